/* The only file that asks which compiler is reading us. Included first by every kernels/ header.
 * Everything else in this room is the common subset of C17 and OpenCL C 1.2. */
#ifndef KL_KERNELS_DEVICE_COMPAT_H
#define KL_KERNELS_DEVICE_COMPAT_H

#if defined(__OPENCL_C_VERSION__)
#define KL_DEVICE 1
#define KL_FN     static inline
#define KL_APART  static inline
#define KL_INLINE static inline
#define KL_GLOBAL __global
#define KL_CONST  __constant
typedef uchar kl_u8;
typedef ushort kl_u16;
typedef short kl_i16;
typedef uint kl_u32;
typedef int kl_i32;
typedef ulong kl_u64;
#define kl_sqrt(x)     sqrt(x)
#define kl_sin(x)      sin(x)
#define kl_cos(x)      cos(x)
#define kl_acos(x)     acos(x)
#define kl_atan2(y, x) atan2(y, x)
#define kl_exp2(x)     exp2(x)
#define kl_log2(x)     log2(x)
#define kl_pow(x, y)   pow(x, y)
#define kl_floor(x)    floor(x)
#define kl_fabs(x)     fabs(x)
#define kl_fmin(a, b)  fmin(a, b)
#define kl_fmax(a, b)  fmax(a, b)
#define kl_isfinite(x) isfinite(x)
#define kl_as_u32(x)   as_uint(x)
#define kl_as_f32(x)   as_float(x)
#define KL_PREFETCH(p) ((void)0) /* devices hide latency by themselves */
#define KL_LANES       1u        /* and work items are their lanes */
#define KL_SIMD
#else
#define KL_DEVICE 0
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#define KL_FN     static inline
/* What few scenes need stands apart, where it takes no registers from what all do. */
#define KL_APART  static __attribute__((noinline, unused))
#define KL_INLINE static inline __attribute__((always_inline))
#define KL_GLOBAL
#define KL_PREFETCH(p) __builtin_prefetch(p)
#define KL_LANES       8u /* of a loop that one vector instruction does at once */
#if defined(_OPENMP)
#define KL_SIMD _Pragma("omp simd")
#else
#define KL_SIMD
#endif
#define KL_CONST       static const
typedef uint8_t kl_u8;
typedef uint16_t kl_u16;
typedef int16_t kl_i16;
typedef uint32_t kl_u32;
typedef int32_t kl_i32;
typedef uint64_t kl_u64;
#define kl_sqrt(x)     sqrtf(x)
#define kl_sin(x)      sinf(x)
#define kl_cos(x)      cosf(x)
#define kl_acos(x)     acosf(x)
#define kl_atan2(y, x) atan2f(y, x)
#define kl_exp2(x)     exp2f(x)
#define kl_log2(x)     log2f(x)
#define kl_pow(x, y)   powf(x, y)
#define kl_floor(x)    floorf(x)
#define kl_fabs(x)     fabsf(x)
#define kl_isfinite(x) isfinite(x)
/* No NaN handling needed: NaN is caught where it enters. */
KL_FN float kl_fmin(float a, float b)
{
    return a < b ? a : b;
}
KL_FN float kl_fmax(float a, float b)
{
    return a > b ? a : b;
}
KL_FN kl_u32 kl_as_u32(float x)
{
    kl_u32 u;
    memcpy(&u, &x, sizeof u);
    return u;
}
KL_FN float kl_as_f32(kl_u32 u)
{
    float x;
    memcpy(&x, &u, sizeof x);
    return x;
}
#endif

/* OpenCL C 1.2 has no _Static_assert; a negative array size stops all compilers. */
#define KL_ASSERT_SIZE(type, bytes)                                                                \
    typedef char kl_size_of_##type[(sizeof(type) == (bytes)) ? 1 : -1]

#define KL_NONE   0xffffffffu /* "no index" in every shared array */
#define KL_PI     3.14159265358979f
#define KL_INV_PI 0.318309886183791f
#define KL_INF    3.402823e38f /* stands for infinity: finite, so that products with 0 stay 0 */

KL_FN float kl_clamp(float x, float lo, float hi)
{
    return kl_fmin(kl_fmax(x, lo), hi);
}

#endif
