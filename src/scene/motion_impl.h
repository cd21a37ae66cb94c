/* Private to src/scene/motion*.c. */
#ifndef KL_SRC_SCENE_MOTION_IMPL_H
#define KL_SRC_SCENE_MOTION_IMPL_H

#include "src/scene/motion.h"

/* Poses at GRID + 1 evenly spaced instants of the span, made when asked for; the middle one is the
 * flat scene's. */
enum { KL_MOTION_GRID = 128 };
struct kl_motion_job {
    const struct kl_scene *scene;
    uint32_t animation;
    const struct kl_pose *pose;
    struct kl_flat *flat;
    struct kl_motion_span span;
    bool is_instant; /* the span is one */
    struct kl_pose *poses[KL_MOTION_GRID + 1];
    struct kl_motion *motion;
};

kl_status kl_motion_pose(struct kl_motion_job *job, uint32_t at, const struct kl_pose **out,
                         struct kl_err *err) KL_MUST_CHECK;
/* Materials and lights that change, and the light tree for the whole span. Geometry must be there.
 */
kl_status kl_motion_add_materials(struct kl_motion_job *job, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_motion_add_lights(struct kl_motion_job *job, struct kl_err *err) KL_MUST_CHECK;

#endif
