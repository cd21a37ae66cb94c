#include "src/base/memory.h"
#include "src/device/program_impl.h"

#include <stdlib.h>

enum { DUMMY_BYTES = 64 };

struct kl_device_buffer {
    struct kl_device *device;
    cl_mem mem;
    void *host; /* borrowed; NULL for scratch */
    size_t bytes;
};

static cl_mem_flags buffer_flags(const struct kl_device *device, enum kl_device_access access)
{
    const bool in_place = device->info.shares_memory;

    switch (access) {
    case KL_DEVICE_INPUT:
        return CL_MEM_READ_ONLY | (in_place ? CL_MEM_USE_HOST_PTR : CL_MEM_COPY_HOST_PTR);
    case KL_DEVICE_OUTPUT:
        return CL_MEM_READ_WRITE | (in_place ? CL_MEM_USE_HOST_PTR : 0);
    case KL_DEVICE_SCRATCH:
        break;
    }
    return CL_MEM_READ_WRITE;
}

kl_status kl_device_buffer_create(struct kl_device *device, enum kl_device_access access,
                                  void *host, size_t bytes, struct kl_device_buffer **out,
                                  struct kl_err *err)
{
    struct kl_device_buffer *buffer = NULL;
    cl_int code = CL_SUCCESS;
    kl_status st = kl_alloc_array(&buffer, 1, sizeof *buffer, err);

    if (st != KL_OK) return st;
    cl_mem_flags flags = buffer_flags(device, bytes == 0 ? KL_DEVICE_SCRATCH : access);
    buffer->device = device;
    buffer->host = access == KL_DEVICE_SCRATCH ? NULL : host;
    buffer->bytes = bytes;
    buffer->mem = clCreateBuffer(
        device->context, flags, bytes == 0 ? DUMMY_BYTES : bytes,
        (flags & (CL_MEM_USE_HOST_PTR | CL_MEM_COPY_HOST_PTR)) != 0 ? host : NULL, &code);
    if (code != CL_SUCCESS) {
        free(buffer);
        (void)kl_cl_fail(err, "create buffer", code);
        return kl_wrap(err, "%s: %zu bytes", device->info.name, bytes);
    }
    *out = buffer;
    return KL_OK;
}

kl_status kl_device_buffer_read(struct kl_device_buffer *buffer, struct kl_err *err)
{
    cl_command_queue queue = buffer->device->queue;
    cl_int code = CL_SUCCESS;

    if (buffer->bytes == 0 || buffer->host == NULL) return KL_OK;
    if (!buffer->device->info.shares_memory) {
        code = clEnqueueReadBuffer(queue, buffer->mem, CL_TRUE, 0, buffer->bytes, buffer->host, 0,
                                   NULL, NULL);
        return code == CL_SUCCESS ? KL_OK : kl_cl_fail(err, "read buffer", code);
    }
    /* Mapping is what makes the bytes valid in the host's own memory. */
    void *mapped = clEnqueueMapBuffer(queue, buffer->mem, CL_TRUE, CL_MAP_READ, 0, buffer->bytes, 0,
                                      NULL, NULL, &code);
    if (code != CL_SUCCESS) return kl_cl_fail(err, "map buffer", code);
    code = clEnqueueUnmapMemObject(queue, buffer->mem, mapped, 0, NULL, NULL);
    if (code == CL_SUCCESS) code = clFinish(queue);
    return code == CL_SUCCESS ? KL_OK : kl_cl_fail(err, "unmap buffer", code);
}

void kl_device_buffer_destroy(struct kl_device_buffer *buffer)
{
    if (buffer == NULL) return;
    (void)clReleaseMemObject(buffer->mem);
    free(buffer);
}

static kl_status set_args(cl_kernel kernel, const struct kl_device_arg *args, size_t count,
                          struct kl_err *err)
{
    for (size_t i = 0; i < count; ++i) {
        const struct kl_device_arg *arg = &args[i];
        cl_int code = arg->buffer != NULL
                          ? clSetKernelArg(kernel, (cl_uint)i, sizeof(cl_mem), &arg->buffer->mem)
                          : clSetKernelArg(kernel, (cl_uint)i, arg->size, arg->value);
        if (code == CL_SUCCESS) continue;
        (void)kl_cl_fail(err, "set argument", code);
        return kl_wrap(err, "argument %zu", i);
    }
    return KL_OK;
}

kl_status kl_device_run(struct kl_device_program *program, const char *name,
                        const struct kl_device_arg *args, size_t arg_count, size_t items,
                        size_t group, struct kl_err *err)
{
    cl_command_queue queue = program->device->queue;
    cl_kernel kernel = NULL;

    if (items == 0) return KL_OK;
    kl_status st = kl_device_program_kernel(program, name, &kernel, err);
    if (st == KL_OK) st = set_args(kernel, args, arg_count, err);
    if (st != KL_OK) return kl_wrap(err, "%s", name);
    const size_t global = (items + group - 1) / group * group;
    cl_int code = clEnqueueNDRangeKernel(queue, kernel, 1, NULL, &global, &group, 0, NULL, NULL);
    if (code == CL_SUCCESS) code = clFinish(queue);
    if (code == CL_SUCCESS) return KL_OK;
    (void)kl_cl_fail(err, "run", code);
    return kl_wrap(err, "%s: %s", program->device->info.name, name);
}
