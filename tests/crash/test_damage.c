/* Bits that flip and files that end early: what a reader then takes is what was written, and what
 * is missing is counted. Invariants 3, 4, 7, 9 and 10 of docs/cache_format.md. With the argument
 * "all": 10 000 flips and 1000 cuts. */
#include "cache_io/format_impl.h"
#include "kernels/cache_query.h"
#include "src/base/file.h"
#include "tests/crash/batch.h"

#include <dirent.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

enum { DELTA = 1500, BASE = 3000, NUMBERS = BASE + DELTA };

static int flips = 600;
static int cuts = 120;

/* Two segments in memory: a base of records 0.. and a delta of records BASE.. */
struct fixture {
    char root[64], dir[80];
    size_t size[2];
    char *bytes[2];
    char path[2][400];
};

static void read_segments(struct fixture *f)
{
    struct kl_err err;
    DIR *dir = opendir(f->dir);

    assert_non_null(dir);
    for (const struct dirent *e = readdir(dir); e != NULL; e = readdir(dir)) {
        if (e->d_name[0] == '.') continue;
        const int which = e->d_name[0] == 'd';
        (void)snprintf(f->path[which], sizeof f->path[which], "%s/%s", f->dir, e->d_name);
        assert_int_equal(
            kl_file_read(f->path[which], 1 << 26, &f->bytes[which], &f->size[which], &err), KL_OK);
    }
    (void)closedir(dir);
}

static int setup(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    const struct kl_store_key key = batch_key();
    struct batch *base = batch_create_indexed(0, BASE);
    struct batch *delta = batch_create(BASE, DELTA);
    struct kl_store *store = NULL;
    struct kl_err err;

    assert_non_null(f);
    folder_create(f->root);
    (void)snprintf(f->dir, sizeof f->dir, "%s/a.klc", f->root);
    assert_int_equal(kl_store_open(f->dir, KL_STORE_EXTEND, &key, &store, &err), KL_OK);
    assert_int_equal(kl_store_publish_base(store, base->levels, &err), KL_OK);
    assert_int_equal(kl_store_append(store, delta->levels, &err), KL_OK);
    kl_store_close(store);
    batch_destroy(base);
    batch_destroy(delta);
    read_segments(f);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    struct fixture *f = *state;

    folder_destroy(f->root);
    free(f->bytes[0]);
    free(f->bytes[1]);
    free(f);
    return 0;
}

static void put(const char *path, const void *data, size_t size)
{
    FILE *file = fopen(path, "wb");

    assert_non_null(file);
    assert_int_equal(fwrite(data, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

static uint32_t next_random(uint32_t *seed)
{
    *seed = *seed * 1664525u + 1013904223u;
    return *seed >> 8;
}

/* Every look-up on a grid, in every level that has an octree: an answer and no way out. */
static void look_around(const struct kl_level_arrays *level)
{
    const kl_query query = {1.0f, 0.9f, KL_INF};
    const kl_level_view view = {level->octree, level->hot,  level->cold,
                                level->nodes,  level->rows, NULL};

    for (int i = 0; i < 64; ++i) {
        const kl_vec3 p = kl_v3((float)(i % 8) * 2.5f, (float)(i / 8) * 0.002f, 0.0f);
        const kl_vec3 up = kl_v3(0.0f, 0.0f, 1.0f);
        const kl_answer answer = kl_cache_query(&view, &query, p, up, up);
        assert_true(answer.weight >= 0.0f);
        assert_true(answer.weight == 0.0f || kl_v3_isfinite(answer.irr));
    }
}

/* What the store says now: numbers present once, each the record it was (batch_count aborts
 * otherwise); 1024 at most are missing for a block, and none without a complaint. */
static void check_store(const struct fixture *f, bool one_block)
{
    static uint32_t counts[NUMBERS];
    const struct kl_store_key key = batch_key();
    struct kl_store *store = NULL;
    struct kl_store_damage damage;
    struct kl_err err;
    uint32_t missing = 0;

    memset(counts, 0, sizeof counts);
    assert_int_equal(kl_store_open(f->dir, KL_STORE_READ, &key, &store, &err), KL_OK);
    kl_store_get_damage(store, &damage);
    for (size_t i = 0; i < kl_store_segment_count(store); ++i) {
        struct kl_level_arrays levels[KL_CACHE_LEVELS];
        kl_store_segment_get(store, i, NULL, levels);
        for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
            if (levels[l].octree.record_count > 0) look_around(&levels[l]);
        }
    }
    assert_int_equal(batch_count(f->dir, counts, NUMBERS, &err), KL_OK);
    for (int i = 0; i < NUMBERS; ++i) {
        assert_true(counts[i] <= 1);
        missing += counts[i] == 0;
    }
    if (damage.segments == 0) assert_int_equal(missing, damage.records[0]);
    if (missing > 0) assert_true(kl_store_damaged(store, NULL) > 0);
    if (one_block) {
        assert_int_equal(damage.segments, 0);
        assert_true(damage.blocks + damage.headers <= 1);
        assert_true(missing <= SEGMENT_BLOCK_RECORDS);
    }
    kl_store_close(store);
}

static void flipped_bits_lose_one_block(void **state) /* 3, 4, 7, 9, 10 */
{
    struct fixture *f = *state;
    uint32_t seed = 1;

    for (int i = 0; i < flips; ++i) {
        const int which = i & 1;
        /* Every other one among headers, which are small. */
        const size_t room = (i & 2) != 0 ? 1024 : f->size[which];
        size_t at = next_random(&seed) % room;
        if ((i & 6) == 6) at = f->size[which] - 1 - at; /* the second header */
        const char bit = (char)(1 << (next_random(&seed) % 8));
        f->bytes[which][at] = (char)(f->bytes[which][at] ^ bit);
        put(f->path[which], f->bytes[which], f->size[which]);
        check_store(f, true);
        f->bytes[which][at] = (char)(f->bytes[which][at] ^ bit);
        put(f->path[which], f->bytes[which], f->size[which]);
    }
}

static void torn_pages_lose_their_blocks(void **state) /* 9 */
{
    struct fixture *f = *state;
    uint32_t seed = 2;

    for (int i = 0; i < flips / 8; ++i) {
        const int which = i & 1;
        const size_t page = next_random(&seed) % (f->size[which] / 4096);
        char saved[4096];
        memcpy(saved, f->bytes[which] + page * 4096, 4096);
        memset(f->bytes[which] + page * 4096, 0, 4096);
        put(f->path[which], f->bytes[which], f->size[which]);
        check_store(f, false);
        memcpy(f->bytes[which] + page * 4096, saved, 4096);
        put(f->path[which], f->bytes[which], f->size[which]);
    }
}

static void cut_files_keep_what_is_there(void **state) /* 1, 9 */
{
    struct fixture *f = *state;
    uint32_t seed = 3;

    for (int i = 0; i < cuts; ++i) {
        const int which = i & 1;
        const size_t room = (i & 2) != 0 ? 4096 : f->size[which];
        put(f->path[which], f->bytes[which], next_random(&seed) % room);
        check_store(f, false);
        put(f->path[which], f->bytes[which], f->size[which]);
    }
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(flipped_bits_lose_one_block),
        cmocka_unit_test(torn_pages_lose_their_blocks),
        cmocka_unit_test(cut_files_keep_what_is_there),
    };

    if (argc > 1 && strcmp(argv[1], "all") == 0) {
        flips = 10000;
        cuts = 1000;
    }
    return cmocka_run_group_tests_name("damage", tests, setup, teardown);
}
