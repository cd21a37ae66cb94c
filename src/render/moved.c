#include "src/render/moved.h"

#include "src/base/memory.h"
#include "src/render/moved_impl.h"
#include "src/scene/matrix4.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- maps: 3x4 row major, in double ---- */

/* The inverse of a matrix (column major, 4x4) as a map. False: it has none. */
static bool invert(const double m[16], double out[12])
{
    for (int i = 0; i < 3; ++i) { /* rows: cross products of the other columns */
        const double *a = m + 4 * ((i + 1) % 3);
        const double *b = m + 4 * ((i + 2) % 3);
        out[4 * i] = a[1] * b[2] - a[2] * b[1];
        out[4 * i + 1] = a[2] * b[0] - a[0] * b[2];
        out[4 * i + 2] = a[0] * b[1] - a[1] * b[0];
    }
    const double det = m[0] * out[0] + m[1] * out[1] + m[2] * out[2];
    for (int i = 0; i < 3; ++i) {
        double *row = out + 4 * i;
        for (int k = 0; k < 3; ++k) {
            row[k] /= det;
        }
        row[3] = -(row[0] * m[12] + row[1] * m[13] + row[2] * m[14]);
    }
    return isfinite(det) && det != 0.0;
}

/* A map of world space as one of render space. */
static void map_render(const double map[12], const double from[3], float out[12])
{
    for (int i = 0; i < 3; ++i) {
        const double *row = map + 4 * i;
        for (int k = 0; k < 3; ++k) {
            out[4 * i + k] = (float)row[k];
        }
        out[4 * i + 3] = (float)(row[3] + row[0] * from[0] + row[1] * from[1] + row[2] * from[2]);
    }
}

/* A thing that is flattened, to a plane or to nothing, in a box of the world. */
static struct kl_thing world_thing(const struct kl_thing *t)
{
    const double *m = t->world_from_box;
    struct kl_thing out = *t;

    kl_mat4_identity(out.world_from_box);
    for (int i = 0; i < 3; ++i) {
        out.lo[i] = m[12 + i];
        out.hi[i] = m[12 + i];
        for (int k = 0; k < 3; ++k) {
            const double a = m[4 * k + i] * t->lo[k];
            const double b = m[4 * k + i] * t->hi[k];
            out.lo[i] += fmin(a, b);
            out.hi[i] += fmax(a, b);
        }
    }
    return out;
}

static bool make_box(const struct kl_thing *t, const struct kl_stand *s, struct kl_moved_box *out)
{
    double map[12];
    struct kl_err ignored; /* without memory nothing can be compared */
    const struct kl_thing flat = world_thing(t);
    if (!invert(t->world_from_box, map)) t = &flat;
    const bool sound = invert(t->world_from_box, map) &&
                       kl_alloc_array(&out->ways, t->steps, 12 * sizeof(float), &ignored) == KL_OK;

    out->object = t->object;
    out->steps = t->steps;
    if (sound && t->steps > 0) memcpy(out->ways, t->ways, 12 * sizeof(float) * t->steps);
    for (int i = 0; sound && i < 3; ++i) {
        double *row = map + 4 * i;
        const double per_metre = sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2]);
        const double half = 0.5 * (t->hi[i] - t->lo[i]) + s->margin * per_metre;
        row[3] -= 0.5 * (t->lo[i] + t->hi[i]);
        for (int k = 0; k < 4; ++k) {
            row[k] /= half;
        }
    }
    map_render(map, s->origin, out->unit_from_render);
    return sound;
}

/* How an object got from one place to the other, as a whole. */
static bool make_way(const struct kl_thing *before, const struct kl_thing *now,
                     const struct kl_stand *s, struct kl_moved_object *out)
{
    const double *m = now->world_from_box;
    double back[12];
    double way[16] = {0.0};
    double inverse[12];

    if (!invert(before->world_from_box, back)) return false;
    for (int column = 0; column < 4; ++column) {
        for (int i = 0; i < 3; ++i) {
            way[4 * column + i] = m[i] * back[column] + m[4 + i] * back[4 + column] +
                                  m[8 + i] * back[8 + column] + (column == 3 ? m[12 + i] : 0.0);
        }
    }
    if (!invert(way, inverse)) return false;
    for (int i = 0; i < 3; ++i) {
        double at = way[12 + i] - s->origin[i];
        for (int k = 0; k < 3; ++k) {
            out->now_from_before[4 * i + k] = (float)way[4 * k + i];
            out->normals[3 * i + k] = (float)inverse[4 * k + i];
            at += way[4 * k + i] * s->origin[k];
        }
        out->now_from_before[4 * i + 3] = (float)at;
    }
    return true;
}

static bool has_moved(const struct kl_thing *a, const struct kl_thing *b)
{
    if (!(a->lo[0] <= a->hi[0])) return false; /* nothing there */
    if (a->deforms) return memcmp(a->vertices, b->vertices, sizeof a->vertices) != 0;
    if (a->steps != b->steps) return true;
    return memcmp(a->world_from_box, b->world_from_box, sizeof a->world_from_box) != 0 ||
           (a->steps > 0 && memcmp(a->ways, b->ways, 12 * sizeof(float) * a->steps) != 0);
}

static void add_moved(const struct kl_stand *before, const struct kl_stand *now, uint32_t i,
                      struct kl_moved *out)
{
    const struct kl_thing *a = &before->things[i];
    const struct kl_thing *b = &now->things[i];
    struct kl_moved_object *object = &out->objects[b->object];
    const kl_u32 bit = now->bits[b->object];

    object->moved = true;
    if (b->deforms || !make_way(a, b, now, object)) object->deformed = true;
    if (bit < 64u) out->touched[bit >> 5] |= 1u << (bit & 31u);
    const bool sound =
        make_box(a, before, &out->was[out->count]) && make_box(b, now, &out->is[out->count]);
    if (sound) ++out->count;
    out->all = out->all || !sound;
}

kl_status kl_moved_between(const struct kl_stand *before, const struct kl_stand *now,
                           struct kl_moved *out, struct kl_err *err)
{
    const uint32_t n = now->thing_count;

    *out = (struct kl_moved){.all = memcmp(before->light, now->light, sizeof now->light) != 0};
    out->room = n;
    kl_status st = kl_alloc_array(&out->objects, now->object_count, sizeof *out->objects, err);
    if (st == KL_OK) st = kl_alloc_array(&out->was, n, sizeof *out->was, err);
    if (st == KL_OK) st = kl_alloc_array(&out->is, n, sizeof *out->is, err);
    for (uint32_t i = 0; st == KL_OK && i < n; ++i) {
        if (has_moved(&before->things[i], &now->things[i])) add_moved(before, now, i, out);
    }
    if (st != KL_OK) kl_moved_fini(out);
    return st;
}

void kl_moved_fini(struct kl_moved *moved)
{
    for (uint32_t i = 0; moved->was != NULL && i < moved->room; ++i) {
        free(moved->was[i].ways);
    }
    for (uint32_t i = 0; moved->is != NULL && i < moved->room; ++i) {
        free(moved->is[i].ways);
    }
    free(moved->objects);
    free(moved->was);
    free(moved->is);
    *moved = (struct kl_moved){.all = true};
}

/* Slabs, as in Kay and Kajiya 1986. */
static bool meets(const struct kl_moved_box *box, const kl_ray *ray)
{
    kl_vec3 origin = ray->origin;
    kl_vec3 dir = ray->dir;
    float near = 0.0f;
    float far = ray->tmax;

    if (box->steps > 0) {
        const kl_map x = kl_map_of(box->ways, box->steps, ray->time);
        origin = kl_map_point_back(&x, origin);
        dir = kl_map_back(&x, dir);
    }
    for (int k = 0; k < 3; ++k) {
        const float *m = box->unit_from_render + 4 * k;
        const float o = m[0] * origin.x + m[1] * origin.y + m[2] * origin.z + m[3];
        const float d = m[0] * dir.x + m[1] * dir.y + m[2] * dir.z;
        const float inverse = 1.0f / (d != 0.0f ? d : 1e-30f);
        const float a = (-1.0f - o) * inverse;
        const float b = (1.0f - o) * inverse;
        near = kl_fmax(near, kl_fmin(a, b));
        far = kl_fmin(far, kl_fmax(a, b));
    }
    return near <= far;
}

bool kl_moved_meets(const struct kl_moved_box *boxes, uint32_t count, uint32_t except,
                    const kl_ray *ray)
{
    for (uint32_t i = 0; i < count; ++i) {
        if (boxes[i].object != except && meets(&boxes[i], ray)) return true;
    }
    return false;
}
