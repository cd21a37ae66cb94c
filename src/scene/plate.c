/* An object on a plate: everything with a mesh turns about a vertical axis, what is around it
 * stays. */
#include "src/scene/scene.h"

#include "src/base/memory.h"
#include "src/scene/matrix4.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

static const double pi = 3.14159265358979323846;

/* Fractions of a frame are rounded to this: what time / frame rate loses must not turn a vertex. */
static const double frame_grain = 1.0 / (1 << 24);

enum role { ROLE_LAMP = 1, ROLE_BODY = 2, ROLE_JOINT = 4 };

static bool glows(const kl_material *m)
{
    return m->emission[0] > 0.0f || m->emission[1] > 0.0f || m->emission[2] > 0.0f;
}

static uint32_t top_of(const struct kl_scene *scene, uint32_t node, const bool *is_top)
{
    while (node != KL_NONE && !is_top[node]) {
        node = scene->nodes[node].parent;
    }
    return node;
}

/* The nodes that things are sorted by: the roots, or what hangs under a lone root that is nothing
 * by itself. */
static void find_tops(const struct kl_scene *scene, const uint8_t *roles, bool *is_top)
{
    uint32_t parent = KL_NONE;
    for (;;) {
        uint32_t count = 0;
        uint32_t last = KL_NONE;
        uint32_t children = 0;
        for (uint32_t n = 0; n < scene->node_count; ++n) {
            if (!scene->nodes[n].visible || scene->nodes[n].parent != parent) continue;
            ++count;
            last = n;
        }
        for (uint32_t n = 0; count == 1 && n < scene->node_count; ++n) {
            children += scene->nodes[n].visible && scene->nodes[n].parent == last;
        }
        if (count != 1 || roles[last] != 0 || children == 0) break;
        parent = last;
    }
    for (uint32_t n = 0; n < scene->node_count; ++n) {
        is_top[n] = scene->nodes[n].parent == parent;
    }
}

static void find_roles(const struct kl_scene *scene, uint8_t *roles)
{
    for (uint32_t i = 0; i < scene->instance_count; ++i) {
        const struct kl_scene_instance *in = &scene->instances[i];
        const kl_material *m = &scene->materials[scene->meshes[in->mesh].material];
        roles[in->node] |= glows(m) ? ROLE_LAMP : ROLE_BODY;
        for (uint32_t j = 0; in->skin != KL_NONE && j < scene->skins[in->skin].joint_count; ++j) {
            roles[scene->skins[in->skin].joints[j]] |= ROLE_JOINT;
        }
    }
}

/* Middle of the box of what turns. */
static void find_axis(struct kl_scene *scene, const struct kl_pose *pose, const bool *is_top)
{
    double lo[3] = {DBL_MAX, DBL_MAX, DBL_MAX};
    double hi[3] = {-DBL_MAX, -DBL_MAX, -DBL_MAX};

    for (uint32_t i = 0; i < scene->instance_count; ++i) {
        const struct kl_scene_instance *in = &scene->instances[i];
        const struct kl_mesh *mesh = &scene->meshes[in->mesh];
        const uint32_t top = top_of(scene, in->node, is_top);
        if (top == KL_NONE || !scene->nodes[top].turns) continue;
        for (size_t v = 0; v < mesh->vertex_count; ++v) {
            const double p[3] = {(double)mesh->positions[3 * v], (double)mesh->positions[3 * v + 1],
                                 (double)mesh->positions[3 * v + 2]};
            double q[3];
            kl_mat4_point(pose->world_from_node + 16 * (size_t)in->node, p, q);
            for (int k = 0; k < 3; ++k) {
                lo[k] = fmin(lo[k], q[k]);
                hi[k] = fmax(hi[k], q[k]);
            }
        }
    }
    for (int k = 0; k < 3; ++k) {
        scene->plate.centre[k] = lo[k] <= hi[k] ? 0.5 * (lo[k] + hi[k]) : 0.0;
    }
}

kl_status kl_scene_set_plate(struct kl_scene *scene, double fps, uint32_t count, struct kl_err *err)
{
    struct kl_pose *pose = NULL;
    uint8_t *roles = NULL;
    bool *is_top = NULL;
    kl_status st = kl_alloc_array(&roles, scene->node_count, sizeof *roles, err);

    if (st == KL_OK) st = kl_alloc_array(&is_top, scene->node_count, sizeof *is_top, err);
    if (st == KL_OK) st = kl_pose_create(scene, KL_NONE, 0.0, &pose, err);
    if (st == KL_OK) {
        find_roles(scene, roles);
        find_tops(scene, roles, is_top);
        for (uint32_t n = 0; n < scene->node_count; ++n) { /* parents come first */
            const uint32_t top = top_of(scene, n, is_top);
            if (top != KL_NONE && (roles[n] & (ROLE_BODY | ROLE_JOINT)) != 0) {
                scene->nodes[top].turns = true;
            }
        }
        find_axis(scene, pose, is_top);
        scene->plate.fps = fps;
        scene->plate.count = count;
    }
    kl_pose_destroy(pose);
    free(roles);
    free(is_top);
    return st;
}

void kl_plate_matrix(const struct kl_plate *turn, double time, double out[16])
{
    const double frame = time * turn->fps - 1.0;
    const double whole = floor(frame + 0.5);
    const double part = floor((frame - whole) / frame_grain + 0.5) * frame_grain;
    double index = fmod(whole, (double)turn->count);
    if (index < 0.0) index += (double)turn->count;
    const double angle = 2.0 * pi * (index + part) / (double)turn->count;
    const double c = cos(angle);
    const double s = sin(angle);

    kl_mat4_identity(out);
    out[0] = c;
    out[2] = -s;
    out[8] = s;
    out[10] = c;
    out[12] = turn->centre[0] - (c * turn->centre[0] + s * turn->centre[2]);
    out[14] = turn->centre[2] - (c * turn->centre[2] - s * turn->centre[0]);
}
