#include "src/app/record_list.h"

#include "cache_io/records.h"
#include "cache_io/use.h"
#include "src/app/cache_stores.h"
#include "src/base/memory.h"

#include <stdlib.h>
#include <string.h>

static kl_status add_records(struct kl_record_list *list, const struct kl_records *records,
                             const struct kl_use *use, const double origin[3], struct kl_err *err)
{
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    kl_status st = KL_OK;

    kl_records_get(records, levels);
    for (uint32_t l = 0; st == KL_OK && l < KL_CACHE_LEVELS; ++l) {
        const uint32_t *births = kl_records_births(records, l);
        const uint32_t n = levels[l].record_count;
        st =
            kl_grow_array(&list->items, &list->capacity, list->count + n, sizeof *list->items, err);
        for (uint32_t i = 0; st == KL_OK && i < n; ++i) {
            struct kl_record_item *item = &list->items[list->count++];
            *item = (struct kl_record_item){.hot = levels[l].hot[i],
                                            .cold = levels[l].cold[i],
                                            .level = l,
                                            .born = births[i],
                                            .used = l == 0 && kl_use_has(use, &levels[l].hot[i]),
                                            .instant = (uint32_t)list->instant_count};
            for (int k = 0; k < 3; ++k) {
                item->pos[k] = origin[k] + (double)levels[l].hot[i].pos[k];
            }
        }
    }
    return st;
}

static kl_status add_store(struct kl_record_list *list, const char *path, const char *instant,
                           struct kl_err *err)
{
    struct kl_store *store = NULL;
    struct kl_records *records = NULL;
    struct kl_use *use = NULL;
    struct kl_store_key key;
    uint64_t merged = 0;
    kl_status st = kl_store_open(path, KL_STORE_READ, NULL, &store, err);

    if (st != KL_OK) return st;
    kl_store_key_get(store, &key);
    st = kl_records_create(&records, err);
    if (st == KL_OK) st = kl_records_add_store(records, store, err);
    if (st == KL_OK) st = kl_records_merge(records, &merged, err);
    if (st == KL_OK) st = kl_use_load(store, 0, &use, err);
    if (st == KL_OK) st = add_records(list, records, use, key.origin, err);
    if (st == KL_OK) st = kl_copy_string(&list->instants[list->instant_count], instant, err);
    if (st == KL_OK) ++list->instant_count;
    kl_use_destroy(use);
    kl_records_destroy(records);
    kl_store_close(store);
    return st;
}

kl_status kl_record_list_load(const char *dir, struct kl_record_list *out, struct kl_err *err)
{
    struct kl_cache_stores stores = {0};
    kl_status st = kl_cache_stores_find(dir, &stores, err);

    if (st == KL_OK) st = kl_alloc_array(&out->instants, stores.count, sizeof(char *), err);
    for (size_t i = 0; st == KL_OK && i < stores.count; ++i) {
        const bool is_whole = strcmp(stores.paths[i], dir) == 0;
        st =
            add_store(out, stores.paths[i], is_whole ? "" : strrchr(stores.paths[i], '/') + 1, err);
    }
    kl_cache_stores_fini(&stores);
    return st;
}

void kl_record_list_fini(struct kl_record_list *list)
{
    for (size_t i = 0; i < list->instant_count; ++i) {
        free(list->instants[i]);
    }
    free(list->instants);
    free(list->items);
    *list = (struct kl_record_list){0};
}
