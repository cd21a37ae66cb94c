/* Frame lists, file patterns, durations, frame rates and shutters. */
#include "sequences/duration.h"
#include "sequences/frames.h"
#include "sequences/pattern.h"
#include "sequences/shutter.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static void check_frames(const char *text, const char *expected)
{
    struct kl_frames frames;
    struct kl_err err;
    char got[256] = "";

    if (kl_frames_parse(text, &frames, &err) != KL_OK) fail_msg("%s", err.msg);
    for (size_t i = 0; i < frames.count; ++i) {
        char one[16];
        (void)snprintf(one, sizeof one, "%s%d", i ? " " : "", frames.frames[i]);
        assert_true(strlen(got) + strlen(one) < sizeof got);
        strcat(got, one);
    }
    assert_string_equal(got, expected);
    kl_frames_fini(&frames);
}

static void frame_lists(void **state)
{
    (void)state;
    check_frames("7", "7");
    check_frames("1-3", "1 2 3");
    check_frames("1-8x3,60", "1 4 7 60");
    check_frames("3-1", "3 2 1");
    check_frames("20-10x3", "20 17 14 11");
    check_frames("-10--8", "-10 -9 -8");
    check_frames("-2-2x2", "-2 0 2");
    check_frames("1:10x4", "1 5 9");
    check_frames("1..4", "1 2 3 4");
    check_frames("-3..-1", "-3 -2 -1");
    check_frames(" 4 , 1-5,2", "4 1 2 3 5");
    check_frames("5-5x100", "5");
}

static void bad_frame_lists(void **state)
{
    static const char *const texts[] = {
        "",      ",",       "1,",    "1-",     "-",
        "a",     "1-3x",    "1-3x0", "1-3x-1", "1--",
        "1 2",   "1-3y",    "1.5",   "1x2",    "99999999",
        "1-2-3", "1-3x0.5", "--1",   "1;2",    "1-2000001",
        "\xff",  "1...3",   "+1",    "0x10",   "1-1000000,2000000",
    };
    struct kl_frames frames;
    struct kl_err err;

    (void)state;
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; ++i) {
        if (kl_frames_parse(texts[i], &frames, &err) != KL_ERR_USAGE) fail_msg("%s", texts[i]);
        assert_true(strncmp(err.msg, "frames", 6) == 0);
    }
    assert_int_equal(kl_frames_parse("1-3y", &frames, &err), KL_ERR_USAGE);
    assert_non_null(strstr(err.msg, "character 4"));
    assert_int_equal(kl_frames_parse("1-1000000", &frames, &err), KL_OK);
    assert_int_equal(frames.count, 1000000);
    kl_frames_fini(&frames);
}

static void check_name(const char *pattern, int32_t frame, bool many, const char *expected)
{
    struct kl_err err;
    char name[64];

    if (kl_pattern_format(pattern, frame, many, name, sizeof name, &err) != KL_OK) {
        fail_msg("%s", err.msg);
    }
    assert_string_equal(name, expected);
}

static void patterns(void **state)
{
    (void)state;
    check_name("out.####.exr", 7, true, "out.0007.exr");
    check_name("out.#.exr", 123, false, "out.123.exr");
    check_name("out.####.exr", -8, true, "out.-0008.exr");
    check_name("a/%04d.exr", -8, true, "a/-008.exr");
    check_name("a%d.exr", 12, true, "a12.exr");
    check_name("a.$F4.exr", 12, true, "a.0012.exr");
    check_name("a.$F.exr", 12, true, "a.12.exr");
    check_name("$FOO/a.exr", 12, false, "$FOO/a.exr");
    check_name("100%/a.exr", 1, false, "100%/a.exr");
    check_name("a.exr", 5, false, "a.exr");
    check_name("a.exr", 5, true, "a.0005.exr");
    check_name("d.x/a", 5, true, "d.x/a.0005");
    check_name("d/.a", 5, true, "d/.a.0005");
    check_name("####", INT32_MIN, true, "-2147483648");
}

static void bad_patterns(void **state)
{
    static const char *const texts[] = {
        "",
        "dir/",
        "a.##.##.exr",
        "%d.$F4",
        "%099999999999d",
        "$F99999999999999999999.exr",
        "#########################",
        "a-name-that-is-much-too-long-for-the-buffer-of-this-test.exr",
    };
    struct kl_err err;
    char name[40];

    (void)state;
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; ++i) {
        if (kl_pattern_format(texts[i], 1, true, name, sizeof name, &err) != KL_ERR_USAGE) {
            fail_msg("%s", texts[i]);
        }
    }
}

static void durations(void **state)
{
    static const struct {
        const char *text;
        double seconds;
    } good[] = {{"90", 90},    {"90s", 90},      {"10m", 600},     {"1h30m", 5400},
                {"0.1h", 360}, {"0", 0},         {".5s", 0.5},     {"1h1s", 3601},
                {"2.5", 2.5},  {"1h2m3s", 3723}, {"30d", 2592000}, {"1d1h", 90000}};
    static const char *const bad[] = {
        "",       "h",    "-1",  "1h30",         "1m1h",  "1h1d",
        "1x",     "1s1s", "1e3", "inf",          "nan",   "1 h",
        "1h30m ", "0x5",  ".",   "999999999999", "1h-2m", "9999999999999999999999"};
    struct kl_err err;
    double seconds = 0.0;

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof good[0]; ++i) {
        if (kl_duration_parse(good[i].text, &seconds, &err) != KL_OK) fail_msg("%s", err.msg);
        if (seconds != good[i].seconds) fail_msg("%s: %g", good[i].text, seconds);
    }
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; ++i) {
        if (kl_duration_parse(bad[i], &seconds, &err) != KL_ERR_USAGE) fail_msg("%s", bad[i]);
    }
}

static void check_fps(const char *text, int32_t numerator, uint32_t denominator)
{
    struct kl_fps fps;
    struct kl_err err;

    if (kl_fps_parse(text, &fps, &err) != KL_OK) fail_msg("%s", err.msg);
    if (fps.numerator != numerator || fps.denominator != denominator) {
        fail_msg("%s: %d/%u", text, fps.numerator, fps.denominator);
    }
}

static void frame_rates(void **state)
{
    static const char *const bad[] = {"",      "0",     "-24",    "24/0", "1e9",
                                      "24fps", "1.5/2", "0.0001", "24/",  "999999999999999999/1"};
    struct kl_fps fps;
    struct kl_err err;

    (void)state;
    check_fps("24", 24, 1);
    check_fps("25.0", 25, 1);
    check_fps("12.5", 25, 2);
    check_fps("23.976", 24000, 1001);
    check_fps("23.98", 24000, 1001);
    check_fps("29.97", 30000, 1001);
    check_fps("59.94", 60000, 1001);
    check_fps("24000/1001", 24000, 1001);
    check_fps("48/2", 24, 1);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; ++i) {
        if (kl_fps_parse(bad[i], &fps, &err) != KL_ERR_USAGE) fail_msg("%s", bad[i]);
    }
}

static void shutters(void **state)
{
    static const char *const bad[] = {"", "f", "-90", "1g", "11f", "3601", "0.5 f", "180d"};
    struct kl_shutter shutter = {0};
    struct kl_err err;

    (void)state;
    assert_int_equal(kl_shutter_parse_length("180", &shutter.length, &err), KL_OK);
    assert_true(shutter.length == 0.5);
    assert_int_equal(kl_shutter_parse_length("0.25f", &shutter.length, &err), KL_OK);
    assert_true(shutter.length == 0.25);
    assert_int_equal(kl_shutter_parse_offset("-0.5f", &shutter.offset, &err), KL_OK);
    assert_true(shutter.offset == -0.5);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; ++i) {
        double length = 0.0;
        if (kl_shutter_parse_length(bad[i], &length, &err) != KL_ERR_USAGE) fail_msg("%s", bad[i]);
    }
    shutter = (struct kl_shutter){.length = 0.5};
    const struct kl_fps fps = {.numerator = 4, .denominator = 1};
    const struct kl_interval t = kl_shutter_interval(&shutter, fps, 8);
    assert_true(t.reference == 2.0 && t.open == 1.9375 && t.close == 2.0625);
}

/* Against the inverse of the area under the curve, worked out by hand. */
static void shutter_curves(void **state)
{
    static const struct {
        const char *text;
        double u, time;
    } good[] = {
        {"box", 0.3, 0.3},           {"1,1", 0.3, 0.3},     {"0,1", 0.25, 0.5},
        {"1,0", 0.75, 0.5},          {"0,1,0", 0.0, 0.0},   {"triangle", 0.125, 0.25},
        {"triangle", 0.5, 0.5},      {"cosine", 0.5, 0.5},  {"0,1,1,0", 0.25, 1.0 / 3.0},
        {"0,0,0,1", 0.0, 2.0 / 3.0}, {"0,1,1,0", 1.0, 1.0},
    };
    static const char *const bad[] = {"", "wave", "1", "0,0", "1,-1", "1,", "1;2", "Box"};
    char many[4 * KL_SHUTTER_WEIGHTS] = "1";
    struct kl_shutter_curve curve;
    struct kl_err err;

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof good[0]; ++i) {
        assert_int_equal(kl_shutter_parse_curve(good[i].text, &curve, &err), KL_OK);
        const double time = kl_shutter_curve_time(&curve, good[i].u);
        if (fabs(time - good[i].time) > 1e-9) fail_msg("%s: %g", good[i].text, time);
    }
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; ++i) {
        if (kl_shutter_parse_curve(bad[i], &curve, &err) != KL_ERR_USAGE) fail_msg("%s", bad[i]);
    }
    for (int i = 1; i < KL_SHUTTER_WEIGHTS; ++i) {
        strcat(many, ",1");
    }
    assert_int_equal(kl_shutter_parse_curve(many, &curve, &err), KL_OK);
    assert_int_equal(kl_shutter_parse_curve(strcat(many, ",1"), &curve, &err), KL_ERR_USAGE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(frame_lists), cmocka_unit_test(bad_frame_lists),
        cmocka_unit_test(patterns),    cmocka_unit_test(bad_patterns),
        cmocka_unit_test(durations),   cmocka_unit_test(frame_rates),
        cmocka_unit_test(shutters),    cmocka_unit_test(shutter_curves),
    };

    return cmocka_run_group_tests_name("sequence_text", tests, NULL, NULL);
}
