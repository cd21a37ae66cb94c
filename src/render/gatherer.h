/* Private to src/render: who gathers, chosen by name. */
#ifndef KL_SRC_RENDER_GATHERER_H
#define KL_SRC_RENDER_GATHERER_H

#include "src/device/gather.h"
#include "src/scene/motion.h"

struct kl_gatherer;

/* `device`: "embree", "opencl", "opencl:N", or "auto" (NULL): a GPU where there is one, else
 * Embree, which is the faster of the two on a processor (docs/benchmarks.md). Never decided by the
 * clock, so that the same machine gives the same records. The flat scene, its motion (NULL: nothing
 * moves) and their tracer stay until the gatherer is destroyed. */
kl_status kl_gatherer_create(const char *device, struct kl_flat *flat, struct kl_motion *motion,
                             struct kl_gatherer **out, struct kl_err *err) KL_MUST_CHECK;
void kl_gatherer_destroy(struct kl_gatherer *gatherer); /* accepts NULL */
const char *kl_gatherer_get_name(const struct kl_gatherer *gatherer);
/* A kl_gather_fn of src/render/fill.h; context: struct kl_gatherer. */
kl_status kl_gatherer_run(void *context, const struct kl_gather_job *job, struct kl_err *err);
/* Single rays, by whom records are gathered. */
kl_status kl_gatherer_run_picks(struct kl_gatherer *gatherer, const struct kl_gather_picks *picks,
                                struct kl_err *err) KL_MUST_CHECK;

#endif
