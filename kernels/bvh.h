/* Ray tracing on devices: a tree of eight boxes a node over packs of four triangles, and a second
 * tree over instances where the scene has them. Built by src/trace/device_bvh.c.
 *
 * Robust as far as it matters for light: boxes are padded at build time and compared with a slack
 * of a few units in the last place; triangles are tested by Pluecker coordinates relative to the
 * ray's origin, whose edge function changes only its sign between the two triangles of an edge, so
 * no ray slips between them. Davidovic et al., "3D Rasterization: A Bridge between Rasterization
 * and Ray Casting", 2012; Embree's robust mode does the same. */
#ifndef KL_KERNELS_BVH_H
#define KL_KERNELS_BVH_H
#include "kernels/trace.h"

#define KL_BVH_WIDTH 8
#define KL_BVH_PACK  4
/* Entries a traversal may need, both trees together; the builder keeps below it. */
#define KL_BVH_STACK 192

/* A child: KL_NONE: none (its box is never hit). Bit 31 clear: a node. Set: a leaf; in a
 * tree of triangles the low 2 bits say how many packs (less one), the others the first pack; in the
 * tree of instances the low 31 bits are the instance. */
#define KL_BVH_LEAF 0x80000000u

/* bounds: lower x of all children, upper x, lower y, upper y, lower z, upper z. */
typedef struct kl_bvh_node {
    float bounds[6 * KL_BVH_WIDTH];
    kl_u32 child[KL_BVH_WIDTH];
    kl_u32 pad[8];
} kl_bvh_node;
KL_ASSERT_SIZE(kl_bvh_node, 256);

/* v: x of the four vertices 0, y, z, then vertices 1, then vertices 2. Unused lanes: all vertices
 * 0 (never hit) and triangle KL_NONE. */
typedef struct kl_bvh_leaf {
    float v[9 * KL_BVH_PACK];
    kl_u32 triangle[KL_BVH_PACK];
} kl_bvh_leaf;
KL_ASSERT_SIZE(kl_bvh_leaf, 160);

/* What the box test needs of a ray. near_*: where in kl_bvh_node.bounds the side stands that the
 * ray meets first, in units of KL_BVH_WIDTH; the far side is its neighbour (xor 1). */
typedef struct kl_bvh_slabs {
    kl_vec3 origin, inverse;
    float tmin;
    kl_u32 near_x, near_y, near_z;
} kl_bvh_slabs;

/* One over a direction's component; a huge finite number for (almost) 0, so that no product is
 * NaN: box sides are finite and below 1e20. */
KL_FN float kl_bvh_inverse(float d)
{
    const float tiny = 1e-18f;
    if (kl_fabs(d) < tiny) return (kl_as_u32(d) >> 31) != 0u ? -1.0f / tiny : 1.0f / tiny;
    return 1.0f / d;
}

KL_FN kl_bvh_slabs kl_bvh_slabs_make(kl_vec3 origin, kl_vec3 dir, float tmin)
{
    kl_bvh_slabs s;
    s.origin = origin;
    s.inverse = kl_v3(kl_bvh_inverse(dir.x), kl_bvh_inverse(dir.y), kl_bvh_inverse(dir.z));
    s.tmin = tmin;
    s.near_x = s.inverse.x < 0.0f ? 1u : 0u;
    s.near_y = s.inverse.y < 0.0f ? 3u : 2u;
    s.near_z = s.inverse.z < 0.0f ? 5u : 4u;
    return s;
}

/* Far distances are stretched by this: subtraction, inverse and product are each off by at most
 * half a unit in the last place, on both sides of the comparison. 1 + 2^-21. */
#define KL_BVH_SLACK 1.000000476837158f

/* How the rays of a pack end: lanes that are hit, their distance and edge functions. */
typedef struct kl_bvh_lanes {
    kl_u32 mask;
    float t[KL_BVH_PACK], u[KL_BVH_PACK], v[KL_BVH_PACK];
} kl_bvh_lanes;

#if KL_DEVICE
/* Bit i of the result: lane i of a comparison. x86 has an instruction for it, which compilers do not
 * find by themselves. */
#if defined(__AVX__) && defined(__clang__)
KL_FN kl_u32 kl_bvh_mask8(int8 m)
{
    return (kl_u32)__builtin_ia32_movmskps256(as_float8(m));
}
KL_FN kl_u32 kl_bvh_mask4(int4 m)
{
    return (kl_u32)__builtin_ia32_movmskps(as_float4(m));
}
#else
KL_FN kl_u32 kl_bvh_mask4(int4 m)
{
    const int4 b = m & (int4)(1, 2, 4, 8);
    const int2 c = b.lo | b.hi;
    return (kl_u32)(c.x | c.y);
}
KL_FN kl_u32 kl_bvh_mask8(int8 m)
{
    return kl_bvh_mask4(m.lo) | (kl_bvh_mask4(m.hi) << 4);
}
#endif

KL_FN kl_u32 kl_bvh_boxes(const KL_GLOBAL kl_bvh_node *node, const kl_bvh_slabs *s, float tmax,
                          float *tnear)
{
    const KL_GLOBAL float *b = node->bounds;
    const float8 nx = (vload8(s->near_x, b) - s->origin.x) * s->inverse.x;
    const float8 ny = (vload8(s->near_y, b) - s->origin.y) * s->inverse.y;
    const float8 nz = (vload8(s->near_z, b) - s->origin.z) * s->inverse.z;
    const float8 fx = (vload8(s->near_x ^ 1u, b) - s->origin.x) * s->inverse.x;
    const float8 fy = (vload8(s->near_y ^ 1u, b) - s->origin.y) * s->inverse.y;
    const float8 fz = (vload8(s->near_z ^ 1u, b) - s->origin.z) * s->inverse.z;
    const float8 n = max(max(nx, ny), max(nz, (float8)(s->tmin)));
    const float8 f = min(min(fx, fy), min(fz, (float8)(tmax)));
    vstore8(n, 0, tnear);
    return kl_bvh_mask8(n <= f * KL_BVH_SLACK);
}

KL_FN void kl_bvh_pack(const KL_GLOBAL kl_bvh_leaf *leaf, kl_vec3 o, kl_vec3 d, float tmin,
                       float tmax, kl_bvh_lanes *out)
{
    const KL_GLOBAL float *p = leaf->v;
    const float4 ax = vload4(0, p) - o.x, ay = vload4(1, p) - o.y, az = vload4(2, p) - o.z;
    const float4 bx = vload4(3, p) - o.x, by = vload4(4, p) - o.y, bz = vload4(5, p) - o.z;
    const float4 cx = vload4(6, p) - o.x, cy = vload4(7, p) - o.y, cz = vload4(8, p) - o.z;
    const float4 ex = cx - ax, ey = cy - ay, ez = cz - az;
    const float4 fx = ax - bx, fy = ay - by, fz = az - bz;
    const float4 gx = bx - cx, gy = by - cy, gz = bz - cz;
    const float4 sx = cx + ax, sy = cy + ay, sz = cz + az;
    const float4 tx = ax + bx, ty = ay + by, tz = az + bz;
    const float4 wx = bx + cx, wy = by + cy, wz = bz + cz;
    const float4 u =
        (ey * sz - ez * sy) * d.x + (ez * sx - ex * sz) * d.y + (ex * sy - ey * sx) * d.z;
    const float4 v =
        (fy * tz - fz * ty) * d.x + (fz * tx - fx * tz) * d.y + (fx * ty - fy * tx) * d.z;
    const float4 w =
        (gy * wz - gz * wy) * d.x + (gz * wx - gx * wz) * d.y + (gx * wy - gy * wx) * d.z;
    const float4 sum = u + v + w;
    const float4 eps = fabs(sum) * KL_BVH_EDGE;
    const int4 inside =
        (min(min(u, v), w) >= -eps) | (max(max(u, v), w) <= eps);
    out->mask = kl_bvh_mask4(inside);
    if (out->mask == 0u) return;
    const float4 hx = fy * ez - fz * ey, hy = fz * ex - fx * ez, hz = fx * ey - fy * ex;
    const float4 den = hx * d.x + hy * d.y + hz * d.z;
    const float4 t = (ax * hx + ay * hy + az * hz) / den;
    /* A NaN (0 / 0: the ray lies in the plane) fails both comparisons. */
    out->mask = kl_bvh_mask4(inside & (t > tmin) & (t < tmax));
    vstore4(t, 0, out->t);
    vstore4(u / sum, 0, out->u);
    vstore4(v / sum, 0, out->v);
}
#else
