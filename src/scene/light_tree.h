/* Binary tree over the lights that are somewhere (kernels/light_choice.h walks it). */
#ifndef KL_SRC_SCENE_LIGHT_TREE_H
#define KL_SRC_SCENE_LIGHT_TREE_H

#include "kernels/scene_data.h"
#include "src/base/status.h"

/* Where lights are and where they shine. */
struct kl_light_bounds {
    float box_min[3], box_max[3];
    float axis[3], cos_cone; /* emitting normals lie within this cone about axis; -1: any */
    float power;             /* kl_light_power of all of them */
    uint32_t two_sided;      /* 1: also against the cone */
};

void kl_light_bounds_init(const kl_light *light, struct kl_light_bounds *out);
/* Holds both; power is the sum. `out` is neither. */
void kl_light_bounds_merge(const struct kl_light_bounds *a, const struct kl_light_bounds *b,
                           struct kl_light_bounds *out);

/* lights[first .. count) are point, spot and triangle lights, all with power > 0. Sets their
 * `leaf`. `leaves`: per light (all of them, from 0) where it is, or NULL: where it stands. *nodes
 * gets 2 * (count - first) - 1 nodes, the caller's to free(); none: NULL and 0. */
kl_status kl_light_tree_build(kl_light *lights, uint32_t first, uint32_t count,
                              const struct kl_light_bounds *leaves, kl_light_node **nodes,
                              uint32_t *node_count, struct kl_err *err) KL_MUST_CHECK;

/* Luminous power of a light up to the factor that all share: what choosing goes by. */
float kl_light_power(const kl_light *light);

#endif
