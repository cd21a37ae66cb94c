#include "src/base/memory.h"
#include "src/device/device_impl.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_PLATFORMS = 16, MAX_DEVICES = 64 };

/* Every device of the system, in the order that selectors count. */
struct all_devices {
    size_t count;
    cl_platform_id platform[MAX_DEVICES];
    cl_device_id id[MAX_DEVICES];
};

const char *kl_cl_error_name(cl_int code)
{
    static const struct {
        cl_int code;
        const char *name;
    } names[] = {
        {CL_DEVICE_NOT_FOUND, "CL_DEVICE_NOT_FOUND"},
        {CL_DEVICE_NOT_AVAILABLE, "CL_DEVICE_NOT_AVAILABLE"},
        {CL_COMPILER_NOT_AVAILABLE, "CL_COMPILER_NOT_AVAILABLE"},
        {CL_MEM_OBJECT_ALLOCATION_FAILURE, "CL_MEM_OBJECT_ALLOCATION_FAILURE"},
        {CL_OUT_OF_RESOURCES, "CL_OUT_OF_RESOURCES"},
        {CL_OUT_OF_HOST_MEMORY, "CL_OUT_OF_HOST_MEMORY"},
        {CL_BUILD_PROGRAM_FAILURE, "CL_BUILD_PROGRAM_FAILURE"},
        {CL_MAP_FAILURE, "CL_MAP_FAILURE"},
        {CL_INVALID_VALUE, "CL_INVALID_VALUE"},
        {CL_INVALID_CONTEXT, "CL_INVALID_CONTEXT"},
        {CL_INVALID_COMMAND_QUEUE, "CL_INVALID_COMMAND_QUEUE"},
        {CL_INVALID_MEM_OBJECT, "CL_INVALID_MEM_OBJECT"},
        {CL_INVALID_BUFFER_SIZE, "CL_INVALID_BUFFER_SIZE"},
        {CL_INVALID_BUILD_OPTIONS, "CL_INVALID_BUILD_OPTIONS"},
        {CL_INVALID_KERNEL_NAME, "CL_INVALID_KERNEL_NAME"},
        {CL_INVALID_ARG_INDEX, "CL_INVALID_ARG_INDEX"},
        {CL_INVALID_ARG_VALUE, "CL_INVALID_ARG_VALUE"},
        {CL_INVALID_ARG_SIZE, "CL_INVALID_ARG_SIZE"},
        {CL_INVALID_KERNEL_ARGS, "CL_INVALID_KERNEL_ARGS"},
        {CL_INVALID_WORK_GROUP_SIZE, "CL_INVALID_WORK_GROUP_SIZE"},
    };
    for (size_t i = 0; i < sizeof names / sizeof names[0]; ++i) {
        if (names[i].code == code) return names[i].name;
    }
    return "unknown";
}

kl_status kl_cl_fail(struct kl_err *err, const char *call, cl_int code)
{
    const bool memory = code == CL_OUT_OF_HOST_MEMORY || code == CL_MEM_OBJECT_ALLOCATION_FAILURE;
    return kl_fail(err, memory ? KL_ERR_NO_MEMORY : KL_ERR_DEVICE, "OpenCL: %s: %s (%d)", call,
                   kl_cl_error_name(code), (int)code);
}

/* A platform that answers with an error has no devices: a broken driver must not hide the others.
 * No platform at all is reported as an error by the ICD loader; it means 0 devices. */
static void find_all(struct all_devices *all)
{
    cl_platform_id platforms[MAX_PLATFORMS];
    cl_uint platform_count = 0;

    all->count = 0;
    if (clGetPlatformIDs(MAX_PLATFORMS, platforms, &platform_count) != CL_SUCCESS) return;
    if (platform_count > MAX_PLATFORMS) platform_count = MAX_PLATFORMS;
    for (cl_uint i = 0; i < platform_count; ++i) {
        const cl_uint room = (cl_uint)(MAX_DEVICES - all->count);
        cl_uint found = 0;
        if (room == 0) return;
        if (clGetDeviceIDs(platforms[i], CL_DEVICE_TYPE_ALL, room, all->id + all->count, &found) !=
            CL_SUCCESS) {
            continue;
        }
        if (found > room) found = room;
        for (cl_uint k = 0; k < found; ++k) {
            all->platform[all->count++] = platforms[i];
        }
    }
}

static void get_text(cl_device_id id, cl_device_info what, char *text, size_t size)
{
    text[0] = '\0';
    if (clGetDeviceInfo(id, what, size, text, NULL) != CL_SUCCESS) {
        (void)snprintf(text, size, "?");
    }
    text[size - 1] = '\0';
}

/* 0 if the device does not say. */
static uint64_t get_u64(cl_device_id id, cl_device_info what)
{
    cl_ulong value = 0;
    if (clGetDeviceInfo(id, what, sizeof value, &value, NULL) != CL_SUCCESS) return 0;
    return value;
}

static uint32_t get_u32(cl_device_id id, cl_device_info what)
{
    cl_uint value = 0;
    if (clGetDeviceInfo(id, what, sizeof value, &value, NULL) != CL_SUCCESS) return 0;
    return value;
}

static const char *why_not(cl_device_id id, const struct kl_device_info *info)
{
    unsigned int major = 0, minor = 0;

    if (!get_u32(id, CL_DEVICE_AVAILABLE)) return "not available";
    if (!get_u32(id, CL_DEVICE_COMPILER_AVAILABLE)) return "has no compiler";
    if (!get_u32(id, CL_DEVICE_ENDIAN_LITTLE)) return "is big-endian";
    if (sscanf(info->version, "OpenCL %u.%u", &major, &minor) != 2) return "unknown version";
    if (major < 1 || (major == 1 && minor < 2)) return "older than OpenCL 1.2";
    return NULL;
}

static void describe(cl_platform_id platform, cl_device_id id, struct kl_device_info *info)
{
    const uint64_t type = get_u64(id, CL_DEVICE_TYPE);

    memset(info, 0, sizeof *info);
    get_text(id, CL_DEVICE_NAME, info->name, sizeof info->name);
    get_text(id, CL_DEVICE_VERSION, info->version, sizeof info->version);
    get_text(id, CL_DRIVER_VERSION, info->driver, sizeof info->driver);
    if (clGetPlatformInfo(platform, CL_PLATFORM_NAME, sizeof info->platform, info->platform,
                          NULL) != CL_SUCCESS) {
        (void)snprintf(info->platform, sizeof info->platform, "?");
    }
    (void)snprintf(info->type, sizeof info->type, "%s",
                   (type & CL_DEVICE_TYPE_GPU) != 0           ? "gpu"
                   : (type & CL_DEVICE_TYPE_CPU) != 0         ? "cpu"
                   : (type & CL_DEVICE_TYPE_ACCELERATOR) != 0 ? "accelerator"
                                                              : "other");
    info->memory_bytes = get_u64(id, CL_DEVICE_GLOBAL_MEM_SIZE);
    info->largest_bytes = get_u64(id, CL_DEVICE_MAX_MEM_ALLOC_SIZE);
    info->compute_units = get_u32(id, CL_DEVICE_MAX_COMPUTE_UNITS);
    info->shares_memory = (type & CL_DEVICE_TYPE_CPU) != 0;
    const char *reason = why_not(id, info);
    info->usable = reason == NULL;
    (void)snprintf(info->reason, sizeof info->reason, "%s", reason != NULL ? reason : "");
}

kl_status kl_device_list(struct kl_device_info **out, size_t *count, struct kl_err *err)
{
    struct all_devices all;
    struct kl_device_info *infos = NULL;

    find_all(&all);
    kl_status st = kl_alloc_array(&infos, all.count, sizeof *infos, err);
    if (st != KL_OK) return st;
    for (size_t i = 0; i < all.count; ++i) {
        describe(all.platform[i], all.id[i], &infos[i]);
    }
    *out = infos;
    *count = all.count;
    return KL_OK;
}

/* *number is SIZE_MAX for "opencl". */
static kl_status parse_selector(const char *selector, size_t *number, struct kl_err *err)
{
    const char *prefix = "opencl";
    char *end = NULL;

    *number = SIZE_MAX;
    if (strcmp(selector, prefix) == 0) return KL_OK;
    if (strncmp(selector, "opencl:", 7) == 0 && selector[7] >= '0' && selector[7] <= '9') {
        errno = 0;
        const unsigned long n = strtoul(selector + 7, &end, 10);
        if (errno == 0 && *end == '\0' && n < MAX_DEVICES) {
            *number = n;
            return KL_OK;
        }
    }
    return kl_fail(err, KL_ERR_USAGE, "device \"%s\": expected opencl or opencl:N with N < %d",
                   selector, MAX_DEVICES);
}

static kl_status choose(const struct all_devices *all, size_t number, size_t *chosen,
                        struct kl_err *err)
{
    struct kl_device_info info;
    bool found = false;

    if (number != SIZE_MAX) {
        if (number >= all->count) {
            return kl_fail(err, KL_ERR_DEVICE, "no OpenCL device %zu: there are %zu", number,
                           all->count);
        }
        describe(all->platform[number], all->id[number], &info);
        if (!info.usable) {
            return kl_fail(err, KL_ERR_DEVICE, "OpenCL device %zu (%s): %s", number, info.name,
                           info.reason);
        }
        *chosen = number;
        return KL_OK;
    }
    for (size_t i = 0; i < all->count; ++i) {
        describe(all->platform[i], all->id[i], &info);
        if (!info.usable) continue;
        const bool gpu = strcmp(info.type, "gpu") == 0;
        if (!found || gpu) *chosen = i;
        found = true;
        if (gpu) break;
    }
    if (!found) {
        return kl_fail(err, KL_ERR_DEVICE, "no usable OpenCL device among %zu", all->count);
    }
    return KL_OK;
}

kl_status kl_device_open(const char *selector, struct kl_device **out, struct kl_err *err)
{
    struct all_devices all;
    struct kl_device *device = NULL;
    size_t number = 0, chosen = 0;
    cl_int code = CL_SUCCESS;
    kl_status st = parse_selector(selector, &number, err);

    if (st != KL_OK) return st;
    find_all(&all);
    st = choose(&all, number, &chosen, err);
    if (st == KL_OK) st = kl_alloc_array(&device, 1, sizeof *device, err);
    if (st != KL_OK) return st;
    device->id = all.id[chosen];
    describe(all.platform[chosen], device->id, &device->info);
    device->exact_division = (get_u64(device->id, CL_DEVICE_SINGLE_FP_CONFIG) &
                              CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT) != 0;
    const cl_context_properties properties[] = {CL_CONTEXT_PLATFORM,
                                                (cl_context_properties)all.platform[chosen], 0};
    device->context = clCreateContext(properties, 1, &device->id, NULL, NULL, &code);
    if (code != CL_SUCCESS) {
        st = kl_cl_fail(err, "create context", code);
    } else {
        device->queue = clCreateCommandQueue(device->context, device->id, 0, &code);
        if (code != CL_SUCCESS) st = kl_cl_fail(err, "create queue", code);
    }
    if (st != KL_OK) {
        (void)kl_wrap(err, "%s", device->info.name);
        kl_device_close(device);
        return st;
    }
    *out = device;
    return KL_OK;
}

void kl_device_close(struct kl_device *device)
{
    if (device == NULL) return;
    if (device->queue != NULL) (void)clReleaseCommandQueue(device->queue);
    if (device->context != NULL) (void)clReleaseContext(device->context);
    free(device);
}

const struct kl_device_info *kl_device_get_info(const struct kl_device *device)
{
    return &device->info;
}
