/* Claims: a process says what it is about to gather, so that others do something else, or wait.
 * Only advice: a claim that is ignored, lost or too old costs work done twice, never a record.
 *
 * A claim is a file of the store's folder that lives for KL_CLAIM_LIFE_S after it was last renewed.
 * All times are those that the file system gives files, so the clocks of machines do not count; a
 * claim from the future is as dead as one from the past. */
#ifndef KL_CACHE_IO_CLAIM_H
#define KL_CACHE_IO_CLAIM_H

#include "cache_io/store.h"

enum { KL_CLAIM_LIFE_S = 20 };

struct kl_claim;

/* Claim `work` (a hash of what is to be done). NULL: another process has it and is alive. Where the
 * folder cannot be written to, or memory is out, nobody is kept waiting: `taken` is true and the
 * claim NULL. Renew it more often than it lives; release accepts NULL. */
struct kl_claim *kl_claim_take(const struct kl_store *store, uint64_t work, bool *taken);
void kl_claim_renew(struct kl_claim *claim); /* accepts NULL */
void kl_claim_release(struct kl_claim *claim);

#endif
