#include "src/render/verify.h"

#include "src/base/memory.h"
#include "src/render/fill_points.h"
#include "src/render/reference.h"

#include <math.h>
#include <stdlib.h>

static const double z95 = 1.96;

/* What one camera sees: where to gather. */
struct points {
    kl_gather_point *gather;
    struct kl_point *where;
    kl_gather_result *results;
    size_t count;
};

static void points_fini(struct points *p)
{
    free(p->gather);
    free(p->where);
    free(p->results);
}

static size_t count_points(const struct kl_verify_job *job, size_t visible)
{
    const double wanted = ceil(job->share * (double)visible);
    const size_t most = job->at_most > 0 ? job->at_most / job->camera_count + 1 : visible;
    const size_t n = (size_t)wanted < most ? (size_t)wanted : most;
    return n < visible ? n : visible;
}

/* Of a camera's visible points, one in each of as many equal runs. */
static kl_status choose_points(const struct kl_verify_job *job, uint32_t camera, struct points *out,
                               struct kl_err *err)
{
    const struct kl_fill_job fill = {
        .scene = job->scene, .cameras = job->cameras, .camera_count = job->camera_count};
    struct kl_point *all = NULL;
    size_t visible = 0;
    kl_status st = kl_fill_screen_points(&fill, camera, 1, &all, &visible, err);
    if (st != KL_OK) return st;
    const size_t n = count_points(job, visible);
    st = kl_alloc_array(&out->gather, n, sizeof *out->gather, err);
    if (st == KL_OK) st = kl_alloc_array(&out->where, n, sizeof *out->where, err);
    if (st == KL_OK) st = kl_alloc_array(&out->results, n, sizeof *out->results, err);
    for (size_t k = 0; st == KL_OK && k < n; ++k) {
        const size_t first = k * visible / n;
        const size_t room = (k + 1) * visible / n - first;
        const struct kl_point *p = &all[first + kl_hash2((uint32_t)k, camera) % room];
        out->gather[k] = kl_fill_gather_point(job->motion, p->pos, kl_oct_encode(p->smooth),
                                              kl_oct_encode(p->geometric), KL_CACHE_LEVELS);
        out->where[k] = *p;
    }
    out->count = n;
    free(all);
    return st;
}

static int compare_sizes(const void *a, const void *b)
{
    const double x = fabs(*(const double *)a);
    const double y = fabs(*(const double *)b);
    return (x > y) - (x < y);
}

/* Percentile q of the sizes of n values sorted by size, and the order statistics that hold it with
 * 95 %. */
static void percentile(const double *sorted, size_t n, double q, double *value, double *low,
                       double *high)
{
    const double middle = q * (double)(n - 1);
    const double half = z95 * sqrt(q * (1.0 - q) * (double)n);
    *value = fabs(sorted[(size_t)(middle + 0.5)]);
    *low = fabs(sorted[(size_t)fmax(0.0, floor(middle - half))]);
    *high = fabs(sorted[(size_t)fmin((double)(n - 1), ceil(middle + half))]);
}

void kl_verify_summarise(struct kl_verify_errors *errors, struct kl_verify_stats *stats)
{
    const size_t n = errors->count;
    const double count = (double)n;
    double *values = errors->values;
    double sum = 0.0;
    double sum2 = 0.0;
    double sum4 = 0.0;

    *stats =
        (struct kl_verify_stats){.points = n, .unserved = errors->unserved, .rays = errors->rays};
    if (n == 0) return;
    for (size_t i = 0; i < n; ++i) {
        const double e2 = values[i] * values[i];
        sum += values[i];
        sum2 += e2;
        sum4 += e2 * e2;
    }
    stats->noise = sqrt(errors->noise2 / (count + (double)errors->unserved));
    stats->bias = sum / count;
    stats->bias_interval = z95 * sqrt(fmax(0.0, sum2 / count - stats->bias * stats->bias) / count);
    stats->rmse = sqrt(sum2 / count);
    const double spread = sqrt(fmax(0.0, sum4 / count - (sum2 / count) * (sum2 / count)) / count);
    stats->rmse_interval = stats->rmse > 0.0 ? z95 * spread / (2.0 * stats->rmse) : 0.0;
    qsort(values, n, sizeof *values, compare_sizes);
    percentile(values, n, 0.95, &stats->p95, &stats->p95_low, &stats->p95_high);
    percentile(values, n, 0.99, &stats->p99, &stats->p99_low, &stats->p99_high);
}

/* Append the errors at one camera's points. There is room. */
static void compare(const struct kl_verify_job *job, const struct points *points,
                    struct kl_verify_errors *errors)
{
    const size_t n = points->count;
    if (n == 0) return;
    const double black =
        kl_fill_black(points->results->irr, n, sizeof *points->results / sizeof(float));
    const double least = black > 0.0 ? black : 1.0;
    for (size_t i = 0; i < n; ++i) {
        const struct kl_point *p = &points->where[i];
        const kl_gather_result *r = &points->results[i];
        const kl_answer a = kl_cache_query(&job->cache, &job->query, p->pos, p->smooth, p->smooth);
        const double y = (double)kl_luminance(kl_v3_load(r->irr));
        errors->noise2 += (double)r->error * (double)r->error;
        if (a.weight > 0.0f) {
            errors->values[errors->count++] = ((double)kl_luminance(a.irr) - y) / fmax(y, least);
        } else {
            ++errors->unserved;
        }
    }
}

static kl_status gather(const struct kl_verify_job *job, struct points *points, uint64_t *rays,
                        struct kl_err *err)
{
    const kl_level_view nothing = {.head = {.record_count = 0}};
    const struct kl_gather_job gather = {
        .scene = job->motion,
        .level1 = job->level1 != NULL ? job->level1 : &nothing,
        .ladder = job->ladder,
        .settings = job->gather,
        .points = points->gather,
        .count = points->count,
        .results = points->results,
    };
    return kl_reference_gather(&gather, job->gather_batch, job->gather_context, rays, err);
}

static kl_status verify_camera(const struct kl_verify_job *job, uint32_t camera,
                               struct kl_verify_errors *errors, struct kl_err *err)
{
    struct points points = {0};
    kl_status st = choose_points(job, camera, &points, err);
    if (st == KL_OK) st = gather(job, &points, &errors->rays, err);
    if (st == KL_OK) {
        st = kl_grow_array(&errors->values, &errors->room, errors->count + points.count,
                           sizeof *errors->values, err);
    }
    if (st == KL_OK) compare(job, &points, errors);
    points_fini(&points);
    return st;
}

static kl_status append(struct kl_verify_errors *all, const struct kl_verify_errors *own,
                        struct kl_err *err)
{
    kl_status st =
        kl_grow_array(&all->values, &all->room, all->count + own->count, sizeof *all->values, err);
    if (st != KL_OK) return st;
    for (size_t i = 0; i < own->count; ++i) {
        all->values[all->count++] = own->values[i];
    }
    all->unserved += own->unserved;
    all->rays += own->rays;
    all->noise2 += own->noise2;
    return KL_OK;
}

kl_status kl_verify(const struct kl_verify_job *job, struct kl_verify_errors *all,
                    struct kl_verify_stats *stats, struct kl_err *err)
{
    struct kl_verify_errors own = {0};
    kl_status st = KL_OK;

    for (uint32_t i = 0; st == KL_OK && i < job->camera_count; ++i) {
        st = verify_camera(job, i, &own, err);
    }
    if (st == KL_OK && all != NULL) st = append(all, &own, err);
    if (st == KL_OK) kl_verify_summarise(&own, stats);
    free(own.values);
    return st;
}

double kl_verify_error(const struct kl_verify_stats *stats)
{
    const double noise = z95 * stats->noise / (double)KL_TOLD_NOISE;
    return sqrt(fmax(0.0, stats->p95 * stats->p95 - noise * noise));
}
