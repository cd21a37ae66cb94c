/* src/cache/validity.c: fewer records answer a query, and no point that was served is without. */
#include "src/cache/octree.h"
#include "src/cache/record.h"
#include "src/cache/validity.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

enum { N = 4000, POINTS = 200000 };
static const float cos_max = 0.9394f;
static const float reach = 1.4f;

struct world {
    kl_record_hot hot[N];
    kl_record_cold cold[N];
    float limits[N];
    struct kl_octree octree;
    kl_level_view view;
    bool round; /* a unit sphere; else a square of side 2 */
};

static void random_point(const struct world *w, struct random *r, kl_vec3 *p, kl_vec3 *n)
{
    if (w->round) {
        *n = random_direction(r);
        *p = *n;
    } else {
        *n = kl_v3(0.0f, 0.0f, 1.0f);
        *p = kl_v3(random_range(r, -1.0f, 1.0f), random_range(r, -1.0f, 1.0f), 0.0f);
    }
}

static void make_records(struct world *w, float least, float most, bool walls, uint64_t seed)
{
    struct random r = {seed};
    for (uint32_t i = 0; i < N; ++i) {
        kl_vec3 p, n;
        random_point(w, &r, &p, &n);
        const float radius = least * powf(most / least, random_float(&r));
        w->hot[i] = (kl_record_hot){.pos = {p.x, p.y, p.z},
                                    .normal = kl_oct_encode(n),
                                    .radius = radius,
                                    .radius2 = radius * random_range(&r, 1.0f, 1.5f),
                                    .form = (kl_u32)random_bits(&r) & 0xfffu,
                                    .object = KL_NONE};
        w->cold[i] = (kl_record_cold){.irr = {1.0f, 1.0f, 1.0f}, .raw_radius = 1.0f};
        const float unit2 = kl_clearance_unit2(w->cold[i].error_spacing, w->cold[i].raw_radius);
        for (int k = 0; k < KL_SECTORS; ++k) {
            const float wall = radius * random_range(&r, 0.2f, 4.0f);
            w->cold[i].clearance[k] =
                walls ? (kl_u8)kl_clearance_code(unit2, wall * wall) : (kl_u8)255;
        }
    }
}

static void index_records(struct world *w)
{
    const float center[3] = {0.0f, 0.0f, 0.0f};
    const struct kl_octree_root root = kl_octree_root_make(center, 1.0f);
    const struct kl_octree_limits limits = {reach, cos_max};
    struct kl_err err = {0};
    kl_octree_fini(&w->octree);
    if (kl_octree_build(&root, w->hot, N, &limits, &w->octree, &err) != KL_OK) {
        fail_msg("%s", err.msg);
    }
    w->view =
        (kl_level_view){w->octree.head, w->hot, w->cold, w->octree.nodes, w->octree.rows, NULL};
}

static void limit_records(struct world *w)
{
    static struct kl_tree_point points[N];
    struct kl_point_tree *tree = NULL;
    struct kl_err err = {0};
    for (uint32_t i = 0; i < N; ++i) {
        memcpy(points[i].pos, w->hot[i].pos, sizeof points[i].pos);
    }
    if (kl_point_tree_create(points, N, &tree, &err) != KL_OK) fail_msg("%s", err.msg);
    const struct kl_record_set set = {w->hot, w->cold, N, tree, reach, cos_max};
    kl_validity_limits(&set, w->limits);
    kl_point_tree_destroy(tree);
    for (uint32_t i = 0; i < N; ++i) {
        kl_record_limit_radii(&w->hot[i], &w->cold[i], w->limits[i]);
    }
    index_records(w);
}

/* Records that contribute to queries at the points where any do; weights[i] of point i. */
static double count_serving(const struct world *w, float factor, float *weights)
{
    const kl_query q = {factor, cos_max, KL_INF};
    struct random r = {77};
    uint64_t serving = 0;
    uint32_t served = 0;
    for (uint32_t i = 0; i < POINTS; ++i) {
        kl_vec3 p, n;
        kl_u32 item = 0;
        random_point(w, &r, &p, &n);
        weights[i] = kl_cache_query(&w->view, &q, p, n, n).weight;
        if (!(weights[i] > 0.0f)) continue;
        ++served;
        kl_u32 at = kl_octree_row(&w->view, p, kl_normal_face(n));
        for (; at != KL_NONE && !(item & KL_ROW_LAST); ++at) {
            item = w->view.rows[at];
            const kl_record_hot *hot = &w->hot[item & ~KL_ROW_LAST];
            serving += kl_record_bearing(hot, &q, p, n).weight > 0.0f;
        }
    }
    return (double)serving / (served > 0 ? served : 1);
}

struct outcome {
    double before, after; /* records that contribute on average */
    uint32_t lost;        /* points that were served */
    uint32_t weak;        /* points at which the fill would want more, and did not */
};

static struct outcome clamp(struct world *w, float factor)
{
    static float before[POINTS], after[POINTS];
    struct outcome o = {0};
    index_records(w);
    o.before = count_serving(w, factor, before);
    limit_records(w);
    o.after = count_serving(w, factor, after);
    for (uint32_t i = 0; i < POINTS; ++i) {
        o.lost += before[i] > 0.0f && !(after[i] > 0.0f);
        o.weak += before[i] >= 0.3f && after[i] < 0.3f;
    }
    print_message("factor %g: %.2f records a query before, %.2f after; %u points lost, %u weak\n",
                  (double)factor, o.before, o.after, o.lost, o.weak);
    return o;
}

static struct outcome try_world(bool is_round, float most, bool walls, float factor)
{
    struct world *w = calloc(1, sizeof *w);
    assert_non_null(w);
    w->round = is_round;
    make_records(w, 0.25f * most, most, walls, 5);
    const struct outcome o = clamp(w, factor);
    kl_octree_fini(&w->octree);
    free(w);
    return o;
}

static void nothing_is_lost_on_a_plane(void **state)
{
    (void)state;
    for (int k = 0; k < 2; ++k) {
        const struct outcome o = try_world(false, 0.1f, false, k ? reach : 1.0f);
        assert_int_equal(o.lost, 0);
        assert_true(o.weak < POINTS / 500);
        assert_true(o.after < 0.5 * o.before);
        if (k == 0) assert_true(o.after >= 3.0 && o.after <= 6.0);
    }
}

static void nothing_is_lost_on_a_sphere(void **state)
{
    (void)state;
    const struct outcome o = try_world(true, 0.12f, false, 1.0f);
    assert_true(o.lost < POINTS / 10000);
    assert_true(o.after < 0.8 * o.before);
}

/* Records whose sight is blocked here and there take over only where they see. */
static void nothing_is_lost_behind_walls(void **state)
{
    (void)state;
    const struct outcome o = try_world(false, 0.1f, true, 1.0f);
    assert_true(o.lost < POINTS / 1000);
}

/* As where many bakes were merged: many times what a row of the index holds. */
static void hundreds_that_overlap_become_few(void **state)
{
    (void)state;
    const struct outcome o = try_world(false, 0.8f, false, 1.0f);
    assert_int_equal(o.lost, 0);
    assert_true(o.weak < POINTS / 500);
    assert_true(o.after < 0.25 * o.before);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_is_lost_on_a_plane),
        cmocka_unit_test(nothing_is_lost_on_a_sphere),
        cmocka_unit_test(nothing_is_lost_behind_walls),
        cmocka_unit_test(hundreds_that_overlap_become_few),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
