/* Points with values, in a tree of boxes. Their nearest, and the lower envelope of cones: the
 * smallest value_k + |x - x_k|. Neighbour clamping of radii (Krivanek et al., "Making radiance and
 * irradiance caching practical", 2006) is this envelope at the records themselves, and because
 * distances obey the triangle inequality one simultaneous pass over the original values is the
 * fixpoint: no order, no iteration. */
#ifndef KL_SRC_CACHE_POINT_TREE_H
#define KL_SRC_CACHE_POINT_TREE_H

#include "src/base/status.h"

#include <stdint.h>

struct kl_point_tree;

struct kl_tree_point {
    float pos[3];
    float value; /* > 0 */
};

/* Copies the points; a point's number is its place among them. *out is the caller's:
 * kl_point_tree_destroy. */
kl_status kl_point_tree_create(const struct kl_tree_point *points, uint32_t count,
                               struct kl_point_tree **out, struct kl_err *err) KL_MUST_CHECK;
void kl_point_tree_destroy(struct kl_point_tree *tree); /* accepts NULL */

/* min(limit, min_k(value_k + |pos - x_k|)). Threads: any number at once. */
float kl_point_tree_envelope(const struct kl_point_tree *tree, const float pos[3], float limit);

enum { KL_NEAREST_MOST = 128 };

/* The `most` (<= KL_NEAREST_MOST) nearest points within `radius` of pos: their numbers, nearest
 * first, into found; how many. Of points that are equally far the one with the smaller coordinates
 * comes first, then the smaller value. Threads: any number at once. */
uint32_t kl_point_tree_nearest(const struct kl_point_tree *tree, const float pos[3], float radius,
                               uint32_t most, uint32_t *found);

#endif
