/* What changes while a shutter is open, beside the flat scene at its centre: states at evenly
 * spaced times, as many as the way that each thing goes needs. */
#ifndef KL_SRC_SCENE_MOTION_H
#define KL_SRC_SCENE_MOTION_H

#include "kernels/trace.h"
#include "src/base/hash.h"
#include "src/scene/flat.h"
#include "src/scene/scene.h"

/* Instants [s]. Where both are the same, everything has a single state: that of this instant. */
struct kl_motion_span {
    double open, close;
    const float *times; /* kl_scene_view.shutter_times; NULL: open all the time */
};

struct kl_motion {
    /* The flat scene in motion: rays carry a time in [0, 1], opening to closing. */
    kl_scene_view view;
    /* The flat scene at the reference instant for the hits of such rays: the same surface points
     * where they are at the shutter's centre. */
    kl_scene_view reference;
    uint32_t instance_count; /* those of the flat scene, then one per merged thing that moves */
    uint32_t shared_count;   /* those of the flat scene */
    kl_instance *instances;
    kl_moving *moving; /* per instance */
    size_t matrix_count, vertex_count;
    float *matrices, *positions, *normals, *tangents;
    float shutter_times[KL_SHUTTER_TIMES];
    kl_triangle *triangles; /* the flat scene's with other numbers of lights; NULL: the same */
    uint32_t light_count, light_node_count; /* 0: the flat scene's lights */
    kl_light *lights;
    kl_light_node *light_nodes;
    uint32_t *light_motion;
    kl_u32 *touch_bits; /* of these lights, then of objects: kl_flat, whose bits must be set */
    size_t step_light_count, step_material_count;
    kl_light *step_lights;
    uint32_t *material_motion;
    kl_material *step_materials;
    /* For people: */
    uint32_t rigid_count, deforming_count, most_steps;
    uint32_t moving_lights, moving_materials;
};

/* What moves within the span, against `flat`, which was made for the instant in the middle of it
 * (or, for a span of one instant, for any other). *out is NULL where nothing does; else it borrows
 * from `flat` and is the caller's: kl_motion_destroy. */
kl_status kl_motion_create(const struct kl_scene *scene, uint32_t animation,
                           const struct kl_pose *pose, struct kl_flat *flat,
                           const struct kl_motion_span *span, struct kl_motion **out,
                           struct kl_err *err) KL_MUST_CHECK;
void kl_motion_destroy(struct kl_motion *motion); /* accepts NULL */

/* Where the surface point of a hit is at a time of the span, for a hit in this flat scene with any
 * motion or none; `still` where it does not move. motion NULL: nothing moves. */
kl_vec3 kl_motion_point(const struct kl_motion *motion, const kl_hit *hit, float time,
                        kl_vec3 still);

/* The instance of a merged triangle that moves, KL_NONE where it does not. */
uint32_t kl_motion_find(const struct kl_motion *motion, uint32_t triangle);

/* Adds all that decides what is seen in motion to a digest. */
void kl_motion_digest(const struct kl_motion *motion, struct kl_hash *hash);

#endif
