/* Measured values in order: what a median and a spread are read from. */
#ifndef KL_TESTS_BENCH_SORT_H
#define KL_TESTS_BENCH_SORT_H

#include <stddef.h>
#include <stdlib.h>

static int bench_compare(const void *a, const void *b)
{
    const double x = *(const double *)a;
    const double y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Ascending, in place. */
static inline void bench_sort(double *values, size_t n)
{
    qsort(values, n, sizeof *values, bench_compare);
}

#endif
