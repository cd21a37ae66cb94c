/* One pass over the blocks of a segment, with all threads: checksums, and the values of what is
 * checked by itself, while a block is in the processor's cache. */
#ifndef KL_CACHE_IO_SEGMENT_VERIFY_IMPL_H
#define KL_CACHE_IO_SEGMENT_VERIFY_IMPL_H

#include "cache_io/segment_head_impl.h"

struct segment_reader {
    const unsigned char *data;
    size_t size;
    bool trust; /* checksums are not looked at */
    struct segment_head head;
    struct segment_table table;
};

struct segment_verdict {
    /* bad[type][level][b] = 1: block b is cut off, is not what its checksum says, or holds records
     * that are not sound. NULL: there is no such section. */
    uint8_t *bad[SECTION_TYPES][KL_CACHE_LEVELS];
    /* The rows of the level follow each other as they must, name records that exist, and start at
     * the places that the slots name. */
    bool index_is_sound[KL_CACHE_LEVELS];
    uint8_t *storage;
};

uint64_t section_block_count(const struct segment_section *section);
/* After KL_OK: segment_verdict_fini. */
kl_status segment_verify(const struct segment_reader *reader, struct segment_verdict *out,
                         struct kl_err *err) KL_MUST_CHECK;
uint64_t segment_verdict_count_bad(const struct segment_verdict *verdict,
                                   const struct segment_section *section, enum section_type type,
                                   uint32_t level);
void segment_verdict_fini(struct segment_verdict *verdict);

#endif
