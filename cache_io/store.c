/* Open stores: their life, and what they tell. Invariants: docs/cache_format.md section 1. */
#include "cache_io/store.h"

#include "cache_io/store_impl.h"
#include "cache_io/use_impl.h"
#include "src/base/file.h"
#include "src/base/file_calls.h"
#include "src/base/memory.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- opening ---- */

kl_status store_check_key(const struct kl_store_key *have, const struct kl_store_key *want,
                          const char *name, struct kl_err *err)
{
    const bool scene = memcmp(have->scene, want->scene, KL_DIGEST_SIZE) != 0;
    const bool settings = memcmp(have->settings, want->settings, KL_DIGEST_SIZE) != 0;
    bool origin = false;

    for (int i = 0; i < 3; ++i)
        origin = origin || have->origin[i] != want->origin[i];
    if (!scene && !settings && !origin) return KL_OK;
    return kl_fail(err, KL_ERR_STALE, "%s was made for another%s%s%s", name, scene ? " scene" : "",
                   settings ? (scene ? " and other settings" : " choice of settings") : "",
                   origin && !scene && !settings ? " origin of the scene" : "");
}

struct removal {
    int dir_fd;
    struct id_list segments;
};

static kl_status remove_other(void *context, const char *name, struct kl_err *err)
{
    struct removal *r = context;
    struct segment_id id;
    uint64_t use = 0;

    if (segment_id_parse(name, &id)) {
        kl_status st = kl_grow_array(&r->segments.ids, &r->segments.capacity, r->segments.count + 1,
                                     sizeof *r->segments.ids, err);
        if (st == KL_OK) r->segments.ids[r->segments.count++] = id;
        return st;
    }
    /* Generations begin anew: what renders told of the old ones would be taken for the new. */
    if (!segment_is_temp(name) && !use_name_parse(name, &use) && !use_is_temp(name)) return KL_OK;
    if (kl_file_calls->unlink_at(r->dir_fd, name) == 0 || errno == ENOENT) return KL_OK;
    return kl_fail_errno(err, "remove %s", name);
}

/* Deltas go before bases, and old bases before new ones: what a base had superseded, and a crash
 * had left behind, cannot come back to life. */
static int compare_removal(const void *a, const void *b)
{
    const struct segment_id *x = a;
    const struct segment_id *y = b;

    if (x->kind != y->kind) return x->kind == SEGMENT_DELTA ? -1 : 1;
    return segment_id_compare(a, b);
}

static kl_status remove_all(int dir_fd, struct kl_err *err)
{
    struct removal r = {.dir_fd = dir_fd};
    kl_status st = store_for_each_name(dir_fd, remove_other, &r, err);

    if (r.segments.count > 1) {
        qsort(r.segments.ids, r.segments.count, sizeof *r.segments.ids, compare_removal);
    }
    for (size_t i = 0; i < r.segments.count && st == KL_OK; ++i) {
        char name[SEGMENT_NAME_SIZE];
        segment_id_format(&r.segments.ids[i], name);
        /* Names go for good in this order only if each step is durable before the next. */
        if (i > 0 && r.segments.ids[i].kind == SEGMENT_BASE && kl_file_sync(dir_fd) != 0) {
            st = kl_fail_errno(err, "fsync");
            break;
        }
        if (kl_file_calls->unlink_at(dir_fd, name) != 0 && errno != ENOENT) {
            st = kl_fail_errno(err, "remove %s", name);
        }
    }
    if (st == KL_OK && kl_file_sync(dir_fd) != 0) st = kl_fail_errno(err, "fsync");
    free(r.segments.ids);
    return st;
}

/* A new directory must survive a crash as its segments do: sync the one above it. */
static kl_status make_directory(const char *dir, struct kl_err *err)
{
    char *parent = NULL;

    if (kl_file_calls->make_dir(dir, 0777) != 0) {
        if (errno == EEXIST) return KL_OK;
        return kl_fail_errno(err, "create directory");
    }
    kl_status st = kl_alloc_array(&parent, strlen(dir) + sizeof "/..", 1, err);
    if (st != KL_OK) return st;
    (void)snprintf(parent, strlen(dir) + sizeof "/..", "%s/..", dir);
    const int fd = kl_file_open_at(AT_FDCWD, parent, O_RDONLY | O_DIRECTORY);
    if (fd >= 0) {
        (void)kl_file_sync(fd); /* where it fails, the segments' own sync will tell */
        (void)kl_file_calls->close(fd);
    }
    free(parent);
    return KL_OK;
}

/* Damage is not all there is. */
static kl_status check_usable(const struct kl_store *store, struct kl_err *err)
{
    struct kl_store_damage damage;
    uint64_t records = 0;

    kl_store_get_damage(store, &damage);
    for (size_t i = 0; i < store->segments.count; ++i) {
        for (int l = 0; l < KL_CACHE_LEVELS; ++l)
            records += store->segments.items[i].levels[l].record_count;
    }
    if (records > 0 || damage.blocks == 0) return KL_OK;
    return kl_fail(err, KL_ERR_CORRUPT, "nothing is left whole; first: %s", store->complaint);
}

kl_status kl_store_open(const char *dir, enum kl_store_mode mode, const struct kl_store_key *key,
                        struct kl_store **out, struct kl_err *err)
{
    struct kl_store *store = NULL;
    kl_status st = KL_OK;

    if (mode != KL_STORE_READ && key == NULL) {
        return kl_fail(err, KL_ERR_USAGE, "%s: no key to write with", dir);
    }
    if (mode != KL_STORE_READ) {
        st = make_directory(dir, err);
        if (st != KL_OK) return kl_wrap(err, "%s", dir);
    }
    st = kl_alloc_array(&store, 1, sizeof *store, err);
    if (st != KL_OK) return st;
    store->mode = mode;
    store->has_key = key != NULL;
    if (key != NULL) store->key = *key;
    store->dir_fd = kl_file_open_at(AT_FDCWD, dir, O_RDONLY | O_DIRECTORY);
    if (store->dir_fd < 0) st = kl_fail_errno(err, "open the cache");
    if (st == KL_OK && mode == KL_STORE_REBUILD) st = remove_all(store->dir_fd, err);
    if (st == KL_OK) st = store_load(store, err);
    if (st == KL_OK) st = check_usable(store, err);
    if (st != KL_OK) {
        kl_store_close(store);
        return kl_wrap(err, "%s", dir);
    }
    *out = store;
    return KL_OK;
}

static bool are_equal(const struct id_list *a, const struct id_list *b)
{
    if (a->count != b->count) return false;
    for (size_t i = 0; i < a->count; ++i) {
        if (!segment_id_is_equal(&a->ids[i], &b->ids[i])) return false;
    }
    return true;
}

kl_status kl_store_refresh(struct kl_store *store, bool *changed, struct kl_err *err)
{
    struct id_list now = {0};
    kl_status st = store_list(store->dir_fd, &now, err);

    *changed = false;
    if (st == KL_OK && !are_equal(&now, &store->listed)) {
        st = store_load(store, err);
        *changed = st == KL_OK;
    }
    free(now.ids);
    return st;
}

void kl_store_close(struct kl_store *store)
{
    if (store == NULL) return;
    segment_list_fini(&store->segments);
    if (store->dir_fd >= 0) (void)kl_file_calls->close(store->dir_fd);
    free(store->leftovers.ids);
    free(store->listed.ids);
    free(store->rejects);
    free(store->parts);
    free(store);
}

/* ---- asking ---- */

size_t kl_store_segment_count(const struct kl_store *store)
{
    return store->segments.count;
}

static uint32_t birth_of(uint64_t generation)
{
    return generation < UINT32_MAX ? (uint32_t)generation : UINT32_MAX;
}

void kl_store_segment_get(const struct kl_store *store, size_t i,
                          struct kl_store_segment_info *info,
                          struct kl_level_arrays levels[KL_CACHE_LEVELS])
{
    const struct segment *segment = &store->segments.items[i];

    if (info != NULL) {
        memset(info, 0, sizeof *info);
        memcpy(info->name, segment->name, sizeof info->name);
        memcpy(info->program, segment->program, sizeof info->program);
        info->bytes = segment->size;
        info->generation = segment->id.generation;
        info->is_base = segment->id.kind == SEGMENT_BASE;
        info->damage = segment->damage;
        memcpy(info->births, segment->births, sizeof info->births);
        info->born = birth_of(segment->id.generation);
        for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
            info->records[l] = segment->levels[l].record_count;
            info->has_octree[l] = segment->levels[l].octree.record_count > 0;
        }
    }
    if (levels != NULL) memcpy(levels, segment->levels, sizeof segment->levels);
}

void kl_store_key_get(const struct kl_store *store, struct kl_store_key *key)
{
    *key = store->key;
}

const kl_part *kl_store_parts_get(const struct kl_store *store, uint32_t *count)
{
    for (size_t i = 0; i < store->segments.count; ++i) {
        *count = store->segments.items[i].part_count;
        if (*count > 0) return store->segments.items[i].parts;
    }
    *count = 0;
    return NULL;
}

kl_status kl_store_parts_set(struct kl_store *store, const kl_part *parts, uint32_t count,
                             struct kl_err *err)
{
    kl_part *copy = NULL;
    kl_status st = kl_alloc_array(&copy, count, sizeof *copy, err);

    if (st != KL_OK) return st;
    if (count > 0) memcpy(copy, parts, count * sizeof *copy);
    free(store->parts);
    store->parts = copy;
    store->part_count = count;
    return KL_OK;
}

uint64_t kl_store_generation(const struct kl_store *store)
{
    return store->generation;
}

uint64_t kl_store_bytes(const struct kl_store *store)
{
    uint64_t bytes = 0;

    for (size_t i = 0; i < store->segments.count; ++i)
        bytes += store->segments.items[i].size;
    return bytes;
}

bool segment_is_damaged(const struct segment *segment)
{
    const struct kl_store_damage *d = &segment->damage;

    return d->headers + d->blocks + d->octrees > 0;
}

size_t kl_store_damaged(const struct kl_store *store, const char **first)
{
    size_t damaged = store->reject_count;

    for (size_t i = 0; i < store->segments.count; ++i)
        damaged += segment_is_damaged(&store->segments.items[i]);
    if (first != NULL) *first = damaged > 0 ? store->complaint : NULL;
    return damaged;
}

void kl_store_get_damage(const struct kl_store *store, struct kl_store_damage *out)
{
    memset(out, 0, sizeof *out);
    for (size_t i = 0; i < store->reject_count; ++i) {
        if (store->rejects[i].why == REJECT_FOREIGN) {
            ++out->foreign;
        } else {
            ++out->segments;
        }
    }
    for (size_t i = 0; i < store->segments.count; ++i) {
        const struct kl_store_damage *d = &store->segments.items[i].damage;
        out->headers += d->headers;
        out->blocks += d->blocks;
        out->octrees += d->octrees;
        for (int l = 0; l < KL_CACHE_LEVELS; ++l)
            out->records[l] += d->records[l];
    }
}
