/* Gather rays per second: the kernel on a device against Embree on the host, same batch. Prints
 * JSON. Arguments: device selector ("opencl"), rays a side (32), points (1000). */
#include "../kernel/gallery_batch.h"
#include "src/base/clock.h"
#include "src/base/memory.h"
#include "src/device/gather_device.h"
#include "tests/bench/bench_sort.h"

#include <stdio.h>
#include <stdlib.h>

enum { RUNS = 5 };

int main(int argc, char **argv)
{
    const char *selector = argc > 1 ? argv[1] : "opencl";
    const uint32_t side = argc > 2 ? (uint32_t)strtoul(argv[2], NULL, 10) : 32;
    const size_t points = argc > 3 ? (size_t)strtoul(argv[3], NULL, 10) : 1000;
    struct gallery_batch b;
    struct kl_gather_device *device = NULL;
    struct kl_err err;
    kl_gather_result *results = NULL;
    double host[RUNS];
    double other[RUNS];

    if (!gallery_batch_init(&b, side, points)) return 1;
    if (kl_gather_device_create(selector, b.flat, NULL, &device, &err) != KL_OK ||
        kl_alloc_array(&results, b.count, sizeof *results, &err) != KL_OK) {
        (void)fprintf(stderr, "%s\n", err.msg);
        return 1;
    }
    const struct kl_gather_job job = gallery_batch_job(&b, results);
    if (kl_gather_device_run(device, &job, &err) != KL_OK) return 1; /* compiles */
    for (int i = 0; i < RUNS; ++i) { /* turn about: both meet the same moods of the machine */
        double start = kl_seconds();
        if (kl_gather_host(&job, &err) != KL_OK) return 1;
        host[i] = kl_seconds() - start;
        start = kl_seconds();
        if (kl_gather_device_run(device, &job, &err) != KL_OK) return 1;
        other[i] = kl_seconds() - start;
    }
    bench_sort(host, RUNS);
    bench_sort(other, RUNS);
    const double rays = (double)b.count * side * side;
    (void)printf("{\"device\": \"%s\", \"rays\": %.0f, \"embree_rays_per_s\": %.4g, "
                 "\"device_rays_per_s\": %.4g, \"device_over_embree\": %.3f}\n",
                 kl_gather_device_get_info(device)->name, rays, rays / host[RUNS / 2],
                 rays / other[RUNS / 2], host[RUNS / 2] / other[RUNS / 2]);
    kl_gather_device_destroy(device);
    free(results);
    gallery_batch_fini(&b);
    return 0;
}
