/* Where records contradict each other (after Krivanek, Bouatouch, Pattanaik and Zara, "Making
 * radiance and irradiance caching practical: adaptive caching and neighbor clamping", 2006): what a
 * record says at the place of another one is checked against what was gathered there. Half of the
 * way goes by either's gradient, as answers do (docs/decisions/0031). */
#ifndef KL_SRC_CACHE_AGREEMENT_H
#define KL_SRC_CACHE_AGREEMENT_H

#include "src/cache/record_set.h"

/* For every record of a set, the share of its radii with which it ends, to queries of the set's
 * reach, at the nearest record that it is wrong about: by more than `error`, relative, beyond what
 * the noise of both explains. 1: none. The KL_NEAREST_MOST nearest are looked at. Depends on the
 * set of records and their radii only, not on their order. Threads: uses all. */
void kl_agreement_shares(const struct kl_record_set *set, float error, float *shares);

#endif
