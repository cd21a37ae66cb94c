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
    const unsigned char *data;
    uint64_t count, bytes, offset, block_bytes, first_block;
};

struct layout {
    size_t count;
    struct piece pieces[SEGMENT_MAX_SECTIONS];
    uint64_t blocks, head_size, file_size;
};

static void add_piece(struct layout *layout, enum section_type type, uint32_t level,
                      const void *data, uint64_t count, size_t item, bool is_record_array)
{
    struct piece *piece = &layout->pieces[layout->count++];

    piece->type = type;
    piece->level = level;
    piece->data = data;
    piece->count = count;
    piece->bytes = count * item;
    piece->block_bytes =
        is_record_array ? (uint64_t)item * SEGMENT_BLOCK_RECORDS : SEGMENT_BLOCK_BYTES;
    piece->first_block = layout->blocks;
    layout->blocks += (piece->bytes + piece->block_bytes - 1) / piece->block_bytes;
}

static uint64_t align_up(uint64_t x)
{
    return (x + SEGMENT_ALIGN - 1) / SEGMENT_ALIGN * SEGMENT_ALIGN;
}

static void add_level(struct layout *layout, const struct kl_level_arrays *level, uint32_t l,
                      bool with_octree)
{
    if (level->record_count == 0) return;
    for (size_t a = 0; a < RECORD_ARRAYS; ++a) {
        add_piece(layout, record_arrays[a].type, l, record_array_get(level, &record_arrays[a]),
                  level->record_count, record_arrays[a].item, true);
    }
    if (!with_octree || level->octree.record_count == 0) return;
    add_piece(layout, SECTION_OCTREE, l, &level->octree, 1, sizeof level->octree, false);
    add_piece(layout, SECTION_NODES, l, level->nodes, level->octree.node_count,
              sizeof *level->nodes, false);
    add_piece(layout, SECTION_ROWS, l, level->rows, level->octree.row_size, sizeof *level->rows,
              false);
}

static void lay_out(const struct segment_plan *plan, const unsigned char *superseded,
                    struct layout *layout)
{
    memset(layout, 0, sizeof *layout);
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        const uint32_t count = plan->levels[l].record_count;
        add_level(layout, &plan->levels[l], l, plan->kind == SEGMENT_BASE);
        if (count > 0 && plan->births != NULL && plan->births[l] != NULL) {
            add_piece(layout, SECTION_BIRTHS, l, plan->births[l], count, sizeof **plan->births,
                      false);
        }
    }
    if (plan->superseded_count > 0) {
        add_piece(layout, SECTION_SUPERSEDED, 0, superseded, plan->superseded_count, OLD_SIZE,
                  false);
    }
    if (plan->part_count > 0) {
        add_piece(layout, SECTION_PARTS, 0, plan->parts, plan->part_count, sizeof *plan->parts,
                  false);
    }
    layout->head_size = HDR_TABLE + layout->count * SEC_SIZE + layout->blocks * 8 + HDR_END;
    uint64_t offset = align_up(layout->head_size);
    for (size_t i = 0; i < layout->count; ++i) {
        layout->pieces[i].offset = offset;
        offset = align_up(offset + layout->pieces[i].bytes);
    }
    layout->file_size = offset + layout->head_size;
}

static void put_checksums(const struct layout *layout, unsigned char *out)
{
    for (size_t i = 0; i < layout->count; ++i) {
        const struct piece *piece = &layout->pieces[i];
        const int64_t blocks =
            (int64_t)((piece->bytes + piece->block_bytes - 1) / piece->block_bytes);
#pragma omp parallel for schedule(dynamic, 16) if (blocks >= 64)
        for (int64_t b = 0; b < blocks; ++b) {
            const uint64_t start = (uint64_t)b * piece->block_bytes;
            const uint64_t left = piece->bytes - start;
            const uint64_t bytes = left < piece->block_bytes ? left : piece->block_bytes;
            put_u64(out + (piece->first_block + (uint64_t)b) * 8,
                    kl_hash_block(piece->data + start, (size_t)bytes));
        }
    }
}

/* Fills `header` (zeroed, layout->head_size); returns its checksum. */
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
    put_u64(header + HDR_BLOCKS, layout->blocks);
    for (size_t i = 0; i < layout->count; ++i) {
        const struct piece *piece = &layout->pieces[i];
        unsigned char *entry = header + HDR_TABLE + i * SEC_SIZE;
        put_u32(entry + SEC_TYPE, piece->type);
        put_u32(entry + SEC_LEVEL, piece->level);
        put_u64(entry + SEC_OFFSET, piece->offset);
        put_u64(entry + SEC_BYTES, piece->bytes);
        put_u64(entry + SEC_COUNT, piece->count);
        put_u64(entry + SEC_FIRST_BLOCK, piece->first_block);
        put_u64(entry + SEC_BLOCK_BYTES, piece->block_bytes);
    }
    put_checksums(layout, header + HDR_TABLE + layout->count * SEC_SIZE);
    put_u64(header + layout->head_size - HDR_END, layout->head_size);
    const uint64_t checksum = kl_hash_block(header, (size_t)layout->head_size - 8);
    put_u64(header + layout->head_size - 8, checksum);
    return checksum;
}

static kl_status write_padded(int fd, const void *data, uint64_t bytes, struct kl_err *err)
{
    static const unsigned char zeros[SEGMENT_ALIGN];
    kl_status st = kl_file_write_all(fd, data, (size_t)bytes, err);

    if (st != KL_OK || align_up(bytes) == bytes) return st;
    return kl_file_write_all(fd, zeros, (size_t)(align_up(bytes) - bytes), err);
}

static kl_status write_all(int fd, const unsigned char *header, const struct layout *layout,
                           struct kl_err *err)
{
    kl_status st = write_padded(fd, header, layout->head_size, err);

    for (size_t i = 0; i < layout->count && st == KL_OK; ++i) {
        st = write_padded(fd, layout->pieces[i].data, layout->pieces[i].bytes, err);
    }
    if (st == KL_OK) st = kl_file_write_all(fd, header, (size_t)layout->head_size, err);
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

/* Others may compact the segment away the moment it has its name: it is mapped before. */
static kl_status write_and_map(struct kl_file_temp *file, const unsigned char *header,
                               const struct layout *layout, const struct segment_id *id,
                               struct segment *out, struct kl_err *err)
{
    kl_status st = write_all(file->fd, header, layout, err);

    if (st == KL_OK) st = segment_map(file->fd, id, out, err);
    if (st != KL_OK) {
        kl_file_temp_discard(file);
        return st;
    }
    const struct kl_store_damage *damage = &out->damage;
    if (damage->headers + damage->blocks + damage->octrees > 0) {
        kl_file_temp_discard(file);
        st = kl_fail(err, KL_ERR_IO, "what was written does not come back");
    } else {
        st = kl_file_temp_commit(file, err);
    }
    if (st != KL_OK) segment_close(out);
    return st;
}

kl_status segment_write(int dir_fd, const struct segment_plan *plan, struct segment *out,
                        struct kl_err *err)
{
    struct layout layout;
    struct kl_file_temp file;
    struct segment_id id = {.kind = plan->kind, .generation = plan->generation};
    unsigned char *superseded = NULL;
    unsigned char *header = NULL;
    char name[SEGMENT_NAME_SIZE];
    kl_status st = pack_superseded(plan, &superseded, err);

    if (st != KL_OK) return st;
    lay_out(plan, superseded, &layout);
    st = kl_alloc_array(&header, (size_t)layout.head_size, 1, err);
    if (st != KL_OK) goto cleanup;
    id.hash = make_header(plan, &layout, header);
    segment_id_format(&id, name);
    st = kl_file_temp_open_at(dir_fd, name, &file, err);
    if (st == KL_OK) st = write_and_map(&file, header, &layout, &id, out, err);
    if (st != KL_OK) (void)kl_wrap(err, "%s", name);

cleanup:
    free(superseded);
    free(header);
    return st;
}
