/* Camera paths and turntables. */
#include "sequences/path.h"
#include "sequences/turntable.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static struct kl_path *parse(const char *text)
{
    struct kl_err err;
    struct kl_path *path = NULL;

    if (kl_path_parse(text, strlen(text), "p.json", 24.0, &path, &err) != KL_OK) {
        fail_msg("%s", err.msg);
    }
    return path;
}

static void assert_point(const double p[3], double x, double y, double z)
{
    if (!(fabs(p[0] - x) < 1e-9 && fabs(p[1] - y) < 1e-9 && fabs(p[2] - z) < 1e-9)) {
        fail_msg("(%g %g %g) is not (%g %g %g)", p[0], p[1], p[2], x, y, z);
    }
}

static void linear_paths(void **state)
{
    struct kl_path *path = parse("{\"interpolation\":\"linear\",\"fps\":10,\"keys\":["
                                 "{\"time\":0,\"eye\":[0,0,5],\"target\":[0,0,0],\"yfov_deg\":90},"
                                 "{\"frame\":20,\"eye\":[4,0,5],\"target\":[0,2,0],"
                                 "\"up\":[0,3,0],\"yfov_deg\":45}]}");
    struct kl_look pose;
    double first = -1.0;
    double last = -1.0;

    (void)state;
    kl_path_range(path, &first, &last);
    assert_true(first == 0.0 && last == 2.0);
    kl_path_evaluate(path, 0.5, &pose);
    assert_point(pose.eye, 1, 0, 5);
    assert_point(pose.target, 0, 0.5, 0);
    assert_point(pose.up, 0, 1, 0);
    assert_true(fabs(pose.yfov - 78.75 * 3.14159265358979 / 180.0) < 1e-12);
    kl_path_evaluate(path, -7.0, &pose);
    assert_point(pose.eye, 0, 0, 5);
    kl_path_evaluate(path, 1e30, &pose);
    assert_point(pose.eye, 4, 0, 5);
    kl_path_evaluate(path, (double)NAN, &pose);
    assert_point(pose.eye, 0, 0, 5);
    kl_path_destroy(path);
}

static void smooth_paths_meet_their_keys(void **state)
{
    struct kl_path *path = parse("{\"keys\":["
                                 "{\"time\":0,\"eye\":[0,0,5],\"target\":[0,0,0]},"
                                 "{\"time\":1,\"eye\":[4,0,5],\"target\":[0,0,0]},"
                                 "{\"time\":2,\"eye\":[4,0,5],\"target\":[0,0,0]},"
                                 "{\"time\":4,\"eye\":[5,3,5],\"target\":[1,0,0]}]}");
    struct kl_look pose;
    struct kl_look before;

    (void)state;
    kl_path_evaluate(path, 1.0, &pose);
    assert_point(pose.eye, 4, 0, 5);
    kl_path_evaluate(path, 1.5, &pose); /* two keys at one place hold the camera */
    assert_point(pose.eye, 4, 0, 5);
    kl_path_evaluate(path, 4.0, &pose);
    assert_point(pose.eye, 5, 3, 5);
    assert_point(pose.target, 1, 0, 0);
    kl_path_evaluate(path, 0.0, &before);
    for (int i = 1; i <= 4000; ++i) { /* continuous */
        kl_path_evaluate(path, i * 0.001, &pose);
        for (int c = 0; c < 3; ++c) {
            assert_true(isfinite(pose.eye[c]) && fabs(pose.eye[c] - before.eye[c]) < 0.02);
        }
        before = pose;
    }
    kl_path_destroy(path);
    /* Evenly spaced keys on a line give even motion. */
    path = parse("{\"keys\":[{\"time\":0,\"eye\":[0,0,5],\"target\":[0,0,0]},"
                 "{\"time\":1,\"eye\":[1,0,5],\"target\":[1,0,0]},"
                 "{\"time\":2,\"eye\":[2,0,5],\"target\":[2,0,0]}]}");
    kl_path_evaluate(path, 0.25, &pose);
    assert_point(pose.eye, 0.25, 0, 5);
    kl_path_destroy(path);
}

static void an_eye_through_its_target_still_looks_somewhere(void **state)
{
    struct kl_path *path = parse("{\"interpolation\":\"linear\",\"keys\":["
                                 "{\"time\":0,\"eye\":[0,0,1],\"target\":[0,0,0],\"up\":[0,1,0]},"
                                 "{\"time\":2,\"eye\":[0,0,-1],\"target\":[0,0,0],\"up\":[0,-1,0]}"
                                 "]}");
    struct kl_look pose;

    (void)state;
    kl_path_evaluate(path, 1.0, &pose);
    assert_point(pose.target, 0, 0, -1);
    assert_point(pose.up, 0, 1, 0);
    kl_path_destroy(path);
}

static void bad_paths(void **state)
{
#define KEY0 "{\"time\":0,\"eye\":[0,0,5],\"target\":[0,0,0]}"
    static const struct {
        const char *text, *complaint;
    } bad[] = {
        {"", "line 1"},
        {"[]", "an object"},
        {"{\"keys\":[]}", "keys"},
        {"{\"keys\":3}", "keys"},
        {"{}", "keys"},
        {"{\"keys\":[" KEY0 "],\"kyes\":1}", "kyes"},
        {"{\"keys\":[" KEY0 "],\"fps\":0}", "fps"},
        {"{\"keys\":[" KEY0 "],\"fps\":\"a\"}", "fps"},
        {"{\"keys\":[" KEY0 "],\"interpolation\":\"cubic\"}", "interpolation"},
        {"{\"keys\":[" KEY0 "],\"interpolation\":1}", "interpolation"},
        {"{\"keys\":[" KEY0 ",7]}", "keys[1]"},
        {"{\"keys\":[" KEY0 "," KEY0 "]}", "keys[1].time"},
        {"{\"keys\":[{\"eye\":[0,0,5],\"target\":[0,0,0]}]}", "either"},
        {"{\"keys\":[{\"time\":0,\"frame\":0,\"eye\":[0,0,5],\"target\":[0,0,0]}]}", "either"},
        {"{\"keys\":[{\"time\":\"0\",\"eye\":[0,0,5],\"target\":[0,0,0]}]}", "keys[0].time"},
        {"{\"keys\":[{\"time\":0,\"eye\":[0,0],\"target\":[0,0,0]}]}", "keys[0].eye"},
        {"{\"keys\":[{\"time\":0,\"eye\":[0,0,1e10],\"target\":[0,0,0]}]}", "keys[0].eye"},
        {"{\"keys\":[{\"time\":0,\"eye\":[0,0,0],\"target\":[0,0,0]}]}", "keys[0].target"},
        {"{\"keys\":[{\"time\":0,\"eye\":[0,5,0],\"target\":[0,0,0]}]}", "keys[0].up"},
        {"{\"keys\":[{\"time\":0,\"eye\":[0,0,5],\"target\":[0,0,0],\"up\":[0,0,0]}]}", "up"},
        {"{\"keys\":[{\"time\":0,\"eye\":[0,0,5],\"target\":[0,0,0],\"yfov_deg\":180}]}", "yfov"},
        {"{\"keys\":[{\"time\":0,\"eye\":[0,0,5],\"target\":[0,0,0],\"yfov_deg\":50},"
         "{\"time\":1,\"eye\":[0,0,5],\"target\":[0,0,0]}]}",
         "yfov"},
        {"{\"keys\":[" KEY0 "],\"keys\":[" KEY0 "]}", "line 1"},
    };
    struct kl_err err;
    struct kl_path *path = NULL;

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; ++i) {
        if (kl_path_parse(bad[i].text, strlen(bad[i].text), "p.json", 24.0, &path, &err) !=
            KL_ERR_INPUT) {
            fail_msg("%s", bad[i].text);
        }
        assert_true(strncmp(err.msg, "p.json: ", 8) == 0);
        if (strstr(err.msg, bad[i].complaint) == NULL) fail_msg("%s", err.msg);
    }
    assert_int_equal(kl_path_load("/nonexistent.json", 24.0, &path, &err), KL_ERR_INPUT);
    assert_null(path);
}

static void turntables_close(void **state)
{
    const struct kl_turntable t = {.centre = {1, 2, 3},
                                   .radius = 2.0,
                                   .yfov = 0.7,
                                   .aspect = 0.5,
                                   .elevation = 0.3,
                                   .start = 0.1,
                                   .count = 7};
    struct kl_err err;
    struct kl_look a;
    struct kl_look b;

    (void)state;
    assert_int_equal(kl_turntable_check(&t, &err), KL_OK);
    for (int64_t k = 0; k < 7; ++k) {
        kl_turntable_pose(&t, k, 0.25, &a);
        kl_turntable_pose(&t, k + 7, 0.25, &b);
        assert_memory_equal(&a, &b, sizeof a);
        kl_turntable_pose(&t, k - 700, 0.25, &b);
        assert_memory_equal(&a, &b, sizeof a);
        const double dx = a.eye[0] - 1;
        const double dy = a.eye[1] - 2;
        const double dz = a.eye[2] - 3;
        const double half_x = atan(0.5 * tan(0.35));
        assert_true(fabs(sqrt(dx * dx + dy * dy + dz * dz) * sin(half_x) - 2.0) < 1e-12);
        assert_point(a.target, 1, 2, 3);
    }
    struct kl_turntable bad = t;
    bad.count = 0;
    assert_int_equal(kl_turntable_check(&bad, &err), KL_ERR_USAGE);
    bad = t;
    bad.radius = (double)NAN;
    assert_int_equal(kl_turntable_check(&bad, &err), KL_ERR_USAGE);
    bad = t;
    bad.elevation = 1.6;
    assert_int_equal(kl_turntable_check(&bad, &err), KL_ERR_USAGE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(linear_paths),
        cmocka_unit_test(smooth_paths_meet_their_keys),
        cmocka_unit_test(an_eye_through_its_target_still_looks_somewhere),
        cmocka_unit_test(bad_paths),
        cmocka_unit_test(turntables_close),
    };

    return cmocka_run_group_tests_name("sequence_camera", tests, NULL, NULL);
}
