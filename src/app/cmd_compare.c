#include "src/app/commands.h"
#include "src/app/folders.h"
#include "src/app/json_text.h"
#include "src/image/exr.h"
#include "src/image/metrics.h"

#include <jansson.h>
#include <stdio.h>

static json_t *describe(const struct kl_metrics *m)
{
    return json_pack(
        "{s:I,s:I,s:I,s:I,s:I,s:f,s:f,s:f,s:f,s:f,s:f,s:f,s:f,s:f,s:f,s:f,s:f,s:f,s:f}", "width",
        (json_int_t)m->width, "height", (json_int_t)m->height, "pixels", (json_int_t)m->pixels,
        "bad_pixels", (json_int_t)m->bad_pixels, "masked_pixels", (json_int_t)m->masked_pixels,
        "relmse", m->relmse, "relmse_trimmed", m->relmse_trimmed, "block8_relmse", m->block8_relmse,
        "rmse", m->rmse, "psnr_db", m->psnr_db, "psnr_peak", m->psnr_peak, "smape", m->smape,
        "mean_error", m->mean_error, "flip_mean", m->flip_mean, "flip_p95", m->flip_p95,
        "flip_ldr_mean", m->flip_ldr_mean, "max_abs", m->max_abs, "relative_p95", m->relative_p95,
        "relative_p99", m->relative_p99);
}

static void print_text(const struct kl_metrics *m)
{
    (void)printf("size           %ux%u, %llu pixels count\n", (unsigned)m->width,
                 (unsigned)m->height, (unsigned long long)m->pixels);
    if (m->bad_pixels > 0) {
        (void)printf("bad_pixels     %llu NaN or infinite\n", (unsigned long long)m->bad_pixels);
    }
    if (m->masked_pixels > 0) {
        (void)printf("masked_pixels  %llu\n", (unsigned long long)m->masked_pixels);
    }
    (void)printf("relmse         %.6g\n", m->relmse);
    (void)printf("block8_relmse  %.6g\n", m->block8_relmse);
    (void)printf("rmse           %.6g\n", m->rmse);
    (void)printf("psnr_db        %.4g (peak %.4g)\n", m->psnr_db, m->psnr_peak);
    (void)printf("smape          %.6g\n", m->smape);
    (void)printf("mean_error     %+.6g\n", m->mean_error);
    (void)printf("max_abs        %.6g\n", m->max_abs);
    (void)printf("relative_p95   %.6g\n", m->relative_p95);
    (void)printf("flip_mean      %.6g\n", m->flip_mean);
}

static kl_status write_json(const struct kl_options *o, const struct kl_metrics *metrics,
                            struct kl_err *err)
{
    json_t *root = describe(metrics);
    if (root == NULL) return kl_fail(err, KL_ERR_NO_MEMORY, "compare: out of memory");
    kl_status st = kl_json_write(root, o->json_file, err);
    json_decref(root);
    return st;
}

kl_status kl_command_compare(const struct kl_options *options, struct kl_err *err)
{
    const struct kl_options *o = options;
    const struct kl_metrics_options metrics_options = {.mask_above = (float)o->mask_above,
                                                       .layer = o->layer};
    const struct kl_difference_options difference = {.mask_above = (float)o->mask_above,
                                                     .layer = o->layer};
    struct kl_image *test = NULL;
    struct kl_image *reference = NULL;
    struct kl_metrics metrics;
    kl_status st = kl_file_expect(o->arguments[0], "", err);

    if (st == KL_OK) st = kl_file_expect(o->arguments[1], "", err);
    if (st == KL_OK) st = kl_exr_read(o->arguments[0], &test, err);
    if (st == KL_OK) st = kl_exr_read(o->arguments[1], &reference, err);
    if (st == KL_OK) st = kl_metrics_compare(test, reference, &metrics_options, &metrics, err);
    if (st == KL_OK && o->json) st = write_json(o, &metrics, err);
    if (st == KL_OK && (!o->json || o->json_file != NULL)) print_text(&metrics);
    if (st == KL_OK && o->diff != NULL) {
        st = kl_metrics_write_difference(o->diff, test, reference, &difference, err);
    }
    kl_image_destroy(test);
    kl_image_destroy(reference);
    return st;
}
