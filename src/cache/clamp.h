/* Radii of a level's records from all of them together, in this order: what neighbours allow, how
 * far records agree with each other, what nearer ones leave to do. */
#ifndef KL_SRC_CACHE_CLAMP_H
#define KL_SRC_CACHE_CLAMP_H

#include "src/base/status.h"
#include "src/cache/record.h"
#include "src/cache/record_set.h"

/* The places of `count` records with the radii they wish for, over the slope: the tree of their
 * set. *out is the caller's: kl_point_tree_destroy. */
kl_status kl_clamp_tree(const kl_record_hot *hot, const kl_record_cold *cold, uint32_t count,
                        const struct kl_radius_settings *settings, struct kl_point_tree **out,
                        struct kl_err *err) KL_MUST_CHECK;

/* Set all radii from the records' wishes, none more than the slope larger than a neighbour's.
 * Threads: uses all. */
void kl_clamp_by_neighbours(const struct kl_record_set *set,
                            const struct kl_radius_settings *settings);

/* Let no record reach the nearest other one that it is wrong about by more than half of the
 * accuracy's square, which is the error that is asked for (0013).
 * Split-sphere radii stay as published, and so does level 1: gather rays average over so much of it
 * that single records' mistakes do not matter (0025).
 * `scratch`: as many as records. Threads: uses all. */
void kl_clamp_by_agreement(const struct kl_record_set *set, uint32_t level,
                           const struct kl_radius_settings *settings, float *scratch);

/* Let no record reach far into what nearer ones serve. `scratch`: as many as records. Threads: uses
 * all. */
void kl_clamp_by_validity(const struct kl_record_set *set, float *scratch);

#endif
