/* How far a picture is from a reference. All numbers are over R, G and B of one layer. */
#ifndef KL_SRC_IMAGE_METRICS_H
#define KL_SRC_IMAGE_METRICS_H

#include "src/image/image.h"

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Zero is the default. */
struct kl_metrics_options {
    float mask_above;  /* > 0: leave out pixels with a reference channel above this (lamps) */
    bool without_flip; /* FLIP costs far more than all the rest */
    const char *layer; /* borrowed; NULL or "": the unnamed one */
};

/* I: test, R: reference. A mean is over the pixels that count: not masked, and finite in both
 * pictures; blocks are means over such pixels too. "Scaled": both pictures are first multiplied by
 * 1 / mean(R) over all three channels (by 1 where that mean is not above 0), so that the constants
 * below mean the same for every exposure. Sums are compensated, in double. */
struct kl_metrics {
    uint32_t width, height;
    uint64_t pixels;        /* that count */
    uint64_t bad_pixels;    /* NaN or infinite in either picture: left out */
    uint64_t masked_pixels; /* left out by mask_above */
    double relmse;          /* scaled: mean of (I - R)^2 / (R^2 + 0.01) over pixels and channels */
    double relmse_trimmed;  /* relmse without the worst 0.01 % of the pixels (at least none) */
    double block8_relmse;   /* relmse of the means of 8 x 8 blocks (smaller at right and bottom);
                             * blocks with a masked pixel are left out whole */
    double rmse;            /* sqrt of the mean of (I - R)^2, not scaled */
    double psnr_peak;       /* 99.9th percentile of all channel values of R, not scaled */
    double psnr_db;         /* 20 log10(psnr_peak / rmse), at most 200, which also says "equal" */
    double smape;           /* scaled: mean of 2 |I - R| / (|I| + |R| + 0.01), 0 to 2 */
    double relative_p95;    /* 95th percentile of |Y(I) - Y(R)| / Y(R), luminance, over the pixels
                             * with Y(R) above a thousandth of its mean; 0 where there is none */
    double relative_p99;    /* likewise the 99th */
    double mean_error;      /* (mean(I) - mean(R)) / mean(R); undivided where mean(R) <= 0 */
    double max_abs;         /* largest |I - R|, not scaled */
    double flip_mean;       /* HDR-FLIP at 67 pixels per degree; 0 if without_flip */
    double flip_p95;        /* its 95th percentile over pixels */
    double flip_ldr_mean;   /* FLIP of the pictures clipped to [0, 1] */
};

/* KL_ERR_INPUT: sizes differ, a channel is missing, or no pixel counts. `options` may be NULL. */
kl_status kl_metrics_compare(const struct kl_image *test, const struct kl_image *reference,
                             const struct kl_metrics_options *options, struct kl_metrics *out,
                             struct kl_err *err) KL_MUST_CHECK;

/* Zero is the default. */
struct kl_difference_options {
    float full_scale; /* relative error that is drawn in full colour; 0: 0.5 */
    float sigma_px;   /* > 0: low-pass the error first (16 shows splotches); 0: not */
    float mask_above; /* as above */
    const char *layer;
};

/* PNG of (Y(I) - Y(R)) / (Y(R) + 0.01 mean Y(R)): white 0, red too bright, blue too dark, grey left
 * out. */
kl_status kl_metrics_write_difference(const char *path, const struct kl_image *test,
                                      const struct kl_image *reference,
                                      const struct kl_difference_options *options,
                                      struct kl_err *err) KL_MUST_CHECK;

#ifdef __cplusplus
}
#endif
#endif
