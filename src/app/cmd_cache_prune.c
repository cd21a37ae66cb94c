/* cache prune: drop records by age, use, place or size. */
#include "cache_io/upkeep.h"
#include "src/app/cache_stores.h"
#include "src/app/commands.h"
#include "src/app/exit_code.h"
#include "src/app/json_text.h"
#include "src/app/option_text.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>

static kl_status read_request(const struct kl_options *o, struct kl_store_prune *out,
                              struct kl_err *err)
{
    kl_status st = KL_OK;

    *out = (struct kl_store_prune){.older_than = o->older_than,
                                   .max_bytes = o->max_bytes,
                                   .unused = o->unused || o->unused_for > 0.0,
                                   .unused_for = (int64_t)ceil(o->unused_for),
                                   .has_inside = o->inside != NULL,
                                   .has_outside = o->outside != NULL};
    if (out->has_inside) st = kl_option_read_box("inside", o->inside, out->inside, err);
    if (st == KL_OK && out->has_outside) {
        st = kl_option_read_box("outside", o->outside, out->outside, err);
    }
    if (st == KL_OK && out->older_than == 0 && out->max_bytes == 0 && !out->has_inside &&
        !out->has_outside && !out->unused) {
        st = kl_fail(err, KL_ERR_USAGE,
                     "cache prune: expected what to drop: --older-than, --unused, --unused-for, "
                     "--inside, --outside or --max-bytes");
    }
    return st;
}

/* All stores of one cache; a limit in bytes is shared out evenly among the instants. */
static kl_status prune_cache(const char *path, const struct kl_store_prune *request,
                             struct kl_store_pruned *sum, struct kl_err *err)
{
    struct kl_cache_stores stores = {0};
    struct kl_store_prune what = *request;
    size_t untold = 0;
    kl_status st = kl_cache_stores_find(path, &stores, err);

    if (st == KL_OK && request->max_bytes > 0) {
        what.max_bytes = request->max_bytes / stores.count;
        if (what.max_bytes == 0) what.max_bytes = 1;
    }
    for (size_t i = 0; st == KL_OK && i < stores.count; ++i) {
        struct kl_store_pruned pruned;
        st = kl_store_prune(stores.paths[i], &what, &pruned, err);
        if (st != KL_OK) break;
        sum->kept += pruned.kept;
        sum->dropped += pruned.dropped;
        untold += pruned.untold;
        if (pruned.damaged_uses > 0) {
            char line[4096 + 320];
            (void)snprintf(line, sizeof line, "%s: a file of use is ignored: %s", stores.paths[i],
                           pruned.complaint);
            kl_say_warning(NULL, line);
        }
    }
    if (st == KL_OK && untold > 0 && untold == stores.count) {
        st = kl_fail(err, KL_ERR_INPUT,
                     "%s: no render has told what it used%s: nothing can be said to be unused",
                     path, request->unused_for > 0 ? " in this time" : "");
    }
    kl_cache_stores_fini(&stores);
    return st;
}

kl_status kl_command_cache_prune(const struct kl_options *options, struct kl_err *err)
{
    const struct kl_options *o = options;
    struct kl_store_prune what;
    json_t *list = json_array();
    kl_status st = read_request(o, &what, err);

    for (size_t i = 0; st == KL_OK && i < o->argument_count; ++i) {
        struct kl_store_pruned sum = {0};
        st = prune_cache(o->arguments[i], &what, &sum, err);
        if (st != KL_OK) break;
        if (!o->json || o->json_file != NULL) {
            (void)printf("%s: %llu records dropped, %llu kept\n", o->arguments[i],
                         (unsigned long long)sum.dropped, (unsigned long long)sum.kept);
        }
        if (json_array_append_new(list, json_pack("{s:s,s:I,s:I}", "path", o->arguments[i],
                                                  "dropped", (json_int_t)sum.dropped, "kept",
                                                  (json_int_t)sum.kept)) != 0) {
            st = kl_fail(err, KL_ERR_NO_MEMORY, "cache prune: out of memory");
        }
    }
    if (st == KL_OK && o->json) {
        const json_t *root = o->argument_count == 1 ? json_array_get(list, 0) : list;
        st = kl_json_write(root, o->json_file, err);
    }
    json_decref(list);
    return st;
}
