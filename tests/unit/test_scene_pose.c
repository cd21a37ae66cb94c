/* Poses against values worked out by hand: glTF 2.0 section 3.11 and appendix C. */
#include "src/scene/scene.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

enum { MAX_NODES = 4 };

/* A scene on the stack: nodes at rest, one animation with one channel. */
struct fixture {
    struct kl_scene scene;
    struct kl_node nodes[MAX_NODES];
    struct kl_animation animation;
    struct kl_animation_channel channel;
};

static void init_fixture(struct fixture *f, uint32_t node_count)
{
    memset(f, 0, sizeof *f);
    for (uint32_t n = 0; n < node_count; ++n) {
        f->nodes[n].parent = KL_NONE;
        f->nodes[n].rotation[3] = 1.0;
        for (int i = 0; i < 3; ++i) {
            f->nodes[n].scale[i] = 1.0;
        }
    }
    f->scene.nodes = f->nodes;
    f->scene.node_count = node_count;
    f->animation.channels = &f->channel;
    f->animation.channel_count = 1;
    f->scene.animations = &f->animation;
}

static void animate(struct fixture *f, enum kl_channel_path path, enum kl_interpolation how,
                    uint32_t keys, float *times, float *values)
{
    f->scene.animation_count = 1;
    f->channel.path = path;
    f->channel.interpolation = how;
    f->channel.width = path == KL_ROTATION ? 4 : 3;
    f->channel.key_count = keys;
    f->channel.times = times;
    f->channel.values = values;
}

static void get_world(const struct fixture *f, double time, uint32_t node, double out[16])
{
    struct kl_pose *pose = NULL;
    struct kl_err err;
    assert_int_equal(kl_pose_create(&f->scene, KL_NONE, time, &pose, &err), KL_OK);
    memcpy(out, pose->world_from_node + (size_t)node * 16, 16 * sizeof(double));
    kl_pose_destroy(pose);
}

static void assert_near(double got, double expected)
{
    if (!(fabs(got - expected) < 1e-6)) print_message("%.9g, expected %.9g\n", got, expected);
    assert_true(fabs(got - expected) < 1e-6);
}

static void test_transform_order(void **state)
{
    struct fixture f;
    double m[16];
    (void)state;
    /* Scale (2, 3, 4), then a quarter turn round z, then the translation. */
    init_fixture(&f, 1);
    f.nodes[0].rotation[2] = f.nodes[0].rotation[3] = sqrt(0.5);
    for (int i = 0; i < 3; ++i) {
        f.nodes[0].scale[i] = 2.0 + i;
        f.nodes[0].translation[i] = 10.0 * (i + 1);
    }
    get_world(&f, 0.0, 0, m);
    const double expected[16] = {0, 2, 0, 0, -3, 0, 0, 0, 0, 0, 4, 0, 10, 20, 30, 1};
    for (int i = 0; i < 16; ++i) {
        assert_near(m[i], expected[i]);
    }
}

static void test_hierarchy(void **state)
{
    struct fixture f;
    double m[16];
    (void)state;
    init_fixture(&f, 3);
    f.nodes[0].scale[0] = -2.0; /* mirrored */
    f.nodes[1].parent = 0;
    f.nodes[1].translation[0] = 5.0;
    f.nodes[2].parent = 1;
    f.nodes[2].has_matrix = true;
    for (int i = 0; i < 16; ++i) {
        f.nodes[2].matrix[i] = i % 5 == 0 ? 1.0 : 0.0;
    }
    f.nodes[2].matrix[12] = 1.0;
    get_world(&f, 0.0, 2, m);
    assert_near(m[0], -2.0);
    assert_near(m[5], 1.0);
    assert_near(m[12], -12.0); /* -2 (5 + 1) */
}

static void test_step_and_linear(void **state)
{
    float times[3] = {1.0f, 2.0f, 4.0f};
    float values[9] = {0.0f, 0.0f, 0.0f, 1.0f, 10.0f, 0.0f, 3.0f, 20.0f, 0.0f};
    const struct {
        double time, step, linear;
    } cases[] = {{-5.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, {1.5, 0.0, 0.5}, {1.999, 0.0, 0.999},
                 {2.0, 1.0, 1.0},  {3.0, 1.0, 2.0}, {4.0, 3.0, 3.0}, {99.0, 3.0, 3.0}};
    struct fixture f;
    double m[16];
    (void)state;
    init_fixture(&f, 1);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        animate(&f, KL_TRANSLATION, KL_STEP, 3, times, values);
        get_world(&f, cases[i].time, 0, m);
        assert_near(m[12], cases[i].step);
        f.channel.interpolation = KL_LINEAR;
        get_world(&f, cases[i].time, 0, m);
        assert_near(m[12], cases[i].linear);
    }
}

static void test_slerp_takes_the_short_way(void **state)
{
    /* 0 and 90 degrees round z, the second as -q: half way is 45 degrees, not 225. */
    float times[2] = {0.0f, 1.0f};
    float values[8] = {0.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f, -0.70710678f, -0.70710678f};
    struct fixture f;
    double m[16];
    (void)state;
    init_fixture(&f, 1);
    animate(&f, KL_ROTATION, KL_LINEAR, 2, times, values);
    get_world(&f, 0.5, 0, m);
    assert_near(m[0], sqrt(0.5));
    assert_near(m[1], sqrt(0.5));
    get_world(&f, 1.0 / 3.0, 0, m); /* constant speed: 30 degrees */
    assert_near(m[0], sqrt(0.75));
    assert_near(m[1], 0.5);
}

static void test_cubic_spline(void **state)
{
    /* Keys 0 and 1 two seconds apart; out-tangent 1 per second, in-tangent 0. */
    float times[2] = {0.0f, 2.0f};
    float values[18] = {9.0f, 9.0f, 9.0f, 0.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f,
                        0.0f, 0.0f, 0.0f, 1.0f, 1.0f, 1.0f, 9.0f, 9.0f, 9.0f};
    struct fixture f;
    double m[16];
    (void)state;
    init_fixture(&f, 1);
    animate(&f, KL_TRANSLATION, KL_CUBIC_SPLINE, 2, times, values);
    get_world(&f, 1.0, 0, m);
    /* t = 1/2: 1/2 p1 + 1/8 * 2 s * 1/s */
    assert_near(m[12], 0.75);
    assert_near(m[13], 0.5);
    get_world(&f, 0.5, 0, m);
    /* t = 1/4: (-2/64 + 3/16) + 2 (1/64 - 2/16 + 1/4) */
    assert_near(m[12], 0.15625 + 0.28125);
    get_world(&f, -1.0, 0, m);
    assert_near(m[12], 0.0); /* the value, not the in-tangent */
    get_world(&f, 3.0, 0, m);
    assert_near(m[12], 1.0);
}

static void test_cubic_rotation_is_unit(void **state)
{
    float times[2] = {0.0f, 1.0f};
    float values[24] = {0.0f, 0.0f, 0.0f,        0.0f,        0.0f, 0.0f, 0.0f, 1.0f,
                        0.0f, 0.0f, 0.0f,        0.0f,        0.0f, 0.0f, 0.0f, 0.0f,
                        0.0f, 0.0f, 0.70710678f, 0.70710678f, 0.0f, 0.0f, 0.0f, 0.0f};
    struct fixture f;
    double m[16];
    (void)state;
    init_fixture(&f, 1);
    animate(&f, KL_ROTATION, KL_CUBIC_SPLINE, 2, times, values);
    get_world(&f, 0.5, 0, m);
    assert_near(m[0], sqrt(0.5)); /* by symmetry 45 degrees */
    assert_near(m[0] * m[0] + m[1] * m[1], 1.0);
}

static void test_weights(void **state)
{
    float times[2] = {0.0f, 1.0f};
    float values[4] = {0.0f, 1.0f, 1.0f, 0.0f};
    double rest[2] = {0.5, 0.25};
    struct fixture f;
    struct kl_pose *pose = NULL;
    struct kl_err err;
    (void)state;
    init_fixture(&f, 1);
    f.nodes[0].weight_count = 2;
    f.nodes[0].weights = rest;
    animate(&f, KL_WEIGHTS, KL_LINEAR, 2, times, values);
    f.channel.width = 2;
    assert_int_equal(kl_pose_create(&f.scene, 0, 0.25, &pose, &err), KL_OK);
    assert_near(pose->weights[0][0], 0.25);
    assert_near(pose->weights[0][1], 0.75);
    kl_pose_destroy(pose);
    f.scene.animation_count = 0;
    assert_int_equal(kl_pose_create(&f.scene, KL_NONE, 0.25, &pose, &err), KL_OK);
    assert_near(pose->weights[0][1], 0.25);
    kl_pose_destroy(pose);
}

static void test_many_keys(void **state)
{
    enum { COUNT = 1001 };
    float *times = calloc(COUNT, sizeof *times);
    float *values = calloc((size_t)COUNT * 3, sizeof *values);
    struct fixture f;
    double m[16];
    (void)state;
    for (int k = 0; k < COUNT; ++k) { /* uneven spacing, value = time */
        times[k] = (float)k * (float)k * 1e-3f;
        values[k * 3] = times[k];
    }
    init_fixture(&f, 1);
    animate(&f, KL_TRANSLATION, KL_LINEAR, COUNT, times, values);
    for (int i = 0; i <= 500; ++i) {
        get_world(&f, 2.0 * i, 0, m);
        assert_true(fabs(m[12] - 2.0 * i) < 1e-3);
    }
    free(times);
    free(values);
}

static void test_animation_choice(void **state)
{
    float times[1] = {0.0f};
    float values[3] = {7.0f, 0.0f, 0.0f};
    struct fixture f;
    struct kl_pose *pose = NULL;
    struct kl_err err;
    (void)state;
    init_fixture(&f, 1);
    animate(&f, KL_TRANSLATION, KL_LINEAR, 1, times, values);
    assert_int_equal(kl_pose_create(&f.scene, 1, 0.0, &pose, &err), KL_OK);
    assert_near(pose->world_from_node[12], 0.0); /* another animation was asked for */
    kl_pose_destroy(pose);
    kl_pose_destroy(NULL);
}

static void test_moving(void **state)
{
    float times[2] = {0.0f, 1.0f};
    float still[6] = {1.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f};
    float moving[6] = {1.0f, 0.0f, 0.0f, 2.0f, 0.0f, 0.0f};
    struct kl_scene_instance instance = {0, 1, KL_NONE, 0};
    struct fixture f;
    (void)state;
    init_fixture(&f, 3);
    f.nodes[1].parent = 0;
    f.scene.instances = &instance;
    f.scene.instance_count = 1;
    assert_false(kl_scene_is_moving(&f.scene, KL_NONE));
    animate(&f, KL_TRANSLATION, KL_LINEAR, 2, times, still);
    assert_false(kl_node_is_animated(&f.scene, KL_NONE, 0)); /* keys that say the same */
    animate(&f, KL_TRANSLATION, KL_LINEAR, 2, times, moving);
    assert_true(kl_node_is_animated(&f.scene, KL_NONE, 0));
    assert_true(kl_node_is_animated(&f.scene, KL_NONE, 1)); /* through its parent */
    assert_false(kl_node_is_animated(&f.scene, KL_NONE, 2));
    assert_false(kl_node_is_animated(&f.scene, 1, 0)); /* not in that animation */
    assert_true(kl_scene_is_moving(&f.scene, KL_NONE));
    float cubic[18] = {0.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
                       0.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    animate(&f, KL_TRANSLATION, KL_CUBIC_SPLINE, 2, times, cubic);
    assert_false(kl_scene_is_moving(&f.scene, KL_NONE));
    cubic[6] = 1.0f; /* the same values, but a swing between them */
    assert_true(kl_scene_is_moving(&f.scene, KL_NONE));
    f.channel.node = 2; /* a node that nothing hangs on, such as a camera's */
    assert_false(kl_scene_is_moving(&f.scene, KL_NONE));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_transform_order),  cmocka_unit_test(test_hierarchy),
        cmocka_unit_test(test_step_and_linear),  cmocka_unit_test(test_slerp_takes_the_short_way),
        cmocka_unit_test(test_cubic_spline),     cmocka_unit_test(test_cubic_rotation_is_unit),
        cmocka_unit_test(test_weights),          cmocka_unit_test(test_many_keys),
        cmocka_unit_test(test_animation_choice), cmocka_unit_test(test_moving),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
