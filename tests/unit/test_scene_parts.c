/* Which part of an edited scene differs, and when it is another scene. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "src/scene/scene_parts.h"
#include <stdio.h>
#include <string.h>

enum { OBJECTS = 6 };

static kl_part object(uint32_t number)
{
    kl_part p = {.kind = KL_PART_OBJECT,
                 .name = {number, 77},
                 .shape = {1, number},
                 .place = {2, number},
                 .surface = {3, 3}};
    (void)snprintf(p.label, sizeof p.label, "thing %u", number);
    return p;
}

static void make_scene(kl_part parts[OBJECTS + 2])
{
    for (uint32_t i = 0; i < OBJECTS; ++i) {
        parts[i] = object(i);
    }
    parts[OBJECTS] =
        (kl_part){.kind = KL_PART_LIGHT, .name = {9, 9}, .glow = {1, 1}, .label = "sun"};
    parts[OBJECTS + 1] = (kl_part){.kind = KL_PART_SETTINGS, .label = "1024 rays"};
}

static void compare(const kl_part *old, uint32_t old_count, const kl_part *fresh, uint32_t count,
                    struct kl_parts_edits *out)
{
    struct kl_err err;
    assert_int_equal(kl_parts_compare(old, old_count, fresh, count, out, &err), KL_OK);
}

static void test_nothing_changed(void **state)
{
    kl_part a[OBJECTS + 2];
    kl_part b[OBJECTS + 2];
    struct kl_parts_edits edits;
    (void)state;

    make_scene(a);
    make_scene(b);
    strcpy(b[OBJECTS + 1].label, "64 rays"); /* settings are no part of the scene */
    compare(a, OBJECTS + 2, b, OBJECTS + 2, &edits);
    assert_int_equal(edits.count, 0);
    assert_int_equal(edits.common, OBJECTS);
    assert_true(edits.is_same_scene);
    kl_parts_edits_fini(&edits);
}

static void test_each_change_is_named(void **state)
{
    kl_part a[OBJECTS + 2];
    kl_part b[OBJECTS + 2];
    struct kl_parts_edits edits;
    char text[256];
    (void)state;

    make_scene(a);
    make_scene(b);
    b[0].surface[0] ^= 1;
    b[1].place[1] ^= 1;
    b[OBJECTS].glow[0] ^= 1;
    const kl_part fresh = object(40);
    b[5] = fresh; /* object 5 is gone, 40 is new */
    compare(a, OBJECTS + 2, b, OBJECTS + 2, &edits);
    assert_int_equal(edits.count, 5);
    assert_int_equal(edits.items[0].what, KL_PART_SURFACE);
    assert_int_equal(edits.items[1].what, KL_PART_PLACE);
    assert_int_equal(edits.items[2].what, KL_PART_REMOVED);
    assert_ptr_equal(edits.items[2].old, &a[5]);
    assert_null(edits.items[2].fresh);
    assert_int_equal(edits.items[3].what, KL_PART_GLOW);
    assert_int_equal(edits.items[4].what, KL_PART_ADDED);
    assert_ptr_equal(edits.items[4].fresh, &b[5]);
    assert_true(edits.is_same_scene);
    kl_parts_edits_describe(&edits, text, sizeof text);
    assert_string_equal(text, "object 'thing 0' (material), object 'thing 1' (place), object "
                              "'thing 5' (gone) and 2 more");
    kl_parts_edits_fini(&edits);
}

/* The order of a file does not matter, names do. */
static void test_order_does_not_matter(void **state)
{
    kl_part a[OBJECTS + 2];
    kl_part b[OBJECTS + 2];
    struct kl_parts_edits edits;
    (void)state;

    make_scene(a);
    make_scene(b);
    const kl_part first = b[0];
    memmove(b, b + 1, (OBJECTS - 1) * sizeof *b);
    b[OBJECTS - 1] = first;
    compare(a, OBJECTS + 2, b, OBJECTS + 2, &edits);
    assert_int_equal(edits.count, 0);
    kl_parts_edits_fini(&edits);
}

static void test_half_in_common_is_the_limit(void **state)
{
    kl_part a[OBJECTS + 2];
    kl_part b[OBJECTS + 2];
    struct kl_parts_edits edits;
    (void)state;

    make_scene(a);
    make_scene(b);
    for (uint32_t i = 0; i < 3; ++i) {
        b[i] = object(60 + i);
    }
    compare(a, OBJECTS + 2, b, OBJECTS + 2, &edits);
    assert_true(edits.is_same_scene);
    kl_parts_edits_fini(&edits);
    b[3] = object(63);
    compare(a, OBJECTS + 2, b, OBJECTS + 2, &edits);
    assert_false(edits.is_same_scene);
    kl_parts_edits_fini(&edits);
}

/* However little room there is, the text ends with a zero. */
static void test_text_is_cut(void **state)
{
    kl_part a[OBJECTS + 2];
    kl_part b[OBJECTS + 2];
    struct kl_parts_edits edits;
    char text[64];
    (void)state;

    make_scene(a);
    make_scene(b);
    for (uint32_t i = 0; i < OBJECTS; ++i) {
        b[i].surface[0] ^= 1;
    }
    compare(a, OBJECTS + 2, b, OBJECTS + 2, &edits);
    for (size_t size = 1; size < sizeof text; ++size) {
        memset(text, 'x', sizeof text);
        kl_parts_edits_describe(&edits, text, size);
        assert_true(strlen(text) < size);
    }
    kl_parts_edits_fini(&edits);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_nothing_changed),
        cmocka_unit_test(test_each_change_is_named),
        cmocka_unit_test(test_order_does_not_matter),
        cmocka_unit_test(test_half_in_common_is_the_limit),
        cmocka_unit_test(test_text_is_cut),
    };
    return cmocka_run_group_tests_name("scene parts", tests, NULL, NULL);
}
