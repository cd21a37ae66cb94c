/* The system calls that src/base/file.c and cache_io/ make on files: one table, so that tests can
 * put failures, and the order in which data becomes durable, in place of the system. */
#ifndef KL_SRC_BASE_FILE_CALLS_H
#define KL_SRC_BASE_FILE_CALLS_H

#include <dirent.h>
#include <stddef.h>
#include <sys/stat.h>
#include <sys/types.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Every member behaves as the POSIX function named beside it, errno included. */
struct kl_file_calls {
    int (*open_at)(int dir_fd, const char *path, int flags, mode_t mode); /* openat */
    int (*close)(int fd);                                                 /* close */
    ssize_t (*read)(int fd, void *data, size_t size);                     /* read */
    ssize_t (*write)(int fd, const void *data, size_t size);              /* write */
    int (*sync)(int fd);                                                  /* fsync */
    int (*stat)(int fd, struct stat *info);                               /* fstat */
    void *(*map)(size_t size, int fd); /* mmap: shared, to be read, from offset 0 */
    int (*rename_at)(int from_fd, const char *from, int to_fd, const char *to); /* renameat */
    int (*unlink_at)(int dir_fd, const char *path);                             /* unlinkat */
    int (*make_dir)(const char *path, mode_t mode);                             /* mkdir */
    struct dirent *(*read_dir)(DIR *dir);                                       /* readdir */
};

/* The system's own. */
extern const struct kl_file_calls kl_file_system_calls;
/* What is in use. Only tests set it, while one thread runs. */
extern const struct kl_file_calls *kl_file_calls;

#ifdef __cplusplus
}
#endif
#endif
