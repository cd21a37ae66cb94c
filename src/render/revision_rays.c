/* What a few rays from a record tell about an edit: see docs/decisions/0010-dependence.md. */
#include "kernels/bsdf.h"
#include "kernels/lights.h"
#include "src/render/revision_impl.h"

#include <math.h>

enum { PILOT_RAYS = 64, BOX_RAYS = 16 };
static const kl_u32 pilot_salt = 0x51ed270bu;
static const float brightest = 4.0f; /* what an object sends over what the record gets: at most */

/* Distance at which a ray enters a box; KL_INF: never. Slabs, as in Kay and Kajiya 1986. */
static float box_entry(const struct kl_revision_box *box, const kl_ray *ray)
{
    const float o[3] = {ray->origin.x, ray->origin.y, ray->origin.z};
    const float d[3] = {ray->dir.x, ray->dir.y, ray->dir.z};
    float near = 0.0f;
    float far = ray->tmax;

    for (int k = 0; k < 3; ++k) {
        if (d[k] == 0.0f) {
            if (o[k] < box->min[k] || o[k] > box->max[k]) return KL_INF;
            continue;
        }
        const float a = (box->min[k] - o[k]) / d[k];
        const float b = (box->max[k] - o[k]) / d[k];
        near = fmaxf(near, fminf(a, b));
        far = fminf(far, fmaxf(a, b));
    }
    return near <= far ? near : KL_INF;
}

static kl_vec3 point_in(const struct kl_revision_box *box, kl_sampler *sampler)
{
    const kl_vec2 u = kl_sampler_2d(sampler);
    const float w = kl_sampler_1d(sampler);
    return kl_v3(box->min[0] + u.x * (box->max[0] - box->min[0]),
                 box->min[1] + u.y * (box->max[1] - box->min[1]),
                 box->min[2] + w * (box->max[2] - box->min[2]));
}

/* A sphere of angular radius a covers at most sin^2 a of the cosine-weighted hemisphere. */
static bool is_too_small(const struct kl_revision *r, const struct kl_revision_box *box,
                         kl_vec3 pos, kl_vec3 n)
{
    const kl_vec3 lo = kl_v3_load(box->min);
    const kl_vec3 hi = kl_v3_load(box->max);
    const kl_vec3 way = kl_v3_sub(kl_v3_scale(kl_v3_add(lo, hi), 0.5f), pos);
    const float radius = 0.5f * kl_length(kl_v3_sub(hi, lo));
    const float d2 = kl_dot(way, way);
    if (kl_dot(way, n) < -radius) return true; /* below the horizon */
    return brightest * radius * radius < r->touch * d2;
}

static bool is_visible(const struct kl_revision *r, const struct kl_revision_box *box, kl_vec3 pos,
                       kl_vec3 n, kl_u32 seed)
{
    for (kl_u32 i = 0; i < BOX_RAYS; ++i) {
        kl_sampler sampler = kl_sampler_make(i, seed);
        const kl_vec3 way = kl_v3_sub(point_in(box, &sampler), pos);
        const float length = kl_length(way);
        if (!(length > 0.0f)) return true;
        const kl_vec3 dir = kl_v3_scale(way, 1.0f / length);
        if (!(kl_dot(dir, n) > 0.0f)) continue;
        const kl_ray ray = kl_ray_make(kl_leave_surface(r->scene, pos, n), dir, KL_INF);
        kl_hit hit;
        if (!kl_intersect(r->scene, &ray, seed + i, &hit)) return true;
        if (hit.t >= 0.999f * box_entry(box, &ray)) return true;
    }
    return false;
}

struct pilot {
    kl_vec3 pos, normal;
    kl_frame frame;
    kl_u32 seed;
    float light; /* luminance of the record's irradiance */
};

static struct pilot pilot_of(const kl_record_hot *hot, const kl_record_cold *cold)
{
    struct pilot p = {.pos = kl_v3_load(hot->pos), .normal = kl_oct_decode(hot->normal)};
    p.frame = kl_frame_from_normal(p.normal);
    p.seed = pilot_salt ^ kl_record_seed(hot->pos, hot->normal, kl_record_level(hot->form));
    p.light = kl_luminance(kl_v3_load(cold->irr));
    return p;
}

/* Ray i of a pilot: what it hits, and its albedo there. */
static bool pilot_hit(const struct kl_revision *r, const struct pilot *p, kl_u32 i,
                      kl_sampler *sampler, kl_surface *surface, kl_vec3 *albedo)
{
    *sampler = kl_sampler_make(i, p->seed);
    const kl_vec3 dir = kl_frame_to_world(&p->frame, kl_cosine_direction(kl_sampler_2d(sampler)));
    const kl_ray ray = kl_ray_make(kl_leave_surface(r->scene, p->pos, p->normal), dir, KL_INF);
    kl_hit hit;
    if (!kl_intersect(r->scene, &ray, p->seed + i, &hit)) return false;
    kl_surface_at(r->scene, &ray, &hit, surface);
    *albedo = kl_gather_albedo(r->scene, surface, kl_v3_scale(dir, -1.0f));
    return !kl_is_black(*albedo);
}

/* Direct light at a surface that passes one of the boxes on its way, as radiance, unshadowed. */
static float shadowed_light(const struct kl_revision *r, const kl_surface *surface, kl_vec3 albedo,
                            kl_sampler *sampler)
{
    kl_light_sample light;
    const float choice = kl_sampler_1d(sampler);
    const kl_vec2 u = kl_sampler_2d(sampler);
    if (!kl_light_sample_one(r->scene, surface->pos, surface->geometric, surface->time, choice, u,
                             &light)) {
        return 0.0f;
    }
    const float cosine = kl_dot(surface->smooth, light.wi);
    if (!(cosine > 0.0f)) return 0.0f;
    const kl_ray ray = kl_shadow_ray(r->scene, surface, &light);
    for (uint32_t b = 0; b < r->box_count; ++b) {
        if (box_entry(&r->boxes[b], &ray) < KL_INF) {
            return kl_luminance(kl_v3_mul(albedo, light.radiance)) * KL_INV_PI * cosine / light.pdf;
        }
    }
    return 0.0f;
}

bool kl_revision_sees_boxes(const struct kl_revision *revision, const kl_record_hot *hot,
                            const kl_record_cold *cold)
{
    const struct kl_revision *r = revision;
    const struct pilot p = pilot_of(hot, cold);
    float sum = 0.0f;

    if (r->box_count == 0) return false;
    for (uint32_t b = 0; b < r->box_count; ++b) {
        if (is_too_small(r, &r->boxes[b], p.pos, p.normal)) continue;
        if (is_visible(r, &r->boxes[b], p.pos, p.normal, p.seed)) return true;
    }
    for (kl_u32 i = 0; i < PILOT_RAYS; ++i) {
        kl_sampler sampler;
        kl_surface surface;
        kl_vec3 albedo;
        if (!pilot_hit(r, &p, i, &sampler, &surface, &albedo)) continue;
        sum += shadowed_light(r, &surface, albedo, &sampler);
    }
    return sum > 0.0f && KL_PI * sum >= r->touch * PILOT_RAYS * p.light;
}

bool kl_revision_is_changed(const struct kl_revision *revision, const kl_level_view *before,
                            const kl_level_view *after, const kl_record_hot *hot,
                            const kl_record_cold *cold)
{
    const struct pilot p = pilot_of(hot, cold);
    kl_vec3 sum = kl_v3_splat(0.0f);

    for (kl_u32 i = 0; i < PILOT_RAYS; ++i) {
        kl_sampler sampler;
        kl_surface s;
        kl_vec3 albedo;
        if (!pilot_hit(revision, &p, i, &sampler, &s, &albedo)) continue;
        const kl_answer was = kl_cache_query(before, &revision->query, s.pos, s.smooth, s.smooth);
        const kl_answer is = kl_cache_query(after, &revision->query, s.pos, s.smooth, s.smooth);
        if (!(was.weight > 0.0f) || !(is.weight > 0.0f)) continue;
        sum = kl_v3_add(sum, kl_v3_mul(albedo, kl_v3_sub(is.irr, was.irr)));
    }
    const float change = kl_max3(kl_v3(fabsf(sum.x), fabsf(sum.y), fabsf(sum.z)));
    return change > 0.0f && change >= revision->touch * PILOT_RAYS * p.light;
}
