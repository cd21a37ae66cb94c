#include "src/render/camera.h"

#include "kernels/moving.h"

#include <math.h>

static kl_vec3 unit_of(const double v[3])
{
    const double l = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    const double s = l > 0.0 ? 1.0 / l : 0.0;
    return kl_v3((float)(v[0] * s), (float)(v[1] * s), (float)(v[2] * s));
}

static kl_vec3 render_from_world(const double p[3], const double origin[3])
{
    return kl_v3((float)(p[0] - origin[0]), (float)(p[1] - origin[1]), (float)(p[2] - origin[2]));
}

/* Orthonormal axes from a viewing direction and a rough up. */
static void set_axes(struct kl_camera *c, kl_vec3 forward, kl_vec3 up)
{
    kl_vec3 right = kl_cross(forward, up);
    if (!(kl_dot(right, right) > 1e-12f)) right = kl_frame_from_normal(forward).t;
    c->forward = forward;
    c->right = kl_normalize(right);
    c->up = kl_cross(c->right, forward);
}

struct kl_camera kl_camera_from_scene(const struct kl_scene *scene, const struct kl_pose *pose,
                                      uint32_t index, const double origin[3], uint32_t width,
                                      uint32_t height)
{
    const struct kl_scene_camera *in = kl_pose_camera(scene, pose, index);
    const double *m = pose->world_from_node + 16 * (size_t)in->node;
    const double forward[3] = {-m[8], -m[9], -m[10]};
    struct kl_camera c = {.width = width, .height = height, .time = KL_TIME_REFERENCE};
    const float aspect = (float)width / (float)height;

    c.eye = render_from_world(m + 12, origin);
    set_axes(&c, unit_of(forward), unit_of(m + 4));
    c.orthographic = in->projection == KL_ORTHOGRAPHIC;
    c.half_height = (float)(c.orthographic ? in->ymag : tan(0.5 * in->yfov));
    c.half_width = c.half_height * aspect;
    return c;
}

struct kl_camera kl_camera_look_at(const double eye[3], const double target[3], const double up[3],
                                   double yfov, const double origin[3], uint32_t width,
                                   uint32_t height)
{
    const double forward[3] = {target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]};
    struct kl_camera c = {.width = width, .height = height, .time = KL_TIME_REFERENCE};

    c.eye = render_from_world(eye, origin);
    set_axes(&c, unit_of(forward), unit_of(up));
    c.half_height = (float)tan(0.5 * yfov);
    c.half_width = c.half_height * (float)width / (float)height;
    return c;
}

struct kl_camera kl_camera_at(const struct kl_camera *cameras, uint32_t count, float time)
{
    const kl_blend b = kl_blend_at(count, time);
    struct kl_camera c = cameras[b.step];

    if (b.share > 0.0f) {
        const struct kl_camera *next = &cameras[b.step + 1];
        c.eye = kl_mix3(c.eye, next->eye, b.share);
        c.half_width = kl_mix(c.half_width, next->half_width, b.share);
        c.half_height = kl_mix(c.half_height, next->half_height, b.share);
        set_axes(&c, kl_normalize(kl_mix3(c.forward, next->forward, b.share)),
                 kl_mix3(c.up, next->up, b.share));
    }
    c.time = time;
    return c;
}

static kl_ray ray_at(kl_vec3 origin, kl_vec3 dir, float time)
{
    kl_ray ray = kl_ray_make(origin, dir, KL_INF);
    ray.time = time;
    return ray;
}

kl_ray kl_camera_ray(const struct kl_camera *c, float x, float y)
{
    const float sx = (2.0f * x / (float)c->width - 1.0f) * c->half_width;
    const float sy = (1.0f - 2.0f * y / (float)c->height) * c->half_height;
    if (c->orthographic) {
        const kl_vec3 o = kl_v3_mad(kl_v3_mad(c->eye, sx, c->right), sy, c->up);
        return ray_at(o, c->forward, c->time);
    }
    const kl_vec3 d = kl_v3_mad(kl_v3_mad(c->forward, sx, c->right), sy, c->up);
    return ray_at(c->eye, kl_normalize(d), c->time);
}

bool kl_camera_project(const struct kl_camera *c, kl_vec3 p, float *x, float *y, float *depth)
{
    const kl_vec3 d = kl_v3_sub(p, c->eye);
    const float z = kl_dot(d, c->forward);
    const float scale = c->orthographic ? 1.0f : z;
    *depth = z;
    if (!(z > 0.0f)) return false;
    const float sx = kl_dot(d, c->right) / (scale * c->half_width);
    const float sy = kl_dot(d, c->up) / (scale * c->half_height);
    *x = (sx + 1.0f) * 0.5f * (float)c->width;
    *y = (1.0f - sy) * 0.5f * (float)c->height;
    return true;
}

float kl_camera_pixel_size(const struct kl_camera *c, float distance)
{
    const float at_one = 2.0f * c->half_height / (float)c->height;
    return c->orthographic ? at_one : at_one * distance;
}
