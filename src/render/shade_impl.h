/* Private to src/render/shade*.c. */
#ifndef KL_SRC_RENDER_SHADE_IMPL_H
#define KL_SRC_RENDER_SHADE_IMPL_H

#include "src/render/shade.h"

/* Share of a strategy with density p against another with density q: power heuristic, exponent 2.
 */
static inline float kl_power_weight(float p, float q)
{
    const float p2 = p * p;
    const float q2 = q * q;
    return p2 + q2 > 0.0f ? p2 / (p2 + q2) : 0.0f;
}

/* Where the last bounce came from: what an emitter that is hit by chance is weighed with. */
struct kl_bounce {
    float pdf;   /* of the direction, 0: straight from the camera */
    kl_vec3 pos; /* where it started */
    kl_vec3 normal;
};

/* Radiance of the emitter or sky that a ray ran into, weighed against light sampling. hit NULL: the
 * ray left the scene. */
kl_vec3 kl_shade_emission(const struct kl_shade_context *context, const kl_ray *ray,
                          const kl_hit *hit, const kl_surface *surface,
                          const struct kl_bounce *from);

/* How directions are drawn besides light samples: the base's with density diffuse * cos / pi, the
 * lobe's with density specular * its own. 0: never, so the light sample has all of that part. */
struct kl_lobes {
    float diffuse, specular;
    bool mixed; /* one direction is drawn from both together, not one from each */
};

/* One light sample, reflected towards wo by base and lobe, each weighed against those densities. */
struct kl_direct {
    kl_vec3 diffuse, specular;
};
struct kl_direct kl_shade_direct(const struct kl_shade_context *context, const kl_surface *surface,
                                 kl_vec3 wo, kl_vec3 albedo, const struct kl_lobes *lobes,
                                 kl_sampler *sampler, struct kl_counts *counts);

#endif
