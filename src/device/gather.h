/* Batches of irradiance gathers: points in, irradiance with gradients out. The arithmetic is
 * kernels/gather.h and kernels/derivatives.h; this says who runs it. */
#ifndef KL_SRC_DEVICE_GATHER_H
#define KL_SRC_DEVICE_GATHER_H

#include "kernels/derivatives.h"
#include "src/base/status.h"

#include <stdbool.h>
#include <stdint.h>

/* Tables that all gathers with side x side rays share. */
struct kl_gather_tables {
    uint32_t side, sets;
    kl_direction *directions; /* sets x side^2 */
    float *corners;           /* kl_grid_view */
    float *turn;
};

/* `side`: a power of two in [4, 256]. *out is the caller's: kl_gather_tables_destroy. */
kl_status kl_gather_tables_create(uint32_t side, struct kl_gather_tables **out,
                                  struct kl_err *err) KL_MUST_CHECK;
void kl_gather_tables_destroy(struct kl_gather_tables *tables); /* accepts NULL */
kl_grid_view kl_gather_tables_grid(const struct kl_gather_tables *tables);

/* Directions of a point: its seed chooses the set. */
static inline const kl_direction *kl_gather_directions(const struct kl_gather_tables *tables,
                                                       uint32_t seed)
{
    return tables->directions + (size_t)(seed & (tables->sets - 1)) * tables->side * tables->side;
}

/* Standard errors as quarter blocks tell them, over what they are on average. */
#define KL_TOLD_NOISE 1.5f

/* How many rays a record gets: every step has four times the rays of the one before and keeps
 * theirs, because the directions are prefixes of one sequence. */
enum { KL_GATHER_STEPS = 5 };
struct kl_gather_ladder {
    const struct kl_gather_tables *steps[KL_GATHER_STEPS]; /* borrowed */
    uint32_t count;
    float tolerance; /* relative standard error that is good enough; with one step not read */
    float floor;     /* luminance [W m^-2] below which the error is measured against this instead */
};

struct kl_gather_job {
    const kl_scene_view *scene;
    const kl_level_view *level1; /* frozen records that rays may end in */
    struct kl_gather_ladder ladder;
    kl_gather_settings settings; /* side and sets are set for each step */
    const kl_gather_point *points;
    size_t count;
    kl_gather_result *results; /* count of them, written */
    kl_gather_cell **cells;    /* count of them, NULL; written: each record's last cells, the
                                * caller's to free(), NULL where memory is out; NULL: they are not
                                * wanted */
};

/* Single rays of records, all of one step. */
struct kl_gather_picks {
    const kl_scene_view *scene;
    const kl_level_view *level1;
    const struct kl_gather_tables *tables;
    kl_gather_settings settings; /* as kl_gather_job */
    const kl_gather_point *points;
    size_t point_count;
    const kl_gather_pick *picks;
    size_t count;
    kl_gather_cell *cells; /* count of them, written */
};

/* The job's settings for one step. */
static inline kl_gather_settings kl_gather_step(const struct kl_gather_job *job, uint32_t step)
{
    kl_gather_settings s = job->settings;
    s.side = job->ladder.steps[step]->side;
    s.sets = job->ladder.steps[step]->sets;
    s.side_before = step > 0 ? job->ladder.steps[step - 1]->side : 0;
    return s;
}

/* The same for single rays. */
static inline kl_gather_settings kl_gather_pick_settings(const struct kl_gather_picks *picks)
{
    kl_gather_settings s = picks->settings;
    s.side = picks->tables->side;
    s.sets = picks->tables->sets;
    return s;
}

/* Is a record that was gathered on `step` good enough? */
static inline bool kl_gather_is_done(const struct kl_gather_ladder *ladder, uint32_t step,
                                     const kl_gather_result *result)
{
    if (step + 1 >= ladder->count) return true;
    const float y = kl_luminance(kl_v3(result->irr[0], result->irr[1], result->irr[2]));
    return result->error * y <= ladder->tolerance * kl_fmax(y, ladder->floor);
}

/* Hand record i's cells of its last step to who wants them. */
void kl_gather_keep(const struct kl_gather_job *job, uint32_t step, size_t i,
                    const kl_gather_cell *cells);

/* Run on the host with Embree, all OpenMP threads. Results do not depend on their number. */
kl_status kl_gather_host(const struct kl_gather_job *job, struct kl_err *err) KL_MUST_CHECK;
void kl_gather_host_picks(const struct kl_gather_picks *picks);

#endif
