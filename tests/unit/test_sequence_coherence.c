/* Frame coherence of made-up sequences whose flicker, pops and lag are known. */
#include "sequences/coherence.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>

enum { WIDTH = 64, HEIGHT = 48, PIXELS = WIDTH * HEIGHT, FRAMES = 16 };

/* What a pixel shows, from its place [pixels] and the frame. */
struct scene {
    double (*test)(double x, double y, uint32_t t);
    double (*reference)(double x, double y, uint32_t t); /* or NULL */
    double speed[2];                                     /* of the camera [pixels / frame] */
    double (*cover)(uint32_t t); /* or NULL: left edge of a nearer object, 8 pixels wide */
};

struct buffers {
    float test[PIXELS], reference[PIXELS], motion[2][PIXELS], depth[PIXELS], position[3][PIXELS];
    uint32_t ids[PIXELS];
};

static bool is_covered(const struct scene *s, uint32_t x, uint32_t t)
{
    if (s->cover == NULL) return false;
    const double left = s->cover(t);
    return x + 0.5 >= left && x + 0.5 < left + 8.0;
}

static void draw(const struct scene *s, uint32_t t, struct buffers *b)
{
    for (uint32_t i = 0; i < PIXELS; ++i) {
        const uint32_t px = i % WIDTH;
        const double x = px + 0.5 + s->speed[0] * t;
        const double y = i / WIDTH + 0.5 + s->speed[1] * t;
        const bool covered = is_covered(s, px, t);
        b->test[i] = covered ? 5.0f : (float)s->test(x, y, t);
        b->reference[i] = covered ? 5.0f : s->reference != NULL ? (float)s->reference(x, y, t) : 0;
        b->depth[i] = covered ? 2.0f : 4.0f;
        b->ids[i] = covered;
        b->motion[0][i] = (float)s->speed[0];
        b->motion[1][i] = (float)s->speed[1];
        if (covered && t > 0) {
            b->motion[0][i] = (float)(s->cover(t - 1) - s->cover(t));
            b->motion[1][i] = 0.0f;
        }
        b->position[0][i] = (float)x;
        b->position[1][i] = (float)y;
        b->position[2][i] = covered ? (float)t : 0.0f; /* moves: not at rest */
    }
}

/* The coherence object is the caller's, as the result borrows from it. */
static struct kl_coherence *run(const struct scene *s, struct kl_coherence_result *out)
{
    struct buffers *buffers = calloc(2, sizeof *buffers);
    struct kl_coherence *c = NULL;
    struct kl_err err = {0};

    assert_non_null(buffers);
    assert_int_equal(kl_coherence_create(WIDTH, HEIGHT, FRAMES, &c, &err), KL_OK);
    for (uint32_t t = FRAMES; t-- > 0;) {
        struct buffers *b = &buffers[t % 2];
        draw(s, t, b);
        struct kl_coherence_frame frame = {
            .test = {b->test, b->test, b->test},
            .motion = {b->motion[0], b->motion[1]},
            .depth = b->depth,
            .ids = b->ids,
            .position = {b->position[0], b->position[1], b->position[2]}};
        for (int k = 0; s->reference != NULL && k < 3; ++k)
            frame.reference[k] = b->reference;
        assert_int_equal(kl_coherence_add(c, &frame, &err), KL_OK);
    }
    assert_int_equal(kl_coherence_finish(c, out, &err), KL_OK);
    free(buffers);
    return c;
}

static void expect(double value, double wanted, double tolerance)
{
    if (!(fabs(value - wanted) <= tolerance)) {
        fail_msg("%.9g is not %.9g +- %g", value, wanted, tolerance);
    }
}

static double ramp(double x, double y, uint32_t t)
{
    (void)t;
    return 1.0 + 0.01 * x + 0.02 * y;
}

static double alternating(double x, double y, uint32_t t)
{
    return ramp(x, y, t) * (t % 2 ? 1.005 : 0.995);
}

/* A square of one block jumps by 10 % in frame 6. */
static double popping(double x, double y, uint32_t t)
{
    return t >= 6 && x >= 16 && x < 32 && y >= 16 && y < 32 ? 1.1 : 1.0;
}

static double one(double x, double y, uint32_t t)
{
    (void)x, (void)y, (void)t;
    return 1.0;
}

static double step_at_5(double x, double y, uint32_t t)
{
    (void)x, (void)y;
    return t >= 5 ? 2.0 : 1.0;
}

static double step_at_7(double x, double y, uint32_t t)
{
    return step_at_5(x, y, t >= 2 ? t - 2 : 0);
}

static double brighter(double x, double y, uint32_t t)
{
    return 1.25 * step_at_5(x, y, t);
}

static double sliding(uint32_t t)
{
    return 4.0 + 2.0 * t;
}

static void nothing_happens(void **state)
{
    const struct scene scene = {.test = ramp, .reference = ramp};
    struct kl_coherence_result r;
    struct kl_coherence *c = run(&scene, &r);
    (void)state;
    expect(r.flicker_mean, 0.0, 1e-12);
    expect(r.followed, 1.0, 0.0);
    expect(r.t_relmse, 0.0, 1e-12);
    expect(r.high_band_rms, 0.0, 1e-9);
    assert_int_equal(r.pops, 0);
    assert_int_equal(r.points, (WIDTH - 2) * (HEIGHT - 2));
    assert_int_equal(r.block_steps, 12 * (FRAMES - 1));
    assert_true(isnan(r.lag_frames)); /* the reference does not change */
    assert_true(isnan(r.heat[0]));    /* at the border neighbours are missing */
    expect((double)r.heat[WIDTH + 1], 0.0, 1e-7);
    kl_coherence_destroy(c);
}

/* A surface whose light is linear on the screen passes by, 0.3 and 0.7 pixels a frame. */
static void a_moving_camera_is_no_flicker(void **state)
{
    const struct scene scene = {.test = ramp, .reference = ramp, .speed = {0.3, -0.7}};
    struct kl_coherence_result r;
    struct kl_coherence *c = run(&scene, &r);
    (void)state;
    expect(r.flicker_mean, 0.0, 1e-6);
    expect(r.flicker_p99, 0.0, 1e-6);
    expect(r.t_relmse, 0.0, 1e-12);
    expect(r.steps[FRAMES - 1].step, 0.0, 1e-6);
    assert_int_equal(r.pops, 0);
    assert_true(r.followed > 0.85 && r.followed < 1.0);
    kl_coherence_destroy(c);
}

static void alternation_is_flicker(void **state)
{
    const struct scene scene = {.test = alternating, .reference = ramp};
    const double deviation = 0.005 * sqrt(FRAMES / (FRAMES - 1.0));
    struct kl_coherence_result r;
    struct kl_coherence *c = run(&scene, &r);
    (void)state;
    expect(r.flicker_mean, deviation, 1e-5);
    expect(r.flicker_p99, deviation, 1e-5);
    expect((double)r.heat[20 * WIDTH + 20], deviation, 1e-5);
    expect(r.reference_flicker_mean, 0.0, 1e-9);
    expect(r.high_band_rms, 0.005, 1e-4); /* all of it at half the frame rate */
    expect(r.steps[3].step, 0.01, 1e-4);
    expect(r.steps[3].reference_step, 0.0, 1e-9);
    assert_int_equal(r.pops, 0); /* steps of 1 % */
    kl_coherence_destroy(c);
}

static void a_jump_is_a_pop(void **state)
{
    struct scene scene = {.test = popping, .reference = one};
    struct kl_coherence_result r;
    struct kl_coherence *c = run(&scene, &r);
    (void)state;
    assert_int_equal(r.pops, 1);
    assert_int_equal(r.steps[6].pops, 1);
    expect(r.steps[6].t_mse, 0.01 * 256 / PIXELS, 1e-6);
    expect(r.t_mse, 0.01 * 256 / PIXELS / (FRAMES - 1), 1e-7);
    expect(r.t_relmse, r.t_mse / 1.01, 1e-7);
    kl_coherence_destroy(c);
    scene.reference = NULL;
    c = run(&scene, &r);
    assert_int_equal(r.pops, 1);
    assert_true(isnan(r.t_relmse) && isnan(r.lag_frames) && isnan(r.high_band_rms));
    kl_coherence_destroy(c);
    scene.reference = popping; /* which the reference has, too */
    c = run(&scene, &r);
    assert_int_equal(r.pops, 0);
    expect(r.t_mse, 0.0, 1e-12);
    kl_coherence_destroy(c);
}

/* A wrong but constant factor is no temporal error beyond the step itself. */
static void a_late_step_is_lag(void **state)
{
    struct scene scene = {.test = step_at_7, .reference = step_at_5};
    struct kl_coherence_result r;
    struct kl_coherence *c = run(&scene, &r);
    (void)state;
    expect(r.lag_frames, 2.0, 1e-9);
    expect(r.lag_correlation, 1.0, 1e-9);
    assert_int_equal(r.pops, 2 * 12);
    kl_coherence_destroy(c);
    scene.test = brighter;
    c = run(&scene, &r);
    expect(r.lag_frames, 0.0, 1e-9);
    kl_coherence_destroy(c);
}

/* An object slides over the surface: what it uncovers is not compared with it. */
static void disocclusion_is_left_out(void **state)
{
    const struct scene scene = {.test = ramp, .reference = ramp, .cover = sliding};
    struct kl_coherence_result r;
    struct kl_coherence *c = run(&scene, &r);
    (void)state;
    expect(r.flicker_mean, 0.0, 1e-9);
    expect(r.t_relmse, 0.0, 1e-12);
    expect(r.steps[8].step, 0.0, 1e-9);
    assert_int_equal(r.pops, 0);
    assert_true(r.followed < 1.0 - 2.0 / WIDTH + 1e-9); /* two columns appear in every frame */
    kl_coherence_destroy(c);
}

static void bad_calls_are_refused(void **state)
{
    struct kl_coherence *c = NULL;
    struct kl_coherence_result r;
    struct kl_err err = {0};
    (void)state;
    assert_int_equal(kl_coherence_create(8, 8, 1, &c, &err), KL_ERR_USAGE);
    assert_int_equal(kl_coherence_create(8, 8, 2, &c, &err), KL_OK);
    assert_int_equal(kl_coherence_finish(c, &r, &err), KL_ERR_USAGE);
    kl_coherence_destroy(c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_happens),        cmocka_unit_test(a_moving_camera_is_no_flicker),
        cmocka_unit_test(alternation_is_flicker), cmocka_unit_test(a_jump_is_a_pop),
        cmocka_unit_test(a_late_step_is_lag),     cmocka_unit_test(disocclusion_is_left_out),
        cmocka_unit_test(bad_calls_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
