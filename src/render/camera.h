/* A camera at one instant: from pixels to rays and back. */
#ifndef KL_SRC_RENDER_CAMERA_H
#define KL_SRC_RENDER_CAMERA_H

#include "kernels/trace.h"
#include "src/scene/scene.h"

#include <stdbool.h>
#include <stdint.h>

struct kl_camera {
    uint32_t width, height; /* [pixels] */
    bool orthographic;
    kl_vec3 eye;                   /* [m], render space */
    kl_vec3 right, up, forward;    /* unit, orthogonal */
    float half_width, half_height; /* of the image: at distance 1, or [m] where orthographic */
    float time;                    /* of its rays, [0, 1] while the shutter is open */
};

/* The scene's camera number `index` at a pose. The image keeps the vertical field of view (and the
 * horizontal one follows the pixels, which are square). */
struct kl_camera kl_camera_from_scene(const struct kl_scene *scene, const struct kl_pose *pose,
                                      uint32_t index, const double origin[3], uint32_t width,
                                      uint32_t height);
/* A perspective camera at `eye` that looks at `target`, world space [m]; yfov [rad]. */
struct kl_camera kl_camera_look_at(const double eye[3], const double target[3], const double up[3],
                                   double yfov, const double origin[3], uint32_t width,
                                   uint32_t height);

/* A camera that moves while the shutter is open: `cameras` are `count` >= 1 states at evenly spaced
 * times. */
struct kl_camera kl_camera_at(const struct kl_camera *cameras, uint32_t count, float time);

/* Ray through the point (x, y) of the image [pixels], (0, 0) its upper left corner. */
kl_ray kl_camera_ray(const struct kl_camera *camera, float x, float y);
/* Image point and depth along `forward` of a render-space point; false behind the eye. */
bool kl_camera_project(const struct kl_camera *camera, kl_vec3 p, float *x, float *y, float *depth);
/* Edge [m] of what one pixel covers, square to the view, at a distance along the ray. */
float kl_camera_pixel_size(const struct kl_camera *camera, float distance);

#endif
