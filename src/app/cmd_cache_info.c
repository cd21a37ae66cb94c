/* cache info: what a cache holds. */
#include "cache_io/store.h"
#include "src/app/cache_stores.h"
#include "src/app/commands.h"
#include "src/app/json_text.h"
#include "src/base/hash.h"

#include <float.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>

/* One store, or the sum of the stores of a moving scene. */
struct summary {
    struct kl_store_key key;
    uint64_t records[KL_CACHE_LEVELS];
    uint64_t segments, bytes, generation, damaged, stores;
    double box_min[3], box_max[3]; /* [m] world; empty while there is no record */
};

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
    struct kl_cache_stores stores = {0};
    struct summary s = {.box_min = {DBL_MAX, DBL_MAX, DBL_MAX},
                        .box_max = {-DBL_MAX, -DBL_MAX, -DBL_MAX}};
    kl_status st = kl_cache_stores_find(dir, &stores, err);

    for (size_t i = 0; st == KL_OK && i < stores.count; ++i) {
        struct kl_store *store = NULL;
        st = kl_store_open(stores.paths[i], KL_STORE_READ, NULL, &store, err);
        if (st != KL_OK) break;
        add_summary(&s, store);
        kl_store_close(store);
    }
    kl_cache_stores_fini(&stores);
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
