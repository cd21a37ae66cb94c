/* Which rays of a record are shot again, and what its light is then: docs/decisions/0018-ledger.md.
 */
#include "src/cache/record.h"
#include "src/render/ledger_impl.h"

#include <math.h>
#include <string.h>

static const float near_steps = 4.0f; /* of a record: what is nearer is seen from another side */
static const float slight = 0.02f;    /* change of the light that leaves the derivatives alone */
static const float clear = 1e-3f;     /* of the scene's radius */

/* Of how many of a kind one is shot again in a turn; of those that may be slow, where the record's
 * light changed little the last time. */
static const uint32_t one_of[KL_RAY_KINDS] = {0, 10, 4, 3, 2, 2, 1};
enum { ONE_OF_SLOW = 4 };
static const float notes = 0.01f; /* change of light elsewhere, of its own, that a record notes */

/* Rays of a kind that are shot in turn. */
struct stratum {
    double change[3], turns; /* of those that were shot: of radiance, and over how many turns */
    double others[3], waits; /* of those that were not: radiance, and for how many turns */
};
enum { FEW = 8 }; /* turns of rays that say nothing about others */

static bool is_in(const kl_u32 set[2], kl_u32 bit)
{
    return bit < 64u && (set[bit >> 5] >> (bit & 31u) & 1u) != 0u;
}

/* Is the light that the surface at `at` asked for seen now? Both ends are kept off the surfaces by
 * more than what the ledger's directions are rounded by. `from`: the way to the surface. */
static bool is_lit(const kl_scene_view *scene, kl_ray to_light, kl_vec3 from)
{
    const float off = clear * scene->scene_radius;
    to_light.origin = kl_v3_mad(to_light.origin, -off, from);
    to_light.tmax -= 2.0f * off;
    return to_light.tmax <= 0.0f || kl_transmittance(scene, &to_light) > 0.0f;
}

/* What moved may have come into the way of light, or have left it. */
static bool is_light_changed(const struct kl_ledger_refresh *r, const kl_gather_cell *c, kl_vec3 at,
                             const kl_ray *from)
{
    const struct kl_moved *m = r->moved;
    const bool lit = (c->touch >> 16 & 255u) != 0u;
    kl_ray to_light = kl_ray_make(at, kl_oct_decode(c->toward), c->light);

    if (!(c->light > 0.0f)) return false;
    to_light.time = from->time;
    return kl_moved_meets(lit ? m->is : m->was, m->count, KL_NONE, &to_light) &&
           is_lit(r->job->motion, to_light, from->dir) != lit;
}

/* Has light around what a ray hits changed by as much as its record would notice? */
static bool is_noted(const struct kl_ledger_refresh *r, const struct kl_ledger_entry *e, kl_vec3 at)
{
    const float change = kl_ledger_stir_at(r->stir, at);
    return change > 0.0f && change >= notes * kl_luminance(kl_v3_load(e->cold.irr));
}

/* `except`: the object that the record rides on, which stands in its own way as before. */
static enum kl_ledger_kind judge(const struct kl_ledger_refresh *r, const struct kl_ledger_entry *e,
                                 const kl_gather_cell *c, const kl_ray *ray, uint32_t except)
{
    const struct kl_moved *m = r->moved;
    const enum kl_ledger_kind still =
        is_in(r->stir->objects, c->touch & 255u) ? KL_RAY_DIMS : KL_RAY_STILL;
    const enum kl_ledger_kind otherwise = except != KL_NONE ? KL_RAY_RIDES : still;
    const float t = fabsf(c->distance);
    kl_ray way = *ray;

    if (c->touch == KL_NONE) return otherwise; /* below its own triangle */
    const bool saw = is_in(m->touched, c->touch & 255u);
    if (!saw) way.tmax = t;
    const bool meets = kl_moved_meets(m->is, m->count, except, &way);
    if (saw != meets) return KL_RAY_TOUCHED;
    if (saw || is_in(m->touched, c->touch >> 24)) return KL_RAY_SEES;
    if (!(t < KL_INF)) return otherwise;
    const kl_vec3 at = kl_v3_mad(ray->origin, t, ray->dir);
    if (is_light_changed(r, c, at, ray)) return KL_RAY_TOUCHED;
    return otherwise <= KL_RAY_DIMS && is_noted(r, e, at) ? KL_RAY_FADES : otherwise;
}

static uint32_t period_of(const struct kl_ledger_entry *e, enum kl_ledger_kind kind)
{
    const bool slow = (kind == KL_RAY_SEES || kind == KL_RAY_RIDES) && !e->hasty;
    return slow ? ONE_OF_SLOW : one_of[kind];
}

static bool is_due(const struct kl_ledger_entry *e, enum kl_ledger_kind kind, uint32_t turn)
{
    const uint32_t period = period_of(e, kind);
    return period > 0 && turn % period == 0;
}

/* Does light that a ray of this kind brings change steadily? */
static bool is_steady(enum kl_ledger_kind kind)
{
    return kind == KL_RAY_LAGS || kind == KL_RAY_FADES || kind == KL_RAY_SEES ||
           kind == KL_RAY_RIDES;
}

void kl_ledger_judge_entry(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entry,
                           const kl_direction *directions)
{
    const struct kl_ledger_refresh *r = refresh;
    struct kl_ledger_entry *e = entry;
    const bool rides = r->moved->objects[e->object].moved;

    e->due = 0;
    for (uint32_t i = 0; i < e->side * e->side; ++i) {
        const kl_gather_cell *c = &e->cells[i];
        const kl_direction *d = &directions[i];
        const kl_stance from = kl_gather_stance(r->job->motion, &e->point, d);
        const kl_ray ray = kl_gather_leave(r->job->motion, &e->point, d, &from);
        enum kl_ledger_kind kind = judge(r, e, c, &ray, rides ? e->object : KL_NONE);
        if (fabsf(c->distance) <= near_steps * e->step) kind = KL_RAY_TOUCHED;
        if (kind <= KL_RAY_DIMS && e->waits[i] > 0) kind = KL_RAY_LAGS;
        if (is_steady(kind) && e->waits[i] < UINT8_MAX) ++e->waits[i];
        e->kinds[i] = (uint8_t)kind;
        if (is_due(e, kind, kl_hash2(d->index, e->point.seed) + r->turn)) {
            e->kinds[i] |= KL_RAY_DUE;
            ++e->due;
        }
    }
}

/* What rays brought, in their order: into the ledger, and into what is known of their kinds. */
static void take(struct kl_ledger_entry *e, const kl_gather_cell *brought, struct stratum *strata)
{
    for (uint32_t i = 0; i < e->side * e->side; ++i) {
        struct stratum *s = &strata[e->kinds[i] & ~KL_RAY_DUE];
        if ((e->kinds[i] & KL_RAY_DUE) == 0) {
            s->waits += e->waits[i];
            for (int k = 0; k < 3; ++k) {
                s->others[k] += (double)e->cells[i].radiance[k];
            }
            continue;
        }
        for (int k = 0; k < 3; ++k) {
            s->change[k] += (double)brought->radiance[k] - (double)e->cells[i].radiance[k];
        }
        s->turns += e->waits[i];
        e->cells[i] = *brought++;
        e->waits[i] = 0;
        e->kinds[i] = KL_RAY_TOUCHED;
    }
    e->shot = e->due;
    e->due = 0;
}

/* What rays of a kind that wait have changed by since they were shot, judged by those that had
 * their turn lately: a factor that adds the mean change. It is told from what rays brought, never
 * from what was estimated before: else errors would be handed from one half of the rays to the
 * other for ever. Where few rays change, and by much, they just wait. */
static void drift_of(struct kl_ledger_entry *e, enum kl_ledger_kind kind, const struct stratum *s,
                     float factor[3])
{
    struct kl_ledger_rate *rate = &e->rates[kind];
    const float keep = 1.0f - 1.0f / (float)period_of(e, kind);

    rate->turns = keep * rate->turns + (float)s->turns;
    for (int k = 0; k < 3; ++k) {
        rate->change[k] = keep * rate->change[k] + (float)s->change[k];
        factor[k] = 1.0f;
        if (rate->turns < (float)FEW || !(s->others[k] > 0.0)) continue;
        const double drift = (double)(rate->change[k] / rate->turns) * s->waits / s->others[k];
        factor[k] = (float)fmin(2.0, fmax(0.5, 1.0 + drift));
    }
}

/* The rays as they are now, by all that is known. */
static void drift(struct kl_ledger_entry *e, const struct stratum *strata, kl_gather_cell *cells)
{
    float factor[KL_RAY_KINDS][3];

    for (int kind = 0; kind < KL_RAY_KINDS; ++kind) {
        factor[kind][0] = factor[kind][1] = factor[kind][2] = 1.0f;
        if (is_steady((enum kl_ledger_kind)kind)) {
            drift_of(e, (enum kl_ledger_kind)kind, &strata[kind], factor[kind]);
        }
    }
    for (uint32_t i = 0; i < e->side * e->side; ++i) {
        const float *f = factor[e->kinds[i]];
        cells[i] = e->cells[i];
        for (int k = 0; k < 3; ++k) {
            cells[i].radiance[k] *= f[k];
        }
        cells[i].potential *= kl_luminance(kl_v3_load(f));
    }
}

static double sum_up(const kl_gather_cell *cells, uint32_t n, float irr[3])
{
    double sum[3] = {0.0, 0.0, 0.0};

    for (uint32_t i = 0; i < n; ++i) {
        for (int k = 0; k < 3; ++k) {
            sum[k] += (double)cells[i].radiance[k];
        }
    }
    for (int k = 0; k < 3; ++k) {
        irr[k] = (float)(sum[k] * (double)KL_PI / n);
    }
    return (double)kl_luminance(kl_v3_load(irr));
}

/* The record from its rays: only its light where that has changed little. */
static void reduce(const struct kl_ledger_refresh *r, struct kl_ledger_entry *e,
                   const struct kl_gather_tables *tables, struct kl_ledger_scratch *scratch)
{
    const float spacing = kl_half_to_float(e->cold.error_spacing >> 16) * e->cold.raw_radius;
    const kl_grid_view grid = kl_gather_tables_grid(tables);
    kl_gather_result result;

    kl_reduce_touched(scratch->cells, e->side * e->side, r->job->gather.touch, &result);
    if (e->change < slight && e->step < KL_INF) {
        memcpy(e->cold.touched, result.touched, sizeof e->cold.touched);
        return;
    }
    kl_reduce_record(scratch->cells, kl_gather_directions(tables, e->point.seed), &grid, &e->point,
                     scratch->reduced, &result);
    kl_record_pack(&e->point, &result, e->level, spacing, &r->job->radius, &e->hot, &e->cold);
}

void kl_ledger_refresh_entry(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entry,
                             const struct kl_gather_tables *tables, const kl_gather_cell *brought,
                             struct kl_ledger_scratch *scratch)
{
    const double before = (double)kl_luminance(kl_v3_load(entry->cold.irr));
    struct stratum strata[KL_RAY_KINDS];

    memset(strata, 0, sizeof strata);
    take(entry, brought, strata);
    drift(entry, strata, scratch->cells);
    const double after = sum_up(scratch->cells, entry->side * entry->side, entry->cold.irr);
    entry->added = (float)(after - before);
    if (after != before) entry->change = before > 0.0 ? (float)fabs(after / before - 1.0) : 1.0f;
    reduce(refresh, entry, tables, scratch);
}
