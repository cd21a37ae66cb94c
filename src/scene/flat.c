#include "src/scene/flat.h"

#include "src/base/memory.h"
#include "src/scene/flat_impl.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A mesh with at least this many triangles that is used again is shared, not copied: below it a
 * second level of tracing costs more than the copy. */
enum { SHARE_TRIANGLES = 4096 };

struct plan {               /* what becomes of each scene instance and mesh */
    uint32_t *uses;         /* per mesh */
    uint32_t *first_vertex; /* per mesh: of its shared copy, KL_NONE if it has none */
    uint32_t *first_triangle;
    uint8_t *shared; /* per scene instance */
    uint32_t merged_vertices, merged_triangles, shared_vertices, shared_triangles, instances;
};

static double determinant3(const double m[16])
{
    return m[0] * (m[5] * m[10] - m[9] * m[6]) - m[4] * (m[1] * m[10] - m[9] * m[2]) +
           m[8] * (m[1] * m[6] - m[5] * m[2]);
}

/* Inverse times determinant, transposed, column major: maps normals, also where the matrix is
 * singular. */
static void cofactors(const double m[16], double c[9])
{
    c[0] = m[5] * m[10] - m[9] * m[6];
    c[1] = m[8] * m[6] - m[4] * m[10];
    c[2] = m[4] * m[9] - m[8] * m[5];
    c[3] = m[9] * m[2] - m[1] * m[10];
    c[4] = m[0] * m[10] - m[8] * m[2];
    c[5] = m[8] * m[1] - m[0] * m[9];
    c[6] = m[1] * m[6] - m[5] * m[2];
    c[7] = m[4] * m[2] - m[0] * m[6];
    c[8] = m[0] * m[5] - m[4] * m[1];
}

static bool is_emissive(const kl_material *m)
{
    return m->emission[0] > 0.0f || m->emission[1] > 0.0f || m->emission[2] > 0.0f;
}

/* Whether a material glows, or an animation may make it. */
static bool may_glow(const struct kl_scene *scene, uint32_t material)
{
    bool glows = is_emissive(&scene->materials[material]);
    for (uint32_t a = 0; a < scene->animation_count; ++a) {
        for (uint32_t c = 0; c < scene->animations[a].channel_count; ++c) {
            const struct kl_animation_channel *channel = &scene->animations[a].channels[c];
            glows = glows ||
                    (channel->node == material && (channel->path == KL_MATERIAL_EMISSIVE_FACTOR ||
                                                   channel->path == KL_MATERIAL_EMISSIVE_STRENGTH));
        }
    }
    return glows;
}

static bool is_shareable(const struct kl_scene *scene, const struct kl_pose *pose,
                         const struct plan *plan, uint32_t i)
{
    const struct kl_scene_instance *inst = &scene->instances[i];
    const struct kl_mesh *mesh = &scene->meshes[inst->mesh];
    const double *m = pose->world_from_node + 16 * (size_t)inst->node;
    return plan->uses[inst->mesh] > 1 && mesh->triangle_count >= SHARE_TRIANGLES &&
           !may_glow(scene, mesh->material) && !kl_instance_is_deformed(scene, i) &&
           fabs(determinant3(m)) > 1e-30;
}

static kl_status make_plan(const struct kl_scene *scene, const struct kl_pose *pose,
                           struct plan *plan, struct kl_err *err)
{
    uint64_t vertices = 0;
    uint64_t triangles = 0;
    kl_status st = kl_alloc_array(&plan->uses, scene->mesh_count, sizeof(uint32_t), err);
    if (st == KL_OK) {
        st = kl_alloc_array(&plan->first_vertex, scene->mesh_count, sizeof(uint32_t), err);
    }
    if (st == KL_OK) {
        st = kl_alloc_array(&plan->first_triangle, scene->mesh_count, sizeof(uint32_t), err);
    }
    if (st == KL_OK) st = kl_alloc_array(&plan->shared, scene->instance_count, 1, err);
    if (st != KL_OK) return st;
    for (uint32_t i = 0; i < scene->instance_count; ++i) {
        ++plan->uses[scene->instances[i].mesh];
    }
    for (uint32_t i = 0; i < scene->mesh_count; ++i) {
        plan->first_vertex[i] = KL_NONE;
    }
    for (uint32_t i = 0; i < scene->instance_count; ++i) {
        const uint32_t number = scene->instances[i].mesh;
        const struct kl_mesh *mesh = &scene->meshes[number];
        plan->shared[i] = is_shareable(scene, pose, plan, i);
        if (plan->shared[i]) {
            ++plan->instances;
            if (plan->first_vertex[number] != KL_NONE) continue;
            plan->first_vertex[number] = 0; /* placed later */
            plan->shared_vertices += mesh->vertex_count;
            plan->shared_triangles += mesh->triangle_count;
        } else {
            plan->merged_vertices += mesh->vertex_count;
            plan->merged_triangles += mesh->triangle_count;
        }
        vertices += mesh->vertex_count;
        triangles += mesh->triangle_count;
    }
    if (vertices >= UINT32_MAX / 4 || triangles >= UINT32_MAX / 4) {
        return kl_fail(err, KL_ERR_INPUT, "%s: %llu triangles, at most 2^30 can be rendered",
                       scene->path, (unsigned long long)triangles);
    }
    return KL_OK;
}

static void free_plan(struct plan *plan)
{
    free(plan->uses);
    free(plan->first_vertex);
    free(plan->first_triangle);
    free(plan->shared);
}

static kl_status alloc_geometry(struct kl_flat *flat, struct kl_err *err)
{
    const uint32_t needs = flat->view.needs;
    kl_status st = kl_alloc_array(&flat->positions, 3 * (size_t)flat->vertex_count, 4, err);
    if (st == KL_OK) st = kl_alloc_array(&flat->normals, 3 * (size_t)flat->vertex_count, 4, err);
    if (st == KL_OK && (needs & KL_NEED_NORMAL_MAPS)) {
        st = kl_alloc_array(&flat->tangents, 4 * (size_t)flat->vertex_count, 4, err);
    }
    if (st == KL_OK && (needs & KL_NEED_TEXTURES)) {
        st = kl_alloc_array(&flat->uvs, 4 * (size_t)flat->vertex_count, 4, err);
    }
    if (st == KL_OK && (needs & KL_NEED_VERTEX_COLORS)) {
        st = kl_alloc_array(&flat->colors, 4 * (size_t)flat->vertex_count, 4, err);
    }
    if (st == KL_OK) {
        st = kl_alloc_array(&flat->triangles, flat->triangle_count, sizeof(kl_triangle), err);
    }
    if (st == KL_OK) {
        st = kl_alloc_array(&flat->instances, flat->instance_count, sizeof(kl_instance), err);
    }
    return st;
}

/* Attributes that no transform changes. */
static void copy_plain(struct kl_flat *flat, const struct kl_mesh *mesh, uint32_t first)
{
    for (size_t v = 0; v < mesh->vertex_count; ++v) {
        for (int set = 0; flat->uvs != NULL && set < 2; ++set) {
            if (mesh->uv[set] == NULL) continue;
            memcpy(flat->uvs + 4 * (first + v) + 2 * set, mesh->uv[set] + 2 * v, 8);
        }
        if (flat->colors == NULL) continue;
        for (int k = 0; k < 4; ++k) {
            flat->colors[4 * (first + v) + (size_t)k] =
                mesh->colors != NULL ? mesh->colors[4 * v + (size_t)k] : 1.0f;
        }
    }
}

static void copy_triangles(struct kl_flat *flat, const struct kl_mesh *mesh, uint32_t first_vertex,
                           uint32_t first_triangle, uint32_t object, bool flip)
{
    for (uint32_t t = 0; t < mesh->triangle_count; ++t) {
        kl_triangle *out = &flat->triangles[first_triangle + t];
        for (int k = 0; k < 3; ++k) {
            out->v[flip && k > 0 ? 3 - k : k] = first_vertex + mesh->indices[3 * t + (uint32_t)k];
        }
        out->material = mesh->material;
        out->object = object;
        out->light = KL_NONE;
    }
}

static void store_unit(float out[3], double x, double y, double z)
{
    const double l = sqrt(x * x + y * y + z * z);
    const double s = l > 0.0 ? 1.0 / l : 0.0;
    out[0] = (float)(x * s);
    out[1] = (float)(y * s);
    out[2] = l > 0.0 ? (float)(z * s) : 1.0f;
}

/* What vertices are put to. */
struct targets {
    float *positions, *normals, *tangents; /* tangents may be NULL */
};

/* Put one instance's vertices into render space. */
static void place_vertices(const struct kl_mesh *mesh, const struct kl_deformed *deformed,
                           const double m[16], const double origin[3], const struct targets *out)
{
    const float *normals = deformed->normals != NULL ? deformed->normals : mesh->normals;
    const float *tangents = deformed->tangents != NULL ? deformed->tangents : mesh->tangents;
    const double sign = determinant3(m) < 0.0 ? -1.0 : 1.0;
    double c[9];

    cofactors(m, c);
    for (size_t v = 0; v < mesh->vertex_count; ++v) {
        double p[3];
        double world[3];
        const float *n = normals + 3 * v;
        for (size_t k = 0; k < 3; ++k) {
            p[k] = deformed->positions != NULL ? deformed->positions[3 * v + k]
                                               : (double)mesh->positions[3 * v + k];
        }
        kl_matrix_point(m, p, world);
        for (size_t k = 0; k < 3; ++k) {
            out->positions[3 * v + k] = (float)(world[k] - origin[k]);
        }
        double normal[3];
        for (int r = 0; r < 3; ++r) {
            normal[r] =
                sign * (c[r] * (double)n[0] + c[3 + r] * (double)n[1] + c[6 + r] * (double)n[2]);
        }
        store_unit(out->normals + 3 * v, normal[0], normal[1], normal[2]);
        if (out->tangents == NULL || tangents == NULL) continue;
        const float *t = tangents + 4 * v;
        double bent[3];
        for (int r = 0; r < 3; ++r) {
            bent[r] = m[r] * (double)t[0] + m[4 + r] * (double)t[1] + m[8 + r] * (double)t[2];
        }
        store_unit(out->tangents + 4 * v, bent[0], bent[1], bent[2]);
        out->tangents[4 * v + 3] = t[3] * (float)sign;
    }
}

kl_status kl_flat_place_vertices(const struct kl_scene *scene, const struct kl_pose *pose,
                                 uint32_t instance, const double origin[3], float *positions,
                                 float *normals, float *tangents, struct kl_err *err)
{
    static const double identity[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    const struct kl_scene_instance *inst = &scene->instances[instance];
    const double *m = pose->world_from_node + 16 * (size_t)inst->node;
    const struct targets targets = {positions, normals, tangents};
    struct kl_deformed deformed = {0};

    if (kl_instance_is_deformed(scene, instance)) {
        kl_status st = kl_instance_deform(scene, pose, instance, &deformed, err);
        if (st != KL_OK) return st;
        if (deformed.in_world) m = identity;
    }
    place_vertices(&scene->meshes[inst->mesh], &deformed, m, origin, &targets);
    kl_deformed_fini(&deformed);
    return KL_OK;
}

/* Row-major 3x4 of a column-major 4x4, and of its inverse, in render space. */
static void set_instance(kl_instance *out, const double m[16], const double origin[3])
{
    double c[9];
    const double det = determinant3(m);
    cofactors(m, c);
    const double t[3] = {m[12] - origin[0], m[13] - origin[1], m[14] - origin[2]};
    for (int r = 0; r < 3; ++r) {
        double shift = 0.0;
        for (int k = 0; k < 3; ++k) {
            const double inverse = c[3 * r + k] / det; /* adjugate: transposed cofactors */
            out->render_from_object[4 * r + k] = (float)m[4 * k + r];
            out->object_from_render[4 * r + k] = (float)inverse;
            shift -= inverse * t[k];
        }
        out->render_from_object[4 * r + 3] = (float)t[r];
        out->object_from_render[4 * r + 3] = (float)shift;
    }
    out->mirrored = det < 0.0;
}

static void set_identity(kl_instance *out)
{
    memset(out, 0, sizeof *out);
    for (int r = 0; r < 3; ++r) {
        out->render_from_object[5 * r] = 1.0f;
        out->object_from_render[5 * r] = 1.0f;
    }
    out->object = KL_NONE;
}

/* The one copy of a mesh that instances share, in its own space. */
static void place_shared(struct kl_flat *flat, const struct kl_mesh *mesh, uint32_t first_vertex,
                         uint32_t first_triangle)
{
    memcpy(flat->positions + 3 * (size_t)first_vertex, mesh->positions,
           12 * (size_t)mesh->vertex_count);
    memcpy(flat->normals + 3 * (size_t)first_vertex, mesh->normals,
           12 * (size_t)mesh->vertex_count);
    if (flat->tangents != NULL && mesh->tangents != NULL) {
        memcpy(flat->tangents + 4 * (size_t)first_vertex, mesh->tangents,
               16 * (size_t)mesh->vertex_count);
    }
    copy_plain(flat, mesh, first_vertex);
    copy_triangles(flat, mesh, first_vertex, first_triangle, KL_NONE, false);
}

static kl_status place_merged(const struct kl_scene *scene, const struct kl_pose *pose,
                              struct kl_flat *flat, uint32_t i, uint32_t first_vertex,
                              uint32_t first_triangle, struct kl_err *err)
{
    const struct kl_scene_instance *inst = &scene->instances[i];
    const struct kl_mesh *mesh = &scene->meshes[inst->mesh];
    const double *m = pose->world_from_node + 16 * (size_t)inst->node;
    const size_t v = first_vertex;
    kl_status st = kl_flat_place_vertices(
        scene, pose, i, flat->origin, flat->positions + 3 * v, flat->normals + 3 * v,
        flat->tangents != NULL ? flat->tangents + 4 * v : NULL, err);

    if (st != KL_OK) return st;
    copy_plain(flat, mesh, first_vertex);
    copy_triangles(flat, mesh, first_vertex, first_triangle, inst->object,
                   inst->skin == KL_NONE && determinant3(m) < 0.0);
    return KL_OK;
}

static kl_status place_geometry(const struct kl_scene *scene, const struct kl_pose *pose,
                                struct plan *plan, struct kl_flat *flat, struct kl_err *err)
{
    uint32_t vertex = 0;
    uint32_t triangle = 0;
    uint32_t shared_vertex = plan->merged_vertices;
    uint32_t shared_triangle = plan->merged_triangles;
    uint32_t instance = 1;

    set_identity(&flat->instances[0]);
    flat->instances[0].triangle_count = plan->merged_triangles;
    for (uint32_t i = 0; i < scene->mesh_count; ++i) {
        plan->first_vertex[i] = KL_NONE;
    }
    for (uint32_t i = 0; i < scene->instance_count; ++i) {
        const struct kl_scene_instance *inst = &scene->instances[i];
        const struct kl_mesh *mesh = &scene->meshes[inst->mesh];
        if (!plan->shared[i]) {
            kl_status st = place_merged(scene, pose, flat, i, vertex, triangle, err);
            if (st != KL_OK) return st;
            flat->places[i] = (struct kl_flat_place){0, vertex, triangle};
            vertex += mesh->vertex_count;
            triangle += mesh->triangle_count;
            continue;
        }
        if (plan->first_vertex[inst->mesh] == KL_NONE) {
            plan->first_vertex[inst->mesh] = shared_vertex;
            plan->first_triangle[inst->mesh] = shared_triangle;
            place_shared(flat, mesh, shared_vertex, shared_triangle);
            shared_vertex += mesh->vertex_count;
            shared_triangle += mesh->triangle_count;
        }
        flat->places[i] = (struct kl_flat_place){instance, plan->first_vertex[inst->mesh],
                                                 plan->first_triangle[inst->mesh]};
        kl_instance *out = &flat->instances[instance++];
        set_instance(out, pose->world_from_node + 16 * (size_t)inst->node, flat->origin);
        out->first_triangle = plan->first_triangle[inst->mesh];
        out->triangle_count = mesh->triangle_count;
        out->object = inst->object;
    }
    return KL_OK;
}

/* Bounding sphere of the box of all that can be hit. */
static void set_bounds(struct kl_flat *flat)
{
    float lo[3] = {FLT_MAX, FLT_MAX, FLT_MAX};
    float hi[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX};
    for (uint32_t i = 0; i < flat->instance_count; ++i) {
        const kl_instance *inst = &flat->instances[i];
        for (uint32_t t = 0; t < 3 * inst->triangle_count; ++t) {
            const kl_triangle *tri = &flat->triangles[inst->first_triangle + t / 3];
            const kl_vec3 p = kl_affine_point(
                inst->render_from_object, kl_v3_load(flat->positions + 3 * (size_t)tri->v[t % 3]));
            const float q[3] = {p.x, p.y, p.z};
            for (int k = 0; k < 3; ++k) {
                lo[k] = fminf(lo[k], q[k]);
                hi[k] = fmaxf(hi[k], q[k]);
            }
        }
    }
    double r2 = 0.0;
    for (int k = 0; k < 3; ++k) {
        flat->center[k] = lo[k] <= hi[k] ? 0.5f * (lo[k] + hi[k]) : 0.0f;
        const double half = lo[k] <= hi[k] ? 0.5 * ((double)hi[k] - (double)lo[k]) : 0.0;
        r2 += half * half;
    }
    flat->radius = r2 > 0.0 ? (float)sqrt(r2) : 1.0f;
    flat->view.scene_radius = flat->radius;
}

static void set_view(struct kl_flat *flat)
{
    kl_scene_view *v = &flat->view;
    v->instance_count = flat->instance_count;
    v->positions = flat->positions;
    v->normals = flat->normals;
    v->tangents = flat->tangents;
    v->uvs = flat->uvs;
    v->colors = flat->colors;
    v->triangles = flat->triangles;
    v->instances = flat->instances;
    v->materials = flat->materials;
    v->textures = flat->textures;
    v->texels = flat->texels;
    v->srgb_table = flat->srgb_table;
    v->lights = flat->lights;
    v->light_nodes = flat->light_nodes;
    v->env_texels = flat->env_texels;
    v->env_rows = flat->env_rows;
    v->env_columns = flat->env_columns;
    v->touch_bits = flat->touch_bits;
}

kl_status kl_flat_create(const struct kl_scene *scene, const struct kl_pose *pose,
                         const double origin[3], struct kl_flat **out, struct kl_err *err)
{
    struct kl_flat *flat = NULL;
    struct plan plan = {0};
    kl_status st = kl_alloc_array(&flat, 1, sizeof *flat, err);

    if (st != KL_OK) return st;
    memcpy(flat->origin, origin, sizeof flat->origin);
    st = make_plan(scene, pose, &plan, err);
    if (st == KL_OK) st = kl_flat_add_materials(scene, pose, flat, err);
    if (st != KL_OK) goto cleanup;
    flat->vertex_count = plan.merged_vertices + plan.shared_vertices;
    flat->triangle_count = plan.merged_triangles + plan.shared_triangles;
    flat->instance_count = 1 + plan.instances;
    if (plan.instances > 0) flat->view.needs |= KL_NEED_INSTANCES;
    st = alloc_geometry(flat, err);
    if (st == KL_OK) {
        st = kl_alloc_array(&flat->places, scene->instance_count, sizeof *flat->places, err);
    }
    if (st == KL_OK) st = place_geometry(scene, pose, &plan, flat, err);
    if (st != KL_OK) goto cleanup;
    set_bounds(flat);
    set_view(flat);
    st = kl_flat_add_lights(scene, pose, flat, err);
    if (st != KL_OK) goto cleanup;
    flat->object_count =
        scene->instance_count > 0 ? scene->instances[scene->instance_count - 1].object + 1 : 0;
    st = kl_alloc_array(&flat->touch_bits, (size_t)flat->light_count + flat->object_count,
                        sizeof *flat->touch_bits, err);
    if (st != KL_OK) goto cleanup;
    set_view(flat);
    *out = flat;
    flat = NULL;

cleanup:
    free_plan(&plan);
    kl_flat_destroy(flat);
    return st;
}

bool kl_flat_is_alike(const struct kl_scene *scene, const struct kl_flat *a,
                      const struct kl_flat *b)
{
    return memcmp(a->places, b->places, scene->instance_count * sizeof *a->places) == 0;
}

void kl_flat_destroy(struct kl_flat *flat)
{
    if (flat == NULL) return;
    free(flat->places);
    free(flat->positions);
    free(flat->normals);
    free(flat->tangents);
    free(flat->uvs);
    free(flat->colors);
    free(flat->triangles);
    free(flat->instances);
    free(flat->materials);
    free(flat->textures);
    free(flat->texels);
    free(flat->srgb_table);
    free(flat->lights);
    free(flat->light_nodes);
    free(flat->env_texels);
    free(flat->env_rows);
    free(flat->env_columns);
    free(flat->light_sources);
    free(flat->touch_bits);
    free(flat);
}

kl_status kl_flat_choose_origin(const struct kl_scene *scene, const struct kl_pose *pose,
                                double origin[3], struct kl_err *err)
{
    double lo[3] = {DBL_MAX, DBL_MAX, DBL_MAX};
    double hi[3] = {-DBL_MAX, -DBL_MAX, -DBL_MAX};

    for (uint32_t i = 0; i < scene->instance_count; ++i) {
        const struct kl_scene_instance *inst = &scene->instances[i];
        const struct kl_mesh *mesh = &scene->meshes[inst->mesh];
        const double *m = pose->world_from_node + 16 * (size_t)inst->node;
        struct kl_deformed deformed = {0};
        if (kl_instance_is_deformed(scene, i)) { /* a skin may be far from its node */
            kl_status st = kl_instance_deform(scene, pose, i, &deformed, err);
            if (st != KL_OK) return st;
        }
        for (size_t v = 0; v < mesh->vertex_count; ++v) {
            double p[3];
            double world[3];
            for (size_t k = 0; k < 3; ++k) {
                p[k] = deformed.positions != NULL ? deformed.positions[3 * v + k]
                                                  : (double)mesh->positions[3 * v + k];
            }
            if (deformed.in_world) {
                memcpy(world, p, sizeof world);
            } else {
                kl_matrix_point(m, p, world);
            }
            for (int k = 0; k < 3; ++k) {
                lo[k] = fmin(lo[k], world[k]);
                hi[k] = fmax(hi[k], world[k]);
            }
        }
        kl_deformed_fini(&deformed);
    }
    for (int k = 0; k < 3; ++k) {
        origin[k] = lo[k] <= hi[k] ? 0.5 * (lo[k] + hi[k]) : 0.0;
    }
    return KL_OK;
}
