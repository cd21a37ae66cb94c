/* From a hit to what a shader wants to know: position, normals, material values. Geometry is solid
 * from both sides: all normals face the side the ray came from. */
#ifndef KL_KERNELS_SURFACE_H
#define KL_KERNELS_SURFACE_H
#include "kernels/moving.h"
#include "kernels/sampling.h"
#include "kernels/texture.h"
#include "kernels/trace.h"

typedef struct kl_surface {
    kl_vec3 pos;       /* [m], render space */
    kl_vec3 geometric; /* unit normal of the triangle */
    kl_vec3 smooth;    /* unit interpolated vertex normal: gathers and look-ups use it */
    kl_vec3 shading;   /* unit, with the normal map */
    kl_vec3 diffuse;   /* base colour times (1 - metallic): albedo before the specular layer */
    kl_vec3 f0, f90;   /* specular reflectance at normal and at grazing incidence; 0: no lobe */
    float roughness;   /* perceptual, GGX alpha is its square */
    kl_vec3 emission;  /* [nit] towards the side the ray came from */
    int unlit;         /* emission is what the eye sees, and lights nothing */
    kl_u32 object;     /* scene instance */
    kl_u32 triangle;
    kl_u32 light; /* index into lights, KL_NONE */
    int front;    /* the ray came from the front */
    float time;   /* of the ray */
} kl_surface;

typedef struct kl_uv {
    kl_vec2 set[2];
} kl_uv;

KL_FN kl_uv kl_hit_uv(const kl_scene_view *s, const KL_GLOBAL kl_triangle *t, const kl_hit *h)
{
    const KL_GLOBAL float *a = s->uvs + 4 * t->v[0];
    const KL_GLOBAL float *b = s->uvs + 4 * t->v[1];
    const KL_GLOBAL float *c = s->uvs + 4 * t->v[2];
    const float w = 1.0f - h->u - h->v;
    kl_uv uv;
    uv.set[0].x = w * a[0] + h->u * b[0] + h->v * c[0];
    uv.set[0].y = w * a[1] + h->u * b[1] + h->v * c[1];
    uv.set[1].x = w * a[2] + h->u * b[2] + h->v * c[2];
    uv.set[1].y = w * a[3] + h->u * b[3] + h->v * c[3];
    return uv;
}

/* Texel of a material's slot; white where the slot is empty. */
KL_FN kl_rgba kl_material_texel(const kl_scene_view *s, const KL_GLOBAL kl_material *m, int slot,
                                const kl_uv *uv)
{
    const KL_GLOBAL kl_texture_use *use = &m->tex[slot];
    kl_rgba one;
    one.r = 1.0f;
    one.g = 1.0f;
    one.b = 1.0f;
    one.a = 1.0f;
    if (!KL_NEEDS(s, KL_NEED_TEXTURES) || use->texture == KL_NONE) return one;
    const float u = use->uv_set ? uv->set[1].x : uv->set[0].x;
    const float v = use->uv_set ? uv->set[1].y : uv->set[0].y;
    return kl_texture_sample(s, use->texture,
                             use->matrix[0] * u + use->matrix[1] * v + use->matrix[2],
                             use->matrix[3] * u + use->matrix[4] * v + use->matrix[5]);
}

/* Base colour and alpha: factor, texture, vertex colour. */
KL_FN kl_rgba kl_base_color(const kl_scene_view *s, const KL_GLOBAL kl_triangle *t,
                            const KL_GLOBAL kl_material *m, const kl_hit *h, const kl_uv *uv)
{
    kl_rgba c = kl_material_texel(s, m, KL_TEX_BASE_COLOR, uv);
    c.r *= m->base_color[0];
    c.g *= m->base_color[1];
    c.b *= m->base_color[2];
    c.a *= m->base_color[3];
    if (KL_NEEDS(s, KL_NEED_VERTEX_COLORS)) {
        const KL_GLOBAL float *p = s->colors + 4 * t->v[0];
        const KL_GLOBAL float *q = s->colors + 4 * t->v[1];
        const KL_GLOBAL float *r = s->colors + 4 * t->v[2];
        const float w = 1.0f - h->u - h->v;
        c.r *= w * p[0] + h->u * q[0] + h->v * r[0];
        c.g *= w * p[1] + h->u * q[1] + h->v * r[1];
        c.b *= w * p[2] + h->u * q[2] + h->v * r[2];
        c.a *= w * p[3] + h->u * q[3] + h->v * r[3];
    }
    return c;
}

KL_FN kl_uv kl_hit_uv_if_needed(const kl_scene_view *s, const KL_GLOBAL kl_triangle *t,
                                const kl_hit *h)
{
    kl_uv uv;
    uv.set[0].x = 0.0f;
    uv.set[0].y = 0.0f;
    uv.set[1] = uv.set[0];
    if (KL_NEEDS(s, KL_NEED_TEXTURES)) uv = kl_hit_uv(s, t, h);
    return uv;
}

/* Opacity of a hit: 1 opaque, 0 a hole. */
KL_FN float kl_hit_alpha(const kl_scene_view *s, const kl_hit *h, float time)
{
    const KL_GLOBAL kl_triangle *t = &s->triangles[h->triangle];
    const KL_GLOBAL kl_material *m = kl_material_at(s, t->material, time);
    if ((m->flags & (KL_MAT_ALPHA_MASK | KL_MAT_ALPHA_BLEND)) == 0u) return 1.0f;
    const kl_uv uv = kl_hit_uv_if_needed(s, t, h);
    const float a = kl_base_color(s, t, m, h, &uv).a;
    if (m->flags & KL_MAT_ALPHA_MASK) return a >= m->alpha_cutoff ? 1.0f : 0.0f;
    return kl_clamp(a, 0.0f, 1.0f);
}

KL_FN kl_vec3 kl_lerp3(kl_vec3 a, kl_vec3 b, kl_vec3 c, float u, float v)
{
    return kl_v3_mad(kl_v3_mad(kl_v3_scale(a, 1.0f - u - v), u, b), v, c);
}

/* Origin for a ray that leaves `p` on the side of `n`: moved by 256 ulps, Waechter and Binder, "A
 * Fast and Robust Method for Avoiding Self-Intersection", Ray Tracing Gems 2019. Their constants
 * for places near 0, where ulps are too small, are lengths; here they are shares of the scene. */
KL_FN float kl_offset_axis(float p, float n, float scene_radius)
{
    const kl_i32 step = (kl_i32)(256.0f * n);
    const kl_i32 bits = (kl_i32)kl_as_u32(p) + (p < 0.0f ? -step : step);
    if (kl_fabs(p) < scene_radius * (1.0f / 32.0f))
        return p + n * scene_radius * (1.0f / 262144.0f);
    return kl_as_f32((kl_u32)bits);
}
KL_FN kl_vec3 kl_leave_surface(const kl_scene_view *s, kl_vec3 p, kl_vec3 n)
{
    return kl_v3(kl_offset_axis(p.x, n.x, s->scene_radius),
                 kl_offset_axis(p.y, n.y, s->scene_radius),
                 kl_offset_axis(p.z, n.z, s->scene_radius));
}

KL_FN kl_vec3 kl_normal_map(const kl_scene_view *s, const KL_GLOBAL kl_triangle *t,
                            const KL_GLOBAL kl_material *m, const kl_hit *h, const kl_uv *uv,
                            kl_vec3 n, float time)
{
    const KL_GLOBAL float *a = s->tangents + 4 * t->v[0];
    const KL_GLOBAL float *b = s->tangents + 4 * t->v[1];
    const KL_GLOBAL float *c = s->tangents + 4 * t->v[2];
    kl_vec3 raw = kl_lerp3(kl_v3_load(a), kl_v3_load(b), kl_v3_load(c), h->u, h->v);
    if (kl_instance_moves(s, h->instance) && s->moving[h->instance].deforms) {
        const kl_corners k = kl_corners_at(&s->moving[h->instance], s->step_tangents, t, time);
        raw = kl_lerp3(k.a, k.b, k.c, h->u, h->v);
    }
    const kl_vec3 flat = kl_v3_mad(raw, -kl_dot(raw, n), n);
    if (!(kl_dot(flat, flat) > 1e-12f)) return n;
    const kl_vec3 tangent = kl_normalize(flat);
    const kl_vec3 bitangent = kl_v3_scale(kl_cross(n, tangent), a[3] < 0.0f ? -1.0f : 1.0f);
    const kl_rgba p = kl_material_texel(s, m, KL_TEX_NORMAL, uv);
    const kl_vec3 bump = kl_v3((2.0f * p.r - 1.0f) * m->normal_scale,
                               (2.0f * p.g - 1.0f) * m->normal_scale, 2.0f * p.b - 1.0f);
    const kl_vec3 bent =
        kl_v3_mad(kl_v3_mad(kl_v3_scale(tangent, bump.x), bump.y, bitangent), bump.z, n);
    return kl_dot(bent, bent) > 1e-12f ? kl_normalize(bent) : n;
}

/* Metallic-roughness with KHR_materials_specular and KHR_materials_ior: fills diffuse, f0, f90,
 * roughness. glTF 2.0 appendix B.3. */
KL_FN void kl_surface_material(const kl_scene_view *s, const KL_GLOBAL kl_material *m,
                               const kl_uv *uv, kl_rgba base, kl_surface *out)
{
    const kl_vec3 color = kl_v3(base.r, base.g, base.b);
    float metallic = m->metallic;
    out->f0 = kl_v3_splat(0.0f);
    out->f90 = out->f0;
    out->roughness = m->roughness;
    if (KL_NEEDS(s, KL_NEED_TEXTURES) && m->tex[KL_TEX_METAL_ROUGH].texture != KL_NONE) {
        const kl_rgba mr = kl_material_texel(s, m, KL_TEX_METAL_ROUGH, uv);
        metallic *= mr.b;
        out->roughness *= mr.g;
    }
    out->diffuse = kl_v3_scale(color, 1.0f - metallic);
    if (!KL_NEEDS(s, KL_NEED_SPECULAR)) return;
    const kl_rgba tint = kl_material_texel(s, m, KL_TEX_SPECULAR_COLOR, uv);
    const float weight = m->specular * kl_material_texel(s, m, KL_TEX_SPECULAR, uv).a;
    const float r = m->ior > 0.0f ? (m->ior - 1.0f) / (m->ior + 1.0f) : 1.0f;
    kl_vec3 dielectric =
        kl_v3_scale(kl_v3(m->specular_color[0] * tint.r, m->specular_color[1] * tint.g,
                          m->specular_color[2] * tint.b),
                    r * r);
    dielectric = kl_v3(kl_fmin(dielectric.x, 1.0f), kl_fmin(dielectric.y, 1.0f),
                       kl_fmin(dielectric.z, 1.0f));
    out->f0 = kl_v3_mad(kl_v3_scale(dielectric, weight * (1.0f - metallic)), metallic, color);
    out->f90 = kl_v3_splat(weight * (1.0f - metallic) + metallic);
}

/* `motion`: a constant, so that scenes without it pay nothing. */
KL_INLINE void kl_surface_find(const kl_scene_view *s, const kl_ray *ray, const kl_hit *h,
                               int motion, kl_surface *out)
{
    const KL_GLOBAL kl_triangle *t = &s->triangles[h->triangle];
    const KL_GLOBAL kl_material *m =
        motion ? kl_material_at(s, t->material, ray->time) : &s->materials[t->material];
    const int moves = motion && kl_instance_moves(s, h->instance);
    kl_corners p = kl_corners_of(s->positions, t);
    kl_corners n = kl_corners_of(s->normals, t);
    if (moves && s->moving[h->instance].deforms) {
        p = kl_corners_at(&s->moving[h->instance], s->step_positions, t, ray->time);
        n = kl_corners_at(&s->moving[h->instance], s->step_normals, t, ray->time);
    }
    const kl_uv uv = kl_hit_uv_if_needed(s, t, h);
    const kl_rgba base = kl_base_color(s, t, m, h, &uv);
    kl_vec3 ns = kl_lerp3(n.a, n.b, n.c, h->u, h->v);
    kl_vec3 ng = kl_cross(kl_v3_sub(p.b, p.a), kl_v3_sub(p.c, p.a));
    kl_vec3 bent = ns;

    if (KL_NEEDS(s, KL_NEED_NORMAL_MAPS) && m->tex[KL_TEX_NORMAL].texture != KL_NONE) {
        bent = kl_normal_map(s, t, m, h, &uv, kl_normalize(ns), ray->time);
    }
    out->pos = kl_lerp3(p.a, p.b, p.c, h->u, h->v);
    out->object = t->object;
    out->time = ray->time;
    if (moves && !s->moving[h->instance].deforms) {
        const kl_map x = kl_map_at(s, &s->moving[h->instance], ray->time);
        out->pos = kl_map_point(&x, out->pos);
        ng = kl_map_normal(&x, ng);
        ns = kl_map_normal(&x, ns);
        bent = kl_map_normal(&x, bent);
        out->object = s->instances[h->instance].object;
    } else if (KL_NEEDS(s, KL_NEED_INSTANCES) && h->instance != 0u) {
        const KL_GLOBAL kl_instance *i = &s->instances[h->instance];
        out->pos = kl_affine_point(i->render_from_object, out->pos);
        ng = kl_affine_normal(i->object_from_render, ng);
        ns = kl_affine_normal(i->object_from_render, ns);
        bent = kl_affine_normal(i->object_from_render, bent);
        out->object = i->object;
    }
    ng = kl_normalize(ng);
    ns = kl_normalize(ns);
    bent = kl_normalize(bent);
    /* The inverse transpose keeps each side's image on its side, also where the map mirrors: the
     * front is what glTF 3.7.4 calls it. */
    const int front = kl_dot(ng, ray->dir) < 0.0f;
    out->front = front;
    if (!front) ng = kl_v3_scale(ng, -1.0f);
    if (kl_dot(ns, ng) < 0.0f) {
        ns = kl_v3_scale(ns, -1.0f);
        bent = kl_v3_scale(bent, -1.0f);
    }
    out->geometric = ng;
    out->smooth = ns;
    out->shading = kl_dot(bent, ng) > 0.0f ? bent : ns;
    out->triangle = h->triangle;
    out->light = t->light;
    out->unlit = (m->flags & KL_MAT_UNLIT) != 0u;
    kl_surface_material(s, m, &uv, base, out);
    out->emission = kl_v3_splat(0.0f);
    if (out->unlit) {
        out->emission = kl_v3(base.r, base.g, base.b);
        out->diffuse = kl_v3_splat(0.0f);
        out->f0 = out->diffuse;
        out->f90 = out->diffuse;
    } else if (front || (m->flags & KL_MAT_DOUBLE_SIDED)) {
        out->emission = kl_v3(m->emission[0], m->emission[1], m->emission[2]);
        if (!kl_is_black(out->emission)) {
            const kl_rgba e = kl_material_texel(s, m, KL_TEX_EMISSIVE, &uv);
            out->emission = kl_v3_mul(out->emission, kl_v3(e.r, e.g, e.b));
        }
    }
}

KL_APART void kl_surface_still(const kl_scene_view *s, const kl_ray *ray, const kl_hit *h,
                               kl_surface *out)
{
    kl_surface_find(s, ray, h, 0, out);
}
KL_APART void kl_surface_moving(const kl_scene_view *s, const kl_ray *ray, const kl_hit *h,
                                kl_surface *out)
{
    kl_surface_find(s, ray, h, 1, out);
}
/* Everything about the hit of `ray`. */
KL_FN void kl_surface_at(const kl_scene_view *s, const kl_ray *ray, const kl_hit *h,
                         kl_surface *out)
{
    if (KL_NEEDS(s, KL_NEED_MOTION)) {
        kl_surface_moving(s, ray, h, out);
    } else {
        kl_surface_still(s, ray, h, out);
    }
}

/* As kl_surface_at, seen from the front or the back, whichever way the ray came: for a hit that
 * was made at another time. */
KL_FN void kl_surface_of_side(const kl_scene_view *s, const kl_ray *ray, const kl_hit *h, int front,
                              kl_surface *out)
{
    kl_surface_at(s, ray, h, out);
    if (out->front == front) return;
    out->front = front;
    out->geometric = kl_v3_scale(out->geometric, -1.0f);
    out->smooth = kl_v3_scale(out->smooth, -1.0f);
    out->shading = kl_v3_scale(out->shading, -1.0f);
}

/* Ray from a surface point, at the surface's time. */
KL_FN kl_ray kl_ray_leave(const kl_scene_view *scene, const kl_surface *s, kl_vec3 dir)
{
    kl_ray r = kl_ray_make(kl_leave_surface(scene, s->pos, s->geometric), dir, KL_INF);
    r.time = s->time;
    return r;
}

#define KL_MAX_LAYERS 64 /* transparent surfaces a ray may pass */

/* Nearest opaque hit; partly transparent surfaces are taken with the probability of their alpha,
 * decided by `seed` (Enderton et al., "Stochastic Transparency", 2010). hit->t counts from the
 * original origin. */
KL_FN int kl_intersect(const kl_scene_view *s, const kl_ray *ray, kl_u32 seed, kl_hit *hit)
{
    kl_ray r = *ray;
    if (!KL_NEEDS(s, KL_NEED_ALPHA)) return kl_trace_closest(s, &r, hit);
    for (int layer = 0; layer < KL_MAX_LAYERS; ++layer) {
        if (!kl_trace_closest(s, &r, hit)) return 0;
        const float alpha = kl_hit_alpha(s, hit, r.time);
        if (alpha >= 1.0f) return 1;
        if (alpha > 0.0f &&
            kl_unit_float(kl_hash2(seed, hit->triangle * 64u + (kl_u32)layer)) < alpha) {
            return 1;
        }
        r.tmin = hit->t * (1.0f + 4e-6f) + 1e-6f * s->scene_radius;
    }
    return 0;
}

/* Share of light that gets along the ray: 0 or 1, or between where surfaces blend. */
KL_FN float kl_transmittance(const kl_scene_view *s, const kl_ray *ray)
{
    kl_ray r = *ray;
    float through = 1.0f;
    if (!KL_NEEDS(s, KL_NEED_ALPHA)) return kl_trace_any(s, &r) ? 0.0f : 1.0f;
    for (int layer = 0; layer < KL_MAX_LAYERS; ++layer) {
        kl_hit hit;
        if (!kl_trace_closest(s, &r, &hit)) return through;
        through *= 1.0f - kl_hit_alpha(s, &hit, r.time);
        if (through < 1e-4f) return 0.0f;
        r.tmin = hit.t * (1.0f + 4e-6f) + 1e-6f * s->scene_radius;
    }
    return 0.0f;
}

#endif
