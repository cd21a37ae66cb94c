/* Rays of many records that are due, shot in one go: on a device they are one batch. */
#include "src/base/memory.h"
#include "src/render/ledger_impl.h"

#include <omp.h>
#include <stdlib.h>

const struct kl_gather_tables *kl_ledger_tables(const struct kl_fill_job *job, uint32_t side)
{
    const struct kl_gather_tables *found = job->ladder[0].steps[0];
    for (uint32_t l = 0; l < KL_CACHE_LEVELS; ++l) {
        for (uint32_t i = 0; i < job->ladder[l].count; ++i) {
            if (job->ladder[l].steps[i]->side == side) found = job->ladder[l].steps[i];
        }
    }
    return found;
}

/* Records with as many rays each. */
struct volley {
    const struct kl_gather_tables *tables;
    size_t records, rays;
    struct kl_ledger_entry **entries;
    size_t *first; /* per record: its first ray */
    kl_gather_point *points;
    kl_gather_pick *picks;
    kl_gather_cell *cells;
};

static void volley_fini(struct volley *v)
{
    free(v->entries);
    free(v->first);
    free(v->points);
    free(v->picks);
    free(v->cells);
}

static void add_entry(struct volley *v, struct kl_ledger_entry *e)
{
    const uint32_t rays = e->side * e->side;
    const uint32_t set = (e->point.seed & (v->tables->sets - 1)) * rays;

    v->entries[v->records] = e;
    v->first[v->records] = v->rays;
    v->points[v->records] = e->point;
    for (uint32_t i = 0; i < rays; ++i) {
        if ((e->kinds[i] & KL_RAY_DUE) == 0) continue;
        v->picks[v->rays++] = (kl_gather_pick){(kl_u32)v->records, set + i};
    }
    ++v->records;
}

static kl_status volley_init(const struct kl_fill_job *job, struct kl_ledger_entry *entries,
                             size_t count, uint32_t side, struct volley *v, struct kl_err *err)
{
    size_t records = 0;
    size_t rays = 0;

    *v = (struct volley){.tables = kl_ledger_tables(job, side)};
    for (size_t i = 0; i < count; ++i) {
        if (entries[i].due == 0 || entries[i].side != side) continue;
        ++records;
        rays += entries[i].due;
    }
    kl_status st = kl_alloc_array(&v->entries, records, sizeof(struct kl_ledger_entry *), err);
    if (st == KL_OK) st = kl_alloc_array(&v->first, records, sizeof *v->first, err);
    if (st == KL_OK) st = kl_alloc_array(&v->points, records, sizeof *v->points, err);
    if (st == KL_OK) st = kl_alloc_array(&v->picks, rays, sizeof *v->picks, err);
    if (st == KL_OK) st = kl_alloc_array(&v->cells, rays, sizeof *v->cells, err);
    for (size_t i = 0; st == KL_OK && i < count; ++i) {
        if (entries[i].due > 0 && entries[i].side == side) add_entry(v, &entries[i]);
    }
    return st;
}

static kl_status shoot_side(const struct kl_ledger_refresh *r, struct kl_ledger_entry *entries,
                            size_t count, uint32_t side, struct kl_ledger_scratch *scratch,
                            struct kl_err *err)
{
    struct volley v;
    kl_status st = volley_init(r->job, entries, count, side, &v, err);
    const struct kl_gather_picks picks = {.scene = r->job->motion,
                                          .level1 = &r->level1,
                                          .tables = v.tables,
                                          .settings = r->job->gather,
                                          .points = v.points,
                                          .point_count = v.records,
                                          .picks = v.picks,
                                          .count = v.rays,
                                          .cells = v.cells};
    if (st == KL_OK) st = kl_gatherer_run_picks(r->gatherer, &picks, err);
#pragma omp parallel for schedule(dynamic, 4)
    for (size_t i = 0; i < (st == KL_OK ? v.records : 0); ++i) {
        kl_ledger_refresh_entry(r, v.entries[i], v.tables, v.cells + v.first[i],
                                &scratch[omp_get_thread_num()]);
    }
    volley_fini(&v);
    return st;
}

kl_status kl_ledger_shoot(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entries,
                          size_t count, struct kl_ledger_scratch *scratch, struct kl_err *err)
{
    kl_status st = KL_OK;

    for (size_t i = 0; st == KL_OK && i < count; ++i) { /* each side once: then none of it is due */
        if (entries[i].due == 0) continue;
        st = shoot_side(refresh, entries + i, count - i, entries[i].side, scratch, err);
    }
    return st;
}
