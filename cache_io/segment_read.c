#include "cache_io/format_impl.h"
#include "src/base/hash.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

static const size_t item_sizes[SECTION_TYPES] = {
    [SECTION_HOT] = sizeof(kl_record_hot),
    [SECTION_COLD] = sizeof(kl_record_cold),
    [SECTION_OCTREE] = sizeof(kl_octree_header),
    [SECTION_SLOTS] = sizeof(kl_octree_slot),
    [SECTION_ROWS] = sizeof(kl_u32),
    [SECTION_SUPERSEDED] = OLD_SIZE,
    [SECTION_PARTS] = sizeof(kl_part),
};

struct section {
    const unsigned char *data; /* NULL: absent */
    uint64_t count;
};

struct table {
    struct section at[SECTION_TYPES][KL_CACHE_LEVELS];
};

static size_t header_size(const unsigned char *data)
{
    return HDR_TABLE + (size_t)read_u32(data + HDR_SECTIONS) * SEC_SIZE + 8;
}

static kl_status check_start(const unsigned char *data, size_t size, struct kl_err *err)
{
    if (size < HDR_MIN_SIZE) {
        return kl_fail(err, KL_ERR_CORRUPT, "%zu bytes are less than a header", size);
    }
    if (memcmp(data + HDR_MAGIC, KL_SEGMENT_MAGIC, 8) != 0) {
        return kl_fail(err, KL_ERR_CORRUPT, "not a cache segment (magic)");
    }
    if (read_u16(data + HDR_MAJOR) != SEGMENT_MAJOR) {
        return kl_fail(err, KL_ERR_VERSION, "format version %u, this program reads %d",
                       read_u16(data + HDR_MAJOR), SEGMENT_MAJOR);
    }
    return KL_OK;
}

static kl_status check_header(const unsigned char *data, size_t size, const struct segment_id *id,
                              bool trust, struct segment *out, struct kl_err *err)
{
    const uint32_t sections = read_u32(data + HDR_SECTIONS);

    if (sections > SEGMENT_MAX_SECTIONS || header_size(data) > size) {
        return kl_fail(err, KL_ERR_CORRUPT, "%u sections in %zu bytes", sections, size);
    }
    const size_t covered = header_size(data) - 8;
    out->id.hash = read_u64(data + covered);
    if (!trust && kl_hash_block(data, covered) != out->id.hash) {
        return kl_fail(err, KL_ERR_CORRUPT, "header checksum does not match");
    }
    if ((read_u32(data + HDR_REQUIRED) & ~(uint32_t)SEGMENT_FEATURES) != 0) {
        return kl_fail(err, KL_ERR_VERSION, "needs features 0x%x, which this program does not know",
                       read_u32(data + HDR_REQUIRED));
    }
    out->id.kind = read_u32(data + HDR_KIND);
    out->id.generation = read_u64(data + HDR_GENERATION);
    if (read_u64(data + HDR_FILE_SIZE) != size) {
        return kl_fail(err, KL_ERR_CORRUPT, "%zu bytes, the header says %" PRIu64, size,
                       read_u64(data + HDR_FILE_SIZE));
    }
    if (out->id.kind != SEGMENT_BASE && out->id.kind != SEGMENT_DELTA) {
        return kl_fail(err, KL_ERR_CORRUPT, "unknown kind %u", out->id.kind);
    }
    if (out->id.generation > INT64_MAX || (id != NULL && !segment_id_is_equal(id, &out->id))) {
        return kl_fail(err, KL_ERR_CORRUPT, "the header is of another file name");
    }
    memcpy(out->key.scene, data + HDR_SCENE, KL_DIGEST_SIZE);
    memcpy(out->key.settings, data + HDR_SETTINGS, KL_DIGEST_SIZE);
    memcpy(out->key.origin, data + HDR_ORIGIN, sizeof out->key.origin);
    for (int i = 0; i < 3; ++i) {
        if (!isfinite(out->key.origin[i])) return kl_fail(err, KL_ERR_CORRUPT, "origin not finite");
    }
    return KL_OK;
}

/* The one place that verifies the content of sections against their checksums. */
static bool section_is_intact(const unsigned char *entry, const unsigned char *data)
{
    return kl_hash_block(data, (size_t)read_u64(entry + SEC_BYTES)) ==
           read_u64(entry + SEC_CHECKSUM);
}

static kl_status read_section(const struct segment *segment, const unsigned char *entry, bool trust,
                              struct table *table, struct kl_err *err)
{
    const uint32_t type = read_u32(entry + SEC_TYPE);
    const uint32_t level = read_u32(entry + SEC_LEVEL);
    const uint64_t offset = read_u64(entry + SEC_OFFSET);
    const uint64_t bytes = read_u64(entry + SEC_BYTES);
    const uint64_t count = read_u64(entry + SEC_COUNT);

    if (type == 0 || type >= SECTION_TYPES) return KL_OK; /* of a newer minor version */
    if (level >= KL_CACHE_LEVELS || offset % SEGMENT_ALIGN != 0 ||
        offset < header_size(segment->data) || offset > segment->size ||
        bytes > segment->size - offset || count > UINT32_MAX || bytes != count * item_sizes[type]) {
        return kl_fail(err, KL_ERR_CORRUPT, "section %u of level %u does not fit", type, level);
    }
    struct section *section = &table->at[type][level];
    if (section->data != NULL) {
        return kl_fail(err, KL_ERR_CORRUPT, "section %u of level %u twice", type, level);
    }
    section->data = segment->data + offset;
    section->count = count;
    if (!trust && !section_is_intact(entry, section->data)) {
        return kl_fail(err, KL_ERR_CORRUPT, "section %u of level %u: checksum does not match", type,
                       level);
    }
    return KL_OK;
}

/* A mapped section as an array: its offset is a multiple of 64. */
static const void *array_get(const struct section *section)
{
    return section->data;
}

static kl_status take_level(const struct table *table, uint32_t l, uint32_t kind,
                            struct kl_level_arrays *level, struct kl_err *err)
{
    const struct section *hot = &table->at[SECTION_HOT][l];
    const struct section *cold = &table->at[SECTION_COLD][l];
    const struct section *octree = &table->at[SECTION_OCTREE][l];
    const struct section *slots = &table->at[SECTION_SLOTS][l];
    const struct section *rows = &table->at[SECTION_ROWS][l];

    memset(level, 0, sizeof *level);
    if (hot->count != cold->count) {
        return kl_fail(err, KL_ERR_CORRUPT, "%" PRIu64 " hot and %" PRIu64 " cold records",
                       hot->count, cold->count);
    }
    level->record_count = (uint32_t)hot->count;
    level->hot = array_get(hot);
    level->cold = array_get(cold);
    if (octree->data == NULL && slots->data == NULL && rows->data == NULL) return KL_OK;
    if (kind != SEGMENT_BASE || octree->count != 1 || slots->data == NULL || rows->data == NULL) {
        return kl_fail(err, KL_ERR_CORRUPT, "parts of an octree");
    }
    memcpy(&level->octree, octree->data, sizeof level->octree);
    level->slots = array_get(slots);
    level->rows = array_get(rows);
    if (level->octree.slot_count != slots->count || level->octree.row_size != rows->count ||
        level->octree.record_count == 0) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: counts are not those of its arrays");
    }
    return KL_OK;
}

kl_status segment_parse(const void *data, size_t size, const struct segment_id *id, bool trust,
                        struct segment *out, struct kl_err *err)
{
    struct table table = {0};

    memset(out, 0, sizeof *out);
    out->data = data;
    out->size = size;
    kl_status st = check_start(out->data, size, err);
    if (st != KL_OK) return st;
    st = check_header(out->data, size, id, trust, out, err);
    if (st != KL_OK) return st;
    const uint32_t sections = read_u32(out->data + HDR_SECTIONS);
    for (uint32_t i = 0; i < sections; ++i) {
        st = read_section(out, out->data + HDR_TABLE + (size_t)i * SEC_SIZE, trust, &table, err);
        if (st != KL_OK) return st;
    }
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        st = take_level(&table, l, out->id.kind, &out->levels[l], err);
        if (st == KL_OK) st = level_validate(&out->levels[l], err);
        if (st != KL_OK) return kl_wrap(err, "level %u", l);
    }
    const struct section *superseded = &table.at[SECTION_SUPERSEDED][0];
    if (superseded->count > 0 && out->id.kind != SEGMENT_BASE) {
        return kl_fail(err, KL_ERR_CORRUPT, "a delta cannot supersede");
    }
    out->superseded = superseded->data;
    out->superseded_count = (size_t)superseded->count;
    const struct section *parts = &table.at[SECTION_PARTS][0];
    out->parts = array_get(parts);
    out->part_count = (uint32_t)parts->count;
    st = parts_validate(out->parts, out->part_count, err);
    if (st != KL_OK) return st;
    segment_id_format(&out->id, out->name);
    return KL_OK;
}

kl_status segment_open(int dir_fd, const char *name, struct segment *out, struct kl_err *err)
{
    struct segment_id id;
    struct stat info;
    void *map = MAP_FAILED;
    kl_status st = KL_OK;

    if (!segment_id_parse(name, &id)) {
        return kl_fail(err, KL_ERR_USAGE, "%s: not a segment's name", name);
    }
    const int fd = openat(dir_fd, name, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0) return kl_fail_errno(err, "%s: open", name);
    if (fstat(fd, &info) != 0) {
        st = kl_fail_errno(err, "%s: stat", name);
    } else if (!S_ISREG(info.st_mode) || info.st_size < HDR_MIN_SIZE) {
        st = kl_fail(err, KL_ERR_CORRUPT, "%s: not a file that holds a header", name);
    } else {
        map = mmap(NULL, (size_t)info.st_size, PROT_READ, MAP_SHARED, fd, 0);
        if (map == MAP_FAILED) st = kl_fail_errno(err, "%s: map", name);
    }
    close(fd);
    if (st != KL_OK) return st;
    st = segment_parse(map, (size_t)info.st_size, &id, false, out, err);
    if (st != KL_OK) {
        (void)munmap(map, (size_t)info.st_size);
        return kl_wrap(err, "%s", name);
    }
    return KL_OK;
}

void segment_close(struct segment *segment)
{
    union {
        const unsigned char *borrowed;
        void *owned;
    } map = {.borrowed = segment->data}; /* munmap takes no pointer to const */

    if (map.owned != NULL) (void)munmap(map.owned, segment->size);
    segment->data = NULL;
}
