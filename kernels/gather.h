/* One gather ray: the indirect radiance that arrives at a point from one direction, and how far
 * away it comes from. */
#ifndef KL_KERNELS_GATHER_H
#define KL_KERNELS_GATHER_H
#include "kernels/bsdf.h"
#include "kernels/cache_query.h"
#include "kernels/lights.h"
#include "kernels/parts.h"
#include "kernels/riding.h"

#define KL_GATHER_DEPTH 64 /* bounces at most; roulette ends nearly all paths long before */

#define KL_SAME_SIDE 0.9f /* cosine: surfaces that may share records */

/* A point for which irradiance is wanted. */
typedef struct kl_gather_point {
    float pos[3];           /* [m], render space, on the surface */
    kl_u32 normal;          /* octahedral: smooth normal, axis of the hemisphere */
    kl_u32 geometric;       /* octahedral: normal of the triangle, on the same side */
    kl_u32 seed;            /* identity of the record: hash of position, normal, level */
    float rot_cos, rot_sin; /* rotation of the direction set about the normal */
    kl_ride on;             /* while the shutter is open */
} kl_gather_point;
KL_ASSERT_SIZE(kl_gather_point, 48);

/* Directions shared by a batch: an Owen-scrambled Sobol' net of side^2 points on the unit disc, one
 * in each cell of the concentric grid, listed by cell, row by row. */
typedef struct kl_direction {
    float x, y;   /* disc point: the tangential part of the direction */
    kl_u32 index; /* place in the sequence: quarter blocks estimate the error */
    float when;   /* third coordinate, in [0, 1): the ray's time */
} kl_direction;
KL_ASSERT_SIZE(kl_direction, 16);

/* One ray out of a step: of point `point`, by direction `direction` of all the sets. */
typedef struct kl_gather_pick {
    kl_u32 point, direction;
} kl_gather_pick;
KL_ASSERT_SIZE(kl_gather_pick, 8);

/* What one ray found. */
typedef struct kl_gather_cell {
    float radiance[3]; /* [W m^-2 sr^-1], >= 0, finite */
    float distance;    /* [m]; KL_INF: nothing there; negative: the magnitude, and the surface that
                        * was hit faces the way the record does (the same floor, curved) */
    float potential;   /* luminance that would arrive if the surface that was hit were white */
    kl_u32 touch;  /* four bytes, lowest first: bit (kernels/parts.h) of the object that was hit;
                    * of the light that it was asked for; that light's share of the radiance, in
                    * 255ths; bit of the object that the path hit next, if it went on. 255: none */
    kl_u32 toward; /* octahedral: where light was asked for from what was hit */
    float light;   /* [m] how far away that is; 0: none was, KL_INF: the sky */
} kl_gather_cell;
KL_ASSERT_SIZE(kl_gather_cell, 32);

KL_FN float kl_cell_inverse(const KL_GLOBAL kl_gather_cell *c)
{
    const float d = kl_fabs(c->distance);
    return d < KL_INF ? 1.0f / kl_fmax(d, 1e-30f) : 0.0f;
}
KL_FN float kl_cell_luminance(const KL_GLOBAL kl_gather_cell *c)
{
    return 0.2126f * c->radiance[0] + 0.7152f * c->radiance[1] + 0.0722f * c->radiance[2];
}

typedef struct kl_gather_settings {
    kl_query query;     /* of the level-1 records */
    float length_scale; /* records serve a ray only if it is longer than xi * this * radius */
    kl_u32 side;        /* directions are side x side */
    kl_u32 side_before; /* rays of this many directions a side have been traced already, or 0 */
    kl_u32 sets;        /* number of direction sets, a power of two */
    float touch;        /* share of a record's light from which on it depends on a part */
} kl_gather_settings;

/* Direct light reflected by a white Lambertian surface: one sample of one light. *light: where it
 * was looked for; light KL_NONE: there is none, distance 0: it cannot come from there. */
KL_FN kl_vec3 kl_direct_lambert(const kl_scene_view *s, const kl_surface *surf, float choice,
                                kl_vec2 u, kl_light_sample *light)
{
    if (!kl_light_sample_one(s, surf->pos, surf->geometric, surf->time, choice, u, light)) {
        light->light = KL_NONE;
        light->distance = 0.0f;
        light->wi = surf->smooth;
        return kl_v3_splat(0.0f);
    }
    const float cosine = kl_dot(surf->smooth, light->wi);
    if (!(cosine > 0.0f) || !(kl_dot(surf->geometric, light->wi) > 0.0f)) {
        light->distance = 0.0f;
        return kl_v3_splat(0.0f);
    }
    const kl_ray ray = kl_shadow_ray(s, surf, light);
    const float through = kl_transmittance(s, &ray);
    return kl_v3_scale(light->radiance, KL_INV_PI * cosine * through / light->pdf);
}

/* Bits of a light and of an object. */
KL_FN kl_u32 kl_touch_of_light(const kl_scene_view *s, kl_u32 light)
{
    return light == KL_NONE ? KL_TOUCH_NONE : s->touch_bits[light];
}
KL_FN kl_u32 kl_touch_of_object(const kl_scene_view *s, kl_u32 object)
{
    return object == KL_NONE ? KL_TOUCH_NONE : s->touch_bits[s->light_count + object];
}
/* `direct` of all the light `sum` comes straight from `light`. */
KL_FN kl_u32 kl_touch_of_direct(const kl_scene_view *s, kl_u32 light, kl_vec3 direct, kl_vec3 sum)
{
    const float all = kl_luminance(sum);
    const float share = all > 0.0f ? kl_clamp(kl_luminance(direct) / all, 0.0f, 1.0f) : 0.0f;
    return kl_touch_of_light(s, light) << 8 | (kl_u32)(share * 255.0f + 0.5f) << 16;
}

/* A point of a surface where records are. */
typedef struct kl_asked {
    kl_vec3 pos, normal;
} kl_asked;

/* Of a hit on something that moves: where it is at the reference instant. */
KL_APART kl_asked kl_gather_carry(const kl_scene_view *s, const kl_ray *ray, const kl_hit *hit,
                                  int front)
{
    kl_surface there;
    kl_asked out;
    kl_ray r = *ray;
    r.time = KL_TIME_REFERENCE;
    kl_surface_of_side(s, &r, hit, front, &there);
    out.pos = there.pos;
    out.normal = there.smooth;
    return out;
}

/* Is a point inside of something at a ray's time? Then what first meets the eye along its surface
 * is, to three sides, the back of something that moves. A sheet over it leaves a side open. */
KL_APART int kl_gather_is_inside(const kl_scene_view *s, const kl_ray *from, kl_vec3 axis)
{
    const kl_frame f = kl_frame_from_normal(axis);
    kl_vec3 side = kl_v3(0.995f, 0.0f, 0.1f);
    for (int k = 0; k < 3; ++k) {
        kl_ray ray = *from;
        kl_hit hit;
        kl_surface surf;
        ray.dir = kl_frame_to_world(&f, side);
        if (!kl_trace_closest(s, &ray, &hit) || !kl_instance_moves(s, hit.instance)) return 0;
        kl_surface_at(s, &ray, &hit, &surf);
        if (surf.front) return 0;
        side = kl_v3(-0.5f * side.x - 0.8660254f * side.y, 0.8660254f * side.x - 0.5f * side.y,
                     side.z);
    }
    return 1;
}

/* Radiance that comes back along `ray`, without what emitters send directly: their light belongs to
 * the direct light of the ray's origin. Ends in the records of level 1 where these serve, else goes
 * on as a path, so that all bounces are counted. `axis`: normal at the ray's origin. `stays`: that
 * is there at all times, and at the reference instant uncovered: a ray that starts inside of
 * something that moves goes then instead. */
KL_FN kl_gather_cell kl_gather_ray(const kl_scene_view *s, const kl_level_view *level1,
                                   const kl_gather_settings *set, kl_vec3 axis, kl_ray ray,
                                   int stays, kl_sampler sampler)
{
    kl_gather_cell out;
    kl_vec3 first = kl_v3_splat(0.0f);  /* albedo of the surface that is hit first */
    kl_vec3 direct = kl_v3_splat(0.0f); /* on it */
    kl_u32 light = KL_NONE;             /* whose */
    kl_u32 hit_bits = KL_TOUCH_NONE | KL_TOUCH_NONE << 24;
    kl_vec3 sum = kl_v3_splat(0.0f); /* as if the first surface were white */
    kl_vec3 beta = kl_v3_splat(1.0f);
    out.distance = KL_INF;
    out.toward = 0u;
    out.light = 0.0f;
    for (int bounce = 0; bounce < KL_GATHER_DEPTH; ++bounce) {
        kl_hit hit;
        kl_surface surf;
        const kl_u32 seed = kl_hash2(sampler.seed, sampler.index * 64u + (kl_u32)bounce);
        if (!kl_intersect(s, &ray, seed, &hit)) break;
        kl_surface_at(s, &ray, &hit, &surf);
        if (stays && bounce == 0 && !surf.front && kl_instance_moves(s, hit.instance) &&
            kl_gather_is_inside(s, &ray, axis)) {
            ray.time = KL_TIME_REFERENCE;
            stays = 0;
            bounce = -1;
            continue;
        }
        const kl_vec3 wo = kl_v3_scale(ray.dir, -1.0f);
        const kl_vec3 albedo = kl_gather_albedo(s, &surf, wo);
        if (bounce == 0) {
            out.distance = kl_dot(surf.smooth, axis) > KL_SAME_SIDE ? -hit.t : hit.t;
            first = albedo;
            hit_bits = kl_touch_of_object(s, surf.object) | KL_TOUCH_NONE << 24;
        } else {
            beta = kl_v3_mul(beta, albedo);
            if (kl_is_black(beta)) break;
            if (bounce == 1) hit_bits ^= (KL_TOUCH_NONE ^ kl_touch_of_object(s, surf.object)) << 24;
        }
        const float choice = kl_sampler_1d(&sampler);
        const kl_vec2 u = kl_sampler_2d(&sampler);
        kl_light_sample sample;
        kl_vec3 here = kl_direct_lambert(s, &surf, choice, u, &sample);
        if (!kl_is_black(here)) {
            here = kl_v3_mul(here, kl_gather_shape(s, &surf, albedo, wo, sample.wi));
        }
        if (bounce == 0) {
            direct = here;
            light = sample.light;
            out.toward = kl_oct_encode(sample.wi);
            out.light = sample.distance;
        }
        sum = kl_v3_add(sum, kl_v3_mul(beta, here));
        const float xi = kl_sampler_1d(&sampler);
        kl_asked at;
        at.pos = surf.pos;
        at.normal = surf.smooth;
        if (kl_instance_moves(s, hit.instance)) at = kl_gather_carry(s, &ray, &hit, surf.front);
        const kl_answer a = kl_cache_query(level1, &set->query, at.pos, at.normal, at.normal);
        if (a.weight > 0.0f && hit.t > xi * set->length_scale * a.radius) {
            sum = kl_v3_mad(sum, KL_INV_PI, kl_v3_mul(beta, a.irr));
            break;
        }
        if (kl_is_black(first)) break;
        if (bounce >= 1) {
            const float go_on = kl_fmin(0.95f, kl_max3(kl_v3_mul(first, beta)));
            if (kl_sampler_1d(&sampler) >= go_on) break;
            beta = kl_v3_scale(beta, 1.0f / go_on);
        }
        const kl_frame f = kl_frame_from_normal(surf.smooth);
        const kl_vec3 dir = kl_frame_to_world(&f, kl_cosine_direction(kl_sampler_2d(&sampler)));
        if (!(kl_dot(dir, surf.geometric) > 0.0f)) break;
        ray = kl_ray_leave(s, &surf, dir);
    }
    out.radiance[0] = first.x * sum.x;
    out.radiance[1] = first.y * sum.y;
    out.radiance[2] = first.z * sum.z;
    out.potential = kl_luminance(sum);
    out.touch = hit_bits | kl_touch_of_direct(s, light, direct, sum);
    return out;
}

/* How a point stands when the ray of one cell leaves it. While the shutter is open every ray has a
 * time of its own: together they bring the mean over it, for the same point of the surface. */
KL_FN kl_stance kl_gather_stance(const kl_scene_view *s, const KL_GLOBAL kl_gather_point *point,
                                 const KL_GLOBAL kl_direction *direction)
{
    const kl_vec3 n = kl_oct_decode(point->normal);
    kl_stance out;
    out.pos = kl_v3_load(point->pos);
    out.geometric = kl_oct_decode(point->geometric);
    out.frame = kl_frame_from_normal(n);
    out.time = KL_TIME_REFERENCE;
    if (KL_NEEDS(s, KL_NEED_MOTION)) {
        const kl_ride on = point->on;
        const float u = direction->when + kl_unit_float(kl_hash(point->seed ^ 0x74696d65u));
        out.time = kl_shutter_time(s->shutter_times, u < 1.0f ? u : u - 1.0f);
        if (on.instance != 0u) return kl_ride_to(s, &on, out.time, out.pos, n, out.geometric);
    }
    return out;
}

/* The ray of one cell of one record's hemisphere, below the triangle or not. */
KL_FN kl_ray kl_gather_leave(const kl_scene_view *s, const KL_GLOBAL kl_gather_point *point,
                             const KL_GLOBAL kl_direction *direction, const kl_stance *from)
{
    const float x = point->rot_cos * direction->x - point->rot_sin * direction->y;
    const float y = point->rot_sin * direction->x + point->rot_cos * direction->y;
    const kl_vec3 dir = kl_v3(x, y, kl_sqrt(kl_fmax(0.0f, 1.0f - x * x - y * y)));
    kl_ray ray = kl_ray_make(kl_leave_surface(s, from->pos, from->geometric),
                             kl_frame_to_world(&from->frame, dir), KL_INF);
    ray.time = from->time;
    return ray;
}

/* What it brings. */
KL_FN kl_gather_cell kl_gather_direction(const kl_scene_view *s, const kl_level_view *level1,
                                         const kl_gather_settings *set,
                                         const KL_GLOBAL kl_gather_point *point,
                                         const KL_GLOBAL kl_direction *direction)
{
    const kl_stance from = kl_gather_stance(s, point, direction);
    const kl_ray ray = kl_gather_leave(s, point, direction, &from);
    if (!(kl_dot(ray.dir, from.geometric) > 0.0f)) { /* its own surface, black and near */
        kl_gather_cell none;
        none.radiance[0] = 0.0f;
        none.radiance[1] = 0.0f;
        none.radiance[2] = 0.0f;
        none.distance = KL_INF;
        none.potential = 0.0f;
        none.touch = KL_NONE;
        none.toward = 0u;
        none.light = 0.0f;
        return none;
    }
    return kl_gather_ray(s, level1, set, from.frame.n, ray, point->on.instance == 0u,
                         kl_sampler_make(direction->index, point->seed));
}

/* One cell of a step: traced, or taken from the cells of the step before, whose every ray is one of
 * this step's and lies in the cell that this one is a quarter of. */
KL_FN kl_gather_cell kl_gather_one_cell(const kl_scene_view *s, const kl_level_view *level1,
                                        const kl_gather_settings *set,
                                        const KL_GLOBAL kl_gather_point *point,
                                        const KL_GLOBAL kl_direction *directions, kl_u32 cell,
                                        const KL_GLOBAL kl_gather_cell *before)
{
    const KL_GLOBAL kl_direction *direction = directions + cell;
    if (direction->index < set->side_before * set->side_before) {
        const kl_u32 step = set->side / set->side_before;
        const kl_u32 x = cell % set->side / step;
        const kl_u32 y = cell / set->side / step;
        return before[y * set->side_before + x];
    }
    return kl_gather_direction(s, level1, set, point, direction);
}

/* Cell `order` of a side x side grid along the Z-curve, as row * side + column: consecutive work
 * items trace neighbouring directions. side is a power of two. */
KL_FN kl_u32 kl_cell_in_order(kl_u32 order, kl_u32 side)
{
    kl_u32 x = order & 0x55555555u;
    kl_u32 y = (order >> 1) & 0x55555555u;
    x = (x | (x >> 1)) & 0x33333333u;
    x = (x | (x >> 2)) & 0x0f0f0f0fu;
    x = (x | (x >> 4)) & 0x00ff00ffu;
    x = (x | (x >> 8)) & 0x0000ffffu;
    y = (y | (y >> 1)) & 0x33333333u;
    y = (y | (y >> 2)) & 0x0f0f0f0fu;
    y = (y | (y >> 4)) & 0x00ff00ffu;
    y = (y | (y >> 8)) & 0x0000ffffu;
    return y * side + x;
}

#endif
