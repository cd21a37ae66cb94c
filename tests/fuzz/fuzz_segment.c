/* Any bytes as a cache segment, checksums skipped so that mutations get past them: what is accepted
 * must not lead a reader outside its arrays. */
#include "cache_io/format_impl.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void touch(const struct kl_level_arrays *level, volatile kl_u32 *sink)
{
    for (uint32_t i = 0; i < level->record_count; ++i)
        *sink ^= level->cold[i].touched[0];
    for (uint32_t i = 0; i < level->octree.slot_count; ++i) {
        if (level->slots[i].tag == 0) continue;
        const kl_u32 *row = level->rows + level->slots[i].row + 1; /* behind the check word */
        /* The ends are enough: all between is checked by the same run length. */
        if (row[0] > 0) *sink ^= level->hot[row[1]].object ^ level->hot[row[row[0]]].object;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct kl_err err;
    struct segment segment;
    volatile kl_u32 sink = 0;
    void *copy = NULL;

    /* Exactly `size` bytes, so that a sanitizer sees the first one beyond. */
    if (posix_memalign(&copy, 64, size > 0 ? size : 1) != 0) return 0;
    memcpy(copy, data, size);
    if (segment_parse(copy, size, NULL, true, &segment, &err) == KL_OK) {
        for (int l = 0; l < KL_CACHE_LEVELS; ++l)
            touch(&segment.levels[l], &sink);
        for (size_t i = 0; i < segment.superseded_count; ++i) {
            sink ^= segment_superseded_get(&segment, i).kind;
        }
        segment_fini(&segment);
    }
    free(copy);
    return 0;
}
