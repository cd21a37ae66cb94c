/* Sizes and offsets of the shared structs as this compiler lays them out. */
#include "kernels/probe_list.h"

#define REPORT_SIZE(type) out[n++] = (uint)sizeof(type);
#define REPORT_FIELD(type, field)                                                                  \
    {                                                                                              \
        type x;                                                                                    \
        out[n++] = (uint)((char *)&x.field - (char *)&x);                                          \
    }

/* `out` holds as many as KL_PROBE_ALL lists; one work-item writes all. */
__kernel void kl_probe_layout(__global uint *out)
{
    uint n = 0;
    if (get_global_id(0) != 0) return;
    KL_PROBE_ALL(REPORT_SIZE, REPORT_FIELD)
}
