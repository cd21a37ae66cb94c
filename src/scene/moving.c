/* What moves: asked per scene to build only what it needs. */
#include "src/scene/scene.h"

#include <string.h>

/* A channel whose keys all say the same moves nothing. */
static bool channel_moves(const struct kl_animation_channel *channel)
{
    const size_t width = channel->width;
    const bool cubic = channel->interpolation == KL_CUBIC_SPLINE;
    const size_t stride = cubic ? 3 * width : width;
    const size_t value = cubic ? width : 0; /* after the in-tangent */

    for (uint32_t k = 0; k < channel->key_count; ++k) {
        const float *key = channel->values + k * stride;
        if (memcmp(key + value, channel->values + value, width * sizeof(float)) != 0) return true;
        for (size_t i = 0; cubic && channel->key_count > 1 && i < width; ++i) {
            if (key[i] != 0.0f || key[2 * width + i] != 0.0f) return true;
        }
    }
    return false;
}

/* `weights`: ask for channels of morph weights, else for those of the transform. */
static bool node_has_channel(const struct kl_scene *scene, uint32_t animation, uint32_t node,
                             bool weights)
{
    for (uint32_t a = 0; a < scene->animation_count; ++a) {
        const struct kl_animation *from = &scene->animations[a];
        if (animation != KL_NONE && animation != a) continue;
        for (uint32_t c = 0; c < from->channel_count; ++c) {
            const struct kl_animation_channel *channel = &from->channels[c];
            const bool same = kl_path_is_of_node(channel->path) && channel->node == node &&
                              (channel->path == KL_WEIGHTS) == weights;
            if (same && channel_moves(channel)) return true;
        }
    }
    return false;
}

/* The node's place: its own transform or an ancestor's. */
static bool node_moves(const struct kl_scene *scene, uint32_t animation, uint32_t node)
{
    for (uint32_t n = node; n != KL_NONE; n = scene->nodes[n].parent) {
        if (scene->plate.count > 0 && scene->nodes[n].turns) return true;
        if (node_has_channel(scene, animation, n, false)) return true;
    }
    return false;
}

static bool skin_moves(const struct kl_scene *scene, uint32_t animation, uint32_t skin)
{
    for (uint32_t j = 0; j < scene->skins[skin].joint_count; ++j) {
        if (node_moves(scene, animation, scene->skins[skin].joints[j])) return true;
    }
    return false;
}

bool kl_instance_is_animated(const struct kl_scene *scene, uint32_t animation, uint32_t instance)
{
    const struct kl_scene_instance *in = &scene->instances[instance];
    return node_moves(scene, animation, in->node) ||
           node_has_channel(scene, animation, in->node, true) ||
           (in->skin != KL_NONE && skin_moves(scene, animation, in->skin));
}

bool kl_node_is_animated(const struct kl_scene *scene, uint32_t animation, uint32_t node)
{
    if (node_moves(scene, animation, node)) return true;
    if (node_has_channel(scene, animation, node, true)) return true;
    for (uint32_t i = 0; i < scene->instance_count; ++i) {
        const struct kl_scene_instance *instance = &scene->instances[i];
        if (instance->node != node || instance->skin == KL_NONE) continue;
        if (skin_moves(scene, animation, instance->skin)) return true;
    }
    return false;
}

/* Whether a channel changes light `source` of the file, or any material (KL_NONE). */
static bool thing_changes(const struct kl_scene *scene, uint32_t animation, uint32_t light)
{
    for (uint32_t a = 0; a < scene->animation_count; ++a) {
        const struct kl_animation *from = &scene->animations[a];
        if (animation != KL_NONE && animation != a) continue;
        for (uint32_t c = 0; c < from->channel_count; ++c) {
            const struct kl_animation_channel *channel = &from->channels[c];
            const bool of_light =
                !kl_path_is_of_node(channel->path) && channel->path <= KL_LIGHT_OUTER_CONE;
            const bool same = light == KL_NONE ? channel->path > KL_CAMERA_YMAG
                                               : of_light && channel->node == light;
            if (same && channel_moves(channel)) return true;
        }
    }
    return false;
}

bool kl_scene_is_moving(const struct kl_scene *scene, uint32_t animation)
{
    for (uint32_t i = 0; i < scene->instance_count; ++i) {
        if (kl_node_is_animated(scene, animation, scene->instances[i].node)) return true;
    }
    for (uint32_t i = 0; i < scene->light_count; ++i) {
        if (node_moves(scene, animation, scene->lights[i].node)) return true;
        if (thing_changes(scene, animation, scene->lights[i].source)) return true;
    }
    return thing_changes(scene, animation, KL_NONE);
}
