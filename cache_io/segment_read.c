#include "cache_io/segment_verify_impl.h"
#include "src/base/file.h"
#include "src/base/file_calls.h"
#include "src/base/memory.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

/* A mapped section as an array: its offset is a multiple of 64. */
static const void *array_get(const struct segment_reader *r, const struct segment_section *section)
{
    return section->offset < r->size ? r->data + section->offset : NULL;
}

/* good[b] = 1 where block b of all arrays of records is; returns how many are not. */
static uint64_t gather_good(const struct segment_verdict *verdict, uint32_t l, uint8_t *good,
                            int64_t blocks)
{
    uint64_t lost = 0;

    for (int64_t b = 0; b < blocks; ++b) {
        good[b] = 1;
        for (size_t a = 0; a < RECORD_ARRAYS; ++a) {
            if (verdict->bad[record_arrays[a].type][l][b] != 0) good[b] = 0;
        }
        lost += !good[b];
    }
    return lost;
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
static kl_status take_records(const struct segment_reader *r, const struct segment_verdict *verdict,
                              uint32_t l, struct segment *out, struct kl_err *err)
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
    const uint64_t bad = gather_good(verdict, l, good, blocks);
    out->damage.blocks += bad;
    if (bad > 0) st = salvage(out, l, good, blocks, err);
    free(good);
    return st;
}

/* The octree of level l, or none where anything in it or in the records is damaged. */
static kl_status take_octree(const struct segment_reader *r, const struct segment_verdict *verdict,
                             uint32_t l, struct segment *out, struct kl_err *err)
{
    const struct segment_section *octree = &r->table.at[SECTION_OCTREE][l];
    const struct segment_section *nodes = &r->table.at[SECTION_NODES][l];
    const struct segment_section *rows = &r->table.at[SECTION_ROWS][l];
    struct kl_level_arrays level = out->levels[l];
    struct kl_err complaint;

    if (octree->offset == 0 && nodes->offset == 0 && rows->offset == 0) return KL_OK;
    if (out->id.kind != SEGMENT_BASE || octree->count != 1 || nodes->offset == 0 ||
        rows->offset == 0) {
        return kl_fail(err, KL_ERR_CORRUPT, "parts of an octree");
    }
    const uint64_t bad = segment_verdict_count_bad(verdict, octree, SECTION_OCTREE, l) +
                         segment_verdict_count_bad(verdict, nodes, SECTION_NODES, l) +
                         segment_verdict_count_bad(verdict, rows, SECTION_ROWS, l);
    out->damage.blocks += bad;
    bool ok = bad == 0 && out->damage.records[l] == 0;
    if (ok) {
        memcpy(&level.octree, array_get(r, octree), sizeof level.octree);
        level.nodes = array_get(r, nodes);
        level.rows = array_get(r, rows);
        ok = level.octree.node_count == nodes->count && level.octree.row_size == rows->count &&
             level.octree.record_count > 0 && octree_check_header(&level, &complaint) == KL_OK &&
             verdict->index_is_sound[l];
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
static kl_status take_births(const struct segment_reader *r, const struct segment_verdict *verdict,
                             uint32_t l, struct segment *out, struct kl_err *err)
{
    const struct segment_section *section = &r->table.at[SECTION_BIRTHS][l];

    if (section->count == 0) return KL_OK;
    if (section->count != r->table.at[record_arrays[0].type][l].count) {
        return kl_fail(err, KL_ERR_CORRUPT, "births of %" PRIu64 " records", section->count);
    }
    const uint64_t bad = segment_verdict_count_bad(verdict, section, SECTION_BIRTHS, l);
    out->damage.blocks += bad;
    if (bad == 0 && out->damage.records[l] == 0) out->births[l] = array_get(r, section);
    return KL_OK;
}

static kl_status take_superseded(const struct segment_reader *r,
                                 const struct segment_verdict *verdict, struct segment *out,
                                 struct kl_err *err)
{
    const struct segment_section *section = &r->table.at[SECTION_SUPERSEDED][0];

    if (section->count == 0) return KL_OK;
    if (out->id.kind != SEGMENT_BASE) {
        return kl_fail(err, KL_ERR_CORRUPT, "a delta cannot supersede");
    }
    const uint64_t bad = segment_verdict_count_bad(verdict, section, SECTION_SUPERSEDED, 0);
    out->damage.blocks += bad;
    if (bad > 0) return KL_OK;
    out->superseded = array_get(r, section);
    out->superseded_count = (size_t)section->count;
    return KL_OK;
}

static void take_parts(const struct segment_reader *r, const struct segment_verdict *verdict,
                       struct segment *out)
{
    const struct segment_section *section = &r->table.at[SECTION_PARTS][0];
    struct kl_err complaint;

    if (section->count == 0) return;
    const uint64_t bad = segment_verdict_count_bad(verdict, section, SECTION_PARTS, 0);
    if (bad > 0 || parts_validate(array_get(r, section), (uint32_t)section->count, &complaint)) {
        out->damage.blocks += bad > 0 ? bad : 1;
        return;
    }
    out->parts = array_get(r, section);
    out->part_count = (uint32_t)section->count;
}

static void take_identity(const struct segment_reader *r, struct segment *out)
{
    out->data = r->data;
    out->size = r->size;
    out->id.kind = read_u32(r->head.at + HDR_KIND);
    out->id.generation = read_u64(r->head.at + HDR_GENERATION);
    out->id.hash = read_u64(r->head.at + r->head.size - 8);
    out->damage.headers = r->head.is_damaged;
    memcpy(out->key.scene, r->head.at + HDR_SCENE, KL_DIGEST_SIZE);
    memcpy(out->key.settings, r->head.at + HDR_SETTINGS, KL_DIGEST_SIZE);
    memcpy(out->key.origin, r->head.at + HDR_ORIGIN, sizeof out->key.origin);
    memcpy(out->program, r->head.at + HDR_PROGRAM, HDR_PROGRAM_SIZE);
    segment_id_format(&out->id, out->name);
}

kl_status segment_parse(const void *data, size_t size, const struct segment_id *id, bool trust,
                        struct segment *out, struct kl_err *err)
{
    struct segment_reader r = {.data = data, .size = size, .trust = trust};
    struct segment_verdict verdict = {0};

    memset(out, 0, sizeof *out);
    kl_status st = segment_head_read(r.data, r.size, id, r.trust, &r.head, err);
    if (st == KL_OK) st = segment_head_sections(&r.head, &r.table, err);
    if (st == KL_OK) st = segment_verify(&r, &verdict, err);
    if (st != KL_OK) return st;
    take_identity(&r, out);
    for (uint32_t l = 0; l < KL_CACHE_LEVELS && st == KL_OK; ++l) {
        st = take_records(&r, &verdict, l, out, err);
        if (st == KL_OK) st = take_octree(&r, &verdict, l, out, err);
        if (st == KL_OK) st = take_births(&r, &verdict, l, out, err);
        if (st != KL_OK) (void)!kl_wrap(err, "level %u", l);
    }
    if (st == KL_OK) {
        take_parts(&r, &verdict, out);
        st = take_superseded(&r, &verdict, out, err);
    }
    segment_verdict_fini(&verdict);
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
