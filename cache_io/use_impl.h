/* Use files: section 8 of docs/cache_format.md. Private to this folder and its tests. */
#ifndef KL_CACHE_IO_USE_IMPL_H
#define KL_CACHE_IO_USE_IMPL_H

#include "cache_io/use.h"

enum {
    USE_MAJOR = 1,
    USE_LEAST_BITS = 9, /* logarithms of the number of bits */
    USE_MOST_BITS = 36,
    USE_PROBES = 4,
    USE_MOST_FILES = 16, /* then the next one takes their place */
    USE_NAME_SIZE = 32,

    USE_MAGIC_AT = 0,
    USE_MAJOR_AT = 8,
    USE_BITS_AT = 12,
    USE_GENERATION_AT = 16,
    USE_RECORDS_AT = 24,
    USE_HEAD_SIZE = 64,
    USE_HASH_SIZE = 8, /* behind the bits */
};
#define USE_MAGIC "\x89KLU\r\n\x1a\n"

/* A set of places: a filter after Bloom, 1970. */
struct use_set {
    uint32_t log2_bits;
    uint64_t generation; /* of the store that it was told about */
    uint64_t records;    /* that were added */
    unsigned char *bits; /* owned */
};

uint64_t use_place(const kl_record_hot *hot);
void use_set_add(struct use_set *set, uint64_t place);
bool use_set_has(const struct use_set *set, uint64_t place);
/* All that is in `from` is in `into` too; its size does not change, or grows to that of `from`. */
kl_status use_set_join(struct use_set *into, const struct use_set *from,
                       struct kl_err *err) KL_MUST_CHECK;

/* False: not the name of a use file. */
bool use_name_parse(const char *name, uint64_t *hash);
void use_name_format(uint64_t hash, char name[USE_NAME_SIZE]);
bool use_is_temp(const char *name);
/* Check bytes against the format. `hash`: what the name says, NULL: whatever; `trust`: the checksum
 * is not looked at, for fuzzing. After KL_OK free out->bits. */
kl_status use_parse(const void *data, size_t size, const uint64_t *hash, bool trust,
                    struct use_set *out, struct kl_err *err) KL_MUST_CHECK;

#endif
