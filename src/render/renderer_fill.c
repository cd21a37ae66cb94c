#include "src/base/clock.h"
#include "src/render/renderer_impl.h"
#include "src/render/turn.h"

#include <math.h>

static const float least_weight = 0.3f;
static const float one_sided = 0.7f; /* radii that a point may be from the records' mean place */
static const float spacing_px = 1.5f;
static const float proved_spacing_px = 0.75f; /* where the error is to be proved: every pixel */
static const float uncovered = 5e-5f; /* of pixels: those left are rims, and the worst (0035) */
enum { BATCH = 4096 };
enum { MEASURED_POINTS = 256, MEASURE_ROUNDS = 8 };
enum { MEASURE_SIDE = KL_LAST_SIDE / 4, VERIFY_SIDE = KL_LAST_SIDE / 2 };
/* Standard errors over the error that was asked for: of references, of those that tell when to end
 * and of the proof's, which are part of what it says; and where the error is to be proved, of
 * records by level. 95 % of what they say lies within twice theirs. */
static const float reference_noise = 0.25f;
static const float proof_noise = 0.125f;
static const float proved_noise[KL_CACHE_LEVELS] = {0.35f, 1.0f};
/* Relative standard deviation of single rays where light is most even. */
static const double evenness = 0.44;
/* Of the error: a few hundred points say it within 15 %. */
static const double measured_share = 0.85;
static const double worth_a_round = 0.97; /* of the error of the round before */

/* A ladder where the error is to be proved. Four blocks of few rays say now and then that they
 * agree by chance: the first step, of `side` or more, has as many rays as the most even light
 * needs. */
static kl_status climb(struct kl_renderer *r, uint32_t side, float noise,
                       struct kl_gather_ladder *out, struct kl_err *err)
{
    const double needed = pow(evenness / ((double)noise * r->settings.error), 2.0);
    const double most = (double)KL_LAST_SIDE * KL_LAST_SIDE;
    const uint32_t least = kl_renderer_side_for((uint32_t)fmin(needed, most));
    return kl_renderer_climb(r, side > least ? side : least, KL_GATHER_STEPS, noise, out, err);
}

/* Bring the cache of an earlier edition up to date, and only then replace what lies on disk. */
static kl_status revise(struct kl_renderer *r, const struct kl_fill_job *job,
                        struct kl_fill_stats *stats, struct kl_err *err)
{
    struct kl_cache *cache = NULL;
    kl_status st = kl_revision_fill(r->revision, job, &cache, stats, err);

    if (st != KL_OK) return st;
    kl_revision_get_summary(r->revision, &r->summary);
    stats->refreshed = r->summary.again;
    kl_cache_destroy(r->cache);
    r->cache = cache;
    if (job->keep_batch != NULL) st = kl_renderer_publish(r, err);
    if (st != KL_OK) return st;
    kl_revision_close(r->revision);
    r->revision = NULL;
    return KL_OK;
}

static struct kl_verify_job verify_job(const struct kl_renderer *r, const struct kl_camera *cameras,
                                       uint32_t camera_count)
{
    return (struct kl_verify_job){
        .scene = kl_renderer_reference(r),
        .motion = kl_renderer_motion(r),
        .cache = kl_cache_view(r->cache, 0),
        .query = kl_renderer_eye_query(),
        .cameras = cameras,
        .camera_count = camera_count,
        .gather = {.query = kl_renderer_gather_query(), .length_scale = KL_LENGTH_SCALE},
        .gather_batch = kl_gatherer_run,
        .gather_context = r->gatherer,
    };
}

/* How well the frozen cache serves `cameras`: a few hundred points, with rays enough for the error
 * that was asked for. */
static kl_status measure(struct kl_renderer *r, const struct kl_renderer_fill *fill,
                         struct kl_fill_stats *stats, struct kl_err *err)
{
    struct kl_verify_stats found;
    const kl_level_view level1 = kl_cache_view(r->cache, 1);
    const double start = kl_seconds();
    struct kl_verify_job job = verify_job(r, fill->cameras, fill->camera_count);
    job.level1 = &level1;
    job.share = 1.0;
    job.at_most = MEASURED_POINTS;
    kl_status st = climb(r, MEASURE_SIDE, reference_noise, &job.ladder, err);
    if (st == KL_OK) st = kl_verify(&job, NULL, &found, err);
    if (st != KL_OK) return st;
    stats->gather_rays += found.rays;
    stats->gather_seconds += kl_seconds() - start;
    stats->measured = kl_verify_error(&found);
    return KL_OK;
}

static uint32_t added(const struct kl_fill_stats *stats)
{
    return stats->added[0] + stats->added[1];
}

/* Fill; then, as long as the measured error is above what was asked for and falls, make radii
 * smaller and fill the gaps. The error goes with the square of the radii. */
static kl_status fill_until_met(struct kl_renderer *r, const struct kl_renderer_fill *fill,
                                const struct kl_fill_job *job, struct kl_fill_stats *stats,
                                struct kl_err *err)
{
    for (int round = 0;; ++round) {
        const uint32_t before = added(stats);
        const double measured = stats->measured;
        kl_status st = kl_fill(job, stats, err);
        if (st != KL_OK || !fill->measure || added(stats) == before) return st;
        st = measure(r, fill, stats, err);
        const double over = stats->measured / (measured_share * r->settings.error);
        const bool in_vain = round > 0 && stats->measured > worth_a_round * measured;
        if (st != KL_OK || over <= 1.0 || in_vain || round == MEASURE_ROUNDS) return st;
        r->accuracy[0] *= (float)fmin(0.9, fmax(0.6, sqrt(0.9 / over)));
        st = kl_cache_set_accuracy(r->cache, 0, r->accuracy[0], err);
        if (st != KL_OK) return st;
    }
}

/* What is gathered from now on is noted in the ledger. At first an empty cache takes over the
 * records of the instant before; to what came from disk the ledger knows nothing. */
static kl_status open_ledger(struct kl_renderer *r, struct kl_fill_job *job,
                             struct kl_fill_stats *stats, struct kl_err *err)
{
    if (r->ledger == NULL) return KL_OK;
    job->gather_batch = kl_ledger_gather;
    job->gather_context = r->ledger;
    kl_ledger_use(r->ledger, r->gatherer);
    if (r->stand == NULL) return KL_OK;
    if (kl_cache_count(r->cache, 0) + kl_cache_count(r->cache, 1) == 0) {
        return kl_ledger_carry(r->ledger, job, r->stand, r->earlier, stats, err);
    }
    kl_ledger_clear(r->ledger);
    return KL_OK;
}

static kl_status close_ledger(struct kl_renderer *r, struct kl_err *err)
{
    struct kl_stand *stand = r->stand;

    if (r->ledger == NULL) return KL_OK;
    r->stand = NULL;
    return kl_ledger_close(r->ledger, r->cache, kl_renderer_reference(r), stand, r->reference, err);
}

static kl_status fill_cache(struct kl_renderer *r, const struct kl_renderer_fill *fill,
                            struct kl_turn *turn, struct kl_fill_stats *stats, struct kl_err *err)
{
    const bool keep = fill->keep && r->store != NULL;
    struct kl_fill_job job = {
        .scene = kl_renderer_reference(r),
        .motion = kl_renderer_motion(r),
        .scene_radius = r->flat->radius,
        .radius = {r->settings.radius, 0.0f, r->flat->radius},
        .cameras = fill->cameras,
        .camera_count = fill->camera_count,
        .ladder = {r->ladder[0], r->ladder[1]},
        .gather = {.query = kl_renderer_gather_query(),
                   .length_scale = KL_LENGTH_SCALE,
                   .touch = kl_renderer_touch_share(r)},
        .served = {{kl_renderer_eye_query(), least_weight, one_sided},
                   {{1.0f, KL_COS_MAX, KL_INF}, least_weight, KL_INF}},
        .spacing_px = fill->measure ? proved_spacing_px : spacing_px,
        .uncovered = uncovered,
        .batch = BATCH,
        .gather_batch = kl_gatherer_run,
        .gather_context = r->gatherer,
        .keep_batch = keep ? kl_renderer_keep_batch : NULL,
        .keep_context = r,
        .progress = kl_turn_note,
        .progress_context = turn,
    };
    kl_status st = KL_OK;
    for (int i = 0; st == KL_OK && fill->measure && i < KL_CACHE_LEVELS; ++i) {
        st = climb(r, r->ladder[i].steps[0]->side, proved_noise[i], &job.ladder[i], err);
    }
    if (st == KL_OK && r->revision != NULL) st = revise(r, &job, stats, err);
    job.cache = r->cache;
    if (st == KL_OK) st = open_ledger(r, &job, stats, err);
    if (st == KL_OK) st = fill_until_met(r, fill, &job, stats, err);
    if (st == KL_OK) st = close_ledger(r, err);
    if (st != KL_OK) return st;
    const double start = kl_seconds();
    const bool grown = added(stats) + stats->refreshed > 0;
    if (keep && r->lost[0] == '\0' && (grown || !kl_renderer_is_compact(r->store)))
        st = kl_renderer_publish(r, err);
    stats->insert_seconds += kl_seconds() - start;
    return st;
}

kl_status kl_renderer_fill(struct kl_renderer *renderer, const struct kl_renderer_fill *fill,
                           struct kl_fill_stats *stats, struct kl_err *err)
{
    struct kl_renderer *r = renderer;
    struct kl_turn turn = {.progress = fill->progress, .progress_context = fill->progress_context};
    kl_status st = KL_OK;

    *stats = (struct kl_fill_stats){0};
    kl_renderer_tell_use(r); /* records get other numbers */
    r->must_keep = fill->must_keep;
    if (fill->keep && r->store != NULL) {
        st = kl_turn_begin(&turn, r->store, fill->cameras, fill->camera_count, err);
        if (st == KL_OK && r->revision == NULL) st = kl_renderer_refresh(r, err);
    }
    if (st == KL_OK) st = fill_cache(r, fill, &turn, stats, err);
    kl_turn_end(&turn);
    return st;
}

kl_status kl_renderer_verify(struct kl_renderer *renderer, const struct kl_camera *camera,
                             double share, struct kl_verify_errors *all,
                             struct kl_verify_stats *stats, struct kl_err *err)
{
    struct kl_verify_job job = verify_job(renderer, camera, 1);
    job.share = share;
    kl_status st = climb(renderer, VERIFY_SIDE, proof_noise, &job.ladder, err);
    return st == KL_OK ? kl_verify(&job, all, stats, err) : st;
}
