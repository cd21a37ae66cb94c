#include "src/device/program_impl.h"

#include "src/base/file.h"
#include "src/base/memory.h"
#include "src/device/kernel_sources.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* The build log, zero-terminated, or NULL. free() it. */
static char *get_log(const struct kl_device *device, cl_program program)
{
    struct kl_err ignored = {0};
    size_t size = 0;
    char *log = NULL;

    if (clGetProgramBuildInfo(program, device->id, CL_PROGRAM_BUILD_LOG, 0, NULL, &size) !=
            CL_SUCCESS ||
        kl_alloc_array(&log, size + 1, 1, &ignored) != KL_OK) {
        return NULL;
    }
    if (clGetProgramBuildInfo(program, device->id, CL_PROGRAM_BUILD_LOG, size, log, NULL) !=
        CL_SUCCESS) {
        log[0] = '\0';
    }
    return log;
}

/* Source, then options and log behind it as a comment, to a file in the temporary directory;
 * `path` becomes "" if that fails, for the log in the message matters more. */
static void save_source(const char *file, const char *source, const char *options, const char *log,
                        char *path, size_t path_size)
{
    const char *dir = getenv("TMPDIR");
    const char *base = strrchr(file, '/');
    struct kl_err ignored = {0};
    char *text = NULL;
    const size_t size = strlen(source) + strlen(options) + strlen(log) + 64;

    (void)snprintf(path, path_size, "%s/keeplight-%ld-%s", dir != NULL ? dir : "/tmp",
                   (long)getpid(), base != NULL ? base + 1 : file);
    if (kl_alloc_array(&text, size, 1, &ignored) == KL_OK) {
        const int n =
            snprintf(text, size, "%s\n#if 0\noptions: %s\n%s\n#endif\n", source, options, log);
        if (kl_file_replace(path, text, (size_t)n, &ignored) != KL_OK) path[0] = '\0';
    } else {
        path[0] = '\0';
    }
    free(text);
}

/* The first error line of a log, so that a short message has what matters. */
static const char *first_error(const char *log)
{
    const char *error = strstr(log, "error");

    if (error == NULL) return log;
    while (error > log && error[-1] != '\n') {
        --error;
    }
    return error;
}

static kl_status fail_build(const struct kl_device *device, cl_program program, const char *file,
                            const char *source, const char *options, cl_int code,
                            struct kl_err *err)
{
    char path[256];
    char *log = get_log(device, program);
    const char *text = log != NULL ? log : "no log";

    save_source(file, source, options, text, path, sizeof path);
    kl_status st =
        kl_fail(err, KL_ERR_DEVICE,
                "%s: the compiler of %.60s refused it: %s; options \"%s\"; source in %s; %.160s",
                file, device->info.name, kl_cl_error_name(code), options,
                path[0] != '\0' ? path : "no file", first_error(text));
    free(log);
    return st;
}

static kl_status build(struct kl_device_program *program, const char *file, const char *source,
                       uint32_t features, struct kl_err *err)
{
    const struct kl_device *device = program->device;
    char options[128];
    cl_int code = CL_SUCCESS;

    (void)snprintf(options, sizeof options, "-cl-std=CL1.2 -DKL_FEATURES=0x%xu%s", features,
                   device->exact_division ? " -cl-fp32-correctly-rounded-divide-sqrt" : "");
    program->program = clCreateProgramWithSource(device->context, 1, &source, NULL, &code);
    if (code != CL_SUCCESS) return kl_cl_fail(err, "create program", code);
    code = clBuildProgram(program->program, 1, &device->id, options, NULL, NULL);
    if (code == CL_SUCCESS) return KL_OK;
    return fail_build(device, program->program, file, source, options, code, err);
}

kl_status kl_device_program_create(struct kl_device *device, const char *file, uint32_t features,
                                   struct kl_device_program **out, struct kl_err *err)
{
    struct kl_device_program *program = NULL;
    char *source = NULL;
    const char *dir = getenv("KEEPLIGHT_KERNEL_DIR");
    kl_status st = kl_alloc_array(&program, 1, sizeof *program, err);

    if (st != KL_OK) return st;
    program->device = device;
    st = kl_kernel_assemble(file, dir != NULL && dir[0] != '\0' ? dir : NULL, &source, err);
    if (st == KL_OK) st = build(program, file, source, features, err);
    free(source);
    if (st != KL_OK) {
        kl_device_program_destroy(program);
        return st;
    }
    *out = program;
    return KL_OK;
}

void kl_device_program_destroy(struct kl_device_program *program)
{
    if (program == NULL) return;
    for (size_t i = 0; i < program->kernel_count; ++i) {
        (void)clReleaseKernel(program->kernels[i].kernel);
    }
    if (program->program != NULL) (void)clReleaseProgram(program->program);
    free(program);
}

kl_status kl_device_program_kernel(struct kl_device_program *program, const char *name,
                                   cl_kernel *out, struct kl_err *err)
{
    const size_t n = program->kernel_count;
    cl_int code = CL_SUCCESS;

    for (size_t i = 0; i < n; ++i) {
        if (strcmp(program->kernels[i].name, name) != 0) continue;
        *out = program->kernels[i].kernel;
        return KL_OK;
    }
    if (n == KL_MAX_KERNELS || strlen(name) >= sizeof program->kernels[0].name) {
        return kl_fail(err, KL_ERR_DEVICE, "kernel %s: too many or too long a name", name);
    }
    cl_kernel kernel = clCreateKernel(program->program, name, &code);
    if (code != CL_SUCCESS) {
        (void)kl_cl_fail(err, "create kernel", code);
        return kl_wrap(err, "%s", name);
    }
    (void)snprintf(program->kernels[n].name, sizeof program->kernels[n].name, "%s", name);
    program->kernels[n].kernel = kernel;
    program->kernel_count = n + 1;
    *out = kernel;
    return KL_OK;
}
