/* Private to src/render/ledger*.c. */
#ifndef KL_SRC_RENDER_LEDGER_IMPL_H
#define KL_SRC_RENDER_LEDGER_IMPL_H

#include "src/render/ledger.h"

/* By how much rays that wait for their turn change, from those that had it, recent ones first. */
struct kl_ledger_rate {
    float change[3]; /* of radiance, summed over rays */
    float turns;     /* that this took, summed likewise */
};

/* What may have become of a ray: nothing; what it hits is lit a little otherwise; nothing any more,
 * but its turn had not come while something did; what it hits is lit so much otherwise that its
 * record notices; what it hits has moved, and it still hits it; it has another origin; all. */
enum kl_ledger_kind {
    KL_RAY_STILL,
    KL_RAY_DIMS,
    KL_RAY_LAGS,
    KL_RAY_FADES,
    KL_RAY_SEES,
    KL_RAY_RIDES,
    KL_RAY_TOUCHED,
    KL_RAY_KINDS
};
#define KL_RAY_DUE 0x80u /* has to be shot */

/* One record and its rays. */
struct kl_ledger_entry {
    kl_gather_point point; /* where it is; its seed is that of the first place */
    uint32_t level, side;
    kl_gather_cell *cells; /* side^2: what came back when each was last shot */
    uint8_t *waits;        /* side^2: turns since then in which the ray may have changed */
    uint8_t *kinds;        /* side^2: kl_ledger_kind by the last refresh, and KL_RAY_DUE */
    uint32_t due;          /* rays that a refresh under way has to shoot */
    struct kl_ledger_rate rates[KL_RAY_KINDS];
    uint32_t object;    /* that it lies on */
    kl_ride lies;       /* where; the instance is not told */
    kl_corners corners; /* of that triangle, if it is a merged one */
    kl_record_hot hot;
    kl_record_cold cold;
    bool by_paths;       /* its rays went on until they met no more light, for want of records */
    bool kept;           /* it belongs to a record of the cache */
    bool dropped;        /* its place is gone */
    uint32_t record;     /* of the cache, if kept */
    uint32_t age_frames; /* frames that it has been shown, up to KL_LEDGER_FADE: in full */
    bool leaves;         /* others do without it: its age goes down, and then it is dropped */
    bool faded;          /* the cache has other light than `cold` */
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
    struct kl_gatherer *gatherer;
    const struct kl_moved *moved;
    kl_level_view level1; /* what is up to date of it: rays end there */
    const struct kl_ledger_stir *stir;
    uint32_t turn; /* number of the refresh: whose turn it is */
};

enum { KL_LEDGER_SIDE = 256, KL_LEDGER_CELLS = KL_LEDGER_SIDE * KL_LEDGER_SIDE }; /* rays at most */
enum { KL_LEDGER_FADE = 4 }; /* frames in which a record comes or goes */

/* Room for the rays of one record: a thread's own. */
struct kl_ledger_scratch {
    kl_gather_cell cells[KL_LEDGER_CELLS], reduced[KL_LEDGER_CELLS];
};

/* `touch`: relative change from which on records tell others. `radius`: of the scene [m]. */
void kl_ledger_stir(const struct kl_ledger_entry *entries, size_t count,
                    const struct kl_stand *stand, float touch, float radius,
                    struct kl_ledger_stir *out);
/* Mean change of irradiance around a point, luminance. */
float kl_ledger_stir_at(const struct kl_ledger_stir *stir, kl_vec3 at);

/* Take a record a frame further, along with what it lies on; it is dropped where its place is gone,
 * or it has left. */
void kl_ledger_move_entry(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entry);
/* Which rays of a record that was moved and not dropped have to be shot. `directions`: of its set.
 */
void kl_ledger_judge_entry(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entry,
                           const kl_direction *directions);
/* Bring a record up to date of which rays were due; `brought`: by these, in their order. */
void kl_ledger_refresh_entry(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entry,
                             const struct kl_gather_tables *tables, const kl_gather_cell *brought,
                             struct kl_ledger_scratch *scratch);
/* Shoot all rays that are due of `count` records, by whoever gathers, and bring these up to date.
 * `scratch`: one a thread. */
kl_status kl_ledger_shoot(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entries,
                          size_t count, struct kl_ledger_scratch *scratch,
                          struct kl_err *err) KL_MUST_CHECK;
/* Tables of the records with side x side rays, among those that the job gathers by. */
const struct kl_gather_tables *kl_ledger_tables(const struct kl_fill_job *job, uint32_t side);

/* Records that were placed close together because something was near, and that could now be far
 * apart, give way to the oldest of them: at once in level 1, else they leave. */
kl_status kl_ledger_thin(struct kl_ledger_entry *entries, size_t count,
                         struct kl_err *err) KL_MUST_CHECK;

/* Let records of level 0 come and go by degrees: where others know the light of a place, the cache
 * gets a mean of what they and the record say. Entries keep their own light. */
kl_status kl_ledger_fade(struct kl_ledger_entry *entries, size_t count, struct kl_cache *cache,
                         struct kl_err *err) KL_MUST_CHECK;

#endif
