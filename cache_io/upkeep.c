#include "cache_io/store_impl.h"

kl_status store_check_read(const struct kl_store *store, struct kl_err *err)
{
    for (size_t i = 0; i < store->reject_count; ++i) {
        if (store->rejects[i].why != REJECT_UNREAD) continue;
        return kl_fail(err, KL_ERR_IO, "%s", store->rejects[i].message);
    }
    return KL_OK;
}

kl_status store_open_found(const char *dir, struct kl_store **out, struct kl_err *err)
{
    struct kl_store *store = NULL;
    struct kl_store_key key;
    kl_status st = kl_store_open(dir, KL_STORE_READ, NULL, &store, err);

    if (st != KL_OK) return st;
    kl_store_key_get(store, &key);
    kl_store_close(store);
    st = kl_store_open(dir, KL_STORE_EXTEND, &key, &store, err);
    if (st != KL_OK) return st;
    st = store_check_read(store, err);
    if (st != KL_OK) {
        kl_store_close(store);
        return kl_wrap(err, "%s", dir);
    }
    *out = store;
    return KL_OK;
}
