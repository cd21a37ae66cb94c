#include "cache_io/records.h"
#include "cache_io/use.h"
#include "src/render/renderer_impl.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Radius over raw radius for an error to aim at. */
static float accuracy_for(enum kl_radius_rule rule, double error)
{
    return (float)sqrt((rule == KL_RADIUS_HESSIAN ? 1.0 : 4.0) * error);
}

void kl_renderer_tell_use(struct kl_renderer *r)
{
    struct kl_err ignored;

    if (r->used != NULL) {
        const struct kl_level_arrays level = kl_cache_get_arrays(r->cache, 0);
        (void)!kl_use_publish(r->store, level.hot, level.record_count, r->used, &ignored);
    }
    free(r->used);
    r->used = NULL;
}

void kl_renderer_close_cache(struct kl_renderer *r)
{
    kl_renderer_tell_use(r);
    kl_cache_destroy(r->cache);
    kl_store_close(r->store);
    kl_revision_close(r->revision);
    r->revision = NULL;
    r->revised = false;
    r->cache = NULL;
    r->store = NULL;
}

bool kl_renderer_is_compact(const struct kl_store *store)
{
    struct kl_store_segment_info info;

    if (kl_store_segment_count(store) != 1 || kl_store_damaged(store, NULL) > 0) return false;
    kl_store_segment_get(store, 0, &info, NULL);
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        if (info.records[l] > 0 && !info.has_octree[l]) return false;
    }
    return info.is_base;
}

/* Take over what a store of several segments holds: each place once, copied and indexed. */
static kl_status adopt_merged(struct kl_renderer *r, struct kl_err *err)
{
    struct kl_records *records = NULL;
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    uint64_t merged = 0;
    kl_status st = kl_records_create(&records, err);

    if (st == KL_OK) st = kl_records_add_store(records, r->store, err);
    if (st == KL_OK) st = kl_records_merge(records, &merged, err);
    if (st == KL_OK) kl_records_get(records, levels);
    for (uint32_t l = 0; st == KL_OK && l < KL_CACHE_LEVELS; ++l) {
        if (levels[l].record_count == 0) continue;
        st = kl_cache_insert(r->cache, l, levels[l].hot, levels[l].cold, levels[l].record_count,
                             err);
    }
    kl_records_destroy(records);
    return st == KL_OK ? kl_cache_finish(r->cache, err) : st;
}

/* Radii for the error that is asked for, or finer ones that the store was made with: what a
 * measurement once found necessary stays. */
static void choose_accuracy(struct kl_renderer *r)
{
    const size_t n = r->store != NULL ? kl_store_segment_count(r->store) : 0;
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        r->accuracy[l] = accuracy_for(r->settings.radius, r->settings.error);
    }
    for (size_t i = 0; i < n; ++i) {
        struct kl_store_segment_info info;
        struct kl_level_arrays levels[KL_CACHE_LEVELS];
        kl_store_segment_get(r->store, i, &info, levels);
        for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
            const float made_with = levels[l].octree.accuracy;
            if (levels[l].octree.record_count > 0 && made_with > 0.0f) {
                r->accuracy[l] = fminf(r->accuracy[l], made_with);
            }
        }
    }
}

/* Take over what a store holds: a lone base in place. */
static kl_status adopt_store(struct kl_renderer *r, struct kl_err *err)
{
    struct kl_store_segment_info info;
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    kl_status st = KL_OK;

    if (kl_store_segment_count(r->store) == 0) return KL_OK;
    if (kl_store_segment_count(r->store) > 1) return adopt_merged(r, err);
    kl_store_segment_get(r->store, 0, &info, levels);
    for (uint32_t l = 0; st == KL_OK && l < KL_CACHE_LEVELS; ++l) {
        if (levels[l].record_count == 0) continue;
        st = info.is_base ? kl_cache_adopt(r->cache, l, &levels[l], err)
                          : kl_cache_insert(r->cache, l, levels[l].hot, levels[l].cold,
                                            levels[l].record_count, err);
    }
    return st == KL_OK ? kl_cache_finish(r->cache, err) : st;
}

/* Directory of the present instant's store. */
static void store_path(const struct kl_renderer *r, const char *dir, char *out, size_t size)
{
    char hex[2 * KL_HASH_SIZE + 1];
    kl_hash_to_hex(r->scene_digest, KL_HASH_SIZE, hex);
    if (r->moving) {
        (void)snprintf(out, size, "%s/t-%.16s", dir, hex);
    } else {
        (void)snprintf(out, size, "%s", dir);
    }
}

/* A disk that does not take what is kept costs the keeping, not the frames. */
static kl_status may_go_on(struct kl_renderer *r, kl_status st, const struct kl_err *err)
{
    if (st != KL_ERR_IO || r->must_keep) return st;
    (void)snprintf(r->lost, sizeof r->lost, "%s", err->msg);
    return KL_OK;
}

static struct kl_cache_settings cache_settings(const struct kl_renderer *r)
{
    struct kl_cache_settings s = {.scene_radius = r->flat->radius,
                                  .rule = r->settings.radius,
                                  .reach = {KL_EYE_REACH, 1.0f},
                                  .cos_max = KL_COS_MAX};
    memcpy(s.center, r->flat->center, sizeof s.center);
    memcpy(s.accuracy, r->accuracy, sizeof s.accuracy);
    return s;
}

/* A cache that is not of this scene as it stands: use what holds of it, if it is of an earlier
 * edition. */
static kl_status open_revision(struct kl_renderer *r, const char *path, enum kl_store_mode mode,
                               const struct kl_store_key *key, struct kl_err *err)
{
    const struct kl_cache_settings settings = cache_settings(r);
    const struct kl_revision_query query = {.stale = {path, key, &r->parts},
                                            .scene = kl_renderer_reference(r),
                                            .settings = &settings,
                                            .query = kl_renderer_gather_query(),
                                            .touch = kl_renderer_touch_share(r)};
    kl_status st = kl_revision_open(&query, &r->revision, err);

    if (st != KL_OK) return st;
    r->revised = true;
    kl_revision_get_summary(r->revision, &r->summary);
    kl_cache_destroy(r->cache);
    r->cache = NULL;
    st = kl_revision_serve(r->revision, &r->cache, err);
    if (st != KL_OK || mode == KL_STORE_READ) return st;
    st = kl_store_open(path, KL_STORE_REVISE, key, &r->store, err);
    if (st == KL_ERR_IO) return may_go_on(r, st, err);
    return st == KL_OK ? kl_store_parts_set(r->store, r->parts.items, r->parts.count, err) : st;
}

kl_status kl_renderer_open_cache(struct kl_renderer *renderer, const char *dir,
                                 enum kl_store_mode mode, struct kl_err *err)
{
    struct kl_renderer *r = renderer;
    kl_renderer_close_cache(r);
    choose_accuracy(r);
    const struct kl_cache_settings settings = cache_settings(r);
    kl_status st = kl_cache_create(&settings, &r->cache, err);
    if (st != KL_OK || dir == NULL) return st;
    struct kl_store_key key;
    char path[4096];
    memcpy(key.scene, r->scene_digest, KL_DIGEST_SIZE);
    memcpy(key.settings, r->settings_digest, KL_DIGEST_SIZE);
    memcpy(key.origin, r->origin, sizeof key.origin);
    store_path(r, dir, path, sizeof path);
    st = kl_store_open(path, mode, &key, &r->store, err);
    if (r->moving && mode == KL_STORE_READ && st == KL_ERR_IO && err->os_error == ENOENT) {
        return kl_fail(err, KL_ERR_STALE,
                       "%s: has no records of this instant: the scene was edited since, or this "
                       "frame was never baked",
                       dir);
    }
    if (st == KL_ERR_IO && mode != KL_STORE_READ) return may_go_on(r, st, err);
    if (st == KL_ERR_STALE) return open_revision(r, path, mode, &key, err);
    if (st == KL_OK) st = kl_store_parts_set(r->store, r->parts.items, r->parts.count, err);
    choose_accuracy(r);
    for (uint32_t l = 0; st == KL_OK && l < KL_CACHE_LEVELS; ++l) {
        st = kl_cache_set_accuracy(r->cache, l, r->accuracy[l], err);
    }
    return st == KL_OK ? adopt_store(r, err) : st;
}

void kl_renderer_get_cache(const struct kl_renderer *renderer, struct kl_cache_state *state)
{
    *state = (struct kl_cache_state){0};
    for (uint32_t l = 0; renderer->cache != NULL && l < KL_CACHE_LEVELS; ++l) {
        state->records[l] = kl_cache_count(renderer->cache, l);
    }
    state->lost = renderer->lost[0] != '\0' ? renderer->lost : NULL;
    if (renderer->store == NULL) return;
    state->generation = kl_store_generation(renderer->store);
    state->bytes = kl_store_bytes(renderer->store);
    state->damaged = kl_store_damaged(renderer->store, NULL);
}

bool kl_renderer_get_revision(const struct kl_renderer *renderer,
                              struct kl_renderer_revision *revision)
{
    const struct kl_revision_summary *s = &renderer->summary;
    if (!renderer->revised) return false;
    *revision =
        (struct kl_renderer_revision){.had = s->had, .kept = s->kept, .refreshed = s->again};
    memcpy(revision->text, s->text, sizeof revision->text);
    return true;
}

kl_status kl_renderer_keep_batch(void *context, uint32_t level, const kl_record_hot *hot,
                                 const kl_record_cold *cold, uint32_t count, struct kl_err *err)
{
    struct kl_renderer *r = context;
    struct kl_level_arrays levels[KL_CACHE_LEVELS] = {0};
    levels[level].record_count = count;
    levels[level].hot = hot;
    levels[level].cold = cold;
    return may_go_on(r, r->lost[0] == '\0' ? kl_store_append(r->store, levels, err) : KL_OK, err);
}

/* A new cache from what the store holds now. */
static kl_status serve_store(struct kl_renderer *r, struct kl_err *err)
{
    const struct kl_cache_settings settings = cache_settings(r);

    kl_renderer_tell_use(r);
    kl_cache_destroy(r->cache);
    r->cache = NULL;
    kl_status st = kl_cache_create(&settings, &r->cache, err);
    return st == KL_OK ? adopt_store(r, err) : st;
}

kl_status kl_renderer_refresh(struct kl_renderer *r, struct kl_err *err)
{
    struct kl_err ignored;
    bool changed = false;

    if (kl_store_refresh(r->store, &changed, &ignored) != KL_OK || !changed) return KL_OK;
    return serve_store(r, err);
}

kl_status kl_renderer_publish(struct kl_renderer *r, struct kl_err *err)
{
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    kl_status st = KL_OK;

    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        levels[l] = kl_cache_get_arrays(r->cache, l);
    }
    st = kl_store_publish_base(r->store, levels, err);
    if (st != KL_OK) return may_go_on(r, st, err);
    return serve_store(r, err);
}
