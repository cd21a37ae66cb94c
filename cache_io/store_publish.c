/* Writing to a store: batches, and bases that take the place of others. */
#include "cache_io/records.h"
#include "cache_io/store_impl.h"
#include "cache_io/use_impl.h"
#include "src/base/file.h"
#include "src/base/file_calls.h"
#include "src/base/memory.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>

enum { TEMP_LIFE_S = 3600 }; /* a temp file that old belongs to nobody who lives */

static kl_status check_writable(const struct kl_store *store, struct kl_err *err)
{
    if (store->mode == KL_STORE_READ) {
        return kl_fail(err, KL_ERR_USAGE, "the cache was opened for reading only");
    }
    if (store->broken) {
        return kl_fail(err, KL_ERR_IO, "the cache is not written after a write that failed");
    }
    return KL_OK;
}

/* What readers would refuse is never written. */
static kl_status check_levels(const struct kl_level_arrays *levels, bool with_octree,
                              struct kl_err *err)
{
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        const struct kl_level_arrays *level = &levels[l];
        if (!records_are_valid(level)) {
            return kl_fail(err, KL_ERR_USAGE, "cache level %u: a record is not sound", l);
        }
        if (!with_octree || level->octree.record_count == 0) continue;
        if (octree_validate(level, err) != KL_OK) {
            err->status = KL_ERR_USAGE;
            return kl_wrap(err, "cache level %u", l);
        }
    }
    return KL_OK;
}

kl_status kl_store_append(struct kl_store *store,
                          const struct kl_level_arrays records[KL_CACHE_LEVELS], struct kl_err *err)
{
    uint64_t total = 0;
    kl_status st = check_writable(store, err);

    if (st == KL_OK) st = check_levels(records, false, err);
    if (st != KL_OK) return st;
    for (int l = 0; l < KL_CACHE_LEVELS; ++l)
        total += records[l].record_count;
    if (total == 0) return KL_OK;
    struct segment_list *list = &store->segments;
    st = kl_grow_array(&list->items, &list->capacity, list->count + 1, sizeof *list->items, err);
    if (st != KL_OK) return st;
    uint32_t known = 0;
    (void)kl_store_parts_get(store, &known);
    const struct segment_plan plan = {
        .kind = SEGMENT_DELTA,
        .generation = store->generation + 1,
        .key = &store->key,
        .levels = records,
        .parts = store->parts,
        .part_count = known > 0 ? 0 : store->part_count,
    };
    st = segment_write(store->dir_fd, &plan, &list->items[list->count], err);
    if (st == KL_OK) {
        ++list->count;
        store->generation = plan.generation;
    } else {
        store->broken = true;
    }
    return st;
}

/* Remove a writer's temp file, or a claim, that is older than the directory's last change by
 * TEMP_LIFE_S: both times are the file system's, so no machine's clock counts. */
static kl_status sweep_temp(void *context, const char *name, struct kl_err *err)
{
    const struct kl_store *store = context;
    struct stat file;
    struct stat dir;

    (void)err;
    const char *bare = name[0] == '.' ? name + 1 : name;
    if (!segment_is_temp(name) && !use_is_temp(name) && strncmp(bare, "claim-", 6) != 0) {
        return KL_OK;
    }
    const int fd = kl_file_open_at(store->dir_fd, name, O_RDONLY);
    if (fd < 0) return KL_OK;
    const bool known =
        kl_file_calls->stat(fd, &file) == 0 && kl_file_calls->stat(store->dir_fd, &dir) == 0;
    (void)kl_file_calls->close(fd);
    if (known && dir.st_mtime - file.st_mtime > TEMP_LIFE_S) {
        (void)kl_file_calls->unlink_at(store->dir_fd, name);
    }
    return KL_OK;
}

kl_status store_replace(struct kl_store *store, struct id_list *old,
                        const struct kl_level_arrays levels[KL_CACHE_LEVELS],
                        const uint32_t *const births[KL_CACHE_LEVELS], struct segment *out,
                        struct kl_err *err)
{
    struct kl_err ignored;

    if (old->count > 1) qsort(old->ids, old->count, sizeof *old->ids, segment_id_compare);
    uint32_t part_count = store->part_count;
    const kl_part *parts = part_count > 0 ? store->parts : kl_store_parts_get(store, &part_count);
    const struct segment_plan plan = {
        .kind = SEGMENT_BASE,
        .generation = store->generation + 1,
        .key = &store->key,
        .levels = levels,
        .births = births,
        .superseded_count = old->count,
        .superseded = old->ids,
        .parts = parts,
        .part_count = part_count,
    };
    kl_status st = segment_write(store->dir_fd, &plan, out, err);
    if (st != KL_OK) {
        store->broken = true;
        return st;
    }
    store->generation = plan.generation;
    /* The base is durable. What cannot be removed now is ignored by readers and tried again. */
    size_t left = 0;
    for (size_t i = 0; i < old->count; ++i) {
        char name[SEGMENT_NAME_SIZE];
        segment_id_format(&old->ids[i], name);
        if (kl_file_calls->unlink_at(store->dir_fd, name) != 0 && errno != ENOENT) {
            old->ids[left++] = old->ids[i];
        }
    }
    old->count = left;
    (void)kl_file_sync(store->dir_fd);
    if (store_for_each_name(store->dir_fd, sweep_temp, store, &ignored) != KL_OK) return KL_OK;
    return KL_OK;
}

/* Everything that a new base replaces: what is open, what it had replaced and still lies there. */
static kl_status collect_superseded(const struct kl_store *store, struct id_list *out,
                                    struct kl_err *err)
{
    const size_t total = store->segments.count + store->leftovers.count;
    kl_status st = kl_alloc_array(&out->ids, total, sizeof *out->ids, err);

    if (st != KL_OK) return st;
    out->capacity = total;
    for (size_t i = 0; i < store->segments.count; ++i)
        out->ids[out->count++] = store->segments.items[i].id;
    for (size_t i = 0; i < store->leftovers.count; ++i)
        out->ids[out->count++] = store->leftovers.ids[i];
    return KL_OK;
}

/* The new base takes the place of all that the store holds. */
static kl_status publish_base(struct kl_store *store,
                              const struct kl_level_arrays levels[KL_CACHE_LEVELS],
                              const uint32_t *const births[KL_CACHE_LEVELS], struct kl_err *err)
{
    struct id_list old = {0};
    struct segment_list list = {.capacity = 16};
    kl_status st = collect_superseded(store, &old, err);

    if (st == KL_OK) st = kl_alloc_array(&list.items, list.capacity, sizeof *list.items, err);
    if (st == KL_OK) st = store_replace(store, &old, levels, births, &list.items[0], err);
    if (st == KL_OK) {
        list.count = 1;
        const struct segment_list before = store->segments;
        store->segments = list;
        list = before;
        free(store->leftovers.ids);
        store->leftovers = old;
        old = (struct id_list){0};
    }
    free(old.ids);
    segment_list_fini(&list);
    return st;
}

kl_status kl_store_publish_base(struct kl_store *store,
                                const struct kl_level_arrays levels[KL_CACHE_LEVELS],
                                struct kl_err *err)
{
    uint32_t *births[KL_CACHE_LEVELS] = {NULL};
    kl_status st = check_writable(store, err);

    if (st == KL_OK) st = check_levels(levels, true, err);
    if (st == KL_OK) {
        const uint64_t next = store->generation + 1;
        st = store_find_births(store, levels, next < UINT32_MAX ? (uint32_t)next : UINT32_MAX,
                               births, err);
    }
    if (st == KL_OK) st = publish_base(store, levels, (const uint32_t *const *)births, err);
    for (int l = 0; l < KL_CACHE_LEVELS; ++l)
        free(births[l]);
    return st;
}

kl_status kl_store_publish_records(struct kl_store *store, const struct kl_records *records,
                                   struct kl_err *err)
{
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    const uint32_t *births[KL_CACHE_LEVELS];
    kl_status st = check_writable(store, err);

    kl_records_get(records, levels);
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l)
        births[l] = kl_records_births(records, l);
    if (st == KL_OK) st = check_levels(levels, false, err);
    return st == KL_OK ? publish_base(store, levels, births, err) : st;
}
