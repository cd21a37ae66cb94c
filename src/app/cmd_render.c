/* render and bake. A scene in which only the camera moves is filled for all frames, then rendered
 * from the frozen cache; a moving one has a cache per instant and goes through both per frame. */
#include "src/app/commands.h"
#include "src/app/folders.h"
#include "src/app/frame_file.h"
#include "src/app/job.h"
#include "src/app/report.h"
#include "src/base/clock.h"
#include "src/base/memory.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

struct plan_entry {
    bool renders;
    char *path;
};

struct run {
    struct kl_job job;
    struct kl_report *report;
    struct plan_entry *entries; /* one per frame; NULL: bake */
    struct kl_image *image;
    size_t to_render, rendered, skipped;
    uint64_t added;
    double uncovered, measured;
    struct kl_verify_errors errors; /* of all frames */
};

static bool note_render(void *context, double done)
{
    return kl_progress_update(context, done);
}

static void make_fingerprint(const struct kl_job *job, size_t i, char text[KL_FINGERPRINT_SIZE])
{
    struct kl_renderer_info info;
    uint8_t settings[KL_DIGEST_SIZE];

    kl_renderer_get_info(job->renderer, &info);
    kl_job_settings_digest(job, i, settings);
    kl_fingerprint_make(info.scene_digest, settings, job->frames[i].frame, text);
}

/* What to do with frame i whose file exists. Its instant has to be visited for its fingerprint. */
static kl_status plan_existing(struct run *run, size_t i, struct kl_err *err)
{
    struct kl_job *job = &run->job;
    int32_t number = job->frames[i].frame;
    const struct kl_frames one = {.count = 1, .frames = &number};
    struct kl_renderer_info info;
    uint8_t settings[KL_DIGEST_SIZE];
    struct kl_plan plan = {0};
    const bool frozen = job->options->cache_mode == KL_CACHE_MODE_FREEZE; /* generation counts */
    kl_status st = frozen ? kl_job_enter(job, i, err) : kl_job_visit(job, i, err);

    if (st != KL_OK) return st;
    kl_renderer_get_info(job->renderer, &info);
    kl_job_settings_digest(job, i, settings);
    const struct kl_plan_options options = {.frames = &one,
                                            .pattern = run->entries[i].path,
                                            .scene = info.scene_digest,
                                            .settings = settings,
                                            .overwrite = job->options->overwrite,
                                            .read = kl_frame_file_read};
    st = kl_plan_make(&options, &plan, err);
    if (st != KL_OK) return st;
    const enum kl_plan_action action = plan.frames[0].action;
    kl_plan_fini(&plan);
    run->entries[i].renders = action == KL_PLAN_RENDER;
    if (action == KL_PLAN_REFUSE) {
        st = kl_fail(err, KL_ERR_USAGE,
                     "%s: exists, made from another scene or with other settings; --overwrite "
                     "replaces it",
                     run->entries[i].path);
    }
    return st;
}

static kl_status plan_frames(struct run *run, struct kl_err *err)
{
    struct kl_job *job = &run->job;
    kl_status st = kl_alloc_array(&run->entries, job->frame_count, sizeof *run->entries, err);

    for (size_t i = 0; st == KL_OK && i < job->frame_count; ++i) {
        char path[KL_JOB_PATH_SIZE];
        st = kl_job_image_path(job, i, path, err);
        if (st == KL_OK) st = kl_copy_string(&run->entries[i].path, path, err);
        if (st != KL_OK) break;
        run->entries[i].renders = true;
        if (access(path, F_OK) == 0) st = plan_existing(run, i, err);
        run->to_render += run->entries[i].renders;
    }
    return st;
}

static kl_status fill_frames(struct run *run, size_t i, size_t count, struct kl_fill_stats *stats,
                             struct kl_err *err)
{
    kl_status st = kl_job_fill(&run->job, i, count, stats, err);

    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        run->added += stats->added[l];
    }
    run->uncovered = stats->uncovered;
    run->measured = fmax(run->measured, stats->measured);
    return st;
}

/* Render frame i, whose cache is filled, and write it. */
static kl_status render_frame(struct run *run, size_t i, struct kl_report_frame *entry,
                              struct kl_err *err)
{
    struct kl_job *job = &run->job;
    struct kl_renderer_blend blend[2 * KL_CACHE_BLEND_MOST];
    const struct kl_renderer_frame frame = {
        .camera = job->frames[i].camera,
        .before = job->frames[i].before,
        .cameras = job->frames[i].cameras,
        .camera_count = job->frames[i].camera_count,
        .times = job->shutter_times,
        .blend = blend,
        .blend_count = kl_job_blend(job, i, blend),
        .frame = kl_rig_sample_number(job->rig, job->frames[i].frame),
        .spp = job->options->spp,
        .note_use = true,
        .progress = note_render,
        .progress_context = &job->progress};
    char fingerprint[KL_FINGERPRINT_SIZE];
    const double start = kl_seconds();
    kl_status st = kl_renderer_frame(job->renderer, &frame, run->image, &entry->counts,
                                     &entry->bad_samples, err);

    entry->shade_seconds = kl_seconds() - start;
    if (st != KL_OK) return st;
    make_fingerprint(job, i, fingerprint);
    entry->error_estimate = kl_frame_file_error(run->image);
    const struct kl_frame_file file = {i, run->entries[i].path, fingerprint, entry->shade_seconds};
    st = kl_frame_file_write(job, &file, run->image, err);
    entry->write_seconds = kl_seconds() - start - entry->shade_seconds;
    if (st == KL_OK) {
        ++run->rendered;
        kl_progress_next_frame(&job->progress);
    }
    return st;
}

static kl_status verify_frame(struct run *run, size_t i, struct kl_report_frame *entry,
                              struct kl_err *err)
{
    struct kl_job *job = &run->job;
    if (!job->has_cache || job->options->verify <= 0.0) return KL_OK;
    entry->verified = true;
    return kl_renderer_verify(job->renderer, &job->frames[i].camera, job->options->verify,
                              &run->errors, &entry->verify, err);
}

static struct kl_report_frame start_entry(const struct run *run, size_t i)
{
    return (struct kl_report_frame){.frame = run->job.frames[i].frame,
                                    .outcome =
                                        run->entries != NULL ? KL_FRAME_SKIPPED : KL_FRAME_FILLED,
                                    .file = run->entries != NULL ? run->entries[i].path : NULL,
                                    .error_estimate = -1.0};
}

/* One frame of a run: its own fill in a moving scene (`fill` NULL), then its image. Else the fill
 * of all frames is behind us; the first frame that is not skipped takes it into its account. */
static kl_status do_frame(struct run *run, size_t i, struct kl_fill_stats *fill, struct kl_err *err)
{
    struct kl_job *job = &run->job;
    struct kl_report_frame entry = start_entry(run, i);
    const bool renders = run->entries != NULL && run->entries[i].renders;
    const double start = kl_seconds();
    kl_status st = KL_OK;

    if (run->entries != NULL && !renders) {
        ++run->skipped;
        return kl_report_add_frame(run->report, &entry, err);
    }
    st = kl_job_enter(job, i, err);
    if (fill != NULL) {
        entry.fill = *fill;
        *fill = (struct kl_fill_stats){0};
    } else if (st == KL_OK) {
        st = fill_frames(run, i, 1, &entry.fill, err);
    }
    entry.loaded = kl_job_loaded(job, i);
    entry.uncovered = run->uncovered;
    if (st == KL_OK) st = verify_frame(run, i, &entry, err);
    if (st == KL_OK && renders) {
        entry.outcome = KL_FRAME_RENDERED;
        st = render_frame(run, i, &entry, err);
    } else if (st == KL_OK) {
        kl_progress_next_frame(&job->progress);
    }
    entry.total_seconds = kl_seconds() - start;
    if (fill != NULL) {
        entry.total_seconds +=
            entry.fill.visibility_seconds + entry.fill.gather_seconds + entry.fill.insert_seconds;
    }
    return st == KL_OK ? kl_report_add_frame(run->report, &entry, err) : st;
}

static kl_status do_frames(struct run *run, struct kl_err *err)
{
    struct kl_job *job = &run->job;
    struct kl_fill_stats fill = {0};
    const bool moving = kl_renderer_is_moving(job->renderer);
    kl_status st = KL_OK;

    if (!moving) {
        kl_progress_begin(&job->progress, "fill", 0);
        st = kl_job_enter(job, 0, err);
        if (st == KL_OK) st = fill_frames(run, 0, job->frame_count, &fill, err);
    }
    kl_progress_begin(&job->progress, "render", run->entries ? run->to_render : job->frame_count);
    for (size_t i = 0; st == KL_OK && i < job->frame_count; ++i) {
        job->progress.phase = "render";
        if (kl_progress_is_stopped(&job->progress)) {
            return kl_fail(err, KL_ERR_INTERRUPTED, "interrupted");
        }
        st = do_frame(run, i, moving ? NULL : &fill, err);
    }
    return st;
}

/* Why a run stopped early, in place of the renderer's "interrupted". */
static kl_status explain_stop(const struct run *run, struct kl_err *err)
{
    const struct kl_job *job = &run->job;
    const size_t goal = run->entries != NULL ? run->to_render : job->frame_count;

    if (job->progress.stopped == KL_ERR_LIMIT) {
        return kl_fail(err, KL_ERR_LIMIT,
                       "time limit of %g s reached after %zu of %zu frames; the same command goes "
                       "on from here",
                       job->options->time_limit, run->rendered, goal);
    }
    return kl_fail(err, KL_ERR_INTERRUPTED,
                   "interrupted after %zu of %zu frames; the same command goes on from here",
                   run->rendered, goal);
}

/* The error of the irradiance as measured, all frames together. */
static kl_status sum_up_errors(struct run *run, struct kl_err *err)
{
    struct kl_verify_stats v;
    if (run->errors.count == 0) return KL_OK;
    kl_verify_summarise(&run->errors, &v);
    (void)printf("irradiance at %llu pixels: bias %+.2f %% +- %.2f, rmse %.2f %%, 95 %% within "
                 "%.2f %% (%.2f to %.2f), 99 %% within %.2f %%\n",
                 (unsigned long long)v.points, 100.0 * v.bias, 100.0 * v.bias_interval,
                 100.0 * v.rmse, 100.0 * v.p95, 100.0 * v.p95_low, 100.0 * v.p95_high,
                 100.0 * v.p99);
    return kl_report_set_verify(run->report, &v, err);
}

/* All frames are there, but the measured error is not what was asked for. */
static kl_status check_promise(const struct run *run, struct kl_err *err)
{
    const double asked = run->job.options->error;
    if (run->measured <= asked) return KL_OK;
    return kl_fail(err, KL_ERR_LIMIT,
                   "95 %% of the irradiance is within %.4g, not within the --error %.3g asked for; "
                   "more --rays help against noise",
                   run->measured, asked);
}

static void print_summary(const struct run *run)
{
    const struct kl_job *job = &run->job;

    if (run->entries != NULL) {
        (void)printf("frames: %zu rendered, %zu skipped\n", run->rendered, run->skipped);
    } else {
        (void)printf("frames: %zu filled\n", job->frame_count);
    }
    if (!job->has_cache || job->open_count == 0) return;
    (void)printf("cache: %lu records, %llu added", (unsigned long)kl_job_records(job),
                 (unsigned long long)run->added);
    if (job->has_store) (void)printf(", in %s", job->cache_dir);
    (void)putchar('\n');
}

static kl_status start_run(struct run *run, const struct kl_options *options, bool renders,
                           struct kl_err *err)
{
    kl_status st = kl_job_init(&run->job, options, err);

    if (st == KL_OK) st = kl_report_create(&run->report, err);
    if (st == KL_OK && renders) st = kl_frame_file_create(&run->job, &run->image, err);
    if (st == KL_OK && renders) st = plan_frames(run, err);
    return st;
}

static void free_run(struct run *run)
{
    for (size_t i = 0; run->entries != NULL && i < run->job.frame_count; ++i) {
        free(run->entries[i].path);
    }
    free(run->entries);
    free(run->errors.values);
    kl_image_destroy(run->image);
    kl_report_destroy(run->report);
    kl_job_fini(&run->job);
}

static kl_status run_job(const struct kl_options *options, bool renders, struct kl_err *err)
{
    struct run run = {0};
    kl_status st = start_run(&run, options, renders, err);
    const bool started = st == KL_OK;
    run.job.must_keep = !renders;

    if (st == KL_OK && (!renders || run.to_render > 0)) {
        st = do_frames(&run, err);
    } else if (st == KL_OK) {
        for (size_t i = 0; st == KL_OK && i < run.job.frame_count; ++i) {
            st = do_frame(&run, i, NULL, err);
        }
    }
    kl_progress_end(&run.job.progress);
    if (st == KL_ERR_INTERRUPTED) st = explain_stop(&run, err);
    if (st == KL_OK) st = sum_up_errors(&run, err);
    if (st == KL_OK) st = check_promise(&run, err);
    if (started && options->report != NULL) {
        struct kl_err report_err;
        const kl_status written = kl_report_write(run.report, &run.job, st, options->report,
                                                  st == KL_OK ? err : &report_err);
        if (st == KL_OK) st = written;
    }
    if (started && (st == KL_OK || st == KL_ERR_INTERRUPTED || st == KL_ERR_LIMIT)) {
        print_summary(&run);
    }
    free_run(&run);
    return st;
}

kl_status kl_command_render(const struct kl_options *options, struct kl_err *err)
{
    return run_job(options, true, err);
}

kl_status kl_command_bake(const struct kl_options *options, struct kl_err *err)
{
    const bool fills = options->indirect == KL_INDIRECT_OPTION_CACHE &&
                       (options->cache_mode == KL_CACHE_MODE_EXTEND ||
                        options->cache_mode == KL_CACHE_MODE_REBUILD);

    if (!fills) {
        return kl_fail(err, KL_ERR_USAGE,
                       "bake needs --indirect cache and --cache-mode extend or rebuild");
    }
    return run_job(options, false, err);
}
