/* What radii are worth: error of cached irradiance over records, Hessian against split-sphere
 * radii. Both caches gather with the same number of rays and stand as for an image `finer` times as
 * large as the one named; at 1/16 as many of its pixels as the named one has the cache's answer is
 * compared with a gather of that point by 65 536 rays or more that end in the same level 1, so that
 * radii and the records' own noise are all that differs. `first_order`: the same records, each
 * followed by its own gradient alone, as split-sphere was published. Prints JSON. usage:
 * bench_radii SCENE.glb CAMERA WIDTH HEIGHT [rays 16384] [finer 4] */
#include "src/base/memory.h"
#include "src/import/import.h"
#include "src/render/fill_points.h"
#include "src/render/reference.h"
#include "src/render/renderer_impl.h"
#include "tests/bench/bench_sort.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST = 6, EVERY = 4 };      /* plus one: pixels that the fill looks around from are even */
static const float quiet = 0.002f; /* relative standard error of references */

struct bench {
    struct kl_scene *scene;
    const char *camera;
    uint32_t width, height, rays, finer;
};

/* How records are interpolated. */
enum rule { ANSWER, FIRST_ORDER, RULES };
static const char *const rule_names[RULES] = {"answer", "first_order"};

struct rmse {
    double relative, absolute; /* of relative errors; over the mean irradiance */
};

struct point {
    double error; /* that was asked for */
    uint32_t records;
    struct rmse rmse[RULES];
};

struct curve {
    const char *name;
    enum kl_radius_rule rule;
    double errors[MOST];
    struct point points[MOST];
    int count;
};

static kl_status find_camera(const struct bench *b, struct kl_renderer *r, struct kl_camera *out,
                             struct kl_err *err)
{
    for (uint32_t i = 0; i < b->scene->camera_count; ++i) {
        if (strcmp(b->scene->cameras[i].name, b->camera) != 0) continue;
        return kl_renderer_camera(r, i, 0.0, b->finer * b->width, b->finer * b->height, out, err);
    }
    return kl_fail(err, KL_ERR_USAGE, "no camera '%s'", b->camera);
}

/* Luminance of the weighted mean of what all records say by their own gradients; 0: none serves. */
static float first_order(const kl_level_view *level, const kl_query *query,
                         const struct kl_point *p)
{
    double shares = 0.0;
    double sum = 0.0;
    for (uint32_t i = 0; i < level->head.record_count; ++i) {
        const kl_record_hot *hot = &level->hot[i];
        const kl_record_cold *cold = &level->cold[i];
        const kl_bearing b = kl_record_bearing(hot, query, p->pos, p->smooth);
        if (!(b.weight > 0.0f) || kl_record_is_blocked(cold, &b)) continue;
        const double share = (double)b.weight / ((double)hot->radius * (double)hot->radius);
        const kl_vec3 gain = kl_v3_scale(kl_record_half_gain(cold, b), 2.0f);
        shares += share;
        sum += share * (double)kl_luminance(kl_record_with_gain(cold, gain));
    }
    return shares > 0.0 ? (float)(sum / shares) : 0.0f;
}

static float said(enum rule rule, const kl_level_view *level, const struct kl_point *p)
{
    const kl_query query = kl_renderer_eye_query();
    if (rule == FIRST_ORDER) return first_order(level, &query, p);
    return kl_luminance(kl_cache_query(level, &query, p->pos, p->smooth, p->smooth).irr);
}

/* Errors at `n` points, less what is noise of the references. Points without a record are left out.
 */
static struct rmse judge(enum rule rule, const struct kl_renderer *r, const struct kl_point *where,
                         const kl_gather_result *found, size_t n)
{
    const kl_level_view level = kl_cache_view(r->cache, 0);
    double sum = 0.0;
    double absolute2 = 0.0;
    double relative2 = 0.0;
    double served = 0.0;
    for (size_t i = 0; i < n; ++i) {
        const double e = (double)said(rule, &level, &where[i]);
        const double y = (double)kl_luminance(kl_v3_load(found[i].irr));
        const double noise = (double)found[i].error * y;
        if (!(e > 0.0) || !(y > 0.0)) continue;
        sum += y;
        absolute2 += (e - y) * (e - y) - noise * noise;
        relative2 += ((e - y) * (e - y) - noise * noise) / (y * y);
        served += 1.0;
    }
    if (!(served > 0.0)) return (struct rmse){0};
    return (struct rmse){.relative = sqrt(fmax(0.0, relative2) / served),
                         .absolute = sqrt(fmax(0.0, absolute2) / served) / (sum / served)};
}

static kl_status compare(struct kl_renderer *r, const struct kl_camera *camera, uint32_t every,
                         struct point *p, struct kl_err *err)
{
    const kl_level_view level1 = kl_cache_view(r->cache, 1);
    const struct kl_fill_job screen = {
        .scene = kl_renderer_reference(r), .cameras = camera, .camera_count = 1};
    struct kl_gather_job job = {
        .scene = kl_renderer_motion(r),
        .level1 = &level1,
        .settings = {.query = kl_renderer_gather_query(), .length_scale = KL_LENGTH_SCALE},
    };
    struct kl_point *where = NULL;
    kl_gather_point *gather = NULL;
    uint64_t rays = 0;
    kl_status st = kl_renderer_climb(r, KL_LAST_SIDE, 1, 1.0f, &job.ladder, err);
    job.ladder.tolerance = KL_TOLD_NOISE * quiet;
    if (st == KL_OK) st = kl_fill_screen_points(&screen, 0, every, &where, &job.count, err);
    if (st == KL_OK) st = kl_alloc_array(&gather, job.count, sizeof *gather, err);
    if (st == KL_OK) st = kl_alloc_array(&job.results, job.count, sizeof *job.results, err);
    for (size_t i = 0; st == KL_OK && i < job.count; ++i) {
        gather[i] = kl_fill_gather_point(job.scene, where[i].pos, kl_oct_encode(where[i].smooth),
                                         kl_oct_encode(where[i].geometric), KL_CACHE_LEVELS);
    }
    job.points = gather;
    if (st == KL_OK) st = kl_reference_gather(&job, kl_gatherer_run, r->gatherer, &rays, err);
    for (int k = 0; st == KL_OK && k < RULES; ++k) {
        p->rmse[k] = judge((enum rule)k, r, where, job.results, job.count);
    }
    free(where);
    free(gather);
    free(job.results);
    return st;
}

static kl_status measure(const struct bench *b, enum kl_radius_rule rule, struct point *p,
                         struct kl_err *err)
{
    const struct kl_renderer_settings settings = {.rays = b->rays,
                                                  .indirect = KL_INDIRECT_CACHE,
                                                  .radius = rule,
                                                  .device = "embree",
                                                  .error = p->error,
                                                  .animation = KL_NONE};
    struct kl_renderer *r = NULL;
    struct kl_camera camera;
    struct kl_fill_stats stats;
    const struct kl_renderer_fill fill = {.cameras = &camera, .camera_count = 1};
    kl_status st = kl_renderer_create(b->scene, &settings, &r, err);
    if (st == KL_OK) st = kl_renderer_set_time(r, 0.0, err);
    if (st == KL_OK) st = find_camera(b, r, &camera, err);
    if (st == KL_OK) st = kl_renderer_open_cache(r, NULL, KL_STORE_EXTEND, err);
    if (st == KL_OK) st = kl_renderer_fill(r, &fill, &stats, err);
    if (st == KL_OK) st = compare(r, &camera, EVERY * b->finer + 1, p, err);
    if (st == KL_OK) p->records = kl_cache_count(r->cache, 0);
    kl_renderer_destroy(r);
    return st;
}

static kl_status measure_curve(const struct bench *b, struct curve *c, struct kl_err *err)
{
    kl_status st = KL_OK;
    for (c->count = 0; st == KL_OK && c->count < MOST && c->errors[c->count] > 0.0; ++c->count) {
        struct point *p = &c->points[c->count];
        p->error = c->errors[c->count];
        st = measure(b, c->rule, p, err);
        if (st != KL_OK) return st;
        (void)fprintf(stderr, "%s %g: %u records", c->name, p->error, p->records);
        for (int k = 0; k < RULES; ++k) {
            (void)fprintf(stderr, ", %s: RMSE %.4f of the mean, %.4f relative", rule_names[k],
                          p->rmse[k].absolute, p->rmse[k].relative);
        }
        (void)fprintf(stderr, "\n");
    }
    return st;
}

static double along(double from, double to, double f)
{
    return from * pow(to / from, f);
}

/* RMSE of a curve at a number of records, log-log between its points; 0 outside of them. */
static struct rmse at_records(const struct curve *c, uint32_t records, int rule)
{
    for (int i = 1; i < c->count; ++i) {
        const struct point *p = &c->points[i - 1];
        const struct point *q = &c->points[i];
        if (records < p->records || records > q->records || p->records == q->records) continue;
        const double f = log((double)records / p->records) / log((double)q->records / p->records);
        return (struct rmse){along(p->rmse[rule].relative, q->rmse[rule].relative, f),
                             along(p->rmse[rule].absolute, q->rmse[rule].absolute, f)};
    }
    return (struct rmse){0};
}

static void print_curve(const struct curve *c)
{
    (void)printf(",\n \"%s\": [", c->name);
    for (int i = 0; i < c->count; ++i) {
        const struct point *p = &c->points[i];
        (void)printf("%s{\"error\": %g, \"records\": %u", i > 0 ? ", " : "", p->error, p->records);
        for (int k = 0; k < RULES; ++k) {
            (void)printf(", \"%s\": {\"rmse\": %.5f, \"relative_rmse\": %.5f}", rule_names[k],
                         p->rmse[k].absolute, p->rmse[k].relative);
        }
        (void)printf("}");
    }
    (void)printf("]");
}

static double median(double *values, int n)
{
    bench_sort(values, (size_t)n);
    return n > 0 ? 0.5 * (values[(n - 1) / 2] + values[n / 2]) : 0.0;
}

/* Split-sphere over Hessian, the one as answers go, the other by either rule, at each number of
 * records of Hessians that lies on the other curve, and the medians. */
static void print_ratios(const struct curve *hessian, const struct curve *other)
{
    double absolute[RULES][MOST];
    double relative[RULES][MOST];
    int n = 0;
    (void)printf(",\n \"equal_records\": [");
    for (int i = 0; i < hessian->count; ++i) {
        const struct point *p = &hessian->points[i];
        if (!(at_records(other, p->records, ANSWER).absolute > 0.0)) continue;
        (void)printf("%s{\"records\": %u", n > 0 ? ", " : "", p->records);
        for (int k = 0; k < RULES; ++k) {
            const struct rmse split = at_records(other, p->records, k);
            absolute[k][n] = split.absolute / p->rmse[ANSWER].absolute;
            relative[k][n] = split.relative / p->rmse[ANSWER].relative;
            (void)printf(", \"%s\": {\"rmse_ratio\": %.3f, \"relative_rmse_ratio\": %.3f}",
                         rule_names[k], absolute[k][n], relative[k][n]);
        }
        (void)printf("}");
        ++n;
    }
    (void)printf("],\n \"medians\": {");
    for (int k = 0; k < RULES; ++k) {
        (void)printf("%s\"%s\": {\"rmse_ratio\": %.3f, \"relative_rmse_ratio\": %.3f}",
                     k > 0 ? ", " : "", rule_names[k], median(absolute[k], n),
                     median(relative[k], n));
    }
    (void)printf("}}\n");
}

static void print(const struct bench *b, const struct curve *curves)
{
    (void)printf("{\"camera\": \"%s\", \"width\": %u, \"height\": %u, \"rays\": %u, \"finer\": "
                 "%u",
                 b->camera, b->width, b->height, b->rays, b->finer);
    print_curve(&curves[0]);
    print_curve(&curves[1]);
    print_ratios(&curves[0], &curves[1]);
}

int main(int argc, char **argv)
{
    struct curve curves[] = {
        {.name = "hessian", .rule = KL_RADIUS_HESSIAN, .errors = {0.1, 0.07, 0.05, 0.035, 0.025}},
        {.name = "split_sphere",
         .rule = KL_RADIUS_SPLIT_SPHERE,
         .errors = {0.28, 0.2, 0.14, 0.1, 0.07, 0.05}},
    };
    struct bench b = {0};
    struct kl_err err = {0};
    if (argc < 5) {
        (void)fprintf(stderr, "usage: bench_radii SCENE.glb CAMERA WIDTH HEIGHT [rays] [finer]\n");
        return 1;
    }
    b.camera = argv[2];
    b.width = (uint32_t)strtoul(argv[3], NULL, 10);
    b.height = (uint32_t)strtoul(argv[4], NULL, 10);
    b.rays = argc > 5 ? (uint32_t)strtoul(argv[5], NULL, 10) : 16384;
    b.finer = argc > 6 ? (uint32_t)strtoul(argv[6], NULL, 10) : 4;
    kl_status st = kl_import_gltf(argv[1], NULL, NULL, &b.scene, &err);
    for (int i = 0; st == KL_OK && i < 2; ++i) {
        st = measure_curve(&b, &curves[i], &err);
    }
    if (st == KL_OK) {
        print(&b, curves);
    } else {
        (void)fprintf(stderr, "%s\n", err.msg);
    }
    kl_scene_destroy(b.scene);
    return st == KL_OK ? 0 : 1;
}
