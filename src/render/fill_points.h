/* Private to src/render: the points at which the cache must serve. */
#ifndef KL_SRC_RENDER_FILL_POINTS_H
#define KL_SRC_RENDER_FILL_POINTS_H

#include "src/render/fill.h"

struct kl_point {
    kl_vec3 pos, smooth, geometric; /* render space */
    float pixel;                    /* [m] size of a pixel there */
    float near;                     /* [m] harmonic mean distance of a few rays; KL_INF: unknown */
    uint32_t rank;                  /* random order */
    bool covered;
};

/* What the centres of pixels see through mirrors: the first diffuse surface. Of every column and
 * row if `every` is 1, of every second one if it is 2. *points is the caller's to free(). */
kl_status kl_fill_screen_points(const struct kl_fill_job *job, uint32_t camera, uint32_t every,
                                struct kl_point **points, size_t *count,
                                struct kl_err *err) KL_MUST_CHECK;
/* Where gather rays land: vertices of random walks from what the cameras see. The same points for
 * the same cameras, whatever the cache holds. */
kl_status kl_fill_world_points(const struct kl_fill_job *job, struct kl_point **points,
                               size_t *count, struct kl_err *err) KL_MUST_CHECK;

/* The surface under a record, seen from its side. False: there is none, or it faces elsewhere. */
bool kl_fill_find_surface(const kl_scene_view *scene, const kl_record_hot *hot, kl_hit *hit,
                          kl_surface *out);

/* What a point on a surface lies on: kl_ride. `motion`: kl_fill_job. */
kl_ride kl_fill_find_ride(const kl_scene_view *motion, kl_vec3 pos, kl_u32 geometric);

/* Let a point gather by the rays of this seed. */
void kl_fill_seed(kl_gather_point *point, kl_u32 seed);
/* Where, and with which seed, a record of `level` gathers. Normals are octahedral. */
kl_gather_point kl_fill_gather_point(const kl_scene_view *motion, kl_vec3 pos, kl_u32 normal,
                                     kl_u32 geometric, uint32_t level);

/* Gather records of `level` with rays that end in `level1`; counts the rays. */
kl_status kl_fill_gather(const struct kl_fill_job *job, const kl_level_view *level1, uint32_t level,
                         const kl_gather_point *points, size_t count, kl_gather_result *results,
                         struct kl_fill_stats *stats, struct kl_err *err) KL_MUST_CHECK;

/* Luminance [W m^-2] of irradiance that counts as black: far below the geometric mean of `count`
 * of them, RGB, `stride` floats apart. 0 if all are. */
double kl_fill_black(const float *irr, size_t count, size_t stride);

#endif
