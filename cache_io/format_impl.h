/* The tables of docs/cache_format.md section 3. Private to this folder and its tests. */
#ifndef KL_CACHE_IO_FORMAT_IMPL_H
#define KL_CACHE_IO_FORMAT_IMPL_H

#include "cache_io/store.h"

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "segments are mapped as they are: little-endian machines only"
#endif

#define KL_SEGMENT_MAGIC "\x89KLS\r\n\x1a\n"

enum {
    SEGMENT_MAJOR = 1,
    SEGMENT_MINOR = 0,
    SEGMENT_FEATURES = 0, /* all that we know */
    SEGMENT_MAX_SECTIONS = 64,
    SEGMENT_ALIGN = 64,

    HDR_MAGIC = 0,
    HDR_MAJOR = 8,
    HDR_MINOR = 10,
    HDR_REQUIRED = 12,
    HDR_KIND = 16,
    HDR_SECTIONS = 20,
    HDR_GENERATION = 24,
    HDR_FILE_SIZE = 32,
    HDR_SCENE = 40,
    HDR_SETTINGS = 56,
    HDR_ORIGIN = 72,
    HDR_PROGRAM = 96,
    HDR_PROGRAM_SIZE = 32,
    HDR_TABLE = 128,

    SEC_TYPE = 0,
    SEC_LEVEL = 4,
    SEC_OFFSET = 8,
    SEC_BYTES = 16,
    SEC_COUNT = 24,
    SEC_CHECKSUM = 32,
    SEC_SIZE = 48,

    OLD_KIND = 0,
    OLD_GENERATION = 8,
    OLD_HASH = 16,
    OLD_SIZE = 24,

    HDR_MIN_SIZE = HDR_TABLE + 8,
};

enum segment_kind { SEGMENT_BASE = 1, SEGMENT_DELTA = 2 };

enum section_type {
    SECTION_HOT = 1,
    SECTION_COLD = 2,
    SECTION_OCTREE = 3,
    SECTION_SLOTS = 4,
    SECTION_ROWS = 5,
    SECTION_SUPERSEDED = 6,
    SECTION_PARTS = 7,
    SECTION_TYPES = 8,
};

/* What a file name says. */
struct segment_id {
    uint32_t kind; /* enum segment_kind */
    uint64_t generation;
    uint64_t hash; /* header checksum */
};

enum { SEGMENT_NAME_SIZE = 64 };

/* False: not the name of a segment. */
bool segment_id_parse(const char *name, struct segment_id *id);
void segment_id_format(const struct segment_id *id, char name[SEGMENT_NAME_SIZE]);
bool segment_id_is_equal(const struct segment_id *a, const struct segment_id *b);

/* A segment in memory that was found valid. Arrays point into `data`. */
struct segment {
    struct segment_id id;
    struct kl_store_key key;
    char name[SEGMENT_NAME_SIZE];
    const unsigned char *data;
    size_t size;
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    const unsigned char *superseded; /* OLD_SIZE bytes each */
    size_t superseded_count;
    const kl_part *parts; /* of the scene; NULL: not in this segment */
    uint32_t part_count;
};

struct segment_id segment_superseded_get(const struct segment *segment, size_t i);

/* Check bytes (64-byte aligned) against section 4 of the format; they must outlive *out. `id`: what
 * the name says, NULL: whatever the header says. `trust`: skip checksums, for fuzzing.
 * KL_ERR_CORRUPT, KL_ERR_VERSION. */
kl_status segment_parse(const void *data, size_t size, const struct segment_id *id, bool trust,
                        struct segment *out, struct kl_err *err) KL_MUST_CHECK;
/* Map and parse a file. os_error ENOENT: it is gone. After KL_OK: segment_close. */
kl_status segment_open(int dir_fd, const char *name, struct segment *out,
                       struct kl_err *err) KL_MUST_CHECK;
void segment_close(struct segment *segment);

/* What is to be written. */
struct segment_plan {
    enum segment_kind kind;
    uint64_t generation;
    const struct kl_store_key *key;
    const struct kl_level_arrays *levels; /* KL_CACHE_LEVELS */
    size_t superseded_count;
    const struct segment_id *superseded;
    const kl_part *parts; /* NULL: left out */
    uint32_t part_count;
};

/* Publish by section 5; *id is the new segment's. */
kl_status segment_write(int dir_fd, const struct segment_plan *plan, struct segment_id *id,
                        struct kl_err *err) KL_MUST_CHECK;

/* Items 6 and 7 of section 4 for one level. */
/* The list of a scene's parts. */
kl_status parts_validate(const kl_part *parts, uint32_t count, struct kl_err *err) KL_MUST_CHECK;
kl_status level_validate(const struct kl_level_arrays *level, struct kl_err *err) KL_MUST_CHECK;

uint64_t read_u64(const unsigned char *p);
uint32_t read_u32(const unsigned char *p);
uint32_t read_u16(const unsigned char *p);
void put_u64(unsigned char *p, uint64_t v);
void put_u32(unsigned char *p, uint32_t v);
void put_u16(unsigned char *p, uint32_t v);

#endif
