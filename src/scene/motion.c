#include "src/scene/motion_impl.h"

#include "kernels/surface.h"
#include "src/base/memory.h"
#include "src/scene/flat_impl.h"
#include "src/scene/matrix4.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    GRID = KL_MOTION_GRID, /* Embree takes 129 steps */
    DEFORM_SEGMENTS = 32,  /* at most: each holds all vertices */
};
/* Of the scene's radius: how far the straight way between two steps may be from the real one, and
 * how far a thing has to go to count as moving. A picture that the scene fills is some 500 pixels a
 * radius: 0.01 pixels. */
static const double tolerance = 2e-5;
static const double standstill = 1e-7;

/* A scene instance that may move. */
struct track {
    uint32_t index; /* of the scene instance */
    const struct kl_mesh *mesh;
    struct kl_flat_place place;
    bool deforms;
    double from_reference[16]; /* inverse of its matrix at the reference instant */
    double corners[8][3];      /* of its box: object space as the flat scene has it */
    double reference[8][3];    /* where they are at the reference instant, render space */
};

kl_status kl_motion_pose(struct kl_motion_job *job, uint32_t at, const struct kl_pose **out,
                         struct kl_err *err)
{
    const double middle = 0.5 * (job->span.open + job->span.close);
    const double half = 0.5 * (job->span.close - job->span.open);
    const double time = middle + half * ((double)at - GRID / 2) / (GRID / 2);
    kl_status st = KL_OK;

    if (at == GRID / 2 && !job->is_instant) {
        *out = job->pose;
        return KL_OK;
    }
    if (job->poses[at] == NULL) {
        st = kl_pose_create(job->scene, job->animation, time, &job->poses[at], err);
    }
    *out = job->poses[at];
    return st;
}

/* False where the matrix cannot be inverted. */
static bool invert(const double m[16], double out[16])
{
    double c[9];
    const double det = kl_mat4_cofactors(m, c);
    double size = 0.0;

    for (int i = 0; i < 11; ++i) {
        size = fmax(size, fabs(m[i]));
    }
    if (!(fabs(det) > 1e-9 * size * size * size)) return false;
    kl_mat4_identity(out);
    for (int r = 0; r < 3; ++r) {
        double shift = 0.0;
        for (int k = 0; k < 3; ++k) {
            out[4 * k + r] = c[3 * r + k] / det;
            shift -= out[4 * k + r] * m[12 + k];
        }
        out[12 + r] = shift;
    }
    return true;
}

/* Render space from the instance's space in the flat scene, row major 3x4: from object space for a
 * shared instance; from render space at the reference instant for a merged one. */
static void matrix_of(const struct kl_motion_job *job, const struct track *t,
                      const struct kl_pose *pose, double out[12])
{
    const double *m = pose->world_from_node + 16 * (size_t)job->scene->instances[t->index].node;
    const double *o = job->flat->origin;
    double moved[16];
    double shift[3] = {0.0, 0.0, 0.0};

    if (t->place.instance == 0) {
        kl_mat4_multiply(m, t->from_reference, moved);
        kl_mat4_vector(moved, o, shift);
    } else {
        memcpy(moved, m, sizeof moved);
    }
    for (int r = 0; r < 3; ++r) {
        for (int k = 0; k < 3; ++k) {
            out[4 * r + k] = moved[4 * k + r];
        }
        out[4 * r + 3] = moved[12 + r] + shift[r] - o[r];
    }
}

static void apply(const double m[12], const double p[3], double out[3])
{
    for (int r = 0; r < 3; ++r) {
        out[r] = m[4 * r] * p[0] + m[4 * r + 1] * p[1] + m[4 * r + 2] * p[2] + m[4 * r + 3];
    }
}

static double distance(const double a[3], const double b[3])
{
    const double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
}

static void find_corners(const struct kl_motion_job *job, struct track *t)
{
    const float *p = job->flat->positions + 3 * (size_t)t->place.first_vertex;
    double lo[3] = {INFINITY, INFINITY, INFINITY};
    double hi[3] = {-INFINITY, -INFINITY, -INFINITY};
    double m[12];

    for (size_t v = 0; v < 3 * (size_t)t->mesh->vertex_count; ++v) {
        lo[v % 3] = fmin(lo[v % 3], (double)p[v]);
        hi[v % 3] = fmax(hi[v % 3], (double)p[v]);
    }
    matrix_of(job, t, job->pose, m);
    for (int c = 0; c < 8; ++c) {
        for (int k = 0; k < 3; ++k) {
            t->corners[c][k] = (c >> k) & 1 ? hi[k] : lo[k];
        }
        apply(m, t->corners[c], t->reference[c]);
    }
}

/* Everywhere on the grid it can be undone, without passing through a mirror image. */
static kl_status is_regular(struct kl_motion_job *job, const struct track *t, bool *out,
                            struct kl_err *err)
{
    const uint32_t node = job->scene->instances[t->index].node;
    double first = 0.0;

    *out = true;
    for (uint32_t k = 0; k <= GRID; k += job->is_instant ? GRID : GRID / 8) {
        const struct kl_pose *pose;
        double inverse[16];
        double c[9];
        kl_status st = kl_motion_pose(job, k, &pose, err);
        if (st != KL_OK) return st;
        const double *m = pose->world_from_node + 16 * (size_t)node;
        const double det = kl_mat4_cofactors(m, c);
        if (k == 0) first = det;
        if (!invert(m, inverse) || (det < 0.0) != (first < 0.0)) *out = false;
    }
    return KL_OK;
}

static kl_status rigid_moves(struct kl_motion_job *job, const struct track *t, bool *out,
                             struct kl_err *err)
{
    *out = false;
    for (uint32_t k = 0; k <= GRID && !*out; k += job->is_instant ? GRID : GRID / 8) {
        const struct kl_pose *pose;
        double m[12];
        kl_status st = kl_motion_pose(job, k, &pose, err);
        if (st != KL_OK) return st;
        matrix_of(job, t, pose, m);
        for (int c = 0; c < 8; ++c) {
            double p[3];
            apply(m, t->corners[c], p);
            *out = *out || distance(p, t->reference[c]) > standstill * (double)job->flat->radius;
        }
    }
    return KL_OK;
}

/* Distance of the real way from the straight one between grid points a and b, at c between them. */
static kl_status rigid_error(struct kl_motion_job *job, const struct track *t, const uint32_t at[3],
                             double *out, struct kl_err *err)
{
    const double share = (double)(at[2] - at[0]) / (double)(at[1] - at[0]);
    double m[3][12];

    for (int i = 0; i < 3; ++i) {
        const struct kl_pose *pose;
        kl_status st = kl_motion_pose(job, at[i], &pose, err);
        if (st != KL_OK) return st;
        matrix_of(job, t, pose, m[i]);
    }
    for (int i = 0; i < 12; ++i) {
        m[0][i] = (1.0 - share) * m[0][i] + share * m[1][i];
    }
    for (int c = 0; c < 8; ++c) {
        double straight[3];
        double real[3];
        apply(m[0], t->corners[c], straight);
        apply(m[2], t->corners[c], real);
        *out = fmax(*out, distance(straight, real));
    }
    return KL_OK;
}

/* Fewest segments, a power of two, with which the way between steps is straight enough. An even
 * number, so that the reference instant is a step. */
static kl_status rigid_segments(struct kl_motion_job *job, const struct track *t, uint32_t *out,
                                struct kl_err *err)
{
    for (uint32_t n = 2; n < GRID; n *= 2) {
        const uint32_t stride = GRID / n;
        const uint32_t sub = stride >= 4 ? stride / 4 : 1;
        double error = 0.0;
        for (uint32_t k = 0; k < GRID; k += sub) {
            if (k % stride == 0) continue;
            const uint32_t at[3] = {k - k % stride, k - k % stride + stride, k};
            kl_status st = rigid_error(job, t, at, &error, err);
            if (st != KL_OK) return st;
        }
        *out = n;
        if (error <= tolerance * (double)job->flat->radius) return KL_OK;
    }
    *out = GRID;
    return KL_OK;
}

/* The entry of a merged instance that moves, or of the shared one. */
static kl_moving *add_moving(struct kl_motion_job *job, const struct track *t)
{
    struct kl_motion *m = job->motion;
    if (t->place.instance != 0) return &m->moving[t->place.instance];
    kl_instance *instance = &m->instances[m->instance_count];
    memset(instance, 0, sizeof *instance);
    for (int r = 0; r < 3; ++r) {
        instance->render_from_object[5 * r] = 1.0f;
        instance->object_from_render[5 * r] = 1.0f;
    }
    instance->first_triangle = t->place.first_triangle;
    instance->triangle_count = t->mesh->triangle_count;
    instance->object = job->scene->instances[t->index].object;
    return &m->moving[m->instance_count++];
}

static kl_status add_rigid(struct kl_motion_job *job, const struct track *t, struct kl_err *err)
{
    struct kl_motion *motion = job->motion;
    bool moves = false;
    uint32_t segments = 0;
    size_t capacity = motion->matrix_count;
    kl_status st = rigid_moves(job, t, &moves, err);

    if (st != KL_OK || !moves) return st;
    if (!job->is_instant) st = rigid_segments(job, t, &segments, err);
    const uint32_t stride = segments > 0 ? GRID / segments : GRID;
    if (st == KL_OK) {
        st = kl_grow_array(&motion->matrices, &capacity, motion->matrix_count + segments + 1,
                           12 * sizeof(float), err);
    }
    if (st != KL_OK) return st;
    *add_moving(job, t) = (kl_moving){.steps = segments + 1, .first = (kl_u32)motion->matrix_count};
    for (uint32_t k = 0; k <= segments; ++k) {
        const struct kl_pose *pose;
        double m[12];
        st = kl_motion_pose(job, k * stride, &pose, err);
        if (st != KL_OK) return st;
        matrix_of(job, t, pose, m);
        if (k == segments / 2 && segments > 0 && t->place.instance == 0) {
            static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
            memcpy(m, identity, sizeof m); /* without the rounding of the inverse */
        }
        for (int i = 0; i < 12; ++i) {
            motion->matrices[12 * motion->matrix_count + (size_t)i] = (float)m[i];
        }
        ++motion->matrix_count;
    }
    ++motion->rigid_count;
    motion->most_steps = segments + 1 > motion->most_steps ? segments + 1 : motion->most_steps;
    return KL_OK;
}

/* Vertices of a deforming instance on the grid, made when asked for. */
struct shapes {
    float *positions[GRID + 1], *normals[GRID + 1], *tangents[GRID + 1];
};

static void shapes_fini(struct shapes *s)
{
    for (int k = 0; k <= GRID; ++k) {
        free(s->positions[k]);
        free(s->normals[k]);
        free(s->tangents[k]);
    }
}

static kl_status shape_at(struct kl_motion_job *job, const struct track *t, uint32_t at,
                          struct shapes *s, struct kl_err *err)
{
    const size_t n = t->mesh->vertex_count;
    const struct kl_pose *pose;

    if (s->positions[at] != NULL) return KL_OK;
    kl_status st = kl_motion_pose(job, at, &pose, err);
    if (st == KL_OK) st = kl_alloc_array(&s->positions[at], n, 3 * sizeof(float), err);
    if (st == KL_OK) st = kl_alloc_array(&s->normals[at], n, 3 * sizeof(float), err);
    if (st == KL_OK && job->flat->tangents != NULL) {
        st = kl_alloc_array(&s->tangents[at], n, 4 * sizeof(float), err);
    }
    if (st != KL_OK) return st;
    return kl_flat_place_vertices(job->scene, pose, t->index, job->flat->origin, s->positions[at],
                                  s->normals[at], s->tangents[at], err);
}

static kl_status shape_moves(struct kl_motion_job *job, const struct track *t, struct shapes *s,
                             bool *out, struct kl_err *err)
{
    const float *reference = job->flat->positions + 3 * (size_t)t->place.first_vertex;
    const float far = (float)standstill * job->flat->radius;

    *out = false;
    for (uint32_t k = 0; k <= GRID && !*out; k += job->is_instant ? GRID : GRID / 4) {
        kl_status st = shape_at(job, t, k, s, err);
        if (st != KL_OK) return st;
        for (size_t i = 0; i < 3 * (size_t)t->mesh->vertex_count; ++i) {
            *out = *out || fabsf(s->positions[k][i] - reference[i]) > far;
        }
    }
    return KL_OK;
}

static kl_status shape_segments(struct kl_motion_job *job, const struct track *t, struct shapes *s,
                                uint32_t *out, struct kl_err *err)
{
    const size_t numbers = 3 * (size_t)t->mesh->vertex_count;

    for (uint32_t n = 2; n <= DEFORM_SEGMENTS; n *= 2) {
        const uint32_t stride = GRID / n;
        float error = 0.0f;
        for (uint32_t k = 0; k < GRID; k += stride) {
            const uint32_t at[3] = {k, k + stride / 2, k + stride};
            kl_status st = KL_OK;
            for (int i = 0; st == KL_OK && i < 3; ++i) {
                st = shape_at(job, t, at[i], s, err);
            }
            if (st != KL_OK) return st;
            const float *const p[3] = {s->positions[at[0]], s->positions[at[1]],
                                       s->positions[at[2]]};
            for (size_t i = 0; i < numbers; ++i) {
                error = fmaxf(error, fabsf(p[1][i] - 0.5f * (p[0][i] + p[2][i])));
            }
        }
        *out = n;
        if ((double)error <= tolerance * (double)job->flat->radius) return KL_OK;
    }
    return KL_OK;
}

static kl_status store_shapes(struct kl_motion_job *job, const struct track *t, struct shapes *s,
                              uint32_t segments, struct kl_err *err)
{
    struct kl_motion *m = job->motion;
    const size_t n = t->mesh->vertex_count;
    const uint32_t stride = segments > 0 ? GRID / segments : GRID;
    const size_t count = m->vertex_count + n * (segments + 1);
    size_t capacity[3] = {m->vertex_count, m->vertex_count, m->vertex_count};
    kl_status st = kl_grow_array(&m->positions, &capacity[0], count, 3 * sizeof(float), err);

    if (st == KL_OK) st = kl_grow_array(&m->normals, &capacity[1], count, 3 * sizeof(float), err);
    if (st == KL_OK && job->flat->tangents != NULL) {
        st = kl_grow_array(&m->tangents, &capacity[2], count, 3 * sizeof(float), err);
    }
    if (count > UINT32_MAX && st == KL_OK) {
        st = kl_fail(err, KL_ERR_INPUT, "%s: too many vertices in motion", job->scene->path);
    }
    if (st != KL_OK) return st;
    *add_moving(job, t) = (kl_moving){.steps = segments + 1,
                                      .deforms = 1,
                                      .first = (kl_u32)m->vertex_count,
                                      .first_vertex = t->place.first_vertex,
                                      .vertex_count = (kl_u32)n};
    for (uint32_t k = 0; k <= segments; ++k) {
        st = shape_at(job, t, k * stride, s, err);
        if (st != KL_OK) return st;
        memcpy(m->positions + 3 * m->vertex_count, s->positions[k * stride], 12 * n);
        memcpy(m->normals + 3 * m->vertex_count, s->normals[k * stride], 12 * n);
        for (size_t v = 0; m->tangents != NULL && v < n; ++v) {
            memcpy(m->tangents + 3 * (m->vertex_count + v), s->tangents[k * stride] + 4 * v, 12);
        }
        m->vertex_count += n;
    }
    ++m->deforming_count;
    m->most_steps = segments + 1 > m->most_steps ? segments + 1 : m->most_steps;
    return KL_OK;
}

static kl_status add_deforming(struct kl_motion_job *job, const struct track *t, struct kl_err *err)
{
    struct shapes *shapes = NULL;
    bool moves = false;
    uint32_t segments = 0;
    kl_status st = kl_alloc_array(&shapes, 1, sizeof *shapes, err);

    if (st != KL_OK) return st;
    st = shape_moves(job, t, shapes, &moves, err);
    if (st == KL_OK && moves && !job->is_instant)
        st = shape_segments(job, t, shapes, &segments, err);
    if (st == KL_OK && moves) st = store_shapes(job, t, shapes, segments, err);
    shapes_fini(shapes);
    free(shapes);
    return st;
}

static kl_status add_track(struct kl_motion_job *job, uint32_t index, struct kl_err *err)
{
    const struct kl_scene_instance *in = &job->scene->instances[index];
    struct track t = {.index = index,
                      .mesh = &job->scene->meshes[in->mesh],
                      .place = job->flat->places[index],
                      .deforms = kl_instance_is_deformed(job->scene, index)};
    bool regular = true;

    if (t.mesh->triangle_count == 0) return KL_OK;
    if (!t.deforms && t.place.instance == 0) {
        const double *m = job->pose->world_from_node + 16 * (size_t)in->node;
        kl_status st = is_regular(job, &t, &regular, err);
        if (st != KL_OK) return st;
        t.deforms = !regular || !invert(m, t.from_reference);
    }
    if (t.deforms) return add_deforming(job, &t, err);
    find_corners(job, &t);
    return add_rigid(job, &t, err);
}

uint32_t kl_motion_find(const struct kl_motion *motion, uint32_t triangle)
{
    uint32_t low = motion->shared_count; /* merged ones are in the order of their triangles */
    uint32_t high = motion->instance_count;

    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        const kl_instance *in = &motion->instances[middle];
        if (triangle < in->first_triangle) {
            high = middle;
        } else if (triangle >= in->first_triangle + in->triangle_count) {
            low = middle + 1;
        } else {
            return middle;
        }
    }
    return KL_NONE;
}

static void set_views(struct kl_motion_job *job)
{
    struct kl_motion *m = job->motion;
    m->reference = job->flat->view;
    m->reference.instance_count = m->instance_count;
    m->reference.instances = m->instances;
    m->view = m->reference;
    m->view.needs |= KL_NEED_MOTION;
    for (int i = 0; i < KL_SHUTTER_TIMES; ++i) {
        m->shutter_times[i] =
            job->span.times != NULL ? job->span.times[i] : (float)i / (float)(KL_SHUTTER_TIMES - 1);
    }
    m->view.shutter_times = m->shutter_times;
    m->view.moving = m->moving;
    m->view.step_matrices = m->matrices;
    m->view.step_positions = m->positions;
    m->view.step_normals = m->normals;
    m->view.step_tangents = m->tangents;
    m->view.material_motion = m->material_motion;
    m->view.step_materials = m->step_materials;
}

static kl_status start(struct kl_motion_job *job, struct kl_err *err)
{
    const struct kl_flat *flat = job->flat;
    struct kl_motion *m = NULL;
    const size_t most = (size_t)flat->instance_count + job->scene->instance_count;
    kl_status st = kl_alloc_array(&job->motion, 1, sizeof *m, err);

    if (st != KL_OK) return st;
    m = job->motion;
    st = kl_alloc_array(&m->instances, most, sizeof *m->instances, err);
    if (st == KL_OK) st = kl_alloc_array(&m->moving, most, sizeof *m->moving, err);
    if (st == KL_OK) {
        st = kl_alloc_array(&m->material_motion, flat->material_count, sizeof(uint32_t), err);
    }
    if (st != KL_OK) return st;
    memcpy(m->instances, flat->instances, flat->instance_count * sizeof *m->instances);
    memset(m->material_motion, 0xff, flat->material_count * sizeof(uint32_t));
    m->instance_count = flat->instance_count;
    m->shared_count = flat->instance_count;
    return KL_OK;
}

kl_status kl_motion_create(const struct kl_scene *scene, uint32_t animation,
                           const struct kl_pose *pose, struct kl_flat *flat,
                           const struct kl_motion_span *span, struct kl_motion **out,
                           struct kl_err *err)
{
    struct kl_motion_job job = {.scene = scene,
                                .animation = animation,
                                .pose = pose,
                                .flat = flat,
                                .span = *span,
                                .is_instant = !(span->close > span->open)};
    kl_status st = start(&job, err);

    for (uint32_t i = 0; st == KL_OK && i < scene->instance_count; ++i) {
        if (kl_instance_is_animated(scene, animation, i)) st = add_track(&job, i, err);
    }
    if (st == KL_OK && !job.is_instant) st = kl_motion_add_materials(&job, err);
    if (st == KL_OK) set_views(&job); /* lights ask where triangles are */
    if (st == KL_OK && !job.is_instant) st = kl_motion_add_lights(&job, err);
    for (int k = 0; k <= GRID; ++k) {
        kl_pose_destroy(job.poses[k]);
    }
    const struct kl_motion *m = job.motion;
    if (st != KL_OK ||
        m->rigid_count + m->deforming_count + m->moving_lights + m->moving_materials == 0) {
        kl_motion_destroy(job.motion);
        job.motion = NULL;
    }
    *out = job.motion;
    return st;
}

void kl_motion_destroy(struct kl_motion *motion)
{
    if (motion == NULL) return;
    free(motion->instances);
    free(motion->moving);
    free(motion->matrices);
    free(motion->positions);
    free(motion->normals);
    free(motion->tangents);
    free(motion->triangles);
    free(motion->lights);
    free(motion->light_nodes);
    free(motion->light_motion);
    free(motion->touch_bits);
    free(motion->step_lights);
    free(motion->material_motion);
    free(motion->step_materials);
    free(motion);
}

kl_vec3 kl_motion_point(const struct kl_motion *motion, const kl_hit *hit, float time,
                        kl_vec3 still)
{
    if (motion == NULL) return still;
    const bool shared = hit->instance > 0 && hit->instance < motion->shared_count;
    const uint32_t instance = shared ? hit->instance : kl_motion_find(motion, hit->triangle);
    if (instance == KL_NONE || motion->moving[instance].steps == 0) return still;
    const kl_corners k =
        kl_moved_corners(&motion->view, instance, &motion->view.triangles[hit->triangle], time);
    return kl_lerp3(k.a, k.b, k.c, hit->u, hit->v);
}

static void add(struct kl_hash *h, const void *data, size_t count, size_t size)
{
    const uint64_t n = data != NULL ? count : 0;
    kl_hash_update(h, &n, sizeof n);
    kl_hash_update(h, data, (size_t)n * size);
}

void kl_motion_digest(const struct kl_motion *motion, struct kl_hash *hash)
{
    const struct kl_motion *m = motion;
    if (m == NULL) return;
    add(hash, m->shutter_times, KL_SHUTTER_TIMES, sizeof *m->shutter_times);
    add(hash, m->moving, m->instance_count, sizeof *m->moving);
    add(hash, m->matrices, m->matrix_count, 12 * sizeof(float));
    add(hash, m->positions, m->vertex_count, 3 * sizeof(float));
    add(hash, m->normals, m->vertex_count, 3 * sizeof(float));
    add(hash, m->tangents, m->vertex_count, 3 * sizeof(float));
    add(hash, m->step_lights, m->step_light_count, sizeof *m->step_lights);
    add(hash, m->step_materials, m->step_material_count, sizeof *m->step_materials);
}
