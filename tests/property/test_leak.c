/* Two closed rooms with a wall of 1 mm (or 10 um) between them, one without any light: it stays
 * black, also when one cache serves both. */
#include "property_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>

static void dark_room_stays_dark(const char *name)
{
    struct property_stage stage;
    struct kl_fill_stats stats;
    if (!property_has(name)) skip();
    property_open(&stage, name, KL_INDIRECT_CACHE, 0.0, NULL);
    const struct kl_camera cameras[2] = {property_look(&stage, "bright camera", 0.0, 96),
                                         property_look(&stage, "dark camera", 0.0, 96)};
    property_fill(&stage, cameras, 2, false, &stats);
    struct kl_image *bright = property_render(&stage, &cameras[0], 1, 4, NULL);
    struct kl_image *dark = property_render(&stage, &cameras[1], 1, 4, NULL);
    const struct property_spread b = property_measure(bright, "G", 0.0);
    const struct property_spread d = property_measure(dark, "G", 0.0);
    uint32_t leaking = 0;
    const struct kl_channel *g = kl_image_find(dark, "G");
    for (size_t i = 0; i < 96 * 96; ++i) {
        leaking += (double)g->data[i] > 1e-3 * b.mean;
    }
    print_message("%s: bright mean %.4f, dark mean %.3e, worst %.3e, %u pixels above 1e-3, records "
                  "%u + %u\n",
                  name, b.mean, d.mean, d.worst, leaking, stats.added[0], stats.added[1]);
    assert_true(b.mean > 0.1);
    assert_true(d.worst < 1e-3 * b.mean);
    kl_image_destroy(bright);
    kl_image_destroy(dark);
    property_close(&stage);
}

static void wall_of_a_millimetre(void **state)
{
    (void)state;
    dark_room_stays_dark("two-rooms");
}

static void wall_of_ten_micrometres(void **state)
{
    (void)state;
    dark_room_stays_dark("two-rooms-thin");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(wall_of_a_millimetre),
        cmocka_unit_test(wall_of_ten_micrometres),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
