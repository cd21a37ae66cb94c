/* Gathering again what depends on an edit: docs/decisions/0010-dependence.md. */
#include "src/base/clock.h"
#include "src/base/memory.h"
#include "src/cache/record.h"
#include "src/render/fill_points.h"
#include "src/render/revision_impl.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_ROUNDS = 8, BATCH = 4096, FIRST_BATCH = 512 };

/* Records of one level that are gathered again, in batches. */
struct again {
    struct kl_revision *revision;
    const struct kl_fill_job *job;
    uint32_t level, count;
    uint32_t *numbers; /* of the records */
    struct kl_fill_stats *stats;
};

/* Gather `count` records anew and put the values where the old ones are. */
static kl_status gather_some(const struct again *a, const uint32_t *numbers, uint32_t count,
                             const struct kl_cache *ends, struct kl_err *err)
{
    const struct kl_fill_job *job = a->job;
    struct kl_revision_level *level = &a->revision->levels[a->level];
    const kl_level_view level1 = kl_cache_view(ends, 1);
    kl_gather_point *points = NULL;
    kl_gather_result *results = NULL;
    uint32_t *used = NULL;
    uint32_t n = 0;
    kl_status st = kl_alloc_array(&points, count, sizeof *points, err);

    if (st == KL_OK) st = kl_alloc_array(&results, count, sizeof *results, err);
    if (st == KL_OK) st = kl_alloc_array(&used, count, sizeof *used, err);
    for (uint32_t i = 0; st == KL_OK && i < count; ++i) {
        kl_hit hit;
        kl_surface surface;
        if (!kl_fill_find_surface(job->scene, &level->hot[numbers[i]], &hit, &surface)) {
            level->fate[numbers[i]] = KL_FATE_DROP;
            continue;
        }
        points[n] = kl_fill_gather_point(job->motion, kl_v3_load(level->hot[numbers[i]].pos),
                                         level->hot[numbers[i]].normal,
                                         kl_oct_encode(surface.geometric), a->level);
        used[n++] = numbers[i];
    }
    if (st == KL_OK && n > 0) {
        st = kl_fill_gather(job, &level1, a->level, points, n, results, a->stats, err);
    }
    for (uint32_t i = 0; st == KL_OK && i < n; ++i) {
        kl_record_hot *hot = &level->hot[used[i]];
        kl_record_cold *cold = &level->cold[used[i]];
        const float spacing = kl_half_to_float(cold->error_spacing >> 16) * cold->raw_radius;
        kl_record_pack(&points[i], &results[i], a->level, spacing, &job->radius, hot, cold);
    }
    free(points);
    free(results);
    free(used);
    return st;
}

static kl_status list_again(const struct kl_revision *r, uint32_t level, const uint8_t *flags,
                            struct again *out, struct kl_err *err)
{
    const struct kl_revision_level *l = &r->levels[level];
    kl_status st = kl_alloc_array(&out->numbers, l->count, sizeof *out->numbers, err);

    out->level = level;
    out->count = 0;
    for (uint32_t i = 0; st == KL_OK && i < l->count; ++i) {
        const bool wanted = flags != NULL ? flags[i] : l->fate[i] == KL_FATE_AGAIN;
        if (wanted && l->fate[i] != KL_FATE_DROP) out->numbers[out->count++] = i;
    }
    return st;
}

static bool is_stopped(const struct again *a, uint32_t done)
{
    const struct kl_fill_job *job = a->job;
    const double share = a->count > 0 ? (double)done / (double)a->count : 1.0;
    return job->progress != NULL &&
           job->progress(job->progress_context, a->level == 1 ? 0 : 1, share, a->count);
}

/* All of the list, with rays that end in `ends`. */
static kl_status gather_all(const struct again *a, const struct kl_cache *ends, struct kl_err *err)
{
    kl_status st = KL_OK;

    for (uint32_t i = 0; st == KL_OK && i < a->count; i += BATCH) {
        const uint32_t n = a->count - i < BATCH ? a->count - i : BATCH;
        st = gather_some(a, a->numbers + i, n, ends, err);
        if (st == KL_OK && is_stopped(a, i + n)) {
            st = kl_fail(err, KL_ERR_INTERRUPTED, "interrupted");
        }
    }
    return st;
}

/* Put records that were just gathered into a cache. */
static kl_status insert_some(const struct again *a, const uint32_t *numbers, uint32_t count,
                             struct kl_cache *cache, struct kl_err *err)
{
    const struct kl_revision_level *level = &a->revision->levels[a->level];
    kl_record_hot *hot = NULL;
    kl_record_cold *cold = NULL;
    uint32_t n = 0;
    kl_status st = kl_alloc_array(&hot, count, sizeof *hot, err);

    if (st == KL_OK) st = kl_alloc_array(&cold, count, sizeof *cold, err);
    for (uint32_t i = 0; st == KL_OK && i < count; ++i) {
        if (level->fate[numbers[i]] == KL_FATE_DROP) continue;
        hot[n] = level->hot[numbers[i]];
        cold[n++] = level->cold[numbers[i]];
    }
    if (st == KL_OK && n > 0) st = kl_cache_insert(cache, a->level, hot, cold, n, err);
    free(hot);
    free(cold);
    return st;
}

/* Level 1 from nothing, as where no cache was: later batches end in the earlier ones. */
static kl_status gather_level1_anew(struct again *a, struct kl_cache **out, struct kl_err *err)
{
    kl_status st = kl_cache_create(&a->revision->settings, out, err);
    uint32_t n = 0;

    for (uint32_t i = 0; st == KL_OK && i < a->count; i += n) {
        const uint32_t most = i == 0 ? FIRST_BATCH : BATCH;
        n = a->count - i < most ? a->count - i : most;
        st = gather_some(a, a->numbers + i, n, *out, err);
        if (st == KL_OK) st = insert_some(a, a->numbers + i, n, *out, err);
        if (st == KL_OK && is_stopped(a, i + n)) {
            st = kl_fail(err, KL_ERR_INTERRUPTED, "interrupted");
        }
    }
    return st;
}

/* flags[i] = 1 where the light of record i changes with level 1 from `before` to `after`. Returns
 * how many. */
static uint32_t find_changed(const struct kl_revision *r, uint32_t level,
                             const struct kl_cache *before, const struct kl_cache *after,
                             uint8_t *flags)
{
    const struct kl_revision_level *l = &r->levels[level];
    const kl_level_view was = kl_cache_view(before, 1);
    const kl_level_view is = kl_cache_view(after, 1);
    uint32_t found = 0;

#pragma omp parallel for schedule(dynamic, 64) reduction(+ : found)
    for (uint32_t i = 0; i < l->count; ++i) {
        flags[i] = l->fate[i] != KL_FATE_DROP &&
                   kl_revision_is_changed(r, &was, &is, &l->hot[i], &l->cold[i]);
        found += flags[i];
    }
    return found;
}

/* Values of level 1, round by round: what depends on the edit itself, then what depends on records
 * that changed in the round before. *now: level 1 in its new state. */
static kl_status settle_level1(struct kl_revision *r, struct again *a, struct kl_cache **now,
                               struct kl_err *err)
{
    struct kl_revision_level *level = &r->levels[1];
    struct kl_cache *next = NULL;
    uint8_t *flags = NULL;
    kl_status st = kl_alloc_array(&flags, level->count, 1, err);

    if (st == KL_OK) st = kl_revision_build(r, KL_FATE_AGAIN, now, err);
    if (st == KL_OK) st = list_again(r, 1, NULL, a, err);
    for (int round = 0; st == KL_OK && a->count > 0 && round < MOST_ROUNDS; ++round) {
        st = gather_all(a, *now, err);
        if (st == KL_OK) st = kl_revision_build(r, KL_FATE_AGAIN, &next, err);
        if (st != KL_OK) break;
        (void)find_changed(r, 1, *now, next, flags);
        kl_cache_destroy(*now);
        *now = next;
        for (uint32_t i = 0; i < level->count; ++i) {
            if (flags[i]) level->fate[i] = KL_FATE_AGAIN;
        }
        free(a->numbers);
        a->numbers = NULL;
        st = list_again(r, 1, flags, a, err);
    }
    free(flags);
    return st;
}

/* What is seen: judged by how level 1 has changed as a whole. */
static kl_status settle_level0(struct kl_revision *r, struct again *a, const struct kl_cache *now,
                               struct kl_err *err)
{
    struct kl_revision_level *level = &r->levels[0];
    uint8_t *flags = NULL;
    kl_status st = kl_alloc_array(&flags, level->count, 1, err);

    if (st == KL_OK && !r->all) {
        (void)find_changed(r, 0, r->before, now, flags);
        for (uint32_t i = 0; i < level->count; ++i) {
            if (!flags[i] || level->fate[i] != KL_FATE_KEEP) continue;
            level->fate[i] = r->in_place ? KL_FATE_AGAIN : KL_FATE_DROP;
        }
    }
    if (st == KL_OK) st = list_again(r, 0, NULL, a, err);
    if (st == KL_OK) st = gather_all(a, now, err);
    free(flags);
    return st;
}

/* Does so much of level 1 depend on the edit that rounds would take longer than to start again? */
static bool is_mostly_stale(const struct kl_revision *r)
{
    const struct kl_revision_level *l = &r->levels[1];
    uint32_t stale = 0;

    for (uint32_t i = 0; i < l->count; ++i) {
        stale += l->fate[i] != KL_FATE_KEEP;
    }
    return r->all || (double)stale > 0.75 * (double)l->count;
}

/* Every record of level 1 whose surface is still there is to be gathered. */
static void mark_level1(struct kl_revision *r)
{
    struct kl_revision_level *l = &r->levels[1];

    for (uint32_t i = 0; i < l->count; ++i) {
        if (l->fate[i] == KL_FATE_KEEP) l->fate[i] = KL_FATE_AGAIN;
    }
}

kl_status kl_revision_fill(struct kl_revision *revision, const struct kl_fill_job *job,
                           struct kl_cache **out, struct kl_fill_stats *stats, struct kl_err *err)
{
    struct kl_revision *r = revision;
    struct again world = {.revision = r, .job = job, .stats = stats};
    struct again seen = world;
    struct kl_cache *now = NULL;
    const double start = kl_seconds();
    kl_status st = KL_OK;

    if (is_mostly_stale(r)) {
        mark_level1(r);
        st = list_again(r, 1, NULL, &world, err);
        if (st == KL_OK) st = gather_level1_anew(&world, &now, err);
    } else {
        st = settle_level1(r, &world, &now, err);
    }
    if (st == KL_OK) st = settle_level0(r, &seen, now, err);
    if (st == KL_OK) st = kl_revision_build(r, KL_FATE_AGAIN, out, err);
    stats->gather_seconds += kl_seconds() - start;
    kl_cache_destroy(now);
    free(world.numbers);
    free(seen.numbers);
    return st;
}
