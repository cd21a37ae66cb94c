#include "cache_io/store_impl.h"
#include "cache_io/upkeep.h"
#include "src/base/file.h"
#include "src/base/file_calls.h"
#include "src/base/memory.h"

#include <errno.h>
#include <stdlib.h>

/* What a base in place of this segment may remove. Where records are lost, what the segment itself
 * had superseded is in use again, and stays. */
static kl_status list_old(const struct segment *segment, bool lost, struct id_list *old,
                          struct kl_err *err)
{
    const size_t count = lost ? 0 : segment->superseded_count;
    kl_status st = kl_alloc_array(&old->ids, count + 1, sizeof *old->ids, err);

    if (st != KL_OK) return st;
    old->capacity = count + 1;
    old->ids[old->count++] = segment->id;
    for (size_t i = 0; i < count; ++i)
        old->ids[old->count++] = segment_superseded_get(segment, i);
    return KL_OK;
}

static kl_status remove_file(const struct kl_store *store, const struct segment_id *id,
                             struct kl_err *err)
{
    char name[SEGMENT_NAME_SIZE];

    segment_id_format(id, name);
    if (kl_file_calls->unlink_at(store->dir_fd, name) == 0 || errno == ENOENT) return KL_OK;
    return kl_fail_errno(err, "remove %s", name);
}

static kl_status rewrite(struct kl_store *store, const struct segment *segment,
                         struct kl_store_repaired *out, struct kl_err *err)
{
    struct id_list old = {0};
    struct segment replaced = {0};
    uint64_t kept = 0;
    uint64_t lost = 0;

    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        kept += segment->levels[l].record_count;
        lost += segment->damage.records[l];
    }
    if (kept == 0) {
        ++out->removed;
        return remove_file(store, &segment->id, err);
    }
    kl_status st = list_old(segment, lost > 0, &old, err);
    if (st == KL_OK) {
        st = store_replace(store, &old, segment->levels, segment->births, &replaced, err);
    }
    if (st == KL_OK) {
        segment_close(&replaced);
        ++out->rewritten;
    }
    free(old.ids);
    return st;
}

kl_status kl_store_repair(const char *dir, struct kl_store_repaired *out, struct kl_err *err)
{
    struct kl_store *store = NULL;
    kl_status st = store_open_found(dir, &store, err);

    *out = (struct kl_store_repaired){0};
    if (st != KL_OK) return st;
    kl_store_get_damage(store, &out->lost);
    for (size_t i = 0; i < store->segments.count && st == KL_OK; ++i) {
        const struct segment *segment = &store->segments.items[i];
        if (segment_is_damaged(segment)) st = rewrite(store, segment, out, err);
    }
    for (size_t i = 0; i < store->reject_count && st == KL_OK; ++i) {
        if (store->rejects[i].why != REJECT_DAMAGED) continue;
        st = remove_file(store, &store->rejects[i].id, err);
        ++out->removed;
    }
    if (st == KL_OK && out->removed > 0 && kl_file_sync(store->dir_fd) != 0) {
        st = kl_fail_errno(err, "fsync");
    }
    kl_store_close(store);
    return st == KL_OK ? KL_OK : kl_wrap(err, "%s", dir);
}
