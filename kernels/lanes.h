/* Rows of eight words as columns: several records at once, each in a lane of its own. */
#ifndef KL_KERNELS_LANES_H
#define KL_KERNELS_LANES_H
#include "kernels/device_compat.h"

/* at[j][k]: word j of the row in lane k. */
typedef struct kl_columns {
    kl_u32 at[8][KL_LANES];
} kl_columns;

/* Row k begins `first` words into the element numbers[k] of an array of elements of `stride` words.
 * There it must have eight. */
#if KL_DEVICE
KL_FN void kl_columns_load(const KL_GLOBAL void *elements, kl_u32 stride, kl_u32 first,
                           const kl_u32 *numbers, kl_columns *out)
{
    const KL_GLOBAL kl_u32 *words = elements;
    for (kl_u32 j = 0; j < 8u; ++j) {
        out->at[j][0] = words[(kl_u64)numbers[0] * stride + first + j];
    }
}
#else
typedef kl_u32 kl_row __attribute__((vector_size(32)));
typedef kl_u32 kl_row_in_memory __attribute__((vector_size(32), aligned(4), may_alias));

/* Transposes in three rounds: words, pairs of words, halves of rows change places. */
KL_FN void kl_columns_load(const void *elements, kl_u32 stride, kl_u32 first, const kl_u32 *numbers,
                           kl_columns *out)
{
    const kl_u32 *words = (const kl_u32 *)elements + first;
    kl_row a[8];
    kl_row b[8];
    for (kl_u32 k = 0; k < 8u; ++k) {
        a[k] = *(const kl_row_in_memory *)(words + (size_t)numbers[k] * stride);
    }
    for (kl_u32 k = 0; k < 8u; k += 2) {
        b[k] = __builtin_shufflevector(a[k], a[k + 1], 0, 8, 1, 9, 4, 12, 5, 13);
        b[k + 1] = __builtin_shufflevector(a[k], a[k + 1], 2, 10, 3, 11, 6, 14, 7, 15);
    }
    for (kl_u32 k = 0; k < 8u; k += 4) {
        for (kl_u32 i = 0; i < 2u; ++i) {
            const kl_row x = b[k + i];
            const kl_row y = b[k + i + 2];
            a[k + 2 * i] = __builtin_shufflevector(x, y, 0, 1, 8, 9, 4, 5, 12, 13);
            a[k + 2 * i + 1] = __builtin_shufflevector(x, y, 2, 3, 10, 11, 6, 7, 14, 15);
        }
    }
    for (kl_u32 j = 0; j < 4u; ++j) {
        b[j] = __builtin_shufflevector(a[j], a[j + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        b[j + 4] = __builtin_shufflevector(a[j], a[j + 4], 4, 5, 6, 7, 12, 13, 14, 15);
    }
    for (kl_u32 j = 0; j < 8u; ++j) {
        *(kl_row_in_memory *)out->at[j] = b[j];
    }
}
#endif

#endif
