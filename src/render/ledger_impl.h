/* Private to src/render/ledger*.c. */
#ifndef KL_SRC_RENDER_LEDGER_IMPL_H
#define KL_SRC_RENDER_LEDGER_IMPL_H

#include "src/render/ledger.h"

/* One record and its rays. */
struct kl_ledger_entry {
    kl_gather_point point; /* where it is; its seed is that of the first place */
    uint32_t level, side;
    kl_gather_cell *cells; /* side^2 */
    uint32_t object;       /* that it lies on */
    kl_record_hot hot;
    kl_record_cold cold;
    bool by_paths; /* its rays went on until they met no more light, for want of records */
    bool kept;     /* it belongs to a record of the cache */
    bool dropped;  /* its place is gone */
    /* By the last refresh: */
    float step;    /* [m] that it moved; KL_INF: it turned so far that its rays say nothing */
    uint32_t shot; /* rays */
    float change;  /* of its light, relative */
};

/* What all records of a level share while they are brought up to date. */
struct kl_ledger_refresh {
    const struct kl_fill_job *job;
    const struct kl_moved *moved;
    kl_level_view level1; /* what is up to date of it: rays end there */
    kl_u32 stirred[2];    /* bits of objects whose level-1 records changed: kernels/parts.h */
    uint32_t turn;        /* number of the refresh: whose turn it is */
};

enum { KL_LEDGER_SIDE = 256 }; /* of a record's rays at most */

/* Take a record along with what it lies on; it is dropped where its place is gone. */
void kl_ledger_move_entry(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entry);
/* Bring a record that was moved and not dropped up to date. `scratch`: KL_LEDGER_SIDE^2 cells. */
void kl_ledger_refresh_entry(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entry,
                             kl_gather_cell *scratch);

#endif
