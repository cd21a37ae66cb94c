/* Private to src/scene/flat*.c: the parts of flattening. */
#ifndef KL_SRC_SCENE_FLAT_IMPL_H
#define KL_SRC_SCENE_FLAT_IMPL_H

#include "src/scene/flat.h"

/* The vertices of a scene instance at a pose, render space: 3, 3 and 4 numbers each; `tangents` may
 * be NULL, and is left alone where the mesh has none. */
kl_status kl_flat_place_vertices(const struct kl_scene *scene, const struct kl_pose *pose,
                                 uint32_t instance, const double origin[3], float *positions,
                                 float *normals, float *tangents, struct kl_err *err) KL_MUST_CHECK;

/* A material as the flat scene has it. */
void kl_flat_convert_material(const kl_material *in, kl_material *out);

/* Materials, textures and texels; sets the needs that come from materials. */
kl_status kl_flat_add_materials(const struct kl_scene *scene, const struct kl_pose *pose,
                                struct kl_flat *flat, struct kl_err *err) KL_MUST_CHECK;
/* Lights of the pose, emissive triangles of instance 0, environment tables, light tree. Geometry
 * and materials must be there. */
kl_status kl_flat_add_lights(const struct kl_scene *scene, const struct kl_pose *pose,
                             struct kl_flat *flat, struct kl_err *err) KL_MUST_CHECK;

/* The lights alone, without environment tables and tree: what kl_flat_add_lights begins with. Far
 * ones come first, then other punctual ones, then triangles, whose `light` is set. */
struct kl_flat_lights {
    kl_light *items;
    uint32_t *sources; /* kl_flat.light_sources */
    uint32_t count, far_count, near_count;
};
kl_status kl_flat_list_lights(const struct kl_scene *scene, const struct kl_pose *pose,
                              struct kl_flat *flat, struct kl_flat_lights *out,
                              struct kl_err *err) KL_MUST_CHECK;
/* With which one of the far lights is chosen. */
float kl_flat_far_probability(const struct kl_flat_lights *lights);
void kl_flat_lights_fini(struct kl_flat_lights *lights);
/* One punctual light at a pose. */
kl_light kl_flat_punctual(const struct kl_scene *scene, const struct kl_pose *pose, uint32_t light,
                          const double origin[3]);

/* p' = M p for a column-major 4x4 affine matrix. */
static inline void kl_matrix_point(const double m[16], const double p[3], double out[3])
{
    for (int r = 0; r < 3; ++r) {
        out[r] = m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r];
    }
}

#endif
