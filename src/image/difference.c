#include "src/base/memory.h"
#include "src/image/metrics.h"
#include "src/image/png.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const float left_out_grey = 128.0f;

static float luminance(const float *const rgb[3], size_t i)
{
    return 0.2126f * rgb[0][i] + 0.7152f * rgb[1][i] + 0.0722f * rgb[2][i];
}

/* error[i] = NAN where the pixel is left out. */
static void relative_errors(const float *const test[3], const float *const reference[3],
                            size_t count, float mask_above, float *error)
{
    double total = 0.0;
    size_t n = 0;

    for (size_t i = 0; i < count; ++i) {
        bool used = true;
        for (int c = 0; c < 3; ++c) {
            used = used && isfinite(test[c][i]) && isfinite(reference[c][i]) &&
                   !(mask_above > 0.0f && reference[c][i] > mask_above);
        }
        error[i] = used ? 0.0f : NAN;
        if (!used) continue;
        total += (double)luminance(reference, i);
        ++n;
    }
    const float mean = n > 0 && total > 0.0 ? (float)(total / (double)n) : 1.0f;
    for (size_t i = 0; i < count; ++i) {
        if (isnan(error[i])) continue;
        const float r = luminance(reference, i);
        error[i] = (luminance(test, i) - r) / (fmaxf(r, 0.0f) + 0.01f * mean);
    }
}

/* Normalised Gaussian along one axis; pixels that are left out have no weight and stay NAN. */
static void blur_line(const float *from, float *to, size_t count, size_t step, float sigma)
{
    const long radius = (long)ceilf(3.0f * sigma);

    for (long i = 0; i < (long)count; ++i) {
        float total = 0.0f;
        float weight = 0.0f;
        for (long k = i - radius; k <= i + radius; ++k) {
            if (k < 0 || k >= (long)count || isnan(from[(size_t)k * step])) continue;
            const float d = (float)(k - i) / sigma;
            const float w = expf(-0.5f * d * d);
            total += w * from[(size_t)k * step];
            weight += w;
        }
        const size_t at = (size_t)i * step;
        to[at] = isnan(from[at]) ? NAN : total / weight;
    }
}

static void paint(float error, float full_scale, unsigned char *rgb)
{
    float color[3] = {left_out_grey, left_out_grey, left_out_grey};

    if (!isnan(error)) {
        const float t = fminf(fabsf(error) / full_scale, 1.0f);
        const float other = 255.0f * (1.0f - t);
        color[0] = error >= 0.0f ? 255.0f : other;
        color[1] = other;
        color[2] = error <= 0.0f ? 255.0f : other;
    }
    for (int c = 0; c < 3; ++c)
        rgb[c] = (unsigned char)(color[c] + 0.5f);
}

kl_status kl_metrics_write_difference(const char *path, const struct kl_image *test,
                                      const struct kl_image *reference,
                                      const struct kl_difference_options *options,
                                      struct kl_err *err)
{
    struct kl_difference_options o = {0};
    const float *rgb[2][3];
    float *error = NULL;
    unsigned char *bytes = NULL;

    if (options != NULL) o = *options;
    if (!(o.full_scale > 0.0f)) o.full_scale = 0.5f;
    if (test->width != reference->width || test->height != reference->height) {
        return kl_fail(err, KL_ERR_INPUT, "sizes differ: test %u x %u, reference %u x %u",
                       test->width, test->height, reference->width, reference->height);
    }
    if (o.sigma_px > 1000.0f) {
        return kl_fail(err, KL_ERR_USAGE, "sigma of %g pixels is above 1000", (double)o.sigma_px);
    }
    const size_t count = (size_t)test->width * test->height;
    kl_status st = kl_image_get_rgb(test, o.layer, rgb[0], err);
    if (st == KL_OK) st = kl_image_get_rgb(reference, o.layer, rgb[1], err);
    if (st == KL_OK) st = kl_alloc_array(&error, count, 2 * sizeof *error, err);
    if (st == KL_OK) st = kl_alloc_array(&bytes, count, 3, err);
    if (st != KL_OK) goto cleanup;
    relative_errors(rgb[0], rgb[1], count, o.mask_above, error);
    if (o.sigma_px > 0.0f) {
        float *half = error + count;
        for (size_t y = 0; y < test->height; ++y) {
            blur_line(error + y * test->width, half + y * test->width, test->width, 1, o.sigma_px);
        }
        for (size_t x = 0; x < test->width; ++x) {
            blur_line(half + x, error + x, test->height, test->width, o.sigma_px);
        }
    }
    for (size_t i = 0; i < count; ++i)
        paint(error[i], o.full_scale, bytes + 3 * i);
    st = kl_png_write_bytes(path, test->width, test->height, bytes, err);

cleanup:
    free(error);
    free(bytes);
    return st;
}
