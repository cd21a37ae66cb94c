/* Every system call of a commit fails in turn, and the power goes after each: the store is in the
 * old state or in the new one, never in a third. Invariants 1, 5 and 6 of docs/cache_format.md. */
#include "tests/crash/batch.h"
#include "tests/crash/faults.h"

#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* Numbers 0..19 and 20..39 are there before; 40..59 are appended, or 60..79 take the place of all.
 */
enum { SIZE = 20, NUMBERS = 4 * SIZE };
enum state { STATE_OLD, STATE_APPENDED, STATE_REPLACED, STATE_EMPTY, STATE_THIRD };

struct fixture {
    char root[64], dir[80], copy[80];
};

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);

    assert_non_null(f);
    folder_create(f->root);
    (void)snprintf(f->dir, sizeof f->dir, "%s/a.klc", f->root);
    (void)snprintf(f->copy, sizeof f->copy, "%s/b.klc", f->root);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;

    folder_destroy(f->root);
    free(f);
    return 0;
}

static kl_status append(struct kl_store *store, uint32_t first, struct kl_err *err)
{
    struct batch *b = batch_create(first, SIZE);
    const kl_status st = kl_store_append(store, b->levels, err);

    batch_destroy(b);
    return st;
}

static void make_old(const struct fixture *f)
{
    struct kl_err err;

    folder_destroy(f->dir);
    struct kl_store *store = batch_open(f->dir, KL_STORE_EXTEND);
    assert_int_equal(append(store, 0, &err), KL_OK);
    assert_int_equal(append(store, SIZE, &err), KL_OK);
    kl_store_close(store);
}

static enum state state_of(const char *dir)
{
    static const int wanted[][NUMBERS / SIZE] = {
        [STATE_OLD] = {1, 1, 0, 0},
        [STATE_APPENDED] = {1, 1, 1, 0},
        [STATE_REPLACED] = {0, 0, 0, 1},
        [STATE_EMPTY] = {0, 0, 0, 0},
    };
    uint32_t counts[NUMBERS] = {0};
    struct kl_err err;

    if (batch_count(dir, counts, NUMBERS, &err) != KL_OK) return STATE_THIRD;
    for (int s = 0; s <= STATE_EMPTY; ++s) {
        bool same = true;
        for (int i = 0; i < NUMBERS; ++i)
            same = same && counts[i] == (uint32_t)wanted[s][i / SIZE];
        if (same) return (enum state)s;
    }
    return STATE_THIRD;
}

/* What is tried: each leaves `done` behind where nothing fails. */
struct deed {
    const char *name;
    enum state done;
    kl_status (*run)(struct kl_store *store, struct kl_err *err);
};

static kl_status run_append(struct kl_store *store, struct kl_err *err)
{
    return append(store, 2 * SIZE, err);
}

static struct batch *indexed; /* the base: indexing takes time */

static kl_status run_replace(struct kl_store *store, struct kl_err *err)
{
    return kl_store_publish_base(store, indexed->levels, err);
}

static const struct deed deeds[] = {
    {"append", STATE_APPENDED, run_append},
    {"base", STATE_REPLACED, run_replace},
};
enum { DEEDS = sizeof deeds / sizeof deeds[0] };

/* The deed on a new old store under a plan. */
static kl_status try(const struct fixture *f, const struct deed *deed,
                     const struct fault_plan *plan, struct kl_err *err)
{
    make_old(f);
    struct kl_store *store = batch_open(f->dir, KL_STORE_EXTEND);
    faults_begin(f->dir, plan);
    const kl_status st = deed->run(store, err);
    const int calls = faults_call_count();
    if (st != KL_OK) {
        struct kl_err again;
        /* What is open stays usable, and the next write says no. */
        assert_true(kl_store_segment_count(store) >= 2);
        assert_int_not_equal(append(store, 0, &again), KL_OK);
        assert_true(strlen(again.msg) > 0 && strchr(again.msg, '\n') == NULL);
    }
    assert_true(calls > 0);
    faults_end();
    kl_store_close(store);
    return st;
}

static void every_call_fails_in_turn(void **state) /* 1, 5, 6 */
{
    static const int errors[] = {EIO, ENOSPC, EDQUOT, EROFS, EACCES, ENOMEM};
    const struct fixture *f = *state;
    int tried = 0;

    for (int d = 0; d < DEEDS; ++d) {
        for (size_t e = 0; e < 2 * sizeof errors / sizeof errors[0]; ++e) {
            struct fault_plan plan = {
                .kind = FAULT_ERROR, .lasts = e % 2 == 1, .error = errors[e / 2]};
            for (;; ++plan.at) {
                struct kl_err err;
                const kl_status st = try(f, &deeds[d], &plan, &err);
                if (faults_hit()[0] == '\0') break;
                ++tried;
                const enum state now = state_of(f->dir);
                if (now != deeds[d].done && (st == KL_OK || now != STATE_OLD)) {
                    fail_msg("%s: call %d (%s), errno %d: status %d, state %d", deeds[d].name,
                             plan.at, faults_hit(), plan.error, (int)st, (int)now);
                }
                if (st != KL_OK && strchr(err.msg, '\n') != NULL) fail_msg("two lines");
            }
        }
    }
    assert_true(tried > 100);
    (void)printf("%d calls failed\n", tried);
}

static void interrupted_and_short_calls_are_gone_on_with(void **state)
{
    const struct fixture *f = *state;
    struct kl_err err;

    for (int d = 0; d < DEEDS; ++d) {
        struct fault_plan plan = {.kind = FAULT_SHORT};
        if (try(f, &deeds[d], &plan, &err) != KL_OK) fail_msg("%s", err.msg);
        assert_int_equal(state_of(f->dir), deeds[d].done);
        plan = (struct fault_plan){.kind = FAULT_ERROR, .error = EINTR};
        for (;; ++plan.at) {
            const kl_status st = try(f, &deeds[d], &plan, &err);
            const char *hit = faults_hit();
            if (hit[0] == '\0') break;
            const bool restarts =
                strcmp(hit, "open") == 0 || strcmp(hit, "write") == 0 || strcmp(hit, "fsync") == 0;
            if (restarts && st != KL_OK)
                fail_msg("%s: EINTR of %s: %s", deeds[d].name, hit, err.msg);
            if (restarts) assert_int_equal(state_of(f->dir), deeds[d].done);
        }
    }
}

static void power_cut_after_each_call(void **state) /* 1, 5, 6 */
{
    const struct fixture *f = *state;
    int outcomes = 0;

    for (int d = 0; d < DEEDS; ++d) {
        struct fault_plan plan = {.kind = FAULT_POWER_CUT};
        for (;; ++plan.at) {
            struct kl_err err;
            make_old(f);
            struct kl_store *store = batch_open(f->dir, KL_STORE_EXTEND);
            faults_begin(f->dir, &plan);
            const kl_status st = deeds[d].run(store, &err);
            faults_end();
            kl_store_close(store);
            const bool cut = faults_hit()[0] != '\0';
            for (int i = 0;; ++i) {
                folder_destroy(f->copy);
                kl_store_close(batch_open(f->copy, KL_STORE_EXTEND));
                if (!faults_outcome(i, f->copy)) break;
                ++outcomes;
                const enum state now = state_of(f->copy);
                /* What was reported as done has to be there. */
                if (now != deeds[d].done && (st == KL_OK || now != STATE_OLD)) {
                    fail_msg("%s: cut after call %d (%s), outcome %d: state %d", deeds[d].name,
                             plan.at, faults_hit(), i, (int)now);
                }
            }
            if (!cut) break;
        }
    }
    assert_true(outcomes > 200);
    (void)printf("%d outcomes\n", outcomes);
}

static void opening_survives_every_failure(void **state)
{
    static const int errors[] = {EIO, ENOENT, EACCES, EINTR, ENOMEM, EMFILE};
    const struct fixture *f = *state;
    const struct kl_store_key key = batch_key();

    make_old(f);
    for (size_t e = 0; e < sizeof errors / sizeof errors[0]; ++e) {
        struct fault_plan plan = {.kind = FAULT_ERROR, .error = errors[e]};
        for (;; ++plan.at) {
            struct kl_store *store = NULL;
            struct kl_err err;
            faults_begin(f->dir, &plan);
            const kl_status st = kl_store_open(f->dir, KL_STORE_READ, &key, &store, &err);
            faults_end();
            if (st == KL_OK && errors[e] != EINTR && errors[e] != ENOENT) {
                /* Nothing is missing that was not reported. */
                assert_true(kl_store_segment_count(store) + kl_store_damaged(store, NULL) == 2);
            }
            kl_store_close(store);
            if (faults_hit()[0] == '\0') break;
            if (st != KL_OK) assert_true(strlen(err.msg) > 0 && strchr(err.msg, '\n') == NULL);
            assert_int_equal(state_of(f->dir), STATE_OLD);
        }
    }
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        TEST(every_call_fails_in_turn),
        TEST(interrupted_and_short_calls_are_gone_on_with),
        TEST(power_cut_after_each_call),
        TEST(opening_survives_every_failure),
    };

    indexed = batch_create_indexed(3 * SIZE, SIZE);
    const int failed = cmocka_run_group_tests_name("commit", tests, NULL, NULL);
    batch_destroy(indexed);
    return failed;
}
