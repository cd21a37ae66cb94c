#include "tests/crash/batch.h"

#include "cache_io/records.h"
#include "kernels/sampling.h"
#include "src/cache/cache.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static void must(kl_status st, const struct kl_err *err)
{
    if (st == KL_OK) return;
    (void)fprintf(stderr, "%s\n", err->msg);
    abort();
}

/* Spread over a plane, so that indexing does not take long. */
static void make_record(uint32_t number, uint32_t level, kl_record_hot *hot, kl_record_cold *cold)
{
    memset(hot, 0, sizeof *hot);
    memset(cold, 0, sizeof *cold);
    hot->pos[0] = (float)(number % 2048) * 0.01f;
    hot->pos[1] = (float)(number / 2048) * 0.01f;
    hot->normal = kl_oct_encode(kl_v3(0.0f, 0.0f, 1.0f));
    hot->radius = 0.012f;
    hot->radius2 = 0.012f;
    hot->form = level << 20;
    hot->object = KL_NONE;
    cold->irr[0] = 1.0f + (float)(number % 97);
    cold->irr[1] = 2.0f;
    cold->irr[2] = (float)level;
    cold->raw_radius = 0.05f;
    memset(cold->clearance, 255, sizeof cold->clearance); /* nothing in the way */
}

struct batch *batch_create(uint32_t first, uint32_t count)
{
    struct batch *b = calloc(1, sizeof *b);

    if (b == NULL) abort();
    b->count = count;
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        const uint32_t n = count >> l;
        b->hot[l] = calloc(n + 1, sizeof *b->hot[l]);
        b->cold[l] = calloc(n + 1, sizeof *b->cold[l]);
        if (b->hot[l] == NULL || b->cold[l] == NULL) abort();
        for (uint32_t i = 0; i < n; ++i) {
            make_record(first + i, l, &b->hot[l][i], &b->cold[l][i]);
        }
        b->levels[l].record_count = n;
        b->levels[l].hot = b->hot[l];
        b->levels[l].cold = b->cold[l];
    }
    return b;
}

struct batch *batch_create_indexed(uint32_t first, uint32_t count)
{
    const struct kl_cache_settings settings = {.center = {10.0f, 10.0f, 0.0f},
                                               .scene_radius = 20.0f,
                                               .accuracy = {0.25f, 0.25f},
                                               .reach = {1.0f, 1.0f},
                                               .cos_max = 0.9f};
    struct batch *b = batch_create(first, count);
    struct kl_err err;

    must(kl_cache_create(&settings, &b->cache, &err), &err);
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        must(kl_cache_insert(b->cache, l, b->hot[l], b->cold[l], b->levels[l].record_count, &err),
             &err);
    }
    must(kl_cache_finish(b->cache, &err), &err);
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        b->levels[l] = kl_cache_get_arrays(b->cache, l);
    }
    return b;
}

void batch_destroy(struct batch *batch)
{
    if (batch == NULL) return;
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        free(batch->hot[l]);
        free(batch->cold[l]);
    }
    kl_cache_destroy(batch->cache);
    free(batch);
}

uint32_t batch_number(const kl_record_hot *hot)
{
    return (uint32_t)(hot->pos[0] * 100.0f + 0.5f) + 2048 * (uint32_t)(hot->pos[1] * 100.0f + 0.5f);
}

struct kl_store_key batch_key(void)
{
    struct kl_store_key key = {.origin = {0.0, 0.0, 12.5}};

    memset(key.scene, 0xab, sizeof key.scene);
    memset(key.settings, 0xcd, sizeof key.settings);
    return key;
}

static void count_level(const struct kl_level_arrays *level, uint32_t *counts, uint32_t limit)
{
    for (uint32_t i = 0; i < level->record_count; ++i) {
        kl_record_hot hot;
        kl_record_cold cold;
        const uint32_t number = batch_number(&level->hot[i]);
        if (number >= limit) abort();
        make_record(number, 0, &hot, &cold);
        if (memcmp(hot.pos, level->hot[i].pos, sizeof hot.pos) != 0 ||
            memcmp(&cold, &level->cold[i], sizeof cold) != 0) {
            abort();
        }
        ++counts[number];
    }
}

kl_status batch_count(const char *dir, uint32_t *counts, uint32_t limit, struct kl_err *err)
{
    const struct kl_store_key key = batch_key();
    struct kl_store *store = NULL;
    kl_status st = kl_store_open(dir, KL_STORE_READ, &key, &store, err);

    if (st != KL_OK) return st;
    for (size_t i = 0; i < kl_store_segment_count(store); ++i) {
        struct kl_level_arrays levels[KL_CACHE_LEVELS];
        kl_store_segment_get(store, i, NULL, levels);
        count_level(&levels[0], counts, limit);
    }
    kl_store_close(store);
    return KL_OK;
}

void batch_must(kl_status st, const struct kl_err *err)
{
    if (st == KL_OK) return;
    (void)fprintf(stderr, "%s\n", err->msg);
    _exit(1);
}

struct kl_store *batch_open(const char *dir, enum kl_store_mode mode)
{
    const struct kl_store_key key = batch_key();
    struct kl_store *store = NULL;
    struct kl_err err;

    batch_must(kl_store_open(dir, mode, &key, &store, &err), &err);
    return store;
}

void batch_compact(struct kl_store *store)
{
    struct kl_records *records = NULL;
    struct kl_err err;
    uint64_t merged = 0;

    batch_must(kl_records_create(&records, &err), &err);
    batch_must(kl_records_add_store(records, store, &err), &err);
    batch_must(kl_records_merge(records, &merged, &err), &err);
    batch_must(kl_store_publish_records(store, records, &err), &err);
    kl_records_destroy(records);
}

void folder_create(char path[64])
{
    const char *root = getenv("TMPDIR");

    (void)snprintf(path, 64, "%.40s/kl_crash_XXXXXX", root != NULL ? root : "/tmp");
    if (mkdtemp(path) == NULL) abort();
}

void folder_empty(const char *path)
{
    char name[600];
    DIR *dir = opendir(path);

    if (dir == NULL) return;
    for (const struct dirent *e = readdir(dir); e != NULL; e = readdir(dir)) {
        if (strcmp(e->d_name, ".") == 0 || strcmp(e->d_name, "..") == 0) continue;
        (void)snprintf(name, sizeof name, "%s/%s", path, e->d_name);
        if (unlink(name) != 0) folder_destroy(name);
    }
    (void)closedir(dir);
}

void folder_destroy(const char *path)
{
    folder_empty(path);
    (void)rmdir(path);
}
