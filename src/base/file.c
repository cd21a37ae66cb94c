#include "src/base/file.h"

#include "src/base/file_calls.h"
#include "src/base/memory.h"

#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

int kl_file_open_at(int dir_fd, const char *path, int flags)
{
    int fd = -1;

    do {
        fd = kl_file_calls->open_at(dir_fd, path, flags | O_CLOEXEC, 0644);
    } while (fd < 0 && errno == EINTR);
    return fd;
}

int kl_file_sync(int fd)
{
    int failed = 0;

    do {
        failed = kl_file_calls->sync(fd);
    } while (failed != 0 && errno == EINTR);
    return failed != 0 && errno == EINVAL ? 0 : failed;
}

kl_status kl_file_write_all(int fd, const void *data, size_t size, struct kl_err *err)
{
    const char *next = data;

    while (size > 0) {
        const ssize_t n = kl_file_calls->write(fd, next, size);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return kl_fail_errno(err, "write of %zu bytes", size);
        if (n == 0) return kl_fail(err, KL_ERR_IO, "write of %zu bytes: nothing is taken", size);
        next += n;
        size -= (size_t)n;
    }
    return KL_OK;
}

static kl_status read_all(int fd, const char *path, char *data, size_t size, struct kl_err *err)
{
    size_t done = 0;

    while (done < size) {
        const ssize_t n = kl_file_calls->read(fd, data + done, size - done);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return kl_fail_errno(err, "read %s", path);
        if (n == 0) {
            return kl_fail(err, KL_ERR_IO, "%s: ends after %zu of %zu bytes", path, done, size);
        }
        done += (size_t)n;
    }
    return KL_OK;
}

kl_status kl_file_read(const char *path, size_t limit, char **out, size_t *size, struct kl_err *err)
{
    int64_t changed = 0;

    return kl_file_read_at(AT_FDCWD, path, limit, out, size, &changed, err);
}

kl_status kl_file_read_at(int dir_fd, const char *path, size_t limit, char **out, size_t *size,
                          int64_t *changed, struct kl_err *err)
{
    kl_status st = KL_OK;
    char *data = NULL;
    struct stat info;
    const int fd = kl_file_open_at(dir_fd, path, O_RDONLY | O_NONBLOCK); /* pipes do not wait */

    if (fd < 0) {
        st = kl_fail_errno(err, "open %s", path);
        if (err->os_error == ENOENT || err->os_error == ENOTDIR) st = err->status = KL_ERR_INPUT;
        return st;
    }
    if (kl_file_calls->stat(fd, &info) != 0) {
        st = kl_fail_errno(err, "stat %s", path);
        goto cleanup;
    }
    if (!S_ISREG(info.st_mode)) {
        st = kl_fail(err, KL_ERR_INPUT, "%s: not a regular file", path);
        goto cleanup;
    }
    if ((uint64_t)info.st_size > limit) {
        st = kl_fail(err, KL_ERR_INPUT, "%s: %lld bytes, at most %zu are read", path,
                     (long long)info.st_size, limit);
        goto cleanup;
    }
    st = kl_alloc_array(&data, (size_t)info.st_size + 1, 1, err);
    if (st != KL_OK) goto cleanup;
    st = read_all(fd, path, data, (size_t)info.st_size, err);
    if (st != KL_OK) goto cleanup;
    *out = data;
    *size = (size_t)info.st_size;
    *changed = (int64_t)info.st_mtime;
    data = NULL;

cleanup:
    free(data);
    (void)kl_file_calls->close(fd);
    return st;
}

/* A process of the same number, killed earlier or on another machine, may have left a temp file
 * behind: another number is taken, never its file. */
static int open_unused(struct kl_file_temp *file)
{
    const long pid = (long)getpid();

    for (int attempt = 0; attempt < 100; ++attempt) {
        char suffix[32] = "";
        if (attempt > 0) (void)snprintf(suffix, sizeof suffix, "-%d", attempt);
        const int n =
            snprintf(file->temp, sizeof file->temp, ".%s.tmp-%ld%s", file->name, pid, suffix);
        if (n < 0 || (size_t)n >= sizeof file->temp) {
            errno = ENAMETOOLONG;
            return -1;
        }
        const int fd = kl_file_open_at(file->dir_fd, file->temp, O_RDWR | O_CREAT | O_EXCL);
        if (fd >= 0 || errno != EEXIST) return fd;
    }
    return -1;
}

kl_status kl_file_temp_open_at(int dir_fd, const char *name, struct kl_file_temp *file,
                               struct kl_err *err)
{
    memset(file, 0, sizeof *file);
    file->fd = -1;
    if (strlen(name) >= sizeof file->name || name[0] == '\0') {
        return kl_fail(err, KL_ERR_USAGE, "file name is empty or too long: %.300s", name);
    }
    memcpy(file->name, name, strlen(name) + 1);
    file->dir_fd = kl_file_open_at(dir_fd, ".", O_RDONLY | O_DIRECTORY);
    if (file->dir_fd < 0) return kl_fail_errno(err, "open the directory of %s", name);
    file->fd = open_unused(file);
    if (file->fd < 0) {
        (void)kl_fail_errno(err, "create %s", file->temp);
        (void)kl_file_calls->close(file->dir_fd);
        return err->status;
    }
    return KL_OK;
}

kl_status kl_file_temp_open(const char *path, struct kl_file_temp *file, struct kl_err *err)
{
    const char *slash = strrchr(path, '/');
    const char *name = slash != NULL ? slash + 1 : path;
    const size_t dir_size = (size_t)(name - path);
    char *dir = NULL;
    kl_status st = kl_copy_string(&dir, dir_size > 0 ? path : "./", err);

    if (st != KL_OK) return st;
    if (dir_size > 0) dir[dir_size] = '\0';
    const int dir_fd = kl_file_open_at(AT_FDCWD, dir, O_RDONLY | O_DIRECTORY);
    if (dir_fd < 0) {
        st = kl_fail_errno(err, "open directory %s", dir);
    } else {
        st = kl_file_temp_open_at(dir_fd, name, file, err);
        (void)kl_file_calls->close(dir_fd);
    }
    free(dir);
    return st;
}

kl_status kl_file_temp_commit(struct kl_file_temp *file, struct kl_err *err)
{
    kl_status st = KL_OK;

    if (kl_file_sync(file->fd) != 0) {
        st = kl_fail_errno(err, "fsync %s", file->temp);
        goto cleanup;
    }
    if (kl_file_calls->rename_at(file->dir_fd, file->temp, file->dir_fd, file->name) != 0) {
        st = kl_fail_errno(err, "rename %s to %s", file->temp, file->name);
        goto cleanup;
    }
    if (kl_file_sync(file->dir_fd) != 0) {
        st = kl_fail_errno(err, "fsync directory of %s", file->name);
    }

cleanup:
    if (st != KL_OK)
        (void)kl_file_calls->unlink_at(file->dir_fd, file->temp); /* ENOENT once renamed */
    (void)kl_file_calls->close(file->fd);
    (void)kl_file_calls->close(file->dir_fd);
    file->fd = file->dir_fd = -1;
    return st;
}

void kl_file_temp_discard(struct kl_file_temp *file)
{
    (void)kl_file_calls->unlink_at(file->dir_fd, file->temp);
    (void)kl_file_calls->close(file->fd);
    (void)kl_file_calls->close(file->dir_fd);
    file->fd = file->dir_fd = -1;
}

kl_status kl_file_replace(const char *path, const void *data, size_t size, struct kl_err *err)
{
    struct kl_file_temp file = {.dir_fd = -1, .fd = -1};
    kl_status st = kl_file_temp_open(path, &file, err);

    if (st != KL_OK) return st;
    st = kl_file_write_all(file.fd, data, size, err);
    if (st != KL_OK) {
        kl_file_temp_discard(&file);
        return kl_wrap(err, "%s", path);
    }
    st = kl_file_temp_commit(&file, err);
    return st == KL_OK ? KL_OK : kl_wrap(err, "%s", path);
}
