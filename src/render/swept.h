/* Private to src/render: the room that moving things take while the shutter is open. A still
 * surface that one of them covers at the reference instant has no light there that could be kept.
 */
#ifndef KL_SRC_RENDER_SWEPT_H
#define KL_SRC_RENDER_SWEPT_H

#include "kernels/surface.h"
#include "src/base/status.h"
#include "src/scene/motion.h"

#include <stdbool.h>

struct kl_swept;

/* *out is the caller's: kl_swept_destroy. Borrows nothing. */
kl_status kl_swept_create(const struct kl_motion *motion, struct kl_swept **out,
                          struct kl_err *err) KL_MUST_CHECK;
void kl_swept_destroy(struct kl_swept *swept); /* accepts NULL */

/* Does the point of a still surface lie inside something that moves, in `reference`, the scene at
 * the reference instant with its tracer? False where nothing comes near. NULL: nothing moves. Any
 * thread. */
bool kl_swept_covers(const struct kl_swept *swept, const kl_scene_view *reference,
                     const kl_surface *surface);

#endif
