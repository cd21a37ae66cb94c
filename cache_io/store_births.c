/* When records were first written: a base inherits it from the segments it takes the place of. */
#include "cache_io/store_impl.h"
#include "src/base/hash.h"
#include "src/base/memory.h"

#include <stdlib.h>
#include <string.h>

/* Records of one level by place, with the least birth of each place. */
struct table {
    size_t mask;
    struct slot {
        uint64_t place; /* hash, 0: empty */
        uint32_t birth;
    } * slots;
};

static uint64_t place_of(const kl_record_hot *hot)
{
    unsigned char bytes[20];

    memcpy(bytes, hot->pos, 12);
    memcpy(bytes + 12, &hot->normal, 4);
    memcpy(bytes + 16, &hot->object, 4);
    const uint64_t hash = kl_hash_block(bytes, sizeof bytes);
    return hash != 0 ? hash : 1;
}

static struct slot *find(const struct table *table, uint64_t place)
{
    size_t i = (size_t)place & table->mask;

    while (table->slots[i].place != 0 && table->slots[i].place != place)
        i = (i + 1) & table->mask;
    return &table->slots[i];
}

static void enter_segment(struct table *table, const struct segment *segment, uint32_t l)
{
    const struct kl_level_arrays *level = &segment->levels[l];
    const uint64_t g = segment->id.generation;
    const uint32_t born = g < UINT32_MAX ? (uint32_t)g : UINT32_MAX;

    for (uint32_t i = 0; i < level->record_count; ++i) {
        const uint64_t place = place_of(&level->hot[i]);
        const uint32_t birth = segment->births[l] != NULL ? segment->births[l][i] : born;
        struct slot *slot = find(table, place);
        if (slot->place == 0 || birth < slot->birth) *slot = (struct slot){place, birth};
    }
}

static kl_status find_level(const struct kl_store *store, const struct kl_level_arrays *level,
                            uint32_t l, uint32_t next, uint32_t *births, struct kl_err *err)
{
    struct table table = {0};
    size_t known = 0;
    size_t size = 16;

    for (size_t i = 0; i < store->segments.count; ++i)
        known += store->segments.items[i].levels[l].record_count;
    while (size < 2 * known)
        size *= 2;
    table.mask = size - 1;
    kl_status st = kl_alloc_array(&table.slots, size, sizeof *table.slots, err);
    if (st != KL_OK) return st;
    for (size_t i = 0; i < store->segments.count; ++i)
        enter_segment(&table, &store->segments.items[i], l);
    for (uint32_t i = 0; i < level->record_count; ++i) {
        const struct slot *slot = find(&table, place_of(&level->hot[i]));
        births[i] = slot->place != 0 ? slot->birth : next;
    }
    free(table.slots);
    return KL_OK;
}

kl_status store_find_births(const struct kl_store *store,
                            const struct kl_level_arrays levels[KL_CACHE_LEVELS], uint32_t next,
                            uint32_t *births[KL_CACHE_LEVELS], struct kl_err *err)
{
    kl_status st = KL_OK;

    for (uint32_t l = 0; l < KL_CACHE_LEVELS && st == KL_OK; ++l) {
        const uint32_t count = levels[l].record_count;
        st = kl_alloc_array(&births[l], count, sizeof *births[l], err);
        if (st == KL_OK) st = find_level(store, &levels[l], l, next, births[l], err);
    }
    return st;
}
