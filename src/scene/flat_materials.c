#include "src/scene/flat_impl.h"

#include "src/base/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static bool slot_is_srgb(int slot)
{
    return slot == KL_TEX_BASE_COLOR || slot == KL_TEX_EMISSIVE || slot == KL_TEX_SPECULAR_COLOR;
}

static uint32_t material_needs(const kl_material *m)
{
    uint32_t needs = 0;
    for (int k = 0; k < KL_TEX_SLOTS; ++k) {
        if (m->tex[k].texture != KL_NONE) needs |= KL_NEED_TEXTURES;
    }
    if (m->tex[KL_TEX_NORMAL].texture != KL_NONE) needs |= KL_NEED_NORMAL_MAPS;
    if (m->flags & (KL_MAT_ALPHA_MASK | KL_MAT_ALPHA_BLEND)) needs |= KL_NEED_ALPHA;
    if (!(m->flags & KL_MAT_UNLIT) && (m->metallic > 0.0f || m->specular > 0.0f)) {
        needs |= KL_NEED_SPECULAR;
    }
    return needs;
}

/* Texture 2t reads texture t as linear values, 2t + 1 as sRGB: the slot decides which. */
void kl_flat_convert_material(const kl_material *in, kl_material *out)
{
    *out = *in;
    for (int k = 0; k < KL_TEX_SLOTS; ++k) {
        if (in->tex[k].texture == KL_NONE) continue;
        out->tex[k].texture = 2 * in->tex[k].texture + (slot_is_srgb(k) ? 1u : 0u);
    }
}

static void fill_srgb_table(float table[256])
{
    for (int i = 0; i < 256; ++i) { /* IEC 61966-2-1 */
        const double c = i / 255.0;
        table[i] = (float)(c <= 0.04045 ? c / 12.92 : pow((c + 0.055) / 1.055, 2.4));
    }
}

static kl_status add_textures(const struct kl_scene *scene, struct kl_flat *flat,
                              struct kl_err *err)
{
    uint32_t *first = NULL;
    uint64_t texels = 0;
    kl_status st = kl_alloc_array(&first, scene->image_count, sizeof *first, err);

    if (st != KL_OK) return st;
    for (uint32_t i = 0; i < scene->image_count; ++i) {
        first[i] = (uint32_t)texels;
        texels += (uint64_t)scene->images[i].width * scene->images[i].height;
    }
    flat->texture_count = 2 * scene->texture_count;
    flat->texel_count = (uint32_t)texels;
    if (texels >= UINT32_MAX) {
        st = kl_fail(err, KL_ERR_INPUT, "%s: textures of %llu texels, at most 2^32", scene->path,
                     (unsigned long long)texels);
    }
    if (st == KL_OK) st = kl_alloc_array(&flat->texels, flat->texel_count, 4, err);
    if (st == KL_OK) {
        st = kl_alloc_array(&flat->textures, flat->texture_count, sizeof(kl_texture), err);
    }
    if (st == KL_OK) st = kl_alloc_array(&flat->srgb_table, 256, sizeof(float), err);
    for (uint32_t i = 0; st == KL_OK && i < scene->image_count; ++i) {
        const struct kl_scene_image *image = &scene->images[i];
        memcpy(flat->texels + first[i], image->texels, 4 * (size_t)image->width * image->height);
    }
    for (uint32_t i = 0; st == KL_OK && i < flat->texture_count; ++i) {
        const struct kl_scene_texture *t = &scene->textures[i / 2];
        const struct kl_scene_image *image = &scene->images[t->image];
        flat->textures[i] = (kl_texture){first[t->image], image->width, image->height, t->wrap_s,
                                         t->wrap_t,       t->nearest,   i % 2,         0};
    }
    if (st == KL_OK) fill_srgb_table(flat->srgb_table);
    free(first);
    return st;
}

kl_status kl_flat_add_materials(const struct kl_scene *scene, const struct kl_pose *pose,
                                struct kl_flat *flat, struct kl_err *err)
{
    flat->material_count = scene->material_count;
    kl_status st =
        kl_alloc_array(&flat->materials, scene->material_count, sizeof(kl_material), err);
    if (st != KL_OK) return st;
    for (uint32_t i = 0; i < scene->material_count; ++i) {
        kl_flat_convert_material(kl_pose_material(scene, pose, i), &flat->materials[i]);
    }
    for (uint32_t i = 0; i < scene->instance_count; ++i) {
        const struct kl_mesh *mesh = &scene->meshes[scene->instances[i].mesh];
        flat->view.needs |= material_needs(kl_pose_material(scene, pose, mesh->material));
        if (mesh->colors != NULL) flat->view.needs |= KL_NEED_VERTEX_COLORS;
    }
    return add_textures(scene, flat, err);
}
