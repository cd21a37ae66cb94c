/* Private to src/render/ledger*.c. */
#ifndef KL_SRC_RENDER_LEDGER_IMPL_H
#define KL_SRC_RENDER_LEDGER_IMPL_H

#include "src/render/ledger.h"

/* By how much rays that wait for their turn change, from those that had it, recent ones first. */
struct kl_ledger_rate {
    float change[3]; /* of radiance, summed over rays */
    float turns;     /* that this took, summed likewise */
};

/* What may have become of a ray: nothing; what it hits is lit otherwise, a little or so much that
 * its record notices; what it hits has moved, and it still hits it; it has another origin; all. */
enum kl_ledger_kind {
    KL_RAY_STILL,
    KL_RAY_DIMS,
    KL_RAY_FADES,
    KL_RAY_SEES,
    KL_RAY_RIDES,
    KL_RAY_TOUCHED,
    KL_RAY_KINDS
};

/* One record and its rays. */
struct kl_ledger_entry {
    kl_gather_point point; /* where it is; its seed is that of the first place */
    uint32_t level, side;
    kl_gather_cell *cells; /* side^2: what came back when each was last shot */
    uint8_t *waits;        /* side^2: turns since then in which the ray may have changed */
    struct kl_ledger_rate rates[KL_RAY_KINDS];
    uint32_t object; /* that it lies on */
    kl_record_hot hot;
    kl_record_cold cold;
    bool by_paths; /* its rays went on until they met no more light, for want of records */
    bool kept;     /* it belongs to a record of the cache */
    bool dropped;  /* its place is gone */
    /* By the last refresh: */
    float step;    /* [m] that it moved; KL_INF: it turned so far that its rays say nothing */
    uint32_t shot; /* rays */
    float change;  /* of its light, relative */
    float added;   /* to its light: luminance of irradiance */
    bool hasty;    /* its light changed quickly by the refresh before */
};

/* Where light has changed, by the level-1 records that are up to date. */
enum { KL_STIR_SIDE = 16 };
struct kl_ledger_stir {
    kl_u32 objects[2]; /* bits of those with records that changed: kernels/parts.h */
    float per_metre;   /* cells */
    float fades[KL_STIR_SIDE * KL_STIR_SIDE * KL_STIR_SIDE]; /* a cell of space: mean change of
                                                              * irradiance, luminance; >= 0 */
};

/* What all records of a level share while they are brought up to date. */
struct kl_ledger_refresh {
    const struct kl_fill_job *job;
    const struct kl_moved *moved;
    kl_level_view level1; /* what is up to date of it: rays end there */
    const struct kl_ledger_stir *stir;
    uint32_t turn; /* number of the refresh: whose turn it is */
};

enum { KL_LEDGER_SIDE = 256 }; /* of a record's rays at most */

/* `touch`: relative change from which on records tell others. `radius`: of the scene [m]. */
void kl_ledger_stir(const struct kl_ledger_entry *entries, size_t count,
                    const struct kl_stand *stand, float touch, float radius,
                    struct kl_ledger_stir *out);
/* Mean change of irradiance around a point, luminance. */
float kl_ledger_stir_at(const struct kl_ledger_stir *stir, kl_vec3 at);

/* Take a record along with what it lies on; it is dropped where its place is gone. */
void kl_ledger_move_entry(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entry);
/* Bring a record that was moved and not dropped up to date. `scratch`: 2 KL_LEDGER_SIDE^2 cells. */
void kl_ledger_refresh_entry(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entry,
                             kl_gather_cell *scratch);

#endif
