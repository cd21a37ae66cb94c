/* Proof at run time: interpolated irradiance against gathers of the same points with many rays. */
#ifndef KL_SRC_RENDER_VERIFY_H
#define KL_SRC_RENDER_VERIFY_H

#include "src/render/fill.h"

struct kl_verify_job {
    const kl_scene_view *scene, *motion; /* as kl_fill_job */
    kl_level_view cache;                 /* records of level 0 */
    kl_query query;                      /* as frames ask */
    const kl_level_view *level1;     /* what gather rays may end in, NULL: they go on as paths */
    const struct kl_camera *cameras; /* one per frame */
    uint32_t camera_count;
    double share;                   /* of the pixels that see a surface, in (0, 1] */
    uint32_t at_most;               /* points over all cameras together, 0: no limit */
    struct kl_gather_ladder ladder; /* rays of the references */
    kl_gather_settings gather;      /* side and sets are set from the ladder */
    kl_gather_fn gather_batch;
    void *gather_context;
};

/* Relative errors (interpolated - reference) / reference of the luminance; references below a
 * thousandth of their geometric mean count as that. Intervals hold the value with 95 %. */
struct kl_verify_stats {
    uint64_t points, unserved;  /* compared; without a record */
    uint64_t rays;              /* first ones of the references */
    double bias, bias_interval; /* mean, and half the width of its interval */
    double rmse, rmse_interval;
    double p95, p95_low, p95_high; /* percentiles of the size of the error */
    double p99, p99_low, p99_high;
    double noise; /* root mean square of the references' own relative standard errors */
};

/* Errors of several calls, to be summed up together. Zero is empty; values are to be free()d. */
struct kl_verify_errors {
    double *values;
    size_t count, room;
    uint64_t unserved, rays;
    double noise2; /* sum of the references' squared relative standard errors */
};

/* Gather at visible points of the cameras, spread evenly, by default as paths that ask no record.
 * The same points for the same cameras. What is found is also added to *all, which may be NULL. */
kl_status kl_verify(const struct kl_verify_job *job, struct kl_verify_errors *all,
                    struct kl_verify_stats *stats, struct kl_err *err) KL_MUST_CHECK;

/* Sums up; sorts the values. */
void kl_verify_summarise(struct kl_verify_errors *errors, struct kl_verify_stats *stats);

/* 95th percentile without what the noise of the references adds to it. */
double kl_verify_error(const struct kl_verify_stats *stats);

#endif
