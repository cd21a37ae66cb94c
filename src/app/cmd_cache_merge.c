/* cache merge: one cache from several. The caches of a moving scene are merged instant by instant.
 */
#include "cache_io/upkeep.h"
#include "src/app/cache_stores.h"
#include "src/app/commands.h"
#include "src/app/folders.h"
#include "src/app/json_text.h"
#include "src/base/memory.h"

#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PATH_SIZE = 4096 };

/* A store among the sources: `instant` is "t-..." within its cache, or "". */
struct source {
    const char *path, *instant;
};

struct sources {
    struct kl_cache_stores *caches; /* one per argument */
    size_t count, capacity;
    struct source *items; /* sorted by instant */
};

static int compare_sources(const void *a, const void *b)
{
    const struct source *x = a;
    const struct source *y = b;

    const int order = strcmp(x->instant, y->instant);
    return order != 0 ? order : strcmp(x->path, y->path);
}

static kl_status find_sources(const struct kl_options *o, struct sources *out, struct kl_err *err)
{
    kl_status st = kl_alloc_array(&out->caches, o->argument_count, sizeof *out->caches, err);

    for (size_t i = 0; st == KL_OK && i < o->argument_count; ++i) {
        struct kl_cache_stores *stores = &out->caches[i];
        st = kl_cache_stores_find(o->arguments[i], stores, err);
        for (size_t k = 0; st == KL_OK && k < stores->count; ++k) {
            const bool is_whole = strcmp(stores->paths[k], o->arguments[i]) == 0;
            st =
                kl_grow_array(&out->items, &out->capacity, out->count + 1, sizeof *out->items, err);
            if (st != KL_OK) break;
            out->items[out->count++] = (struct source){
                stores->paths[k], is_whole ? "" : strrchr(stores->paths[k], '/') + 1};
        }
    }
    if (st == KL_OK) qsort(out->items, out->count, sizeof *out->items, compare_sources);
    return st;
}

/* Merge items [first, last), which are of one instant. */
static kl_status merge_instant(const struct kl_options *o, const struct sources *sources,
                               size_t first, size_t last, struct kl_store_merged *sum,
                               struct kl_err *err)
{
    const char **paths = NULL;
    struct kl_store_merged merged;
    char target[PATH_SIZE];
    const char *instant = sources->items[first].instant;
    const int n = snprintf(target, sizeof target, "%s%s%s", o->output,
                           instant[0] != '\0' ? "/" : "", instant);

    if (n < 0 || (size_t)n >= sizeof target) {
        return kl_fail(err, KL_ERR_USAGE, "--output: the name is too long");
    }
    kl_status st = kl_alloc_array(&paths, last - first, sizeof *paths, err);
    if (st != KL_OK) return st;
    for (size_t i = first; i < last; ++i) {
        paths[i - first] = sources->items[i].path;
    }
    st = kl_folders_make(target, false, err);
    if (st == KL_OK) st = kl_store_merge(paths, last - first, target, &merged, err);
    free(paths);
    if (st != KL_OK) return st;
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        sum->records[l] += merged.records[l];
    }
    sum->merged += merged.merged;
    sum->damaged += merged.damaged;
    return KL_OK;
}

static kl_status report(const struct kl_options *o, const struct kl_store_merged *m,
                        struct kl_err *err)
{
    uint64_t records = 0;
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        records += m->records[l];
    }
    if (!o->json || o->json_file != NULL) {
        (void)printf("%s: %llu records, %llu duplicates merged\n", o->output,
                     (unsigned long long)records, (unsigned long long)m->merged);
        if (m->damaged > 0) {
            (void)printf("%llu damaged segments of the sources: what was whole of them is there\n",
                         (unsigned long long)m->damaged);
        }
    }
    if (!o->json) return KL_OK;
    json_t *root = json_pack("{s:s,s:I,s:I,s:I}", "path", o->output, "records", (json_int_t)records,
                             "merged", (json_int_t)m->merged, "damaged", (json_int_t)m->damaged);
    if (root == NULL) return kl_fail(err, KL_ERR_NO_MEMORY, "cache merge: out of memory");
    kl_status st = kl_json_write(root, o->json_file, err);
    json_decref(root);
    return st;
}

kl_status kl_command_cache_merge(const struct kl_options *options, struct kl_err *err)
{
    const struct kl_options *o = options;
    struct sources sources = {0};
    struct kl_store_merged sum = {0};

    if (o->output == NULL) {
        return kl_fail(err, KL_ERR_USAGE, "cache merge: expected -o CACHE, the new cache");
    }
    kl_status st = find_sources(o, &sources, err);
    for (size_t first = 0; st == KL_OK && first < sources.count;) {
        size_t last = first + 1;
        while (last < sources.count &&
               strcmp(sources.items[last].instant, sources.items[first].instant) == 0) {
            ++last;
        }
        st = merge_instant(o, &sources, first, last, &sum, err);
        first = last;
    }
    if (st == KL_OK) st = report(o, &sum, err);
    for (size_t i = 0; sources.caches != NULL && i < o->argument_count; ++i) {
        kl_cache_stores_fini(&sources.caches[i]);
    }
    free(sources.caches);
    free(sources.items);
    return st;
}
