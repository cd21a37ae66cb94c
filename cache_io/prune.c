#include "cache_io/store_impl.h"
#include "cache_io/upkeep.h"
#include "cache_io/use.h"
#include "src/base/hash.h"
#include "src/base/memory.h"

#include <stdlib.h>
#include <string.h>

/* What decides who goes first: least goes last. */
struct rank {
    uint32_t age, error; /* generations; bits of a half */
    uint64_t place;      /* a hash: so that the cut falls between two records */
};

struct judge {
    const struct kl_store_prune *what;
    double origin[3];
    uint32_t generation;
    const struct kl_use *use; /* NULL: not asked for */
    uint64_t judged;          /* records born later have had no chance to be used */
    struct rank *ranks;       /* of all records; NULL: not asked for */
    size_t rank_count;
    struct rank last; /* that stays */
};

static struct rank rank_of(const struct judge *j, const kl_record_hot *hot,
                           const kl_record_cold *cold, uint32_t birth)
{
    const struct rank rank = {.age = j->generation > birth ? j->generation - birth : 0,
                              .error = cold->error_spacing & 0xffffu,
                              .place = kl_hash_block(hot, sizeof *hot)};

    return rank;
}

static int compare_ranks(const void *a, const void *b)
{
    const struct rank *x = a;
    const struct rank *y = b;

    if (x->age != y->age) return x->age < y->age ? -1 : 1;
    if (x->error != y->error) return x->error < y->error ? -1 : 1;
    return (x->place > y->place) - (x->place < y->place);
}

static bool is_in_box(const struct judge *j, const double box[2][3], const kl_record_hot *hot)
{
    bool in = true;

    for (int k = 0; k < 3; ++k) {
        const double x = j->origin[k] + (double)hot->pos[k];
        in = in && x >= box[0][k] && x <= box[1][k];
    }
    return in;
}

static bool stays(void *context, uint32_t level, const kl_record_hot *hot,
                  const kl_record_cold *cold, uint32_t birth)
{
    const struct judge *j = context;
    const struct kl_store_prune *what = j->what;

    if (what->older_than > 0 && rank_of(j, hot, cold, birth).age > what->older_than) return false;
    if (j->use != NULL && level == 0 && birth <= j->judged && !kl_use_has(j->use, hot)) {
        return false;
    }
    if (what->has_inside && is_in_box(j, what->inside, hot)) return false;
    if (what->has_outside && !is_in_box(j, what->outside, hot)) return false;
    return what->keep == NULL || what->keep(what->keep_context, level, hot, cold, birth);
}

static bool note_rank(void *context, uint32_t level, const kl_record_hot *hot,
                      const kl_record_cold *cold, uint32_t birth)
{
    struct judge *j = context;

    (void)level;
    j->ranks[j->rank_count++] = rank_of(j, hot, cold, birth);
    return true;
}

static bool fits(void *context, uint32_t level, const kl_record_hot *hot,
                 const kl_record_cold *cold, uint32_t birth)
{
    const struct judge *j = context;
    const struct rank rank = rank_of(j, hot, cold, birth);

    (void)level;
    return compare_ranks(&rank, &j->last) <= 0;
}

static bool none_stays(void *context, uint32_t level, const kl_record_hot *hot,
                       const kl_record_cold *cold, uint32_t birth)
{
    (void)context;
    (void)level;
    (void)hot;
    (void)cold;
    (void)birth;
    return false;
}

static uint64_t count_records(const struct kl_records *records)
{
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    uint64_t sum = 0;

    kl_records_get(records, levels);
    for (int l = 0; l < KL_CACHE_LEVELS; ++l)
        sum += levels[l].record_count;
    return sum;
}

/* Drop the oldest, of these the worst, until `room` records are left. */
static kl_status shrink(struct kl_records *records, struct judge *j, uint64_t room,
                        struct kl_err *err)
{
    const uint64_t count = count_records(records);

    if (count <= room) return KL_OK;
    if (room == 0) {
        kl_records_select(records, none_stays, NULL);
        return KL_OK;
    }
    kl_status st = kl_alloc_array(&j->ranks, (size_t)count, sizeof *j->ranks, err);
    if (st != KL_OK) return st;
    kl_records_select(records, note_rank, j);
    qsort(j->ranks, j->rank_count, sizeof *j->ranks, compare_ranks);
    j->last = j->ranks[room - 1];
    free(j->ranks);
    kl_records_select(records, fits, j);
    return KL_OK;
}

/* What is known of use, and of whom it says anything. */
static kl_status load_use(const struct kl_store *store, const struct kl_store_prune *what,
                          struct kl_use **out, uint64_t *judged, struct kl_store_pruned *pruned,
                          struct kl_err *err)
{
    struct kl_use_summary sum;
    kl_status st = kl_use_load(store, what->unused_for, out, err);

    if (st != KL_OK) return st;
    kl_use_get_summary(*out, &sum);
    pruned->damaged_uses = sum.damaged;
    memcpy(pruned->complaint, sum.complaint, sizeof pruned->complaint);
    pruned->untold = sum.files == 0;
    *judged = sum.generation;
    if (what->unused_for > 0 && sum.earlier < *judged) *judged = sum.earlier;
    return KL_OK;
}

static kl_status prune(struct kl_store *store, struct kl_records *records,
                       const struct kl_store_prune *what, struct kl_store_pruned *out,
                       struct kl_err *err)
{
    const uint64_t generation = kl_store_generation(store);
    struct judge j = {.what = what,
                      .generation = generation < UINT32_MAX ? (uint32_t)generation : UINT32_MAX};
    struct kl_store_key key;
    kl_status st = kl_records_add_store(records, store, err);

    if (st != KL_OK) return st;
    kl_store_key_get(store, &key);
    for (int k = 0; k < 3; ++k)
        j.origin[k] = key.origin[k];
    struct kl_use *use = NULL;
    if (what->unused) st = load_use(store, what, &use, &j.judged, out, err);
    const uint64_t before = count_records(records);
    if (st != KL_OK || out->untold) {
        out->kept = before;
        kl_use_destroy(use);
        return st;
    }
    j.use = use;
    kl_records_select(records, stays, &j);
    kl_use_destroy(use);
    j.use = NULL;
    if (what->max_bytes > 0 && before > 0) {
        /* As large as they are now, index included: a base that is not indexed yet is smaller. */
        const double each = (double)kl_store_bytes(store) / (double)before;
        st = shrink(records, &j, (uint64_t)((double)what->max_bytes / each), err);
    }
    out->kept = count_records(records);
    out->dropped = before - out->kept;
    if (st == KL_OK && out->dropped > 0) st = kl_store_publish_records(store, records, err);
    return st;
}

kl_status kl_store_prune(const char *dir, const struct kl_store_prune *what,
                         struct kl_store_pruned *out, struct kl_err *err)
{
    struct kl_store *store = NULL;
    struct kl_records *records = NULL;
    kl_status st = store_open_found(dir, &store, err);

    *out = (struct kl_store_pruned){0};
    if (st != KL_OK) return st;
    st = kl_records_create(&records, err);
    if (st == KL_OK) st = prune(store, records, what, out, err);
    kl_records_destroy(records);
    kl_store_close(store);
    return st == KL_OK ? KL_OK : kl_wrap(err, "%s", dir);
}
