/* Private to src/render/revision*.c. */
#ifndef KL_SRC_RENDER_REVISION_IMPL_H
#define KL_SRC_RENDER_REVISION_IMPL_H

#include "src/render/revision.h"

enum kl_fate {
    KL_FATE_KEEP,
    KL_FATE_AGAIN, /* gathered again at its place */
    KL_FATE_DROP,
};

/* Where geometry was or is that differs, render space [m]. */
struct kl_revision_box {
    float min[3], max[3];
};

struct kl_revision_level {
    uint32_t count;
    kl_record_hot *hot;
    kl_record_cold *cold;
    uint8_t *fate; /* enum kl_fate */
};

struct kl_revision {
    struct kl_store *old;
    struct kl_cache_settings settings;
    struct kl_cache *before; /* all old records */
    const kl_scene_view *scene;
    float touch;
    kl_query query; /* of gather rays */
    struct kl_parts_edits edits;
    kl_u32 mask[2]; /* bits of what changed */
    bool all;       /* light may come from where none came: every value is stale */
    bool in_place;  /* only lights changed: seen records are gathered again where they are */
    uint32_t box_count;
    struct kl_revision_box *boxes;
    struct kl_revision_level levels[KL_CACHE_LEVELS];
};

/* May geometry that changed be seen from the record, or change the shadows on what it sees? By a
 * few rays; boxes stand for what is in them. */
bool kl_revision_sees_boxes(const struct kl_revision *revision, const kl_record_hot *hot,
                            const kl_record_cold *cold);

/* Does the record's light change by the share `touch` or more when the records that its rays end in
 * go from `before` to `after`? By a few rays. */
bool kl_revision_is_changed(const struct kl_revision *revision, const kl_level_view *before,
                            const kl_level_view *after, const kl_record_hot *hot,
                            const kl_record_cold *cold);

/* A cache of the records of all levels whose fate is at most `worst`. *out is the caller's. */
kl_status kl_revision_build(const struct kl_revision *revision, enum kl_fate worst,
                            struct kl_cache **out, struct kl_err *err) KL_MUST_CHECK;

#endif
