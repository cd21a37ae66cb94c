#include "src/app/job.h"

#include "sequences/pattern.h"
#include "src/app/exit_code.h"
#include "src/app/folders.h"
#include "src/app/scene_file.h"
#include "src/app/version.h"
#include "src/base/hash.h"
#include "src/base/memory.h"

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

static kl_status create_renderer(struct kl_job *job, struct kl_err *err)
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
                                                  .animation = job->animation};
    return kl_renderer_create(job->scene, &settings, &job->renderer, err);
}

enum { SHUTTER_CAMERAS = 33 }; /* a camera turns little between two of them */

/* The camera while the shutter is open. */
static kl_status place_shutter_cameras(struct kl_job *job, struct kl_job_frame *f,
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

static kl_status place_cameras(struct kl_job *job, struct kl_err *err)
{
    struct kl_frames list = {0};
    kl_status st = kl_rig_frames(job->rig, job->animation, &list, err);

    if (st == KL_OK) st = kl_alloc_array(&job->frames, list.count, sizeof *job->frames, err);
    for (size_t i = 0; st == KL_OK && i < list.count; ++i) {
        struct kl_job_frame *f = &job->frames[i];
        f->frame = list.frames[i];
        const double offset = job->options->shutter.offset;
        const struct kl_interval interval = kl_rig_interval(job->rig, f->frame);
        f->instants = (struct kl_renderer_instants){
            .reference = interval.reference,
            .open = interval.open,
            .close = interval.close,
            .before = kl_rig_interval(job->rig, f->frame - 1).reference};
        st = kl_rig_camera(job->rig, f->frame, offset, &f->camera, err);
        if (st == KL_OK) st = kl_rig_camera(job->rig, f->frame - 1, offset, &f->before, err);
        if (st == KL_OK && job->options->shutter.length > 0.0 &&
            kl_rig_moves(job->rig, job->animation)) {
            st = place_shutter_cameras(job, f, err);
        }
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
    if (st == KL_OK) st = create_renderer(job, err);
    if (st == KL_OK) st = kl_rig_create(job->scene, job->renderer, options, &job->rig, err);
    if (st == KL_OK) st = place_cameras(job, err);
    if (st == KL_OK) st = kl_renderer_set_instants(job->renderer, &job->frames[0].instants, err);
    return st;
}

void kl_job_fini(struct kl_job *job)
{
    kl_rig_destroy(job->rig);
    kl_renderer_destroy(job->renderer);
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

static kl_status open_cache(struct kl_job *job, struct kl_err *err)
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
    job->loaded = kl_job_records(job);
    job->is_open = true;
    ++job->open_count;
    return KL_OK;
}

kl_status kl_job_enter(struct kl_job *job, size_t i, struct kl_err *err)
{
    kl_status st = kl_renderer_set_instants(job->renderer, &job->frames[i].instants, err);

    if (kl_renderer_is_moving(job->renderer)) job->is_open = false;
    if (st == KL_OK && job->has_cache && !job->is_open) st = open_cache(job, err);
    return st;
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

kl_status kl_job_fill(struct kl_job *job, size_t i, size_t count, struct kl_fill_stats *stats,
                      struct kl_err *err)
{
    struct kl_camera *cameras = NULL;
    uint32_t used = 0;

    *stats = (struct kl_fill_stats){0};
    if (!job->fills) return KL_OK;
    kl_status st = kl_alloc_array(&cameras, count, 3 * sizeof *cameras, err);
    if (st != KL_OK) return st;
    for (size_t k = 0; k < count; ++k) {
        used += add_cameras(job, &job->frames[i + k], cameras + used);
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

void kl_job_settings_digest(const struct kl_job *job, size_t i, uint8_t digest[KL_DIGEST_SIZE])
{
    const struct kl_options *o = job->options;
    const uint32_t numbers[] = {(uint32_t)o->indirect, o->spp, o->seed, o->rays};
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
    kl_hash_finish(&hash, digest);
}
