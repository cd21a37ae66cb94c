/* Records of a level that are being made ready to be indexed. */
#ifndef KL_SRC_CACHE_RECORD_SET_H
#define KL_SRC_CACHE_RECORD_SET_H

#include "kernels/cache_query.h"
#include "src/cache/point_tree.h"

struct kl_record_set {
    kl_record_hot *hot; /* their radii are what is made ready */
    const kl_record_cold *cold;
    uint32_t count;
    const struct kl_point_tree *tree; /* of their positions, numbered alike */
    float reach, cos_max;             /* the largest of all queries: see kl_query */
};

#endif
