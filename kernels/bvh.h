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

/* Position of the lowest set bit of a mask that is not 0: OpenCL C 1.2 has only clz. */
KL_FN kl_u32 kl_ctz(kl_u32 mask)
{
#if KL_DEVICE
    return 31u - clz(mask & (0u - mask));
#else
    return (kl_u32)__builtin_ctz(mask);
#endif
}

/* Ask for a child's first bytes ahead of its visit. */
KL_FN void kl_bvh_prefetch(const kl_scene_view *scene, kl_u32 child)
{
#if KL_DEVICE && defined(__AVX__) && defined(__clang__)
    const __global char *p = (child & KL_BVH_LEAF) == 0u
                                 ? (const __global char *)(scene->bvh_nodes + child)
                                 : (const __global char *)scene->bvh_leaves +
                                       (size_t)((child & ~KL_BVH_LEAF) >> 2) * 160u;
    __builtin_prefetch((const void *)(size_t)p);
    __builtin_prefetch((const void *)(size_t)(p + 64));
    __builtin_prefetch((const void *)(size_t)(p + 128));
    __builtin_prefetch((const void *)(size_t)(p + 192));
#else
    (void)scene;
    (void)child;
#endif
}

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

/* Edge functions that differ from 0 by less than this part of their sum count as 0: 2^-23. */
#define KL_BVH_EDGE 1.1920929e-7f

/* Where a ray meets a triangle whose corners are relative to its origin. 0: not between tmin and
 * tmax. */
KL_FN int kl_bvh_triangle(const kl_corners *k, kl_vec3 d, float tmin, float tmax, float *t)
{
    const float u = kl_edge_function(k->c, k->a, d);
    const float v = kl_edge_function(k->a, k->b, d);
    const float w = kl_edge_function(k->b, k->c, d);
    const float sum = u + v + w;
    const float eps = kl_fabs(sum) * KL_BVH_EDGE;
    if (!(kl_fmin(kl_fmin(u, v), w) >= -eps || kl_fmax(kl_fmax(u, v), w) <= eps)) return 0;
    const kl_vec3 normal = kl_cross(kl_v3_sub(k->a, k->b), kl_v3_sub(k->c, k->a));
    const float den = kl_dot(normal, d);
    if (den == 0.0f) return 0; /* the ray lies in the plane */
    *t = kl_dot(k->a, normal) / den;
    return *t > tmin && *t < tmax;
}

/* How a ray meets a pack: lanes that are hit, and their distance. Where on the triangle is asked
 * only of the nearest in the end: kl_hit_settle. */
typedef struct kl_bvh_lanes {
    kl_u32 mask;
    float t[KL_BVH_PACK];
} kl_bvh_lanes;

#if KL_DEVICE
/* Bit i of the result: lane i of a comparison. x86 has an instruction for it, which compilers do
 * not find by themselves. */
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
    const int4 inside = (min(min(u, v), w) >= -eps) | (max(max(u, v), w) <= eps);
    out->mask = kl_bvh_mask4(inside);
    if (out->mask == 0u) return;
    const float4 hx = fy * ez - fz * ey, hy = fz * ex - fx * ez, hz = fx * ey - fy * ex;
    const float4 den = hx * d.x + hy * d.y + hz * d.z;
    const float4 t = (ax * hx + ay * hy + az * hz) / den;
    /* A NaN (0 / 0: the ray lies in the plane) fails both comparisons. */
    out->mask = kl_bvh_mask4(inside & (t > tmin) & (t < tmax));
    vstore4(t, 0, out->t);
}
#else
KL_FN kl_u32 kl_bvh_boxes(const KL_GLOBAL kl_bvh_node *node, const kl_bvh_slabs *s, float tmax,
                          float *tnear)
{
    kl_u32 mask = 0u;
    for (kl_u32 i = 0u; i < KL_BVH_WIDTH; ++i) {
        const KL_GLOBAL float *b = node->bounds + i;
        const float nx = (b[8u * s->near_x] - s->origin.x) * s->inverse.x;
        const float ny = (b[8u * s->near_y] - s->origin.y) * s->inverse.y;
        const float nz = (b[8u * s->near_z] - s->origin.z) * s->inverse.z;
        const float fx = (b[8u * (s->near_x ^ 1u)] - s->origin.x) * s->inverse.x;
        const float fy = (b[8u * (s->near_y ^ 1u)] - s->origin.y) * s->inverse.y;
        const float fz = (b[8u * (s->near_z ^ 1u)] - s->origin.z) * s->inverse.z;
        const float n = kl_fmax(kl_fmax(nx, ny), kl_fmax(nz, s->tmin));
        const float f = kl_fmin(kl_fmin(fx, fy), kl_fmin(fz, tmax));
        tnear[i] = n;
        mask |= n <= f * KL_BVH_SLACK ? 1u << i : 0u;
    }
    return mask;
}

KL_FN void kl_bvh_pack(const KL_GLOBAL kl_bvh_leaf *leaf, kl_vec3 o, kl_vec3 d, float tmin,
                       float tmax, kl_bvh_lanes *out)
{
    out->mask = 0u;
    for (kl_u32 i = 0u; i < KL_BVH_PACK; ++i) {
        const KL_GLOBAL float *p = leaf->v + i;
        kl_corners k;
        k.a = kl_v3_sub(kl_v3(p[0], p[4], p[8]), o);
        k.b = kl_v3_sub(kl_v3(p[12], p[16], p[20]), o);
        k.c = kl_v3_sub(kl_v3(p[24], p[28], p[32]), o);
        if (kl_bvh_triangle(&k, d, tmin, tmax, &out->t[i])) out->mask |= 1u << i;
    }
}
#endif

/* Children still to visit, nearest on top. */
typedef struct kl_bvh_stack {
    kl_u32 size;
    kl_u32 child[KL_BVH_STACK];
    float t[KL_BVH_STACK];
} kl_bvh_stack;

/* Push the children of a node that `mask` names, farthest first. */
KL_FN void kl_bvh_push(const kl_scene_view *scene, kl_bvh_stack *stack,
                       const KL_GLOBAL kl_bvh_node *node, kl_u32 mask, const float *tnear)
{
    const kl_u32 base = stack->size;
    while (mask != 0u) {
        const kl_u32 i = kl_ctz(mask);
        const float t = tnear[i];
        kl_bvh_prefetch(scene, node->child[i]);
        kl_u32 at = stack->size++;
        mask &= mask - 1u;
        while (at > base && stack->t[at - 1u] < t) {
            stack->t[at] = stack->t[at - 1u];
            stack->child[at] = stack->child[at - 1u];
            --at;
        }
        stack->t[at] = t;
        stack->child[at] = node->child[i];
    }
}

/* What a tree of triangles is asked: a ray in its space, with its length kept in units of the
 * render-space direction, so that distances compare across instances. */
typedef struct kl_bvh_ray {
    kl_vec3 origin, dir;
    float tmin, time;
    const KL_GLOBAL kl_moving *bends; /* whose triangles have other corners at other times; NULL */
} kl_bvh_ray;

/* How it meets the triangles of a pack where these are at its time. */
KL_FN void kl_bvh_pack_at(const kl_scene_view *scene, const KL_GLOBAL kl_bvh_leaf *leaf,
                          const kl_bvh_ray *ray, float tmax, kl_bvh_lanes *out)
{
    out->mask = 0u;
    for (kl_u32 i = 0u; i < KL_BVH_PACK && leaf->triangle[i] != KL_NONE; ++i) {
        kl_corners k = kl_corners_at(ray->bends, scene->step_positions,
                                     &scene->triangles[leaf->triangle[i]], ray->time);
        k.a = kl_v3_sub(k.a, ray->origin);
        k.b = kl_v3_sub(k.b, ray->origin);
        k.c = kl_v3_sub(k.c, ray->origin);
        if (kl_bvh_triangle(&k, ray->dir, ray->tmin, tmax, &out->t[i])) out->mask |= 1u << i;
    }
}

KL_FN void kl_bvh_meet(const kl_scene_view *scene, const KL_GLOBAL kl_bvh_leaf *leaf,
                       const kl_bvh_ray *ray, float tmax, kl_bvh_lanes *out)
{
    if (KL_NEEDS(scene, KL_NEED_MOTION) && ray->bends != 0) {
        kl_bvh_pack_at(scene, leaf, ray, tmax, out);
    } else {
        kl_bvh_pack(leaf, ray->origin, ray->dir, ray->tmin, tmax, out);
    }
}

/* All packs of a leaf; improves *hit (its t is the limit). 1 if anything was hit. */
KL_FN int kl_bvh_leaf_closest(const kl_scene_view *scene, kl_u32 child, const kl_bvh_ray *ray,
                              kl_hit *hit)
{
    const KL_GLOBAL kl_bvh_leaf *leaves = scene->bvh_leaves;
    const kl_u32 first = (child & ~KL_BVH_LEAF) >> 2;
    const kl_u32 end = first + (child & 3u) + 1u;
    int found = 0;
    for (kl_u32 i = first; i < end; ++i) {
        kl_bvh_lanes lanes;
        kl_bvh_meet(scene, leaves + i, ray, hit->t, &lanes);
        while (lanes.mask != 0u) {
            const kl_u32 k = kl_ctz(lanes.mask);
            lanes.mask &= lanes.mask - 1u;
            if (!(lanes.t[k] < hit->t)) continue;
            hit->t = lanes.t[k];
            hit->triangle = leaves[i].triangle[k];
            found = 1;
        }
    }
    return found;
}

/* The triangles below `root`, from the entries above stack->size on: the caller's stay. */
KL_FN int kl_bvh_tree_closest(const kl_scene_view *scene, kl_u32 root, kl_bvh_stack *stack,
                              const kl_bvh_ray *ray, kl_hit *hit)
{
    const kl_bvh_slabs slabs = kl_bvh_slabs_make(ray->origin, ray->dir, ray->tmin);
    const kl_u32 base = stack->size;
    kl_u32 current = root;
    int found = 0;
    for (;;) {
        if ((current & KL_BVH_LEAF) == 0u) {
            const KL_GLOBAL kl_bvh_node *node = scene->bvh_nodes + current;
            float tnear[KL_BVH_WIDTH];
            const kl_u32 mask = kl_bvh_boxes(node, &slabs, hit->t, tnear);
            if (mask != 0u && (mask & (mask - 1u)) == 0u) {
                current = node->child[kl_ctz(mask)];
                continue;
            }
            kl_bvh_push(scene, stack, node, mask, tnear);
        } else {
            found |= kl_bvh_leaf_closest(scene, current, ray, hit);
        }
        do {
            if (stack->size == base) return found;
            --stack->size;
        } while (stack->t[stack->size] > hit->t);
        current = stack->child[stack->size];
    }
}

KL_FN int kl_bvh_leaf_any(const kl_scene_view *scene, kl_u32 child, const kl_bvh_ray *ray,
                          float tmax)
{
    const kl_u32 first = (child & ~KL_BVH_LEAF) >> 2;
    const kl_u32 end = first + (child & 3u) + 1u;
    for (kl_u32 i = first; i < end; ++i) {
        kl_bvh_lanes lanes;
        kl_bvh_meet(scene, scene->bvh_leaves + i, ray, tmax, &lanes);
        if (lanes.mask != 0u) return 1;
    }
    return 0;
}

KL_FN int kl_bvh_tree_any(const kl_scene_view *scene, kl_u32 root, kl_bvh_stack *stack,
                          const kl_bvh_ray *ray, float tmax)
{
    const kl_bvh_slabs slabs = kl_bvh_slabs_make(ray->origin, ray->dir, ray->tmin);
    const kl_u32 base = stack->size;
    kl_u32 current = root;
    for (;;) {
        if ((current & KL_BVH_LEAF) == 0u) {
            const KL_GLOBAL kl_bvh_node *node = scene->bvh_nodes + current;
            float tnear[KL_BVH_WIDTH];
            kl_u32 mask = kl_bvh_boxes(node, &slabs, tmax, tnear);
            while (mask != 0u) {
                stack->child[stack->size++] = node->child[kl_ctz(mask)];
                mask &= mask - 1u;
            }
        } else if (kl_bvh_leaf_any(scene, current, ray, tmax)) {
            return 1;
        }
        if (stack->size == base) return 0;
        current = stack->child[--stack->size];
    }
}

/* A ray in the space of an instance's tree. */
KL_FN kl_bvh_ray kl_bvh_enter(const kl_scene_view *scene, kl_u32 index, const kl_ray *ray)
{
    kl_bvh_ray r;
    r.origin = ray->origin;
    r.dir = ray->dir;
    r.tmin = ray->tmin;
    r.time = ray->time;
    r.bends = 0;
    if (index == 0u) return r;
    if (!kl_instance_moves(scene, index)) {
        const KL_GLOBAL float *m = scene->instances[index].object_from_render;
        r.origin = kl_affine_point(m, r.origin);
        r.dir = kl_affine_vector(m, r.dir);
    } else if (scene->moving[index].deforms) {
        r.bends = &scene->moving[index];
    } else {
        const kl_map x = kl_map_at(scene, &scene->moving[index], ray->time);
        r.origin = kl_map_point_back(&x, r.origin);
        r.dir = kl_map_back(&x, r.dir);
    }
    return r;
}

KL_FN int kl_bvh_instance_closest(const kl_scene_view *scene, kl_u32 index, kl_bvh_stack *stack,
                                  const kl_ray *ray, kl_hit *hit)
{
    const kl_u32 root = scene->bvh_roots[index];
    if (root == KL_NONE) return 0;
    const kl_bvh_ray r = kl_bvh_enter(scene, index, ray);
    if (!kl_bvh_tree_closest(scene, root, stack, &r, hit)) return 0;
    hit->instance = index;
    return 1;
}

KL_FN int kl_bvh_instance_any(const kl_scene_view *scene, kl_u32 index, kl_bvh_stack *stack,
                              const kl_ray *ray)
{
    const kl_u32 root = scene->bvh_roots[index];
    if (root == KL_NONE) return 0;
    const kl_bvh_ray r = kl_bvh_enter(scene, index, ray);
    return kl_bvh_tree_any(scene, root, stack, &r, ray->tmax);
}

/* The tree of instances: the next instance whose box the ray may meet before `tmax`, KL_NONE at the
 * end. The stack holds what is left. */
KL_FN kl_u32 kl_bvh_next_instance(const kl_scene_view *scene, kl_bvh_stack *stack,
                                  const kl_bvh_slabs *slabs, float tmax)
{
    while (stack->size > 0u) {
        const kl_u32 current = stack->child[--stack->size];
        const KL_GLOBAL kl_bvh_node *node = scene->bvh_nodes + current;
        float tnear[KL_BVH_WIDTH];
        if (stack->t[stack->size] > tmax) continue;
        if ((current & KL_BVH_LEAF) != 0u) return current & ~KL_BVH_LEAF;
        const kl_u32 mask = kl_bvh_boxes(node, slabs, tmax, tnear);
        kl_bvh_push(scene, stack, node, mask, tnear);
    }
    return KL_NONE;
}

KL_FN void kl_bvh_start_instances(const kl_scene_view *scene, kl_bvh_stack *stack, float tmin)
{
    const kl_u32 root = scene->bvh_roots[scene->instance_count];
    stack->size = 0u;
    if (root == KL_NONE) return;
    stack->child[0] = root;
    stack->t[0] = tmin;
    stack->size = 1u;
}

/* As kl_trace_closest. */
KL_FN int kl_bvh_closest(const kl_scene_view *scene, const kl_ray *ray, kl_hit *hit)
{
    kl_bvh_stack stack;
    kl_hit best;
    int found = 0;
    best.t = ray->tmax;
    best.u = best.v = 0.0f;
    best.triangle = best.instance = KL_NONE;
    stack.size = 0u;
    if (!KL_NEEDS(scene, KL_NEED_INSTANCES)) {
        found = kl_bvh_instance_closest(scene, 0u, &stack, ray, &best);
    } else {
        const kl_bvh_slabs slabs = kl_bvh_slabs_make(ray->origin, ray->dir, ray->tmin);
        kl_u32 index;
        kl_bvh_start_instances(scene, &stack, ray->tmin);
        while ((index = kl_bvh_next_instance(scene, &stack, &slabs, best.t)) != KL_NONE) {
            found |= kl_bvh_instance_closest(scene, index, &stack, ray, &best);
        }
    }
    if (!found) return 0;
    kl_hit_settle(scene, ray, &best);
    *hit = best;
    return 1;
}

/* As kl_trace_any. */
KL_FN int kl_bvh_any(const kl_scene_view *scene, const kl_ray *ray)
{
    kl_bvh_stack stack;
    stack.size = 0u;
    if (!KL_NEEDS(scene, KL_NEED_INSTANCES)) {
        return kl_bvh_instance_any(scene, 0u, &stack, ray);
    }
    const kl_bvh_slabs slabs = kl_bvh_slabs_make(ray->origin, ray->dir, ray->tmin);
    kl_u32 index;
    kl_bvh_start_instances(scene, &stack, ray->tmin);
    while ((index = kl_bvh_next_instance(scene, &stack, &slabs, ray->tmax)) != KL_NONE) {
        if (kl_bvh_instance_any(scene, index, &stack, ray)) return 1;
    }
    return 0;
}

#endif
