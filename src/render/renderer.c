#include "src/base/memory.h"
#include "src/render/renderer_impl.h"
#include "src/render/swept.h"
#include "src/scene/digest.h"
#include "src/trace/tracer.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Changes whenever the same scene and settings would give other records. */
static const uint32_t algorithm_version = 1;

enum { DEFAULT_RAYS = 1024, LADDER = 3 };

uint32_t kl_renderer_side_for(uint32_t rays)
{
    uint32_t side = KL_FIRST_SIDE;
    while (side < KL_LAST_SIDE && side * side < rays) {
        side *= 2;
    }
    return side;
}

kl_status kl_renderer_get_tables(struct kl_renderer *r, uint32_t side,
                                 const struct kl_gather_tables **out, struct kl_err *err)
{
    uint32_t i = 0;
    while ((uint32_t)KL_FIRST_SIDE << i < side) {
        ++i;
    }
    kl_status st = KL_OK;
    if (r->tables[i] == NULL) st = kl_gather_tables_create(side, &r->tables[i], err);
    *out = r->tables[i];
    return st;
}

kl_status kl_renderer_climb(struct kl_renderer *r, uint32_t side, uint32_t steps, float noise,
                            struct kl_gather_ladder *out, struct kl_err *err)
{
    kl_status st = KL_OK;
    *out = (struct kl_gather_ladder){.tolerance = KL_TOLD_NOISE * noise * (float)r->settings.error};
    for (uint32_t s = side; st == KL_OK && out->count < steps && s <= KL_LAST_SIDE; s *= 2) {
        st = kl_renderer_get_tables(r, s, &out->steps[out->count++], err);
    }
    return st;
}

/* Records that the camera sees climb until their noise is good enough; gather rays average over
 * many of those they end in, which get a quarter of the rays. */
static kl_status make_ladders(struct kl_renderer *r, struct kl_err *err)
{
    const uint32_t side = kl_renderer_side_for(r->settings.rays);
    kl_status st = kl_renderer_climb(r, side, LADDER, 1.0f, &r->ladder[0], err);
    if (st != KL_OK) return st;
    return kl_renderer_climb(r, side > KL_FIRST_SIDE ? side / 2 : side, 1, 1.0f, &r->ladder[1],
                             err);
}

static void digest_settings(struct kl_renderer *r)
{
    const uint32_t numbers[] = {algorithm_version, r->ladder[0].steps[0]->side,
                                (uint32_t)r->settings.radius};
    const float floats[] = {KL_COS_MAX, KL_LENGTH_SCALE, KL_EYE_REACH};
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
    if (st == KL_OK && r->moving && settings->carry && settings->indirect == KL_INDIRECT_CACHE) {
        st = kl_ledger_create(&r->ledger, err);
    }
    kl_pose_destroy(pose);
    if (st != KL_OK) {
        kl_renderer_destroy(r);
        return st;
    }
    digest_settings(r);
    *out = r;
    return KL_OK;
}

static void leave_instant(struct kl_renderer *r)
{
    kl_renderer_close_cache(r);
    kl_gatherer_destroy(r->gatherer);
    kl_tracer_destroy(r->tracer);
    kl_motion_destroy(r->motion);
    kl_motion_destroy(r->before);
    kl_swept_destroy(r->swept);
    kl_stand_destroy(r->stand);
    kl_parts_fini(&r->parts);
    kl_flat_destroy(r->flat);
    r->gatherer = NULL;
    r->tracer = NULL;
    r->motion = NULL;
    r->before = NULL;
    r->swept = NULL;
    r->stand = NULL;
    r->flat = NULL;
    r->ready = false;
}

void kl_renderer_destroy(struct kl_renderer *renderer)
{
    if (renderer == NULL) return;
    leave_instant(renderer);
    kl_ledger_destroy(renderer->ledger);
    for (int i = 0; i < KL_TABLES; ++i) {
        kl_gather_tables_destroy(renderer->tables[i]);
    }
    free(renderer);
}

bool kl_renderer_is_moving(const struct kl_renderer *renderer)
{
    return renderer->moving;
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
    const struct kl_motion_span open = {t->open, t->close, t->times};
    const struct kl_motion_span before = {t->before, t->before, NULL};
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

/* While the shutter is open records are means over it. */
static void digest_instant(struct kl_renderer *r)
{
    struct kl_hash hash;

    kl_flat_digest(r->flat, r->scene_digest);
    if (r->motion == NULL) return;
    kl_hash_init(&hash);
    kl_hash_update(&hash, r->scene_digest, sizeof r->scene_digest);
    kl_motion_digest(r->motion, &hash);
    kl_hash_finish(&hash, r->scene_digest);
}

kl_status kl_renderer_set_time(struct kl_renderer *renderer, double time, struct kl_err *err)
{
    const struct kl_renderer_instants instants = {
        .reference = time, .open = time, .close = time, .before = time};
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
    if (st == KL_OK && r->ledger != NULL) {
        st = kl_stand_create(r->scene, pose, r->flat, r->motion, &r->stand, err);
    }
    if (st == KL_OK && r->settings.indirect == KL_INDIRECT_CACHE) {
        st = kl_gatherer_create(r->settings.device, r->flat, r->motion, &r->gatherer, err);
    }
    kl_pose_destroy(pose);
    if (st != KL_OK) {
        leave_instant(r);
        return st;
    }
    digest_instant(r);
    r->reference = time;
    r->earlier = instants->before;
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
        .shade = {.scene = kl_renderer_motion(r),
                  .reference = kl_renderer_reference(r),
                  .swept = r->swept,
                  .indirect = r->settings.indirect,
                  .query = kl_renderer_eye_query(),
                  .gather = {.query = kl_renderer_gather_query(), .length_scale = KL_LENGTH_SCALE}},
        .camera = frame->camera,
        .cameras = frame->cameras,
        .camera_count = frame->camera_count,
        .times = frame->times,
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
