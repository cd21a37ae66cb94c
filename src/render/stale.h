/* Private to src/render: a cache that was made for something else. */
#ifndef KL_SRC_RENDER_STALE_H
#define KL_SRC_RENDER_STALE_H

#include "cache_io/store.h"
#include "src/scene/parts.h"

/* What is asked of the cache in `dir`, and with what it is compared. */
struct kl_stale_query {
    const char *dir;
    const struct kl_store_key *key;
    const struct kl_scene_parts *parts;
};

/* Put into words why the store of `query` was refused: settings, origin, another scene, or which
 * parts of this one were edited. Always returns KL_ERR_STALE, with the reason in *err; where the
 * store cannot be read any more, what *err says already stays. */
kl_status kl_stale_explain(const struct kl_stale_query *query, struct kl_err *err);

#endif
