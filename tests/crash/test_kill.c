/* A process that appends batches and compacts is killed at random moments. What it had been told is
 * kept is there, once, and the store is whole. The first argument is the number of kills. */
#include "tests/crash/batch.h"

#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

enum { SIZE = 64, BATCHES = 4096, NUMBERS = SIZE * BATCHES, BASE_EVERY = 5 };

static int kills = 60;
static char root[64];
static char dir[80];

/* Appends batch after batch from `first` on, and says so when each is kept. */
static void work(int pipe_fd, uint32_t first)
{
    const struct kl_store_key key = batch_key();
    struct kl_store *store = NULL;
    struct kl_err err;

    batch_must(kl_store_open(dir, KL_STORE_EXTEND, &key, &store, &err), &err);
    for (uint32_t i = first; i < BATCHES; ++i) {
        struct batch *b = batch_create(i * SIZE, SIZE);
        batch_must(kl_store_append(store, b->levels, &err), &err);
        batch_destroy(b);
        if (write(pipe_fd, &i, sizeof i) != (ssize_t)sizeof i) _exit(1);
        if (i % BASE_EVERY == 0) batch_compact(store);
    }
    _exit(0);
}

/* Runs a worker for a random while; returns the number after its last kept batch. */
static uint32_t run_and_kill(uint32_t first, uint32_t microseconds)
{
    int fds[2];
    uint32_t last = 0;
    uint32_t next = first;
    const struct timespec wait = {0, (long)microseconds * 1000};

    assert_int_equal(pipe(fds), 0);
    const pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) {
        (void)close(fds[0]);
        work(fds[1], first);
    }
    (void)close(fds[1]);
    (void)nanosleep(&wait, NULL);
    assert_int_equal(kill(pid, SIGKILL), 0);
    int status = 0;
    assert_int_equal(waitpid(pid, &status, 0), pid);
    if (WIFEXITED(status)) assert_int_equal(WEXITSTATUS(status), 0);
    while (read(fds[0], &last, sizeof last) == (ssize_t)sizeof last)
        next = last + 1;
    (void)close(fds[0]);
    return next;
}

static void nothing_kept_is_lost(void **state) /* 1, 5, 6, 11 */
{
    static uint32_t counts[NUMBERS];
    const struct kl_store_key key = batch_key();
    uint32_t seed = 12345;
    uint32_t next = 0;
    uint64_t bases = 0;

    (void)state;
    for (int k = 0; k < kills; ++k) {
        struct kl_store *store = NULL;
        struct kl_err err;
        seed = seed * 1664525u + 1013904223u;
        next = run_and_kill(next, 1000 + (seed >> 8) % 20000);
        if (next + 64 > BATCHES) { /* begin anew before numbers run out */
            folder_destroy(dir);
            next = 0;
            continue;
        }
        memset(counts, 0, sizeof counts);
        batch_must(kl_store_open(dir, KL_STORE_EXTEND, &key, &store, &err), &err);
        assert_int_equal(kl_store_damaged(store, NULL), 0);
        struct kl_store_segment_info info;
        if (kl_store_segment_count(store) > 0) {
            kl_store_segment_get(store, 0, &info, NULL);
            bases += info.is_base;
        }
        kl_store_close(store);
        batch_must(batch_count(dir, counts, NUMBERS, &err), &err);
        for (uint32_t i = 0; i < next * SIZE; ++i)
            assert_int_equal(counts[i], 1);
        /* The batch under way is there whole or not at all. */
        for (uint32_t i = next * SIZE; i < (next + 1) * SIZE; ++i)
            assert_int_equal(counts[i], counts[next * SIZE]);
        next += counts[next * SIZE];
    }
    (void)printf("%d kills, %u batches, %llu times with a base\n", kills, next,
                 (unsigned long long)bases);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(nothing_kept_is_lost)};

    if (argc > 1) kills = atoi(argv[1]);
    folder_create(root);
    (void)snprintf(dir, sizeof dir, "%s/a.klc", root);
    const int failed = cmocka_run_group_tests_name("kill", tests, NULL, NULL);
    folder_destroy(root);
    return failed;
}
