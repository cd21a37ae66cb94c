/* Lower envelope of cones: the smallest value_k + |x - x_k| over a set of points. Neighbour
 * clamping of radii (Krivanek et al., "Making radiance and irradiance caching practical", 2006) is
 * this envelope at the records themselves, and because distances obey the triangle inequality one
 * simultaneous pass over the original values is the fixpoint: no order, no iteration. */
#ifndef KL_SRC_CACHE_FALLOFF_H
#define KL_SRC_CACHE_FALLOFF_H

#include "src/base/status.h"

#include <stdint.h>

struct kl_falloff;

struct kl_falloff_point {
    float pos[3];
    float value; /* > 0 */
};

/* Copies the points. *out is the caller's: kl_falloff_destroy. */
kl_status kl_falloff_create(const struct kl_falloff_point *points, uint32_t count,
                            struct kl_falloff **out, struct kl_err *err) KL_MUST_CHECK;
void kl_falloff_destroy(struct kl_falloff *falloff); /* accepts NULL */

/* min(limit, min_k(value_k + |pos - x_k|)). Threads: any number at once. */
float kl_falloff_at(const struct kl_falloff *falloff, const float pos[3], float limit);

#endif
