#include "src/app/vdb_module.h"

#include "src/app/folders.h"
#include "src/base/file.h"

#include <dlfcn.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

enum { PATH_SIZE = 4096 };

/* Stays loaded: the library has threads of its own. */
static kl_status load(kl_vdb_write_fn *out, struct kl_err *err)
{
    static const char *const places[] = {"keeplight-vdb.so", "../lib/keeplight/keeplight-vdb.so"};
    char program[PATH_SIZE];
    void *module = NULL;
    const ssize_t n = readlink("/proc/self/exe", program, sizeof program - 1);

    if (n <= 0) return kl_fail_errno(err, "/proc/self/exe");
    program[n] = '\0';
    for (int i = 0; i < 2 && module == NULL; ++i) {
        char path[PATH_SIZE + 64];
        (void)snprintf(path, sizeof path, "%.*s%s", (int)kl_path_folder_length(program), program,
                       places[i]);
        module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    }
    if (module == NULL) return kl_fail(err, KL_ERR_IO, "no OpenVDB: %s", dlerror());
    void *symbol = dlsym(module, "kl_vdb_write");
    if (symbol == NULL) return kl_fail(err, KL_ERR_IO, "no OpenVDB: %s", dlerror());
    memcpy(out, &symbol, sizeof *out); /* POSIX: both are of one size */
    return KL_OK;
}

kl_status kl_vdb_module_write(const char *path, const struct kl_vdb_points *points,
                              struct kl_err *err)
{
    kl_vdb_write_fn write = NULL;
    struct kl_file_temp temp;
    char temp_path[PATH_SIZE];
    char message[256] = "";
    kl_status st = load(&write, err);

    if (st == KL_OK) st = kl_file_temp_open(path, &temp, err);
    if (st != KL_OK) return st;
    const int n = snprintf(temp_path, sizeof temp_path, "%.*s%s", (int)kl_path_folder_length(path),
                           path, temp.temp);
    if (n < 0 || (size_t)n >= sizeof temp_path) {
        st = kl_fail(err, KL_ERR_USAGE, "%s: the name is too long", path);
    } else if (write(temp_path, points, message, sizeof message) != 0) {
        st = kl_fail(err, KL_ERR_IO, "%s: %s", path, message);
    }
    if (st == KL_OK) return kl_file_temp_commit(&temp, err);
    kl_file_temp_discard(&temp);
    return st;
}
