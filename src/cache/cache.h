/* The irradiance cache in memory: per bounce level a set of records and their octree, taken from
 * a store or grown by batches. Reading and growing are separate: a view stays as it is until the
 * next kl_cache_insert, _finish or _load. */
#ifndef KL_SRC_CACHE_CACHE_H
#define KL_SRC_CACHE_CACHE_H

#include "kernels/cache_query.h"
#include "src/base/status.h"
#include "src/cache/record.h"

#include <stdbool.h>
#include <stdint.h>

struct kl_cache;

struct kl_cache_settings {
    float center[3]; /* bounding sphere of the scene, render space [m] */
    float scene_radius;
    enum kl_radius_rule rule;
    float accuracy[KL_CACHE_LEVELS]; /* radius over raw radius */
    float reach[KL_CACHE_LEVELS];    /* largest factor that queries enlarge radii by */
    float cos_max;                   /* cosine of the largest angle between normals */
};

kl_status kl_cache_create(const struct kl_cache_settings *settings, struct kl_cache **out,
                          struct kl_err *err) KL_MUST_CHECK;
void kl_cache_destroy(struct kl_cache *cache); /* accepts NULL */

/* Make the cache serve these arrays in place (mapped from a store): nothing is copied as long as
 * nothing is inserted. They must stay until the cache is destroyed or grown. Where the octree was
 * built for other settings, records are copied and indexed anew. */
kl_status kl_cache_adopt(struct kl_cache *cache, uint32_t level, const struct kl_level_arrays *part,
                         struct kl_err *err) KL_MUST_CHECK;

/* Add a batch. Duplicates (same id, position and normal) are left out. Radii of all records are
 * clamped anew, the octree is rebuilt. The result does not depend on how records were split into
 * batches or ordered within them, once kl_cache_finish has sorted them. */
kl_status kl_cache_insert(struct kl_cache *cache, uint32_t level, const kl_record_hot *hot,
                          const kl_record_cold *cold, uint32_t count,
                          struct kl_err *err) KL_MUST_CHECK;

/* Sort the records along the Z-curve and index them: the form that goes to disk. No-op on levels
 * that have not grown since they were adopted or finished. */
kl_status kl_cache_finish(struct kl_cache *cache, struct kl_err *err) KL_MUST_CHECK;

/* What queries read. Borrowed until the cache changes. */
kl_level_view kl_cache_view(const struct kl_cache *cache, uint32_t level);
struct kl_level_arrays kl_cache_get_arrays(const struct kl_cache *cache, uint32_t level);
uint32_t kl_cache_count(const struct kl_cache *cache, uint32_t level);

/* Another irradiance for record i; all else stays, its relative gradients too. Without effect on a
 * level that has not grown since it was adopted: it is another's. */
void kl_cache_set_light(struct kl_cache *cache, uint32_t level, uint32_t i, const float irr[3]);

/* Those that the cache was made with, the accuracies as they are now; borrowed. */
const struct kl_cache_settings *kl_cache_get_settings(const struct kl_cache *cache);
/* Another accuracy: all radii of the level are made anew, no irradiance changes. */
kl_status kl_cache_set_accuracy(struct kl_cache *cache, uint32_t level, float accuracy,
                                struct kl_err *err) KL_MUST_CHECK;

/* Make ready for kl_cache_predict_radius after adopting: costs a look at every record. */
kl_status kl_cache_prepare(struct kl_cache *cache, uint32_t level,
                           struct kl_err *err) KL_MUST_CHECK;

/* Radius [m] that a record at pos would get at most, judged by its neighbours; `otherwise` where
 * there are none. */
float kl_cache_predict_radius(const struct kl_cache *cache, uint32_t level, const float pos[3],
                              float otherwise);

#endif
