/* Ground truth of time: what gathers bring while the shutter is open, against Lambert's polygon
 * formula over time. */
#include "hard_scene.h"

#include "src/render/fill_points.h"
#include "src/scene/motion.h"
#include "src/trace/tracer.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { POINTS = 64, RAYS_A_SIDE = 128, INSTANTS = 64 };

/* ---- exact values ---- */

/* A rectangle parallel to the square. */
struct rectangle {
    double lo[2], hi[2], z;
};
static const struct rectangle square = {{-0.5, -0.5}, {0.5, 0.5}, 1.0};
static const struct rectangle occluder = {{-0.05, -0.08}, {0.15, 0.12}, 0.4};

/* A receiver that is turned about +Y by `angle` [rad]. */
struct receiver {
    double pos[3], angle;
};

/* Irradiance by a rectangle of radiance 1 that lies wholly above the receiver's horizon: a contour
 * integral over its edges (J. H. Lambert, "Photometria", 1760). */
static double lambert(const struct rectangle *r, const struct receiver *at)
{
    double v[4][3], sum = 0.0;
    if (!(r->hi[0] > r->lo[0] && r->hi[1] > r->lo[1])) return 0.0;
    for (int k = 0; k < 4; ++k) {
        const double x = (k == 1 || k == 2 ? r->hi[0] : r->lo[0]) - at->pos[0];
        const double z = r->z - at->pos[2];
        v[k][0] = cos(at->angle) * x - sin(at->angle) * z;
        v[k][1] = (k >= 2 ? r->hi[1] : r->lo[1]) - at->pos[1];
        v[k][2] = sin(at->angle) * x + cos(at->angle) * z;
        assert_true(v[k][2] > 0.0);
    }
    for (int k = 0; k < 4; ++k) {
        const double *a = v[k];
        const double *b = v[(k + 1) % 4];
        const double c[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                             a[0] * b[1] - a[1] * b[0]};
        const double length = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
        sum += atan2(length, a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) * c[2] / length;
    }
    return 0.5 * sum;
}

/* What the square brings past the occluder, which is moved along X: less that part of the square
 * which it hides, again a rectangle. */
static double behind(const struct receiver *at, double moved)
{
    const double scale = (square.z - at->pos[2]) / (occluder.z - at->pos[2]);
    struct rectangle hidden = {.z = square.z};
    for (int k = 0; k < 2; ++k) {
        const double shift = k == 0 ? moved : 0.0;
        hidden.lo[k] = at->pos[k] + scale * (occluder.lo[k] + shift - at->pos[k]);
        hidden.hi[k] = at->pos[k] + scale * (occluder.hi[k] + shift - at->pos[k]);
        hidden.lo[k] = fmax(hidden.lo[k], square.lo[k]);
        hidden.hi[k] = fmin(hidden.hi[k], square.hi[k]);
    }
    return lambert(&square, at) - lambert(&hidden, at);
}

/* ---- the same as a scene ---- */

/* All happens from second 0 to 1. */
struct act {
    double way;         /* [m] the occluder's, along X */
    double turn;        /* [rad] the receiver's, about +Y through `axis` */
    double slide;       /* [m] the receiver's, along X */
    double arm;         /* [m] of the receiver, from there along its own X */
    bool behind;        /* the receiver sees the occluder from behind */
    const float *times; /* of the shutter, NULL: open all the time */
};
static const double axis[3] = {0.1, 0.05, 0.0};

static struct receiver receiver_at(const struct act *act, double time)
{
    const double angle = act->turn * (time - 0.5);
    return (struct receiver){{axis[0] + act->slide * (time - 0.5) + act->arm * cos(angle), axis[1],
                              axis[2] - act->arm * sin(angle)},
                             angle};
}

static double exact(const struct act *act, double time)
{
    const struct receiver at = receiver_at(act, time);
    return behind(&at, act->way * (time - 0.5));
}

static void add_rectangle(struct kl_scene *s, uint32_t node, double albedo,
                          const struct rectangle *r, bool down)
{
    const double u[3] = {r->hi[0] - r->lo[0], 0, 0};
    const double v[3] = {0, r->hi[1] - r->lo[1], 0};
    hard_quad(s, node, hard_material(s, albedo, 0.0), (double[]){r->lo[0], r->lo[1], r->z},
              down ? v : u, down ? u : v);
}

/* The square is lit from below by a sun so low that no shadow falls on it, and shines with radiance
 * 1. All else is black. */
static struct kl_scene *scene_of(const struct act *act)
{
    static const float times[2] = {0.0f, 1.0f};
    const float half = (float)(0.25 * act->turn); /* of the angle at the ends */
    const float turns[8] = {0, -sinf(half), 0, cosf(half), 0, sinf(half), 0, cosf(half)};
    const float slides[6] = {(float)(axis[0] - 0.5 * act->slide), (float)axis[1], (float)axis[2],
                             (float)(axis[0] + 0.5 * act->slide), (float)axis[1], (float)axis[2]};
    const float ways[6] = {(float)(-0.5 * act->way), 0, 0, (float)(0.5 * act->way), 0, 0};
    const struct rectangle plate = {{act->arm - 0.05, -0.05}, {act->arm + 0.05, 0.05}, 0.0};
    const double albedo = 0.8;
    struct kl_scene *s = hard_scene();
    const uint32_t still = hard_node(s, NULL);
    const uint32_t over = hard_node(s, NULL);
    const uint32_t under = hard_node(s, NULL);

    add_rectangle(s, still, albedo, &square, true);
    add_rectangle(s, over, 0.0, &occluder, !act->behind);
    add_rectangle(s, under, 0.0, &plate, false);
    hard_sun(s, (double[]){sqrt(0.75), 0.0, 0.5}, HARD_PI / (0.5 * albedo));
    hard_animate(s, over, KL_TRANSLATION, 2, times, ways);
    hard_animate(s, under, KL_TRANSLATION, 2, times, slides);
    hard_animate(s, under, KL_ROTATION, 2, times, turns);
    return s;
}

struct made {
    struct kl_pose *pose;
    struct kl_flat *flat;
    struct kl_motion *motion;
    struct kl_tracer *tracer;
    const kl_scene_view *view;
};

/* At `time`, with the shutter open from `open` to `close`; both the same: closed. */
static void make(struct kl_scene *s, double time, const struct kl_motion_span *span, struct made *m)
{
    struct kl_err err = {0};
    double origin[3];
    *m = (struct made){0};
    kl_status st = kl_pose_create(s, KL_NONE, time, &m->pose, &err);
    if (st == KL_OK) st = kl_flat_choose_origin(s, m->pose, origin, &err);
    if (st == KL_OK) st = kl_flat_create(s, m->pose, origin, &m->flat, &err);
    if (st == KL_OK && span->close > span->open)
        st = kl_motion_create(s, KL_NONE, m->pose, m->flat, span, &m->motion, &err);
    if (st == KL_OK) {
        st = m->motion != NULL ? kl_tracer_create_moving(m->flat, m->motion, &m->tracer, &err)
                               : kl_tracer_create(m->flat, &m->tracer, &err);
    }
    if (st != KL_OK) fail_msg("%s", err.msg);
    m->view = m->motion != NULL ? &m->motion->view : &m->flat->view;
}

static void made_fini(struct made *m)
{
    kl_tracer_destroy(m->tracer);
    kl_motion_destroy(m->motion);
    kl_flat_destroy(m->flat);
    kl_pose_destroy(m->pose);
}

/* Irradiance at the receiver, from POINTS gathers at one point, and its standard error. */
struct measured {
    double mean, error;
};
static struct measured gather(const struct made *m, const struct kl_gather_tables *tables,
                              const struct receiver *at)
{
    struct kl_err err = {0};
    kl_gather_point points[POINTS];
    kl_gather_result results[POINTS];
    struct measured out = {0};
    const kl_vec3 pos =
        kl_v3((float)(at->pos[0] - m->flat->origin[0]), (float)(at->pos[1] - m->flat->origin[1]),
              (float)(at->pos[2] - m->flat->origin[2]));
    const kl_u32 n = kl_oct_encode(kl_v3((float)sin(at->angle), 0.0f, (float)cos(at->angle)));

    for (uint32_t i = 0; i < POINTS; ++i) {
        points[i] = kl_fill_gather_point(m->view, pos, n, n, 0);
        points[i].seed = kl_hash2(points[i].seed, i);
        points[i].rot_cos = cosf((float)i);
        points[i].rot_sin = sinf((float)i);
    }
    const kl_level_view none = {0};
    const struct kl_gather_job job = {.scene = m->view,
                                      .level1 = &none,
                                      .ladder = {.steps = {tables}, .count = 1},
                                      .points = points,
                                      .count = POINTS,
                                      .results = results};
    if (kl_gather_host(&job, &err) != KL_OK) fail_msg("%s", err.msg);
    for (int i = 0; i < POINTS; ++i) {
        const double e = (double)results[i].irr[1];
        out.mean += e / POINTS;
        out.error += pow((double)results[i].error * e, 2.0) / (POINTS * POINTS);
    }
    out.error = sqrt(out.error);
    return out;
}

/* ---- */

static double weight_at(const struct act *act, double time)
{
    return act->times != NULL ? 1.0 - fabs(2.0 * time - 1.0) : 1.0;
}

/* Over the shutter, each instant by how far it is open then. */
static double exact_mean(const struct act *act)
{
    double sum = 0.0, weights = 0.0;
    for (int i = 0; i < INSTANTS; ++i) {
        const double time = (i + 0.5) / INSTANTS;
        sum += weight_at(act, time) * exact(act, time);
        weights += weight_at(act, time);
    }
    return sum / weights;
}

/* How much is let pass. */
static double expect_gather(void **state, const struct act *act, const struct kl_motion_span *span,
                            double wanted)
{
    const struct receiver at = receiver_at(act, 0.5);
    struct kl_scene *s = scene_of(act);
    struct made m;

    make(s, 0.5, span, &m);
    assert_true((m.motion != NULL) == (span->close > span->open));
    const struct measured e = gather(&m, *state, &at);
    const double tolerance = 3.0 * e.error + 1e-3 * wanted;
    made_fini(&m);
    kl_scene_destroy(s);
    hard_expect("irradiance", e.mean, wanted, tolerance);
    return tolerance;
}

/* Open, the shutter shows the mean, which has to be further from its centre than is let pass. */
static void check_act(void **state, const char *what, const struct act *act)
{
    const struct kl_motion_span open = {0.0, 1.0, act->times};
    const double centre = exact(act, 0.5);
    const double mean = exact_mean(act);

    print_message("%s: centre %.6f, mean %.6f\n", what, centre, mean);
    assert_true(fabs(mean - centre) > expect_gather(state, act, &open, mean));
}

static void golden_value(void **state)
{
    const struct act still = {0};
    (void)state;
    hard_expect("Lambert's formula", exact(&still, 0.5), 0.51894851, 1e-8);
}

/* A shutter that opens for no time shows its instant. */
static void closed_shutters(void **state)
{
    const struct kl_motion_span closed = {0.5, 0.5, NULL};
    const struct act acts[2] = {{.way = 0.8}, {.turn = HARD_PI / 6.0, .arm = 0.15}};
    for (int i = 0; i < 2; ++i)
        (void)expect_gather(state, &acts[i], &closed, exact(&acts[i], 0.5));
}

static void occluders_move(void **state)
{
    check_act(state, "half its width", &(struct act){.way = 0.1});
    check_act(state, "its width", &(struct act){.way = 0.2});
    check_act(state, "four widths", &(struct act){.way = 0.8});
}

/* A sheet hides as much from behind. */
static void sheets_move(void **state)
{
    check_act(state, "seen from behind", &(struct act){.way = 0.8, .behind = true});
}

static void receivers_move(void **state)
{
    check_act(state, "sliding", &(struct act){.slide = 0.4});
    check_act(state, "turning by 30 degrees", &(struct act){.turn = HARD_PI / 6.0});
    check_act(state, "on an arm", &(struct act){.turn = HARD_PI / 6.0, .arm = 0.15});
    check_act(state, "all at once",
              &(struct act){.way = 0.4, .turn = HARD_PI / 6.0, .slide = -0.2, .arm = 0.15});
}

/* Opening and closing evenly: a triangle over time. */
static void shutters_open_slowly(void **state)
{
    float times[KL_SHUTTER_TIMES];
    for (int k = 0; k < KL_SHUTTER_TIMES; ++k) {
        const double u = (double)k / (KL_SHUTTER_TIMES - 1);
        times[k] = (float)(u < 0.5 ? sqrt(0.5 * u) : 1.0 - sqrt(0.5 * (1.0 - u)));
    }
    const struct act box = {.way = 0.8}, triangle = {.way = 0.8, .times = times};
    assert_true(fabs(exact_mean(&triangle) / exact_mean(&box) - 1.0) > 0.03);
    check_act(state, "four widths", &triangle);
    check_act(state, "turning by 30 degrees",
              &(struct act){.turn = HARD_PI / 6.0, .slide = 0.4, .times = times});
}

static int make_tables(void **state)
{
    struct kl_gather_tables *tables = NULL;
    struct kl_err err = {0};
    if (kl_gather_tables_create(RAYS_A_SIDE, &tables, &err) != KL_OK) return -1;
    *state = tables;
    return 0;
}
static int free_tables(void **state)
{
    kl_gather_tables_destroy(*state);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(golden_value),   cmocka_unit_test(closed_shutters),
        cmocka_unit_test(occluders_move), cmocka_unit_test(sheets_move),
        cmocka_unit_test(receivers_move), cmocka_unit_test(shutters_open_slowly),
    };
    return cmocka_run_group_tests(tests, make_tables, free_tables);
}
