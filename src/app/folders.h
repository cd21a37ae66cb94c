/* Names of files and the folders that they need. */
#ifndef KL_SRC_APP_FOLDERS_H
#define KL_SRC_APP_FOLDERS_H

#include "src/base/status.h"

#include <stdbool.h>
#include <stddef.h>

/* Create the folders that `path` lies in, and with `itself` the last component too. */
kl_status kl_folders_make(const char *path, bool itself, struct kl_err *err) KL_MUST_CHECK;
bool kl_folder_is(const char *path);
/* KL_ERR_INPUT where there is none: a name that is wrong is bad input, a disk that fails is not.
 * `option`: "--env: ", or "". */
kl_status kl_file_expect(const char *path, const char *option, struct kl_err *err) KL_MUST_CHECK;

/* "a/b.c.glb": stem "b.c". KL_ERR_USAGE where the result does not fit. */
kl_status kl_path_get_stem(const char *path, char *out, size_t size,
                           struct kl_err *err) KL_MUST_CHECK;
/* `path` with its extension replaced: "a/b.exr", "png" is "a/b.png". */
kl_status kl_path_with_extension(const char *path, const char *extension, char *out, size_t size,
                                 struct kl_err *err) KL_MUST_CHECK;
/* Folder of `path` with its slash: "a/", or "". */
size_t kl_path_folder_length(const char *path);

#endif
