#include "src/render/renderer.h"

#include "cache_io/records.h"
#include "cache_io/use.h"
#include "src/base/clock.h"
#include "src/base/hash.h"
#include "src/base/memory.h"
#include "src/render/gatherer.h"
#include "src/render/revision.h"
#include "src/render/swept.h"
#include "src/render/turn.h"
#include "src/scene/digest.h"
#include "src/scene/flat.h"
#include "src/scene/motion.h"
#include "src/scene/scene_parts.h"
#include "src/trace/tracer.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Changes whenever the same scene and settings would give other records. */
static const uint32_t algorithm_version = 1;

static const float reach = 1.4f;      /* second-pass smoothing: methods of Krivanek 2008 */
static const float cos_max = 0.9394f; /* cos(0.35 rad): normals share records up to 20 degrees */
static const float least_weight = 0.3f;
static const float spacing_px = 1.5f;
static const float uncovered = 5e-4f;
static const float length_scale = 2.0f;
static const float gather_weight = 0.3f;
/* Records of coarser runs serve finer ones too: dependence is judged by this error at most. */
static const double touch_error = 0.02;
enum { BATCH = 4096, DEFAULT_RAYS = 1024, LADDER = 3 };
enum { FIRST_SIDE = 8, TABLES = 6, LAST_SIDE = FIRST_SIDE << (TABLES - 1) };
enum { MEASURED_POINTS = 256, MEASURE_ROUNDS = 8, VERIFY_SIDE = LAST_SIDE / 2 };
/* Standard errors are told by quarter blocks, 1.5 times too large on average. Those of records
 * reach the error that was asked for, those of the references for proof a quarter of it. */
static const float record_noise = 1.5f;
static const float reference_noise = 0.375f;
/* Of the error: a few hundred points say it within 15 %. */
static const double measured_share = 0.85;

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
        *tables[TABLES]; /* side FIRST_SIDE, twice that, ...; made when needed */
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
};

/* Radius over raw radius for an error to aim at. Both rules leave out the second-order term: the
 * radius is where it reaches the error. */
static float accuracy_for(enum kl_radius_rule rule, double error)
{
    return (float)sqrt((rule == KL_RADIUS_HESSIAN ? 1.0 : 4.0) * error);
}

static uint32_t side_for(uint32_t rays)
{
    uint32_t side = FIRST_SIDE;
    while (side < LAST_SIDE && side * side < rays) {
        side *= 2;
    }
    return side;
}

static kl_status get_tables(struct kl_renderer *r, uint32_t side,
                            const struct kl_gather_tables **out, struct kl_err *err)
{
    uint32_t i = 0;
    while ((uint32_t)FIRST_SIDE << i < side) {
        ++i;
    }
    kl_status st = KL_OK;
    if (r->tables[i] == NULL) st = kl_gather_tables_create(side, &r->tables[i], err);
    *out = r->tables[i];
    return st;
}

/* Records that the camera sees climb until their noise is good enough; gather rays average over
 * many of those they end in, which get a quarter of the rays. */
static kl_status make_ladders(struct kl_renderer *r, struct kl_err *err)
{
    const uint32_t side = side_for(r->settings.rays);
    struct kl_gather_ladder *eye = &r->ladder[0];
    kl_status st = get_tables(r, side > FIRST_SIDE ? side / 2 : side, &r->ladder[1].steps[0], err);
    r->ladder[1].count = 1;
    eye->tolerance = record_noise * (float)r->settings.error;
    for (uint32_t s = side; st == KL_OK && eye->count < LADDER && s <= LAST_SIDE; s *= 2) {
        st = get_tables(r, s, &eye->steps[eye->count++], err);
    }
    return st;
}

static void digest_settings(struct kl_renderer *r)
{
    const uint32_t numbers[] = {algorithm_version, r->ladder[0].steps[0]->side,
                                (uint32_t)r->settings.radius};
    const float floats[] = {cos_max, length_scale, reach};
    struct kl_hash h;
    kl_hash_init(&h);
    kl_hash_update(&h, numbers, sizeof numbers);
    kl_hash_update(&h, floats, sizeof floats);
    kl_hash_finish(&h, r->settings_digest);
}

kl_status kl_renderer_create(const struct kl_scene *scene,
                             const struct kl_renderer_settings *settings, struct kl_renderer **out,
                             struct kl_err *err)
{
    struct kl_renderer *r = NULL;
    struct kl_pose *pose = NULL;
    kl_status st = kl_alloc_array(&r, 1, sizeof *r, err);

    if (st != KL_OK) return st;
    r->scene = scene;
    r->settings = *settings;
    if (r->settings.error <= 0.0) r->settings.error = 0.02;
    if (r->settings.rays == 0) r->settings.rays = DEFAULT_RAYS;
    r->moving = kl_scene_is_moving(scene, settings->animation);
    st = kl_pose_create(scene, settings->animation, 0.0, &pose, err);
    if (st == KL_OK) st = kl_flat_choose_origin(scene, pose, r->origin, err);
    if (st == KL_OK) st = make_ladders(r, err);
    kl_pose_destroy(pose);
    if (st != KL_OK) {
        kl_renderer_destroy(r);
        return st;
    }
    digest_settings(r);
    *out = r;
    return KL_OK;
}

/* Tell the store which records served, before it or the cache changes. A folder that cannot be
 * written to, as with frozen caches, is no reason to complain. */
static void tell_use(struct kl_renderer *r)
{
    struct kl_err ignored;

    if (r->used != NULL) {
        const struct kl_level_arrays level = kl_cache_get_arrays(r->cache, 0);
        (void)!kl_use_publish(r->store, level.hot, level.record_count, r->used, &ignored);
    }
    free(r->used);
    r->used = NULL;
}

static void close_cache(struct kl_renderer *r)
{
    tell_use(r);
    kl_cache_destroy(r->cache);
    kl_store_close(r->store);
    kl_revision_close(r->revision);
    r->revision = NULL;
    r->revised = false;
    r->cache = NULL;
    r->store = NULL;
}

static void leave_instant(struct kl_renderer *r)
{
    close_cache(r);
    kl_gatherer_destroy(r->gatherer);
    kl_tracer_destroy(r->tracer);
    kl_motion_destroy(r->motion);
    kl_motion_destroy(r->before);
    kl_swept_destroy(r->swept);
    kl_parts_fini(&r->parts);
    kl_flat_destroy(r->flat);
    r->gatherer = NULL;
    r->tracer = NULL;
    r->motion = NULL;
    r->before = NULL;
    r->swept = NULL;
    r->flat = NULL;
    r->ready = false;
}

void kl_renderer_destroy(struct kl_renderer *renderer)
{
    if (renderer == NULL) return;
    leave_instant(renderer);
    for (int i = 0; i < TABLES; ++i) {
        kl_gather_tables_destroy(renderer->tables[i]);
    }
    free(renderer);
}

bool kl_renderer_is_moving(const struct kl_renderer *renderer)
{
    return renderer->moving;
}

/* Share of a record's light from which on it depends on a part of the scene. */
static float touch_share(const struct kl_renderer *r)
{
    return (float)(0.25 * fmin(r->settings.error, touch_error));
}

/* What the scene is made of, and how records are gathered in it. */
static kl_status make_parts(struct kl_renderer *r, const struct kl_pose *pose, struct kl_err *err)
{
    const uint32_t side = r->ladder[0].steps[0]->side;
    char label[KL_PART_LABEL];
    kl_status st = kl_parts_init(r->scene, pose, r->flat, &r->parts, err);

    if (st != KL_OK) return st;
    (void)snprintf(label, sizeof label, "%u rays, version %u", side * side, algorithm_version);
    kl_parts_add_settings(&r->parts, label);
    return KL_OK;
}

/* What moves, and rays that see it move. */
static kl_status set_motion(struct kl_renderer *r, const struct kl_pose *pose,
                            const struct kl_renderer_instants *t, struct kl_err *err)
{
    const struct kl_motion_span open = {t->open, t->close};
    const struct kl_motion_span before = {t->before, t->before};
    kl_status st = KL_OK;

    if (r->moving && t->close > t->open) {
        st = kl_motion_create(r->scene, r->settings.animation, pose, r->flat, &open, &r->motion,
                              err);
    }
    if (st == KL_OK && r->moving && t->before != t->reference) {
        st = kl_motion_create(r->scene, r->settings.animation, pose, r->flat, &before, &r->before,
                              err);
    }
    if (st == KL_OK && r->motion != NULL) st = kl_swept_create(r->motion, &r->swept, err);
    if (st != KL_OK) return st;
    return r->motion != NULL ? kl_tracer_create_moving(r->flat, r->motion, &r->tracer, err)
                             : kl_tracer_create(r->flat, &r->tracer, err);
}

/* The scene at the reference instant, for rays that may also have other times. */
static const kl_scene_view *reference_view(const struct kl_renderer *r)
{
    return r->motion != NULL ? &r->motion->reference : &r->flat->view;
}

kl_status kl_renderer_set_time(struct kl_renderer *renderer, double time, struct kl_err *err)
{
    const struct kl_renderer_instants instants = {time, time, time, time};
    return kl_renderer_set_instants(renderer, &instants, err);
}

kl_status kl_renderer_set_instants(struct kl_renderer *renderer,
                                   const struct kl_renderer_instants *instants, struct kl_err *err)
{
    struct kl_renderer *r = renderer;
    const double time = r->moving ? instants->reference : 0.0;
    struct kl_pose *pose = NULL;
    kl_status st = KL_OK;

    if (r->ready && !r->moving) return KL_OK;
    leave_instant(r);
    st = kl_pose_create(r->scene, r->settings.animation, time, &pose, err);
    if (st == KL_OK) st = kl_flat_create(r->scene, pose, r->origin, &r->flat, err);
    if (st == KL_OK) st = make_parts(r, pose, err);
    if (st == KL_OK) st = set_motion(r, pose, instants, err);
    if (st == KL_OK && r->settings.indirect == KL_INDIRECT_CACHE) {
        st = kl_gatherer_create(r->settings.device, r->flat, &r->gatherer, err);
    }
    kl_pose_destroy(pose);
    if (st != KL_OK) {
        leave_instant(r);
        return st;
    }
    kl_flat_digest(r->flat, r->scene_digest);
    r->ready = true;
    return KL_OK;
}

kl_status kl_renderer_camera(const struct kl_renderer *renderer, uint32_t index, double time,
                             uint32_t width, uint32_t height, struct kl_camera *out,
                             struct kl_err *err)
{
    struct kl_pose *pose = NULL;
    kl_status st = kl_pose_create(renderer->scene, renderer->settings.animation, time, &pose, err);
    if (st != KL_OK) return st;
    *out = kl_camera_from_scene(renderer->scene, pose, index, renderer->origin, width, height);
    kl_pose_destroy(pose);
    return KL_OK;
}

void kl_renderer_get_origin(const struct kl_renderer *renderer, double origin[3])
{
    memcpy(origin, renderer->origin, sizeof renderer->origin);
}

void kl_renderer_get_bounds(const struct kl_renderer *renderer, double center[3], double *radius)
{
    for (int k = 0; k < 3; ++k) {
        center[k] = renderer->origin[k] + (double)renderer->flat->center[k];
    }
    *radius = (double)renderer->flat->radius;
}

void kl_renderer_get_info(const struct kl_renderer *renderer, struct kl_renderer_info *info)
{
    const struct kl_flat *flat = renderer->flat;
    *info = (struct kl_renderer_info){
        .needs = flat->view.needs | (renderer->moving ? KL_NEED_MOTION : 0u),
        .lights = flat->light_count,
        .device = renderer->gatherer != NULL ? kl_gatherer_get_name(renderer->gatherer) : "embree"};
    for (uint32_t i = 0; i < flat->instance_count; ++i) {
        info->triangles += flat->instances[i].triangle_count;
    }
    struct kl_hash hash;
    kl_hash_init(&hash);
    kl_motion_digest(renderer->motion, &hash);
    kl_motion_digest(renderer->before, &hash);
    kl_hash_finish(&hash, info->motion_digest);
    if (renderer->motion != NULL) {
        info->moving_objects = renderer->motion->rigid_count + renderer->motion->deforming_count;
        info->moving_lights = renderer->motion->moving_lights;
        info->most_steps = renderer->motion->most_steps;
    }
    memcpy(info->scene_digest, renderer->scene_digest, KL_DIGEST_SIZE);
    memcpy(info->settings_digest, renderer->settings_digest, KL_DIGEST_SIZE);
}

/* Is the store one base with all its octrees, which can be served from in place? */
static bool is_compact(const struct kl_store *store)
{
    struct kl_store_segment_info info;

    if (kl_store_segment_count(store) != 1 || kl_store_damaged(store, NULL) > 0) return false;
    kl_store_segment_get(store, 0, &info, NULL);
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        if (info.records[l] > 0 && !info.has_octree[l]) return false;
    }
    return info.is_base;
}

/* Take over what a store of several segments holds: each place once, copied and indexed. */
static kl_status adopt_merged(struct kl_renderer *r, struct kl_err *err)
{
    struct kl_records *records = NULL;
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    uint64_t merged = 0;
    kl_status st = kl_records_create(&records, err);

    if (st == KL_OK) st = kl_records_add_store(records, r->store, err);
    if (st == KL_OK) st = kl_records_merge(records, &merged, err);
    if (st == KL_OK) kl_records_get(records, levels);
    for (uint32_t l = 0; st == KL_OK && l < KL_CACHE_LEVELS; ++l) {
        if (levels[l].record_count == 0) continue;
        st = kl_cache_insert(r->cache, l, levels[l].hot, levels[l].cold, levels[l].record_count,
                             err);
    }
    kl_records_destroy(records);
    return st == KL_OK ? kl_cache_finish(r->cache, err) : st;
}

/* Radii for the error that is asked for, or finer ones that the store was made with: what a
 * measurement once found necessary stays. */
static void choose_accuracy(struct kl_renderer *r)
{
    const size_t n = r->store != NULL ? kl_store_segment_count(r->store) : 0;
    r->accuracy[0] = accuracy_for(r->settings.radius, r->settings.error);
    r->accuracy[1] = 2.0f * r->accuracy[0];
    for (size_t i = 0; i < n; ++i) {
        struct kl_store_segment_info info;
        struct kl_level_arrays levels[KL_CACHE_LEVELS];
        kl_store_segment_get(r->store, i, &info, levels);
        for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
            const float made_with = levels[l].octree.accuracy;
            if (levels[l].octree.record_count > 0 && made_with > 0.0f) {
                r->accuracy[l] = fminf(r->accuracy[l], made_with);
            }
        }
    }
}

/* Take over what a store holds: a lone base in place. */
static kl_status adopt_store(struct kl_renderer *r, struct kl_err *err)
{
    struct kl_store_segment_info info;
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    kl_status st = KL_OK;

    if (kl_store_segment_count(r->store) == 0) return KL_OK;
    if (kl_store_segment_count(r->store) > 1) return adopt_merged(r, err);
    kl_store_segment_get(r->store, 0, &info, levels);
    for (uint32_t l = 0; st == KL_OK && l < KL_CACHE_LEVELS; ++l) {
        if (levels[l].record_count == 0) continue;
        st = info.is_base ? kl_cache_adopt(r->cache, l, &levels[l], err)
                          : kl_cache_insert(r->cache, l, levels[l].hot, levels[l].cold,
                                            levels[l].record_count, err);
    }
    return st == KL_OK ? kl_cache_finish(r->cache, err) : st;
}

/* Directory of the present instant's store. */
static void store_path(const struct kl_renderer *r, const char *dir, char *out, size_t size)
{
    char hex[2 * KL_HASH_SIZE + 1];
    kl_hash_to_hex(r->scene_digest, KL_HASH_SIZE, hex);
    if (r->moving) {
        (void)snprintf(out, size, "%s/t-%.16s", dir, hex);
    } else {
        (void)snprintf(out, size, "%s", dir);
    }
}

/* A disk that does not take what is kept costs the keeping, not the frames. */
static kl_status may_go_on(struct kl_renderer *r, kl_status st, const struct kl_err *err)
{
    if (st != KL_ERR_IO || r->must_keep) return st;
    (void)snprintf(r->lost, sizeof r->lost, "%s", err->msg);
    return KL_OK;
}

static struct kl_cache_settings cache_settings(const struct kl_renderer *r)
{
    struct kl_cache_settings s = {.scene_radius = r->flat->radius,
                                  .rule = r->settings.radius,
                                  .reach = {reach, 1.0f},
                                  .cos_max = cos_max};
    memcpy(s.center, r->flat->center, sizeof s.center);
    memcpy(s.accuracy, r->accuracy, sizeof s.accuracy);
    return s;
}

/* Queries of what the camera sees take all records, with enlarged radii; those of gather rays are
 * averaged over a hemisphere, so a few records do. */
static kl_query eye_query(void)
{
    return (kl_query){reach, cos_max, KL_INF};
}
static kl_query gather_query(void)
{
    return (kl_query){1.0f, cos_max, gather_weight};
}

/* A cache that is not of this scene as it stands: use what holds of it, if it is of an earlier
 * edition. */
static kl_status open_revision(struct kl_renderer *r, const char *path, enum kl_store_mode mode,
                               const struct kl_store_key *key, struct kl_err *err)
{
    const struct kl_cache_settings settings = cache_settings(r);
    const struct kl_revision_query query = {.stale = {path, key, &r->parts},
                                            .scene = reference_view(r),
                                            .settings = &settings,
                                            .query = gather_query(),
                                            .touch = touch_share(r)};
    kl_status st = kl_revision_open(&query, &r->revision, err);

    if (st != KL_OK) return st;
    r->revised = true;
    kl_revision_get_summary(r->revision, &r->summary);
    kl_cache_destroy(r->cache);
    r->cache = NULL;
    st = kl_revision_serve(r->revision, &r->cache, err);
    if (st != KL_OK || mode == KL_STORE_READ) return st;
    st = kl_store_open(path, KL_STORE_REVISE, key, &r->store, err);
    if (st == KL_ERR_IO) return may_go_on(r, st, err);
    return st == KL_OK ? kl_store_parts_set(r->store, r->parts.items, r->parts.count, err) : st;
}

kl_status kl_renderer_open_cache(struct kl_renderer *renderer, const char *dir,
                                 enum kl_store_mode mode, struct kl_err *err)
{
    struct kl_renderer *r = renderer;
    close_cache(r);
    choose_accuracy(r);
    const struct kl_cache_settings settings = cache_settings(r);
    kl_status st = kl_cache_create(&settings, &r->cache, err);
    if (st != KL_OK || dir == NULL) return st;
    struct kl_store_key key;
    char path[4096];
    memcpy(key.scene, r->scene_digest, KL_DIGEST_SIZE);
    memcpy(key.settings, r->settings_digest, KL_DIGEST_SIZE);
    memcpy(key.origin, r->origin, sizeof key.origin);
    store_path(r, dir, path, sizeof path);
    st = kl_store_open(path, mode, &key, &r->store, err);
    if (r->moving && mode == KL_STORE_READ && st == KL_ERR_IO && err->os_error == ENOENT) {
        return kl_fail(err, KL_ERR_STALE,
                       "%s: has no records of this instant: the scene was edited since, or this "
                       "frame was never baked",
                       dir);
    }
    if (st == KL_ERR_IO && mode != KL_STORE_READ) return may_go_on(r, st, err);
    if (st == KL_ERR_STALE) return open_revision(r, path, mode, &key, err);
    if (st == KL_OK) st = kl_store_parts_set(r->store, r->parts.items, r->parts.count, err);
    choose_accuracy(r);
    for (uint32_t l = 0; st == KL_OK && l < KL_CACHE_LEVELS; ++l) {
        st = kl_cache_set_accuracy(r->cache, l, r->accuracy[l], err);
    }
    return st == KL_OK ? adopt_store(r, err) : st;
}

void kl_renderer_get_cache(const struct kl_renderer *renderer, struct kl_cache_state *state)
{
    *state = (struct kl_cache_state){0};
    for (uint32_t l = 0; renderer->cache != NULL && l < KL_CACHE_LEVELS; ++l) {
        state->records[l] = kl_cache_count(renderer->cache, l);
    }
    state->lost = renderer->lost[0] != '\0' ? renderer->lost : NULL;
    if (renderer->store == NULL) return;
    state->generation = kl_store_generation(renderer->store);
    state->bytes = kl_store_bytes(renderer->store);
    state->damaged = kl_store_damaged(renderer->store, NULL);
}

bool kl_renderer_get_revision(const struct kl_renderer *renderer,
                              struct kl_renderer_revision *revision)
{
    const struct kl_revision_summary *s = &renderer->summary;
    if (!renderer->revised) return false;
    *revision =
        (struct kl_renderer_revision){.had = s->had, .kept = s->kept, .refreshed = s->again};
    memcpy(revision->text, s->text, sizeof revision->text);
    return true;
}

static kl_status keep_batch(void *context, uint32_t level, const kl_record_hot *hot,
                            const kl_record_cold *cold, uint32_t count, struct kl_err *err)
{
    struct kl_renderer *r = context;
    struct kl_level_arrays levels[KL_CACHE_LEVELS] = {0};
    levels[level].record_count = count;
    levels[level].hot = hot;
    levels[level].cold = cold;
    return may_go_on(r, r->lost[0] == '\0' ? kl_store_append(r->store, levels, err) : KL_OK, err);
}

/* A new cache from what the store holds now. */
static kl_status serve_store(struct kl_renderer *r, struct kl_err *err)
{
    const struct kl_cache_settings settings = cache_settings(r);

    tell_use(r);
    kl_cache_destroy(r->cache);
    r->cache = NULL;
    kl_status st = kl_cache_create(&settings, &r->cache, err);
    return st == KL_OK ? adopt_store(r, err) : st;
}

/* Pick up what other processes have published. What cannot be read now is not missed. */
static kl_status refresh(struct kl_renderer *r, struct kl_err *err)
{
    struct kl_err ignored;
    bool changed = false;

    if (kl_store_refresh(r->store, &changed, &ignored) != KL_OK || !changed) return KL_OK;
    return serve_store(r, err);
}

/* Put the finished cache into one base segment and serve from it. */
static kl_status publish(struct kl_renderer *r, struct kl_err *err)
{
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    kl_status st = KL_OK;

    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        levels[l] = kl_cache_get_arrays(r->cache, l);
    }
    st = kl_store_publish_base(r->store, levels, err);
    if (st != KL_OK) return may_go_on(r, st, err);
    return serve_store(r, err);
}

/* Bring the cache of an earlier edition up to date, and only then replace what lies on disk. */
static kl_status revise(struct kl_renderer *r, const struct kl_fill_job *job,
                        struct kl_fill_stats *stats, struct kl_err *err)
{
    struct kl_cache *cache = NULL;
    kl_status st = kl_revision_fill(r->revision, job, &cache, stats, err);

    if (st != KL_OK) return st;
    kl_revision_get_summary(r->revision, &r->summary);
    stats->refreshed = r->summary.again;
    kl_cache_destroy(r->cache);
    r->cache = cache;
    if (job->keep_batch != NULL) st = publish(r, err);
    if (st != KL_OK) return st;
    kl_revision_close(r->revision);
    r->revision = NULL;
    return KL_OK;
}

static struct kl_verify_job verify_job(const struct kl_renderer *r, const struct kl_camera *cameras,
                                       uint32_t camera_count)
{
    return (struct kl_verify_job){
        .scene = reference_view(r),
        .cache = kl_cache_view(r->cache, 0),
        .query = eye_query(),
        .cameras = cameras,
        .camera_count = camera_count,
        .gather = {.query = gather_query(), .length_scale = length_scale},
        .gather_batch = kl_gatherer_run,
        .gather_context = r->gatherer,
    };
}

/* How well the frozen cache serves `cameras`: a few hundred points, with rays enough for the error
 * that was asked for. */
static kl_status measure(struct kl_renderer *r, const struct kl_renderer_fill *fill,
                         struct kl_fill_stats *stats, struct kl_err *err)
{
    const struct kl_gather_tables *tables = NULL;
    struct kl_verify_stats found;
    const kl_level_view level1 = kl_cache_view(r->cache, 1);
    const double start = kl_seconds();
    kl_status st = get_tables(r, side_for(r->settings.error < 0.02 ? 16384 : 4096), &tables, err);
    if (st != KL_OK) return st;
    struct kl_verify_job job = verify_job(r, fill->cameras, fill->camera_count);
    job.ladder = (struct kl_gather_ladder){.steps = {tables}, .count = 1};
    job.level1 = &level1;
    job.share = 1.0;
    job.at_most = MEASURED_POINTS;
    st = kl_verify(&job, NULL, &found, err);
    stats->gather_rays += (found.points + found.unserved) * tables->side * tables->side;
    stats->gather_seconds += kl_seconds() - start;
    stats->measured = kl_verify_error(&found);
    return st;
}

static uint32_t added(const struct kl_fill_stats *stats)
{
    return stats->added[0] + stats->added[1];
}

/* Fill; then, as long as the measured error is above what was asked for, make radii smaller and
 * fill the gaps. The error goes with the square of the radii. */
static kl_status fill_until_met(struct kl_renderer *r, const struct kl_renderer_fill *fill,
                                const struct kl_fill_job *job, struct kl_fill_stats *stats,
                                struct kl_err *err)
{
    for (int round = 0;; ++round) {
        const uint32_t before = added(stats);
        kl_status st = kl_fill(job, stats, err);
        if (st != KL_OK || !fill->measure || added(stats) == before) return st;
        st = measure(r, fill, stats, err);
        const double over = stats->measured / (measured_share * r->settings.error);
        if (st != KL_OK || over <= 1.0 || round == MEASURE_ROUNDS) return st;
        r->accuracy[0] *= (float)fmin(0.9, fmax(0.6, sqrt(0.9 / over)));
        st = kl_cache_set_accuracy(r->cache, 0, r->accuracy[0], err);
        if (st != KL_OK) return st;
    }
}

static kl_status fill_cache(struct kl_renderer *r, const struct kl_renderer_fill *fill,
                            struct kl_turn *turn, struct kl_fill_stats *stats, struct kl_err *err)
{
    const bool keep = fill->keep && r->store != NULL;
    struct kl_fill_job job = {
        .scene = reference_view(r),
        .scene_radius = r->flat->radius,
        .radius = {r->settings.radius, 0.0f, r->flat->radius},
        .cameras = fill->cameras,
        .camera_count = fill->camera_count,
        .ladder = {r->ladder[0], r->ladder[1]},
        .gather = {.query = gather_query(), .length_scale = length_scale, .touch = touch_share(r)},
        .query = {1.0f, cos_max, KL_INF},
        .least_weight = least_weight,
        .spacing_px = spacing_px,
        .uncovered = uncovered,
        .batch = BATCH,
        .gather_batch = kl_gatherer_run,
        .gather_context = r->gatherer,
        .keep_batch = keep ? keep_batch : NULL,
        .keep_context = r,
        .progress = kl_turn_note,
        .progress_context = turn,
    };
    kl_status st = r->revision != NULL ? revise(r, &job, stats, err) : KL_OK;
    job.cache = r->cache;
    if (st == KL_OK) st = fill_until_met(r, fill, &job, stats, err);
    if (st != KL_OK) return st;
    const double start = kl_seconds();
    const bool grown = added(stats) > 0;
    if (keep && r->lost[0] == '\0' && (grown || !is_compact(r->store))) st = publish(r, err);
    stats->insert_seconds += kl_seconds() - start;
    return st;
}

kl_status kl_renderer_fill(struct kl_renderer *renderer, const struct kl_renderer_fill *fill,
                           struct kl_fill_stats *stats, struct kl_err *err)
{
    struct kl_renderer *r = renderer;
    struct kl_turn turn = {.progress = fill->progress, .progress_context = fill->progress_context};
    kl_status st = KL_OK;

    *stats = (struct kl_fill_stats){0};
    tell_use(r); /* records get other numbers */
    r->must_keep = fill->must_keep;
    if (fill->keep && r->store != NULL) {
        st = kl_turn_begin(&turn, r->store, fill->cameras, fill->camera_count, err);
        if (st == KL_OK && r->revision == NULL) st = refresh(r, err);
    }
    if (st == KL_OK) st = fill_cache(r, fill, &turn, stats, err);
    kl_turn_end(&turn);
    return st;
}

kl_status kl_renderer_verify(struct kl_renderer *renderer, const struct kl_camera *camera,
                             double share, struct kl_verify_errors *all,
                             struct kl_verify_stats *stats, struct kl_err *err)
{
    struct kl_verify_job job = verify_job(renderer, camera, 1);
    job.share = share;
    job.ladder = (struct kl_gather_ladder){
        .count = 2, .tolerance = reference_noise * (float)renderer->settings.error};
    kl_status st = get_tables(renderer, VERIFY_SIDE, &job.ladder.steps[0], err);
    if (st == KL_OK) st = get_tables(renderer, LAST_SIDE, &job.ladder.steps[1], err);
    if (st != KL_OK) return st;
    return kl_verify(&job, all, stats, err);
}

/* The frozen cache as frames ask it; `tells`: which records serve is noted for the store. */
static void serve_frame(struct kl_renderer *r, bool tells, kl_level_view levels[KL_CACHE_LEVELS])
{
    for (uint32_t l = 0; r->cache != NULL && l < KL_CACHE_LEVELS; ++l) {
        levels[l] = kl_cache_view(r->cache, l);
    }
    /* The cache of another edition of the scene is not ours to judge. */
    tells = tells && r->store != NULL && r->revision == NULL;
    if (tells && r->used == NULL && r->cache != NULL) {
        struct kl_err ignored; /* without memory nothing is told */
        (void)!kl_alloc_array(&r->used, kl_cache_count(r->cache, 0), 1, &ignored);
    }
    levels[0].used = r->used;
}

/* The caches to blend into those of `r`; their number. */
static uint32_t make_moments(const struct kl_renderer *r, const struct kl_renderer_frame *frame,
                             struct kl_shade_moment *moments)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < frame->blend_count; ++i) {
        struct kl_renderer *other = frame->blend[i].renderer;
        struct kl_shade_moment *m = &moments[count];
        if (!kl_flat_is_alike(r->scene, r->flat, other->flat)) continue;
        m->scene = &other->flat->view;
        m->weight = frame->blend[i].weight;
        serve_frame(other, frame->note_use, m->levels);
        ++count;
    }
    return count;
}

kl_status kl_renderer_frame(struct kl_renderer *renderer, const struct kl_renderer_frame *frame,
                            struct kl_image *image, struct kl_counts *counts, uint64_t *bad_samples,
                            struct kl_err *err)
{
    struct kl_renderer *r = renderer;
    struct kl_frame_job job = {
        .shade = {.scene = r->motion != NULL ? &r->motion->view : &r->flat->view,
                  .reference = reference_view(r),
                  .swept = r->swept,
                  .indirect = r->settings.indirect,
                  .query = eye_query(),
                  .gather = {.query = gather_query(), .length_scale = length_scale}},
        .camera = frame->camera,
        .cameras = frame->cameras,
        .camera_count = frame->camera_count,
        .times = frame->times,
        .time_count = frame->time_count,
        .before = frame->before,
        .before_motion = r->before,
        .spp = frame->spp,
        .seed = kl_hash2(r->settings.seed, (uint32_t)frame->frame),
        .progress = frame->progress,
        .progress_context = frame->progress_context,
    };
    struct kl_shade_moment *moments = NULL;
    kl_status st = kl_alloc_array(&moments, frame->blend_count, sizeof *moments, err);
    if (st != KL_OK) return st;
    memcpy(job.origin, r->origin, sizeof job.origin);
    serve_frame(r, frame->note_use, job.shade.levels);
    job.shade.moments = moments;
    job.shade.moment_count = make_moments(r, frame, moments);
    st = kl_frame_render(&job, image, counts, bad_samples, err);
    free(moments);
    return st;
}
