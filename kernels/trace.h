/* Rays and hits. The host answers with Embree (src/trace/tracer.c), devices with kernels/bvh.h. */
#ifndef KL_KERNELS_TRACE_H
#define KL_KERNELS_TRACE_H
#include "kernels/moving.h"

typedef struct kl_ray {
    kl_vec3 origin; /* [m], render space; already moved off the surface it starts on */
    float tmin;     /* in units of |dir| */
    kl_vec3 dir;    /* unit */
    float tmax;     /* KL_INF: unlimited */
    float time;     /* [0, 1] while the shutter is open; of no effect where nothing moves */
} kl_ray;

typedef struct kl_hit {
    float t;         /* distance [m] */
    float u, v;      /* barycentrics of vertices 1 and 2 */
    kl_u32 triangle; /* index into triangles */
    kl_u32 instance; /* index into instances */
} kl_hit;

/* A ray at the reference instant. */
KL_FN kl_ray kl_ray_make(kl_vec3 origin, kl_vec3 dir, float tmax)
{
    kl_ray r;
    r.origin = origin;
    r.dir = dir;
    r.tmin = 0.0f;
    r.tmax = tmax;
    r.time = KL_TIME_REFERENCE;
    return r;
}

/* Edge function of the edge from p to q, both relative to the ray's origin, against direction d:
 * its sign says on which side the ray passes. */
KL_FN float kl_edge_function(kl_vec3 q, kl_vec3 p, kl_vec3 d)
{
    return kl_dot(kl_cross(kl_v3_sub(q, p), kl_v3_add(q, p)), d);
}

/* Where the ray meets the triangle that *hit names: tracers find triangles, and differ in the last
 * digits of all else. After this two of them agree to the bit wherever they found the same one. */
KL_FN void kl_hit_settle(const kl_scene_view *scene, const kl_ray *ray, kl_hit *hit)
{
    kl_vec3 o = ray->origin;
    kl_vec3 d = ray->dir;
    const KL_GLOBAL kl_triangle *triangle = &scene->triangles[hit->triangle];
    kl_corners p = kl_corners_of(scene->positions, triangle);
    if (kl_instance_moves(scene, hit->instance)) {
        p = kl_moved_corners(scene, hit->instance, triangle, ray->time);
    } else if (KL_NEEDS(scene, KL_NEED_INSTANCES) && hit->instance != 0u) {
        const KL_GLOBAL float *m = scene->instances[hit->instance].object_from_render;
        o = kl_affine_point(m, o);
        d = kl_affine_vector(m, d);
    }
    const kl_vec3 a = kl_v3_sub(p.a, o);
    const kl_vec3 b = kl_v3_sub(p.b, o);
    const kl_vec3 c = kl_v3_sub(p.c, o);
    const float u = kl_edge_function(c, a, d);
    const float v = kl_edge_function(a, b, d);
    const float sum = u + v + kl_edge_function(b, c, d);
    const kl_vec3 normal = kl_cross(kl_v3_sub(a, b), kl_v3_sub(c, a));
    const float slope = kl_dot(normal, d);
    const float t = kl_dot(a, normal) / slope;
    if (sum == 0.0f || !(t > ray->tmin && t < KL_INF)) return; /* the ray lies in the plane */
    hit->u = kl_clamp(u / sum, 0.0f, 1.0f);
    hit->v = kl_clamp(v / sum, 0.0f, 1.0f - hit->u);
    hit->t = t;
}

/* Nearest hit from either side of the surface, whatever its alpha; 0 and *hit untouched where there
 * is none. Any hit: 1 if anything lies in (tmin, tmax). Threads: any number at once. */
#if KL_DEVICE
#include "kernels/bvh.h"
KL_FN int kl_trace_closest(const kl_scene_view *scene, const kl_ray *ray, kl_hit *hit)
{
    return kl_bvh_closest(scene, ray, hit);
}
KL_FN int kl_trace_any(const kl_scene_view *scene, const kl_ray *ray)
{
    return kl_bvh_any(scene, ray);
}
#else
int kl_trace_closest(const kl_scene_view *scene, const kl_ray *ray, kl_hit *hit);
int kl_trace_any(const kl_scene_view *scene, const kl_ray *ray);
#endif

#endif
