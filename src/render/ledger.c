#include "src/render/ledger.h"

#include "src/base/clock.h"
#include "src/base/memory.h"
#include "src/render/fill_points.h"
#include "src/render/ledger_impl.h"

#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

enum { FIRST_SLOTS = 4096, BATCH = 256 };
static const size_t most_rays = (size_t)1 << 25; /* 1 GiB; records beyond are placed anew */
static const float beside = 0.1f; /* of the image: records so far outside may still serve */

struct kl_ledger {
    struct kl_gatherer *gatherer; /* of this instant; borrowed */
    struct kl_ledger_entry *entries;
    size_t count, capacity;
    size_t rays;
    struct kl_stand *stand; /* of the instant that the entries are of; NULL: there are none yet */
    double time;            /* of it [s] */
    uint32_t turn;
};

kl_status kl_ledger_create(struct kl_ledger **out, struct kl_err *err)
{
    return kl_alloc_array(out, 1, sizeof **out, err);
}

static void entry_fini(struct kl_ledger_entry *e)
{
    free(e->cells);
    free(e->waits);
    free(e->kinds);
}

/* Forget all entries but those for which `stays`. */
static void sift(struct kl_ledger *l, bool (*stays)(const struct kl_ledger_entry *e))
{
    size_t left = 0;

    l->rays = 0;
    for (size_t i = 0; i < l->count; ++i) {
        struct kl_ledger_entry *e = &l->entries[i];
        if (stays(e)) {
            l->rays += (size_t)e->side * e->side;
            l->entries[left++] = *e;
        } else {
            entry_fini(e);
        }
    }
    l->count = left;
}

static bool stays_never(const struct kl_ledger_entry *e)
{
    (void)e;
    return false;
}
static bool stays_if_kept(const struct kl_ledger_entry *e)
{
    return e->kept;
}
static bool stays_if_there(const struct kl_ledger_entry *e)
{
    return !e->dropped;
}

void kl_ledger_use(struct kl_ledger *ledger, struct kl_gatherer *gatherer)
{
    ledger->gatherer = gatherer;
}

void kl_ledger_clear(struct kl_ledger *ledger)
{
    sift(ledger, stays_never);
    kl_stand_destroy(ledger->stand);
    ledger->stand = NULL;
}

void kl_ledger_destroy(struct kl_ledger *ledger)
{
    if (ledger == NULL) return;
    kl_ledger_clear(ledger);
    free(ledger->entries);
    free(ledger);
}

/* ---- writing ---- */

/* Note a record that was gathered; `cells` are the ledger's from now on, also after a failure. */
static kl_status note(struct kl_ledger *l, const struct kl_gather_job *job, size_t i,
                      kl_gather_cell *cells, struct kl_err *err)
{
    struct kl_ledger_entry e = {.point = job->points[i],
                                .side = job->results[i].side,
                                .cells = cells,
                                .age_frames = 1,
                                .by_paths = job->level1->head.record_count == 0};
    const size_t rays = (size_t)e.side * e.side;
    kl_status st = kl_alloc_array(&e.waits, rays, sizeof *e.waits, err);

    if (st == KL_OK) st = kl_alloc_array(&e.kinds, rays, sizeof *e.kinds, err);
    if (st != KL_OK) {
        entry_fini(&e);
        return st;
    }
    l->rays += rays;
    l->entries[l->count++] = e;
    return KL_OK;
}

kl_status kl_ledger_gather(void *context, const struct kl_gather_job *job, struct kl_err *err)
{
    struct kl_ledger *l = context;
    struct kl_gather_job own = *job;
    kl_status st = kl_alloc_array(&own.cells, job->count, sizeof *own.cells, err);

    if (st == KL_OK) {
        st = kl_grow_array(&l->entries, &l->capacity, l->count + job->count, sizeof *l->entries,
                           err);
    }
    if (st == KL_OK) st = kl_gatherer_run(l->gatherer, &own, err);
    for (size_t i = 0; own.cells != NULL && i < job->count; ++i) {
        if (st != KL_OK || own.cells[i] == NULL || l->rays >= most_rays) {
            free(own.cells[i]);
        } else {
            st = note(l, job, i, own.cells[i], err);
        }
    }
    free(own.cells);
    return st;
}

/* ---- whose they are ---- */

static bool find_object(const kl_scene_view *scene, struct kl_ledger_entry *e)
{
    kl_hit hit;
    kl_surface s;
    if (!kl_fill_find_surface(scene, &e->hot, &hit, &s)) return false;
    e->object = s.object;
    e->lies = (kl_ride){.triangle = hit.triangle, .u = hit.u, .v = hit.v};
    e->corners = kl_corners_of(scene->positions, &scene->triangles[hit.triangle]);
    return s.object != KL_NONE;
}

static size_t slot_of(const float pos[3], kl_u32 normal, size_t slots)
{
    return kl_record_seed(pos, normal, 0) & (slots - 1);
}

/* Entries by place: open addressing, number plus one, 0: free. */
static kl_status make_index(const struct kl_ledger *l, uint32_t **out, size_t *slots,
                            struct kl_err *err)
{
    uint32_t *index = NULL;

    *slots = FIRST_SLOTS;
    while (*slots < 2 * l->count) {
        *slots *= 2;
    }
    kl_status st = kl_alloc_array(&index, *slots, sizeof *index, err);
    if (st != KL_OK) return st;
    for (size_t i = 0; i < l->count; ++i) {
        const kl_gather_point *p = &l->entries[i].point;
        size_t at = slot_of(p->pos, p->normal, *slots);
        while (index[at] != 0) {
            at = (at + 1) & (*slots - 1);
        }
        index[at] = (uint32_t)i + 1;
        l->entries[i].kept = false;
    }
    *out = index;
    return KL_OK;
}

/* Give a record of the cache to its entry, if there is one. Both levels may have a record in one
 * place: then either entry does for either. */
static void give(struct kl_ledger *l, const uint32_t *index, size_t slots, uint32_t level,
                 uint32_t record, const struct kl_level_arrays *in)
{
    const kl_record_hot *hot = &in->hot[record];
    size_t at = slot_of(hot->pos, hot->normal, slots);
    for (; index[at] != 0; at = (at + 1) & (slots - 1)) {
        struct kl_ledger_entry *e = &l->entries[index[at] - 1];
        if (e->kept || e->point.normal != hot->normal ||
            memcmp(e->point.pos, hot->pos, sizeof hot->pos) != 0) {
            continue;
        }
        e->kept = true;
        e->level = level;
        e->record = record;
        e->hot = *hot;
        if (!e->faded) e->cold = in->cold[record];
        return;
    }
}

kl_status kl_ledger_close(struct kl_ledger *ledger, struct kl_cache *cache,
                          const kl_scene_view *scene, struct kl_stand *stand, double time,
                          struct kl_err *err)
{
    struct kl_ledger *l = ledger;
    uint32_t *index = NULL;
    size_t slots = 0;

    if (stand != NULL) {
        kl_stand_destroy(l->stand);
        l->stand = stand;
    }
    l->time = time;
    kl_status st = make_index(l, &index, &slots, err);
    for (uint32_t level = 0; st == KL_OK && level < KL_CACHE_LEVELS; ++level) {
        const struct kl_level_arrays in = kl_cache_get_arrays(cache, level);
        for (uint32_t i = 0; i < in.record_count; ++i) {
            give(l, index, slots, level, i, &in);
        }
    }
    free(index);
    if (st != KL_OK) return st;
#pragma omp parallel for schedule(dynamic, 64)
    for (size_t i = 0; i < l->count; ++i) {
        struct kl_ledger_entry *e = &l->entries[i];
        e->kept = e->kept && find_object(scene, e);
    }
    st = kl_ledger_fade(l->entries, l->count, cache, err);
    if (st == KL_OK) st = kl_ledger_thin(l->entries, l->count, err);
    sift(l, stays_if_kept);
    return st;
}

/* ---- carrying ---- */

static bool is_in_frame(const struct kl_camera *c, kl_vec3 pos, float *depth)
{
    const float w = (float)c->width;
    const float h = (float)c->height;
    float x;
    float y;

    return kl_camera_project(c, pos, &x, &y, depth) && x > -beside * w && x < (1.0f + beside) * w &&
           y > -beside * h && y < (1.0f + beside) * h;
}

/* What no camera sees need not be kept up to date. What it sees in a mirror only is placed anew. */
static bool is_seen(const struct kl_fill_job *job, const kl_gather_point *p)
{
    const kl_vec3 pos = kl_v3_load(p->pos);
    const kl_vec3 geometric = kl_oct_decode(p->geometric);

    for (uint32_t i = 0; i < job->camera_count; ++i) {
        const struct kl_camera *c = &job->cameras[i];
        float depth;
        if (!is_in_frame(c, pos, &depth)) continue;
        const kl_vec3 way =
            c->orthographic ? kl_v3_scale(c->forward, -depth) : kl_v3_sub(c->eye, pos);
        const float length = kl_length(way);
        const kl_ray ray = kl_ray_make(kl_leave_surface(job->scene, pos, geometric),
                                       kl_v3_scale(way, 1.0f / length), length);
        if (kl_dot(way, geometric) > 0.0f && kl_transmittance(job->scene, &ray) > 0.0f) return true;
    }
    return false;
}

/* Records are brought up to date in the order in which light comes to them: those whose rays go on
 * as paths, those of level 1 whose rays end in these, then what the cameras see. Were level 1 to
 * end in all of itself, its errors would go round. */
enum pass { BY_PATHS, WORLD, VIEW, PASSES };

static enum pass pass_of(const struct kl_ledger_entry *e)
{
    if (e->level == 0) return VIEW;
    return e->by_paths ? BY_PATHS : WORLD;
}

/* Put the records of a pass into the cache, and on disk. */
static kl_status insert(const struct kl_ledger *l, enum pass pass, const struct kl_fill_job *job,
                        struct kl_err *err)
{
    const uint32_t level = pass == VIEW ? 0 : 1;
    kl_record_hot *hot = NULL;
    kl_record_cold *cold = NULL;
    uint32_t n = 0;
    kl_status st = kl_alloc_array(&hot, l->count, sizeof *hot, err);

    if (st == KL_OK) st = kl_alloc_array(&cold, l->count, sizeof *cold, err);
    for (size_t i = 0; st == KL_OK && i < l->count; ++i) {
        const struct kl_ledger_entry *e = &l->entries[i];
        if (pass_of(e) != pass || e->dropped) continue;
        hot[n] = e->hot;
        cold[n++] = e->cold;
    }
    if (st == KL_OK && n > 0) st = kl_cache_insert(job->cache, level, hot, cold, n, err);
    if (st == KL_OK && n > 0 && job->keep_batch != NULL) {
        st = job->keep_batch(job->keep_context, level, hot, cold, n, err);
    }
    free(hot);
    free(cold);
    return st;
}

static bool is_stopped(const struct kl_ledger *l, enum pass pass, size_t done,
                       const struct kl_fill_job *job)
{
    const double share = (double)done / (double)l->count;
    return job->progress != NULL &&
           job->progress(job->progress_context, pass == VIEW ? 1 : 0, share, (uint32_t)l->count);
}

/* Where a record is now, and which of its rays have to be shot. */
static void look_at(const struct kl_ledger_refresh *refresh, enum pass pass,
                    struct kl_ledger_entry *e)
{
    const struct kl_gather_tables *tables = kl_ledger_tables(refresh->job, e->side);

    kl_ledger_move_entry(refresh, e);
    e->dropped = e->dropped || (pass == VIEW && !is_seen(refresh->job, &e->point));
    if (e->dropped) return;
    kl_ledger_judge_entry(refresh, e, kl_gather_directions(tables, e->point.seed));
}

static kl_status refresh_some(struct kl_ledger *l, enum pass pass,
                              const struct kl_ledger_refresh *refresh, struct kl_err *err)
{
    struct kl_ledger_scratch *scratch = NULL;
    kl_status st = kl_alloc_array(&scratch, (size_t)omp_get_max_threads(), sizeof *scratch, err);

    for (size_t first = 0; st == KL_OK && first < l->count; first += BATCH) {
        const size_t end = first + BATCH < l->count ? first + BATCH : l->count;
#pragma omp parallel for schedule(dynamic, 4)
        for (size_t i = first; i < end; ++i) {
            struct kl_ledger_entry *e = &l->entries[i];
            if (pass_of(e) == pass) look_at(refresh, pass, e);
        }
        st = kl_ledger_shoot(refresh, l->entries + first, end - first, scratch, err);
        if (st == KL_OK && is_stopped(l, pass, end, refresh->job)) {
            st = kl_fail(err, KL_ERR_INTERRUPTED, "interrupted");
        }
    }
    free(scratch);
    return st;
}

static kl_status refresh_all(struct kl_ledger *l, const struct kl_fill_job *job,
                             const struct kl_moved *moved, const struct kl_stand *stand,
                             struct kl_fill_stats *stats, struct kl_err *err)
{
    struct kl_ledger_stir *stir = NULL;
    kl_status st = kl_alloc_array(&stir, 1, sizeof *stir, err);
    struct kl_ledger_refresh refresh = {
        .job = job, .gatherer = l->gatherer, .moved = moved, .stir = stir, .turn = ++l->turn};

    for (int pass = 0; st == KL_OK && pass < PASSES; ++pass) {
        refresh.level1 = kl_cache_view(job->cache, 1);
        kl_ledger_stir(l->entries, l->count, stand, job->gather.touch, job->scene->scene_radius,
                       stir);
        st = refresh_some(l, (enum pass)pass, &refresh, err);
        if (st == KL_OK) st = insert(l, (enum pass)pass, job, err);
    }
    for (size_t i = 0; st == KL_OK && i < l->count; ++i) {
        stats->gather_rays += l->entries[i].shot;
        stats->refreshed += l->entries[i].shot > 0 && !l->entries[i].dropped;
    }
    free(stir);
    return st;
}

kl_status kl_ledger_carry(struct kl_ledger *ledger, const struct kl_fill_job *job,
                          const struct kl_stand *stand, double before, struct kl_fill_stats *stats,
                          struct kl_err *err)
{
    struct kl_moved moved = {.all = true};
    const double start = kl_seconds();
    kl_status st = KL_OK;

    if (ledger->stand != NULL && ledger->time == before) {
        st = kl_moved_between(ledger->stand, stand, &moved, err);
    }
    if (st == KL_OK && moved.all) {
        kl_ledger_clear(ledger);
    } else if (st == KL_OK) {
        st = refresh_all(ledger, job, &moved, stand, stats, err);
        sift(ledger, stays_if_there);
    }
    kl_moved_fini(&moved);
    stats->gather_seconds += kl_seconds() - start;
    return st;
}
