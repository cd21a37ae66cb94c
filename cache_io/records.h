/* Sets of records, taken from stores, merged and chosen from: what merge, prune, compaction and
 * repair work on. The result does not depend on the order in which records were added.
 *
 * Threads: one at a time. */
#ifndef KL_CACHE_IO_RECORDS_H
#define KL_CACHE_IO_RECORDS_H

#include "cache_io/store.h"

struct kl_records;

kl_status kl_records_create(struct kl_records **out, struct kl_err *err) KL_MUST_CHECK;
void kl_records_destroy(struct kl_records *records); /* accepts NULL */

/* Add copies of all records of `levels` (octrees ignored). births[l]: the generation that each was
 * first written in, NULL: all in `born`. */
kl_status kl_records_add(struct kl_records *records,
                         const struct kl_level_arrays levels[KL_CACHE_LEVELS],
                         const uint32_t *const births[KL_CACHE_LEVELS], uint32_t born,
                         struct kl_err *err) KL_MUST_CHECK;
/* The same for every segment of a store. */
kl_status kl_records_add_store(struct kl_records *records, const struct kl_store *store,
                               struct kl_err *err) KL_MUST_CHECK;

/* Sort, and leave one of the records that stand for the same place: same level and object,
 * positions nearer than 1e-3 of the smaller radius, normals within acos(0.999). The one of the
 * smaller error stays. *merged: how many went. */
kl_status kl_records_merge(struct kl_records *records, uint64_t *merged,
                           struct kl_err *err) KL_MUST_CHECK;

/* Keep the records for which `keep` says so. */
typedef bool (*kl_records_keep_fn)(void *context, uint32_t level, const kl_record_hot *hot,
                                   const kl_record_cold *cold, uint32_t birth);
void kl_records_select(struct kl_records *records, kl_records_keep_fn keep, void *context);

/* Borrowed until the set changes; no octrees. */
void kl_records_get(const struct kl_records *records,
                    struct kl_level_arrays levels[KL_CACHE_LEVELS]);
const uint32_t *kl_records_births(const struct kl_records *records, uint32_t level);

/* Publish one base with these records, not indexed, in place of all segments of the store's list:
 * kl_store_publish_base without octrees, and with the births that the set knows. */
kl_status kl_store_publish_records(struct kl_store *store, const struct kl_records *records,
                                   struct kl_err *err) KL_MUST_CHECK;

#endif
