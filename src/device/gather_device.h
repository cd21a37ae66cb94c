/* Batches of gathers on an OpenCL device: the same job as kl_gather_host of src/device/gather.h. */
#ifndef KL_SRC_DEVICE_GATHER_DEVICE_H
#define KL_SRC_DEVICE_GATHER_DEVICE_H

#include "src/device/device.h"
#include "src/device/gather.h"
#include "src/scene/motion.h"

/* One scene on one device. Threads: one at a time. */
struct kl_gather_device;

/* Opens the device that `selector` names (kl_device_open), builds its trees, compiles the kernels
 * for what the scene needs and uploads the scene. The flat scene and its motion (NULL: nothing
 * moves) are borrowed and stay unchanged until destroy; the view's bvh_* are set. Takes seconds the
 * first time a scene's needs are compiled. */
kl_status kl_gather_device_create(const char *selector, struct kl_flat *flat,
                                  struct kl_motion *motion, struct kl_gather_device **out,
                                  struct kl_err *err) KL_MUST_CHECK;
void kl_gather_device_destroy(struct kl_gather_device *gather); /* accepts NULL */
const struct kl_device_info *kl_gather_device_get_info(const struct kl_gather_device *gather);

/* A kl_gather_fn of src/render/fill.h: `context` is the struct kl_gather_device, job->scene is the
 * view of its scene. The same job gives the same results every time; they differ from the
 * host's by rounding. On failure results are undefined: gather the job on the host. */
kl_status kl_gather_device_run(void *context, const struct kl_gather_job *job,
                               struct kl_err *err) KL_MUST_CHECK;

/* Single rays on the device, as kl_gather_host_picks. */
kl_status kl_gather_device_picks(struct kl_gather_device *gather,
                                 const struct kl_gather_picks *picks,
                                 struct kl_err *err) KL_MUST_CHECK;

#endif
