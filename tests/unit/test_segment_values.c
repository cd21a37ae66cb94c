/* What the values of a segment may be, against the words of docs/cache_format.md section 4. Numbers
 * refer to its section 1. */
#include "cache_io/format_impl.h"
#include "kernels/sampling.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

enum { RECORDS = 7, SLOTS = 8, ROW_ITEMS = 12, ROWS = KL_DIRECTORY_SIZE + ROW_ITEMS };

static bool half_is_finite(kl_u16 half)
{
    return (half & 0x7c00u) != 0x7c00u;
}

/* As the format says it. */
static bool is_sound(const kl_record_hot *hot, const kl_record_cold *cold)
{
    bool ok = isfinite(hot->radius2) && hot->radius > 0.0f && hot->radius <= hot->radius2;

    for (int i = 0; i < 3; ++i) {
        ok = ok && isfinite(hot->pos[i]) && isfinite(cold->irr[i]) && cold->irr[i] >= 0.0f;
    }
    for (int i = 0; i < 6; ++i) {
        ok = ok && half_is_finite(cold->grad_t[i]) && half_is_finite(cold->grad_r[i]);
    }
    ok = ok && isfinite(cold->raw_radius) && cold->raw_radius > 0.0f;
    ok = ok && (cold->error_spacing & 0xffffu) < 0x7c00u && cold->error_spacing >> 16 < 0x7c00u;
    return ok && kl_record_level(hot->form) < KL_CACHE_LEVELS;
}

static void make_record(kl_record_hot *hot, kl_record_cold *cold)
{
    memset(hot, 0, sizeof *hot);
    memset(cold, 0, sizeof *cold);
    hot->radius = 0.5f;
    hot->radius2 = 0.75f;
    hot->object = KL_NONE;
    cold->raw_radius = 1.0f;
    memset(cold->clearance, 0xff, sizeof cold->clearance);
    memset(cold->touched, 0xff, sizeof cold->touched);
}

static void check(const kl_record_hot *hot, const kl_record_cold *cold, size_t *refused)
{
    const struct kl_level_arrays level = {.record_count = 1, .hot = hot, .cold = cold};
    const bool want = is_sound(hot, cold);

    assert_int_equal(kl_record_is_valid(hot, cold), want);
    assert_int_equal(records_are_valid(&level), want);
    *refused += !want;
}

/* Every word of a record, one after the other, is given every exponent, and every bit. */
static void records_are_judged_as_the_format_says(void **state) /* 7 */
{
    enum { HOT = sizeof(kl_record_hot), SIZE = HOT + sizeof(kl_record_cold) };
    kl_record_hot hot;
    kl_record_cold cold;
    unsigned char bytes[SIZE];
    size_t refused = 0;
    uint32_t random = 1;
    (void)state;

    make_record(&hot, &cold);
    memcpy(bytes, &hot, HOT);
    memcpy(bytes + HOT, &cold, SIZE - HOT);
    for (size_t at = 0; at < SIZE; at += 4) {
        for (uint32_t k = 0; k < 4096; ++k) {
            random = kl_hash(random);
            /* 0, inf, 1 and their neighbours; then each sign and exponent; then anything. */
            static const uint32_t corners[] = {0u, 0x7f800000u, 0x3f800000u, 0x7c007c00u};
            uint32_t word = random;
            if (k < 512) word = k << 23 | (random & 0x7fffffu);
            if (k < 32) word = (corners[k % 4] + k / 8 - 1) ^ (k / 4 % 2) << 31;
            memcpy(&hot, bytes, HOT);
            memcpy(&cold, bytes + HOT, SIZE - HOT);
            if (at < HOT) memcpy((char *)&hot + at, &word, 4);
            if (at >= HOT) memcpy((char *)&cold + at - HOT, &word, 4);
            check(&hot, &cold, &refused);
        }
    }
    assert_true(refused > 1000);
}

struct octree {
    kl_octree_slot slots[SLOTS];
    kl_u32 rows[ROWS];
    struct kl_level_arrays level;
};

static struct octree *octree_create(void)
{
    struct octree *o = calloc(1, sizeof *o);
    /* Check word, count, record numbers. A check word may be anything. */
    const kl_u32 rows[ROW_ITEMS] = {0xabcdu, 3, 0, 1, 6, 0xffffffffu, 2, 5, 6, 2, 1, 3};

    if (o == NULL) abort();
    memcpy(o->rows + KL_DIRECTORY_SIZE, rows, sizeof rows);
    o->slots[1] = (kl_octree_slot){.tag = 99, .row = KL_DIRECTORY_SIZE};
    o->slots[2] = (kl_octree_slot){.tag = 77, .row = KL_DIRECTORY_SIZE + 9};
    o->slots[7] = (kl_octree_slot){.tag = 1, .row = KL_DIRECTORY_SIZE + 5};
    o->slots[3] = (kl_octree_slot){.tag = 0, .row = 4000000000u}; /* not in use */
    o->level.record_count = RECORDS;
    o->level.octree = (kl_octree_header){.side = 4.0f,
                                         .slot_count = SLOTS,
                                         .row_size = ROWS,
                                         .record_count = RECORDS,
                                         .reach = 1.0f};
    o->level.slots = o->slots;
    o->level.rows = o->rows;
    return o;
}

/* Words that are set to another value, one at a time. */
static const struct {
    const char *what;
    bool is_slot; /* of the slots' words, else of the rows behind the directory */
    size_t at;
    kl_u32 value;
} changes[] = {
    {"a number that is too large", false, 4, RECORDS},
    {"the largest number", false, 11, 0xffffffffu},
    {"a row without records", false, 10, 0},
    {"a row that is too short", false, 6, 1},
    {"a row that is too long", false, 1, 4},
    {"a row beyond the end", false, 10, 2},
    {"a row far beyond the end", false, 1, 0xffffffffu},
    {"a slot in a row", true, 3, KL_DIRECTORY_SIZE + 1},
    {"a slot in the directory", true, 3, 0},
    {"a slot at the end", true, 3, ROWS},
    {"a slot beyond the end", true, 3, 0xffffffffu},
    {"two slots of one row", true, 3, KL_DIRECTORY_SIZE + 5},
    {"a row without a slot", true, 4, 0},
    {"a slot too many", true, 12, 5},
};

static void octrees_lead_nowhere_else(void **state) /* 7 */
{
    struct octree *o = octree_create();
    struct kl_err err;
    (void)state;

    assert_int_equal(octree_validate(&o->level, &err), KL_OK);
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; ++i) {
        kl_u32 words[2 * SLOTS];
        struct octree *c = octree_create();
        memcpy(words, c->slots, sizeof words);
        if (changes[i].is_slot) words[changes[i].at] = changes[i].value;
        memcpy(c->slots, words, sizeof words);
        if (!changes[i].is_slot) c->rows[KL_DIRECTORY_SIZE + changes[i].at] = changes[i].value;
        if (octree_validate(&c->level, &err) != KL_ERR_CORRUPT) fail_msg("%s", changes[i].what);
        free(c);
    }
    o->level.octree.row_size = KL_DIRECTORY_SIZE - 1;
    assert_int_equal(octree_validate(&o->level, &err), KL_ERR_CORRUPT);
    o->level.octree.row_size = ROWS - 1;
    assert_int_equal(octree_validate(&o->level, &err), KL_ERR_CORRUPT);
    free(o);
}

/* Rows come in blocks: wherever the cuts lie, the answer is the same. */
static void rows_are_walked_in_pieces(void **state)
{
    struct octree *o = octree_create();
    const uint64_t key = place_key_make();
    (void)state;

    for (int with_error = 0; with_error < 2; ++with_error) {
        o->rows[KL_DIRECTORY_SIZE + 11] = with_error ? RECORDS : 3;
        for (kl_u32 cuts = 0; cuts < 1u << (ROW_ITEMS - 1); ++cuts) {
            struct row_walk walk = {
                .rows = o->rows, .size = ROWS, .record_count = RECORDS, ROW_WALK_START(key)};
            for (kl_u32 i = 1; i < ROW_ITEMS; ++i) {
                if ((cuts >> (i - 1) & 1u) != 0) row_walk_to(&walk, KL_DIRECTORY_SIZE + i);
            }
            row_walk_to(&walk, ROWS);
            assert_int_equal(row_walk_is_done(&walk), !with_error);
            assert_true(places_are_equal(walk.starts, slots_places(o->slots, SLOTS, key)));
        }
    }
    free(o);
}

/* Many sets of places that differ in one: told apart; in another order: the same. */
static void sets_of_places_are_told_apart(void **state)
{
    enum { PLACES = 1000 };
    kl_octree_slot slots[PLACES];
    (void)state;

    for (uint32_t i = 0; i < PLACES; ++i)
        slots[i] = (kl_octree_slot){.tag = i % 3, .row = kl_hash(i)};
    for (uint32_t i = 0; i < PLACES; ++i) {
        const uint64_t key = place_key_make();
        const uint64_t all = slots_places(slots, PLACES, key);
        const uint64_t parts =
            places_join(slots_places(slots + i, PLACES - i, key), slots_places(slots, i, key));
        assert_true(places_are_equal(all, parts));
        slots[i].row ^= 1u << (i % 32);
        assert_int_equal(places_are_equal(all, slots_places(slots, PLACES, key)),
                         slots[i].tag == 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(records_are_judged_as_the_format_says),
        cmocka_unit_test(octrees_lead_nowhere_else),
        cmocka_unit_test(rows_are_walked_in_pieces),
        cmocka_unit_test(sets_of_places_are_told_apart),
    };

    return cmocka_run_group_tests_name("segment_values", tests, NULL, NULL);
}
