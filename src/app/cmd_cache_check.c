/* cache check: whether a cache is whole, and with --repair, what of it stays. */
#include "cache_io/upkeep.h"
#include "src/app/cache_stores.h"
#include "src/app/commands.h"
#include "src/app/json_text.h"

#include <jansson.h>
#include <stdio.h>

/* Of one store. */
struct finding {
    const char *path;
    size_t segments, damaged;
    struct kl_store_damage damage;
    struct kl_store_repaired repaired;
    char message[512]; /* "": whole */
};

static kl_status look(const char *path, struct finding *out, struct kl_err *err)
{
    struct kl_store *store = NULL;
    const char *first = NULL;

    *out = (struct finding){.path = path};
    kl_status st = kl_store_open(path, KL_STORE_READ, NULL, &store, err);
    if (st != KL_OK) {
        (void)snprintf(out->message, sizeof out->message, "%s", err->msg);
        return st;
    }
    out->segments = kl_store_segment_count(store);
    out->damaged = kl_store_damaged(store, &first);
    kl_store_get_damage(store, &out->damage);
    if (out->damaged > 0) {
        st =
            kl_fail(err, KL_ERR_CORRUPT, "%s: %zu damaged segments: %s", path, out->damaged, first);
        (void)snprintf(out->message, sizeof out->message, "%s", err->msg);
    }
    kl_store_close(store);
    return st;
}

static unsigned long long sum(const uint64_t records[KL_CACHE_LEVELS])
{
    unsigned long long total = 0;
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        total += records[l];
    }
    return total;
}

static void print_text(const struct finding *f, bool repair)
{
    const struct kl_store_damage *d = &f->damage;

    if (f->message[0] == '\0') {
        (void)printf("%s: whole, %zu segments\n", f->path, f->segments);
        return;
    }
    (void)printf("%s\n", f->message);
    (void)printf("%s: %llu segments, %llu headers, %llu blocks, %llu octrees damaged; %llu records "
                 "lost; %llu foreign segments\n",
                 f->path, (unsigned long long)d->segments, (unsigned long long)d->headers,
                 (unsigned long long)d->blocks, (unsigned long long)d->octrees, sum(d->records),
                 (unsigned long long)d->foreign);
    if (!repair) return;
    (void)printf("%s: repaired: %llu segments rewritten, %llu removed\n", f->path,
                 (unsigned long long)f->repaired.rewritten,
                 (unsigned long long)f->repaired.removed);
}

static json_t *describe(const struct finding *f, bool repair)
{
    const struct kl_store_damage *d = &f->damage;
    json_t *object =
        json_pack("{s:s,s:b,s:I,s:I,s:s?,s:{s:I,s:I,s:I,s:I,s:I,s:I}}", "path", f->path, "whole",
                  f->message[0] == '\0', "segments", (json_int_t)f->segments, "damaged",
                  (json_int_t)f->damaged, "message", f->message[0] != '\0' ? f->message : NULL,
                  "lost", "segments", (json_int_t)d->segments, "headers", (json_int_t)d->headers,
                  "blocks", (json_int_t)d->blocks, "octrees", (json_int_t)d->octrees, "records",
                  (json_int_t)sum(d->records), "foreign", (json_int_t)d->foreign);

    if (repair && object != NULL) {
        (void)json_object_set_new(object, "repaired",
                                  json_pack("{s:I,s:I}", "rewritten",
                                            (json_int_t)f->repaired.rewritten, "removed",
                                            (json_int_t)f->repaired.removed));
    }
    return object;
}

/* Look, repair, report; *worst: what is still wrong. */
static kl_status check_store(const struct kl_options *o, const char *path, json_t *list,
                             struct kl_err *worst, struct kl_err *err)
{
    struct finding finding;
    struct kl_err found;
    kl_status st = look(path, &finding, &found);

    if (st == KL_ERR_CORRUPT && o->repair) {
        st = kl_store_repair(path, &finding.repaired, &found);
        /* Strangers stay, and are still named. */
        if (st == KL_OK && finding.damage.foreign > 0) {
            st = kl_fail(&found, KL_ERR_CORRUPT, "%s", finding.message);
        }
    }
    if (st != KL_OK && worst->status == KL_OK) *worst = found;
    if (!o->json || o->json_file != NULL) print_text(&finding, o->repair);
    if (json_array_append_new(list, describe(&finding, o->repair)) != 0) {
        return kl_fail(err, KL_ERR_NO_MEMORY, "cache check: out of memory");
    }
    return KL_OK;
}

kl_status kl_command_cache_check(const struct kl_options *options, struct kl_err *err)
{
    const struct kl_options *o = options;
    struct kl_err worst = {.status = KL_OK};
    json_t *list = json_array();
    kl_status st = KL_OK;

    for (size_t i = 0; st == KL_OK && i < o->argument_count; ++i) {
        struct kl_cache_stores stores = {0};
        struct kl_err missing;
        if (kl_cache_stores_find(o->arguments[i], &stores, &missing) != KL_OK) {
            if (worst.status == KL_OK) worst = missing;
        }
        for (size_t k = 0; st == KL_OK && k < stores.count; ++k) {
            st = check_store(o, stores.paths[k], list, &worst, err);
        }
        kl_cache_stores_fini(&stores);
    }
    if (st == KL_OK && o->json) st = kl_json_write(list, o->json_file, err);
    json_decref(list);
    if (st == KL_OK && worst.status != KL_OK) {
        *err = worst;
        st = worst.status;
    }
    return st;
}
