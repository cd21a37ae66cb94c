/* Names in a store's directory. */
#include "cache_io/store_impl.h"
#include "src/base/file.h"
#include "src/base/file_calls.h"
#include "src/base/memory.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>

kl_status store_for_each_name(int dir_fd,
                              kl_status (*visit)(void *context, const char *name,
                                                 struct kl_err *err),
                              void *context, struct kl_err *err)
{
    kl_status st = KL_OK;
    const int fd = kl_file_open_at(dir_fd, ".", O_RDONLY | O_DIRECTORY);

    if (fd < 0) return kl_fail_errno(err, "list");
    DIR *dir = fdopendir(fd);
    if (dir == NULL) {
        st = kl_fail_errno(err, "list");
        (void)kl_file_calls->close(fd);
        return st;
    }
    while (st == KL_OK) {
        errno = 0;
        const struct dirent *entry = kl_file_calls->read_dir(dir);
        if (entry == NULL && errno == EINTR) continue;
        if (entry == NULL && errno != 0) st = kl_fail_errno(err, "list");
        if (entry == NULL) break;
        st = visit(context, entry->d_name, err);
    }
    (void)closedir(dir);
    return st;
}

static kl_status take_segment(void *context, const char *name, struct kl_err *err)
{
    struct id_list *list = context;
    struct segment_id id;

    if (!segment_id_parse(name, &id)) return KL_OK;
    kl_status st =
        kl_grow_array(&list->ids, &list->capacity, list->count + 1, sizeof *list->ids, err);
    if (st == KL_OK) list->ids[list->count++] = id;
    return st;
}

kl_status store_list(int dir_fd, struct id_list *out, struct kl_err *err)
{
    out->count = 0;
    kl_status st = store_for_each_name(dir_fd, take_segment, out, err);
    /* Sorted, so that what is opened first does not depend on the file system. */
    if (out->count > 1) qsort(out->ids, out->count, sizeof *out->ids, segment_id_compare);
    return st;
}
