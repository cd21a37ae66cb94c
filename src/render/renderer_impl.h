/* What the files of the renderer share: renderer.c (instants and frames), renderer_cache.c (what is
 * served and kept on disk), renderer_fill.c (fill and proof). */
#ifndef KL_SRC_RENDER_RENDERER_IMPL_H
#define KL_SRC_RENDER_RENDERER_IMPL_H

#include "src/base/hash.h"
#include "src/render/gatherer.h"
#include "src/render/ledger.h"
#include "src/render/renderer.h"
#include "src/render/revision.h"
#include "src/scene/flat.h"
#include "src/scene/motion.h"
#include "src/scene/scene_parts.h"

#include <math.h>

enum { KL_FIRST_SIDE = 8, KL_TABLES = 6, KL_LAST_SIDE = KL_FIRST_SIDE << (KL_TABLES - 1) };

#define KL_EYE_REACH     1.3f    /* second-pass smoothing: methods of Krivanek 2008 */
#define KL_COS_MAX       0.9394f /* cos(0.35 rad): normals share records up to 20 degrees */
#define KL_LENGTH_SCALE  2.0f
#define KL_GATHER_WEIGHT 0.3f
/* Records of coarser runs serve finer ones too: dependence is judged by this error at most. */
#define KL_TOUCH_ERROR 0.02

struct kl_renderer {
    const struct kl_scene *scene; /* borrowed */
    struct kl_renderer_settings settings;
    bool moving, ready;
    double origin[3];
    float accuracy[KL_CACHE_LEVELS];
    struct kl_flat *flat;
    struct kl_scene_parts parts;
    struct kl_motion *motion; /* while the shutter is open; NULL: nothing moves */
    struct kl_swept *swept;   /* by what moves; NULL: nothing does */
    struct kl_motion *before; /* one frame earlier; NULL: as now */
    struct kl_tracer *tracer;
    struct kl_gatherer *gatherer;
    struct kl_gather_tables
        *tables[KL_TABLES]; /* side KL_FIRST_SIDE, twice that, ...; made when needed */
    struct kl_gather_ladder ladder[KL_CACHE_LEVELS];
    uint8_t scene_digest[KL_HASH_SIZE], settings_digest[KL_HASH_SIZE];
    bool must_keep;         /* of the fill under way */
    char lost[512];         /* why nothing more is kept on disk; "": it is */
    struct kl_cache *cache; /* declared before the store it may borrow from: closed first */
    struct kl_store *store;
    uint8_t *used; /* a byte a record of level 0: it served a frame; NULL: none was to be noted */
    struct kl_revision *revision; /* NULL: the cache is of this edition of the scene */
    bool revised;
    struct kl_revision_summary summary; /* of the revision, if revised */
    struct kl_ledger *ledger;           /* NULL: records are not carried from instant to instant */
    struct kl_stand *stand;    /* how things stand; NULL: the ledger knows it, or there is none */
    double reference, earlier; /* this instant and the one to carry from [s] */
};

/* Queries of what the camera sees take all records, with enlarged radii; those of gather rays are
 * averaged over a hemisphere, so a few records do. */
static inline kl_query kl_renderer_eye_query(void)
{
    return (kl_query){KL_EYE_REACH, KL_COS_MAX, KL_INF};
}
static inline kl_query kl_renderer_gather_query(void)
{
    return (kl_query){1.0f, KL_COS_MAX, KL_GATHER_WEIGHT};
}

/* Share of a record's light from which on it depends on a part of the scene. */
static inline float kl_renderer_touch_share(const struct kl_renderer *r)
{
    return (float)(0.25 * fmin(r->settings.error, KL_TOUCH_ERROR));
}

/* The scene at the reference instant, for rays that may also have other times. */
static inline const kl_scene_view *kl_renderer_reference(const struct kl_renderer *r)
{
    return r->motion != NULL ? &r->motion->reference : &r->flat->view;
}

/* The scene while the shutter is open. */
static inline const kl_scene_view *kl_renderer_motion(const struct kl_renderer *r)
{
    return r->motion != NULL ? &r->motion->view : &r->flat->view;
}

/* Rays a side for at least so many rays, and the tables for it, made when first needed. */
uint32_t kl_renderer_side_for(uint32_t rays);
kl_status kl_renderer_get_tables(struct kl_renderer *r, uint32_t side,
                                 const struct kl_gather_tables **out,
                                 struct kl_err *err) KL_MUST_CHECK;

/* Rays of a gather: side x side, and four times as many in each further step, until the standard
 * error is `noise` times the error that was asked for. `steps`: at most KL_GATHER_STEPS. */
kl_status kl_renderer_climb(struct kl_renderer *r, uint32_t side, uint32_t steps, float noise,
                            struct kl_gather_ladder *out, struct kl_err *err) KL_MUST_CHECK;

/* Tell the store which records served, before it or the cache changes. A folder that cannot be
 * written to, as with frozen caches, is no reason to complain. */
void kl_renderer_tell_use(struct kl_renderer *r);
void kl_renderer_close_cache(struct kl_renderer *r);

/* Is the store one base with all its octrees, which can be served from in place? */
bool kl_renderer_is_compact(const struct kl_store *store);

/* Append a batch of a fill to the store: kl_fill_job.keep_batch, `context` is the renderer. */
kl_status kl_renderer_keep_batch(void *context, uint32_t level, const kl_record_hot *hot,
                                 const kl_record_cold *cold, uint32_t count,
                                 struct kl_err *err) KL_MUST_CHECK;

/* Pick up what other processes have published. What cannot be read now is not missed. */
kl_status kl_renderer_refresh(struct kl_renderer *r, struct kl_err *err) KL_MUST_CHECK;

/* Put the finished cache into one base segment and serve from it. */
kl_status kl_renderer_publish(struct kl_renderer *r, struct kl_err *err) KL_MUST_CHECK;

#endif
