/* Reflection: a Lambert base under one GGX lobe. The base is scaled by what the lobe leaves over in
 * the viewing direction, so that base and lobe together never gain energy and the base stays a
 * plain albedo / pi, which is what an irradiance cache can serve. */
#ifndef KL_KERNELS_BSDF_H
#define KL_KERNELS_BSDF_H
#include "kernels/surface.h"

#define KL_MIN_ALPHA 1e-3f /* smoother surfaces are mirrors to this renderer */

/* Directional albedo of the GGX lobe: fit of B. Karis, "Physically Based Shading on Mobile", 2014. */
KL_FN kl_vec3 kl_specular_albedo(const kl_surface *s, float cos_view)
{
    const float c = kl_clamp(cos_view, 0.0f, 1.0f);
    const float rx = 1.0f - s->roughness;
    const float ry = 0.0425f - 0.0275f * s->roughness;
    const float rz = 1.04f - 0.572f * s->roughness;
    const float rw = 0.022f * s->roughness - 0.04f;
    const float a = kl_fmin(rx * rx, kl_exp2(-9.28f * c)) * rx + ry;
    const float scale = -1.04f * a + rz;
    const float bias = kl_fmax(0.0f, 1.04f * a + rw);
    return kl_v3(kl_clamp(s->f0.x * scale + s->f90.x * bias, 0.0f, 1.0f),
                 kl_clamp(s->f0.y * scale + s->f90.y * bias, 0.0f, 1.0f),
                 kl_clamp(s->f0.z * scale + s->f90.z * bias, 0.0f, 1.0f));
}
KL_FN int kl_has_specular(const kl_surface *s)
{
    return s->f90.x > 0.0f || s->f0.x > 0.0f || s->f0.y > 0.0f || s->f0.z > 0.0f;
}

/* Albedo of the base as seen from wo (unit, away from the surface). */
KL_FN kl_vec3 kl_diffuse_albedo(const kl_scene_view *scene, const kl_surface *s, kl_vec3 wo)
{
    if (!KL_NEEDS(scene, KL_NEED_SPECULAR) || !kl_has_specular(s)) return s->diffuse;
    const float left = 1.0f - kl_max3(kl_specular_albedo(s, kl_dot(s->shading, wo)));
    return kl_v3_scale(s->diffuse, left);
}

/* All that the surface reflects, taken as Lambertian: what gather rays see of it. Glossy lobes
 * would make gradients wrong and splotches likely; their energy is kept, their direction is not. */
KL_FN kl_vec3 kl_gather_albedo(const kl_scene_view *scene, const kl_surface *s, kl_vec3 wo)
{
    if (!KL_NEEDS(scene, KL_NEED_SPECULAR) || !kl_has_specular(s)) return s->diffuse;
    const kl_vec3 lobe = kl_specular_albedo(s, kl_dot(s->shading, wo));
    return kl_v3_mad(lobe, 1.0f - kl_max3(lobe), s->diffuse);
}

KL_FN float kl_ggx_alpha(const kl_surface *s)
{
    return kl_fmax(s->roughness * s->roughness, KL_MIN_ALPHA);
}
/* Smith's G1 for GGX (Heitz 2014), isotropic; c = cosine to the normal, > 0. */
KL_FN float kl_ggx_g1(float c, float alpha)
{
    const float t2 = kl_fmax(0.0f, 1.0f - c * c) / (c * c);
    return 2.0f / (1.0f + kl_sqrt(1.0f + alpha * alpha * t2));
}
KL_FN float kl_ggx_d(float ch, float alpha)
{
    const float a2 = alpha * alpha;
    const float k = ch * ch * (a2 - 1.0f) + 1.0f;
    return a2 / (KL_PI * k * k);
}

/* f_s * cos(wi) of the lobe and the density with which kl_specular_sample finds wi; 0 and 0 where
 * either direction is below the surface. */
KL_FN kl_vec3 kl_specular_eval(const kl_surface *s, kl_vec3 wo, kl_vec3 wi, float *pdf)
{
    const float co = kl_dot(s->shading, wo);
    const float ci = kl_dot(s->shading, wi);
    *pdf = 0.0f;
    if (co <= 1e-6f || ci <= 1e-6f || kl_dot(s->geometric, wi) <= 0.0f) return kl_v3_splat(0.0f);
    const kl_vec3 h = kl_normalize(kl_v3_add(wo, wi));
    const float alpha = kl_ggx_alpha(s);
    const float ch = kl_clamp(kl_dot(s->shading, h), 0.0f, 1.0f);
    const float oh = kl_fmax(kl_dot(wo, h), 1e-6f);
    const float d = kl_ggx_d(ch, alpha);
    const float g1o = kl_ggx_g1(co, alpha);
    const float m = 1.0f - oh;
    const float m5 = m * m * m * m * m;
    const kl_vec3 f = kl_v3_mad(kl_v3_scale(s->f0, 1.0f - m5), m5, s->f90);
    *pdf = g1o * d / (4.0f * co);
    return kl_v3_scale(f, d * g1o * kl_ggx_g1(ci, alpha) / (4.0f * co));
}

/* Direction by the visible normals: Heitz, "Sampling the GGX Distribution of Visible Normals", JCGT
 * 2018. Returns f_s cos / pdf, black where the sample goes below the surface. */
KL_FN kl_vec3 kl_specular_sample(const kl_surface *s, kl_vec3 wo, kl_vec2 u, kl_vec3 *wi,
                                 float *pdf)
{
    const kl_frame f = kl_frame_from_normal(s->shading);
    const kl_vec3 v = kl_frame_to_local(&f, wo);
    const float alpha = kl_ggx_alpha(s);
    *pdf = 0.0f;
    *wi = s->shading;
    if (v.z <= 1e-6f) return kl_v3_splat(0.0f);
    const kl_vec3 vh = kl_normalize(kl_v3(alpha * v.x, alpha * v.y, v.z));
    const float l2 = vh.x * vh.x + vh.y * vh.y;
    const kl_vec3 t1 = l2 > 1e-12f ? kl_v3_scale(kl_v3(-vh.y, vh.x, 0.0f), 1.0f / kl_sqrt(l2))
                                   : kl_v3(1.0f, 0.0f, 0.0f);
    const kl_vec3 t2 = kl_cross(vh, t1);
    const kl_vec2 p = kl_concentric_disc(u);
    const float k = 0.5f * (1.0f + vh.z);
    const float p2 = (1.0f - k) * kl_sqrt(kl_fmax(0.0f, 1.0f - p.x * p.x)) + k * p.y;
    const float pz = kl_sqrt(kl_fmax(0.0f, 1.0f - p.x * p.x - p2 * p2));
    const kl_vec3 nh = kl_v3_mad(kl_v3_mad(kl_v3_scale(t1, p.x), p2, t2), pz, vh);
    const kl_vec3 hl = kl_normalize(kl_v3(alpha * nh.x, alpha * nh.y, kl_fmax(1e-6f, nh.z)));
    const kl_vec3 h = kl_frame_to_world(&f, hl);
    *wi = kl_v3_mad(kl_v3_scale(wo, -1.0f), 2.0f * kl_dot(wo, h), h);
    const kl_vec3 value = kl_specular_eval(s, wo, *wi, pdf);
    if (!(*pdf > 0.0f)) return kl_v3_splat(0.0f);
    return kl_v3_scale(value, 1.0f / *pdf);
}

#endif
