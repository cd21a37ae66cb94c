/* Private to src/render: the ledger of a moving scene, what each gather ray of each record met,
 * from one frame of a run to the next (docs/decisions/0018-ledger.md). In memory only. */
#ifndef KL_SRC_RENDER_LEDGER_H
#define KL_SRC_RENDER_LEDGER_H

#include "src/render/fill.h"
#include "src/render/gatherer.h"
#include "src/render/moved.h"

struct kl_ledger;

kl_status kl_ledger_create(struct kl_ledger **out, struct kl_err *err) KL_MUST_CHECK;
void kl_ledger_destroy(struct kl_ledger *ledger); /* accepts NULL */
void kl_ledger_clear(struct kl_ledger *ledger);
/* Who gathers until the next call; stays until then. */
void kl_ledger_use(struct kl_ledger *ledger, struct kl_gatherer *gatherer);

/* A kl_gather_fn; context: struct kl_ledger. Gathers, and notes what rays met. */
kl_status kl_ledger_gather(void *context, const struct kl_gather_job *job, struct kl_err *err);

/* The cache of the instant `time` is complete: keep what was noted of its records, forget the rest,
 * and let new records show by degrees (kl_ledger_fade).
 * `scene`: with its tracer. `stand` is the ledger's from now on, also after a failure; NULL: it is
 * of this instant already. */
kl_status kl_ledger_close(struct kl_ledger *ledger, struct kl_cache *cache,
                          const kl_scene_view *scene, struct kl_stand *stand, double time,
                          struct kl_err *err) KL_MUST_CHECK;

/* Carry the records of the instant `before` over to the one of `stand`, bring them up to date with
 * the rays that this takes, and insert them into job->cache, which is empty. Nothing is carried
 * where the ledger is of another instant, or light itself has changed. */
kl_status kl_ledger_carry(struct kl_ledger *ledger, const struct kl_fill_job *job,
                          const struct kl_stand *stand, double before, struct kl_fill_stats *stats,
                          struct kl_err *err) KL_MUST_CHECK;

#endif
