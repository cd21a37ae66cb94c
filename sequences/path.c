#include "sequences/path.h"

#include "src/base/file.h"
#include "src/base/memory.h"

#include <jansson.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_KEYS = 100000, MAX_BYTES = 64 << 20 };

static const double pi = 3.14159265358979323846;
static const double largest = 1e9; /* of times and coordinates: squares stay far from overflow */

struct key {
    double time;
    struct kl_look pose;
};

struct kl_path {
    bool smooth;
    size_t count;
    struct key *keys;
};

/* ---- vectors ---- */

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double distance(const double a[3], const double b[3])
{
    const double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};

    return sqrt(dot(d, d));
}

static void mix(const double a[3], const double b[3], double t, double out[3])
{
    for (int i = 0; i < 3; ++i)
        out[i] = (1.0 - t) * a[i] + t * b[i];
}

/* Sine of the angle between `up` (unit) and the view; 0 where there is no view. */
static double tilt(const struct kl_look *p, const double up[3])
{
    const double d[3] = {p->target[0] - p->eye[0], p->target[1] - p->eye[1],
                         p->target[2] - p->eye[2]};
    const double cross[3] = {d[1] * up[2] - d[2] * up[1], d[2] * up[0] - d[0] * up[2],
                             d[0] * up[1] - d[1] * up[0]};
    const double length = sqrt(dot(d, d));

    return length > 0.0 ? sqrt(dot(cross, cross)) / length : 0.0;
}

/* ---- reading ---- */

struct reader {
    const char *name;
    double fps;
    size_t index; /* of the key at hand */
    struct kl_err *err;
};

static kl_status fail_key(const struct reader *r, const char *member, const char *expected)
{
    return kl_fail(r->err, KL_ERR_INPUT, "%s: keys[%zu].%s: expected %s", r->name, r->index, member,
                   expected);
}

static bool number_get(const json_t *value, double *out)
{
    if (!json_is_number(value)) return false;
    *out = json_number_value(value);
    return isfinite(*out) && fabs(*out) <= largest;
}

static kl_status read_vector(const struct reader *r, const json_t *key, const char *member,
                             double out[3])
{
    const json_t *value = json_object_get(key, member);

    if (!json_is_array(value) || json_array_size(value) != 3) {
        return fail_key(r, member, "three numbers");
    }
    for (size_t i = 0; i < 3; ++i) {
        if (!number_get(json_array_get(value, i), &out[i])) {
            return fail_key(r, member, "three numbers below 1e9");
        }
    }
    return KL_OK;
}

static kl_status read_time(const struct reader *r, const json_t *key, double *out)
{
    const json_t *time = json_object_get(key, "time");
    const json_t *frame = json_object_get(key, "frame");

    if ((time == NULL) == (frame == NULL)) {
        return fail_key(r, "time", "either \"time\" or \"frame\"");
    }
    if (!number_get(time != NULL ? time : frame, out)) {
        return fail_key(r, time != NULL ? "time" : "frame", "a number below 1e9");
    }
    if (frame != NULL) *out /= r->fps;
    return KL_OK;
}

static kl_status read_up(const struct reader *r, const json_t *key, struct kl_look *pose)
{
    kl_status st = KL_OK;

    memcpy(pose->up, (const double[3]){0.0, 1.0, 0.0}, sizeof pose->up);
    if (json_object_get(key, "up") != NULL) st = read_vector(r, key, "up", pose->up);
    if (st != KL_OK) return st;
    const double length = sqrt(dot(pose->up, pose->up));
    if (!(length > 1e-9)) return fail_key(r, "up", "a direction, found 0");
    for (int i = 0; i < 3; ++i)
        pose->up[i] /= length;
    if (tilt(pose, pose->up) < 1e-6) {
        return fail_key(r, "up", "a direction that is not along the view");
    }
    return KL_OK;
}

/* A misspelt member would be ignored in silence: refuse it. */
static kl_status check_members(const struct reader *r, json_t *object, const char *const *known,
                               const char *place)
{
    const char *member = NULL;
    json_t *value = NULL;

    json_object_foreach(object, member, value)
    {
        size_t i = 0;
        while (known[i] != NULL && strcmp(known[i], member) != 0)
            ++i;
        if (known[i] == NULL) {
            return kl_fail(r->err, KL_ERR_INPUT, "%s: %s: unknown member \"%.60s\"", r->name, place,
                           member);
        }
    }
    return KL_OK;
}

static kl_status read_key(const struct reader *r, json_t *value, struct key *out)
{
    static const char *const known[] = {"time", "frame", "eye", "target", "up", "yfov_deg", NULL};
    char place[40];

    (void)snprintf(place, sizeof place, "keys[%zu]", r->index);
    if (!json_is_object(value)) {
        return kl_fail(r->err, KL_ERR_INPUT, "%s: %s: expected an object", r->name, place);
    }
    kl_status st = check_members(r, value, known, place);
    if (st == KL_OK) st = read_time(r, value, &out->time);
    if (st == KL_OK) st = read_vector(r, value, "eye", out->pose.eye);
    if (st == KL_OK) st = read_vector(r, value, "target", out->pose.target);
    if (st != KL_OK) return st;
    if (distance(out->pose.eye, out->pose.target) < 1e-9) {
        return fail_key(r, "target", "a point other than the eye");
    }
    st = read_up(r, value, &out->pose);
    if (st != KL_OK) return st;
    const json_t *yfov = json_object_get(value, "yfov_deg");
    if (yfov == NULL) return KL_OK;
    double degrees = 0.0;
    if (!number_get(yfov, &degrees) || !(degrees > 0.0 && degrees < 180.0)) {
        return fail_key(r, "yfov_deg", "degrees between 0 and 180");
    }
    out->pose.yfov = degrees * (pi / 180.0);
    return KL_OK;
}

static kl_status read_keys(struct reader *r, const json_t *keys, struct kl_path *path)
{
    const size_t count = json_array_size(keys);

    if (!json_is_array(keys) || count == 0 || count > MAX_KEYS) {
        return kl_fail(r->err, KL_ERR_INPUT, "%s: keys: expected a list of 1 to %d keys", r->name,
                       MAX_KEYS);
    }
    kl_status st = kl_alloc_array(&path->keys, count, sizeof *path->keys, r->err);
    for (size_t i = 0; i < count && st == KL_OK; ++i) {
        struct key *key = &path->keys[i];
        r->index = i;
        st = read_key(r, json_array_get(keys, i), key);
        if (st != KL_OK) return st;
        if (i > 0 && !(key->time > key[-1].time)) {
            return fail_key(r, "time", "a later time than the key before");
        }
        if (i > 0 && (key->pose.yfov > 0.0) != (key[-1].pose.yfov > 0.0)) {
            return fail_key(r, "yfov_deg", "it on every key or on none");
        }
        path->count = i + 1;
    }
    return st;
}

static kl_status read_root(struct reader *r, json_t *root, struct kl_path *path)
{
    static const char *const known[] = {"fps", "interpolation", "keys", NULL};

    if (!json_is_object(root)) {
        return kl_fail(r->err, KL_ERR_INPUT, "%s: expected an object", r->name);
    }
    kl_status st = check_members(r, root, known, "top level");
    if (st != KL_OK) return st;
    const json_t *fps = json_object_get(root, "fps");
    if (fps != NULL && (!number_get(fps, &r->fps) || !(r->fps >= 0.001))) {
        return kl_fail(r->err, KL_ERR_INPUT, "%s: fps: expected a number of at least 0.001",
                       r->name);
    }
    const json_t *interpolation = json_object_get(root, "interpolation");
    const char *text = json_string_value(interpolation);
    path->smooth = interpolation == NULL || (text != NULL && strcmp(text, "smooth") == 0);
    if (!path->smooth && (text == NULL || strcmp(text, "linear") != 0)) {
        return kl_fail(r->err, KL_ERR_INPUT, "%s: interpolation: expected \"linear\" or \"smooth\"",
                       r->name);
    }
    return read_keys(r, json_object_get(root, "keys"), path);
}

kl_status kl_path_parse(const char *text, size_t size, const char *name, double fps,
                        struct kl_path **out, struct kl_err *err)
{
    struct reader reader = {.name = name, .fps = fps, .err = err};
    struct kl_path *path = NULL;
    json_error_t where;
    json_t *root = NULL;

    if (!(fps > 0.0)) return kl_fail(err, KL_ERR_USAGE, "%s: fps %g is not above 0", name, fps);
    kl_status st = kl_alloc_array(&path, 1, sizeof *path, err);
    if (st != KL_OK) return st;
    root = json_loadb(text, size, JSON_REJECT_DUPLICATES, &where);
    if (root == NULL) {
        st = kl_fail(err, KL_ERR_INPUT, "%s: line %d, column %d: %s", name, where.line,
                     where.column, where.text);
    } else {
        st = read_root(&reader, root, path);
    }
    json_decref(root);
    if (st != KL_OK) {
        kl_path_destroy(path);
        return st;
    }
    *out = path;
    return KL_OK;
}

kl_status kl_path_load(const char *file, double fps, struct kl_path **out, struct kl_err *err)
{
    char *text = NULL;
    size_t size = 0;
    kl_status st = kl_file_read(file, MAX_BYTES, &text, &size, err);

    if (st != KL_OK) return st;
    st = kl_path_parse(text, size, file, fps, out, err);
    free(text);
    return st;
}

void kl_path_destroy(struct kl_path *path)
{
    if (path == NULL) return;
    free(path->keys);
    free(path);
}

void kl_path_range(const struct kl_path *path, double *first, double *last)
{
    *first = path->keys[0].time;
    *last = path->keys[path->count - 1].time;
}

/* ---- evaluating ---- */

/* Centripetal Catmull-Rom between p[1] and p[2], u in [0, 1], by the pyramid of Barry and Goldman:
 * "A Recursive Evaluation Algorithm for a Class of Catmull-Rom Splines", 1988. Knots are the square
 * roots of the distances: no loops or overshoot (Yuksel et al. 2011). */
static void spline(const double *const p[4], double u, double out[3])
{
    double k[4] = {0.0};
    double a[3][3];
    double b[2][3];
    const double step = sqrt(distance(p[1], p[2]));

    if (!(step > 1e-9)) { /* the camera rests */
        mix(p[1], p[2], u, out);
        return;
    }
    for (int i = 0; i < 3; ++i) {
        const double d = sqrt(distance(p[i], p[i + 1]));
        k[i + 1] = k[i] + (d > 1e-6 * step ? d : step);
    }
    const double t = k[1] + u * (k[2] - k[1]);
    for (int i = 0; i < 3; ++i)
        mix(p[i], p[i + 1], (t - k[i]) / (k[i + 1] - k[i]), a[i]);
    for (int i = 0; i < 2; ++i)
        mix(a[i], a[i + 1], (t - k[i]) / (k[i + 2] - k[i]), b[i]);
    mix(b[0], b[1], (t - k[1]) / (k[2] - k[1]), out);
}

/* The point beyond an end: the mirror image of the neighbour. */
static void mirror(const double end[3], const double neighbour[3], double out[3])
{
    for (int i = 0; i < 3; ++i)
        out[i] = 2.0 * end[i] - neighbour[i];
}

static void interpolate(const struct kl_path *path, size_t i, double u, bool eye, double out[3])
{
    const double *p[4];
    double before[3];
    double after[3];
    const struct key *keys = path->keys;

    p[1] = eye ? keys[i].pose.eye : keys[i].pose.target;
    p[2] = eye ? keys[i + 1].pose.eye : keys[i + 1].pose.target;
    if (!path->smooth) {
        mix(p[1], p[2], u, out);
        return;
    }
    if (i > 0) {
        p[0] = eye ? keys[i - 1].pose.eye : keys[i - 1].pose.target;
    } else {
        mirror(p[1], p[2], before);
        p[0] = before;
    }
    if (i + 2 < path->count) {
        p[3] = eye ? keys[i + 2].pose.eye : keys[i + 2].pose.target;
    } else {
        mirror(p[2], p[1], after);
        p[3] = after;
    }
    spline(p, u, out);
}

/* Between keys the eye may run through its target, or up through the view: keep both apart. */
static void repair(struct kl_look *pose, const struct kl_look *key)
{
    if (distance(pose->eye, pose->target) < 1e-9) {
        for (int i = 0; i < 3; ++i)
            pose->target[i] = pose->eye[i] + key->target[i] - key->eye[i];
    }
    const double length = sqrt(dot(pose->up, pose->up));
    if (length > 1e-9) {
        for (int i = 0; i < 3; ++i)
            pose->up[i] /= length;
    }
    if (length > 1e-9 && tilt(pose, pose->up) > 1e-9) return;
    const double axes[3][3] = {{0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}, {1.0, 0.0, 0.0}};
    for (int i = 0; i < 3; ++i) {
        memcpy(pose->up, axes[i], sizeof pose->up);
        if (tilt(pose, pose->up) > 0.1) return;
    }
}

/* The last key that is not after `time`; there is one. */
static size_t find_key(const struct kl_path *path, double time)
{
    size_t low = 0;
    size_t high = path->count;

    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (path->keys[middle].time <= time) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

void kl_path_evaluate(const struct kl_path *path, double time, struct kl_look *out)
{
    const struct key *last = &path->keys[path->count - 1];

    if (!(time > path->keys[0].time)) { /* also NaN */
        *out = path->keys[0].pose;
        return;
    }
    if (time >= last->time) {
        *out = last->pose;
        return;
    }
    const size_t i = find_key(path, time);
    const struct key *a = &path->keys[i];
    const struct key *b = a + 1;
    const double u = (time - a->time) / (b->time - a->time);
    interpolate(path, i, u, true, out->eye);
    interpolate(path, i, u, false, out->target);
    mix(a->pose.up, b->pose.up, u, out->up);
    out->yfov = (1.0 - u) * a->pose.yfov + u * b->pose.yfov;
    repair(out, &a->pose);
}
