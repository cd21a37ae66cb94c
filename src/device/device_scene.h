/* The flat scene and the cache's levels on a device, as arguments of kernels
 * (kernels/scene_args.h). */
#ifndef KL_SRC_DEVICE_DEVICE_SCENE_H
#define KL_SRC_DEVICE_DEVICE_SCENE_H

#include "kernels/cache_data.h"
#include "src/device/device.h"
#include "src/scene/motion.h"
#include "src/trace/device_bvh.h"

enum { KL_SCENE_ARG_COUNT = 31, KL_LEVEL_ARG_COUNT = 5 };

/* Uploaded once, or used in place where memory is shared: the flat scene, its motion (NULL: nothing
 * moves) and the trees of both stay unchanged until destroy. */
struct kl_device_scene;
kl_status kl_device_scene_create(struct kl_device *device, const struct kl_flat *flat,
                                 const struct kl_motion *motion, const struct kl_device_bvh *bvh,
                                 struct kl_device_scene **out, struct kl_err *err) KL_MUST_CHECK;
void kl_device_scene_destroy(struct kl_device_scene *scene); /* accepts NULL */
/* Fills args[0 .. KL_SCENE_ARG_COUNT): KL_SCENE_PARAMS. Valid until the scene's end. */
void kl_device_scene_get_args(const struct kl_device_scene *scene, struct kl_device_arg *args);

/* One level of the cache; made anew when its arrays change. The same lifetime rule. */
struct kl_device_level;
kl_status kl_device_level_create(struct kl_device *device, const kl_level_view *level,
                                 struct kl_device_level **out, struct kl_err *err) KL_MUST_CHECK;
void kl_device_level_destroy(struct kl_device_level *level); /* accepts NULL */
/* Fills args[0 .. KL_LEVEL_ARG_COUNT): KL_LEVEL_PARAMS. */
void kl_device_level_get_args(const struct kl_device_level *level, struct kl_device_arg *args);

#endif
