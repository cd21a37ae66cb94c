#include "src/render/shade_impl.h"
#include "src/render/swept.h"

#include <string.h>

kl_vec3 kl_shade_emission(const struct kl_shade_context *context, const kl_ray *ray,
                          const kl_hit *hit, const kl_surface *surface,
                          const struct kl_bounce *from)
{
    const kl_scene_view *s = context->scene;
    if (hit == NULL) {
        if (!(from->pdf > 0.0f)) return kl_env_radiance_smooth(s, ray->dir);
        const kl_vec3 sky = kl_env_radiance(s, ray->dir);
        if (kl_is_black(sky)) return sky;
        const float p =
            kl_light_pdf(s, s->env.light, from->pos, from->normal, ray->time, ray->dir, KL_INF);
        return kl_v3_scale(sky, kl_power_weight(from->pdf, p));
    }
    if (!(from->pdf > 0.0f) || surface->light == KL_NONE || kl_is_black(surface->emission)) {
        return surface->emission;
    }
    const float p =
        kl_light_pdf(s, surface->light, from->pos, from->normal, ray->time, ray->dir, hit->t);
    return kl_v3_scale(surface->emission, kl_power_weight(from->pdf, p));
}

struct kl_direct kl_shade_direct(const struct kl_shade_context *context, const kl_surface *surface,
                                 kl_vec3 wo, kl_vec3 albedo, const struct kl_lobes *lobes,
                                 kl_sampler *sampler, struct kl_counts *counts)
{
    struct kl_direct out = {kl_v3_splat(0.0f), kl_v3_splat(0.0f)};
    const float choice = kl_sampler_1d(sampler);
    const kl_vec2 u = kl_sampler_2d(sampler);
    kl_light_sample light;

    if (!kl_light_sample_one(context->scene, surface->pos, surface->geometric, surface->time,
                             choice, u, &light)) {
        return out;
    }
    if (!(kl_dot(surface->geometric, light.wi) > 0.0f)) return out;
    const float cosine = kl_fmax(0.0f, kl_dot(surface->shading, light.wi));
    float lobe_pdf = 0.0f;
    kl_vec3 lobe = kl_v3_splat(0.0f);
    if (kl_has_specular(surface)) lobe = kl_specular_eval(surface, wo, light.wi, &lobe_pdf);
    const kl_vec3 base = kl_v3_scale(albedo, KL_INV_PI * cosine);
    if (kl_is_black(base) && kl_is_black(lobe)) return out;
    const kl_ray ray = kl_shadow_ray(context->scene, surface, &light);
    ++counts->shadow;
    const float through = kl_transmittance(context->scene, &ray);
    if (!(through > 0.0f)) return out;
    float p_base = light.delta ? 0.0f : lobes->diffuse * cosine * KL_INV_PI;
    float p_lobe = light.delta ? 0.0f : lobes->specular * lobe_pdf;
    if (lobes->mixed) {
        p_base += p_lobe;
        p_lobe = p_base;
    }
    const kl_vec3 arriving = kl_v3_scale(light.radiance, through / light.pdf);
    out.diffuse = kl_v3_scale(kl_v3_mul(base, arriving), kl_power_weight(light.pdf, p_base));
    out.specular = kl_v3_scale(kl_v3_mul(lobe, arriving), kl_power_weight(light.pdf, p_lobe));
    return out;
}

/* The other half of direct light where lights fill the view: a direction drawn from the base, which
 * counts if it runs into a light. */
static kl_vec3 direct_by_base(const struct kl_shade_context *context, const kl_surface *surface,
                              kl_vec3 albedo, kl_sampler *sampler, struct kl_counts *counts)
{
    const kl_frame f = kl_frame_from_normal(surface->shading);
    const kl_vec3 local = kl_cosine_direction(kl_sampler_2d(sampler));
    const kl_vec3 dir = kl_frame_to_world(&f, local);
    const struct kl_bounce from = {local.z * KL_INV_PI, surface->pos, surface->geometric};
    kl_hit hit;
    kl_surface other;

    if (!(kl_dot(dir, surface->geometric) > 0.0f) || !(local.z > 0.0f)) return kl_v3_splat(0.0f);
    const kl_ray ray = kl_ray_leave(context->scene, surface, dir);
    ++counts->shadow;
    const bool found =
        kl_intersect(context->scene, &ray, kl_hash2(sampler->seed, sampler->index), &hit);
    if (found) kl_surface_at(context->scene, &ray, &hit, &other);
    if (found && (other.unlit || other.light == KL_NONE)) return kl_v3_splat(0.0f);
    return kl_v3_mul(albedo, kl_shade_emission(context, &ray, found ? &hit : NULL, &other, &from));
}

/* A hit: the surface point as the ray met it, and where records serve it. */
struct spot {
    const kl_ray *ray;
    const kl_hit *hit;
    const kl_surface *now, *at; /* at: at the reference instant */
    bool first;                 /* straight from the camera */
    float footprint;            /* [m] of a pixel on the surface */
};

/* The surface point of a hit where `scene` has it, seen from the side that was hit. */
static void carry(const kl_scene_view *scene, const kl_ray *ray, kl_hit hit, const kl_surface *now,
                  kl_surface *out)
{
    /* While the shutter is open merged things that move are instances of their own. */
    if (hit.instance >= scene->instance_count) hit.instance = 0;
    kl_surface_of_side(scene, ray, &hit, now->front, out);
}

/* The surface point of a hit at the reference instant: `now` where it does not move, else *moved.
 */
static const kl_surface *carry_back(const struct kl_shade_context *context, const kl_ray *ray,
                                    const kl_hit *hit, const kl_surface *now, kl_surface *moved)
{
    if (!kl_instance_moves(context->scene, hit->instance)) return now;
    carry(context->reference, ray, *hit, now, moved);
    return moved;
}

/* Irradiance by one short path, for samples that no record serves, at their own time. Unbiased. */
static kl_vec3 late_irradiance(const struct kl_shade_context *context, const kl_surface *surface,
                               kl_sampler *sampler, struct kl_counts *counts)
{
    const kl_frame f = kl_frame_from_normal(surface->smooth);
    const kl_vec3 dir = kl_frame_to_world(&f, kl_cosine_direction(kl_sampler_2d(sampler)));
    ++counts->late;
    if (!(kl_dot(dir, surface->geometric) > 0.0f)) return kl_v3_splat(0.0f);
    const kl_ray ray = kl_ray_leave(context->scene, surface, dir);
    const kl_gather_cell cell = kl_gather_ray(context->scene, &context->levels[1], &context->gather,
                                              surface->smooth, ray, 0, *sampler);
    ++sampler->dim;
    return kl_v3_scale(kl_v3(cell.radiance[0], cell.radiance[1], cell.radiance[2]), KL_PI);
}

/* The nearest answer for a hit within half a pixel's footprint on the surface, normals alike; NULL:
 * none. */
static const kl_answer *find_reusable(const struct kl_reuse *reuse, const kl_surface *s,
                                      float footprint)
{
    const float reach = 0.5f * footprint;
    const kl_answer *nearest = NULL;
    float least = reach * reach;

    for (int k = 0; k < KL_REUSED; ++k) {
        const struct kl_reuse_entry *r = &reuse->entries[k];
        if (!r->valid || r->object != s->object) continue;
        const kl_vec3 d = kl_v3_sub(s->pos, r->pos);
        if (kl_dot(d, d) < least && kl_dot(r->smooth, s->smooth) > 0.95f &&
            kl_dot(r->bent, s->shading) > 0.98f) {
            least = kl_dot(d, d);
            nearest = &r->answer;
        }
    }
    return nearest;
}

static void remember(struct kl_reuse *reuse, const kl_surface *s, const kl_answer *answer)
{
    reuse->entries[reuse->next] =
        (struct kl_reuse_entry){true, s->pos, s->smooth, s->shading, s->object, *answer};
    reuse->next = (reuse->next + 1u) % KL_REUSED;
}

/* What one cache knows of a surface point: the records seen from the camera, then (after a bounce)
 * those seen by gather rays. */
static kl_answer ask(const struct kl_shade_context *context, const kl_level_view *levels,
                     const kl_surface *surface, bool first, struct kl_counts *counts)
{
    ++counts->lookups;
    kl_answer a = kl_cache_query(&levels[0], &context->query, surface->pos, surface->smooth,
                                 surface->shading);
    if (!(a.weight > 0.0f) && !first) {
        a = kl_cache_query(&levels[1], &context->gather.query, surface->pos, surface->smooth,
                           surface->shading);
    }
    if (a.weight > 0.0f) ++counts->lookup_hits;
    return a;
}

/* What the frame's cache knows, and the weighted mean with those of other instants that serve the
 * same point of the surface, where it is then. */
static kl_answer ask_all(const struct kl_shade_context *context, const struct spot *spot,
                         struct kl_counts *counts)
{
    kl_answer mean = ask(context, context->levels, spot->at, spot->first, counts);
    float weights = mean.weight > 0.0f ? 1.0f : 0.0f;
    for (uint32_t i = 0; i < context->moment_count; ++i) {
        const struct kl_shade_moment *m = &context->moments[i];
        kl_surface then;
        carry(m->scene, spot->ray, *spot->hit, spot->now, &then);
        const kl_answer a = ask(context, m->levels, &then, spot->first, counts);
        if (!(a.weight > 0.0f)) continue;
        weights += m->weight;
        const float share = m->weight / weights;
        mean.irr = kl_mix3(mean.irr, a.irr, share);
        mean.weight = kl_mix(mean.weight, a.weight, share);
        mean.error = kl_mix(mean.error, a.error, share);
    }
    return mean;
}

/* Indirect irradiance at a hit: the records, else a short path. */
static kl_answer find_irradiance(const struct kl_shade_context *context, const struct spot *spot,
                                 struct kl_reuse *reuse, kl_sampler *sampler,
                                 struct kl_counts *counts, float *late)
{
    *late = 0.0f;
    const kl_answer *known = spot->first ? find_reusable(reuse, spot->at, spot->footprint) : NULL;
    if (known != NULL) {
        ++counts->reused;
        return *known;
    }
    kl_answer a = ask_all(context, spot, counts);
    if (a.weight > 0.0f) {
        if (spot->first) remember(reuse, spot->at, &a);
        return a;
    }
    *late = 1.0f;
    a.irr = late_irradiance(context, spot->now, sampler, counts);
    return a;
}

/* Indirect irradiance at a still surface that something covers at the reference instant, and not
 * when it is seen. */
static kl_answer uncovered_irradiance(const struct kl_shade_context *context,
                                      const kl_surface *surface, kl_sampler *sampler,
                                      struct kl_counts *counts, float *late)
{
    kl_answer a = {0};
    *late = 1.0f;
    a.irr = late_irradiance(context, surface, sampler, counts);
    return a;
}

/* Chance of following the specular lobe: lobes that reflect little are followed seldom. */
static float specular_chance(const kl_surface *surface, kl_vec3 wo, bool first, kl_vec3 beta)
{
    if (!kl_has_specular(surface)) return 0.0f;
    const float reflect = kl_max3(kl_specular_albedo(surface, kl_dot(surface->shading, wo)));
    return kl_fmin(1.0f, first ? 4.0f * reflect : 2.0f * reflect * kl_max3(beta));
}

/* Follow the specular lobe with the given chance; false: the path ends. */
static bool continue_specular(const struct kl_shade_context *context, const kl_surface *surface,
                              kl_vec3 wo, float chance, kl_sampler *sampler, kl_vec3 *beta,
                              struct kl_bounce *from, kl_ray *ray)
{
    kl_vec3 wi;
    float pdf;
    const float roulette = kl_sampler_1d(sampler);
    const kl_vec2 u = kl_sampler_2d(sampler);
    if (!(roulette < chance)) return false;
    const kl_vec3 f = kl_specular_sample(surface, wo, u, &wi, &pdf);
    if (kl_is_black(f) || !(kl_dot(wi, surface->geometric) > 0.0f)) return false;
    *beta = kl_v3_scale(kl_v3_mul(*beta, f), 1.0f / chance);
    /* The light sampler weighs the lobe's density times the chance to get here. */
    *from = (struct kl_bounce){pdf * chance, surface->pos, surface->geometric};
    *ray = kl_ray_leave(context->scene, surface, wi);
    return true;
}

enum { MAX_SPECULAR = 32 };

void kl_shade_cached(const struct kl_shade_context *context, kl_ray ray, kl_sampler *sampler,
                     float pixel_size, struct kl_reuse *reuse, struct kl_counts *counts,
                     struct kl_parts *parts)
{
    kl_vec3 beta = kl_v3_splat(1.0f);
    struct kl_bounce from = {0};
    float length = 0.0f;

    memset(parts, 0, sizeof *parts);
    for (int depth = 0; depth < MAX_SPECULAR; ++depth) {
        kl_hit hit;
        kl_surface surface;
        const bool first = depth == 0;
        kl_vec3 *sink = depth == 1 ? &parts->specular_direct : &parts->specular_indirect;
        const uint32_t seed = kl_hash2(sampler->seed + (uint32_t)depth, sampler->index);
        const bool found = kl_intersect(context->scene, &ray, seed, &hit);
        if (first) ++counts->primary;
        if (!first) ++counts->path;
        if (found) kl_surface_at(context->scene, &ray, &hit, &surface);
        const kl_vec3 light =
            kl_shade_emission(context, &ray, found ? &hit : NULL, &surface, &from);
        if (first) {
            parts->emission = light;
        } else {
            *sink = kl_v3_add(*sink, kl_v3_mul(beta, light));
        }
        if (!found) return;
        if (first) parts->alpha = 1.0f;
        if (!first && context->indirect == KL_INDIRECT_OFF) return;
        length += hit.t;
        const kl_vec3 wo = kl_v3_scale(ray.dir, -1.0f);
        const kl_vec3 albedo = kl_diffuse_albedo(context->scene, &surface, wo);
        const float chance = specular_chance(&surface, wo, first, beta);
        const bool enclosed = KL_NEEDS(context->scene, KL_NEED_ENCLOSING) && !kl_is_black(albedo);
        const struct kl_lobes lobes = {enclosed ? 1.0f : 0.0f, chance, false};
        struct kl_direct direct =
            kl_shade_direct(context, &surface, wo, albedo, &lobes, sampler, counts);
        if (enclosed) {
            direct.diffuse = kl_v3_add(direct.diffuse,
                                       direct_by_base(context, &surface, albedo, sampler, counts));
        }
        kl_vec3 indirect = kl_v3_splat(0.0f);
        if (context->indirect == KL_INDIRECT_CACHE && !kl_is_black(albedo)) {
            float late;
            kl_surface moved;
            const kl_surface *at = carry_back(context, &ray, &hit, &surface, &moved);
            const float slope = kl_fmax(kl_dot(wo, surface.geometric), 0.1f);
            const struct spot spot = {&ray, &hit, &surface, at, first, pixel_size * length / slope};
            const bool still = at == &surface;
            const kl_answer a =
                still && kl_swept_covers(context->swept, context->reference, at)
                    ? uncovered_irradiance(context, at, sampler, counts, &late)
                    : find_irradiance(context, &spot, reuse, sampler, counts, &late);
            indirect = kl_v3_scale(kl_v3_mul(albedo, a.irr), KL_INV_PI);
            if (first) {
                parts->irradiance = a.irr;
                parts->cache_weight = a.weight;
                parts->cache_error = a.error;
                parts->late = late;
            }
        }
        if (first) {
            parts->albedo = albedo;
            parts->diffuse_direct = direct.diffuse;
            parts->specular_direct = direct.specular;
            parts->diffuse_indirect = indirect;
        } else {
            const kl_vec3 sum = kl_v3_add(kl_v3_add(direct.diffuse, direct.specular), indirect);
            parts->specular_indirect = kl_v3_add(parts->specular_indirect, kl_v3_mul(beta, sum));
        }
        if (!(chance > 0.0f)) return;
        if (!continue_specular(context, &surface, wo, chance, sampler, &beta, &from, &ray)) return;
    }
}
