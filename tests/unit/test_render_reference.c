/* References are gathered again and again until their noise is small: by a stand-in for who
 * gathers, whose results are the truth and a known noise. */
#include "src/render/reference.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdbool.h>

enum { POINTS = 64, STEPS = 2, SIDE = 4 };
static const float truth = 2.0f;

struct stand_in {
    uint32_t calls;
    size_t asked;        /* points of all calls */
    bool full;           /* all later calls: the ladder's last step alone */
    float noise[POINTS]; /* relative, of one gather */
};

/* Uniform noise of a known standard deviation, by the seed. pos[0] is the point's number. */
static kl_status gather_noise(void *context, const struct kl_gather_job *job, struct kl_err *err)
{
    struct stand_in *s = context;
    (void)err;
    ++s->calls;
    s->asked += job->count;
    const struct kl_gather_tables *last = job->ladder.steps[job->ladder.count - 1];
    s->full = s->full && job->ladder.count == (s->calls == 1 ? STEPS : 1) && last->side == SIDE;
    for (size_t i = 0; i < job->count; ++i) {
        const float noise = s->noise[(int)job->points[i].pos[0]];
        const float off = 3.4641016f * (kl_unit_float(kl_hash(job->points[i].seed)) - 0.5f);
        for (int k = 0; k < 3; ++k) {
            job->results[i].irr[k] = truth * (1.0f + noise * off);
        }
        job->results[i].error = noise / (1.0f + noise * off); /* of what was found */
        job->results[i].side = SIDE;
    }
    return KL_OK;
}

/* Gathers at POINTS points; the root mean square of what the results are off. */
static double run(struct stand_in *s, float tolerance, kl_gather_result *results, uint64_t *rays)
{
    const struct kl_gather_tables steps[STEPS] = {{.side = SIDE / 2}, {.side = SIDE}};
    kl_gather_point points[POINTS] = {0};
    struct kl_err err = {0};
    double sum2 = 0.0;
    for (int i = 0; i < POINTS; ++i) {
        points[i].pos[0] = (float)i;
        points[i].seed = kl_hash((kl_u32)i);
    }
    const struct kl_gather_job job = {
        .ladder = {.steps = {&steps[0], &steps[1]}, .count = STEPS, .tolerance = tolerance},
        .points = points,
        .count = POINTS,
        .results = results,
    };
    s->full = true;
    *rays = 0;
    assert_int_equal(kl_reference_gather(&job, gather_noise, s, rays, &err), KL_OK);
    for (int i = 0; i < POINTS; ++i) {
        const double off = (double)results[i].irr[1] / (double)truth - 1.0;
        sum2 += off * off / POINTS;
    }
    assert_true(s->full);
    assert_int_equal(*rays, s->asked * SIDE * SIDE);
    return sqrt(sum2);
}

static void quiet_points_are_gathered_once(void **state)
{
    struct stand_in s = {0};
    kl_gather_result results[POINTS];
    uint64_t rays;
    (void)state;
    for (int i = 0; i < POINTS; ++i) {
        s.noise[i] = 0.009f;
    }
    run(&s, 0.01f, results, &rays);
    assert_int_equal(s.calls, 1);
    assert_int_equal(s.asked, POINTS);
}

/* Half of the points need four gathers, the others one. */
static void noisy_points_are_gathered_until_they_are_quiet(void **state)
{
    struct stand_in s = {0};
    kl_gather_result results[POINTS];
    uint64_t rays;
    (void)state;
    for (int i = 0; i < POINTS; ++i) {
        s.noise[i] = i % 2 ? 0.0195f : 0.0f;
    }
    const double off = run(&s, 0.01f, results, &rays);
    assert_in_range(s.asked, POINTS / 2 * 5 - 8, POINTS / 2 * 5 + 8);
    assert_true(off < 0.01 * 0.70710678 * 1.3);
    for (int i = 1; i < POINTS; i += 2) {
        assert_true(results[i].error <= 0.01f && results[i].error > 0.008f);
    }
}

/* Eight gathers are the end, with an eighth of the variance; equal runs are equal. */
static void gathers_end(void **state)
{
    kl_gather_result results[2][POINTS];
    uint64_t rays;
    double off = 0.0;
    (void)state;
    for (int k = 0; k < 2; ++k) {
        struct stand_in s = {0};
        for (int i = 0; i < POINTS; ++i) {
            s.noise[i] = 0.1f;
        }
        off = run(&s, 0.001f, results[k], &rays);
        assert_int_equal(s.calls, 8);
        assert_int_equal(s.asked, 8 * POINTS);
    }
    print_message("off %.4f, told %.4f\n", off, (double)results[0][0].error);
    assert_true(off > 0.025 && off < 0.047);
    for (int i = 0; i < POINTS; ++i) {
        const float told = results[0][i].error * results[0][i].irr[0] / truth;
        assert_true(fabsf(told / 0.0353553f - 1.0f) < 1e-3f);
        assert_true(results[0][i].irr[0] == results[1][i].irr[0]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(quiet_points_are_gathered_once),
        cmocka_unit_test(noisy_points_are_gathered_until_they_are_quiet),
        cmocka_unit_test(gathers_end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
