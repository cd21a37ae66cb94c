/* What render and bake share: options made into a scene, a renderer, frames and their cameras. */
#ifndef KL_SRC_APP_JOB_H
#define KL_SRC_APP_JOB_H

#include "sequences/plan.h"
#include "src/app/options.h"
#include "src/app/progress.h"
#include "src/app/rig.h"
#include "src/render/renderer.h"
#include "src/scene/scene.h"

enum { KL_JOB_PATH_SIZE = 4096, KL_SHUTTER_TIMES = 257 };

struct kl_job_frame {
    int32_t frame;
    struct kl_renderer_instants instants;
    struct kl_camera camera, before; /* before: one frame earlier */
    struct kl_camera *cameras;       /* while the shutter is open; NULL: it stands still */
    uint32_t camera_count;
};

struct kl_job {
    const struct kl_options *options; /* borrowed */
    struct kl_scene *scene;
    struct kl_renderer *renderer;
    struct kl_rig *rig;
    uint32_t animation; /* KL_NONE: all */
    size_t frame_count;
    struct kl_job_frame *frames;             /* in the order of --frames */
    char pattern[KL_JOB_PATH_SIZE];          /* of image files */
    char cache_dir[KL_JOB_PATH_SIZE];        /* where the cache lies, if it lies anywhere */
    bool has_cache, has_store, fills, keeps; /* indirect light from a cache; which is on disk; is
                                                filled; and written */
    bool said_revision;
    bool is_open; /* the cache of the present instant */
    uint64_t open_count;
    bool must_keep;       /* what is not kept on disk is worth nothing: bake */
    bool told_lost;       /* that the disk takes no more */
    uint32_t loaded;      /* records that the last opening found */
    float *shutter_times; /* KL_SHUTTER_TIMES of the curve, NULL: open all the time */
    struct kl_progress progress;
};

/* Import, choose, open; the renderer stands at the first frame's instant. *job is set up also after
 * a failure: kl_job_fini. Options must outlive the job. */
kl_status kl_job_init(struct kl_job *job, const struct kl_options *options,
                      struct kl_err *err) KL_MUST_CHECK;
void kl_job_fini(struct kl_job *job);

/* Go to the instant of frame i and open the cache for it, unless it is open already. */
kl_status kl_job_enter(struct kl_job *job, size_t i, struct kl_err *err) KL_MUST_CHECK;
/* Fill for frames i to i + count - 1 (entered), if the cache mode fills at all. */
kl_status kl_job_fill(struct kl_job *job, size_t i, size_t count, struct kl_fill_stats *stats,
                      struct kl_err *err) KL_MUST_CHECK;
uint32_t kl_job_records(const struct kl_job *job); /* in the open cache */

/* Where the image of frame i goes. */
kl_status kl_job_image_path(const struct kl_job *job, size_t i, char out[KL_JOB_PATH_SIZE],
                            struct kl_err *err) KL_MUST_CHECK;
/* Digest of all that decides the pixels of frame i, once entered, but scene and frame number. With
 * a frozen cache its generation counts too: another state of it makes other pixels. */
void kl_job_settings_digest(const struct kl_job *job, size_t i, uint8_t digest[KL_DIGEST_SIZE]);

#endif
