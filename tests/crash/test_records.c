/* Merging records of several writers: each place once, the better record, whatever the order. */
#include "cache_io/records.h"
#include "tests/crash/batch.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

enum { SIZE = 500 };

static void check(kl_status st, const struct kl_err *err)
{
    if (st != KL_OK) fail_msg("%s", err->msg);
}

/* Batches of the same places: b's are moved by less than 1e-3 of the radius, and every other one is
 * the worse one; c lies too far away from both to be the same. */
static void make_batches(struct batch *batches[3])
{
    for (uint32_t i = 0; i < 3; ++i)
        batches[i] = batch_create(0, SIZE);
    for (uint32_t i = 0; i < SIZE; ++i) {
        batches[1]->hot[0][i].pos[2] += 0.5e-3f * 0.012f;
        batches[2]->hot[0][i].pos[2] += 5e-3f * 0.012f;
        batches[0]->cold[0][i].error_spacing = i % 2 ? 100 : 200;
        batches[1]->cold[0][i].error_spacing = 150;
    }
}

static struct kl_records *merge(struct batch *const batches[3], const int order[3],
                                uint64_t *merged)
{
    static const uint32_t *const none[KL_CACHE_LEVELS] = {NULL};
    struct kl_records *records = NULL;
    struct kl_err err;

    check(kl_records_create(&records, &err), &err);
    for (int i = 0; i < 3; ++i)
        check(kl_records_add(records, batches[order[i]]->levels, none, 7, &err), &err);
    check(kl_records_merge(records, merged, &err), &err);
    return records;
}

static void the_order_does_not_matter(void **state)
{
    static const int orders[][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2},
                                    {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    struct batch *batches[3];
    struct kl_level_arrays first[KL_CACHE_LEVELS];
    uint64_t merged = 0;

    (void)state;
    make_batches(batches);
    struct kl_records *reference = merge(batches, orders[0], &merged);
    kl_records_get(reference, first);
    assert_int_equal(first[0].record_count, 2 * SIZE);
    assert_int_equal(first[1].record_count, SIZE / 2);
    assert_int_equal(merged, SIZE + 2 * (SIZE / 2));
    for (int i = 1; i < 6; ++i) {
        struct kl_level_arrays other[KL_CACHE_LEVELS];
        struct kl_records *records = merge(batches, orders[i], &merged);
        kl_records_get(records, other);
        for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
            const size_t n = first[l].record_count;
            assert_int_equal(other[l].record_count, n);
            assert_memory_equal(other[l].hot, first[l].hot, n * sizeof *first[l].hot);
            assert_memory_equal(other[l].cold, first[l].cold, n * sizeof *first[l].cold);
        }
        kl_records_destroy(records);
    }
    kl_records_destroy(reference);
    for (int i = 0; i < 3; ++i)
        batch_destroy(batches[i]);
}

static void the_better_record_stays(void **state)
{
    static const int order[3] = {1, 2, 0};
    struct batch *batches[3];
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    uint64_t merged = 0;
    uint32_t bad = 0;

    (void)state;
    make_batches(batches);
    struct kl_records *records = merge(batches, order, &merged);
    kl_records_get(records, levels);
    for (uint32_t i = 0; i < levels[0].record_count; ++i)
        bad += (levels[0].cold[i].error_spacing & 0xffffu) == 200;
    assert_int_equal(bad, 0);
    kl_records_destroy(records);
    for (int i = 0; i < 3; ++i)
        batch_destroy(batches[i]);
}

/* Normals or objects that differ: not the same place. */
static void strangers_stay_apart(void **state)
{
    static const int order[3] = {0, 1, 2};
    struct batch *batches[3];
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    uint64_t merged = 0;

    (void)state;
    make_batches(batches);
    for (uint32_t i = 0; i < SIZE; ++i)
        batches[1]->hot[0][i].object = 3;
    struct kl_records *records = merge(batches, order, &merged);
    kl_records_get(records, levels);
    assert_int_equal(levels[0].record_count, 3 * SIZE);
    kl_records_destroy(records);
    for (int i = 0; i < 3; ++i)
        batch_destroy(batches[i]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_order_does_not_matter),
        cmocka_unit_test(the_better_record_stays),
        cmocka_unit_test(strangers_stay_apart),
    };

    return cmocka_run_group_tests_name("records", tests, NULL, NULL);
}
