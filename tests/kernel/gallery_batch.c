#include "gallery_batch.h"

#include "src/base/memory.h"
#include "src/import/import.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { WIDTH = 192, HEIGHT = 108, RAYS = 64 };

static kl_status fill_store(struct gallery_batch *b, struct kl_err *err)
{
    const struct kl_renderer_settings settings = {
        .animation = KL_NONE, .device = "embree", .rays = RAYS, .error = 0.02};
    struct kl_camera camera;
    struct kl_fill_stats stats;
    const struct kl_renderer_fill fill = {.cameras = &camera, .camera_count = 1, .keep = true};
    kl_status st = kl_renderer_create(b->scene, &settings, &b->renderer, err);

    if (st == KL_OK) st = kl_renderer_set_time(b->renderer, 0.0, err);
    if (st == KL_OK) {
        st = kl_renderer_camera(b->renderer, 0, 1.0 / 24.0, WIDTH, HEIGHT, &camera, err);
    }
    if (st == KL_OK) st = kl_renderer_open_cache(b->renderer, b->dir, KL_STORE_REBUILD, err);
    return st == KL_OK ? kl_renderer_fill(b->renderer, &fill, &stats, err) : st;
}

/* Every n-th record seen from the camera, gathered anew with full batches of rays. */
static void take_points(struct gallery_batch *b, const struct kl_level_arrays *level, size_t count)
{
    b->count = level->record_count < count ? level->record_count : count;
    for (size_t i = 0; i < b->count; ++i) {
        const size_t k = i * level->record_count / b->count;
        const uint32_t seed = kl_record_seed(level->hot[k].pos, level->hot[k].normal, 0);
        const float angle = 6.2831853f * (float)(seed & 1023u) / 1024.0f;
        kl_gather_point *p = &b->points[i];
        memcpy(p->pos, level->hot[k].pos, sizeof p->pos);
        p->normal = level->hot[k].normal;
        p->geometric = level->hot[k].normal;
        p->seed = seed;
        p->rot_cos = cosf(angle);
        p->rot_sin = sinf(angle);
    }
}

static kl_status init(struct gallery_batch *b, const char *path, uint32_t side, size_t count,
                      struct kl_err *err)
{
    struct kl_pose *pose = NULL;
    struct kl_store_key key;
    struct kl_store_segment_info info;
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    kl_status st = kl_import_gltf(path, NULL, NULL, &b->scene, err);

    if (st == KL_OK) st = fill_store(b, err);
    if (st == KL_OK) st = kl_store_open(b->dir, KL_STORE_READ, NULL, &b->store, err);
    if (st != KL_OK) return st;
    kl_store_key_get(b->store, &key);
    kl_store_segment_get(b->store, 0, &info, levels);
    b->level1 = (kl_level_view){levels[1].octree, levels[1].hot,  levels[1].cold,
                                levels[1].nodes,  levels[1].rows, NULL};
    st = kl_pose_create(b->scene, KL_NONE, 0.0, &pose, err);
    if (st == KL_OK) st = kl_flat_create(b->scene, pose, key.origin, &b->flat, err);
    kl_pose_destroy(pose);
    if (st == KL_OK) st = kl_tracer_create(b->flat, &b->tracer, err);
    if (st == KL_OK) st = kl_gather_tables_create(side, &b->tables, err);
    if (st == KL_OK) st = kl_alloc_array(&b->points, count, sizeof *b->points, err);
    if (st == KL_OK) take_points(b, &levels[0], count);
    return st;
}

bool gallery_batch_init(struct gallery_batch *batch, uint32_t side, size_t count)
{
    const char *data = getenv("KEEPLIGHT_DATA");
    struct kl_err err;
    char path[1024];

    *batch = (struct gallery_batch){.dir = "/tmp/keeplight-gallery-XXXXXX"};
    if (data == NULL) data = KL_SOURCE_DIR "/../shared";
    (void)snprintf(path, sizeof path, "%s/scenes/exact/gallery.glb", data);
    if (access(path, R_OK) != 0) {
        (void)printf("skipped: no %s\n", path);
        return false;
    }
    if (mkdtemp(batch->dir) == NULL) return false;
    if (init(batch, path, side, count, &err) == KL_OK) return true;
    (void)printf("failed: %s\n", err.msg);
    return false;
}

void gallery_batch_fini(struct gallery_batch *batch)
{
    char command[128];
    kl_gather_tables_destroy(batch->tables);
    kl_tracer_destroy(batch->tracer);
    kl_flat_destroy(batch->flat);
    kl_renderer_destroy(batch->renderer);
    kl_store_close(batch->store);
    kl_scene_destroy(batch->scene);
    free(batch->points);
    (void)snprintf(command, sizeof command, "rm -rf '%s'", batch->dir);
    if (strncmp(batch->dir, "/tmp/keeplight-gallery-", 23) == 0 && system(command) != 0) {
        (void)printf("could not remove %s\n", batch->dir);
    }
}

struct kl_gather_job gallery_batch_job(const struct gallery_batch *batch, kl_gather_result *results)
{
    return (struct kl_gather_job){
        .scene = &batch->flat->view,
        .level1 = &batch->level1,
        .ladder = {.steps = {batch->tables}, .count = 1},
        .settings = {.query = {1.0f, 0.9394f, 0.8f}, .length_scale = 2.0f},
        .points = batch->points,
        .count = batch->count,
        .results = results,
    };
}
