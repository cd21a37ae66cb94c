#include "src/trace/ranges.h"

#include "src/base/memory.h"

#include <stdlib.h>

static int compare(const void *a, const void *b)
{
    const struct kl_range *x = a;
    const struct kl_range *y = b;

    if (x->first != y->first) return x->first < y->first ? -1 : 1;
    if (x->count != y->count) return x->count < y->count ? -1 : 1;
    return x->instance < y->instance ? -1 : x->instance > y->instance;
}

kl_status kl_ranges_sorted(const struct kl_flat *flat, struct kl_range **out, size_t *out_count,
                           struct kl_err *err)
{
    struct kl_range *ranges = NULL;
    size_t used = 0;
    kl_status st = kl_alloc_array(&ranges, flat->instance_count, sizeof *ranges, err);

    if (st != KL_OK) return st;
    for (uint32_t i = 1; i < flat->instance_count; ++i) {
        const kl_instance *instance = &flat->instances[i];
        if (instance->triangle_count == 0) continue;
        ranges[used++] = (struct kl_range){instance->first_triangle, instance->triangle_count, i};
    }
    qsort(ranges, used, sizeof *ranges, compare);
    *out = ranges;
    *out_count = used;
    return KL_OK;
}

size_t kl_ranges_run_end(const struct kl_range *ranges, size_t count, size_t begin)
{
    size_t end = begin + 1;

    while (end < count && ranges[end].first == ranges[begin].first &&
           ranges[end].count == ranges[begin].count) {
        ++end;
    }
    return end;
}
