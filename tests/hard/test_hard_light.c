/* Hard cases 9, 11 to 13, 30, 31, 34 and the ground truths of transport: bent normals, tiny lamps,
 * blackness, skies and suns, albedo 1, sums, two planes, a radiosity cube, sphere and strip lights.
 */
#include "hard_scene.h"

#include "kernels/lights.h"
#include "src/device/gather.h"
#include "src/scene/flat.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef __FAST_MATH__
#error "compensated sums and NaN tests need IEEE arithmetic: no -ffast-math (hard case 31)"
#endif

enum { SIDE = 32 };

/* 9. Vertex normals that lean by 100 degrees: light stays finite and close to path tracing. */
static struct kl_scene *bent(double angle)
{
    struct kl_scene *s = hard_room();
    struct kl_mesh *floor = &s->meshes[0];
    for (uint32_t v = 0; v < floor->vertex_count; ++v) {
        float *n = floor->normals + 3 * (size_t)v;
        if (n[1] < 0.9f) continue;
        n[0] = (float)sin(angle);
        n[1] = (float)cos(angle);
    }
    return s;
}

static void bent_normals(void **state)
{
    static const double angles[] = {0.3, 1.75};
    (void)state;
    for (int i = 0; i < 2; ++i) {
        struct kl_image *cached = hard_image(bent(angles[i]), KL_INDIRECT_CACHE, SIDE, 16, NULL);
        struct kl_image *paths = hard_image(bent(angles[i]), KL_INDIRECT_PATH, SIDE, 512, NULL);
        double ratio;
        const double rms = hard_difference(cached, paths, "diffuse_indirect.G", &ratio);
        print_message("bent by %g: rms %.4f\n", angles[i], rms);
        hard_expect("indirect light over that of paths", ratio, 1.0, 0.03);
        kl_image_destroy(cached);
        kl_image_destroy(paths);
    }
}

/* 11. All light comes from 1e-4 sr of radiance 1e6. */
static struct kl_scene *tiny_lamp(void)
{
    struct kl_scene *s = hard_room();
    for (uint32_t i = 0; i < s->mesh_count; ++i) {
        struct kl_mesh *m = &s->meshes[i];
        if (!(s->materials[m->material].emission[0] > 0.0f)) continue;
        for (uint32_t v = 0; v < m->vertex_count; ++v) {
            m->positions[3 * v] *= 0.0125f;
            m->positions[3 * v + 2] *= 0.0125f;
        }
        for (int k = 0; k < 3; ++k)
            s->materials[m->material].emission[k] = 1e6f;
    }
    return s;
}

static void tiny_bright_lamps(void **state)
{
    struct kl_image *cached = hard_image(tiny_lamp(), KL_INDIRECT_CACHE, SIDE, 16, NULL);
    struct kl_image *paths = hard_image(tiny_lamp(), KL_INDIRECT_PATH, SIDE, 512, NULL);
    double ratio;
    const double rms = hard_difference(cached, paths, "diffuse_indirect.G", &ratio);
    (void)state;
    print_message("rms %.4f\n", rms);
    hard_expect("indirect light over that of paths", ratio, 1.0, 0.03);
    kl_image_destroy(cached);
    kl_image_destroy(paths);
}

/* 12. Nothing reflects: exactly no indirect light. Half reflects: as paths say. */
static struct kl_scene *blackened(bool all)
{
    struct kl_scene *s = hard_room();
    for (uint32_t i = all ? 0 : 1; i < s->material_count; ++i) {
        for (int k = 0; k < 3; ++k)
            s->materials[i].base_color[k] = 0.0f;
    }
    return s;
}

static void black_bodies(void **state)
{
    (void)state;
    struct kl_image *black = hard_image(blackened(true), KL_INDIRECT_CACHE, SIDE, 4, NULL);
    const struct hard_spread e = hard_measure(black, "irradiance.G");
    assert_true(e.lowest == 0.0 && e.highest == 0.0);
    struct kl_image *half = hard_image(blackened(false), KL_INDIRECT_CACHE, SIDE, 16, NULL);
    struct kl_image *paths = hard_image(blackened(false), KL_INDIRECT_PATH, SIDE, 512, NULL);
    double ratio;
    (void)hard_difference(half, paths, "diffuse_indirect.G", &ratio);
    hard_expect("half black: indirect light over that of paths", ratio, 1.0, 0.03);
    kl_image_destroy(black);
    kl_image_destroy(half);
    kl_image_destroy(paths);
}

/* 13. A plane under a uniform sky: E = pi L, no indirect light, few records. */
static void open_sky(void **state)
{
    struct kl_scene *s = hard_scene();
    uint32_t records;
    (void)state;
    hard_quad(s, hard_node(s, NULL), hard_material(s, 0.5, 0.0), (double[]){-5, 0, -5},
              (double[]){0, 0, 10}, (double[]){10, 0, 0});
    hard_sky(s, 64, 32, 2.0);
    (void)hard_camera(s, (double[]){0, 3, 0}, (double[]){0, 0, -0.01}, 1.0);
    struct kl_image *image = hard_image(s, KL_INDIRECT_CACHE, SIDE, 64, &records);
    const struct hard_spread d = hard_measure(image, "diffuse_direct.G");
    const struct hard_spread e = hard_measure(image, "irradiance.G");
    print_message("%u records\n", records);
    hard_expect("rho L", d.mean, 1.0, 0.005);
    assert_true(e.highest == 0.0);
    assert_true(records < 64);
    kl_image_destroy(image);
}

/* 34. White things under a white sky vanish: radiance 1 everywhere, whatever bounces. */
static void white_furnace(void **state)
{
    struct kl_scene *s = hard_scene();
    const uint32_t node = hard_node(s, NULL);
    const uint32_t white = hard_material(s, 1.0, 0.0);
    (void)state;
    hard_quad(s, node, white, (double[]){-5, -0.5, -5}, (double[]){0, 0, 10}, (double[]){10, 0, 0});
    hard_sphere(s, node, white, (double[]){0, 0, 0}, 0.4, 24, true, false);
    hard_sky(s, 16, 8, 1.0);
    (void)hard_camera(s, (double[]){0, 0.5, 2}, (double[]){0, -0.1, 0}, 0.6);
    struct kl_image *image = hard_image(s, KL_INDIRECT_CACHE, SIDE, 64, NULL);
    const struct hard_spread g = hard_measure(image, "G");
    hard_expect("radiance", g.mean, 1.0, 0.012);
    kl_image_destroy(image);
}

static struct kl_flat *flatten(struct kl_scene *s)
{
    struct kl_pose *pose = NULL;
    struct kl_flat *flat = NULL;
    struct kl_err err = {0};
    double origin[3];
    assert_int_equal(kl_pose_create(s, KL_NONE, 0.0, &pose, &err), KL_OK);
    assert_int_equal(kl_flat_choose_origin(s, pose, origin, &err), KL_OK);
    assert_int_equal(kl_flat_create(s, pose, origin, &flat, &err), KL_OK);
    kl_pose_destroy(pose);
    return flat;
}

/* A sun of 1e9 in a sky of 1: every texel can be sampled, densities integrate to 1. */
static void no_texel_is_lost_beside_a_sun(void **state)
{
    enum { W = 256, H = 128 };
    struct kl_scene *s = hard_scene();
    double sum = 0.0;
    uint32_t lost = 0;
    (void)state;
    hard_quad(s, hard_node(s, NULL), hard_material(s, 0.5, 0.0), (double[]){-1, 0, -1},
              (double[]){0, 0, 2}, (double[]){2, 0, 0});
    hard_sky(s, W, H, 1.0);
    for (int k = 0; k < 3; ++k)
        s->environment.rgb[3 * (40 * W + 77) + k] = 1e9f;
    struct kl_flat *flat = flatten(s);
    for (int y = 0; y < H; ++y) {
        const double theta = HARD_PI * (y + 0.5) / H;
        for (int x = 0; x < W; ++x) {
            const double phi = 2.0 * HARD_PI * ((x + 0.5) / W - 0.5);
            const kl_vec3 d = kl_v3((float)(sin(theta) * sin(phi)), (float)cos(theta),
                                    (float)(-sin(theta) * cos(phi)));
            const double pdf = (double)kl_env_pdf(&flat->view, d);
            lost += pdf > 0.0 ? 0u : 1u;
            sum += pdf * sin(theta) * (HARD_PI / H) * (2.0 * HARD_PI / W);
        }
    }
    assert_int_equal(lost, 0);
    hard_expect("integral of the density", sum, 1.0, 1e-3);
    kl_flat_destroy(flat);
    kl_scene_destroy(s);
}

/* A lamp beside one 1e8 times stronger: both can be chosen, and as often as is said. */
static void no_lamp_is_lost_beside_a_strong_one(void **state)
{
    struct kl_scene *s = hard_scene();
    const uint32_t node = hard_node(s, NULL);
    const kl_vec3 n = kl_v3(0.0f, 1.0f, 0.0f);
    uint32_t chosen[4] = {0};
    (void)state;
    for (int i = 0; i < 2; ++i) {
        hard_quad(s, node, hard_material(s, 0.0, i == 0 ? 1e8 : 1.0), (double[]){3.0 * i, 1, 0},
                  (double[]){1, 0, 0}, (double[]){0, 0, 1});
    }
    hard_quad(s, node, hard_material(s, 0.5, 0.0), (double[]){-5, 0, -5}, (double[]){0, 0, 10},
              (double[]){10, 0, 0});
    struct kl_flat *flat = flatten(s);
    const kl_vec3 p = kl_v3((float)(2.0 - flat->origin[0]), (float)-flat->origin[1],
                            (float)(0.5 - flat->origin[2]));
    assert_int_equal(flat->light_count, 4);
    for (uint32_t i = 0; i < 1u << 20; ++i) {
        float probability;
        const uint32_t light =
            kl_light_choose(&flat->view, p, n, ((float)i + 0.5f) * 0x1p-20f, &probability);
        assert_true(light < 4 && probability > 0.0f);
        ++chosen[light];
    }
    for (uint32_t i = 0; i < 4; ++i) {
        const double said = (double)kl_light_probability(&flat->view, i, p, n);
        print_message("light %u: probability %.3g, chosen %.3g\n", i, said, chosen[i] * 0x1p-20);
        assert_true(said > 1e-5);
        assert_true(fabs(chosen[i] * 0x1p-20 / said - 1.0) < 0.05);
    }
    kl_flat_destroy(flat);
    kl_scene_destroy(s);
}

/* 30. 65 536 equal terms. */
static void equal_terms_sum_up(void **state)
{
    enum { CELLS = 256 };
    struct kl_gather_tables *tables = NULL;
    struct kl_err err = {0};
    kl_gather_cell *cells = calloc(CELLS * CELLS, sizeof *cells);
    kl_gather_result out;
    (void)state;
    assert_non_null(cells);
    assert_int_equal(kl_gather_tables_create(CELLS, &tables, &err), KL_OK);
    for (int i = 0; i < CELLS * CELLS; ++i)
        cells[i] = (kl_gather_cell){.radiance = {0.1f, 0.1f, 0.1f}, .distance = 1.0f};
    kl_reduce_irradiance(cells, kl_gather_directions(tables, 0), CELLS, &out);
    hard_expect("E / (pi L)", (double)out.irr[1] / (HARD_PI * (double)0.1f), 1.0, 1e-5);
    kl_gather_tables_destroy(tables);
    free(cells);
}

/* Two planes of 1e4 : 1 that glow and reflect: L1 = (e1 + r1 e2) / (1 - r1 r2). */
static void two_planes(void **state)
{
    const double e[2] = {1.0, 0.5}, r[2] = {0.6, 0.3};
    const double wanted = (e[0] + r[0] * e[1]) / (1.0 - r[0] * r[1]);
    struct kl_scene *s = hard_scene();
    const uint32_t node = hard_node(s, NULL);
    (void)state;
    hard_quad(s, node, hard_material(s, r[0], e[0]), (double[]){-5e3, 0, -5e3},
              (double[]){0, 0, 1e4}, (double[]){1e4, 0, 0});
    hard_quad(s, node, hard_material(s, r[1], e[1]), (double[]){-5e3, 1, -5e3},
              (double[]){1e4, 0, 0}, (double[]){0, 0, 1e4});
    (void)hard_camera(s, (double[]){0, 0.9, 0}, (double[]){0, 0, 0}, 1.0);
    struct kl_image *image = hard_image(s, KL_INDIRECT_PATH, 16, 4096, NULL);
    hard_expect("radiance of the first", hard_measure(image, "G").mean, wanted, 0.01 * wanted);
    kl_image_destroy(image);
}

/* Patches of a cube [-1, 1]^3: faces -x, +x, -y, +y, -z, +z. */
enum { CUT = 12, PATCHES = 6 * CUT * CUT };

static void patch_corner(int patch, double u, double v, double out[3])
{
    const int face = patch / (CUT * CUT);
    const int axis = face / 2;
    out[axis] = face % 2 ? 1.0 : -1.0;
    out[(axis + 1) % 3] = -1.0 + 2.0 * (patch % CUT + u) / CUT;
    out[(axis + 2) % 3] = -1.0 + 2.0 * (patch / CUT % CUT + v) / CUT;
}

/* Share of the cosine-weighted hemisphere over patch i's middle that patch j fills: Lambert. */
static double form_factor(int i, int j)
{
    static const double uv[5][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 0}};
    const int axis = i / (CUT * CUT) / 2;
    double p[3], v[5][3], sum = 0.0;
    patch_corner(i, 0.5, 0.5, p);
    for (int k = 0; k < 5; ++k) {
        double length = 0.0;
        patch_corner(j, uv[k][0], uv[k][1], v[k]);
        for (int c = 0; c < 3; ++c) {
            v[k][c] -= p[c];
            length += v[k][c] * v[k][c];
        }
        for (int c = 0; c < 3; ++c)
            v[k][c] /= sqrt(length);
    }
    for (int k = 0; k < 4; ++k) {
        const int a = (axis + 1) % 3, b = (axis + 2) % 3;
        double dot = 0.0, cross[3];
        for (int c = 0; c < 3; ++c) {
            dot += v[k][c] * v[k + 1][c];
            cross[c] = v[k][(c + 1) % 3] * v[k + 1][(c + 2) % 3] -
                       v[k][(c + 2) % 3] * v[k + 1][(c + 1) % 3];
        }
        const double length =
            sqrt(cross[axis] * cross[axis] + cross[a] * cross[a] + cross[b] * cross[b]);
        if (length > 0.0) sum += atan2(length, dot) * cross[axis] / length;
    }
    return fabs(sum) / (2.0 * HARD_PI);
}

/* Mean indirect E of floor, ceiling and walls, the ceiling glowing; checks the form factors of
 * whole faces: 0.1998256 opposite, 0.2000436 beside. */
static void solve_cube(double rho, double glow, double means[3])
{
    double *f = malloc((size_t)PATCHES * PATCHES * sizeof *f);
    double *b = calloc(3 * PATCHES, sizeof *b);
    double *gathered = b + PATCHES, *emission = b + 2 * PATCHES;
    double opposite = 0.0, beside = 0.0;
    const int face = CUT * CUT;
    assert_true(f != NULL && b != NULL);
    for (int i = 0; i < PATCHES; ++i) {
        emission[i] = i / face == 3 ? glow : 0.0;
        for (int j = 0; j < PATCHES; ++j)
            f[i * PATCHES + j] = i / face == j / face ? 0.0 : form_factor(i, j);
    }
    for (int i = 2 * face; i < 3 * face; ++i) {
        for (int j = 0; j < PATCHES; ++j) {
            if (j / face == 3) opposite += f[i * PATCHES + j] / face;
            if (j / face == 4) beside += f[i * PATCHES + j] / face;
        }
    }
    hard_expect("form factor of the opposite face", opposite, 0.1998256, 5e-4);
    hard_expect("form factor of a face beside", beside, 0.2000436, 5e-4);
    for (int sweep = 0; sweep < 40; ++sweep) {
        for (int i = 0; i < PATCHES; ++i) {
            gathered[i] = 0.0;
            for (int j = 0; j < PATCHES; ++j)
                gathered[i] += f[i * PATCHES + j] * (b[j] - emission[j] * (sweep == 39));
        }
        for (int i = 0; i < PATCHES; ++i)
            b[i] = emission[i] + rho * gathered[i];
    }
    for (int k = 0; k < 3; ++k) {
        means[k] = 0.0;
        for (int i = 0; i < face; ++i) /* faces 2, 3 and 4 */
            means[k] += HARD_PI * gathered[(2 + k) * face + i] / face;
    }
    free(f);
    free(b);
}

/* A cube whose ceiling glows: means over faces as radiosity has them. */
static void radiosity_cube(void **state)
{
    const double rho = 0.5, glow = 1.0;
    double indirect[3];
    (void)state;
    solve_cube(rho, glow, indirect);
    for (int kind = 0; kind < 2; ++kind) {
        const enum kl_indirect how = kind == 0 ? KL_INDIRECT_CACHE : KL_INDIRECT_PATH;
        const double looks[3][3] = {{0, -1, 0}, {0, 1, 0}, {1, 0, 0}};
        struct kl_scene *s = hard_scene();
        const uint32_t node = hard_node(s, NULL);
        const uint32_t grey = hard_material(s, rho, 0.0);
        const uint32_t bright = hard_material(s, rho, glow);
        struct hard_stage stage;
        hard_box(s, node, grey, (double[]){-1, -1, -1}, (double[]){1, 1, 1}, true);
        /* Another ceiling takes the place of the box's. */
        struct kl_mesh *box = &s->meshes[0];
        uint32_t kept = 0;
        for (uint32_t t = 0; t < box->triangle_count; ++t) {
            const uint32_t *v = box->indices + 3 * (size_t)t;
            if (box->normals[3 * v[0] + 1] < -0.9f) continue;
            memmove(box->indices + 3 * (size_t)kept++, v, 3 * sizeof *v);
        }
        box->triangle_count = kept;
        hard_quad(s, node, bright, (double[]){-1, 1, -1}, (double[]){2, 0, 0}, (double[]){0, 0, 2});
        for (int i = 0; i < 3; ++i)
            (void)hard_camera(s, (double[]){0, 0, 0}, looks[i], HARD_PI / 2);
        hard_open(&stage, s, how, 0.02, 1024);
        for (uint32_t i = 0; i < 3; ++i) { /* every pixel shows the same area of its face */
            char what[48];
            struct kl_image *image = hard_render(&stage, i, SIDE, SIDE, kind == 0 ? 4 : 256);
            (void)snprintf(what, sizeof what, "%s, mean E of %s", kind == 0 ? "cache" : "paths",
                           i == 0   ? "floor"
                           : i == 1 ? "ceiling"
                                    : "wall");
            hard_expect(what, hard_measure(image, "irradiance.G").mean, indirect[i],
                        0.01 * indirect[i]);
            kl_image_destroy(image);
        }
        hard_close(&stage);
    }
}

/* Direct light at the middle of a small floor: of a ball, E = pi L (R / d)^2 cos(theta); of a strip
 * without end between two elevations, E = (pi L / 2) (sin b - sin a). */
static double direct_at_origin(struct kl_scene *s, const double eye[3])
{
    hard_quad(s, hard_node(s, NULL), hard_material(s, 1.0, 0.0), (double[]){-0.01, 0, -0.01},
              (double[]){0, 0, 0.02}, (double[]){0.02, 0, 0});
    (void)hard_camera(s, eye, (double[]){0, 0, 0}, 0.02);
    struct kl_image *image = hard_image(s, KL_INDIRECT_OFF, 16, 256, NULL);
    const double e = HARD_PI * hard_measure(image, "diffuse_direct.G").mean;
    kl_image_destroy(image);
    return e;
}

static void ball_and_strip_lights(void **state)
{
    const double radius = 0.5, x = 1.2, y = 1.6; /* distance 2, cosine 0.8 */
    struct kl_scene *s = hard_scene();
    (void)state;
    hard_sphere(s, hard_node(s, NULL), hard_material(s, 0.0, 1.0), (double[]){x, y, 0}, radius, 48,
                false, false);
    const double ball = HARD_PI * radius * radius / 4.0 * 0.8;
    hard_expect("ball", direct_at_origin(s, (double[]){-0.4, 0.5, 0}), ball, 0.008 * ball);
    s = hard_scene();
    hard_quad(s, hard_node(s, NULL), hard_material(s, 0.0, 1.0), (double[]){0.5, 1, -1e3},
              (double[]){1, 0, 0}, (double[]){0, 0, 2e3});
    const double strip =
        HARD_PI / 2.0 * (1.5 / sqrt(1.5 * 1.5 + 1.0) - 0.5 / sqrt(0.5 * 0.5 + 1.0));
    hard_expect("strip", direct_at_origin(s, (double[]){-0.4, 0.5, 0}), strip, 0.01 * strip);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bent_normals),
        cmocka_unit_test(tiny_bright_lamps),
        cmocka_unit_test(black_bodies),
        cmocka_unit_test(open_sky),
        cmocka_unit_test(white_furnace),
        cmocka_unit_test(no_texel_is_lost_beside_a_sun),
        cmocka_unit_test(no_lamp_is_lost_beside_a_strong_one),
        cmocka_unit_test(equal_terms_sum_up),
        cmocka_unit_test(two_planes),
        cmocka_unit_test(radiosity_cube),
        cmocka_unit_test(ball_and_strip_lights),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
