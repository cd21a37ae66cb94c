/* Hard cases 5, 6, 28: the same scene at scales 1e-4 to 1e6, far from the origin, and rays that
 * leave the surfaces they start on. */
#include "hard_scene.h"

#include "kernels/surface.h"
#include "src/scene/flat.h"
#include "src/trace/tracer.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>

enum { SIDE = 32, SPP = 8 };
static const double nowhere[3] = {0, 0, 0};

static struct kl_image *moved_room(double scale, const double offset[3], uint32_t *records)
{
    struct kl_scene *scene = hard_room();
    hard_move(scene, scale, offset);
    return hard_image(scene, KL_INDIRECT_CACHE, SIDE, SPP, records);
}

static void expect_same(const struct kl_image *image, uint32_t records, const struct kl_image *one,
                        uint32_t records_one, const char *what)
{
    double ratio;
    const double rms = hard_difference(image, one, "G", &ratio);
    print_message("%s: %u records, rms %.4f\n", what, records, rms);
    hard_expect("mean over the mean at scale 1", ratio, 1.0, 0.005);
    hard_expect("records over those at scale 1", (double)records / records_one, 1.0, 0.02);
    assert_true(rms < 0.05); /* noise of 8 samples, which are the same, and of other records */
}

static void room_at_all_scales(void **state)
{
    static const double scales[] = {1e-4, 1e-2, 1e2, 1e4, 1e6};
    uint32_t records_one, records;
    struct kl_image *one = moved_room(1.0, nowhere, &records_one);
    (void)state;
    for (size_t i = 0; i < sizeof scales / sizeof scales[0]; ++i) {
        char what[32];
        (void)snprintf(what, sizeof what, "scale %g", scales[i]);
        struct kl_image *image = moved_room(scales[i], nowhere, &records);
        expect_same(image, records, one, records_one, what);
        kl_image_destroy(image);
    }
    kl_image_destroy(one);
}

static void room_far_away(void **state)
{
    const double far[3] = {1e6, -1e6, 1e6};
    uint32_t records_one, records;
    struct kl_image *one = moved_room(1.0, nowhere, &records_one);
    struct kl_image *image = moved_room(1.0, far, &records);
    (void)state;
    expect_same(image, records, one, records_one, "offset 1e6");
    kl_image_destroy(image);
    kl_image_destroy(one);
}

/* All is radiance 1: emission 0.5 and albedo 0.5, a ball in a box, at every scale. */
static void furnace_at_all_scales(void **state)
{
    (void)state;
    for (double scale = 1e-4; scale < 2e6; scale *= 1e5) {
        struct kl_scene *s = hard_scene();
        const uint32_t node = hard_node(s, NULL);
        const uint32_t glow = hard_material(s, 0.5, 0.5);
        hard_box(s, node, glow, (double[]){-1, -1, -1}, (double[]){1, 1, 1}, true);
        hard_sphere(s, node, glow, (double[]){0.2, -0.3, -0.4}, 0.4, 16, true, false);
        (void)hard_camera(s, (double[]){0, 0, 0.9}, (double[]){0, 0, 0}, 1.2);
        hard_move(s, scale, nowhere);
        struct kl_image *image = hard_image(s, KL_INDIRECT_CACHE, SIDE, 32, NULL);
        const struct hard_spread g = hard_measure(image, "G");
        const struct hard_spread e = hard_measure(image, "diffuse_indirect.G");
        print_message("scale %g\n", scale);
        hard_expect("furnace", g.mean, 1.0, 0.004);
        hard_expect("its indirect part", e.mean, 0.25, 0.25 * 0.012);
        kl_image_destroy(image);
    }
}

static uint32_t hash_of(uint32_t *state)
{
    return *state = *state * 747796405u + 2891336453u;
}
static double uniform(uint32_t *state)
{
    return (double)(hash_of(state) >> 8) * 0x1p-24;
}

/* Rays at a sphere beside the middle of the scene: from the hit, outward, nothing is ever met. */
static uint32_t count_self_hits(double radius)
{
    struct kl_scene *s = hard_scene();
    const uint32_t node = hard_node(s, NULL);
    const uint32_t grey = hard_material(s, 0.5, 0.0);
    struct kl_pose *pose = NULL;
    struct kl_flat *flat = NULL;
    struct kl_tracer *tracer = NULL;
    struct kl_err err = {0};
    double origin[3];
    uint32_t random = 1, hits = 0;
    hard_sphere(s, node, grey, (double[]){0.37 * radius, -0.21 * radius, 0.11 * radius}, radius, 64,
                false, false);
    const kl_status made = kl_pose_create(s, KL_NONE, 0.0, &pose, &err);
    assert_int_equal(made, KL_OK);
    assert_int_equal(kl_flat_choose_origin(s, pose, origin, &err), KL_OK);
    origin[0] -= 2.0 * radius; /* so that not every coordinate is as good as it gets */
    assert_int_equal(kl_flat_create(s, pose, origin, &flat, &err), KL_OK);
    assert_int_equal(kl_tracer_create(flat, &tracer, &err), KL_OK);
    for (int i = 0; i < 20000; ++i) {
        kl_vec3 v[2];
        for (int k = 0; k < 2; ++k) {
            const float z = (float)(2.0 * uniform(&random) - 1.0);
            const float p = (float)(2.0 * HARD_PI * uniform(&random));
            const float r = sqrtf(fmaxf(0.0f, 1.0f - z * z));
            v[k] = kl_v3(r * cosf(p), r * sinf(p), z);
        }
        const kl_vec3 center =
            kl_v3((float)(0.37 * radius - origin[0]), (float)(-0.21 * radius - origin[1]),
                  (float)(0.11 * radius - origin[2]));
        const kl_vec3 eye = kl_v3_mad(center, (float)(3.0 * radius), v[0]);
        const kl_ray ray = kl_ray_make(eye, kl_v3_scale(v[0], -1.0f), KL_INF);
        kl_hit hit;
        kl_surface surface;
        if (!kl_intersect(&flat->view, &ray, 0, &hit)) continue;
        kl_surface_at(&flat->view, &ray, &hit, &surface);
        kl_vec3 out = v[1];
        if (kl_dot(out, surface.geometric) < 0.0f) out = kl_v3_scale(out, -1.0f);
        if (kl_dot(out, surface.geometric) < 1e-4f) continue;
        const kl_ray away =
            kl_ray_make(kl_leave_surface(&flat->view, surface.pos, surface.geometric), out, KL_INF);
        hits += kl_trace_any(&flat->view, &away) != 0;
    }
    kl_tracer_destroy(tracer);
    kl_flat_destroy(flat);
    kl_pose_destroy(pose);
    kl_scene_destroy(s);
    return hits;
}

static void no_surface_meets_itself(void **state)
{
    (void)state;
    for (double radius = 1e-4; radius < 2e6; radius *= 10.0) {
        const uint32_t hits = count_self_hits(radius);
        print_message("radius %g: %u of 20000 rays meet the sphere they leave\n", radius, hits);
        assert_int_equal(hits, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_surface_meets_itself),
        cmocka_unit_test(room_at_all_scales),
        cmocka_unit_test(room_far_away),
        cmocka_unit_test(furnace_at_all_scales),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
