/* A picture of numbers. */
#ifndef KL_SRC_IMAGE_HEAT_H
#define KL_SRC_IMAGE_HEAT_H

#include "src/base/status.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* PNG of width * height values: 0 (and below) black, over red and yellow to white at `full_scale`
 * (and above), grey where a value is NAN. */
kl_status kl_heat_write(const char *path, uint32_t width, uint32_t height, const float *values,
                        float full_scale, struct kl_err *err) KL_MUST_CHECK;

#ifdef __cplusplus
}
#endif
#endif
