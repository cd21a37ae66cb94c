/* The header of a segment: docs/cache_format.md section 3. */
#ifndef KL_CACHE_IO_SEGMENT_HEAD_IMPL_H
#define KL_CACHE_IO_SEGMENT_HEAD_IMPL_H

#include "cache_io/format_impl.h"

struct segment_head {
    const unsigned char *at; /* of the copy that is whole */
    size_t size;
    uint64_t file_size; /* what the file should have */
    uint32_t section_count;
    uint64_t block_count;
    const unsigned char *checksums; /* block_count x 8 bytes */
    bool is_damaged;                /* one of the copies, or the size of the file */
};

/* A section of a known type. */
struct segment_section {
    uint64_t offset; /* in the file; 0: absent */
    uint64_t count, bytes, first_block, block_bytes;
};

struct segment_table {
    struct segment_section at[SECTION_TYPES][KL_CACHE_LEVELS];
};

/* Find the header at the file's start, else its copy at the end. `id` and `trust` as in
 * segment_parse. KL_ERR_CORRUPT, KL_ERR_VERSION. */
kl_status segment_head_read(const unsigned char *data, size_t size, const struct segment_id *id,
                            bool trust, struct segment_head *out, struct kl_err *err) KL_MUST_CHECK;
/* Places of all sections. They may lie beyond the end of a file that was cut. */
kl_status segment_head_sections(const struct segment_head *head, struct segment_table *out,
                                struct kl_err *err) KL_MUST_CHECK;

#endif
