/* Hard cases 23, 24, 26, 27 and 32: records where things move. Time 1 is a frame. */
#include "hard_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { SIDE = 24, PATHS = 512 };
static const double error = 0.05; /* and few rays: quick */
static const uint32_t rays = 256;
static const char light[] = "diffuse_indirect.G";

/* ---- helpers ---- */

/* A lit room of side 2, dark enough for light to come to rest soon; camera 0 looks in. */
static struct kl_scene *room(void)
{
    struct kl_scene *s = hard_scene();
    const uint32_t node = hard_node(s, NULL);
    hard_box(s, node, hard_material(s, 0.3, 0.0), (double[]){-1, -1, -1}, (double[]){1, 1, 1},
             true);
    hard_quad(s, node, hard_material(s, 0.0, 10.0), (double[]){-0.4, 0.98, -0.4},
              (double[]){0.8, 0, 0}, (double[]){0, 0, 0.8});
    (void)hard_camera(s, (double[]){0, 0, 0.95}, (double[]){0, -0.3, 0}, 1.4);
    return s;
}

/* The frame at `time` by paths. */
static struct kl_image *by_paths(struct kl_scene *scene, double time, double shutter)
{
    struct hard_stage stage;
    hard_begin(&stage, scene, KL_INDIRECT_PATH, error, rays, false);
    hard_go(&stage, time, shutter);
    struct kl_image *image = hard_render(&stage, 0, SIDE, SIDE, PATHS);
    hard_close(&stage);
    return image;
}

static struct kl_image *go_and_render(struct hard_stage *stage, double time, double shutter)
{
    hard_go(stage, time, shutter);
    struct kl_image *image = hard_render(stage, 0, SIDE, SIDE, 16);
    assert_int_equal(stage->bad, 0);
    return image;
}

static void expect_same(const struct kl_image *a, const struct kl_image *b)
{
    for (const char **name = (const char *[]){light, "irradiance.G", "G", NULL}; *name; ++name) {
        const float *p = kl_image_find(a, *name)->data;
        const float *q = kl_image_find(b, *name)->data;
        assert_memory_equal(p, q, (size_t)SIDE * SIDE * sizeof(float));
    }
}

/* Within `mean` on average and `rms` pixel by pixel. */
static void expect_like(const char *what, const struct kl_image *image,
                        const struct kl_image *reference, double mean, double rms)
{
    double ratio;
    const double difference = hard_difference(image, reference, light, &ratio);
    hard_expect(what, ratio, 1.0, mean);
    print_message("%s: rms %.4f, at most %.4f\n", what, difference, rms);
    assert_true(difference <= rms);
}

/* ---- 23 ---- */

/* Below the floor, through it, half of it in for a while, and where it was. */
enum { COMES = 2, STAYS = 5, GONE = 6 };
static const float pass_times[] = {0, 1, 2, 5, 6};
static const float pass_places[] = {-0.3f, -1.6f, 0.2f,  -0.15f, -0.8f, 0.2f,  0.0f, -1.1f,
                                    0.2f,  0.0f,  -1.1f, 0.2f,   -0.3f, -1.6f, 0.2f};
static const double ball_radius = 0.35;

static void add_ball(struct kl_scene *s)
{
    const uint32_t node = hard_node(s, NULL);
    hard_sphere(s, node, hard_material(s, 0.2, 0.0), (double[]){0, 0, 0}, ball_radius, 16, true,
                false);
    hard_animate(s, node, KL_TRANSLATION, 5, pass_times, pass_places);
}

/* Seen from above. */
static struct kl_scene *pass_scene(void)
{
    struct kl_scene *s = room();
    add_ball(s);
    hard_forget_cameras(s);
    (void)hard_camera(s, (double[]){0, 0.6, 0.2}, (double[]){0, -1, 0.2}, 1.0);
    return s;
}

/* Light on the floor next to the ball that stays, over that of the reference. */
static void expect_ring(const char *what, const struct kl_image *image,
                        const struct kl_image *reference, double tolerance)
{
    const double height = -1.1 + 1.0;
    const double radius = sqrt(ball_radius * ball_radius - height * height);
    const float *x = kl_image_find(reference, "P.X")->data;
    const float *y = kl_image_find(reference, "P.Y")->data;
    const float *z = kl_image_find(reference, "P.Z")->data;
    double sums[2] = {0.0, 0.0};
    int pixels = 0;

    for (size_t i = 0; i < (size_t)SIDE * SIDE; ++i) {
        const double away = hypot((double)x[i], (double)z[i] - 0.2) - radius;
        if (fabs((double)y[i] + 1.0) > 1e-3 || away < 0.01 || away > 0.15) continue;
        sums[0] += (double)kl_image_find(image, light)->data[i];
        sums[1] += (double)kl_image_find(reference, light)->data[i];
        ++pixels;
    }
    assert_true(pixels > 20);
    hard_expect(what, sums[0] / sums[1], 1.0, tolerance);
}

/* Records made in each frame anew. */
static void expect_passed_anew(const struct kl_image *paths, const struct kl_image *first)
{
    struct hard_stage stage;
    hard_begin(&stage, pass_scene(), KL_INDIRECT_CACHE, error, rays, false);
    struct kl_image *there = go_and_render(&stage, STAYS, 0.0);
    expect_like("anew, while it is there", there, paths, 0.02, 0.04);
    expect_ring("anew, next to it", there, paths, 0.03);
    struct kl_image *gone = go_and_render(&stage, GONE, 0.0);
    expect_same(gone, first);
    kl_image_destroy(there);
    kl_image_destroy(gone);
    hard_close(&stage);
}

/* Carried records show by degrees over four frames, so it takes as long until all is right. */
static void object_passes_through_a_record(void **state)
{
    struct hard_stage stage;
    struct kl_image *paths = by_paths(pass_scene(), STAYS, 0.0);
    (void)state;
    hard_begin(&stage, pass_scene(), KL_INDIRECT_CACHE, error, rays, true);
    struct kl_image *first = go_and_render(&stage, 0.0, 0.0);
    for (int frame = 1; frame <= GONE; ++frame) {
        struct kl_image *image = go_and_render(&stage, frame, 0.0);
        print_message("frame %d: %u + %u records added, %u refreshed\n", frame,
                      stage.stats.added[0], stage.stats.added[1], stage.stats.refreshed);
        if (frame == COMES) {
            expect_like("carried, as it comes", image, paths, 0.03, 0.06);
            expect_ring("carried, next to it", image, paths, 0.1);
        } else if (frame == STAYS) {
            expect_like("carried, while it is there", image, paths, 0.03, 0.05);
            expect_ring("carried, next to it", image, paths, 0.03);
        } else if (frame == GONE) {
            expect_like("carried, gone", image, first, 0.02, 0.04);
        }
        kl_image_destroy(image);
    }
    hard_close(&stage);
    expect_passed_anew(paths, first);
    kl_image_destroy(first);
    kl_image_destroy(paths);
}

/* ---- 24 ---- */

/* A bright block that shrinks to nothing and is gone from second 1 to 2. */
static void add_block(struct kl_scene *s)
{
    static const float times[] = {0, 1, 2, 3};
    static const float scales[] = {1, 1, 1, 0, 0, 0, 0, 0, 0, 1, 1, 1};
    const uint32_t node = hard_node(s, NULL);
    s->nodes[node].translation[0] = -0.68;
    s->nodes[node].translation[1] = -0.6;
    s->nodes[node].translation[2] = -0.4;
    hard_box(s, node, hard_material(s, 0.9, 0.0), (double[]){-0.3, -0.38, -0.3},
             (double[]){0.3, 0.38, 0.3}, false);
    hard_animate(s, node, KL_SCALE, 4, times, scales);
}

static struct kl_scene *toggle_scene(void)
{
    struct kl_scene *s = room();
    add_block(s);
    return s;
}

static void make_folder(char *path)
{
    (void)snprintf(path, 64, "/tmp/hard_motion_XXXXXX");
    if (mkdtemp(path) == NULL) fail_msg("no temporary folder");
}
static void remove_folder(const char *path)
{
    char command[96];
    (void)snprintf(command, sizeof command, "rm -r '%s'", path);
    assert_int_equal(system(command), 0);
}

static void surface_disappears_and_returns(void **state)
{
    struct hard_stage stage;
    char folder[64];
    (void)state;
    make_folder(folder);
    hard_begin(&stage, toggle_scene(), KL_INDIRECT_CACHE, error, rays, false);
    stage.store = folder;
    struct kl_image *there = go_and_render(&stage, 0.0, 0.0);
    const uint32_t added = stage.stats.added[0] + stage.stats.added[1];
    struct kl_image *gone = go_and_render(&stage, 1.0, 0.0);
    struct kl_image *paths = by_paths(toggle_scene(), 1.0, 0.0);
    struct kl_image *never = by_paths(room(), 0.0, 0.0);
    expect_same(paths, never);
    expect_like("gone", gone, paths, 0.02, 0.04);
    struct kl_image *back = go_and_render(&stage, 3.0, 0.0);
    print_message("%u records added, %u when it is back\n", added,
                  stage.stats.added[0] + stage.stats.added[1]);
    assert_true(added > 0 && stage.stats.added[0] + stage.stats.added[1] == 0);
    expect_same(back, there);
    kl_image_destroy(there);
    kl_image_destroy(gone);
    kl_image_destroy(paths);
    kl_image_destroy(never);
    kl_image_destroy(back);
    hard_close(&stage);
    remove_folder(folder);
}

/* ---- 26 ---- */

static const float squash_times[] = {0, 1};
static const float squash_scales[] = {1, 1, 1, 1.5f, 0.375f, 1.5f}; /* 1 : 4 in the end */

static struct kl_scene *squash_furnace(void)
{
    struct kl_scene *s = hard_scene();
    const uint32_t still = hard_node(s, NULL);
    const uint32_t node = hard_node(s, NULL);
    const uint32_t glow = hard_material(s, 0.5, 1.0);
    hard_box(s, still, glow, (double[]){-2, -2, -2}, (double[]){2, 2, 2}, true);
    hard_sphere(s, node, glow, (double[]){0, 0, 0}, 0.8, 16, true, false);
    hard_animate(s, node, KL_SCALE, 2, squash_times, squash_scales);
    (void)hard_camera(s, (double[]){1.2, 1.0, 1.9}, (double[]){0, 0, 0}, 0.9);
    return s;
}

static void add_squashed(struct kl_scene *s)
{
    const uint32_t node = hard_node(s, NULL);
    s->nodes[node].translation[0] = -0.1;
    s->nodes[node].translation[1] = -0.3;
    s->nodes[node].translation[2] = 0.2;
    hard_sphere(s, node, hard_material(s, 0.7, 0.0), (double[]){0, 0, 0}, 0.25, 16, true, false);
    hard_box(s, node, hard_material(s, 0.3, 0.0), (double[]){0.3, -0.2, -0.2},
             (double[]){0.6, 0.3, 0.2}, false);
    hard_animate(s, node, KL_SCALE, 2, squash_times, squash_scales);
}

static struct kl_scene *squash_scene(void)
{
    struct kl_scene *s = room();
    add_squashed(s);
    return s;
}

/* All surfaces glow and reflect half: E = pi without their own light. */
static void expect_furnace(struct hard_stage *stage, double time, double shutter)
{
    struct kl_image *image = go_and_render(stage, time, shutter);
    const struct hard_spread e = hard_measure(image, "irradiance.G");
    print_message("time %g: lowest %.4f pi, highest %.4f pi\n", time, e.lowest / HARD_PI,
                  e.highest / HARD_PI);
    hard_expect("E / pi", e.mean / HARD_PI, 1.0, 0.01);
    assert_true(e.deviation < 0.02 * HARD_PI);
    kl_image_destroy(image);
}

static void squash_and_stretch_over_time(void **state)
{
    struct hard_stage stage;
    (void)state;
    hard_begin(&stage, squash_furnace(), KL_INDIRECT_CACHE, 0.02, 16 * rays, false);
    expect_furnace(&stage, 1.0, 0.0);
    expect_furnace(&stage, 0.5, 1.0); /* all of it while the shutter is open */
    hard_close(&stage);
}

static void squash_and_stretch_in_a_room(void **state)
{
    struct hard_stage stage;
    struct kl_image *paths = by_paths(squash_scene(), 1.0, 0.0);
    (void)state;
    hard_begin(&stage, squash_scene(), KL_INDIRECT_CACHE, error, rays, true);
    kl_image_destroy(go_and_render(&stage, 0.0, 0.0));
    kl_image_destroy(go_and_render(&stage, 0.5, 0.0));
    struct kl_image *image = go_and_render(&stage, 1.0, 0.0);
    assert_true(stage.stats.refreshed > 0);
    expect_like("carried", image, paths, 0.03, 0.06);
    kl_image_destroy(image);
    kl_image_destroy(paths);
    hard_close(&stage);
}

/* ---- 23, 24, 26 while the shutter is open ---- */

static struct kl_scene *blurred_scene(void)
{
    struct kl_scene *s = room();
    add_ball(s);
    add_block(s);
    add_squashed(s);
    return s;
}

/* The block has no size at all when the shutter closes, and the ball goes through the floor. */
static void all_of_them_in_a_blur(void **state)
{
    struct hard_stage stage;
    struct kl_image *paths = by_paths(blurred_scene(), 0.75, 0.5);
    (void)state;
    hard_begin(&stage, blurred_scene(), KL_INDIRECT_CACHE, error, rays, false);
    struct kl_image *image = go_and_render(&stage, 0.75, 0.5);
    expect_like("blurred", image, paths, 0.02, 0.07);
    kl_image_destroy(image);
    kl_image_destroy(paths);
    hard_close(&stage);
}

/* ---- 27 ---- */

/* A block in the middle of the room becomes a ball: one grows as the other vanishes. */
static struct kl_scene *swap_scene(void)
{
    static const float times[] = {0.0f, 0.45f, 0.55f, 1.0f};
    static const float out[] = {1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0};
    static const float in[] = {0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1};
    struct kl_scene *s = room();
    const uint32_t white = hard_material(s, 0.8, 0.0);
    for (int k = 0; k < 2; ++k) {
        const uint32_t node = hard_node(s, NULL);
        s->nodes[node].translation[0] = -0.2;
        s->nodes[node].translation[1] = -0.6;
        s->nodes[node].translation[2] = 0.35;
        hard_animate(s, node, KL_SCALE, 4, times, k == 0 ? out : in);
        if (k == 0) {
            hard_box(s, node, white, (double[]){-0.25, -0.25, -0.25}, (double[]){0.25, 0.25, 0.25},
                     false);
        } else {
            hard_sphere(s, node, white, (double[]){0, 0, 0}, 0.3, 16, true, false);
        }
    }
    return s;
}

/* Right, and without the cost of a new cache: records of other things live. */
static void topology_changes(void **state)
{
    struct hard_stage stage;
    struct kl_image *paths = by_paths(swap_scene(), 1.0, 0.0);
    (void)state;
    hard_begin(&stage, swap_scene(), KL_INDIRECT_CACHE, error, rays, true);
    kl_image_destroy(go_and_render(&stage, 0.0, 0.0));
    const uint32_t before = stage.stats.added[0] + stage.stats.added[1];
    struct kl_image *image = go_and_render(&stage, 1.0, 0.0);
    const uint32_t added = stage.stats.added[0] + stage.stats.added[1];
    expect_like("carried", image, paths, 0.02, 0.05);
    kl_image_destroy(image);
    kl_image_destroy(paths);
    hard_close(&stage);
    print_message("%u records, then %u added\n", before, added);
    assert_true(added < before / 2);
}

/* ---- 32 ---- */

/* Two closed boxes with a common wall, seen from within. The one on the right, whose lamp is a
 * 100th as bright, slides along the other with its camera, number 0; lamps stand still. `both`: the
 * bright one's lamp is lit. */
static struct kl_scene *boxes_scene(bool both)
{
    static const float times[] = {0, 2};
    static const float ways[] = {0, 0, 0, 0, 0, 0.4f};
    struct kl_scene *s = hard_scene();
    const uint32_t grey = hard_material(s, 0.3, 0.0);
    const uint32_t lamps[2] = {hard_material(s, 0.0, both ? 10.0 : 0.0),
                               hard_material(s, 0.0, 0.1)};
    const uint32_t still = hard_node(s, NULL);
    for (int k = 1; k >= 0; --k) {
        const uint32_t node = hard_node(s, NULL);
        const double x = k == 0 ? -2.0 : 0.0;
        hard_box(s, node, grey, (double[]){x, -1, -1}, (double[]){x + 2, 1, 1}, true);
        hard_quad(s, still, lamps[k], (double[]){x + 0.6, 0.9, -0.4}, (double[]){0.8, 0, 0},
                  (double[]){0, 0, 0.8});
        const uint32_t camera =
            hard_camera(s, (double[]){k == 0 ? -1.5 : 1.5, 0, 0.8}, (double[]){0, -0.2, 0}, 1.2);
        s->nodes[s->cameras[camera].node].parent = node;
        if (k == 1) hard_animate(s, node, KL_TRANSLATION, 2, times, ways);
    }
    return s;
}

/* Not 3 % more or less than paths on average, nor anywhere brighter by 1 % of the bright box. Paths
 * do without its lamp: they would only lose samples to it. So do the few pixels for which paths had
 * to help the cache out, which are left out. */
static void expect_dim(const struct kl_image *dim, const struct kl_image *paths, double bright)
{
    const float *late = kl_image_find(dim, "cache.late")->data;
    const float *a = kl_image_find(dim, light)->data;
    const float *b = kl_image_find(paths, light)->data;
    double sums[2] = {0.0, 0.0}, worst = 0.0;
    uint32_t pixels = 0;

    for (size_t i = 0; i < (size_t)SIDE * SIDE; ++i) {
        if (late[i] > 0.0f) continue;
        sums[0] += (double)a[i];
        sums[1] += (double)b[i];
        worst = fmax(worst, (double)(a[i] - b[i]) / bright);
        ++pixels;
    }
    print_message("%u pixels, dim over bright %.4f, too bright by %.4f of it at most\n", pixels,
                  sums[0] / pixels / bright, worst);
    hard_expect("dim box", sums[0] / sums[1], 1.0, 0.03);
    assert_true(pixels > 3 * SIDE * SIDE / 4 && worst < 0.01);
    assert_true(sums[0] / pixels < 0.02 * bright);
}

/* The bright one is seen first, so its records are there. How many records were carried to here and
 * brought up to date. */
static uint32_t check_boxes(struct hard_stage *stage, double time, double shutter)
{
    hard_go(stage, time, shutter);
    struct kl_image *bright = hard_render(stage, 1, SIDE, SIDE, 16);
    const uint32_t refreshed = stage->stats.refreshed;
    struct kl_image *dim = hard_render(stage, 0, SIDE, SIDE, 16);
    struct kl_image *paths = by_paths(boxes_scene(false), time, shutter);
    expect_dim(dim, paths, hard_measure(bright, light).mean);
    kl_image_destroy(bright);
    kl_image_destroy(dim);
    kl_image_destroy(paths);
    return refreshed;
}

static void touching_boxes_one_moves(void **state)
{
    struct hard_stage stage;
    (void)state;
    hard_begin(&stage, boxes_scene(true), KL_INDIRECT_CACHE, error, rays, true);
    for (int frame = 0; frame <= 2; ++frame) {
        const uint32_t refreshed = check_boxes(&stage, frame, 0.0);
        assert_true((refreshed > 0) == (frame > 0));
    }
    hard_close(&stage);
}

static void touching_boxes_in_a_blur(void **state)
{
    struct hard_stage stage;
    (void)state;
    hard_begin(&stage, boxes_scene(true), KL_INDIRECT_CACHE, error, rays, false);
    (void)check_boxes(&stage, 1.0, 0.5);
    hard_close(&stage);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(object_passes_through_a_record),
        cmocka_unit_test(surface_disappears_and_returns),
        cmocka_unit_test(squash_and_stretch_over_time),
        cmocka_unit_test(squash_and_stretch_in_a_room),
        cmocka_unit_test(all_of_them_in_a_blur),
        cmocka_unit_test(topology_changes),
        cmocka_unit_test(touching_boxes_one_moves),
        cmocka_unit_test(touching_boxes_in_a_blur),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
