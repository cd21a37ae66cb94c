/* kl_cache_query: how near an answer comes to what records were taken from. */
#include "kernels/cache_query.h"
#include "src/cache/octree.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

enum { SIDE = 12, N = SIDE * SIDE, QUERIES = 1000 };
static const float cos_max = 0.94f;
static const float spacing = 0.1f;
static const float radius = 0.15f;

struct world {
    kl_record_hot hot[N];
    kl_record_cold cold[N];
    uint32_t count;
    struct kl_octree octree;
    kl_level_view view;
};

/* Irradiance in the plane z = 0, [-0.6, 0.6] squared, and its derivatives. */
struct field {
    float gx, gy;     /* at the origin */
    float xx, xy, yy; /* everywhere */
};

static float field_value(const struct field *f, float x, float y)
{
    return 1.0f + f->gx * x + f->gy * y + 0.5f * (f->xx * x * x + f->yy * y * y) + f->xy * x * y;
}

static void set_record(struct world *w, const struct field *f, float x, float y)
{
    const kl_vec3 normal = kl_v3(0.0f, 0.0f, 1.0f);
    const kl_frame frame = kl_frame_from_normal(normal);
    const float e = field_value(f, x, y);
    const kl_vec3 slope = kl_v3(f->gx + f->xx * x + f->xy * y, f->gy + f->xy * x + f->yy * y, 0.0f);
    kl_record_cold *cold = &w->cold[w->count];
    w->hot[w->count] =
        (kl_record_hot){{x, y, 0.0f}, kl_oct_encode(normal), radius, radius, 0, KL_NONE};
    *cold = (kl_record_cold){.irr = {e, 2.0f * e, 0.5f * e}, .raw_radius = 1.0f};
    for (int k = 0; k < 3; ++k) {
        cold->grad[2 * k] = (kl_u16)kl_float_to_half(kl_dot(slope, frame.t) / e);
        cold->grad[2 * k + 1] = (kl_u16)kl_float_to_half(kl_dot(slope, frame.b) / e);
    }
    memset(cold->clearance, 255, sizeof cold->clearance);
    ++w->count;
}

static void world_index(struct world *w)
{
    const float center[3] = {0.0f, 0.0f, 0.0f};
    const struct kl_octree_root root = kl_octree_root_make(center, 1.0f);
    const struct kl_octree_limits limits = {1.0f, cos_max};
    struct kl_err err = {0};
    if (kl_octree_build(&root, w->hot, w->count, &limits, &w->octree, &err) != KL_OK) {
        fail_msg("%s", err.msg);
    }
    w->view =
        (kl_level_view){w->octree.head, w->hot, w->cold, w->octree.nodes, w->octree.rows, NULL};
}

/* Records on a grid, each moved at random by up to `jitter` of the spacing. */
static void world_init(struct world *w, const struct field *f, float jitter)
{
    struct random r = {5};
    *w = (struct world){0};
    for (int i = 0; i < N; ++i) {
        const float x = (float)(i % SIDE) - 0.5f * (SIDE - 1) + random_range(&r, -jitter, jitter);
        const float y = (float)(i / SIDE) - 0.5f * (SIDE - 1) + random_range(&r, -jitter, jitter);
        set_record(w, f, spacing * x, spacing * y);
    }
    world_index(w);
}

static kl_answer ask(const struct world *w, float x, float y)
{
    const kl_query query = {1.0f, cos_max, KL_INF};
    const kl_vec3 n = kl_v3(0.0f, 0.0f, 1.0f);
    return kl_cache_query(&w->view, &query, kl_v3(x, y, 0.0f), n, n);
}

/* What the answer would be if every record were followed by its own gradients alone. */
static double said_alone(const struct world *w, const kl_query *query, kl_vec3 p, kl_vec3 n)
{
    double weights = 0.0;
    double said = 0.0;
    for (uint32_t k = 0; k < w->count; ++k) {
        const kl_bearing b = kl_record_bearing(&w->hot[k], query, p, n);
        const kl_vec3 gain = kl_v3_scale(kl_record_half_gain(&w->cold[k], b), 2.0f);
        weights += (double)b.weight;
        said += (double)b.weight * (double)kl_record_with_gain(&w->cold[k], gain).x;
    }
    return said / weights;
}

/* RMS of the error of answers, and of what they would be if every record were followed by its own
 * gradient alone. */
static void measure(const struct world *w, const struct field *f, double *ours, double *alone)
{
    struct random r = {7};
    const kl_query query = {1.0f, cos_max, KL_INF};
    const kl_vec3 n = kl_v3(0.0f, 0.0f, 1.0f);
    double sum[2] = {0.0, 0.0};
    for (int i = 0; i < QUERIES; ++i) {
        const float x = random_range(&r, -0.3f, 0.3f);
        const float y = random_range(&r, -0.3f, 0.3f);
        const double said = said_alone(w, &query, kl_v3(x, y, 0.0f), n);
        const double truth = (double)field_value(f, x, y);
        sum[0] += pow((double)ask(w, x, y).irr.x - truth, 2.0);
        sum[1] += pow(said - truth, 2.0);
    }
    *ours = sqrt(sum[0] / QUERIES);
    *alone = sqrt(sum[1] / QUERIES);
}

static void slopes_are_exact(void **state)
{
    static struct world w;
    const struct field f = {.gx = 0.5f, .gy = -0.3f};
    double ours;
    double alone;
    (void)state;
    world_init(&w, &f, 0.3f);
    measure(&w, &f, &ours, &alone);
    assert_true(ours < 5e-5); /* gradients are halves of 11 bits */
    kl_octree_fini(&w.octree);
}

/* In the middle of four records no way is left over, and second derivatives cancel. */
static void curvature_is_exact_amid_records(void **state)
{
    static struct world w;
    const struct field f = {.gx = 0.2f, .xx = 2.0f, .xy = -1.0f, .yy = 1.0f};
    (void)state;
    world_init(&w, &f, 0.0f);
    for (int i = -2; i <= 2; ++i) {
        const float x = spacing * (float)i;
        const float y = spacing * (float)(1 - i);
        const kl_answer a = ask(&w, x, y);
        const float truth = field_value(&f, x, y);
        assert_true(fabsf(a.irr.x - truth) < 1e-4f);
        assert_true(fabsf(a.irr.y - 2.0f * truth) < 2e-4f);
        assert_true(fabsf(a.irr.z - 0.5f * truth) < 1e-4f);
        assert_true(a.way < 1e-5f);
    }
    kl_octree_fini(&w.octree);
}

static void curvature_is_followed_between_records(void **state)
{
    static struct world w;
    const struct field saddle = {.gx = 0.2f, .xx = 2.0f, .xy = -1.0f, .yy = -3.0f};
    const struct field bowl = {.gy = 0.4f, .xx = 2.0f, .xy = 0.5f, .yy = 3.0f};
    const struct field *fields[] = {&saddle, &bowl};
    (void)state;
    for (int k = 0; k < 2; ++k) {
        double ours;
        double alone;
        world_init(&w, fields[k], 0.3f);
        measure(&w, fields[k], &ours, &alone);
        if (!(4.0 * ours < alone)) fail_msg("%g by own gradients, %g by both", alone, ours);
        kl_octree_fini(&w.octree);
    }
}

/* Irradiance about a cylinder, by the angle: all of its change comes from the normal's turn. */
static float turned_value(float t)
{
    return 1.0f + 0.5f * t + 2.0f * t * t;
}

static kl_vec3 on_cylinder(float t, float y)
{
    return kl_v3(sinf(t), y, cosf(t));
}

static void set_turned_record(struct world *w, float t, float y)
{
    const kl_vec3 normal = on_cylinder(t, 0.0f);
    const kl_frame frame = kl_frame_from_normal(normal);
    const float e = turned_value(t);
    const kl_vec3 slope = kl_v3_scale(kl_v3(cosf(t), 0.0f, -sinf(t)), (0.5f + 4.0f * t) / e);
    const kl_u16 u = (kl_u16)kl_float_to_half(-kl_dot(slope, frame.b));
    const kl_u16 v = (kl_u16)kl_float_to_half(kl_dot(slope, frame.t));
    w->hot[w->count] =
        (kl_record_hot){{sinf(t), y, cosf(t)}, kl_oct_encode(normal), radius, radius, 0, KL_NONE};
    w->cold[w->count] = (kl_record_cold){.irr = {e, 2.0f * e, 0.5f * e},
                                         .raw_radius = 1.0f,
                                         .grad = {0, 0, 0, 0, 0, 0, u, v, u, v, u, v}};
    memset(w->cold[w->count].clearance, 255, sizeof w->cold[w->count].clearance);
    ++w->count;
}

static void turns_are_followed_between_records(void **state)
{
    static struct world w;
    const kl_query query = {1.0f, cos_max, KL_INF};
    struct random r = {9};
    double ours = 0.0;
    double alone = 0.0;
    (void)state;
    w = (struct world){0};
    for (int i = 0; i < N; ++i) {
        const float t = (float)(i % SIDE) - 0.5f * (SIDE - 1) + random_range(&r, -0.2f, 0.2f);
        const float y = (float)(i / SIDE) - 0.5f * (SIDE - 1) + random_range(&r, -0.2f, 0.2f);
        set_turned_record(&w, spacing * t, spacing * y);
    }
    world_index(&w);
    for (int i = 0; i < QUERIES; ++i) {
        const float t = random_range(&r, -0.3f, 0.3f);
        const kl_vec3 p = on_cylinder(t, random_range(&r, -0.3f, 0.3f));
        const kl_vec3 n = on_cylinder(t, 0.0f);
        const kl_answer a = kl_cache_query(&w.view, &query, p, n, n);
        const double said = said_alone(&w, &query, p, n);
        ours += pow((double)a.irr.x - (double)turned_value(t), 2.0);
        alone += pow(said - (double)turned_value(t), 2.0);
        assert_true(fabsf(a.irr.y - 2.0f * a.irr.x) < 1e-3f);
        assert_true(fabsf(a.irr.z - 0.5f * a.irr.x) < 1e-3f);
    }
    ours = sqrt(ours / QUERIES);
    alone = sqrt(alone / QUERIES);
    if (!(4.0 * ours < alone)) fail_msg("%g by own gradients, %g by both", alone, ours);
    kl_octree_fini(&w.octree);
}

/* With nothing else around, a record's own gradient is followed all the way. */
static void one_record_is_followed_all_the_way(void **state)
{
    static struct world w;
    const struct field f = {.gx = 1.0f, .gy = -2.0f};
    (void)state;
    w = (struct world){0};
    set_record(&w, &f, 0.0f, 0.0f);
    world_index(&w);
    const kl_answer a = ask(&w, 0.08f, -0.05f);
    assert_true(a.weight > 0.0f);
    assert_true(fabsf(a.irr.x - field_value(&f, 0.08f, -0.05f)) < 1e-4f);
    assert_true(fabsf(a.way - hypotf(0.08f, 0.05f)) < 1e-6f);
    kl_octree_fini(&w.octree);
}

/* Gradients that lead below zero leave a little light, as they do for single records. */
static void light_stays_positive(void **state)
{
    static struct world w;
    const struct field f = {.gx = 1.0f, .gy = -2.0f};
    (void)state;
    w = (struct world){0};
    set_record(&w, &f, 0.0f, 0.0f);
    set_record(&w, &f, 0.01f, 0.0f);
    for (int k = 0; k < 6; ++k) {
        w.cold[0].grad[k] = w.cold[1].grad[k] = (kl_u16)kl_float_to_half(-40.0f);
    }
    world_index(&w);
    for (int k = 0; k < 8; ++k) {
        const float angle = (float)k * 0.25f * KL_PI;
        const kl_answer a = ask(&w, 0.1f * cosf(angle), 0.1f * sinf(angle));
        assert_true(a.weight > 0.0f);
        assert_true(a.irr.x > 0.0f && a.irr.y > 0.0f && a.irr.z > 0.0f);
    }
    kl_octree_fini(&w.octree);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slopes_are_exact),
        cmocka_unit_test(curvature_is_exact_amid_records),
        cmocka_unit_test(curvature_is_followed_between_records),
        cmocka_unit_test(turns_are_followed_between_records),
        cmocka_unit_test(one_record_is_followed_all_the_way),
        cmocka_unit_test(light_stays_positive),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
