#include "src/scene/digest.h"

static void add(struct kl_hash *h, const void *data, size_t count, size_t size)
{
    const uint64_t n = data != NULL ? count : 0;
    kl_hash_update(h, &n, sizeof n);
    kl_hash_update(h, data, (size_t)n * size);
}

void kl_flat_digest(const struct kl_flat *flat, uint8_t digest[KL_HASH_SIZE])
{
    const size_t v = flat->vertex_count;
    const kl_environment *env = &flat->view.env;
    const size_t texels = (size_t)env->width * env->height;
    struct kl_hash h;

    kl_hash_init(&h);
    add(&h, flat->origin, 3, sizeof(double));
    add(&h, flat->positions, 3 * v, sizeof(float));
    add(&h, flat->normals, 3 * v, sizeof(float));
    add(&h, flat->tangents, 4 * v, sizeof(float));
    add(&h, flat->uvs, 4 * v, sizeof(float));
    add(&h, flat->colors, 4 * v, sizeof(float));
    add(&h, flat->triangles, flat->triangle_count, sizeof *flat->triangles);
    add(&h, flat->instances, flat->instance_count, sizeof *flat->instances);
    add(&h, flat->materials, flat->material_count, sizeof *flat->materials);
    add(&h, flat->textures, flat->texture_count, sizeof *flat->textures);
    add(&h, flat->texels, flat->texel_count, sizeof *flat->texels);
    add(&h, flat->lights, flat->light_count, sizeof *flat->lights);
    add(&h, flat->env_texels, 3 * texels, sizeof(float));
    add(&h, &env->scale, 1, sizeof env->scale);
    kl_hash_finish(&h, digest);
}
