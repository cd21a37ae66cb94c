/* What render and bake share: options made into a scene, a renderer, frames and their cameras. */
#ifndef KL_SRC_APP_JOB_H
#define KL_SRC_APP_JOB_H

#include "sequences/plan.h"
#include "src/app/options.h"
#include "src/app/progress.h"
#include "src/app/rig.h"
#include "src/render/renderer.h"
#include "src/scene/scene.h"

enum { KL_JOB_PATH_SIZE = 4096 };

struct kl_job_frame {
    int32_t frame;
    struct kl_renderer_instants instants;
    struct kl_camera camera, before; /* before: one frame earlier */
    struct kl_camera *cameras;       /* while the shutter is open; NULL: it stands still */
    uint32_t camera_count;
};

/* A frame's instant, with a renderer of its own. */
struct kl_job_instant {
    struct kl_renderer *renderer;
    int32_t frame;   /* that the renderer stands at, if is_placed */
    bool is_placed;  /* it stands at `frame`, or nothing moves */
    bool is_open;    /* so is its cache */
    bool is_filled;  /* and filled for the frame */
    uint32_t loaded; /* records that the last opening found */
};

struct kl_job {
    const struct kl_options *options; /* borrowed */
    struct kl_scene *scene;
    int32_t blend;                   /* frames each way whose caches are blended */
    struct kl_job_instant *instants; /* 2 * blend + 1, by frame number modulo that */
    struct kl_renderer *renderer;    /* of the frame entered; one of theirs */
    struct kl_rig *rig;
    uint32_t animation; /* KL_NONE: all */
    size_t frame_count;
    struct kl_job_frame *frames;             /* in the order of --frames */
    char pattern[KL_JOB_PATH_SIZE];          /* of image files */
    char cache_dir[KL_JOB_PATH_SIZE];        /* where the cache lies, if it lies anywhere */
    bool has_cache, has_store, fills, keeps; /* indirect light from a cache; which is on disk; is
                                                filled; and written */
    bool said_revision;
    uint64_t open_count;
    bool must_keep;       /* what is not kept on disk is worth nothing: bake */
    bool told_lost;       /* that the disk takes no more */
    float *shutter_times; /* KL_SHUTTER_TIMES of the curve, NULL: open all the time */
    struct kl_progress progress;
};

/* Import, choose, open; the renderer stands at the first frame's instant. --cache-blend counts only
 * where things move; else a line says that it does nothing. *job is set up also after a failure:
 * kl_job_fini. Options must outlive the job. */
kl_status kl_job_init(struct kl_job *job, const struct kl_options *options,
                      struct kl_err *err) KL_MUST_CHECK;
void kl_job_fini(struct kl_job *job);

/* Go to the instant of frame i, and with other renderers to those whose caches are blended into
 * its own; what stands there already stays. */
kl_status kl_job_visit(struct kl_job *job, size_t i, struct kl_err *err) KL_MUST_CHECK;
/* The same, and open the caches that are not open already. */
kl_status kl_job_enter(struct kl_job *job, size_t i, struct kl_err *err) KL_MUST_CHECK;
/* Records that were there when the cache of frame i (entered) was opened. */
uint32_t kl_job_loaded(const struct kl_job *job, size_t i);
/* Fill for frames i to i + count - 1 (entered), if the cache mode fills at all. In a moving scene
 * count is 1, and the caches that are blended are filled for their own frames. */
kl_status kl_job_fill(struct kl_job *job, size_t i, size_t count, struct kl_fill_stats *stats,
                      struct kl_err *err) KL_MUST_CHECK;
uint32_t kl_job_records(const struct kl_job *job); /* in the open cache */

/* What to blend into frame i (entered); their number. */
uint32_t kl_job_blend(const struct kl_job *job, size_t i,
                      struct kl_renderer_blend out[2 * KL_CACHE_BLEND_MOST]);

/* Where the image of frame i goes. */
kl_status kl_job_image_path(const struct kl_job *job, size_t i, char out[KL_JOB_PATH_SIZE],
                            struct kl_err *err) KL_MUST_CHECK;
/* Digest of all that decides the pixels of frame i, once entered, but scene and frame number. With
 * a frozen cache its generation counts too: another state of it makes other pixels. */
void kl_job_settings_digest(const struct kl_job *job, size_t i, uint8_t digest[KL_DIGEST_SIZE]);

#endif
