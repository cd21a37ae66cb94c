#include "cache_io/segment_head_impl.h"
#include "src/base/file.h"
#include "src/base/file_calls.h"
#include "src/base/hash.h"
#include "src/base/memory.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

/* Blocks of a small segment are not worth a team of threads. */
enum { PARALLEL_BLOCKS = 64 };

struct reader {
    const unsigned char *data;
    size_t size;
    bool trust;
    struct segment_head head;
    struct segment_table table;
};

/* The one place that verifies content against checksums. */
static bool block_is_intact(const struct reader *r, const struct segment_section *section,
                            uint64_t block)
{
    const uint64_t start = block * section->block_bytes;
    const uint64_t left = section->bytes - start;
    const uint64_t bytes = left < section->block_bytes ? left : section->block_bytes;
    const uint64_t offset = section->offset + start;

    if (offset > r->size || bytes > r->size - offset) return false; /* cut off */
    if (r->trust) return true;
    return kl_hash_block(r->data + offset, (size_t)bytes) ==
           read_u64(r->head.checksums + (section->first_block + block) * 8);
}

static uint64_t block_count_of(const struct segment_section *section)
{
    return (section->bytes + section->block_bytes - 1) / section->block_bytes;
}

/* Number of bad blocks of a section. */
static uint64_t count_bad(const struct reader *r, const struct segment_section *section)
{
    const int64_t blocks = section->offset != 0 ? (int64_t)block_count_of(section) : 0;
    uint64_t bad = 0;

#pragma omp parallel for schedule(dynamic, 16) reduction(+ : bad) if (blocks >= PARALLEL_BLOCKS)
    for (int64_t i = 0; i < blocks; ++i) {
        bad += !block_is_intact(r, section, (uint64_t)i);
    }
    return bad;
}

/* A mapped section as an array: its offset is a multiple of 64. */
static const void *array_get(const struct reader *r, const struct segment_section *section)
{
    return section->offset < r->size ? r->data + section->offset : NULL;
}

/* good[b] = 1 where block b of all arrays is intact and its records are sound; returns how many are
 * not. */
static uint64_t verify_records(const struct reader *r, const struct kl_level_arrays *level,
                               uint32_t l, uint8_t *good, int64_t blocks)
{
    const uint32_t n = level->record_count;
    uint64_t bad = 0;

#pragma omp parallel for schedule(dynamic, 4) reduction(+ : bad) if (blocks >= PARALLEL_BLOCKS)
    for (int64_t b = 0; b < blocks; ++b) {
        const uint32_t first = (uint32_t)b * SEGMENT_BLOCK_RECORDS;
        const uint32_t last = n - first < SEGMENT_BLOCK_RECORDS ? n : first + SEGMENT_BLOCK_RECORDS;
        bool ok = true;
        for (size_t a = 0; a < RECORD_ARRAYS; ++a) {
            ok = block_is_intact(r, &r->table.at[record_arrays[a].type][l], (uint64_t)b) && ok;
        }
        good[b] = ok && records_are_valid(level, first, last);
        bad += !good[b];
    }
    return bad;
}

/* Copies of the good blocks take the place of the mapped arrays. */
static kl_status salvage(struct segment *out, uint32_t l, const uint8_t *good, int64_t blocks,
                         struct kl_err *err)
{
    struct kl_level_arrays *level = &out->levels[l];
    const uint32_t n = level->record_count;
    uint32_t kept = 0;

    for (int64_t b = 0; b < blocks; ++b) {
        const uint32_t left = n - (uint32_t)b * SEGMENT_BLOCK_RECORDS;
        if (good[b]) kept += left < SEGMENT_BLOCK_RECORDS ? left : SEGMENT_BLOCK_RECORDS;
    }
    for (size_t a = 0; a < RECORD_ARRAYS; ++a) {
        const size_t item = record_arrays[a].item;
        const unsigned char *from = record_array_get(level, &record_arrays[a]);
        unsigned char *to = NULL;
        kl_status st = kl_alloc_array(&to, kept, item, err);
        if (st != KL_OK) return st;
        out->salvaged[l][a] = to;
        record_array_set(level, &record_arrays[a], to);
        for (int64_t b = 0; b < blocks; ++b) {
            const uint32_t first = (uint32_t)b * SEGMENT_BLOCK_RECORDS;
            const uint32_t left = n - first;
            const size_t bytes =
                item * (left < SEGMENT_BLOCK_RECORDS ? left : SEGMENT_BLOCK_RECORDS);
            if (!good[b]) continue;
            memcpy(to, from + first * item, bytes);
            to += bytes;
        }
    }
    level->record_count = kept;
    out->damage.records[l] += n - kept;
    return KL_OK;
}

/* The record arrays of level l, without what is damaged. */
static kl_status take_records(const struct reader *r, uint32_t l, struct segment *out,
                              struct kl_err *err)
{
    struct kl_level_arrays *level = &out->levels[l];
    const uint64_t count = r->table.at[record_arrays[0].type][l].count;
    uint8_t *good = NULL;

    for (size_t a = 0; a < RECORD_ARRAYS; ++a) {
        const struct segment_section *section = &r->table.at[record_arrays[a].type][l];
        if (section->count != count) {
            return kl_fail(err, KL_ERR_CORRUPT, "record arrays of %" PRIu64 " and %" PRIu64, count,
                           section->count);
        }
        if (section->offset != 0) record_array_set(level, &record_arrays[a], array_get(r, section));
    }
    level->record_count = (uint32_t)count;
    if (count == 0) return KL_OK;
    const int64_t blocks = (int64_t)((count + SEGMENT_BLOCK_RECORDS - 1) / SEGMENT_BLOCK_RECORDS);
    kl_status st = kl_alloc_array(&good, (size_t)blocks, 1, err);
    if (st != KL_OK) return st;
    const uint64_t bad = verify_records(r, level, l, good, blocks);
    out->damage.blocks += bad;
    if (bad > 0) st = salvage(out, l, good, blocks, err);
    free(good);
    return st;
}

/* The octree of level l, or none where anything in it or in the records is damaged. */
static kl_status take_octree(const struct reader *r, uint32_t l, struct segment *out,
                             struct kl_err *err)
{
    const struct segment_section *octree = &r->table.at[SECTION_OCTREE][l];
    const struct segment_section *slots = &r->table.at[SECTION_SLOTS][l];
    const struct segment_section *rows = &r->table.at[SECTION_ROWS][l];
    struct kl_level_arrays level = out->levels[l];
    struct kl_err complaint;

    if (octree->offset == 0 && slots->offset == 0 && rows->offset == 0) return KL_OK;
    if (out->id.kind != SEGMENT_BASE || octree->count != 1 || slots->offset == 0 ||
        rows->offset == 0) {
        return kl_fail(err, KL_ERR_CORRUPT, "parts of an octree");
    }
    const uint64_t bad = count_bad(r, octree) + count_bad(r, slots) + count_bad(r, rows);
    out->damage.blocks += bad;
    bool ok = bad == 0 && out->damage.records[l] == 0;
    if (ok) {
        memcpy(&level.octree, array_get(r, octree), sizeof level.octree);
        level.slots = array_get(r, slots);
        level.rows = array_get(r, rows);
        ok = level.octree.slot_count == slots->count && level.octree.row_size == rows->count &&
             level.octree.record_count > 0 && octree_validate(&level, &complaint) == KL_OK;
    }
    if (ok) {
        out->levels[l] = level;
    } else {
        ++out->damage.octrees;
    }
    return KL_OK;
}

/* When the records of level l were first written. Numbers mean nothing once records are left out.
 */
static kl_status take_births(const struct reader *r, uint32_t l, struct segment *out,
                             struct kl_err *err)
{
    const struct segment_section *section = &r->table.at[SECTION_BIRTHS][l];

    if (section->count == 0) return KL_OK;
    if (section->count != r->table.at[record_arrays[0].type][l].count) {
        return kl_fail(err, KL_ERR_CORRUPT, "births of %" PRIu64 " records", section->count);
    }
    const uint64_t bad = count_bad(r, section);
    out->damage.blocks += bad;
    if (bad == 0 && out->damage.records[l] == 0) out->births[l] = array_get(r, section);
    return KL_OK;
}

static kl_status take_superseded(const struct reader *r, struct segment *out, struct kl_err *err)
{
    const struct segment_section *section = &r->table.at[SECTION_SUPERSEDED][0];

    if (section->count == 0) return KL_OK;
    if (out->id.kind != SEGMENT_BASE) {
        return kl_fail(err, KL_ERR_CORRUPT, "a delta cannot supersede");
    }
    const uint64_t bad = count_bad(r, section);
    out->damage.blocks += bad;
    if (bad > 0) return KL_OK;
    out->superseded = array_get(r, section);
    out->superseded_count = (size_t)section->count;
    return KL_OK;
}

static void take_parts(const struct reader *r, struct segment *out)
{
    const struct segment_section *section = &r->table.at[SECTION_PARTS][0];
    struct kl_err complaint;

    if (section->count == 0) return;
    const uint64_t bad = count_bad(r, section);
    if (bad > 0 || parts_validate(array_get(r, section), (uint32_t)section->count, &complaint)) {
        out->damage.blocks += bad > 0 ? bad : 1;
        return;
    }
    out->parts = array_get(r, section);
    out->part_count = (uint32_t)section->count;
}

kl_status segment_parse(const void *data, size_t size, const struct segment_id *id, bool trust,
                        struct segment *out, struct kl_err *err)
{
    struct reader r = {.data = data, .size = size, .trust = trust};

    memset(out, 0, sizeof *out);
    kl_status st = segment_head_read(r.data, size, id, trust, &r.head, err);
    if (st == KL_OK) st = segment_head_sections(&r.head, &r.table, err);
    if (st != KL_OK) return st;
    out->data = data;
    out->size = size;
    out->id.kind = read_u32(r.head.at + HDR_KIND);
    out->id.generation = read_u64(r.head.at + HDR_GENERATION);
    out->id.hash = read_u64(r.head.at + r.head.size - 8);
    out->damage.headers = r.head.is_damaged;
    memcpy(out->key.scene, r.head.at + HDR_SCENE, KL_DIGEST_SIZE);
    memcpy(out->key.settings, r.head.at + HDR_SETTINGS, KL_DIGEST_SIZE);
    memcpy(out->key.origin, r.head.at + HDR_ORIGIN, sizeof out->key.origin);
    memcpy(out->program, r.head.at + HDR_PROGRAM, HDR_PROGRAM_SIZE);
    segment_id_format(&out->id, out->name);
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        st = take_records(&r, l, out, err);
        if (st == KL_OK) st = take_octree(&r, l, out, err);
        if (st == KL_OK) st = take_births(&r, l, out, err);
        if (st != KL_OK) {
            segment_fini(out);
            return kl_wrap(err, "level %u", l);
        }
    }
    take_parts(&r, out);
    st = take_superseded(&r, out, err);
    if (st != KL_OK) segment_fini(out);
    return st;
}

void segment_fini(struct segment *segment)
{
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        for (size_t a = 0; a < RECORD_ARRAYS; ++a) {
            free(segment->salvaged[l][a]);
            segment->salvaged[l][a] = NULL;
        }
    }
}

static void unmap(const void *data, size_t size)
{
    union {
        const void *borrowed;
        void *owned;
    } map = {.borrowed = data}; /* munmap takes no pointer to const */

    (void)munmap(map.owned, size);
}

kl_status segment_map(int fd, const struct segment_id *id, struct segment *out, struct kl_err *err)
{
    struct stat info;

    if (kl_file_calls->stat(fd, &info) != 0) return kl_fail_errno(err, "stat");
    if (!S_ISREG(info.st_mode) || info.st_size < HDR_MIN_SIZE) {
        return kl_fail(err, KL_ERR_CORRUPT, "not a file that holds a header");
    }
    const void *map = kl_file_calls->map((size_t)info.st_size, fd);
    if (map == MAP_FAILED) return kl_fail_errno(err, "map");
    kl_status st = segment_parse(map, (size_t)info.st_size, id, false, out, err);
    if (st != KL_OK) unmap(map, (size_t)info.st_size);
    return st;
}

kl_status segment_open(int dir_fd, const char *name, struct segment *out, struct kl_err *err)
{
    struct segment_id id;

    if (!segment_id_parse(name, &id)) {
        return kl_fail(err, KL_ERR_USAGE, "%s: not a segment's name", name);
    }
    const int fd = kl_file_open_at(dir_fd, name, O_RDONLY | O_NONBLOCK);
    if (fd < 0) return kl_fail_errno(err, "%s: open", name);
    kl_status st = segment_map(fd, &id, out, err);
    (void)kl_file_calls->close(fd);
    return st == KL_OK ? KL_OK : kl_wrap(err, "%s", name);
}

void segment_close(struct segment *segment)
{
    segment_fini(segment);
    if (segment->data != NULL) unmap(segment->data, segment->size);
    segment->data = NULL;
}
