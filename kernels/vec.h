/* Three-component vectors as a plain struct: the same size and alignment in C and in OpenCL. */
#ifndef KL_KERNELS_VEC_H
#define KL_KERNELS_VEC_H
#include "kernels/device_compat.h"

typedef struct kl_vec3 {
    float x, y, z;
} kl_vec3;

KL_FN kl_vec3 kl_v3(float x, float y, float z)
{
    kl_vec3 v;
    v.x = x;
    v.y = y;
    v.z = z;
    return v;
}
KL_FN kl_vec3 kl_v3_splat(float s)
{
    return kl_v3(s, s, s);
}
KL_FN kl_vec3 kl_v3_load(const KL_GLOBAL float *p)
{
    return kl_v3(p[0], p[1], p[2]);
}
KL_FN kl_vec3 kl_v3_add(kl_vec3 a, kl_vec3 b)
{
    return kl_v3(a.x + b.x, a.y + b.y, a.z + b.z);
}
KL_FN kl_vec3 kl_v3_sub(kl_vec3 a, kl_vec3 b)
{
    return kl_v3(a.x - b.x, a.y - b.y, a.z - b.z);
}
KL_FN kl_vec3 kl_v3_mul(kl_vec3 a, kl_vec3 b)
{
    return kl_v3(a.x * b.x, a.y * b.y, a.z * b.z);
}
KL_FN kl_vec3 kl_v3_scale(kl_vec3 a, float s)
{
    return kl_v3(a.x * s, a.y * s, a.z * s);
}
/* a + s * b */
KL_FN kl_vec3 kl_v3_mad(kl_vec3 a, float s, kl_vec3 b)
{
    return kl_v3(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z);
}
KL_FN float kl_dot(kl_vec3 a, kl_vec3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
KL_FN kl_vec3 kl_cross(kl_vec3 a, kl_vec3 b)
{
    return kl_v3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
KL_FN float kl_length(kl_vec3 a)
{
    return kl_sqrt(kl_dot(a, a));
}
/* Unit vector along a; (0, 0, 1) where a has no direction. */
KL_FN kl_vec3 kl_normalize(kl_vec3 a)
{
    const float l2 = kl_dot(a, a);
    if (!(l2 > 0.0f) || !kl_isfinite(l2)) {
        /* Squares may under- or overflow where the vector itself is fine. */
        const float m = kl_fmax(kl_fmax(kl_fabs(a.x), kl_fabs(a.y)), kl_fabs(a.z));
        if (!(m > 0.0f) || !kl_isfinite(m)) return kl_v3(0.0f, 0.0f, 1.0f);
        a = kl_v3(a.x / m, a.y / m, a.z / m);
        return kl_v3_scale(a, 1.0f / kl_length(a));
    }
    return kl_v3_scale(a, 1.0f / kl_sqrt(l2));
}
KL_FN float kl_max3(kl_vec3 a)
{
    return kl_fmax(kl_fmax(a.x, a.y), a.z);
}
/* Rec. 709 luminance of a linear colour. */
KL_FN float kl_luminance(kl_vec3 c)
{
    return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z;
}
KL_FN int kl_is_black(kl_vec3 c)
{
    return c.x <= 0.0f && c.y <= 0.0f && c.z <= 0.0f;
}
KL_FN int kl_v3_isfinite(kl_vec3 c)
{
    return kl_isfinite(c.x) && kl_isfinite(c.y) && kl_isfinite(c.z);
}

/* Right-handed orthonormal frame (t, b, n): Duff et al., "Building an Orthonormal Basis,
 * Revisited", JCGT 2017. */
typedef struct kl_frame {
    kl_vec3 t, b, n;
} kl_frame;

KL_FN kl_frame kl_frame_from_normal(kl_vec3 n)
{
    kl_frame f;
    const float sign = n.z >= 0.0f ? 1.0f : -1.0f;
    const float a = -1.0f / (sign + n.z);
    const float b = n.x * n.y * a;
    f.t = kl_v3(1.0f + sign * n.x * n.x * a, sign * b, -sign * n.x);
    f.b = kl_v3(b, sign + n.y * n.y * a, -n.y);
    f.n = n;
    return f;
}
KL_FN kl_vec3 kl_frame_to_world(const kl_frame *f, kl_vec3 v)
{
    return kl_v3_mad(kl_v3_mad(kl_v3_scale(f->t, v.x), v.y, f->b), v.z, f->n);
}
KL_FN kl_vec3 kl_frame_to_local(const kl_frame *f, kl_vec3 v)
{
    return kl_v3(kl_dot(v, f->t), kl_dot(v, f->b), kl_dot(v, f->n));
}

/* Affine map, rows of a 3x4 matrix: p' = M p + t. */
KL_FN kl_vec3 kl_affine_point(const KL_GLOBAL float *m, kl_vec3 p)
{
    return kl_v3(m[0] * p.x + m[1] * p.y + m[2] * p.z + m[3],
                 m[4] * p.x + m[5] * p.y + m[6] * p.z + m[7],
                 m[8] * p.x + m[9] * p.y + m[10] * p.z + m[11]);
}
KL_FN kl_vec3 kl_affine_vector(const KL_GLOBAL float *m, kl_vec3 v)
{
    return kl_v3(m[0] * v.x + m[1] * v.y + m[2] * v.z, m[4] * v.x + m[5] * v.y + m[6] * v.z,
                 m[8] * v.x + m[9] * v.y + m[10] * v.z);
}
/* Normals go by the inverse transpose: pass the inverse map. Not unit length. */
KL_FN kl_vec3 kl_affine_normal(const KL_GLOBAL float *inverse, kl_vec3 n)
{
    return kl_v3(inverse[0] * n.x + inverse[4] * n.y + inverse[8] * n.z,
                 inverse[1] * n.x + inverse[5] * n.y + inverse[9] * n.z,
                 inverse[2] * n.x + inverse[6] * n.y + inverse[10] * n.z);
}

#endif
