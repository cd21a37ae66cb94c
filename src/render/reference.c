#include "src/render/reference.h"

#include "src/base/memory.h"
#include "src/render/fill_points.h"

#include <math.h>
#include <stdlib.h>

enum { MOST_GATHERS = 8 };

/* Those that are to be gathered once more. */
struct again {
    kl_gather_point *points;
    kl_gather_result *results;
    size_t *which; /* of the job's points */
    size_t count;
};

static void again_fini(struct again *a)
{
    free(a->points);
    free(a->results);
    free(a->which);
}

static kl_status again_init(struct again *a, size_t n, struct kl_err *err)
{
    kl_status st = kl_alloc_array(&a->points, n, sizeof *a->points, err);
    if (st == KL_OK) st = kl_alloc_array(&a->results, n, sizeof *a->results, err);
    if (st == KL_OK) st = kl_alloc_array(&a->which, n, sizeof *a->which, err);
    return st;
}

/* The points that `before` gathers left noisy, each with another seed than before. */
static void choose(const struct kl_gather_job *job, uint32_t before, struct again *a)
{
    a->count = 0;
    for (size_t i = 0; i < job->count; ++i) {
        const kl_gather_result *r = &job->results[i];
        const float y = kl_luminance(kl_v3_load(r->irr));
        if (r->error * y <= job->ladder.tolerance * kl_fmax(y, job->ladder.floor)) continue;
        a->points[a->count] = job->points[i];
        kl_fill_seed(&a->points[a->count], kl_hash(job->points[i].seed + before));
        a->which[a->count++] = i;
    }
}

/* Take an independent gather into the mean of `before` others. */
static void take_in(kl_gather_result *mean, const kl_gather_result *next, uint32_t before)
{
    const float share = 1.0f / (float)(before + 1);
    const float earlier = mean->error * kl_luminance(kl_v3_load(mean->irr)) * (float)before;
    const float own = next->error * kl_luminance(kl_v3_load(next->irr));
    for (int k = 0; k < 3; ++k) {
        mean->irr[k] += (next->irr[k] - mean->irr[k]) * share;
    }
    const float y = kl_luminance(kl_v3_load(mean->irr));
    mean->error = y > 0.0f ? hypotf(earlier, own) * share / y : 0.0f;
}

static uint64_t rays_of(const kl_gather_result *results, size_t count)
{
    uint64_t rays = 0;
    for (size_t i = 0; i < count; ++i) {
        rays += (uint64_t)results[i].side * results[i].side;
    }
    return rays;
}

kl_status kl_reference_gather(const struct kl_gather_job *job, kl_gather_fn gather_batch,
                              void *gather_context, uint64_t *rays, struct kl_err *err)
{
    struct kl_gather_job once = *job;
    struct again a = {0};
    kl_status st = gather_batch(gather_context, job, err);

    if (st == KL_OK) *rays += rays_of(job->results, job->count);
    if (st == KL_OK) st = again_init(&a, job->count, err);
    once.points = a.points;
    once.results = a.results;
    once.ladder.steps[0] = job->ladder.steps[job->ladder.count - 1];
    once.ladder.count = 1;
    for (uint32_t before = 1; st == KL_OK && before < MOST_GATHERS; ++before) {
        choose(job, before, &a);
        once.count = a.count;
        if (a.count == 0) break;
        st = gather_batch(gather_context, &once, err);
        for (size_t k = 0; st == KL_OK && k < a.count; ++k) {
            take_in(&job->results[a.which[k]], &a.results[k], before);
        }
        if (st == KL_OK) *rays += rays_of(a.results, a.count);
    }
    again_fini(&a);
    return st;
}
