/* Device and host gather the same irradiance at a thousand records of a real scene. */
#include "gallery_batch.h"
#include "src/base/memory.h"
#include "src/device/gather_device.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { SIDE = 32, POINTS = 1000 };

/* Where a hit, a shadow or a look-up lies within rounding of an edge, a ray may go another way here
 * than there. One such ray moves the sum by what it carries: a lamp's light at most 64 times the
 * mean, else no more than a white surface in the brightest place sends. */
static double largest_explained(const kl_gather_result *host, double brightest)
{
    return fmax(64.0 * (double)host->irr[1], brightest) / (SIDE * SIDE);
}

static void test_device_equals_host(void **state)
{
    struct gallery_batch b;
    struct kl_gather_device *device = NULL;
    struct kl_err err;
    kl_gather_result *host = NULL;
    kl_gather_result *other = NULL;

    (void)state;
    if (!gallery_batch_init(&b, SIDE, POINTS)) {
        gallery_batch_fini(&b);
        skip();
    }
    if (kl_gather_device_create("opencl", b.flat, NULL, &device, &err) != KL_OK) {
        (void)printf("skipped: %s\n", err.msg);
        gallery_batch_fini(&b);
        skip();
    }
    assert_int_equal(kl_alloc_array(&host, b.count, sizeof *host, &err), KL_OK);
    assert_int_equal(kl_alloc_array(&other, b.count, sizeof *other, &err), KL_OK);
    const struct kl_gather_job on_host = gallery_batch_job(&b, host);
    const struct kl_gather_job on_device = gallery_batch_job(&b, other);
    assert_int_equal(kl_gather_host(&on_host, &err), KL_OK);
    assert_int_equal(kl_gather_device_run(device, &on_device, &err), KL_OK);
    size_t close = 0;
    size_t unexplained = 0;
    double brightest = 0.0;
    for (size_t i = 0; i < b.count; ++i) {
        brightest = fmax(brightest, (double)host[i].irr[1]);
    }
    double worst = 0.0;
    for (size_t i = 0; i < b.count; ++i) {
        const double h = (double)host[i].irr[1];
        const double d = (double)other[i].irr[1];
        const double off = fabs(h - d) / fmax(h, 1e-6);
        close += off < 1e-3;
        worst = fmax(worst, off);
        if (off > 1e-3) {
            (void)printf("record %zu: %.6g on the host, %.6g on the device: %.2f of a ray\n", i, h,
                         d, fabs(h - d) / largest_explained(&host[i], brightest));
        }
        unexplained += fabs(h - d) >= largest_explained(&host[i], brightest);
    }
    (void)printf("%zu of %zu records within 1e-3, worst %.2g\n", close, b.count, worst);
    assert_true((double)close >= 0.995 * (double)b.count);
    assert_int_equal(unexplained, 0);
    kl_gather_device_destroy(device);
    free(host);
    free(other);
    gallery_batch_fini(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_device_equals_host)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
