/* cache check: whether a cache is whole. */
#include "cache_io/store.h"
#include "src/app/cache_stores.h"
#include "src/app/commands.h"

#include <stdio.h>

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
        struct kl_cache_stores stores = {0};
        kl_status st = kl_cache_stores_find(options->arguments[i], &stores, err);
        if (st != KL_OK) worst = *err;
        for (size_t k = 0; st == KL_OK && k < stores.count; ++k) {
            struct kl_err found;
            if (check_store(stores.paths[k], &found) == KL_OK) continue;
            (void)printf("%s\n", found.msg);
            if (worst.status == KL_OK) worst = found;
        }
        kl_cache_stores_fini(&stores);
    }
    if (worst.status != KL_OK) *err = worst;
    return worst.status;
}
