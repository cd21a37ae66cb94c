/* Binary tree over the lights that are somewhere (kernels/lights.h walks it). */
#ifndef KL_SRC_SCENE_LIGHT_TREE_H
#define KL_SRC_SCENE_LIGHT_TREE_H

#include "kernels/scene_data.h"
#include "src/base/status.h"

/* What the tree knows of a light: a leaf without links. */
void kl_light_node_init(const kl_light *light, kl_light_node *node);
/* Holds both; power is the sum. Links are not touched. */
void kl_light_node_merge(const kl_light_node *a, const kl_light_node *b, kl_light_node *out);

/* lights[first .. count) are point, spot and triangle lights, all with power > 0. Sets their
 * `leaf`. `leaves`: per light (all of them, from 0) what the tree is to know of it, or NULL. *nodes
 * gets 2 * (count - first) - 1 nodes, the caller's to free(); none: NULL and 0. */
kl_status kl_light_tree_build(kl_light *lights, uint32_t first, uint32_t count,
                              const kl_light_node *leaves, kl_light_node **nodes,
                              uint32_t *node_count, struct kl_err *err) KL_MUST_CHECK;

/* Luminous power of a light up to the factor that all share: what choosing goes by. */
float kl_light_power(const kl_light *light);

#endif
