/* OpenEXR files: written as scan lines, ZIP, one part; read whatever the flat formats allow. */
#ifndef KL_SRC_IMAGE_EXR_H
#define KL_SRC_IMAGE_EXR_H

#include "src/image/image.h"

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Write all channels. Values of half channels are limited to +-65504 (NaN stays NaN). Attributes:
 * `chromaticities` always (Rec. 709 unless set), then the standard ones, then all others in the
 * order in which they were set. `path` appears whole or not at all (kl_file_temp_commit). */
kl_status kl_exr_write(const char *path, const struct kl_image *image,
                       struct kl_err *err) KL_MUST_CHECK;

/* Read part 0 of a scan-line or tiled file (level 0), any compression but DWA (the library's C
 * core has none), the pixels of its data window. Attributes of types that struct kl_attribute does
 * not have are left out. *out is the caller's. KL_ERR_INPUT: not an EXR file, deep, subsampled,
 * incomplete or too large. */
kl_status kl_exr_read(const char *path, struct kl_image **out, struct kl_err *err) KL_MUST_CHECK;

/* Size and attributes only: *out has no channels. *complete says
 * whether every chunk is there (pixels are not decoded). KL_ERR_INPUT: the header is unusable. */
kl_status kl_exr_read_header(const char *path, struct kl_image **out, bool *complete,
                             struct kl_err *err) KL_MUST_CHECK;

#ifdef __cplusplus
}
#endif
#endif
