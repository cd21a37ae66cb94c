#include "src/base/memory.h"
#include "src/scene/scene_parts.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int compare_parts(const void *a, const void *b)
{
    const kl_part *const *x = a;
    const kl_part *const *y = b;
    return memcmp((*x)->name, (*y)->name, sizeof(*x)->name);
}

static kl_status sort_parts(const kl_part *parts, uint32_t count, const kl_part ***out,
                            struct kl_err *err)
{
    kl_status st = kl_alloc_array(out, count, sizeof **out, err);
    if (st != KL_OK) return st;
    for (uint32_t i = 0; i < count; ++i) {
        (*out)[i] = &parts[i];
    }
    qsort(*out, count, sizeof **out, compare_parts);
    return KL_OK;
}

static const kl_part *find_part(const kl_part *wanted, const kl_part *const *sorted, uint32_t count)
{
    const kl_part *const *found = bsearch(&wanted, sorted, count, sizeof *sorted, compare_parts);
    return found != NULL ? *found : NULL;
}

static uint32_t difference(const kl_part *a, const kl_part *b)
{
    uint32_t what = 0;
    if (memcmp(a->shape, b->shape, sizeof a->shape) != 0) what |= KL_PART_SHAPE;
    if (memcmp(a->place, b->place, sizeof a->place) != 0) what |= KL_PART_PLACE;
    if (memcmp(a->surface, b->surface, sizeof a->surface) != 0) what |= KL_PART_SURFACE;
    if (memcmp(a->glow, b->glow, sizeof a->glow) != 0) what |= KL_PART_GLOW;
    return what;
}

static void add_edit(struct kl_parts_edits *out, uint32_t what, const kl_part *old,
                     const kl_part *fresh)
{
    if (what == 0) return;
    out->items[out->count++] = (struct kl_part_edit){what, old, fresh};
}

static uint32_t count_objects(const kl_part *parts, uint32_t count)
{
    uint32_t objects = 0;
    for (uint32_t i = 0; i < count; ++i) {
        objects += parts[i].kind == KL_PART_OBJECT;
    }
    return objects;
}

kl_status kl_parts_compare(const kl_part *old, uint32_t old_count, const kl_part *fresh,
                           uint32_t fresh_count, struct kl_parts_edits *out, struct kl_err *err)
{
    const kl_part **olds = NULL;
    const kl_part **news = NULL;

    *out = (struct kl_parts_edits){0};
    kl_status st = sort_parts(old, old_count, &olds, err);
    if (st == KL_OK) st = sort_parts(fresh, fresh_count, &news, err);
    if (st == KL_OK) {
        st = kl_alloc_array(&out->items, (size_t)old_count + fresh_count, sizeof *out->items, err);
    }
    if (st != KL_OK) goto cleanup;
    for (uint32_t i = 0; i < old_count; ++i) {
        if (old[i].kind == KL_PART_SETTINGS) continue;
        const kl_part *now = find_part(&old[i], news, fresh_count);
        if (now != NULL && now->kind == KL_PART_OBJECT) ++out->common;
        add_edit(out, now != NULL ? difference(&old[i], now) : (uint32_t)KL_PART_REMOVED, &old[i],
                 now);
    }
    for (uint32_t i = 0; i < fresh_count; ++i) {
        if (fresh[i].kind == KL_PART_SETTINGS) continue;
        if (find_part(&fresh[i], olds, old_count) == NULL) {
            add_edit(out, KL_PART_ADDED, NULL, &fresh[i]);
        }
    }
    out->old_objects = count_objects(old, old_count);
    out->is_same_scene =
        2 * out->common >= out->old_objects && 2 * out->common >= count_objects(fresh, fresh_count);

cleanup:
    free(olds);
    free(news);
    return st;
}

void kl_parts_edits_fini(struct kl_parts_edits *edits)
{
    free(edits->items);
    *edits = (struct kl_parts_edits){0};
}

/* The gravest of what happened to a part, in a word. */
static const char *word_for(const struct kl_part_edit *edit)
{
    const bool is_object = (edit->old != NULL ? edit->old : edit->fresh)->kind == KL_PART_OBJECT;
    if (edit->what & KL_PART_ADDED) return "new";
    if (edit->what & KL_PART_REMOVED) return "gone";
    if (edit->what & KL_PART_SHAPE) return is_object ? "shape" : "kind";
    if (edit->what & KL_PART_PLACE) return "place";
    if (edit->what & KL_PART_GLOW) return is_object ? "emission" : "intensity";
    return "material";
}

void kl_parts_edits_describe(const struct kl_parts_edits *edits, char *text, size_t size)
{
    enum { NAMED = 3 };
    static const char *const kinds[KL_PART_KINDS] = {"object", "light", "environment", ""};
    size_t used = 0;

    text[0] = '\0';
    for (uint32_t i = 0; i < edits->count && i <= NAMED && used < size; ++i) {
        const struct kl_part_edit *edit = &edits->items[i];
        const kl_part *part = edit->old != NULL ? edit->old : edit->fresh;
        const bool last = i + 1 == edits->count;
        int n = 0;
        if (i == NAMED) {
            n = snprintf(text + used, size - used, " and %u more", edits->count - NAMED);
        } else {
            const char *before = i == 0 ? "" : last ? " and " : ", ";
            n = part->kind == KL_PART_ENVIRONMENT
                    ? snprintf(text + used, size - used, "%s%s (%s)", before, kinds[part->kind],
                               word_for(edit))
                    : snprintf(text + used, size - used, "%s%s '%s' (%s)", before,
                               kinds[part->kind], part->label, word_for(edit));
        }
        used += n > 0 ? (size_t)n : 0;
    }
}
