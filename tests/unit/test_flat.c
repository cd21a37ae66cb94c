/* src/scene/flat*.c: transforms, sharing, lights and environment, by what rays and samples then
 * see. */
#include "src/scene/flat.h"

#include "kernels/lights.h"
#include "src/trace/tracer.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdlib.h>

enum { RINGS = 40, VERTICES = (RINGS + 1) * (2 * RINGS + 1), TRIANGLES = 4 * RINGS * (RINGS - 1) };
enum { NODES = 3 };

/* A sphere mesh (more than 4096 triangles: shared where used twice), on up to three nodes. */
struct world {
    struct kl_scene scene;
    struct kl_mesh mesh;
    struct kl_node nodes[NODES];
    struct kl_scene_instance instances[NODES];
    kl_material material;
    double matrices[16 * NODES];
    struct kl_pose pose;
};

static void make_sphere(struct kl_mesh *m)
{
    const uint32_t w = 2 * RINGS + 1;
    uint32_t used = 0;
    m->vertex_count = VERTICES;
    m->positions = calloc(3 * VERTICES, sizeof(float));
    m->normals = calloc(3 * VERTICES, sizeof(float));
    m->indices = calloc(3 * TRIANGLES, sizeof(uint32_t));
    assert_true(m->positions && m->normals && m->indices);
    for (uint32_t i = 0; i < VERTICES; ++i) {
        const float t = KL_PI * (float)(i / w) / RINGS;
        const float p = KL_PI * (float)(i % w) / RINGS;
        const float d[3] = {sinf(t) * cosf(p), cosf(t), -sinf(t) * sinf(p)};
        memcpy(m->positions + 3 * i, d, sizeof d);
        memcpy(m->normals + 3 * i, d, sizeof d);
    }
    for (uint32_t i = 0; i < RINGS; ++i) {
        for (uint32_t j = 0; j < 2 * RINGS; ++j) {
            const uint32_t a = i * w + j;
            const uint32_t quad[6] = {a, a + w, a + w + 1, a, a + w + 1, a + 1};
            for (uint32_t k = i < RINGS - 1 ? 0 : 3; k < (i > 0 ? 6u : 3u); ++k) {
                m->indices[used++] = quad[k];
            }
        }
    }
    m->triangle_count = used / 3;
    assert_int_equal(m->triangle_count, TRIANGLES);
}

static void world_init(struct world *w, uint32_t instances, const double (*matrices)[16])
{
    *w = (struct world){0};
    make_sphere(&w->mesh);
    w->mesh.name = "sphere";
    w->material = (kl_material){.base_color = {0.5f, 0.5f, 0.5f, 1.0f}, .roughness = 1.0f};
    for (int k = 0; k < KL_TEX_SLOTS; ++k) {
        w->material.tex[k].texture = KL_NONE;
    }
    for (uint32_t i = 0; i < instances; ++i) {
        w->nodes[i] = (struct kl_node){.name = "node", .parent = KL_NONE, .visible = true};
        w->instances[i] = (struct kl_scene_instance){0, i, KL_NONE, i};
        memcpy(w->matrices + 16 * i, matrices[i], sizeof matrices[i]);
    }
    w->scene = (struct kl_scene){.path = "test",
                                 .mesh_count = 1,
                                 .node_count = instances,
                                 .instance_count = instances,
                                 .material_count = 1,
                                 .meshes = &w->mesh,
                                 .nodes = w->nodes,
                                 .instances = w->instances,
                                 .materials = &w->material};
    w->pose = (struct kl_pose){.node_count = instances, .world_from_node = w->matrices};
    static double *no_weights[NODES];
    w->pose.weights = no_weights;
}

static void world_fini(struct world *w)
{
    free(w->mesh.positions);
    free(w->mesh.normals);
    free(w->mesh.indices);
}

static struct kl_flat *flatten(struct world *w, const double *origin)
{
    struct kl_flat *flat = NULL;
    struct kl_err err = {0};
    double chosen[3];
    if (kl_flat_choose_origin(&w->scene, &w->pose, chosen, &err) != KL_OK) fail_msg("%s", err.msg);
    if (kl_flat_create(&w->scene, &w->pose, origin != NULL ? origin : chosen, &flat, &err) !=
        KL_OK) {
        fail_msg("%s", err.msg);
    }
    return flat;
}

static struct kl_tracer *trace(struct kl_flat *flat)
{
    struct kl_tracer *t = NULL;
    struct kl_err err = {0};
    if (kl_tracer_create(flat, &t, &err) != KL_OK) fail_msg("%s", err.msg);
    return t;
}

/* Turned, stretched, mirrored; columns. */
static const double stretched[16] = {1.5, 0.4, 0,   0, -0.3, 0.5,  0.2, 0,
                                     0.1, 0,   0.8, 0, 0.3,  -0.2, 0.1, 1};
static const double mirrored[16] = {-1.2, 0.1, 0.3, 0, 0.2, 0.6, 0, 0,
                                    0,    0.3, 1.1, 0, -4,  0.5, 1, 1};

static double det3(const double *m)
{
    return m[0] * (m[5] * m[10] - m[9] * m[6]) - m[4] * (m[1] * m[10] - m[9] * m[2]) +
           m[8] * (m[1] * m[6] - m[5] * m[2]);
}

/* Rays at an ellipsoid from outside (and inside): the front is outside also where the map mirrors,
 * normals stand on the surface, and smooth ones are close to those of the triangles. */
static void check_normals(struct kl_flat *flat, uint32_t object, const double m[16], bool emits)
{
    struct random r = {object + 1};
    int hits = 0;
    for (int i = 0; i < 2000; ++i) {
        const kl_vec3 c = kl_v3((float)(m[12] - flat->origin[0]), (float)(m[13] - flat->origin[1]),
                                (float)(m[14] - flat->origin[2]));
        const kl_vec3 d = random_direction(&r);
        const bool outside = i % 2;
        const kl_vec3 o = outside ? kl_v3_mad(c, -5.0f, d) : c;
        const kl_vec3 aim = outside ? kl_v3_mad(c, 0.3f, random_direction(&r)) : kl_v3_add(c, d);
        const kl_ray ray = kl_ray_make(o, kl_normalize(kl_v3_sub(aim, o)), KL_INF);
        kl_hit hit;
        kl_surface s;
        if (!kl_trace_closest(&flat->view, &ray, &hit)) continue;
        kl_surface_at(&flat->view, &ray, &hit, &s);
        if (s.object != object) continue;
        ++hits;
        assert_true(kl_dot(s.geometric, ray.dir) < 0.0f);
        assert_true(kl_dot(s.smooth, s.geometric) > 0.99f);
        assert_true(fabsf(kl_length(s.smooth) - 1.0f) < 1e-4f);
        const kl_vec3 out = kl_v3_sub(s.pos, c); /* convex about c: outward normals lean outward */
        assert_true((kl_dot(s.geometric, out) > 0.0f) == outside);
        const kl_vec3 at = kl_v3_mad(ray.origin, hit.t, ray.dir);
        assert_true(kl_length(kl_v3_sub(at, s.pos)) < 1e-4f);
        if (emits) assert_true(kl_is_black(s.emission) != outside); /* one-sided: front only */
    }
    assert_true(hits > 500);
}

static void merged_instances(void **state)
{
    const double *const both[2] = {stretched, mirrored};
    (void)state;
    for (int i = 0; i < 2; ++i) {
        double m[1][16];
        struct world w;
        memcpy(m[0], both[i], sizeof m[0]);
        world_init(&w, 1, (const double(*)[16])m);
        w.material.emission[0] = 1.0f;
        struct kl_flat *flat = flatten(&w, NULL);
        struct kl_tracer *t = trace(flat);
        assert_int_equal(flat->instance_count, 1);
        check_normals(flat, 0, both[i], true);
        assert_true((det3(both[i]) < 0.0) == (i == 1));
        kl_tracer_destroy(t);
        kl_flat_destroy(flat);
        world_fini(&w);
    }
}

/* The same two instances shared and merged: the same hits and normals. Emissive ones are merged. */
static void shared_equals_merged(void **state)
{
    double m[2][16];
    struct world w;
    struct random r = {3};
    int hits = 0;
    (void)state;
    memcpy(m[0], stretched, sizeof m[0]);
    memcpy(m[1], mirrored, sizeof m[1]);
    world_init(&w, 2, (const double(*)[16])m);
    struct kl_flat *shared = flatten(&w, NULL);
    w.material.emission[1] = 1.0f;
    struct kl_flat *merged = flatten(&w, shared->origin);
    assert_int_equal(shared->instance_count, 3);
    assert_int_equal(shared->triangle_count, TRIANGLES);
    assert_int_equal(merged->instance_count, 1);
    assert_int_equal(merged->triangle_count, 2 * TRIANGLES);
    assert_true(fabsf(shared->radius - merged->radius) < 1e-4f);
    struct kl_tracer *a = trace(shared);
    struct kl_tracer *b = trace(merged);
    check_normals(shared, 0, stretched, false);
    check_normals(shared, 1, mirrored, false);
    for (int i = 0; i < 20000; ++i) {
        const kl_vec3 o = kl_v3_scale(random_direction(&r), 6.0f);
        const kl_vec3 aim =
            kl_v3(random_range(&r, -3.0f, 3.0f), random_range(&r, -1.0f, 1.0f), 0.0f);
        const kl_ray ray = kl_ray_make(o, kl_normalize(kl_v3_sub(aim, o)), KL_INF);
        kl_hit h, g;
        kl_surface s, q;
        const int found = kl_trace_closest(&shared->view, &ray, &h);
        if (found != kl_trace_closest(&merged->view, &ray, &g) || !found) continue;
        kl_surface_at(&shared->view, &ray, &h, &s);
        kl_surface_at(&merged->view, &ray, &g, &q);
        if (fabsf(h.t - g.t) > 1e-4f) continue; /* silhouettes */
        ++hits;
        assert_int_equal(s.object, q.object);
        assert_true(kl_dot(s.smooth, q.smooth) > 0.9999f);
        assert_true(kl_length(kl_v3_sub(s.pos, q.pos)) < 1e-4f);
    }
    assert_true(hits > 5000);
    kl_tracer_destroy(a);
    kl_tracer_destroy(b);
    kl_flat_destroy(shared);
    kl_flat_destroy(merged);
    world_fini(&w);
}

/* Emissive triangles: area of the stretched sphere, power, and each triangle names its light. */
static void triangle_lights(void **state)
{
    double m[1][16];
    struct world w;
    double area = 0.0;
    (void)state;
    memcpy(m[0], mirrored, sizeof m[0]);
    world_init(&w, 1, (const double(*)[16])m);
    w.material.emission[0] = 2.0f;
    struct kl_flat *flat = flatten(&w, NULL);
    assert_int_equal(flat->light_count, TRIANGLES);
    assert_int_equal(flat->light_node_count, 2 * TRIANGLES - 1);
    assert_true(flat->view.needs & KL_NEED_EMITTERS);
    double sum = 0.0;
    for (uint32_t i = 0; i < flat->triangle_count; ++i) {
        const kl_triangle *t = &flat->triangles[i];
        const kl_light *l = &flat->lights[t->light];
        const kl_vec3 a = kl_v3_load(flat->positions + 3 * (size_t)t->v[0]);
        const kl_vec3 b = kl_v3_load(flat->positions + 3 * (size_t)t->v[1]);
        const kl_vec3 c = kl_v3_load(flat->positions + 3 * (size_t)t->v[2]);
        const float exact = 0.5f * kl_length(kl_cross(kl_v3_sub(b, a), kl_v3_sub(c, a)));
        assert_int_equal(l->triangle, i);
        assert_int_equal(flat->light_nodes[l->leaf].light, t->light);
        assert_true(fabsf(l->area - exact) < 1e-3f * exact);
        area += (double)exact;
        sum += (double)kl_light_probability(&flat->view, t->light, kl_v3(3.0f, 2.0f, 1.0f),
                                            kl_v3(-1.0f, 0.0f, 0.0f));
    }
    assert_true(sum < 1.0 + 1e-3 && sum > 0.5);
    assert_true(fabs((double)flat->light_nodes[0].power / (area * 2.0 * 0.2126) - 1.0) < 1e-3);
    kl_flat_destroy(flat);
    world_fini(&w);
}

static void environment_with(struct world *w, float *rgb, uint32_t width, uint32_t height)
{
    w->scene.environment.width = width;
    w->scene.environment.height = height;
    w->scene.environment.rgb = rgb;
}

/* Density sums to 1 over the sphere, samples follow it, and each direction lands in the texel it
 * was drawn from. */
static void environment_density(void **state)
{
    enum { WIDTH = 64, HEIGHT = 32, SAMPLES = 1 << 18 };
    static float rgb[3 * WIDTH * HEIGHT];
    static uint32_t count[WIDTH * HEIGHT];
    double m[1][16];
    struct world w;
    struct random r = {5};
    (void)state;
    for (int i = 0; i < WIDTH * HEIGHT; ++i) {
        const float v = i % 7 == 0 ? 0.0f : powf(10.0f, random_range(&r, -1.0f, 1.0f));
        for (int k = 0; k < 3; ++k) {
            rgb[3 * i + k] = v;
        }
    }
    rgb[3 * (20 * WIDTH + 11)] = 1e4f; /* a sun */
    memcpy(m[0], stretched, sizeof m[0]);
    world_init(&w, 1, (const double(*)[16])m);
    environment_with(&w, rgb, WIDTH, HEIGHT);
    struct kl_flat *flat = flatten(&w, NULL);
    assert_true(flat->view.far_count == 1 && flat->view.far_probability == 1.0f);
    double integral = 0.0;
    enum { FINE = 8 };
    for (int y = 0; y < HEIGHT * FINE; ++y) {
        for (int x = 0; x < WIDTH * FINE; ++x) {
            const double theta = 3.14159265358979 * (y + 0.5) / (HEIGHT * FINE);
            const double phi = 6.28318530717959 * ((x + 0.5) / (WIDTH * FINE) - 0.5);
            const kl_vec3 d = kl_v3((float)(sin(theta) * sin(phi)), (float)cos(theta),
                                    (float)(-sin(theta) * cos(phi)));
            integral += (double)kl_env_pdf(&flat->view, d) * sin(theta) *
                        (3.14159265 / (HEIGHT * FINE)) * (6.28318531 / (WIDTH * FINE));
        }
    }
    assert_true(fabs(integral - 1.0) < 1e-3);
    memset(count, 0, sizeof count);
    int astray = 0;
    double power = 0.0;
    for (uint32_t i = 0; i < SAMPLES; ++i) {
        const kl_vec2 u = kl_sobol_2d(i, 3);
        const uint32_t y = kl_cdf_find(flat->env_rows, HEIGHT, u.y);
        const uint32_t x = kl_cdf_find(flat->env_columns + (size_t)y * (WIDTH + 1), WIDTH, u.x);
        const kl_vec3 d = kl_env_sample(&flat->view, u);
        const uint32_t texel = kl_env_texel_at(&flat->view, kl_env_uv(d));
        const float pdf = kl_env_pdf(&flat->view, d);
        ++count[y * WIDTH + x];
        astray += texel != y * WIDTH + x;
        if (pdf > 0.0f) power += (double)kl_env_radiance(&flat->view, d).y / (double)pdf / SAMPLES;
    }
    assert_true(astray < SAMPLES / 10000);
    double exact = 0.0;
    for (int i = 0; i < WIDTH * HEIGHT; ++i) {
        const double y = i / WIDTH;
        const double band =
            cos(3.14159265358979 * y / HEIGHT) - cos(3.14159265358979 * (y + 1) / HEIGHT);
        exact += (double)rgb[3 * i + 1] * band * 6.28318530717959 / WIDTH;
        if (rgb[3 * i + 1] == 0.0f) assert_int_equal(count[i], 0);
    }
    print_message("environment: integral %.5f, power %.4f of %.4f, %d astray\n", integral, power,
                  exact, astray);
    assert_true(fabs(power / exact - 1.0) < 0.01);
    kl_flat_destroy(flat);
    world_fini(&w);
}

static void black_environment_samples_uniformly(void **state)
{
    static float rgb[3 * 8 * 4];
    double m[1][16];
    struct world w;
    (void)state;
    memcpy(m[0], stretched, sizeof m[0]);
    world_init(&w, 1, (const double(*)[16])m);
    environment_with(&w, rgb, 8, 4);
    struct kl_flat *flat = flatten(&w, NULL);
    for (uint32_t i = 0; i < 1000; ++i) {
        const float pdf = kl_env_pdf(&flat->view, kl_env_sample(&flat->view, kl_sobol_2d(i, 1)));
        assert_true(pdf > 0.0f && isfinite(pdf));
    }
    kl_flat_destroy(flat);
    world_fini(&w);
}

/* A million metres away: render space keeps every digit that the file has. */
static void far_from_the_origin(void **state)
{
    double near[1][16], far[1][16];
    struct world w;
    (void)state;
    memcpy(near[0], stretched, sizeof near[0]);
    memcpy(far[0], stretched, sizeof far[0]);
    far[0][12] += 1e6;
    far[0][13] -= 1e6;
    far[0][14] += 1e6;
    world_init(&w, 1, (const double(*)[16])near);
    struct kl_flat *a = flatten(&w, NULL);
    memcpy(w.matrices, far[0], sizeof far[0]);
    struct kl_flat *b = flatten(&w, NULL);
    for (uint32_t i = 0; i < 3 * a->vertex_count; ++i) {
        assert_true(fabsf(a->positions[i] - b->positions[i]) < 1e-6f);
        assert_true(a->normals[i] == b->normals[i]);
    }
    assert_true(fabsf(a->radius - b->radius) < 1e-5f);
    assert_true(fabs(b->origin[0] - a->origin[0] - 1e6) < 1e-6);
    struct kl_tracer *t = trace(b);
    check_normals(b, 0, far[0], false);
    kl_tracer_destroy(t);
    kl_flat_destroy(a);
    kl_flat_destroy(b);
    world_fini(&w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(merged_instances),
        cmocka_unit_test(shared_equals_merged),
        cmocka_unit_test(triangle_lights),
        cmocka_unit_test(environment_density),
        cmocka_unit_test(black_environment_samples_uniformly),
        cmocka_unit_test(far_from_the_origin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
