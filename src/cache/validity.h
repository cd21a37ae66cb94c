/* Validity clamping (after Frolov et al., "Irradiance caching in a GPU photorealistic renderer"): a
 * record need not reach far into what nearer records serve. Fewer records then answer a query, and
 * nothing that was served is without. */
#ifndef KL_SRC_CACHE_VALIDITY_H
#define KL_SRC_CACHE_VALIDITY_H

#include "kernels/cache_query.h"
#include "src/cache/record.h"

/* For every record of an indexed level, the radius [m] that it needs at most. Depends on the set of
 * records and their radii only, not on their order. Threads: uses all. */
void kl_validity_limits(const kl_level_view *level, float *limits);

#endif
