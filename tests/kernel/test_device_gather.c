/* Gathers on the device against the same gathers on the host: the same rays, but traced, and their
 * sines and roots computed, by another compiler. */
#include "src/base/memory.h"
#include "src/device/gather_device.h"
#include "src/trace/tracer.h"
#include "test_trace_scenes.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { POINTS = 300, SIDE = 16, THINGS = 12 };

struct lit_scene {
    struct kl_flat *flat;
    float *normals;
    kl_material material;
    kl_light lights[2];      /* the sun, a lamp */
    kl_light_node root;      /* the lamp's */
    kl_u32 bits[2 + THINGS]; /* of the lights; of what lies in the landscape */
};

static kl_vec3 triangle_normal(const struct kl_flat *flat, uint32_t triangle)
{
    const kl_u32 *v = flat->triangles[triangle].v;
    const kl_vec3 a = kl_v3_load(flat->positions + 3 * (size_t)v[0]);
    const kl_vec3 b = kl_v3_load(flat->positions + 3 * (size_t)v[1]);
    const kl_vec3 c = kl_v3_load(flat->positions + 3 * (size_t)v[2]);
    return kl_normalize(kl_cross(kl_v3_sub(b, a), kl_v3_sub(c, a)));
}

static void add_normals(struct lit_scene *s)
{
    struct kl_flat *flat = s->flat;
    struct kl_err err = {0};

    if (kl_alloc_array(&s->normals, flat->vertex_count, 3 * sizeof(float), &err) != KL_OK) {
        fail_msg("%s", err.msg);
    }
    for (uint32_t i = 0; i < flat->triangle_count; ++i) {
        const kl_vec3 n = triangle_normal(flat, i);
        for (int k = 0; k < 3; ++k) {
            float *out = s->normals + 3 * (size_t)flat->triangles[i].v[k];
            out[0] = n.x;
            out[1] = n.y;
            out[2] = n.z;
        }
    }
}

static void add_lights(struct lit_scene *s)
{
    s->lights[0] = (kl_light){.type = KL_LIGHT_DIRECTIONAL,
                              .triangle = KL_NONE,
                              .color = {3.0f, 2.5f, 2.0f},
                              .dir = {0.6f, -0.8f, 0.0f}};
    s->lights[1] = (kl_light){.type = KL_LIGHT_POINT,
                              .triangle = KL_NONE,
                              .color = {1.0f, 2.0f, 4.0f},
                              .pos = {0.1f, 1.5f, -0.3f}};
    s->root = (kl_light_node){.center = {0.1f, 1.5f, -0.3f},
                              .power = 1.0f,
                              .cos_cone = -1.0f,
                              .parent = KL_NONE,
                              .child = KL_NONE,
                              .light = 1};
}

/* The landscape under a sun and a lamp, all of one grey material. */
static void light_scene(struct lit_scene *s)
{
    struct kl_flat *flat = kl_test_landscape(64, THINGS);

    s->flat = flat;
    add_normals(s);
    add_lights(s);
    s->material = (kl_material){.base_color = {0.7f, 0.6f, 0.5f, 1.0f},
                                .roughness = 1.0f,
                                .ior = 1.5f,
                                .specular = 1.0f,
                                .specular_color = {1.0f, 1.0f, 1.0f}};
    for (int i = 0; i < KL_TEX_SLOTS; ++i) {
        s->material.tex[i].texture = KL_NONE;
    }
    flat->material_count = 1;
    flat->light_count = 2;
    flat->light_node_count = 1;
    flat->view.needs = KL_NEED_PUNCTUAL | KL_NEED_SPECULAR;
    flat->view.light_count = 2;
    flat->view.far_count = 1;
    flat->view.far_probability = 0.5f;
    flat->view.normals = s->normals;
    flat->view.materials = &s->material;
    flat->view.lights = s->lights;
    flat->view.light_nodes = &s->root;
    s->bits[0] = KL_TOUCH_OBJECTS;
    s->bits[1] = KL_TOUCH_OBJECTS + 7;
    for (kl_u32 i = 0; i < THINGS; ++i) {
        s->bits[2 + i] = 3 * i;
        flat->triangles[i].object = i; /* a few facets of the ground */
    }
    flat->object_count = THINGS;
    flat->view.touch_bits = s->bits;
}

static void make_points(const struct kl_flat *flat, kl_gather_point *points)
{
    struct kl_test_random random = {5};

    for (uint32_t i = 0; i < POINTS; ++i) {
        const uint32_t t = (uint32_t)(kl_test_uniform(&random) * (float)flat->triangle_count);
        const kl_u32 *v = flat->triangles[t].v;
        const float turn = 2.0f * KL_PI * kl_test_uniform(&random);
        for (int k = 0; k < 3; ++k) {
            points[i].pos[k] = (flat->positions[3 * (size_t)v[0] + (size_t)k] +
                                flat->positions[3 * (size_t)v[1] + (size_t)k] +
                                flat->positions[3 * (size_t)v[2] + (size_t)k]) /
                               3.0f;
        }
        points[i].normal = kl_oct_encode(triangle_normal(flat, t));
        points[i].geometric = points[i].normal;
        points[i].seed = i * 2654435761u;
        points[i].rot_cos = cosf(turn);
        points[i].rot_sin = sinf(turn);
    }
}

static bool is_near(float a, float b, float slack)
{
    return fabsf(a - b) <= slack;
}

/* A rounding that sends one path another way changes a record a little: most must agree closely,
 * and their mean very closely. */
static void compare_results(const kl_gather_result *host, const kl_gather_result *device)
{
    double sum_host = 0.0, sum_device = 0.0;
    int near = 0;
    kl_u32 touched = 0;

    for (int i = 0; i < POINTS; ++i) {
        const kl_gather_result *a = &host[i];
        const kl_gather_result *b = &device[i];
        const float scale = 1e-6f + fabsf(a->irr[0]);
        bool same = is_near(a->harmonic, b->harmonic, 1e-3f * a->harmonic);
        for (int k = 0; k < 3; ++k) {
            assert_true(isfinite(b->irr[k]) && b->irr[k] >= 0.0f);
            same = same && is_near(a->irr[k], b->irr[k], 1e-3f * scale);
            sum_host += (double)a->irr[k];
            sum_device += (double)b->irr[k];
        }
        const float bend = 1e-2f * (1e-3f + fabsf(a->grad_t[0]) + fabsf(a->grad_t[1]));
        same = same && is_near(a->grad_t[0], b->grad_t[0], bend);
        same = same && is_near(a->grad_t[1], b->grad_t[1], bend);
        same = same && a->touched[0] == b->touched[0] && a->touched[1] == b->touched[1];
        assert_int_equal(a->touched[1] & b->touched[1] & ~0x00810002u, 0);
        touched |= a->touched[0] | a->touched[1];
        near += same;
    }
    (void)printf("%d of %d records agree; mean %.6f on the host, %.6f on the device\n", near,
                 POINTS, sum_host / POINTS, sum_device / POINTS);
    assert_true(sum_host > 0.0);
    assert_true(fabs(sum_host - sum_device) <= 2e-3 * sum_host);
    assert_true(near >= POINTS * 9 / 10);
    assert_true(touched != 0);
}

static void device_gathers_as_host(void **state)
{
    (void)state;
    static kl_gather_point points[POINTS];
    static kl_gather_result host[POINTS], device[POINTS], again[POINTS];
    struct lit_scene s = {0};
    struct kl_gather_device *gather = NULL;
    struct kl_gather_tables *tables = NULL;
    struct kl_tracer *tracer = NULL;
    struct kl_err err = {0};

    light_scene(&s);
    make_points(s.flat, points);
    if (kl_gather_device_create("opencl", s.flat, NULL, &gather, &err) != KL_OK) {
        (void)printf("SKIPPED: %s\n", err.msg);
        kl_test_scene_destroy(s.flat);
        free(s.normals);
        skip();
    }
    kl_status st = kl_tracer_create(s.flat, &tracer, &err);
    if (st == KL_OK) st = kl_gather_tables_create(SIDE, &tables, &err);
    if (st != KL_OK) fail_msg("%s", err.msg);
    const kl_level_view none = {0};
    struct kl_gather_job job = {
        .scene = &s.flat->view,
        .level1 = &none,
        .ladder = {.steps = {tables}, .count = 1},
        .settings = {.query = {1.0f, 0.9f}, .length_scale = 1.0f, .touch = 0.005f},
        .points = points,
        .count = POINTS,
        .results = host,
    };
    st = kl_gather_host(&job, &err);
    job.results = device;
    if (st == KL_OK) st = kl_gather_device_run(gather, &job, &err);
    job.results = again;
    if (st == KL_OK) st = kl_gather_device_run(gather, &job, &err);
    if (st != KL_OK) fail_msg("%s", err.msg);
    compare_results(host, device);
    assert_memory_equal(device, again, sizeof again);
    kl_gather_tables_destroy(tables);
    kl_tracer_destroy(tracer);
    kl_gather_device_destroy(gather);
    kl_gather_device_destroy(NULL);
    kl_test_scene_destroy(s.flat);
    free(s.normals);
}

/* A ladder climbed to its end has traced every ray of its last step once: the same result as that
 * step alone. With a tolerance, records stop on the way. */
static void ladders_keep_their_rays(void **state)
{
    (void)state;
    static kl_gather_point points[POINTS];
    static kl_gather_result climbed[POINTS], alone[POINTS];
    struct lit_scene s = {0};
    struct kl_gather_device *gather = NULL;
    struct kl_gather_tables *tables[3] = {NULL, NULL, NULL};
    struct kl_tracer *tracer = NULL;
    struct kl_err err = {0};

    light_scene(&s);
    make_points(s.flat, points);
    kl_status st = kl_tracer_create(s.flat, &tracer, &err);
    for (uint32_t i = 0; st == KL_OK && i < 3; ++i) {
        st = kl_gather_tables_create(8u << i, &tables[i], &err);
    }
    if (st != KL_OK) fail_msg("%s", err.msg);
    const bool has_device = kl_gather_device_create("opencl", s.flat, NULL, &gather, &err) == KL_OK;
    const kl_level_view none = {0};
    for (int on_device = 0; on_device <= (has_device ? 1 : 0); ++on_device) {
        struct kl_gather_job job = {
            .scene = &s.flat->view,
            .level1 = &none,
            .ladder = {.steps = {tables[0], tables[1], tables[2]}, .count = 3, .tolerance = -1.0f},
            .settings = {.query = {1.0f, 0.9f}, .length_scale = 1.0f, .touch = 0.005f},
            .points = points,
            .count = POINTS,
            .results = climbed,
        };
        st = on_device ? kl_gather_device_run(gather, &job, &err) : kl_gather_host(&job, &err);
        job.ladder = (struct kl_gather_ladder){.steps = {tables[2]}, .count = 1};
        job.results = alone;
        if (st == KL_OK) {
            st = on_device ? kl_gather_device_run(gather, &job, &err) : kl_gather_host(&job, &err);
        }
        if (st != KL_OK) fail_msg("%s", err.msg);
        uint32_t whole = 0;
        for (int i = 0; i < POINTS; ++i) { /* where no ray finds light, more do not help */
            if (climbed[i].side < 32) {
                assert_true(climbed[i].irr[1] == 0.0f);
                continue;
            }
            assert_memory_equal(&climbed[i], &alone[i], sizeof alone[i]);
            ++whole;
        }
        assert_true(whole > POINTS / 10);
        job.results = climbed;
        job.ladder = (struct kl_gather_ladder){
            .steps = {tables[0], tables[1], tables[2]}, .count = 3, .tolerance = 0.2f};
        st = on_device ? kl_gather_device_run(gather, &job, &err) : kl_gather_host(&job, &err);
        if (st != KL_OK) fail_msg("%s", err.msg);
        uint32_t early = 0;
        for (int i = 0; i < POINTS; ++i) {
            early += climbed[i].side < 32;
            assert_true(climbed[i].side == 32 || climbed[i].error <= 0.2f);
        }
        assert_in_range(early, 1, POINTS - 1);
    }
    for (uint32_t i = 0; i < 3; ++i) {
        kl_gather_tables_destroy(tables[i]);
    }
    kl_tracer_destroy(tracer);
    kl_gather_device_destroy(gather);
    kl_test_scene_destroy(s.flat);
    free(s.normals);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(device_gathers_as_host),
                                       cmocka_unit_test(ladders_keep_their_rays)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
