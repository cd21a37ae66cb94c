/* src/cache/cache.c: the same records give the same bytes, however they came in. */
#include "src/cache/cache.h"

#include "src/cache/record.h"

#include "test_kernel_random.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdlib.h>

enum { N = 3000 };

struct records {
    kl_record_hot hot[N];
    kl_record_cold cold[N];
};

static const struct kl_cache_settings settings = {
    .center = {0.5f, 0.0f, -2.0f},
    .scene_radius = 2.0f,
    .accuracy = {0.4f, 0.8f},
    .reach = {1.4f, 1.0f},
    .cos_max = 0.9394f,
};

static const struct kl_radius_settings radius = {KL_RADIUS_HESSIAN, 0.4f, 2.0f};

/* Records as the fill makes them: packed gathers on a bumpy floor. */
static void fill(struct records *out, uint32_t level, uint64_t seed)
{
    struct random r = {seed};
    for (uint32_t i = 0; i < N; ++i) {
        const kl_vec3 n =
            kl_normalize(kl_v3(random_range(&r, -0.1f, 0.1f), 1.0f, random_range(&r, -0.1f, 0.1f)));
        kl_gather_point point = {
            .pos = {random_range(&r, -0.5f, 1.5f), 0.0f, random_range(&r, -3.0f, -1.0f)},
            .normal = kl_oct_encode(n),
            .seed = (uint32_t)random_bits(&r)};
        kl_gather_result result = {.irr = {1.0f, 2.0f, 3.0f},
                                   .error = 0.01f,
                                   .grad_t = {0.1f, 0.0f, 0.2f, -0.1f, 0.1f, 0.3f},
                                   .hessian = {random_range(&r, -300.0f, 300.0f),
                                               random_range(&r, -30.0f, 30.0f),
                                               random_range(&r, -3.0f, 3.0f)},
                                   .harmonic = powf(10.0f, random_range(&r, -1.5f, 0.5f))};
        for (int k = 0; k < KL_SECTORS; ++k) {
            result.clearance[k] = random_range(&r, 0.0f, 1.0f);
        }
        kl_record_pack(&point, &result, level, 0.01f, &radius, &out->hot[i], &out->cold[i]);
    }
}

static struct kl_cache *create(void)
{
    struct kl_cache *c = NULL;
    struct kl_err err = {0};
    if (kl_cache_create(&settings, &c, &err) != KL_OK) fail_msg("%s", err.msg);
    return c;
}

static void insert(struct kl_cache *c, uint32_t level, const kl_record_hot *hot,
                   const kl_record_cold *cold, uint32_t count)
{
    struct kl_err err = {0};
    if (kl_cache_insert(c, level, hot, cold, count, &err) != KL_OK) fail_msg("%s", err.msg);
}

static void finish(struct kl_cache *c)
{
    struct kl_err err = {0};
    if (kl_cache_finish(c, &err) != KL_OK) fail_msg("%s", err.msg);
}

static void assert_same(const struct kl_cache *a, const struct kl_cache *b, uint32_t level)
{
    const struct kl_level_arrays p = kl_cache_get_arrays(a, level);
    const struct kl_level_arrays q = kl_cache_get_arrays(b, level);
    assert_int_equal(p.record_count, q.record_count);
    assert_memory_equal(&p.octree, &q.octree, sizeof p.octree);
    if (p.record_count == 0) return;
    assert_memory_equal(p.hot, q.hot, p.record_count * sizeof *p.hot);
    assert_memory_equal(p.cold, q.cold, p.record_count * sizeof *p.cold);
    assert_memory_equal(p.nodes, q.nodes, p.octree.node_count * sizeof *p.nodes);
    assert_memory_equal(p.rows, q.rows, p.octree.row_size * sizeof *p.rows);
}

static struct kl_cache *from_one_batch(const struct records *r, uint32_t level)
{
    struct kl_cache *c = create();
    insert(c, level, r->hot, r->cold, N);
    finish(c);
    return c;
}

static void batches_and_order_do_not_matter(void **state)
{
    static struct records r, shuffled;
    struct random random = {5};
    (void)state;
    for (uint32_t level = 0; level < KL_CACHE_LEVELS; ++level) {
        fill(&r, level, 1 + level);
        struct kl_cache *want = from_one_batch(&r, level);
        assert_int_equal(kl_cache_count(want, level), N);
        shuffled = r;
        for (uint32_t i = N - 1; i > 0; --i) {
            const uint32_t k = (uint32_t)(random_bits(&random) % (i + 1));
            const kl_record_hot h = shuffled.hot[i];
            const kl_record_cold c = shuffled.cold[i];
            shuffled.hot[i] = shuffled.hot[k];
            shuffled.cold[i] = shuffled.cold[k];
            shuffled.hot[k] = h;
            shuffled.cold[k] = c;
        }
        struct kl_cache *got = create();
        for (uint32_t i = 0; i < N; i += 700) {
            insert(got, level, shuffled.hot + i, shuffled.cold + i, i + 700 < N ? 700 : N - i);
        }
        finish(got);
        assert_same(want, got, level);
        assert_same(want, got, 1 - level); /* empty in both */
        finish(got);
        assert_same(want, got, level);
        kl_cache_destroy(want);
        kl_cache_destroy(got);
    }
}

/* The same record again, in a later batch or within one batch, is one record (hard case 17). */
static void duplicates_in_later_batches(void **state)
{
    static struct records r;
    fill(&r, 0, 7);
    (void)state;
    struct kl_cache *want = from_one_batch(&r, 0);
    struct kl_cache *got = create();
    insert(got, 0, r.hot, r.cold, N);
    insert(got, 0, r.hot, r.cold, N);
    finish(got);
    assert_same(want, got, 0);
    insert(got, 0, r.hot + 10, r.cold + 10, 100);
    finish(got);
    assert_same(want, got, 0);
    kl_cache_destroy(want);
    kl_cache_destroy(got);
}

static void duplicates_within_a_batch(void **state)
{
    static struct records r;
    fill(&r, 0, 7);
    (void)state;
    for (uint32_t i = N / 2; i < N; ++i) {
        r.hot[i] = r.hot[i - N / 2];
        r.cold[i] = r.cold[i - N / 2];
    }
    struct kl_cache *want = create();
    struct kl_cache *got = create();
    insert(want, 0, r.hot, r.cold, N / 2);
    insert(got, 0, r.hot, r.cold, N);
    finish(want);
    finish(got);
    assert_int_equal(kl_cache_count(got, 0), N / 2);
    assert_same(want, got, 0);
    kl_cache_destroy(want);
    kl_cache_destroy(got);
}

/* Two records at one position, of surfaces that meet at an edge: which comes first must not decide
 * how they are sorted. */
static void records_at_one_position(void **state)
{
    static struct records r;
    fill(&r, 0, 9);
    (void)state;
    memcpy(r.hot[1].pos, r.hot[0].pos, sizeof r.hot[1].pos);
    struct kl_cache *forward = create();
    struct kl_cache *backward = create();
    insert(forward, 0, r.hot, r.cold, 1);
    insert(forward, 0, r.hot + 1, r.cold + 1, N - 1);
    insert(backward, 0, r.hot + 1, r.cold + 1, N - 1);
    insert(backward, 0, r.hot, r.cold, 1);
    finish(forward);
    finish(backward);
    assert_int_equal(kl_cache_count(forward, 0), N);
    assert_same(forward, backward, 0);
    kl_cache_destroy(forward);
    kl_cache_destroy(backward);
}

/* Serving borrowed arrays gives the same bytes and answers as building them; other settings rebuild
 * without touching what is borrowed. */
static void adopting(void **state)
{
    static struct records r;
    struct kl_err err = {0};
    fill(&r, 0, 11);
    (void)state;
    struct kl_cache *built = from_one_batch(&r, 0);
    const struct kl_level_arrays part = kl_cache_get_arrays(built, 0);
    struct kl_cache *borrowed = create();
    assert_int_equal(kl_cache_adopt(borrowed, 0, &part, &err), KL_OK);
    assert_ptr_equal(kl_cache_get_arrays(borrowed, 0).hot, part.hot);
    assert_ptr_equal(kl_cache_get_arrays(borrowed, 0).rows, part.rows);
    assert_same(built, borrowed, 0);
    finish(borrowed);
    assert_ptr_equal(kl_cache_get_arrays(borrowed, 0).hot, part.hot);

    struct kl_level_arrays bare = {
        .record_count = part.record_count, .hot = part.hot, .cold = part.cold};
    struct kl_cache *rebuilt = create();
    assert_int_equal(kl_cache_adopt(rebuilt, 0, &bare, &err), KL_OK);
    assert_same(built, rebuilt, 0);

    insert(borrowed, 0, r.hot, r.cold, N); /* nothing new, but now a copy */
    finish(borrowed);
    assert_ptr_not_equal(kl_cache_get_arrays(borrowed, 0).hot, part.hot);
    assert_same(built, borrowed, 0);
    kl_cache_destroy(borrowed);
    kl_cache_destroy(rebuilt);
    kl_cache_destroy(built);
}

/* Adopt half of the records and add the rest: as if all had come at once. */
static void growing_what_was_adopted(void **state)
{
    static struct records r;
    struct kl_err err = {0};
    fill(&r, 0, 13);
    (void)state;
    struct kl_cache *all = from_one_batch(&r, 0);
    struct kl_cache *half = create();
    struct kl_cache *grown = create();
    insert(half, 0, r.hot, r.cold, N / 2);
    finish(half);
    const struct kl_level_arrays part = kl_cache_get_arrays(half, 0);
    assert_int_equal(kl_cache_adopt(grown, 0, &part, &err), KL_OK);
    insert(grown, 0, r.hot + N / 2, r.cold + N / 2, N - N / 2);
    finish(grown);
    assert_same(all, grown, 0);
    kl_cache_destroy(all);
    kl_cache_destroy(grown);
    kl_cache_destroy(half);
}

/* Radii are within the neighbours' envelope; predictions are the same function between records. */
static void radii_are_clamped_by_neighbours(void **state)
{
    static struct records r;
    fill(&r, 0, 15);
    (void)state;
    struct kl_cache *c = from_one_batch(&r, 0);
    const struct kl_level_arrays p = kl_cache_get_arrays(c, 0);
    uint32_t clamped = 0;
    uint32_t whole = 0;
    for (uint32_t i = 0; i < N; i += 7) {
        const float wish = kl_record_wish(&p.hot[i], &p.cold[i], &radius);
        const float slope = kl_record_slope(&radius);
        float least = wish;
        for (uint32_t k = 0; k < N; ++k) {
            const kl_vec3 d = kl_v3_sub(kl_v3_load(p.hot[i].pos), kl_v3_load(p.hot[k].pos));
            least =
                fminf(least, kl_record_wish(&p.hot[k], &p.cold[k], &radius) + slope * kl_length(d));
        }
        clamped += least < wish;
        kl_record_hot want = p.hot[i];
        kl_record_set_radii(&want, &p.cold[i], least, &radius);
        assert_true(p.hot[i].radius <= 1.000001f * want.radius);
        assert_true(p.hot[i].radius2 <= 1.000001f * want.radius2);
        whole += p.hot[i].radius >= 0.999999f * want.radius;
        const float predicted = kl_cache_predict_radius(c, 0, p.hot[i].pos, 1e30f);
        assert_true(fabsf(predicted - least) <= 1e-6f * least);
    }
    assert_true(clamped > N / 7 / 8);
    assert_true(whole > N / 7 / 8); /* the others: where nearer records serve */
    const float nowhere[3] = {0.0f, 0.0f, 0.0f};
    assert_true(kl_cache_predict_radius(c, 1, nowhere, 0.125f) == 0.125f);
    kl_cache_destroy(c);
}

/* Records of a store, served in place, are as good a judge of a new record's radius. */
static void predicting_from_adopted_records(void **state)
{
    static struct records r;
    struct kl_err err = {0};
    fill(&r, 0, 17);
    (void)state;
    struct kl_cache *built = from_one_batch(&r, 0);
    struct kl_cache *borrowed = create();
    const struct kl_level_arrays part = kl_cache_get_arrays(built, 0);
    assert_int_equal(kl_cache_adopt(borrowed, 0, &part, &err), KL_OK);
    assert_int_equal(kl_cache_prepare(borrowed, 0, &err), KL_OK);
    const float want = kl_cache_predict_radius(built, 0, part.hot[5].pos, 100.0f);
    assert_true(kl_cache_predict_radius(borrowed, 0, part.hot[5].pos, 100.0f) == want);
    kl_cache_destroy(borrowed);
    kl_cache_destroy(built);
}

/* What a record covers, it still covers when its neighbours come, as long as these do not shrink
 * it; and views stay good for queries at all times. */
static void queries_at_records_are_served(void **state)
{
    static struct records r;
    const kl_query q = {1.4f, settings.cos_max, KL_INF};
    fill(&r, 0, 19);
    (void)state;
    struct kl_cache *c = create();
    assert_true(kl_cache_query(&(kl_level_view){0}, &q, kl_v3_splat(0.0f), kl_v3_splat(1.0f),
                               kl_v3_splat(1.0f))
                    .weight == 0.0f);
    for (uint32_t i = 0; i < N; i += 1000) {
        insert(c, 0, r.hot + i, r.cold + i, 1000);
        const kl_level_view view = kl_cache_view(c, 0);
        for (uint32_t k = 0; k < i + 1000; k += 3) {
            const kl_vec3 n = kl_oct_decode(r.hot[k].normal);
            const kl_answer a = kl_cache_query(&view, &q, kl_v3_load(r.hot[k].pos), n, n);
            assert_true(a.weight > 0.999f);
            assert_true(kl_v3_isfinite(a.irr) && a.irr.x >= 0.0f);
        }
    }
    kl_cache_destroy(c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(batches_and_order_do_not_matter),
        cmocka_unit_test(duplicates_in_later_batches),
        cmocka_unit_test(duplicates_within_a_batch),
        cmocka_unit_test(records_at_one_position),
        cmocka_unit_test(adopting),
        cmocka_unit_test(growing_what_was_adopted),
        cmocka_unit_test(radii_are_clamped_by_neighbours),
        cmocka_unit_test(predicting_from_adopted_records),
        cmocka_unit_test(queries_at_records_are_served),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
