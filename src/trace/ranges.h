/* Which instances share their triangles. Private to src/trace. */
#ifndef KL_SRC_TRACE_RANGES_H
#define KL_SRC_TRACE_RANGES_H

#include "src/base/status.h"
#include "src/scene/flat.h"

struct kl_range {
    uint32_t first, count, instance;
};

/* The triangle ranges of instances 1 and up, without empty ones, ordered so that equal ranges are
 * neighbours. *out is the caller's: free(). */
kl_status kl_ranges_sorted(const struct kl_flat *flat, struct kl_range **out, size_t *out_count,
                           struct kl_err *err) KL_MUST_CHECK;

/* End of the run of equal ranges that starts at `begin`. */
size_t kl_ranges_run_end(const struct kl_range *ranges, size_t count, size_t begin);

#endif
