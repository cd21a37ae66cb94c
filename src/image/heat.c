#include "src/image/heat.h"

#include "src/base/memory.h"
#include "src/image/png.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>

static const unsigned char unknown_grey = 128;

/* The three channels rise one after the other. */
static void paint(float value, unsigned char *rgb)
{
    for (int c = 0; c < 3; ++c) {
        const float level = fminf(fmaxf(3.0f * value - (float)c, 0.0f), 1.0f);
        rgb[c] = isnan(value) ? unknown_grey : (unsigned char)(255.0f * level + 0.5f);
    }
}

kl_status kl_heat_write(const char *path, uint32_t width, uint32_t height, const float *values,
                        float full_scale, struct kl_err *err)
{
    const size_t count = (size_t)width * height;
    unsigned char *bytes = NULL;
    kl_status st = kl_alloc_array(&bytes, count, 3, err);

    if (st != KL_OK) return st;
    for (size_t i = 0; i < count; ++i)
        paint(values[i] / full_scale, bytes + 3 * i);
    st = kl_png_write_bytes(path, width, height, bytes, err);
    free(bytes);
    return st;
}
