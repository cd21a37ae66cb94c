/* Any bytes as a file of use, its checksum skipped: what is accepted is a set that can be asked and
 * joined. */
#include "cache_io/use_impl.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct kl_err err;
    struct use_set set;
    void *copy = malloc(size > 0 ? size : 1);

    /* Exactly `size` bytes, so that a sanitizer sees the first one beyond. */
    if (copy == NULL) return 0;
    memcpy(copy, data, size);
    if (use_parse(copy, size, NULL, true, &set, &err) == KL_OK) {
        struct use_set small = {.log2_bits = USE_LEAST_BITS,
                                .bits = calloc(1, (size_t)1 << (USE_LEAST_BITS - 3))};
        for (uint64_t i = 0; i < 16; ++i) {
            const uint64_t place = (i << 60 | i) * 0x9e3779b97f4a7c15ull;
            const bool had = use_set_has(&set, place);
            if (small.bits == NULL) break;
            use_set_add(&small, place);
            if (use_set_join(&small, &set, &err) != KL_OK) break;
            if (!use_set_has(&small, place) || (had && !use_set_has(&set, place))) abort();
        }
        free(small.bits);
        free(set.bits);
    }
    free(copy);
    return 0;
}
