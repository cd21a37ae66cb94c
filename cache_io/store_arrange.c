/* Which segments of a store are in use: section 5 of docs/cache_format.md. */
#include "cache_io/store_impl.h"
#include "src/base/memory.h"

#include <stdlib.h>

/* Superseded ids of all segments, with the segment that says so; sorted by id. */
struct verdict {
    struct segment_id id;
    size_t by;
};

struct verdicts {
    size_t count;
    struct verdict *items;
};

/* What a base supersedes stays in use where records of that base are lost. */
static size_t superseded_count_of(const struct segment *segment)
{
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        if (segment->damage.records[l] > 0) return 0;
    }
    return segment->superseded_count;
}

static kl_status collect_verdicts(const struct segment_list *list, struct verdicts *out,
                                  struct kl_err *err)
{
    size_t total = 0;

    for (size_t i = 0; i < list->count; ++i)
        total += superseded_count_of(&list->items[i]);
    kl_status st = kl_alloc_array(&out->items, total, sizeof *out->items, err);
    if (st != KL_OK) return st;
    for (size_t i = 0; i < list->count; ++i) {
        for (size_t k = 0; k < superseded_count_of(&list->items[i]); ++k) {
            out->items[out->count++] =
                (struct verdict){segment_superseded_get(&list->items[i], k), i};
        }
    }
    /* An id is the first member: compared as ids are. */
    if (total > 1) qsort(out->items, out->count, sizeof *out->items, segment_id_compare);
    return KL_OK;
}

static const struct verdict *find_verdicts(const struct verdicts *verdicts,
                                           const struct segment_id *id)
{
    const struct verdict *hit = verdicts->count == 0
                                    ? NULL
                                    : bsearch(id, verdicts->items, verdicts->count,
                                              sizeof *verdicts->items, segment_id_compare);

    while (hit != NULL && hit > verdicts->items && segment_id_compare(&hit[-1].id, id) == 0)
        --hit;
    return hit;
}

static bool is_superseded(const struct verdicts *verdicts, const struct segment_id *id)
{
    return find_verdicts(verdicts, id) != NULL;
}

static bool is_superseded_by(const struct verdicts *verdicts, size_t by,
                             const struct segment_id *id)
{
    const struct verdict *end = verdicts->items + verdicts->count;
    const struct verdict *c = find_verdicts(verdicts, id);

    for (; c != NULL && c < end && segment_id_compare(&c->id, id) == 0; ++c) {
        if (c->by == by) return true;
    }
    return false;
}

/* A base that came from nothing but what the leader has taken in as well. */
static bool is_redundant(const struct segment_list *list, const struct verdicts *verdicts, size_t i,
                         size_t leader)
{
    const struct segment *base = &list->items[i];

    if (i == leader || base->id.kind != SEGMENT_BASE || base->superseded_count == 0) return false;
    for (size_t k = 0; k < base->superseded_count; ++k) {
        const struct segment_id old = segment_superseded_get(base, k);
        if (!is_superseded_by(verdicts, leader, &old)) return false;
    }
    return true;
}

/* Items in reading order, those out of use closed and remembered. `list` is sorted by id. */
static void reorder(struct segment_list *list, const bool *ignored, size_t leader,
                    struct segment *sorted, struct id_list *leftovers)
{
    size_t kept = 0;

    if (leader < list->count) sorted[kept++] = list->items[leader];
    for (size_t i = 0; i < list->count; ++i) {
        if (ignored[i]) {
            leftovers->ids[leftovers->count++] = list->items[i].id;
            segment_close(&list->items[i]);
        } else if (i != leader) {
            sorted[kept++] = list->items[i];
        }
    }
    free(list->items);
    list->items = sorted;
    list->count = kept;
}

kl_status store_arrange(struct segment_list *segments, struct id_list *leftovers,
                        struct kl_err *err)
{
    struct verdicts verdicts = {0};
    bool *ignored = NULL;
    struct segment *sorted = NULL;
    size_t leader = SIZE_MAX;
    kl_status st = collect_verdicts(segments, &verdicts, err);

    if (st == KL_OK) st = kl_alloc_array(&ignored, segments->count, sizeof *ignored, err);
    if (st == KL_OK) {
        st = kl_grow_array(&leftovers->ids, &leftovers->capacity,
                           leftovers->count + segments->count, sizeof *leftovers->ids, err);
    }
    if (st == KL_OK) st = kl_alloc_array(&sorted, segments->capacity, sizeof *sorted, err);
    if (st != KL_OK) goto cleanup;
    for (size_t i = 0; i < segments->count; ++i) {
        const struct segment_id *id = &segments->items[i].id;
        ignored[i] = is_superseded(&verdicts, id);
        /* Sorted by generation, then name: the last one leads. */
        if (id->kind == SEGMENT_BASE && !ignored[i]) leader = i;
    }
    for (size_t i = 0; i < segments->count && leader != SIZE_MAX; ++i) {
        ignored[i] = ignored[i] || is_redundant(segments, &verdicts, i, leader);
    }
    reorder(segments, ignored, leader, sorted, leftovers);
    sorted = NULL;

cleanup:
    free(verdicts.items);
    free(ignored);
    free(sorted);
    return st;
}
