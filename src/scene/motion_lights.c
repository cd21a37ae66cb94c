/* Lights and materials that change while the shutter is open, and lights on things that move. */
#include "src/scene/motion_impl.h"

#include "kernels/moving.h"
#include "kernels/parts.h"
#include "src/base/memory.h"
#include "src/scene/flat_impl.h"
#include "src/scene/light_tree.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { STEPS = KL_VALUE_STEPS, STRIDE = KL_MOTION_GRID / (KL_VALUE_STEPS - 1) };

/* Between steps normals may lean out of the cone of those at steps. */
static const float cone_slack = 0.05f; /* [rad] */

kl_status kl_motion_add_materials(struct kl_motion_job *job, struct kl_err *err)
{
    struct kl_motion *m = job->motion;
    size_t capacity = 0;

    if (job->pose->materials == NULL) return KL_OK; /* no animation changes any */
    for (uint32_t i = 0; i < job->flat->material_count; ++i) {
        kl_material steps[STEPS];
        bool changes = false;
        for (uint32_t k = 0; k < STEPS; ++k) {
            const struct kl_pose *pose;
            kl_status st = kl_motion_pose(job, k * STRIDE, &pose, err);
            if (st != KL_OK) return st;
            kl_flat_convert_material(kl_pose_material(job->scene, pose, i), &steps[k]);
            changes = changes || memcmp(&steps[k], &steps[0], sizeof steps[k]) != 0;
        }
        if (!changes) continue;
        const size_t count = m->step_material_count + STEPS;
        kl_status st =
            kl_grow_array(&m->step_materials, &capacity, count, sizeof *m->step_materials, err);
        if (st != KL_OK) return st;
        memcpy(m->step_materials + m->step_material_count, steps, sizeof steps);
        m->material_motion[i] = (uint32_t)m->step_material_count;
        m->step_material_count = count;
        ++m->moving_materials;
    }
    return KL_OK;
}

/* The lights of the whole span: each as bright as it ever gets. */
struct bright {
    struct kl_pose pose;
    struct kl_flat flat;
    uint32_t *steps; /* per light of the scene: its place in step_lights, KL_NONE: constant */
};

static void bright_fini(struct bright *b)
{
    free(b->pose.lights);
    free(b->flat.materials);
    free(b->steps);
}

static kl_status track_light(struct kl_motion_job *job, uint32_t i, struct bright *b,
                             size_t *capacity, struct kl_err *err)
{
    struct kl_motion *m = job->motion;
    struct kl_scene_light *out = &b->pose.lights[i];
    kl_light steps[STEPS];
    bool changes = false;

    for (uint32_t k = 0; k < STEPS; ++k) {
        const struct kl_pose *pose;
        kl_status st = kl_motion_pose(job, k * STRIDE, &pose, err);
        if (st != KL_OK) return st;
        steps[k] = kl_flat_punctual(job->scene, pose, i, job->flat->origin);
        changes = changes || memcmp(&steps[k], &steps[0], sizeof steps[k]) != 0;
    }
    b->steps[i] = KL_NONE;
    if (!changes) return KL_OK;
    out->intensity = 1.0;
    for (int c = 0; c < 3; ++c) {
        out->color[c] = 0.0;
        for (int k = 0; k < STEPS; ++k) {
            out->color[c] = fmax(out->color[c], (double)steps[k].color[c]);
        }
    }
    const size_t count = m->step_light_count + STEPS;
    kl_status st = kl_grow_array(&m->step_lights, capacity, count, sizeof *m->step_lights, err);
    if (st != KL_OK) return st;
    memcpy(m->step_lights + m->step_light_count, steps, sizeof steps);
    b->steps[i] = (uint32_t)m->step_light_count;
    m->step_light_count = count;
    ++m->moving_lights;
    return KL_OK;
}

static void brighten_materials(const struct kl_motion *m, struct kl_flat *flat)
{
    for (uint32_t i = 0; i < flat->material_count; ++i) {
        for (int k = 0; m->material_motion[i] != KL_NONE && k < STEPS; ++k) {
            const float *e = m->step_materials[m->material_motion[i] + (uint32_t)k].emission;
            for (int c = 0; c < 3; ++c) {
                flat->materials[i].emission[c] = fmaxf(flat->materials[i].emission[c], e[c]);
            }
        }
    }
}

static kl_status bright_init(struct kl_motion_job *job, struct bright *b, struct kl_err *err)
{
    const struct kl_scene *scene = job->scene;
    const struct kl_flat *flat = job->flat;
    struct kl_motion *m = job->motion;
    size_t capacity = 0;

    b->pose = *job->pose;
    b->flat = *flat;
    b->pose.lights = NULL;
    b->flat.materials = NULL;
    b->steps = NULL;
    kl_status st = kl_alloc_array(&b->pose.lights, scene->light_count, sizeof *b->pose.lights, err);
    if (st == KL_OK) st = kl_alloc_array(&b->steps, scene->light_count, sizeof *b->steps, err);
    if (st == KL_OK) {
        st = kl_alloc_array(&b->flat.materials, flat->material_count, sizeof(kl_material), err);
    }
    if (st == KL_OK) {
        st = kl_alloc_array(&m->triangles, flat->triangle_count, sizeof(kl_triangle), err);
    }
    if (st != KL_OK) return st;
    b->flat.triangles = m->triangles;
    memcpy(m->triangles, flat->triangles, flat->triangle_count * sizeof(kl_triangle));
    for (uint32_t t = 0; t < flat->triangle_count; ++t) {
        m->triangles[t].light = KL_NONE;
    }
    memcpy(b->flat.materials, flat->materials, flat->material_count * sizeof(kl_material));
    brighten_materials(m, &b->flat);
    for (uint32_t i = 0; st == KL_OK && i < scene->light_count; ++i) {
        b->pose.lights[i] = *kl_pose_light(scene, job->pose, i);
        if (scene->nodes[scene->lights[i].node].visible)
            st = track_light(job, i, b, &capacity, err);
    }
    return st;
}

/* Bounds of a light over the whole span. */
static void leaf_over_span(const struct kl_motion *m, const kl_light *light, uint32_t motion,
                           struct kl_light_bounds *leaf)
{
    const bool glows = light->type == KL_LIGHT_TRIANGLE;
    const uint32_t steps = glows ? m->moving[motion].steps : STEPS;

    kl_light_bounds_init(light, leaf);
    for (uint32_t k = 0; k < steps; ++k) {
        const struct kl_light_bounds before = *leaf;
        struct kl_light_bounds node;
        kl_light there = *light;
        if (glows) {
            const kl_corners c = kl_moved_corners(&m->view, motion, &m->triangles[light->triangle],
                                                  steps > 1 ? (float)k / (float)(steps - 1) : 0.0f);
            const kl_vec3 e1 = kl_v3_sub(c.b, c.a);
            const kl_vec3 e2 = kl_v3_sub(c.c, c.a);
            const float pos[3] = {c.a.x, c.a.y, c.a.z};
            const float edge1[3] = {e1.x, e1.y, e1.z};
            const float edge2[3] = {e2.x, e2.y, e2.z};
            memcpy(there.pos, pos, sizeof pos);
            memcpy(there.edge1, edge1, sizeof edge1);
            memcpy(there.edge2, edge2, sizeof edge2);
            there.area = 0.5f * kl_length(kl_cross(e1, e2));
        } else {
            memcpy(there.pos, m->step_lights[motion + k].pos, sizeof there.pos);
        }
        kl_light_bounds_init(&there, &node);
        kl_light_bounds_merge(&before, &node, leaf);
        leaf->power = fmaxf(before.power, node.power);
    }
    if (leaf->cos_cone > -1.0f) {
        const float angle = acosf(kl_clamp(leaf->cos_cone, -1.0f, 1.0f)) + cone_slack;
        leaf->cos_cone = angle < KL_PI ? cosf(angle) : -1.0f;
    }
}

/* Which motion each light of the list has; how many have any. */
static uint32_t find_motions(struct kl_motion *m, const struct kl_flat_lights *list,
                             const uint32_t *steps)
{
    uint32_t moving = 0;
    for (uint32_t i = 0; i < list->count; ++i) {
        const kl_light *l = &list->items[i];
        m->light_motion[i] = KL_NONE;
        if (l->type == KL_LIGHT_TRIANGLE) {
            m->light_motion[i] = kl_motion_find(m, l->triangle);
        } else if (l->type != KL_LIGHT_ENVIRONMENT) {
            m->light_motion[i] = steps[list->sources[i]];
        }
        moving += m->light_motion[i] != KL_NONE;
    }
    return moving;
}

/* Bits of lights and objects (kernels/parts.h) with the list's numbers. Lights of the flat scene
 * are in the list, in the same order; others are dark at the reference instant. */
static void number_bits(struct kl_motion *m, const struct kl_flat_lights *list,
                        const struct kl_flat *flat)
{
    uint32_t at = 0;
    for (uint32_t i = 0; i < list->count; ++i) {
        const kl_light *l = &list->items[i];
        const bool known = at < flat->light_count && flat->lights[at].type == l->type &&
                           flat->lights[at].triangle == l->triangle &&
                           flat->light_sources[at] == list->sources[i];
        m->touch_bits[i] = known ? flat->touch_bits[at++] : KL_TOUCH_NONE;
    }
    for (uint32_t i = 0; i < flat->object_count; ++i) {
        m->touch_bits[list->count + i] = flat->touch_bits[flat->light_count + i];
    }
}

kl_status kl_motion_add_lights(struct kl_motion_job *job, struct kl_err *err)
{
    struct kl_motion *m = job->motion;
    struct bright bright;
    struct kl_flat_lights list = {0};
    struct kl_light_bounds *leaves = NULL;
    kl_status st = bright_init(job, &bright, err);

    if (st == KL_OK) st = kl_flat_list_lights(job->scene, &bright.pose, &bright.flat, &list, err);
    if (st == KL_OK) st = kl_alloc_array(&m->light_motion, list.count, sizeof(uint32_t), err);
    if (st == KL_OK) {
        st = kl_alloc_array(&m->touch_bits, (size_t)list.count + job->flat->object_count,
                            sizeof *m->touch_bits, err);
    }
    if (st == KL_OK) st = kl_alloc_array(&leaves, list.count, sizeof *leaves, err);
    if (st != KL_OK) goto cleanup;
    m->moving_lights = find_motions(m, &list, bright.steps);
    number_bits(m, &list, job->flat);
    for (uint32_t i = 0; i < list.count; ++i) {
        if (m->light_motion[i] != KL_NONE) {
            leaf_over_span(m, &list.items[i], m->light_motion[i], &leaves[i]);
        } else {
            kl_light_bounds_init(&list.items[i], &leaves[i]);
        }
    }
    st = kl_light_tree_build(list.items, list.far_count, list.count, leaves, &m->light_nodes,
                             &m->light_node_count, err);
    if (st != KL_OK) goto cleanup;
    m->lights = list.items;
    m->light_count = list.count;
    m->view.triangles = m->triangles;
    m->view.lights = m->lights;
    m->view.light_nodes = m->light_nodes;
    m->view.light_motion = m->light_motion;
    m->view.touch_bits = m->touch_bits;
    m->view.step_lights = m->step_lights;
    m->view.light_count = list.count;
    m->view.far_count = list.far_count;
    m->view.far_probability = kl_flat_far_probability(&list);
    if (m->view.env.width > 0) m->view.env.light = list.far_count - 1;
    list.items = NULL;

cleanup:
    bright_fini(&bright);
    kl_flat_lights_fini(&list);
    free(leaves);
    return st;
}
