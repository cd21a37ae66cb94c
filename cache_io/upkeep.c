#include "cache_io/store_impl.h"

kl_status store_open_found(const char *dir, struct kl_store **out, struct kl_err *err)
{
    struct kl_store *store = NULL;
    struct kl_store_key key;
    kl_status st = kl_store_open(dir, KL_STORE_READ, NULL, &store, err);

    if (st != KL_OK) return st;
    kl_store_key_get(store, &key);
    kl_store_close(store);
    return kl_store_open(dir, KL_STORE_EXTEND, &key, out, err);
}
