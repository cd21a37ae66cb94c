/* cache view: where the records of a cache lie, drawn over a frame. */
#include "kernels/sampling.h"
#include "src/app/commands.h"
#include "src/app/folders.h"
#include "src/app/frame_file.h"
#include "src/app/job.h"
#include "src/app/json_text.h"
#include "src/app/record_list.h"
#include "src/base/hash.h"
#include "src/image/exr.h"
#include "src/image/png.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { CORNERS = 48 };
static const float dim = 0.35f;       /* what is left of the frame, grey */
static const float full_error = 0.1f; /* relative error that is drawn as the most */

struct picture {
    const struct kl_options *options;
    struct kl_camera camera;
    double origin[3];
    uint32_t newest, oldest; /* generations of records */
    const float *depth;      /* of the frame [m] */
    float *rgb[3];
    uint32_t width, height;
    float scale; /* of the radii */
};

/* Violet, blue, green, yellow: after the map "viridis" of Smith and van der Walt, 2015. */
static kl_vec3 color_of_share(float t)
{
    static const float stops[5][3] = {{0.059f, 0.0f, 0.089f},
                                      {0.042f, 0.085f, 0.259f},
                                      {0.015f, 0.283f, 0.265f},
                                      {0.110f, 0.585f, 0.122f},
                                      {0.985f, 0.801f, 0.018f}};
    const float x = 4.0f * kl_clamp(t, 0.0f, 1.0f);
    const int i = x >= 4.0f ? 3 : (int)x;
    const kl_vec3 a = kl_v3_load(stops[i]);
    return kl_v3_mad(a, x - (float)i, kl_v3_sub(kl_v3_load(stops[i + 1]), a));
}

static kl_vec3 color_of(const struct picture *p, const struct kl_record_item *r)
{
    static const kl_vec3 seen = {0.9f, 0.35f, 0.02f};
    static const kl_vec3 world = {0.02f, 0.3f, 0.9f};
    const enum kl_view_by by = p->options->view_by;

    if (by == KL_VIEW_BY_AGE) {
        const float span = (float)(p->newest - p->oldest);
        return color_of_share(span > 0.0f ? (float)(p->newest - r->born) / span : 0.0f);
    }
    if (by == KL_VIEW_BY_ERROR) {
        return color_of_share(kl_half_to_float(r->cold.error_spacing & 0xffffu) / full_error);
    }
    if (by == KL_VIEW_BY_USE) return r->used ? seen : world;
    return r->level == 0 ? seen : world;
}

static void blend(struct picture *p, int x, int y, kl_vec3 color, float alpha)
{
    const float c[3] = {color.x, color.y, color.z};
    if (x < 0 || y < 0 || (uint32_t)x >= p->width || (uint32_t)y >= p->height) return;
    const size_t i = (size_t)y * p->width + (size_t)x;
    for (int k = 0; k < 3; ++k) {
        p->rgb[k][i] += alpha * (c[k] - p->rgb[k][i]);
    }
}

/* A line of one pixel's width, with smooth edges across its steeper direction. */
static void draw_line(struct picture *p, const float a[2], const float b[2], kl_vec3 color)
{
    const float dx = b[0] - a[0];
    const float dy = b[1] - a[1];
    const float steps = ceilf(fmaxf(fabsf(dx), fabsf(dy)));
    const float most = 4.0f * (float)(p->width + p->height);

    if (!(steps > 0.0f) || steps > most) return;
    for (float s = 0.0f; s < steps; s += 1.0f) {
        const float x = a[0] + dx * (s / steps) - 0.5f;
        const float y = a[1] + dy * (s / steps) - 0.5f;
        const bool flat = fabsf(dx) >= fabsf(dy);
        const float across = flat ? y : x;
        const float part = across - floorf(across);
        const int x0 = (int)floorf(flat ? x + 0.5f : x);
        const int y0 = (int)floorf(flat ? y : y + 0.5f);
        blend(p, x0, y0, color, 0.7f * (1.0f - part));
        blend(p, flat ? x0 : x0 + 1, flat ? y0 + 1 : y0, color, 0.7f * part);
    }
}

/* Is a point in front of what the frame shows there, within its record's radius? */
static bool is_shown(const struct picture *p, kl_vec3 pos, float slack, float at[2])
{
    float depth = 0.0f;
    if (!kl_camera_project(&p->camera, pos, &at[0], &at[1], &depth)) return false;
    if (at[0] < 0.0f || at[1] < 0.0f || at[0] >= (float)p->width || at[1] >= (float)p->height) {
        return false;
    }
    const size_t i = (size_t)at[1] * p->width + (size_t)at[0];
    return depth <= p->depth[i] * 1.01f + slack;
}

/* The ellipse in which the record serves, on its plane, and its place as a dot. */
static bool draw_record(struct picture *p, const struct kl_record_item *r)
{
    const kl_vec3 pos = kl_v3((float)(r->pos[0] - p->origin[0]), (float)(r->pos[1] - p->origin[1]),
                              (float)(r->pos[2] - p->origin[2]));
    const kl_frame f = kl_frame_from_normal(kl_oct_decode(r->hot.normal));
    const float angle = kl_record_axis_angle(r->hot.form);
    const kl_vec3 minor = kl_v3_add(kl_v3_scale(f.t, cosf(angle)), kl_v3_scale(f.b, sinf(angle)));
    const kl_vec3 major = kl_v3_sub(kl_v3_scale(f.b, cosf(angle)), kl_v3_scale(f.t, sinf(angle)));
    const kl_vec3 color = color_of(p, r);
    float center[2];
    float before[2] = {0.0f, 0.0f};
    bool has_before = false;

    if (!is_shown(p, pos, 0.02f * r->hot.radius, center)) return false;
    for (int k = 0; k <= CORNERS; ++k) {
        const float turn = 2.0f * KL_PI * (float)k / (float)CORNERS;
        const kl_vec3 q = kl_v3_mad(kl_v3_mad(pos, p->scale * r->hot.radius * cosf(turn), minor),
                                    p->scale * r->hot.radius2 * sinf(turn), major);
        float at[2];
        float depth = 0.0f;
        const bool in_front = kl_camera_project(&p->camera, q, &at[0], &at[1], &depth);
        if (in_front && has_before) draw_line(p, before, at, color);
        has_before = in_front;
        memcpy(before, at, sizeof before);
    }
    blend(p, (int)center[0], (int)center[1], color, 1.0f);
    return true;
}

/* The frame, grey and dim; where samples had to gather for themselves, red. */
static kl_status start_picture(struct picture *p, struct kl_image *frame, struct kl_image *out,
                               struct kl_err *err)
{
    static const char *const names[] = {"R", "G", "B"};
    const float *rgb[3];
    const struct kl_channel *late = kl_image_find(frame, "cache.late");
    kl_status st = kl_image_get_rgb(frame, NULL, rgb, err);

    p->depth = kl_image_find(frame, "Z")->data;
    p->width = out->width;
    p->height = out->height;
    for (int k = 0; st == KL_OK && k < 3; ++k) {
        st = kl_image_add_channel(out, names[k], KL_PIXEL_HALF, &p->rgb[k], err);
    }
    for (size_t i = 0; st == KL_OK && i < (size_t)out->width * out->height; ++i) {
        const float y = kl_luminance(kl_v3(rgb[0][i], rgb[1][i], rgb[2][i]));
        const float grey = dim * y / (1.0f + y);
        const bool tell = p->options->view_by == KL_VIEW_BY_LATE;
        p->rgb[0][i] = grey + (tell ? late->data[i] : 0.0f);
        p->rgb[1][i] = grey;
        p->rgb[2][i] = grey;
    }
    return st;
}

/* The name of the present instant among the stores of a moving scene's cache; else "". */
static void instant_name(const struct kl_job *job, char out[32])
{
    struct kl_renderer_info info;
    char hex[KL_HASH_HEX_SIZE];

    out[0] = '\0';
    if (!kl_renderer_is_moving(job->renderer)) return;
    kl_renderer_get_info(job->renderer, &info);
    kl_hash_to_hex(info.scene_digest, KL_DIGEST_SIZE, hex);
    (void)snprintf(out, 32, "t-%.16s", hex);
}

static kl_status draw(struct kl_job *job, const struct kl_record_list *list, struct kl_image *frame,
                      struct kl_image *out, size_t *drawn, struct kl_err *err)
{
    const struct kl_options *o = job->options;
    struct picture p = {.options = o, .camera = job->frames[0].camera};
    char instant[32];
    kl_status st = start_picture(&p, frame, out, err);

    instant_name(job, instant);
    kl_renderer_get_origin(job->renderer, p.origin);
    p.oldest = UINT32_MAX;
    for (size_t i = 0; i < list->count; ++i) {
        const uint32_t born = list->items[i].born;
        p.newest = born > p.newest ? born : p.newest;
        p.oldest = born < p.oldest ? born : p.oldest;
    }
    p.scale = 1.0f / (float)(o->reduce > 0 ? o->reduce : 4);
    for (uint32_t level = KL_CACHE_LEVELS; st == KL_OK && level-- > 0;) { /* the seen ones on top */
        if (level != 0 && o->view_by != KL_VIEW_BY_LEVEL) continue;
        for (size_t i = 0; i < list->count; ++i) {
            const struct kl_record_item *r = &list->items[i];
            if (r->level != level || strcmp(list->instants[r->instant], instant) != 0) continue;
            *drawn += draw_record(&p, r);
        }
    }
    return st;
}

static kl_status render(struct kl_job *job, struct kl_image *frame, struct kl_err *err)
{
    const struct kl_renderer_frame what = {.camera = job->frames[0].camera,
                                           .before = job->frames[0].before,
                                           .frame = job->frames[0].frame,
                                           .spp = job->options->spp};
    struct kl_counts counts;
    uint64_t bad = 0;
    kl_status st = kl_job_enter(job, 0, err);
    return st == KL_OK ? kl_renderer_frame(job->renderer, &what, frame, &counts, &bad, err) : st;
}

static kl_status write_picture(const char *path, const struct kl_image *picture, struct kl_err *err)
{
    char png[KL_JOB_PATH_SIZE];
    kl_status st = kl_folders_make(path, false, err);

    if (st == KL_OK) st = kl_path_with_extension(path, "png", png, sizeof png, err);
    if (st == KL_OK) st = kl_png_write(png, picture, NULL, err);
    return st == KL_OK ? kl_exr_write(path, picture, err) : st;
}

static kl_status report(const struct kl_options *o, const char *path, size_t records, size_t drawn,
                        struct kl_err *err)
{
    kl_status st = KL_OK;

    if (!o->json || o->json_file != NULL) {
        (void)printf("%s: %zu of %zu records in view\n", path, drawn, records);
    }
    if (o->json) {
        json_t *root = json_pack("{s:s,s:I,s:I}", "file", path, "records", (json_int_t)records,
                                 "drawn", (json_int_t)drawn);
        st = kl_json_write(root, o->json_file, err);
        json_decref(root);
    }
    return st;
}

kl_status kl_command_cache_view(const struct kl_options *options, struct kl_err *err)
{
    /* A frame of SCENE from CACHE as it is. */
    struct kl_options o = *options;
    struct kl_job job = {0};
    struct kl_record_list list = {0};
    struct kl_image *frame = NULL;
    struct kl_image *picture = NULL;
    char path[KL_JOB_PATH_SIZE];
    size_t drawn = 0;

    o.cache = options->arguments[0];
    o.arguments = options->arguments + 1;
    o.argument_count = 1;
    o.cache_mode = KL_CACHE_MODE_FREEZE;
    o.progress = KL_PROGRESS_OFF;
    kl_status st = kl_job_init(&job, &o, err);
    if (st == KL_OK) st = kl_job_image_path(&job, 0, path, err);
    if (st == KL_OK) st = kl_record_list_load(o.cache, &list, err);
    if (st == KL_OK) st = kl_image_create(o.width, o.height, &frame, err);
    if (st == KL_OK) st = kl_frame_add_layers(frame, "Z,cache.late", err);
    if (st == KL_OK) st = render(&job, frame, err);
    if (st == KL_OK) st = kl_image_create(o.width, o.height, &picture, err);
    if (st == KL_OK) st = draw(&job, &list, frame, picture, &drawn, err);
    if (st == KL_OK) st = write_picture(path, picture, err);
    if (st == KL_OK) st = report(options, path, list.count, drawn, err);
    kl_image_destroy(frame);
    kl_image_destroy(picture);
    kl_record_list_fini(&list);
    kl_job_fini(&job);
    return st;
}
