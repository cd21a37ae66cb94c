/* Sampling lights. Every light belongs to the light sampler alone: rays that hit an
 * emitter by chance weigh it against that (multiple importance sampling) or leave it out. */
#ifndef KL_KERNELS_LIGHTS_H
#define KL_KERNELS_LIGHTS_H
#include "kernels/light_choice.h"

typedef struct kl_light_sample {
    kl_vec3 radiance; /* what arrives if nothing blocks, divided by nothing: [nit], or for points
                       * and directions the irradiance at normal incidence [lx] */
    kl_vec3 wi;       /* unit, towards the light */
    kl_vec3 facing;   /* unit normal of the light where it was sampled, towards the point; or 0 */
    float distance;   /* [m], KL_INF: infinitely far */
    float pdf;        /* density over solid angle, choice of the light included; delta: of choice */
    int delta;        /* no other strategy can find it */
    kl_u32 light;     /* index into lights */
} kl_light_sample;

/* --- The environment: lat-long, row 0 at +Y, centre column at -Z, +X to the right of it. --- */

KL_FN kl_vec2 kl_env_uv(kl_vec3 d)
{
    kl_vec2 uv;
    uv.x = 0.5f + kl_atan2(d.x, -d.z) * (0.5f * KL_INV_PI);
    uv.y = kl_acos(kl_clamp(d.y, -1.0f, 1.0f)) * KL_INV_PI;
    return uv;
}
KL_FN kl_u32 kl_env_texel_at(const kl_scene_view *s, kl_vec2 uv)
{
    const kl_u32 x = (kl_u32)kl_clamp(uv.x * (float)s->env.width, 0.0f, (float)(s->env.width - 1u));
    const kl_u32 y =
        (kl_u32)kl_clamp(uv.y * (float)s->env.height, 0.0f, (float)(s->env.height - 1u));
    return y * s->env.width + x;
}
/* Radiance from direction d; piecewise constant, so that the sampling density matches exactly. */
KL_FN kl_vec3 kl_env_radiance(const kl_scene_view *s, kl_vec3 d)
{
    if (!KL_NEEDS(s, KL_NEED_ENVIRONMENT)) return kl_v3_splat(0.0f);
    const kl_vec3 c = kl_v3_load(s->env_texels + 3 * (size_t)kl_env_texel_at(s, kl_env_uv(d)));
    return kl_v3_scale(c, s->env.scale);
}
/* The same between the texels' middles, for eyes: what the camera sees of the sky has no steps. */
KL_FN kl_vec3 kl_env_radiance_smooth(const kl_scene_view *s, kl_vec3 d)
{
    if (!KL_NEEDS(s, KL_NEED_ENVIRONMENT)) return kl_v3_splat(0.0f);
    const kl_vec2 uv = kl_env_uv(d);
    const kl_u32 w = s->env.width;
    const float last = (float)(s->env.height - 1u);
    const float x = kl_clamp(uv.x, 0.0f, 1.0f) * (float)w + (float)w - 0.5f;
    const float y = kl_clamp(uv.y * (float)s->env.height - 0.5f, 0.0f, last);
    const kl_u32 x0 = (kl_u32)x % w;
    const kl_u32 x1 = (x0 + 1u) % w;
    const kl_u32 y0 = (kl_u32)y;
    const kl_u32 y1 = y0 + 1u < s->env.height ? y0 + 1u : y0;
    const float ax = x - kl_floor(x);
    const float ay = y - kl_floor(y);
    const kl_vec3 top =
        kl_v3_mad(kl_v3_scale(kl_v3_load(s->env_texels + 3 * (size_t)(y0 * w + x0)), 1.0f - ax), ax,
                  kl_v3_load(s->env_texels + 3 * (size_t)(y0 * w + x1)));
    const kl_vec3 bottom =
        kl_v3_mad(kl_v3_scale(kl_v3_load(s->env_texels + 3 * (size_t)(y1 * w + x0)), 1.0f - ax), ax,
                  kl_v3_load(s->env_texels + 3 * (size_t)(y1 * w + x1)));
    return kl_v3_scale(kl_v3_mad(kl_v3_scale(top, 1.0f - ay), ay, bottom), s->env.scale);
}
/* Largest i in [0, n) with cdf[i] <= u. */
KL_FN kl_u32 kl_cdf_find(const KL_GLOBAL float *cdf, kl_u32 n, float u)
{
    kl_u32 lo = 0;
    kl_u32 hi = n;
    while (hi - lo > 1u) {
        const kl_u32 mid = (lo + hi) / 2u;
        if (cdf[mid] <= u) {
            lo = mid;
        } else {
            hi = mid;
        }
    }
    return lo;
}
/* Density over solid angle of kl_env_sample, without the choice of the light. */
KL_FN float kl_env_pdf(const kl_scene_view *s, kl_vec3 d)
{
    const kl_u32 texel = kl_env_texel_at(s, kl_env_uv(d));
    const kl_u32 y = texel / s->env.width;
    const kl_u32 x = texel - y * s->env.width;
    const KL_GLOBAL float *row = s->env_columns + (size_t)y * (s->env.width + 1u);
    const float p = (s->env_rows[y + 1] - s->env_rows[y]) * (row[x + 1] - row[x]);
    const float sine = kl_sqrt(kl_fmax(1e-12f, 1.0f - d.y * d.y));
    return p * (float)s->env.width * (float)s->env.height / (2.0f * KL_PI * KL_PI * sine);
}
KL_FN kl_vec3 kl_env_sample(const kl_scene_view *s, kl_vec2 u)
{
    const kl_u32 y = kl_cdf_find(s->env_rows, s->env.height, u.y);
    const KL_GLOBAL float *row = s->env_columns + (size_t)y * (s->env.width + 1u);
    const kl_u32 x = kl_cdf_find(row, s->env.width, u.x);
    const float wy = s->env_rows[y + 1] - s->env_rows[y];
    const float wx = row[x + 1] - row[x];
    const float fy = wy > 0.0f ? (u.y - s->env_rows[y]) / wy : 0.5f;
    const float fx = wx > 0.0f ? (u.x - row[x]) / wx : 0.5f;
    const float theta = KL_PI * ((float)y + kl_clamp(fy, 0.0f, 0.9999f)) / (float)s->env.height;
    const float phi =
        2.0f * KL_PI * (((float)x + kl_clamp(fx, 0.0f, 0.9999f)) / (float)s->env.width - 0.5f);
    const float sine = kl_sin(theta);
    return kl_v3(sine * kl_sin(phi), kl_cos(theta), -sine * kl_cos(phi));
}

/* --- Samples. --- */

KL_FN kl_vec3 kl_light_color(const KL_GLOBAL kl_light *l)
{
    return kl_v3_load(l->color);
}

/* Emission of a textured triangle at barycentrics (u, v). */
KL_FN kl_vec3 kl_triangle_emission(const kl_scene_view *s, const KL_GLOBAL kl_light *l, float u,
                                   float v, float time)
{
    if (!l->textured && !KL_NEEDS(s, KL_NEED_MOTION)) return kl_light_color(l);
    const KL_GLOBAL kl_triangle *t = &s->triangles[l->triangle];
    const KL_GLOBAL kl_material *m = kl_material_at(s, t->material, time);
    kl_hit h;
    h.t = 0.0f;
    h.u = u;
    h.v = v;
    h.triangle = l->triangle;
    h.instance = 0;
    const kl_uv uv = kl_hit_uv_if_needed(s, t, &h);
    const kl_rgba e = kl_material_texel(s, m, KL_TEX_EMISSIVE, &uv);
    return kl_v3(m->emission[0] * e.r, m->emission[1] * e.g, m->emission[2] * e.b);
}

/* Triangles that look larger than this are sampled uniformly over their solid angle, which keeps
 * close lights free of the 1 / d^2 spikes; smaller ones over their area. */
#define KL_SPHERICAL_FROM 0.02f

/* Direction uniformly over a spherical triangle: Arvo, "Stratified Sampling of Spherical
 * Triangles", SIGGRAPH 1995. */
KL_FN kl_vec3 kl_spherical_sample(const kl_spherical *s, kl_vec2 u)
{
    const kl_vec3 n_ab = kl_normalize(kl_cross(s->a, s->b));
    const kl_vec3 n_ca = kl_normalize(kl_cross(s->c, s->a));
    const float cos_alpha = kl_clamp(-kl_dot(n_ab, n_ca), -1.0f, 1.0f);
    const float sin_alpha = kl_safe_sin(cos_alpha);
    const float cos_side = kl_dot(s->a, s->b);
    const float angle = u.x * s->solid_angle - kl_acos(cos_alpha);
    const float sn = kl_sin(angle);
    const float cs = kl_cos(angle);
    const float p = cs - cos_alpha;
    const float q = sn + sin_alpha * cos_side;
    const float below = (q * sn + p * cs) * sin_alpha;
    const float k = below != 0.0f ? ((q * cs - p * sn) * cos_alpha - q) / below : 1.0f;
    const float cos_b = kl_clamp(k, -1.0f, 1.0f);
    const kl_vec3 to_c = kl_normalize(kl_v3_mad(s->c, -kl_dot(s->c, s->a), s->a));
    const kl_vec3 on_side = kl_v3_mad(kl_v3_scale(s->a, cos_b), kl_safe_sin(cos_b), to_c);
    const float z = 1.0f - u.y * (1.0f - kl_dot(on_side, s->b));
    const kl_vec3 up = kl_normalize(kl_v3_mad(on_side, -kl_dot(on_side, s->b), s->b));
    return kl_v3_mad(kl_v3_scale(s->b, z), kl_safe_sin(z), up);
}

/* Heitz, "A Low-Distortion Map Between Triangle and Square", 2019: keeps strata whole. */
KL_FN kl_vec2 kl_triangle_map(kl_vec2 u)
{
    kl_vec2 b;
    if (u.x < u.y) {
        b.x = 0.5f * u.x;
        b.y = u.y - b.x;
    } else {
        b.y = 0.5f * u.y;
        b.x = u.x - b.y;
    }
    return b;
}

/* Barycentrics of the point where direction d from p meets the triangle's plane, kept inside. */
KL_FN kl_vec2 kl_triangle_meet(kl_vec3 from_v0, kl_vec3 e1, kl_vec3 e2, kl_vec3 d)
{
    kl_vec2 b;
    const kl_vec3 h = kl_cross(d, e2);
    const float det = kl_dot(e1, h);
    const float inverse = det != 0.0f ? 1.0f / det : 0.0f;
    b.x = kl_clamp(kl_dot(from_v0, h) * inverse, 0.0f, 1.0f);
    b.y = kl_clamp(kl_dot(d, kl_cross(from_v0, e1)) * inverse, 0.0f, 1.0f - b.x);
    return b;
}

/* Density over solid angle of a triangle's sample that lies along unit w at distance^2 d2. */
KL_FN float kl_triangle_pdf(const kl_light_shape *l, const kl_spherical *s, float cosine, float d2)
{
    if (s->solid_angle > KL_SPHERICAL_FROM) return 1.0f / s->solid_angle;
    return cosine > 1e-6f ? d2 / (cosine * l->area) : 0.0f;
}

KL_FN int kl_light_sample_triangle(const kl_scene_view *s, kl_u32 light, kl_vec3 p, float time,
                                   kl_vec2 u, kl_light_sample *out)
{
    const KL_GLOBAL kl_light *l = &s->lights[light];
    const kl_light_shape shape = kl_light_shape_at(s, light, time);
    const kl_vec3 e1 = shape.edge1;
    const kl_vec3 e2 = shape.edge2;
    const kl_spherical sphere = kl_light_spherical(&shape, p);
    kl_vec2 b = kl_triangle_map(u);
    if (sphere.solid_angle > KL_SPHERICAL_FROM) {
        b = kl_triangle_meet(kl_v3_sub(p, shape.pos), e1, e2, kl_spherical_sample(&sphere, u));
    }
    const kl_vec3 y = kl_v3_mad(kl_v3_mad(shape.pos, b.x, e1), b.y, e2);
    const kl_vec3 d = kl_v3_sub(y, p);
    const float d2 = kl_dot(d, d);
    if (!(d2 > 0.0f)) return 0;
    out->distance = kl_sqrt(d2);
    out->wi = kl_v3_scale(d, 1.0f / out->distance);
    const kl_vec3 normal = kl_normalize(kl_cross(e1, e2));
    float cosine = -kl_dot(normal, out->wi);
    out->facing = kl_v3_scale(normal, cosine < 0.0f ? -1.0f : 1.0f);
    if (l->two_sided) cosine = kl_fabs(cosine);
    if (!(cosine > 1e-6f)) return 0;
    out->radiance = kl_triangle_emission(s, l, b.x, b.y, time);
    out->pdf = kl_triangle_pdf(&shape, &sphere, cosine, d2);
    out->delta = 0;
    return out->pdf > 0.0f;
}

KL_FN int kl_light_sample_punctual(const kl_punctual *l, kl_vec3 p, kl_light_sample *out)
{
    out->delta = 1;
    out->pdf = 1.0f;
    out->radiance = l->color;
    if (l->type == KL_LIGHT_DIRECTIONAL) {
        out->wi = kl_v3_scale(l->dir, -1.0f);
        out->distance = KL_INF;
        return 1;
    }
    const kl_vec3 d = kl_v3_sub(l->pos, p);
    const float d2 = kl_dot(d, d);
    if (!(d2 > 0.0f)) return 0;
    out->distance = kl_sqrt(d2);
    out->wi = kl_v3_scale(d, 1.0f / out->distance);
    float scale = 1.0f / d2;
    if (l->range > 0.0f) { /* KHR_lights_punctual's recommended window */
        const float q = out->distance / l->range;
        scale *= kl_clamp(1.0f - q * q * q * q, 0.0f, 1.0f);
    }
    if (l->type == KL_LIGHT_SPOT) {
        const float c = -kl_dot(out->wi, l->dir);
        const float a = kl_clamp((c - l->cone_cos) * l->cone_scale, 0.0f, 1.0f);
        scale *= a * a;
    }
    out->radiance = kl_v3_scale(out->radiance, scale);
    return scale > 0.0f;
}

/* One sample of the light that reaches p at a time, where the surface has geometric normal n. 0:
 * nothing. */
KL_FN int kl_light_sample_one(const kl_scene_view *s, kl_vec3 p, kl_vec3 n, float time,
                              float choice, kl_vec2 u, kl_light_sample *out)
{
    float prob;
    const kl_u32 i = kl_light_choose(s, p, n, choice, &prob);
    if (i == KL_NONE || !(prob > 0.0f)) return 0;
    const KL_GLOBAL kl_light *l = &s->lights[i];
    int ok = 0;
    out->facing = kl_v3_splat(0.0f);
    if (l->type == KL_LIGHT_TRIANGLE) {
        ok = kl_light_sample_triangle(s, i, p, time, u, out);
    } else if (l->type == KL_LIGHT_ENVIRONMENT) {
        out->wi = kl_env_sample(s, u);
        out->distance = KL_INF;
        out->radiance = kl_env_radiance(s, out->wi);
        out->pdf = kl_env_pdf(s, out->wi);
        out->delta = 0;
        ok = out->pdf > 0.0f;
    } else {
        const kl_punctual punctual = kl_punctual_at(s, i, time);
        ok = kl_light_sample_punctual(&punctual, p, out);
    }
    out->pdf *= prob;
    out->light = i;
    return ok && !kl_is_black(out->radiance);
}

/* Density with which kl_light_sample_one, asked at p with normal n at a time, finds the emitter
 * that a ray from p along `dir` hit at distance t; for the environment pass light = env.light. */
KL_FN float kl_light_pdf(const kl_scene_view *s, kl_u32 light, kl_vec3 p, kl_vec3 n, float time,
                         kl_vec3 dir, float t)
{
    const KL_GLOBAL kl_light *l = &s->lights[light];
    const float prob = kl_light_probability(s, light, p, n);
    if (l->type == KL_LIGHT_ENVIRONMENT) return prob * kl_env_pdf(s, dir);
    const kl_light_shape shape = kl_light_shape_at(s, light, time);
    const kl_vec3 ln = kl_normalize(kl_cross(shape.edge1, shape.edge2));
    const kl_spherical sphere = kl_light_spherical(&shape, p);
    return prob * kl_triangle_pdf(&shape, &sphere, kl_fabs(kl_dot(ln, dir)), t * t);
}

/* Ray from a surface point to a light sample, both ends kept off the surfaces. */
KL_FN kl_ray kl_shadow_ray(const kl_scene_view *scene, const kl_surface *s,
                           const kl_light_sample *l)
{
    const float side = kl_dot(s->geometric, l->wi) >= 0.0f ? 1.0f : -1.0f;
    const kl_vec3 o = kl_leave_surface(scene, s->pos, kl_v3_scale(s->geometric, side));
    kl_ray ray = kl_ray_make(o, l->wi, KL_INF);
    ray.time = s->time;
    if (l->distance >= KL_INF) return ray;
    const kl_vec3 short_of_it = kl_v3_mad(s->pos, l->distance * (1.0f - 1e-4f), l->wi);
    const kl_vec3 target = kl_leave_surface(scene, short_of_it, l->facing);
    const kl_vec3 d = kl_v3_sub(target, o);
    const float t = kl_length(d);
    ray.dir = t > 0.0f ? kl_v3_scale(d, 1.0f / t) : l->wi;
    ray.tmax = t;
    return ray;
}

#endif
