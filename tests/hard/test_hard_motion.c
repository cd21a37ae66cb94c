/* Hard cases 23, 24, 26, 27, 32 need records that live with moving things. */
#include "hard_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

static void object_passes_through_a_record(void **state)
{
    (void)state;
    hard_waits("23", "waiting for motion: records that are suspended while something covers them");
}
static void surface_disappears_and_returns(void **state)
{
    (void)state;
    hard_waits("24", "waiting for motion: records that sleep while their surface is gone");
}
static void squash_and_stretch_over_time(void **state)
{
    (void)state;
    hard_waits("26", "waiting for motion: radii that follow a changing scale");
}
static void topology_changes(void **state)
{
    (void)state;
    hard_waits("27", "waiting for motion: records that die with their mesh");
}
static void touching_boxes_one_moves(void **state)
{
    (void)state;
    hard_waits("32", "waiting for motion: records that ride on an object");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(object_passes_through_a_record),
        cmocka_unit_test(surface_disappears_and_returns),
        cmocka_unit_test(squash_and_stretch_over_time),
        cmocka_unit_test(topology_changes),
        cmocka_unit_test(touching_boxes_one_moves),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
