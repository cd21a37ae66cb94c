/* src/cache/point_tree.c: envelope and nearest points are the brute-force ones, bit for bit,
 * whatever the order. */
#include "src/cache/point_tree.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdlib.h>

static struct kl_point_tree *create(const struct kl_tree_point *points, uint32_t count)
{
    struct kl_point_tree *f = NULL;
    struct kl_err err = {0};
    if (kl_point_tree_create(points, count, &f, &err) != KL_OK) fail_msg("%s", err.msg);
    return f;
}

static float brute_force(const struct kl_tree_point *points, uint32_t count, const float pos[3],
                         float limit)
{
    float best = limit;
    for (uint32_t i = 0; i < count; ++i) {
        const float *p = points[i].pos;
        const kl_vec3 d = kl_v3(pos[0] - p[0], pos[1] - p[1], pos[2] - p[2]);
        best = fminf(best, points[i].value + kl_length(d));
    }
    return best;
}

/* kind 0: a volume; 1: a plane; 2: few places many times; 3: one line; 4: one place */
static void fill(struct kl_tree_point *points, uint32_t count, int kind, struct random *r)
{
    for (uint32_t i = 0; i < count; ++i) {
        for (int k = 0; k < 3; ++k) {
            points[i].pos[k] = random_range(r, -1.0f, 1.0f);
            if (kind == 1 && k == 1) points[i].pos[k] = 0.25f;
            if (kind == 2) points[i].pos[k] = floorf(3.0f * points[i].pos[k]);
            if (kind == 3 && k > 0) points[i].pos[k] = -7.0f;
            if (kind == 4) points[i].pos[k] = 0.5f;
        }
        points[i].value = powf(10.0f, random_range(r, -6.0f, 1.0f));
    }
}

static void equals_brute_force(void **state)
{
    enum { MOST = 3000 };
    static struct kl_tree_point points[MOST];
    struct random r = {1};
    (void)state;
    for (int kind = 0; kind < 5; ++kind) {
        for (uint32_t count = 1; count <= MOST; count = count * 3 + 1) {
            fill(points, count, kind, &r);
            struct kl_point_tree *f = create(points, count);
            for (int i = 0; i < 500; ++i) {
                const kl_vec3 d = kl_v3_scale(random_direction(&r), 3.0f * random_float(&r));
                const float at[3] = {d.x, d.y, d.z};
                const float *pos = i % 2 ? at : points[random_bits(&r) % count].pos;
                const float limit = i % 3 ? 1e30f : 0.1f;
                assert_true(kl_point_tree_envelope(f, pos, limit) ==
                            brute_force(points, count, pos, limit));
            }
            kl_point_tree_destroy(f);
        }
    }
}

static void none_leaves_the_limit(void **state)
{
    const float pos[3] = {0.0f, 0.0f, 0.0f};
    struct kl_point_tree *f = create(NULL, 0);
    (void)state;
    uint32_t found[KL_NEAREST_MOST];
    assert_true(kl_point_tree_envelope(f, pos, 0.25f) == 0.25f);
    assert_int_equal(kl_point_tree_nearest(f, pos, 1.0f, KL_NEAREST_MOST, found), 0);
    kl_point_tree_destroy(f);
    kl_point_tree_destroy(NULL);
}

/* Clamping what is clamped already changes nothing but rounding. */
static void one_pass_is_the_fixpoint(void **state)
{
    enum { N = 4000 };
    static struct kl_tree_point points[N], clamped[N];
    struct random r = {2};
    (void)state;
    fill(points, N, 1, &r);
    struct kl_point_tree *f = create(points, N);
    uint32_t lowered = 0;
    for (int i = 0; i < N; ++i) {
        clamped[i] = points[i];
        clamped[i].value = kl_point_tree_envelope(f, points[i].pos, points[i].value);
        lowered += clamped[i].value < points[i].value;
    }
    kl_point_tree_destroy(f);
    assert_true(lowered > N / 4);
    f = create(clamped, N);
    for (int i = 0; i < N; ++i) {
        const float again = kl_point_tree_envelope(f, clamped[i].pos, clamped[i].value);
        assert_true(fabsf(again - clamped[i].value) <= 4e-7f * (clamped[i].value + 2.0f));
    }
    kl_point_tree_destroy(f);
}

static void order_does_not_matter(void **state)
{
    enum { N = 5000 };
    static struct kl_tree_point points[N];
    static float before[N];
    struct random r = {3};
    (void)state;
    for (int kind = 0; kind < 3; ++kind) {
        fill(points, N, kind, &r);
        struct kl_point_tree *f = create(points, N);
        const struct kl_tree_point first = points[0];
        for (int i = 0; i < N; ++i) {
            before[i] = kl_point_tree_envelope(f, points[i].pos, points[i].value);
        }
        kl_point_tree_destroy(f);
        for (int i = 0; i < N / 2; ++i) { /* reverse */
            const struct kl_tree_point swap = points[i];
            points[i] = points[N - 1 - i];
            points[N - 1 - i] = swap;
        }
        f = create(points, N);
        assert_memory_equal(&points[N - 1], &first, sizeof first);
        for (int i = 0; i < N; ++i) {
            assert_true(kl_point_tree_envelope(f, points[i].pos, points[i].value) ==
                        before[N - 1 - i]);
        }
        kl_point_tree_destroy(f);
    }
}

static float distance2(const struct kl_tree_point *p, const float pos[3])
{
    const kl_vec3 d = kl_v3_sub(kl_v3_load(p->pos), kl_v3_load(pos));
    return kl_dot(d, d);
}

struct judge {
    const struct kl_tree_point *points;
    const float *pos;
};
static struct judge judge;

static int compare_points(const void *a, const void *b)
{
    const struct kl_tree_point *x = &judge.points[*(const uint32_t *)a];
    const struct kl_tree_point *y = &judge.points[*(const uint32_t *)b];
    const float dx = distance2(x, judge.pos);
    const float dy = distance2(y, judge.pos);
    if (dx != dy) return dx < dy ? -1 : 1;
    for (int k = 0; k < 3; ++k) {
        if (x->pos[k] != y->pos[k]) return x->pos[k] < y->pos[k] ? -1 : 1;
    }
    return (x->value > y->value) - (x->value < y->value);
}

static void check_nearest(const struct kl_point_tree *f, const struct kl_tree_point *points,
                          uint32_t count, const float pos[3], float radius, uint32_t most)
{
    enum { MOST = 1000 };
    static uint32_t sorted[MOST];
    uint32_t found[KL_NEAREST_MOST];
    uint32_t inside = 0;
    for (uint32_t i = 0; i < count; ++i) {
        sorted[i] = i;
        inside += distance2(&points[i], pos) <= radius * radius;
    }
    judge = (struct judge){points, pos};
    qsort(sorted, count, sizeof *sorted, compare_points);
    const uint32_t n = kl_point_tree_nearest(f, pos, radius, most, found);
    assert_int_equal(n, inside < most ? inside : most);
    for (uint32_t i = 0; i < n; ++i) {
        assert_int_equal(compare_points(&found[i], &sorted[i]), 0);
    }
}

static void nearest_are_the_nearest(void **state)
{
    static struct kl_tree_point points[1000];
    static const uint32_t mosts[] = {1, 7, KL_NEAREST_MOST};
    struct random r = {4};
    (void)state;
    for (int kind = 0; kind < 5; ++kind) {
        for (uint32_t count = 1; count <= 1000; count = count * 3 + 1) {
            fill(points, count, kind, &r);
            struct kl_point_tree *f = create(points, count);
            for (int i = 0; i < 60; ++i) {
                const float *pos = points[random_bits(&r) % count].pos;
                const float radius = i % 2 ? 0.5f * random_float(&r) : 1e30f;
                check_nearest(f, points, count, pos, radius, mosts[i % 3]);
            }
            kl_point_tree_destroy(f);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equals_brute_force),       cmocka_unit_test(none_leaves_the_limit),
        cmocka_unit_test(one_pass_is_the_fixpoint), cmocka_unit_test(order_does_not_matter),
        cmocka_unit_test(nearest_are_the_nearest),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
