/* src/render/moved.c: what moved, where it is and was, and what it took along. */
#include "src/render/moved.h"

#include "kernels/surface.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Two squares, 2 m wide, facing +Z; object 1 is 5 m behind object 0. */
struct world {
    struct kl_scene scene;
    struct kl_mesh mesh;
    struct kl_node nodes[2];
    struct kl_scene_instance instances[2];
    kl_material material;
};

static void world_init(struct world *w)
{
    static float corners[12] = {-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0};
    static float normals[12] = {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1};
    static uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    memset(w, 0, sizeof *w);
    w->mesh = (struct kl_mesh){.vertex_count = 4,
                               .triangle_count = 2,
                               .positions = corners,
                               .normals = normals,
                               .indices = indices};
    for (uint32_t n = 0; n < 2; ++n) {
        w->nodes[n] = (struct kl_node){
            .parent = KL_NONE, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}, .visible = true};
        w->instances[n] = (struct kl_scene_instance){0, n, KL_NONE, n};
    }
    w->nodes[1].translation[2] = -5.0;
    for (int k = 0; k < KL_TEX_SLOTS; ++k) {
        w->material.tex[k].texture = KL_NONE;
    }
    w->scene = (struct kl_scene){.mesh_count = 1,
                                 .node_count = 2,
                                 .instance_count = 2,
                                 .material_count = 1,
                                 .meshes = &w->mesh,
                                 .nodes = w->nodes,
                                 .instances = w->instances,
                                 .materials = &w->material};
}

/* Object 0 has gone 3 m along X and turned about Z by 90 degrees. */
static void world_move(struct world *w)
{
    world_init(w);
    w->nodes[0].translation[0] = 3.0;
    w->nodes[0].rotation[2] = sqrt(0.5);
    w->nodes[0].rotation[3] = sqrt(0.5);
}

/* How the world stands; render space begins at (10, 0, 0). */
static struct kl_stand *stand_of(const struct world *w)
{
    static const double origin[3] = {10.0, 0.0, 0.0};
    struct kl_pose *pose = NULL;
    struct kl_flat *flat = NULL;
    struct kl_stand *stand = NULL;
    struct kl_err err = {0};
    assert_int_equal(kl_pose_create(&w->scene, KL_NONE, 0.0, &pose, &err), KL_OK);
    assert_int_equal(kl_flat_create(&w->scene, pose, origin, &flat, &err), KL_OK);
    flat->touch_bits[flat->light_count] = 7;
    flat->touch_bits[flat->light_count + 1] = 40;
    assert_int_equal(kl_stand_create(&w->scene, pose, flat, NULL, &stand, &err), KL_OK);
    kl_flat_destroy(flat);
    kl_pose_destroy(pose);
    return stand;
}

static struct kl_moved moved_between(const struct world *a, const struct world *b)
{
    struct kl_stand *before = stand_of(a);
    struct kl_stand *now = stand_of(b);
    struct kl_moved moved;
    struct kl_err err = {0};
    assert_int_equal(kl_moved_between(before, now, &moved, &err), KL_OK);
    assert_int_equal(kl_stand_bit(now, 1), 40);
    kl_stand_destroy(before);
    kl_stand_destroy(now);
    return moved;
}

/* Object 0 has moved. */
static struct kl_moved moved_once(void)
{
    struct world a;
    struct world b;
    world_init(&a);
    world_move(&b);
    return moved_between(&a, &b);
}

static void nothing_moves(void **state)
{
    struct world w;
    (void)state;
    world_move(&w);
    struct kl_moved m = moved_between(&w, &w);
    assert_false(m.all);
    assert_int_equal(m.count, 0);
    assert_int_equal(m.touched[0] | m.touched[1], 0);
    kl_moved_fini(&m);
}

static void one_thing_moves(void **state)
{
    const float near = 1e-5f;
    struct kl_moved m = moved_once();
    (void)state;
    assert_false(m.all);
    assert_int_equal(m.count, 1);
    assert_int_equal(m.touched[0], 1u << 7);
    assert_int_equal(m.touched[1], 0);
    assert_true(m.objects[0].moved && !m.objects[0].deformed);
    assert_false(m.objects[1].moved);
    /* The corner (1, 0.5, 0) goes to (-0.5, 1, 0), and 3 m along X. */
    const kl_vec3 p =
        kl_affine_point(m.objects[0].now_from_before, kl_v3(1.0f - 10.0f, 0.5f, 0.0f));
    assert_true(kl_length(kl_v3_sub(p, kl_v3(2.5f - 10.0f, 1.0f, 0.0f))) < near);
    const float *n = m.objects[0].normals; /* X turns to Y */
    assert_true(fabsf(n[0]) < near && n[3] > 0.0f && fabsf(n[6]) < near);
    kl_moved_fini(&m);
}

static bool meets(const struct kl_moved_box *boxes, uint32_t count, uint32_t except, kl_vec3 origin,
                  kl_vec3 dir, float length)
{
    const kl_ray ray = kl_ray_make(origin, dir, length);
    return kl_moved_meets(boxes, count, except, &ray);
}

static void boxes_are_where_it_was_and_is(void **state)
{
    const kl_vec3 back = kl_v3(0.0f, 0.0f, -1.0f);
    const kl_vec3 there = kl_v3(0.9f - 10.0f, 0.9f, 2.0f); /* in front of where it was */
    const kl_vec3 here = kl_v3(3.9f - 10.0f, 0.9f, 2.0f);  /* and is */
    struct kl_moved m = moved_once();
    (void)state;
    assert_true(meets(m.was, m.count, KL_NONE, there, back, KL_INF));
    assert_false(meets(m.is, m.count, KL_NONE, there, back, KL_INF));
    assert_true(meets(m.is, m.count, KL_NONE, here, back, KL_INF));
    assert_false(meets(m.was, m.count, KL_NONE, here, back, KL_INF));
    assert_false(meets(m.is, m.count, 0, here, back, KL_INF)); /* it does not count */
    assert_false(meets(m.is, m.count, KL_NONE, here, back, 1.9f));
    assert_true(meets(m.is, m.count, KL_NONE, here, back, 2.1f));
    assert_false(meets(m.is, m.count, KL_NONE, here, kl_v3_scale(back, -1.0f), KL_INF));
    const kl_vec3 in = kl_v3(3.0f - 10.0f, 0.0f, 0.0f);
    assert_true(meets(m.is, m.count, KL_NONE, in, back, 0.0f));
    assert_false(meets(m.was, m.count, KL_NONE, in, back, 0.0f));
    kl_moved_fini(&m);
}

static void other_materials_are_another_world(void **state)
{
    struct world a;
    struct world b;
    (void)state;
    world_init(&a);
    world_init(&b);
    b.material.base_color[0] = 0.5f;
    struct kl_moved m = moved_between(&a, &b);
    assert_true(m.all);
    kl_moved_fini(&m);
}

/* While the shutter is open a box goes along: 4 m along Y from opening to closing. */
static void boxes_move_while_the_shutter_is_open(void **state)
{
    float ways[3 * 12] = {0};
    const struct kl_moved_box box = {
        .unit_from_render = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, .steps = 3, .ways = ways};
    kl_ray ray = kl_ray_make(kl_v3(0.0f, 0.0f, 5.0f), kl_v3(0.0f, 0.0f, -1.0f), KL_INF);
    (void)state;
    for (int k = 0; k < 3; ++k) {
        float *m = ways + 12 * k;
        m[0] = m[5] = m[10] = 1.0f;
        m[7] = 2.0f * (float)(k - 1);
    }
    for (int k = 0; k <= 10; ++k) {
        ray.time = 0.1f * (float)k;
        const float y = 4.0f * (ray.time - 0.5f);
        ray.origin.y = y + 0.9f;
        assert_true(kl_moved_meets(&box, 1, KL_NONE, &ray));
        ray.origin.y = y - 1.1f;
        assert_false(kl_moved_meets(&box, 1, KL_NONE, &ray));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_moves),
        cmocka_unit_test(one_thing_moves),
        cmocka_unit_test(boxes_are_where_it_was_and_is),
        cmocka_unit_test(other_materials_are_another_world),
        cmocka_unit_test(boxes_move_while_the_shutter_is_open),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
