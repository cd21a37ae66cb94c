#include "src/device/gather.h"

#include "src/base/memory.h"

#include <omp.h>
#include <stdlib.h>

static void gather_one(const struct kl_gather_job *job, const kl_grid_view *grid, size_t i,
                       kl_gather_cell *cells)
{
    const uint32_t side = job->tables->side;
    const kl_gather_point *point = &job->points[i];
    const kl_direction *directions = kl_gather_directions(job->tables, point->seed);
    for (uint32_t order = 0; order < side * side; ++order) {
        const uint32_t cell = kl_cell_in_order(order, side);
        cells[cell] =
            kl_gather_direction(job->scene, job->level1, &job->settings, point, &directions[cell]);
    }
    kl_reduce_record(cells, directions, grid, point, &job->results[i]);
    kl_reduce_touched(cells, side * side, job->settings.touch, &job->results[i]);
}

kl_status kl_gather_host(const struct kl_gather_job *job, struct kl_err *err)
{
    const size_t cells = (size_t)job->tables->side * job->tables->side;
    const kl_grid_view grid = kl_gather_tables_grid(job->tables);
    kl_gather_cell *scratch = NULL;
    kl_status st =
        kl_alloc_array(&scratch, cells * (size_t)omp_get_max_threads(), sizeof *scratch, err);

    if (st != KL_OK) return st;
#pragma omp parallel for schedule(dynamic, 4)
    for (size_t i = 0; i < job->count; ++i) {
        gather_one(job, &grid, i, scratch + cells * (size_t)omp_get_thread_num());
    }
    free(scratch);
    return KL_OK;
}
