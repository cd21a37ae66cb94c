/* src/cache/agreement.c: records that are wrong about the place of another one end before it. */
#include "src/cache/agreement.h"
#include "src/cache/record.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { N = 400 }; /* no more than are looked at lie within a radius */
static const float radius = 0.1f;
static const float reach = 1.4f;
static const float error = 0.02f;
static const float slope = 0.5f; /* of the sloping world's irradiance [W m^-3] */

struct world {
    kl_record_hot hot[N];
    kl_record_cold cold[N];
    float shares[N];
};

static float sloping(float x)
{
    return 1.0f + slope * x;
}
static float stepping(float x)
{
    return x < 0.0f ? 1.0f : 1.25f;
}

/* Records at random points of a square of side 2, in any order of their numbers. */
static void make_world(struct world *w, float (*irradiance)(float x), float gradient, float noise,
                       bool walled)
{
    struct random r = {11};
    const kl_vec3 normal = kl_v3(0.0f, 0.0f, 1.0f);
    const kl_frame f = kl_frame_from_normal(normal);
    for (uint32_t i = 0; i < N; ++i) {
        const float x = random_range(&r, -1.0f, 1.0f);
        const float y = random_range(&r, -1.0f, 1.0f);
        const float e = irradiance(x);
        kl_record_hot *hot = &w->hot[i];
        kl_record_cold *cold = &w->cold[i];
        *hot = (kl_record_hot){.pos = {x, y, 0.0f},
                               .normal = kl_oct_encode(normal),
                               .radius = radius,
                               .radius2 = radius,
                               .object = KL_NONE};
        *cold = (kl_record_cold){
            .irr = {e, e, e}, .raw_radius = 1.0f, .error_spacing = kl_float_to_half(noise)};
        for (int k = 0; k < 3; ++k) {
            cold->grad[2 * k] = (kl_u16)kl_float_to_half(gradient * f.t.x / e);
            cold->grad[2 * k + 1] = (kl_u16)kl_float_to_half(gradient * f.b.x / e);
        }
        for (int k = 0; k < KL_SECTORS; ++k) {
            cold->clearance[k] = walled ? 0 : 255;
        }
    }
}

static void find_shares(struct world *w)
{
    static struct kl_tree_point points[N];
    struct kl_point_tree *tree = NULL;
    struct kl_err err = {0};
    for (uint32_t i = 0; i < N; ++i) {
        memcpy(points[i].pos, w->hot[i].pos, sizeof points[i].pos);
    }
    assert_int_equal(kl_point_tree_create(points, N, &tree, &err), KL_OK);
    const struct kl_record_set set = {w->hot, w->cold, N, tree, reach, 0.94f};
    kl_agreement_shares(&set, error, w->shares);
    kl_point_tree_destroy(tree);
}

static uint32_t count_shrunk(struct world *w)
{
    uint32_t n = 0;
    find_shares(w);
    for (uint32_t i = 0; i < N; ++i) {
        n += w->shares[i] < 1.0f;
    }
    return n;
}

static void what_gradients_foretell_agrees(void **state)
{
    static struct world w;
    (void)state;
    make_world(&w, sloping, slope, 0.0f, false);
    assert_int_equal(count_shrunk(&w), 0);
    make_world(&w, sloping, -slope, 0.0f, false);
    assert_true(count_shrunk(&w) > N / 2);
}

/* Nearest record on the other side, of what the radius reaches. */
static float to_other_side(const struct world *w, uint32_t number)
{
    const float *p = w->hot[number].pos;
    float nearest = 1.0f;
    for (uint32_t i = 0; i < N; ++i) {
        const float *q = w->hot[i].pos;
        if (stepping(q[0]) == stepping(p[0])) continue;
        nearest = fminf(nearest, hypotf(p[0] - q[0], p[1] - q[1]) / (reach * radius));
    }
    return nearest;
}

static void records_end_before_what_they_are_wrong_about(void **state)
{
    static struct world w;
    uint32_t near = 0;
    (void)state;
    make_world(&w, stepping, 0.0f, 0.0f, false);
    find_shares(&w);
    for (uint32_t i = 0; i < N; ++i) {
        const float expected = to_other_side(&w, i);
        assert_true(fabsf(w.shares[i] - expected) < 1e-3f);
        near += expected < 1.0f;
    }
    assert_true(near > N / 20 && near < N / 5);
}

static void nobody_is_served_from_the_other_side(void **state)
{
    static struct world w;
    const kl_query query = {reach, 0.94f, KL_INF};
    const kl_vec3 normal = kl_v3(0.0f, 0.0f, 1.0f);
    (void)state;
    make_world(&w, stepping, 0.0f, 0.0f, false);
    find_shares(&w);
    for (uint32_t i = 0; i < N; ++i) {
        kl_record_scale_radii(&w.hot[i], &w.cold[i], w.shares[i]);
        for (uint32_t k = 0; k < N; ++k) {
            if (stepping(w.hot[k].pos[0]) == stepping(w.hot[i].pos[0])) continue;
            const kl_bearing b =
                kl_record_bearing(&w.hot[i], &query, kl_v3_load(w.hot[k].pos), normal);
            assert_true(b.weight < 1e-3f);
        }
    }
}

/* A step of a quarter: twice the noise of both, and the error. */
static void noise_is_no_contradiction(void **state)
{
    static struct world w;
    (void)state;
    make_world(&w, stepping, 0.0f, 0.06f, false);
    assert_int_equal(count_shrunk(&w), 0);
    make_world(&w, stepping, 0.0f, 0.04f, false);
    assert_true(count_shrunk(&w) > N / 20);
}

static void what_is_out_of_sight_may_differ(void **state)
{
    static struct world w;
    (void)state;
    make_world(&w, stepping, 0.0f, 0.0f, true);
    assert_int_equal(count_shrunk(&w), 0);
}

static void radii_shrink_to_the_least_one(void **state)
{
    kl_record_hot hot = {.radius = 2.0f, .radius2 = 3.0f};
    const kl_record_cold cold = {.raw_radius = 1.0f, .error_spacing = kl_float_to_half(0.5f) << 16};
    (void)state;
    kl_record_scale_radii(&hot, &cold, 0.5f);
    assert_true(hot.radius == 1.0f && hot.radius2 == 1.5f);
    kl_record_scale_radii(&hot, &cold, 0.1f);
    assert_true(hot.radius == 0.5f && hot.radius2 == 0.5f);
    hot.radius = 0.25f; /* below already: as it is */
    kl_record_scale_radii(&hot, &cold, 0.1f);
    assert_true(hot.radius == 0.25f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_gradients_foretell_agrees),
        cmocka_unit_test(records_end_before_what_they_are_wrong_about),
        cmocka_unit_test(nobody_is_served_from_the_other_side),
        cmocka_unit_test(noise_is_no_contradiction),
        cmocka_unit_test(what_is_out_of_sight_may_differ),
        cmocka_unit_test(radii_shrink_to_the_least_one),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
