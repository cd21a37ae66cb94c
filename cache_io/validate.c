#include "cache_io/format_impl.h"
#include "src/base/clock.h"
#include "src/base/hash.h"

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

static bool is_power_of_two(kl_u32 x)
{
    return x != 0 && (x & (x - 1)) == 0;
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
    if (!is_power_of_two(head->slot_count)) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: %u slots are not a power of two",
                       head->slot_count);
    }
    if (head->row_size < KL_DIRECTORY_SIZE) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: %u row items, the directory alone has %d",
                       head->row_size, KL_DIRECTORY_SIZE);
    }
    if (head->record_count != level->record_count) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: %u records, the level has %u",
                       head->record_count, level->record_count);
    }
    return KL_OK;
}

/* ---- sets of places ---- */

/* Products over k + place modulo a prime: as polynomials in k they are one only where the sets of
 * places are, and two that differ agree at no more k than they have places. So for a k that a file
 * cannot know they tell sets of n places apart but for n of 2^61 cases, in the order of memory, and
 * whatever the order of the places. */
#define PLACE_PRIME ((1ull << 61) - 1)

__extension__ typedef unsigned __int128 wide;

/* Factors and result: 2^61 at most. */
static inline uint64_t times(uint64_t a, uint64_t b)
{
    const wide product = (wide)a * b;
    const uint64_t sum = ((uint64_t)product & PLACE_PRIME) + (uint64_t)(product >> 61);

    return (sum & PLACE_PRIME) + (sum >> 61);
}

uint64_t place_key_make(void)
{
    const struct {
        double seconds;
        const void *here;
    } chance = {kl_seconds(), &chance}; /* where the system put our stack, and when it is */

    return (kl_hash_block(&chance, sizeof chance) & (PLACE_PRIME >> 1)) + 1;
}

uint64_t places_join(uint64_t a, uint64_t b)
{
    return times(a, b);
}

bool places_are_equal(uint64_t a, uint64_t b)
{
    return a % PLACE_PRIME == b % PLACE_PRIME;
}

/* ---- rows and slots ---- */

static uint32_t count_above(const kl_u32 *items, size_t count, kl_u32 limit)
{
    uint32_t n = 0;

    for (size_t i = 0; i < count; ++i)
        n += (uint32_t)(items[i] >= limit);
    return n;
}

/* Rows follow each other without gaps behind the directory: one pass in the order of memory, whose
 * time a hostile file cannot stretch. Which words are record numbers is known too late for a fast
 * loop: all are compared with the number of records, and the words in front of the numbers
 * subtracted. */
void row_walk_to(struct row_walk *walk, kl_u32 end)
{
    const kl_u32 *rows = walk->rows;
    const kl_u32 size = walk->size;
    const kl_u32 limit = walk->record_count;
    uint64_t starts = walk->starts;
    uint32_t heads_above = 0;
    kl_u32 p = walk->next;

    walk->above += count_above(rows + walk->seen, end - walk->seen, limit);
    walk->seen = end;
    /* A check word, a count, then as many record numbers. */
    while (p < end && end - p >= 2) {
        const kl_u32 count = rows[p + 1];
        if (count == 0 || count > size - p - 2) {
            walk->is_sound = false;
            break;
        }
        heads_above += (uint32_t)(rows[p] >= limit) + (uint32_t)(count >= limit);
        starts = times(starts, walk->key + p);
        p += 2 + count;
    }
    walk->starts = starts;
    walk->above -= heads_above;
    walk->next = p;
}

bool row_walk_is_done(const struct row_walk *walk)
{
    return walk->is_sound && walk->next == walk->size && walk->above == 0;
}

/* Which slots are in use nobody can guess: no branch. */
static inline uint64_t place_of(const kl_octree_slot *slot, uint64_t key)
{
    const uint64_t used = 0 - (uint64_t)(slot->tag != 0);

    return 1 + ((key - 1 + slot->row) & used);
}

uint64_t slots_places(const kl_octree_slot *slots, size_t count, uint64_t key)
{
    uint64_t a = 1; /* four products: each waits for its last multiplication only */
    uint64_t b = 1;
    uint64_t c = 1;
    uint64_t d = 1;
    size_t i = 0;

    for (; i + 4 <= count; i += 4) {
        a = times(a, place_of(&slots[i], key));
        b = times(b, place_of(&slots[i + 1], key));
        c = times(c, place_of(&slots[i + 2], key));
        d = times(d, place_of(&slots[i + 3], key));
    }
    for (; i < count; ++i)
        a = times(a, place_of(&slots[i], key));
    return times(times(a, b), times(c, d));
}

kl_status octree_validate(const struct kl_level_arrays *level, struct kl_err *err)
{
    struct row_walk walk = {.rows = level->rows,
                            .size = level->octree.row_size,
                            .record_count = level->record_count,
                            ROW_WALK_START(place_key_make())};
    kl_status st = octree_check_header(level, err);

    if (st != KL_OK) return st;
    row_walk_to(&walk, walk.size);
    if (!row_walk_is_done(&walk) ||
        !places_are_equal(walk.starts,
                          slots_places(level->slots, level->octree.slot_count, walk.key))) {
        return kl_fail(err, KL_ERR_CORRUPT, "octree: a row, or a slot's place, is not sound");
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
