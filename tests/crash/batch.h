/* Made-up records for tests of the cache on disk: sound, and each known by its number. */
#ifndef KL_TESTS_CRASH_BATCH_H
#define KL_TESTS_CRASH_BATCH_H

#include "cache_io/store.h"

struct kl_cache;

struct batch {
    uint32_t count; /* of records of level 0; level 1 has half as many */
    kl_record_hot *hot[KL_CACHE_LEVELS];
    kl_record_cold *cold[KL_CACHE_LEVELS];
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    struct kl_cache *cache; /* owns the levels of an indexed batch */
};

/* Records first, first + 1, ... The same number gives the same record. Aborts on failure. */
struct batch *batch_create(uint32_t first, uint32_t count);
/* The same with octrees, as a finished fill leaves them. */
struct batch *batch_create_indexed(uint32_t first, uint32_t count);
void batch_destroy(struct batch *batch);
/* Number of a record that batch_create made. */
uint32_t batch_number(const kl_record_hot *hot);

struct kl_store_key batch_key(void);

/* How often each number below `limit` is in level 0 of the store at `dir`, added to counts; aborts
 * where a number is out of range or a record is not the one of its number. KL_OK, or why the store
 * cannot be opened. */
kl_status batch_count(const char *dir, uint32_t *counts, uint32_t limit, struct kl_err *err);

/* End the process with exit code 1 and the message unless st is KL_OK. */
void batch_must(kl_status st, const struct kl_err *err);
/* Open a store of batches; it must. */
struct kl_store *batch_open(const char *dir, enum kl_store_mode mode);
/* Publish all records of the store as one base. */
void batch_compact(struct kl_store *store);

/* A folder of its own below TMPDIR or /tmp, and its end with all that is in it. */
void folder_create(char path[64]);
void folder_empty(const char *path);
void folder_destroy(const char *path);

#endif
