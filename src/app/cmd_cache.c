/* cache info and cache check. The cache of a moving scene is a folder of stores, one per instant
 * ("t-..."): both commands go through all of them. */
#include "cache_io/store.h"
#include "src/app/commands.h"
#include "src/app/folders.h"
#include "src/app/json_text.h"
#include "src/base/hash.h"
#include "src/base/memory.h"

#include <dirent.h>
#include <float.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PATH_SIZE = 4096 };

/* One store, or the sum of the stores of a moving scene. */
struct summary {
    struct kl_store_key key;
    uint64_t records[KL_CACHE_LEVELS];
    uint64_t segments, bytes, generation, damaged, stores;
    double box_min[3], box_max[3]; /* [m] world; empty while there is no record */
};

struct stores {
    size_t count, capacity;
    char **paths;
};

static void stores_fini(struct stores *stores)
{
    for (size_t i = 0; i < stores->count; ++i) {
        free(stores->paths[i]);
    }
    free(stores->paths);
}

static kl_status add_store(struct stores *stores, const char *path, struct kl_err *err)
{
    kl_status st = kl_grow_array(&stores->paths, &stores->capacity, stores->count + 1,
                                 sizeof *stores->paths, err);
    if (st == KL_OK) st = kl_copy_string(&stores->paths[stores->count], path, err);
    if (st == KL_OK) ++stores->count;
    return st;
}

static int compare_paths(const void *a, const void *b)
{
    char *const *x = a;
    char *const *y = b;
    return strcmp(*x, *y);
}

/* The stores in `dir`: itself, or its sub-folders "t-...", sorted. */
static kl_status find_stores(const char *dir, struct stores *out, struct kl_err *err)
{
    DIR *folder = opendir(dir);
    const struct dirent *entry = NULL;
    kl_status st = KL_OK;

    if (folder == NULL) {
        return kl_fail(err, KL_ERR_INPUT, "%s: not a folder that can be read", dir);
    }
    while (st == KL_OK &&
           (entry = readdir(folder)) != NULL) { /* NOLINT(concurrency-mt-unsafe): own stream */
        char path[PATH_SIZE];
        const int n = snprintf(path, sizeof path, "%s/%s", dir, entry->d_name);
        if (n < 0 || (size_t)n >= sizeof path || strncmp(entry->d_name, "t-", 2) != 0) continue;
        if (kl_folder_is(path)) st = add_store(out, path, err);
    }
    (void)closedir(folder);
    if (st == KL_OK && out->count == 0) st = add_store(out, dir, err);
    if (st == KL_OK) qsort(out->paths, out->count, sizeof *out->paths, compare_paths);
    return st;
}

static void add_box(struct summary *s, const struct kl_level_arrays *level, const double origin[3])
{
    for (uint32_t r = 0; r < level->record_count; ++r) {
        for (int k = 0; k < 3; ++k) {
            const double x = origin[k] + (double)level->hot[r].pos[k];
            s->box_min[k] = fmin(s->box_min[k], x);
            s->box_max[k] = fmax(s->box_max[k], x);
        }
    }
}

static void add_summary(struct summary *s, const struct kl_store *store)
{
    kl_store_key_get(store, &s->key);
    for (size_t i = 0; i < kl_store_segment_count(store); ++i) {
        struct kl_store_segment_info info;
        struct kl_level_arrays levels[KL_CACHE_LEVELS];
        kl_store_segment_get(store, i, &info, levels);
        for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
            s->records[l] += levels[l].record_count;
            add_box(s, &levels[l], s->key.origin);
        }
        ++s->segments;
    }
    const uint64_t generation = kl_store_generation(store);
    if (generation > s->generation) s->generation = generation;
    s->bytes += kl_store_bytes(store);
    s->damaged += kl_store_damaged(store, NULL);
    ++s->stores;
}

static kl_status summarise(const char *dir, struct summary *out, struct kl_err *err)
{
    struct stores stores = {0};
    struct summary s = {.box_min = {DBL_MAX, DBL_MAX, DBL_MAX},
                        .box_max = {-DBL_MAX, -DBL_MAX, -DBL_MAX}};
    kl_status st = find_stores(dir, &stores, err);

    for (size_t i = 0; st == KL_OK && i < stores.count; ++i) {
        struct kl_store *store = NULL;
        st = kl_store_open(stores.paths[i], KL_STORE_READ, NULL, &store, err);
        if (st != KL_OK) break;
        add_summary(&s, store);
        kl_store_close(store);
    }
    stores_fini(&stores);
    if (st == KL_OK) *out = s;
    return st;
}

static uint64_t total_records(const struct summary *s)
{
    uint64_t sum = 0;
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        sum += s->records[l];
    }
    return sum;
}

static json_t *describe(const char *dir, const struct summary *s)
{
    char scene[KL_HASH_HEX_SIZE];
    char settings[KL_HASH_HEX_SIZE];
    json_t *levels = json_array();
    json_t *box = total_records(s) == 0 ? json_null()
                                        : json_pack("{s:[fff],s:[fff]}", "min", s->box_min[0],
                                                    s->box_min[1], s->box_min[2], "max",
                                                    s->box_max[0], s->box_max[1], s->box_max[2]);

    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        (void)json_array_append_new(
            levels, json_pack("{s:i,s:I}", "level", l, "records", (json_int_t)s->records[l]));
    }
    kl_hash_to_hex(s->key.scene, KL_DIGEST_SIZE, scene);
    kl_hash_to_hex(s->key.settings, KL_DIGEST_SIZE, settings);
    return json_pack("{s:s,s:I,s:I,s:I,s:I,s:I,s:I,s:s,s:s,s:o,s:o,s:[fff]}", "path", dir,
                     "records", (json_int_t)total_records(s), "segments", (json_int_t)s->segments,
                     "bytes", (json_int_t)s->bytes, "generation", (json_int_t)s->generation,
                     "damaged", (json_int_t)s->damaged, "stores", (json_int_t)s->stores,
                     "scene_digest", scene, "settings_digest", settings, "levels", levels, "box",
                     box, "origin", s->key.origin[0], s->key.origin[1], s->key.origin[2]);
}

static void print_text(const char *dir, const struct summary *s)
{
    char scene[KL_HASH_HEX_SIZE];
    char settings[KL_HASH_HEX_SIZE];

    kl_hash_to_hex(s->key.scene, KL_DIGEST_SIZE, scene);
    kl_hash_to_hex(s->key.settings, KL_DIGEST_SIZE, settings);
    (void)printf("cache       %s\n", dir);
    (void)printf("records     %llu (seen %llu, world %llu)\n", (unsigned long long)total_records(s),
                 (unsigned long long)s->records[0], (unsigned long long)s->records[1]);
    (void)printf("segments    %llu, %llu damaged\n", (unsigned long long)s->segments,
                 (unsigned long long)s->damaged);
    (void)printf("bytes       %llu\n", (unsigned long long)s->bytes);
    (void)printf("generation  %llu\n", (unsigned long long)s->generation);
    if (s->stores > 1) {
        (void)printf("instants    %llu\n", (unsigned long long)s->stores);
    }
    (void)printf("scene       %s\n", scene);
    (void)printf("settings    %s\n", settings);
    if (total_records(s) == 0) return;
    (void)printf("box         %.4g %.4g %.4g to %.4g %.4g %.4g m\n", s->box_min[0], s->box_min[1],
                 s->box_min[2], s->box_max[0], s->box_max[1], s->box_max[2]);
}

kl_status kl_command_cache_info(const struct kl_options *options, struct kl_err *err)
{
    const struct kl_options *o = options;
    json_t *list = json_array();
    kl_status st = KL_OK;

    for (size_t i = 0; st == KL_OK && i < o->argument_count; ++i) {
        struct summary summary;
        st = summarise(o->arguments[i], &summary, err);
        if (st != KL_OK) break;
        if (!o->json || o->json_file != NULL) print_text(o->arguments[i], &summary);
        if (json_array_append_new(list, describe(o->arguments[i], &summary)) != 0) {
            st = kl_fail(err, KL_ERR_NO_MEMORY, "cache info: out of memory");
        }
    }
    if (st == KL_OK && o->json) {
        /* One cache is an object, several are a list. */
        const json_t *root = o->argument_count == 1 ? json_array_get(list, 0) : list;
        st = kl_json_write(root, o->json_file, err);
    }
    json_decref(list);
    return st;
}

/* Prints what is wrong with one store. */
static kl_status check_store(const char *path, struct kl_err *err)
{
    struct kl_store *store = NULL;
    const char *first = NULL;
    kl_status st = kl_store_open(path, KL_STORE_READ, NULL, &store, err);

    if (st != KL_OK) return st;
    const size_t damaged = kl_store_damaged(store, &first);
    if (damaged > 0) {
        st = kl_fail(err, KL_ERR_CORRUPT, "%s: %zu damaged segments: %s", path, damaged,
                     first != NULL ? first : "");
    } else {
        (void)printf("%s: whole, %zu segments\n", path, kl_store_segment_count(store));
    }
    kl_store_close(store);
    return st;
}

kl_status kl_command_cache_check(const struct kl_options *options, struct kl_err *err)
{
    struct kl_err worst = {.status = KL_OK};

    for (size_t i = 0; i < options->argument_count; ++i) {
        struct stores stores = {0};
        kl_status st = find_stores(options->arguments[i], &stores, err);
        if (st != KL_OK) worst = *err;
        for (size_t k = 0; st == KL_OK && k < stores.count; ++k) {
            struct kl_err found;
            if (check_store(stores.paths[k], &found) == KL_OK) continue;
            (void)printf("%s\n", found.msg);
            if (worst.status == KL_OK) worst = found;
        }
        stores_fini(&stores);
    }
    if (worst.status != KL_OK) *err = worst;
    return worst.status;
}
