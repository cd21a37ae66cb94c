/* The scene at one instant as flat arrays that host and devices share (kernels/scene_data.h).
 * Small and single-use meshes are merged into one run of triangles in render space; large meshes
 * that are used more than once stay shared under instances. */
#ifndef KL_SRC_SCENE_FLAT_H
#define KL_SRC_SCENE_FLAT_H

#include "kernels/scene_data.h"
#include "src/base/status.h"
#include "src/scene/scene.h"

/* Where a scene instance has gone. */
struct kl_flat_place {
    uint32_t instance; /* of `instances`; 0: merged */
    uint32_t first_vertex, first_triangle;
};

struct kl_flat {
    double origin[3]; /* [m] world position of render space's origin */
    float center[3];  /* [m] render space: bounding sphere of all geometry */
    float radius;     /* [m] > 0 */
    uint32_t vertex_count, triangle_count, instance_count, material_count;
    uint32_t texture_count, texel_count, light_count, light_node_count;
    kl_scene_view view; /* points into the arrays below; tracer and bvh_* are filled by src/trace */

    float *positions, *normals, *tangents, *uvs, *colors;
    kl_triangle *triangles;
    kl_instance *instances; /* >= 1; instance 0: merged geometry, possibly 0 triangles */
    kl_material *materials;
    kl_texture *textures;
    kl_u32 *texels;
    float *srgb_table;
    kl_light *lights;
    kl_light_node *light_nodes;
    float *env_texels, *env_rows, *env_columns;
    struct kl_flat_place *places; /* per scene instance */
    uint32_t object_count;
    uint32_t *light_sources; /* per light: number of the scene's light or of the glowing object */
    kl_u32 *touch_bits;      /* light_count + object_count; 0 until kl_scene_parts_init */
};

/* `origin`: the world position to use as render space's origin, kept for a whole sequence
 * (kl_flat_choose_origin). *out is the caller's: kl_flat_destroy. Reads the scene only. */
kl_status kl_flat_create(const struct kl_scene *scene, const struct kl_pose *pose,
                         const double origin[3], struct kl_flat **out,
                         struct kl_err *err) KL_MUST_CHECK;
void kl_flat_destroy(struct kl_flat *flat); /* accepts NULL */

/* Do hits in one name the same surface points in the other? Both of `scene`, at any two poses: not
 * so where a mesh is shared in one only, as it has shrunk to nothing in the other. */
bool kl_flat_is_alike(const struct kl_scene *scene, const struct kl_flat *a,
                      const struct kl_flat *b);

/* Centre of the scene's bounding box at the pose: render space then has the best precision. */
kl_status kl_flat_choose_origin(const struct kl_scene *scene, const struct kl_pose *pose,
                                double origin[3], struct kl_err *err) KL_MUST_CHECK;

#endif
