#include "src/image/png.h"

#include "src/base/file.h"
#include "src/base/memory.h"

#include <math.h>
#include <png.h>
#include <stdlib.h>
#include <string.h>

enum { BORDER_GREY = 96 };

static float filmic(float x)
{
    return (x * (2.51f * x + 0.03f)) / (x * (2.43f * x + 0.59f) + 0.14f);
}

/* IEC 61966-2-1. */
static unsigned char encode(float x, const struct kl_png_options *options, float scale)
{
    if (!(x > 0.0f)) return 0; /* also NaN */
    x *= scale;
    if (x > 1e6f) x = 1e6f; /* infinity would make the filmic curve NaN */
    if (options->curve == KL_PNG_FILMIC) x = filmic(x);
    if (x >= 1.0f) return 255;
    const float y = x <= 0.0031308f ? 12.92f * x : 1.055f * powf(x, 1.0f / 2.4f) - 0.055f;
    return (unsigned char)(y * 255.0f + 0.5f);
}

kl_status kl_png_write_bytes(const char *path, uint32_t width, uint32_t height,
                             const unsigned char *rgb, struct kl_err *err)
{
    /* libpng's simplified interface: no setjmp on our side. */
    png_image png;
    png_alloc_size_t size = 0;
    unsigned char *file = NULL;

    memset(&png, 0, sizeof png);
    png.version = PNG_IMAGE_VERSION;
    png.width = width;
    png.height = height;
    png.format = PNG_FORMAT_RGB;
    size = PNG_IMAGE_PNG_SIZE_MAX(png);
    kl_status st = kl_alloc_array(&file, size, 1, err);
    if (st != KL_OK) return st;
    if (png_image_write_to_memory(&png, file, &size, 0, rgb, 0, NULL) == 0) {
        st = kl_fail(err, KL_ERR_IO, "%s: PNG encoder: %s", path, png.message);
    } else {
        st = kl_file_replace(path, file, size, err);
    }
    png_image_free(&png);
    free(file);
    return st;
}

static uint32_t reduced(uint32_t size, uint32_t factor)
{
    return (size + factor - 1) / factor;
}

/* Mean of a factor x factor block, cut at the image's edges; NaN counts as 0. */
static float block_mean(const struct kl_image *image, const float *data, uint32_t x, uint32_t y,
                        uint32_t factor)
{
    const uint32_t x1 = x + factor < image->width ? x + factor : image->width;
    const uint32_t y1 = y + factor < image->height ? y + factor : image->height;
    float sum = 0.0f;

    if (factor == 1) return data[(size_t)y * image->width + x];
    for (uint32_t v = y; v < y1; ++v) {
        for (uint32_t u = x; u < x1; ++u) {
            const float value = data[(size_t)v * image->width + u];
            if (!isnan(value)) sum += value;
        }
    }
    return sum / (float)((x1 - x) * (y1 - y));
}

/* Draw an image with its top left corner at `to`, `stride` bytes a row. */
static kl_status draw(unsigned char *to, size_t stride, const struct kl_image *image,
                      uint32_t factor, const struct kl_png_options *options, struct kl_err *err)
{
    const float scale = exp2f(options->exposure);
    const uint32_t width = reduced(image->width, factor);
    const uint32_t height = reduced(image->height, factor);
    const float *rgb[3];
    kl_status st = kl_image_get_rgb(image, NULL, rgb, err);

    if (st != KL_OK) return st;
    for (uint32_t y = 0; y < height; ++y) {
        for (uint32_t x = 0; x < width; ++x) {
            for (int c = 0; c < 3; ++c) {
                const float v = block_mean(image, rgb[c], x * factor, y * factor, factor);
                to[y * stride + (size_t)x * 3 + (size_t)c] = encode(v, options, scale);
            }
        }
    }
    return KL_OK;
}

kl_status kl_png_write(const char *path, const struct kl_image *image,
                       const struct kl_png_options *options, struct kl_err *err)
{
    const struct kl_png_sheet sheet = {.count = 1, .images = &image, .columns = 1};

    return kl_png_write_sheet(path, &sheet, options, err);
}

kl_status kl_png_write_sheet(const char *path, const struct kl_png_sheet *sheet,
                             const struct kl_png_options *options, struct kl_err *err)
{
    const uint32_t factor = sheet->reduce > 1 ? sheet->reduce : 1;
    const struct kl_png_options defaults = {0};
    uint64_t cell_w = 0;
    uint64_t cell_h = 0;
    unsigned char *rgb = NULL;

    if (sheet->count == 0) return kl_fail(err, KL_ERR_USAGE, "%s: no images", path);
    for (size_t i = 0; i < sheet->count; ++i) {
        const uint32_t w = reduced(sheet->images[i]->width, factor);
        const uint32_t h = reduced(sheet->images[i]->height, factor);
        if (w > cell_w) cell_w = w;
        if (h > cell_h) cell_h = h;
    }
    uint64_t columns = sheet->columns;
    if (columns == 0) columns = (uint64_t)ceil(sqrt((double)sheet->count));
    if (columns > sheet->count) columns = sheet->count;
    const uint64_t rows = (sheet->count + columns - 1) / columns;
    const uint64_t width = columns * (cell_w + sheet->border) + sheet->border;
    const uint64_t height = rows * (cell_h + sheet->border) + sheet->border;
    if (width > KL_IMAGE_MAX_SIDE || height > KL_IMAGE_MAX_SIDE) {
        return kl_fail(err, KL_ERR_USAGE, "%s: the picture would be larger than %d pixels", path,
                       KL_IMAGE_MAX_SIDE);
    }
    kl_status st = kl_alloc_array(&rgb, (size_t)(width * height), 3, err);
    if (st != KL_OK) return st;
    memset(rgb, BORDER_GREY, (size_t)(width * height) * 3);
    for (size_t i = 0; i < sheet->count && st == KL_OK; ++i) {
        const uint64_t x = sheet->border + i % columns * (cell_w + sheet->border);
        const uint64_t y = sheet->border + i / columns * (cell_h + sheet->border);
        st = draw(rgb + (y * width + x) * 3, (size_t)width * 3, sheet->images[i], factor,
                  options != NULL ? options : &defaults, err);
        if (st != KL_OK) (void)kl_wrap(err, "%s: image %zu", path, i + 1);
    }
    if (st == KL_OK) st = kl_png_write_bytes(path, (uint32_t)width, (uint32_t)height, rgb, err);
    free(rgb);
    return st;
}
