/* Hard cases 18 and 21, origins of skins and records on one side: many records in one place, least
 * spacing, scenes whose nodes are not where their vertices are, points that are not between records
 * that serve them. */
#include "hard_scene.h"

#include "src/cache/octree.h"
#include "src/render/fill_points.h"
#include "src/render/renderer_impl.h"
#include "src/scene/flat.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MANY = 20000, MOST_IN_ROW = 64 };

static kl_record_hot record_at(kl_vec3 p, float radius)
{
    return (kl_record_hot){.pos = {p.x, p.y, p.z},
                           .normal = kl_oct_encode(kl_v3(0.0f, 0.0f, 1.0f)),
                           .radius = radius,
                           .radius2 = radius,
                           .object = KL_NONE};
}

static uint32_t longest_row(const struct kl_octree *o)
{
    uint32_t longest = 0;
    uint32_t count = 0;
    for (uint32_t i = 0; i < o->head.row_size; ++i) {
        ++count;
        longest = count > longest ? count : longest;
        if (o->rows[i] & KL_ROW_LAST) count = 0;
    }
    return longest;
}

static struct kl_octree index_records(const kl_record_hot *hot, uint32_t count)
{
    const struct kl_octree_limits limits = {1.4f, 0.94f};
    const float center[3] = {0};
    const struct kl_octree_root root = kl_octree_root_make(center, 1.0f);
    struct kl_octree octree = {0};
    struct kl_err err = {0};
    if (kl_octree_build(&root, hot, count, &limits, &octree, &err) != KL_OK) {
        fail_msg("%s", err.msg);
    }
    return octree;
}

/* 18. Records in one place: no cell keeps more than 64 of them. */
static void rows_are_capped(void **state)
{
    kl_record_hot *hot = calloc(MANY, sizeof *hot);
    (void)state;
    assert_non_null(hot);
    for (uint32_t i = 0; i < MANY; ++i)
        hot[i] = record_at(kl_v3(0.1f, 0.2f, 0.3f), 0.05f);
    struct kl_octree octree = index_records(hot, MANY);
    print_message("longest row: %u records\n", longest_row(&octree));
    assert_true(longest_row(&octree) <= MOST_IN_ROW);
    kl_octree_fini(&octree);
    free(hot);
}

/* 21. Radii of 1e-9 in a scene of 1 m: the levels are limited, and so is what the index takes. */
static void tiny_radii_do_not_deepen_the_index(void **state)
{
    kl_record_hot *hot = calloc(MANY, sizeof *hot);
    (void)state;
    assert_non_null(hot);
    for (uint32_t i = 0; i < MANY; ++i) {
        const float x = (float)(i % 200) / 200.0f - 0.5f;
        hot[i] = record_at(kl_v3(x, (float)(i / 200) / 100.0f - 0.5f, 0.0f), 1e-9f);
    }
    struct kl_octree octree = index_records(hot, MANY);
    print_message("%u nodes, %u entries\n", octree.head.node_count, octree.head.row_size);
    assert_true(octree.head.node_count < 64 * MANY);
    assert_true(octree.head.row_size < 64 * MANY);
    kl_octree_fini(&octree);
    free(hot);
}

/* A mesh hung on a skin whose joint is 1e6 m away: render space begins there, not at its node. */
static void origin_follows_the_skin(void **state)
{
    const double far[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1e6, 2e6, -1e6, 1};
    struct kl_scene *s = hard_scene();
    const uint32_t node = hard_node(s, NULL);
    const uint32_t joint = hard_node(s, far);
    struct kl_pose *pose = NULL;
    struct kl_err err = {0};
    double origin[3];
    (void)state;
    hard_box(s, node, hard_material(s, 0.5, 0.0), (double[]){-1, -1, -1}, (double[]){1, 1, 1},
             false);
    struct kl_mesh *m = &s->meshes[0];
    m->influence_count = 4;
    m->joints = calloc(4 * m->vertex_count, sizeof *m->joints);
    m->weights = calloc(4 * m->vertex_count, sizeof *m->weights);
    s->skins = calloc(1, sizeof *s->skins);
    assert_true(m->joints != NULL && m->weights != NULL && s->skins != NULL);
    for (uint32_t v = 0; v < m->vertex_count; ++v)
        m->weights[4 * v] = 1.0f;
    s->skin_count = 1;
    s->skins[0].joint_count = 1;
    s->skins[0].joints = calloc(1, sizeof(uint32_t));
    s->skins[0].inverse_bind = calloc(16, sizeof(double));
    assert_true(s->skins[0].joints != NULL && s->skins[0].inverse_bind != NULL);
    s->skins[0].joints[0] = joint;
    for (int i = 0; i < 16; i += 5)
        s->skins[0].inverse_bind[i] = 1.0;
    s->instances[0].skin = 0;
    assert_int_equal(kl_pose_create(s, KL_NONE, 0.0, &pose, &err), KL_OK);
    assert_int_equal(kl_flat_choose_origin(s, pose, origin, &err), KL_OK);
    for (int k = 0; k < 3; ++k)
        assert_true(fabs(origin[k] - far[12 + k]) < 1e-6);
    kl_pose_destroy(pose);
    kl_scene_destroy(s);
}

/* Points that large records serve from one side alone may have what none of these knows of. */
static void points_lie_between_records(void **state)
{
    enum { SIDE = 256 };
    struct hard_stage stage;
    struct kl_point *points = NULL;
    struct kl_err err = {0};
    size_t count = 0;
    uint32_t aside = 0;
    (void)state;
    hard_open(&stage, hard_room(), KL_INDIRECT_CACHE, 0.0, 0);
    kl_image_destroy(hard_render(&stage, 0, SIDE, SIDE, 1));
    struct kl_renderer *r = stage.renderer;
    struct kl_camera camera;
    if (kl_renderer_camera(r, 0, 0.0, SIDE, SIDE, &camera, &err) != KL_OK) fail_msg("%s", err.msg);
    const struct kl_fill_job screen = {
        .scene = kl_renderer_reference(r), .cameras = &camera, .camera_count = 1};
    if (kl_fill_screen_points(&screen, 0, 1, &points, &count, &err) != KL_OK) {
        fail_msg("%s", err.msg);
    }
    const kl_level_view level = kl_cache_view(r->cache, 0);
    const kl_query eye = kl_renderer_eye_query();
    for (size_t i = 0; i < count; ++i) {
        const struct kl_point *p = &points[i];
        const kl_answer a = kl_cache_query(&level, &eye, p->pos, p->smooth, p->smooth);
        aside += a.way > fmaxf(0.7f * a.radius, 8.0f * p->pixel) ? 1u : 0u;
    }
    print_message("%u of %zu points\n", aside, count);
    assert_true(count > (size_t)SIDE * SIDE / 2);
    assert_true((double)aside <= 1e-3 * (double)count);
    free(points);
    hard_close(&stage);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_are_capped),
        cmocka_unit_test(tiny_radii_do_not_deepen_the_index),
        cmocka_unit_test(origin_follows_the_skin),
        cmocka_unit_test(points_lie_between_records),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
