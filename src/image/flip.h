/* The FLIP difference of what an eye sees that flips between two pictures.
 * Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", HPG 2020, and
 * "Visualizing Errors in Rendered High Dynamic Range Images", Eurographics Short Papers 2021. */
#ifndef KL_SRC_IMAGE_FLIP_H
#define KL_SRC_IMAGE_FLIP_H

#include "src/base/status.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The papers' viewing condition: 0.7 m from a screen of 0.7 m and 3840 pixels. */
#define KL_FLIP_PIXELS_PER_DEGREE 67.0f

/* Planar linear Rec. 709, finite. */
struct kl_flip_images {
    uint32_t width, height;
    const float *test[3], *reference[3];
};

/* map[i] = FLIP of pixel i, 0 (equal) to 1. LDR: values are clipped to [0, 1]. */
kl_status kl_flip_ldr(const struct kl_flip_images *images, float pixels_per_degree, float *map,
                      struct kl_err *err) KL_MUST_CHECK;
/* HDR-FLIP: the largest LDR-FLIP over a range of exposures chosen from the reference, ACES curve. A
 * black reference has no exposure of its own: then exposure 0 is taken. */
kl_status kl_flip_hdr(const struct kl_flip_images *images, float pixels_per_degree, float *map,
                      struct kl_err *err) KL_MUST_CHECK;

#ifdef __cplusplus
}
#endif
#endif
