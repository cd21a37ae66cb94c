/* Frame rate and shutter. Frame f is the instant f / fps; the shutter is centred on it. */
#ifndef KL_SEQUENCES_SHUTTER_H
#define KL_SEQUENCES_SHUTTER_H

#include "src/base/status.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct kl_fps {
    int32_t numerator;    /* > 0 */
    uint32_t denominator; /* > 0 */
};

/* In frames. */
struct kl_shutter {
    double length; /* 0: no blur; 180 degrees are 0.5 */
    double offset; /* of the centre from the frame's instant */
};

/* [s] of the sequence's time. */
struct kl_interval {
    double reference; /* the centre: t = 0 of the frame, where records live */
    double open, close;
};

/* "24", "23.976" (one of the rates that stand for n * 1000 / 1001), "12.5", "24000/1001"; 0.001 to
 * 100000. KL_ERR_USAGE otherwise. */
kl_status kl_fps_parse(const char *text, struct kl_fps *out, struct kl_err *err) KL_MUST_CHECK;
double kl_fps_get(struct kl_fps fps); /* [1/s] */

/* "180" in degrees or "0.5f" in frames. Length: 0 to 10 frames; offset: -10 to 10 frames. */
kl_status kl_shutter_parse_length(const char *text, double *out, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_shutter_parse_offset(const char *text, double *out, struct kl_err *err) KL_MUST_CHECK;

/* How open the shutter is from opening to closing: straight between weights at evenly spaced times.
 */
enum { KL_SHUTTER_WEIGHTS = 64 };
struct kl_shutter_curve {
    uint32_t count; /* 0: fully open all the time */
    double weights[KL_SHUTTER_WEIGHTS];
};

/* "box", "triangle", "cosine", or 2 to 64 weights >= 0 with commas, not all 0. KL_ERR_USAGE
 * otherwise. */
kl_status kl_shutter_parse_curve(const char *text, struct kl_shutter_curve *out,
                                 struct kl_err *err) KL_MUST_CHECK;
/* The time in [0, 1] up to which the share `u` of the light gets in. */
double kl_shutter_curve_time(const struct kl_shutter_curve *curve, double u);

struct kl_interval kl_shutter_interval(const struct kl_shutter *shutter, struct kl_fps fps,
                                       int32_t frame);

#ifdef __cplusplus
}
#endif
#endif
