/* Rays and hits. The host answers with Embree (src/trace/tracer.c), devices with kernels/bvh.h, at
 * the reference instant only. */
#ifndef KL_KERNELS_TRACE_H
#define KL_KERNELS_TRACE_H
#include "kernels/scene_data.h"

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
