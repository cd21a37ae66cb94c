/* What must not change an image: threads, the order of frames, a cache from disk instead of one
 * that was just filled. */
#include "property_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <dirent.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { SIDE = 48, SPP = 2 };

static void make_folder(char path[64])
{
    (void)snprintf(path, 64, "/tmp/keeplight-property-XXXXXX");
    assert_non_null(mkdtemp(path));
}

/* A folder and the files and folders in it. */
static void remove_folder(const char *path)
{
    char inner[512];
    DIR *d = opendir(path);
    for (struct dirent *e; d != NULL && (e = readdir(d)) != NULL;) {
        if (strcmp(e->d_name, ".") == 0 || strcmp(e->d_name, "..") == 0) continue;
        (void)snprintf(inner, sizeof inner, "%s/%s", path, e->d_name);
        if (remove(inner) != 0) remove_folder(inner);
    }
    if (d != NULL) (void)closedir(d);
    (void)remove(path);
}

static void expect_same(struct kl_image *a, struct kl_image *b)
{
    assert_true(property_same(a, b));
    kl_image_destroy(b);
}

/* Fill and render with a number of threads. */
static struct kl_image *render_with(int threads, uint32_t records[2])
{
    struct property_stage stage;
    struct kl_cache_state state;
    omp_set_num_threads(threads);
    property_open(&stage, "cornell", KL_INDIRECT_CACHE, 0.0, NULL);
    const struct kl_camera camera = property_look(&stage, "camera", 0.0, SIDE);
    property_fill(&stage, &camera, 1, false, NULL);
    struct kl_image *image = property_render(&stage, &camera, 1, SPP, NULL);
    kl_renderer_get_cache(stage.renderer, &state);
    records[0] = state.records[0];
    records[1] = state.records[1];
    property_close(&stage);
    return image;
}

static void any_number_of_threads(void **state)
{
    const int before = omp_get_max_threads();
    uint32_t one[2], many[2];
    (void)state;
    if (!property_has("cornell")) skip();
    struct kl_image *image = render_with(1, one);
    for (int threads = 2; threads <= 5; threads += 3) {
        expect_same(image, render_with(threads, many));
        assert_memory_equal(one, many, sizeof one);
    }
    omp_set_num_threads(before);
    kl_image_destroy(image);
}

static void any_number_of_threads_by_paths(void **state)
{
    const int before = omp_get_max_threads();
    struct property_stage stage;
    (void)state;
    if (!property_has("cornell")) skip();
    property_open(&stage, "cornell", KL_INDIRECT_PATH, 0.0, NULL);
    const struct kl_camera camera = property_look(&stage, "camera", 0.0, SIDE);
    omp_set_num_threads(1);
    struct kl_image *image = property_render(&stage, &camera, 1, SPP, NULL);
    omp_set_num_threads(3);
    expect_same(image, property_render(&stage, &camera, 1, SPP, NULL));
    omp_set_num_threads(before);
    kl_image_destroy(image);
    property_close(&stage);
}

/* Once filled, frames do not depend on each other; another number gives other samples. */
static void any_order_of_frames(void **state)
{
    struct property_stage stage;
    struct kl_image *first[3];
    (void)state;
    if (!property_has("cornell")) skip();
    property_open(&stage, "cornell", KL_INDIRECT_CACHE, 0.0, NULL);
    const struct kl_camera camera = property_look(&stage, "camera", 0.0, SIDE);
    property_fill(&stage, &camera, 1, false, NULL);
    for (int i = 0; i < 3; ++i) {
        first[i] = property_render(&stage, &camera, i, SPP, NULL);
    }
    for (int i = 2; i >= 0; --i) {
        expect_same(first[i], property_render(&stage, &camera, i, SPP, NULL));
    }
    const struct kl_channel *a = kl_image_find(first[0], "G");
    const struct kl_channel *b = kl_image_find(first[1], "G");
    assert_memory_not_equal(a->data, b->data, SIDE * SIDE * sizeof(float));
    for (int i = 0; i < 3; ++i) {
        kl_image_destroy(first[i]);
    }
    property_close(&stage);
}

/* Cold: filled, kept, rendered. Warm: opened from disk, nothing to add, the same image. */
static void warm_is_cold(void **state)
{
    struct property_stage stage;
    struct kl_fill_stats stats;
    char root[64];
    char dir[80];
    (void)state;
    if (!property_has("cornell")) skip();
    make_folder(root);
    (void)snprintf(dir, sizeof dir, "%s/room.klc", root);
    property_open(&stage, "cornell", KL_INDIRECT_CACHE, 0.0, dir);
    const struct kl_camera camera = property_look(&stage, "camera", 0.0, SIDE);
    property_fill(&stage, &camera, 1, true, &stats);
    assert_true(stats.added[0] > 100 && stats.added[1] > 100);
    struct kl_image *cold = property_render(&stage, &camera, 1, SPP, NULL);
    property_close(&stage);

    property_open(&stage, "cornell", KL_INDIRECT_CACHE, 0.0, dir);
    struct kl_image *opened = property_render(&stage, &camera, 1, SPP, NULL);
    property_fill(&stage, &camera, 1, true, &stats);
    print_message("warm fill adds %u + %u\n", stats.added[0], stats.added[1]);
    struct kl_image *filled = property_render(&stage, &camera, 1, SPP, NULL);
    property_close(&stage);
    remove_folder(root);

    expect_same(cold, opened);
    assert_int_equal(stats.added[0] + stats.added[1], 0);
    expect_same(cold, filled);
    kl_image_destroy(cold);
}

/* Memory only and on disk: the same. */
static void keeping_changes_nothing(void **state)
{
    struct property_stage stage;
    struct kl_image *images[2];
    char root[64];
    char dir[80];
    (void)state;
    if (!property_has("cornell")) skip();
    make_folder(root);
    (void)snprintf(dir, sizeof dir, "%s/room.klc", root);
    for (int i = 0; i < 2; ++i) {
        property_open(&stage, "cornell", KL_INDIRECT_CACHE, 0.0, i ? dir : NULL);
        const struct kl_camera camera = property_look(&stage, "camera", 0.0, SIDE);
        property_fill(&stage, &camera, 1, i, NULL);
        images[i] = property_render(&stage, &camera, 1, SPP, NULL);
        property_close(&stage);
    }
    remove_folder(root);
    expect_same(images[0], images[1]);
    kl_image_destroy(images[0]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(any_number_of_threads),   cmocka_unit_test(any_number_of_threads_by_paths),
        cmocka_unit_test(any_order_of_frames),     cmocka_unit_test(warm_is_cold),
        cmocka_unit_test(keeping_changes_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
