/* Records of a ledger come and go by degrees: docs/decisions/0018-ledger.md. A record's weight is
 * that of its place, on disk too, so its light fades: from what the others say it is to its own. */
#include "kernels/moving.h"
#include "src/base/memory.h"
#include "src/render/ledger_impl.h"

#include <stdlib.h>

static bool is_shown(const struct kl_ledger_entry *e)
{
    return e->kept && e->level == 0;
}
static bool is_settled(const struct kl_ledger_entry *e)
{
    return is_shown(e) && !e->leaves && e->age_frames >= KL_LEDGER_FADE;
}

static bool does_any_fade(const struct kl_ledger_entry *entries, size_t count)
{
    for (size_t i = 0; i < count; ++i) {
        if (is_shown(&entries[i]) && !is_settled(&entries[i])) return true;
    }
    return false;
}

/* A cache of the records of level 0 that neither come nor go: what it would be without the others.
 * *out may be NULL: there are none. */
static kl_status settle(const struct kl_ledger_entry *entries, size_t count,
                        const struct kl_cache_settings *settings, struct kl_cache **out,
                        struct kl_err *err)
{
    kl_record_hot *hot = NULL;
    kl_record_cold *cold = NULL;
    uint32_t n = 0;
    kl_status st = kl_alloc_array(&hot, count, sizeof *hot, err);

    if (st == KL_OK) st = kl_alloc_array(&cold, count, sizeof *cold, err);
    for (size_t i = 0; st == KL_OK && i < count; ++i) {
        if (!is_settled(&entries[i])) continue;
        hot[n] = entries[i].hot;
        cold[n++] = entries[i].cold;
    }
    if (st == KL_OK && n > 0) st = kl_cache_create(settings, out, err);
    if (st == KL_OK && n > 0) st = kl_cache_insert(*out, 0, hot, cold, n, err);
    free(hot);
    free(cold);
    return st;
}

static float share_of(uint32_t age_frames)
{
    const float t = (float)age_frames / KL_LEDGER_FADE;
    return t * t * (3.0f - 2.0f * t);
}

/* Where no other serves the place of a record there is nothing to fade from: it counts in full. */
static void fade(struct kl_ledger_entry *e, const kl_level_view *others, const kl_query *query,
                 struct kl_cache *cache)
{
    const kl_vec3 normal = kl_oct_decode(e->point.normal);
    const kl_answer a = kl_cache_query(others, query, kl_v3_load(e->point.pos), normal, normal);

    if (!(a.weight > 0.0f)) {
        e->age_frames = KL_LEDGER_FADE;
        e->leaves = false;
    }
    const kl_vec3 irr = kl_mix3(a.irr, kl_v3_load(e->cold.irr), share_of(e->age_frames));
    const float values[3] = {irr.x, irr.y, irr.z};
    kl_cache_set_light(cache, 0, e->record, values);
    e->faded = true;
}

kl_status kl_ledger_fade(struct kl_ledger_entry *entries, size_t count, struct kl_cache *cache,
                         struct kl_err *err)
{
    const struct kl_cache_settings *settings = kl_cache_get_settings(cache);
    const kl_query query = {settings->reach[0], settings->cos_max, KL_INF};
    struct kl_cache *others = NULL;
    kl_level_view view = {0};

    if (!does_any_fade(entries, count)) return KL_OK;
    kl_status st = settle(entries, count, settings, &others, err);
    if (st == KL_OK && others != NULL) view = kl_cache_view(others, 0);
#pragma omp parallel for schedule(dynamic, 64)
    for (size_t i = 0; i < (st == KL_OK ? count : 0); ++i) {
        if (!is_shown(&entries[i]) || is_settled(&entries[i])) continue;
        fade(&entries[i], &view, &query, cache);
    }
    kl_cache_destroy(others);
    return st;
}
