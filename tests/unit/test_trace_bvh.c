/* kernels/bvh.h on the host and the trees of src/trace/device_bvh.c, against Embree. */
#include "kernels/bvh.h"
#include "src/trace/device_bvh.h"
#include "src/trace/tracer.h"

#include "test_trace_scenes.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>

struct fixture {
    struct kl_flat *flat;
    struct kl_tracer *tracer;
    struct kl_device_bvh *bvh;
};

static struct fixture set_up(struct kl_flat *flat)
{
    struct fixture f = {.flat = flat};
    struct kl_err err = {0};

    if (kl_tracer_create(flat, &f.tracer, &err) != KL_OK) fail_msg("%s", err.msg);
    if (kl_device_bvh_create(flat, NULL, &f.bvh, &err) != KL_OK) fail_msg("%s", err.msg);
    assert_ptr_equal(flat->view.bvh_nodes, f.bvh->nodes);
    return f;
}

static void tear_down(struct fixture *f)
{
    kl_device_bvh_destroy(f->bvh);
    kl_tracer_destroy(f->tracer);
    kl_test_scene_destroy(f->flat);
}

/* 1 if the two tracers disagree by more than a choice between equal distances. */
static int disagree(const kl_scene_view *view, const kl_ray *ray, int *found)
{
    kl_hit want = {0}, got = {.t = -1.0f};
    const int expected = kl_trace_closest(view, ray, &want);
    *found = kl_bvh_closest(view, ray, &got);

    assert_int_equal(kl_bvh_any(view, ray), *found);
    if (!*found) {
        assert_true(got.t == -1.0f); /* untouched */
        return expected;
    }
    assert_true(got.t > ray->tmin && got.t < ray->tmax);
    assert_true(got.u >= 0.0f && got.u <= 1.0f && got.v >= 0.0f && got.v <= 1.0f);
    assert_true(got.instance < view->instance_count);
    const kl_instance *instance = &view->instances[got.instance];
    assert_true(got.triangle - instance->first_triangle < instance->triangle_count);
    if (!expected) return 1;
    const float near = 2e-5f * (1.0f + want.t);
    if (got.triangle != want.triangle || got.instance != want.instance) {
        return !(fabsf(got.t - want.t) <= near);
    }
    return !(fabsf(got.t - want.t) <= near && fabsf(got.u - want.u) <= 1e-3f &&
             fabsf(got.v - want.v) <= 1e-3f);
}

/* Random, axis-parallel and limited rays. */
static kl_ray make_ray(struct kl_test_random *random, int i)
{
    const float axis = i % 8 < 4 ? 1.0f : -1.0f;
    kl_vec3 origin = kl_v3_scale(kl_test_direction(random), 2.5f * kl_test_uniform(random));
    kl_vec3 dir = kl_test_direction(random);

    if (i % 16 == 1) dir = kl_v3(axis, 0.0f, -0.0f);
    if (i % 16 == 2) dir = kl_v3(-0.0f, axis, 0.0f);
    if (i % 16 == 3) dir = kl_v3(0.0f, 0.0f, axis);
    if (i % 16 == 9) dir = kl_normalize(kl_v3(0.0f, dir.y, dir.z));
    kl_ray ray = kl_ray_make(origin, dir, i % 3 == 0 ? kl_test_uniform(random) : KL_INF);
    if (i % 5 == 0) ray.tmin = 0.1f * kl_test_uniform(random);
    return ray;
}

static void compare(struct kl_flat *flat, uint64_t seed, int rays)
{
    struct fixture f = set_up(flat);
    struct kl_test_random random = {seed};
    int hits = 0, odd = 0;

    for (int i = 0; i < rays; ++i) {
        const kl_ray ray = make_ray(&random, i);
        int found = 0;
        odd += disagree(&flat->view, &ray, &found);
        hits += found;
    }
    tear_down(&f);
    assert_true(hits > rays / 100);
    /* Rays that graze an edge: both answers are right. */
    if (odd > rays / 2000) fail_msg("%d of %d rays differ", odd, rays);
}

static void soups(void **state)
{
    (void)state;
    compare(kl_test_soup(1, 3000, 0.3f, 0, 0), 20, 20000);
    compare(kl_test_soup(2, 20000, 0.05f, 0, 0), 21, 20000);
    compare(kl_test_soup(3, 3, 2.0f, 0, 0), 22, 4000);
    compare(kl_test_soup(4, 5, 2.0f, 0, 0), 22, 4000);
}

static void instances(void **state)
{
    (void)state;
    compare(kl_test_soup(5, 2000, 0.2f, 2000, 40), 23, 20000);
    compare(kl_test_soup(7, 0, 0.3f, 500, 1), 25, 20000);
    compare(kl_test_soup(8, 10, 0.3f, 3, 500), 26, 20000);
}

static void landscape(void **state)
{
    (void)state;
    compare(kl_test_landscape(64, 10), 27, 20000);
}

/* A closed surface leaks no ray, not even one aimed at a vertex or the middle of an edge. */
static void watertight(void **state)
{
    (void)state;
    struct fixture f = set_up(kl_test_landscape(64, 1));
    const struct kl_flat *flat = f.flat;
    struct kl_test_random random = {30};

    for (uint32_t i = 2 * 64 * 64; i < flat->triangle_count; ++i) {
        for (int k = 0; k < 6; ++k) {
            const kl_u32 *v = flat->triangles[i].v;
            const kl_vec3 a = kl_v3_load(flat->positions + 3 * v[k % 3]);
            const kl_vec3 b = kl_v3_load(flat->positions + 3 * v[(k + k / 3) % 3]);
            const kl_vec3 target = kl_v3_scale(kl_v3_add(a, b), 0.5f);
            const kl_vec3 jitter = kl_v3_scale(kl_test_direction(&random), 0.02f);
            const kl_vec3 origin = kl_v3_add(kl_v3(-0.8f, 0.35f, -0.8f), jitter);
            const kl_vec3 dir = kl_normalize(kl_v3_sub(target, origin));
            const kl_ray ray = kl_ray_make(origin, dir, KL_INF);
            kl_hit hit;
            assert_true(kl_bvh_closest(&flat->view, &ray, &hit));
            assert_true(hit.t < 0.2f);
            assert_true(kl_bvh_any(&flat->view, &ray));
        }
    }
    tear_down(&f);
}

static void degenerate(void **state)
{
    (void)state;
    struct kl_flat *flat = kl_test_soup(9, 400, 0.3f, 0, 0);
    float *p = flat->positions;

    for (uint32_t i = 0; i < 100; ++i) {
        float *t = p + 9 * (size_t)i;
        for (int k = 0; k < 9; ++k) {
            if (i % 4 == 0) t[k] = p[k % 3];              /* all in one point, many times */
            if (i % 4 == 1) t[k] = (float)(k / 3) * 0.1f; /* a line */
            if (i % 4 == 2) t[k] = t[k % 6];              /* two vertices equal */
        }
        if (i % 4 == 3) t[i % 9] = i % 8 == 3 ? NAN : INFINITY;
    }
    struct fixture f = set_up(flat);
    struct kl_test_random random = {31};
    for (int i = 0; i < 20000; ++i) {
        const kl_ray ray = make_ray(&random, i);
        int found = 0;
        kl_hit hit = {0};
        assert_int_equal(disagree(&flat->view, &ray, &found), 0);
        if (kl_bvh_closest(&flat->view, &ray, &hit)) assert_true(hit.triangle >= 100);
    }
    tear_down(&f);
}

/* Many equal triangles cannot be told apart by any split: the depth must stay bounded. */
static void many_equal_triangles(void **state)
{
    (void)state;
    struct kl_flat *flat = kl_test_soup(10, 5000, 0.3f, 100, 200);
    for (size_t i = 9; i < 9 * (size_t)5000; ++i) {
        flat->positions[i] = flat->positions[i % 9];
    }
    for (uint32_t i = 2; i < flat->instance_count; ++i) {
        flat->instances[i] = flat->instances[1];
    }
    compare(flat, 32, 4000);
}

static void nothing_to_hit(void **state)
{
    (void)state;
    struct fixture f = set_up(kl_test_soup(1, 0, 0.5f, 0, 2));
    const kl_ray ray = kl_ray_make(kl_v3(0.0f, 0.0f, 0.0f), kl_v3(0.0f, 0.0f, 1.0f), KL_INF);
    kl_hit hit;

    assert_int_equal(kl_bvh_closest(&f.flat->view, &ray, &hit), 0);
    assert_int_equal(kl_bvh_any(&f.flat->view, &ray), 0);
    f.flat->view.needs = 0;
    assert_int_equal(kl_bvh_closest(&f.flat->view, &ray, &hit), 0);
    assert_int_equal(kl_bvh_any(&f.flat->view, &ray), 0);
    tear_down(&f);
    kl_device_bvh_destroy(NULL);
}

static void same_scene_same_bytes(void **state)
{
    (void)state;
    struct fixture a = set_up(kl_test_landscape(256, 20));
    struct fixture b = set_up(kl_test_landscape(256, 20));

    assert_int_equal(a.bvh->node_count, b.bvh->node_count);
    assert_int_equal(a.bvh->leaf_count, b.bvh->leaf_count);
    assert_memory_equal(a.bvh->nodes, b.bvh->nodes, a.bvh->node_count * sizeof *a.bvh->nodes);
    assert_memory_equal(a.bvh->leaves, b.bvh->leaves, a.bvh->leaf_count * sizeof *a.bvh->leaves);
    assert_memory_equal(a.bvh->roots, b.bvh->roots, a.bvh->root_count * sizeof *a.bvh->roots);
    tear_down(&a);
    tear_down(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(soups),          cmocka_unit_test(instances),
        cmocka_unit_test(landscape),      cmocka_unit_test(watertight),
        cmocka_unit_test(degenerate),     cmocka_unit_test(many_equal_triangles),
        cmocka_unit_test(nothing_to_hit), cmocka_unit_test(same_scene_same_bytes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
