/* OpenCL devices: find one, compile the kernels for a scene, run batches.
 *
 * Threads: a device and everything made from it belong to one thread at a time. Objects made from a
 * device are destroyed before it is closed. A device that fails reports KL_ERR_DEVICE from then on;
 * the caller goes on with the host. */
#ifndef KL_SRC_DEVICE_DEVICE_H
#define KL_SRC_DEVICE_DEVICE_H

#include "src/base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct kl_device_info {
    char name[128], platform[128], version[128], driver[64];
    char type[16];          /* "cpu", "gpu", "accelerator" or "other" */
    uint64_t memory_bytes;  /* global memory */
    uint64_t largest_bytes; /* largest single buffer */
    uint32_t compute_units;
    bool shares_memory; /* a CPU: buffers use the caller's memory */
    bool usable;
    char reason[128]; /* why not, if not usable */
};

/* All devices of all platforms, in the system's order; number N is "opencl:N". *out is the
 * caller's: free(). No platform at all is KL_OK with *count 0. */
kl_status kl_device_list(struct kl_device_info **out, size_t *count,
                         struct kl_err *err) KL_MUST_CHECK;

struct kl_device;

/* `selector`: "opencl" (the first usable GPU, else the first usable device) or "opencl:N".
 * KL_ERR_USAGE: another text. KL_ERR_DEVICE: no such device or it is not usable. */
kl_status kl_device_open(const char *selector, struct kl_device **out,
                         struct kl_err *err) KL_MUST_CHECK;
void kl_device_close(struct kl_device *device); /* accepts NULL */
const struct kl_device_info *kl_device_get_info(const struct kl_device *device);

/* A .cl file compiled for a set of features. */
struct kl_device_program;

/* `file`: as "kernels/trace.cl". `features`: KL_NEED_* of the scene. Sources are those built into
 * the program, or, if the environment has KEEPLIGHT_KERNEL_DIR, the files of that directory
 * ("kernels/x.h" is its x.h). If the compiler refuses, the message has device, options and the
 * log's beginning, and names a file with the whole source and log. */
kl_status kl_device_program_create(struct kl_device *device, const char *file, uint32_t features,
                                   struct kl_device_program **out,
                                   struct kl_err *err) KL_MUST_CHECK;
void kl_device_program_destroy(struct kl_device_program *program); /* accepts NULL */

/* Memory that kernels see. */
struct kl_device_buffer;
enum kl_device_access { KL_DEVICE_INPUT, KL_DEVICE_OUTPUT, KL_DEVICE_SCRATCH };

/* INPUT: `host` is read now, or in place where the device shares memory: it stays unchanged until
 * destroy. OUTPUT: kernels write, kl_device_buffer_read brings the bytes to `host`; INPUT's
 * lifetime rule holds. SCRATCH: stays on the device, `host` is NULL. 0 bytes give a small dummy, so
 * that absent arrays can be arguments. */
kl_status kl_device_buffer_create(struct kl_device *device, enum kl_device_access access,
                                  void *host, size_t bytes, struct kl_device_buffer **out,
                                  struct kl_err *err) KL_MUST_CHECK;
kl_status kl_device_buffer_read(struct kl_device_buffer *buffer, struct kl_err *err) KL_MUST_CHECK;
void kl_device_buffer_destroy(struct kl_device_buffer *buffer); /* accepts NULL */

/* One argument of a kernel: a buffer, or `size` bytes at `value`; both borrowed for the call. */
struct kl_device_arg {
    const struct kl_device_buffer *buffer; /* NULL: value */
    const void *value;
    size_t size;
};

/* Runs `kernel` over at least `items` work-items in groups of `group` (kernels compare their id
 * with a count) and waits for the end. 0 items: nothing happens. */
kl_status kl_device_run(struct kl_device_program *program, const char *kernel,
                        const struct kl_device_arg *args, size_t arg_count, size_t items,
                        size_t group, struct kl_err *err) KL_MUST_CHECK;

#endif
