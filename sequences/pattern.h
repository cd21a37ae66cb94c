/* File names with a place for the frame number. */
#ifndef KL_SEQUENCES_PATTERN_H
#define KL_SEQUENCES_PATTERN_H

#include "src/base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* `out` = the file name of a frame. Placeholders, at most one in a pattern:
 *   ####        as many digits as signs, more where the number needs them; -8 is -0008
 *   $F4, $F     the same with 4 digits or 1 ("$F" before a letter is plain text)
 *   %04d, %d    as printf; -8 is -008
 * Without one the pattern names a single file; with `many` frames ".####" is put before its
 * extension. KL_ERR_USAGE: two placeholders, no name, or the result does not fit `size`. */
kl_status kl_pattern_format(const char *pattern, int32_t frame, bool many, char *out, size_t size,
                            struct kl_err *err) KL_MUST_CHECK;

#ifdef __cplusplus
}
#endif
#endif
