#include "src/base/memory.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { ALIGNMENT = 64, TAIL = 64 };

kl_status kl_alloc_array(void *out, size_t count, size_t size, struct kl_err *err)
{
    void *memory = NULL;

    if (size != 0 && count > (SIZE_MAX - TAIL) / size) {
        return kl_fail(err, KL_ERR_NO_MEMORY, "out of memory: %zu items of %zu bytes", count, size);
    }
    if (posix_memalign(&memory, ALIGNMENT, count * size + TAIL) != 0) {
        return kl_fail(err, KL_ERR_NO_MEMORY, "out of memory: %zu bytes", count * size);
    }
    memset(memory, 0, count * size + TAIL);
    memcpy(out, &memory, sizeof memory);
    return KL_OK;
}

kl_status kl_grow_array(void *array, size_t *capacity, size_t count, size_t size,
                        struct kl_err *err)
{
    void *old = NULL;
    void *grown = NULL;
    size_t wanted = *capacity < 16 ? 16 : *capacity;

    if (count <= *capacity) return KL_OK;
    while (wanted < count) {
        wanted = wanted > SIZE_MAX / 2 ? count : wanted * 2;
    }
    kl_status st = kl_alloc_array(&grown, wanted, size, err);
    if (st != KL_OK) return st;
    memcpy(&old, array, sizeof old);
    if (old != NULL) memcpy(grown, old, *capacity * size);
    free(old);
    memcpy(array, &grown, sizeof grown);
    *capacity = wanted;
    return KL_OK;
}

kl_status kl_copy_string(char **out, const char *text, struct kl_err *err)
{
    const size_t size = strlen(text) + 1;
    char *copy = NULL;
    kl_status st = kl_alloc_array(&copy, size, 1, err);

    if (st != KL_OK) return st;
    memcpy(copy, text, size);
    *out = copy;
    return KL_OK;
}
