/* cache diff: which records two caches share, and how far the values of those are apart. */
#include "src/app/commands.h"
#include "src/app/json_text.h"
#include "src/app/record_list.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct difference {
    size_t only_a, only_b, both, moved; /* moved: in both, with other values */
    double sum_squares, largest;        /* of relative differences */
};

/* Who a record is: level, position, normal. */
static int compare_places(const struct kl_record_item *x, const struct kl_record_item *y)
{
    if (x->level != y->level) return x->level < y->level ? -1 : 1;
    for (int k = 0; k < 3; ++k) {
        if (x->pos[k] != y->pos[k]) return x->pos[k] < y->pos[k] ? -1 : 1;
    }
    return (x->hot.normal > y->hot.normal) - (x->hot.normal < y->hot.normal);
}

static int order(const struct kl_record_list *a, const struct kl_record_item *x,
                 const struct kl_record_list *b, const struct kl_record_item *y)
{
    const int by_name = strcmp(a->instants[x->instant], b->instants[y->instant]);
    return by_name != 0 ? by_name : compare_places(x, y);
}

/* Within one list: its instants are numbered by name. */
static int compare_items(const void *a, const void *b)
{
    const struct kl_record_item *x = a;
    const struct kl_record_item *y = b;
    if (x->instant != y->instant) return x->instant < y->instant ? -1 : 1;
    return compare_places(x, y);
}

static void sort_items(struct kl_record_list *list)
{
    if (list->count > 1) qsort(list->items, list->count, sizeof *list->items, compare_items);
}

/* |a - b| over their mean, of luminance. */
static double relative_difference(const kl_record_cold *a, const kl_record_cold *b)
{
    const double x = (double)kl_luminance(kl_v3_load(a->irr));
    const double y = (double)kl_luminance(kl_v3_load(b->irr));
    const double mean = 0.5 * (x + y);
    return mean > 0.0 ? fabs(x - y) / mean : 0.0;
}

static struct difference compare_lists(const struct kl_record_list *a,
                                       const struct kl_record_list *b)
{
    struct difference d = {0};
    size_t i = 0;
    size_t k = 0;

    while (i < a->count || k < b->count) {
        const int which = i == a->count   ? 1
                          : k == b->count ? -1
                                          : order(a, &a->items[i], b, &b->items[k]);
        if (which != 0) {
            d.only_a += which < 0;
            d.only_b += which > 0;
            i += which < 0;
            k += which > 0;
            continue;
        }
        const kl_record_cold *x = &a->items[i++].cold;
        const kl_record_cold *y = &b->items[k++].cold;
        const double relative = relative_difference(x, y);
        ++d.both;
        d.moved += memcmp(x->irr, y->irr, sizeof x->irr) != 0;
        d.sum_squares += relative * relative;
        d.largest = fmax(d.largest, relative);
    }
    return d;
}

static kl_status report(const struct kl_options *o, const struct difference *d, struct kl_err *err)
{
    const double rms = d->both > 0 ? sqrt(d->sum_squares / (double)d->both) : 0.0;
    const bool same = d->only_a + d->only_b + d->moved == 0;
    kl_status st = KL_OK;

    if (!o->json || o->json_file != NULL) {
        (void)printf("only in %s: %zu\nonly in %s: %zu\nin both: %zu, %zu with other values\n"
                     "relative difference: RMS %.4g, largest %.4g\n",
                     o->arguments[0], d->only_a, o->arguments[1], d->only_b, d->both, d->moved, rms,
                     d->largest);
    }
    if (o->json) {
        json_t *root = json_pack("{s:b,s:I,s:I,s:I,s:I,s:f,s:f}", "same", (int)same, "only_a",
                                 (json_int_t)d->only_a, "only_b", (json_int_t)d->only_b, "both",
                                 (json_int_t)d->both, "moved", (json_int_t)d->moved, "rms_relative",
                                 rms, "max_relative", d->largest);
        st = kl_json_write(root, o->json_file, err);
        json_decref(root);
    }
    if (st != KL_OK || o->max_difference < 0.0) return st;
    if (d->only_a + d->only_b > 0) {
        return kl_fail(err, KL_ERR_LIMIT, "%zu records are in one of the caches only",
                       d->only_a + d->only_b);
    }
    if (d->largest > o->max_difference) {
        return kl_fail(err, KL_ERR_LIMIT, "largest relative difference %.4g, at most %.4g allowed",
                       d->largest, o->max_difference);
    }
    return KL_OK;
}

kl_status kl_command_cache_diff(const struct kl_options *options, struct kl_err *err)
{
    struct kl_record_list a = {0};
    struct kl_record_list b = {0};
    kl_status st = kl_record_list_load(options->arguments[0], &a, err);

    if (st == KL_OK) st = kl_record_list_load(options->arguments[1], &b, err);
    if (st == KL_OK) {
        sort_items(&a);
        sort_items(&b);
        const struct difference d = compare_lists(&a, &b);
        st = report(options, &d, err);
    }
    kl_record_list_fini(&a);
    kl_record_list_fini(&b);
    return st;
}
