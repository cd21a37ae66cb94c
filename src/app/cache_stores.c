#include "src/app/cache_stores.h"

#include "src/app/folders.h"
#include "src/base/memory.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PATH_SIZE = 4096 };

void kl_cache_stores_fini(struct kl_cache_stores *stores)
{
    for (size_t i = 0; i < stores->count; ++i) {
        free(stores->paths[i]);
    }
    free(stores->paths);
}

static kl_status add_store(struct kl_cache_stores *stores, const char *path, struct kl_err *err)
{
    kl_status st = kl_grow_array(&stores->paths, &stores->capacity, stores->count + 1,
                                 sizeof *stores->paths, err);
    if (st == KL_OK) st = kl_copy_string(&stores->paths[stores->count], path, err);
    if (st == KL_OK) ++stores->count;
    return st;
}

static int compare_paths(const void *a, const void *b)
{
    char *const *x = a;
    char *const *y = b;
    return strcmp(*x, *y);
}

kl_status kl_cache_stores_find(const char *dir, struct kl_cache_stores *out, struct kl_err *err)
{
    DIR *folder = opendir(dir);
    const struct dirent *entry = NULL;
    kl_status st = KL_OK;

    if (folder == NULL) {
        return kl_fail(err, KL_ERR_INPUT, "%s: not a folder that can be read", dir);
    }
    while (st == KL_OK &&
           (entry = readdir(folder)) != NULL) { /* NOLINT(concurrency-mt-unsafe): own stream */
        char path[PATH_SIZE];
        const int n = snprintf(path, sizeof path, "%s/%s", dir, entry->d_name);
        if (n < 0 || (size_t)n >= sizeof path || strncmp(entry->d_name, "t-", 2) != 0) continue;
        if (kl_folder_is(path)) st = add_store(out, path, err);
    }
    (void)closedir(folder);
    if (st == KL_OK && out->count == 0) st = add_store(out, dir, err);
    if (st == KL_OK) qsort(out->paths, out->count, sizeof *out->paths, compare_paths);
    return st;
}
