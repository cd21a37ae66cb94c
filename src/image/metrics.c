#include "src/image/metrics.h"

#include "src/base/memory.h"
#include "src/image/flip.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double relmse_epsilon = 1e-2;
static const double smape_epsilon = 1e-2;
static const double relative_least = 1e-3; /* of the mean: darker pixels have no relative error */
static const double psnr_limit_db = 200.0;

/* Neumaier's compensated sum. */
struct sum {
    double total, lost;
};

static void sum_add(struct sum *s, double x)
{
    const double t = s->total + x;

    if (fabs(s->total) >= fabs(x)) {
        s->lost += (s->total - t) + x;
    } else {
        s->lost += (x - t) + s->total;
    }
    s->total = t;
}

static double sum_get(const struct sum *s)
{
    return s->total + s->lost;
}

struct pair {
    uint32_t width, height;
    size_t count;
    const float *test[3], *reference[3];
    unsigned char *counts; /* COUNTS, MASKED or BAD */
};

enum { BAD = 0, COUNTS = 1, MASKED = 2 };

static kl_status mark_pixels(struct pair *p, float mask_above, struct kl_metrics *out,
                             struct kl_err *err)
{
    kl_status st = kl_alloc_array(&p->counts, p->count, 1, err);

    if (st != KL_OK) return st;
    for (size_t i = 0; i < p->count; ++i) {
        bool bad = false;
        bool masked = false;
        for (int c = 0; c < 3; ++c) {
            bad = bad || !isfinite(p->test[c][i]) || !isfinite(p->reference[c][i]);
            masked = masked || (mask_above > 0.0f && p->reference[c][i] > mask_above);
        }
        if (bad) {
            ++out->bad_pixels;
        } else if (masked) {
            ++out->masked_pixels;
            p->counts[i] = MASKED;
        } else {
            p->counts[i] = COUNTS;
        }
    }
    out->pixels = p->count - out->bad_pixels - out->masked_pixels;
    if (out->pixels == 0) {
        return kl_fail(err, KL_ERR_INPUT, "no pixel to compare: %llu are not finite, %llu masked",
                       (unsigned long long)out->bad_pixels, (unsigned long long)out->masked_pixels);
    }
    return KL_OK;
}

/* p->counts is the caller's to free, whatever is returned. */
static kl_status pair_up(struct pair *p, const struct kl_image *test,
                         const struct kl_image *reference, const struct kl_metrics_options *options,
                         struct kl_metrics *out, struct kl_err *err)
{
    memset(p, 0, sizeof *p);
    memset(out, 0, sizeof *out);
    if (test->width != reference->width || test->height != reference->height) {
        return kl_fail(err, KL_ERR_INPUT, "sizes differ: test %u x %u, reference %u x %u",
                       test->width, test->height, reference->width, reference->height);
    }
    p->width = out->width = test->width;
    p->height = out->height = test->height;
    p->count = (size_t)p->width * p->height;
    kl_status st = kl_image_get_rgb(test, options->layer, p->test, err);
    if (st != KL_OK) return kl_wrap(err, "test");
    st = kl_image_get_rgb(reference, options->layer, p->reference, err);
    if (st != KL_OK) return kl_wrap(err, "reference");
    return mark_pixels(p, options->mask_above, out, err);
}

static double mean_get(const struct pair *p, const float *const rgb[3], uint64_t pixels)
{
    struct sum s = {0};

    for (int c = 0; c < 3; ++c) {
        for (size_t i = 0; i < p->count; ++i) {
            if (p->counts[i] == COUNTS) sum_add(&s, (double)rgb[c][i]);
        }
    }
    return sum_get(&s) / (3.0 * (double)pixels);
}

static double relative_square(double test, double reference)
{
    const double d = test - reference;

    return d * d / (reference * reference + relmse_epsilon);
}

static int compare_doubles(const void *a, const void *b)
{
    const double x = *(const double *)a;
    const double y = *(const double *)b;

    return (x > y) - (x < y);
}

/* All that is a mean over single pixels. */
static kl_status measure_pixels(const struct pair *p, double scale, struct kl_metrics *out,
                                struct kl_err *err)
{
    struct sum relative = {0};
    struct sum square = {0};
    struct sum symmetric = {0};
    struct sum trimmed = {0};
    double *errors = NULL;
    size_t n = 0;
    kl_status st = kl_alloc_array(&errors, out->pixels, sizeof *errors, err);

    if (st != KL_OK) return st;
    for (size_t i = 0; i < p->count; ++i) {
        if (p->counts[i] != COUNTS) continue;
        double error = 0.0;
        for (int c = 0; c < 3; ++c) {
            const double test = (double)p->test[c][i];
            const double reference = (double)p->reference[c][i];
            const double d = fabs(test - reference);
            error += relative_square(test * scale, reference * scale);
            sum_add(&square, d * d);
            sum_add(&symmetric,
                    2.0 * d * scale / ((fabs(test) + fabs(reference)) * scale + smape_epsilon));
            if (d > out->max_abs) out->max_abs = d;
        }
        sum_add(&relative, error);
        errors[n++] = error;
    }
    qsort(errors, n, sizeof *errors, compare_doubles);
    const size_t kept = n - n / 10000;
    for (size_t i = 0; i < kept; ++i)
        sum_add(&trimmed, errors[i]);
    const double values = 3.0 * (double)n;
    out->relmse = sum_get(&relative) / values;
    out->relmse_trimmed = sum_get(&trimmed) / (3.0 * (double)kept);
    out->rmse = sqrt(sum_get(&square) / values);
    out->smape = sum_get(&symmetric) / values;
    free(errors);
    return KL_OK;
}

/* False where no pixel of the block counts, or one is masked: what is left beside a lamp is too few
 * pixels to be compared with whole blocks. */
static bool block_means(const struct pair *p, const float *data, uint32_t x0, uint32_t y0,
                        double *mean)
{
    const uint32_t x1 = x0 + 8 < p->width ? x0 + 8 : p->width;
    const uint32_t y1 = y0 + 8 < p->height ? y0 + 8 : p->height;
    double total = 0.0;
    unsigned n = 0;

    for (uint32_t y = y0; y < y1; ++y) {
        for (uint32_t x = x0; x < x1; ++x) {
            const size_t i = (size_t)y * p->width + x;
            if (p->counts[i] == MASKED) return false;
            if (p->counts[i] == BAD) continue;
            total += (double)data[i];
            ++n;
        }
    }
    if (n > 0) *mean = total / n;
    return n > 0;
}

static double measure_blocks(const struct pair *p, double scale)
{
    struct sum relative = {0};
    uint64_t n = 0;

    for (uint32_t y = 0; y < p->height; y += 8) {
        for (uint32_t x = 0; x < p->width; x += 8) {
            for (int c = 0; c < 3; ++c) {
                double test = 0.0;
                double reference = 0.0;
                if (!block_means(p, p->test[c], x, y, &test)) continue;
                (void)block_means(p, p->reference[c], x, y, &reference);
                sum_add(&relative, relative_square(test * scale, reference * scale));
                ++n;
            }
        }
    }
    return n > 0 ? sum_get(&relative) / (double)n : 0.0;
}

static int compare_floats(const void *a, const void *b)
{
    const float x = *(const float *)a;
    const float y = *(const float *)b;

    return (x > y) - (x < y);
}

/* Sorts `values`: the smallest value that at least `share` of them do not exceed. */
static double percentile(float *values, size_t count, double share)
{
    qsort(values, count, sizeof *values, compare_floats);
    size_t rank = (size_t)ceil(share * (double)count);
    if (rank > 0) --rank;
    return (double)values[rank < count ? rank : count - 1];
}

static kl_status measure_psnr(const struct pair *p, struct kl_metrics *out, struct kl_err *err)
{
    float *values = NULL;
    size_t n = 0;
    kl_status st = kl_alloc_array(&values, out->pixels, 3 * sizeof *values, err);

    if (st != KL_OK) return st;
    for (int c = 0; c < 3; ++c) {
        for (size_t i = 0; i < p->count; ++i) {
            if (p->counts[i] == COUNTS) values[n++] = p->reference[c][i];
        }
    }
    out->psnr_peak = percentile(values, n, 0.999);
    out->psnr_db = psnr_limit_db;
    if (out->rmse > 0.0) {
        const double db = 20.0 * log10(fmax(out->psnr_peak, 1e-30) / out->rmse);
        out->psnr_db = fmin(db, psnr_limit_db);
    }
    free(values);
    return KL_OK;
}

static double luminance(const float *const rgb[3], size_t i)
{
    return 0.2126 * (double)rgb[0][i] + 0.7152 * (double)rgb[1][i] + 0.0722 * (double)rgb[2][i];
}

static kl_status measure_relative(const struct pair *p, struct kl_metrics *out, struct kl_err *err)
{
    struct sum sum = {0};
    float *values = NULL;
    size_t n = 0;
    kl_status st = kl_alloc_array(&values, out->pixels, sizeof *values, err);

    if (st != KL_OK) return st;
    for (size_t i = 0; i < p->count; ++i) {
        if (p->counts[i] == COUNTS) sum_add(&sum, luminance(p->reference, i));
    }
    const double least = relative_least * sum_get(&sum) / (double)out->pixels;
    for (size_t i = 0; i < p->count; ++i) {
        if (p->counts[i] != COUNTS) continue;
        const double r = luminance(p->reference, i);
        if (r > least && r > 0.0) values[n++] = (float)(fabs(luminance(p->test, i) - r) / r);
    }
    if (n > 0) out->relative_p95 = percentile(values, n, 0.95);
    if (n > 0) out->relative_p99 = percentile(values, n, 0.99);
    free(values);
    return KL_OK;
}

/* Mean of the map over the pixels that count; the map is packed to those. */
static double map_mean(const struct pair *p, float *map)
{
    struct sum s = {0};
    size_t n = 0;

    for (size_t i = 0; i < p->count; ++i) {
        if (p->counts[i] != COUNTS) continue;
        sum_add(&s, (double)map[i]);
        map[n++] = map[i];
    }
    return sum_get(&s) / (double)n;
}

/* FLIP filters over neighbours, so pixels that do not count are made equal (black) in both. */
static kl_status measure_flip(const struct pair *p, struct kl_metrics *out, struct kl_err *err)
{
    struct kl_flip_images images = {.width = p->width, .height = p->height};
    float *memory = NULL;
    kl_status st = kl_alloc_array(&memory, p->count, 7 * sizeof *memory, err);

    if (st != KL_OK) return st;
    float *map = memory + 6 * p->count;
    for (size_t c = 0; c < 3; ++c) {
        float *test = memory + 2 * c * p->count;
        float *reference = test + p->count;
        for (size_t i = 0; i < p->count; ++i) {
            if (p->counts[i] != COUNTS) continue;
            test[i] = p->test[c][i];
            reference[i] = p->reference[c][i];
        }
        images.test[c] = test;
        images.reference[c] = reference;
    }
    st = kl_flip_ldr(&images, KL_FLIP_PIXELS_PER_DEGREE, map, err);
    if (st != KL_OK) goto cleanup;
    out->flip_ldr_mean = map_mean(p, map);
    st = kl_flip_hdr(&images, KL_FLIP_PIXELS_PER_DEGREE, map, err);
    if (st != KL_OK) goto cleanup;
    out->flip_mean = map_mean(p, map);
    out->flip_p95 = percentile(map, out->pixels, 0.95);

cleanup:
    free(memory);
    return st;
}

kl_status kl_metrics_compare(const struct kl_image *test, const struct kl_image *reference,
                             const struct kl_metrics_options *options, struct kl_metrics *out,
                             struct kl_err *err)
{
    const struct kl_metrics_options defaults = {0};
    const struct kl_metrics_options *o = options != NULL ? options : &defaults;
    struct pair p;
    struct kl_metrics m;
    kl_status st = pair_up(&p, test, reference, o, &m, err);

    if (st != KL_OK) goto cleanup;
    const double mean_test = mean_get(&p, p.test, m.pixels);
    const double mean_reference = mean_get(&p, p.reference, m.pixels);
    const double scale = mean_reference > 0.0 ? 1.0 / mean_reference : 1.0;
    m.mean_error = (mean_test - mean_reference) * scale;
    st = measure_pixels(&p, scale, &m, err);
    if (st != KL_OK) goto cleanup;
    m.block8_relmse = measure_blocks(&p, scale);
    st = measure_psnr(&p, &m, err);
    if (st == KL_OK) st = measure_relative(&p, &m, err);
    if (st == KL_OK && !o->without_flip) st = measure_flip(&p, &m, err);
    if (st == KL_OK) *out = m;

cleanup:
    free(p.counts);
    return st;
}
