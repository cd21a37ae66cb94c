/* The tables of docs/cache_format.md section 3. Private to this folder and its tests. */
#ifndef KL_CACHE_IO_FORMAT_IMPL_H
#define KL_CACHE_IO_FORMAT_IMPL_H

#include "cache_io/store.h"

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "segments are mapped as they are: little-endian machines only"
#endif

#define KL_SEGMENT_MAGIC "\x89KLS\r\n\x1a\n"

enum {
    SEGMENT_MAJOR = 3,
    SEGMENT_MINOR = 0,
    SEGMENT_FEATURES = 0, /* all that we know */
    SEGMENT_MAX_SECTIONS = 64,
    SEGMENT_ALIGN = 64,
    SEGMENT_BLOCK_RECORDS = 1024, /* records that share a checksum in each of their arrays */
    SEGMENT_BLOCK_BYTES = 65536,  /* bytes that share a checksum in every other section */

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
    HDR_BLOCKS = 128,
    HDR_TABLE = 192,

    SEC_TYPE = 0,
    SEC_LEVEL = 4,
    SEC_OFFSET = 8,
    SEC_BYTES = 16,
    SEC_COUNT = 24,
    SEC_FIRST_BLOCK = 32,
    SEC_BLOCK_BYTES = 40,
    SEC_SIZE = 48,

    OLD_KIND = 0,
    OLD_GENERATION = 8,
    OLD_HASH = 16,
    OLD_SIZE = 24,

    HDR_END = 16, /* size of the header, checksum: its last bytes, and the last of the file */
    HDR_MIN_SIZE = HDR_TABLE + HDR_END,
};

enum segment_kind { SEGMENT_BASE = 1, SEGMENT_DELTA = 2 };

enum section_type {
    SECTION_HOT = 1,
    SECTION_COLD = 2,
    SECTION_OCTREE = 3,
    SECTION_NODES = 4,
    SECTION_ROWS = 5,
    SECTION_SUPERSEDED = 6,
    SECTION_PARTS = 7,
    SECTION_BIRTHS = 8,
    SECTION_TYPES = 9,
};

/* The arrays of a level that have one item a record, in the order of the file. */
enum { RECORD_ARRAYS = 2 };
struct record_array {
    enum section_type type;
    size_t item; /* bytes of an item */
    size_t at;   /* offset of its pointer in struct kl_level_arrays */
};
extern const struct record_array record_arrays[RECORD_ARRAYS];
const void *record_array_get(const struct kl_level_arrays *level, const struct record_array *array);
void record_array_set(struct kl_level_arrays *level, const struct record_array *array,
                      const void *items);

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
/* By generation, kind and hash: the reading order. For qsort and bsearch. */
int segment_id_compare(const void *a, const void *b);
/* `.b-....kls.tmp-PID` of a writer. */
bool segment_is_temp(const char *name);

/* A segment in memory whose header was found valid. Arrays point into `data`, or, where blocks were
 * left out, into `salvaged`. */
struct segment {
    struct segment_id id;
    struct kl_store_key key;
    char name[SEGMENT_NAME_SIZE];
    char program[HDR_PROGRAM_SIZE + 1];
    const unsigned char *data;
    size_t size; /* of the file */
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    void *salvaged[KL_CACHE_LEVELS][RECORD_ARRAYS];
    const uint32_t *births[KL_CACHE_LEVELS]; /* NULL: all are of this generation */
    const unsigned char *superseded;         /* OLD_SIZE bytes each */
    size_t superseded_count;
    const kl_part *parts; /* of the scene; NULL: not in this segment */
    uint32_t part_count;
    struct kl_store_damage damage;
};

struct segment_id segment_superseded_get(const struct segment *segment, size_t i);

/* Check bytes (64-byte aligned) against section 4 of the format; they must outlive *out. `id`: what
 * the name says, NULL: whatever the header says. `trust`: skip checksums, for fuzzing. Bad blocks
 * are left out and counted in out->damage. After KL_OK: segment_fini. KL_ERR_CORRUPT: nothing of it
 * can be used; KL_ERR_VERSION. */
kl_status segment_parse(const void *data, size_t size, const struct segment_id *id, bool trust,
                        struct segment *out, struct kl_err *err) KL_MUST_CHECK;
void segment_fini(struct segment *segment);
/* Map and parse a file. os_error ENOENT: it is gone. After KL_OK: segment_close. */
kl_status segment_open(int dir_fd, const char *name, struct segment *out,
                       struct kl_err *err) KL_MUST_CHECK;
/* The same for an open file, which stays the caller's. */
kl_status segment_map(int fd, const struct segment_id *id, struct segment *out,
                      struct kl_err *err) KL_MUST_CHECK;
void segment_close(struct segment *segment);

/* What is to be written. */
struct segment_plan {
    enum segment_kind kind;
    uint64_t generation;
    const struct kl_store_key *key;
    const struct kl_level_arrays *levels; /* KL_CACHE_LEVELS */
    const uint32_t *const *births; /* KL_CACHE_LEVELS; NULL: none, in it: not of this level */
    size_t superseded_count;
    const struct segment_id *superseded;
    const kl_part *parts; /* NULL: left out */
    uint32_t part_count;
};

/* Publish by section 5. *out: the new segment, mapped and verified before anyone could see it. */
kl_status segment_write(int dir_fd, const struct segment_plan *plan, struct segment *out,
                        struct kl_err *err) KL_MUST_CHECK;

/* Records of a level are sound. */
bool records_are_valid(const struct kl_level_arrays *level);
/* So are those of a block of their array; what is of another type has nothing to say by itself. */
bool record_block_is_sound(enum section_type type, const void *block, size_t bytes);
/* The list of a scene's parts. */
kl_status parts_validate(const kl_part *parts, uint32_t count, struct kl_err *err) KL_MUST_CHECK;
/* The octree's arrays lead nowhere else: section 4, item 8. */
kl_status octree_validate(const struct kl_level_arrays *level, struct kl_err *err) KL_MUST_CHECK;
/* The steps of it. The header. */
kl_status octree_check_header(const struct kl_level_arrays *level,
                              struct kl_err *err) KL_MUST_CHECK;
/* Blocks of nodes and of rows, in any order: `start` is the byte in its array where a block begins.
 * What is of another type has nothing to say. */
struct index_counts {
    uint64_t nodes, rows, records; /* that they may lead to */
};
bool index_block_is_sound(enum section_type type, const void *block, size_t bytes, uint64_t start,
                          const struct index_counts *counts);

uint64_t read_u64(const unsigned char *p);
uint32_t read_u32(const unsigned char *p);
uint32_t read_u16(const unsigned char *p);
void put_u64(unsigned char *p, uint64_t v);
void put_u32(unsigned char *p, uint32_t v);
void put_u16(unsigned char *p, uint32_t v);

#endif
