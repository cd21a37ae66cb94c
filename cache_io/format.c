#include "cache_io/format_impl.h"

#include <inttypes.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

const struct record_array record_arrays[RECORD_ARRAYS] = {
    {SECTION_HOT, sizeof(kl_record_hot), offsetof(struct kl_level_arrays, hot)},
    {SECTION_COLD, sizeof(kl_record_cold), offsetof(struct kl_level_arrays, cold)},
};

const void *record_array_get(const struct kl_level_arrays *level, const struct record_array *array)
{
    const void *items = NULL;

    memcpy(&items, (const char *)level + array->at, sizeof items);
    return items;
}

void record_array_set(struct kl_level_arrays *level, const struct record_array *array,
                      const void *items)
{
    memcpy((char *)level + array->at, &items, sizeof items);
}

uint32_t read_u16(const unsigned char *p)
{
    return (uint32_t)p[0] | (uint32_t)p[1] << 8;
}

uint32_t read_u32(const unsigned char *p)
{
    return read_u16(p) | read_u16(p + 2) << 16;
}

uint64_t read_u64(const unsigned char *p)
{
    return (uint64_t)read_u32(p) | (uint64_t)read_u32(p + 4) << 32;
}

void put_u16(unsigned char *p, uint32_t v)
{
    p[0] = (unsigned char)(v & 0xff);
    p[1] = (unsigned char)(v >> 8 & 0xff);
}

void put_u32(unsigned char *p, uint32_t v)
{
    put_u16(p, v);
    put_u16(p + 2, v >> 16);
}

void put_u64(unsigned char *p, uint64_t v)
{
    put_u32(p, (uint32_t)(v & 0xffffffffu));
    put_u32(p + 4, (uint32_t)(v >> 32));
}

static int hex_digit(char c)
{
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    return -1;
}

bool segment_id_parse(const char *name, struct segment_id *id)
{
    struct segment_id parsed = {0};
    size_t digits = 0;

    if (name[0] == 'b') {
        parsed.kind = SEGMENT_BASE;
    } else if (name[0] == 'd') {
        parsed.kind = SEGMENT_DELTA;
    } else {
        return false;
    }
    if (name[1] != '-') return false;
    const char *p = name + 2;
    for (; *p >= '0' && *p <= '9' && digits < 19; ++p, ++digits) {
        parsed.generation = parsed.generation * 10 + (uint64_t)(*p - '0');
    }
    if (digits < 8 || *p++ != '-') return false;
    for (int i = 0; i < 16; ++i, ++p) {
        const int digit = hex_digit(*p);
        if (digit < 0) return false;
        parsed.hash = parsed.hash << 4 | (uint64_t)digit;
    }
    if (strcmp(p, ".kls") != 0) return false;
    *id = parsed;
    /* Leading zeros beyond 8 digits would give one segment two names. */
    char canonical[SEGMENT_NAME_SIZE];
    segment_id_format(id, canonical);
    return strcmp(canonical, name) == 0;
}

void segment_id_format(const struct segment_id *id, char name[SEGMENT_NAME_SIZE])
{
    (void)snprintf(name, SEGMENT_NAME_SIZE, "%c-%08" PRIu64 "-%016" PRIx64 ".kls",
                   id->kind == SEGMENT_BASE ? 'b' : 'd', id->generation, id->hash);
}

bool segment_id_is_equal(const struct segment_id *a, const struct segment_id *b)
{
    return a->kind == b->kind && a->generation == b->generation && a->hash == b->hash;
}

int segment_id_compare(const void *a, const void *b)
{
    const struct segment_id *x = a;
    const struct segment_id *y = b;

    if (x->generation != y->generation) return x->generation < y->generation ? -1 : 1;
    if (x->kind != y->kind) return x->kind < y->kind ? -1 : 1;
    return (x->hash > y->hash) - (x->hash < y->hash);
}

bool segment_is_temp(const char *name)
{
    return name[0] == '.' && (name[1] == 'b' || name[1] == 'd') && name[2] == '-' &&
           strstr(name, ".kls.tmp-") != NULL;
}

struct segment_id segment_superseded_get(const struct segment *segment, size_t i)
{
    const unsigned char *p = segment->superseded + i * OLD_SIZE;
    const struct segment_id id = {
        .kind = read_u32(p + OLD_KIND),
        .generation = read_u64(p + OLD_GENERATION),
        .hash = read_u64(p + OLD_HASH),
    };

    return id;
}
