/* Metrics with answers that can be worked out by hand, and properties of FLIP. */
#include "src/image/flip.h"
#include "src/image/metrics.h"
#include "src/image/png.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

static struct kl_image *make(uint32_t width, uint32_t height, float value)
{
    static const char *const names[] = {"R", "G", "B"};
    struct kl_err err;
    struct kl_image *image = NULL;

    assert_int_equal(kl_image_create(width, height, &image, &err), KL_OK);
    for (int c = 0; c < 3; ++c) {
        float *data = NULL;
        assert_int_equal(kl_image_add_channel(image, names[c], KL_PIXEL_FLOAT, &data, &err), KL_OK);
        for (size_t i = 0; i < (size_t)width * height; ++i)
            data[i] = value;
    }
    return image;
}

static void assert_near(double a, double b, double tolerance)
{
    if (!(fabs(a - b) <= tolerance)) fail_msg("%.12g is not %.12g +- %g", a, b, tolerance);
}

static void constant_images(void **state)
{
    struct kl_err err;
    struct kl_metrics m;
    struct kl_image *test = make(20, 9, 2.2f);
    struct kl_image *reference = make(20, 9, 2.0f);
    const double d = (double)2.2f - 2.0;

    (void)state;
    assert_int_equal(kl_metrics_compare(test, reference, NULL, &m, &err), KL_OK);
    assert_near(m.mean_error, d / 2.0, 1e-12);
    assert_near(m.relmse, d * d / 4.0 / 1.01, 1e-12);
    assert_near(m.block8_relmse, m.relmse, 1e-12);
    assert_near(m.rmse, d, 1e-12);
    assert_near(m.max_abs, d, 1e-12);
    assert_near(m.psnr_peak, 2.0, 0.0);
    assert_near(m.psnr_db, 20.0 * log10(2.0 / d), 1e-9);
    assert_near(m.relative_p95, d / 2.0, 1e-7);
    assert_near(m.smape, 2.0 * d / ((double)2.2f + 2.0 + 0.02), 1e-12);
    assert_true(m.flip_mean > 0.0 && m.flip_mean < 0.2);
    assert_int_equal(m.pixels, 180);
    assert_int_equal(kl_metrics_compare(reference, reference, NULL, &m, &err), KL_OK);
    assert_near(m.relmse + m.rmse + m.smape + m.mean_error + m.flip_mean + m.flip_ldr_mean, 0, 0);
    assert_near(m.psnr_db, 200.0, 0.0);
    kl_image_destroy(test);
    kl_image_destroy(reference);
}

/* Of 100 pixels, 4 are 50 % off, 2 are 100 % off, and one that is black does not count. */
static void percentiles_of_the_relative_error(void **state)
{
    struct kl_err err;
    struct kl_metrics m;
    struct kl_image *test = make(101, 1, 3.0f);
    struct kl_image *reference = make(101, 1, 3.0f);

    (void)state;
    for (int c = 0; c < 3; ++c) {
        for (int i = 0; i < 6; ++i)
            test->channels[c].data[i] = i < 4 ? 4.5f : 6.0f;
        reference->channels[c].data[100] = 0.0f;
    }
    assert_int_equal(kl_metrics_compare(test, reference, NULL, &m, &err), KL_OK);
    assert_near(m.relative_p95, 0.5, 1e-6);
    assert_near(m.relative_p99, 1.0, 1e-6);
    kl_image_destroy(test);
    kl_image_destroy(reference);
}

static void layers(void **state)
{
    const struct kl_metrics_options options = {.layer = "albedo", .without_flip = true};
    struct kl_err err;
    struct kl_metrics m;
    struct kl_image *a = make(4, 4, 1.0f);
    struct kl_image *b = make(4, 4, 1.0f);
    float *data = NULL;

    (void)state;
    assert_int_equal(kl_metrics_compare(a, b, &options, &m, &err), KL_ERR_INPUT);
    for (int c = 0; c < 3; ++c) {
        char name[16];
        (void)snprintf(name, sizeof name, "albedo.%c", "RGB"[c]);
        assert_int_equal(kl_image_add_channel(a, name, KL_PIXEL_FLOAT, &data, &err), KL_OK);
        data[0] = 1.6f;
        assert_int_equal(kl_image_add_channel(b, name, KL_PIXEL_FLOAT, &data, &err), KL_OK);
        for (int i = 0; i < 16; ++i)
            data[i] = 0.1f;
    }
    assert_int_equal(kl_metrics_compare(a, b, &options, &m, &err), KL_OK);
    assert_near(m.mean_error, 0.0, 1e-6);
    assert_near(m.max_abs, 1.5, 1e-6);
    kl_image_destroy(a);
    kl_image_destroy(b);
}

static void noise_averages_out_in_blocks(void **state)
{
    struct kl_err err;
    struct kl_metrics m;
    struct kl_image *test = make(64, 64, 1.0f);
    struct kl_image *reference = make(64, 64, 1.0f);

    (void)state;
    for (int c = 0; c < 3; ++c) {
        for (size_t i = 0; i < 64 * 64; ++i)
            test->channels[c].data[i] += i % 2 ? 0.5f : -0.5f;
    }
    assert_int_equal(kl_metrics_compare(test, reference, NULL, &m, &err), KL_OK);
    assert_near(m.relmse, 0.25 / 1.01, 1e-12);
    assert_near(m.block8_relmse, 0.0, 1e-15);
    assert_near(m.mean_error, 0.0, 1e-15);
    kl_image_destroy(test);
    kl_image_destroy(reference);
}

static void bad_and_masked_pixels_are_left_out(void **state)
{
    struct kl_err err;
    struct kl_metrics m;
    struct kl_image *test = make(16, 16, 1.0f);
    struct kl_image *reference = make(16, 16, 1.0f);
    const struct kl_metrics_options options = {.mask_above = 10.0f};

    (void)state;
    test->channels[0].data[3] = NAN;
    reference->channels[1].data[4] = INFINITY;
    reference->channels[2].data[5] = 1000.0f;
    assert_int_equal(kl_metrics_compare(test, reference, &options, &m, &err), KL_OK);
    assert_int_equal(m.bad_pixels, 2);
    assert_int_equal(m.masked_pixels, 1);
    assert_int_equal(m.pixels, 253);
    assert_near(m.relmse + m.block8_relmse + m.rmse + m.flip_mean, 0.0, 0.0);
    for (size_t i = 0; i < 256; ++i)
        test->channels[0].data[i] = NAN;
    assert_int_equal(kl_metrics_compare(test, reference, &options, &m, &err), KL_ERR_INPUT);
    struct kl_image *other = make(8, 16, 1.0f);
    assert_int_equal(kl_metrics_compare(test, other, &options, &m, &err), KL_ERR_INPUT);
    kl_image_destroy(other);
    kl_image_destroy(test);
    kl_image_destroy(reference);
}

/* A picture with edges, gradients and colour, the same in every run. */
static void draw(struct kl_image *image, float noise)
{
    uint32_t seed = 1;

    for (uint32_t i = 0; i < image->width * image->height; ++i) {
        const float x = (float)(i % image->width) / (float)image->width;
        const float y = (float)(i / image->width) / (float)image->height;
        const float light = (x - 0.6f) * (x - 0.6f) + (y - 0.3f) * (y - 0.3f) < 0.01f ? 8.0f : 0.0f;
        for (int c = 0; c < 3; ++c) {
            seed = seed * 1664525u + 1013904223u;
            const float random = (float)(seed >> 8) / 16777216.0f - 0.5f;
            const float base = c == 0 ? x : (c == 1 ? y : 1.0f - x);
            image->channels[c].data[i] = 0.05f + base * base + light + noise * random;
        }
    }
}

/* Values of the authors' own program (flip-evaluator 1.7) for the same two pictures, negative
 * values set to 0. */
static void flip_agrees_with_its_authors(void **state)
{
    struct kl_err err;
    struct kl_metrics m;
    struct kl_image *test = make(120, 90, 0.0f);
    struct kl_image *reference = make(120, 90, 0.0f);

    (void)state;
    draw(test, 0.2f);
    draw(reference, 0.0f);
    assert_int_equal(kl_metrics_compare(test, reference, NULL, &m, &err), KL_OK);
    assert_near(m.flip_mean, 0.1988659, 1e-5);
    assert_near(m.flip_ldr_mean, 0.1115935, 1e-5);
    kl_image_destroy(test);
    kl_image_destroy(reference);
}

static void pictures_are_written(void **state)
{
    char dir[] = "/tmp/kl_png_XXXXXX";
    char path[64];
    struct kl_err err;
    struct kl_image *image = make(50, 40, 0.0f);
    struct kl_image *other = make(30, 40, 1.0f);
    const struct kl_image *const images[] = {image, other, image};
    const struct kl_png_sheet sheet = {.count = 3, .images = images, .border = 2, .reduce = 3};
    const struct kl_png_options options = {.exposure = 1.0f, .curve = KL_PNG_FILMIC};

    (void)state;
    draw(image, 0.1f);
    image->channels[0].data[0] = NAN;
    image->channels[0].data[1] = INFINITY;
    assert_non_null(mkdtemp(dir));
    (void)snprintf(path, sizeof path, "%s/a.png", dir);
    assert_int_equal(kl_png_write(path, image, &options, &err), KL_OK);
    assert_int_equal(kl_png_write_sheet(path, &sheet, NULL, &err), KL_OK);
    const struct kl_difference_options difference = {.sigma_px = 4.0f};
    assert_int_equal(kl_metrics_write_difference(path, image, image, &difference, &err), KL_OK);
    assert_int_equal(kl_metrics_write_difference(path, image, other, NULL, &err), KL_ERR_INPUT);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(rmdir(dir), 0);
    kl_image_destroy(image);
    kl_image_destroy(other);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(constant_images),
        cmocka_unit_test(percentiles_of_the_relative_error),
        cmocka_unit_test(layers),
        cmocka_unit_test(noise_averages_out_in_blocks),
        cmocka_unit_test(bad_and_masked_pixels_are_left_out),
        cmocka_unit_test(flip_agrees_with_its_authors),
        cmocka_unit_test(pictures_are_written),
    };

    return cmocka_run_group_tests_name("image_metrics", tests, NULL, NULL);
}
