/* Private to src/render: what has moved from one instant of a scene to another. */
#ifndef KL_SRC_RENDER_MOVED_H
#define KL_SRC_RENDER_MOVED_H

#include "src/base/status.h"
#include "src/scene/motion.h"

#include <stdbool.h>

/* How the things of a scene stand at an instant, and move while the shutter is open about it. */
struct kl_stand;

/* `flat`, `motion` (NULL: nothing moves while the shutter is open): of the pose. *out is the
 * caller's: kl_stand_destroy. */
kl_status kl_stand_create(const struct kl_scene *scene, const struct kl_pose *pose,
                          const struct kl_flat *flat, const struct kl_motion *motion,
                          struct kl_stand **out, struct kl_err *err) KL_MUST_CHECK;
void kl_stand_destroy(struct kl_stand *stand); /* accepts NULL */

/* Bit of an object: kernels/parts.h. */
kl_u32 kl_stand_bit(const struct kl_stand *stand, uint32_t object);

/* Bounds of a thing: the map that takes them, at the reference instant, to the cube [-1, 1]^3. Of
 * what deforms: wherever it gets to. */
struct kl_moved_box {
    float unit_from_render[12]; /* 3x4 row major */
    uint32_t object;
    uint32_t steps; /* 0: it is there while the shutter is open */
    float *ways;    /* steps x 3x4 row major: to a time from the reference instant */
};

/* What became of an object, by its number. */
struct kl_moved_object {
    bool moved, deformed;      /* deformed: its points did not keep together */
    float now_from_before[12]; /* render space, 3x4 row major; where it moved as a whole */
    float normals[9];          /* its inverse transpose, up to a factor */
};

struct kl_moved {
    bool all;                      /* lights or materials changed too: nothing can be compared */
    uint32_t count, room;          /* of boxes in either list; that these have room for */
    struct kl_moved_box *was, *is; /* of what moved: before, and now */
    struct kl_moved_object *objects;
    kl_u32 touched[2]; /* bits of the objects that moved: kernels/parts.h */
};

/* Compare two instants of one scene. *out: kl_moved_fini. */
kl_status kl_moved_between(const struct kl_stand *before, const struct kl_stand *now,
                           struct kl_moved *out, struct kl_err *err) KL_MUST_CHECK;
void kl_moved_fini(struct kl_moved *moved);

/* Does a ray meet one of `count` boxes where these are at its time, before tmax? That of object
 * `except` does not count. */
bool kl_moved_meets(const struct kl_moved_box *boxes, uint32_t count, uint32_t except,
                    const kl_ray *ray);

#endif
