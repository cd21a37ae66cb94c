#include "cache_io/format_impl.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

/* What the words of a record may be, eight at a time and without a branch: a store of 10^7 records
 * is looked through whenever it is opened. The type is one that GCC and Clang know; they make do
 * where a machine has narrower vectors. */
typedef uint32_t words __attribute__((vector_size(32)));

struct word_rules {
    words exponent; /* of floats or pairs of halves: not all of its bits are set */
    words carry;    /* least bits of `exponent` */
    words over;     /* where it carries to if they all are */
    words clear;    /* bits that are 0 */
    words zero;     /* sign, that only a 0 may have */
    words more;     /* sign: the word is not 0 */
};

#define SIGN       0x80000000u
#define FLOAT      0x7f800000u
#define CARRY      0x00800000u
#define HALF2      0x7c007c00u
#define HALF_CARRY 0x04000400u
#define HALF_SIGN  0x80008000u

/* clang-format off */
/* kl_record_hot: position x 3, normal, radius, radius2, form, object. */
static const struct word_rules hot_rules = {
    .exponent = {FLOAT, FLOAT, FLOAT, 0, FLOAT, FLOAT, 0,           0},
    .carry    = {CARRY, CARRY, CARRY, 0, CARRY, CARRY, 0,           0},
    .over     = {SIGN,  SIGN,  SIGN,  0, SIGN,  SIGN,  0,           0},
    .clear    = {0,     0,     0,     0, SIGN,  SIGN,  0x00e00000u, 0},
    .zero     = {0},
    .more     = {0,     0,     0,     0, SIGN,  SIGN,  0,           0},
};
/* kl_record_cold: irradiance x 3, gradients x 5; gradients, raw radius, error and spacing, clearance
 * x 3, touched x 2. */
static const struct word_rules cold_rules[2] = {{
    .exponent = {FLOAT, FLOAT, FLOAT, HALF2, HALF2, HALF2, HALF2, HALF2},
    .carry    = {CARRY, CARRY, CARRY, HALF_CARRY, HALF_CARRY, HALF_CARRY, HALF_CARRY, HALF_CARRY},
    .over     = {SIGN,  SIGN,  SIGN,  HALF_SIGN,  HALF_SIGN,  HALF_SIGN,  HALF_SIGN,  HALF_SIGN},
    .clear    = {0},
    .zero     = {SIGN,  SIGN,  SIGN},
    .more     = {0},
}, {
    .exponent = {HALF2,      FLOAT, HALF2},
    .carry    = {HALF_CARRY, CARRY, HALF_CARRY},
    .over     = {HALF_SIGN,  SIGN,  HALF_SIGN},
    .clear    = {0,          SIGN,  HALF_SIGN},
    .zero     = {0},
    .more     = {0,          SIGN,  0},
}};
/* clang-format on */
_Static_assert(KL_CACHE_LEVELS == 2, "the rule for `form` lets 2 levels through");
_Static_assert(offsetof(kl_record_hot, form) == 24, "hot_rules are of another layout");
_Static_assert(offsetof(kl_record_cold, raw_radius) == 36, "cold_rules are of another layout");
_Static_assert(offsetof(kl_record_cold, error_spacing) == 40, "cold_rules are of another layout");

static inline words broken_rules(const struct word_rules *rules, const void *at)
{
    words w;

    memcpy(&w, at, sizeof w);
    return (((w & rules->exponent) + rules->carry) & rules->over) | (w & rules->clear) |
           (w & (w - 1u) & rules->zero) | ((w - 1u) & rules->more);
}

static bool is_zero(words w)
{
    uint32_t any = 0;

    for (int k = 0; k < 8; ++k)
        any |= w[k];
    return any == 0;
}

static bool hots_are_sound(const kl_record_hot *hot, size_t count)
{
    words bad = {0};
    uint32_t swapped = 0;

    for (size_t i = 0; i < count; ++i) {
        bad |= broken_rules(&hot_rules, &hot[i]);
        swapped |= (uint32_t)(hot[i].radius > hot[i].radius2);
    }
    return is_zero(bad) && swapped == 0;
}

static bool colds_are_sound(const kl_record_cold *cold, size_t count)
{
    words bad = {0};

    for (size_t i = 0; i < count; ++i) {
        const char *at = (const char *)&cold[i];
        bad |= broken_rules(&cold_rules[0], at) | broken_rules(&cold_rules[1], at + sizeof(words));
    }
    return is_zero(bad);
}

bool kl_record_is_valid(const kl_record_hot *hot, const kl_record_cold *cold)
{
    return hots_are_sound(hot, 1) && colds_are_sound(cold, 1);
}

bool record_block_is_sound(enum section_type type, const void *block, size_t bytes)
{
    if (type == SECTION_HOT) return hots_are_sound(block, bytes / sizeof(kl_record_hot));
    if (type == SECTION_COLD) return colds_are_sound(block, bytes / sizeof(kl_record_cold));
    return true;
}

bool records_are_valid(const struct kl_level_arrays *level)
{
    return hots_are_sound(level->hot, level->record_count) &&
           colds_are_sound(level->cold, level->record_count);
}

kl_status octree_check_header(const struct kl_level_arrays *level, struct kl_err *err)
{
    const kl_octree_header *head = &level->octree;
    int exponent = 0;

    for (int i = 0; i < 3; ++i) {
        if (!isfinite(head->root_min[i])) {
            return kl_fail(err, KL_ERR_CORRUPT, "octree: root corner is not finite");
        }
    }
    if (!isfinite(head->side) || !(head->side > 0.0f) || frexpf(head->side, &exponent) != 0.5f) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: side %g is not a power of two",
                       (double)head->side);
    }
    if (!isfinite(head->reach) || !(head->reach > 0.0f)) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: reach %g is not positive",
                       (double)head->reach);
    }
    if (head->top_bits > KL_TOP_BITS_MAX || head->node_count < 1u << 3 * head->top_bits) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: %u nodes do not hold a grid of 2^%u",
                       head->node_count, head->top_bits);
    }
    if (head->record_count != level->record_count) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: %u records, the level has %u",
                       head->record_count, level->record_count);
    }
    return KL_OK;
}

/* Groups lie behind what leads to them, so no way down is endless. */
static bool nodes_are_sound(const kl_u32 *nodes, size_t count, uint64_t first,
                            const struct index_counts *counts)
{
    uint32_t bad = 0;

    for (size_t i = 0; i < count; ++i) {
        const kl_u32 entry = nodes[i];
        const uint64_t group = entry & KL_NODE_INDEX;
        const bool is_leaf = (entry & KL_NODE_LEAF) != 0;
        const bool leads_on = group > first + i && group + 8 <= counts->nodes;
        const bool leads_out = (entry & ~KL_NODE_LEAF) < counts->rows;
        bad += (uint32_t)(entry != KL_NODE_EMPTY && !(is_leaf ? leads_out : leads_on));
    }
    return bad == 0;
}

/* Rows end before the array does, whoever leads into them. */
static bool rows_are_sound(const kl_u32 *rows, size_t count, uint64_t first,
                           const struct index_counts *counts)
{
    uint32_t bad = 0;

    for (size_t i = 0; i < count; ++i)
        bad += (uint32_t)((rows[i] & ~KL_ROW_LAST) >= counts->records);
    if (count > 0 && first + count == counts->rows) bad += !(rows[count - 1] & KL_ROW_LAST);
    return bad == 0;
}

bool index_block_is_sound(enum section_type type, const void *block, size_t bytes, uint64_t start,
                          const struct index_counts *counts)
{
    const size_t count = bytes / sizeof(kl_u32);
    const uint64_t first = start / sizeof(kl_u32);

    if (type == SECTION_NODES) return nodes_are_sound(block, count, first, counts);
    if (type == SECTION_ROWS) return rows_are_sound(block, count, first, counts);
    return true;
}

kl_status octree_validate(const struct kl_level_arrays *level, struct kl_err *err)
{
    const kl_octree_header *head = &level->octree;
    const struct index_counts counts = {head->node_count, head->row_size, level->record_count};
    kl_status st = octree_check_header(level, err);

    if (st != KL_OK) return st;
    if (!nodes_are_sound(level->nodes, head->node_count, 0, &counts) ||
        !rows_are_sound(level->rows, head->row_size, 0, &counts)) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: a row, or a node, is not sound");
    }
    return KL_OK;
}

static bool part_is_valid(const kl_part *part)
{
    bool ok = part->kind < KL_PART_KINDS && isfinite(part->power) && part->power >= 0.0f &&
              part->label[KL_PART_LABEL - 1] == '\0';

    for (int k = 0; k < 3; ++k) {
        ok = ok && isfinite(part->box_min[k]) && isfinite(part->box_max[k]) &&
             part->box_min[k] <= part->box_max[k];
    }
    for (const char *c = part->label; ok && *c != '\0'; ++c) {
        ok = (unsigned char)*c >= 32; /* it is printed */
    }
    return ok;
}

kl_status parts_validate(const kl_part *parts, uint32_t count, struct kl_err *err)
{
    if (count > KL_PARTS_MAX) {
        return kl_fail(err, KL_ERR_CORRUPT, "%u parts of the scene, at most %u", count,
                       KL_PARTS_MAX);
    }
    for (uint32_t i = 0; i < count; ++i) {
        if (!part_is_valid(&parts[i])) {
            return kl_fail(err, KL_ERR_CORRUPT, "part %u of the scene is not sound", i);
        }
    }
    return KL_OK;
}
