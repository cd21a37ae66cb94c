/* Lat-long OpenEXR images through OpenEXR's C core. The image is the display window; what the data
 * window leaves open is black. */
#include "src/import/import.h"

#include "src/base/memory.h"

#include <OpenEXR/openexr.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

static const uint64_t max_texels = (uint64_t)1 << 28;

enum { MAX_PLANES = 3 };

/* One channel of the file; `sampling` 2 has a value at every other column and row. */
struct plane {
    const char *name;
    int sampling;
    int width, height;
    size_t element; /* 2: half, 4: float */
    uint8_t *values;
};

struct exr_job {
    exr_context_t file;
    char said[256]; /* the library's first message */
    int part;
    exr_attr_box2i_t data, display;
    int plane_count;
    struct plane planes[MAX_PLANES]; /* R G B, or Y, or Y RY BY */
    bool is_luminance;
    double to_rec709[9]; /* row major, from the file's RGB */
    double luminance[3]; /* of the file's primaries */
};

static void keep_message(exr_const_context_t file, exr_result_t code, const char *message)
{
    void *user = NULL;
    (void)code;
    if (exr_get_user_data(file, &user) != EXR_ERR_SUCCESS || user == NULL) return;
    struct exr_job *job = user;
    if (job->said[0] == '\0') (void)!snprintf(job->said, sizeof job->said, "%s", message);
}

static kl_status fail_exr(const struct exr_job *job, exr_result_t code, const char *what,
                          struct kl_err *err)
{
    const char *why = job->said[0] != '\0' ? job->said : exr_get_default_error_message(code);
    if (code == EXR_ERR_OUT_OF_MEMORY) return kl_fail(err, KL_ERR_NO_MEMORY, "out of memory");
    return kl_fail(err, KL_ERR_INPUT, "%s: %s", what, why);
}

static kl_status open_file(struct exr_job *job, const char *path, struct kl_err *err)
{
    struct stat info;
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;

    if (stat(path, &info) != 0) return kl_fail_errno(err, "cannot open");
    if (!S_ISREG(info.st_mode)) return kl_fail(err, KL_ERR_INPUT, "not a regular file");
    init.error_handler_fn = keep_message;
    init.user_data = job;
    init.max_image_width = 1 << 20;
    init.max_image_height = 1 << 20;
    const exr_result_t code = exr_start_read(&job->file, path, &init);
    if (code != EXR_ERR_SUCCESS) return fail_exr(job, code, "not a readable OpenEXR file", err);
    return KL_OK;
}

static const exr_attr_chlist_entry_t *find_channel(const exr_attr_chlist_t *list, const char *name)
{
    for (int i = 0; i < list->num_channels; ++i) {
        if (strcmp(list->entries[i].name.str, name) == 0) return &list->entries[i];
    }
    return NULL;
}

/* True if the part is flat and has channels that make an image. */
static bool choose_channels(struct exr_job *job, int part)
{
    static const char *const colors[3] = {"R", "G", "B"};
    static const char *const luminance[3] = {"Y", "RY", "BY"};
    const exr_attr_chlist_t *list = NULL;
    exr_storage_t storage = EXR_STORAGE_LAST_TYPE;

    if (exr_get_storage(job->file, part, &storage) != EXR_ERR_SUCCESS) return false;
    if (storage != EXR_STORAGE_SCANLINE && storage != EXR_STORAGE_TILED) return false;
    if (exr_get_channels(job->file, part, &list) != EXR_ERR_SUCCESS) return false;
    bool has_rgb = true;
    for (int i = 0; i < 3; ++i) {
        if (find_channel(list, colors[i]) == NULL) has_rgb = false;
    }
    if (!has_rgb && find_channel(list, "Y") == NULL) return false;
    job->is_luminance = !has_rgb;
    const char *const *names = has_rgb ? colors : luminance;
    const bool has_all =
        find_channel(list, names[1]) != NULL && find_channel(list, names[2]) != NULL;
    job->part = part;
    job->plane_count = has_all ? 3 : 1;
    for (int i = 0; i < job->plane_count; ++i) {
        const exr_attr_chlist_entry_t *entry = find_channel(list, names[i]);
        if (entry == NULL || entry->pixel_type == EXR_PIXEL_UINT) return false;
        if (entry->x_sampling != entry->y_sampling || entry->x_sampling < 1) return false;
        if (entry->x_sampling > 2 || (i == 0 && entry->x_sampling != 1)) return false;
        job->planes[i].name = names[i];
        job->planes[i].sampling = entry->x_sampling;
        job->planes[i].element = entry->pixel_type == EXR_PIXEL_HALF ? 2 : 4;
    }
    return true;
}

static kl_status choose_part(struct exr_job *job, struct kl_err *err)
{
    int count = 0;

    if (exr_get_count(job->file, &count) != EXR_ERR_SUCCESS) count = 0;
    for (int part = 0; part < count; ++part) {
        if (choose_channels(job, part)) return KL_OK;
    }
    return kl_fail(err, KL_ERR_INPUT,
                   "no image of half or float channels R G B, Y, or Y RY BY in it");
}

static kl_status check_window(const exr_attr_box2i_t *box, const char *what, struct kl_err *err)
{
    const int64_t width = (int64_t)box->max.x - box->min.x + 1;
    const int64_t height = (int64_t)box->max.y - box->min.y + 1;

    if (width < 1 || height < 1 || width > 1 << 20 || height > 1 << 20 ||
        (uint64_t)(width * height) > max_texels) {
        return kl_fail(err, KL_ERR_INPUT, "%s of %lld x %lld, expected 1..2^28 texels", what,
                       (long long)width, (long long)height);
    }
    return KL_OK;
}

static kl_status init_planes(struct exr_job *job, struct kl_err *err)
{
    exr_result_t code = exr_get_data_window(job->file, job->part, &job->data);
    if (code == EXR_ERR_SUCCESS) {
        code = exr_get_display_window(job->file, job->part, &job->display);
    }
    if (code != EXR_ERR_SUCCESS) return fail_exr(job, code, "windows", err);
    kl_status st = check_window(&job->data, "data window", err);
    if (st != KL_OK) return st;
    st = check_window(&job->display, "display window", err);
    if (st != KL_OK) return st;
    for (int i = 0; i < job->plane_count; ++i) {
        struct plane *plane = &job->planes[i];
        if (job->data.min.x % plane->sampling != 0 || job->data.min.y % plane->sampling != 0) {
            return kl_fail(err, KL_ERR_INPUT, "data window does not begin on a sample of %s",
                           plane->name);
        }
        plane->width = (job->data.max.x - job->data.min.x) / plane->sampling + 1;
        plane->height = (job->data.max.y - job->data.min.y) / plane->sampling + 1;
        st = kl_alloc_array(&plane->values, (size_t)plane->width * (size_t)plane->height,
                            plane->element, err);
        if (st != KL_OK) return st;
    }
    return KL_OK;
}

/* The library does not convert: in OpenEXR 3.1 its fast way from half to float ignores that a
 * channel is sparse or not wanted, and writes where nothing is. Point the decoder's channels at the
 * planes; (x, y) is the chunk's first pixel in the data window. Fails if the chunk does not fit: a
 * damaged file. */
static kl_status aim_channels(const struct exr_job *job, exr_decode_pipeline_t *decode, int x,
                              int y, struct kl_err *err)
{
    for (int c = 0; c < decode->channel_count; ++c) {
        exr_coding_channel_info_t *to = &decode->channels[c];
        to->decode_to_ptr = NULL;
        for (int i = 0; i < job->plane_count; ++i) {
            const struct plane *plane = &job->planes[i];
            if (strcmp(plane->name, to->channel_name) != 0) continue;
            const int column = x / plane->sampling;
            const int row = (y + plane->sampling - 1) / plane->sampling;
            if (to->height < 1 || to->width < 1) continue;
            if (to->width > plane->width - column || to->height > plane->height - row) {
                return kl_fail(err, KL_ERR_INPUT, "pixels at %d, %d reach beyond the data window",
                               x, y);
            }
            to->decode_to_ptr =
                plane->values +
                ((size_t)row * (size_t)plane->width + (size_t)column) * plane->element;
            to->user_data_type = to->data_type;
            to->user_bytes_per_element = (int16_t)plane->element;
            to->user_pixel_stride = (int32_t)plane->element;
            to->user_line_stride = plane->width * (int32_t)plane->element;
        }
    }
    return KL_OK;
}

static kl_status decode_chunk(const struct exr_job *job, const exr_chunk_info_t *chunk,
                              exr_decode_pipeline_t *decode, bool first, int x, int y,
                              struct kl_err *err)
{
    exr_result_t code = first ? exr_decoding_initialize(job->file, job->part, chunk, decode)
                              : exr_decoding_update(job->file, job->part, chunk, decode);
    if (code != EXR_ERR_SUCCESS) return fail_exr(job, code, "pixels", err);
    kl_status st = aim_channels(job, decode, x, y, err);
    if (st != KL_OK) return st;
    if (first) code = exr_decoding_choose_default_routines(job->file, job->part, decode);
    if (code == EXR_ERR_SUCCESS) code = exr_decoding_run(job->file, job->part, decode);
    if (code != EXR_ERR_SUCCESS) return fail_exr(job, code, "pixels", err);
    return KL_OK;
}

static kl_status read_scanlines(const struct exr_job *job, struct kl_err *err)
{
    exr_decode_pipeline_t decode = EXR_DECODE_PIPELINE_INITIALIZER;
    const int height = job->data.max.y - job->data.min.y + 1;
    int32_t lines = 0;
    kl_status st = KL_OK;

    exr_result_t code = exr_get_scanlines_per_chunk(job->file, job->part, &lines);
    if (code != EXR_ERR_SUCCESS || lines < 1) return fail_exr(job, code, "scan lines", err);
    for (int y = 0; y < height && st == KL_OK; y += lines) {
        exr_chunk_info_t chunk;
        code = exr_read_scanline_chunk_info(job->file, job->part, job->data.min.y + y, &chunk);
        if (code != EXR_ERR_SUCCESS) {
            st = fail_exr(job, code, "scan lines", err);
        } else {
            st = decode_chunk(job, &chunk, &decode, y == 0, 0, y, err);
        }
    }
    (void)exr_decoding_destroy(job->file, &decode);
    return st;
}

static kl_status read_tiles(const struct exr_job *job, struct kl_err *err)
{
    exr_decode_pipeline_t decode = EXR_DECODE_PIPELINE_INITIALIZER;
    const int width = job->data.max.x - job->data.min.x + 1;
    const int height = job->data.max.y - job->data.min.y + 1;
    int32_t tile_width = 0;
    int32_t tile_height = 0;
    bool first = true;
    kl_status st = KL_OK;

    exr_result_t code = exr_get_tile_sizes(job->file, job->part, 0, 0, &tile_width, &tile_height);
    if (code != EXR_ERR_SUCCESS || tile_width < 1 || tile_height < 1) {
        return fail_exr(job, code, "tiles", err);
    }
    const int columns = (width + tile_width - 1) / tile_width;
    const int rows = (height + tile_height - 1) / tile_height;
    for (int i = 0; i < columns * rows && st == KL_OK; ++i) {
        exr_chunk_info_t chunk;
        const int column = i % columns;
        const int row = i / columns;
        code = exr_read_tile_chunk_info(job->file, job->part, column, row, 0, 0, &chunk);
        if (code != EXR_ERR_SUCCESS) {
            st = fail_exr(job, code, "tiles", err);
            break;
        }
        st = decode_chunk(job, &chunk, &decode, first, column * tile_width, row * tile_height, err);
        first = false;
    }
    (void)exr_decoding_destroy(job->file, &decode);
    return st;
}

/* XYZ from RGB of these primaries, white at Y = 1: SMPTE RP 177. False for impossible ones. */
static bool xyz_from_rgb(const exr_attr_chromaticities_t *c, double out[9])
{
    const double x[3] = {(double)c->red_x, (double)c->green_x, (double)c->blue_x};
    const double y[3] = {(double)c->red_y, (double)c->green_y, (double)c->blue_y};
    const double wx = (double)c->white_x;
    const double wy = (double)c->white_y;
    double p[9];

    for (int i = 0; i < 3; ++i) {
        if (!(fabs(y[i]) > 1e-6) || !(fabs(wy) > 1e-6)) return false;
        p[i] = x[i] / y[i];
        p[3 + i] = 1.0;
        p[6 + i] = (1.0 - x[i] - y[i]) / y[i];
    }
    const double w[3] = {wx / wy, 1.0, (1.0 - wx - wy) / wy};
    const double det = p[0] * (p[4] * p[8] - p[5] * p[7]) - p[1] * (p[3] * p[8] - p[5] * p[6]) +
                       p[2] * (p[3] * p[7] - p[4] * p[6]);
    if (!(fabs(det) > 1e-9)) return false;
    for (int i = 0; i < 3; ++i) { /* Cramer: s_i makes white */
        double q[9];
        memcpy(q, p, sizeof q);
        for (int row = 0; row < 3; ++row) {
            q[3 * row + i] = w[row];
        }
        const double s = (q[0] * (q[4] * q[8] - q[5] * q[7]) - q[1] * (q[3] * q[8] - q[5] * q[6]) +
                          q[2] * (q[3] * q[7] - q[4] * q[6])) /
                         det;
        for (int row = 0; row < 3; ++row) {
            out[3 * row + i] = p[3 * row + i] * s;
        }
    }
    return true;
}

/* The file's primaries; Rec. 709 where it names none. White stays white: each channel of the result
 * is scaled so that (1, 1, 1) maps to itself. */
static void read_colors(struct exr_job *job)
{
    static const double rec709_from_xyz[9] = {3.2404542,  -1.5371385, -0.4985314,
                                              -0.9692660, 1.8760108,  0.0415560,
                                              0.0556434,  -0.2040259, 1.0572252};
    exr_attr_chromaticities_t c = {0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f};
    exr_attr_chromaticities_t found;
    double xyz[9];

    if (exr_attr_get_chromaticities(job->file, job->part, "chromaticities", &found) ==
        EXR_ERR_SUCCESS) {
        c = found;
    }
    job->said[0] = '\0'; /* an absent attribute is no news */
    for (int i = 0; i < 9; ++i) {
        job->to_rec709[i] = i % 4 == 0 ? 1.0 : 0.0;
    }
    job->luminance[0] = 0.2126;
    job->luminance[1] = 0.7152;
    job->luminance[2] = 0.0722;
    if (!xyz_from_rgb(&c, xyz)) return;
    memcpy(job->luminance, &xyz[3], sizeof job->luminance);
    for (int row = 0; row < 3; ++row) {
        double sum = 0.0;
        double m[3];
        for (int i = 0; i < 3; ++i) {
            m[i] = 0.0;
            for (int k = 0; k < 3; ++k) {
                m[i] += rec709_from_xyz[3 * row + k] * xyz[3 * k + i];
            }
            sum += m[i];
        }
        for (int i = 0; i < 3; ++i) {
            /* 1e-3: a file that says Rec. 709 is taken as it is, bit for bit. */
            const double x = m[i] / sum;
            const double unit = row == i ? 1.0 : 0.0;
            job->to_rec709[3 * row + i] = fabs(x - unit) < 1e-3 ? unit : x;
        }
    }
}

static double half_to_double(uint16_t half)
{
    const double sign = (half & 0x8000u) != 0 ? -1.0 : 1.0;
    const int exponent = half >> 10 & 0x1f;
    const int mantissa = half & 0x3ff;

    if (exponent == 0) return sign * ldexp((double)mantissa, -24);
    if (exponent == 31) return mantissa != 0 ? (double)NAN : sign * (double)INFINITY;
    return sign * ldexp((double)(mantissa + 1024), exponent - 25);
}

static double get_value(const struct plane *plane, int x, int y)
{
    const size_t at = (size_t)y * (size_t)plane->width + (size_t)x;
    uint16_t half = 0;
    float value = 0.0f;

    if (plane->element == 2) {
        memcpy(&half, plane->values + at * 2, sizeof half);
        return half_to_double(half);
    }
    memcpy(&value, plane->values + at * 4, sizeof value);
    return (double)value;
}

/* Value at pixel (x, y) of the data window; sparse channels are interpolated linearly. */
static double sample_plane(const struct plane *plane, int x, int y)
{
    if (plane->sampling == 1) return get_value(plane, x, y);
    /* The channel has ceil(n / 2) columns and rows, so the first of each pair exists. */
    const int x0 = x / 2;
    const int y0 = y / 2;
    const int x1 = x0 + 1 < plane->width ? x0 + (x & 1) : x0;
    const int y1 = y0 + 1 < plane->height ? y0 + (y & 1) : y0;
    return 0.25 * (get_value(plane, x0, y0) + get_value(plane, x1, y0) + get_value(plane, x0, y1) +
                   get_value(plane, x1, y1));
}

static void get_pixel(const struct exr_job *job, int x, int y, double rgb[3])
{
    double v[3] = {0.0, 0.0, 0.0};

    for (int i = 0; i < job->plane_count; ++i) {
        v[i] = sample_plane(&job->planes[i], x, y);
    }
    if (job->plane_count == 1) v[1] = v[2] = v[0];
    if (job->is_luminance && job->plane_count == 3) { /* RY = (R - Y) / Y, BY = (B - Y) / Y */
        const double luminance = v[0];
        const double red = (v[1] + 1.0) * luminance;
        const double blue = (v[2] + 1.0) * luminance;
        const double *w = job->luminance;
        v[0] = red;
        v[1] = (luminance - w[0] * red - w[2] * blue) / w[1];
        v[2] = blue;
    }
    for (int row = 0; row < 3; ++row) {
        /* 0 * Inf must not turn a channel that is fine into NaN. */
        rgb[row] = 0.0;
        for (int i = 0; i < 3; ++i) {
            const double m = job->to_rec709[3 * row + i];
            if (m != 0.0) rgb[row] += m * v[i];
        }
    }
}

/* Writes the repaired pixel (x, y) of the data window; false if there was something to repair. */
static bool fill_texel(const struct exr_job *job, int x, int y, float *texel)
{
    double rgb[3];
    bool good = true;

    get_pixel(job, x, y, rgb);
    for (int i = 0; i < 3; ++i) {
        const bool valid = rgb[i] >= 0.0 && rgb[i] <= 3e38;
        /* Interpolated chroma may leave a hair below zero: no news. */
        const bool hair = job->is_luminance && rgb[i] < 0.0 && rgb[i] > -1e-2;
        texel[i] = valid ? (float)rgb[i] : 0.0f;
        if (!valid && !hair) good = false;
    }
    return good;
}

/* Fills the display window; returns the number of texels that had to be repaired. */
static size_t fill_texels(const struct exr_job *job, uint32_t width, uint32_t height, float *out)
{
    const exr_attr_box2i_t *data = &job->data;
    size_t repaired = 0;

    for (uint32_t row = 0; row < height; ++row) {
        const int64_t y = (int64_t)job->display.min.y + row - data->min.y;
        if (y < 0 || y > (int64_t)data->max.y - data->min.y) continue;
        for (uint32_t column = 0; column < width; ++column) {
            const int64_t x = (int64_t)job->display.min.x + column - data->min.x;
            float *texel = out + ((size_t)row * width + column) * 3;
            if (x < 0 || x > (int64_t)data->max.x - data->min.x) continue;
            if (!fill_texel(job, (int)x, (int)y, texel)) ++repaired;
        }
    }
    return repaired;
}

static kl_status read_image(struct exr_job *job, const char *path, struct kl_err *err)
{
    exr_storage_t storage = EXR_STORAGE_LAST_TYPE;

    kl_status st = open_file(job, path, err);
    if (st != KL_OK) return st;
    st = choose_part(job, err);
    if (st != KL_OK) return st;
    st = init_planes(job, err);
    if (st != KL_OK) return st;
    read_colors(job);
    (void)exr_get_storage(job->file, job->part, &storage);
    return storage == EXR_STORAGE_TILED ? read_tiles(job, err) : read_scanlines(job, err);
}

kl_status kl_import_environment(struct kl_scene *scene, const char *path, kl_warn_fn warn,
                                void *warn_context, struct kl_err *err)
{
    struct exr_job job = {0};
    float *texels = NULL;

    kl_status st = read_image(&job, path, err);
    if (st != KL_OK) goto cleanup;
    const uint32_t width = (uint32_t)(job.display.max.x - job.display.min.x + 1);
    const uint32_t height = (uint32_t)(job.display.max.y - job.display.min.y + 1);
    st = kl_alloc_array(&texels, (size_t)width * height, 3 * sizeof(float), err);
    if (st != KL_OK) goto cleanup;
    const size_t repaired = fill_texels(&job, width, height, texels);
    if (repaired > 0 && warn != NULL) {
        char line[160];
        (void)!snprintf(line, sizeof line,
                        "%zu texels of the environment are not finite or negative: 0 is used",
                        repaired);
        warn(warn_context, line);
    }
    free(scene->environment.rgb);
    scene->environment = (struct kl_scene_environment){width, height, texels};

cleanup:
    for (int i = 0; i < MAX_PLANES; ++i) {
        free(job.planes[i].values);
    }
    if (job.file != NULL) (void)exr_finish(&job.file);
    return st == KL_OK ? KL_OK : kl_wrap(err, "%s", path);
}
