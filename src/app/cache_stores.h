/* The stores that a cache folder holds. */
#ifndef KL_SRC_APP_CACHE_STORES_H
#define KL_SRC_APP_CACHE_STORES_H

#include "src/base/status.h"

#include <stddef.h>

struct kl_cache_stores {
    size_t count, capacity;
    char **paths;
};

/* The cache of a moving scene is a folder of stores, one per instant: its sub-folders "t-...",
 * sorted. Any other folder is a store itself. *out zeroed before; kl_cache_stores_fini also after a
 * failure. */
kl_status kl_cache_stores_find(const char *dir, struct kl_cache_stores *out,
                               struct kl_err *err) KL_MUST_CHECK;
void kl_cache_stores_fini(struct kl_cache_stores *stores);

#endif
