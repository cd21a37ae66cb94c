/* cache info: what a cache holds, segment by segment: who wrote them, when, and with what. Who and
 * when are what the file system says. */
#include "cache_io/store.h"
#include "cache_io/use.h"
#include "src/app/cache_stores.h"
#include "src/app/commands.h"
#include "src/app/exit_code.h"
#include "src/app/json_text.h"
#include "src/base/hash.h"

#include <float.h>
#include <jansson.h>
#include <math.h>
#include <pwd.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

/* One store, or the sum of the stores of a moving scene. */
struct summary {
    struct kl_store_key key;
    uint64_t records[KL_CACHE_LEVELS];
    uint64_t segments, bytes, generation, damaged, stores;
    double box_min[3], box_max[3]; /* [m] world; empty while there is no record */
    uint32_t oldest;               /* generation that the oldest record was first written in */
    uint64_t renders, used;        /* files that tell of use; records of level 0 that were used */
    uint64_t use_generation;       /* the largest that one of them saw */
    int64_t last_use;              /* [s since 1970] */
    json_t *history;               /* segments */
};

static void format_time(int64_t seconds, char when[32])
{
    const time_t time = (time_t)seconds;
    struct tm utc;

    if (gmtime_r(&time, &utc) != NULL) (void)strftime(when, 32, "%Y-%m-%dT%H:%M:%SZ", &utc);
}

/* Owner and time of last change of a segment's file; "?" where the system does not say. */
static void find_origin(const char *dir, const char *name, char who[64], char when[32])
{
    char path[4096];
    struct stat info;

    (void)snprintf(who, 64, "?");
    (void)snprintf(when, 32, "?");
    const int n = snprintf(path, sizeof path, "%s/%s", dir, name);
    if (n < 0 || (size_t)n >= sizeof path || stat(path, &info) != 0) return;
    const struct passwd *user =
        getpwuid(info.st_uid); /* NOLINT(concurrency-mt-unsafe): one thread */
    if (user != NULL) {
        (void)snprintf(who, 64, "%s", user->pw_name);
    } else {
        (void)snprintf(who, 64, "%lu", (unsigned long)info.st_uid);
    }
    format_time((int64_t)info.st_mtime, when);
}

static json_t *describe_segment(const char *dir, const struct kl_store_segment_info *info)
{
    char who[64];
    char when[32];
    json_t *records = json_array();

    find_origin(dir, info->name, who, when);
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        (void)json_array_append_new(records, json_integer((json_int_t)info->records[l]));
    }
    return json_pack("{s:s,s:s,s:I,s:I,s:o,s:b,s:s,s:s,s:s,s:I}", "name", info->name, "kind",
                     info->is_base ? "base" : "delta", "generation", (json_int_t)info->generation,
                     "bytes", (json_int_t)info->bytes, "records", records, "indexed",
                     info->has_octree[0] || info->has_octree[1], "program", info->program, "who",
                     who, "when", when, "damaged_blocks", (json_int_t)info->damage.blocks);
}

static uint32_t oldest_of(const struct kl_store_segment_info *info)
{
    uint32_t oldest = info->born;

    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        for (uint32_t i = 0; info->births[l] != NULL && i < info->records[l]; ++i) {
            if (info->births[l][i] < oldest) oldest = info->births[l][i];
        }
    }
    return oldest;
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

/* What renders have told of use. */
static kl_status add_use(struct summary *s, const char *path, const struct kl_store *store,
                         struct kl_err *err)
{
    struct kl_use *use = NULL;
    struct kl_use_summary sum;
    kl_status st = kl_use_load(store, 0, &use, err);

    if (st != KL_OK) return st;
    kl_use_get_summary(use, &sum);
    s->renders += sum.files;
    if (sum.generation > s->use_generation) s->use_generation = sum.generation;
    if (sum.newest > s->last_use) s->last_use = sum.newest;
    for (size_t i = 0; sum.files > 0 && i < kl_store_segment_count(store); ++i) {
        struct kl_level_arrays levels[KL_CACHE_LEVELS];
        kl_store_segment_get(store, i, NULL, levels);
        for (uint32_t r = 0; r < levels[0].record_count; ++r)
            s->used += kl_use_has(use, &levels[0].hot[r]);
    }
    if (sum.damaged > 0) {
        char line[4096 + 320];
        (void)snprintf(line, sizeof line, "%s: a file of use is ignored: %s", path, sum.complaint);
        kl_say_warning(NULL, line);
    }
    kl_use_destroy(use);
    return KL_OK;
}

static void add_summary(struct summary *s, const char *path, const struct kl_store *store)
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
        const uint32_t oldest = oldest_of(&info);
        if (oldest < s->oldest) s->oldest = oldest;
        (void)json_array_append_new(s->history, describe_segment(path, &info));
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
    struct summary s = {.oldest = UINT32_MAX,
                        .history = json_array(),
                        .box_min = {DBL_MAX, DBL_MAX, DBL_MAX},
                        .box_max = {-DBL_MAX, -DBL_MAX, -DBL_MAX}};
    kl_status st = kl_cache_stores_find(dir, &stores, err);

    for (size_t i = 0; st == KL_OK && i < stores.count; ++i) {
        struct kl_store *store = NULL;
        st = kl_store_open(stores.paths[i], KL_STORE_READ, NULL, &store, err);
        if (st != KL_OK) break;
        add_summary(&s, stores.paths[i], store);
        st = add_use(&s, stores.paths[i], store, err);
        kl_store_close(store);
    }
    kl_cache_stores_fini(&stores);
    if (st == KL_OK) {
        *out = s;
    } else {
        json_decref(s.history);
    }
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

/* NULL in JSON where no render has told. */
static json_t *describe_use(const struct summary *s)
{
    char when[32] = "?";

    if (s->renders == 0) return json_null();
    format_time(s->last_use, when);
    return json_pack("{s:I,s:I,s:I,s:s}", "files", (json_int_t)s->renders, "records",
                     (json_int_t)s->used, "generation", (json_int_t)s->use_generation, "last",
                     when);
}

/* All told: the same bytes are on disk and mapped. */
static double bytes_per_record(const struct summary *s)
{
    const uint64_t records = total_records(s);
    return records > 0 ? (double)s->bytes / (double)records : 0.0;
}

/* Takes s->history. */
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
    return json_pack(
        "{s:s,s:I,s:I,s:I,s:f,s:I,s:I,s:I,s:I,s:s,s:s,s:o,s:o,s:[fff],s:o,s:o}", "path", dir,
        "records", (json_int_t)total_records(s), "segments", (json_int_t)s->segments, "bytes",
        (json_int_t)s->bytes, "bytes_per_record", bytes_per_record(s), "generation",
        (json_int_t)s->generation, "oldest", (json_int_t)(total_records(s) > 0 ? s->oldest : 0),
        "damaged", (json_int_t)s->damaged, "stores", (json_int_t)s->stores, "scene_digest", scene,
        "settings_digest", settings, "levels", levels, "box", box, "origin", s->key.origin[0],
        s->key.origin[1], s->key.origin[2], "use", describe_use(s), "history", s->history);
}

static void print_history(const json_t *history)
{
    size_t i = 0;
    const json_t *segment = NULL;

    json_array_foreach(history, i, segment)
    {
        (void)printf("segment     %s: %lld bytes, %s by %s with %s\n",
                     json_string_value(json_object_get(segment, "name")),
                     (long long)json_integer_value(json_object_get(segment, "bytes")),
                     json_string_value(json_object_get(segment, "when")),
                     json_string_value(json_object_get(segment, "who")),
                     json_string_value(json_object_get(segment, "program")));
    }
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
    (void)printf("bytes       %llu, %.0f a record\n", (unsigned long long)s->bytes,
                 bytes_per_record(s));
    (void)printf("generation  %llu, oldest records of %lu\n", (unsigned long long)s->generation,
                 (unsigned long)(total_records(s) > 0 ? s->oldest : 0));
    if (s->renders > 0) {
        char when[32] = "?";
        format_time(s->last_use, when);
        (void)printf("used        %llu of %llu seen records, last %s\n",
                     (unsigned long long)s->used, (unsigned long long)s->records[0], when);
    }
    if (s->stores > 1) {
        (void)printf("instants    %llu\n", (unsigned long long)s->stores);
    }
    (void)printf("scene       %s\n", scene);
    (void)printf("settings    %s\n", settings);
    print_history(s->history);
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
