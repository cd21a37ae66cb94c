#include "src/image/exr.h"
#include "src/image/exr_impl.h"

#include <fcntl.h>
#include <inttypes.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* An open file and what its header says. */
struct reader {
    struct exr_stream stream;
    exr_context_t file;
    exr_storage_t storage;
    exr_attr_box2i_t window;
    const exr_attr_chlist_t *channels; /* borrowed from `file` */
    struct kl_image *image;
};

static kl_status check(struct reader *reader, exr_result_t result, struct kl_err *err)
{
    return exr_stream_check(&reader->stream, result, KL_ERR_INPUT, err);
}

static kl_status open_file(struct reader *reader, const char *path, struct kl_err *err)
{
    exr_context_initializer_t setup = exr_stream_setup(&reader->stream);
    struct stat info;

    setup.max_image_width = KL_IMAGE_MAX_SIDE;
    setup.max_image_height = KL_IMAGE_MAX_SIDE;
    setup.max_tile_width = KL_IMAGE_MAX_SIDE;
    setup.max_tile_height = KL_IMAGE_MAX_SIDE;
    /* Guessing at lost chunks would turn an unfinished frame into a picture with holes. */
    setup.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    reader->stream.fd = open(path, O_RDONLY | O_CLOEXEC);
    if (reader->stream.fd < 0) return kl_fail_errno(err, "open");
    if (fstat(reader->stream.fd, &info) != 0) return kl_fail_errno(err, "stat");
    if (!S_ISREG(info.st_mode)) return kl_fail(err, KL_ERR_INPUT, "not a regular file");
    reader->stream.size = info.st_size;
    return check(reader, exr_start_read(&reader->file, path, &setup), err);
}

/* PIZ has no bound on how far it shrinks; no other one gets beyond deflate's 1032:1. */
static bool is_bounded(exr_compression_t compression)
{
    return compression != EXR_COMPRESSION_PIZ;
}

/* Limits first, so that a few hostile bytes cannot make us allocate gigabytes. */
static kl_status check_size(struct reader *reader, int64_t width, int64_t height,
                            struct kl_err *err)
{
    const uint64_t values = (uint64_t)(width * height) * (uint64_t)reader->channels->num_channels;
    exr_compression_t compression = EXR_COMPRESSION_NONE;
    kl_status st = check(reader, exr_get_compression(reader->file, 0, &compression), err);

    if (st != KL_OK) return st;
    if (compression == EXR_COMPRESSION_DWAA || compression == EXR_COMPRESSION_DWAB) {
        return kl_fail(err, KL_ERR_INPUT, "DWA compression is not read: save it with ZIP or PIZ");
    }
    if (reader->channels->num_channels > KL_IMAGE_MAX_CHANNELS || values > KL_IMAGE_MAX_VALUES) {
        return kl_fail(err, KL_ERR_INPUT, "%" PRId64 " x %" PRId64 " x %d channels: too large",
                       width, height, reader->channels->num_channels);
    }
    if (is_bounded(compression) && values * 2 / 1100 > (uint64_t)reader->stream.size) {
        return kl_fail(err, KL_ERR_INPUT,
                       "%" PRId64 " x %" PRId64 " x %d channels cannot be in %" PRId64 " bytes",
                       width, height, reader->channels->num_channels, reader->stream.size);
    }
    return KL_OK;
}

static kl_status read_layout(struct reader *reader, struct kl_err *err)
{
    kl_status st = check(reader, exr_get_storage(reader->file, 0, &reader->storage), err);

    if (st != KL_OK) return st;
    if (reader->storage != EXR_STORAGE_SCANLINE && reader->storage != EXR_STORAGE_TILED) {
        return kl_fail(err, KL_ERR_INPUT, "deep image: only flat ones are read");
    }
    st = check(reader, exr_get_data_window(reader->file, 0, &reader->window), err);
    if (st != KL_OK) return st;
    st = check(reader, exr_get_channels(reader->file, 0, &reader->channels), err);
    if (st != KL_OK) return st;
    const exr_attr_box2i_t *w = &reader->window;
    const int64_t width = (int64_t)w->max.x - w->min.x + 1;
    const int64_t height = (int64_t)w->max.y - w->min.y + 1;
    if (width < 1 || height < 1 || width > KL_IMAGE_MAX_SIDE || height > KL_IMAGE_MAX_SIDE) {
        return kl_fail(err, KL_ERR_INPUT, "size %" PRId64 " x %" PRId64 " is not within 1 to %d",
                       width, height, KL_IMAGE_MAX_SIDE);
    }
    for (int i = 0; i < reader->channels->num_channels; ++i) {
        const exr_attr_chlist_entry_t *c = &reader->channels->entries[i];
        if (c->x_sampling != 1 || c->y_sampling != 1) {
            return kl_fail(err, KL_ERR_INPUT, "channel %s is subsampled (%d x %d): not read",
                           c->name.str, c->x_sampling, c->y_sampling);
        }
    }
    st = check_size(reader, width, height, err);
    if (st != KL_OK) return st;
    return kl_image_create((uint32_t)width, (uint32_t)height, &reader->image, err);
}

/* False where struct kl_attribute has no such type or the name is too long. */
static bool convert_attribute(const exr_attribute_t *from, struct kl_attribute *to)
{
    if (from->name_length == 0 || from->name_length >= KL_IMAGE_NAME_SIZE) return false;
    memset(to, 0, sizeof *to);
    memcpy(to->name, from->name, from->name_length);
    if (from->type == EXR_ATTR_INT) {
        to->type = KL_ATTRIBUTE_INT;
        to->value.i = from->i;
    } else if (from->type == EXR_ATTR_FLOAT) {
        to->type = KL_ATTRIBUTE_FLOAT;
        to->value.f = from->f;
    } else if (from->type == EXR_ATTR_DOUBLE) {
        to->type = KL_ATTRIBUTE_DOUBLE;
        to->value.d = from->d;
    } else if (from->type == EXR_ATTR_V2F) {
        to->type = KL_ATTRIBUTE_V2F;
        memcpy(to->value.v2f, from->v2f, sizeof to->value.v2f);
    } else if (from->type == EXR_ATTR_RATIONAL) {
        to->type = KL_ATTRIBUTE_RATIONAL;
        to->value.rational.numerator = from->rational->num;
        to->value.rational.denominator = from->rational->denom;
    } else if (from->type == EXR_ATTR_CHROMATICITIES) {
        to->type = KL_ATTRIBUTE_CHROMATICITIES;
        memcpy(to->value.chromaticities, from->chromaticities, sizeof to->value.chromaticities);
    } else if (from->type == EXR_ATTR_M44F) {
        to->type = KL_ATTRIBUTE_M44F;
        memcpy(to->value.m44f, from->m44f, sizeof to->value.m44f);
    } else {
        return false;
    }
    return true;
}

/* What the format itself keeps in attributes and the writer makes anew. */
static bool is_structural(const char *name)
{
    static const char *const names[] = {
        "pixelAspectRatio", "screenWindowCenter", "type", "name", "screenWindowWidth",
        "version",          "chunkCount"};

    for (size_t i = 0; i < sizeof names / sizeof names[0]; ++i) {
        if (strcmp(names[i], name) == 0) return true;
    }
    return false;
}

static kl_status read_attributes(struct reader *reader, struct kl_err *err)
{
    int32_t count = 0;
    kl_status st = check(reader, exr_get_attribute_count(reader->file, 0, &count), err);

    for (int32_t i = 0; i < count && st == KL_OK; ++i) {
        const exr_attribute_t *a = NULL;
        struct kl_attribute converted;
        st = check(reader,
                   exr_get_attribute_by_index(reader->file, 0, EXR_ATTR_LIST_FILE_ORDER, i, &a),
                   err);
        if (st != KL_OK || is_structural(a->name)) continue;
        if (a->type == EXR_ATTR_STRING && a->name_length < KL_IMAGE_NAME_SIZE) {
            st = kl_image_set_string(reader->image, a->name,
                                     a->string->str != NULL ? a->string->str : "", err);
        } else if (convert_attribute(a, &converted)) {
            st = kl_image_set(reader->image, &converted, err);
        }
    }
    return st;
}

static enum kl_pixel pixel_get(exr_pixel_type_t type)
{
    if (type == EXR_PIXEL_UINT) return KL_PIXEL_UINT;
    return type == EXR_PIXEL_HALF ? KL_PIXEL_HALF : KL_PIXEL_FLOAT;
}

static kl_status add_channels(struct reader *reader, struct kl_err *err)
{
    kl_status st = KL_OK;

    for (int i = 0; i < reader->channels->num_channels && st == KL_OK; ++i) {
        const exr_attr_chlist_entry_t *c = &reader->channels->entries[i];
        st = kl_image_add_channel(reader->image, c->name.str, pixel_get(c->pixel_type), NULL, err);
    }
    return st == KL_ERR_USAGE ? (err->status = KL_ERR_INPUT) : st;
}

/* Calls `visit` for every chunk of level 0 until one fails. */
typedef exr_result_t (*chunk_visitor)(struct reader *reader, const exr_chunk_info_t *chunk,
                                      void *state);

static exr_result_t visit_lines(struct reader *reader, chunk_visitor visit, void *state)
{
    int32_t step = 0;
    exr_result_t r = exr_get_scanlines_per_chunk(reader->file, 0, &step);

    if (r == EXR_ERR_SUCCESS && step < 1) r = EXR_ERR_FILE_BAD_HEADER;
    for (uint32_t y = 0; y < reader->image->height && r == EXR_ERR_SUCCESS; y += (uint32_t)step) {
        exr_chunk_info_t chunk;
        const int line = (int)((int64_t)reader->window.min.y + y);
        r = exr_read_scanline_chunk_info(reader->file, 0, line, &chunk);
        if (r == EXR_ERR_SUCCESS) r = visit(reader, &chunk, state);
    }
    return r;
}

static exr_result_t visit_tiles(struct reader *reader, chunk_visitor visit, void *state)
{
    int32_t w = 0;
    int32_t h = 0;
    exr_result_t r = exr_get_tile_sizes(reader->file, 0, 0, 0, &w, &h);

    if (r == EXR_ERR_SUCCESS && (w < 1 || h < 1)) r = EXR_ERR_FILE_BAD_HEADER;
    if (r != EXR_ERR_SUCCESS) return r;
    const int columns = (int)((reader->image->width + (uint32_t)w - 1) / (uint32_t)w);
    const int rows = (int)((reader->image->height + (uint32_t)h - 1) / (uint32_t)h);
    for (int i = 0; i < columns * rows && r == EXR_ERR_SUCCESS; ++i) {
        exr_chunk_info_t chunk;
        r = exr_read_tile_chunk_info(reader->file, 0, i % columns, i / columns, 0, 0, &chunk);
        if (r == EXR_ERR_SUCCESS) r = visit(reader, &chunk, state);
    }
    return r;
}

static exr_result_t visit_chunks(struct reader *reader, chunk_visitor visit, void *state)
{
    if (reader->storage == EXR_STORAGE_TILED) return visit_tiles(reader, visit, state);
    return visit_lines(reader, visit, state);
}

static exr_result_t check_chunk(struct reader *reader, const exr_chunk_info_t *chunk, void *state)
{
    const uint64_t size = (uint64_t)reader->stream.size;

    (void)state;
    if (chunk->data_offset > size || chunk->packed_size > size - chunk->data_offset) {
        return EXR_ERR_BAD_CHUNK_LEADER;
    }
    return EXR_ERR_SUCCESS;
}

struct decoding {
    exr_decode_pipeline_t pipeline;
    bool started;
};

static exr_result_t decode_chunk(struct reader *reader, const exr_chunk_info_t *chunk, void *state)
{
    struct decoding *decoding = state;
    struct kl_image *image = reader->image;
    exr_decode_pipeline_t *pipeline = &decoding->pipeline;
    exr_result_t r = check_chunk(reader, chunk, NULL);

    if (r != EXR_ERR_SUCCESS) return r;
    if (decoding->started) {
        r = exr_decoding_update(reader->file, 0, chunk, pipeline);
    } else {
        r = exr_decoding_initialize(reader->file, 0, chunk, pipeline);
    }
    if (r != EXR_ERR_SUCCESS) return r;

    /* Scan lines count from the data window's top, tiles from its corner in tile numbers. */
    int64_t x = 0;
    int64_t y = (int64_t)chunk->start_y - reader->window.min.y;
    if (reader->storage == EXR_STORAGE_TILED) {
        int32_t w = 0;
        int32_t h = 0;
        r = exr_get_tile_sizes(reader->file, 0, 0, 0, &w, &h);
        if (r != EXR_ERR_SUCCESS) return r;
        x = (int64_t)chunk->start_x * w;
        y = (int64_t)chunk->start_y * h;
    }
    if (x < 0 || y < 0 || chunk->width < 0 || chunk->height < 0 ||
        x + chunk->width > image->width || y + chunk->height > image->height ||
        (size_t)pipeline->channel_count != image->channel_count) {
        return EXR_ERR_BAD_CHUNK_LEADER;
    }
    for (size_t i = 0; i < image->channel_count; ++i) {
        exr_coding_channel_info_t *c = &pipeline->channels[i];
        const struct kl_channel *to = &image->channels[i];
        const size_t first = (size_t)y * image->width + (size_t)x;
        const bool is_uint = to->pixel == KL_PIXEL_UINT;
        c->user_bytes_per_element = 4;
        c->user_data_type = is_uint ? EXR_PIXEL_UINT : EXR_PIXEL_FLOAT;
        c->user_pixel_stride = 4;
        c->user_line_stride = (int32_t)(image->width * 4);
        c->decode_to_ptr = is_uint ? (uint8_t *)(to->uints + first) : (uint8_t *)(to->data + first);
    }
    if (!decoding->started) r = exr_decoding_choose_default_routines(reader->file, 0, pipeline);
    decoding->started = true;
    if (r == EXR_ERR_SUCCESS) r = exr_decoding_run(reader->file, 0, pipeline);
    return r;
}

static kl_status read_pixels(struct reader *reader, struct kl_err *err)
{
    struct decoding decoding = {.pipeline = EXR_DECODE_PIPELINE_INITIALIZER};
    const exr_result_t r = visit_chunks(reader, decode_chunk, &decoding);
    const exr_result_t end = exr_decoding_destroy(reader->file, &decoding.pipeline);
    kl_status st = check(reader, r != EXR_ERR_SUCCESS ? r : end, err);

    return st == KL_OK ? KL_OK : kl_wrap(err, "incomplete or damaged pixels");
}

static kl_status read_header(struct reader *reader, const char *path, struct kl_err *err)
{
    kl_status st = open_file(reader, path, err);

    if (st == KL_OK) st = read_layout(reader, err);
    if (st == KL_OK) st = read_attributes(reader, err);
    return st;
}

static void close_file(struct reader *reader)
{
    if (reader->file != NULL) (void)exr_finish(&reader->file);
    if (reader->stream.fd >= 0) close(reader->stream.fd);
    kl_image_destroy(reader->image);
}

kl_status kl_exr_read(const char *path, struct kl_image **out, struct kl_err *err)
{
    struct reader reader = {.stream = {.fd = -1}};
    kl_status st = read_header(&reader, path, err);

    if (st == KL_OK) st = add_channels(&reader, err);
    if (st == KL_OK) st = read_pixels(&reader, err);
    if (st == KL_OK) {
        *out = reader.image;
        reader.image = NULL;
    }
    close_file(&reader);
    return st == KL_OK ? KL_OK : kl_wrap(err, "%s", path);
}

kl_status kl_exr_read_header(const char *path, struct kl_image **out, bool *complete,
                             struct kl_err *err)
{
    struct reader reader = {.stream = {.fd = -1}};
    kl_status st = read_header(&reader, path, err);

    if (st == KL_OK) {
        *complete = visit_chunks(&reader, check_chunk, NULL) == EXR_ERR_SUCCESS;
        *out = reader.image;
        reader.image = NULL;
    }
    close_file(&reader);
    return st == KL_OK ? KL_OK : kl_wrap(err, "%s", path);
}
