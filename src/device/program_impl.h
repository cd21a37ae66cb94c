/* Private to src/device. */
#ifndef KL_SRC_DEVICE_PROGRAM_IMPL_H
#define KL_SRC_DEVICE_PROGRAM_IMPL_H

#include "src/device/device_impl.h"

enum { KL_MAX_KERNELS = 8 };

struct kl_device_program {
    struct kl_device *device;
    cl_program program;
    size_t kernel_count;
    struct {
        char name[64];
        cl_kernel kernel;
    } kernels[KL_MAX_KERNELS]; /* made when first run */
};

/* Borrowed until the program's end. */
kl_status kl_device_program_kernel(struct kl_device_program *program, const char *name,
                                   cl_kernel *out, struct kl_err *err) KL_MUST_CHECK;

#endif
