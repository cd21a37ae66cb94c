/* Which rays of a record are shot again, and what its light is then: docs/decisions/0018-ledger.md.
 */
#include "src/cache/record.h"
#include "src/render/ledger_impl.h"

#include <math.h>
#include <string.h>

static const float near_steps = 4.0f; /* of a record: what is nearer is seen from another side */
static const float turned = 0.9394f;  /* cosine, 20 degrees: normals beyond do not share records */
static const float slight = 0.02f;    /* change of the light that leaves the derivatives alone */
static const float clear = 1e-3f;     /* of the scene's radius */

/* What may have become of a ray: nothing; what it hits is lit otherwise; what it hits has moved,
 * and it still hits it; it has another origin; all. Of how many of a kind one is shot again in a
 * turn. */
enum kind { STILL, DIMS, SEES, RIDES, TOUCHED, KINDS };
static const uint32_t one_of[KINDS] = {0, 10, 2, 2, 1};

/* Rays of a kind: those that were shot again say by how much the others are wrong on average. */
struct stratum {
    double was, is; /* sums of luminance of those that were shot, before and now */
    double others;  /* of those that were not */
    uint32_t shot, kept;
};
enum { FEW = 8 }; /* rays that say nothing about others */

/* Entries were gathered by the same ladders: one of them has the side. */
static const struct kl_gather_tables *find_tables(const struct kl_fill_job *job, uint32_t side)
{
    const struct kl_gather_tables *found = job->ladder[0].steps[0];
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        for (uint32_t i = 0; i < job->ladder[l].count; ++i) {
            if (job->ladder[l].steps[i]->side == side) found = job->ladder[l].steps[i];
        }
    }
    return found;
}

static bool is_in(const kl_u32 set[2], kl_u32 bit)
{
    return bit < 64u && (set[bit >> 5] >> (bit & 31u) & 1u) != 0u;
}

/* Is the light that the surface at `at` asked for seen now? Both ends are kept off the surfaces by
 * more than what the ledger's directions are rounded by. `from`: the way to the surface. */
static bool is_lit(const kl_scene_view *scene, const kl_gather_cell *c, kl_vec3 at, kl_vec3 from)
{
    const float off = clear * scene->scene_radius;
    const float length = c->light - 2.0f * off;
    const kl_vec3 toward = kl_oct_decode(c->toward);
    const kl_ray ray = kl_ray_make(kl_v3_mad(at, -off, from), toward, length);
    return length <= 0.0f || kl_transmittance(scene, &ray) > 0.0f;
}

/* What moved may have come into the way of light, or have left it. */
static bool is_light_changed(const struct kl_ledger_refresh *r, const kl_gather_cell *c, kl_vec3 at,
                             kl_vec3 from)
{
    const struct kl_moved *m = r->moved;
    const kl_vec3 toward = kl_oct_decode(c->toward);
    const bool lit = (c->touch >> 16 & 255u) != 0u;

    if (!(c->light > 0.0f)) return false;
    return kl_moved_meets(lit ? m->is : m->was, m->count, KL_NONE, at, toward, c->light) &&
           is_lit(r->job->scene, c, at, from) != lit;
}

/* `except`: the object that the record rides on, which stands in its own way as before. */
static enum kind judge(const struct kl_ledger_refresh *r, const struct kl_ledger_entry *e,
                       const kl_gather_cell *c, kl_vec3 dir, uint32_t except)
{
    const struct kl_moved *m = r->moved;
    const enum kind still = is_in(r->stirred, c->touch & 255u) ? DIMS : STILL;
    const enum kind otherwise = except != KL_NONE ? RIDES : still;
    const kl_vec3 pos = kl_v3_load(e->point.pos);
    const float t = fabsf(c->distance);

    if (c->touch == KL_NONE) return otherwise; /* below its own triangle */
    const bool saw = is_in(m->touched, c->touch & 255u);
    const bool meets = kl_moved_meets(m->is, m->count, except, pos, dir, saw ? KL_INF : t);
    if (saw != meets) return TOUCHED;
    if (saw || is_in(m->touched, c->touch >> 24)) return SEES;
    if (t < KL_INF && is_light_changed(r, c, kl_v3_mad(pos, t, dir), dir)) return TOUCHED;
    return otherwise;
}

static kl_u32 turn_normal(const float m[9], kl_u32 normal)
{
    const kl_vec3 n = kl_oct_decode(normal);
    return kl_oct_encode(kl_normalize(kl_v3(m[0] * n.x + m[1] * n.y + m[2] * n.z,
                                            m[3] * n.x + m[4] * n.y + m[5] * n.z,
                                            m[6] * n.x + m[7] * n.y + m[8] * n.z)));
}

void kl_ledger_move_entry(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entry)
{
    struct kl_ledger_entry *e = entry;
    const struct kl_moved *m = refresh->moved;
    const struct kl_moved_object *object = &m->objects[e->object];
    const kl_vec3 was = kl_v3_load(e->point.pos);
    const kl_vec3 normal = kl_oct_decode(e->point.normal);
    kl_vec3 pos = was;

    e->step = 0.0f;
    e->shot = 0;
    e->change = 0.0f;
    if (object->moved && !object->deformed) {
        pos = kl_affine_point(object->now_from_before, was);
        e->point.pos[0] = pos.x;
        e->point.pos[1] = pos.y;
        e->point.pos[2] = pos.z;
        e->point.normal = turn_normal(object->normals, e->point.normal);
        e->point.geometric = turn_normal(object->normals, e->point.geometric);
        memcpy(e->hot.pos, e->point.pos, sizeof e->hot.pos);
        e->hot.normal = e->point.normal;
        e->step = kl_length(kl_v3_sub(pos, was));
        if (kl_dot(normal, kl_oct_decode(e->point.normal)) < turned) e->step = KL_INF;
    }
    e->dropped =
        object->deformed ||
        kl_moved_meets(m->is, m->count, object->moved ? e->object : KL_NONE, pos, normal, 0.0f);
}

static bool is_due(enum kind kind, uint32_t turn)
{
    return one_of[kind] > 0 && turn % one_of[kind] == 0;
}

/* Shoot what has to be; kinds[i] becomes TOUCHED where that was done. */
static void shoot(const struct kl_ledger_refresh *r, struct kl_ledger_entry *e,
                  const struct kl_gather_tables *tables, uint8_t *kinds, struct stratum *strata)
{
    const kl_direction *directions = kl_gather_directions(tables, e->point.seed);
    const bool rides = r->moved->objects[e->object].moved;
    kl_gather_settings set = r->job->gather;

    set.side = e->side;
    set.sets = tables->sets;
    for (uint32_t i = 0; i < e->side * e->side; ++i) {
        kl_gather_cell *c = &e->cells[i];
        const kl_direction *d = &directions[i];
        const kl_vec3 dir = kl_gather_toward(&e->point, d);
        enum kind kind = judge(r, e, c, dir, rides ? e->object : KL_NONE);
        if (fabsf(c->distance) <= near_steps * e->step) kind = TOUCHED;
        struct stratum *s = &strata[kind];
        const double was = (double)kl_cell_luminance(c);
        kinds[i] = (uint8_t)kind;
        if (!is_due(kind, kl_hash2(d->index, e->point.seed) + r->turn)) {
            s->others += was;
            ++s->kept;
            continue;
        }
        *c = kl_gather_direction(r->job->scene, &r->level1, &set, &e->point, d);
        s->was += was;
        s->is += (double)kl_cell_luminance(c);
        ++s->shot;
        ++e->shot;
        kinds[i] = TOUCHED;
    }
}

/* What rays that were not shot again have changed by, judged by those of their kind that were: a
 * factor that adds the mean difference. Where only light may have changed few rays change, and by
 * much: they wait for their turn. */
static float drift_of(enum kind kind, const struct stratum *s)
{
    if (kind < SEES || kind == TOUCHED || s->shot < FEW || !(s->others > 0.0)) return 1.0f;
    const double drift = (s->is - s->was) * s->kept / (s->shot * s->others);
    return (float)fmin(2.0, fmax(0.5, 1.0 + drift));
}

static double sum_up(const struct kl_ledger_entry *e, float irr[3])
{
    const uint32_t n = e->side * e->side;
    double sum[3] = {0.0, 0.0, 0.0};

    for (uint32_t i = 0; i < n; ++i) {
        for (int k = 0; k < 3; ++k) {
            sum[k] += (double)e->cells[i].radiance[k];
        }
    }
    for (int k = 0; k < 3; ++k) {
        irr[k] = (float)(sum[k] * (double)KL_PI / n);
    }
    return (double)kl_luminance(kl_v3_load(irr));
}

static void drift(struct kl_ledger_entry *e, const uint8_t *kinds, const struct stratum *strata)
{
    float factor[KINDS];
    for (int k = 0; k < KINDS; ++k) {
        factor[k] = drift_of((enum kind)k, &strata[k]);
    }
    for (uint32_t i = 0; i < e->side * e->side; ++i) {
        for (int k = 0; k < 3; ++k) {
            e->cells[i].radiance[k] *= factor[kinds[i]];
        }
        e->cells[i].potential *= factor[kinds[i]];
    }
}

/* The record from its rays: only its light where that has changed little. */
static void reduce(const struct kl_ledger_refresh *r, struct kl_ledger_entry *e,
                   const struct kl_gather_tables *tables, kl_gather_cell *scratch)
{
    const float spacing = kl_half_to_float(e->cold.error_spacing >> 16) * e->cold.raw_radius;
    const kl_grid_view grid = kl_gather_tables_grid(tables);
    kl_gather_result result;

    kl_reduce_touched(e->cells, e->side * e->side, r->job->gather.touch, &result);
    if (e->change < slight) {
        memcpy(e->cold.touched, result.touched, sizeof e->cold.touched);
        return;
    }
    kl_reduce_record(e->cells, kl_gather_directions(tables, e->point.seed), &grid, &e->point,
                     scratch, &result);
    kl_record_pack(&e->point, &result, e->level, spacing, &r->job->radius, &e->hot, &e->cold);
}

void kl_ledger_refresh_entry(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entry,
                             kl_gather_cell *scratch)
{
    const struct kl_gather_tables *tables = find_tables(refresh->job, entry->side);
    struct stratum strata[KINDS] = {{0}};
    uint8_t kinds[KL_LEDGER_SIDE * KL_LEDGER_SIDE];
    float irr[3];

    const double before = sum_up(entry, irr);
    shoot(refresh, entry, tables, kinds, strata);
    if (entry->shot == 0) return;
    drift(entry, kinds, strata);
    const double after = sum_up(entry, entry->cold.irr);
    if (after != before) entry->change = before > 0.0 ? (float)fabs(after / before - 1.0) : 1.0f;
    reduce(refresh, entry, tables, scratch);
}
