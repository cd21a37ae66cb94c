#include "sequences/coherence.h"

#include "sequences/pattern.h"
#include "src/app/commands.h"
#include "src/app/flicker_plot.h"
#include "src/app/folders.h"
#include "src/app/json_text.h"
#include "src/base/memory.h"
#include "src/image/exr.h"
#include "src/image/heat.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const float heat_full_scale = 0.02f;

struct file {
    char *path, *reference; /* owned; reference may be NULL */
    bool has_number;
    int32_t number; /* of the frame, from the file */
    uint32_t width, height;
};

struct flicker {
    const struct kl_options *options;
    const char *layer; /* "beauty": the unnamed one */
    size_t count;
    struct file *files; /* in order of time */
    bool has_reference;
    struct kl_coherence *coherence;
    struct kl_coherence_result result;
};

static kl_status read_header(const char *path, struct file *file, struct kl_err *err)
{
    struct kl_image *image = NULL;
    bool complete = false;
    kl_status st = kl_file_expect(path, "", err);

    if (st == KL_OK) st = kl_exr_read_header(path, &image, &complete, err);
    if (st != KL_OK) return st;
    const struct kl_attribute *number = kl_image_get_attribute(image, "keeplight.frame");
    file->has_number = number != NULL && number->type == KL_ATTRIBUTE_INT;
    if (file->has_number) file->number = number->value.i;
    file->width = image->width;
    file->height = image->height;
    kl_image_destroy(image);
    if (!complete) return kl_fail(err, KL_ERR_INPUT, "%s: the file is not complete", path);
    return KL_OK;
}

static int by_number(const void *a, const void *b)
{
    const struct file *x = a;
    const struct file *y = b;

    return (x->number > y->number) - (x->number < y->number);
}

/* In order of time, without gaps: a motion vector leads one frame back. Files that do not say their
 * number stay as they were given. */
static kl_status sort_files(struct flicker *f, struct kl_err *err)
{
    for (size_t i = 0; i < f->count; ++i) {
        if (!f->files[i].has_number) return KL_OK;
    }
    qsort(f->files, f->count, sizeof *f->files, by_number);
    for (size_t i = 1; i < f->count; ++i) {
        const struct file *a = &f->files[i - 1];
        const struct file *b = &f->files[i];
        if ((int64_t)b->number - a->number == 1) continue;
        return kl_fail(err, KL_ERR_INPUT,
                       "%s: frame %ld after frame %ld: expected neighbours, as motion vectors lead "
                       "one frame back",
                       b->path, (long)b->number, (long)a->number);
    }
    return KL_OK;
}

/* The reference's file of files[i]. */
static kl_status name_reference(struct flicker *f, size_t i, const char *pattern,
                                struct kl_err *err)
{
    char name[4096];
    struct file *file = &f->files[i];

    if (!file->has_number) {
        return kl_fail(err, KL_ERR_INPUT,
                       "%s: does not say its frame number, so list the files of "
                       "--reference",
                       file->path);
    }
    kl_status st = kl_pattern_format(pattern, file->number, true, name, sizeof name, err);
    if (st == KL_OK) st = kl_copy_string(&file->reference, name, err);
    return st;
}

static bool is_pattern(const char *name)
{
    struct kl_err err;
    char out[4096];

    return kl_pattern_format(name, 1, false, out, sizeof out, &err) != KL_OK ||
           strcmp(name, out) != 0;
}

/* The files of --reference are that option's value and the arguments after it, or all that a
 * pattern names. */
static kl_status list_files(struct flicker *f, struct kl_err *err)
{
    const struct kl_options *o = f->options;
    const bool listed = o->reference != NULL && !is_pattern(o->reference);
    kl_status st = KL_OK;

    f->has_reference = o->reference != NULL;
    f->count = listed ? o->reference_at : o->argument_count;
    const size_t references = listed ? 1 + o->argument_count - o->reference_at : f->count;
    if (f->count < 2) {
        return kl_fail(err, KL_ERR_USAGE, "flicker: %zu frames: expected two or more", f->count);
    }
    if (references != f->count) {
        return kl_fail(err, KL_ERR_USAGE, "--reference: %zu files for %zu frames", references,
                       f->count);
    }
    st = kl_alloc_array(&f->files, f->count, sizeof *f->files, err);
    for (size_t i = 0; st == KL_OK && i < f->count; ++i) {
        struct file *file = &f->files[i];
        st = kl_copy_string(&file->path, o->arguments[i], err);
        if (st == KL_OK) st = read_header(file->path, file, err);
        if (st == KL_OK && listed) {
            const char *name = i == 0 ? o->reference : o->arguments[o->reference_at + i - 1];
            st = kl_copy_string(&file->reference, name, err);
        } else if (st == KL_OK && o->reference != NULL) {
            st = name_reference(f, i, o->reference, err);
        }
        if (st == KL_OK &&
            (file->width != f->files[0].width || file->height != f->files[0].height)) {
            st = kl_fail(err, KL_ERR_INPUT, "%s: %u x %u pixels, %s has %u x %u", file->path,
                         file->width, file->height, f->files[0].path, f->files[0].width,
                         f->files[0].height);
        }
    }
    return st == KL_OK ? sort_files(f, err) : st;
}

/* The channels "LAYER.X", "LAYER.Y", ... of `names`. */
static bool find_channels(const struct kl_image *image, const char *layer, const char *names,
                          const float **out)
{
    char name[KL_IMAGE_NAME_SIZE];

    for (size_t k = 0; names[k] != '\0'; ++k) {
        (void)snprintf(name, sizeof name, "%s.%c", layer, names[k]);
        const struct kl_channel *c = kl_image_find(image, name);
        if (c == NULL || c->data == NULL) return false;
        out[k] = c->data;
    }
    return true;
}

static kl_status find_layer(const struct kl_image *image, const char *path, const char *layer,
                            const float *rgb[3], struct kl_err *err)
{
    return kl_image_get_rgb(image, layer, rgb, err) == KL_OK ? KL_OK : kl_wrap(err, "%s", path);
}

static kl_status find_geometry(const struct kl_image *image, const char *path,
                               struct kl_coherence_frame *frame, struct kl_err *err)
{
    const struct kl_channel *id = kl_image_find(image, "id");
    const struct kl_channel *depth = kl_image_find(image, "Z");
    const bool moves = find_channels(image, "motion", "XY", frame->motion);

    if (!moves || id == NULL || id->uints == NULL || depth == NULL || depth->data == NULL) {
        return kl_fail(err, KL_ERR_INPUT, "%s: expected the layers motion, id and Z (--aov)", path);
    }
    frame->depth = depth->data;
    frame->ids = id->uints;
    if (!find_channels(image, "P", "XYZ", frame->position)) frame->position[0] = NULL;
    if (!find_channels(image, "N", "XYZ", frame->normal)) frame->normal[0] = NULL;
    return KL_OK;
}

/* Irradiance where the frames have it, else beauty. */
static void choose_layer(struct flicker *f, const struct kl_image *image)
{
    const float *rgb[3];
    const char *asked = f->options->layer;

    if (asked != NULL) {
        f->layer = asked;
    } else {
        f->layer = find_channels(image, "irradiance", "RGB", rgb) ? "irradiance" : "beauty";
    }
}

static kl_status read_reference(const struct file *file, struct kl_image **out, struct kl_err *err)
{
    struct file header = {0};
    kl_status st = kl_file_expect(file->reference, "--reference: ", err);

    if (st == KL_OK) st = read_header(file->reference, &header, err);
    if (st != KL_OK) return st;
    if (header.width != file->width || header.height != file->height) {
        return kl_fail(err, KL_ERR_INPUT, "%s: %u x %u pixels, %s has %u x %u", file->reference,
                       header.width, header.height, file->path, file->width, file->height);
    }
    if (header.has_number && file->has_number && header.number != file->number) {
        return kl_fail(err, KL_ERR_INPUT, "%s: is frame %ld, expected frame %ld, as %s is",
                       file->reference, (long)header.number, (long)file->number, file->path);
    }
    return kl_exr_read(file->reference, out, err);
}

/* images: of the frame and of its reference, the caller's also after a failure. */
static kl_status add_file(struct flicker *f, const struct file *file, struct kl_image *images[2],
                          struct kl_err *err)
{
    struct kl_coherence_frame frame = {0};
    kl_status st = kl_exr_read(file->path, &images[0], err);

    if (st != KL_OK) return st;
    if (f->layer == NULL) choose_layer(f, images[0]);
    st = find_layer(images[0], file->path, f->layer, frame.test, err);
    if (st == KL_OK) st = find_geometry(images[0], file->path, &frame, err);
    if (st == KL_OK && f->has_reference) {
        st = read_reference(file, &images[1], err);
        if (st == KL_OK)
            st = find_layer(images[1], file->reference, f->layer, frame.reference, err);
    }
    return st == KL_OK ? kl_coherence_add(f->coherence, &frame, err) : st;
}

/* Backwards; two frames are in memory. */
static kl_status measure(struct flicker *f, struct kl_err *err)
{
    struct kl_image *now[2] = {NULL, NULL};
    struct kl_image *later[2] = {NULL, NULL};
    kl_status st = kl_coherence_create(f->files[0].width, f->files[0].height, (uint32_t)f->count,
                                       &f->coherence, err);

    for (size_t i = f->count; st == KL_OK && i-- > 0;) {
        st = add_file(f, &f->files[i], now, err);
        for (int k = 0; k < 2; ++k) {
            kl_image_destroy(later[k]);
            later[k] = now[k];
            now[k] = NULL;
        }
    }
    if (st == KL_OK) st = kl_coherence_finish(f->coherence, &f->result, err);
    for (int k = 0; k < 2; ++k) {
        kl_image_destroy(later[k]);
    }
    return st;
}

static json_t *number(double value)
{
    return isnan(value) ? json_null() : json_real(value);
}

static json_t *describe_step(const struct flicker *f, size_t i)
{
    const struct kl_coherence_step *s = &f->result.steps[i];
    const int32_t frame = f->files[i].has_number ? f->files[i].number : (int32_t)i + 1;

    if (i == 0) return json_pack("{s:i,s:s}", "frame", (int)frame, "file", f->files[i].path);
    return json_pack("{s:i,s:s,s:f,s:o,s:o,s:o,s:o,s:I}", "frame", (int)frame, "file",
                     f->files[i].path, "followed", s->followed, "step", number(s->step),
                     "reference_step", number(s->reference_step), "t_mse", number(s->t_mse),
                     "t_relmse", number(s->t_relmse), "pops", (json_int_t)s->pops);
}

static json_t *describe(const struct flicker *f)
{
    const struct kl_coherence_result *r = &f->result;
    json_t *frames = json_array();

    for (size_t i = 0; frames != NULL && i < f->count; ++i) {
        if (json_array_append_new(frames, describe_step(f, i)) == 0) continue;
        json_decref(frames);
        frames = NULL;
    }
    if (frames == NULL) return NULL;
    return json_pack(
        "{s:s,s:I,s:I,s:I,s:b,s:o,s:o,s:o,s:o,s:I,s:f,s:o,s:o,s:I,s:I,s:o,s:o,s:o,"
        "s:o}",
        "layer", f->layer, "width", (json_int_t)f->files[0].width, "height",
        (json_int_t)f->files[0].height, "frame_count", (json_int_t)f->count, "reference",
        (int)f->has_reference, "flicker_mean", number(r->flicker_mean), "flicker_p99",
        number(r->flicker_p99), "reference_flicker_mean", number(r->reference_flicker_mean),
        "reference_flicker_p99", number(r->reference_flicker_p99), "points", (json_int_t)r->points,
        "followed", r->followed, "t_mse", number(r->t_mse), "t_relmse", number(r->t_relmse), "pops",
        (json_int_t)r->pops, "block_steps", (json_int_t)r->block_steps, "lag_frames",
        number(r->lag_frames), "lag_correlation", number(r->lag_correlation), "high_band_rms",
        number(r->high_band_rms), "frames", frames);
}

static void print_value(const char *name, double value)
{
    if (!isnan(value)) (void)printf("%-24s%.4g\n", name, value);
}

static void print_text(const struct flicker *f)
{
    const struct kl_coherence_result *r = &f->result;

    (void)printf("%-24s%zu frames, %ux%u, %s\n", "sequence", f->count, (unsigned)f->files[0].width,
                 (unsigned)f->files[0].height, f->layer);
    (void)printf("%-24s%.4g of the pixels, %llu points long enough\n", "followed", r->followed,
                 (unsigned long long)r->points);
    print_value("flicker_mean", r->flicker_mean);
    print_value("flicker_p99", r->flicker_p99);
    print_value("reference_flicker_mean", r->reference_flicker_mean);
    print_value("t_mse", r->t_mse);
    print_value("t_relmse", r->t_relmse);
    (void)printf("%-24s%llu of %llu block steps\n", "pops", (unsigned long long)r->pops,
                 (unsigned long long)r->block_steps);
    print_value("lag_frames", r->lag_frames);
    print_value("high_band_rms", r->high_band_rms);
}

static kl_status write_json(const struct flicker *f, struct kl_err *err)
{
    json_t *root = describe(f);

    if (root == NULL) return kl_fail(err, KL_ERR_NO_MEMORY, "flicker: out of memory");
    kl_status st = kl_json_write(root, f->options->json_file, err);
    json_decref(root);
    return st;
}

static kl_status report(const struct flicker *f, struct kl_err *err)
{
    const struct kl_options *o = f->options;
    const int32_t first = f->files[0].has_number ? f->files[0].number : 1;
    kl_status st = o->json ? write_json(f, err) : KL_OK;

    if (st == KL_OK && (!o->json || o->json_file != NULL)) print_text(f);
    if (st == KL_OK && o->heat != NULL) {
        st = kl_heat_write(o->heat, f->files[0].width, f->files[0].height, f->result.heat,
                           heat_full_scale, err);
    }
    if (st == KL_OK && o->plot != NULL) st = kl_flicker_plot(o->plot, &f->result, first, err);
    return st;
}

kl_status kl_command_flicker(const struct kl_options *options, struct kl_err *err)
{
    struct flicker f = {.options = options};
    kl_status st = options->plot != NULL ? kl_flicker_plot_check(options->plot, err) : KL_OK;

    if (st == KL_OK) st = list_files(&f, err);
    if (st == KL_OK) st = measure(&f, err);
    if (st == KL_OK) st = report(&f, err);
    kl_coherence_destroy(f.coherence);
    for (size_t i = 0; f.files != NULL && i < f.count; ++i) {
        free(f.files[i].path);
        free(f.files[i].reference);
    }
    free(f.files);
    return st;
}
