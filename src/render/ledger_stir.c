/* Where the light of a moving scene changes: whose rays have to follow, and how soon. */
#include "src/render/ledger_impl.h"

#include <math.h>
#include <string.h>

enum { CELLS = KL_STIR_SIDE * KL_STIR_SIDE * KL_STIR_SIDE };

/* The grid repeats itself: the scene, two radii wide, fits into it once. */
static uint32_t cell_of(const struct kl_ledger_stir *s, kl_vec3 at)
{
    const uint32_t x = (uint32_t)(int32_t)floorf(at.x * s->per_metre) % KL_STIR_SIDE;
    const uint32_t y = (uint32_t)(int32_t)floorf(at.y * s->per_metre) % KL_STIR_SIDE;
    const uint32_t z = (uint32_t)(int32_t)floorf(at.z * s->per_metre) % KL_STIR_SIDE;
    return (z * KL_STIR_SIDE + y) * KL_STIR_SIDE + x;
}

float kl_ledger_stir_at(const struct kl_ledger_stir *stir, kl_vec3 at)
{
    return stir->fades[cell_of(stir, at)];
}

void kl_ledger_stir(const struct kl_ledger_entry *entries, size_t count,
                    const struct kl_stand *stand, float touch, float radius,
                    struct kl_ledger_stir *out)
{
    uint32_t records[CELLS] = {0};

    memset(out, 0, sizeof *out);
    out->per_metre = 0.5f * KL_STIR_SIDE / radius;
    for (size_t i = 0; i < count; ++i) {
        const struct kl_ledger_entry *e = &entries[i];
        const kl_u32 bit = kl_stand_bit(stand, e->object);
        const uint32_t cell = cell_of(out, kl_v3_load(e->point.pos));
        if (e->level != 1) continue;
        if (e->change >= touch && bit < 64u) out->objects[bit >> 5] |= 1u << (bit & 31u);
        out->fades[cell] += e->added;
        ++records[cell];
    }
    for (int i = 0; i < CELLS; ++i) {
        if (records[i] > 0) out->fades[i] = fabsf(out->fades[i]) / (float)records[i];
    }
}
