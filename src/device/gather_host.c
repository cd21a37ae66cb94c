#include "src/device/gather.h"

#include "src/base/memory.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

/* Cells of one thread: of this step, of the one before, and smoothed ones. */
struct scratch {
    kl_gather_cell *now, *before, *smooth;
};

static void gather_step(const struct kl_gather_job *job, uint32_t step, size_t i,
                        const struct scratch *scratch)
{
    const struct kl_gather_tables *tables = job->ladder.steps[step];
    const kl_gather_settings settings = kl_gather_step(job, step);
    const kl_grid_view grid = kl_gather_tables_grid(tables);
    const kl_gather_point *point = &job->points[i];
    const kl_direction *directions = kl_gather_directions(tables, point->seed);
    for (uint32_t order = 0; order < settings.side * settings.side; ++order) {
        const uint32_t cell = kl_cell_in_order(order, settings.side);
        scratch->now[cell] = kl_gather_one_cell(job->scene, job->level1, &settings, point,
                                                directions, cell, scratch->before);
    }
    kl_reduce_record(scratch->now, directions, &grid, point, scratch->smooth, &job->results[i]);
    kl_reduce_touched(scratch->now, settings.side * settings.side, settings.touch,
                      &job->results[i]);
}

void kl_gather_keep(const struct kl_gather_job *job, uint32_t step, size_t i,
                    const kl_gather_cell *cells)
{
    const size_t side = job->ladder.steps[step]->side;
    struct kl_err ignored;
    if (job->cells == NULL) return;
    if (kl_alloc_array(&job->cells[i], side * side, sizeof *cells, &ignored) != KL_OK) return;
    memcpy(job->cells[i], cells, side * side * sizeof *cells);
}

static void gather_record(const struct kl_gather_job *job, size_t i, struct scratch scratch)
{
    for (uint32_t step = 0; step < job->ladder.count; ++step) {
        gather_step(job, step, i, &scratch);
        if (kl_gather_is_done(&job->ladder, step, &job->results[i])) {
            kl_gather_keep(job, step, i, scratch.now);
            break;
        }
        kl_gather_cell *free_again = scratch.before;
        scratch.before = scratch.now;
        scratch.now = free_again;
    }
}

kl_status kl_gather_host(const struct kl_gather_job *job, struct kl_err *err)
{
    const size_t side = job->ladder.steps[job->ladder.count - 1]->side;
    const size_t cells = side * side;
    kl_gather_cell *all = NULL;
    kl_status st =
        kl_alloc_array(&all, 3 * cells * (size_t)omp_get_max_threads(), sizeof *all, err);

    if (st != KL_OK) return st;
#pragma omp parallel for schedule(dynamic, 4)
    for (size_t i = 0; i < job->count; ++i) {
        kl_gather_cell *own = all + 3 * cells * (size_t)omp_get_thread_num();
        gather_record(job, i, (struct scratch){own, own + cells, own + 2 * cells});
    }
    free(all);
    return KL_OK;
}

void kl_gather_host_picks(const struct kl_gather_picks *picks)
{
    const kl_gather_settings settings = kl_gather_pick_settings(picks);

#pragma omp parallel for schedule(dynamic, 256)
    for (size_t i = 0; i < picks->count; ++i) {
        const kl_gather_pick *pick = &picks->picks[i];
        picks->cells[i] =
            kl_gather_direction(picks->scene, picks->level1, &settings, &picks->points[pick->point],
                                &picks->tables->directions[pick->direction]);
    }
}
