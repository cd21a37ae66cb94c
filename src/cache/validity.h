/* Validity clamping (after Frolov et al., "Irradiance caching in a GPU photorealistic renderer"): a
 * record need not reach far into what nearer records serve. Fewer records then answer a query, and
 * what was served still is, but for slivers at edges: a few points of 100 000. */
#ifndef KL_SRC_CACHE_VALIDITY_H
#define KL_SRC_CACHE_VALIDITY_H

#include "src/cache/record_set.h"

/* For every record of a set, the radius [m] that it needs at most beside the KL_NEAREST_MOST
 * nearest. Depends on the set of
 * records and their radii only, not on their order. Threads: uses all. */
void kl_validity_limits(const struct kl_record_set *set, float *limits);

#endif
