#include "src/scene/scene.h"

#include <stdlib.h>

static void free_mesh(struct kl_mesh *mesh)
{
    free(mesh->name);
    free(mesh->positions);
    free(mesh->normals);
    free(mesh->tangents);
    for (int set = 0; set < KL_MAX_UV_SETS; ++set) {
        free(mesh->uv[set]);
    }
    free(mesh->colors);
    free(mesh->indices);
    free(mesh->morph_positions);
    free(mesh->morph_normals);
    free(mesh->morph_tangents);
    free(mesh->joints);
    free(mesh->weights);
}

static void free_animation(struct kl_animation *animation)
{
    for (uint32_t c = 0; c < animation->channel_count; ++c) {
        free(animation->channels[c].times);
        free(animation->channels[c].values);
    }
    free(animation->channels);
    free(animation->name);
}

static void free_geometry(struct kl_scene *scene)
{
    for (uint32_t i = 0; i < scene->mesh_count; ++i) {
        free_mesh(&scene->meshes[i]);
    }
    for (uint32_t i = 0; i < scene->node_count; ++i) {
        free(scene->nodes[i].name);
        free(scene->nodes[i].weights);
    }
    for (uint32_t i = 0; i < scene->skin_count; ++i) {
        free(scene->skins[i].joints);
        free(scene->skins[i].inverse_bind);
    }
    free(scene->meshes);
    free(scene->nodes);
    free(scene->instances);
    free(scene->skins);
}

void kl_scene_destroy(struct kl_scene *scene)
{
    if (scene == NULL) return;
    free_geometry(scene);
    for (uint32_t i = 0; i < scene->camera_count; ++i) {
        free(scene->cameras[i].name);
    }
    for (uint32_t i = 0; i < scene->light_count; ++i) {
        free(scene->lights[i].name);
    }
    for (uint32_t i = 0; i < scene->image_count; ++i) {
        free(scene->images[i].name);
        free(scene->images[i].texels);
    }
    for (uint32_t i = 0; i < scene->animation_count; ++i) {
        free_animation(&scene->animations[i]);
    }
    free(scene->cameras);
    free(scene->lights);
    free(scene->materials);
    free(scene->glows);
    free(scene->images);
    free(scene->textures);
    free(scene->animations);
    free(scene->environment.rgb);
    free(scene->path);
    free(scene);
}
