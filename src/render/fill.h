/* Filling the cache: find where it does not serve, gather there, insert, until it serves. */
#ifndef KL_SRC_RENDER_FILL_H
#define KL_SRC_RENDER_FILL_H

#include "src/cache/cache.h"
#include "src/device/gather.h"
#include "src/render/camera.h"

#include <stdbool.h>

/* What a batch is gathered by: the host or a device. */
typedef kl_status (*kl_gather_fn)(void *context, const struct kl_gather_job *job,
                                  struct kl_err *err);
/* Told about every batch that was inserted, to keep it on disk. */
typedef kl_status (*kl_batch_fn)(void *context, uint32_t level, const kl_record_hot *hot,
                                 const kl_record_cold *cold, uint32_t count, struct kl_err *err);

/* What counts as served. */
struct kl_served {
    kl_query query;
    float least_weight; /* the weights sum to at least this */
    float most_way;     /* mean way from the records to the point, in their mean radius, at most */
};

struct kl_fill_job {
    const kl_scene_view *scene, *motion; /* at the reference instant; while the shutter is open,
                                          * where rays have times: the same if nothing moves */
    struct kl_cache *cache;
    float scene_radius;
    struct kl_radius_settings radius; /* accuracy is the cache's own */
    const struct kl_camera *cameras;  /* one per frame */
    uint32_t camera_count;
    struct kl_gather_ladder ladder[KL_CACHE_LEVELS];
    kl_gather_settings gather;                /* side and sets are set per level */
    struct kl_served served[KL_CACHE_LEVELS]; /* records are placed where a point is not */
    float spacing_px;                         /* least radius in pixels */
    float uncovered;                          /* share of pixels that may stay without */
    uint32_t batch;                           /* records at most */
    kl_gather_fn gather_batch;
    void *gather_context;
    kl_batch_fn keep_batch; /* may be NULL */
    void *keep_context;
    /* stage 0: surfaces that gather rays reach; 1: what the cameras see. True asks to stop. */
    bool (*progress)(void *context, int stage, double done, uint32_t records);
    void *progress_context;
};

struct kl_fill_stats {
    uint64_t primary_rays, gather_rays;
    uint32_t added[KL_CACHE_LEVELS];
    uint32_t batches;
    double uncovered;   /* share of pixels at the end, worst frame */
    double measured;    /* 95th percentile of the relative error of irradiance in the end; 0: not
                         * measured, because nobody asked or nothing was added */
    uint32_t refreshed; /* records gathered again where they are, after an edit of the scene, or of
                         * which rays were shot again as things moved */
    double visibility_seconds, gather_seconds, insert_seconds;
};

/* Fill both levels for all cameras, then sort and index (kl_cache_finish). Running it again on its
 * result adds nothing. KL_ERR_INTERRUPTED: progress asked to stop; batches so far are in the cache
 * and were kept. */
kl_status kl_fill(const struct kl_fill_job *job, struct kl_fill_stats *stats,
                  struct kl_err *err) KL_MUST_CHECK;

#endif
