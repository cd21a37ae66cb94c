/* Allocation with overflow checks. */
#ifndef KL_SRC_BASE_MEMORY_H
#define KL_SRC_BASE_MEMORY_H

#include "src/base/status.h"

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* *out = zeroed storage for `count` items of `size` bytes (at least 1 byte), aligned to 64 bytes
 * and followed by 64 bytes that may be read (Embree reads 16 past a vertex array). Free with
 * free(). *out is untouched on failure. */
kl_status kl_alloc_array(void *out, size_t count, size_t size, struct kl_err *err) KL_MUST_CHECK;

/* Grow *array (capacity *capacity items of `size` bytes) to hold at least `count`: doubles, keeps
 * contents, new items zeroed. *array may be NULL with capacity 0. */
kl_status kl_grow_array(void *array, size_t *capacity, size_t count, size_t size,
                        struct kl_err *err) KL_MUST_CHECK;

/* Copy of a string. */
kl_status kl_copy_string(char **out, const char *text, struct kl_err *err) KL_MUST_CHECK;

#ifdef __cplusplus
}
#endif
#endif
