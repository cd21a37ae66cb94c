#include "src/cache/validity.h"

#include <math.h>

/* Invariant: let S be the records that serve a point, and m the nearest of them. If m were to lose
 * the point, then along the way from m through it a nearer record took over, and that record serves
 * the point too: it is in S, and nearer than m. So m keeps the point, with a weight of 1 - 1 / room
 * at least: what the fill asks for. Ways are few and `strip` guesses, so this holds but for
 * slivers: what is lost is filled like any other gap. */
static const float room = 1.45f;
/* A way on which nobody takes over mostly leads off the surface, over an edge or to where no
 * records are: it counts no more than so many times the longest of the others. */
static const float strip = 3.0f;
static const float before_wall = 0.9f; /* of a way that ends at a wall: nobody serves its foot */
enum { WAYS = 12, ROUNDS = 3 };

/* How far a record serves along a direction (x, y) of its frame, radii enlarged by `reach`. */
static float extent_along(const kl_record_hot *r, const kl_record_cold *cold, float x, float y,
                          float reach)
{
    const kl_vec2 axis = kl_record_axis(r->form);
    const float minor = (x * axis.x + y * axis.y) / r->radius;
    const float major = (y * axis.x - x * axis.y) / r->radius2;
    const float radius = reach / sqrtf(minor * minor + major * major);
    const kl_u32 code = cold->clearance[kl_sector_of(x, y)];
    const float unit2 = kl_clearance_unit2(cold->error_spacing, cold->raw_radius);
    return code == 255u ? radius : kl_fmin(radius, sqrtf(kl_clearance_distance2(unit2, code)));
}

static bool serves(const struct kl_record_set *set, uint32_t number, kl_vec3 p, kl_vec3 n,
                   float reach)
{
    const kl_query query = {reach, set->cos_max, KL_INF};
    const kl_bearing b = kl_record_bearing(&set->hot[number], &query, p, n);
    return b.weight > 0.0f && !kl_record_is_blocked(&set->cold[number], &b);
}

struct way {
    kl_vec3 pos, normal; /* of the record */
    kl_vec3 dir;
    float reach;
};

static kl_vec3 on_way(const struct way *w, float length)
{
    return kl_v3_mad(w->pos, length, w->dir);
}

/* From where on, along a way up to `end`, record `number` is nearer than the way's own and serves
 * in its place; `end` if nowhere. What a record serves is convex: the ends are enough. */
static float taken_over(const struct kl_record_set *set, uint32_t number, const struct way *w,
                        float end)
{
    const kl_vec3 d = kl_v3_sub(kl_v3_load(set->hot[number].pos), w->pos);
    const float along = kl_dot(d, w->dir);
    const float d2 = kl_dot(d, d);
    if (!(d2 > 0.0f) || !(d2 < 2.0f * end * along)) return end;
    const float start = 0.5f * d2 / along;
    if (!serves(set, number, on_way(w, end), w->normal, w->reach)) return end;
    return serves(set, number, on_way(w, start), w->normal, w->reach) ? start : end;
}

/* The records around one, nearest first. */
struct others {
    uint32_t count, numbers[KL_NEAREST_MOST];
    float distances[KL_NEAREST_MOST]; /* [m] */
    bool are_all;
};

/* How far along a way up to `end` its record is needed: what lies beyond is served by nearer ones,
 * of which one takes over from the other. */
static float needed_along(const struct kl_record_set *set, const struct others *others,
                          const struct way *w, float end)
{
    float before = KL_INF;
    while (end < before) {
        before = end;
        for (uint32_t i = 0; i < others->count && others->distances[i] < 2.0f * end; ++i) {
            end = taken_over(set, others->numbers[i], w, end);
        }
    }
    return end;
}

/* Those that may take over: of normals that a query may have beside the record's own. */
static void find_others(const struct kl_record_set *set, const kl_record_hot *r, struct others *out)
{
    const kl_vec3 n = kl_oct_decode(r->normal);
    uint32_t near[KL_NEAREST_MOST];
    const uint32_t count = kl_point_tree_nearest(set->tree, r->pos, 2.0f * set->reach * r->radius2,
                                                 KL_NEAREST_MOST, near);
    out->count = 0;
    out->are_all = count < KL_NEAREST_MOST;
    for (uint32_t i = 0; i < count; ++i) {
        const kl_record_hot *o = &set->hot[near[i]];
        if (!(kl_dot(kl_oct_decode(o->normal), n) > set->cos_max)) continue;
        out->distances[out->count] = kl_length(kl_v3_sub(kl_v3_load(o->pos), kl_v3_load(r->pos)));
        out->numbers[out->count++] = near[i];
    }
}

/* Radii as they are, and enlarged as far as queries may. */
static float limit_among(const struct kl_record_set *set, const struct others *others,
                         const kl_record_hot *r, const kl_record_cold *cold)
{
    const kl_vec3 n = kl_oct_decode(r->normal);
    const kl_frame f = kl_frame_from_normal(n);
    float needed = 0.0f;
    float open = 0.0f;
    int open_ways = 0;
    for (int k = 0; k < 2 * WAYS; ++k) {
        const float angle = (float)k * (2.0f * KL_PI / WAYS);
        const float x = cosf(angle);
        const float y = sinf(angle);
        const float reach = k < WAYS ? 1.0f : set->reach;
        const struct way w = {kl_v3_load(r->pos), n, kl_v3_mad(kl_v3_scale(f.t, x), y, f.b), reach};
        const float end = extent_along(r, cold, x, y, reach);
        if (end <= reach * needed) continue;
        const bool is_walled = cold->clearance[kl_sector_of(x, y)] != 255u;
        const float last = is_walled ? before_wall * end : end;
        const float found = needed_along(set, others, &w, last);
        if (found < last) {
            needed = kl_fmax(needed, found / reach);
        } else {
            open = kl_fmax(open, end / reach);
            ++open_ways;
        }
    }
    return open_ways > WAYS ? KL_INF : room * kl_fmax(needed, kl_fmin(open, strip * needed));
}

/* A record with many around it is looked at again in its new radii, about which fewer lie. */
static float limit_of(const struct kl_record_set *set, uint32_t number)
{
    kl_record_hot r = set->hot[number];
    struct others others = {0};
    float limit = KL_INF;
    for (int i = 0; i < ROUNDS && !others.are_all; ++i) {
        find_others(set, &r, &others);
        limit = kl_fmin(limit, limit_among(set, &others, &r, &set->cold[number]));
        r.radius = kl_fmin(r.radius, limit);
        r.radius2 = kl_fmin(r.radius2, limit);
    }
    return limit;
}

void kl_validity_limits(const struct kl_record_set *set, float *limits)
{
#pragma omp parallel for schedule(dynamic, 256)
    for (uint32_t i = 0; i < set->count; ++i) {
        limits[i] = limit_of(set, i);
    }
}
