/* Rays on the host: an Embree scene over the flat scene. It answers kl_trace_closest and
 * kl_trace_any of kernels/trace.h through kl_scene_view.tracer. */
#ifndef KL_SRC_TRACE_TRACER_H
#define KL_SRC_TRACE_TRACER_H

#include "src/base/status.h"
#include "src/scene/flat.h"
#include "src/scene/motion.h"

/* Threads: any number may trace at once; create and destroy belong to one thread. Which of several
 * hits at exactly the same distance is reported depends on the scene alone, not on threads. */
struct kl_tracer;

/* Builds the acceleration structures and sets flat->view.tracer. They borrow the flat scene's
 * positions, triangles and instances: keep those unchanged until kl_tracer_destroy. *out is the
 * caller's. Scenes without triangles or instances are fine: nothing is hit.
 * KL_ERR_DEVICE: Embree refused, the message carries its text. KL_ERR_NO_MEMORY. */
kl_status kl_tracer_create(struct kl_flat *flat, struct kl_tracer **out,
                           struct kl_err *err) KL_MUST_CHECK;

/* The same in motion: rays meet things where these are at the rays' times. Sets the tracer of the
 * motion's views too; hits are in their instances, so flat->view must not trace. Borrows both. */
kl_status kl_tracer_create_moving(struct kl_flat *flat, struct kl_motion *motion,
                                  struct kl_tracer **out, struct kl_err *err) KL_MUST_CHECK;

/* Accepts NULL. Views that still point to the tracer must not trace any more. */
void kl_tracer_destroy(struct kl_tracer *tracer);

#endif
