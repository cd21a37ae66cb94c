#include "cache_io/records.h"

#include "cache_io/format_impl.h"
#include "kernels/sampling.h"
#include "src/base/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const float same_distance = 1e-3f; /* of the smaller radius */
static const float same_normal = 0.999f;  /* cosine */

struct level {
    size_t count, capacity[RECORD_ARRAYS], birth_capacity;
    unsigned char *arrays[RECORD_ARRAYS];
    uint32_t *births;
    struct kl_level_arrays view;
};

struct kl_records {
    struct level levels[KL_CACHE_LEVELS];
};

kl_status kl_records_create(struct kl_records **out, struct kl_err *err)
{
    return kl_alloc_array(out, 1, sizeof **out, err);
}

static void level_fini(struct level *l)
{
    for (size_t a = 0; a < RECORD_ARRAYS; ++a)
        free(l->arrays[a]);
    free(l->births);
    *l = (struct level){0};
}

void kl_records_destroy(struct kl_records *records)
{
    if (records == NULL) return;
    for (int l = 0; l < KL_CACHE_LEVELS; ++l)
        level_fini(&records->levels[l]);
    free(records);
}

static kl_status reserve(struct level *l, size_t count, struct kl_err *err)
{
    kl_status st = KL_OK;

    if (count > UINT32_MAX) {
        return kl_fail(err, KL_ERR_NO_MEMORY, "more than 2^32 records of one level");
    }
    for (size_t a = 0; a < RECORD_ARRAYS && st == KL_OK; ++a) {
        st = kl_grow_array(&l->arrays[a], &l->capacity[a], count, record_arrays[a].item, err);
    }
    if (st == KL_OK) {
        st = kl_grow_array(&l->births, &l->birth_capacity, count, sizeof *l->births, err);
    }
    return st;
}

static void set_view(struct level *l)
{
    l->view = (struct kl_level_arrays){.record_count = (kl_u32)l->count};
    for (size_t a = 0; a < RECORD_ARRAYS; ++a)
        record_array_set(&l->view, &record_arrays[a], l->arrays[a]);
}

kl_status kl_records_add(struct kl_records *records,
                         const struct kl_level_arrays levels[KL_CACHE_LEVELS],
                         const uint32_t *const births[KL_CACHE_LEVELS], uint32_t born,
                         struct kl_err *err)
{
    for (int i = 0; i < KL_CACHE_LEVELS; ++i) {
        struct level *l = &records->levels[i];
        const size_t n = levels[i].record_count;
        if (n == 0) continue;
        kl_status st = reserve(l, l->count + n, err);
        if (st != KL_OK) return st;
        for (size_t a = 0; a < RECORD_ARRAYS; ++a) {
            const size_t item = record_arrays[a].item;
            memcpy(l->arrays[a] + l->count * item, record_array_get(&levels[i], &record_arrays[a]),
                   n * item);
        }
        for (size_t k = 0; k < n; ++k)
            l->births[l->count + k] = births[i] != NULL ? births[i][k] : born;
        l->count += n;
        set_view(l);
    }
    return KL_OK;
}

kl_status kl_records_add_store(struct kl_records *records, const struct kl_store *store,
                               struct kl_err *err)
{
    kl_status st = KL_OK;

    for (size_t i = 0; i < kl_store_segment_count(store) && st == KL_OK; ++i) {
        struct kl_store_segment_info info;
        struct kl_level_arrays levels[KL_CACHE_LEVELS];
        kl_store_segment_get(store, i, &info, levels);
        st = kl_records_add(records, levels, info.births, info.born, err);
    }
    return st;
}

/* A record of a set, to be sorted. */
struct item {
    const struct level *level;
    uint32_t number;
};

static int compare_bytes(const struct item *x, const struct item *y)
{
    for (size_t a = 0; a < RECORD_ARRAYS; ++a) {
        const size_t item = record_arrays[a].item;
        const int order = memcmp(x->level->arrays[a] + x->number * item,
                                 y->level->arrays[a] + y->number * item, item);
        if (order != 0) return order;
    }
    const uint32_t p = x->level->births[x->number];
    const uint32_t q = y->level->births[y->number];
    return (p > q) - (p < q);
}

/* Best first. The error is a half that is not negative: its bits order as its value. */
static int compare_quality(const void *a, const void *b)
{
    const struct item *x = a;
    const struct item *y = b;
    const uint32_t p = x->level->view.cold[x->number].error_spacing & 0xffffu;
    const uint32_t q = y->level->view.cold[y->number].error_spacing & 0xffffu;

    return p != q ? (p > q) - (p < q) : compare_bytes(x, y);
}

static int compare_place(const void *a, const void *b)
{
    const struct item *x = a;
    const struct item *y = b;
    const float *p = x->level->view.hot[x->number].pos;
    const float *q = y->level->view.hot[y->number].pos;

    for (int k = 0; k < 3; ++k) {
        if (p[k] != q[k]) return p[k] < q[k] ? -1 : 1;
    }
    return compare_bytes(x, y);
}

/* Records that were kept, by cells of the largest distance at which two can be the same. */
struct grid {
    float edge;
    size_t mask;
    uint32_t *heads, *next; /* 1 + number of a record, 0: end */
};

static kl_status grid_init(struct grid *grid, const struct level *l, struct kl_err *err)
{
    size_t size = 16;
    float radius = 0.0f;

    for (size_t i = 0; i < l->count; ++i)
        radius = fmaxf(radius, l->view.hot[i].radius);
    while (size < 2 * l->count)
        size *= 2;
    *grid = (struct grid){.edge = fmaxf(same_distance * radius, 1e-30f), .mask = size - 1};
    kl_status st = kl_alloc_array(&grid->heads, size, sizeof *grid->heads, err);
    if (st == KL_OK) st = kl_alloc_array(&grid->next, l->count, sizeof *grid->next, err);
    return st;
}

static void grid_fini(struct grid *grid)
{
    free(grid->heads);
    free(grid->next);
}

static uint32_t *grid_cell(const struct grid *grid, const float pos[3], const int offset[3])
{
    uint64_t hash = 0;

    for (int k = 0; k < 3; ++k) {
        /* Beyond 2^53 cells all are one: more work, the same answer. */
        const double cell = floor((double)pos[k] / (double)grid->edge) + offset[k];
        const double bounded = fmin(fmax(cell, -9007199254740992.0), 9007199254740992.0);
        hash = (hash ^ (uint64_t)(int64_t)bounded) * 0x9e3779b97f4a7c15ull;
        hash ^= hash >> 29;
    }
    return &grid->heads[hash & grid->mask];
}

static bool is_same(const kl_record_hot *x, const kl_record_hot *y)
{
    const kl_vec3 d = kl_v3_sub(kl_v3_load(x->pos), kl_v3_load(y->pos));
    const float least = same_distance * fminf(x->radius, y->radius);

    return x->object == y->object && kl_dot(d, d) < least * least &&
           kl_dot(kl_oct_decode(x->normal), kl_oct_decode(y->normal)) > same_normal;
}

static bool has_same(const struct grid *grid, const struct level *l, uint32_t number)
{
    const kl_record_hot *hot = &l->view.hot[number];

    for (int c = 0; c < 27; ++c) {
        const int offset[3] = {c % 3 - 1, c / 3 % 3 - 1, c / 9 - 1};
        for (uint32_t i = *grid_cell(grid, hot->pos, offset); i != 0; i = grid->next[i - 1]) {
            if (is_same(hot, &l->view.hot[i - 1])) return true;
        }
    }
    return false;
}

/* Best first, each unless a better one stands for it: the same choice in whatever order they came.
 * Chosen items move to the front; returns how many. */
static size_t choose(struct grid *grid, const struct level *l, struct item *items)
{
    static const int here[3] = {0, 0, 0};
    size_t kept = 0;

    for (size_t i = 0; i < l->count; ++i) {
        const uint32_t number = items[i].number;
        if (has_same(grid, l, number)) continue;
        uint32_t *head = grid_cell(grid, l->view.hot[number].pos, here);
        grid->next[number] = *head;
        *head = number + 1;
        items[kept++] = items[i];
    }
    return kept;
}

static kl_status take_items(struct level *l, const struct item *items, size_t count,
                            struct kl_err *err)
{
    struct level out = {.count = count};
    kl_status st = reserve(&out, count, err);

    if (st != KL_OK) {
        level_fini(&out);
        return st;
    }
    for (size_t i = 0; i < count; ++i) {
        for (size_t a = 0; a < RECORD_ARRAYS; ++a) {
            const size_t item = record_arrays[a].item;
            memcpy(out.arrays[a] + i * item, l->arrays[a] + items[i].number * item, item);
        }
        out.births[i] = l->births[items[i].number];
    }
    set_view(&out);
    level_fini(l);
    *l = out;
    return KL_OK;
}

static kl_status merge_level(struct level *l, uint64_t *merged, struct kl_err *err)
{
    struct grid grid = {0};
    struct item *items = NULL;
    kl_status st = kl_alloc_array(&items, l->count, sizeof *items, err);

    if (st == KL_OK) st = grid_init(&grid, l, err);
    if (st == KL_OK) {
        for (size_t i = 0; i < l->count; ++i)
            items[i] = (struct item){l, (uint32_t)i};
        qsort(items, l->count, sizeof *items, compare_quality);
        const size_t kept = choose(&grid, l, items);
        qsort(items, kept, sizeof *items, compare_place);
        *merged += l->count - kept;
        st = take_items(l, items, kept, err);
    }
    grid_fini(&grid);
    free(items);
    return st;
}

kl_status kl_records_merge(struct kl_records *records, uint64_t *merged, struct kl_err *err)
{
    kl_status st = KL_OK;

    *merged = 0;
    for (int l = 0; l < KL_CACHE_LEVELS && st == KL_OK; ++l) {
        if (records->levels[l].count > 0) st = merge_level(&records->levels[l], merged, err);
    }
    return st;
}

void kl_records_select(struct kl_records *records, kl_records_keep_fn keep, void *context)
{
    for (uint32_t i = 0; i < KL_CACHE_LEVELS; ++i) {
        struct level *l = &records->levels[i];
        size_t kept = 0;
        for (size_t k = 0; k < l->count; ++k) {
            if (!keep(context, i, &l->view.hot[k], &l->view.cold[k], l->births[k])) continue;
            for (size_t a = 0; a < RECORD_ARRAYS; ++a) {
                const size_t item = record_arrays[a].item;
                memmove(l->arrays[a] + kept * item, l->arrays[a] + k * item, item);
            }
            l->births[kept++] = l->births[k];
        }
        l->count = kept;
        set_view(l);
    }
}

void kl_records_get(const struct kl_records *records,
                    struct kl_level_arrays levels[KL_CACHE_LEVELS])
{
    for (int l = 0; l < KL_CACHE_LEVELS; ++l)
        levels[l] = records->levels[l].view;
}

const uint32_t *kl_records_births(const struct kl_records *records, uint32_t level)
{
    return records->levels[level].births;
}
