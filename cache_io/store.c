/* Invariants: docs/cache_format.md section 1. This file keeps 5 and 6; format_impl.h's functions
 * the others. */
#include "cache_io/store.h"

#include "cache_io/format_impl.h"
#include "src/base/memory.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { LISTING_ATTEMPTS = 10 };

struct kl_store {
    int dir_fd;
    enum kl_store_mode mode;
    bool broken; /* a write failed: what the directory holds is not what we believe */
    struct kl_store_key key;
    uint64_t generation;
    size_t count, capacity;
    struct segment *segments; /* in reading order */
    /* Superseded segments that are still there: the next base removes them too. */
    size_t leftover_count, leftover_capacity;
    struct segment_id *leftovers;
    kl_part *parts; /* to be written */
    uint32_t part_count;
    size_t damaged;
    char complaint[512];
};

/* ---- listing ---- */

struct listing {
    size_t count, capacity;
    struct segment_id *ids;
};

static int compare_ids(const void *a, const void *b)
{
    const struct segment_id *x = a;
    const struct segment_id *y = b;

    if (x->generation != y->generation) return x->generation < y->generation ? -1 : 1;
    if (x->kind != y->kind) return x->kind < y->kind ? -1 : 1;
    return (x->hash > y->hash) - (x->hash < y->hash);
}

/* A stream of its own over an open directory, which stays the caller's: closedir(*out). */
static kl_status open_stream(int dir_fd, DIR **out, struct kl_err *err)
{
    const int fd = openat(dir_fd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);

    if (fd < 0) return kl_fail_errno(err, "list");
    *out = fdopendir(fd);
    if (*out != NULL) return KL_OK;
    const kl_status st = kl_fail_errno(err, "list");
    close(fd);
    return st;
}

/* Sorted, so that what is opened first does not depend on the file system. */
static kl_status list_segments(int dir_fd, struct listing *out, struct kl_err *err)
{
    DIR *dir = NULL;
    kl_status st = open_stream(dir_fd, &dir, err);

    out->count = 0;
    if (st != KL_OK) return st;
    for (;;) {
        struct segment_id id;
        errno = 0;
        const struct dirent *entry = readdir(dir); /* NOLINT(concurrency-mt-unsafe): own stream */
        if (entry == NULL) break;
        if (!segment_id_parse(entry->d_name, &id)) continue;
        st = kl_grow_array(&out->ids, &out->capacity, out->count + 1, sizeof *out->ids, err);
        if (st != KL_OK) break;
        out->ids[out->count++] = id;
    }
    if (st == KL_OK && errno != 0) st = kl_fail_errno(err, "list");
    (void)closedir(dir);
    if (out->count > 1) qsort(out->ids, out->count, sizeof *out->ids, compare_ids);
    return st;
}

/* ---- opening ---- */

static void drop_segments(struct kl_store *store)
{
    for (size_t i = 0; i < store->count; ++i)
        segment_close(&store->segments[i]);
    store->count = 0;
    store->leftover_count = 0;
    store->damaged = 0;
    store->complaint[0] = '\0';
}

static void complain(struct kl_store *store, const struct kl_err *err)
{
    if (store->damaged++ == 0) {
        (void)!snprintf(store->complaint, sizeof store->complaint, "%s", err->msg);
    }
}

/* What a listing contained besides sound segments. */
struct findings {
    bool gone;             /* a file vanished: list again */
    bool other_major;      /* some segment has another major version */
    struct kl_err version; /* its message */
};

static kl_status open_one(struct kl_store *store, const struct segment_id *id,
                          struct findings *found, struct kl_err *err)
{
    char name[SEGMENT_NAME_SIZE];
    kl_status st = kl_grow_array(&store->segments, &store->capacity, store->count + 1,
                                 sizeof *store->segments, err);

    if (st != KL_OK) return st;
    segment_id_format(id, name);
    st = segment_open(store->dir_fd, name, &store->segments[store->count], err);
    if (st == KL_OK) {
        ++store->count;
        return KL_OK;
    }
    if (st == KL_ERR_IO && err->os_error == ENOENT) {
        found->gone = true;
        return KL_OK;
    }
    if (st == KL_ERR_CORRUPT || st == KL_ERR_VERSION) {
        complain(store, err);
        if (st == KL_ERR_VERSION && !found->other_major) {
            found->other_major = true;
            found->version = *err;
        }
        return KL_OK;
    }
    return st;
}

static kl_status check_key(const struct kl_store_key *have, const struct kl_store_key *want,
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

static bool key_is_equal(const struct kl_store_key *a, const struct kl_store_key *b)
{
    struct kl_err ignored;
    return check_key(a, b, "", &ignored) == KL_OK;
}

static kl_status add_leftover(struct kl_store *store, const struct segment_id *id,
                              struct kl_err *err)
{
    kl_status st = kl_grow_array(&store->leftovers, &store->leftover_capacity,
                                 store->leftover_count + 1, sizeof *store->leftovers, err);
    if (st == KL_OK) store->leftovers[store->leftover_count++] = *id;
    return st;
}

/* Close the segments of other keys: all of them if `any`, else those that differ in the scene only.
 */
static kl_status leave_out_others(struct kl_store *store, bool any, struct kl_err *err)
{
    size_t kept = 0;
    kl_status st = KL_OK;

    for (size_t i = 0; i < store->count; ++i) {
        struct segment *segment = &store->segments[i];
        struct kl_store_key key = segment->key;
        if (!any) memcpy(key.scene, store->key.scene, sizeof key.scene);
        const bool another = !key_is_equal(&segment->key, &store->key);
        if (st == KL_OK && another && (any || key_is_equal(&key, &store->key))) {
            if (segment->id.generation > store->generation) {
                store->generation = segment->id.generation;
            }
            st = add_leftover(store, &segment->id, err);
            segment_close(segment);
        } else {
            store->segments[kept++] = *segment;
        }
    }
    store->count = kept;
    return st;
}

static bool has_key(const struct kl_store *store, const struct kl_store_key *key)
{
    for (size_t i = 0; i < store->count; ++i) {
        if (key_is_equal(&store->segments[i].key, key)) return true;
    }
    return false;
}

/* Decide for one key among the segments that are open. */
static kl_status settle_key(struct kl_store *store, const struct kl_store_key *key,
                            struct kl_err *err)
{
    kl_status st = KL_OK;

    /* Sorted by generation: the last one is the newest. */
    store->key = key != NULL ? *key : store->segments[store->count - 1].key;
    if (key == NULL || store->mode == KL_STORE_REVISE) {
        st = leave_out_others(store, true, err);
    } else if (has_key(store, key)) {
        st = leave_out_others(store, false, err);
    }
    for (size_t i = 0; i < store->count && st == KL_OK; ++i) {
        st = check_key(&store->segments[i].key, &store->key, store->segments[i].name, err);
    }
    return st;
}

static bool is_superseded_by(const struct segment *base, const struct segment_id *id)
{
    for (size_t i = 0; i < base->superseded_count; ++i) {
        const struct segment_id old = segment_superseded_get(base, i);
        if (segment_id_is_equal(&old, id)) return true;
    }
    return false;
}

static bool is_subset(const struct segment *small, const struct segment *large)
{
    for (size_t i = 0; i < small->superseded_count; ++i) {
        const struct segment_id old = segment_superseded_get(small, i);
        if (!is_superseded_by(large, &old)) return false;
    }
    return true;
}

/* Section 5 of the format: does segment i stay out of use, given the leading base? */
static bool is_ignored(const struct kl_store *store, size_t i, const struct segment *leader)
{
    const struct segment *segment = &store->segments[i];

    for (size_t k = 0; k < store->count; ++k) {
        if (k != i && is_superseded_by(&store->segments[k], &segment->id)) return true;
    }
    return leader != NULL && segment != leader && segment->id.kind == SEGMENT_BASE &&
           segment->superseded_count > 0 && is_subset(segment, leader);
}

/* The base of the largest generation (then name) that no other base supersedes; NULL: none. */
static const struct segment *find_leader(const struct kl_store *store)
{
    const struct segment *leader = NULL;

    for (size_t i = 0; i < store->count; ++i) { /* sorted by generation, then name */
        const struct segment *segment = &store->segments[i];
        if (segment->id.kind == SEGMENT_BASE && !is_ignored(store, i, NULL)) leader = segment;
    }
    return leader;
}

/* Reading order; superseded segments are closed and remembered. */
static kl_status arrange(struct kl_store *store, struct kl_err *err)
{
    const struct segment *leader = find_leader(store);
    bool *ignored = NULL;
    struct segment *sorted = NULL;
    size_t kept = 0;
    kl_status st = kl_alloc_array(&ignored, store->count, sizeof *ignored, err);

    if (st == KL_OK) st = kl_alloc_array(&sorted, store->capacity, sizeof *sorted, err);
    if (st == KL_OK) {
        st = kl_grow_array(&store->leftovers, &store->leftover_capacity,
                           store->leftover_count + store->count, sizeof *store->leftovers, err);
    }
    if (st != KL_OK) {
        free(ignored);
        free(sorted);
        return st;
    }
    for (size_t i = 0; i < store->count; ++i)
        ignored[i] = is_ignored(store, i, leader);
    if (leader != NULL) sorted[kept++] = *leader;
    for (size_t i = 0; i < store->count; ++i) {
        struct segment *segment = &store->segments[i];
        if (segment->id.generation > store->generation) store->generation = segment->id.generation;
        if (segment == leader) continue;
        if (ignored[i]) {
            store->leftovers[store->leftover_count++] = segment->id;
            segment_close(segment);
        } else {
            sorted[kept++] = *segment;
        }
    }
    free(ignored);
    free(store->segments);
    store->segments = sorted;
    store->count = kept;
    return KL_OK;
}

/* Opens what is listed. found->gone: do it again. */
static kl_status open_listed(struct kl_store *store, const struct listing *listing,
                             struct findings *found, struct kl_err *err)
{
    for (size_t i = 0; i < listing->count && !found->gone; ++i) {
        kl_status st = open_one(store, &listing->ids[i], found, err);
        if (st != KL_OK) return st;
    }
    return KL_OK;
}

static kl_status load(struct kl_store *store, const struct kl_store_key *key, struct kl_err *err)
{
    struct listing listing = {0};
    struct findings found;
    kl_status st = KL_OK;

    for (int attempt = 0;; ++attempt) {
        memset(&found, 0, sizeof found);
        drop_segments(store);
        st = list_segments(store->dir_fd, &listing, err);
        if (st == KL_OK) st = open_listed(store, &listing, &found, err);
        if (st != KL_OK) goto cleanup;
        if (!found.gone) break;
        if (attempt + 1 == LISTING_ATTEMPTS) {
            st = kl_fail(err, KL_ERR_IO, "segments keep vanishing while they are opened");
            goto cleanup;
        }
    }
    if (store->count == 0 && found.other_major) {
        *err = found.version;
        st = KL_ERR_VERSION;
    } else if (store->count == 0 && store->damaged > 0) {
        st = kl_fail(err, KL_ERR_CORRUPT, "all %zu segments are damaged; first: %s", store->damaged,
                     store->complaint);
    } else if (store->count == 0 && key == NULL) {
        st = kl_fail(err, KL_ERR_INPUT, "no cache segments in this directory");
    }
    if (st != KL_OK) goto cleanup;
    st = settle_key(store, key, err);
    if (st == KL_OK && store->count > 0) st = arrange(store, err);

cleanup:
    free(listing.ids);
    return st;
}

/* `.b-....kls.tmp-PID` of writers that were killed. */
static bool is_our_temp(const char *name)
{
    return name[0] == '.' && (name[1] == 'b' || name[1] == 'd') && name[2] == '-' &&
           strstr(name, ".kls.tmp-") != NULL;
}

static kl_status remove_all(int dir_fd, struct kl_err *err)
{
    DIR *dir = NULL;
    kl_status st = open_stream(dir_fd, &dir, err);

    if (st != KL_OK) return st;
    for (;;) {
        struct segment_id id;
        const struct dirent *entry = readdir(dir); /* NOLINT(concurrency-mt-unsafe): own stream */
        if (entry == NULL) break;
        if (!segment_id_parse(entry->d_name, &id) && !is_our_temp(entry->d_name)) continue;
        if (unlinkat(dir_fd, entry->d_name, 0) != 0 && errno != ENOENT) {
            st = kl_fail_errno(err, "remove %s", entry->d_name);
            break;
        }
    }
    (void)closedir(dir);
    return st;
}

/* A new directory must survive a crash as its segments do: sync the one above it. */
static kl_status make_directory(const char *dir, struct kl_err *err)
{
    char *parent = NULL;

    if (mkdir(dir, 0777) != 0) {
        if (errno == EEXIST) return KL_OK;
        return kl_fail_errno(err, "create directory");
    }
    kl_status st = kl_alloc_array(&parent, strlen(dir) + sizeof "/..", 1, err);
    if (st != KL_OK) return st;
    (void)snprintf(parent, strlen(dir) + sizeof "/..", "%s/..", dir);
    const int fd = open(parent, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd >= 0) {
        (void)fsync(fd); /* where it fails, the segments' own sync will tell */
        close(fd);
    }
    free(parent);
    return KL_OK;
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
    store->dir_fd = open(dir, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (store->dir_fd < 0) st = kl_fail_errno(err, "open the cache");
    if (st == KL_OK && mode == KL_STORE_REBUILD) st = remove_all(store->dir_fd, err);
    if (st == KL_OK) st = load(store, key, err);
    if (st != KL_OK) {
        kl_store_close(store);
        return kl_wrap(err, "%s", dir);
    }
    *out = store;
    return KL_OK;
}

void kl_store_close(struct kl_store *store)
{
    if (store == NULL) return;
    drop_segments(store);
    if (store->dir_fd >= 0) close(store->dir_fd);
    free(store->segments);
    free(store->leftovers);
    free(store->parts);
    free(store);
}

/* ---- asking ---- */

size_t kl_store_segment_count(const struct kl_store *store)
{
    return store->count;
}

void kl_store_segment_get(const struct kl_store *store, size_t i,
                          struct kl_store_segment_info *info,
                          struct kl_level_arrays levels[KL_CACHE_LEVELS])
{
    const struct segment *segment = &store->segments[i];

    if (info != NULL) {
        memset(info, 0, sizeof *info);
        memcpy(info->name, segment->name, sizeof info->name);
        info->bytes = segment->size;
        info->generation = segment->id.generation;
        info->is_base = segment->id.kind == SEGMENT_BASE;
        for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
            info->records[l] = segment->levels[l].record_count;
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
    for (size_t i = 0; i < store->count; ++i) {
        *count = store->segments[i].part_count;
        if (*count > 0) return store->segments[i].parts;
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

    for (size_t i = 0; i < store->count; ++i)
        bytes += store->segments[i].size;
    return bytes;
}

size_t kl_store_damaged(const struct kl_store *store, const char **first)
{
    if (first != NULL) *first = store->damaged > 0 ? store->complaint : NULL;
    return store->damaged;
}

/* ---- publishing ---- */

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
        struct kl_level_arrays level = levels[l];
        if (!with_octree) level.octree.record_count = 0;
        if (level.record_count == 0 && level.octree.record_count == 0) continue;
        kl_status st = level_validate(&level, err);
        if (st == KL_ERR_CORRUPT) st = err->status = KL_ERR_USAGE;
        if (st != KL_OK) return kl_wrap(err, "cache level %u", l);
    }
    return KL_OK;
}

/* Write, then read back: the store's list holds only what any reader would accept. */
static kl_status publish(struct kl_store *store, const struct segment_plan *plan,
                         struct segment *out, struct kl_err *err)
{
    struct segment_id id;
    char name[SEGMENT_NAME_SIZE];
    kl_status st = segment_write(store->dir_fd, plan, &id, err);

    if (st == KL_OK) {
        segment_id_format(&id, name);
        st = segment_open(store->dir_fd, name, out, err);
    }
    if (st == KL_OK) {
        store->generation = plan->generation;
    } else {
        store->broken = true;
    }
    return st;
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
    st = kl_grow_array(&store->segments, &store->capacity, store->count + 1,
                       sizeof *store->segments, err);
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
    st = publish(store, &plan, &store->segments[store->count], err);
    if (st == KL_OK) ++store->count;
    return st;
}

/* Everything that a new base replaces: what is open, what it had replaced and still lies there. */
static kl_status collect_superseded(const struct kl_store *store, struct segment_id **out,
                                    size_t *count, struct kl_err *err)
{
    kl_status st = kl_alloc_array(out, store->count + store->leftover_count, sizeof **out, err);

    if (st != KL_OK) return st;
    for (size_t i = 0; i < store->count; ++i)
        (*out)[i] = store->segments[i].id;
    if (store->leftover_count > 0) {
        memcpy(*out + store->count, store->leftovers, store->leftover_count * sizeof **out);
    }
    *count = store->count + store->leftover_count;
    qsort(*out, *count, sizeof **out, compare_ids);
    return KL_OK;
}

kl_status kl_store_publish_base(struct kl_store *store,
                                const struct kl_level_arrays levels[KL_CACHE_LEVELS],
                                struct kl_err *err)
{
    struct segment_id *old = NULL;
    struct segment *list = NULL;
    size_t old_count = 0;
    kl_status st = check_writable(store, err);

    if (st == KL_OK) st = check_levels(levels, true, err);
    if (st == KL_OK) st = collect_superseded(store, &old, &old_count, err);
    if (st == KL_OK) st = kl_alloc_array(&list, 16, sizeof *list, err);
    if (st != KL_OK) goto cleanup;
    uint32_t part_count = store->part_count;
    const kl_part *parts = part_count > 0 ? store->parts : kl_store_parts_get(store, &part_count);
    const struct segment_plan plan = {
        .kind = SEGMENT_BASE,
        .generation = store->generation + 1,
        .key = &store->key,
        .levels = levels,
        .superseded_count = old_count,
        .superseded = old,
        .parts = parts,
        .part_count = part_count,
    };
    st = publish(store, &plan, &list[0], err);
    if (st != KL_OK) goto cleanup;

    /* The base is durable. What cannot be removed now is ignored by readers and tried again. */
    for (size_t i = 0; i < store->count; ++i)
        segment_close(&store->segments[i]);
    free(store->segments);
    store->segments = list;
    store->count = 1;
    store->capacity = 16;
    list = NULL;
    store->leftover_count = 0;
    free(store->leftovers);
    store->leftovers = old;
    store->leftover_capacity = old_count;
    for (size_t i = 0; i < old_count; ++i) {
        char name[SEGMENT_NAME_SIZE];
        segment_id_format(&old[i], name);
        if (unlinkat(store->dir_fd, name, 0) != 0 && errno != ENOENT) {
            old[store->leftover_count++] = old[i];
        }
    }
    old = NULL;
    (void)fsync(store->dir_fd);

cleanup:
    free(old);
    free(list);
    return st;
}
