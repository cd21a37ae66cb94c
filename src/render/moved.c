#include "src/render/moved.h"

#include "src/base/hash.h"
#include "src/base/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const float margin = 1e-4f; /* of the scene's radius, about boxes: rounding of rays */

/* An instance of a mesh: a box in a space of its own. */
struct thing {
    uint32_t object;
    bool deforms;
    double world_from_box[16]; /* column major; of what deforms the identity */
    double lo[3], hi[3];       /* of what deforms: wherever it gets to while the shutter is open */
    uint8_t vertices[KL_HASH_SIZE]; /* digest; of what deforms */
    uint32_t steps;                 /* kl_moved_box */
    float *ways;
};

struct kl_stand {
    double origin[3];
    double margin;
    uint32_t thing_count, object_count;
    struct thing *things;
    kl_u32 *bits;                /* per object: kernels/parts.h */
    uint8_t light[KL_HASH_SIZE]; /* digest of lights and materials */
};

static void grow(struct thing *t, double x, double y, double z)
{
    const double p[3] = {x, y, z};
    for (int k = 0; k < 3; ++k) {
        t->lo[k] = fmin(t->lo[k], p[k]);
        t->hi[k] = fmax(t->hi[k], p[k]);
    }
}

/* Nothing is in its box yet, which is the world's. */
static void clear_box(struct thing *t)
{
    static const double identity[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    memcpy(t->world_from_box, identity, sizeof identity);
    for (int k = 0; k < 3; ++k) {
        t->lo[k] = INFINITY;
        t->hi[k] = -INFINITY;
    }
}

static void stand_thing(const struct kl_scene *scene, const struct kl_pose *pose,
                        const struct kl_flat *flat, uint32_t i, struct thing *t)
{
    const struct kl_scene_instance *in = &scene->instances[i];
    const struct kl_mesh *mesh = &scene->meshes[in->mesh];
    const bool deforms = kl_instance_is_deformed(scene, i);
    const float *from =
        deforms ? flat->positions + 3 * (size_t)flat->places[i].first_vertex : mesh->positions;
    const double *origin = flat->origin;
    struct kl_hash hash;

    t->object = in->object;
    t->deforms = deforms;
    clear_box(t);
    if (!deforms) {
        memcpy(t->world_from_box, pose->world_from_node + 16 * (size_t)in->node,
               sizeof t->world_from_box);
    }
    for (size_t v = 0; v < mesh->vertex_count; ++v, from += 3) {
        grow(t, (double)from[0] + (deforms ? origin[0] : 0.0),
             (double)from[1] + (deforms ? origin[1] : 0.0),
             (double)from[2] + (deforms ? origin[2] : 0.0));
    }
    if (!deforms) return;
    kl_hash_init(&hash);
    kl_hash_update(&hash, from - 3 * (size_t)mesh->vertex_count,
                   3 * (size_t)mesh->vertex_count * sizeof *from);
    kl_hash_finish(&hash, t->vertices);
}

/* The instance of the motion that a thing is; KL_NONE: it keeps still. */
static uint32_t find_moving(const struct kl_flat_place *place, const struct kl_motion *motion)
{
    const uint32_t instance =
        place->instance != 0 ? place->instance : kl_motion_find(motion, place->first_triangle);
    return instance != KL_NONE && motion->moving[instance].steps > 0 ? instance : KL_NONE;
}

/* Out of the space of the reference instant, whatever the matrices take from. */
static void way_of(const float matrix[12], const kl_instance *instance, float out[12])
{
    const float *back = instance->object_from_render;
    for (int i = 0; i < 3; ++i) {
        const float *row = matrix + 4 * i;
        for (int k = 0; k < 4; ++k) {
            out[4 * i + k] = row[0] * back[k] + row[1] * back[4 + k] + row[2] * back[8 + k] +
                             (k == 3 ? row[3] : 0.0f);
        }
    }
}

/* How a thing moves while the shutter is open. */
static kl_status move_thing(const struct kl_flat *flat, const struct kl_motion *motion, uint32_t i,
                            struct thing *t, struct kl_err *err)
{
    const uint32_t instance = find_moving(&flat->places[i], motion);
    if (instance == KL_NONE) return KL_OK;
    const kl_moving *m = &motion->moving[instance];
    const double *o = flat->origin;

    if (m->deforms) {
        const float *p = motion->positions + 3 * (size_t)m->first;
        const size_t count = (size_t)m->steps * m->vertex_count;
        struct kl_hash hash;
        t->deforms = true;
        clear_box(t);
        for (size_t v = 0; v < count; ++v) {
            grow(t, (double)p[3 * v] + o[0], (double)p[3 * v + 1] + o[1],
                 (double)p[3 * v + 2] + o[2]);
        }
        kl_hash_init(&hash);
        kl_hash_update(&hash, p, 3 * count * sizeof *p);
        kl_hash_finish(&hash, t->vertices);
        return KL_OK;
    }
    kl_status st = kl_alloc_array(&t->ways, m->steps, 12 * sizeof(float), err);
    for (uint32_t k = 0; st == KL_OK && k < m->steps; ++k) {
        way_of(motion->matrices + 12 * (size_t)(m->first + k), &motion->instances[instance],
               t->ways + 12 * (size_t)k);
        t->steps = k + 1;
    }
    return st;
}

static void digest_light(const struct kl_flat *flat, const struct kl_motion *motion,
                         uint8_t out[KL_HASH_SIZE])
{
    struct kl_hash hash;
    kl_hash_init(&hash);
    if (motion != NULL) {
        kl_hash_update(&hash, motion->step_lights,
                       motion->step_light_count * sizeof *motion->step_lights);
        kl_hash_update(&hash, motion->step_materials,
                       motion->step_material_count * sizeof *motion->step_materials);
    }
    kl_hash_update(&hash, &flat->view.env, sizeof flat->view.env);
    kl_hash_update(&hash, flat->lights, flat->light_count * sizeof *flat->lights);
    kl_hash_update(&hash, flat->materials, flat->material_count * sizeof *flat->materials);
    kl_hash_finish(&hash, out);
}

kl_status kl_stand_create(const struct kl_scene *scene, const struct kl_pose *pose,
                          const struct kl_flat *flat, const struct kl_motion *motion,
                          struct kl_stand **out, struct kl_err *err)
{
    struct kl_stand *s = NULL;
    kl_status st = kl_alloc_array(&s, 1, sizeof *s, err);

    if (st != KL_OK) return st;
    memcpy(s->origin, flat->origin, sizeof s->origin);
    s->margin = (double)(margin * flat->radius);
    s->thing_count = scene->instance_count;
    s->object_count = flat->object_count;
    st = kl_alloc_array(&s->things, s->thing_count, sizeof *s->things, err);
    if (st == KL_OK) st = kl_alloc_array(&s->bits, s->object_count, sizeof *s->bits, err);
    for (uint32_t i = 0; st == KL_OK && i < s->thing_count; ++i) {
        stand_thing(scene, pose, flat, i, &s->things[i]);
        if (motion != NULL) st = move_thing(flat, motion, i, &s->things[i], err);
    }
    if (st != KL_OK) {
        kl_stand_destroy(s);
        return st;
    }
    memcpy(s->bits, flat->touch_bits + flat->light_count, s->object_count * sizeof *s->bits);
    digest_light(flat, motion, s->light);
    *out = s;
    return KL_OK;
}

void kl_stand_destroy(struct kl_stand *stand)
{
    if (stand == NULL) return;
    for (uint32_t i = 0; stand->things != NULL && i < stand->thing_count; ++i) {
        free(stand->things[i].ways);
    }
    free(stand->things);
    free(stand->bits);
    free(stand);
}

kl_u32 kl_stand_bit(const struct kl_stand *stand, uint32_t object)
{
    return stand->bits[object];
}

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

static bool make_box(const struct thing *t, const struct kl_stand *s, struct kl_moved_box *out)
{
    double map[12];
    struct kl_err ignored; /* without memory nothing can be compared */
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
static bool make_way(const struct thing *before, const struct thing *now, const struct kl_stand *s,
                     struct kl_moved_object *out)
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

static bool has_moved(const struct thing *a, const struct thing *b)
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
    const struct thing *a = &before->things[i];
    const struct thing *b = &now->things[i];
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
        origin = kl_map_back(&x, kl_v3_sub(origin, kl_v3(x.m[3], x.m[7], x.m[11])));
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
