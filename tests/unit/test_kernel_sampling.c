/* kernels/sampling.h: nets, maps and codes that everything else is built on. */
#include "kernels/cache_query.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdlib.h>

/* Cells of a columns x rows grid that do not hold exactly one of points first .. + columns * rows
 */
static int bad_cells(uint32_t first, uint32_t columns, uint32_t rows, uint32_t seed)
{
    static uint8_t count[65536];
    int bad = 0;
    memset(count, 0, sizeof count);
    for (uint32_t i = first; i < first + columns * rows; ++i) {
        const kl_vec2 p = kl_sobol_2d(i, seed);
        assert_true(p.x >= 0.0f && p.x < 1.0f && p.y >= 0.0f && p.y < 1.0f);
        const uint32_t x = (uint32_t)(p.x * (float)columns);
        const uint32_t y = (uint32_t)(p.y * (float)rows);
        ++count[y * columns + x];
    }
    for (uint32_t i = 0; i < columns * rows; ++i) {
        bad += count[i] != 1;
    }
    return bad;
}

/* Prefixes of 4^k points are full nets, and so is every block of 4^k that follows. */
static void sobol_prefixes_are_nets(void **state)
{
    (void)state;
    for (uint32_t s = 0; s < 50; ++s) {
        const uint32_t seed = kl_hash(s);
        assert_int_equal(bad_cells(0, 64, 64, seed), 0);
        assert_int_equal(bad_cells(0, 32, 128, seed), 0);
        assert_int_equal(bad_cells(0, 128, 32, seed), 0);
        assert_int_equal(bad_cells(0, 4096, 1, seed), 0);
        assert_int_equal(bad_cells(0, 256, 256, seed), 0);
        for (uint32_t block = 0; block < 16; ++block) {
            assert_int_equal(bad_cells(1024 * block, 32, 32, seed), 0);
            assert_int_equal(bad_cells(1024 * block, 16, 64, seed), 0);
        }
    }
}

/* The streams of a sampler keep the nets in each pair of dimensions, and pairs are independent. */
static void sampler_pairs_are_nets_and_independent(void **state)
{
    enum { N = 1024 };
    (void)state;
    for (uint32_t seed = 1; seed < 20; ++seed) {
        uint8_t cells[3][N] = {{0}};
        double cross = 0.0;
        for (uint32_t i = 0; i < N; ++i) {
            kl_sampler s = kl_sampler_make(i, seed);
            const kl_vec2 a = kl_sampler_2d(&s);
            const float b = kl_sampler_1d(&s);
            const kl_vec2 c = kl_sampler_2d(&s);
            ++cells[0][(uint32_t)(a.y * 32.0f) * 32 + (uint32_t)(a.x * 32.0f)];
            ++cells[1][(uint32_t)(b * N)];
            ++cells[2][(uint32_t)(c.y * 32.0f) * 32 + (uint32_t)(c.x * 32.0f)];
            cross +=
                ((double)a.x - 0.5) * ((double)c.x - 0.5) + ((double)a.y - 0.5) * ((double)b - 0.5);
        }
        for (int i = 0; i < N; ++i) {
            assert_int_equal(cells[0][i], 1);
            assert_int_equal(cells[1][i], 1);
            assert_int_equal(cells[2][i], 1);
        }
        /* Two products of variance 1 / 144 each, N of them: 5 sigma. */
        assert_true(fabs(cross / N) < 5.0 * sqrt(2.0 / 144.0 / N));
    }
}

/* Bit k of the hash depends on bits 0 .. k only, and is a permutation: that is an Owen scramble. */
static void owen_hash_is_nested(void **state)
{
    struct random r = {3};
    (void)state;
    for (int i = 0; i < 20000; ++i) {
        const uint32_t x = (uint32_t)random_bits(&r);
        const uint32_t seed = (uint32_t)random_bits(&r);
        const uint32_t bit = (uint32_t)(random_bits(&r) % 32);
        const uint32_t changed = kl_owen_hash(x, seed) ^ kl_owen_hash(x ^ (1u << bit), seed);
        assert_int_equal(changed & ((1u << bit) - 1u), 0);
        assert_true((changed >> bit) & 1u);
    }
}

/* Scrambled bits are fair: with another seed each output bit flips about half of the time. */
static void owen_hash_is_fair(void **state)
{
    enum { N = 20000 };
    (void)state;
    for (uint32_t bit = 0; bit < 24; ++bit) { /* of the result, from the top */
        uint32_t ones = 0;
        for (uint32_t s = 0; s < N; ++s) {
            ones += (kl_reverse_bits(kl_owen_hash(0x2545f491u, kl_hash(s))) >> (31 - bit)) & 1u;
        }
        assert_true(fabs((double)ones / N - 0.5) < 5.0 * 0.5 / sqrt(N));
    }
}

/* Value of a half by its definition; codes of infinity and NaN count on past the largest. */
static double half_value(uint32_t h)
{
    const int e = (int)(h >> 10 & 31);
    const double m = (double)(h & 1023);
    const double v = e == 0 ? ldexp(m, -24) : ldexp(1024.0 + m, e - 25);
    return h & 0x8000u ? -v : v;
}

static void halves_round_trip(void **state)
{
    (void)state;
    for (uint32_t h = 0; h < 65536; ++h) {
        const float f = kl_half_to_float(h);
        assert_true((double)f == half_value(h));
        const uint32_t most = (h & 0x8000u) | 0x7bffu;
        assert_int_equal(kl_float_to_half(f), (h & 0x7fffu) > 0x7bffu ? most : h);
    }
}

static uint32_t nearest_half(float f) /* of finite f >= 0 within range: to nearest, ties to even */
{
    uint32_t h = 0;
    for (uint32_t bit = 0x4000u; bit > 0; bit >>= 1) {
        if (h + bit <= 0x7bffu && half_value(h + bit) <= (double)f) h += bit;
    }
    const double below = (double)f - half_value(h);
    const double above = half_value(h + 1) - (double)f;
    return h + (h < 0x7bffu && (above < below || (above == below && (h & 1u))));
}

static void halves_round_to_nearest_even(void **state)
{
    struct random r = {5};
    (void)state;
    for (int i = 0; i < 400000; ++i) {
        float f = kl_as_f32((uint32_t)random_bits(&r) & 0x7fffffffu);
        if (i % 2) f = ldexpf(random_float(&r), -(int)(random_bits(&r) % 30));
        if (i % 4 == 3) { /* exactly between two halves */
            const uint32_t h = (uint32_t)(random_bits(&r) % 0x7bff);
            f = (float)(0.5 * (half_value(h) + half_value(h + 1)));
        }
        if (!isfinite(f) || f > 65504.0f) continue;
        if (kl_float_to_half(f) != nearest_half(f)) {
            fail_msg("%a gives half 0x%x, nearest is 0x%x", (double)f, kl_float_to_half(f),
                     nearest_half(f));
        }
        assert_int_equal(kl_float_to_half(-f), nearest_half(f) | 0x8000u);
    }
    assert_int_equal(kl_float_to_half(INFINITY), 0x7bff);
    assert_int_equal(kl_float_to_half(-1e30f), 0xfbff);
    assert_int_equal(kl_float_to_half(NAN), 0);
}

static double angle_between(kl_vec3 a, kl_vec3 b)
{
    const kl_vec3 c = kl_cross(a, b);
    return atan2((double)kl_length(c), (double)kl_dot(a, b));
}

static void normals_survive_coding(kl_vec3 n, double *worst)
{
    const uint32_t code = kl_oct_encode(n);
    const kl_vec3 d = kl_oct_decode(code);
    const int32_t x = (int16_t)(uint16_t)(code & 0xffffu);
    const int32_t y = (int16_t)(uint16_t)(code >> 16);
    assert_true(fabsf(kl_length(d) - 1.0f) < 1e-6f);
    assert_true(x >= -32767 && y >= -32767);
    if (abs(x) < 32767 && abs(y) < 32767) assert_int_equal(kl_oct_encode(d), code);
    assert_true(angle_between(kl_oct_decode(kl_oct_encode(d)), d) < 1e-6);
    *worst = fmax(*worst, angle_between(n, d));
}

/* Error at most that of a 16-bit octahedron: half a step of 1 / 32767 along both axes, stretched at
 * most by sqrt(3) where a face's middle is nearest to the centre. */
static void octahedral_codes(void **state)
{
    struct random r = {7};
    double worst = 0.0;
    (void)state;
    for (int i = 0; i < 500000; ++i) {
        normals_survive_coding(random_direction(&r), &worst);
    }
    for (int k = 0; k < 27; ++k) { /* axes, edges, corners, and close by */
        const kl_vec3 v = kl_v3((float)(k % 3 - 1), (float)(k / 3 % 3 - 1), (float)(k / 9 - 1));
        if (k == 13) continue;
        for (int i = 0; i < 200; ++i) {
            const float near = i == 0 ? 0.0f : powf(10.0f, random_range(&r, -8.0f, -2.0f));
            normals_survive_coding(kl_normalize(kl_v3_mad(v, near, random_direction(&r))), &worst);
        }
    }
    assert_true(worst < 7e-5);
}

static void octahedral_codes_inside_the_square(void **state)
{
    struct random r = {8};
    (void)state;
    for (int i = 0; i < 500000; ++i) {
        const int32_t x = (int32_t)(random_bits(&r) % 65533) - 32766;
        const int32_t y = (int32_t)(random_bits(&r) % 65533) - 32766;
        const uint32_t code = ((uint32_t)x & 0xffffu) | ((uint32_t)y & 0xffffu) << 16;
        assert_int_equal(kl_oct_encode(kl_oct_decode(code)), code);
    }
}

/* Determinant of the map by differences: pi everywhere, as an area of 1 becomes one of pi. */
static void concentric_map_preserves_area(void **state)
{
    struct random r = {9};
    const float h = 1.0f / 512;
    (void)state;
    for (int i = 0; i < 20000; ++i) {
        const kl_vec2 u = {random_range(&r, h, 1.0f - h), random_range(&r, h, 1.0f - h)};
        const float a = fabsf(2.0f * u.x - 1.0f);
        const float b = fabsf(2.0f * u.y - 1.0f);
        if (fabsf(a - b) < 5.0f * h) continue; /* the map has a crease on the diagonals */
        const kl_vec2 right = kl_concentric_disc((kl_vec2){u.x + h, u.y});
        const kl_vec2 left = kl_concentric_disc((kl_vec2){u.x - h, u.y});
        const kl_vec2 up = kl_concentric_disc((kl_vec2){u.x, u.y + h});
        const kl_vec2 down = kl_concentric_disc((kl_vec2){u.x, u.y - h});
        const float det =
            ((right.x - left.x) * (up.y - down.y) - (right.y - left.y) * (up.x - down.x)) /
            (4.0f * h * h);
        const float r2 = fmaxf(a, b);
        assert_true(fabsf(det / KL_PI - 1.0f) < 0.01f + 2e-5f / (r2 * r2));
        const kl_vec2 p = kl_concentric_disc(u);
        assert_true(p.x * p.x + p.y * p.y <= 1.0f + 1e-6f);
        assert_true(fabsf(sqrtf(p.x * p.x + p.y * p.y) - r2) < 1e-6f);
    }
}

/* Shares of the disc's sectors and rings, and the mean cosine of directions, 2 / 3. */
static void cosine_directions(void **state)
{
    enum { N = 1 << 16 };
    uint32_t rings[8] = {0};
    double cosine = 0.0;
    (void)state;
    for (uint32_t i = 0; i < N; ++i) {
        const kl_vec3 d = kl_cosine_direction(kl_sobol_2d(i, 77));
        assert_true(fabsf(kl_length(d) - 1.0f) < 1e-5f);
        cosine += (double)d.z;
        const float ring = 8.0f * (d.x * d.x + d.y * d.y);
        ++rings[ring < 8.0f ? (uint32_t)ring : 7u];
    }
    assert_true(fabs(cosine / N - 2.0 / 3.0) < 1e-3);
    for (int k = 0; k < 8; ++k) {
        assert_true(fabs((double)rings[k] / N - 0.125) < 2e-3);
    }
}

/* Sectors are 12 equal angles, numbered within quadrants; angles say the same as the code. */
static void sectors_are_equal_angles(void **state)
{
    uint32_t hits[KL_SECTORS] = {0};
    (void)state;
    for (int i = 0; i < 120000; ++i) {
        const double angle = (i + 0.5) * (2.0 * 3.14159265358979 / 120000.0);
        const double x = cos(angle);
        const double y = sin(angle);
        const double folded = atan2(fabs(y), fabs(x)); /* as the quadrants mirror */
        const double exact = folded / (3.14159265358979 / 6.0);
        const uint32_t want = 3u * ((x < 0.0 ? 1u : 0u) + (y < 0.0 ? 2u : 0u)) + (uint32_t)exact;
        const uint32_t got = kl_sector_of((float)x, (float)y);
        ++hits[got];
        if (fabs(exact - round(exact)) < 1e-4) continue;
        assert_int_equal(got, want);
        assert_int_equal(kl_sector_of(1e-6f * (float)x, 1e-6f * (float)y), want);
        assert_int_equal(kl_sector_of(1e6f * (float)x, 1e6f * (float)y), want);
    }
    for (int k = 0; k < KL_SECTORS; ++k) {
        assert_in_range(hits[k], 9999, 10001);
    }
}

static void frames_are_right_handed(void **state)
{
    struct random r = {11};
    (void)state;
    for (int i = 0; i < 100000; ++i) {
        kl_vec3 n = random_direction(&r);
        if (i % 10 == 0) { /* close to the poles, where the formula turns over */
            n = kl_normalize(kl_v3(1e-4f * n.x, 1e-4f * n.y, i % 20 ? -1.0f : 1.0f));
        }
        if (i % 1000 == 0) n = kl_normalize(kl_v3(n.x, n.y, i % 2000 ? -0.0f : 0.0f));
        const kl_frame f = kl_frame_from_normal(n);
        assert_true(fabsf(kl_dot(f.t, f.b)) < 2e-6f && fabsf(kl_dot(f.t, n)) < 2e-6f);
        assert_true(fabsf(kl_dot(f.b, n)) < 2e-6f && fabsf(kl_length(f.t) - 1.0f) < 2e-6f);
        assert_true(kl_dot(kl_cross(f.t, f.b), n) > 0.999f);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sobol_prefixes_are_nets),
        cmocka_unit_test(sampler_pairs_are_nets_and_independent),
        cmocka_unit_test(owen_hash_is_nested),
        cmocka_unit_test(owen_hash_is_fair),
        cmocka_unit_test(halves_round_trip),
        cmocka_unit_test(halves_round_to_nearest_even),
        cmocka_unit_test(octahedral_codes),
        cmocka_unit_test(octahedral_codes_inside_the_square),
        cmocka_unit_test(concentric_map_preserves_area),
        cmocka_unit_test(cosine_directions),
        cmocka_unit_test(sectors_are_equal_angles),
        cmocka_unit_test(frames_are_right_handed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
