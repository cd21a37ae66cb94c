/* From the files of a directory to the segments in use. */
#include "cache_io/store_impl.h"
#include "src/base/memory.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LISTING_ATTEMPTS = 100 };

/* A load under way. Segments of `fresh` that the store had open already belong to the store until
 * the load has succeeded. */
struct load {
    const struct kl_store *store;
    struct kl_store_key key; /* that was decided for */
    uint64_t generation;     /* the largest */
    struct id_list listed, again;
    struct id_list left;       /* segments of other keys that a base may supersede */
    struct segment_list fresh; /* sorted by id once all are open */
    size_t reject_count, reject_capacity;
    struct store_reject *rejects;
    bool gone;             /* a file vanished: list again */
    bool other_major;      /* some segment has another major version */
    struct kl_err version; /* its message */
};

static const struct segment *find_open(const struct segment_list *list, const struct segment_id *id)
{
    for (size_t i = 0; i < list->count; ++i) {
        if (segment_id_is_equal(&list->items[i].id, id)) return &list->items[i];
    }
    return NULL;
}

static kl_status reject(struct load *load, const struct segment_id *id, enum reject_why why,
                        const char *message, struct kl_err *err)
{
    kl_status st = kl_grow_array(&load->rejects, &load->reject_capacity, load->reject_count + 1,
                                 sizeof *load->rejects, err);
    if (st != KL_OK) return st;
    struct store_reject *r = &load->rejects[load->reject_count++];
    r->id = *id;
    r->why = why;
    (void)!snprintf(r->message, sizeof r->message, "%s", message);
    return KL_OK;
}

static kl_status open_one(struct load *load, const struct segment_id *id, struct kl_err *err)
{
    const struct segment *known = find_open(&load->store->segments, id);
    char name[SEGMENT_NAME_SIZE];
    kl_status st = KL_OK;

    if (find_open(&load->fresh, id) != NULL) return KL_OK; /* by an earlier attempt */
    st = kl_grow_array(&load->fresh.items, &load->fresh.capacity, load->fresh.count + 1,
                       sizeof *load->fresh.items, err);
    if (st != KL_OK) return st;
    struct segment *segment = &load->fresh.items[load->fresh.count];
    if (known != NULL) {
        *segment = *known;
        ++load->fresh.count;
        return KL_OK;
    }
    segment_id_format(id, name);
    st = segment_open(load->store->dir_fd, name, segment, err);
    if (st == KL_OK) {
        ++load->fresh.count;
        return KL_OK;
    }
    if (st == KL_ERR_NO_MEMORY) return st;
    if (st == KL_ERR_IO && err->os_error == ENOENT) {
        load->gone = true;
        return KL_OK;
    }
    if (st == KL_ERR_VERSION && !load->other_major) {
        load->other_major = true;
        load->version = *err;
    }
    enum reject_why why = REJECT_DAMAGED;
    if (st == KL_ERR_VERSION) why = REJECT_VERSION;
    if (st == KL_ERR_IO) why = REJECT_UNREAD;
    return reject(load, id, why, err->msg, err);
}

/* Does `now` name a base that `before` does not? Both sorted. */
static bool has_new_base(const struct id_list *now, const struct id_list *before)
{
    for (size_t i = 0; i < now->count; ++i) {
        if (now->ids[i].kind == SEGMENT_BASE &&
            (before->count == 0 || bsearch(&now->ids[i], before->ids, before->count,
                                           sizeof *before->ids, segment_id_compare) == NULL)) {
            return true;
        }
    }
    return false;
}

/* One pass. A directory is not read in one step: a base that came, and took the place of others,
 * while it was read may be missed together with them; the second listing shows it. */
static kl_status open_listed(struct load *load, bool *done, struct kl_err *err)
{
    kl_status st = store_list(load->store->dir_fd, &load->listed, err);

    load->gone = false;
    load->reject_count = 0;
    for (size_t i = 0; i < load->listed.count && st == KL_OK && !load->gone; ++i) {
        st = open_one(load, &load->listed.ids[i], err);
    }
    if (st != KL_OK || load->gone) return st;
    st = store_list(load->store->dir_fd, &load->again, err);
    *done = st == KL_OK && !has_new_base(&load->again, &load->listed);
    return st;
}

static bool is_borrowed(const struct load *load, const struct segment *segment)
{
    const struct segment *known = find_open(&load->store->segments, &segment->id);

    return known != NULL && known->data == segment->data;
}

static kl_status nothing_there(const struct load *load, struct kl_err *err)
{
    if (load->other_major) {
        *err = load->version;
        return KL_ERR_VERSION;
    }
    if (load->reject_count > 0) {
        return kl_fail(err, KL_ERR_CORRUPT, "all %zu segments are damaged; first: %s",
                       load->reject_count, load->rejects[0].message);
    }
    if (!load->store->has_key) {
        return kl_fail(err, KL_ERR_INPUT, "no cache segments in this directory");
    }
    return KL_OK;
}

static bool key_is(const struct segment *segment, const struct kl_store_key *key)
{
    struct kl_err ignored;

    return store_check_key(&segment->key, key, "", &ignored) == KL_OK;
}

/* Leave out a segment of another key: what a revision, or another edition of the scene, left behind
 * is superseded by the next base, a stranger never. */
static kl_status leave_out(struct load *load, struct segment *segment, struct kl_err *err)
{
    const struct kl_store *store = load->store;
    struct kl_store_key key = segment->key;
    struct kl_err other;
    kl_status st = KL_OK;

    memcpy(key.scene, load->key.scene, sizeof key.scene);
    if (!store->has_key || store->mode == KL_STORE_REVISE ||
        store_check_key(&key, &load->key, "", &other) == KL_OK) {
        st = kl_grow_array(&load->left.ids, &load->left.capacity, load->left.count + 1,
                           sizeof *load->left.ids, err);
        if (st == KL_OK) load->left.ids[load->left.count++] = segment->id;
    } else {
        (void)!store_check_key(&segment->key, &load->key, segment->name, &other);
        st = reject(load, &segment->id, REJECT_FOREIGN, other.msg, err);
    }
    if (!is_borrowed(load, segment)) segment_close(segment);
    return st;
}

/* Decide for one key among the segments that are open, sorted by generation. */
static kl_status settle_key(struct load *load, struct kl_err *err)
{
    const struct kl_store *store = load->store;
    struct segment_list *list = &load->fresh;
    size_t matching = 0;
    size_t kept = 0;
    kl_status st = KL_OK;

    if (list->count == 0) return KL_OK;
    load->key = store->has_key ? store->key : list->items[list->count - 1].key;
    for (size_t i = 0; i < list->count; ++i)
        matching += key_is(&list->items[i], &load->key);
    if (matching == 0 && store->mode != KL_STORE_REVISE) {
        return store_check_key(&list->items[0].key, &load->key, list->items[0].name, err);
    }
    for (size_t i = 0; i < list->count; ++i) {
        struct segment *segment = &list->items[i];
        if (st == KL_OK && !key_is(segment, &load->key)) {
            st = leave_out(load, segment, err);
        } else {
            list->items[kept++] = *segment;
        }
    }
    list->count = kept;
    return st;
}

static void note_complaint(struct kl_store *store)
{
    store->complaint[0] = '\0';
    if (store->reject_count > 0) {
        (void)!snprintf(store->complaint, sizeof store->complaint, "%s", store->rejects[0].message);
        return;
    }
    for (size_t i = 0; i < store->segments.count; ++i) {
        const struct segment *s = &store->segments.items[i];
        if (!segment_is_damaged(s)) continue;
        (void)!snprintf(store->complaint, sizeof store->complaint, "%s: %llu blocks damaged",
                        s->name, (unsigned long long)s->damage.blocks);
        return;
    }
}

/* Everything is open: from here on nothing fails but memory. */
static kl_status take_over(struct kl_store *store, struct load *load, struct kl_err *err)
{
    if (load->generation > store->generation) store->generation = load->generation;
    if (load->listed.count > 0 && !store->has_key) store->key = load->key;
    store->has_key = true;
    /* What the store had open and does not list any more is closed; the rest has moved. */
    for (size_t i = 0; i < store->segments.count; ++i) {
        struct segment *old = &store->segments.items[i];
        const struct segment *now = find_open(&load->fresh, &old->id);
        if (now == NULL || now->data != old->data) segment_close(old);
    }
    free(store->segments.items);
    store->segments = load->fresh;
    load->fresh = (struct segment_list){0};
    free(store->listed.ids);
    store->listed = load->listed;
    load->listed = (struct id_list){0};
    free(store->leftovers.ids);
    store->leftovers = load->left;
    load->left = (struct id_list){0};
    free(store->rejects);
    store->rejects = load->rejects;
    store->reject_count = load->reject_count;
    store->reject_capacity = load->reject_capacity;
    load->rejects = NULL;
    kl_status st = store_arrange(&store->segments, &store->leftovers, err);
    note_complaint(store);
    return st;
}

static int compare_segments(const void *a, const void *b)
{
    const struct segment *x = a;
    const struct segment *y = b;

    return segment_id_compare(&x->id, &y->id);
}

kl_status store_load(struct kl_store *store, struct kl_err *err)
{
    struct load load = {.store = store};
    bool done = false;
    kl_status st = KL_OK;

    for (int attempt = 0; st == KL_OK && !done && attempt < LISTING_ATTEMPTS; ++attempt) {
        st = open_listed(&load, &done, err);
    }
    if (st == KL_OK && !done) {
        st = kl_fail(err, KL_ERR_IO, "segments keep vanishing while they are opened");
    }
    if (st != KL_OK) goto cleanup;
    if (load.fresh.count > 1) {
        qsort(load.fresh.items, load.fresh.count, sizeof *load.fresh.items, compare_segments);
    }
    for (size_t i = 0; i < load.fresh.count; ++i) {
        const uint64_t generation = load.fresh.items[i].id.generation;
        if (generation > load.generation) load.generation = generation;
    }
    if (load.fresh.count == 0) st = nothing_there(&load, err);
    if (st == KL_OK) st = settle_key(&load, err);
    if (st == KL_OK) st = take_over(store, &load, err);

cleanup:
    for (size_t i = 0; i < load.fresh.count; ++i) {
        if (!is_borrowed(&load, &load.fresh.items[i])) segment_close(&load.fresh.items[i]);
    }
    free(load.fresh.items);
    free(load.left.ids);
    free(load.listed.ids);
    free(load.again.ids);
    free(load.rejects);
    return st;
}

void segment_list_fini(struct segment_list *list)
{
    for (size_t i = 0; i < list->count; ++i)
        segment_close(&list->items[i]);
    free(list->items);
    *list = (struct segment_list){0};
}
