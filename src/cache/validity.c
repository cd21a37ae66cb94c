#include "src/cache/validity.h"

#include <math.h>

/* Invariant: let S be the records that serve a point, and m the nearest of them. If m were to lose
 * the point, then along the way from m through it a nearer record took over, and that record serves
 * the point too: it is in S, and nearer than m. So m keeps the point, with a weight of 1 - 1 / room
 * at least: what the fill asks for. */
static const float room = 1.45f;
enum { WAYS = 12 };

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

static bool serves(const kl_level_view *level, uint32_t number, kl_vec3 p, kl_vec3 n, float reach)
{
    const kl_query query = {reach, level->head.cos_max, KL_INF};
    const kl_bearing b = kl_record_bearing(&level->hot[number], &query, p, n);
    return b.weight > 0.0f && !kl_record_is_blocked(&level->cold[number], &b);
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
static float taken_over(const kl_level_view *level, uint32_t number, const struct way *w, float end)
{
    const kl_vec3 d = kl_v3_sub(kl_v3_load(level->hot[number].pos), w->pos);
    const float along = kl_dot(d, w->dir);
    const float d2 = kl_dot(d, d);
    if (!(d2 > 0.0f) || !(d2 < 2.0f * end * along)) return end;
    const float start = 0.5f * d2 / along;
    if (!serves(level, number, on_way(w, end), w->normal, w->reach)) return end;
    return serves(level, number, on_way(w, start), w->normal, w->reach) ? start : end;
}

/* How far along a way up to `end` its record is needed: what lies beyond is served by nearer ones,
 * of which one takes over from the other. */
static float needed_along(const kl_level_view *level, uint32_t number, kl_u32 row,
                          const struct way *w, float end)
{
    float before = KL_INF;
    while (end < before) {
        kl_u32 item = 0;
        before = end;
        for (kl_u32 at = row; !(item & KL_ROW_LAST); ++at) {
            item = level->rows[at];
            const kl_u32 other = item & ~KL_ROW_LAST;
            if (other != number) end = taken_over(level, other, w, end);
        }
    }
    return end;
}

/* Radii as they are, and enlarged as far as queries may. */
static float limit_of(const kl_level_view *level, uint32_t number)
{
    const kl_record_hot *r = &level->hot[number];
    const kl_vec3 n = kl_oct_decode(r->normal);
    const kl_frame f = kl_frame_from_normal(n);
    const kl_u32 row = kl_octree_row(level, kl_v3_load(r->pos), kl_normal_face(n));
    float needed = 0.0f;
    if (row == KL_NONE) return KL_INF;
    for (int k = 0; k < 2 * WAYS; ++k) {
        const float angle = (float)k * (2.0f * KL_PI / WAYS);
        const float x = cosf(angle);
        const float y = sinf(angle);
        const float reach = k < WAYS ? 1.0f : level->head.reach;
        const struct way w = {kl_v3_load(r->pos), n, kl_v3_mad(kl_v3_scale(f.t, x), y, f.b), reach};
        const float end = extent_along(r, &level->cold[number], x, y, reach);
        if (end > reach * needed) {
            needed = kl_fmax(needed, needed_along(level, number, row, &w, end) / reach);
        }
    }
    return room * needed;
}

void kl_validity_limits(const kl_level_view *level, float *limits)
{
#pragma omp parallel for schedule(dynamic, 256)
    for (uint32_t i = 0; i < level->head.record_count; ++i) {
        limits[i] = limit_of(level, i);
    }
}
