#include "src/cache/cache.h"

#include "src/base/memory.h"
#include "src/cache/clamp.h"
#include "src/cache/octree.h"
#include "src/cache/point_tree.h"
#include "src/cache/record.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct level {
    struct kl_level_arrays part; /* what is served: adopted arrays or the owned ones below */
    bool owned, sorted;
    kl_record_hot *hot;
    kl_record_cold *cold;
    size_t hot_capacity, cold_capacity;
    struct kl_octree octree;
    struct kl_point_tree *tree; /* of the radii that records wish for, over their slope */
};

struct kl_cache {
    struct kl_cache_settings settings;
    struct kl_octree_root root;
    struct level levels[KL_CACHE_LEVELS];
};

kl_status kl_cache_create(const struct kl_cache_settings *settings, struct kl_cache **out,
                          struct kl_err *err)
{
    struct kl_cache *c = NULL;
    kl_status st = kl_alloc_array(&c, 1, sizeof *c, err);
    if (st != KL_OK) return st;
    c->settings = *settings;
    c->root = kl_octree_root_make(settings->center, settings->scene_radius);
    *out = c;
    return KL_OK;
}

static void level_fini(struct level *l)
{
    free(l->hot);
    free(l->cold);
    kl_octree_fini(&l->octree);
    kl_point_tree_destroy(l->tree);
    *l = (struct level){0};
}

void kl_cache_destroy(struct kl_cache *cache)
{
    if (cache == NULL) return;
    for (int i = 0; i < KL_CACHE_LEVELS; ++i) {
        level_fini(&cache->levels[i]);
    }
    free(cache);
}

static struct kl_radius_settings radius_settings(const struct kl_cache *c, uint32_t number)
{
    return (struct kl_radius_settings){c->settings.rule, c->settings.accuracy[number],
                                       c->settings.scene_radius};
}

static kl_status make_tree(const struct kl_cache *c, uint32_t number, struct level *l,
                           struct kl_err *err)
{
    const struct kl_radius_settings settings = radius_settings(c, number);
    const struct kl_level_arrays *p = &l->part;
    kl_point_tree_destroy(l->tree);
    l->tree = NULL;
    return kl_clamp_tree(p->hot, p->cold, p->record_count, &settings, &l->tree, err);
}

static void serve_owned(struct level *l, uint32_t count)
{
    l->owned = true;
    l->part = (struct kl_level_arrays){.record_count = count,
                                       .hot = l->hot,
                                       .cold = l->cold,
                                       .octree = l->octree.head,
                                       .nodes = l->octree.nodes,
                                       .rows = l->octree.rows};
}

static kl_status build_octree(struct kl_cache *c, uint32_t number, struct kl_err *err)
{
    struct level *l = &c->levels[number];
    const struct kl_octree_limits limits = {c->settings.reach[number], c->settings.cos_max};
    kl_octree_fini(&l->octree);
    kl_status st =
        kl_octree_build(&c->root, l->hot, l->part.record_count, &limits, &l->octree, err);
    l->octree.head.accuracy = c->settings.accuracy[number];
    serve_owned(l, l->part.record_count);
    return st;
}

/* Clamp all radii of an owned level by what is around them and rebuild its index. */
static kl_status index_level(struct kl_cache *c, uint32_t number, struct kl_err *err)
{
    struct level *l = &c->levels[number];
    const struct kl_radius_settings settings = radius_settings(c, number);
    const uint32_t n = l->part.record_count;
    float *scratch = NULL;
    kl_status st = kl_alloc_array(&scratch, n, sizeof *scratch, err);
    if (st == KL_OK) st = make_tree(c, number, l, err);
    if (st == KL_OK) {
        const struct kl_record_set set = {
            l->hot, l->cold, n, l->tree, c->settings.reach[number], c->settings.cos_max};
        kl_clamp_by_neighbours(&set, &settings);
        kl_clamp_by_agreement(&set, number, &settings, scratch);
        kl_clamp_by_validity(&set, scratch);
        st = build_octree(c, number, err);
    }
    free(scratch);
    return st;
}

/* Copy adopted arrays so that they can grow. */
static kl_status own_level(struct level *l, size_t room, struct kl_err *err)
{
    const size_t n = l->part.record_count;
    kl_status st = kl_grow_array(&l->hot, &l->hot_capacity, n + room, sizeof *l->hot, err);
    if (st == KL_OK) {
        st = kl_grow_array(&l->cold, &l->cold_capacity, n + room, sizeof *l->cold, err);
    }
    if (st != KL_OK) return st;
    if (!l->owned && n > 0) {
        memcpy(l->hot, l->part.hot, n * sizeof *l->hot);
        memcpy(l->cold, l->part.cold, n * sizeof *l->cold);
    }
    serve_owned(l, (uint32_t)n);
    return KL_OK;
}

static bool octree_fits(const struct kl_cache *c, uint32_t level, const kl_octree_header *h,
                        uint32_t count)
{
    return h->record_count == count && count > 0 && h->side == c->root.side &&
           memcmp(h->root_min, c->root.min, sizeof h->root_min) == 0 &&
           h->reach == c->settings.reach[level] && h->cos_max == c->settings.cos_max &&
           h->accuracy == c->settings.accuracy[level];
}

kl_status kl_cache_adopt(struct kl_cache *cache, uint32_t level, const struct kl_level_arrays *part,
                         struct kl_err *err)
{
    struct level *l = &cache->levels[level];
    level_fini(l);
    l->part = *part;
    l->sorted = true;
    if (part->record_count == 0) return KL_OK;
    if (octree_fits(cache, level, &part->octree, part->record_count)) return KL_OK;
    kl_status st = own_level(l, 0, err);
    return st == KL_OK ? index_level(cache, level, err) : st;
}

/* What makes a record itself, within a level. */
struct identity {
    uint32_t normal;
    float pos[3];
    uint32_t number;
};
enum { IDENTITY_BYTES = offsetof(struct identity, number) };

static struct identity identity_of(const kl_record_hot *hot, uint32_t number)
{
    struct identity out = {.normal = hot->normal, .number = number};
    memcpy(out.pos, hot->pos, sizeof out.pos);
    return out;
}

static int compare_identities(const void *a, const void *b)
{
    return memcmp(a, b, IDENTITY_BYTES);
}

static int compare_numbered(const void *a, const void *b)
{
    const struct identity *x = a;
    const struct identity *y = b;
    const int order = compare_identities(a, b);
    return order != 0 ? order : (x->number > y->number) - (x->number < y->number);
}

/* repeated[i] = 1 where record i of a batch is in the level already, or earlier in the batch. */
static kl_status find_repeated(const struct level *l, const kl_record_hot *hot, uint32_t count,
                               uint8_t *repeated, struct kl_err *err)
{
    struct identity *batch = NULL;
    size_t unique = 0;
    kl_status st = kl_alloc_array(&batch, count, sizeof *batch, err);
    if (st != KL_OK) return st;
    for (uint32_t i = 0; i < count; ++i) {
        batch[i] = identity_of(&hot[i], i);
    }
    qsort(batch, count, sizeof *batch, compare_numbered);
    for (uint32_t i = 0; i < count; ++i) {
        if (unique > 0 && compare_identities(&batch[i], &batch[unique - 1]) == 0) {
            repeated[batch[i].number] = 1;
        } else {
            batch[unique++] = batch[i];
        }
    }
    for (uint32_t i = 0; i < l->part.record_count; ++i) {
        const struct identity old = identity_of(&l->part.hot[i], i);
        const struct identity *same =
            bsearch(&old, batch, unique, sizeof *batch, compare_identities);
        if (same != NULL) repeated[same->number] = 1;
    }
    free(batch);
    return KL_OK;
}

kl_status kl_cache_insert(struct kl_cache *cache, uint32_t level, const kl_record_hot *hot,
                          const kl_record_cold *cold, uint32_t count, struct kl_err *err)
{
    struct level *l = &cache->levels[level];
    uint8_t *repeated = NULL;
    kl_status st = own_level(l, count, err);

    if (st == KL_OK) st = kl_alloc_array(&repeated, count, 1, err);
    if (st == KL_OK) st = find_repeated(l, hot, count, repeated, err);
    if (st != KL_OK) goto cleanup;
    for (uint32_t i = 0; i < count; ++i) {
        if (repeated[i]) continue;
        l->hot[l->part.record_count] = hot[i];
        l->cold[l->part.record_count++] = cold[i];
    }
    l->sorted = false;
    st = index_level(cache, level, err);

cleanup:
    free(repeated);
    return st;
}

struct order {
    uint64_t code; /* Z-curve position */
    const kl_record_hot *hot;
    uint32_t number;
};

static uint64_t spread21(uint64_t x)
{
    x &= 0x1fffff;
    x = (x | x << 32) & 0x1f00000000ffffull;
    x = (x | x << 16) & 0x1f0000ff0000ffull;
    x = (x | x << 8) & 0x100f00f00f00f00full;
    x = (x | x << 4) & 0x10c30c30c30c30c3ull;
    return (x | x << 2) & 0x1249249249249249ull;
}

static uint64_t z_code(const struct kl_octree_root *root, const float pos[3])
{
    uint64_t code = 0;
    for (int k = 0; k < 3; ++k) {
        const float q = (pos[k] - root->min[k]) / root->side * 2097152.0f;
        code |= spread21((uint64_t)kl_clamp(q, 0.0f, 2097151.0f)) << k;
    }
    return code;
}

static int compare_order(const void *a, const void *b)
{
    const struct order *x = a;
    const struct order *y = b;
    if (x->code != y->code) return x->code < y->code ? -1 : 1;
    const int order = memcmp(x->hot->pos, y->hot->pos, sizeof x->hot->pos);
    if (order != 0) return order;
    return (x->hot->normal > y->hot->normal) - (x->hot->normal < y->hot->normal);
}

static kl_status sort_level(struct kl_cache *c, struct level *l, struct kl_err *err)
{
    const uint32_t n = l->part.record_count;
    struct order *order = NULL;
    kl_record_hot *hot = NULL;
    kl_record_cold *cold = NULL;
    kl_status st = kl_alloc_array(&order, n, sizeof *order, err);
    if (st == KL_OK) st = kl_alloc_array(&hot, n, sizeof *hot, err);
    if (st == KL_OK) st = kl_alloc_array(&cold, n, sizeof *cold, err);
    if (st != KL_OK) goto cleanup;
    for (uint32_t i = 0; i < n; ++i) {
        order[i] = (struct order){z_code(&c->root, l->hot[i].pos), &l->hot[i], i};
    }
    qsort(order, n, sizeof *order, compare_order);
    for (uint32_t i = 0; i < n; ++i) {
        hot[i] = l->hot[order[i].number];
        cold[i] = l->cold[order[i].number];
    }
    free(l->hot);
    free(l->cold);
    l->hot = hot;
    l->cold = cold;
    l->hot_capacity = n;
    l->cold_capacity = n;
    hot = NULL;
    cold = NULL;
    serve_owned(l, n);

cleanup:
    free(order);
    free(hot);
    free(cold);
    return st;
}

kl_status kl_cache_finish(struct kl_cache *cache, struct kl_err *err)
{
    for (uint32_t i = 0; i < KL_CACHE_LEVELS; ++i) {
        struct level *l = &cache->levels[i];
        if (l->sorted || l->part.record_count == 0) continue;
        kl_status st = sort_level(cache, l, err);
        if (st == KL_OK) st = index_level(cache, i, err);
        if (st != KL_OK) return st;
        l->sorted = true;
    }
    return KL_OK;
}

kl_level_view kl_cache_view(const struct kl_cache *cache, uint32_t level)
{
    const struct kl_level_arrays *p = &cache->levels[level].part;
    return (kl_level_view){p->octree, p->hot, p->cold, p->nodes, p->rows, NULL};
}

struct kl_level_arrays kl_cache_get_arrays(const struct kl_cache *cache, uint32_t level)
{
    return cache->levels[level].part;
}

uint32_t kl_cache_count(const struct kl_cache *cache, uint32_t level)
{
    return cache->levels[level].part.record_count;
}

kl_status kl_cache_prepare(struct kl_cache *cache, uint32_t level, struct kl_err *err)
{
    struct level *l = &cache->levels[level];
    return l->tree != NULL ? KL_OK : make_tree(cache, level, l, err);
}

float kl_cache_predict_radius(const struct kl_cache *cache, uint32_t level, const float pos[3],
                              float otherwise)
{
    const struct level *l = &cache->levels[level];
    if (l->tree == NULL) return otherwise;
    const struct kl_radius_settings settings = radius_settings(cache, level);
    const float slope = kl_record_slope(&settings);
    return slope * kl_point_tree_envelope(l->tree, pos, otherwise / slope);
}

void kl_cache_set_light(struct kl_cache *cache, uint32_t level, uint32_t i, const float irr[3])
{
    struct level *l = &cache->levels[level];
    if (l->owned) memcpy(l->cold[i].irr, irr, sizeof l->cold[i].irr);
}

const struct kl_cache_settings *kl_cache_get_settings(const struct kl_cache *cache)
{
    return &cache->settings;
}

kl_status kl_cache_set_accuracy(struct kl_cache *cache, uint32_t level, float accuracy,
                                struct kl_err *err)
{
    struct level *l = &cache->levels[level];
    if (cache->settings.accuracy[level] == accuracy) return KL_OK;
    cache->settings.accuracy[level] = accuracy;
    if (l->part.record_count == 0) return KL_OK;
    kl_status st = own_level(l, 0, err);
    return st == KL_OK ? index_level(cache, level, err) : st;
}
