/* What moves while the shutter is open, against the poses themselves. */
#include "src/scene/motion.h"

#include "kernels/bvh.h"
#include "kernels/riding.h"
#include "src/trace/device_bvh.h"
#include "src/trace/tracer.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { NODES = 2, KEYS = 2 };

/* A square of two triangles, 2 m wide, facing +Z; another 3 m behind it, which never moves. The
 * first one turns about Z by 2 rad in a second while it slides along X, or morphs. */
struct world {
    struct kl_scene scene;
    struct kl_mesh mesh;
    struct kl_node nodes[NODES];
    struct kl_scene_instance instances[NODES];
    kl_material material;
    struct kl_animation animation;
    struct kl_animation_channel channels[2];
    float positions[12], normals[12], morph[12];
    uint32_t indices[6];
    float times[KEYS], turns[4 * KEYS], slides[3 * KEYS], weights[KEYS];
    double at_rest[1];
};

static void world_init(struct world *w)
{
    static const float corners[12] = {-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0};
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    memset(w, 0, sizeof *w);
    memcpy(w->positions, corners, sizeof corners);
    memcpy(w->indices, indices, sizeof indices);
    for (int v = 0; v < 4; ++v) {
        w->normals[3 * v + 2] = 1.0f;
    }
    w->mesh = (struct kl_mesh){.vertex_count = 4,
                               .triangle_count = 2,
                               .positions = w->positions,
                               .normals = w->normals,
                               .indices = w->indices};
    for (uint32_t n = 0; n < NODES; ++n) {
        w->nodes[n] = (struct kl_node){
            .parent = KL_NONE, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}, .visible = true};
        w->instances[n] = (struct kl_scene_instance){0, n, KL_NONE, n};
    }
    w->nodes[1].translation[2] = -3.0;
    w->material.base_color[3] = 1.0f;
    for (int k = 0; k < KL_TEX_SLOTS; ++k) {
        w->material.tex[k].texture = KL_NONE;
    }
    w->times[1] = 1.0f;
    w->turns[3] = 1.0f;
    w->turns[6] = sinf(1.0f); /* 2 rad about Z */
    w->turns[7] = cosf(1.0f);
    w->slides[3] = 0.5f;
    w->weights[1] = 1.0f;
    w->channels[0] =
        (struct kl_animation_channel){0, KL_ROTATION, KL_LINEAR, KEYS, 4, w->times, w->turns};
    w->channels[1] =
        (struct kl_animation_channel){0, KL_TRANSLATION, KL_LINEAR, KEYS, 3, w->times, w->slides};
    w->animation =
        (struct kl_animation){.duration = 1.0, .channel_count = 2, .channels = w->channels};
    w->scene = (struct kl_scene){.mesh_count = 1,
                                 .node_count = NODES,
                                 .instance_count = NODES,
                                 .material_count = 1,
                                 .animation_count = 1,
                                 .meshes = &w->mesh,
                                 .nodes = w->nodes,
                                 .instances = w->instances,
                                 .materials = &w->material,
                                 .animations = &w->animation};
}

struct made {
    struct kl_pose *pose;
    struct kl_flat *flat;
    struct kl_motion *motion;
    struct kl_tracer *tracer;
};

static void make(struct world *w, double time, double open, double close, struct made *m)
{
    const double origin[3] = {0.25, -0.5, 1.0};
    const struct kl_motion_span span = {open, close, NULL};
    struct kl_err err = {0};
    *m = (struct made){0};
    kl_status st = kl_pose_create(&w->scene, KL_NONE, time, &m->pose, &err);
    if (st == KL_OK) st = kl_flat_create(&w->scene, m->pose, origin, &m->flat, &err);
    if (st == KL_OK) {
        st = kl_motion_create(&w->scene, KL_NONE, m->pose, m->flat, &span, &m->motion, &err);
    }
    if (st == KL_OK && m->motion != NULL) {
        st = kl_tracer_create_moving(m->flat, m->motion, &m->tracer, &err);
    }
    if (st != KL_OK) fail_msg("%s", err.msg);
}

static void made_fini(struct made *m)
{
    kl_tracer_destroy(m->tracer);
    kl_motion_destroy(m->motion);
    kl_flat_destroy(m->flat);
    kl_pose_destroy(m->pose);
}

/* World position of vertex `v` of the first square at a time, from the pose alone. */
static kl_vec3 expected(struct world *w, const struct made *m, double time, int v)
{
    struct kl_pose *pose = NULL;
    struct kl_err err = {0};
    if (kl_pose_create(&w->scene, KL_NONE, time, &pose, &err) != KL_OK) fail_msg("%s", err.msg);
    double p[3];
    for (int r = 0; r < 3; ++r) {
        p[r] = pose->world_from_node[12 + r] - m->flat->origin[r];
        for (int k = 0; k < 3; ++k) {
            const double weight =
                pose->weights[0] != NULL && w->mesh.morph_count > 0 ? pose->weights[0][0] : 0.0;
            p[r] += pose->world_from_node[4 * k + r] *
                    ((double)w->positions[3 * v + k] + weight * (double)w->morph[3 * v + k]);
        }
    }
    kl_pose_destroy(pose);
    return kl_v3((float)p[0], (float)p[1], (float)p[2]);
}

static void expect_way(struct world *w, const struct made *m, double open, double close)
{
    static const float u[3] = {0.0f, 1.0f, 0.0f};
    static const float v[3] = {0.0f, 0.0f, 1.0f};
    for (int k = 0; k <= 50; ++k) {
        const float t = (float)k / 50.0f;
        for (int c = 0; c < 3; ++c) {
            const kl_hit hit = {.u = u[c], .v = v[c], .triangle = 0, .instance = 1};
            const kl_vec3 got = kl_motion_point(m->motion, &hit, t, kl_v3_splat(9.0f));
            const kl_vec3 want = expected(w, m, open + (close - open) * (double)t, c);
            assert_true(kl_length(kl_v3_sub(got, want)) < 1e-4f);
        }
    }
}

/* Rays meet the square where it is at their time, and the other view has the same point at the
 * centre. */
static void expect_hits(const struct made *m)
{
    uint32_t hits = 0;
    for (uint32_t i = 0; i < 2000; ++i) {
        const kl_vec2 p = kl_sobol_2d(i, 7);
        kl_ray ray = kl_ray_make(kl_v3(3.0f * p.x - 1.5f, 3.0f * p.y - 1.0f, 4.0f),
                                 kl_v3(0.0f, 0.0f, -1.0f), KL_INF);
        kl_hit hit;
        kl_surface now;
        kl_surface still;
        ray.time = kl_unit_float(kl_hash(i));
        if (!kl_trace_closest(&m->motion->view, &ray, &hit) || hit.triangle > 1) continue;
        kl_surface_at(&m->motion->view, &ray, &hit, &now);
        kl_surface_at(&m->motion->reference, &ray, &hit, &still);
        const kl_vec3 met = kl_v3_mad(ray.origin, hit.t, ray.dir);
        const kl_vec3 centre = kl_motion_point(m->motion, &hit, KL_TIME_REFERENCE, still.pos);
        assert_true(kl_length(kl_v3_sub(now.pos, met)) < 2e-6f * 8.0f);
        assert_true(kl_length(kl_v3_sub(still.pos, centre)) < 1e-6f);
        assert_int_equal(now.object, 0);
        ++hits;
    }
    assert_true(hits > 500);
}

/* The trees of devices meet what Embree meets, at any time, and where it is met to the bit. */
static void expect_same_on_devices(const struct made *m)
{
    struct kl_device_bvh *bvh = NULL;
    struct kl_err err = {0};
    uint32_t hits = 0;
    if (kl_device_bvh_create(m->flat, m->motion, &bvh, &err) != KL_OK) fail_msg("%s", err.msg);
    kl_scene_view view = m->motion->view;
    view.needs |= KL_NEED_INSTANCES;
    for (uint32_t i = 0; i < 20000; ++i) {
        const kl_vec2 p = kl_sobol_2d(i, 8);
        kl_ray ray = kl_ray_make(kl_v3(6.0f * p.x - 3.0f, 6.0f * p.y - 3.0f, 4.0f),
                                 kl_normalize(kl_v3(p.y - 0.5f, 0.3f - p.x, -1.0f)), KL_INF);
        kl_hit want = {0};
        kl_hit got = {0};
        ray.time = kl_unit_float(kl_hash(i));
        const int expected = kl_trace_closest(&m->motion->view, &ray, &want);
        assert_int_equal(kl_bvh_closest(&view, &ray, &got), expected);
        assert_int_equal(kl_bvh_any(&view, &ray), expected);
        if (!expected) continue;
        assert_int_equal(got.triangle, want.triangle);
        assert_int_equal(got.instance, want.instance);
        assert_true(got.t == want.t && got.u == want.u && got.v == want.v);
        ++hits;
    }
    assert_true(hits > 1000);
    kl_device_bvh_destroy(bvh);
}

/* A point of the first square goes where the pose says, and its frame turns along. */
static void expect_ride(struct world *w, const struct made *m, double open, double close)
{
    const kl_ride on = {kl_motion_find(m->motion, 0), 0, 0.0f, 0.0f};
    const kl_vec3 at = expected(w, m, 0.5 * (open + close), 0);
    const kl_vec3 right = kl_v3_sub(expected(w, m, 0.5 * (open + close), 1), at);
    const kl_vec3 normal = kl_v3(0.0f, 0.0f, 1.0f);
    const kl_stance still =
        kl_ride_to(&m->motion->view, &on, KL_TIME_REFERENCE, at, normal, normal);
    const kl_vec3 along = kl_frame_to_local(&still.frame, kl_normalize(right));
    for (int k = 0; k <= 10; ++k) {
        const float time = 0.1f * (float)k;
        const double then = open + (close - open) * (double)time;
        const kl_stance s = kl_ride_to(&m->motion->view, &on, time, at, normal, normal);
        const kl_vec3 pos = expected(w, m, then, 0);
        const kl_vec3 way = kl_v3_sub(expected(w, m, then, 1), pos);
        const kl_vec3 turned = kl_frame_to_world(&s.frame, along);
        assert_true(kl_length(kl_v3_sub(s.pos, pos)) < 1e-4f);
        assert_true(kl_dot(s.frame.n, normal) > 0.9999f && kl_dot(s.geometric, normal) > 0.9999f);
        assert_true(kl_length(kl_v3_sub(turned, kl_normalize(way))) < 2e-3f);
    }
}

static void rigid_things_turn_and_slide(void **state)
{
    struct world w;
    struct made m;
    (void)state;
    world_init(&w);
    make(&w, 0.5, 0.25, 0.75, &m);
    assert_non_null(m.motion);
    assert_int_equal(m.motion->rigid_count, 1);
    assert_int_equal(m.motion->deforming_count, 0);
    assert_true(m.motion->most_steps > 3);
    expect_way(&w, &m, 0.25, 0.75);
    expect_hits(&m);
    expect_ride(&w, &m, 0.25, 0.75);
    expect_same_on_devices(&m);
    made_fini(&m);
}

static void straight_ways_take_few_steps(void **state)
{
    struct world w;
    struct made m;
    (void)state;
    world_init(&w);
    w.channels[0] = w.channels[1];
    w.animation.channel_count = 1;
    make(&w, 0.5, 0.25, 0.75, &m);
    assert_int_equal(m.motion->most_steps, 3);
    expect_way(&w, &m, 0.25, 0.75);
    made_fini(&m);
}

static void vertices_move(void **state)
{
    struct world w;
    struct made m;
    (void)state;
    world_init(&w);
    w.mesh.morph_count = 1;
    w.mesh.morph_positions = w.morph;
    for (int i = 0; i < 12; ++i) {
        w.morph[i] = 0.1f * (float)(i % 5);
    }
    for (int n = 0; n < NODES; ++n) {
        w.nodes[n].weight_count = 1;
        w.nodes[n].weights = w.at_rest;
    }
    w.channels[1] =
        (struct kl_animation_channel){0, KL_WEIGHTS, KL_LINEAR, KEYS, 1, w.times, w.weights};
    make(&w, 0.5, 0.4, 0.6, &m);
    assert_int_equal(m.motion->deforming_count, 1);
    expect_way(&w, &m, 0.4, 0.6);
    expect_hits(&m);
    expect_same_on_devices(&m);
    made_fini(&m);
}

/* Before and after the animation nothing moves; an instant on its own has one state. */
static void stillness_is_noticed(void **state)
{
    struct world w;
    struct made m;
    (void)state;
    world_init(&w);
    make(&w, 2.0, 1.5, 2.5, &m);
    assert_null(m.motion);
    made_fini(&m);
    make(&w, 0.5, 0.25, 0.25, &m);
    assert_int_equal(m.motion->most_steps, 1);
    expect_way(&w, &m, 0.25, 0.25);
    made_fini(&m);
}

/* Lamps on things that move are known as such. */
static void lamps_move(void **state)
{
    struct world w;
    struct made m;
    (void)state;
    world_init(&w);
    w.material.emission[0] = w.material.emission[1] = w.material.emission[2] = 1.0f;
    w.material.flags = KL_MAT_DOUBLE_SIDED;
    make(&w, 0.5, 0.0, 1.0, &m);
    assert_int_equal(m.motion->moving_lights, 2);
    assert_int_equal(m.motion->view.light_count, 4);
    made_fini(&m);
}

static void a_plate_closes(void **state)
{
    const struct kl_plate turn = {24, 24000.0 / 1001.0, {1.0, 2.0, 3.0}};
    double first[16];
    double other[16];
    (void)state;
    for (int frame = 1; frame <= 24; ++frame) {
        for (int k = -1; k <= 1; ++k) {
            const double time = (frame + 0.25 * k) / turn.fps;
            kl_plate_matrix(&turn, time, first);
            kl_plate_matrix(&turn, (frame + 0.25 * k + 24 * 7) / turn.fps, other);
            assert_memory_equal(first, other, sizeof first);
        }
    }
    kl_plate_matrix(&turn, 1.0 / turn.fps, first);
    for (int i = 0; i < 16; ++i) {
        assert_true(first[i] == (i % 5 == 0 ? 1.0 : 0.0));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rigid_things_turn_and_slide),
        cmocka_unit_test(straight_ways_take_few_steps),
        cmocka_unit_test(vertices_move),
        cmocka_unit_test(stillness_is_noticed),
        cmocka_unit_test(lamps_move),
        cmocka_unit_test(a_plate_closes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
