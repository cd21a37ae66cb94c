/* Morphing and skinning against values worked out by hand. */
#include "src/scene/scene.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* One triangle at node 0; nodes 1 and 2 are joints. */
struct fixture {
    struct kl_scene scene;
    struct kl_node nodes[3];
    struct kl_mesh mesh;
    struct kl_scene_instance instance;
    struct kl_skin skin;
    uint32_t joint_nodes[2];
    double inverse_bind[32];
    double morph_weights[1];
};

static float positions[9] = {0.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f, 0.0f, 1.0f, 0.0f};
static float normals[9] = {0.0f, 0.0f, 1.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f, 1.0f};
static float tangents[12] = {1.0f, 0.0f, 0.0f, 1.0f, 1.0f, 0.0f,
                             0.0f, 1.0f, 1.0f, 0.0f, 0.0f, -1.0f};
static uint16_t joints[12] = {0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0};
static float weights[12] = {1.0f, 0.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f, 0.0f, 0.5f, 0.5f, 0.0f, 0.0f};

static void init_fixture(struct fixture *f)
{
    memset(f, 0, sizeof *f);
    for (int n = 0; n < 3; ++n) {
        f->nodes[n].parent = KL_NONE;
        f->nodes[n].rotation[3] = 1.0;
        for (int i = 0; i < 3; ++i) {
            f->nodes[n].scale[i] = 1.0;
        }
    }
    f->mesh.vertex_count = 3;
    f->mesh.positions = positions;
    f->mesh.normals = normals;
    f->mesh.tangents = tangents;
    f->instance.skin = KL_NONE;
    f->scene.nodes = f->nodes;
    f->scene.node_count = 3;
    f->scene.meshes = &f->mesh;
    f->scene.mesh_count = 1;
    f->scene.instances = &f->instance;
    f->scene.instance_count = 1;
}

static void add_skin(struct fixture *f)
{
    f->mesh.influence_count = 4;
    f->mesh.joints = joints;
    f->mesh.weights = weights;
    f->joint_nodes[0] = 1;
    f->joint_nodes[1] = 2;
    for (int i = 0; i < 32; ++i) {
        f->inverse_bind[i] = i % 16 % 5 == 0 ? 1.0 : 0.0;
    }
    f->skin.joint_count = 2;
    f->skin.joints = f->joint_nodes;
    f->skin.inverse_bind = f->inverse_bind;
    f->scene.skins = &f->skin;
    f->scene.skin_count = 1;
    f->instance.skin = 0;
}

static struct kl_deformed deform(const struct fixture *f)
{
    struct kl_deformed out = {0};
    struct kl_pose *pose = NULL;
    struct kl_err err;
    assert_int_equal(kl_pose_create(&f->scene, KL_NONE, 0.0, &pose, &err), KL_OK);
    assert_int_equal(kl_instance_deform(&f->scene, pose, 0, &out, &err), KL_OK);
    kl_pose_destroy(pose);
    return out;
}

static void assert_near(double got, double expected)
{
    if (!(fabs(got - expected) < 1e-6)) print_message("%.9g, expected %.9g\n", got, expected);
    assert_true(fabs(got - expected) < 1e-6);
}

static void test_rigid(void **state)
{
    struct fixture f;
    (void)state;
    init_fixture(&f);
    assert_false(kl_instance_is_deformed(&f.scene, 0));
    struct kl_deformed out = deform(&f);
    assert_false(out.in_world);
    for (int i = 0; i < 9; ++i) {
        assert_near(out.positions[i], (double)positions[i]);
        assert_near((double)out.normals[i], (double)normals[i]);
    }
    kl_deformed_fini(&out);
    assert_null(out.positions);
}

static void test_morph(void **state)
{
    float moved[9] = {0.0f, 0.0f, 2.0f};
    float turned[9] = {2.0f, 0.0f, 0.0f};
    struct fixture f;
    (void)state;
    init_fixture(&f);
    f.mesh.morph_count = 1;
    f.mesh.morph_positions = moved;
    f.mesh.morph_normals = turned;
    f.morph_weights[0] = 0.5;
    f.nodes[0].weight_count = 1;
    f.nodes[0].weights = f.morph_weights;
    assert_true(kl_instance_is_deformed(&f.scene, 0));
    struct kl_deformed out = deform(&f);
    assert_near(out.positions[2], 1.0);
    assert_near(out.positions[5], 0.0);
    assert_near((double)out.normals[0], sqrt(0.5)); /* (1, 0, 1), normalised */
    assert_near((double)out.normals[2], sqrt(0.5));
    /* The tangent stays at right angles: (1, 0, 0) less its part along the normal. */
    assert_near((double)out.tangents[0], sqrt(0.5));
    assert_near((double)out.tangents[2], -sqrt(0.5));
    assert_near((double)out.tangents[3], 1.0);
    kl_deformed_fini(&out);
}

static void test_skin(void **state)
{
    struct fixture f;
    (void)state;
    init_fixture(&f);
    add_skin(&f);
    f.nodes[0].translation[0] = 1000.0; /* glTF ignores the node of a skinned mesh */
    f.nodes[1].translation[2] = 10.0;
    f.nodes[2].translation[2] = 20.0;
    f.inverse_bind[16 + 12] = -1.0; /* joint 1 was bound at x = 1 */
    struct kl_deformed out = deform(&f);
    assert_true(out.in_world);
    const double expected[9] = {0.0, 0.0, 10.0, 0.0, 0.0, 20.0, -0.5, 1.0, 15.0};
    for (int i = 0; i < 9; ++i) {
        assert_near(out.positions[i], expected[i]);
    }
    kl_deformed_fini(&out);
}

static void test_normals_go_by_the_inverse_transpose(void **state)
{
    struct fixture f;
    static float tilted[9] = {0.0f, 0.70710678f, 0.70710678f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f, 1.0f};
    (void)state;
    init_fixture(&f);
    add_skin(&f);
    f.mesh.normals = tilted;
    f.nodes[1].scale[1] = 2.0;
    struct kl_deformed out = deform(&f);
    /* (0, 1/2, 1) normalised */
    assert_near((double)out.normals[1], 0.5 / sqrt(1.25));
    assert_near((double)out.normals[2], 1.0 / sqrt(1.25));
    kl_deformed_fini(&out);
}

static void test_mirrored_joint(void **state)
{
    struct fixture f;
    (void)state;
    init_fixture(&f);
    add_skin(&f);
    f.nodes[1].scale[0] = -1.0; /* x is mirrored: a normal along z stays */
    struct kl_deformed out = deform(&f);
    assert_near((double)out.normals[2], 1.0);
    assert_near((double)out.tangents[0], -1.0);
    f.nodes[1].scale[0] = 1.0;
    f.nodes[1].scale[2] = -1.0; /* and here it turns */
    kl_deformed_fini(&out);
    out = deform(&f);
    assert_near((double)out.normals[2], -1.0);
    kl_deformed_fini(&out);
}

static void test_flattened_joint(void **state)
{
    struct fixture f;
    (void)state;
    init_fixture(&f);
    add_skin(&f);
    for (int i = 0; i < 3; ++i) {
        f.nodes[1].scale[i] = 0.0;
    }
    struct kl_deformed out = deform(&f);
    for (int v = 0; v < 3; ++v) { /* still unit normals */
        const float *n = out.normals + (size_t)v * 3;
        assert_near((double)(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]), 1.0);
    }
    kl_deformed_fini(&out);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_rigid),
        cmocka_unit_test(test_morph),
        cmocka_unit_test(test_skin),
        cmocka_unit_test(test_normals_go_by_the_inverse_transpose),
        cmocka_unit_test(test_mirrored_joint),
        cmocka_unit_test(test_flattened_joint),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
