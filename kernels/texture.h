/* Texture look-ups: bilinear or nearest, wrapped, linear colour out. */
#ifndef KL_KERNELS_TEXTURE_H
#define KL_KERNELS_TEXTURE_H
#include "kernels/scene_data.h"

typedef struct kl_rgba {
    float r, g, b, a;
} kl_rgba;

KL_FN kl_i32 kl_texture_wrap(kl_i32 i, kl_i32 n, kl_u32 mode)
{
    if (mode == KL_WRAP_CLAMP) return i < 0 ? 0 : (i >= n ? n - 1 : i);
    if (mode == KL_WRAP_MIRROR) {
        const kl_i32 period = 2 * n;
        kl_i32 k = i % period;
        if (k < 0) k += period;
        return k < n ? k : period - 1 - k;
    }
    i %= n;
    return i < 0 ? i + n : i;
}

KL_FN kl_rgba kl_texel(const kl_scene_view *s, const KL_GLOBAL kl_texture *t, kl_i32 x, kl_i32 y)
{
    const kl_i32 ix = kl_texture_wrap(x, (kl_i32)t->width, t->wrap_s);
    const kl_i32 iy = kl_texture_wrap(y, (kl_i32)t->height, t->wrap_t);
    const kl_u32 c = s->texels[t->first_texel + (kl_u32)iy * t->width + (kl_u32)ix];
    kl_rgba p;
    if (t->srgb) {
        p.r = s->srgb_table[c & 255u];
        p.g = s->srgb_table[(c >> 8) & 255u];
        p.b = s->srgb_table[(c >> 16) & 255u];
    } else {
        p.r = (float)(c & 255u) * (1.0f / 255.0f);
        p.g = (float)((c >> 8) & 255u) * (1.0f / 255.0f);
        p.b = (float)((c >> 16) & 255u) * (1.0f / 255.0f);
    }
    p.a = (float)(c >> 24) * (1.0f / 255.0f);
    return p;
}

/* uv as glTF has it: (0, 0) is the upper left corner. Coordinates beyond +-2^20 read texel 0. */
KL_FN kl_rgba kl_texture_sample(const kl_scene_view *s, kl_u32 texture, float u, float v)
{
    const KL_GLOBAL kl_texture *t = &s->textures[texture];
    float x = u * (float)t->width;
    float y = v * (float)t->height;
    if (!(kl_fabs(x) < 1073741824.0f)) x = 0.0f;
    if (!(kl_fabs(y) < 1073741824.0f)) y = 0.0f;
    if (t->nearest) return kl_texel(s, t, (kl_i32)kl_floor(x), (kl_i32)kl_floor(y));
    x -= 0.5f;
    y -= 0.5f;
    const float fx = kl_floor(x);
    const float fy = kl_floor(y);
    const kl_i32 ix = (kl_i32)fx;
    const kl_i32 iy = (kl_i32)fy;
    const float ax = x - fx;
    const float ay = y - fy;
    const kl_rgba p00 = kl_texel(s, t, ix, iy);
    const kl_rgba p10 = kl_texel(s, t, ix + 1, iy);
    const kl_rgba p01 = kl_texel(s, t, ix, iy + 1);
    const kl_rgba p11 = kl_texel(s, t, ix + 1, iy + 1);
    const float w00 = (1.0f - ax) * (1.0f - ay);
    const float w10 = ax * (1.0f - ay);
    const float w01 = (1.0f - ax) * ay;
    const float w11 = ax * ay;
    kl_rgba p;
    p.r = w00 * p00.r + w10 * p10.r + w01 * p01.r + w11 * p11.r;
    p.g = w00 * p00.g + w10 * p10.g + w01 * p01.g + w11 * p11.g;
    p.b = w00 * p00.b + w10 * p10.b + w01 * p01.b + w11 * p11.b;
    p.a = w00 * p00.a + w10 * p10.a + w01 * p01.a + w11 * p11.a;
    return p;
}

#endif
