#include "src/app/job.h"

#include "sequences/pattern.h"
#include "src/app/exit_code.h"
#include "src/app/folders.h"
#include "src/app/scene_file.h"
#include "src/app/version.h"
#include "src/base/hash.h"
#include "src/base/memory.h"

#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static kl_status choose_paths(struct kl_job *job, struct kl_err *err)
{
    const struct kl_options *o = job->options;
    char stem[1024];
    kl_status st = kl_path_get_stem(o->arguments[0], stem, sizeof stem, err);

    if (st != KL_OK) return st;
    if (o->out != NULL) {
        if (strlen(o->out) >= sizeof job->pattern) {
            return kl_fail(err, KL_ERR_USAGE, "--out: the name is too long");
        }
        (void)snprintf(job->pattern, sizeof job->pattern, "%s", o->out);
    } else {
        (void)snprintf(job->pattern, sizeof job->pattern, "%s.####.exr", stem);
    }
    int n = 0;
    if (o->cache != NULL) {
        n = snprintf(job->cache_dir, sizeof job->cache_dir, "%s", o->cache);
    } else {
        n = snprintf(job->cache_dir, sizeof job->cache_dir, "%.*s%s.klc",
                     (int)kl_path_folder_length(job->pattern), job->pattern, stem);
    }
    if (n < 0 || (size_t)n >= sizeof job->cache_dir) {
        return kl_fail(err, KL_ERR_USAGE, "--cache: the name is too long");
    }
    return KL_OK;
}

static void choose_mode(struct kl_job *job)
{
    const enum kl_cache_mode mode = job->options->cache_mode;

    job->has_cache = job->options->indirect == KL_INDIRECT_OPTION_CACHE;
    job->has_store = job->has_cache && mode != KL_CACHE_MODE_OFF;
    job->fills = job->has_cache && mode != KL_CACHE_MODE_FREEZE;
    job->keeps = mode == KL_CACHE_MODE_EXTEND || mode == KL_CACHE_MODE_REBUILD;
}

static kl_status create_renderer(const struct kl_job *job, struct kl_renderer **out,
                                 struct kl_err *err)
{
    static const enum kl_indirect indirects[] = {
        [KL_INDIRECT_OPTION_CACHE] = KL_INDIRECT_CACHE,
        [KL_INDIRECT_OPTION_PATH] = KL_INDIRECT_PATH,
        [KL_INDIRECT_OPTION_OFF] = KL_INDIRECT_OFF,
    };
    const struct kl_options *o = job->options;
    const struct kl_renderer_settings settings = {.indirect = indirects[o->indirect],
                                                  .device = o->device,
                                                  .error = o->error,
                                                  .radius = o->split_sphere ? KL_RADIUS_SPLIT_SPHERE
                                                                            : KL_RADIUS_HESSIAN,
                                                  .rays = o->rays,
                                                  .seed = o->seed,
                                                  .animation = job->animation,
                                                  .carry = o->carry};
    return kl_renderer_create(job->scene, &settings, out, err);
}

/* One renderer; with caches to blend, one for each. */
static kl_status create_renderers(struct kl_job *job, struct kl_err *err)
{
    const int32_t asked = job->has_cache ? (int32_t)job->options->cache_blend : 0;
    struct kl_renderer *first = NULL;
    kl_status st = create_renderer(job, &first, err);

    if (st != KL_OK) return st;
    if (kl_renderer_is_moving(first)) job->blend = asked;
    if (job->blend < asked) {
        kl_say_warning(NULL, "--cache-blend: nothing but the camera moves, so one cache serves all "
                             "frames and there is nothing to blend");
    }
    st = kl_alloc_array(&job->instants, 2 * (size_t)job->blend + 1, sizeof *job->instants, err);
    if (st != KL_OK) {
        kl_renderer_destroy(first);
        return st;
    }
    job->renderer = job->instants[0].renderer = first;
    for (int32_t k = 1; st == KL_OK && k <= 2 * job->blend; ++k) {
        st = create_renderer(job, &job->instants[k].renderer, err);
    }
    return st;
}

enum { SHUTTER_CAMERAS = 33 }; /* a camera turns little between two of them */

/* The camera while the shutter is open. */
static kl_status place_shutter_cameras(const struct kl_job *job, struct kl_job_frame *f,
                                       struct kl_err *err)
{
    const struct kl_shutter *shutter = &job->options->shutter;
    kl_status st = kl_alloc_array(&f->cameras, SHUTTER_CAMERAS, sizeof *f->cameras, err);

    for (int k = 0; st == KL_OK && k < SHUTTER_CAMERAS; ++k) {
        const double share = (double)k / (SHUTTER_CAMERAS - 1);
        st = kl_rig_camera(job->rig, f->frame, shutter->offset + (share - 0.5) * shutter->length,
                           &f->cameras[k], err);
    }
    f->camera_count = SHUTTER_CAMERAS;
    return st;
}

static struct kl_renderer_instants find_instants(const struct kl_job *job, int32_t frame)
{
    const struct kl_interval interval = kl_rig_interval(job->rig, frame);
    return (struct kl_renderer_instants){.reference = interval.reference,
                                         .open = interval.open,
                                         .close = interval.close,
                                         .times = job->shutter_times,
                                         .before = kl_rig_interval(job->rig, frame - 1).reference};
}

static kl_status place_frame(const struct kl_job *job, int32_t frame, struct kl_job_frame *f,
                             struct kl_err *err)
{
    const double offset = job->options->shutter.offset;
    f->frame = frame;
    f->instants = find_instants(job, frame);
    kl_status st = kl_rig_camera(job->rig, frame, offset, &f->camera, err);
    if (st == KL_OK) st = kl_rig_camera(job->rig, frame - 1, offset, &f->before, err);
    if (st == KL_OK && job->options->shutter.length > 0.0 &&
        kl_rig_moves(job->rig, job->animation)) {
        st = place_shutter_cameras(job, f, err);
    }
    return st;
}

static kl_status place_frames(struct kl_job *job, struct kl_err *err)
{
    struct kl_frames list = {0};
    kl_status st = kl_rig_frames(job->rig, job->animation, &list, err);

    if (st == KL_OK) st = kl_alloc_array(&job->frames, list.count, sizeof *job->frames, err);
    for (size_t i = 0; st == KL_OK && i < list.count; ++i) {
        st = place_frame(job, list.frames[i], &job->frames[i], err);
    }
    job->frame_count = list.count;
    kl_frames_fini(&list);
    return st;
}

static kl_status make_shutter_times(struct kl_job *job, struct kl_err *err)
{
    const struct kl_shutter_curve *curve = &job->options->shutter_curve;

    if (curve->count == 0) return KL_OK;
    kl_status st = kl_alloc_array(&job->shutter_times, KL_SHUTTER_TIMES, sizeof(float), err);
    for (int i = 0; st == KL_OK && i < KL_SHUTTER_TIMES; ++i) {
        job->shutter_times[i] =
            (float)kl_shutter_curve_time(curve, (double)i / (KL_SHUTTER_TIMES - 1));
    }
    return st;
}

kl_status kl_job_init(struct kl_job *job, const struct kl_options *options, struct kl_err *err)
{
    *job = (struct kl_job){.options = options, .animation = KL_NONE};
    kl_status st = choose_paths(job, err);

    if (options->threads > 0) omp_set_num_threads((int)options->threads);
    choose_mode(job);
    kl_progress_init(&job->progress, options);
    if (st == KL_OK) st = make_shutter_times(job, err);
    if (st == KL_OK) st = kl_scene_file_load(options, &job->scene, &job->animation, err);
    if (st == KL_OK && options->object_turns) {
        st = kl_scene_set_plate(job->scene, kl_fps_get(options->fps), options->turntable, err);
    }
    if (st == KL_OK) st = create_renderers(job, err);
    if (st == KL_OK) st = kl_rig_create(job->scene, job->renderer, options, &job->rig, err);
    if (st == KL_OK) st = place_frames(job, err);
    return st == KL_OK ? kl_job_visit(job, 0, err) : st;
}

void kl_job_fini(struct kl_job *job)
{
    kl_rig_destroy(job->rig);
    for (int32_t k = 0; job->instants != NULL && k <= 2 * job->blend; ++k) {
        kl_renderer_destroy(job->instants[k].renderer);
    }
    free(job->instants);
    kl_scene_destroy(job->scene);
    for (size_t i = 0; job->frames != NULL && i < job->frame_count; ++i) {
        free(job->frames[i].cameras);
    }
    free(job->frames);
    free(job->shutter_times);
    *job = (struct kl_job){0};
}

/* Once: what of a cache of an earlier edition of the scene could be used. */
static void say_revision(struct kl_job *job)
{
    struct kl_renderer_revision r;
    char line[KL_JOB_PATH_SIZE + 512];

    if (job->said_revision || !kl_renderer_get_revision(job->renderer, &r)) return;
    (void)snprintf(line, sizeof line,
                   "%s: the scene was edited since: %s: of %u records %u kept, %u gathered again, "
                   "%u dropped",
                   job->cache_dir, r.text, r.had, r.kept, r.refreshed,
                   r.had - r.kept - r.refreshed);
    kl_say_warning(NULL, line);
    job->said_revision = true;
}

/* Open the cache of an instant, whose renderer is the job's for now. */
static kl_status open_cache(struct kl_job *job, struct kl_job_instant *at, struct kl_err *err)
{
    static const enum kl_store_mode modes[] = {
        [KL_CACHE_MODE_EXTEND] = KL_STORE_EXTEND,    [KL_CACHE_MODE_FREEZE] = KL_STORE_READ,
        [KL_CACHE_MODE_FREEZE_FILL] = KL_STORE_READ, [KL_CACHE_MODE_REBUILD] = KL_STORE_REBUILD,
        [KL_CACHE_MODE_OFF] = KL_STORE_READ,
    };
    kl_status st = KL_OK;

    if (job->has_store && !job->keeps && !kl_folder_is(job->cache_dir)) {
        return kl_fail(err, KL_ERR_INPUT, "%s: no such cache; bake it first, or extend",
                       job->cache_dir);
    }
    if (job->has_store && job->keeps) {
        st = kl_folders_make(job->cache_dir, kl_renderer_is_moving(job->renderer), err);
    }
    if (st == KL_OK) {
        st = kl_renderer_open_cache(job->renderer, job->has_store ? job->cache_dir : NULL,
                                    modes[job->options->cache_mode], err);
    }
    if (st != KL_OK) return st;
    struct kl_cache_state state;
    kl_renderer_get_cache(job->renderer, &state);
    if (state.damaged > 0) {
        char line[KL_JOB_PATH_SIZE + 128];
        (void)snprintf(line, sizeof line,
                       "%s: %zu segments are damaged or foreign; what is whole of them is used; "
                       "'keeplight cache check' names them",
                       job->cache_dir, state.damaged);
        kl_say_warning(NULL, line);
    }
    if (!job->fills) say_revision(job);
    at->loaded = kl_job_records(job);
    at->is_open = true;
    ++job->open_count;
    return KL_OK;
}

/* Where a frame's instant has its place. */
static struct kl_job_instant *find_instant(const struct kl_job *job, int32_t frame)
{
    const int32_t count = 2 * job->blend + 1;
    return &job->instants[(frame % count + count) % count];
}

/* Take the renderer of a frame's place there, unless it stands there already. */
static kl_status go_to(const struct kl_job *job, int32_t frame, struct kl_err *err)
{
    struct kl_job_instant *at = find_instant(job, frame);
    const struct kl_renderer_instants instants = find_instants(job, frame);

    if (at->is_placed && (at->frame == frame || !kl_renderer_is_moving(at->renderer))) {
        return KL_OK;
    }
    *at = (struct kl_job_instant){.renderer = at->renderer, .frame = frame};
    kl_status st = kl_renderer_set_instants(at->renderer, &instants, err);
    at->is_placed = st == KL_OK;
    return st;
}

static kl_status go_around(struct kl_job *job, int32_t frame, bool opens, struct kl_err *err)
{
    kl_status st = KL_OK;

    for (int32_t f = frame - job->blend; st == KL_OK && f <= frame + job->blend; ++f) {
        struct kl_job_instant *at = find_instant(job, f);
        st = go_to(job, f, err);
        job->renderer = at->renderer;
        if (st == KL_OK && opens && !at->is_open) st = open_cache(job, at, err);
    }
    job->renderer = find_instant(job, frame)->renderer;
    return st;
}

kl_status kl_job_visit(struct kl_job *job, size_t i, struct kl_err *err)
{
    return go_around(job, job->frames[i].frame, false, err);
}

kl_status kl_job_enter(struct kl_job *job, size_t i, struct kl_err *err)
{
    return go_around(job, job->frames[i].frame, job->has_cache, err);
}

uint32_t kl_job_loaded(const struct kl_job *job, size_t i)
{
    return find_instant(job, job->frames[i].frame)->loaded;
}

uint32_t kl_job_blend(const struct kl_job *job, size_t i,
                      struct kl_renderer_blend out[2 * KL_CACHE_BLEND_MOST])
{
    uint32_t count = 0;
    for (int32_t k = -job->blend; k <= job->blend; ++k) {
        if (k == 0) continue;
        out[count++] = (struct kl_renderer_blend){
            .renderer = find_instant(job, job->frames[i].frame + k)->renderer,
            .weight = 1.0f - (float)abs(k) / (float)(job->blend + 1)};
    }
    return count;
}

uint32_t kl_job_records(const struct kl_job *job)
{
    struct kl_cache_state state;
    uint32_t sum = 0;

    kl_renderer_get_cache(job->renderer, &state);
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        sum += state.records[l];
    }
    return sum;
}

static bool note_fill(void *context, int stage, double done, uint32_t records)
{
    struct kl_progress *progress = context;

    progress->phase = stage == 0 ? "fill world" : "fill view";
    progress->records = records;
    return kl_progress_update(progress, done);
}

static void tell_lost(struct kl_job *job)
{
    struct kl_cache_state state;
    char line[KL_JOB_PATH_SIZE + 640];

    kl_renderer_get_cache(job->renderer, &state);
    if (state.lost == NULL || job->told_lost) return;
    (void)snprintf(line, sizeof line, "%s: records are not kept any more: %s", job->cache_dir,
                   state.lost);
    kl_say_warning(NULL, line);
    job->told_lost = true;
}

/* What has to be served for a frame: what is seen at its reference instant, and with blur what is
 * seen first and last; their number. */
static uint32_t add_cameras(const struct kl_job *job, const struct kl_job_frame *f,
                            struct kl_camera out[3])
{
    struct kl_renderer_info info;
    uint32_t used = 0;

    out[used++] = f->camera;
    kl_renderer_get_info(job->renderer, &info);
    if (f->camera_count == 0 && info.moving_objects == 0) return used;
    for (int end = 0; end < 2; ++end) {
        out[used] = f->camera_count > 0 ? f->cameras[end ? f->camera_count - 1 : 0] : f->camera;
        out[used++].time = (float)end;
    }
    return used;
}

/* Fill the cache of the job's present renderer for frames. */
static kl_status fill_frames(struct kl_job *job, const struct kl_job_frame *frames, size_t count,
                             struct kl_fill_stats *stats, struct kl_err *err)
{
    struct kl_camera *cameras = NULL;
    uint32_t used = 0;
    kl_status st = kl_alloc_array(&cameras, count, 3 * sizeof *cameras, err);
    if (st != KL_OK) return st;
    for (size_t k = 0; k < count; ++k) {
        used += add_cameras(job, &frames[k], cameras + used);
    }
    const struct kl_renderer_fill fill = {.cameras = cameras,
                                          .camera_count = used,
                                          .keep = job->keeps,
                                          .must_keep = job->must_keep,
                                          .measure = job->options->verify > 0.0,
                                          .progress = note_fill,
                                          .progress_context = &job->progress};
    st = kl_renderer_fill(job->renderer, &fill, stats, err);
    if (st == KL_OK) tell_lost(job);
    job->progress.records = kl_job_records(job);
    if (st == KL_OK) say_revision(job);
    free(cameras);
    return st;
}

static void add_stats(struct kl_fill_stats *sum, const struct kl_fill_stats *s)
{
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        sum->added[l] += s->added[l];
    }
    sum->primary_rays += s->primary_rays;
    sum->gather_rays += s->gather_rays;
    sum->batches += s->batches;
    sum->refreshed += s->refreshed;
    sum->uncovered = fmax(sum->uncovered, s->uncovered);
    sum->measured = fmax(sum->measured, s->measured);
    sum->visibility_seconds += s->visibility_seconds;
    sum->gather_seconds += s->gather_seconds;
    sum->insert_seconds += s->insert_seconds;
}

/* Fill the cache of one instant for its frame, which need not be one to render. */
static kl_status fill_instant(struct kl_job *job, struct kl_job_instant *at,
                              struct kl_fill_stats *sum, struct kl_err *err)
{
    struct kl_job_frame frame = {0};
    struct kl_fill_stats stats = {0};
    kl_status st = place_frame(job, at->frame, &frame, err);

    job->renderer = at->renderer;
    if (st == KL_OK) st = fill_frames(job, &frame, 1, &stats, err);
    at->is_filled = st == KL_OK;
    add_stats(sum, &stats);
    free(frame.cameras);
    return st;
}

kl_status kl_job_fill(struct kl_job *job, size_t i, size_t count, struct kl_fill_stats *stats,
                      struct kl_err *err)
{
    const int32_t frame = job->frames[i].frame;
    kl_status st = KL_OK;

    *stats = (struct kl_fill_stats){0};
    if (!job->fills) return KL_OK;
    if (!kl_renderer_is_moving(job->renderer)) {
        return fill_frames(job, &job->frames[i], count, stats, err);
    }
    for (int32_t f = frame - job->blend; st == KL_OK && f <= frame + job->blend; ++f) {
        struct kl_job_instant *at = find_instant(job, f);
        if (!at->is_filled) st = fill_instant(job, at, stats, err);
    }
    job->renderer = find_instant(job, frame)->renderer;
    return st;
}

kl_status kl_job_image_path(const struct kl_job *job, size_t i, char out[KL_JOB_PATH_SIZE],
                            struct kl_err *err)
{
    return kl_pattern_format(job->pattern, job->frames[i].frame, job->frame_count > 1, out,
                             KL_JOB_PATH_SIZE, err);
}

static void hash_vec(struct kl_hash *hash, kl_vec3 v)
{
    const float xyz[3] = {v.x, v.y, v.z};
    kl_hash_update(hash, xyz, sizeof xyz);
}

static void hash_camera(struct kl_hash *hash, const struct kl_camera *c)
{
    const uint32_t numbers[] = {c->width, c->height, c->orthographic};
    const float size[] = {c->half_width, c->half_height};

    kl_hash_update(hash, numbers, sizeof numbers);
    hash_vec(hash, c->eye);
    hash_vec(hash, c->right);
    hash_vec(hash, c->up);
    hash_vec(hash, c->forward);
    kl_hash_update(hash, size, sizeof size);
}

static void hash_text(struct kl_hash *hash, const char *text)
{
    kl_hash_update(hash, text, strlen(text) + 1);
}

/* The caches that are blended in: of which instants, and with frozen ones which state of them. */
static void hash_blend(struct kl_hash *hash, const struct kl_job *job, size_t i)
{
    struct kl_renderer_blend blend[2 * KL_CACHE_BLEND_MOST];
    const uint32_t count = kl_job_blend(job, i, blend);

    for (uint32_t k = 0; k < count; ++k) {
        struct kl_renderer_info info;
        struct kl_cache_state state;
        kl_renderer_get_info(blend[k].renderer, &info);
        kl_renderer_get_cache(blend[k].renderer, &state);
        kl_hash_update(hash, info.scene_digest, sizeof info.scene_digest);
        if (job->options->cache_mode != KL_CACHE_MODE_FREEZE) continue;
        kl_hash_update(hash, &state.generation, sizeof state.generation);
    }
}

void kl_job_settings_digest(const struct kl_job *job, size_t i, uint8_t digest[KL_DIGEST_SIZE])
{
    const struct kl_options *o = job->options;
    const bool carries = o->carry && kl_renderer_is_moving(job->renderer);
    const uint32_t numbers[] = {(uint32_t)o->indirect, o->spp, o->seed, o->rays, carries};
    struct kl_renderer_info info;
    struct kl_cache_state state;
    double origin[3];
    struct kl_hash hash;

    kl_renderer_get_info(job->renderer, &info);
    kl_renderer_get_origin(job->renderer, origin);
    kl_renderer_get_cache(job->renderer, &state);
    kl_hash_init(&hash);
    hash_text(&hash, KL_VERSION);
    hash_text(&hash, o->aov != NULL ? o->aov : "all");
    kl_hash_update(&hash, info.settings_digest, sizeof info.settings_digest);
    kl_hash_update(&hash, numbers, sizeof numbers);
    kl_hash_update(&hash, &o->error, sizeof o->error);
    kl_hash_update(&hash, origin, sizeof origin);
    hash_camera(&hash, &job->frames[i].camera);
    hash_camera(&hash, &job->frames[i].before);
    for (uint32_t k = 0; k < job->frames[i].camera_count; ++k) {
        hash_camera(&hash, &job->frames[i].cameras[k]);
    }
    kl_hash_update(&hash, info.motion_digest, sizeof info.motion_digest);
    if (job->shutter_times != NULL) {
        kl_hash_update(&hash, job->shutter_times, KL_SHUTTER_TIMES * sizeof(float));
    }
    if (job->has_cache && o->cache_mode == KL_CACHE_MODE_FREEZE) {
        kl_hash_update(&hash, &state.generation, sizeof state.generation);
    }
    hash_blend(&hash, job, i);
    kl_hash_finish(&hash, digest);
}
