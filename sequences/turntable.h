/* A camera that circles a bounding sphere once in N frames. */
#ifndef KL_SEQUENCES_TURNTABLE_H
#define KL_SEQUENCES_TURNTABLE_H

#include "sequences/look.h"
#include "src/base/status.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct kl_turntable {
    double centre[3]; /* [m] world */
    double radius;    /* [m] of the sphere that has to fit in the picture, > 0 */
    double yfov;      /* [rad] within (0, pi) */
    double aspect;    /* width / height, > 0 */
    double elevation; /* [rad] above the horizon, within (-pi/2, pi/2) */
    double start;     /* [rad] azimuth of index 0 from +Z towards +X */
    uint32_t count;   /* frames of a full turn, > 0 */
};

/* KL_ERR_USAGE: a value is out of its range. */
kl_status kl_turntable_check(const struct kl_turntable *turntable,
                             struct kl_err *err) KL_MUST_CHECK;

/* Pose of frame `index` (0 is the first; any number, modulo count, so that index `count` is index 0
 * bit for bit) plus a fraction of a frame for motion blur. Up is +Y. The turntable must have passed
 * kl_turntable_check. */
void kl_turntable_pose(const struct kl_turntable *turntable, int64_t index, double fraction,
                       struct kl_look *out);

#ifdef __cplusplus
}
#endif
#endif
