/* Images of the exact scenes against independent ones, path traced by another renderer: means of
 * 8 x 8 blocks, as the references are noisy themselves, without the lamps. */
#include "property_scene.h"

#include "src/image/exr.h"
#include "src/image/metrics.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

struct shot {
    const char *scene, *camera, *reference;
    double time; /* [s] */
    uint32_t spp;
    float lamp;        /* pixels above this are left out */
    double most_block; /* block8_relmse */
    /* The references' renderer emits from both sides. The black quad 1 mm behind each lamp leaves a
     * slit, through which it sends perimeter * gap / (2 * area) more than the scene means; the
     * share of that in the image's mean. */
    double slit;
};
static const double most_mean = 0.005; /* of the mean error, apart from the slit */

static bool find_reference(const char *name, char path[1024])
{
    const char *data = getenv("KEEPLIGHT_DATA");
    (void)snprintf(path, 1024, "%s/references/%s.exr",
                   data != NULL ? data : KL_SOURCE_DIR "/../shared", name);
    if (access(path, R_OK) == 0) return true;
    print_message("skipped: no reference image %s (set KEEPLIGHT_DATA)\n", path);
    return false;
}

static void compare(const struct shot *shot, enum kl_indirect indirect)
{
    const struct kl_metrics_options options = {.mask_above = shot->lamp, .without_flip = true};
    struct property_stage stage;
    struct kl_image *reference = NULL;
    struct kl_metrics m;
    struct kl_err err = {0};
    char path[1024];

    if (!property_has(shot->scene) || !find_reference(shot->reference, path)) skip();
    if (kl_exr_read(path, &reference, &err) != KL_OK) fail_msg("%s", err.msg);
    property_open(&stage, shot->scene, indirect, 0.0, NULL);
    struct kl_camera camera;
    if (kl_renderer_camera(stage.renderer, property_camera(&stage, shot->camera), shot->time,
                           reference->width, reference->height, &camera, &err) != KL_OK) {
        fail_msg("%s", err.msg);
    }
    if (indirect == KL_INDIRECT_CACHE) property_fill(&stage, &camera, 1, false, NULL);
    struct kl_image *image = property_render(&stage, &camera, 1, shot->spp, NULL);
    if (kl_metrics_compare(image, reference, &options, &m, &err) != KL_OK) fail_msg("%s", err.msg);
    print_message("%s, %s: relMSE %.2e, of blocks %.2e, mean error %+.4f\n", shot->reference,
                  indirect == KL_INDIRECT_CACHE ? "cache" : "paths", m.relmse, m.block8_relmse,
                  m.mean_error);
    const bool good =
        m.block8_relmse < shot->most_block && fabs(m.mean_error + shot->slit) < most_mean;
    if (!good) { /* for whoever looks into it */
        const char *folder = getenv("TMPDIR");
        (void)snprintf(path, sizeof path, "%s/golden-%s.exr", folder != NULL ? folder : "/tmp",
                       shot->reference);
        if (kl_exr_write(path, image, &err) == KL_OK) print_message("see %s\n", path);
    }
    kl_image_destroy(image);
    kl_image_destroy(reference);
    property_close(&stage);
    assert_true(good);
}

static const struct shot cornell = {"cornell", "camera", "cornell", 0.0, 16, 10.0f, 2.5e-3, 0.004};
static const struct shot sphere = {
    "integrating-sphere", "camera", "integrating-sphere", 0.0, 32, 2.0f, 1.2e-3, 0.02};
static const struct shot rooms = {"two-rooms", "bright camera", "two-rooms-bright", 0.0, 32, 10.0f,
                                  5e-4,        0.0033};
static const struct shot gallery = {"gallery", "fly", "gallery-fly-0001", 1.0 / 24.0, 32, 6.0f,
                                    1e-3,      0.0};

static void cornell_by_paths(void **state)
{
    (void)state;
    compare(&cornell, KL_INDIRECT_PATH);
}
static void cornell_by_the_cache(void **state)
{
    (void)state;
    compare(&cornell, KL_INDIRECT_CACHE);
}
static void sphere_by_paths(void **state)
{
    (void)state;
    compare(&sphere, KL_INDIRECT_PATH);
}
static void sphere_by_the_cache(void **state)
{
    (void)state;
    compare(&sphere, KL_INDIRECT_CACHE);
}
static void rooms_by_paths(void **state)
{
    (void)state;
    compare(&rooms, KL_INDIRECT_PATH);
}
static void rooms_by_the_cache(void **state)
{
    (void)state;
    compare(&rooms, KL_INDIRECT_CACHE);
}
static void gallery_by_paths(void **state)
{
    (void)state;
    compare(&gallery, KL_INDIRECT_PATH);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cornell_by_paths), cmocka_unit_test(cornell_by_the_cache),
        cmocka_unit_test(sphere_by_paths),  cmocka_unit_test(sphere_by_the_cache),
        cmocka_unit_test(rooms_by_paths),   cmocka_unit_test(rooms_by_the_cache),
        cmocka_unit_test(gallery_by_paths),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
