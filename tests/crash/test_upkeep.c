/* Every system call of a rebuild, repair, merge and prune, and of a render that tells what it used,
 * fails in turn, and the power goes after each: the store is in a state that the deed may leave,
 * never in another, and the deed done again ends as it should. Invariants 1, 5, 6 and 9 of
 * docs/cache_format.md. With the argument `all`: all outcomes of the last. */
#include "cache_io/format_impl.h"
#include "cache_io/upkeep.h"
#include "cache_io/use.h"
#include "src/base/file.h"
#include "tests/crash/batch.h"
#include "tests/crash/faults.h"

#include <dirent.h>
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <cmocka.h>

/* Numbers of records that are there together, or not at all. */
static const struct group {
    uint32_t first, end;
} groups[] = {
    {0, 20},      /* a base */
    {20, 40},     /* a delta */
    {40, 60},     /* a delta that the base has superseded, and that lies there still */
    {60, 80},     /* what is new */
    {100, 1124},  /* the first block of a delta */
    {1124, 1144}, /* its second one, damaged */
};
enum {
    GROUPS = sizeof groups / sizeof groups[0],
    NUMBERS = 1200,
    BASE = 1,
    DELTA = 2,
    HIDDEN = 4,
    FRESH = 8,
    WHOLE = 16,
    TORN = 32,
    THIRD = 1 << GROUPS,
    USES = 16,
};

struct fixture {
    char root[64], dir[80], copy[80], source[2][80];
};

static void append(struct kl_store *store, uint32_t first, uint32_t end)
{
    struct batch *b = batch_create(first, end - first);
    struct kl_err err;

    if (kl_store_append(store, b->levels, &err) != KL_OK) fail_msg("%s", err.msg);
    batch_destroy(b);
}

static void path_of_only(const char *dir, char kind, char path[400])
{
    DIR *d = opendir(dir);

    assert_non_null(d);
    for (const struct dirent *e = readdir(d); e != NULL; e = readdir(d)) {
        if (e->d_name[0] == kind) (void)snprintf(path, 400, "%s/%s", dir, e->d_name);
    }
    (void)closedir(d);
}

/* The only delta of a store, and its bytes. */
static char *read_delta(const char *dir, char path[400], size_t *size)
{
    struct kl_err err;
    char *bytes = NULL;

    path_of_only(dir, 'd', path);
    assert_int_equal(kl_file_read(path, 1 << 20, &bytes, size, &err), KL_OK);
    return bytes;
}

static struct batch *indexed; /* group 0: indexing takes time */

/* A base with a superseded delta that a crash has left behind, and a delta. */
static void make_store(const struct fixture *f)
{
    struct kl_err err;
    char path[400] = "";
    char *bytes = NULL;
    size_t size = 0;

    folder_destroy(f->dir);
    struct kl_store *store = batch_open(f->dir, KL_STORE_EXTEND);
    append(store, groups[2].first, groups[2].end);
    bytes = read_delta(f->dir, path, &size);
    assert_int_equal(kl_store_publish_base(store, indexed->levels, &err), KL_OK);
    append(store, groups[1].first, groups[1].end);
    kl_store_close(store);
    assert_int_equal(kl_file_replace(path, bytes, size, &err), KL_OK);
    free(bytes);
}

/* Where the records of level 0 begin in the file. */
static size_t hot_offset(const unsigned char *bytes)
{
    for (uint32_t i = 0; i < read_u32(bytes + HDR_SECTIONS); ++i) {
        const unsigned char *entry = bytes + HDR_TABLE + (size_t)i * SEC_SIZE;
        if (read_u32(entry + SEC_TYPE) == SECTION_HOT && read_u32(entry + SEC_LEVEL) == 0) {
            return (size_t)read_u64(entry + SEC_OFFSET);
        }
    }
    abort();
}

/* The same with a delta of two blocks, the second of them damaged. */
static void make_damaged(const struct fixture *f)
{
    struct kl_err err;
    char path[400] = "";
    char *bytes = NULL;
    size_t size = 0;

    folder_destroy(f->copy);
    struct kl_store *store = batch_open(f->copy, KL_STORE_EXTEND);
    append(store, groups[4].first, groups[5].end);
    kl_store_close(store);
    bytes = read_delta(f->copy, path, &size);
    const size_t at = hot_offset((const unsigned char *)bytes) +
                      SEGMENT_BLOCK_RECORDS * sizeof(kl_record_hot) + 5;
    bytes[at] = (char)(bytes[at] ^ 0x10);
    const char *name = strrchr(path, '/') + 1;
    make_store(f);
    char to[600];
    (void)snprintf(to, sizeof to, "%s/%s", f->dir, name);
    assert_int_equal(kl_file_replace(to, bytes, size, &err), KL_OK);
    free(bytes);
}

static void make_target(const struct fixture *f)
{
    folder_destroy(f->dir);
    assert_int_equal(mkdir(f->dir, 0777), 0);
}

/* Which groups are there, each record once. */
static int state_of(const char *dir)
{
    static uint32_t counts[NUMBERS];
    struct kl_err err;
    int state = 0;

    memset(counts, 0, sizeof counts);
    if (batch_count(dir, counts, NUMBERS, &err) != KL_OK) return THIRD;
    for (int g = 0; g < GROUPS; ++g) {
        const uint32_t n = counts[groups[g].first];
        for (uint32_t i = groups[g].first; i < groups[g].end; ++i) {
            if (counts[i] != n || n > 1) return THIRD;
        }
        state |= (int)n << g;
    }
    return state;
}

static kl_status rebuild(const struct fixture *f, struct kl_err *err)
{
    const struct kl_store_key key = batch_key();
    struct kl_store *store = NULL;
    struct batch *b = batch_create(groups[3].first, groups[3].end - groups[3].first);
    kl_status st = kl_store_open(f->dir, KL_STORE_REBUILD, &key, &store, err);

    if (st == KL_OK) st = kl_store_append(store, b->levels, err);
    kl_store_close(store);
    batch_destroy(b);
    return st;
}

static kl_status repair(const struct fixture *f, struct kl_err *err)
{
    struct kl_store_repaired out;

    return kl_store_repair(f->dir, &out, err);
}

static kl_status merge(const struct fixture *f, struct kl_err *err)
{
    const char *const sources[] = {f->source[0], f->source[1]};
    struct kl_store_merged out;

    return kl_store_merge(sources, 2, f->dir, &out, err);
}

static kl_status prune(const struct fixture *f, struct kl_err *err)
{
    /* Around group 1. */
    const struct kl_store_prune what = {.has_inside = true,
                                        .inside = {{0.195, -1.0, 0.0}, {0.395, 1.0, 100.0}}};
    struct kl_store_pruned out;

    return kl_store_prune(f->dir, &what, &out, err);
}

/* What is tried: what is there before, what it leaves, and what it may leave half-way. */
static const struct deed {
    const char *name;
    void (*prepare)(const struct fixture *f);
    kl_status (*run)(const struct fixture *f, struct kl_err *err);
    int old, done, between[2];
} deeds[] = {
    {"rebuild", make_store, rebuild, BASE | DELTA, FRESH, {BASE, 0}},
    {"repair",
     make_damaged,
     repair,
     BASE | DELTA | WHOLE,
     BASE | DELTA | WHOLE,
     {BASE | DELTA | WHOLE, BASE | DELTA | WHOLE}},
    {"merge", make_target, merge, 0, BASE | DELTA, {0, 0}},
    {"prune", make_store, prune, BASE | DELTA, BASE, {BASE, BASE}},
};
enum { DEEDS = sizeof deeds / sizeof deeds[0] };

static bool is_allowed(const struct deed *deed, int state, kl_status st)
{
    if (st == KL_OK) return state == deed->done;
    return state == deed->old || state == deed->done || state == deed->between[0] ||
           state == deed->between[1];
}

static bool is_whole(const char *dir)
{
    struct kl_store *store = batch_open(dir, KL_STORE_READ);
    const bool whole = kl_store_damaged(store, NULL) == 0;

    kl_store_close(store);
    return whole;
}

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);

    char root[64];

    assert_non_null(f);
    folder_create(f->root);
    memcpy(root, f->root, sizeof root);
    (void)snprintf(f->dir, sizeof f->dir, "%s/a.klc", f->root);
    (void)snprintf(f->copy, sizeof f->copy, "%s/b.klc", f->root);
    for (int i = 0; i < 2; ++i) {
        (void)snprintf(f->source[i], sizeof f->source[i], "%.60s/%s.klc", root, i == 0 ? "c" : "d");
        struct kl_store *store = batch_open(f->source[i], KL_STORE_EXTEND);
        append(store, groups[i].first, groups[i].end);
        kl_store_close(store);
    }
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

static void every_call_fails_in_turn(void **state) /* 1, 5, 6, 9 */
{
    static const int errors[] = {EIO, ENOSPC, EROFS, EACCES, ENOMEM};
    const struct fixture *f = *state;
    int tried = 0;

    for (int d = 0; d < DEEDS; ++d) {
        for (size_t e = 0; e < 2 * sizeof errors / sizeof errors[0]; ++e) {
            struct fault_plan plan = {
                .kind = FAULT_ERROR, .lasts = e % 2 == 1, .error = errors[e / 2]};
            for (;; ++plan.at) {
                struct kl_err err = {0};
                deeds[d].prepare(f);
                faults_begin(f->dir, &plan);
                const kl_status st = deeds[d].run(f, &err);
                faults_end();
                if (faults_hit()[0] == '\0') break;
                ++tried;
                const int now = state_of(f->dir);
                if (!is_allowed(&deeds[d], now, st)) {
                    fail_msg("%s: call %d (%s), errno %d: status %d, state %d", deeds[d].name,
                             plan.at, faults_hit(), plan.error, (int)st, now);
                }
                if (st == KL_OK) continue;
                assert_true(strlen(err.msg) > 0 && strchr(err.msg, '\n') == NULL);
                if (now == deeds[d].done && deeds[d].run == merge) continue;
                if (deeds[d].run(f, &err) != KL_OK) fail_msg("%s: %s", deeds[d].name, err.msg);
                assert_int_equal(state_of(f->dir), deeds[d].done);
                assert_true(is_whole(f->dir));
            }
        }
    }
    assert_true(tried > 500);
    (void)printf("%d calls failed\n", tried);
}

static void power_cut_after_each_call(void **state) /* 1, 5, 6, 9 */
{
    const struct fixture *f = *state;
    int outcomes = 0;

    for (int d = 0; d < DEEDS; ++d) {
        struct fault_plan plan = {.kind = FAULT_POWER_CUT};
        for (;; ++plan.at) {
            struct kl_err err;
            deeds[d].prepare(f);
            faults_begin(f->dir, &plan);
            const kl_status st = deeds[d].run(f, &err);
            faults_end();
            const bool cut = faults_hit()[0] != '\0';
            for (int i = 0;; ++i) {
                folder_destroy(f->copy);
                assert_int_equal(mkdir(f->copy, 0777), 0);
                if (!faults_outcome(i, f->copy)) break;
                ++outcomes;
                const int now = state_of(f->copy);
                if (!is_allowed(&deeds[d], now, st)) {
                    fail_msg("%s: cut after call %d (%s), outcome %d: status %d, state %d",
                             deeds[d].name, plan.at, faults_hit(), i, (int)st, now);
                }
            }
            if (!cut) break;
        }
    }
    assert_true(outcomes > 200);
    (void)printf("%d outcomes\n", outcomes);
}

/* ---- use ---- */

/* Records of group 4, USES + 1 shares of them: one served each render. */
static struct batch *told;
enum { SHARE = 60 };

static kl_status tell(const char *dir, int share, struct kl_err *err)
{
    const struct kl_store_key key = batch_key();
    struct kl_store *store = NULL;
    uint8_t used[1024] = {0};
    kl_status st = kl_store_open(dir, KL_STORE_READ, &key, &store, err);

    memset(used + (ptrdiff_t)SHARE * share, 1, SHARE);
    if (st == KL_OK) st = kl_use_publish(store, told->hot[0], 1024, used, err);
    kl_store_close(store);
    return st;
}

/* Shares that are known in full: bits; -1: not all that were told before. */
static bool knows(const char *dir, int shares)
{
    struct kl_store *store = batch_open(dir, KL_STORE_READ);
    struct kl_use *use = NULL;
    struct kl_err err;
    bool all = true;

    if (kl_use_load(store, 0, &use, &err) != KL_OK) fail_msg("%s", err.msg);
    for (int i = 0; i < SHARE * shares; ++i)
        all = all && kl_use_has(use, &told->hot[0][i]);
    kl_use_destroy(use);
    kl_store_close(store);
    return all;
}

static void make_told(const struct fixture *f)
{
    struct kl_err err;

    make_store(f);
    for (int i = 0; i < USES; ++i) {
        if (tell(f->dir, i, &err) != KL_OK) fail_msg("%s", err.msg);
    }
}

static int all_outcomes;

static void what_was_told_is_not_forgotten(void **state) /* 1 */
{
    static const int errors[] = {EIO, ENOSPC, EROFS, ENOENT};
    const struct fixture *f = *state;
    struct fault_plan plan = {.kind = FAULT_ERROR};
    struct kl_err err;
    int outcomes = 0;

    for (size_t e = 0; e < sizeof errors / sizeof errors[0]; ++e) {
        for (plan.at = 0, plan.error = errors[e];; ++plan.at) {
            make_told(f);
            faults_begin(f->dir, &plan);
            const kl_status st = tell(f->dir, USES, &err);
            faults_end();
            if (faults_hit()[0] == '\0') break;
            assert_true(knows(f->dir, st == KL_OK ? USES + 1 : USES));
            assert_int_equal(state_of(f->dir), BASE | DELTA);
        }
    }
    plan = (struct fault_plan){.kind = FAULT_POWER_CUT};
    for (;; ++plan.at) {
        make_told(f);
        faults_begin(f->dir, &plan);
        const kl_status st = tell(f->dir, USES, &err);
        faults_end();
        /* 16 names that go without a sync: of 2^18 outcomes some. */
        for (int i = 0;; i += i < 64 || all_outcomes != 0 ? 1 : 4099) {
            folder_destroy(f->copy);
            assert_int_equal(mkdir(f->copy, 0777), 0);
            if (!faults_outcome(i, f->copy)) break;
            ++outcomes;
            assert_true(knows(f->copy, st == KL_OK ? USES + 1 : USES));
        }
        if (faults_hit()[0] == '\0') break;
    }
    assert_true(outcomes > 200);
    (void)printf("%d outcomes\n", outcomes);
}

int main(int argc, char **argv)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        TEST(every_call_fails_in_turn),
        TEST(power_cut_after_each_call),
        TEST(what_was_told_is_not_forgotten),
    };

    all_outcomes = argc > 1 && strcmp(argv[1], "all") == 0;
    indexed = batch_create_indexed(groups[0].first, groups[0].end - groups[0].first);
    told = batch_create(groups[4].first, 1024);
    const int failed = cmocka_run_group_tests_name("upkeep", tests, NULL, NULL);
    batch_destroy(indexed);
    batch_destroy(told);
    return failed;
}
