#include "cache_io/segment_head_impl.h"

#include "src/base/hash.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

static const size_t item_sizes[SECTION_TYPES] = {
    [SECTION_HOT] = sizeof(kl_record_hot),
    [SECTION_COLD] = sizeof(kl_record_cold),
    [SECTION_OCTREE] = sizeof(kl_octree_header),
    [SECTION_NODES] = sizeof(kl_u32),
    [SECTION_ROWS] = sizeof(kl_u32),
    [SECTION_SUPERSEDED] = OLD_SIZE,
    [SECTION_PARTS] = sizeof(kl_part),
    [SECTION_BIRTHS] = sizeof(uint32_t),
};

static bool is_record_array(uint32_t type)
{
    for (size_t a = 0; a < RECORD_ARRAYS; ++a) {
        if (record_arrays[a].type == (enum section_type)type) return true;
    }
    return false;
}

static uint64_t block_bytes_of(uint32_t type)
{
    return is_record_array(type) ? item_sizes[type] * SEGMENT_BLOCK_RECORDS : SEGMENT_BLOCK_BYTES;
}

/* Size of the header that begins at `at`, judged by its counts; 0: impossible. */
static size_t size_by_counts(const unsigned char *at, size_t room)
{
    const uint32_t sections = read_u32(at + HDR_SECTIONS);
    const uint64_t blocks = read_u64(at + HDR_BLOCKS);

    if (sections > SEGMENT_MAX_SECTIONS || blocks > room / 8) return 0;
    const uint64_t size = HDR_TABLE + (uint64_t)sections * SEC_SIZE + blocks * 8 + HDR_END;
    return size <= room ? (size_t)size : 0;
}

static kl_status check_at(const unsigned char *at, size_t room, const struct segment_id *id,
                          bool trust, struct segment_head *out, struct kl_err *err)
{
    if (room < HDR_MIN_SIZE) {
        return kl_fail(err, KL_ERR_CORRUPT, "%zu bytes are less than a header", room);
    }
    if (memcmp(at + HDR_MAGIC, KL_SEGMENT_MAGIC, 8) != 0) {
        return kl_fail(err, KL_ERR_CORRUPT, "not a cache segment (magic)");
    }
    if (read_u16(at + HDR_MAJOR) != SEGMENT_MAJOR) {
        return kl_fail(err, KL_ERR_VERSION, "format version %u, this program reads %d",
                       read_u16(at + HDR_MAJOR), SEGMENT_MAJOR);
    }
    out->at = at;
    out->size = size_by_counts(at, room);
    if (out->size == 0 || read_u64(at + out->size - HDR_END) != out->size) {
        return kl_fail(err, KL_ERR_CORRUPT, "%u sections, %" PRIu64 " blocks in %zu bytes",
                       read_u32(at + HDR_SECTIONS), read_u64(at + HDR_BLOCKS), room);
    }
    const uint64_t hash = read_u64(at + out->size - 8);
    if (!trust && kl_hash_block(at, out->size - 8) != hash) {
        return kl_fail(err, KL_ERR_CORRUPT, "header checksum does not match");
    }
    const struct segment_id said = {read_u32(at + HDR_KIND), read_u64(at + HDR_GENERATION), hash};
    if (said.kind != SEGMENT_BASE && said.kind != SEGMENT_DELTA) {
        return kl_fail(err, KL_ERR_CORRUPT, "unknown kind %u", said.kind);
    }
    if (said.generation > INT64_MAX || (id != NULL && !segment_id_is_equal(id, &said))) {
        return kl_fail(err, KL_ERR_CORRUPT, "the header is of another file name");
    }
    if ((read_u32(at + HDR_REQUIRED) & ~(uint32_t)SEGMENT_FEATURES) != 0) {
        return kl_fail(err, KL_ERR_VERSION, "needs features 0x%x, which this program does not know",
                       read_u32(at + HDR_REQUIRED));
    }
    return KL_OK;
}

kl_status segment_head_read(const unsigned char *data, size_t size, const struct segment_id *id,
                            bool trust, struct segment_head *out, struct kl_err *err)
{
    struct kl_err ignored;

    memset(out, 0, sizeof *out);
    kl_status st = check_at(data, size, id, trust, out, err);
    if (st != KL_OK && size >= HDR_MIN_SIZE) {
        const uint64_t tail = read_u64(data + size - HDR_END);
        if (tail >= HDR_MIN_SIZE && tail <= size &&
            check_at(data + size - tail, (size_t)tail, id, trust, out, &ignored) == KL_OK) {
            st = KL_OK;
        }
    }
    if (st != KL_OK) return st;
    for (int i = 0; i < 3; ++i) {
        double x = 0.0;
        memcpy(&x, out->at + HDR_ORIGIN + 8 * i, sizeof x);
        if (!isfinite(x)) return kl_fail(err, KL_ERR_CORRUPT, "origin is not finite");
    }
    out->section_count = read_u32(out->at + HDR_SECTIONS);
    out->block_count = read_u64(out->at + HDR_BLOCKS);
    out->checksums = out->at + HDR_TABLE + (size_t)out->section_count * SEC_SIZE;
    out->file_size = read_u64(out->at + HDR_FILE_SIZE);
    if (out->file_size != size || memcmp(out->at, data, out->size) != 0 ||
        memcmp(out->at, data + size - out->size, out->size) != 0) {
        out->is_damaged = true;
    }
    return KL_OK;
}

kl_status segment_head_sections(const struct segment_head *head, struct segment_table *out,
                                struct kl_err *err)
{
    memset(out, 0, sizeof *out);
    for (uint32_t i = 0; i < head->section_count; ++i) {
        const unsigned char *entry = head->at + HDR_TABLE + (size_t)i * SEC_SIZE;
        const uint32_t type = read_u32(entry + SEC_TYPE);
        const uint32_t level = read_u32(entry + SEC_LEVEL);
        const struct segment_section section = {.offset = read_u64(entry + SEC_OFFSET),
                                                .count = read_u64(entry + SEC_COUNT),
                                                .bytes = read_u64(entry + SEC_BYTES),
                                                .first_block = read_u64(entry + SEC_FIRST_BLOCK),
                                                .block_bytes = read_u64(entry + SEC_BLOCK_BYTES)};

        if (type == 0 || type >= SECTION_TYPES) continue; /* of a newer minor version */
        if (level >= KL_CACHE_LEVELS || section.offset % SEGMENT_ALIGN != 0 ||
            section.offset < head->size || section.offset > head->file_size ||
            section.bytes > head->file_size - section.offset || section.count > UINT32_MAX ||
            section.bytes != section.count * item_sizes[type] ||
            section.block_bytes != block_bytes_of(type)) {
            return kl_fail(err, KL_ERR_CORRUPT, "section %u of level %u does not fit", type, level);
        }
        const uint64_t blocks = (section.bytes + section.block_bytes - 1) / section.block_bytes;
        if (section.first_block > head->block_count ||
            blocks > head->block_count - section.first_block) {
            return kl_fail(err, KL_ERR_CORRUPT, "section %u of level %u: no checksums", type,
                           level);
        }
        if (out->at[type][level].offset != 0) {
            return kl_fail(err, KL_ERR_CORRUPT, "section %u of level %u twice", type, level);
        }
        out->at[type][level] = section;
    }
    return KL_OK;
}
