#include "src/base/file.h"
#include "src/base/memory.h"
#include "src/image/exr.h"
#include "src/image/exr_impl.h"

#include <stdlib.h>
#include <string.h>

static const float largest_half = 65504.0f;

/* Attributes that readers know by name come first: features of the format, not of this program. */
static bool is_standard(const char *name)
{
    static const char *const names[] = {
        "owner",         "comments",   "capDate",  "utcOffset", "framesPerSecond",
        "focus",         "expTime",    "aperture", "isoSpeed",  "whiteLuminance",
        "worldToCamera", "worldToNDC", "software",
    };

    for (size_t i = 0; i < sizeof names / sizeof names[0]; ++i) {
        if (strcmp(names[i], name) == 0) return true;
    }
    return false;
}

static exr_result_t put_attribute(exr_context_t file, const struct kl_attribute *a)
{
    exr_attr_v2f_t v2f;
    exr_attr_rational_t rational;
    exr_attr_chromaticities_t chroma;
    exr_attr_m44f_t m44f;

    switch (a->type) {
    case KL_ATTRIBUTE_STRING:
        return exr_attr_set_string(file, 0, a->name, a->value.string);
    case KL_ATTRIBUTE_INT:
        return exr_attr_set_int(file, 0, a->name, a->value.i);
    case KL_ATTRIBUTE_FLOAT:
        return exr_attr_set_float(file, 0, a->name, a->value.f);
    case KL_ATTRIBUTE_DOUBLE:
        return exr_attr_set_double(file, 0, a->name, a->value.d);
    case KL_ATTRIBUTE_V2F:
        memcpy(&v2f, a->value.v2f, sizeof v2f);
        return exr_attr_set_v2f(file, 0, a->name, &v2f);
    case KL_ATTRIBUTE_RATIONAL:
        rational.num = a->value.rational.numerator;
        rational.denom = a->value.rational.denominator;
        return exr_attr_set_rational(file, 0, a->name, &rational);
    case KL_ATTRIBUTE_CHROMATICITIES:
        memcpy(&chroma, a->value.chromaticities, sizeof chroma);
        return exr_attr_set_chromaticities(file, 0, a->name, &chroma);
    case KL_ATTRIBUTE_M44F:
        memcpy(&m44f, a->value.m44f, sizeof m44f);
        return exr_attr_set_m44f(file, 0, a->name, &m44f);
    default:
        return EXR_ERR_INVALID_ARGUMENT;
    }
}

static exr_result_t put_attributes(exr_context_t file, const struct kl_image *image)
{
    /* ITU-R BT.709, white D65. */
    const exr_attr_chromaticities_t rec709 = {0.64f, 0.33f, 0.30f,   0.60f,
                                              0.15f, 0.06f, 0.3127f, 0.3290f};
    const struct kl_attribute *chroma = kl_image_get_attribute(image, "chromaticities");
    exr_result_t r = EXR_ERR_SUCCESS;

    if (chroma == NULL) {
        r = exr_attr_set_chromaticities(file, 0, "chromaticities", &rec709);
    } else {
        r = put_attribute(file, chroma);
    }
    for (int pass = 0; pass < 2; ++pass) {
        for (size_t i = 0; i < image->attribute_count && r == EXR_ERR_SUCCESS; ++i) {
            const struct kl_attribute *a = &image->attributes[i];
            if (a == chroma || is_standard(a->name) != (pass == 0)) continue;
            r = put_attribute(file, a);
        }
    }
    return r;
}

static int compare_channels(const void *a, const void *b)
{
    const struct kl_channel *const *x = a;
    const struct kl_channel *const *y = b;

    return strcmp((*x)->name, (*y)->name);
}

static exr_result_t put_header(exr_context_t file, const struct kl_image *image,
                               const struct kl_channel *const *sorted)
{
    static const exr_pixel_type_t types[] = {
        [KL_PIXEL_HALF] = EXR_PIXEL_HALF,
        [KL_PIXEL_FLOAT] = EXR_PIXEL_FLOAT,
        [KL_PIXEL_UINT] = EXR_PIXEL_UINT,
    };
    int part = 0;
    exr_result_t r = exr_set_longname_support(file, 1);

    if (r == EXR_ERR_SUCCESS) r = exr_add_part(file, "rgba", EXR_STORAGE_SCANLINE, &part);
    if (r == EXR_ERR_SUCCESS) {
        r = exr_initialize_required_attr_simple(file, part, (int32_t)image->width,
                                                (int32_t)image->height, EXR_COMPRESSION_ZIP);
    }
    for (size_t i = 0; i < image->channel_count && r == EXR_ERR_SUCCESS; ++i) {
        r = exr_add_channel(file, part, sorted[i]->name, types[sorted[i]->pixel],
                            EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
    }
    if (r == EXR_ERR_SUCCESS) r = put_attributes(file, image);
    if (r == EXR_ERR_SUCCESS) r = exr_write_header(file);
    return r;
}

/* Rows [y, y + lines) of a channel as the encoder is to see them. Half channels go through
 * `scratch`, limited to what half can hold: an infinite pixel would spoil every later filter. */
static const void *rows_get(const struct kl_image *image, const struct kl_channel *channel,
                            uint32_t y, uint32_t lines, float *scratch)
{
    const size_t first = (size_t)y * image->width;
    const size_t count = (size_t)lines * image->width;

    if (channel->pixel == KL_PIXEL_UINT) return channel->uints + first;
    if (channel->pixel == KL_PIXEL_FLOAT) return channel->data + first;
    for (size_t i = 0; i < count; ++i) {
        float v = channel->data[first + i];
        if (v > largest_half) v = largest_half;
        if (v < -largest_half) v = -largest_half;
        scratch[i] = v;
    }
    return scratch;
}

static exr_result_t put_chunk(exr_context_t file, const struct kl_image *image,
                              const struct kl_channel *const *sorted, uint32_t y, float *scratch,
                              exr_encode_pipeline_t *encoder)
{
    exr_chunk_info_t chunk;
    exr_result_t r = exr_write_scanline_chunk_info(file, 0, (int)y, &chunk);

    if (r != EXR_ERR_SUCCESS) return r;
    if (y == 0) {
        r = exr_encoding_initialize(file, 0, &chunk, encoder);
    } else {
        r = exr_encoding_update(file, 0, &chunk, encoder);
    }
    if (r != EXR_ERR_SUCCESS) return r;
    const size_t chunk_values = (size_t)chunk.height * image->width;
    for (size_t i = 0; i < image->channel_count; ++i) {
        exr_coding_channel_info_t *c = &encoder->channels[i];
        const uint16_t uint_or_float =
            sorted[i]->pixel == KL_PIXEL_UINT ? EXR_PIXEL_UINT : EXR_PIXEL_FLOAT;
        c->user_bytes_per_element = 4;
        c->user_data_type = uint_or_float;
        c->user_pixel_stride = 4;
        c->user_line_stride = (int32_t)(image->width * 4);
        c->encode_from_ptr =
            rows_get(image, sorted[i], y, (uint32_t)chunk.height, scratch + i * chunk_values);
    }
    if (y == 0) r = exr_encoding_choose_default_routines(file, 0, encoder);
    if (r == EXR_ERR_SUCCESS) r = exr_encoding_run(file, 0, encoder);
    return r;
}

static exr_result_t put_pixels(exr_context_t file, const struct kl_image *image,
                               const struct kl_channel *const *sorted, float *scratch,
                               uint32_t step)
{
    exr_encode_pipeline_t encoder = EXR_ENCODE_PIPELINE_INITIALIZER;
    exr_result_t r = EXR_ERR_SUCCESS;

    for (uint32_t y = 0; y < image->height && r == EXR_ERR_SUCCESS; y += step) {
        r = put_chunk(file, image, sorted, y, scratch, &encoder);
    }
    const exr_result_t end = exr_encoding_destroy(file, &encoder);
    return r != EXR_ERR_SUCCESS ? r : end;
}

static kl_status write_stream(struct exr_stream *stream, const char *path,
                              const struct kl_image *image, const struct kl_channel *const *sorted,
                              struct kl_err *err)
{
    const exr_context_initializer_t setup = exr_stream_setup(stream);
    exr_context_t file = NULL;
    float *scratch = NULL;
    int32_t step = 0;
    kl_status st = KL_OK;
    exr_result_t r = exr_start_write(&file, path, EXR_WRITE_FILE_DIRECTLY, &setup);

    if (r == EXR_ERR_SUCCESS) r = put_header(file, image, sorted);
    if (r == EXR_ERR_SUCCESS) r = exr_get_scanlines_per_chunk(file, 0, &step);
    if (r == EXR_ERR_SUCCESS) {
        st = kl_alloc_array(&scratch, (size_t)step * image->width * image->channel_count,
                            sizeof *scratch, err);
        if (st == KL_OK) r = put_pixels(file, image, sorted, scratch, (uint32_t)step);
    }
    if (st == KL_OK && r != EXR_ERR_SUCCESS) st = exr_stream_check(stream, r, KL_ERR_IO, err);
    if (file != NULL) {
        r = exr_finish(&file); /* writes the table of chunks */
        if (st == KL_OK) st = exr_stream_check(stream, r, KL_ERR_IO, err);
    }
    free(scratch);
    return st;
}

kl_status kl_exr_write(const char *path, const struct kl_image *image, struct kl_err *err)
{
    struct exr_stream stream = {.fd = -1};
    struct kl_file_temp file;
    const struct kl_channel **sorted = NULL;

    if (image->channel_count == 0) return kl_fail(err, KL_ERR_USAGE, "%s: no channels", path);
    const size_t item = sizeof *sorted; /* NOLINT(bugprone-sizeof-expression): of pointers */
    kl_status st = kl_alloc_array(&sorted, image->channel_count, item, err);
    if (st != KL_OK) return st;
    for (size_t i = 0; i < image->channel_count; ++i)
        sorted[i] = &image->channels[i];
    qsort(sorted, image->channel_count, item, compare_channels);

    st = kl_file_temp_open(path, &file, err);
    if (st == KL_OK) {
        stream.fd = file.fd;
        st = write_stream(&stream, path, image, sorted, err);
        if (st == KL_OK) {
            st = kl_file_temp_commit(&file, err);
        } else {
            kl_file_temp_discard(&file);
        }
    }
    free(sorted);
    return st == KL_OK ? KL_OK : kl_wrap(err, "%s", path);
}
