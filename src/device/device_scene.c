#include "src/device/device_scene.h"

#include "kernels/scene_args.h"
#include "src/base/memory.h"

#include <stdlib.h>

#define COUNT_ARRAY(type, name) +1
enum { SCENE_ARRAYS = 0 KL_SCENE_ARRAYS(COUNT_ARRAY), LEVEL_ARRAYS = KL_LEVEL_ARG_COUNT - 1 };
_Static_assert((int)SCENE_ARRAYS + 1 == (int)KL_SCENE_ARG_COUNT, "arguments of a scene");

struct kl_device_scene {
    kl_scene_scalars scalars;
    struct kl_device_buffer *arrays[SCENE_ARRAYS];
};

struct kl_device_level {
    kl_octree_header head;
    struct kl_device_buffer *arrays[LEVEL_ARRAYS];
};

/* Items of each array, by the names of KL_SCENE_ARRAYS. */
struct array_sizes {
    size_t positions, normals, tangents, uvs, colors, triangles, instances, materials, textures;
    size_t texels, srgb_table, lights, light_nodes, env_texels, env_rows, env_columns;
    size_t touch_bits;
    size_t bvh_nodes, bvh_leaves, bvh_roots;
    size_t shutter_times, moving, step_matrices, step_positions, step_normals, step_tangents;
    size_t light_motion, step_lights, material_motion, step_materials;
};

static struct array_sizes count_items(const struct kl_flat *flat, const struct kl_motion *motion,
                                      const struct kl_device_bvh *bvh)
{
    static const struct kl_motion still;
    const struct kl_motion *m = motion != NULL ? motion : &still;
    const size_t vertices = flat->vertex_count;
    const size_t width = flat->view.env.width;
    const size_t height = flat->view.env.height;
    const size_t lights = motion != NULL ? m->light_count : flat->light_count;

    return (struct array_sizes){
        .positions = 3 * vertices,
        .normals = 3 * vertices,
        .tangents = 4 * vertices,
        .uvs = 4 * vertices,
        .colors = 4 * vertices,
        .triangles = flat->triangle_count,
        .instances = motion != NULL ? m->instance_count : flat->instance_count,
        .materials = flat->material_count,
        .textures = flat->texture_count,
        .texels = flat->texel_count,
        .srgb_table = 256,
        .lights = lights,
        .light_nodes = motion != NULL ? m->light_node_count : flat->light_node_count,
        .env_texels = 3 * width * height,
        .env_rows = width > 0 ? height + 1 : 0,
        .env_columns = width > 0 ? height * (width + 1) : 0,
        .touch_bits = lights + flat->object_count,
        .bvh_nodes = bvh->node_count,
        .bvh_leaves = bvh->leaf_count,
        .bvh_roots = bvh->root_count,
        .shutter_times = motion != NULL ? KL_SHUTTER_TIMES : 0,
        .moving = m->instance_count,
        .step_matrices = 12 * m->matrix_count,
        .step_positions = 3 * m->vertex_count,
        .step_normals = 3 * m->vertex_count,
        .step_tangents = 3 * m->vertex_count,
        .light_motion = m->light_count,
        .step_lights = m->step_light_count,
        .material_motion = motion != NULL ? flat->material_count : 0,
        .step_materials = m->step_material_count,
    };
}

/* OpenCL takes pointers to non-const even for memory that nobody writes. */
static void *without_const(const void *p)
{
    return (void *)(uintptr_t)p;
}

static kl_status upload(struct kl_device *device, const void *data, size_t bytes, const char *name,
                        struct kl_device_buffer **out, struct kl_err *err)
{
    kl_status st = kl_device_buffer_create(device, KL_DEVICE_INPUT, without_const(data),
                                           data != NULL ? bytes : 0, out, err);
    return st == KL_OK ? KL_OK : kl_wrap(err, "array %s", name);
}

static kl_status upload_scene(struct kl_device *device, const kl_scene_view *view,
                              const struct array_sizes n, const struct kl_device_bvh *bvh,
                              struct kl_device_scene *scene, struct kl_err *err)
{
    kl_scene_view v = *view;
    v.bvh_nodes = bvh->nodes;
    v.bvh_leaves = bvh->leaves;
    v.bvh_roots = bvh->roots;
#define LIST_ARRAY(type, name) {v.name, n.name * sizeof(type), #name},
    const struct {
        const void *data;
        size_t bytes;
        const char *name;
    } list[] = {KL_SCENE_ARRAYS(LIST_ARRAY)};
    kl_status st = KL_OK;
    for (size_t i = 0; st == KL_OK && i < SCENE_ARRAYS; ++i) {
        st = upload(device, list[i].data, list[i].bytes, list[i].name, &scene->arrays[i], err);
    }
    return st;
}

kl_status kl_device_scene_create(struct kl_device *device, const struct kl_flat *flat,
                                 const struct kl_motion *motion, const struct kl_device_bvh *bvh,
                                 struct kl_device_scene **out, struct kl_err *err)
{
    const kl_scene_view *view = motion != NULL ? &motion->view : &flat->view;
    struct kl_device_scene *scene = NULL;
    kl_status st = kl_alloc_array(&scene, 1, sizeof *scene, err);

    if (st != KL_OK) return st;
    scene->scalars = (kl_scene_scalars){
        .needs = view->needs,
        .light_count = view->light_count,
        .far_count = view->far_count,
        .far_probability = view->far_probability,
        .instance_count = view->instance_count,
        .scene_radius = view->scene_radius,
        .env = view->env,
    };
    st = upload_scene(device, view, count_items(flat, motion, bvh), bvh, scene, err);
    if (st != KL_OK) {
        kl_device_scene_destroy(scene);
        return kl_wrap(err, "scene on %s", kl_device_get_info(device)->name);
    }
    *out = scene;
    return KL_OK;
}

void kl_device_scene_destroy(struct kl_device_scene *scene)
{
    if (scene == NULL) return;
    for (size_t i = 0; i < SCENE_ARRAYS; ++i) {
        kl_device_buffer_destroy(scene->arrays[i]);
    }
    free(scene);
}

void kl_device_scene_get_args(const struct kl_device_scene *scene, struct kl_device_arg *args)
{
    args[0] = (struct kl_device_arg){.value = &scene->scalars, .size = sizeof scene->scalars};
    for (size_t i = 0; i < SCENE_ARRAYS; ++i) {
        args[1 + i] = (struct kl_device_arg){.buffer = scene->arrays[i]};
    }
}

kl_status kl_device_level_create(struct kl_device *device, const kl_level_view *view,
                                 struct kl_device_level **out, struct kl_err *err)
{
    const size_t records = view->head.record_count;
    struct kl_device_level *level = NULL;
    kl_status st = kl_alloc_array(&level, 1, sizeof *level, err);

    if (st != KL_OK) return st;
    level->head = view->head;
    const struct {
        const void *data;
        size_t bytes;
        const char *name;
    } list[LEVEL_ARRAYS] = {
        {view->hot, records * sizeof *view->hot, "hot records"},
        {view->cold, records * sizeof *view->cold, "cold records"},
        {view->nodes, records > 0 ? view->head.node_count * sizeof *view->nodes : 0, "nodes"},
        {view->rows, records > 0 ? view->head.row_size * sizeof *view->rows : 0, "rows"},
    };
    for (size_t i = 0; st == KL_OK && i < LEVEL_ARRAYS; ++i) {
        st = upload(device, list[i].data, list[i].bytes, list[i].name, &level->arrays[i], err);
    }
    if (st != KL_OK) {
        kl_device_level_destroy(level);
        return kl_wrap(err, "cache on %s", kl_device_get_info(device)->name);
    }
    *out = level;
    return KL_OK;
}

void kl_device_level_destroy(struct kl_device_level *level)
{
    if (level == NULL) return;
    for (size_t i = 0; i < LEVEL_ARRAYS; ++i) {
        kl_device_buffer_destroy(level->arrays[i]);
    }
    free(level);
}

void kl_device_level_get_args(const struct kl_device_level *level, struct kl_device_arg *args)
{
    args[0] = (struct kl_device_arg){.value = &level->head, .size = sizeof level->head};
    for (size_t i = 0; i < LEVEL_ARRAYS; ++i) {
        args[1 + i] = (struct kl_device_arg){.buffer = level->arrays[i]};
    }
}
