/* What moves, at a time within the shutter. Everything here is asked only of scenes that move
 * (KL_NEED_MOTION). Between two steps vertices and matrices go straight: as Embree has it. */
#ifndef KL_KERNELS_MOVING_H
#define KL_KERNELS_MOVING_H
#include "kernels/scene_data.h"

/* Between which steps a time lies: step and step + 1, `share` of the way. */
typedef struct kl_blend {
    kl_u32 step;
    float share; /* [0, 1] */
} kl_blend;

KL_FN kl_blend kl_blend_at(kl_u32 steps, float time)
{
    kl_blend b;
    b.step = 0u;
    b.share = 0.0f;
    if (steps < 2u) return b;
    const float x = kl_clamp(time, 0.0f, 1.0f) * (float)(steps - 1u);
    b.step = (kl_u32)x;
    if (b.step > steps - 2u) b.step = steps - 2u;
    b.share = x - (float)b.step;
    return b;
}

KL_FN float kl_mix(float a, float b, float share)
{
    return (1.0f - share) * a + share * b;
}
/* When the shutter has let in a share u of the light, in [0, 1]. */
KL_FN float kl_shutter_time(const KL_GLOBAL float *times, float u)
{
    const kl_blend b = kl_blend_at(KL_SHUTTER_TIMES, u);
    return kl_mix(times[b.step], times[b.step + 1u], b.share);
}

KL_FN kl_vec3 kl_mix3(kl_vec3 a, kl_vec3 b, float share)
{
    return kl_v3_mad(kl_v3_scale(a, 1.0f - share), share, b);
}

/* Three numbers of vertex v (as triangles number it) of a deforming instance from a step array. */
KL_FN kl_vec3 kl_step_vertex(const KL_GLOBAL kl_moving *m, const KL_GLOBAL float *steps, kl_blend b,
                             kl_u32 v)
{
    const size_t at =
        3 * ((size_t)m->first + (size_t)b.step * m->vertex_count + (size_t)(v - m->first_vertex));
    const kl_vec3 p = kl_v3_load(steps + at);
    if (b.share == 0.0f) return p;
    return kl_mix3(p, kl_v3_load(steps + at + 3 * (size_t)m->vertex_count), b.share);
}

/* Three numbers of a triangle's corners at a time. */
typedef struct kl_corners {
    kl_vec3 a, b, c;
} kl_corners;

KL_FN kl_corners kl_corners_of(const KL_GLOBAL float *values, const KL_GLOBAL kl_triangle *t)
{
    kl_corners k;
    k.a = kl_v3_load(values + 3 * t->v[0]);
    k.b = kl_v3_load(values + 3 * t->v[1]);
    k.c = kl_v3_load(values + 3 * t->v[2]);
    return k;
}
KL_APART kl_corners kl_corners_at(const KL_GLOBAL kl_moving *m, const KL_GLOBAL float *steps,
                                  const KL_GLOBAL kl_triangle *t, float time)
{
    const kl_blend b = kl_blend_at(m->steps, time);
    kl_corners k;
    k.a = kl_step_vertex(m, steps, b, t->v[0]);
    k.b = kl_step_vertex(m, steps, b, t->v[1]);
    k.c = kl_step_vertex(m, steps, b, t->v[2]);
    return k;
}

/* Render space from object space at a time. */
typedef struct kl_map {
    float m[12]; /* 3x4 row major */
} kl_map;

/* `matrices`: of `steps` of them. */
KL_APART kl_map kl_map_of(const KL_GLOBAL float *matrices, kl_u32 steps, float time)
{
    const kl_blend b = kl_blend_at(steps, time);
    const KL_GLOBAL float *from = matrices + 12 * (size_t)b.step;
    kl_map out;
    for (int i = 0; i < 12; ++i) {
        out.m[i] = b.share == 0.0f ? from[i] : kl_mix(from[i], from[12 + i], b.share);
    }
    return out;
}
KL_FN kl_map kl_map_at(const kl_scene_view *s, const KL_GLOBAL kl_moving *m, float time)
{
    return kl_map_of(s->step_matrices + 12 * (size_t)m->first, m->steps, time);
}
KL_FN kl_vec3 kl_map_point(const kl_map *x, kl_vec3 p)
{
    const float *m = x->m;
    return kl_v3(m[0] * p.x + m[1] * p.y + m[2] * p.z + m[3],
                 m[4] * p.x + m[5] * p.y + m[6] * p.z + m[7],
                 m[8] * p.x + m[9] * p.y + m[10] * p.z + m[11]);
}
/* Rows of the inverse of a map's linear part, times its determinant. */
typedef struct kl_adjugate {
    kl_vec3 x, y, z;
    float determinant;
} kl_adjugate;

KL_FN kl_adjugate kl_map_adjugate(const kl_map *x)
{
    const float *m = x->m;
    const kl_vec3 a = kl_v3(m[0], m[4], m[8]);
    const kl_vec3 b = kl_v3(m[1], m[5], m[9]);
    const kl_vec3 c = kl_v3(m[2], m[6], m[10]);
    kl_adjugate out;
    out.x = kl_cross(b, c);
    out.y = kl_cross(c, a);
    out.z = kl_cross(a, b);
    out.determinant = kl_dot(a, out.x);
    return out;
}
/* The vector that becomes v. */
KL_FN kl_vec3 kl_map_back(const kl_map *x, kl_vec3 v)
{
    const kl_adjugate r = kl_map_adjugate(x);
    return kl_v3_scale(kl_v3(kl_dot(r.x, v), kl_dot(r.y, v), kl_dot(r.z, v)), 1.0f / r.determinant);
}
/* The point that becomes p. */
KL_FN kl_vec3 kl_map_point_back(const kl_map *x, kl_vec3 p)
{
    return kl_map_back(x, kl_v3_sub(p, kl_v3(x->m[3], x->m[7], x->m[11])));
}
/* By the inverse transpose up to a positive factor. */
KL_APART kl_vec3 kl_map_normal(const kl_map *x, kl_vec3 n)
{
    const kl_adjugate r = kl_map_adjugate(x);
    const kl_vec3 sum = kl_v3_mad(kl_v3_mad(kl_v3_scale(r.x, n.x), n.y, r.y), n.z, r.z);
    return r.determinant < 0.0f ? kl_v3_scale(sum, -1.0f) : sum;
}

/* A material at a time: of the nearest step. */
KL_FN const KL_GLOBAL kl_material *kl_material_at(const kl_scene_view *s, kl_u32 material,
                                                  float time)
{
    if (KL_NEEDS(s, KL_NEED_MOTION)) {
        const kl_u32 first = s->material_motion[material];
        const float last = (float)(KL_VALUE_STEPS - 1);
        if (first != KL_NONE) {
            return s->step_materials + first + (kl_u32)(kl_clamp(time, 0.0f, 1.0f) * last + 0.5f);
        }
    }
    return &s->materials[material];
}

/* Whether what a ray hit has moved from where it is at the reference instant. */
KL_FN int kl_instance_moves(const kl_scene_view *s, kl_u32 instance)
{
    return KL_NEEDS(s, KL_NEED_MOTION) && s->moving[instance].steps > 0u;
}

/* Corners of a triangle of an instance that moves, render space. */
KL_APART kl_corners kl_moved_corners(const kl_scene_view *s, kl_u32 instance,
                                     const KL_GLOBAL kl_triangle *t, float time)
{
    const KL_GLOBAL kl_moving *m = &s->moving[instance];
    if (m->deforms) return kl_corners_at(m, s->step_positions, t, time);
    const kl_map x = kl_map_at(s, m, time);
    kl_corners k = kl_corners_of(s->positions, t);
    k.a = kl_map_point(&x, k.a);
    k.b = kl_map_point(&x, k.b);
    k.c = kl_map_point(&x, k.c);
    return k;
}

/* A point or spot or distant light at a time: from its steps. */
typedef struct kl_punctual {
    kl_vec3 color, pos, dir;
    float range, cone_scale, cone_cos;
    kl_u32 type;
} kl_punctual;

KL_FN kl_punctual kl_punctual_of(const KL_GLOBAL kl_light *l)
{
    kl_punctual p;
    p.color = kl_v3_load(l->color);
    p.pos = kl_v3_load(l->pos);
    p.dir = kl_v3_load(l->dir);
    p.range = l->range;
    p.cone_scale = l->cone_scale;
    p.cone_cos = l->cone_cos;
    p.type = l->type;
    return p;
}
KL_FN kl_punctual kl_punctual_at(const kl_scene_view *s, kl_u32 light, float time)
{
    if (!KL_NEEDS(s, KL_NEED_MOTION) || s->light_motion[light] == KL_NONE) {
        return kl_punctual_of(&s->lights[light]);
    }
    const kl_blend b = kl_blend_at(KL_VALUE_STEPS, time);
    kl_punctual p = kl_punctual_of(&s->step_lights[s->light_motion[light] + b.step]);
    const kl_punctual q = kl_punctual_of(&s->step_lights[s->light_motion[light] + b.step + 1u]);
    p.color = kl_mix3(p.color, q.color, b.share);
    p.pos = kl_mix3(p.pos, q.pos, b.share);
    p.dir = kl_normalize(kl_mix3(p.dir, q.dir, b.share));
    p.range = kl_mix(p.range, q.range, b.share);
    p.cone_scale = kl_mix(p.cone_scale, q.cone_scale, b.share);
    p.cone_cos = kl_mix(p.cone_cos, q.cone_cos, b.share);
    return p;
}

#endif
