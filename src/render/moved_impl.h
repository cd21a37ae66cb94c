/* Private to src/render/moved.c and stand.c. */
#ifndef KL_SRC_RENDER_MOVED_IMPL_H
#define KL_SRC_RENDER_MOVED_IMPL_H

#include "src/base/hash.h"
#include "src/render/moved.h"

/* An instance of a mesh: a box in a space of its own. */
struct kl_thing {
    uint32_t object;
    bool deforms;
    double world_from_box[16]; /* column major; of what deforms the identity */
    double lo[3], hi[3];       /* of what deforms: wherever it gets to while the shutter is open */
    uint8_t vertices[KL_HASH_SIZE]; /* digest; of what deforms */
    uint32_t steps;                 /* kl_moved_box */
    float *ways;
};

struct kl_stand {
    double origin[3];
    double margin;
    uint32_t thing_count, object_count;
    struct kl_thing *things;
    kl_u32 *bits;                /* per object: kernels/parts.h */
    uint8_t light[KL_HASH_SIZE]; /* digest of lights and materials */
};

#endif
