/* A batch of irradiance gathers in two steps: one ray a work-item, then one record a work-item. */
#include "kernels/derivatives.h"
#include "kernels/scene_args.h"

/* Work-item i traces ray i % side^2 (along the Z-curve) of point i / side^2; `count` points. Cells
 * of the step before are those of point from[i / side^2] in `before`. */
__kernel void kl_gather_rays(KL_SCENE_PARAMS, KL_LEVEL_PARAMS(level1),
                             const kl_gather_settings settings,
                             const __global kl_gather_point *points,
                             const __global kl_direction *directions,
                             __global kl_gather_cell *cells, const __global kl_gather_cell *before,
                             const __global uint *from, const uint count)
{
    const uint rays = settings.side * settings.side;
    const uint i = (uint)(get_global_id(0) / rays);
    if (i >= count) return;
    KL_SCENE_VIEW;
    KL_LEVEL_VIEW(level1);
    const __global kl_gather_point *point = points + i;
    const uint cell = kl_cell_in_order((uint)(get_global_id(0) % rays), settings.side);
    const uint set = point->seed & (settings.sets - 1u);
    const size_t earlier = (size_t)from[i] * settings.side_before * settings.side_before;
    cells[(size_t)i * rays + cell] = kl_gather_one_cell(
        &scene, &level1, &settings, point, directions + (size_t)set * rays, cell, before + earlier);
}

/* Work-item i traces one ray, picks[i]. */
__kernel void kl_gather_picked(KL_SCENE_PARAMS, KL_LEVEL_PARAMS(level1),
                               const kl_gather_settings settings,
                               const __global kl_gather_point *points,
                               const __global kl_direction *directions,
                               const __global kl_gather_pick *picks,
                               __global kl_gather_cell *cells, const uint count)
{
    const size_t i = get_global_id(0);
    if (i >= count) return;
    KL_SCENE_VIEW;
    KL_LEVEL_VIEW(level1);
    cells[i] = kl_gather_direction(&scene, &level1, &settings, points + picks[i].point,
                                   directions + picks[i].direction);
}

__kernel void kl_gather_reduce(const kl_gather_settings settings,
                               const __global kl_gather_point *points,
                               const __global kl_direction *directions,
                               const __global float *corners, const __global float *turn,
                               const __global kl_gather_cell *cells,
                               __global kl_gather_cell *smooth, __global kl_gather_result *results,
                               const uint count)
{
    const uint rays = settings.side * settings.side;
    const size_t i = get_global_id(0);
    kl_grid_view grid;
    kl_gather_result result;
    if (i >= count) return;
    const __global kl_gather_point *point = points + i;
    const uint set = point->seed & (settings.sets - 1u);
    grid.side = settings.side;
    grid.corners = corners;
    grid.turn = turn;
    kl_reduce_record(cells + i * rays, directions + (size_t)set * rays, &grid, point,
                     smooth + i * rays, &result);
    kl_reduce_touched(cells + i * rays, rays, settings.touch, &result);
    results[i] = result;
}
