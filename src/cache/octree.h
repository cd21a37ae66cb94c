/* Builds the index of one level: kernels/cache_data.h says what it looks like,
 * kernels/cache_query.h reads it. */
#ifndef KL_SRC_CACHE_OCTREE_H
#define KL_SRC_CACHE_OCTREE_H

#include "kernels/cache_data.h"
#include "src/base/status.h"

struct kl_octree {
    kl_octree_header head;
    kl_u32 *nodes;
    kl_u32 *rows;
};

/* The cube that cells divide: the same for all levels of a cache. */
struct kl_octree_root {
    float min[3]; /* [m], render space */
    float side;   /* [m], a power of two */
};
/* Smallest power-of-two cube about a bounding sphere, with room around it. */
struct kl_octree_root kl_octree_root_make(const float center[3], float radius);

/* What the queries may ask. */
struct kl_octree_limits {
    float reach;   /* radii enlarged by up to this */
    float cos_max; /* normals apart by up to this angle's cosine */
};

/* Index `count` records. Deterministic. *out is
 * overwritten; free with kl_octree_fini. */
kl_status kl_octree_build(const struct kl_octree_root *root, const kl_record_hot *hot,
                          uint32_t count, const struct kl_octree_limits *limits,
                          struct kl_octree *out, struct kl_err *err) KL_MUST_CHECK;
void kl_octree_fini(struct kl_octree *octree);

#endif
