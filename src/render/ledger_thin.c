/* Which records of a ledger others could do without. */
#include "src/base/memory.h"
#include "src/cache/thin.h"
#include "src/render/ledger_impl.h"

#include <stdlib.h>

static const float crowd = 0.7f;  /* of its radius: records this near are not needed */
static const float alike = 0.98f; /* cosine between their normals */

static bool is_settled(const struct kl_ledger_entry *e, uint32_t level)
{
    return e->kept && !e->leaves && e->level == level;
}

/* Entries of a level that stay, as candidates: the oldest come first. */
static size_t list(const struct kl_ledger_entry *entries, size_t count, uint32_t level,
                   struct kl_candidate *out)
{
    size_t n = 0;

    for (size_t i = 0; i < count; ++i) {
        const struct kl_ledger_entry *e = &entries[i];
        if (!is_settled(e, level)) continue;
        const kl_vec3 normal = kl_oct_decode(e->point.normal);
        out[n++] = (struct kl_candidate){kl_v3_load(e->point.pos), normal,     normal, 0.0f,
                                         crowd * e->hot.radius,    (uint32_t)i};
    }
    return n;
}

/* Only where rays were shot again has something been near. */
static void give_way(struct kl_ledger_entry *e)
{
    if (e->shot == 0) return;
    if (e->level == 0) {
        e->leaves = true;
    } else {
        e->kept = false;
    }
}

static kl_status thin_level(struct kl_ledger_entry *entries, size_t count, uint32_t level,
                            struct kl_err *err)
{
    struct kl_candidate *c = NULL;
    uint8_t *stays = NULL;
    size_t left = 0;
    kl_status st = kl_alloc_array(&c, count, sizeof *c, err);

    if (st == KL_OK) st = kl_alloc_array(&stays, count, sizeof *stays, err);
    if (st != KL_OK) goto cleanup;
    const size_t n = list(entries, count, level, c);
    st = kl_thin(c, n, alike, n, &left, err);
    if (st != KL_OK) goto cleanup;
    for (size_t i = 0; i < left; ++i) {
        stays[c[i].rank] = 1;
    }
    for (size_t i = 0; i < count; ++i) {
        if (is_settled(&entries[i], level) && !stays[i]) give_way(&entries[i]);
    }

cleanup:
    free(c);
    free(stays);
    return st;
}

kl_status kl_ledger_thin(struct kl_ledger_entry *entries, size_t count, struct kl_err *err)
{
    kl_status st = KL_OK;

    for (uint32_t level = 0; st == KL_OK && level < KL_CACHE_LEVELS; ++level) {
        st = thin_level(entries, count, level, err);
    }
    return st;
}
