/* The scene as arguments of a kernel: OpenCL 1.2 has no pointers inside structs, so each array is
 * an argument of its own, in the order of KL_SCENE_ARRAYS, after the scalars. */
#ifndef KL_KERNELS_SCENE_ARGS_H
#define KL_KERNELS_SCENE_ARGS_H
#include "kernels/scene_data.h"

typedef struct kl_scene_scalars {
    kl_u32 needs, light_count, far_count;
    float far_probability;
    kl_u32 instance_count;
    float scene_radius;
    kl_environment env;
    kl_u32 pad[2];
} kl_scene_scalars;
KL_ASSERT_SIZE(kl_scene_scalars, 48);

/* X(type, name): name is that of kl_scene_view. */
#define KL_SCENE_ARRAYS(X)                                                                         \
    X(float, positions)                                                                            \
    X(float, normals)                                                                              \
    X(float, tangents)                                                                             \
    X(float, uvs)                                                                                  \
    X(float, colors)                                                                               \
    X(kl_triangle, triangles)                                                                      \
    X(kl_instance, instances)                                                                      \
    X(kl_material, materials)                                                                      \
    X(kl_texture, textures)                                                                        \
    X(kl_u32, texels)                                                                              \
    X(float, srgb_table)                                                                           \
    X(kl_light, lights)                                                                            \
    X(kl_light_node, light_nodes)                                                                  \
    X(float, env_texels)                                                                           \
    X(float, env_rows)                                                                             \
    X(float, env_columns)                                                                          \
    X(kl_u32, touch_bits)                                                                          \
    X(struct kl_bvh_node, bvh_nodes)                                                               \
    X(struct kl_bvh_leaf, bvh_leaves)                                                              \
    X(kl_u32, bvh_roots)                                                                           \
    X(float, shutter_times)                                                                        \
    X(kl_moving, moving)                                                                           \
    X(float, step_matrices)                                                                        \
    X(float, step_positions)                                                                       \
    X(float, step_normals)                                                                         \
    X(float, step_tangents)                                                                        \
    X(kl_u32, light_motion)                                                                        \
    X(kl_light, step_lights)                                                                       \
    X(kl_u32, material_motion)                                                                     \
    X(kl_material, step_materials)

/* In a kernel: `__kernel void f(KL_SCENE_PARAMS, ...) { KL_SCENE_VIEW; ... }`: the view is `scene`.
 */
#define KL_SCENE_PARAM(type, name) , const KL_GLOBAL type *scene_##name
#define KL_SCENE_PARAMS            const kl_scene_scalars scalars KL_SCENE_ARRAYS(KL_SCENE_PARAM)
#define KL_SCENE_SET(type, name)   scene.name = scene_##name;
#define KL_SCENE_VIEW                                                                              \
    kl_scene_view scene;                                                                           \
    scene.needs = scalars.needs;                                                                   \
    scene.light_count = scalars.light_count;                                                       \
    scene.far_count = scalars.far_count;                                                           \
    scene.far_probability = scalars.far_probability;                                               \
    scene.instance_count = scalars.instance_count;                                                 \
    scene.scene_radius = scalars.scene_radius;                                                     \
    scene.env = scalars.env;                                                                       \
    KL_SCENE_ARRAYS(KL_SCENE_SET)

/* One level of the cache: header and arrays of kl_level_view, in this order. `l` is a prefix that
 * tells several levels apart. */
#define KL_LEVEL_PARAMS(l)                                                                         \
    const kl_octree_header l##_head, const KL_GLOBAL kl_record_hot *l##_hot,                       \
        const KL_GLOBAL kl_record_cold *l##_cold, const KL_GLOBAL kl_u32 *l##_nodes,               \
        const KL_GLOBAL kl_u32 *l##_rows
#define KL_LEVEL_VIEW(l)                                                                           \
    kl_level_view l;                                                                               \
    l.head = l##_head;                                                                             \
    l.hot = l##_hot;                                                                               \
    l.cold = l##_cold;                                                                             \
    l.nodes = l##_nodes;                                                                           \
    l.rows = l##_rows

#endif
