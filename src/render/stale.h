/* Private to src/render: a cache that was made for something else. */
#ifndef KL_SRC_RENDER_STALE_H
#define KL_SRC_RENDER_STALE_H

#include "cache_io/store.h"
#include "src/scene/scene_parts.h"

/* What is asked of the cache in `dir`, and with what it is compared. */
struct kl_stale_query {
    const char *dir;
    const struct kl_store_key *key;
    const struct kl_scene_parts *parts;
};

/* A store that was refused as stale: open it for what it was made for, and compare. KL_OK: made for
 * an earlier edition of the scene; *edits, which borrow from *out and the query, say what differs;
 * both are the caller's (kl_parts_edits_fini, then kl_store_close). KL_ERR_STALE: another scene,
 * other settings, another origin: *err says which. */
kl_status kl_stale_open(const struct kl_stale_query *query, struct kl_store **out,
                        struct kl_parts_edits *edits, struct kl_err *err) KL_MUST_CHECK;

#endif
