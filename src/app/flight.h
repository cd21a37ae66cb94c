/* Cameras that are not in the scene: orbits and keyframed paths, in world space. */
#ifndef KL_SRC_APP_FLIGHT_H
#define KL_SRC_APP_FLIGHT_H

#include "sequences/look.h"
#include "src/base/status.h"

#include <stdint.h>

struct kl_flight;

/* An orbit of `count` frames round a sphere that fits in the picture: frame 1 is where it begins.
 * *out is the caller's: kl_flight_destroy. */
struct kl_flight_orbit {
    double center[3], radius; /* [m] world */
    double yfov, aspect;
    double start; /* [rad] azimuth of frame 1, from +Z towards +X */
    uint32_t count;
};
kl_status kl_flight_create_orbit(const struct kl_flight_orbit *orbit, struct kl_flight **out,
                                 struct kl_err *err) KL_MUST_CHECK;
/* docs/sequence_format.md. `yfov` where the file gives none. */
kl_status kl_flight_create_path(const char *file, double fps, double yfov, struct kl_flight **out,
                                struct kl_err *err) KL_MUST_CHECK;
void kl_flight_destroy(struct kl_flight *flight); /* accepts NULL */

/* The view at frame `frame` + `fraction`. */
void kl_flight_get_view(const struct kl_flight *flight, int64_t frame, double fraction,
                        struct kl_look *out);
/* First and last instant of a path [s]; not for an orbit. */
void kl_flight_get_range(const struct kl_flight *flight, double *first, double *last);

#endif
