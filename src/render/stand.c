/* How the things of a scene stand at an instant. */
#include "src/base/memory.h"
#include "src/render/moved_impl.h"
#include "src/scene/matrix4.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const float margin = 1e-4f; /* of the scene's radius, about boxes: rounding of rays */

static void grow(struct kl_thing *t, double x, double y, double z)
{
    const double p[3] = {x, y, z};
    for (int k = 0; k < 3; ++k) {
        t->lo[k] = fmin(t->lo[k], p[k]);
        t->hi[k] = fmax(t->hi[k], p[k]);
    }
}

/* Nothing is in its box yet, which is the world's. */
static void clear_box(struct kl_thing *t)
{
    kl_mat4_identity(t->world_from_box);
    for (int k = 0; k < 3; ++k) {
        t->lo[k] = INFINITY;
        t->hi[k] = -INFINITY;
    }
}

static void stand_thing(const struct kl_scene *scene, const struct kl_pose *pose,
                        const struct kl_flat *flat, uint32_t i, struct kl_thing *t)
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
                            struct kl_thing *t, struct kl_err *err)
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
