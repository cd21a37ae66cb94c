/* Rays traced by the device's kernels against the same code on the host, and Embree. */
#include "kernels/bvh.h"
#include "src/base/memory.h"
#include "src/device/device.h"
#include "src/device/device_scene.h"
#include "src/trace/device_bvh.h"
#include "src/trace/tracer.h"
#include "test_trace_scenes.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { RAYS = 20011 };

struct batch {
    kl_ray rays[RAYS];
    kl_hit hits[RAYS];
    uint32_t blocked[RAYS];
};

static void fill_rays(struct batch *batch, uint64_t seed)
{
    struct kl_test_random random = {seed};

    for (int i = 0; i < RAYS; ++i) {
        const kl_vec3 origin =
            kl_v3_scale(kl_test_direction(&random), 2.5f * kl_test_uniform(&random));
        kl_vec3 dir = kl_test_direction(&random);
        if (i % 16 == 0) dir = kl_v3(0.0f, i % 32 == 0 ? 1.0f : -1.0f, -0.0f);
        batch->rays[i] = kl_ray_make(origin, dir, i % 3 == 0 ? kl_test_uniform(&random) : KL_INF);
        if (i % 5 == 0) batch->rays[i].tmin = 0.1f * kl_test_uniform(&random);
    }
}

static kl_status run_kernel(struct kl_device_program *program, const char *name,
                            const struct kl_device_scene *scene, struct kl_device_buffer *rays,
                            struct kl_device_buffer *out, struct kl_err *err)
{
    const uint32_t count = RAYS;
    struct kl_device_arg args[KL_SCENE_ARG_COUNT + 3];

    kl_device_scene_get_args(scene, args);
    args[KL_SCENE_ARG_COUNT] = (struct kl_device_arg){.buffer = rays};
    args[KL_SCENE_ARG_COUNT + 1] = (struct kl_device_arg){.buffer = out};
    args[KL_SCENE_ARG_COUNT + 2] = (struct kl_device_arg){.value = &count, .size = sizeof count};
    kl_status st = kl_device_run(program, name, args, KL_SCENE_ARG_COUNT + 3, RAYS, 64, err);
    return st == KL_OK ? kl_device_buffer_read(out, err) : st;
}

static kl_status trace(struct kl_device *device, const struct kl_flat *flat,
                       const struct kl_device_bvh *bvh, struct batch *batch, struct kl_err *err)
{
    struct kl_device_program *program = NULL;
    struct kl_device_scene *scene = NULL;
    struct kl_device_buffer *rays = NULL, *hits = NULL, *blocked = NULL;
    kl_status st =
        kl_device_program_create(device, "kernels/trace.cl", flat->view.needs, &program, err);

    if (st == KL_OK) st = kl_device_scene_create(device, flat, NULL, bvh, &scene, err);
    if (st == KL_OK) {
        st = kl_device_buffer_create(device, KL_DEVICE_INPUT, batch->rays, sizeof batch->rays,
                                     &rays, err);
    }
    if (st == KL_OK) {
        st = kl_device_buffer_create(device, KL_DEVICE_OUTPUT, batch->hits, sizeof batch->hits,
                                     &hits, err);
    }
    if (st == KL_OK) {
        st = kl_device_buffer_create(device, KL_DEVICE_OUTPUT, batch->blocked,
                                     sizeof batch->blocked, &blocked, err);
    }
    if (st == KL_OK) st = run_kernel(program, "kl_trace_closest_batch", scene, rays, hits, err);
    if (st == KL_OK) st = run_kernel(program, "kl_trace_any_batch", scene, rays, blocked, err);
    kl_device_buffer_destroy(rays);
    kl_device_buffer_destroy(hits);
    kl_device_buffer_destroy(blocked);
    kl_device_scene_destroy(scene);
    kl_device_program_destroy(program);
    return st;
}

/* A ray that grazes an edge may go either way when a device rounds differently. */
static int differs(const kl_hit *a, int a_found, const kl_hit *b, int b_found, float slack)
{
    if (a_found != b_found) return 1;
    if (!a_found) return 0;
    return !(fabsf(a->t - b->t) <= slack * (1.0f + b->t));
}

static void compare(struct kl_device *device, struct kl_flat *flat, uint64_t seed)
{
    struct kl_tracer *tracer = NULL;
    struct kl_device_bvh *bvh = NULL;
    struct batch *batch = NULL;
    struct kl_err err = {0};
    int hits = 0, odd_host = 0, odd_embree = 0;

    kl_status st = kl_tracer_create(flat, &tracer, &err);
    if (st == KL_OK) st = kl_device_bvh_create(flat, NULL, &bvh, &err);
    if (st == KL_OK) st = kl_alloc_array(&batch, 1, sizeof *batch, &err);
    if (st == KL_OK) {
        fill_rays(batch, seed);
        st = trace(device, flat, bvh, batch, &err);
    }
    if (st != KL_OK) fail_msg("%s", err.msg);
    for (int i = 0; i < RAYS; ++i) {
        kl_hit host = {0}, embree = {0};
        const kl_hit *got = &batch->hits[i];
        const int found = got->triangle != KL_NONE;
        const int host_found = kl_bvh_closest(&flat->view, &batch->rays[i], &host);
        const int embree_found = kl_trace_closest(&flat->view, &batch->rays[i], &embree);
        odd_host += differs(got, found, &host, host_found, 1e-6f);
        odd_embree += differs(got, found, &embree, embree_found, 2e-5f);
        assert_int_equal(batch->blocked[i], found);
        hits += found;
    }
    (void)printf("%d hits, %d differ from the host, %d from Embree\n", hits, odd_host, odd_embree);
    assert_true(hits > RAYS / 100);
    assert_true(odd_host <= RAYS / 2000 && odd_embree <= RAYS / 2000);
    free(batch);
    kl_device_bvh_destroy(bvh);
    kl_tracer_destroy(tracer);
    kl_test_scene_destroy(flat);
}

static void device_hits_are_host_hits(void **state)
{
    (void)state;
    struct kl_device *device = NULL;
    struct kl_err err = {0};

    if (kl_device_open("opencl", &device, &err) != KL_OK) {
        (void)printf("SKIPPED: %s\n", err.msg);
        skip();
    }
    compare(device, kl_test_soup(1, 5000, 0.2f, 0, 0), 1);
    compare(device, kl_test_landscape(64, 10), 2);
    compare(device, kl_test_soup(2, 1000, 0.2f, 1000, 30), 3);
    compare(device, kl_test_soup(3, 0, 0.2f, 500, 7), 4);
    compare(device, kl_test_soup(4, 3, 2.0f, 0, 0), 5);
    kl_device_close(device);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(device_hits_are_host_hits)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
