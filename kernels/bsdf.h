/* Reflection: a Lambert base under one GGX lobe. The base is scaled by what the lobe leaves over in
 * the viewing direction, so that base and lobe together never gain energy and the base stays a
 * plain albedo / pi, which is what an irradiance cache can serve. */
#ifndef KL_KERNELS_BSDF_H
#define KL_KERNELS_BSDF_H
#include "kernels/surface.h"

#define KL_MIN_ALPHA 1e-3f /* smoother surfaces are mirrors to this renderer */

#define KL_LOBE_ROWS    16 /* roughness 0 .. 1 */
#define KL_LOBE_COLUMNS 12 /* square root of the cosine, 0 .. 1 */

/* What the lobe below reflects of uniform light: first with F = 1, then with F = (1 - cos)^5. From
 * its own samples, 2^16 a number; bilinear in between, to 0.03 where it is smooth and grazing. */
KL_CONST float kl_lobe_table[2 * KL_LOBE_ROWS * KL_LOBE_COLUMNS] = {
    1.000f, 0.991f, 1.000f, 1.000f, 1.000f, 1.000f, 1.000f, 1.000f, 1.000f, 1.000f, 1.000f, 1.000f,
    0.915f, 0.906f, 0.989f, 0.998f, 0.999f, 1.000f, 1.000f, 1.000f, 1.000f, 1.000f, 1.000f, 1.000f,
    0.931f, 0.896f, 0.905f, 0.967f, 0.989f, 0.996f, 0.998f, 0.999f, 0.999f, 0.999f, 1.000f, 1.000f,
    0.933f, 0.916f, 0.881f, 0.904f, 0.950f, 0.976f, 0.988f, 0.993f, 0.996f, 0.997f, 0.998f, 0.998f,
    0.931f, 0.922f, 0.892f, 0.877f, 0.901f, 0.937f, 0.963f, 0.978f, 0.986f, 0.990f, 0.993f, 0.994f,
    0.927f, 0.920f, 0.899f, 0.876f, 0.873f, 0.895f, 0.924f, 0.949f, 0.965f, 0.975f, 0.981f, 0.985f,
    0.919f, 0.914f, 0.898f, 0.876f, 0.861f, 0.863f, 0.883f, 0.908f, 0.931f, 0.948f, 0.960f, 0.968f,
    0.906f, 0.902f, 0.890f, 0.870f, 0.851f, 0.841f, 0.846f, 0.863f, 0.885f, 0.906f, 0.924f, 0.937f,
    0.888f, 0.885f, 0.874f, 0.856f, 0.836f, 0.820f, 0.813f, 0.819f, 0.833f, 0.852f, 0.872f, 0.890f,
    0.865f, 0.862f, 0.851f, 0.834f, 0.814f, 0.794f, 0.780f, 0.774f, 0.778f, 0.790f, 0.806f, 0.825f,
    0.835f, 0.832f, 0.821f, 0.804f, 0.783f, 0.761f, 0.741f, 0.727f, 0.720f, 0.722f, 0.730f, 0.743f,
    0.799f, 0.796f, 0.785f, 0.767f, 0.745f, 0.720f, 0.696f, 0.675f, 0.660f, 0.650f, 0.647f, 0.651f,
    0.758f, 0.755f, 0.743f, 0.724f, 0.700f, 0.673f, 0.646f, 0.619f, 0.596f, 0.577f, 0.564f, 0.555f,
    0.713f, 0.709f, 0.696f, 0.676f, 0.650f, 0.621f, 0.590f, 0.559f, 0.531f, 0.504f, 0.482f, 0.463f,
    0.664f, 0.660f, 0.646f, 0.624f, 0.597f, 0.565f, 0.532f, 0.498f, 0.465f, 0.434f, 0.405f, 0.379f,
    0.613f, 0.609f, 0.594f, 0.571f, 0.542f, 0.509f, 0.473f, 0.437f, 0.401f, 0.368f, 0.336f, 0.307f,
    1.000f, 0.949f, 0.844f, 0.679f, 0.492f, 0.314f, 0.171f, 0.075f, 0.023f, 0.004f, 0.000f, 0.000f,
    0.837f, 0.839f, 0.827f, 0.675f, 0.490f, 0.314f, 0.171f, 0.075f, 0.023f, 0.004f, 0.000f, 0.000f,
    0.702f, 0.694f, 0.688f, 0.622f, 0.472f, 0.308f, 0.170f, 0.075f, 0.024f, 0.004f, 0.000f, 0.000f,
    0.555f, 0.556f, 0.540f, 0.504f, 0.415f, 0.286f, 0.164f, 0.074f, 0.024f, 0.005f, 0.000f, 0.000f,
    0.427f, 0.427f, 0.417f, 0.387f, 0.330f, 0.244f, 0.149f, 0.072f, 0.025f, 0.005f, 0.000f, 0.000f,
    0.322f, 0.321f, 0.314f, 0.291f, 0.250f, 0.193f, 0.125f, 0.065f, 0.025f, 0.006f, 0.001f, 0.000f,
    0.241f, 0.239f, 0.233f, 0.216f, 0.186f, 0.145f, 0.099f, 0.055f, 0.023f, 0.006f, 0.001f, 0.000f,
    0.179f, 0.178f, 0.171f, 0.158f, 0.136f, 0.107f, 0.075f, 0.044f, 0.020f, 0.006f, 0.001f, 0.000f,
    0.133f, 0.132f, 0.126f, 0.116f, 0.099f, 0.079f, 0.056f, 0.034f, 0.016f, 0.006f, 0.001f, 0.000f,
    0.099f, 0.098f, 0.093f, 0.085f, 0.072f, 0.057f, 0.041f, 0.025f, 0.013f, 0.005f, 0.001f, 0.000f,
    0.074f, 0.073f, 0.069f, 0.062f, 0.053f, 0.042f, 0.030f, 0.019f, 0.010f, 0.004f, 0.001f, 0.000f,
    0.056f, 0.055f, 0.052f, 0.046f, 0.039f, 0.030f, 0.022f, 0.014f, 0.007f, 0.003f, 0.001f, 0.000f,
    0.043f, 0.042f, 0.039f, 0.034f, 0.029f, 0.022f, 0.016f, 0.010f, 0.005f, 0.002f, 0.001f, 0.000f,
    0.033f, 0.032f, 0.030f, 0.026f, 0.021f, 0.016f, 0.011f, 0.007f, 0.004f, 0.002f, 0.001f, 0.000f,
    0.025f, 0.025f, 0.023f, 0.020f, 0.016f, 0.012f, 0.008f, 0.005f, 0.003f, 0.001f, 0.000f, 0.000f,
    0.020f, 0.019f, 0.017f, 0.015f, 0.012f, 0.009f, 0.006f, 0.004f, 0.002f, 0.001f, 0.000f, 0.000f,
};
KL_FN float kl_lobe_value(kl_u32 at, float fx, float fy)
{
    const float above = kl_lobe_table[at] + fx * (kl_lobe_table[at + 1u] - kl_lobe_table[at]);
    at += KL_LOBE_COLUMNS;
    const float below = kl_lobe_table[at] + fx * (kl_lobe_table[at + 1u] - kl_lobe_table[at]);
    return above + fy * (below - above);
}

/* Directional albedo of the GGX lobe. */
KL_FN kl_vec3 kl_specular_albedo(const kl_surface *s, float cos_view)
{
    const float x = (KL_LOBE_COLUMNS - 1) * kl_sqrt(kl_clamp(cos_view, 0.0f, 1.0f));
    const float y = (KL_LOBE_ROWS - 1) * kl_clamp(s->roughness, 0.0f, 1.0f);
    const float left = kl_fmin(kl_floor(x), KL_LOBE_COLUMNS - 2.0f);
    const float top = kl_fmin(kl_floor(y), KL_LOBE_ROWS - 2.0f);
    const kl_u32 at = (kl_u32)top * KL_LOBE_COLUMNS + (kl_u32)left;
    const kl_u32 next = at + KL_LOBE_ROWS * KL_LOBE_COLUMNS;
    const float bias = kl_lobe_value(next, x - left, y - top);
    const float scale = kl_fmax(0.0f, kl_lobe_value(at, x - left, y - top) - bias);
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

/* A lobe this blunt keeps its direction in gathers: pi times its value at normal incidence is a
 * quarter of a white base's at most, where it is brightest. */
KL_FN int kl_is_blunt(const kl_surface *s)
{
    const float alpha = kl_ggx_alpha(s);
    return kl_max3(s->f0) <= alpha * alpha;
}

/* How much more light from wi a surface sends towards wo than a Lambertian one of its gather albedo
 * would: 1 on average over wi, and everywhere for lobes that are not blunt. */
KL_FN kl_vec3 kl_gather_shape(const kl_scene_view *scene, const kl_surface *s, kl_vec3 albedo,
                              kl_vec3 wo, kl_vec3 wi)
{
    const kl_vec3 one = kl_v3_splat(1.0f);
    float pdf;
    if (!KL_NEEDS(scene, KL_NEED_SPECULAR) || !kl_has_specular(s) || !kl_is_blunt(s)) return one;
    const float ci = kl_fmax(kl_dot(s->shading, wi), 1e-6f);
    const kl_vec3 mean = kl_specular_albedo(s, kl_dot(s->shading, wo));
    const kl_vec3 lobe = kl_v3_scale(kl_specular_eval(s, wo, wi, &pdf), KL_PI / ci);
    const kl_vec3 more = kl_v3_sub(lobe, mean);
    return kl_v3(albedo.x > 0.0f ? kl_fmax(0.0f, 1.0f + more.x / albedo.x) : 1.0f,
                 albedo.y > 0.0f ? kl_fmax(0.0f, 1.0f + more.y / albedo.y) : 1.0f,
                 albedo.z > 0.0f ? kl_fmax(0.0f, 1.0f + more.z / albedo.z) : 1.0f);
}

#endif
