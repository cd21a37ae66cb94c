/* src/render/ledger_fade.c, ledger_thin.c: records come and go without a step. */
#include "src/cache/record.h"
#include "src/render/ledger_impl.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>

enum { N = 4 };

static const struct kl_cache_settings settings = {
    .scene_radius = 2.0f, .accuracy = {0.4f, 0.8f}, .reach = {1.4f, 1.0f}, .cos_max = 0.9394f};

/* An entry of a record on the floor, of which nothing is near. */
static struct kl_ledger_entry entry_at(float x, float irr)
{
    const struct kl_radius_settings radius = {KL_RADIUS_HESSIAN, 0.4f, 2.0f};
    const kl_gather_result result = {
        .irr = {irr, irr, irr}, .hessian = {3.0f * irr, 0.0f, 3.0f * irr}, .harmonic = 1.0f};
    struct kl_ledger_entry e = {.kept = true, .age_frames = KL_LEDGER_FADE};

    e.point =
        (kl_gather_point){.pos = {x, 0.0f, 0.0f}, .normal = kl_oct_encode(kl_v3(0.0f, 1.0f, 0.0f))};
    kl_record_pack(&e.point, &result, 0, 0.01f, &radius, &e.hot, &e.cold);
    for (int k = 0; k < KL_SECTORS; ++k) {
        e.cold.clearance[k] = 255;
    }
    return e;
}

/* A cache of the entries, which learn their records' numbers. */
static struct kl_cache *cache_of(struct kl_ledger_entry *e, uint32_t count)
{
    struct kl_cache *c = NULL;
    struct kl_err err = {0};

    if (kl_cache_create(&settings, &c, &err) != KL_OK) fail_msg("%s", err.msg);
    for (uint32_t i = 0; i < count; ++i) {
        if (kl_cache_insert(c, 0, &e[i].hot, &e[i].cold, 1, &err) != KL_OK) {
            fail_msg("%s", err.msg);
        }
        e[i].record = i;
    }
    return c;
}

static float light_of(const struct kl_cache *c, uint32_t i)
{
    return kl_cache_get_arrays(c, 0).cold[i].irr[0];
}

static void fade(struct kl_ledger_entry *e, uint32_t count, struct kl_cache *c)
{
    struct kl_err err = {0};
    if (kl_ledger_fade(e, count, c, &err) != KL_OK) fail_msg("%s", err.msg);
}

/* Light of a record of 2 among others of 1, by its age. */
static float shown_at(uint32_t age, bool leaves)
{
    struct kl_ledger_entry e[N] = {entry_at(-0.05f, 1.0f), entry_at(0.05f, 1.0f),
                                   entry_at(0.0f, 2.0f), entry_at(1.5f, 3.0f)};
    struct kl_cache *c = cache_of(e, N);

    e[2].age_frames = age;
    e[2].leaves = leaves;
    fade(e, N, c);
    const float shown = light_of(c, 2);
    assert_true(e[2].cold.irr[0] == 2.0f); /* its own light stays */
    assert_true(light_of(c, 0) == 1.0f && light_of(c, 1) == 1.0f && light_of(c, 3) == 3.0f);
    fade(e, N, c); /* a frame that is filled again */
    assert_true(light_of(c, 2) == shown);
    kl_cache_destroy(c);
    return shown;
}

static void new_records_show_by_degrees(void **state)
{
    float before = 1.0f;
    (void)state;
    for (uint32_t age = 1; age <= KL_LEDGER_FADE; ++age) {
        const float shown = shown_at(age, false);
        assert_true(shown > before + 0.1f);
        before = shown;
    }
    assert_true(before == 2.0f);
}

static void old_records_leave_by_degrees(void **state)
{
    float before = 2.0f;
    (void)state;
    for (uint32_t age = KL_LEDGER_FADE - 1; age > 0; --age) {
        const float shown = shown_at(age, true);
        assert_true(shown < before - 0.1f && shown > 1.0f);
        before = shown;
    }
}

static void what_nobody_else_serves_counts_in_full(void **state)
{
    struct kl_ledger_entry e[N] = {entry_at(-0.05f, 1.0f), entry_at(0.05f, 1.0f),
                                   entry_at(0.0f, 1.0f), entry_at(1.5f, 3.0f)};
    struct kl_cache *c = cache_of(e, N);
    (void)state;

    e[3].age_frames = 1;
    e[3].leaves = true;
    fade(e, N, c);
    assert_true(light_of(c, 3) == 3.0f);
    assert_false(e[3].leaves);
    assert_int_equal(e[3].age_frames, KL_LEDGER_FADE);
    kl_cache_destroy(c);
}

/* Of three records in one place the second, which something has been near, gives way. */
static struct kl_ledger_entry thinned(uint32_t level)
{
    struct kl_ledger_entry e[N] = {entry_at(0.0f, 1.0f), entry_at(0.001f, 1.0f),
                                   entry_at(0.002f, 1.0f), entry_at(1.5f, 1.0f)};
    struct kl_err err = {0};

    for (int i = 0; i < N; ++i) {
        e[i].hot.radius = 0.1f;
        e[i].shot = i == 2 ? 0 : 1;
        e[i].level = level;
    }
    if (kl_ledger_thin(e, N, &err) != KL_OK) fail_msg("%s", err.msg);
    assert_true(e[0].kept && e[2].kept && e[3].kept);
    assert_false(e[0].leaves || e[2].leaves || e[3].leaves);
    return e[1];
}

static void crowds_give_way(void **state)
{
    (void)state;
    assert_true(thinned(0).kept && thinned(0).leaves);
    assert_false(thinned(1).kept); /* gone at once */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(new_records_show_by_degrees),
        cmocka_unit_test(old_records_leave_by_degrees),
        cmocka_unit_test(what_nobody_else_serves_counts_in_full),
        cmocka_unit_test(crowds_give_way),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
