/* Random and low-discrepancy numbers. Everything is integer hashing, so host and devices draw the
 * same numbers bit for bit. */
#ifndef KL_KERNELS_SAMPLING_H
#define KL_KERNELS_SAMPLING_H
#include "kernels/vec.h"

/* Mixes 32 bits ("lowbias32" of C. Wellons' hash prospector). */
KL_FN kl_u32 kl_hash(kl_u32 x)
{
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x;
}
KL_FN kl_u32 kl_hash2(kl_u32 a, kl_u32 b)
{
    return kl_hash(a ^ (kl_hash(b) + 0x9e3779b9u + (a << 6) + (a >> 2)));
}

/* [0, 1) from the upper 24 bits: exact in float. */
KL_FN float kl_unit_float(kl_u32 x)
{
    return (float)(x >> 8) * (1.0f / 16777216.0f);
}

KL_FN kl_u32 kl_reverse_bits(kl_u32 x)
{
    x = ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
    x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
    x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
    x = ((x & 0x00ff00ffu) << 8) | ((x >> 8) & 0x00ff00ffu);
    return (x << 16) | (x >> 16);
}

/* Hash in which bit k depends only on bits 0..k: an Owen scramble of the reversed number. Laine and
 * Karras, "Stratified Sampling for Stochastic Transparency", EGSR 2011, with the constants of
 * N. Vegdahl, "Building a Better LK Hash", 2021. */
KL_FN kl_u32 kl_owen_hash(kl_u32 x, kl_u32 seed)
{
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

/* Bit-reversed second Sobol' coordinate of point i: multiplication by Pascal's triangle mod 2. */
KL_FN kl_u32 kl_sobol_second(kl_u32 x)
{
    x ^= (x >> 1) & 0x55555555u;
    x ^= (x >> 2) & 0x33333333u;
    x ^= (x >> 4) & 0x0f0f0f0fu;
    x ^= (x >> 8) & 0x00ff00ffu;
    x ^= x >> 16;
    return x;
}

typedef struct kl_vec2 {
    float x, y;
} kl_vec2;

/* Point i of the Owen-scrambled Sobol' (0,2)-sequence; prefixes of 4^k points are full nets. */
KL_FN kl_vec2 kl_sobol_2d(kl_u32 i, kl_u32 seed)
{
    kl_vec2 p;
    p.x = kl_unit_float(kl_reverse_bits(kl_owen_hash(i, seed)));
    p.y = kl_unit_float(
        kl_reverse_bits(kl_owen_hash(kl_sobol_second(i), kl_hash(seed ^ 0x6c8e9cf5u))));
    return p;
}

/* A stream of 2-D points for one sample of one integral: dimension pairs are independently
 * scrambled and index-shuffled Sobol' points (Burley, "Practical Hash-based Owen Scrambling",
 * JCGT 2020). */
typedef struct kl_sampler {
    kl_u32 index; /* of the sample */
    kl_u32 seed;  /* of the integral (pixel, record) */
    kl_u32 dim;   /* pairs drawn so far */
} kl_sampler;

KL_FN kl_sampler kl_sampler_make(kl_u32 index, kl_u32 seed)
{
    kl_sampler s;
    s.index = index;
    s.seed = seed;
    s.dim = 0;
    return s;
}
KL_FN kl_vec2 kl_sampler_2d(kl_sampler *s)
{
    const kl_u32 seed = kl_hash2(s->seed, s->dim++);
    const kl_u32 shuffled =
        kl_reverse_bits(kl_owen_hash(kl_reverse_bits(s->index), kl_hash(seed ^ 0xa511e9b3u)));
    return kl_sobol_2d(shuffled, seed);
}
KL_FN float kl_sampler_1d(kl_sampler *s)
{
    const kl_u32 seed = kl_hash2(s->seed, s->dim++);
    const kl_u32 shuffled = kl_owen_hash(kl_reverse_bits(s->index), kl_hash(seed ^ 0xa511e9b3u));
    return kl_unit_float(kl_reverse_bits(kl_owen_hash(kl_reverse_bits(shuffled), seed)));
}

/* Area-preserving map of the square to the disc: Shirley and Chiu, "A Low Distortion Map Between
 * Disk and Square", 1997. A unit disc point is the projection of a cosine-distributed direction. */
KL_FN kl_vec2 kl_concentric_disc(kl_vec2 u)
{
    const float a = 2.0f * u.x - 1.0f;
    const float b = 2.0f * u.y - 1.0f;
    kl_vec2 p;
    float r, phi;
    if (a == 0.0f && b == 0.0f) {
        p.x = 0.0f;
        p.y = 0.0f;
        return p;
    }
    if (kl_fabs(a) > kl_fabs(b)) {
        r = a;
        phi = (KL_PI * 0.25f) * (b / a);
    } else {
        r = b;
        phi = (KL_PI * 0.5f) - (KL_PI * 0.25f) * (a / b);
    }
    p.x = r * kl_cos(phi);
    p.y = r * kl_sin(phi);
    return p;
}

/* Cosine-distributed direction about +z. */
KL_FN kl_vec3 kl_cosine_direction(kl_vec2 u)
{
    const kl_vec2 p = kl_concentric_disc(u);
    return kl_v3(p.x, p.y, kl_sqrt(kl_fmax(0.0f, 1.0f - p.x * p.x - p.y * p.y)));
}

/* Octahedral unit vectors in 2 x 16 bits: Cigolle et al., JCGT 2014. Decoding is exact enough that
 * encode(decode(x)) == x off the square's rim, where two codes stand for one direction. */
KL_FN kl_vec3 kl_oct_decode(kl_u32 code)
{
    const float x = (float)((kl_i32)(code << 16) >> 16) * (1.0f / 32767.0f);
    const float y = (float)((kl_i32)code >> 16) * (1.0f / 32767.0f);
    const float z = 1.0f - kl_fabs(x) - kl_fabs(y);
    const float fold = kl_fmax(-z, 0.0f);
    const kl_vec3 n = kl_v3(x + (x >= 0.0f ? -fold : fold), y + (y >= 0.0f ? -fold : fold), z);
    return kl_v3_scale(n, 1.0f / kl_sqrt(kl_dot(n, n))); /* a third at least */
}
KL_FN kl_u32 kl_oct_encode(kl_vec3 n)
{
    const float s = 1.0f / (kl_fabs(n.x) + kl_fabs(n.y) + kl_fabs(n.z));
    float x = n.x * s;
    float y = n.y * s;
    if (n.z < 0.0f) {
        const float fx = (1.0f - kl_fabs(y)) * (x >= 0.0f ? 1.0f : -1.0f);
        const float fy = (1.0f - kl_fabs(x)) * (y >= 0.0f ? 1.0f : -1.0f);
        x = fx;
        y = fy;
    }
    const kl_i32 ix = (kl_i32)kl_floor(x * 32767.0f + 0.5f);
    const kl_i32 iy = (kl_i32)kl_floor(y * 32767.0f + 0.5f);
    return ((kl_u32)ix & 0xffffu) | (((kl_u32)iy & 0xffffu) << 16);
}

/* IEEE half <-> float by bits, the same on every compiler. Rounds to nearest even; overflow gives
 * the largest half, NaN gives 0. */
KL_FN float kl_half_to_float(kl_u32 h)
{
    /* The exponent is moved by a multiplication, which also gets denormals right: exact. */
    const float mag = kl_as_f32((h & 0x7fffu) << 13) * 5.192296858534828e33f; /* 2^112 */
    return kl_as_f32(kl_as_u32(mag) | ((h & 0x8000u) << 16));
}
KL_FN kl_u32 kl_float_to_half(float f)
{
    const kl_u32 x = kl_as_u32(f);
    const kl_u32 sign = (x >> 16) & 0x8000u;
    kl_u32 mag = x & 0x7fffffffu;
    if (mag > 0x7f800000u) return 0;
    if (mag >= 0x477ff000u) return sign | 0x7bffu;
    if (mag < 0x38800000u) { /* denormal half: multiples of 2^-24 */
        const float r = kl_fabs(f) * 16777216.0f;
        const kl_u32 whole = (kl_u32)r;
        const float rest = r - (float)whole;
        return sign | (whole + (rest > 0.5f || (rest == 0.5f && (whole & 1u)) ? 1u : 0u));
    }
    mag += 0xfffu + ((mag >> 13) & 1u);
    return sign | ((mag - 0x38000000u) >> 13);
}

#endif
