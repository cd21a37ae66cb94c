/* Incoherent hemisphere rays: Embree on the host against the kernel on a device. Prints JSON.
 * Arguments: device selector ("opencl"), rays in millions (2), grid size of the landscape (200: 205
 * thousand triangles), work-items a group (16). */
#include "src/base/memory.h"
#include "src/device/device.h"
#include "src/device/device_scene.h"
#include "src/trace/device_bvh.h"
#include "src/trace/tracer.h"
#include "test_trace_scenes.h"
#include "tests/bench/bench_sort.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { RUNS = 5 };

struct bench {
    struct kl_flat *flat;
    struct kl_tracer *tracer;
    struct kl_device_bvh *bvh;
    kl_ray *rays;
    kl_hit *host_hits, *device_hits;
    uint32_t count;
    size_t group;
    double build_tracer, build_bvh, compile; /* [s] */
};

/* Wall time, or the time that all threads of this process worked, which other programs on the
 * machine do not change. */
static double now_on(clockid_t clock)
{
    struct timespec t;
    (void)clock_gettime(clock, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static double now(void)
{
    return now_on(CLOCK_MONOTONIC);
}

struct timing {
    double wall[RUNS], work[RUNS]; /* [s] */
};

static double median(double *values)
{
    bench_sort(values, RUNS);
    return values[RUNS / 2];
}

/* As a gather does: from random points of the surfaces, uniform over the hemisphere above. */
static void make_rays(struct bench *b)
{
    struct kl_test_random random = {99};

    for (uint32_t i = 0; i < b->count; ++i) {
        const uint32_t n = b->flat->triangle_count;
        const uint32_t k = (uint32_t)(kl_test_uniform(&random) * (float)n) % n;
        const kl_u32 *v = b->flat->triangles[k].v;
        const kl_vec3 p = kl_v3_load(b->flat->positions + 3 * (size_t)v[0]);
        const kl_vec3 q = kl_v3_load(b->flat->positions + 3 * (size_t)v[1]);
        const kl_vec3 r = kl_v3_load(b->flat->positions + 3 * (size_t)v[2]);
        const kl_vec3 normal = kl_normalize(kl_cross(kl_v3_sub(q, p), kl_v3_sub(r, p)));
        const kl_vec3 middle = kl_v3_scale(kl_v3_add(p, kl_v3_add(q, r)), 1.0f / 3.0f);
        kl_vec3 dir = kl_test_direction(&random);
        if (kl_dot(dir, normal) < 0.0f) dir = kl_v3_scale(dir, -1.0f);
        b->rays[i] = kl_ray_make(kl_v3_mad(middle, 1e-4f, normal), dir, KL_INF);
    }
}

static void time_host(const struct bench *b, int run, struct timing *timing)
{
    const double start = now();
    const double start_work = now_on(CLOCK_PROCESS_CPUTIME_ID);
    const int64_t count = b->count;

#pragma omp parallel for schedule(dynamic, 1024)
    for (int64_t i = 0; i < count; ++i) {
        b->host_hits[i].triangle = KL_NONE;
        (void)kl_trace_closest(&b->flat->view, &b->rays[i], &b->host_hits[i]);
    }
    timing->work[run] = now_on(CLOCK_PROCESS_CPUTIME_ID) - start_work;
    timing->wall[run] = now() - start;
}

static kl_status time_device(struct bench *b, struct kl_device *device, struct timing *timing,
                             struct kl_err *err)
{
    struct kl_device_program *program = NULL;
    struct kl_device_scene *scene = NULL;
    struct kl_device_buffer *rays = NULL, *hits = NULL;
    struct kl_device_arg args[KL_SCENE_ARG_COUNT + 3];
    const size_t ray_bytes = b->count * sizeof *b->rays;
    const size_t hit_bytes = b->count * sizeof *b->device_hits;
    double start = now();
    kl_status st =
        kl_device_program_create(device, "kernels/trace.cl", b->flat->view.needs, &program, err);

    b->compile = now() - start;
    if (st == KL_OK) st = kl_device_scene_create(device, b->flat, NULL, b->bvh, &scene, err);
    if (st == KL_OK) {
        st = kl_device_buffer_create(device, KL_DEVICE_INPUT, b->rays, ray_bytes, &rays, err);
    }
    if (st == KL_OK) {
        st = kl_device_buffer_create(device, KL_DEVICE_OUTPUT, b->device_hits, hit_bytes, &hits,
                                     err);
    }
    if (st != KL_OK) goto cleanup;
    kl_device_scene_get_args(scene, args);
    args[KL_SCENE_ARG_COUNT] = (struct kl_device_arg){.buffer = rays};
    args[KL_SCENE_ARG_COUNT + 1] = (struct kl_device_arg){.buffer = hits};
    args[KL_SCENE_ARG_COUNT + 2] = (struct kl_device_arg){.value = &b->count, .size = 4};
    for (int run = -1; st == KL_OK && run < RUNS; ++run) { /* -1: warms up */
        const double start_work = now_on(CLOCK_PROCESS_CPUTIME_ID);
        start = now();
        st = kl_device_run(program, "kl_trace_closest_batch", args, KL_SCENE_ARG_COUNT + 3,
                           b->count, b->group, err);
        if (run < 0) continue;
        timing->wall[run] = now() - start;
        timing->work[run] = now_on(CLOCK_PROCESS_CPUTIME_ID) - start_work;
    }
    if (st == KL_OK) st = kl_device_buffer_read(hits, err);

cleanup:
    kl_device_buffer_destroy(rays);
    kl_device_buffer_destroy(hits);
    kl_device_scene_destroy(scene);
    kl_device_program_destroy(program);
    return st;
}

static kl_status prepare(struct bench *b, uint32_t n, struct kl_err *err)
{
    b->flat = kl_test_landscape(n, n / 4);
    double start = now();
    kl_status st = kl_tracer_create(b->flat, &b->tracer, err);

    b->build_tracer = now() - start;
    start = now();
    if (st == KL_OK) st = kl_device_bvh_create(b->flat, NULL, &b->bvh, err);
    b->build_bvh = now() - start;
    if (st == KL_OK) st = kl_alloc_array(&b->rays, b->count, sizeof *b->rays, err);
    if (st == KL_OK) st = kl_alloc_array(&b->host_hits, b->count, sizeof *b->host_hits, err);
    if (st == KL_OK) st = kl_alloc_array(&b->device_hits, b->count, sizeof *b->device_hits, err);
    if (st == KL_OK) make_rays(b);
    return st;
}

static void print(struct bench *b, const struct kl_device *device, struct timing *host,
                  struct timing *on_device)
{
    uint32_t hits = 0, different = 0;

    for (uint32_t i = 0; i < b->count; ++i) {
        hits += b->host_hits[i].triangle != KL_NONE;
        different += b->host_hits[i].triangle != b->device_hits[i].triangle;
    }
    const double host_rate = (double)b->count / median(host->wall);
    const double device_rate = (double)b->count / median(on_device->wall);
    const double work_ratio = median(host->work) / median(on_device->work);
    const double best_ratio = host->work[0] / on_device->work[0]; /* sorted by median() */
    (void)printf("{\"device\": \"%s\", \"triangles\": %u, \"rays\": %u, \"hits\": %u,\n"
                 " \"embree_rays_per_s\": %.0f, \"device_rays_per_s\": %.0f, \"ratio\": %.3f, "
                 "\"work_ratio\": %.3f, \"best_ratio\": %.3f,\n"
                 " \"different\": %u, \"bvh_bytes\": %zu, \"seconds\": {\"build_embree\": %.3f, "
                 "\"build_bvh\": %.3f, \"compile\": %.3f}}\n",
                 kl_device_get_info(device)->name, b->flat->triangle_count, b->count, hits,
                 host_rate, device_rate, device_rate / host_rate, work_ratio, best_ratio, different,
                 b->bvh->node_count * sizeof *b->bvh->nodes +
                     b->bvh->leaf_count * sizeof *b->bvh->leaves,
                 b->build_tracer, b->build_bvh, b->compile);
}

int main(int argc, char **argv)
{
    const char *selector = argc > 1 ? argv[1] : "opencl";
    const double millions = argc > 2 ? strtod(argv[2], NULL) : 2.0;
    const unsigned long n = argc > 3 ? strtoul(argv[3], NULL, 10) : 200;
    const unsigned long group = argc > 4 ? strtoul(argv[4], NULL, 10) : 16;
    struct bench b = {.count = (uint32_t)(millions * 1e6), .group = group};
    struct kl_device *device = NULL;
    struct kl_err err = {0};
    struct timing host, on_device;
    kl_status st = kl_device_open(selector, &device, &err);

    if (st == KL_OK) st = prepare(&b, (uint32_t)n, &err);
    if (st == KL_OK) st = time_device(&b, device, &on_device, &err);
    if (st == KL_OK) {
        time_host(&b, 0, &host); /* warms up */
        for (int run = 0; run < RUNS; ++run) {
            time_host(&b, run, &host);
        }
        print(&b, device, &host, &on_device);
    } else {
        (void)fprintf(stderr, "%s\n", err.msg);
    }
    free(b.rays);
    free(b.host_hits);
    free(b.device_hits);
    kl_device_bvh_destroy(b.bvh);
    kl_tracer_destroy(b.tracer);
    if (b.flat != NULL) kl_test_scene_destroy(b.flat);
    kl_device_close(device);
    return st == KL_OK ? 0 : 1;
}
