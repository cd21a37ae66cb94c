/* Many processes extend one store, compact it and read it at once: every record is there once, the
 * store is whole, nobody stalls. The argument is the time in seconds. Claims keep two processes
 * from the same work while both live. */
#include "cache_io/claim.h"
#include "tests/crash/batch.h"

#include <dirent.h>
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

enum {
    WRITERS = 8,
    SIZE = 32,
    BATCHES = 16384,
    NUMBERS = SIZE * BATCHES,
    COMPACT_EVERY = 32,
    STALL_S = 5
};

static double duration = 2.0;
static char root[64];
static char dir[80];

static double now(clockid_t clock)
{
    struct timespec t;
    (void)clock_gettime(clock, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static uint64_t records_of(const struct kl_store *store)
{
    uint64_t sum = 0;
    for (size_t i = 0; i < kl_store_segment_count(store); ++i) {
        struct kl_store_segment_info info;
        kl_store_segment_get(store, i, &info, NULL);
        sum += info.records[0];
    }
    return sum;
}

struct result {
    uint32_t batches;
    double longest; /* processor time from batch to batch [s] */
};

/* Writer w appends batches w, w + WRITERS, ..., looks for those of the others, and compacts what it
 * sees every 32nd time. Says how many batches it has written. */
static void work(int pipe_fd, uint32_t w)
{
    const struct kl_store_key key = batch_key();
    struct kl_store *store = NULL;
    struct kl_err err;
    const double start = now(CLOCK_MONOTONIC);
    double longest = 0.0;
    uint32_t i = 0;

    batch_must(kl_store_open(dir, KL_STORE_EXTEND, &key, &store, &err), &err);
    for (; now(CLOCK_MONOTONIC) - start < duration && i * WRITERS + w < BATCHES; ++i) {
        /* Of the processor: a machine that is busy with other things is no stall. */
        const double begin = now(CLOCK_PROCESS_CPUTIME_ID);
        const uint32_t number = i * WRITERS + w;
        struct batch *b = batch_create(number * SIZE, SIZE);
        bool changed = false;
        batch_must(kl_store_append(store, b->levels, &err), &err);
        batch_destroy(b);
        batch_must(kl_store_refresh(store, &changed, &err), &err);
        if (kl_store_damaged(store, NULL) > 0) _exit(2);
        if (records_of(store) < (uint64_t)(i + 1) * SIZE) _exit(3); /* not even its own */
        if (i % COMPACT_EVERY == COMPACT_EVERY - 1 - w) batch_compact(store);
        const double busy = now(CLOCK_PROCESS_CPUTIME_ID) - begin;
        longest = busy > longest ? busy : longest;
    }
    kl_store_close(store);
    const struct result result = {i, longest};
    if (write(pipe_fd, &result, sizeof result) != (ssize_t)sizeof result) _exit(4);
    _exit(0);
}

static void all_records_are_there(void **state) /* 5, 6, 11, 12 */
{
    static uint32_t counts[NUMBERS];
    const struct kl_store_key key = batch_key();
    uint32_t written[WRITERS] = {0};
    int fds[WRITERS][2];
    pid_t pids[WRITERS];
    struct kl_store *store = NULL;
    struct kl_err err;
    uint64_t sum = 0;
    double longest = 0.0;

    (void)state;
    for (uint32_t w = 0; w < WRITERS; ++w) {
        assert_int_equal(pipe(fds[w]), 0);
        pids[w] = fork();
        assert_true(pids[w] >= 0);
        if (pids[w] == 0) work(fds[w][1], w);
        (void)close(fds[w][1]);
    }
    for (uint32_t w = 0; w < WRITERS; ++w) {
        int status = 0;
        assert_int_equal(waitpid(pids[w], &status, 0), pids[w]);
        assert_true(WIFEXITED(status));
        assert_int_equal(WEXITSTATUS(status), 0);
        struct result result;
        assert_int_equal(read(fds[w][0], &result, sizeof result), sizeof result);
        (void)close(fds[w][0]);
        written[w] = result.batches;
        sum += result.batches;
        longest = result.longest > longest ? result.longest : longest;
    }
    batch_must(kl_store_open(dir, KL_STORE_EXTEND, &key, &store, &err), &err);
    assert_int_equal(kl_store_damaged(store, NULL), 0);
    const size_t segments = kl_store_segment_count(store);
    batch_compact(store); /* bases that overlap hold some records twice until then */
    kl_store_close(store);
    memset(counts, 0, sizeof counts);
    batch_must(batch_count(dir, counts, NUMBERS, &err), &err);
    for (uint32_t n = 0; n < NUMBERS; ++n) {
        const uint32_t batch = n / SIZE;
        assert_int_equal(counts[n], batch / WRITERS < written[batch % WRITERS] ? 1 : 0);
    }
    (void)printf("%llu batches by %d processes in %.0f s, %zu segments at the end, "
                 "%.2f s of work at most between two batches\n",
                 (unsigned long long)sum, WRITERS, duration, segments, longest);
    assert_true(longest < STALL_S);
}

static void set_age(const char *name, long long seconds)
{
    char path[200];
    struct timespec t[2];

    (void)clock_gettime(CLOCK_REALTIME, &t[0]);
    t[0].tv_sec -= (time_t)seconds;
    t[1] = t[0];
    (void)snprintf(path, sizeof path, "%s/%s", dir, name);
    assert_int_equal(utimensat(AT_FDCWD, path, t, 0), 0);
}

static void claims_expire_and_clocks_may_jump(void **state) /* 13 */
{
    const struct kl_store_key key = batch_key();
    struct kl_store *store = NULL;
    struct kl_err err;
    bool taken = false;

    (void)state;
    batch_must(kl_store_open(dir, KL_STORE_REBUILD, &key, &store, &err), &err);
    struct kl_claim *a = kl_claim_take(store, 7, &taken);
    assert_non_null(a);
    assert_null(kl_claim_take(store, 7, &taken));
    assert_false(taken);
    struct kl_claim *other = kl_claim_take(store, 8, &taken); /* other work */
    assert_non_null(other);
    kl_claim_release(other);
    set_age("claim-0000000000000007", KL_CLAIM_LIFE_S + 5); /* its owner has died */
    struct kl_claim *b = kl_claim_take(store, 7, &taken);
    assert_non_null(b);
    set_age("claim-0000000000000007", -3600); /* the clock has gone back by an hour */
    struct kl_claim *c = kl_claim_take(store, 7, &taken);
    assert_non_null(c);
    set_age("claim-0000000000000007", KL_CLAIM_LIFE_S + 5);
    kl_claim_renew(c);
    assert_null(kl_claim_take(store, 7, &taken));
    kl_claim_release(c);
    kl_claim_release(a);
    kl_claim_release(b);
    c = kl_claim_take(store, 7, &taken);
    assert_non_null(c);
    kl_claim_release(c);
    kl_store_close(store);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_records_are_there),
        cmocka_unit_test(claims_expire_and_clocks_may_jump),
    };

    if (argc > 1) duration = atof(argv[1]);
    folder_create(root);
    (void)snprintf(dir, sizeof dir, "%s/a.klc", root);
    const int failed = cmocka_run_group_tests_name("writers", tests, NULL, NULL);
    folder_destroy(root);
    return failed;
}
