/* kernels/lights.h: what the light sampler finds on average is what closed forms say, and its
 * densities are true. */
#include "kernels/lights.h"
#include "src/scene/light_tree.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdlib.h>

struct rig {
    kl_light lights[704];
    uint32_t count, far;
    kl_light_node *nodes;
    kl_scene_view view;
};

static void add_triangle(struct rig *r, kl_vec3 a, kl_vec3 b, kl_vec3 c, float radiance,
                         uint32_t two_sided)
{
    const kl_vec3 e1 = kl_v3_sub(b, a);
    const kl_vec3 e2 = kl_v3_sub(c, a);
    r->lights[r->count++] = (kl_light){.type = KL_LIGHT_TRIANGLE,
                                       .color = {radiance, radiance, radiance},
                                       .pos = {a.x, a.y, a.z},
                                       .edge1 = {e1.x, e1.y, e1.z},
                                       .edge2 = {e2.x, e2.y, e2.z},
                                       .area = 0.5f * kl_length(kl_cross(e1, e2)),
                                       .two_sided = two_sided};
}

static void rig_finish(struct rig *r)
{
    uint32_t nodes;
    struct kl_err err = {0};
    if (kl_light_tree_build(r->lights, r->far, r->count, NULL, &r->nodes, &nodes, &err) != KL_OK) {
        fail_msg("%s", err.msg);
    }
    r->view = (kl_scene_view){.needs = KL_NEED_EMITTERS | KL_NEED_PUNCTUAL,
                              .light_count = r->count,
                              .far_count = r->far,
                              .scene_radius = 10.0f,
                              .lights = r->lights,
                              .light_nodes = r->nodes};
    r->view.far_probability = r->far == 0 ? 0.0f : (r->far == r->count ? 1.0f : 0.5f);
}

/* Irradiance at p by `samples` light samples. */
static double irradiance(const struct rig *r, kl_vec3 p, kl_vec3 n, uint32_t samples)
{
    double sum = 0.0;
    for (uint32_t i = 0; i < samples; ++i) {
        kl_sampler s = kl_sampler_make(i, 12345);
        const float choice = kl_sampler_1d(&s);
        const kl_vec2 u = kl_sampler_2d(&s);
        kl_light_sample l;
        if (!kl_light_sample_one(&r->view, p, n, KL_TIME_REFERENCE, choice, u, &l)) continue;
        assert_true(l.pdf > 0.0f && isfinite(l.pdf));
        assert_true(fabsf(kl_length(l.wi) - 1.0f) < 1e-4f);
        sum += fmax(0.0, (double)kl_dot(n, l.wi)) * (double)l.radiance.y / (double)l.pdf;
    }
    return sum / samples;
}

/* Lambert's formula for a polygon wholly above the horizon of n, radiance 1. */
static double lambert(const kl_vec3 *v, int count, kl_vec3 p, kl_vec3 n)
{
    double e = 0.0;
    for (int i = 0; i < count; ++i) {
        const kl_vec3 a = kl_v3_sub(v[i], p);
        const kl_vec3 b = kl_v3_sub(v[(i + 1) % count], p);
        const kl_vec3 c = kl_cross(a, b);
        const double angle = atan2((double)kl_length(c), (double)kl_dot(a, b));
        e += angle * (double)kl_dot(n, kl_normalize(c));
    }
    return 0.5 * fabs(e);
}

/* A square above at many distances and sizes: solid angles from 4 sr to 1e-4 sr. */
static void polygons(void **state)
{
    const kl_vec3 n = kl_v3(0.0f, 0.0f, 1.0f);
    struct random random = {1};
    (void)state;
    for (int i = 0; i < 30; ++i) {
        const float h = powf(10.0f, random_range(&random, -1.0f, 1.5f));
        const float turn = random_range(&random, 0.0f, 6.0f);
        const kl_vec3 p =
            kl_v3(random_range(&random, -1.0f, 1.0f), random_range(&random, -1.0f, 1.0f), 0.0f);
        kl_vec3 v[4];
        struct rig r = {0};
        for (int k = 0; k < 4; ++k) { /* clockwise from above: faces down */
            const float a = turn - 0.5f * KL_PI * (float)k;
            v[k] = kl_v3(cosf(a), sinf(a), h + 0.05f * cosf(a));
        }
        const double want = lambert(v, 4, p, n);
        add_triangle(&r, v[0], v[1], v[2], 1.0f, (uint32_t)i % 2);
        add_triangle(&r, v[0], v[2], v[3], 1.0f, (uint32_t)i % 2);
        rig_finish(&r);
        const double got = irradiance(&r, p, n, 1 << 16);
        if (fabs(got / want - 1.0) > 5e-3) {
            fail_msg("height %g: E %.6f, Lambert %.6f", (double)h, got, want);
        }
        const double behind =
            irradiance(&r, kl_v3(p.x, p.y, 2.0f * h), kl_v3(0.0f, 0.0f, -1.0f), 4096);
        assert_true(i % 2 ? behind > 0.0 : behind == 0.0);
        free(r.nodes);
    }
}

/* Disc of radius R, parallel, at height h, shifted by a. */
static void disc(void **state)
{
    enum { EDGES = 60 };
    const double radius = 0.5, h = 0.7, a = 0.4;
    const kl_vec3 center = kl_v3(0.4f, 0.0f, 0.7f);
    struct rig r = {0};
    (void)state;
    for (int i = 0; i < EDGES; ++i) {
        const float t0 = 2.0f * KL_PI * (float)(i + 1) / EDGES;
        const float t1 = 2.0f * KL_PI * (float)i / EDGES;
        const float s = (float)(radius / sqrt(sin(6.2831853 / EDGES) * EDGES / 6.2831853));
        add_triangle(&r, center, kl_v3(0.4f + s * cosf(t0), s * sinf(t0), 0.7f),
                     kl_v3(0.4f + s * cosf(t1), s * sinf(t1), 0.7f), 1.0f, 0);
    }
    rig_finish(&r);
    const double q = h * h + a * a;
    const double want = 0.5 * 3.14159265 *
                        (1.0 - (q - radius * radius) / sqrt(pow(q + radius * radius, 2.0) -
                                                            4.0 * radius * radius * a * a));
    const double got = irradiance(&r, kl_v3_splat(0.0f), kl_v3(0.0f, 0.0f, 1.0f), 1 << 18);
    assert_true(fabs(got / want - 1.0) < 3e-3);
    free(r.nodes);
}

/* Densities integrate: over directions that hit the triangle, pdf sums to 1. */
static void triangle_density(void **state)
{
    struct random random = {3};
    (void)state;
    for (int i = 0; i < 12; ++i) {
        struct rig r = {0};
        const float size = powf(10.0f, random_range(&random, -2.0f, 0.5f));
        const kl_vec3 a = kl_v3(random_range(&random, -1.0f, 1.0f), 0.3f, 1.0f);
        const kl_vec3 b = kl_v3_mad(a, size, kl_v3(0.1f, 1.0f, 0.3f));
        const kl_vec3 c = kl_v3_mad(a, size, kl_v3(1.0f, -0.2f, 0.1f));
        add_triangle(&r, a, b, c, 1.0f, 0);
        rig_finish(&r);
        const kl_vec3 e1 = kl_v3_sub(b, a);
        const kl_vec3 e2 = kl_v3_sub(c, a);
        const kl_vec3 n = kl_v3(0.0f, 0.0f, 1.0f);
        double sum = 0.0;
        enum { N = 300 };
        for (int k = 0; k < N * N; ++k) { /* points by area: solid angle = cos / d^2 dA */
            const kl_vec2 u = {((float)(k % N) + 0.5f) / N, ((float)(k / N) + 0.5f) / N};
            const kl_vec2 q = kl_triangle_map(u);
            const kl_vec3 y = kl_v3_mad(kl_v3_mad(a, q.x, e1), q.y, e2);
            const float d = kl_length(y);
            const kl_vec3 w = kl_v3_scale(y, 1.0f / d);
            const float cosine = fabsf(kl_dot(kl_normalize(kl_cross(e1, e2)), w));
            const float pdf =
                kl_light_pdf(&r.view, 0, kl_v3_splat(0.0f), n, KL_TIME_REFERENCE, w, d);
            sum += (double)(pdf * cosine / (d * d) * r.lights[0].area);
        }
        assert_true(fabs(sum / (N * N) - 1.0) < 5e-3);
        for (uint32_t k = 0; k < 200; ++k) { /* and the sample says the same density */
            kl_light_sample l;
            const kl_vec2 u = kl_sobol_2d(k, 9);
            if (!kl_light_sample_one(&r.view, kl_v3_splat(0.0f), n, KL_TIME_REFERENCE, 0.5f, u, &l))
                continue;
            const float pdf =
                kl_light_pdf(&r.view, 0, kl_v3_splat(0.0f), n, KL_TIME_REFERENCE, l.wi, l.distance);
            assert_true(fabsf(pdf / l.pdf - 1.0f) < 2e-3f);
            assert_true(l.distance > 0.5f);
        }
        free(r.nodes);
    }
}

static void punctual(void **state)
{
    const kl_vec3 up = kl_v3(0.0f, 0.0f, 1.0f);
    struct rig r = {0};
    (void)state;
    r.lights[0] = (kl_light){.type = KL_LIGHT_POINT, .color = {5, 5, 5}, .pos = {3, 0, 4}};
    r.count = 1;
    rig_finish(&r);
    assert_true(fabs(irradiance(&r, kl_v3_splat(0.0f), up, 16) - 5.0 / 25.0 * 0.8) < 1e-6);
    r.lights[0].range = 10.0f; /* 1 - (5 / 10)^4 */
    assert_true(fabs(irradiance(&r, kl_v3_splat(0.0f), up, 16) - 0.16 * (1.0 - 0.0625)) < 1e-6);
    r.lights[0].range = 4.9f;
    assert_true(irradiance(&r, kl_v3_splat(0.0f), up, 16) == 0.0);
    free(r.nodes);

    /* A spot straight down: full inside, (c - outer) / (inner - outer) squared in between. */
    r.lights[0] = (kl_light){.type = KL_LIGHT_SPOT,
                             .color = {2, 2, 2},
                             .pos = {0, 0, 2},
                             .dir = {0, 0, -1},
                             .cone_cos = 0.5f,
                             .cone_scale = 1.0f / 0.4f};
    rig_finish(&r);
    assert_true(fabs(irradiance(&r, kl_v3_splat(0.0f), up, 16) - 0.5) < 1e-6);
    const double d2 = 4.0 / (0.7 * 0.7); /* seen under the cosine 0.7 */
    const kl_vec3 aside = kl_v3((float)sqrt(d2 - 4.0), 0.0f, 0.0f);
    assert_true(fabs(irradiance(&r, aside, up, 16) - 2.0 / d2 * 0.7 * 0.25) < 1e-5);
    assert_true(irradiance(&r, kl_v3(4.0f, 0.0f, 0.0f), up, 16) == 0.0);
    free(r.nodes);

    r.lights[0] =
        (kl_light){.type = KL_LIGHT_DIRECTIONAL, .color = {3, 3, 3}, .dir = {0.6f, 0, -0.8f}};
    r.far = 1;
    rig_finish(&r);
    assert_true(fabs(irradiance(&r, kl_v3_splat(7.0f), up, 16) - 2.4) < 1e-5);
    assert_true(irradiance(&r, kl_v3_splat(7.0f), kl_v3(0, 0, -1), 16) == 0.0);
    free(r.nodes);
}

/* Many kinds of lights all around. */
static void mixed_rig(struct rig *r, uint64_t seed, uint32_t far)
{
    struct random random = {seed};
    *r = (struct rig){.far = far};
    for (; r->count < far; ++r->count) {
        r->lights[r->count] =
            (kl_light){.type = KL_LIGHT_DIRECTIONAL, .color = {1, 1, 1}, .dir = {0, 0, -1}};
    }
    while (r->count < 60) {
        const kl_vec3 p = kl_v3_scale(random_direction(&random), random_range(&random, 0.2f, 3.0f));
        const float power = powf(10.0f, random_range(&random, -2.0f, 2.0f));
        if (random_bits(&random) % 3 == 0) {
            r->lights[r->count++] = (kl_light){
                .type = KL_LIGHT_POINT, .color = {power, power, power}, .pos = {p.x, p.y, p.z}};
            continue;
        }
        const float size = random_range(&random, 0.01f, 0.5f);
        add_triangle(r, p, kl_v3_mad(p, size, random_direction(&random)),
                     kl_v3_mad(p, size, random_direction(&random)), power,
                     (uint32_t)(random_bits(&random) % 2));
    }
    rig_finish(r);
}

/* Probabilities are those of the choice (chi-square), and sum to at most 1; less only where whole
 * branches cannot contribute. */
static void choice_matches_probabilities(void **state)
{
    enum { N = 200000 };
    struct random random = {5};
    (void)state;
    for (uint64_t seed = 1; seed <= 20; ++seed) {
        struct rig r;
        uint32_t hits[64] = {0};
        uint32_t none = 0;
        mixed_rig(&r, seed, (uint32_t)(seed % 3));
        const kl_vec3 p = kl_v3_scale(random_direction(&random), 2.0f * random_float(&random));
        const kl_vec3 n = random_direction(&random);
        for (int i = 0; i < N; ++i) {
            float prob;
            const uint32_t light =
                kl_light_choose(&r.view, p, n, ((float)i + random_float(&random)) / N, &prob);
            if (light == KL_NONE) {
                ++none;
                continue;
            }
            ++hits[light];
            assert_true(fabsf(prob / kl_light_probability(&r.view, light, p, n) - 1.0f) < 1e-4f);
        }
        double sum = 0.0;
        double chi2 = 0.0;
        for (uint32_t i = 0; i < r.count; ++i) {
            const double want = N * (double)kl_light_probability(&r.view, i, p, n);
            sum += want / N;
            if (want == 0.0) assert_int_equal(hits[i], 0);
            if (want > 5.0) chi2 += pow(hits[i] - want, 2.0) / want;
        }
        assert_true(fabs(sum + (double)none / N - 1.0) < 1e-3);
        assert_true(chi2 < 60.0 + 5.0 * sqrt(120.0));
        free(r.nodes);
    }
}

/* A light that gives something is never judged to give nothing, by itself or by a node above it.
 * (Next to one that may give 10^7 times as much its chance rounds to 0.) */
static void no_light_is_lost(void **state)
{
    struct random random = {6};
    (void)state;
    for (uint64_t seed = 1; seed <= 40; ++seed) {
        struct rig r;
        mixed_rig(&r, seed, 0);
        for (int k = 0; k < 50; ++k) {
            const kl_vec3 p = kl_v3_scale(random_direction(&random), 4.0f * random_float(&random));
            const kl_vec3 n = random_direction(&random);
            for (uint32_t i = 0; i < r.count; ++i) {
                const kl_light *l = &r.lights[i];
                kl_light_sample s = {0};
                const kl_vec2 u = {random_float(&random), random_float(&random)};
                const kl_punctual punctual = kl_punctual_of(l);
                const int ok =
                    l->type == KL_LIGHT_TRIANGLE
                        ? kl_light_sample_triangle(&r.view, i, p, KL_TIME_REFERENCE, u, &s)
                        : kl_light_sample_punctual(&punctual, p, &s);
                if (!ok || !(kl_dot(s.wi, n) > 1e-4f)) continue;
                for (uint32_t node = l->leaf; node != KL_NONE; node = r.nodes[node].parent) {
                    assert_true(kl_light_importance(&r.nodes[node], p, n) > 0.0f);
                }
            }
        }
        free(r.nodes);
    }
}

/* Of one light sample at p: what it varies by over what it says, squared. */
static double relative_variance(const struct rig *r, kl_vec3 p, kl_vec3 n, struct random *random)
{
    enum { SAMPLES = 1 << 14 };
    double sum = 0.0;
    double squares = 0.0;
    for (int i = 0; i < SAMPLES; ++i) {
        kl_light_sample l;
        const float choice = random_float(random);
        const kl_vec2 u = {random_float(random), random_float(random)};
        if (!kl_light_sample_one(&r->view, p, n, KL_TIME_REFERENCE, choice, u, &l)) continue;
        const double e = fmax(0.0, (double)kl_dot(n, l.wi)) / (double)l.pdf;
        sum += e / SAMPLES;
        squares += e * e / SAMPLES;
    }
    return squares / (sum * sum) - 1.0;
}

/* A hall under 18 x 18 small panels: most of its lights are far, and the tree's upper nodes hold
 * the receiver. What one sample says varies little. */
static void many_panels(void **state)
{
    enum { ACROSS = 18, POINTS = 20 };
    const kl_vec3 up = kl_v3(0.0f, 0.0f, 1.0f);
    struct random random = {9};
    struct rig r = {0};
    double variance = 0.0;
    (void)state;
    for (int i = 0; i < ACROSS * ACROSS; ++i) {
        const kl_vec3 a = kl_v3(4.0f * (float)(i % ACROSS), 4.0f * (float)(i / ACROSS), 3.0f);
        const kl_vec3 b = kl_v3(a.x, a.y + 1.5f, a.z);
        const kl_vec3 c = kl_v3(a.x + 0.3f, a.y + 1.5f, a.z);
        const kl_vec3 d = kl_v3(a.x + 0.3f, a.y, a.z);
        add_triangle(&r, a, b, c, 1.0f, 0);
        add_triangle(&r, a, c, d, 1.0f, 0);
    }
    rig_finish(&r);
    for (int k = 0; k < POINTS; ++k) {
        const kl_vec3 p = kl_v3(random_range(&random, 4, 64), random_range(&random, 4, 64), 0.0f);
        variance += relative_variance(&r, p, up, &random) / POINTS;
    }
    print_message("relative variance of one sample: %.2f\n", variance);
    assert_true(variance < 1.0); /* 6 while one node after the other was chosen from the root */
    free(r.nodes);
}

/* A corridor of 2 by 2 by 82, all of it shining: long triangles are near though the middles of
 * their spheres are not. */
static void long_walls(void **state)
{
    const kl_vec3 corners[4] = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
    struct random random = {4};
    struct rig r = {0};
    (void)state;
    for (int k = 0; k < 4; ++k) {
        const kl_vec3 a = corners[k];
        const kl_vec3 b = corners[(k + 1) % 4];
        const kl_vec3 c = kl_v3(b.x, b.y, -82.0f);
        const kl_vec3 d = kl_v3(a.x, a.y, -82.0f);
        add_triangle(&r, a, b, c, 1.0f, 1);
        add_triangle(&r, a, c, d, 1.0f, 1);
    }
    add_triangle(&r, corners[0], corners[1], corners[2], 1.0f, 1);
    add_triangle(&r, corners[0], corners[2], corners[3], 1.0f, 1);
    rig_finish(&r);
    const kl_vec3 p = kl_v3(0.2f, 0.3f, -1.0f);
    const double variance = relative_variance(&r, p, kl_v3(0.0f, 0.0f, 1.0f), &random);
    print_message("relative variance of one sample: %.2f\n", variance);
    assert_true(variance < 2.0); /* 17 by the spheres about them */
    free(r.nodes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(polygons),
        cmocka_unit_test(many_panels),
        cmocka_unit_test(long_walls),
        cmocka_unit_test(disc),
        cmocka_unit_test(triangle_density),
        cmocka_unit_test(punctual),
        cmocka_unit_test(choice_matches_probabilities),
        cmocka_unit_test(no_light_is_lost),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
