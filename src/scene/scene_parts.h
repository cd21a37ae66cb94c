/* What a scene is made of, as digests by which an edited scene is told from the one that a cache
 * was made for: objects, lights, environment (kernels/parts.h). */
#ifndef KL_SRC_SCENE_SCENE_PARTS_H
#define KL_SRC_SCENE_SCENE_PARTS_H

#include "kernels/parts.h"
#include "src/scene/flat.h"
#include "src/scene/scene.h"

struct kl_scene_parts {
    uint32_t count; /* 0: more parts than KL_PARTS_MAX; then a change is not looked into */
    kl_part *items; /* objects by their number, lights, the environment if any, settings */
    uint32_t object_count;
};

/* The parts at the pose that `flat` was made from, whose touch_bits are set. *out is the caller's:
 * kl_parts_fini. */
kl_status kl_parts_init(const struct kl_scene *scene, const struct kl_pose *pose,
                        struct kl_flat *flat, struct kl_scene_parts *out,
                        struct kl_err *err) KL_MUST_CHECK;
/* Note what records are gathered with, in words: once, as the last part. */
void kl_parts_add_settings(struct kl_scene_parts *parts, const char *label);
void kl_parts_fini(struct kl_scene_parts *parts);

enum kl_part_change {
    KL_PART_ADDED = 1,
    KL_PART_REMOVED = 2,
    KL_PART_SHAPE = 4,
    KL_PART_PLACE = 8,
    KL_PART_SURFACE = 16,
    KL_PART_GLOW = 32,
};

/* One part that differs. */
struct kl_part_edit {
    uint32_t what;              /* KL_PART_* of kl_part_change, or-ed */
    const kl_part *old, *fresh; /* NULL where it was added or removed; borrowed */
};

struct kl_parts_edits {
    uint32_t count;
    struct kl_part_edit *items;   /* in the order of the old list, then what was added */
    uint32_t old_objects, common; /* those that both lists name */
    bool is_same_scene; /* at least half of the objects of either list are named by both */
};

/* What turned `old` into `fresh`. Both must outlive *out, which is the caller's:
 * kl_parts_edits_fini.
 */
kl_status kl_parts_compare(const kl_part *old, uint32_t old_count, const kl_part *fresh,
                           uint32_t fresh_count, struct kl_parts_edits *out,
                           struct kl_err *err) KL_MUST_CHECK;
void kl_parts_edits_fini(struct kl_parts_edits *edits);

/* One line for people: "object 'ball 3' (material), light 'sun' (intensity) and 4 more". */
void kl_parts_edits_describe(const struct kl_parts_edits *edits, char *text, size_t size);

#endif
