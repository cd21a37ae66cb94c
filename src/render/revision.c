#include "src/render/revision.h"

#include "src/base/memory.h"
#include "src/render/revision_impl.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_BOXES = 64 };

/* ---- what the edits mean ---- */

static void add_bit(struct kl_revision *r, kl_u32 bit)
{
    r->mask[bit >> 5] |= 1u << (bit & 31u);
}

static kl_status add_box(struct kl_revision *r, const kl_part *part, size_t *capacity,
                         struct kl_err *err)
{
    if (part == NULL) return KL_OK;
    kl_status st = kl_grow_array(&r->boxes, capacity, r->box_count + 1, sizeof *r->boxes, err);
    if (st != KL_OK) return st;
    struct kl_revision_box *box = &r->boxes[r->box_count++];
    memcpy(box->min, part->box_min, sizeof box->min);
    memcpy(box->max, part->box_max, sizeof box->max);
    return KL_OK;
}

static bool glows(const kl_part *part)
{
    return part != NULL && (part->glow[0] != 0 || part->glow[1] != 0);
}

/* May light come from where none came, or far more of it? The bits of records only tell of light
 * that was there: they say enough where a known light gets at most twice as strong. */
static bool brings_new_light(const struct kl_part_edit *edit)
{
    const uint32_t appears = KL_PART_ADDED | KL_PART_SHAPE | KL_PART_PLACE;
    if (!glows(edit->fresh)) return false;
    if (edit->fresh->kind == KL_PART_ENVIRONMENT) return true;
    if (edit->what & appears) return true;
    if (!(edit->what & KL_PART_GLOW)) return false;
    if (!glows(edit->old) || edit->fresh->power == edit->old->power) return true;
    return edit->fresh->power > 2.0f * edit->old->power;
}

static kl_status add_edit(struct kl_revision *r, const struct kl_part_edit *edit, size_t *capacity,
                          struct kl_err *err)
{
    const uint32_t geometry = KL_PART_ADDED | KL_PART_REMOVED | KL_PART_SHAPE | KL_PART_PLACE;
    const kl_part *part = edit->old != NULL ? edit->old : edit->fresh;
    kl_status st = KL_OK;

    if (brings_new_light(edit)) r->all = true;
    if (part != NULL && glows(edit->old) && edit->what != KL_PART_SURFACE)
        add_bit(r, kl_part_light_bit(part));
    if (part == NULL || part->kind != KL_PART_OBJECT) return KL_OK;
    if (edit->what != KL_PART_GLOW) {
        add_bit(r, kl_part_hit_bit(part));
        r->in_place = false;
    }
    if (!(edit->what & geometry)) return KL_OK;
    st = add_box(r, edit->old, capacity, err);
    return st == KL_OK ? add_box(r, edit->fresh, capacity, err) : st;
}

static kl_status read_edits(struct kl_revision *r, struct kl_err *err)
{
    size_t capacity = 0;
    kl_status st = KL_OK;

    r->in_place = true;
    for (uint32_t i = 0; st == KL_OK && i < r->edits.count; ++i) {
        st = add_edit(r, &r->edits.items[i], &capacity, err);
    }
    if (r->box_count > MOST_BOXES) { /* a scene that has moved as a whole */
        r->all = true;
        r->in_place = false;
    }
    return st;
}

/* ---- records ---- */

static bool is_near_box(const struct kl_revision *r, const kl_record_hot *hot)
{
    for (uint32_t b = 0; b < r->box_count; ++b) {
        bool inside = true;
        for (int k = 0; k < 3; ++k) {
            inside = inside && hot->pos[k] >= r->boxes[b].min[k] - hot->radius2 &&
                     hot->pos[k] <= r->boxes[b].max[k] + hot->radius2;
        }
        if (inside) return true;
    }
    return false;
}

static enum kl_fate judge(const struct kl_revision *r, uint32_t level, const kl_record_hot *hot,
                          const kl_record_cold *cold)
{
    const bool touched =
        (cold->touched[0] & r->mask[0]) != 0 || (cold->touched[1] & r->mask[1]) != 0;

    if (is_near_box(r, hot)) return KL_FATE_DROP; /* its surface may be gone */
    if (!r->all && !touched && !kl_revision_sees_boxes(r, hot, cold)) return KL_FATE_KEEP;
    return level == 1 || r->in_place ? KL_FATE_AGAIN : KL_FATE_DROP;
}

static kl_status take_level(struct kl_revision *r, uint32_t number, struct kl_err *err)
{
    struct kl_revision_level *l = &r->levels[number];
    const struct kl_level_arrays from = kl_cache_get_arrays(r->before, number);
    const uint32_t n = from.record_count;
    kl_status st = kl_alloc_array(&l->hot, n, sizeof *l->hot, err);

    if (st == KL_OK) st = kl_alloc_array(&l->cold, n, sizeof *l->cold, err);
    if (st == KL_OK) st = kl_alloc_array(&l->fate, n, 1, err);
    if (st != KL_OK || n == 0) return st;
    memcpy(l->hot, from.hot, n * sizeof *l->hot);
    memcpy(l->cold, from.cold, n * sizeof *l->cold);
    l->count = n;
#pragma omp parallel for schedule(dynamic, 64)
    for (uint32_t i = 0; i < n; ++i) {
        l->fate[i] = (uint8_t)judge(r, number, &l->hot[i], &l->cold[i]);
    }
    return KL_OK;
}

static kl_status load_before(struct kl_revision *r, struct kl_err *err)
{
    kl_status st = kl_cache_create(&r->settings, &r->before, err);

    for (size_t i = 0; st == KL_OK && i < kl_store_segment_count(r->old); ++i) {
        struct kl_level_arrays levels[KL_CACHE_LEVELS];
        kl_store_segment_get(r->old, i, NULL, levels);
        for (uint32_t l = 0; st == KL_OK && l < KL_CACHE_LEVELS; ++l) {
            if (levels[l].record_count == 0) continue;
            st = kl_cache_insert(r->before, l, levels[l].hot, levels[l].cold,
                                 levels[l].record_count, err);
        }
    }
    return st == KL_OK ? kl_cache_finish(r->before, err) : st;
}

/* ---- life ---- */

kl_status kl_revision_open(const struct kl_revision_query *query, struct kl_revision **out,
                           struct kl_err *err)
{
    struct kl_revision *r = NULL;
    kl_status st = kl_alloc_array(&r, 1, sizeof *r, err);

    if (st != KL_OK) return st;
    r->scene = query->scene;
    r->settings = *query->settings;
    r->touch = query->touch;
    r->query = query->query;
    st = kl_stale_open(&query->stale, &r->old, &r->edits, err);
    if (st == KL_OK) st = read_edits(r, err);
    if (st == KL_OK) st = load_before(r, err);
    for (uint32_t l = 0; st == KL_OK && l < KL_CACHE_LEVELS; ++l) {
        st = take_level(r, l, err);
    }
    if (st != KL_OK) {
        kl_revision_close(r);
        return st;
    }
    *out = r;
    return KL_OK;
}

void kl_revision_close(struct kl_revision *revision)
{
    struct kl_revision *r = revision;

    if (r == NULL) return;
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        free(r->levels[l].hot);
        free(r->levels[l].cold);
        free(r->levels[l].fate);
    }
    free(r->boxes);
    kl_parts_edits_fini(&r->edits);
    kl_cache_destroy(r->before);
    kl_store_close(r->old);
    free(r);
}

void kl_revision_get_summary(const struct kl_revision *revision,
                             struct kl_revision_summary *summary)
{
    *summary = (struct kl_revision_summary){.had = 0};
    kl_parts_edits_describe(&revision->edits, summary->text, sizeof summary->text);
    for (int l = 0; l < KL_CACHE_LEVELS; ++l) {
        const struct kl_revision_level *level = &revision->levels[l];
        summary->had += level->count;
        for (uint32_t i = 0; i < level->count; ++i) {
            summary->kept += level->fate[i] == KL_FATE_KEEP;
            summary->again += level->fate[i] == KL_FATE_AGAIN;
        }
    }
}

kl_status kl_revision_build(const struct kl_revision *revision, enum kl_fate worst,
                            struct kl_cache **out, struct kl_err *err)
{
    struct kl_cache *cache = NULL;
    kl_status st = kl_cache_create(&revision->settings, &cache, err);

    for (uint32_t l = 0; st == KL_OK && l < KL_CACHE_LEVELS; ++l) {
        const struct kl_revision_level *level = &revision->levels[l];
        kl_record_hot *hot = NULL;
        kl_record_cold *cold = NULL;
        uint32_t n = 0;
        st = kl_alloc_array(&hot, level->count, sizeof *hot, err);
        if (st == KL_OK) st = kl_alloc_array(&cold, level->count, sizeof *cold, err);
        for (uint32_t i = 0; st == KL_OK && i < level->count; ++i) {
            if (level->fate[i] > worst) continue;
            hot[n] = level->hot[i];
            cold[n++] = level->cold[i];
        }
        if (st == KL_OK && n > 0) st = kl_cache_insert(cache, l, hot, cold, n, err);
        free(hot);
        free(cold);
    }
    if (st == KL_OK) st = kl_cache_finish(cache, err);
    if (st != KL_OK) {
        kl_cache_destroy(cache);
        return st;
    }
    *out = cache;
    return KL_OK;
}

kl_status kl_revision_serve(const struct kl_revision *revision, struct kl_cache **out,
                            struct kl_err *err)
{
    return kl_revision_build(revision, KL_FATE_KEEP, out, err);
}
