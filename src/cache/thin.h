/* Choosing where records go: candidates are taken in a random order and dropped where one that was
 * taken is near. That is dart throwing: what stays is a blue-noise set. */
#ifndef KL_SRC_CACHE_THIN_H
#define KL_SRC_CACHE_THIN_H

#include "kernels/vec.h"
#include "src/base/status.h"

#include <stddef.h>
#include <stdint.h>

struct kl_candidate {
    kl_vec3 pos, normal, geometric; /* render space; normals unit */
    float spacing;                  /* [m] least radius */
    float exclude;                  /* [m] no other record within this distance, normals alike */
    uint32_t rank;                  /* order: smaller first; ties by position in the array */
};

/* Sorts candidates by rank, moves those that stay to the front and returns their number in *kept,
 * at most `limit`. cos_alike: normals further apart do not exclude each other. */
kl_status kl_thin(struct kl_candidate *candidates, size_t count, float cos_alike, size_t limit,
                  size_t *kept, struct kl_err *err) KL_MUST_CHECK;

#endif
