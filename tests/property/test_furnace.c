/* Closed scenes whose light is known: a furnace (albedo 0.5, emission 0.5: radiance 1 everywhere)
 * and an integrating sphere (indirect irradiance the same everywhere). */
#include "property_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>

static void report(const char *what, const struct property_spread *s)
{
    print_message("%s: mean %.5f, deviation %.5f, worst %.5f of %u pixels\n", what, s->mean,
                  s->deviation, s->worst, s->pixels);
}

static void furnace_by_paths(void **state)
{
    struct property_stage stage;
    (void)state;
    if (!property_has("furnace")) skip();
    property_open(&stage, "furnace", KL_INDIRECT_PATH, 0.0, NULL);
    const struct kl_camera camera = property_look(&stage, "camera", 0.0, 96);
    struct kl_image *image = property_render(&stage, &camera, 1, 64, NULL);
    const struct property_spread s = property_measure(image, "G", 1.0);
    report("furnace by paths", &s);
    assert_true(fabs(s.mean - 1.0) < 1e-3);
    kl_image_destroy(image);
    property_close(&stage);
}

struct served {              /* pixels that the records served alone */
    double worst, deviation; /* relative error of indirect light */
    double beyond;           /* share further off than 3 standard errors, as told, and 0.5 % */
    double late;             /* share of pixels with samples that no record served */
};

static struct served judge(const struct kl_image *image, double exact)
{
    const struct kl_channel *errors = kl_image_find(image, "cache.error");
    const struct kl_channel *l = kl_image_find(image, "diffuse_indirect.G");
    const struct kl_channel *lates = kl_image_find(image, "cache.late");
    const size_t pixels = (size_t)image->width * image->height;
    struct served s = {0};
    size_t n = 0;
    for (size_t i = 0; i < pixels; ++i) {
        if (lates->data[i] > 0.0f) continue;
        const double e = fabs((double)l->data[i] / exact - 1.0);
        s.worst = fmax(s.worst, e);
        s.deviation += e * e;
        s.beyond += e > 3.0 * (double)errors->data[i] + 0.005;
        ++n;
    }
    assert_true(n > 0);
    s.deviation = sqrt(s.deviation / (double)n);
    s.beyond /= (double)n;
    s.late = (double)(pixels - n) / (double)pixels;
    return s;
}

/* Emission 0.5 and direct 0.25 are sampled; what the cache serves is the other 0.25. */
static void furnace_by_the_cache(void **state)
{
    struct property_stage stage;
    (void)state;
    if (!property_has("furnace")) skip();
    property_open(&stage, "furnace", KL_INDIRECT_CACHE, 0.0, NULL);
    const struct kl_camera camera = property_look(&stage, "camera", 0.0, 96);
    property_fill(&stage, &camera, 1, false, NULL);
    struct kl_counts counts;
    struct kl_image *image = property_render(&stage, &camera, 1, 32, &counts);
    const struct property_spread all = property_measure(image, "G", 1.0);
    const struct property_spread cached = property_measure(image, "diffuse_indirect.G", 0.25);
    report("furnace by the cache", &all);
    report("its indirect part", &cached);
    print_message("late %llu of %llu look-ups\n", (unsigned long long)counts.late,
                  (unsigned long long)counts.lookups);
    const struct served s = judge(image, 0.25);
    print_message("served pixels: worst %.4f, deviation %.4f, beyond 3 sigma %.4f; late %.4f\n",
                  s.worst, s.deviation, s.beyond, s.late);
    assert_true(fabs(all.mean - 1.0) < 2e-3);
    assert_true(fabs(cached.mean / 0.25 - 1.0) < 2e-3);
    assert_true(s.beyond < 0.005);
    assert_true(s.deviation < 0.02); /* the default of what is aimed at */
    assert_true(s.late < 0.05);
    kl_image_destroy(image);
    property_close(&stage);
}

/* The lamp at the centre blocks a little, alike for all: what is left is near 1. */
static void integrating_sphere_is_flat(void **state)
{
    struct property_stage stage;
    (void)state;
    if (!property_has("integrating-sphere")) skip();
    property_open(&stage, "integrating-sphere", KL_INDIRECT_CACHE, 0.0, NULL);
    const struct kl_camera camera = property_look(&stage, "camera", 0.0, 96);
    property_fill(&stage, &camera, 1, false, NULL);
    struct kl_image *image = property_render(&stage, &camera, 1, 4, NULL);
    const struct kl_channel *e = kl_image_find(image, "irradiance.G");
    const struct kl_channel *albedo = kl_image_find(image, "albedo.G");
    double sum = 0.0;
    double square = 0.0;
    double worst = 0.0;
    uint32_t n = 0;
    for (size_t i = 0; i < (size_t)image->width * image->height; ++i) {
        if (albedo->data[i] < 0.79f) continue; /* the lamp, in part or all */
        const double v = (double)e->data[i];
        sum += v;
        square += v * v;
        worst = fmax(worst, fabs(v - 1.0));
        ++n;
    }
    const double mean = sum / n;
    const double deviation = sqrt(fmax(0.0, square / n - mean * mean));
    print_message("integrating sphere: E %.4f, deviation %.4f, worst %.4f from 1\n", mean,
                  deviation, worst);
    assert_true(fabs(mean - 1.0) < 0.02);
    assert_true(deviation < 0.01 * mean);
    assert_true(worst < 0.06);
    kl_image_destroy(image);
    property_close(&stage);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(furnace_by_paths),
        cmocka_unit_test(furnace_by_the_cache),
        cmocka_unit_test(integrating_sphere_is_flat),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
