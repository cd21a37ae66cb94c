/* A small deterministic generator for tests: splitmix64, so that every seed is fine and a failure
 * can be replayed. */
#ifndef KL_TESTS_UNIT_TEST_KERNEL_RANDOM_H
#define KL_TESTS_UNIT_TEST_KERNEL_RANDOM_H

#include "kernels/vec.h"

struct random {
    uint64_t state;
};

static inline uint64_t random_bits(struct random *r)
{
    uint64_t z = r->state += 0x9e3779b97f4a7c15ull;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return z ^ (z >> 31);
}

/* [0, 1) */
static inline float random_float(struct random *r)
{
    return (float)(random_bits(r) >> 40) * (1.0f / 16777216.0f);
}

static inline float random_range(struct random *r, float lo, float hi)
{
    return lo + (hi - lo) * random_float(r);
}

/* Uniform on the sphere. */
static inline kl_vec3 random_direction(struct random *r)
{
    const float z = random_range(r, -1.0f, 1.0f);
    const float phi = random_range(r, 0.0f, 2.0f * KL_PI);
    const float s = sqrtf(fmaxf(0.0f, 1.0f - z * z));
    return kl_v3(s * cosf(phi), s * sinf(phi), z);
}

#endif
