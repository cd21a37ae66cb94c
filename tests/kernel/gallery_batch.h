/* A batch of gathers as a render makes it: a thousand record positions of the gallery, with filled
 * records for the rays to end in. For tests and benchmarks. */
#ifndef KL_TESTS_KERNEL_GALLERY_BATCH_H
#define KL_TESTS_KERNEL_GALLERY_BATCH_H

#include "cache_io/store.h"
#include "src/device/gather.h"
#include "src/render/renderer.h"
#include "src/scene/flat.h"
#include "src/trace/tracer.h"

#include <stdbool.h>

struct gallery_batch {
    struct kl_scene *scene;
    struct kl_renderer *renderer; /* made the store */
    struct kl_flat *flat;
    struct kl_tracer *tracer;
    struct kl_store *store;
    struct kl_gather_tables *tables;
    kl_level_view level1;
    kl_gather_point *points;
    size_t count;
    char dir[64];
};

/* false and a line on stdout: the gallery is not there (KEEPLIGHT_DATA or ../shared), or a part
 * failed. `side` x `side` rays, at most `count` points. */
bool gallery_batch_init(struct gallery_batch *batch, uint32_t side, size_t count);
void gallery_batch_fini(struct gallery_batch *batch);
struct kl_gather_job gallery_batch_job(const struct gallery_batch *batch,
                                       kl_gather_result *results);

#endif
