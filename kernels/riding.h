/* Points that ride on what moves while the shutter is open. The direction in which a point looks
 * turns with the triangle that it lies on. */
#ifndef KL_KERNELS_RIDING_H
#define KL_KERNELS_RIDING_H
#include "kernels/surface.h"

/* What a point of a surface lies on. */
typedef struct kl_ride {
    kl_u32 instance; /* 0: something that stands still; the rest is not read then */
    kl_u32 triangle;
    float u, v; /* barycentrics of vertices 1 and 2 */
} kl_ride;
KL_ASSERT_SIZE(kl_ride, 16);

/* A point at a time, and how it looks at the world. */
typedef struct kl_stance {
    kl_vec3 pos, geometric; /* [m], render space; unit */
    kl_frame frame;         /* about the smooth normal */
    float time;
} kl_stance;

/* Two edges of a triangle, and a normal as long as they are. */
KL_FN kl_corners kl_ride_basis(const kl_corners *k)
{
    kl_corners out;
    out.a = kl_v3_sub(k->b, k->a);
    out.b = kl_v3_sub(k->c, k->a);
    const kl_vec3 n = kl_cross(out.a, out.b);
    out.c = kl_v3_scale(n, 1.0f / kl_sqrt(kl_fmax(kl_length(n), 1e-30f)));
    return out;
}

/* What becomes of a vector as one basis becomes the other. */
KL_FN kl_vec3 kl_ride_vector(const kl_corners *from, const kl_corners *to, kl_vec3 v)
{
    const kl_vec3 bc = kl_cross(from->b, from->c);
    const float scale = 1.0f / kl_dot(from->a, bc);
    const kl_vec3 a = kl_v3_scale(to->a, scale * kl_dot(v, bc));
    const kl_vec3 ab = kl_v3_mad(a, scale * kl_dot(v, kl_cross(from->c, from->a)), to->b);
    return kl_v3_mad(ab, kl_dot(v, from->c) / kl_dot(from->c, from->c), to->c);
}

/* A frame about a normal, by what becomes of its tangents. */
KL_FN kl_frame kl_ride_frame(const kl_corners *from, const kl_corners *to, kl_vec3 normal)
{
    const kl_frame f = kl_frame_from_normal(normal);
    const kl_vec3 t = kl_ride_vector(from, to, f.t);
    kl_frame out;
    out.n = kl_normalize(kl_cross(t, kl_ride_vector(from, to, f.b)));
    out.t = kl_normalize(kl_v3_mad(t, -kl_dot(t, out.n), out.n));
    out.b = kl_cross(out.n, out.t);
    return out;
}

/* Where a point of the reference instant is at a time. */
KL_APART kl_stance kl_ride_to(const kl_scene_view *s, const kl_ride *on, float time, kl_vec3 pos,
                              kl_vec3 normal, kl_vec3 geometric)
{
    kl_stance out;
    const KL_GLOBAL kl_triangle *t = &s->triangles[on->triangle];
    const kl_corners was = kl_moved_corners(s, on->instance, t, KL_TIME_REFERENCE);
    const kl_corners is = kl_moved_corners(s, on->instance, t, time);
    const kl_corners from = kl_ride_basis(&was);
    const kl_corners to = kl_ride_basis(&is);
    const kl_vec3 step = kl_v3_sub(kl_lerp3(is.a, is.b, is.c, on->u, on->v),
                                   kl_lerp3(was.a, was.b, was.c, on->u, on->v));
    out.time = time;
    out.pos = kl_v3_add(pos, step);
    out.geometric = kl_ride_frame(&from, &to, geometric).n;
    out.frame = kl_ride_frame(&from, &to, normal);
    return out;
}

#endif
