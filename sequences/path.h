/* Keyframed camera paths: docs/sequence_format.md. */
#ifndef KL_SEQUENCES_PATH_H
#define KL_SEQUENCES_PATH_H

#include "sequences/look.h"
#include "src/base/status.h"

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Immutable: any number of threads may evaluate. */
struct kl_path;

/* `fps` counts frames where the file has no "fps" of its own, > 0. KL_ERR_INPUT: one line with file
 * and place. *out is the caller's: kl_path_destroy, which accepts NULL. */
kl_status kl_path_load(const char *file, double fps, struct kl_path **out,
                       struct kl_err *err) KL_MUST_CHECK;
/* The same from memory; `name` stands for the file in messages. */
kl_status kl_path_parse(const char *text, size_t size, const char *name, double fps,
                        struct kl_path **out, struct kl_err *err) KL_MUST_CHECK;
void kl_path_destroy(struct kl_path *path);

/* Time of the first and the last key [s]. */
void kl_path_range(const struct kl_path *path, double *first, double *last);

/* The camera at a time [s]; before the first and after the last key it stands still there. */
void kl_path_evaluate(const struct kl_path *path, double time, struct kl_look *out);

#ifdef __cplusplus
}
#endif
#endif
