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

enum { RECORDS = 7, NODES = 8 + 8 + 8, ROWS = 7 };

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
        ok = ok && half_is_finite(cold->grad[i]) && half_is_finite(cold->grad[6 + i]);
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
    kl_u32 nodes[NODES];
    kl_u32 rows[ROWS];
    struct kl_level_arrays level;
};

/* A grid of 2^3; one cell divides by octants, one of these by faces; three rows. */
static struct octree *octree_create(void)
{
    struct octree *o = calloc(1, sizeof *o);
    const kl_u32 rows[ROWS] = {0, 1, 6 | KL_ROW_LAST, 5, 6 | KL_ROW_LAST, 1, 3 | KL_ROW_LAST};

    if (o == NULL) abort();
    memcpy(o->rows, rows, sizeof rows);
    o->nodes[0] = KL_NODE_LEAF;
    o->nodes[7] = 8;
    o->nodes[8] = KL_NODE_FACES | 16;
    o->nodes[15] = KL_NODE_LEAF | 3;
    o->nodes[16] = KL_NODE_LEAF | 5;
    o->nodes[23] = KL_NODE_LEAF | 3; /* two leaves may share a row */
    o->level.record_count = RECORDS;
    o->level.octree = (kl_octree_header){.side = 4.0f,
                                         .top_bits = 1,
                                         .node_count = NODES,
                                         .row_size = ROWS,
                                         .record_count = RECORDS,
                                         .reach = 1.0f};
    o->level.nodes = o->nodes;
    o->level.rows = o->rows;
    return o;
}

/* Words that are set to another value, one at a time. */
static const struct {
    const char *what;
    bool is_node; /* else of the rows */
    size_t at;
    kl_u32 value;
} changes[] = {
    {"a number that is too large", false, 3, RECORDS},
    {"a last number that is too large", false, 4, RECORDS | KL_ROW_LAST},
    {"the largest number", false, 0, 0xffffffffu},
    {"a last row without an end", false, ROWS - 1, 3},
    {"a leaf at the end", true, 15, KL_NODE_LEAF | ROWS},
    {"a leaf beyond the end", true, 15, 0xffffffffu},
    {"a group in itself", true, 8, 8},
    {"a way back", true, 16, 8},
    {"a way back by faces", true, 16, KL_NODE_FACES | 8},
    {"a group that ends beyond the end", true, 8, NODES - 7},
    {"a group beyond the end", true, 0, KL_NODE_INDEX},
};

static void octrees_lead_nowhere_else(void **state) /* 7 */
{
    struct octree *o = octree_create();
    struct kl_err err;
    (void)state;

    assert_int_equal(octree_validate(&o->level, &err), KL_OK);
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; ++i) {
        struct octree *c = octree_create();
        kl_u32 *words = changes[i].is_node ? c->nodes : c->rows;
        words[changes[i].at] = changes[i].value;
        if (octree_validate(&c->level, &err) != KL_ERR_CORRUPT) fail_msg("%s", changes[i].what);
        free(c);
    }
    o->level.octree.row_size = ROWS - 1; /* in the middle of a row */
    assert_int_equal(octree_validate(&o->level, &err), KL_ERR_CORRUPT);
    o->level.octree.row_size = ROWS;
    o->level.octree.top_bits = 2; /* 64 cells */
    assert_int_equal(octree_validate(&o->level, &err), KL_ERR_CORRUPT);
    o->level.octree.top_bits = KL_TOP_BITS_MAX + 1;
    assert_int_equal(octree_validate(&o->level, &err), KL_ERR_CORRUPT);
    free(o);
}

static bool in_pieces(enum section_type type, const kl_u32 *items, uint64_t count, uint64_t cut,
                      const struct index_counts *counts)
{
    const size_t item = sizeof *items;
    return index_block_is_sound(type, items, cut * item, 0, counts) &&
           index_block_is_sound(type, items + cut, (count - cut) * item, cut * item, counts);
}

/* Nodes and rows come in blocks: wherever the cut lies, the answer is the same. */
static void blocks_are_judged_alone(void **state)
{
    const struct index_counts counts = {NODES, ROWS, RECORDS};
    (void)state;

    for (size_t i = 0; i <= sizeof changes / sizeof changes[0]; ++i) {
        const bool is_changed = i < sizeof changes / sizeof changes[0];
        struct octree *o = octree_create();
        kl_u32 *words = is_changed && changes[i].is_node ? o->nodes : o->rows;
        if (is_changed) words[changes[i].at] = changes[i].value;
        for (uint64_t cut = 0; cut < NODES; ++cut) {
            const bool ok = in_pieces(SECTION_NODES, o->nodes, NODES, cut, &counts) &&
                            in_pieces(SECTION_ROWS, o->rows, ROWS, cut % ROWS, &counts);
            assert_int_equal(ok, !is_changed);
        }
        free(o);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(records_are_judged_as_the_format_says),
        cmocka_unit_test(octrees_lead_nowhere_else),
        cmocka_unit_test(blocks_are_judged_alone),
    };

    return cmocka_run_group_tests_name("segment_values", tests, NULL, NULL);
}
