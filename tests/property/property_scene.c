#include "property_scene.h"

#include "src/import/import.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void scene_path(const char *name, char *path, size_t size)
{
    const char *data = getenv("KEEPLIGHT_DATA");
    (void)snprintf(path, size, "%s/scenes/exact/%s.glb",
                   data != NULL ? data : KL_SOURCE_DIR "/../shared", name);
}

bool property_has(const char *name)
{
    char path[1024];
    scene_path(name, path, sizeof path);
    if (access(path, R_OK) == 0) return true;
    print_message("skipped: no test scene %s (set KEEPLIGHT_DATA)\n", path);
    return false;
}

static void check(kl_status st, const struct kl_err *err)
{
    if (st != KL_OK) fail_msg("%s", err->msg);
}

static void import_scene(struct property_stage *stage, const char *name)
{
    struct kl_err err = {0};
    char path[1024];

    *stage = (struct property_stage){0};
    scene_path(name, path, sizeof path);
    check(kl_import_gltf(path, NULL, NULL, &stage->scene, &err), &err);
}

static void make_renderer(struct property_stage *stage, enum kl_indirect indirect, double error,
                          const char *dir)
{
    const struct kl_renderer_settings settings = {
        .indirect = indirect, .device = "embree", .error = error, .animation = KL_NONE};
    struct kl_err err = {0};

    check(kl_renderer_create(stage->scene, &settings, &stage->renderer, &err), &err);
    check(kl_renderer_set_time(stage->renderer, 0.0, &err), &err);
    if (indirect != KL_INDIRECT_CACHE) return;
    check(kl_renderer_open_cache(stage->renderer, dir, KL_STORE_EXTEND, &err), &err);
}

void property_open(struct property_stage *stage, const char *name, enum kl_indirect indirect,
                   double error, const char *dir)
{
    import_scene(stage, name);
    make_renderer(stage, indirect, error, dir);
}

void property_open_changed(struct property_stage *stage, const char *name,
                           enum kl_indirect indirect, void (*change)(struct kl_scene *scene))
{
    import_scene(stage, name);
    change(stage->scene);
    make_renderer(stage, indirect, 0.0, NULL);
}

void property_close(struct property_stage *stage)
{
    kl_renderer_destroy(stage->renderer);
    kl_scene_destroy(stage->scene);
}

uint32_t property_camera(const struct property_stage *stage, const char *name)
{
    for (uint32_t i = 0; i < stage->scene->camera_count; ++i) {
        if (strcmp(stage->scene->cameras[i].name, name) == 0) return i;
    }
    fail_msg("no camera '%s'", name);
    return 0;
}

struct kl_camera property_look(const struct property_stage *stage, const char *name, double time,
                               uint32_t side)
{
    struct kl_camera camera;
    struct kl_err err = {0};
    check(kl_renderer_camera(stage->renderer, property_camera(stage, name), time, side, side,
                             &camera, &err),
          &err);
    return camera;
}

void property_fill(struct property_stage *stage, const struct kl_camera *cameras, uint32_t count,
                   bool keep, struct kl_fill_stats *stats)
{
    const struct kl_renderer_fill fill = {.cameras = cameras, .camera_count = count, .keep = keep};
    struct kl_fill_stats own;
    struct kl_err err = {0};
    check(kl_renderer_fill(stage->renderer, &fill, stats != NULL ? stats : &own, &err), &err);
}

struct kl_image *property_render(struct property_stage *stage, const struct kl_camera *camera,
                                 int64_t frame, uint32_t spp, struct kl_counts *counts)
{
    const struct kl_renderer_frame job = {
        .camera = *camera, .before = *camera, .frame = frame, .spp = spp};
    struct kl_image *image = NULL;
    struct kl_counts own;
    uint64_t bad = 0;
    struct kl_err err = {0};
    check(kl_image_create(camera->width, camera->height, &image, &err), &err);
    check(kl_frame_add_layers(image, "all", &err), &err);
    check(
        kl_renderer_frame(stage->renderer, &job, image, counts != NULL ? counts : &own, &bad, &err),
        &err);
    assert_int_equal(bad, 0);
    return image;
}

struct property_spread property_measure(const struct kl_image *image, const char *channel,
                                        double about)
{
    const struct kl_channel *c = kl_image_find(image, channel);
    const struct kl_channel *ids = kl_image_find(image, "id");
    struct property_spread s = {0};
    double sum = 0.0;
    double square = 0.0;
    assert_non_null(c);
    assert_non_null(ids);
    for (size_t i = 0; i < (size_t)image->width * image->height; ++i) {
        if (ids->uints[i] == KL_NONE) continue;
        const double v = (double)c->data[i];
        ++s.pixels;
        sum += v;
        square += v * v;
        s.worst = fmax(s.worst, fabs(v - about));
    }
    assert_true(s.pixels > 0);
    s.mean = sum / s.pixels;
    s.deviation = sqrt(fmax(0.0, square / s.pixels - s.mean * s.mean));
    return s;
}

bool property_same(const struct kl_image *a, const struct kl_image *b)
{
    const size_t pixels = (size_t)a->width * a->height;
    bool same = a->channel_count == b->channel_count;
    for (size_t i = 0; same && i < a->channel_count; ++i) {
        const struct kl_channel *c = &a->channels[i];
        const struct kl_channel *d = kl_image_find(b, c->name);
        if (d == NULL) return false;
        const void *p = c->uints != NULL ? (const void *)c->uints : c->data;
        const void *q = d->uints != NULL ? (const void *)d->uints : d->data;
        same = memcmp(p, q, 4 * pixels) == 0;
        if (!same) print_message("layer %s differs\n", c->name);
    }
    return same;
}
