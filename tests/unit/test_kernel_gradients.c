/* kernels/derivatives.h against exact values: irradiance, error estimate, gradients and clearance
 * of analytic surroundings, evaluated per gather direction without any tracing. */
#include "src/device/gather.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>

/* What a direction sees from x = (0.1, 0.05, 0) with normal +z. */
typedef kl_gather_cell (*world_fn)(kl_vec3 dir);

static const double x0 = 0.1;
static const double y0 = 0.05;

static kl_gather_cell cell_of(double radiance, double distance)
{
    const float l = (float)radiance;
    const float d = distance < 1e30 ? (float)distance : KL_INF;
    return (kl_gather_cell){.radiance = {l, l, l}, .distance = d};
}

/* Distance to the rectangle [lx, hx] x [ly, hy] at height z, infinite where the ray misses. */
static double to_rectangle(kl_vec3 d, double lx, double hx, double ly, double hy, double z)
{
    if (!(d.z > 0.0f)) return HUGE_VAL;
    const double t = z / (double)d.z;
    const double x = x0 + t * (double)d.x;
    const double y = y0 + t * (double)d.y;
    return x > lx && x < hx && y > ly && y < hy ? t : HUGE_VAL;
}

/* Square light of radiance 1 at height 1. */
static kl_gather_cell scene_a(kl_vec3 d)
{
    const double t = to_rectangle(d, -0.5, 0.5, -0.5, 0.5, 1.0);
    return cell_of(isfinite(t) ? 1.0 : 0.0, t);
}

/* The same with a black rectangle in between. */
static kl_gather_cell scene_b(kl_vec3 d)
{
    const double t = to_rectangle(d, -0.05, 0.15, -0.08, 0.12, 0.4);
    return isfinite(t) ? cell_of(0.0, t) : scene_a(d);
}

/* A bright wall that stands on the tangent plane: x = x0 + 1, 2 m wide, 1 m high. */
static kl_gather_cell scene_wall(kl_vec3 d)
{
    if (!(d.x > 0.0f)) return cell_of(0.0, HUGE_VAL);
    const double t = 1.0 / (double)d.x;
    const double y = t * (double)d.y;
    const double z = t * (double)d.z;
    return fabs(y) < 1.0 && z < 1.0 ? cell_of(1.0, t) : cell_of(0.0, HUGE_VAL);
}

static kl_gather_cell scene_furnace(kl_vec3 d)
{
    return cell_of(1.0, 0.3 + (double)d.z + 0.2 * (double)d.x);
}

struct golden {
    double e, grad_t[2], grad_r[2];
};
/* Closed-form values, checked by fourth-order differences of Lambert's formula. */
static const struct golden golden_a = {
    0.74161939, {-0.16926356, -0.08447145}, {0.0280184, -0.0560800}};
static const struct golden golden_b = {
    0.51894851, {0.06500551, 0.05604766}, {0.0125734, -0.0303352}};

static struct kl_gather_tables *make_tables(uint32_t side)
{
    struct kl_gather_tables *t = NULL;
    struct kl_err err = {0};
    if (kl_gather_tables_create(side, &t, &err) != KL_OK) fail_msg("%s", err.msg);
    return t;
}

static kl_gather_result gather(const struct kl_gather_tables *t, world_fn world, uint32_t set,
                               float angle)
{
    static kl_gather_cell cells[256 * 256];
    static kl_gather_cell smooth[256 * 256];
    const kl_grid_view grid = kl_gather_tables_grid(t);
    const kl_direction *dirs = kl_gather_directions(t, set);
    const kl_gather_point point = {.rot_cos = cosf(angle), .rot_sin = sinf(angle)};
    kl_gather_result out;
    for (uint32_t i = 0; i < t->side * t->side; ++i) {
        const float x = point.rot_cos * dirs[i].x - point.rot_sin * dirs[i].y;
        const float y = point.rot_sin * dirs[i].x + point.rot_cos * dirs[i].y;
        cells[i] = world(kl_v3(x, y, sqrtf(fmaxf(0.0f, 1.0f - x * x - y * y))));
    }
    kl_reduce_record(cells, dirs, &grid, &point, smooth, &out);
    return out;
}

enum { RUNS = 2000 };

struct moments { /* over RUNS gathers, green channel */
    double mean_e, rms_e, mean_s;
    double mean_t[2], rms_t, mean_r[2], rms_r;
};

static struct moments measure(uint32_t side, world_fn world, const struct golden *exact)
{
    struct kl_gather_tables *t = make_tables(side);
    struct random random = {side};
    struct moments m = {0};
    for (uint32_t i = 0; i < RUNS; ++i) {
        const kl_gather_result g = gather(t, world, i, random_range(&random, 0.0f, 2.0f * KL_PI));
        m.mean_e += (double)g.irr[1] / RUNS;
        m.rms_e += pow((double)g.irr[1] - exact->e, 2.0) / RUNS;
        m.mean_s += (double)g.error * (double)g.irr[1] / RUNS;
        for (int k = 0; k < 2; ++k) {
            m.mean_t[k] += (double)g.grad_t[2 + k] / RUNS;
            m.mean_r[k] += (double)g.grad_r[2 + k] / RUNS;
            m.rms_t += pow((double)g.grad_t[2 + k] - exact->grad_t[k], 2.0) / RUNS;
            m.rms_r += pow((double)g.grad_r[2 + k] - exact->grad_r[k], 2.0) / RUNS;
        }
    }
    m.rms_e = sqrt(m.rms_e);
    m.rms_t = sqrt(m.rms_t);
    m.rms_r = sqrt(m.rms_r);
    kl_gather_tables_destroy(t);
    print_message("%u rays: E rms %.5f s/rms %.2f, grad_t rms %.5f, grad_r rms %.5f\n", side * side,
                  m.rms_e, m.mean_s / m.rms_e, m.rms_t, m.rms_r);
    return m;
}

/* Means within three standard errors and a share of the exact vector's length: 3 % at 128 cells a
 * side. The edge flux is biased to first order in the size of a cell, because 1 / r is taken at a
 * sample on the nearer surface, on average half a cell from its edge. */
static void check_means(const struct moments *m, const struct golden *g, uint32_t side)
{
    const double share = 0.03 * fmax(1.0, 128.0 / side);
    const double standard = 3.0 / sqrt((double)RUNS);
    const double length_t = hypot(g->grad_t[0], g->grad_t[1]);
    const double length_r = hypot(g->grad_r[0], g->grad_r[1]);
    assert_true(fabs(m->mean_e - g->e) < standard * m->rms_e + 1e-5);
    for (int k = 0; k < 2; ++k) {
        assert_true(fabs(m->mean_t[k] - g->grad_t[k]) < standard * m->rms_t + share * length_t);
        assert_true(fabs(m->mean_r[k] - g->grad_r[k]) < standard * m->rms_r + 0.03 * length_r);
    }
}

static void check_scene(uint32_t side, world_fn world, const struct golden *g, double most_rms_t)
{
    const struct moments m = measure(side, world, g);
    check_means(&m, g, side);
    assert_true(m.rms_t < most_rms_t + 0.0005); /* the table rounds to 0.001 */
    assert_true(m.mean_s > m.rms_e && m.mean_s < 2.2 * m.rms_e);
}

static void golden_scene_a(void **state)
{
    (void)state;
    check_scene(32, scene_a, &golden_a, 0.014);
    check_scene(64, scene_a, &golden_a, 0.005);
}

static void golden_scene_b(void **state)
{
    (void)state;
    check_scene(32, scene_b, &golden_b, 0.024);
    check_scene(64, scene_b, &golden_b, 0.009);
    check_scene(128, scene_b, &golden_b, 0.004);
}

/* Hessians of the golden scenes: the triangulated estimator lacks 4 % (A) and 20 % (B) at 4096
 * rays, as published; its scatter is small beside that, and it turns with the frame. */
static void check_hessian(world_fn world, const double exact[3], double least_share,
                          double most_rms)
{
    struct kl_gather_tables *t = make_tables(64);
    struct random random = {3};
    double mean[3] = {0.0, 0.0, 0.0};
    double rms[3] = {0.0, 0.0, 0.0};
    for (uint32_t i = 0; i < RUNS; ++i) {
        const kl_gather_result g = gather(t, world, i, random_range(&random, 0.0f, 2.0f * KL_PI));
        for (int k = 0; k < 3; ++k) {
            mean[k] += (double)g.hessian[k] / RUNS;
            rms[k] += pow((double)g.hessian[k], 2.0) / RUNS;
        }
    }
    for (int k = 0; k < 3; ++k) {
        rms[k] = sqrt(fmax(0.0, rms[k] - mean[k] * mean[k]));
        assert_true(rms[k] < most_rms);
        if (k == 1) continue;
        assert_true(mean[k] / exact[k] > least_share && mean[k] / exact[k] < 1.03);
    }
    print_message("Hessian %.4f %.4f %.4f, scatter %.4f\n", mean[0], mean[1], mean[2], rms[0]);
    assert_true(fabs(mean[1] - exact[1]) < 0.2 * fabs(exact[1]) + 0.01);
    kl_gather_tables_destroy(t);
}

static void golden_hessians(void **state)
{
    static const double a[3] = {-1.6542943, 0.0233533, -1.6799364};
    static const double b[3] = {2.6912429, -0.1830715, 2.8818433};
    (void)state;
    check_hessian(scene_a, a, 0.94, 0.02);
    check_hessian(scene_b, b, 0.78, 0.07);
}

/* The same light everywhere, in a box, also close to one of its walls: the skirt closes the rim. */
static double to_wall = 0.5;
static kl_gather_cell scene_box(kl_vec3 d)
{
    double t = 1.0 / fmax((double)d.z, 1e-9);
    if (d.x != 0.0f) t = fmin(t, (d.x > 0.0f ? 1.0 - to_wall : to_wall) / fabs((double)d.x));
    if (d.y != 0.0f) t = fmin(t, 0.5 / fabs((double)d.y));
    return cell_of(1.0, t);
}
static void furnace_has_no_hessian(void **state)
{
    (void)state;
    for (uint32_t side = 32; side <= 64; side *= 2) {
        struct kl_gather_tables *t = make_tables(side);
        for (uint32_t i = 0; i < 32; ++i) {
            to_wall = i % 2 ? 0.5 : 0.1;
            const kl_gather_result g = gather(t, scene_box, i, 0.37f * (float)i);
            for (int k = 0; k < 3; ++k) {
                assert_true(fabs((double)g.hessian[k]) < 0.08);
            }
        }
        kl_gather_tables_destroy(t);
    }
}

/* Rotational gradient of a wall at the horizon, where tan(theta) is unbounded. Its integral over
 * the wall's points: t = y_hat for x, weight z-free: sin^2 over the solid angle. */
static void bright_wall_at_the_horizon(void **state)
{
    enum { N = 1000 };
    struct golden g = {0};
    (void)state;
    for (int i = 0; i < N; ++i) {
        for (int k = 0; k < N; ++k) {
            const double y = 2.0 * (i + 0.5) / N - 1.0;
            const double z = (k + 0.5) / N;
            const double r2 = 1.0 + y * y + z * z;
            const double solid = 2.0 / ((double)N * N) / (r2 * sqrt(r2));
            const double r = sqrt(r2);
            g.e += solid * z / r;
            g.grad_r[0] -= solid * y / r; /* tan cos = sin: the tangential part, turned */
            g.grad_r[1] += solid * 1.0 / r;
        }
    }
    const double scale = hypot(g.grad_r[0], g.grad_r[1]) / 0.93;
    const struct moments few = measure(32, scene_wall, &g);
    const struct moments many = measure(64, scene_wall, &g);
    print_message("wall: |grad_r| %.4f, means %.4f %.4f\n", g.grad_r[1], few.mean_r[1],
                  many.mean_r[1]);
    assert_true(few.rms_r < 1.1 * 0.016 * scale);
    assert_true(many.rms_r < 1.1 * 0.009 * scale);
    assert_true(fabs(many.mean_r[1] - g.grad_r[1]) < 0.01 * g.grad_r[1]);
    assert_true(fabs(many.mean_r[0]) < 0.01 * g.grad_r[1]);
}

/* Uniform light: nothing changes wherever one goes, whatever the distances. */
static void furnace_has_no_gradient(void **state)
{
    (void)state;
    for (uint32_t side = 8; side <= 64; side *= 2) {
        struct kl_gather_tables *t = make_tables(side);
        for (uint32_t i = 0; i < 16; ++i) {
            const kl_gather_result g = gather(t, scene_furnace, i, 0.37f * (float)i);
            for (int k = 0; k < 6; ++k) {
                assert_true(g.grad_t[k] == 0.0f);
                assert_true(fabsf(g.grad_r[k]) < 1e-4f);
            }
            assert_true(fabsf(g.irr[0] / KL_PI - 1.0f) < 1e-5f);
            assert_true(g.error < 1e-5f);
        }
        kl_gather_tables_destroy(t);
    }
}

/* Over the half disc x > 0 the y components of the table sum to the integral of p_x / sqrt(1 -
 * p^2), which is pi / 2, and all of them to 0. */
static void rotation_table_integrates(void **state)
{
    (void)state;
    for (uint32_t side = 8; side <= 128; side *= 4) {
        struct kl_gather_tables *t = make_tables(side);
        double half = 0.0;
        double all = 0.0;
        for (uint32_t i = 0; i < side * side; ++i) {
            const double y = (double)t->turn[2 * i + 1];
            all += y;
            if (i % side >= side / 2) half += y;
        }
        print_message("side %u: half disc %.5f\n", side, half);
        assert_true(fabs(half / 1.5707963 - 1.0) < 0.01);
        assert_true(fabs(all) < 1e-4);
        kl_gather_tables_destroy(t);
    }
}

/* Each cell's direction lies in its cell, and the points of a set are all different ones. */
static void tables_hold_nets(void **state)
{
    (void)state;
    for (uint32_t side = 4; side <= 64; side *= 2) {
        struct kl_gather_tables *t = make_tables(side);
        for (uint32_t set = 0; set < t->sets; ++set) {
            const kl_direction *d = kl_gather_directions(t, set);
            uint8_t *seen = calloc((size_t)side * side, 1);
            assert_non_null(seen);
            for (uint32_t i = 0; i < side * side; ++i) {
                assert_in_range(d[i].index, 0, side * side - 1);
                assert_int_equal(seen[d[i].index]++, 0);
                assert_true(d[i].x * d[i].x + d[i].y * d[i].y < 1.0f);
            }
            free(seen);
        }
        kl_gather_tables_destroy(t);
    }
}

/* Harmonic mean distance of a dome of two distances, and of an open sky. */
static kl_gather_cell scene_dome(kl_vec3 d)
{
    return cell_of(1.0, d.x > 0.0f ? 1.0 : 3.0);
}
static kl_gather_cell scene_open(kl_vec3 d)
{
    return cell_of((double)d.z, HUGE_VAL);
}
static void harmonic_distances(void **state)
{
    struct kl_gather_tables *t = make_tables(32);
    const kl_gather_result dome = gather(t, scene_dome, 0, 0.0f);
    const kl_gather_result open = gather(t, scene_open, 0, 1.0f);
    (void)state;
    assert_true(fabsf(dome.harmonic - 1.5f) < 1e-3f);
    assert_true(open.harmonic == KL_INF);
    for (int k = 0; k < 6; ++k) {
        assert_true(open.grad_t[k] == 0.0f); /* 1 / r = 0: moving changes nothing */
    }
    for (int k = 0; k < KL_SECTORS; ++k) {
        assert_true(open.clearance[k] == KL_INF && dome.clearance[k] <= 3.0f);
    }
    kl_gather_tables_destroy(t);
}

/* A wall that fills x > 0.5: every sector that looks towards it knows, and none says that there is
 * less room than there is. */
static kl_gather_cell scene_half_wall(kl_vec3 d)
{
    return cell_of(0.0, d.x > 1e-6f ? 0.5 / (double)d.x : HUGE_VAL);
}
static void clearance_of_a_wall(void **state)
{
    struct kl_gather_tables *t = make_tables(32);
    struct random random = {5};
    (void)state;
    for (uint32_t i = 0; i < 100; ++i) {
        const float angle = random_range(&random, 0.0f, 2.0f * KL_PI);
        const kl_gather_result g = gather(t, scene_half_wall, i, angle);
        float nearest[KL_SECTORS]; /* in the sector, and with a gap between rays on either side */
        float around[KL_SECTORS];
        for (int k = 0; k < KL_SECTORS; ++k) {
            nearest[k] = KL_INF;
            around[k] = KL_INF;
        }
        for (int k = 0; k < 36000; ++k) {
            const float a = (float)k * (2.0f * KL_PI / 36000.0f);
            const uint32_t s = kl_sector_of(cosf(a), sinf(a));
            if (!(cosf(a) > 1e-3f)) continue;
            nearest[s] = fminf(nearest[s], 0.5f / cosf(a));
            for (float turn = -0.06f; turn < 0.1f; turn += 0.12f) {
                const uint32_t other = kl_sector_of(cosf(a + turn), sinf(a + turn));
                around[other] = fminf(around[other], 0.5f / cosf(a));
            }
        }
        for (int k = 0; k < KL_SECTORS; ++k) {
            assert_true(g.clearance[k] >= fminf(nearest[k], around[k]) * 0.999f);
            /* Rays of the ring are 2.9 degrees apart: the wall is found within that. */
            if (nearest[k] < 1.0f) assert_true(g.clearance[k] <= nearest[k] * 1.15f);
        }
    }
    kl_gather_tables_destroy(t);
}

/* One ray of 1e6: E keeps its energy, the derivatives do not follow it. */
static int firefly_count;
static kl_gather_cell scene_firefly(kl_vec3 d)
{
    (void)d;
    return cell_of(++firefly_count == 500 ? 1e6 : 1.0, 1.0);
}
static void fireflies_do_not_own_gradients(void **state)
{
    struct kl_gather_tables *t = make_tables(32);
    (void)state;
    firefly_count = 0;
    const kl_gather_result g = gather(t, scene_firefly, 0, 0.0f);
    assert_true(fabsf(g.irr[0] / ((1e6f + 1023.0f) / 1024.0f * KL_PI) - 1.0f) < 1e-5f);
    for (int k = 0; k < 6; ++k) { /* the relative gradient stays far below 1e6 / mean ~ 1e3 cells */
        assert_true(fabsf(g.grad_t[k]) < 2.0f * g.irr[0]);
        assert_true(fabsf(g.grad_r[k]) < 2.0f * g.irr[0]);
    }
    kl_gather_tables_destroy(t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(golden_scene_a),
        cmocka_unit_test(golden_scene_b),
        cmocka_unit_test(golden_hessians),
        cmocka_unit_test(furnace_has_no_hessian),
        cmocka_unit_test(bright_wall_at_the_horizon),
        cmocka_unit_test(furnace_has_no_gradient),
        cmocka_unit_test(rotation_table_integrates),
        cmocka_unit_test(tables_hold_nets),
        cmocka_unit_test(harmonic_distances),
        cmocka_unit_test(clearance_of_a_wall),
        cmocka_unit_test(fireflies_do_not_own_gradients),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
