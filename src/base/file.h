/* Whole files: read, and replace in one step. */
#ifndef KL_SRC_BASE_FILE_H
#define KL_SRC_BASE_FILE_H

#include "src/base/status.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* openat() and fsync(), again after EINTR; -1 and errno. Files are created with mode 0644, all are
 * closed by exec. A thing that cannot be synced (EINVAL: directories of some file systems) counts
 * as synced. */
int kl_file_open_at(int dir_fd, const char *path, int flags);
int kl_file_sync(int fd);

/* write() until all is written; goes on after short writes and EINTR. */
kl_status kl_file_write_all(int fd, const void *data, size_t size,
                            struct kl_err *err) KL_MUST_CHECK;

/* *out = the file's bytes and a zero byte after them; *size without it. Free with free().
 * KL_ERR_INPUT: not there, not a regular file, or larger than `limit` bytes. */
kl_status kl_file_read(const char *path, size_t limit, char **out, size_t *size,
                       struct kl_err *err) KL_MUST_CHECK;
/* The same for a path from an open directory; *changed: when the file system says that the file was
 * changed [s]. */
kl_status kl_file_read_at(int dir_fd, const char *path, size_t limit, char **out, size_t *size,
                          int64_t *changed, struct kl_err *err) KL_MUST_CHECK;

/* A new file that nobody sees under its name until kl_file_temp_commit. The caller writes to `fd`
 * at any offset. It lies beside its goal as ".<name>.tmp-<pid>". */
struct kl_file_temp {
    int dir_fd, fd; /* both owned */
    char name[256], temp[256];
};

/* After KL_OK call kl_file_temp_commit or kl_file_temp_discard, once. */
kl_status kl_file_temp_open(const char *path, struct kl_file_temp *file,
                            struct kl_err *err) KL_MUST_CHECK;
/* The same for `name` (no slash) in an open directory, which stays the caller's. */
kl_status kl_file_temp_open_at(int dir_fd, const char *name, struct kl_file_temp *file,
                               struct kl_err *err) KL_MUST_CHECK;
/* After a crash at any point a reader sees the whole old file or the whole new one. Order:
 * fsync(file), rename, fsync(directory). On failure the temp file is gone. */
kl_status kl_file_temp_commit(struct kl_file_temp *file, struct kl_err *err) KL_MUST_CHECK;
void kl_file_temp_discard(struct kl_file_temp *file);

/* Write `size` bytes to `path` through a temp file: kl_file_temp_commit's promise. */
kl_status kl_file_replace(const char *path, const void *data, size_t size,
                          struct kl_err *err) KL_MUST_CHECK;

#ifdef __cplusplus
}
#endif
#endif
