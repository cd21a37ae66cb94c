#include "src/render/shade_impl.h"

#include <string.h>

/* Chosen by noise times time: docs/decisions/0019. */
enum { MAX_DEPTH = 4096, ROULETTE_DEPTH = 3, LIT_TWICE = 2 };
static const float roulette_scale = 8.0f;

/* Probability of continuing with the base; the lobe has the rest. */
static float diffuse_share(const kl_surface *s, kl_vec3 wo, kl_vec3 albedo)
{
    const float d = kl_max3(albedo);
    if (!kl_has_specular(s)) return d > 0.0f ? 1.0f : 0.0f;
    const float l = kl_max3(kl_specular_albedo(s, kl_dot(s->shading, wo)));
    return d + l > 0.0f ? kl_clamp(d / (d + l), d > 0.0f ? 0.1f : 0.0f, l > 0.0f ? 0.9f : 1.0f)
                        : 0.0f;
}

/* Draw the next direction from base and lobe together: balance of both in one density. */
static bool next_direction(const kl_surface *s, kl_vec3 wo, kl_vec3 albedo, float share,
                           kl_sampler *sampler, kl_vec3 *wi, float *pdf, kl_vec3 *weight,
                           bool *diffuse)
{
    const float choice = kl_sampler_1d(sampler);
    const kl_vec2 u = kl_sampler_2d(sampler);
    float lobe_pdf = 0.0f;
    kl_vec3 lobe = kl_v3_splat(0.0f);

    *diffuse = choice < share;
    if (*diffuse) {
        const kl_frame f = kl_frame_from_normal(s->shading);
        *wi = kl_frame_to_world(&f, kl_cosine_direction(u));
    } else if (kl_is_black(kl_specular_sample(s, wo, u, wi, pdf))) {
        return false;
    }
    const float cosine = kl_dot(s->shading, *wi);
    if (!(cosine > 0.0f) || !(kl_dot(s->geometric, *wi) > 0.0f)) return false;
    if (kl_has_specular(s)) lobe = kl_specular_eval(s, wo, *wi, &lobe_pdf);
    *pdf = share * cosine * KL_INV_PI + (1.0f - share) * lobe_pdf;
    if (!(*pdf > 0.0f)) return false;
    const kl_vec3 value = kl_v3_mad(lobe, KL_INV_PI * cosine, albedo);
    *weight = kl_v3_scale(value, 1.0f / *pdf);
    return true;
}

static void add_light(struct kl_parts *parts, int depth, bool diffuse, kl_vec3 light)
{
    kl_vec3 *sink = &parts->emission;
    if (depth == 1) sink = diffuse ? &parts->diffuse_direct : &parts->specular_direct;
    if (depth > 1) sink = diffuse ? &parts->diffuse_indirect : &parts->specular_indirect;
    *sink = kl_v3_add(*sink, light);
}

/* Mean of two samples that share out the lights: points 2i and 2i + 1 of a sequence. */
static struct kl_direct direct_twice(const struct kl_shade_context *context,
                                     const kl_surface *surface, kl_vec3 wo, kl_vec3 albedo,
                                     const struct kl_lobes *lobes, kl_sampler *sampler,
                                     struct kl_counts *counts)
{
    struct kl_direct sum = {0};

    for (uint32_t k = 0; k < 2; ++k) {
        kl_sampler half = *sampler;
        half.index = 2 * sampler->index + k;
        const struct kl_direct one =
            kl_shade_direct(context, surface, wo, albedo, lobes, &half, counts);
        sum.diffuse = kl_v3_mad(sum.diffuse, 0.5f, one.diffuse);
        sum.specular = kl_v3_mad(sum.specular, 0.5f, one.specular);
    }
    sampler->dim += 2; /* drawn by each */
    return sum;
}

void kl_shade_path(const struct kl_shade_context *context, kl_ray ray, kl_sampler *sampler,
                   struct kl_counts *counts, struct kl_parts *parts)
{
    kl_vec3 beta = kl_v3_splat(1.0f);
    struct kl_bounce from = {0};
    bool first_diffuse = true; /* lobe taken at the first hit */

    memset(parts, 0, sizeof *parts);
    for (int depth = 0; depth < MAX_DEPTH; ++depth) {
        kl_hit hit;
        kl_surface surface;
        const uint32_t seed = kl_hash2(sampler->seed + (uint32_t)depth, sampler->index);
        const bool found = kl_intersect(context->scene, &ray, seed, &hit);
        if (depth == 0) ++counts->primary;
        if (depth > 0) ++counts->path;
        if (found) kl_surface_at(context->scene, &ray, &hit, &surface);
        const kl_vec3 light =
            kl_shade_emission(context, &ray, found ? &hit : NULL, &surface, &from);
        if (!found || !surface.unlit || depth == 0) {
            add_light(parts, depth, first_diffuse, kl_v3_mul(beta, light));
        }
        if (!found) break;
        const kl_vec3 wo = kl_v3_scale(ray.dir, -1.0f);
        const kl_vec3 albedo = kl_diffuse_albedo(context->scene, &surface, wo);
        const float share = diffuse_share(&surface, wo, albedo);
        const struct kl_lobes lobes = {share, 1.0f - share, true};
        const struct kl_direct direct =
            depth < LIT_TWICE
                ? direct_twice(context, &surface, wo, albedo, &lobes, sampler, counts)
                : kl_shade_direct(context, &surface, wo, albedo, &lobes, sampler, counts);
        if (depth == 0) {
            parts->alpha = 1.0f;
            parts->albedo = albedo;
            parts->diffuse_direct = direct.diffuse;
            parts->specular_direct = direct.specular;
        } else {
            const kl_vec3 sum = kl_v3_mul(beta, kl_v3_add(direct.diffuse, direct.specular));
            add_light(parts, depth + 1, first_diffuse, sum);
        }
        if (kl_is_black(albedo) && !kl_has_specular(&surface)) break;
        kl_vec3 wi;
        kl_vec3 weight;
        float pdf = 0.0f;
        bool diffuse;
        if (!next_direction(&surface, wo, albedo, share, sampler, &wi, &pdf, &weight, &diffuse)) {
            break;
        }
        if (depth == 0) first_diffuse = diffuse;
        beta = kl_v3_mul(beta, weight);
        if (depth + 1 >= ROULETTE_DEPTH) {
            const float go_on = kl_fmin(0.95f, roulette_scale * kl_max3(beta));
            if (!(kl_sampler_1d(sampler) < go_on)) break;
            beta = kl_v3_scale(beta, 1.0f / go_on);
        }
        from = (struct kl_bounce){pdf, surface.pos, surface.geometric};
        ray = kl_ray_leave(context->scene, &surface, wi);
    }
    if (kl_max3(parts->albedo) > 1e-4f) { /* what irradiance this sample amounts to */
        const kl_vec3 e = parts->diffuse_indirect;
        parts->irradiance =
            kl_v3(e.x / kl_fmax(parts->albedo.x, 1e-4f), e.y / kl_fmax(parts->albedo.y, 1e-4f),
                  e.z / kl_fmax(parts->albedo.z, 1e-4f));
        parts->irradiance = kl_v3_scale(parts->irradiance, KL_PI);
    }
}
