/* Morph targets, then skins: glTF 2.0 sections 3.7.2.2 and 3.7.3. */
#include "src/scene/scene.h"

#include "src/base/memory.h"
#include "src/scene/matrix4.h"

#include <stdlib.h>
#include <string.h>

/* One vertex on its way. */
struct vertex {
    double position[3], normal[3], tangent[3];
};

struct deform_job {
    const struct kl_mesh *mesh;
    const double *weights;     /* morph_count of them, or NULL */
    const double *joint_world; /* 16 per joint: world_from_joint * inverse bind; or NULL */
    struct kl_deformed *out;
};

bool kl_instance_is_deformed(const struct kl_scene *scene, uint32_t instance)
{
    const struct kl_scene_instance *in = &scene->instances[instance];
    return in->skin != KL_NONE || scene->meshes[in->mesh].morph_count > 0;
}

static void normalize_or(const double v[3], const float fallback[3], float out[3])
{
    const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);

    if (!(length > 0.0) || !isfinite(length)) {
        memcpy(out, fallback, 3 * sizeof(float));
        return;
    }
    for (int i = 0; i < 3; ++i) {
        out[i] = (float)(v[i] / length);
    }
}

static void add_target(double v[3], const float *displacements, size_t at, double weight)
{
    if (displacements == NULL) return;
    for (size_t i = 0; i < 3; ++i) {
        v[i] += weight * (double)displacements[at + i];
    }
}

static void morph_vertex(const struct deform_job *job, uint32_t v, struct vertex *x)
{
    const struct kl_mesh *mesh = job->mesh;

    for (size_t i = 0; i < 3; ++i) {
        x->position[i] = (double)mesh->positions[(size_t)v * 3 + i];
        x->normal[i] = (double)mesh->normals[(size_t)v * 3 + i];
        x->tangent[i] = mesh->tangents ? (double)mesh->tangents[(size_t)v * 4 + i] : 0.0;
    }
    if (job->weights == NULL) return;
    for (uint32_t t = 0; t < mesh->morph_count; ++t) {
        const size_t at = ((size_t)t * mesh->vertex_count + v) * 3;
        if (job->weights[t] == 0.0) continue;
        add_target(x->position, mesh->morph_positions, at, job->weights[t]);
        add_target(x->normal, mesh->morph_normals, at, job->weights[t]);
        add_target(x->tangent, mesh->morph_tangents, at, job->weights[t]);
    }
}

/* Linear blend: the matrices are mixed, and the normal goes by the mix's inverse transpose. */
static void skin_vertex(const struct deform_job *job, uint32_t v, struct vertex *x)
{
    const uint32_t count = job->mesh->influence_count;
    double matrix[16] = {0};
    double cofactors[9];
    struct vertex y;

    for (uint32_t i = 0; i < count; ++i) {
        const size_t at = (size_t)v * count + i;
        const double weight = (double)job->mesh->weights[at];
        const double *joint = &job->joint_world[(size_t)job->mesh->joints[at] * 16];
        if (weight == 0.0) continue;
        for (int k = 0; k < 16; ++k) {
            matrix[k] += weight * joint[k];
        }
    }
    /* The weights sum to 1 in float only: a world far from the origin would feel the rest. */
    for (int k = 0; k < 15; ++k) {
        matrix[k] /= matrix[15];
    }
    const double sign = kl_mat4_cofactors(matrix, cofactors) < 0.0 ? -1.0 : 1.0;
    kl_mat4_point(matrix, x->position, y.position);
    kl_mat4_vector(matrix, x->tangent, y.tangent);
    for (int row = 0; row < 3; ++row) {
        y.normal[row] = sign * (cofactors[row] * x->normal[0] + cofactors[3 + row] * x->normal[1] +
                                cofactors[6 + row] * x->normal[2]);
    }
    *x = y;
}

static void write_vertex(const struct deform_job *job, uint32_t v, struct vertex *x)
{
    static const float up[3] = {0.0f, 0.0f, 1.0f};
    struct kl_deformed *out = job->out;
    float *normal = &out->normals[(size_t)v * 3];

    memcpy(&out->positions[(size_t)v * 3], x->position, sizeof x->position);
    normalize_or(x->normal, up, normal);
    if (out->tangents == NULL) return;
    double along = 0.0;
    for (int i = 0; i < 3; ++i) {
        along += x->tangent[i] * (double)normal[i];
    }
    for (int i = 0; i < 3; ++i) {
        x->tangent[i] -= along * (double)normal[i];
    }
    normalize_or(x->tangent, &job->mesh->tangents[(size_t)v * 4], &out->tangents[(size_t)v * 4]);
    out->tangents[(size_t)v * 4 + 3] = job->mesh->tangents[(size_t)v * 4 + 3];
}

static kl_status make_joint_matrices(const struct kl_skin *skin, const struct kl_pose *pose,
                                     double **out, struct kl_err *err)
{
    double *matrices = NULL;
    kl_status st = kl_alloc_array(&matrices, skin->joint_count, 16 * sizeof(double), err);

    if (st != KL_OK) return st;
    for (uint32_t j = 0; j < skin->joint_count; ++j) {
        kl_mat4_multiply(&pose->world_from_node[(size_t)skin->joints[j] * 16],
                         &skin->inverse_bind[(size_t)j * 16], &matrices[(size_t)j * 16]);
    }
    *out = matrices;
    return KL_OK;
}

static kl_status alloc_deformed(const struct kl_mesh *mesh, struct kl_deformed *out,
                                struct kl_err *err)
{
    const size_t count = mesh->vertex_count;
    kl_status st = kl_alloc_array(&out->positions, count, 3 * sizeof(double), err);

    if (st != KL_OK) return st;
    st = kl_alloc_array(&out->normals, count, 3 * sizeof(float), err);
    if (st != KL_OK || mesh->tangents == NULL) return st;
    return kl_alloc_array(&out->tangents, count, 4 * sizeof(float), err);
}

kl_status kl_instance_deform(const struct kl_scene *scene, const struct kl_pose *pose,
                             uint32_t instance, struct kl_deformed *out, struct kl_err *err)
{
    const struct kl_scene_instance *in = &scene->instances[instance];
    const struct kl_mesh *mesh = &scene->meshes[in->mesh];
    struct kl_deformed made = {0};
    double *joints = NULL;

    kl_status st = alloc_deformed(mesh, &made, err);
    if (st != KL_OK) goto cleanup;
    if (in->skin != KL_NONE) {
        st = make_joint_matrices(&scene->skins[in->skin], pose, &joints, err);
        if (st != KL_OK) goto cleanup;
    }
    made.in_world = in->skin != KL_NONE;
    const struct deform_job job = {mesh, pose->weights[in->node], joints, &made};
    for (uint32_t v = 0; v < mesh->vertex_count; ++v) {
        struct vertex x;
        morph_vertex(&job, v, &x);
        if (joints != NULL) skin_vertex(&job, v, &x);
        write_vertex(&job, v, &x);
    }
    *out = made;
    memset(&made, 0, sizeof made);

cleanup:
    free(joints);
    kl_deformed_fini(&made);
    return st;
}

void kl_deformed_fini(struct kl_deformed *deformed)
{
    free(deformed->positions);
    free(deformed->normals);
    free(deformed->tangents);
    memset(deformed, 0, sizeof *deformed);
}
