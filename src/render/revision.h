/* Private to src/render: a cache that was made for an earlier edition of the scene, and what of it
 * holds for this one (docs/decisions/0010-dependence.md).
 *
 * Life: open; then serve, where nothing may be gathered, or fill. */
#ifndef KL_SRC_RENDER_REVISION_H
#define KL_SRC_RENDER_REVISION_H

#include "src/render/fill.h"
#include "src/render/stale.h"

struct kl_revision;

struct kl_revision_query {
    struct kl_stale_query stale;
    const kl_scene_view *scene; /* with its tracer; stays until the revision is closed */
    const struct kl_cache_settings *settings;
    kl_query query; /* as gather rays ask level 1 */
    float touch;    /* share of a record's light from which on it depends on something */
};

/* Compare the editions and judge every record by what its rays met. KL_ERR_STALE: not the same
 * scene, other settings, another origin; *err says what. *out is the caller's: kl_revision_close.
 */
kl_status kl_revision_open(const struct kl_revision_query *query, struct kl_revision **out,
                           struct kl_err *err) KL_MUST_CHECK;
void kl_revision_close(struct kl_revision *revision); /* accepts NULL */

/* What was edited, in words; records that the old cache had, that were kept as they are, and that
 * were gathered again where they lie. All others were dropped. */
struct kl_revision_summary {
    char text[256];
    uint32_t had, kept, again;
};
void kl_revision_get_summary(const struct kl_revision *revision,
                             struct kl_revision_summary *summary);

/* A cache of the records that are kept by what their rays met. *out is the caller's. */
kl_status kl_revision_serve(const struct kl_revision *revision, struct kl_cache **out,
                            struct kl_err *err) KL_MUST_CHECK;

/* Bring values up to date: gather again what depends on the edits, directly and through the records
 * of level 1. Uses what `job` says about gathering, not its cache. *out is the caller's. */
kl_status kl_revision_fill(struct kl_revision *revision, const struct kl_fill_job *job,
                           struct kl_cache **out, struct kl_fill_stats *stats,
                           struct kl_err *err) KL_MUST_CHECK;

#endif
