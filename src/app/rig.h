/* The camera of every frame, wherever it comes from. */
#ifndef KL_SRC_APP_RIG_H
#define KL_SRC_APP_RIG_H

#include "src/app/options.h"
#include "src/render/camera.h"
#include "src/render/renderer.h"
#include "src/scene/scene.h"

struct kl_rig;

/* --camera, --turntable, --path; else the scene's first camera; else a view that fits the scene.
 * May take the renderer to time 0 for the scene's bounds. *out borrows scene, renderer and options,
 * and is the caller's: kl_rig_destroy. KL_ERR_USAGE: no such camera; the message lists them. */
kl_status kl_rig_create(const struct kl_scene *scene, struct kl_renderer *renderer,
                        const struct kl_options *options, struct kl_rig **out,
                        struct kl_err *err) KL_MUST_CHECK;
void kl_rig_destroy(struct kl_rig *rig); /* accepts NULL */

/* --frames; else all frames of the orbit, the path, or the animation if it moves anything but other
 * cameras; else frame 1. *out is the
 * caller's: kl_frames_fini. */
kl_status kl_rig_frames(const struct kl_rig *rig, uint32_t animation, struct kl_frames *out,
                        struct kl_err *err) KL_MUST_CHECK;
/* Instants of a frame [s]: centre, opening and closing of its shutter. */
struct kl_interval kl_rig_interval(const struct kl_rig *rig, int32_t frame);
/* Whether it moves at all. */
bool kl_rig_moves(const struct kl_rig *rig, uint32_t animation);
/* The camera at a frame plus a fraction of a frame. */
kl_status kl_rig_camera(const struct kl_rig *rig, int32_t frame, double fraction,
                        struct kl_camera *out, struct kl_err *err) KL_MUST_CHECK;
/* Number that decides a frame's samples: frames that show the same on a turntable have the same. */
int64_t kl_rig_sample_number(const struct kl_rig *rig, int32_t frame);

#endif
