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
    for (uint32_t i = 0; i < level->octree.row_size; ++i)
        *sink ^= level->hot[level->rows[i] & ~KL_ROW_LAST].object;
    for (uint32_t i = 0; i < level->octree.node_count; ++i) {
        const kl_u32 entry = level->nodes[i];
        if (entry == KL_NODE_EMPTY) continue;
        *sink ^= entry & KL_NODE_LEAF ? level->rows[entry & ~KL_NODE_LEAF]
                                      : level->nodes[(entry & KL_NODE_INDEX) + 7];
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
