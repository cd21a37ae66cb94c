#include "cache_io/segment_verify_impl.h"

#include "src/base/hash.h"
#include "src/base/memory.h"

#include <stdlib.h>

enum {
    UNIT_BYTES = 2 << 20,            /* that a thread takes at a time */
    PARALLEL_BYTES = 4 * UNIT_BYTES, /* less is not worth a team of threads */
};

/* Blocks of one section that one thread verifies. */
struct unit {
    enum section_type type;
    uint32_t level;
    uint64_t first, end;
    bool is_sound; /* of nodes and rows */
};

static uint64_t units_of(const struct segment_section *section, uint64_t *step)
{
    const uint64_t blocks = section_block_count(section);

    *step = 1;
    if (blocks == 0) return 0;
    *step = UNIT_BYTES / section->block_bytes;
    return (blocks + *step - 1) / *step;
}

uint64_t section_block_count(const struct segment_section *section)
{
    return section->offset == 0
               ? 0
               : (section->bytes + section->block_bytes - 1) / section->block_bytes;
}

/* The one place that verifies content against checksums. *at: the block; NULL where it is bad. */
static const unsigned char *block_get(const struct segment_reader *r,
                                      const struct segment_section *section, uint64_t block,
                                      size_t *bytes)
{
    const uint64_t start = block * section->block_bytes;
    const uint64_t left = section->bytes - start;
    const uint64_t offset = section->offset + start;

    *bytes = (size_t)(left < section->block_bytes ? left : section->block_bytes);
    if (offset > r->size || *bytes > r->size - offset) return NULL; /* cut off */
    if (r->trust) return r->data + offset;
    return kl_hash_block(r->data + offset, *bytes) ==
                   read_u64(r->head.checksums + (section->first_block + block) * 8)
               ? r->data + offset
               : NULL;
}

static void verify_unit(const struct segment_reader *r, struct unit *unit,
                        struct segment_verdict *out)
{
    const struct segment_section *section = &r->table.at[unit->type][unit->level];
    const struct index_counts counts = {r->table.at[SECTION_NODES][unit->level].count,
                                        r->table.at[SECTION_ROWS][unit->level].count,
                                        r->table.at[record_arrays[0].type][unit->level].count};
    uint8_t *bad = out->bad[unit->type][unit->level];

    unit->is_sound = true;
    for (uint64_t b = unit->first; b < unit->end; ++b) {
        size_t bytes = 0;
        const void *at = block_get(r, section, b, &bytes);
        bad[b] = at == NULL || !record_block_is_sound(unit->type, at, bytes);
        unit->is_sound =
            unit->is_sound && bad[b] == 0 &&
            index_block_is_sound(unit->type, at, bytes, b * section->block_bytes, &counts);
    }
}

static bool index_is_sound(const struct unit *units, size_t count, uint32_t level)
{
    bool ok = true;

    for (size_t i = 0; i < count; ++i) {
        const bool is_index = units[i].type == SECTION_NODES || units[i].type == SECTION_ROWS;
        if (units[i].level == level && is_index) ok = ok && units[i].is_sound;
    }
    return ok;
}

/* What is to be done, the longest first. */
static kl_status list_units(const struct segment_reader *r, struct unit **out, size_t *count,
                            struct kl_err *err)
{
    static const enum section_type order[] = {
        SECTION_ROWS,   SECTION_HOT,        SECTION_COLD,  SECTION_NODES,
        SECTION_OCTREE, SECTION_SUPERSEDED, SECTION_PARTS, SECTION_BIRTHS,
    };
    uint64_t total = 0;
    uint64_t step = 0;

    for (size_t t = 0; t < sizeof order / sizeof *order; ++t) {
        for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l)
            total += units_of(&r->table.at[order[t]][l], &step);
    }
    *count = 0;
    kl_status st = kl_alloc_array(out, (size_t)total, sizeof **out, err);
    if (st != KL_OK) return st;
    for (size_t t = 0; t < sizeof order / sizeof *order; ++t) {
        for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
            const struct segment_section *section = &r->table.at[order[t]][l];
            const uint64_t blocks = section_block_count(section);
            const uint64_t n = units_of(section, &step);
            for (uint64_t u = 0; u < n; ++u) {
                const uint64_t end = (u + 1) * step < blocks ? (u + 1) * step : blocks;
                (*out)[(*count)++] =
                    (struct unit){.type = order[t], .level = l, .first = u * step, .end = end};
            }
        }
    }
    return KL_OK;
}

static kl_status allocate(const struct segment_reader *r, struct segment_verdict *out,
                          struct kl_err *err)
{
    uint64_t blocks = 0;

    for (uint32_t t = 0; t < SECTION_TYPES; ++t) {
        for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l)
            blocks += section_block_count(&r->table.at[t][l]);
    }
    kl_status st = kl_alloc_array(&out->storage, (size_t)blocks, 1, err);
    uint8_t *at = out->storage;
    for (uint32_t t = 0; t < SECTION_TYPES && st == KL_OK; ++t) {
        for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
            const uint64_t n = section_block_count(&r->table.at[t][l]);
            if (n > 0) out->bad[t][l] = at;
            at += n;
        }
    }
    return st;
}

kl_status segment_verify(const struct segment_reader *reader, struct segment_verdict *out,
                         struct kl_err *err)
{
    struct unit *units = NULL;
    size_t count = 0;

    *out = (struct segment_verdict){0};
    kl_status st = allocate(reader, out, err);
    if (st == KL_OK) st = list_units(reader, &units, &count, err);
    if (st != KL_OK) {
        segment_verdict_fini(out);
        return st;
    }
#pragma omp parallel for schedule(dynamic, 1) if (reader->size >= PARALLEL_BYTES)
    for (size_t i = 0; i < count; ++i) {
        verify_unit(reader, &units[i], out);
    }
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l)
        out->index_is_sound[l] = index_is_sound(units, count, l);
    free(units);
    return KL_OK;
}

uint64_t segment_verdict_count_bad(const struct segment_verdict *verdict,
                                   const struct segment_section *section, enum section_type type,
                                   uint32_t level)
{
    const uint64_t blocks = section_block_count(section);
    uint64_t bad = 0;

    for (uint64_t b = 0; b < blocks; ++b)
        bad += verdict->bad[type][level][b];
    return bad;
}

void segment_verdict_fini(struct segment_verdict *verdict)
{
    free(verdict->storage);
    *verdict = (struct segment_verdict){0};
}
