/* src/trace/tracer.c against trying every triangle. */
#include "src/trace/tracer.h"

#include "test_trace_scenes.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>

static struct kl_tracer *must_create(struct kl_flat *flat)
{
    struct kl_tracer *tracer = NULL;
    struct kl_err err = {0};
    if (kl_tracer_create(flat, &tracer, &err) != KL_OK) fail_msg("%s", err.msg);
    assert_ptr_equal(flat->view.tracer, tracer);
    return tracer;
}

/* Float and double disagree only within rounding of an edge, so a few odd rays are allowed. */
static void compare_with_brute_force(struct kl_flat *flat, uint64_t seed, int rays)
{
    struct kl_tracer *tracer = must_create(flat);
    struct kl_test_random random = {seed};
    int odd = 0, hits = 0;

    for (int i = 0; i < rays; ++i) {
        const kl_vec3 origin = kl_v3_scale(kl_test_direction(&random), 2.0f);
        const float tmax = i % 4 == 0 ? 1.5f : KL_INF;
        const kl_vec3 target = kl_test_direction(&random);
        const kl_ray ray = kl_ray_make(origin, kl_normalize(kl_v3_sub(target, origin)), tmax);
        kl_hit want = {0}, got = {0};
        const int expected = kl_test_brute_force(flat, &ray, &want);
        const int found = kl_trace_closest(&flat->view, &ray, &got);
        assert_int_equal(kl_trace_any(&flat->view, &ray), found);
        hits += found;
        if (found != expected || (found && got.triangle != want.triangle) ||
            (found && got.instance != want.instance)) {
            ++odd;
            continue;
        }
        if (!found) continue;
        assert_true(fabsf(got.t - want.t) <= 1e-4f * (1.0f + want.t));
        assert_true(fabsf(got.u - want.u) <= 1e-2f && fabsf(got.v - want.v) <= 1e-2f);
    }
    kl_tracer_destroy(tracer);
    kl_test_scene_destroy(flat);
    assert_true(hits > rays / 10);
    assert_true(odd <= rays / 500);
}

static void merged_geometry(void **state)
{
    (void)state;
    compare_with_brute_force(kl_test_soup(1, 500, 0.5f, 0, 0), 10, 2000);
}

static void instances(void **state)
{
    (void)state;
    compare_with_brute_force(kl_test_soup(2, 100, 0.5f, 100, 9), 11, 2000);
}

static void instances_alone(void **state)
{
    (void)state;
    compare_with_brute_force(kl_test_soup(3, 0, 0.5f, 200, 5), 12, 2000);
}

static void nothing_to_hit(void **state)
{
    (void)state;
    struct kl_flat *flat = kl_test_soup(1, 0, 0.5f, 0, 2);
    struct kl_tracer *tracer = must_create(flat);
    const kl_ray ray = kl_ray_make(kl_v3(0.0f, 0.0f, 0.0f), kl_v3(0.0f, 0.0f, 1.0f), KL_INF);
    kl_hit hit = {.t = 7.0f};

    assert_int_equal(kl_trace_closest(&flat->view, &ray, &hit), 0);
    assert_true(hit.t == 7.0f);
    assert_int_equal(kl_trace_any(&flat->view, &ray), 0);
    kl_tracer_destroy(tracer);
    kl_tracer_destroy(NULL);
    kl_test_scene_destroy(flat);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(merged_geometry),
        cmocka_unit_test(instances),
        cmocka_unit_test(instances_alone),
        cmocka_unit_test(nothing_to_hit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
