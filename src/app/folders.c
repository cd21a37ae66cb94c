#include "src/app/folders.h"

#include "src/base/memory.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static kl_status make_folder(const char *path, struct kl_err *err)
{
    if (mkdir(path, 0777) == 0 || kl_folder_is(path)) return KL_OK;
    return kl_fail_errno(err, "create folder %s", path);
}

kl_status kl_folders_make(const char *path, bool itself, struct kl_err *err)
{
    char *copy = NULL;
    kl_status st = kl_copy_string(&copy, path, err);

    if (st != KL_OK) return st;
    for (char *c = copy; st == KL_OK && *c != '\0'; ++c) {
        if (*c != '/' || c == copy) continue;
        *c = '\0';
        st = make_folder(copy, err);
        *c = '/';
    }
    if (st == KL_OK && itself) st = make_folder(copy, err);
    free(copy);
    return st;
}

bool kl_folder_is(const char *path)
{
    struct stat info;
    return stat(path, &info) == 0 && S_ISDIR(info.st_mode);
}

kl_status kl_file_expect(const char *path, const char *option, struct kl_err *err)
{
    if (access(path, F_OK) == 0) return KL_OK;
    return kl_fail(err, KL_ERR_INPUT, "%s%s: no such file", option, path);
}

size_t kl_path_folder_length(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash == NULL ? 0 : (size_t)(slash - path) + 1;
}

static size_t stem_length(const char *name)
{
    const char *dot = strrchr(name, '.');
    return dot == NULL || dot == name ? strlen(name) : (size_t)(dot - name);
}

kl_status kl_path_get_stem(const char *path, char *out, size_t size, struct kl_err *err)
{
    const char *name = path + kl_path_folder_length(path);
    const size_t length = stem_length(name);

    if (length >= size) return kl_fail(err, KL_ERR_USAGE, "%s: the name is too long", path);
    memcpy(out, name, length);
    out[length] = '\0';
    return KL_OK;
}

kl_status kl_path_with_extension(const char *path, const char *extension, char *out, size_t size,
                                 struct kl_err *err)
{
    const size_t folder = kl_path_folder_length(path);
    const size_t length = folder + stem_length(path + folder);
    const int n = snprintf(out, size, "%.*s.%s", (int)length, path, extension);

    if (n < 0 || (size_t)n >= size) {
        return kl_fail(err, KL_ERR_USAGE, "%s: the name is too long", path);
    }
    return KL_OK;
}
