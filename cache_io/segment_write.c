#include "cache_io/format_impl.h"
#include "src/base/file.h"
#include "src/base/hash.h"
#include "src/base/memory.h"

#include <stdlib.h>
#include <string.h>

#ifndef KL_PROGRAM
#define KL_PROGRAM "keeplight"
#endif

struct piece {
    uint32_t type, level;
    const void *data;
    uint64_t count, bytes, offset;
};

struct layout {
    size_t count;
    struct piece pieces[SEGMENT_MAX_SECTIONS];
    uint64_t file_size;
};

static void add_piece(struct layout *layout, enum section_type type, uint32_t level,
                      const void *data, uint64_t count, size_t item)
{
    struct piece *piece = &layout->pieces[layout->count++];

    piece->type = type;
    piece->level = level;
    piece->data = data;
    piece->count = count;
    piece->bytes = count * item;
}

static uint64_t align_up(uint64_t x)
{
    return (x + SEGMENT_ALIGN - 1) / SEGMENT_ALIGN * SEGMENT_ALIGN;
}

static void lay_out(const struct segment_plan *plan, const unsigned char *superseded,
                    struct layout *layout)
{
    memset(layout, 0, sizeof *layout);
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        const struct kl_level_arrays *level = &plan->levels[l];
        if (level->record_count == 0) continue;
        add_piece(layout, SECTION_HOT, l, level->hot, level->record_count, sizeof *level->hot);
        add_piece(layout, SECTION_COLD, l, level->cold, level->record_count, sizeof *level->cold);
        if (plan->kind != SEGMENT_BASE || level->octree.record_count == 0) continue;
        add_piece(layout, SECTION_OCTREE, l, &level->octree, 1, sizeof level->octree);
        add_piece(layout, SECTION_SLOTS, l, level->slots, level->octree.slot_count,
                  sizeof *level->slots);
        add_piece(layout, SECTION_ROWS, l, level->rows, level->octree.row_size,
                  sizeof *level->rows);
    }
    if (plan->superseded_count > 0) {
        add_piece(layout, SECTION_SUPERSEDED, 0, superseded, plan->superseded_count, OLD_SIZE);
    }
    if (plan->part_count > 0) {
        add_piece(layout, SECTION_PARTS, 0, plan->parts, plan->part_count, sizeof *plan->parts);
    }
    uint64_t offset = align_up(HDR_TABLE + layout->count * SEC_SIZE + 8);
    for (size_t i = 0; i < layout->count; ++i) {
        layout->pieces[i].offset = offset;
        offset = align_up(offset + layout->pieces[i].bytes);
    }
    layout->file_size = offset;
}

/* Fills `header` (zeroed, up to the first section); returns its checksum. */
static uint64_t make_header(const struct segment_plan *plan, const struct layout *layout,
                            unsigned char *header)
{
    /* NOLINTNEXTLINE(bugprone-not-null-terminated-result): eight bytes, not a string */
    memcpy(header + HDR_MAGIC, KL_SEGMENT_MAGIC, 8);
    put_u16(header + HDR_MAJOR, SEGMENT_MAJOR);
    put_u16(header + HDR_MINOR, SEGMENT_MINOR);
    put_u32(header + HDR_REQUIRED, 0);
    put_u32(header + HDR_KIND, plan->kind);
    put_u32(header + HDR_SECTIONS, (uint32_t)layout->count);
    put_u64(header + HDR_GENERATION, plan->generation);
    put_u64(header + HDR_FILE_SIZE, layout->file_size);
    memcpy(header + HDR_SCENE, plan->key->scene, KL_DIGEST_SIZE);
    memcpy(header + HDR_SETTINGS, plan->key->settings, KL_DIGEST_SIZE);
    memcpy(header + HDR_ORIGIN, plan->key->origin, sizeof plan->key->origin);
    _Static_assert(sizeof KL_PROGRAM <= HDR_PROGRAM_SIZE, "program name is too long");
    memcpy(header + HDR_PROGRAM, KL_PROGRAM, sizeof KL_PROGRAM);
    for (size_t i = 0; i < layout->count; ++i) {
        const struct piece *piece = &layout->pieces[i];
        unsigned char *entry = header + HDR_TABLE + i * SEC_SIZE;
        put_u32(entry + SEC_TYPE, piece->type);
        put_u32(entry + SEC_LEVEL, piece->level);
        put_u64(entry + SEC_OFFSET, piece->offset);
        put_u64(entry + SEC_BYTES, piece->bytes);
        put_u64(entry + SEC_COUNT, piece->count);
        put_u64(entry + SEC_CHECKSUM, kl_hash_block(piece->data, (size_t)piece->bytes));
    }
    const size_t covered = HDR_TABLE + layout->count * SEC_SIZE;
    const uint64_t checksum = kl_hash_block(header, covered);
    put_u64(header + covered, checksum);
    return checksum;
}

static kl_status write_pieces(int fd, const unsigned char *header, size_t header_size,
                              const struct layout *layout, struct kl_err *err)
{
    static const unsigned char zeros[SEGMENT_ALIGN];
    kl_status st = kl_file_write_all(fd, header, header_size, err);

    for (size_t i = 0; i < layout->count && st == KL_OK; ++i) {
        const struct piece *piece = &layout->pieces[i];
        st = kl_file_write_all(fd, piece->data, (size_t)piece->bytes, err);
        if (st != KL_OK) return st;
        st = kl_file_write_all(fd, zeros, (size_t)(align_up(piece->bytes) - piece->bytes), err);
    }
    return st;
}

/* Bytes of the superseded section; *out is the caller's. */
static kl_status pack_superseded(const struct segment_plan *plan, unsigned char **out,
                                 struct kl_err *err)
{
    kl_status st = kl_alloc_array(out, plan->superseded_count, OLD_SIZE, err);

    if (st != KL_OK) return st;
    for (size_t i = 0; i < plan->superseded_count; ++i) {
        unsigned char *p = *out + i * OLD_SIZE;
        put_u32(p + OLD_KIND, plan->superseded[i].kind);
        put_u64(p + OLD_GENERATION, plan->superseded[i].generation);
        put_u64(p + OLD_HASH, plan->superseded[i].hash);
    }
    return KL_OK;
}

kl_status segment_write(int dir_fd, const struct segment_plan *plan, struct segment_id *id,
                        struct kl_err *err)
{
    struct layout layout;
    struct kl_file_temp file;
    unsigned char *superseded = NULL;
    unsigned char *header = NULL;
    char name[SEGMENT_NAME_SIZE];
    kl_status st = pack_superseded(plan, &superseded, err);

    if (st != KL_OK) return st;
    lay_out(plan, superseded, &layout);
    const size_t header_size = (size_t)align_up(HDR_TABLE + layout.count * SEC_SIZE + 8);
    st = kl_alloc_array(&header, header_size, 1, err);
    if (st != KL_OK) goto cleanup;
    id->kind = plan->kind;
    id->generation = plan->generation;
    id->hash = make_header(plan, &layout, header);
    segment_id_format(id, name);
    st = kl_file_temp_open_at(dir_fd, name, &file, err);
    if (st != KL_OK) goto cleanup;
    st = write_pieces(file.fd, header, header_size, &layout, err);
    if (st == KL_OK) {
        st = kl_file_temp_commit(&file, err);
    } else {
        kl_file_temp_discard(&file);
    }
    if (st != KL_OK) (void)kl_wrap(err, "%s", name);

cleanup:
    free(superseded);
    free(header);
    return st;
}
