#include "cache_io/store_impl.h"
#include "cache_io/upkeep.h"
#include "src/base/memory.h"

#include <stdlib.h>
#include <string.h>

struct merge {
    struct kl_store_key key;
    struct kl_records *records;
    kl_part *parts;
    uint32_t part_count;
};

/* Of the sources' lists the same one, whatever their order: the longest, then the first in bytes.
 */
static kl_status take_parts(struct merge *m, const struct kl_store *store, struct kl_err *err)
{
    uint32_t count = 0;
    kl_part *copy = NULL;
    const kl_part *parts = kl_store_parts_get(store, &count);

    if (count < m->part_count || count == 0) return KL_OK;
    if (count == m->part_count && memcmp(parts, m->parts, count * sizeof *parts) >= 0) return KL_OK;
    kl_status st = kl_alloc_array(&copy, count, sizeof *copy, err);
    if (st != KL_OK) return st;
    memcpy(copy, parts, count * sizeof *copy);
    free(m->parts);
    m->parts = copy;
    m->part_count = count;
    return KL_OK;
}

static kl_status take_source(struct merge *m, const char *dir, bool is_first,
                             struct kl_store_merged *out, struct kl_err *err)
{
    struct kl_store *store = NULL;
    struct kl_store_key key;
    kl_status st = kl_store_open(dir, KL_STORE_READ, NULL, &store, err);

    if (st != KL_OK) return st;
    kl_store_key_get(store, &key);
    if (is_first) m->key = key;
    st = store_check_read(store, err);
    if (st == KL_OK) st = store_check_key(&key, &m->key, dir, err);
    if (st == KL_OK) st = kl_records_add_store(m->records, store, err);
    if (st == KL_OK) st = take_parts(m, store, err);
    out->damaged += kl_store_damaged(store, NULL);
    kl_store_close(store);
    return st;
}

static kl_status write_target(const struct merge *m, const char *target, struct kl_err *err)
{
    struct kl_store *store = NULL;
    kl_status st = kl_store_open(target, KL_STORE_EXTEND, &m->key, &store, err);

    if (st == KL_ERR_STALE || (st == KL_OK && kl_store_segment_count(store) > 0)) {
        st = kl_fail(err, KL_ERR_USAGE, "%s: is a cache already", target);
    }
    if (st == KL_OK) st = kl_store_parts_set(store, m->parts, m->part_count, err);
    if (st == KL_OK) st = kl_store_publish_records(store, m->records, err);
    kl_store_close(store);
    return st;
}

kl_status kl_store_merge(const char *const *sources, size_t count, const char *target,
                         struct kl_store_merged *out, struct kl_err *err)
{
    struct merge m = {0};
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    kl_status st = kl_records_create(&m.records, err);

    *out = (struct kl_store_merged){0};
    for (size_t i = 0; i < count && st == KL_OK; ++i) {
        st = take_source(&m, sources[i], i == 0, out, err);
    }
    if (st == KL_OK) st = kl_records_merge(m.records, &out->merged, err);
    if (st == KL_OK) {
        kl_records_get(m.records, levels);
        for (int l = 0; l < KL_CACHE_LEVELS; ++l)
            out->records[l] = levels[l].record_count;
        st = write_target(&m, target, err);
    }
    kl_records_destroy(m.records);
    free(m.parts);
    return st;
}
