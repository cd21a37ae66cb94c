#include "src/app/report.h"

#include "src/app/json_text.h"
#include "src/app/scene_file.h"
#include "src/app/version.h"
#include "src/base/clock.h"
#include "src/base/hash.h"
#include "src/base/memory.h"

#include <jansson.h>
#include <math.h>
#include <omp.h>
#include <stdlib.h>

struct sums {
    struct kl_fill_stats fill;
    struct kl_counts counts;
    uint64_t bad_samples, added;
    double shade_seconds, write_seconds, uncovered;
    size_t rendered, skipped;
};

struct kl_report {
    json_t *frames, *verify; /* verify: NULL if nothing was verified */
    struct sums sums;
};

kl_status kl_report_create(struct kl_report **out, struct kl_err *err)
{
    struct kl_report *report = NULL;
    kl_status st = kl_alloc_array(&report, 1, sizeof *report, err);

    if (st != KL_OK) return st;
    report->frames = json_array();
    if (report->frames == NULL) {
        free(report);
        return kl_fail(err, KL_ERR_NO_MEMORY, "out of memory");
    }
    *out = report;
    return KL_OK;
}

void kl_report_destroy(struct kl_report *report)
{
    if (report == NULL) return;
    json_decref(report->frames);
    json_decref(report->verify);
    free(report);
}

static json_int_t integer(uint64_t n)
{
    return (json_int_t)n;
}

static uint64_t added_by(const struct kl_fill_stats *fill)
{
    uint64_t sum = 0;
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        sum += fill->added[l];
    }
    return sum;
}

static double fill_seconds(const struct kl_fill_stats *fill)
{
    return fill->visibility_seconds + fill->gather_seconds + fill->insert_seconds;
}

static json_t *describe_verify(const struct kl_verify_stats *v)
{
    return json_pack("{s:I,s:I,s:f,s:f,s:f,s:f,s:f,s:[f,f],s:f,s:[f,f],s:f}", "points",
                     integer(v->points), "unserved", integer(v->unserved), "bias", v->bias,
                     "bias_interval", v->bias_interval, "rmse", v->rmse, "rmse_interval",
                     v->rmse_interval, "p95", v->p95, "p95_interval", v->p95_low, v->p95_high,
                     "p99", v->p99, "p99_interval", v->p99_low, v->p99_high, "reference_noise",
                     v->noise);
}

kl_status kl_report_set_verify(struct kl_report *report, const struct kl_verify_stats *stats,
                               struct kl_err *err)
{
    json_decref(report->verify);
    report->verify = describe_verify(stats);
    return report->verify != NULL ? KL_OK : kl_fail(err, KL_ERR_NO_MEMORY, "report: out of memory");
}

/* null where there is no estimate. */
static json_t *estimate(double error)
{
    return error < 0.0 || !isfinite(error) ? json_null() : json_real(error);
}

static void add_sums(struct sums *sums, const struct kl_report_frame *f)
{
    sums->fill.visibility_seconds += f->fill.visibility_seconds;
    sums->fill.gather_seconds += f->fill.gather_seconds;
    sums->fill.insert_seconds += f->fill.insert_seconds;
    sums->fill.primary_rays += f->fill.primary_rays;
    sums->fill.gather_rays += f->fill.gather_rays;
    sums->fill.batches += f->fill.batches;
    sums->counts.primary += f->counts.primary;
    sums->counts.shadow += f->counts.shadow;
    sums->counts.path += f->counts.path;
    sums->counts.late += f->counts.late;
    sums->counts.lookups += f->counts.lookups;
    sums->counts.lookup_hits += f->counts.lookup_hits;
    sums->counts.reused += f->counts.reused;
    sums->bad_samples += f->bad_samples;
    sums->added += added_by(&f->fill);
    sums->shade_seconds += f->shade_seconds;
    sums->write_seconds += f->write_seconds;
    sums->uncovered = fmax(sums->uncovered, f->uncovered);
    sums->fill.measured = fmax(sums->fill.measured, f->fill.measured);
    sums->rendered += f->outcome == KL_FRAME_RENDERED;
    sums->skipped += f->outcome == KL_FRAME_SKIPPED;
}

kl_status kl_report_add_frame(struct kl_report *report, const struct kl_report_frame *frame,
                              struct kl_err *err)
{
    static const char *const outcomes[] = {[KL_FRAME_RENDERED] = "rendered",
                                           [KL_FRAME_SKIPPED] = "skipped",
                                           [KL_FRAME_FILLED] = "filled"};
    const struct kl_report_frame *f = frame;
    json_t *seconds =
        json_pack("{s:f,s:f,s:f,s:f,s:f,s:f,s:f}", "total", f->total_seconds, "visibility",
                  f->fill.visibility_seconds, "fill", fill_seconds(&f->fill), "gather",
                  f->fill.gather_seconds, "insert", f->fill.insert_seconds, "shade",
                  f->shade_seconds, "write", f->write_seconds);
    json_t *records = json_pack("{s:I,s:I,s:I,s:I}", "loaded", integer(f->loaded), "added",
                                integer(added_by(&f->fill)), "refreshed",
                                integer(f->fill.refreshed), "late", integer(f->counts.late));
    json_t *rays =
        json_pack("{s:I,s:I,s:I,s:I}", "primary", integer(f->fill.primary_rays + f->counts.primary),
                  "shadow", integer(f->counts.shadow), "gather", integer(f->fill.gather_rays),
                  "path", integer(f->counts.path));
    json_t *entry = json_pack(
        "{s:i,s:s,s:s?,s:o,s:o,s:I,s:I,s:I,s:o,s:f,s:o,s:I}", "frame", (int)f->frame, "outcome",
        outcomes[f->outcome], "file", f->file, "seconds", seconds, "records", records, "lookups",
        integer(f->counts.lookups), "lookup_hits", integer(f->counts.lookup_hits), "reused_last",
        integer(f->counts.reused), "rays", rays, "uncovered", f->uncovered, "error_estimate",
        estimate(f->error_estimate), "bad_samples", integer(f->bad_samples));
    if (entry != NULL && f->verified) {
        (void)json_object_set_new(entry, "verify", describe_verify(&f->verify));
    }
    if (entry == NULL || json_array_append_new(report->frames, entry) != 0) {
        return kl_fail(err, KL_ERR_NO_MEMORY, "report: out of memory");
    }
    add_sums(&report->sums, f);
    return KL_OK;
}

static json_t *describe_program(const struct kl_renderer_info *info)
{
    return json_pack("{s:s,s:s,s:s,s:i}", "version", KL_VERSION, "commit", KL_COMMIT, "device",
                     info->device, "threads", omp_get_max_threads());
}

static json_t *describe_scene(const struct kl_job *job, const struct kl_renderer_info *info)
{
    const char *names[KL_NEED_NAMES];
    char digest[KL_HASH_HEX_SIZE];
    json_t *needs = json_array();

    kl_hash_to_hex(info->scene_digest, KL_HASH_SIZE, digest);
    kl_need_names(info->needs, names);
    for (size_t i = 0; names[i] != NULL; ++i) {
        if (json_array_append_new(needs, json_string(names[i])) != 0) break;
    }
    return json_pack("{s:s,s:s,s:I,s:I,s:o}", "path", job->options->arguments[0], "digest", digest,
                     "triangles", integer(info->triangles), "lights", integer(info->lights),
                     "needs", needs);
}

static json_t *describe_frames(const struct kl_job *job)
{
    json_t *frames = json_array();
    for (size_t i = 0; i < job->frame_count; ++i) {
        if (json_array_append_new(frames, json_integer(job->frames[i].frame)) != 0) break;
    }
    return frames;
}

static json_t *describe_settings(const struct kl_job *job)
{
    const struct kl_options *o = job->options;
    json_t *image = json_pack(
        "{s:o,s:f,s:f,s:f,s:s?,s:I,s:s?,s:i,s:i,s:I,s:s,s:s,s:b,s:b}", "frames",
        describe_frames(job), "fps", kl_fps_get(o->fps), "shutter", o->shutter.length,
        "shutter_offset", o->shutter.offset, "camera", o->camera, "turntable",
        integer(o->turntable), "path", o->path, "width", (int)o->width, "height", (int)o->height,
        "spp", integer(o->spp), "out", job->pattern, "aov", o->aov != NULL ? o->aov : "all", "png",
        (int)o->png, "overwrite", (int)o->overwrite);
    json_t *light = json_pack(
        "{s:s,s:s?,s:s,s:I,s:s,s:f,s:s?,s:s,s:f,s:I,s:s,s:I,s:s?,s:s,s:f}", "indirect",
        kl_indirect_name(o->indirect), "cache", job->has_store ? job->cache_dir : NULL,
        "cache_mode", kl_cache_mode_name(o->cache_mode), "cache_blend", integer(o->cache_blend),
        "moving", o->carry ? "carry" : "rebuild", "error", o->error, "preset", o->preset, "radius",
        o->split_sphere ? "split-sphere" : "hessian", "verify", o->verify, "rays", integer(o->rays),
        "device", o->device != NULL ? o->device : "auto", "seed", integer(o->seed), "env", o->env,
        "animation", o->animation != NULL ? o->animation : "all", "time_limit", o->time_limit);
    if (image != NULL && light != NULL) (void)json_object_update(image, light);
    json_decref(light);
    return image;
}

static json_t *describe_total(const struct kl_report *report, const struct kl_job *job,
                              const char *outcome)
{
    const struct sums *s = &report->sums;
    struct kl_cache_state state;
    json_t *seconds = json_pack("{s:f,s:f,s:f,s:f,s:f}", "visibility", s->fill.visibility_seconds,
                                "gather", s->fill.gather_seconds, "insert", s->fill.insert_seconds,
                                "shade", s->shade_seconds, "write", s->write_seconds);
    json_t *rays =
        json_pack("{s:I,s:I,s:I,s:I}", "primary", integer(s->fill.primary_rays + s->counts.primary),
                  "shadow", integer(s->counts.shadow), "gather", integer(s->fill.gather_rays),
                  "path", integer(s->counts.path));

    kl_renderer_get_cache(job->renderer, &state);
    return json_pack(
        "{s:s,s:f,s:o,s:I,s:I,s:I,s:I,s:I,s:I,s:I,s:o,s:I,s:I,s:I,s:f,s:I,s:I,s:o}", "outcome",
        outcome, "seconds", kl_seconds() - job->options->start, "seconds_by_stage", seconds,
        "records", integer(kl_job_records(job)), "records_added", integer(s->added), "records_late",
        integer(s->counts.late), "cache_bytes", integer(state.bytes), "cache_generation",
        integer(state.generation), "damaged_segments", integer(state.damaged), "peak_rss_bytes",
        (json_int_t)kl_peak_rss(), "rays", rays, "lookups", integer(s->counts.lookups),
        "lookup_hits", integer(s->counts.lookup_hits), "reused_last", integer(s->counts.reused),
        "uncovered", s->uncovered, "frames_rendered", integer(s->rendered), "frames_skipped",
        integer(s->skipped), "measured_error",
        s->fill.measured > 0.0 ? json_real(s->fill.measured) : json_null());
}

kl_status kl_report_write(const struct kl_report *report, const struct kl_job *job,
                          kl_status outcome, const char *path, struct kl_err *err)
{
    const char *word = outcome == KL_OK ? "done" : "failed";
    struct kl_renderer_info info;
    kl_status st = KL_OK;

    if (outcome == KL_ERR_INTERRUPTED) word = "interrupted";
    if (outcome == KL_ERR_LIMIT) word = "limit";
    kl_renderer_get_info(job->renderer, &info);
    json_t *root = json_object();
    st = kl_json_put(root, "program", describe_program(&info), err);
    if (st == KL_OK) st = kl_json_put(root, "scene", describe_scene(job, &info), err);
    if (st == KL_OK) st = kl_json_put(root, "settings", describe_settings(job), err);
    if (st == KL_OK) st = kl_json_put(root, "frames", json_incref(report->frames), err);
    if (st == KL_OK && report->verify != NULL) {
        st = kl_json_put(root, "verify", json_incref(report->verify), err);
    }
    if (st == KL_OK) st = kl_json_put(root, "total", describe_total(report, job, word), err);
    if (st == KL_OK) st = kl_json_write(root, path, err);
    json_decref(root);
    return st;
}
