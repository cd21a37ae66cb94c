#include "src/cache/thin.h"

#include "kernels/sampling.h"
#include "src/base/memory.h"

#include <math.h>
#include <stdlib.h>

/* Multi-level hash of the accepted candidates: one with exclusion radius e is entered into the
 * cells that its sphere touches on the level whose cells are at least 2 e wide, at most 8 of them;
 * a test then looks at one cell per level. */
enum { LEVELS = 64, BIAS = 32, CELLS_EACH = 8 };

struct entry {
    uint32_t candidate, next;
};

struct grid {
    uint32_t *heads; /* hash table of entry numbers */
    uint32_t mask;
    struct entry *entries;
    uint32_t used;
    uint64_t level_mask;
};

static int level_of(float exclude)
{
    const int l = (int)ceilf(log2f(2.0f * exclude)) + BIAS;
    return l < 0 ? 0 : (l >= LEVELS ? LEVELS - 1 : l);
}

static uint32_t cell_hash(int level, float x, float y, float z, uint32_t mask)
{
    uint32_t h = kl_hash((uint32_t)(int32_t)x + 0x9e3779b9u * (uint32_t)level);
    h = kl_hash(h ^ (uint32_t)(int32_t)y);
    return kl_hash(h ^ (uint32_t)(int32_t)z) & mask;
}

static bool is_excluded(const struct grid *g, const struct kl_candidate *all,
                        const struct kl_candidate *c, float cos_alike)
{
    for (int level = 0; level < LEVELS; ++level) {
        if (!((g->level_mask >> level) & 1u)) continue;
        const float scale = exp2f((float)(BIAS - level));
        uint32_t i = g->heads[cell_hash(level, floorf(c->pos.x * scale), floorf(c->pos.y * scale),
                                        floorf(c->pos.z * scale), g->mask)];
        for (; i != KL_NONE; i = g->entries[i].next) {
            const struct kl_candidate *a = &all[g->entries[i].candidate];
            const kl_vec3 d = kl_v3_sub(c->pos, a->pos);
            const float e = kl_fmin(a->exclude, c->exclude);
            if (kl_dot(d, d) < e * e && kl_dot(a->normal, c->normal) > cos_alike) return true;
        }
    }
    return false;
}

static void enter(struct grid *g, const struct kl_candidate *all, uint32_t number)
{
    const struct kl_candidate *c = &all[number];
    const int level = level_of(c->exclude);
    const float scale = exp2f((float)(BIAS - level));
    uint32_t seen[CELLS_EACH];
    int count = 0;

    g->level_mask |= 1ull << level;
    for (int corner = 0; corner < 8; ++corner) {
        const float x = floorf((c->pos.x + (corner & 1 ? c->exclude : -c->exclude)) * scale);
        const float y = floorf((c->pos.y + (corner & 2 ? c->exclude : -c->exclude)) * scale);
        const float z = floorf((c->pos.z + (corner & 4 ? c->exclude : -c->exclude)) * scale);
        const uint32_t h = cell_hash(level, x, y, z, g->mask);
        bool known = false;
        for (int k = 0; k < count; ++k) {
            known = known || seen[k] == h;
        }
        if (known) continue;
        seen[count++] = h;
        g->entries[g->used] = (struct entry){number, g->heads[h]};
        g->heads[h] = g->used++;
    }
}

struct ranked {
    struct kl_candidate candidate;
    size_t place;
};

static int compare_rank(const void *a, const void *b)
{
    const struct ranked *x = a;
    const struct ranked *y = b;
    if (x->candidate.rank != y->candidate.rank) {
        return x->candidate.rank < y->candidate.rank ? -1 : 1;
    }
    return x->place < y->place ? -1 : 1;
}

static kl_status sort_by_rank(struct kl_candidate *candidates, size_t count, struct kl_err *err)
{
    struct ranked *ranked = NULL;
    kl_status st = kl_alloc_array(&ranked, count, sizeof *ranked, err);
    if (st != KL_OK) return st;
    for (size_t i = 0; i < count; ++i) {
        ranked[i] = (struct ranked){candidates[i], i};
    }
    qsort(ranked, count, sizeof *ranked, compare_rank);
    for (size_t i = 0; i < count; ++i) {
        candidates[i] = ranked[i].candidate;
    }
    free(ranked);
    return KL_OK;
}

kl_status kl_thin(struct kl_candidate *candidates, size_t count, float cos_alike, size_t limit,
                  size_t *kept, struct kl_err *err)
{
    struct grid g = {.mask = 1023};
    const size_t most = count < limit ? count : limit;
    size_t accepted = 0;
    kl_status st = sort_by_rank(candidates, count, err);

    if (st != KL_OK) return st;
    while (g.mask + 1 < CELLS_EACH * most && g.mask < 0x3fffffffu) {
        g.mask = 2 * g.mask + 1;
    }
    st = kl_alloc_array(&g.heads, (size_t)g.mask + 1, sizeof *g.heads, err);
    if (st == KL_OK) st = kl_alloc_array(&g.entries, CELLS_EACH * most, sizeof *g.entries, err);
    if (st != KL_OK) goto cleanup;
    for (size_t i = 0; i <= g.mask; ++i) {
        g.heads[i] = KL_NONE;
    }
    for (size_t i = 0; i < count && accepted < most; ++i) {
        if (is_excluded(&g, candidates, &candidates[i], cos_alike)) continue;
        candidates[accepted] = candidates[i];
        enter(&g, candidates, (uint32_t)accepted++);
    }
    *kept = accepted;

cleanup:
    free(g.heads);
    free(g.entries);
    return st;
}
