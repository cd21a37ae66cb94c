/* src/cache/record.c: whatever a gather found, the record is finite and promises no more than it
 * knows. */
#include "src/cache/record.h"

#include "cache_io/store.h"
#include "kernels/cache_query.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

static const float scene_radius = 5.0f;
static const struct kl_radius_settings rules[] = {{KL_RADIUS_HESSIAN, 0.4f, 5.0f},
                                                  {KL_RADIUS_SPLIT_SPHERE, 0.4f, 5.0f}};

static float any_size(struct random *r)
{
    return powf(10.0f, random_range(r, -12.0f, 12.0f));
}

static kl_gather_result any_result(struct random *r)
{
    kl_gather_result g = {0};
    for (int k = 0; k < 3; ++k) {
        g.irr[k] = random_bits(r) % 5 ? any_size(r) : 0.0f;
    }
    for (int k = 0; k < 6; ++k) {
        g.grad_t[k] = any_size(r) * random_range(r, -1.0f, 1.0f);
        g.grad_r[k] = any_size(r) * random_range(r, -1.0f, 1.0f);
    }
    for (int k = 0; k < KL_SECTORS; ++k) {
        g.clearance[k] = random_bits(r) % 3 ? any_size(r) : KL_INF;
    }
    for (int k = 0; k < 3; ++k) {
        g.hessian[k] = random_bits(r) % 4 ? any_size(r) * random_range(r, -1.0f, 1.0f) : 0.0f;
    }
    g.error = any_size(r);
    g.harmonic = random_bits(r) % 8 ? any_size(r) : KL_INF;
    return g;
}

static bool half_is_finite(uint32_t h)
{
    return (h & 0x7fffu) <= 0x7bffu;
}

static void extremes_pack_to_finite_records(void **state)
{
    struct random r = {1};
    (void)state;
    for (int i = 0; i < 100000; ++i) {
        const kl_gather_point point = {.pos = {1.0f, 2.0f, 3.0f}, .normal = 77, .seed = 99};
        const kl_gather_result g = any_result(&r);
        const float spacing = random_bits(&r) % 10 ? any_size(&r) : 0.0f;
        kl_record_hot hot;
        kl_record_cold cold;
        const struct kl_radius_settings *rule = &rules[i / 2 % 2];
        kl_record_pack(&point, &g, (uint32_t)(i % 2), spacing, rule, &hot, &cold);
        for (int k = 0; k < 6; ++k) {
            assert_true(half_is_finite(cold.grad[k]) && half_is_finite(cold.grad[6 + k]));
        }
        assert_true(half_is_finite(cold.error_spacing & 0xffffu));
        assert_true(half_is_finite(cold.error_spacing >> 16));
        assert_true(kl_record_is_valid(&hot, &cold));
        assert_int_equal(kl_record_level(hot.form), i % 2);
        kl_record_set_radii(&hot, &cold, kl_record_wish(&hot, &cold, rule), rule);
        assert_true(kl_record_is_valid(&hot, &cold));
        assert_true(hot.radius > 0.0f && hot.radius2 <= 0.2f * scene_radius * 1.0001f);
        assert_true(hot.radius2 <= fmaxf(2.0f * hot.radius, hot.radius));
    }
}

/* What the record says of its surroundings at radius * reach is never more open than it was. */
static void clearance_is_conservative(void **state)
{
    struct random r = {2};
    int missed = 0;
    (void)state;
    for (int i = 0; i < 200000; ++i) {
        const struct kl_radius_settings rule = {KL_RADIUS_SPLIT_SPHERE, 0.4f, 1000.0f};
        const float raw = powf(10.0f, random_range(&r, -3.0f, 0.0f));
        const float spacing = i % 2 ? 1e-4f : raw * random_range(&r, 0.0f, 8.0f);
        kl_gather_point point = {.seed = 1};
        kl_gather_result g = {.irr = {1.0f, 1.0f, 1.0f}, .harmonic = raw};
        kl_record_hot hot;
        kl_record_cold cold;
        for (int k = 0; k < KL_SECTORS; ++k) {
            g.clearance[k] = raw * powf(10.0f, random_range(&r, -2.0f, 1.0f));
        }
        kl_record_pack(&point, &g, 0, spacing, &rule, &hot, &cold);
        kl_record_set_radii(&hot, &cold, kl_record_wish(&hot, &cold, &rule), &rule);
        const float angle = random_range(&r, 0.0f, 2.0f * KL_PI);
        const float x = cosf(angle);
        const float y = sinf(angle);
        const float wall = g.clearance[kl_sector_of(x, y)];
        const float reach = 1.4f * hot.radius;
        if (wall > reach) continue;
        const kl_u32 sector = kl_sector_of(x, y);
        const float unit2 = kl_clearance_unit2(cold.error_spacing, cold.raw_radius);
        const kl_u32 code = cold.clearance[sector];
        if (!kl_is_blocked(code, unit2, 1.02f * wall * wall)) ++missed;
        const float near = 0.9f * wall; /* in front of it */
        assert_false(kl_is_blocked(code, unit2, near * near));
    }
    if (missed > 0) fail_msg("%d walls within reach are not seen", missed);
}

/* Gradients come back as they went in, and are damped where the radius was raised. */
static void gradients_survive(void **state)
{
    const kl_gather_point point = {.seed = 1};
    kl_gather_result g = {.irr = {2.0f, 4.0f, 8.0f}, .harmonic = 0.5f};
    kl_record_hot hot;
    kl_record_cold cold;
    (void)state;
    for (int k = 0; k < 6; ++k) {
        g.grad_t[k] = 0.1f * (float)(k + 1);
        g.grad_r[k] = -0.05f * (float)(k + 1);
    }
    kl_record_pack(&point, &g, 0, 0.01f, &rules[1], &hot, &cold);
    assert_true(cold.raw_radius == 0.5f);
    const kl_frame f = kl_frame_from_normal(kl_oct_decode(point.normal));
    const kl_vec3 offset = kl_v3_mad(kl_v3_scale(f.t, 0.02f), -0.03f, f.b);
    const kl_vec3 bent = kl_normalize(kl_v3_mad(f.n, 0.1f, f.t)); /* n x bent is along b */
    const kl_query query = {1.0f, 0.9f, KL_INF};
    const kl_bearing b =
        kl_bearing_of(offset, f.n, hot.radius, hot.radius2, hot.form, &query, f.n, bent);
    const kl_vec3 gain = kl_v3_scale(kl_record_half_gain(&cold, b), 2.0f);
    const kl_vec3 e = kl_record_with_gain(&cold, gain);
    const float v = 0.1f / sqrtf(1.01f);
    const float want[3] = {2.0f + 0.02f * 0.1f - 0.03f * 0.2f - v * 0.05f * 2.0f,
                           4.0f + 0.02f * 0.3f - 0.03f * 0.4f - v * 0.05f * 4.0f,
                           8.0f + 0.02f * 0.5f - 0.03f * 0.6f - v * 0.05f * 6.0f};
    assert_true(fabsf(e.x - want[0]) < 1e-4f * want[0]);
    assert_true(fabsf(e.y - want[1]) < 1e-4f * want[1]);
    assert_true(fabsf(e.z - want[2]) < 1e-4f * want[2]);

    kl_record_pack(&point, &g, 0, 2.0f, &rules[1], &hot, &cold);
    const float damped = kl_half_to_float(cold.grad[0]);
    assert_true(fabsf(damped - 0.1f / 2.0f * 0.5f * 0.25f) < 1e-4f);
}

static void darkness_has_no_gradient(void **state)
{
    const kl_gather_point point = {.seed = 1};
    const kl_gather_result g = {.harmonic = 0.5f};
    kl_record_hot hot;
    kl_record_cold cold;
    (void)state;
    kl_record_pack(&point, &g, 0, 0.01f, &rules[1], &hot, &cold);
    assert_true(kl_record_is_valid(&hot, &cold));
    assert_true(cold.raw_radius == 0.5f);
    for (int k = 0; k < 6; ++k) {
        assert_int_equal(cold.grad[k] & 0x7fffu, 0);
        assert_int_equal(cold.grad[6 + k] & 0x7fffu, 0);
    }
}

/* A saddle: radii along the eigenvectors, the minor one across the larger curvature; a scale of the
 * scene scales them, brighter light does not. */
static void radii_follow_the_hessian(void **state)
{
    const kl_gather_point point = {.seed = 1};
    const struct kl_radius_settings rule = {KL_RADIUS_HESSIAN, 0.25f, 1000.0f};
    const float turn = 0.4f;
    const float c = cosf(turn);
    const float s = sinf(turn);
    (void)state;
    for (int k = 0; k < 4; ++k) {
        const float scale = k & 1 ? 1000.0f : 1.0f;
        const float light = k & 2 ? 50.0f : 1.0f;
        const float l = light / (1.2f * scale * scale); /* eigenvalues -9 l and 4 l */
        const kl_gather_result g = {.irr = {light, light, light},
                                    .harmonic = scale,
                                    .hessian = {l * (-9.0f * c * c + 4.0f * s * s),
                                                l * (-9.0f - 4.0f) * c * s,
                                                l * (-9.0f * s * s + 4.0f * c * c)}};
        kl_record_hot hot;
        kl_record_cold cold;
        kl_record_pack(&point, &g, 0, 1e-6f, &rule, &hot, &cold);
        kl_record_set_radii(&hot, &cold, kl_record_wish(&hot, &cold, &rule), &rule);
        assert_true(fabsf(hot.radius - 0.25f / 3.0f * scale) < 1e-5f * scale);
        assert_true(fabsf(hot.radius2 - 0.25f / 2.0f * scale) < 1e-3f * scale);
        assert_true(fabsf(kl_record_axis_angle(hot.form) - turn) < 1e-3f);
    }
}

/* Weight of a record of radius 1 in the plane z = 0 for a point beside and above it. */
static float weight_at(float beside, float above)
{
    const kl_query query = {1.0f, 0.94f, KL_INF};
    const kl_vec3 up = kl_v3(0.0f, 0.0f, 1.0f);
    const kl_record_hot hot = {.normal = kl_oct_encode(up), .radius = 1.0f, .radius2 = 1.0f};
    return kl_record_bearing(&hot, &query, kl_v3(beside, 0.0f, above), up).weight;
}

static void layers_close_above_are_not_served(void **state)
{
    (void)state;
    assert_true(weight_at(0.1f, 0.2f) == 0.0f); /* within the slab, but steep */
    assert_true(weight_at(0.5f, 0.3f) == 0.0f);
    assert_true(weight_at(0.5f, 0.15f) > 0.4f); /* what a curved surface may do */
    assert_true(weight_at(0.5f, 0.204f) > 0.0f && weight_at(0.5f, 0.204f) < 0.1f); /* fades out */
    assert_true(weight_at(0.0f, 0.01f) > 0.9f);                                    /* rough */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(extremes_pack_to_finite_records),
        cmocka_unit_test(clearance_is_conservative),
        cmocka_unit_test(gradients_survive),
        cmocka_unit_test(darkness_has_no_gradient),
        cmocka_unit_test(radii_follow_the_hessian),
        cmocka_unit_test(layers_close_above_are_not_served),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
