#include "cache_io/format_impl.h"
#include "cache_io/use_impl.h"
#include "src/base/hash.h"
#include "src/base/memory.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

uint64_t use_place(const kl_record_hot *hot)
{
    unsigned char bytes[20];

    memcpy(bytes, hot->pos, 12);
    memcpy(bytes + 12, &hot->normal, 4);
    memcpy(bytes + 16, &hot->object, 4);
    return kl_hash_block(bytes, sizeof bytes);
}

/* Bits of a place: steps of the upper half from the lower one on, after Kirsch and Mitzenmacher,
 * 2006. Only the last bits of each number count, so a larger set holds them too. */
static uint64_t probe(uint64_t place, uint32_t k)
{
    return place + k * ((place >> 32 | place << 32) | 1u);
}

void use_set_add(struct use_set *set, uint64_t place)
{
    const uint64_t mask = (1ull << set->log2_bits) - 1;

    for (uint32_t k = 0; k < USE_PROBES; ++k) {
        const uint64_t bit = probe(place, k) & mask;
        set->bits[bit / 8] = (unsigned char)(set->bits[bit / 8] | 1u << bit % 8);
    }
    ++set->records;
}

bool use_set_has(const struct use_set *set, uint64_t place)
{
    const uint64_t mask = (1ull << set->log2_bits) - 1;

    for (uint32_t k = 0; k < USE_PROBES; ++k) {
        const uint64_t bit = probe(place, k) & mask;
        if (((uint32_t)set->bits[bit / 8] >> bit % 8 & 1u) == 0) return false;
    }
    return true;
}

kl_status use_set_join(struct use_set *into, const struct use_set *from, struct kl_err *err)
{
    const size_t from_size = (size_t)1 << (from->log2_bits - 3);
    size_t size = (size_t)1 << (into->log2_bits - 3);

    /* In a set of twice the size a place has the same bits or those half the set further on: copies
     * of the smaller set side by side hold what it holds. */
    if (size < from_size) {
        unsigned char *bits = NULL;
        kl_status st = kl_alloc_array(&bits, from_size, 1, err);
        if (st != KL_OK) return st;
        for (size_t at = 0; at < from_size; at += size)
            memcpy(bits + at, into->bits, size);
        free(into->bits);
        into->bits = bits;
        into->log2_bits = from->log2_bits;
        size = from_size;
    }
    for (size_t i = 0; i < size; ++i)
        into->bits[i] = (unsigned char)(into->bits[i] | from->bits[i & (from_size - 1)]);
    into->records += from->records;
    if (from->generation > into->generation) into->generation = from->generation;
    return KL_OK;
}

bool use_name_parse(const char *name, uint64_t *hash)
{
    char again[USE_NAME_SIZE];
    uint64_t value = 0;

    if (strncmp(name, "u-", 2) != 0 || strlen(name) != 22) return false;
    for (int i = 2; i < 18; ++i) {
        const char c = name[i];
        if (!((c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'))) return false;
        value = value << 4 | (uint64_t)(c <= '9' ? c - '0' : c - 'a' + 10);
    }
    use_name_format(value, again);
    *hash = value;
    return strcmp(again, name) == 0;
}

void use_name_format(uint64_t hash, char name[USE_NAME_SIZE])
{
    (void)snprintf(name, USE_NAME_SIZE, "u-%016" PRIx64 ".klu", hash);
}

bool use_is_temp(const char *name)
{
    return strncmp(name, ".u-", 3) == 0 && strstr(name, ".klu.tmp-") != NULL;
}

kl_status use_parse(const void *data, size_t size, const uint64_t *hash, bool trust,
                    struct use_set *out, struct kl_err *err)
{
    const unsigned char *p = data;

    *out = (struct use_set){0};
    if (size < USE_HEAD_SIZE + USE_HASH_SIZE || memcmp(p + USE_MAGIC_AT, USE_MAGIC, 8) != 0) {
        return kl_fail(err, KL_ERR_CORRUPT, "not a use file");
    }
    if (read_u16(p + USE_MAJOR_AT) != USE_MAJOR) {
        return kl_fail(err, KL_ERR_VERSION, "version %u, this program reads %d",
                       read_u16(p + USE_MAJOR_AT), USE_MAJOR);
    }
    const uint32_t log2_bits = read_u32(p + USE_BITS_AT);
    if (log2_bits < USE_LEAST_BITS || log2_bits > USE_MOST_BITS ||
        size != USE_HEAD_SIZE + USE_HASH_SIZE + ((uint64_t)1 << (log2_bits - 3))) {
        return kl_fail(err, KL_ERR_CORRUPT, "%zu bytes do not hold a set of 2^%u bits", size,
                       log2_bits);
    }
    const uint64_t said = read_u64(p + size - USE_HASH_SIZE);
    if ((hash != NULL && *hash != said) ||
        (!trust && kl_hash_block(p, size - USE_HASH_SIZE) != said)) {
        return kl_fail(err, KL_ERR_CORRUPT, "checksum does not match");
    }
    const uint64_t generation = read_u64(p + USE_GENERATION_AT);
    if (generation > INT64_MAX) return kl_fail(err, KL_ERR_CORRUPT, "generation out of range");
    kl_status st = kl_alloc_array(&out->bits, (size_t)1 << (log2_bits - 3), 1, err);
    if (st != KL_OK) return st;
    memcpy(out->bits, p + USE_HEAD_SIZE, (size_t)1 << (log2_bits - 3));
    out->log2_bits = log2_bits;
    out->generation = generation;
    out->records = read_u64(p + USE_RECORDS_AT);
    return KL_OK;
}
