/* Animation sampling: glTF 2.0 section 3.11 and appendix C. */
#include "src/scene/scene.h"

#include "src/base/memory.h"
#include "src/scene/matrix4.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* The local transform of a node while channels are applied to it. */
struct local_transform {
    double translation[3], rotation[4], scale[3];
};

/* The span that holds `time`: keys `first` and `first + 1`, at 0 <= fraction < 1 between them. At
 * and beyond the ends both are the end key. */
struct key_span {
    uint32_t first, second;
    double fraction;
    double length; /* [s] */
};

static struct key_span find_span(const struct kl_animation_channel *channel, double time)
{
    const uint32_t last = channel->key_count - 1;
    struct key_span span = {0, 0, 0.0, 0.0};
    uint32_t low = 0;
    uint32_t high = last;

    if (!(time > (double)channel->times[0])) return span;
    if (time >= (double)channel->times[last]) {
        span.first = span.second = last;
        return span;
    }
    while (high - low > 1) { /* times[low] <= time < times[high] */
        const uint32_t middle = low + (high - low) / 2;
        if (time >= (double)channel->times[middle]) {
            low = middle;
        } else {
            high = middle;
        }
    }
    span.first = low;
    span.second = high;
    span.length = (double)channel->times[high] - (double)channel->times[low];
    span.fraction = (time - (double)channel->times[low]) / span.length;
    return span;
}

/* Appendix C.4: the shorter way round; nearly equal rotations are mixed, as the sine vanishes. */
static void slerp(const float *a, const float *b, double t, double out[4])
{
    double cosine = 0.0;
    double weight_a = 1.0 - t;
    double weight_b = t;

    for (int i = 0; i < 4; ++i) {
        cosine += (double)a[i] * (double)b[i];
    }
    const double sign = cosine < 0.0 ? -1.0 : 1.0;
    cosine = fabs(cosine);
    if (cosine < 0.99999) {
        const double angle = acos(cosine);
        const double sine = sin(angle);
        weight_a = sin((1.0 - t) * angle) / sine;
        weight_b = sin(t * angle) / sine;
    }
    for (int i = 0; i < 4; ++i) {
        out[i] = weight_a * (double)a[i] + sign * weight_b * (double)b[i];
    }
}

/* Appendix C.5: cubic Hermite spline; the tangents are per second. */
static void hermite(const struct kl_animation_channel *channel, const struct key_span *span,
                    double *out)
{
    const size_t width = channel->width;
    const float *from = channel->values + (size_t)span->first * 3 * width;
    const float *to = channel->values + (size_t)span->second * 3 * width;
    const double t = span->fraction;
    const double t2 = t * t;
    const double t3 = t2 * t;

    for (size_t i = 0; i < width; ++i) {
        const double value_0 = (double)from[width + i];
        const double out_tangent = (double)from[2 * width + i] * span->length;
        const double in_tangent = (double)to[i] * span->length;
        const double value_1 = (double)to[width + i];
        out[i] = (2.0 * t3 - 3.0 * t2 + 1.0) * value_0 + (t3 - 2.0 * t2 + t) * out_tangent +
                 (-2.0 * t3 + 3.0 * t2) * value_1 + (t3 - t2) * in_tangent;
    }
}

static void normalize_quaternion(double q[4])
{
    const double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);

    if (!(length > 0.0) || !isfinite(length)) {
        q[0] = q[1] = q[2] = 0.0;
        q[3] = 1.0;
        return;
    }
    for (int i = 0; i < 4; ++i) {
        q[i] /= length;
    }
}

/* `out` has room for channel->width numbers. */
static void sample_channel(const struct kl_animation_channel *channel, double time, double *out)
{
    const struct key_span span = find_span(channel, time);
    const size_t width = channel->width;
    const float *a = channel->values + (size_t)span.first * width;
    const float *b = channel->values + (size_t)span.second * width;

    if (channel->interpolation == KL_CUBIC_SPLINE) {
        hermite(channel, &span, out);
    } else if (channel->interpolation == KL_STEP) {
        for (size_t i = 0; i < width; ++i) {
            out[i] = (double)a[i];
        }
    } else if (channel->path == KL_ROTATION) {
        slerp(a, b, span.fraction, out);
    } else {
        for (size_t i = 0; i < width; ++i) {
            out[i] = (1.0 - span.fraction) * (double)a[i] + span.fraction * (double)b[i];
        }
    }
    if (channel->path == KL_ROTATION) normalize_quaternion(out);
}

static void sample_float(const struct kl_animation_channel *channel, double time, float *out)
{
    double values[4];
    sample_channel(channel, time, values);
    for (uint32_t i = 0; i < channel->width; ++i) {
        out[i] = (float)values[i];
    }
}

static void apply_to_light(const struct kl_animation_channel *channel, double time,
                           struct kl_scene_light *light)
{
    double *target = &light->intensity;

    if (channel->path == KL_LIGHT_COLOR) target = light->color;
    if (channel->path == KL_LIGHT_RANGE) target = &light->range;
    if (channel->path == KL_LIGHT_INNER_CONE) target = &light->inner_cone;
    if (channel->path == KL_LIGHT_OUTER_CONE) target = &light->outer_cone;
    sample_channel(channel, time, target);
}

static void apply_to_camera(const struct kl_animation_channel *channel, double time,
                            struct kl_scene_camera *camera)
{
    double value;

    sample_channel(channel, time, &value);
    if (!(value > 0.0)) return; /* no such camera: a spline may swing too far */
    if (channel->path == KL_CAMERA_YFOV && value < 3.14) camera->yfov = value;
    if (channel->path == KL_CAMERA_XMAG) camera->xmag = value;
    if (channel->path == KL_CAMERA_YMAG) camera->ymag = value;
}

static void apply_to_material(const struct kl_animation_channel *channel, double time,
                              kl_material *m, struct kl_scene_glow *glow)
{
    switch ((int)channel->path) {
    case KL_MATERIAL_BASE_COLOR:
        sample_float(channel, time, m->base_color);
        break;
    case KL_MATERIAL_METALLIC:
        sample_float(channel, time, &m->metallic);
        break;
    case KL_MATERIAL_ROUGHNESS:
        sample_float(channel, time, &m->roughness);
        break;
    case KL_MATERIAL_NORMAL_SCALE:
        sample_float(channel, time, &m->normal_scale);
        break;
    case KL_MATERIAL_ALPHA_CUTOFF:
        sample_float(channel, time, &m->alpha_cutoff);
        break;
    case KL_MATERIAL_IOR:
        sample_float(channel, time, &m->ior);
        break;
    case KL_MATERIAL_SPECULAR:
        sample_float(channel, time, &m->specular);
        break;
    case KL_MATERIAL_SPECULAR_COLOR:
        sample_float(channel, time, m->specular_color);
        break;
    case KL_MATERIAL_EMISSIVE_FACTOR:
        sample_float(channel, time, glow->factor);
        break;
    default:
        sample_float(channel, time, &glow->strength);
        break;
    }
}

/* Between keys a spline may leave the range in which values mean anything. */
static void settle_material(kl_material *m, const struct kl_scene_glow *glow)
{
    for (int i = 0; i < 4; ++i) {
        m->base_color[i] = kl_clamp(m->base_color[i], 0.0f, 1.0f);
    }
    for (int i = 0; i < 3; ++i) {
        m->specular_color[i] = kl_fmax(m->specular_color[i], 0.0f);
        m->emission[i] = kl_fmax(glow->factor[i], 0.0f) * kl_fmax(glow->strength, 0.0f);
    }
    m->metallic = kl_clamp(m->metallic, 0.0f, 1.0f);
    m->roughness = kl_clamp(m->roughness, 0.0f, 1.0f);
    m->specular = kl_clamp(m->specular, 0.0f, 1.0f);
    if (m->ior != 0.0f) m->ior = kl_fmax(m->ior, 1.0f);
}

static void settle_light(struct kl_scene_light *light)
{
    for (int i = 0; i < 3; ++i) {
        light->color[i] = fmax(light->color[i], 0.0);
    }
    light->intensity = fmax(light->intensity, 0.0);
    light->range = fmax(light->range, 0.0);
    light->outer_cone = fmin(fmax(light->outer_cone, 1e-3), 1.5707963);
    light->inner_cone = fmin(fmax(light->inner_cone, 0.0), 0.999 * light->outer_cone);
}

/* What channels that are not of nodes change, with copies made for it. */
struct changed {
    struct kl_scene_glow *glows;
    bool *materials; /* that some channel is about */
};

static void apply_to_thing(const struct kl_scene *scene, const struct kl_animation_channel *channel,
                           double time, struct kl_pose *pose, struct changed *changed)
{
    const uint32_t target = channel->node;

    for (uint32_t i = 0; channel->path <= KL_LIGHT_OUTER_CONE && i < scene->light_count; ++i) {
        if (pose->lights[i].source == target) apply_to_light(channel, time, &pose->lights[i]);
    }
    if (channel->path <= KL_LIGHT_OUTER_CONE) return;
    for (uint32_t i = 0; channel->path <= KL_CAMERA_YMAG && i < scene->camera_count; ++i) {
        if (pose->cameras[i].source == target) apply_to_camera(channel, time, &pose->cameras[i]);
    }
    if (channel->path <= KL_CAMERA_YMAG) return;
    changed->materials[target] = true;
    apply_to_material(channel, time, &pose->materials[target], &changed->glows[target]);
}

static void apply_animation(const struct kl_scene *scene, const struct kl_animation *animation,
                            double time, struct local_transform *local, struct kl_pose *pose,
                            struct changed *changed)
{
    for (uint32_t c = 0; c < animation->channel_count; ++c) {
        const struct kl_animation_channel *channel = &animation->channels[c];
        if (!kl_path_is_of_node(channel->path)) {
            apply_to_thing(scene, channel, time, pose, changed);
            continue;
        }
        struct local_transform *target = &local[channel->node];
        if (channel->path == KL_TRANSLATION) sample_channel(channel, time, target->translation);
        if (channel->path == KL_ROTATION) sample_channel(channel, time, target->rotation);
        if (channel->path == KL_SCALE) sample_channel(channel, time, target->scale);
        if (channel->path == KL_WEIGHTS)
            sample_channel(channel, time, pose->weights[channel->node]);
    }
}

static bool has_things(const struct kl_scene *scene, uint32_t animation)
{
    for (uint32_t a = 0; a < scene->animation_count; ++a) {
        if (animation != KL_NONE && animation != a) continue;
        for (uint32_t c = 0; c < scene->animations[a].channel_count; ++c) {
            if (!kl_path_is_of_node(scene->animations[a].channels[c].path)) return true;
        }
    }
    return false;
}

static kl_status copy_things(const struct kl_scene *scene, struct kl_pose *pose,
                             struct changed *changed, struct kl_err *err)
{
    kl_status st = kl_alloc_array(&pose->lights, scene->light_count, sizeof *pose->lights, err);
    if (st == KL_OK) {
        st = kl_alloc_array(&pose->cameras, scene->camera_count, sizeof *pose->cameras, err);
    }
    if (st == KL_OK) {
        st = kl_alloc_array(&pose->materials, scene->material_count, sizeof *pose->materials, err);
    }
    if (st == KL_OK) {
        st = kl_alloc_array(&changed->glows, scene->material_count, sizeof *changed->glows, err);
    }
    if (st == KL_OK) {
        st = kl_alloc_array(&changed->materials, scene->material_count, sizeof(bool), err);
    }
    if (st != KL_OK) return st;
    for (uint32_t i = 0; i < scene->light_count; ++i) {
        pose->lights[i] = scene->lights[i];
    }
    for (uint32_t i = 0; i < scene->camera_count; ++i) {
        pose->cameras[i] = scene->cameras[i];
    }
    for (uint32_t i = 0; i < scene->material_count; ++i) {
        pose->materials[i] = scene->materials[i];
        changed->glows[i] = scene->glows[i];
    }
    return KL_OK;
}

static void settle_things(const struct kl_scene *scene, struct kl_pose *pose,
                          const struct changed *changed)
{
    for (uint32_t i = 0; i < scene->light_count; ++i) {
        if (memcmp(&pose->lights[i], &scene->lights[i], sizeof pose->lights[i]) != 0) {
            settle_light(&pose->lights[i]);
        }
    }
    for (uint32_t i = 0; i < scene->material_count; ++i) {
        if (changed->materials[i]) settle_material(&pose->materials[i], &changed->glows[i]);
    }
}

static kl_status init_pose(const struct kl_scene *scene, struct kl_pose *pose,
                           struct local_transform *local, struct kl_err *err)
{
    kl_status st =
        kl_alloc_array(&pose->world_from_node, scene->node_count, 16 * sizeof(double), err);
    if (st != KL_OK) return st;
    st = kl_alloc_array(&pose->weights, scene->node_count, sizeof(double *), err);
    if (st != KL_OK) return st;
    pose->node_count = scene->node_count;
    for (uint32_t n = 0; n < scene->node_count; ++n) {
        const struct kl_node *node = &scene->nodes[n];
        memcpy(local[n].translation, node->translation, sizeof node->translation);
        memcpy(local[n].rotation, node->rotation, sizeof node->rotation);
        memcpy(local[n].scale, node->scale, sizeof node->scale);
        if (node->weight_count == 0) continue;
        st = kl_alloc_array(&pose->weights[n], node->weight_count, sizeof(double), err);
        if (st != KL_OK) return st;
        memcpy(pose->weights[n], node->weights, node->weight_count * sizeof(double));
    }
    return KL_OK;
}

static void compose_world(const struct kl_scene *scene, const struct local_transform *local,
                          double time, struct kl_pose *pose)
{
    double turn[16];

    if (scene->plate.count > 0) kl_plate_matrix(&scene->plate, time, turn);
    for (uint32_t n = 0; n < scene->node_count; ++n) {
        const struct kl_node *node = &scene->nodes[n];
        double *world = &pose->world_from_node[(size_t)n * 16];
        double matrix[16];
        if (node->has_matrix) {
            memcpy(matrix, node->matrix, sizeof matrix);
        } else {
            kl_mat4_from_trs(local[n].translation, local[n].rotation, local[n].scale, matrix);
        }
        if (node->parent == KL_NONE) {
            memcpy(world, matrix, sizeof matrix);
        } else { /* parents come first */
            kl_mat4_multiply(&pose->world_from_node[(size_t)node->parent * 16], matrix, world);
        }
        if (scene->plate.count > 0 && node->turns) {
            memcpy(matrix, world, sizeof matrix);
            kl_mat4_multiply(turn, matrix, world);
        }
    }
}

kl_status kl_pose_create(const struct kl_scene *scene, uint32_t animation, double time,
                         struct kl_pose **out, struct kl_err *err)
{
    struct kl_pose *pose = NULL;
    struct local_transform *local = NULL;
    struct changed changed = {0};

    kl_status st = kl_alloc_array(&pose, 1, sizeof *pose, err);
    if (st != KL_OK) goto cleanup;
    st = kl_alloc_array(&local, scene->node_count, sizeof *local, err);
    if (st != KL_OK) goto cleanup;
    st = init_pose(scene, pose, local, err);
    const bool things = has_things(scene, animation);
    if (st == KL_OK && things) st = copy_things(scene, pose, &changed, err);
    if (st != KL_OK) goto cleanup;
    for (uint32_t a = 0; a < scene->animation_count; ++a) {
        if (animation != KL_NONE && animation != a) continue;
        apply_animation(scene, &scene->animations[a], time, local, pose, &changed);
    }
    if (things) settle_things(scene, pose, &changed);
    compose_world(scene, local, time, pose);
    *out = pose;
    pose = NULL;

cleanup:
    free(local);
    free(changed.glows);
    free(changed.materials);
    kl_pose_destroy(pose);
    return st;
}

void kl_pose_destroy(struct kl_pose *pose)
{
    if (pose == NULL) return;
    for (uint32_t n = 0; n < pose->node_count; ++n) {
        free(pose->weights[n]);
    }
    free(pose->weights);
    free(pose->world_from_node);
    free(pose->lights);
    free(pose->cameras);
    free(pose->materials);
    free(pose);
}
