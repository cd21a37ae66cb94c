/* A scene made ready to render, with its cache: what commands drive.
 *
 * Life: create; set_time; then, with indirect light from a cache, open_cache and fill; then any
 * number of frames; again from set_time for another instant of a moving scene. */
#ifndef KL_SRC_RENDER_RENDERER_H
#define KL_SRC_RENDER_RENDERER_H

#include "cache_io/store.h"
#include "src/image/image.h"
#include "src/render/camera.h"
#include "src/render/fill.h"
#include "src/render/frame.h"
#include "src/render/shade.h"
#include "src/render/verify.h"
#include "src/scene/scene.h"

struct kl_renderer;

/* Zero is the default of every field. */
struct kl_renderer_settings {
    enum kl_indirect indirect;
    const char *device;         /* who gathers: "auto" (NULL), "embree", "opencl", "opencl:N" */
    double error;               /* relative error of indirect irradiance to aim at; 0: 0.02 */
    enum kl_radius_rule radius; /* what decides how far records serve */
    uint32_t rays;      /* gather rays of a record seen from the camera, a power of 4; 0: 1024 */
    uint32_t seed;      /* of the image samples */
    uint32_t animation; /* of the scene, KL_NONE: all of them */
    bool carry; /* in a moving scene, fill an instant from the records of the one before, if that
                 * was the last to be filled; else each from nothing */
};

kl_status kl_renderer_create(const struct kl_scene *scene,
                             const struct kl_renderer_settings *settings, struct kl_renderer **out,
                             struct kl_err *err) KL_MUST_CHECK;
void kl_renderer_destroy(struct kl_renderer *renderer); /* accepts NULL */

/* Instants of one frame [s]. */
struct kl_renderer_instants {
    double reference;   /* the shutter's centre: where records live */
    double open, close; /* the same twice: no blur */
    const float *times; /* when the shutter has let in 0, ..., all of the light, KL_SHUTTER_TIMES in
                         * [0, 1]; NULL: open all the time */
    double before;      /* reference of the frame before: motion vectors */
};
/* Go to a frame's instants: as kl_renderer_set_time, and what moves is blurred. */
kl_status kl_renderer_set_instants(struct kl_renderer *renderer,
                                   const struct kl_renderer_instants *instants,
                                   struct kl_err *err) KL_MUST_CHECK;

/* Go to an instant [s]. Cheap where nothing but cameras moves (after the first call): the cache
 * stays open. In a moving scene geometry is built anew and an open cache is closed. */
kl_status kl_renderer_set_time(struct kl_renderer *renderer, double time,
                               struct kl_err *err) KL_MUST_CHECK;
bool kl_renderer_is_moving(const struct kl_renderer *renderer);

/* Scene camera `index` as it stands at `time` [s]. */
kl_status kl_renderer_camera(const struct kl_renderer *renderer, uint32_t index, double time,
                             uint32_t width, uint32_t height, struct kl_camera *out,
                             struct kl_err *err) KL_MUST_CHECK;
/* World position of render space's origin, and the scene's bounding sphere in world space. */
void kl_renderer_get_origin(const struct kl_renderer *renderer, double origin[3]);
void kl_renderer_get_bounds(const struct kl_renderer *renderer, double center[3], double *radius);
/* KL_NEED_* of the instant, lights (all kinds) and triangles after instancing. */
struct kl_renderer_info {
    uint32_t needs, lights;
    uint64_t triangles;
    uint8_t scene_digest[KL_DIGEST_SIZE];
    uint8_t settings_digest[KL_DIGEST_SIZE];
    uint8_t motion_digest[KL_DIGEST_SIZE]; /* of what moves while the shutter is open and how it got
                                            * here from the frame before */
    const char *device;                    /* who gathers, in words; borrowed */
    uint32_t moving_objects, moving_lights, most_steps; /* while the shutter is open */
};
void kl_renderer_get_info(const struct kl_renderer *renderer, struct kl_renderer_info *info);

/* Open the store for the present instant; NULL `dir`: memory only. A moving scene keeps one store
 * per instant in sub-directories of `dir`. KL_ERR_STALE as kl_store_open. */
kl_status kl_renderer_open_cache(struct kl_renderer *renderer, const char *dir,
                                 enum kl_store_mode mode, struct kl_err *err) KL_MUST_CHECK;

struct kl_cache_state {
    uint32_t records[KL_CACHE_LEVELS];
    uint64_t generation, bytes; /* on disk */
    size_t damaged;             /* segments left out, in whole or in part */
    const char *lost;           /* why nothing more is kept on disk, NULL: it is; borrowed */
};
void kl_renderer_get_cache(const struct kl_renderer *renderer, struct kl_cache_state *state);

/* A cache that was made for an earlier edition of the scene: what was edited, how many records it
 * had, and how many of them were kept; `refreshed` more are gathered again where they are. False:
 * the open cache is of this edition. The first fill brings it up to date; before it, the numbers
 * are of what the records' own rays met. */
struct kl_renderer_revision {
    char text[256];
    uint32_t had, kept, refreshed;
};
bool kl_renderer_get_revision(const struct kl_renderer *renderer,
                              struct kl_renderer_revision *revision);

struct kl_renderer_fill {
    const struct kl_camera *cameras; /* one or more per frame that will be rendered */
    uint32_t camera_count;
    bool keep;      /* write batches and the finished cache to the store */
    bool must_keep; /* fail where the disk refuses; else go on in memory (kl_cache_state.lost) */
    bool measure;   /* extend until the measured error is what was asked for */
    bool (*progress)(void *context, int stage, double done, uint32_t records);
    void *progress_context;
};
kl_status kl_renderer_fill(struct kl_renderer *renderer, const struct kl_renderer_fill *fill,
                           struct kl_fill_stats *stats, struct kl_err *err) KL_MUST_CHECK;

/* Compare the cache with gathers of many rays at `share` of the points that the camera sees:
 * kl_verify. `all` may be NULL. */
kl_status kl_renderer_verify(struct kl_renderer *renderer, const struct kl_camera *camera,
                             double share, struct kl_verify_errors *all,
                             struct kl_verify_stats *stats, struct kl_err *err) KL_MUST_CHECK;

/* A cache whose look-ups are blended into those of the frame's own, which weighs 1. */
struct kl_renderer_blend {
    struct kl_renderer *renderer; /* of the same scene, at another instant, its cache open */
    float weight;
};

struct kl_renderer_frame {
    struct kl_camera camera, before; /* before: one frame earlier, for motion vectors */
    const struct kl_camera *cameras; /* while the shutter is open, evenly spaced; NULL: still */
    uint32_t camera_count;
    const float *times; /* as kl_renderer_instants; NULL: open all the time */
    const struct kl_renderer_blend
        *blend; /* each asked where the surface point is at its instant */
    uint32_t blend_count;
    int64_t frame; /* number: decides the image samples */
    uint32_t spp;
    bool note_use; /* tell the store which records served, when the cache is closed */
    bool (*progress)(void *context, double done);
    void *progress_context;
};
/* Render into the channels of `image` (kl_frame_add_layers). */
kl_status kl_renderer_frame(struct kl_renderer *renderer, const struct kl_renderer_frame *frame,
                            struct kl_image *image, struct kl_counts *counts, uint64_t *bad_samples,
                            struct kl_err *err) KL_MUST_CHECK;

#endif
