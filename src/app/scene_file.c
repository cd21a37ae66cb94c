#include "src/app/scene_file.h"

#include "src/app/exit_code.h"
#include "src/app/folders.h"
#include "src/import/import.h"

#include <stdio.h>
#include <string.h>

static kl_status find_animation(const struct kl_scene *scene, const char *name, uint32_t *out,
                                struct kl_err *err)
{
    char list[256] = "none";
    size_t used = 0;

    *out = KL_NONE;
    if (name == NULL || strcmp(name, "all") == 0) return KL_OK;
    for (uint32_t i = 0; i < scene->animation_count; ++i) {
        if (strcmp(scene->animations[i].name, name) == 0) {
            *out = i;
            return KL_OK;
        }
        const int n = snprintf(list + used, sizeof list - used, "%s'%s'", used > 0 ? ", " : "",
                               scene->animations[i].name);
        if (n > 0 && used + (size_t)n < sizeof list) used += (size_t)n;
    }
    return kl_fail(err, KL_ERR_USAGE, "--animation: no animation '%s' in the scene, which has: %s",
                   name, list);
}

kl_status kl_scene_file_load(const struct kl_options *options, struct kl_scene **out,
                             uint32_t *animation, struct kl_err *err)
{
    struct kl_scene *scene = NULL;
    kl_status st = kl_file_expect(options->arguments[0], "", err);

    if (st == KL_OK && options->env != NULL) st = kl_file_expect(options->env, "--env: ", err);
    if (st == KL_OK) {
        st = kl_import_gltf(options->arguments[0], kl_say_warning, NULL, &scene, err);
    }
    if (st != KL_OK) return st;
    if (options->env != NULL) {
        st = kl_import_environment(scene, options->env, kl_say_warning, NULL, err);
    }
    if (st == KL_OK) st = find_animation(scene, options->animation, animation, err);
    if (st != KL_OK) {
        kl_scene_destroy(scene);
        return st;
    }
    *out = scene;
    return KL_OK;
}

void kl_need_names(uint32_t needs, const char *names[KL_NEED_NAMES])
{
    static const struct {
        uint32_t bit;
        const char *name;
    } known[] = {
        {KL_NEED_TEXTURES, "textures"},
        {KL_NEED_ALPHA, "alpha"},
        {KL_NEED_INSTANCES, "instances"},
        {KL_NEED_ENVIRONMENT, "environment"},
        {KL_NEED_PUNCTUAL, "punctual lights"},
        {KL_NEED_EMITTERS, "emitters"},
        {KL_NEED_VERTEX_COLORS, "vertex colours"},
        {KL_NEED_SPECULAR, "specular"},
        {KL_NEED_NORMAL_MAPS, "normal maps"},
        {KL_NEED_MOTION, "motion"},
    };
    size_t used = 0;

    for (size_t i = 0; i < sizeof known / sizeof known[0]; ++i) {
        if ((needs & known[i].bit) != 0) names[used++] = known[i].name;
    }
    names[used] = NULL;
}
