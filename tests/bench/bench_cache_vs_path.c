/* Time to equal error: the cache, its filling included, against path tracing with more and more
 * samples, both compared with a reference image. Prints JSON.
 * usage: bench_cache_vs_path SCENE.glb CAMERA FRAME(at 24/s) REFERENCE.exr [error 0.02] [spp 16]
 * [largest path spp 256] [gather rays 1024] */
#include "src/base/clock.h"
#include "src/image/exr.h"
#include "src/image/metrics.h"
#include "src/import/import.h"
#include "src/render/renderer.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { STEPS = 16 };

struct bench {
    struct kl_scene *scene;
    struct kl_image *reference;
    const char *camera;
    double time, error;
    uint32_t spp, most_spp, rays;
};

struct point {
    uint32_t spp;
    double seconds, fill_seconds, relmse, block;
    uint32_t records[KL_CACHE_LEVELS];
};

static kl_status judge(const struct bench *b, const struct kl_image *image, struct point *p,
                       struct kl_err *err)
{
    const struct kl_metrics_options options = {.mask_above = 6.0f, .without_flip = true};
    struct kl_metrics m;
    kl_status st = kl_metrics_compare(image, b->reference, &options, &m, err);
    if (st != KL_OK) return st;
    p->relmse = m.relmse;
    p->block = m.block8_relmse;
    return KL_OK;
}

/* A renderer at the instant, and the camera that the name means. */
static kl_status open_renderer(const struct bench *b, enum kl_indirect indirect,
                               struct kl_renderer **r, struct kl_camera *camera, struct kl_err *err)
{
    const struct kl_renderer_settings settings = {.rays = b->rays,
                                                  .indirect = indirect,
                                                  .device = "embree",
                                                  .error = b->error,
                                                  .animation = KL_NONE};
    uint32_t index = 0;
    while (index < b->scene->camera_count &&
           strcmp(b->scene->cameras[index].name, b->camera) != 0) {
        ++index;
    }
    if (index == b->scene->camera_count) {
        return kl_fail(err, KL_ERR_USAGE, "no camera '%s'", b->camera);
    }
    kl_status st = kl_renderer_create(b->scene, &settings, r, err);
    if (st == KL_OK) st = kl_renderer_set_time(*r, b->time, err);
    if (st == KL_OK) {
        st = kl_renderer_camera(*r, index, b->time, b->reference->width, b->reference->height,
                                camera, err);
    }
    return st;
}

/* One frame: seconds and error into *p. */
static kl_status render(const struct bench *b, struct kl_renderer *r,
                        const struct kl_camera *camera, struct point *p, struct kl_err *err)
{
    const struct kl_renderer_frame frame = {
        .camera = *camera, .before = *camera, .frame = 1, .spp = p->spp};
    struct kl_image *image = NULL;
    struct kl_counts counts;
    uint64_t bad;
    kl_status st = kl_image_create(camera->width, camera->height, &image, err);
    if (st == KL_OK) st = kl_frame_add_layers(image, "beauty", err);
    const double start = kl_seconds();
    if (st == KL_OK) st = kl_renderer_frame(r, &frame, image, &counts, &bad, err);
    p->seconds = p->fill_seconds + kl_seconds() - start;
    if (st == KL_OK) st = judge(b, image, p, err);
    kl_image_destroy(image);
    return st;
}

static kl_status time_cache(const struct bench *b, struct point *p, struct kl_err *err)
{
    struct kl_renderer *r = NULL;
    struct kl_camera camera;
    struct kl_cache_state state = {0};
    struct kl_fill_stats stats;
    kl_status st = open_renderer(b, KL_INDIRECT_CACHE, &r, &camera, err);
    if (st == KL_OK) st = kl_renderer_open_cache(r, NULL, KL_STORE_EXTEND, err);
    const double start = kl_seconds();
    const struct kl_renderer_fill fill = {.cameras = &camera, .camera_count = 1};
    if (st == KL_OK) st = kl_renderer_fill(r, &fill, &stats, err);
    p->fill_seconds = kl_seconds() - start;
    p->spp = b->spp;
    if (st == KL_OK) st = render(b, r, &camera, p, err);
    if (st == KL_OK) kl_renderer_get_cache(r, &state);
    memcpy(p->records, state.records, sizeof p->records);
    kl_renderer_destroy(r);
    return st;
}

static kl_status time_paths(const struct bench *b, struct point paths[STEPS], int *count,
                            struct kl_err *err)
{
    struct kl_renderer *r = NULL;
    struct kl_camera camera;
    kl_status st = open_renderer(b, KL_INDIRECT_PATH, &r, &camera, err);
    *count = 0;
    for (uint32_t spp = 4; st == KL_OK && spp <= b->most_spp && *count < STEPS; spp *= 4) {
        struct point *p = &paths[(*count)++];
        *p = (struct point){.spp = spp};
        st = render(b, r, &camera, p, err);
    }
    kl_renderer_destroy(r);
    return st;
}

/* Seconds at which the paths reach an error: interpolated between measured points on a log-log
 * scale; beyond the last one by error ~ 1 / time. */
static double path_seconds(const struct point *paths, int count, double error, int by_block)
{
    for (int i = 0; i < count; ++i) {
        const double e = by_block ? paths[i].block : paths[i].relmse;
        if (e > error && i + 1 < count) continue;
        if (e > error || i == 0) return paths[i].seconds * e / error;
        const double before = by_block ? paths[i - 1].block : paths[i - 1].relmse;
        const double f = log(before / error) / log(before / e);
        return paths[i - 1].seconds * pow(paths[i].seconds / paths[i - 1].seconds, f);
    }
    return 0.0;
}

static void print(const struct bench *b, const struct point *cache, const struct point *paths,
                  int count)
{
    const double equal = path_seconds(paths, count, cache->relmse, 0);
    const double equal_block = path_seconds(paths, count, cache->block, 1);
    (void)printf("{\"camera\": \"%s\", \"width\": %u, \"height\": %u, \"error_aim\": %g,\n"
                 " \"cache\": {\"spp\": %u, \"seconds\": %.3f, \"fill_seconds\": %.3f, "
                 "\"records\": [%u, %u], \"relmse\": %.6g, \"block8_relmse\": %.6g},\n \"path\": [",
                 b->camera, b->reference->width, b->reference->height, b->error, cache->spp,
                 cache->seconds, cache->fill_seconds, cache->records[0], cache->records[1],
                 cache->relmse, cache->block);
    for (int i = 0; i < count; ++i) {
        (void)printf(
            "%s{\"spp\": %u, \"seconds\": %.3f, \"relmse\": %.6g, \"block8_relmse\": %.6g}",
            i ? ",\n          " : "", paths[i].spp, paths[i].seconds, paths[i].relmse,
            paths[i].block);
    }
    (void)printf("],\n \"path_seconds_to_equal_relmse\": %.3f, \"speedup_relmse\": %.3f,\n"
                 " \"path_seconds_to_equal_block8\": %.3f, \"speedup_block8\": %.3f}\n",
                 equal, equal / cache->seconds, equal_block, equal_block / cache->seconds);
}

int main(int argc, char **argv)
{
    struct bench b = {0};
    struct point cache = {0};
    struct point paths[STEPS];
    struct kl_err err = {0};
    int count = 0;
    if (argc < 5) {
        (void)fprintf(stderr, "usage: bench_cache_vs_path SCENE.glb CAMERA FRAME REFERENCE.exr "
                              "[error] [spp] [largest path spp] [gather rays]\n");
        return 1;
    }
    b.camera = argv[2];
    b.time = strtod(argv[3], NULL) / 24.0;
    b.error = argc > 5 ? strtod(argv[5], NULL) : 0.02;
    b.spp = argc > 6 ? (uint32_t)strtoul(argv[6], NULL, 10) : 16;
    b.most_spp = argc > 7 ? (uint32_t)strtoul(argv[7], NULL, 10) : 256;
    b.rays = argc > 8 ? (uint32_t)strtoul(argv[8], NULL, 10) : 0;
    kl_status st = kl_import_gltf(argv[1], NULL, NULL, &b.scene, &err);
    if (st == KL_OK) st = kl_exr_read(argv[4], &b.reference, &err);
    if (st == KL_OK) st = time_cache(&b, &cache, &err);
    if (st == KL_OK) st = time_paths(&b, paths, &count, &err);
    if (st == KL_OK) {
        print(&b, &cache, paths, count);
    } else {
        (void)fprintf(stderr, "%s\n", err.msg);
    }
    kl_image_destroy(b.reference);
    kl_scene_destroy(b.scene);
    return st == KL_OK ? 0 : 1;
}
