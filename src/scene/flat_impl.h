/* Private to src/scene/flat*.c: the parts of flattening. */
#ifndef KL_SRC_SCENE_FLAT_IMPL_H
#define KL_SRC_SCENE_FLAT_IMPL_H

#include "src/scene/flat.h"

/* Materials, textures and texels; sets the needs that come from materials. */
kl_status kl_flat_add_materials(const struct kl_scene *scene, struct kl_flat *flat,
                                struct kl_err *err) KL_MUST_CHECK;
/* Lights of the pose, emissive triangles of instance 0, environment tables, light tree. Geometry
 * and materials must be there. */
kl_status kl_flat_add_lights(const struct kl_scene *scene, const struct kl_pose *pose,
                             struct kl_flat *flat, struct kl_err *err) KL_MUST_CHECK;

/* p' = M p for a column-major 4x4 affine matrix. */
static inline void kl_matrix_point(const double m[16], const double p[3], double out[3])
{
    for (int r = 0; r < 3; ++r) {
        out[r] = m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r];
    }
}

#endif
