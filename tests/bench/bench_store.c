/* The cache on disk: bench_store FOLDER [GIGABYTES [keep]]. Writes a store of about that size
 * (default 1), then prints JSON: seconds to open it and to the first look-up, and the rate of
 * verification. With `keep` the store stays, and one that is there is taken as it is. */
#include "cache_io/format_impl.h"
#include "kernels/cache_query.h"
#include "src/base/clock.h"
#include "tests/bench/bench_sort.h"
#include "tests/crash/batch.h"

#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { RECORDS_A_GIGABYTE = 5000000, ROUNDS = 5 };

static void must(kl_status st, const struct kl_err *err)
{
    if (st == KL_OK) return;
    (void)fprintf(stderr, "%s\n", err->msg);
    exit(1);
}

static double cpu_seconds(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Seconds from nothing to an answer from the store: median; and those of the processor, which other
 * programs do not disturb as much. */
static double time_open(const char *dir, double *bytes, float *answer, double *cpu)
{
    const struct kl_store_key key = batch_key();
    const kl_query query = {1.0f, 0.9f, KL_INF};
    const kl_vec3 up = {0.0f, 0.0f, 1.0f};
    double seconds[ROUNDS];
    double busy[ROUNDS];

    for (int i = 0; i < ROUNDS; ++i) {
        struct kl_level_arrays levels[KL_CACHE_LEVELS];
        struct kl_store *store = NULL;
        struct kl_err err;
        const double start = kl_seconds();
        const double start_cpu = cpu_seconds();
        must(kl_store_open(dir, KL_STORE_READ, &key, &store, &err), &err);
        if (kl_store_damaged(store, NULL) > 0) exit(1);
        kl_store_segment_get(store, 0, NULL, levels);
        const kl_level_view view = {levels[0].octree, levels[0].hot,  levels[0].cold,
                                    levels[0].nodes,  levels[0].rows, NULL};
        *answer = kl_cache_query(&view, &query, kl_v3(5.0f, 0.5f, 0.0f), up, up).weight;
        seconds[i] = kl_seconds() - start;
        busy[i] = cpu_seconds() - start_cpu;
        *bytes = (double)kl_store_bytes(store);
        kl_store_close(store);
    }
    bench_sort(seconds, ROUNDS);
    bench_sort(busy, ROUNDS);
    *cpu = busy[ROUNDS / 2];
    return seconds[ROUNDS / 2];
}

static double write_store(const char *dir, double gigabytes)
{
    const struct kl_store_key key = batch_key();
    struct batch *b = batch_create_indexed(0, (uint32_t)(gigabytes * RECORDS_A_GIGABYTE));
    struct kl_store *store = NULL;
    struct kl_err err;
    const double start = kl_seconds();

    must(kl_store_open(dir, KL_STORE_REBUILD, &key, &store, &err), &err);
    must(kl_store_publish_base(store, b->levels, &err), &err);
    kl_store_close(store);
    batch_destroy(b);
    return kl_seconds() - start;
}

int main(int argc, char **argv)
{
    char dir[512];
    double bytes = 0.0;
    double cpu = 0.0;
    float weight = 0.0f;

    if (argc < 2) return 2;
    const double size = argc > 2 ? atof(argv[2]) : 1.0;
    (void)snprintf(dir, sizeof dir, "%s/bench.klc", argv[1]);
    const bool keep = argc > 3 && strcmp(argv[3], "keep") == 0;
    const double write_s = keep && access(dir, F_OK) == 0 ? 0.0 : write_store(dir, size);
    const int threads = omp_get_max_threads();
    const double all = time_open(dir, &bytes, &weight, &cpu);
    omp_set_num_threads(1);
    const double one = time_open(dir, &bytes, &weight, &cpu);
    if (!keep) folder_destroy(dir);
    (void)printf(
        "{\"bytes\": %.0f, \"write_seconds\": %.3f, \"threads\": %d, \"open_seconds\": %.4f, "
        "\"open_seconds_one_thread\": %.4f, \"verify_bytes_per_second_per_core\": %.3g, "
        "\"weight\": %.3f}\n",
        bytes, write_s, threads, all, one, bytes / cpu, (double)weight);
    return 0;
}
