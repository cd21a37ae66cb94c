/* 8-bit previews: they lose range and colour, the EXR files are the result. */
#ifndef KL_SRC_IMAGE_PNG_H
#define KL_SRC_IMAGE_PNG_H

#include "src/image/image.h"

#ifdef __cplusplus
extern "C" {
#endif

enum kl_png_curve {
    KL_PNG_SRGB,   /* clipped at 1, then the sRGB curve */
    KL_PNG_FILMIC, /* a shoulder first: Narkowicz, "ACES Filmic Tone Mapping Curve", 2015 */
};

/* Zero is the default. */
struct kl_png_options {
    float exposure; /* [stops]: values are multiplied by 2^exposure */
    enum kl_png_curve curve;
};

/* R, G, B of the unnamed layer. NaN becomes 0. `path` appears whole or not at all. */
kl_status kl_png_write(const char *path, const struct kl_image *image,
                       const struct kl_png_options *options, struct kl_err *err) KL_MUST_CHECK;

/* `count` images in rows of `columns` (0: nearly square), each in a cell as large as the largest,
 * with `border` pixels of grey around every cell. Every image is first reduced by the whole factor
 * `reduce` (0 and 1: not), by averaging linear values. */
struct kl_png_sheet {
    size_t count;
    const struct kl_image *const *images;
    uint32_t columns, border, reduce;
};
kl_status kl_png_write_sheet(const char *path, const struct kl_png_sheet *sheet,
                             const struct kl_png_options *options,
                             struct kl_err *err) KL_MUST_CHECK;

/* Raw 8-bit sRGB triples, row by row from the top. */
kl_status kl_png_write_bytes(const char *path, uint32_t width, uint32_t height,
                             const unsigned char *rgb, struct kl_err *err) KL_MUST_CHECK;

#ifdef __cplusplus
}
#endif
#endif
