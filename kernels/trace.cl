/* Batches of rays. A miss has triangle KL_NONE. */
#include "kernels/scene_args.h"
#include "kernels/trace.h"

__kernel void kl_trace_closest_batch(KL_SCENE_PARAMS, const __global kl_ray *rays,
                                     __global kl_hit *hits, const uint count)
{
    const size_t i = get_global_id(0);
    KL_SCENE_VIEW;
    kl_hit hit;
    if (i >= count) return;
    const kl_ray ray = rays[i];
    hit.t = ray.tmax;
    hit.u = hit.v = 0.0f;
    hit.triangle = hit.instance = KL_NONE;
    (void)kl_trace_closest(&scene, &ray, &hit);
    hits[i] = hit;
}

/* 1 for each ray that meets anything. */
__kernel void kl_trace_any_batch(KL_SCENE_PARAMS, const __global kl_ray *rays,
                                 __global uint *blocked, const uint count)
{
    const size_t i = get_global_id(0);
    KL_SCENE_VIEW;
    if (i >= count) return;
    const kl_ray ray = rays[i];
    blocked[i] = (uint)kl_trace_any(&scene, &ray);
}
