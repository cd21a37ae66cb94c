/* The trees that kernels/bvh.h traverses, built from the flat scene with Embree's builder. */
#ifndef KL_SRC_TRACE_DEVICE_BVH_H
#define KL_SRC_TRACE_DEVICE_BVH_H

#include "kernels/bvh.h"
#include "src/base/status.h"
#include "src/scene/motion.h"

/* Plain arrays, aligned to 64 bytes, ready for upload. Constant once built: any number of threads
 * may read. The same scene gives the same bytes. */
struct kl_device_bvh {
    kl_bvh_node *nodes;
    kl_bvh_leaf *leaves;
    kl_u32 *roots; /* one per instance, then the tree over instances; KL_NONE: empty */
    size_t node_count, leaf_count, root_count;
};

/* Of the flat scene, or in motion (NULL: nothing moves); also sets bvh_* of that view, which then
 * point into *out. *out is the caller's and needs nothing of the flat scene afterwards. Triangles
 * with a coordinate that is not finite or beyond 1e18 are left out, as Embree does. KL_ERR_DEVICE:
 * the builder failed, or the tree is too large or too deep for a kernel. */
kl_status kl_device_bvh_create(struct kl_flat *flat, struct kl_motion *motion,
                               struct kl_device_bvh **out, struct kl_err *err) KL_MUST_CHECK;

void kl_device_bvh_destroy(struct kl_device_bvh *bvh); /* accepts NULL */

#endif
