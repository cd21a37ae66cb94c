#include "src/base/file_calls.h"

#include <fcntl.h>
#include <stdio.h>
#include <sys/mman.h>
#include <unistd.h>

static int open_at(int dir_fd, const char *path, int flags, mode_t mode)
{
    return openat(dir_fd, path, flags, mode);
}

static int stat_file(int fd, struct stat *info)
{
    return fstat(fd, info);
}

static void *map_file(size_t size, int fd)
{
    return mmap(NULL, size, PROT_READ, MAP_SHARED, fd, 0);
}

static int unlink_at(int dir_fd, const char *path)
{
    return unlinkat(dir_fd, path, 0);
}

static struct dirent *read_dir(DIR *dir)
{
    return readdir(dir); /* NOLINT(concurrency-mt-unsafe): every caller has its own stream */
}

const struct kl_file_calls kl_file_system_calls = {
    .open_at = open_at,
    .close = close,
    .read = read,
    .write = write,
    .sync = fsync,
    .stat = stat_file,
    .map = map_file,
    .rename_at = renameat,
    .unlink_at = unlink_at,
    .make_dir = mkdir,
    .read_dir = read_dir,
};

const struct kl_file_calls *kl_file_calls = &kl_file_system_calls;
