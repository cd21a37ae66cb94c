/* References: irradiance at points, gathered until its noise is small, however many rays it takes.
 */
#ifndef KL_SRC_RENDER_REFERENCE_H
#define KL_SRC_RENDER_REFERENCE_H

#include "src/render/fill.h"

/* Gather as the job says. Where the last step of its ladder leaves more noise than the ladder
 * tolerates, the mean with up to seven more such gathers, by other rays, is the result; only `irr`
 * and `error` are means then. *rays: first ones of all gathers, to which they are added. The same
 * points give the same results. */
kl_status kl_reference_gather(const struct kl_gather_job *job, kl_gather_fn gather_batch,
                              void *gather_context, uint64_t *rays,
                              struct kl_err *err) KL_MUST_CHECK;

#endif
