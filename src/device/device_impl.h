/* Private to src/device: the only place with OpenCL's types. */
#ifndef KL_SRC_DEVICE_DEVICE_IMPL_H
#define KL_SRC_DEVICE_DEVICE_IMPL_H

#include "src/device/device.h"

#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>

struct kl_device {
    struct kl_device_info info;
    bool exact_division; /* correctly rounded division and square root can be had */
    cl_device_id id;
    cl_context context;
    cl_command_queue queue;
};

/* Name of an OpenCL error, "unknown" for a vendor's own. */
const char *kl_cl_error_name(cl_int code);

/* "call: CL_NAME (code)" as KL_ERR_DEVICE, out of memory as KL_ERR_NO_MEMORY. */
kl_status kl_cl_fail(struct kl_err *err, const char *call, cl_int code);

#endif
