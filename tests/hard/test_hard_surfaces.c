/* Hard cases 1 to 3, 7, 8, 10, 14, 16, 25, 26, 29, 33, 35, 40: surfaces that are thin, cracked,
 * doubled, curved, mirrored, endless or not there. */
#include "hard_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { SIDE = 32 };

static const float *data_of(const struct kl_image *image, const char *channel)
{
    const struct kl_channel *c = kl_image_find(image, channel);
    assert_non_null(c);
    return c->data;
}

/* Sum of SIDE pixels, `step` apart. */
static double line(const float *pixel, int step)
{
    double sum = 0.0;
    for (int i = 0; i < SIDE; ++i)
        sum += (double)pixel[i * step];
    return sum;
}

/* 1. The edge between floor and wall, seen from near: no bright or dark seam. */
static struct kl_scene *corner(void)
{
    struct kl_scene *s = hard_room();
    hard_forget_cameras(s);
    (void)hard_camera(s, (double[]){0.5, -0.7, -0.7}, (double[]){0.5, -1, -1}, 0.9);
    return s;
}

static void corners_have_no_seam(void **state)
{
    struct kl_image *cached = hard_image(corner(), KL_INDIRECT_CACHE, SIDE, 16, NULL);
    struct kl_image *paths = hard_image(corner(), KL_INDIRECT_PATH, SIDE, 1024, NULL);
    const float *e = data_of(cached, "diffuse_indirect.G");
    const float *r = data_of(paths, "diffuse_indirect.G");
    double worst = 0.0;
    (void)state;
    /* Rows of the image run along the edge: noise averages out, a seam does not. */
    for (int y = 0; y < SIDE; ++y) {
        worst = fmax(worst, fabs(line(e + y * SIDE, 1) / line(r + y * SIDE, 1) - 1.0));
    }
    hard_expect("worst row", worst, 0.0, 0.03);
    kl_image_destroy(cached);
    kl_image_destroy(paths);
}

/* 2. A dark box in bright sky with a crack of 1e-4 along an edge. */
static void cracks_do_not_spread(void **state)
{
    struct kl_scene *s = hard_scene();
    const uint32_t node = hard_node(s, NULL);
    const uint32_t grey = hard_material(s, 0.5, 0.0);
    const double faces[5][3][3] = {
        {{-1, -1, -1}, {2, 0, 0}, {0, 2, 0}}, {{-1, -1, 1}, {0, 2, 0}, {2, 0, 0}},
        {{-1, -1, -1}, {0, 2, 0}, {0, 0, 2}}, {{-1, -1, -1}, {0, 0, 2}, {2, 0, 0}},
        {{-1, 1, -1}, {2, 0, 0}, {0, 0, 2}},
    };
    uint32_t leaking = 0;
    (void)state;
    for (int i = 0; i < 5; ++i)
        hard_quad(s, node, grey, faces[i][0], faces[i][1], faces[i][2]);
    hard_quad(s, node, grey, (double[]){1, -1, -1}, (double[]){0, 0, 2},
              (double[]){0, 2 - 1e-4, 0}); /* ends below the ceiling */
    hard_sky(s, 8, 4, 1.0);
    (void)hard_camera(s, (double[]){-0.8, -0.2, 0.8}, (double[]){1, 0.5, -0.5}, 1.3);
    struct kl_image *image = hard_image(s, KL_INDIRECT_CACHE, 64, 4, NULL);
    const float *e = data_of(image, "irradiance.G");
    for (int i = 0; i < 64 * 64; ++i)
        leaking += (double)e[i] > 0.01 * HARD_PI;
    print_message("%u of 4096 pixels leak\n", leaking);
    assert_true(leaking <= 4);
    kl_image_destroy(image);
}

/* 3. The floor twice, in the same place and one ulp apart: as if it were there once. */
static struct kl_scene *doubled(int how)
{
    struct kl_scene *s = hard_room();
    const double height = how == 2 ? (double)nextafterf(-1.0f, 0.0f) : -1.0;
    if (how > 0) {
        hard_quad(s, hard_node(s, NULL), 0, (double[]){-1, height, -1}, (double[]){0, 0, 2},
                  (double[]){2, 0, 0});
    }
    return s;
}

static void doubled_faces_are_one(void **state)
{
    struct kl_image *once = hard_image(doubled(0), KL_INDIRECT_CACHE, SIDE, 8, NULL);
    (void)state;
    for (int how = 1; how <= 2; ++how) {
        struct kl_image *twice = hard_image(doubled(how), KL_INDIRECT_CACHE, SIDE, 8, NULL);
        double ratio, direct;
        (void)hard_difference(twice, once, "diffuse_direct.G", &direct);
        const double rms = hard_difference(twice, once, "diffuse_indirect.G", &ratio);
        print_message("%s: rms %.4f\n", how == 1 ? "no gap" : "one ulp", rms);
        hard_expect("direct light", direct, 1.0, 0.002);
        hard_expect("indirect light", ratio, 1.0, 0.005);
        assert_true(rms < 0.06);
        kl_image_destroy(twice);
    }
    kl_image_destroy(once);
}

/* 7, 29. A bright room and a dark one behind a wall of 1e-2 and 1e-4 (property.test_leak: 1e-3 and
 * 1e-5). */
static void thin_walls_stop_light(void **state)
{
    (void)state;
    for (double wall = 1e-2; wall > 0.9e-4; wall *= 0.01) {
        struct kl_scene *s = hard_scene();
        const uint32_t node = hard_node(s, NULL);
        const uint32_t grey = hard_material(s, 0.7, 0.0);
        const uint32_t lamp = hard_material(s, 0.0, 10.0);
        hard_box(s, node, grey, (double[]){-2, -1, -1}, (double[]){0, 1, 1}, true);
        hard_box(s, node, grey, (double[]){wall, -1, -1}, (double[]){2 + wall, 1, 1}, true);
        hard_quad(s, node, lamp, (double[]){-1.4, 0.9, -0.4}, (double[]){0.8, 0, 0},
                  (double[]){0, 0, 0.8});
        (void)hard_camera(s, (double[]){-1.5, 0, 0.8}, (double[]){0, -0.2, 0}, 1.2);
        (void)hard_camera(s, (double[]){1.5, 0, 0.8}, (double[]){0, -0.2, 0}, 1.2);
        struct hard_stage stage;
        hard_open(&stage, s, KL_INDIRECT_CACHE, 0.02, 1024);
        struct kl_image *bright = hard_render(&stage, 0, SIDE, SIDE, 4);
        struct kl_image *dark = hard_render(&stage, 1, SIDE, SIDE, 4); /* from the same cache */
        const struct hard_spread b = hard_measure(bright, "G");
        const struct hard_spread d = hard_measure(dark, "G");
        print_message("wall %g: bright %.3f, dark %.3g, worst %.3g\n", wall, b.mean, d.mean,
                      d.highest);
        assert_true(d.mean < 1e-4 * b.mean);
        assert_true(d.highest < 1e-2 * b.mean);
        kl_image_destroy(bright);
        kl_image_destroy(dark);
        hard_close(&stage);
    }
}

/* 29. Two sheets 5 mm apart, seen from beside their rim: the slot between them is dark, though what
 * lies so little above it is not, and looks the same way. */
static struct kl_scene *layers(void)
{
    struct kl_scene *s = hard_scene();
    const uint32_t node = hard_node(s, NULL);
    const uint32_t grey = hard_material(s, 0.5, 0.0);
    const uint32_t lamp = hard_material(s, 0.0, 10.0);
    hard_box(s, node, grey, (double[]){-1, -1, -1}, (double[]){1, 1, 1}, true);
    hard_quad(s, node, lamp, (double[]){-0.4, 0.98, -0.4}, (double[]){0.8, 0, 0},
              (double[]){0, 0, 0.8});
    hard_quad(s, node, grey, (double[]){-1, -1, -0.505}, (double[]){1, 0, 0}, (double[]){0, 2, 0});
    hard_quad(s, node, grey, (double[]){-1, -1, -0.5}, (double[]){1, 0, 0}, (double[]){0, 2, 0});
    (void)hard_camera(s, (double[]){0.8, 0, 0.4}, (double[]){0, 0, -0.5}, 0.4);
    return s;
}

static void layers_stay_apart(void **state)
{
    struct kl_image *cached = hard_image(layers(), KL_INDIRECT_CACHE, SIDE, 16, NULL);
    struct kl_image *paths = hard_image(layers(), KL_INDIRECT_PATH, SIDE, 1024, NULL);
    const struct hard_spread light = hard_measure(paths, "diffuse_indirect.G");
    const float *e = data_of(cached, "diffuse_indirect.G");
    const float *r = data_of(paths, "diffuse_indirect.G");
    double worst = 0.0;
    (void)state;
    /* Columns run along the rim. */
    for (int x = 0; x < SIDE; ++x) {
        worst = fmax(worst, fabs(line(e + x, SIDE) - line(r + x, SIDE)) / SIDE);
    }
    hard_expect("worst column over the mean", worst / light.mean, 0.0, 0.05);
    kl_image_destroy(cached);
    kl_image_destroy(paths);
}

/* 8. A ball of 2 to 2000 pixels in a furnace: as flat as the rest. */
static void curved_surfaces_are_flat_in_a_furnace(void **state)
{
    static const double radii[] = {2, 20, 200, 2000}; /* [pixels] */
    (void)state;
    for (size_t i = 0; i < sizeof radii / sizeof radii[0]; ++i) {
        struct kl_scene *s = hard_scene();
        const uint32_t node = hard_node(s, NULL);
        const uint32_t glow = hard_material(s, 0.5, 0.5);
        const double distance = 0.5;
        const double pixel = 2.0 * distance * tan(0.4) / SIDE;
        const double r = fmin(radii[i] * pixel, 40.0);
        hard_box(s, node, glow, (double[]){-1, -1, -1 - 2 * r}, (double[]){1, 1, 1}, true);
        hard_sphere(s, node, glow, (double[]){0, 0, 0.5 - distance - r}, r, 48, true, false);
        (void)hard_camera(s, (double[]){0, 0, 0.5}, (double[]){0, 0, 0}, 0.8);
        struct hard_stage stage;
        hard_open(&stage, s, KL_INDIRECT_CACHE, 0.05, 1024);
        struct kl_image *image = hard_render(&stage, 0, SIDE, SIDE, 16);
        const struct hard_spread g = hard_measure(image, "diffuse_indirect.G");
        print_message("%g pixels: indirect %.4f, deviation %.4f, %.4f to %.4f\n", radii[i], g.mean,
                      g.deviation, g.lowest, g.highest);
        hard_expect("mean", g.mean, 0.25, 0.25 * 0.02);
        assert_true(g.deviation < 0.25 * 0.03);
        kl_image_destroy(image);
        hard_close(&stage);
    }
}

/* 8, 40. A ball of few flat triangles with smooth normals on a lit floor, against path tracing. */
static struct kl_scene *low_poly(void)
{
    struct kl_scene *s = hard_scene();
    const uint32_t node = hard_node(s, NULL);
    const uint32_t grey = hard_material(s, 0.7, 0.0);
    const uint32_t lamp = hard_material(s, 0.0, 10.0);
    hard_box(s, node, grey, (double[]){-2, -1, -2}, (double[]){2, 3, 2}, true);
    hard_sphere(s, node, grey, (double[]){0, 0, 0}, 0.8, 5, true, false);
    hard_quad(s, node, lamp, (double[]){-1, 2.9, -1}, (double[]){0.7, 0, 0}, (double[]){0, 0, 0.7});
    (void)hard_camera(s, (double[]){0, 0.3, 1.9}, (double[]){0, -0.1, 0}, 1.0);
    return s;
}

static void shadow_terminators_have_no_blotches(void **state)
{
    struct kl_image *cached = hard_image(low_poly(), KL_INDIRECT_CACHE, SIDE, 16, NULL);
    struct kl_image *paths = hard_image(low_poly(), KL_INDIRECT_PATH, SIDE, 1024, NULL);
    double ratio;
    const double rms = hard_difference(cached, paths, "diffuse_indirect.G", &ratio);
    (void)state;
    hard_expect("indirect light over that of paths", ratio, 1.0, 0.02);
    hard_expect("rms", rms, 0.0, 0.12);
    kl_image_destroy(cached);
    kl_image_destroy(paths);
}

/* A canopy over a floor that shines bluntly under a low sun: light is thrown forward, in under the
 * canopy. */
static struct kl_scene *low_sun(void)
{
    struct kl_scene *s = hard_scene();
    const uint32_t node = hard_node(s, NULL);
    const uint32_t grey = hard_material(s, 0.5, 0.0);
    const uint32_t floor = hard_material(s, 0.2, 0.0);
    s->materials[floor].roughness = 0.5f;
    s->materials[floor].specular = 1.0f;
    for (int k = 0; k < 3; ++k)
        s->materials[floor].specular_color[k] = 1.0f;
    hard_quad(s, node, floor, (double[]){-4, 0, -4}, (double[]){0, 0, 8}, (double[]){6, 0, 0});
    hard_quad(s, node, grey, (double[]){0, 1, -2}, (double[]){2, 0, 0}, (double[]){0, 0, 4});
    hard_sun(s, (double[]){0.94, -0.341174, 0}, 10.0);
    (void)hard_camera(s, (double[]){-0.4, 0.2, 0}, (double[]){1, 1, 0}, 0.7);
    return s;
}

static void blunt_lobes_keep_their_direction(void **state)
{
    struct kl_image *cached = hard_image(low_sun(), KL_INDIRECT_CACHE, SIDE, 4, NULL);
    struct kl_image *paths = hard_image(low_sun(), KL_INDIRECT_PATH, SIDE, 1024, NULL);
    double ratio;
    const double rms = hard_difference(cached, paths, "diffuse_indirect.G", &ratio);
    (void)state;
    hard_expect("indirect light over that of paths", ratio, 1.0, 0.02);
    hard_expect("rms", rms, 0.0, 0.05);
    kl_image_destroy(cached);
    kl_image_destroy(paths);
}

/* 10. A floor to the horizon: fewer records than pixels. */
static void grazing_views_stay_finite(void **state)
{
    struct kl_scene *s = hard_scene();
    const uint32_t node = hard_node(s, NULL);
    const uint32_t grey = hard_material(s, 0.5, 0.0);
    uint32_t records;
    (void)state;
    hard_quad(s, node, grey, (double[]){-1e4, 0, -1e4}, (double[]){0, 0, 2e4},
              (double[]){2e4, 0, 0});
    hard_box(s, node, grey, (double[]){-1, 0, -6}, (double[]){1, 2, -4}, false);
    hard_sky(s, 8, 4, 1.0);
    (void)hard_camera(s, (double[]){0, 0.5, 0}, (double[]){0, 0.5, -1}, 1.0);
    struct kl_image *image = hard_image(s, KL_INDIRECT_CACHE, 64, 4, &records);
    const struct hard_spread g = hard_measure(image, "G");
    print_message("%u records for 4096 pixels, mean %.4f\n", records, g.mean);
    assert_true(records < 2 * 4096); /* both levels */
    assert_true(isfinite(g.mean) && g.mean > 0.3 && g.highest < 1.0);
    kl_image_destroy(image);
}

/* 14. Nothing there: black, or the sky. */
static void nothing_is_black(void **state)
{
    (void)state;
    for (int sky = 0; sky < 2; ++sky) {
        for (int how = KL_INDIRECT_CACHE; how <= KL_INDIRECT_OFF; ++how) {
            struct kl_scene *s = hard_scene();
            (void)hard_camera(s, (double[]){0, 0, 1}, (double[]){0, 0, 0}, 1.0);
            if (sky) hard_sky(s, 4, 2, 0.5);
            struct kl_image *image = hard_image(s, (enum kl_indirect)how, 8, 2, NULL);
            for (int i = 0; i < 64; ++i) {
                assert_true(fabsf(data_of(image, "G")[i] - (sky ? 0.5f : 0.0f)) < 1e-6f);
                assert_true(data_of(image, "A")[i] == 0.0f);
            }
            kl_image_destroy(image);
        }
    }
}

/* 16. From inside a solid block: dark, finite, and soon done. */
static void inside_of_solids_is_dark(void **state)
{
    struct kl_scene *s = hard_room();
    struct hard_stage stage;
    (void)state;
    hard_forget_cameras(s);
    (void)hard_camera(s, (double[]){0.4, -0.7, 0.2}, (double[]){0.4, -0.7, 0}, 1.2);
    hard_open(&stage, s, KL_INDIRECT_CACHE, 0.1, 256);
    struct kl_image *image = hard_render(&stage, 0, SIDE, SIDE, 4);
    const struct hard_spread g = hard_measure(image, "G");
    assert_int_equal(stage.bad, 0);
    print_message("inside: %g to %g\n", g.lowest, g.highest);
    /* Of millions of path vertices one may round onto an edge, and its ray starts outside. */
    assert_true(g.highest < 1e-6 && g.lowest >= 0.0);
    kl_image_destroy(image);
    hard_close(&stage);
}

/* 25, 26. The same block made by its transform (mirrored; squashed and sheared) and by its
 * vertices. */
static struct kl_scene *transformed(const double m[16], bool by_node)
{
    struct kl_scene *s = hard_room();
    const double identity[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    const uint32_t node = hard_node(s, by_node ? m : identity);
    const uint32_t grey = hard_material(s, 0.5, 0.0);
    const double det = m[0] * (m[5] * m[10] - m[6] * m[9]) - m[4] * (m[1] * m[10] - m[2] * m[9]) +
                       m[8] * (m[1] * m[6] - m[2] * m[5]);
    hard_sphere(s, node, grey, (double[]){0, 0, 0}, 0.3, 12, false, false);
    struct kl_mesh *mesh = &s->meshes[s->mesh_count - 1];
    for (uint32_t v = 0; !by_node && v < mesh->vertex_count; ++v) {
        float *p = mesh->positions + 3 * (size_t)v;
        const double q[3] = {(double)p[0], (double)p[1], (double)p[2]};
        for (int k = 0; k < 3; ++k)
            p[k] = (float)(m[k] * q[0] + m[4 + k] * q[1] + m[8 + k] * q[2] + m[12 + k]);
    }
    for (uint32_t t = 0; !by_node && t < mesh->triangle_count; ++t) {
        uint32_t *v = mesh->indices + 3 * (size_t)t;
        if (det < 0.0) {
            const uint32_t swap = v[1];
            v[1] = v[2];
            v[2] = swap;
        }
        double e[2][3], n[3], length = 0.0;
        for (int k = 0; k < 3; ++k) {
            for (int i = 0; i < 2; ++i) {
                e[i][k] = (double)mesh->positions[3 * v[i + 1] + (uint32_t)k] -
                          (double)mesh->positions[3 * v[0] + (uint32_t)k];
            }
        }
        for (int k = 0; k < 3; ++k) {
            n[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] - e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
            length += n[k] * n[k];
        }
        for (int i = 0; i < 3; ++i) {
            for (int k = 0; k < 3; ++k)
                mesh->normals[3 * v[i] + (uint32_t)k] = (float)(n[k] / sqrt(length));
        }
    }
    return s;
}

static void transforms_equal_vertices(void **state)
{
    static const double mirrored[16] = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -0.3, 0.2, 0.1, 1};
    static const double squashed[16] = {1.5, 0,   0, 0, 0.5,  0.3, 0,   0,
                                        0,   0.2, 1, 0, -0.3, 0.2, 0.1, 1};
    const double *const maps[2] = {mirrored, squashed};
    (void)state;
    for (int i = 0; i < 2; ++i) {
        struct kl_image *a =
            hard_image(transformed(maps[i], true), KL_INDIRECT_CACHE, SIDE, 8, NULL);
        struct kl_image *b =
            hard_image(transformed(maps[i], false), KL_INDIRECT_CACHE, SIDE, 8, NULL);
        double ratio;
        const double rms = hard_difference(a, b, "G", &ratio);
        print_message("%s: rms %.4f\n", i == 0 ? "mirrored" : "squashed", rms);
        hard_expect("mean", ratio, 1.0, 0.003);
        assert_true(rms < 0.04);
        kl_image_destroy(a);
        kl_image_destroy(b);
    }
}

/* 33. Two shots with a cut between them: one fill serves both. */
static void cuts_are_filled_for(void **state)
{
    struct kl_scene *s = hard_room();
    struct hard_stage stage;
    struct kl_camera cameras[2];
    struct kl_fill_stats stats;
    struct kl_err err = {0};
    (void)state;
    (void)hard_camera(s, (double[]){0.8, 0.6, -0.8}, (double[]){-0.5, -0.8, 0.5}, 1.0);
    hard_open(&stage, s, KL_INDIRECT_CACHE, 0.1, 256);
    for (uint32_t i = 0; i < 2; ++i) {
        assert_int_equal(kl_renderer_camera(stage.renderer, i, 0.0, SIDE, SIDE, &cameras[i], &err),
                         KL_OK);
    }
    const struct kl_renderer_fill fill = {.cameras = cameras, .camera_count = 2};
    assert_int_equal(kl_renderer_fill(stage.renderer, &fill, &stats, &err), KL_OK);
    for (uint32_t i = 0; i < 2; ++i) {
        const struct kl_renderer_frame frame = {
            .camera = cameras[i], .before = cameras[1 - i], .frame = i, .spp = 4};
        struct kl_image *image = NULL;
        struct kl_counts counts;
        uint64_t bad;
        assert_int_equal(kl_image_create(SIDE, SIDE, &image, &err), KL_OK);
        assert_int_equal(kl_frame_add_layers(image, "all", &err), KL_OK);
        assert_int_equal(kl_renderer_frame(stage.renderer, &frame, image, &counts, &bad, &err),
                         KL_OK);
        const double late = (double)counts.late / (4.0 * SIDE * SIDE);
        print_message("shot %u: %.4f of the samples late\n", i, late);
        assert_true(late < 0.05);
        kl_image_destroy(image);
    }
    hard_close(&stage);
}

/* 35. A leaf lit from one side: its other side has records of its own, and stays dark. */
static void sides_have_records_of_their_own(void **state)
{
    struct kl_scene *s = hard_scene();
    const uint32_t node = hard_node(s, NULL);
    const uint32_t white = hard_material(s, 0.8, 0.0);
    const uint32_t black = hard_material(s, 0.0, 0.0);
    const uint32_t lamp = hard_material(s, 0.0, 10.0);
    struct hard_stage stage;
    (void)state;
    hard_box(s, node, black, (double[]){-1, -1, -2}, (double[]){1, 1, 2}, true);
    hard_quad(s, node, white, (double[]){-1, -1, 0}, (double[]){2, 0, 0}, (double[]){0, 2, 0});
    hard_quad(s, node, white, (double[]){-1, -0.9, 0}, (double[]){0, 0, 2}, (double[]){2, 0, 0});
    hard_quad(s, node, lamp, (double[]){-0.4, 0.9, 0.5}, (double[]){0.8, 0, 0},
              (double[]){0, 0, 0.8});
    (void)hard_camera(s, (double[]){0, 0, 1.8}, (double[]){0, 0, 0}, 0.8);
    (void)hard_camera(s, (double[]){0, 0, -1.8}, (double[]){0, 0, 0}, 0.8);
    hard_open(&stage, s, KL_INDIRECT_CACHE, 0.1, 256);
    struct kl_image *lit = hard_render(&stage, 0, SIDE, SIDE, 4);
    struct kl_image *dark = hard_render(&stage, 1, SIDE, SIDE, 4);
    const struct hard_spread l = hard_measure(lit, "irradiance.G");
    const struct hard_spread d = hard_measure(dark, "irradiance.G");
    print_message("lit side E %.4f, other side %.4g at most\n", l.mean, d.highest);
    assert_true(l.mean > 0.05);
    assert_true(d.highest < 1e-3 * l.mean);
    kl_image_destroy(lit);
    kl_image_destroy(dark);
    hard_close(&stage);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(corners_have_no_seam),
        cmocka_unit_test(cracks_do_not_spread),
        cmocka_unit_test(doubled_faces_are_one),
        cmocka_unit_test(thin_walls_stop_light),
        cmocka_unit_test(layers_stay_apart),
        cmocka_unit_test(curved_surfaces_are_flat_in_a_furnace),
        cmocka_unit_test(shadow_terminators_have_no_blotches),
        cmocka_unit_test(blunt_lobes_keep_their_direction),
        cmocka_unit_test(grazing_views_stay_finite),
        cmocka_unit_test(nothing_is_black),
        cmocka_unit_test(inside_of_solids_is_dark),
        cmocka_unit_test(transforms_equal_vertices),
        cmocka_unit_test(cuts_are_filled_for),
        cmocka_unit_test(sides_have_records_of_their_own),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
