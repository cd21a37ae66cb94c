#include "src/render/stale.h"

#include <string.h>

static const char advice[] = "--cache-mode rebuild starts anew";

/* What the records were gathered with, in the store's words; NULL: it does not say. */
static const char *find_settings(const kl_part *parts, uint32_t count)
{
    for (uint32_t i = 0; i < count; ++i) {
        if (parts[i].kind == KL_PART_SETTINGS) return parts[i].label;
    }
    return NULL;
}

static kl_status explain_settings(const struct kl_stale_query *query, const kl_part *old,
                                  uint32_t old_count, struct kl_err *err)
{
    const char *had = find_settings(old, old_count);
    const char *has = find_settings(query->parts->items, query->parts->count);

    if (had == NULL || has == NULL || strcmp(had, has) == 0) {
        return kl_fail(err, KL_ERR_STALE,
                       "%s: made with another choice of settings or by another version of the "
                       "algorithm; %s",
                       query->dir, advice);
    }
    return kl_fail(err, KL_ERR_STALE,
                   "%s: made with another choice of settings (%s, this run: %s); %s", query->dir,
                   had, has, advice);
}

/* Same settings, perhaps another origin. */
static kl_status compare_parts(const struct kl_stale_query *query, const kl_part *old,
                               uint32_t old_count, bool moved, struct kl_parts_edits *edits,
                               struct kl_err *err)
{
    char text[256];

    if (old_count == 0 || query->parts->count == 0) {
        return kl_fail(err, KL_ERR_STALE, "%s: made for another scene; %s", query->dir, advice);
    }
    kl_status st =
        kl_parts_compare(old, old_count, query->parts->items, query->parts->count, edits, err);
    if (st != KL_OK) return st;
    if (!edits->is_same_scene) {
        return kl_fail(err, KL_ERR_STALE,
                       "%s: made for another scene: %u of its %u objects are in this one; %s",
                       query->dir, edits->common, edits->old_objects, advice);
    }
    kl_parts_edits_describe(edits, text, sizeof text);
    if (moved) {
        return kl_fail(err, KL_ERR_STALE,
                       "%s: the scene was edited since: %s, which moved the centre of its bounds; "
                       "%s",
                       query->dir, text, advice);
    }
    if (edits->count == 0) {
        return kl_fail(err, KL_ERR_STALE,
                       "%s: the scene was edited since, but no object and no light; %s", query->dir,
                       advice);
    }
    return KL_OK;
}

kl_status kl_stale_open(const struct kl_stale_query *query, struct kl_store **out,
                        struct kl_parts_edits *edits, struct kl_err *err)
{
    struct kl_store *store = NULL;
    struct kl_store_key had;
    uint32_t count = 0;

    *edits = (struct kl_parts_edits){0};
    kl_status st = kl_store_open(query->dir, KL_STORE_READ, NULL, &store, err);
    if (st != KL_OK) return st;
    kl_store_key_get(store, &had);
    const kl_part *old = kl_store_parts_get(store, &count);
    if (memcmp(had.settings, query->key->settings, sizeof had.settings) != 0) {
        st = explain_settings(query, old, count, err);
    } else {
        const bool moved = memcmp(had.origin, query->key->origin, sizeof had.origin) != 0;
        st = compare_parts(query, old, count, moved, edits, err);
    }
    if (st != KL_OK) {
        kl_parts_edits_fini(edits);
        kl_store_close(store);
        return st;
    }
    *out = store;
    return KL_OK;
}
