#include "src/render/fill.h"

#include "src/base/clock.h"
#include "src/base/memory.h"
#include "src/cache/record.h"
#include "src/cache/thin.h"
#include "src/render/fill_points.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double black = 1e-3;      /* of the geometric mean of the irradiance */
static const float right_here = 0.9f;  /* weight of a record that close */
static const float alike = 0.98f;      /* cosine: candidates exclude each other */
static const float exclusion = 0.5f;   /* of the predicted radius */
static const float unknown_px = 12.0f; /* predicted radius where nothing is known yet */
static const float way_px = 8.0f;      /* shorter ways are never too long: rims would have no end */
enum { MAX_PASSES = 64, MAX_ROUNDS = 8, FIRST_BATCH = 512, FIRST_RAYS = 1 << 20 };
enum { MANY_CAMERAS = 8, STAGE_POINTS = 1 << 20 };
/* Rays of a batch at most: seconds, so that stopping and progress do not wait for minutes. */
enum { BATCH_RAYS = 1 << 22 };

/* Do the records serve a point well enough? Enough of them, none of them so large that it need not
 * know what is close to the point, unless it is right here, and not all from one side: what an
 * answer lacks to second order grows with the square of the mean way (decision 0034). */
static bool is_covered(const struct kl_fill_job *job, uint32_t level, const kl_level_view *view,
                       const struct kl_point *p)
{
    const struct kl_served *served = &job->served[level];
    const kl_answer a = kl_cache_query(view, &served->query, p->pos, p->smooth, p->smooth);
    const float largest =
        kl_cache_get_settings(job->cache)->accuracy[level] * KL_RAW_OVER_HARMONIC * p->near;
    const float farthest = fmaxf(served->most_way * a.radius, way_px * p->pixel);
    return a.weight >= served->least_weight && a.way <= farthest &&
           (a.best >= right_here || a.radius <= largest);
}

/* Copy the points that are not served well enough to `out`, which may be `points`; their number. */
static size_t find_uncovered(const struct kl_fill_job *job, uint32_t level, struct kl_point *points,
                             size_t count, struct kl_point *out)
{
    const kl_level_view view = kl_cache_view(job->cache, level);
    size_t kept = 0;

#pragma omp parallel for schedule(dynamic, 256)
    for (size_t i = 0; i < count; ++i) {
        points[i].covered = is_covered(job, level, &view, &points[i]);
    }
    for (size_t i = 0; i < count; ++i) {
        if (!points[i].covered) out[kept++] = points[i];
    }
    return kept;
}

/* Pixel size [m] at a point, the smallest over all cameras that have it in their frame: a later
 * frame may come closer. */
static float finest_pixel(const struct kl_fill_job *job, kl_vec3 pos, float otherwise)
{
    float finest = otherwise;
    for (uint32_t i = 0; i < job->camera_count; ++i) {
        const struct kl_camera *c = &job->cameras[i];
        float x;
        float y;
        float depth;
        if (!kl_camera_project(c, pos, &x, &y, &depth)) continue;
        if (x < 0.0f || y < 0.0f || x > (float)c->width || y > (float)c->height) continue;
        finest = fminf(finest, kl_camera_pixel_size(c, depth));
    }
    return finest;
}

struct batch {
    kl_gather_point *points;
    kl_gather_result *results;
    kl_record_hot *hot;
    kl_record_cold *cold;
};

static void batch_fini(struct batch *b)
{
    free(b->points);
    free(b->results);
    free(b->hot);
    free(b->cold);
}

static kl_status batch_init(struct batch *b, size_t n, struct kl_err *err)
{
    *b = (struct batch){0};
    kl_status st = kl_alloc_array(&b->points, n, sizeof *b->points, err);
    if (st == KL_OK) st = kl_alloc_array(&b->results, n, sizeof *b->results, err);
    if (st == KL_OK) st = kl_alloc_array(&b->hot, n, sizeof *b->hot, err);
    if (st == KL_OK) st = kl_alloc_array(&b->cold, n, sizeof *b->cold, err);
    return st;
}

double kl_fill_black(const float *irr, size_t count, size_t stride)
{
    double logs = 0.0;
    size_t lit = 0;
    for (size_t i = 0; i < count; ++i) {
        const float y = kl_luminance(kl_v3_load(irr + i * stride));
        if (!(y > 0.0f)) continue;
        logs += log((double)y);
        ++lit;
    }
    return lit > 0 ? black * exp(logs / (double)lit) : 0.0;
}

/* All light that bounces more often comes through the first records of level 1: their noise, unlike
 * that of later ones, does not average out. Together they get rays for a mean within a few tenths
 * of a percent. */
static struct kl_gather_ladder ladder_for(const struct kl_fill_job *job, uint32_t level,
                                          const kl_level_view *level1, size_t count)
{
    struct kl_gather_ladder ladder = job->ladder[level];
    const size_t together = level1->head.record_count + count;
    if (level == 0 || level1->head.record_count >= FIRST_BATCH) return ladder;
    ladder.count = 1;
    for (uint32_t i = 0; i < job->ladder[0].count; ++i) {
        const size_t side = ladder.steps[0]->side;
        if (side * side * together >= FIRST_RAYS) break;
        ladder.steps[0] = job->ladder[0].steps[i];
    }
    return ladder;
}

kl_status kl_fill_gather(const struct kl_fill_job *job, const kl_level_view *level1, uint32_t level,
                         const kl_gather_point *points, size_t count, kl_gather_result *results,
                         struct kl_fill_stats *stats, struct kl_err *err)
{
    struct kl_gather_job gather = {.scene = job->motion,
                                   .level1 = level1,
                                   .ladder = ladder_for(job, level, level1, count),
                                   .settings = job->gather,
                                   .points = points,
                                   .count = count,
                                   .results = results};
    if (level1->head.record_count > 0) {
        gather.ladder.floor = (float)kl_fill_black(level1->cold->irr, level1->head.record_count,
                                                   sizeof *level1->cold / sizeof(float));
    }
    kl_status st = job->gather_batch(job->gather_context, &gather, err);
    for (size_t i = 0; st == KL_OK && i < count; ++i) {
        stats->gather_rays += (uint64_t)results[i].side * results[i].side;
    }
    return st;
}

/* Gather at the chosen candidates and insert the records. */
static kl_status gather_and_insert(const struct kl_fill_job *job, uint32_t level,
                                   const struct kl_candidate *chosen, size_t n,
                                   struct kl_fill_stats *stats, struct kl_err *err)
{
    const kl_level_view level1 = kl_cache_view(job->cache, 1);
    struct batch b;
    kl_status st = batch_init(&b, n, err);
    double start = kl_seconds();

    if (st != KL_OK) goto cleanup;
    for (size_t i = 0; i < n; ++i) {
        b.points[i] =
            kl_fill_gather_point(job->motion, chosen[i].pos, kl_oct_encode(chosen[i].normal),
                                 kl_oct_encode(chosen[i].geometric), level);
    }
    st = kl_fill_gather(job, &level1, level, b.points, n, b.results, stats, err);
    if (st != KL_OK) goto cleanup;
    stats->gather_seconds += kl_seconds() - start;
    start = kl_seconds();
    for (size_t i = 0; i < n; ++i) {
        kl_record_pack(&b.points[i], &b.results[i], level, chosen[i].spacing, &job->radius,
                       &b.hot[i], &b.cold[i]);
    }
    const uint32_t before = kl_cache_count(job->cache, level);
    st = kl_cache_insert(job->cache, level, b.hot, b.cold, (uint32_t)n, err);
    if (st == KL_OK && job->keep_batch != NULL) {
        st = job->keep_batch(job->keep_context, level, b.hot, b.cold, (uint32_t)n, err);
    }
    stats->added[level] += kl_cache_count(job->cache, level) - before;
    ++stats->batches;
    stats->insert_seconds += kl_seconds() - start;

cleanup:
    batch_fini(&b);
    return st;
}

/* Candidates from points, thinned. */
static kl_status choose(const struct kl_fill_job *job, uint32_t level,
                        const struct kl_point *points, size_t count, size_t limit,
                        struct kl_candidate **chosen, size_t *kept, struct kl_err *err)
{
    struct kl_candidate *c = NULL;
    kl_status st = kl_cache_prepare(job->cache, level, err);
    if (st == KL_OK) st = kl_alloc_array(&c, count, sizeof *c, err);
    if (st != KL_OK) return st;
#pragma omp parallel for schedule(dynamic, 256)
    for (size_t i = 0; i < count; ++i) {
        const struct kl_point *p = &points[i];
        const float pixel = level == 0 ? finest_pixel(job, p->pos, p->pixel) : p->pixel;
        const float pos[3] = {p->pos.x, p->pos.y, p->pos.z};
        const float spacing = job->spacing_px * pixel;
        const float predicted = kl_cache_predict_radius(job->cache, level, pos, unknown_px * pixel);
        c[i] = (struct kl_candidate){
            p->pos, p->smooth, p->geometric, spacing, exclusion * fmaxf(predicted, spacing),
            p->rank};
    }
    st = kl_thin(c, count, alike, limit, kept, err);
    *chosen = c;
    return st;
}

struct stage { /* where a set of points stands in the whole, for progress */
    int number;
    double done, share;
};

/* Records of the next batch at most. The first ones are few: later ones then end in them. */
static size_t batch_limit(const struct kl_fill_job *job, uint32_t level)
{
    const size_t side = job->ladder[level].steps[0]->side;
    const size_t by_rays = BATCH_RAYS / (side * side);
    const bool early = kl_cache_count(job->cache, level) < FIRST_BATCH;
    const size_t most = early && job->batch > FIRST_BATCH ? FIRST_BATCH : job->batch;
    return by_rays < most ? by_rays : most;
}

/* Place records until at most `allowed` of the points are without. Radii of old records shrink as
 * new ones come near: what counts is a look at all points that finds few enough. */
static kl_status fill_points(const struct kl_fill_job *job, uint32_t level, struct kl_point *all,
                             size_t count, size_t allowed, const struct stage *stage,
                             struct kl_fill_stats *stats, struct kl_err *err)
{
    struct kl_point *left = NULL;
    kl_status st = kl_alloc_array(&left, count, sizeof *left, err);
    const double start = kl_seconds();
    size_t n = st == KL_OK ? find_uncovered(job, level, all, count, left) : 0;
    const size_t first = n > 0 ? n : 1;
    double reached = 0.0; /* share of the points served so far: only grows, for those who watch */

    stats->visibility_seconds += kl_seconds() - start;
    for (int pass = 0; st == KL_OK && pass < MAX_PASSES && n > allowed; ++pass) {
        struct kl_candidate *chosen = NULL;
        size_t kept = 0;
        const size_t most = batch_limit(job, level);
        const size_t limit = n - allowed < most ? n - allowed : most; /* every one serves a point */
        const uint32_t before = kl_cache_count(job->cache, level);
        st = choose(job, level, left, n, limit, &chosen, &kept, err);
        if (st == KL_OK) st = gather_and_insert(job, level, chosen, kept, stats, err);
        free(chosen);
        if (st != KL_OK) break;
        /* Points whose own records are there but are not found, as too many lie in one place. */
        const bool in_vain = 8 * (size_t)(kl_cache_count(job->cache, level) - before) < kept;
        n = find_uncovered(job, level, left, n, left);
        if (in_vain) break;
        if (n <= allowed) n = find_uncovered(job, level, all, count, left);
        reached = fmax(reached, 1.0 - (double)n / (double)first);
        if (job->progress != NULL && job->progress(job->progress_context, stage->number,
                                                   stage->done + stage->share * reached,
                                                   kl_cache_count(job->cache, level))) {
            st = kl_fail(err, KL_ERR_INTERRUPTED, "interrupted");
        }
    }
    if (level == 0 && count > 0)
        stats->uncovered = fmax(stats->uncovered, (double)n / (double)count);
    free(left);
    return st;
}

static kl_status fill_world(const struct kl_fill_job *job, struct kl_fill_stats *stats,
                            struct kl_err *err)
{
    static const struct stage stage = {0, 0.0, 1.0};
    struct kl_point *points = NULL;
    size_t count = 0;
    const double start = kl_seconds();
    kl_status st = kl_fill_world_points(job, &points, &count, err);
    if (st != KL_OK) return st;
    stats->visibility_seconds += kl_seconds() - start;
    st = fill_points(job, 1, points, count, (size_t)(0.01 * (double)count), &stage, stats, err);
    free(points);
    return st;
}

/* What the cameras from *next on see, until that is enough for a stage; *next moves on. Where there
 * are many, their frames overlap, and each looks at a quarter of its pixels. */
static kl_status look(const struct kl_fill_job *job, uint32_t *next, struct kl_point **points,
                      size_t *count, struct kl_fill_stats *stats, struct kl_err *err)
{
    const uint32_t every = job->camera_count >= MANY_CAMERAS ? 2 : 1;
    const double start = kl_seconds();
    size_t capacity = 0;
    kl_status st = KL_OK;

    while (st == KL_OK && *next < job->camera_count && *count < STAGE_POINTS) {
        struct kl_point *seen = NULL;
        size_t n = 0;
        st = kl_fill_screen_points(job, *next, every, &seen, &n, err);
        if (st == KL_OK) st = kl_grow_array(points, &capacity, *count + n, sizeof **points, err);
        if (st == KL_OK && n > 0) memcpy(*points + *count, seen, n * sizeof *seen);
        free(seen);
        const struct kl_camera *c = &job->cameras[(*next)++];
        stats->primary_rays += (uint64_t)c->width * c->height / (every * every);
        *count += n;
    }
    stats->visibility_seconds += kl_seconds() - start;
    return st;
}

/* The cameras from *next on that make a stage; *next moves on. */
static kl_status fill_cameras(const struct kl_fill_job *job, uint32_t *next,
                              struct kl_fill_stats *stats, struct kl_err *err)
{
    const uint32_t first = *next;
    struct kl_point *points = NULL;
    size_t count = 0;
    kl_status st = look(job, next, &points, &count, stats, err);
    const struct stage stage = {1, (double)first / job->camera_count,
                                (double)(*next - first) / job->camera_count};
    const size_t allowed = (size_t)((double)job->uncovered * (double)count);
    if (st == KL_OK) st = fill_points(job, 0, points, count, allowed, &stage, stats, err);
    free(points);
    return st;
}

kl_status kl_fill(const struct kl_fill_job *job, struct kl_fill_stats *stats, struct kl_err *err)
{
    kl_status st = fill_world(job, stats, err);

    /* A record placed for one frame can shrink its neighbours in another: go round until a whole
     * round adds nothing. That round is also what a later run will see. */
    for (int round = 0; st == KL_OK && round < MAX_ROUNDS; ++round) {
        const uint32_t before = kl_cache_count(job->cache, 0);
        uint32_t next = 0;
        stats->uncovered = 0.0;
        while (st == KL_OK && next < job->camera_count) {
            st = fill_cameras(job, &next, stats, err);
        }
        if (kl_cache_count(job->cache, 0) == before) break;
    }
    if (st != KL_OK) return st;
    return kl_cache_finish(job->cache, err);
}
