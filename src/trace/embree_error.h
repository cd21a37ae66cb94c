/* Embree's error reports as kl_status. Private to src/trace. */
#ifndef KL_SRC_TRACE_EMBREE_ERROR_H
#define KL_SRC_TRACE_EMBREE_ERROR_H

#include "src/base/status.h"

#include <embree3/rtcore.h>

/* The text of the first error since it was last taken. Written by the thread that builds. */
struct kl_embree_error {
    enum RTCError code;
    char text[256];
};

/* Open a device whose builds run on one thread, so that a tree, and with it the choice among hits
 * at equal distance, does not depend on the number of threads. `report` must outlive the device. */
kl_status kl_embree_open(struct kl_embree_error *report, RTCDevice *out,
                         struct kl_err *err) KL_MUST_CHECK;

/* KL_OK if nothing was reported; else the report as a status, and the report is cleared. */
kl_status kl_embree_check(struct kl_embree_error *report, const char *what,
                          struct kl_err *err) KL_MUST_CHECK;

#endif
