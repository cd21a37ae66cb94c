/* Interpolated irradiance from the records around a point. No stack, no pointers: the same on the
 * host and on devices. */
#ifndef KL_KERNELS_CACHE_QUERY_H
#define KL_KERNELS_CACHE_QUERY_H
#include "kernels/cache_data.h"
#include "kernels/sampling.h"

#define KL_BEHIND_TOLERANCE  0.1f /* of the radius: methods of Ward 1988, relative here */
#define KL_SLAB              0.4f /* height above the record's plane, in radii: same surface */
#define KL_MIN_EXTRAPOLATION 0.05f
#define KL_MAX_EXTRAPOLATION 20.0f
#define KL_GRADIENT_REACH    0.35f /* raw radii up to which a gradient is followed */

/* Identity of a record, in any process: hash of position, normal (octahedral) and bounce level. It
 * seeds the gather, so that noise does not change from frame to frame. */
KL_FN kl_u32 kl_record_seed(const float pos[3], kl_u32 normal, kl_u32 level)
{
    kl_u32 h = kl_hash(kl_as_u32(pos[0]) ^ (level << 30));
    h = kl_hash(h ^ kl_as_u32(pos[1]));
    h = kl_hash(h ^ kl_as_u32(pos[2]));
    return kl_hash(h ^ normal);
}

/* How a query weighs records. */
typedef struct kl_query {
    float reach;   /* radii are multiplied by this; at most the octree's own */
    float cos_max; /* cosine of the largest angle between normals */
    float enough;  /* stop at this sum of weights: finest records come first */
} kl_query;

typedef struct kl_answer {
    kl_vec3 irr;  /* irradiance [W m^-2] */
    float weight; /* sum of weights; 0: no record serves this point */
    float best;   /* largest weight: 1 on top of a record */
    float shares; /* sum of weights over squared radii, what the means are taken by */
    float error;  /* relative standard error of the records, root of the weighted mean square */
    float radius; /* [m] of the nearest-weighted records, weighted mean */
} kl_answer;

/* Face of the direction cube that a normal points to: 2 * axis, + 1 if negative. */
KL_FN kl_u32 kl_normal_face(kl_vec3 n)
{
    const float ax = kl_fabs(n.x);
    const float ay = kl_fabs(n.y);
    const float az = kl_fabs(n.z);
    if (ax >= ay && ax >= az) return n.x < 0.0f ? 1u : 0u;
    if (ay >= az) return n.y < 0.0f ? 3u : 2u;
    return n.z < 0.0f ? 5u : 4u;
}

/* Row of what may serve p with a normal on `face`, or KL_NONE. Points outside of the root are
 * served by the cells at its rim. */
KL_FN kl_u32 kl_octree_row(const kl_level_view *c, kl_vec3 p, kl_u32 face)
{
    const float last = (float)((1u << KL_OCTREE_MAX_LEVEL) - 1u);
    const float scale = (float)(1u << KL_OCTREE_MAX_LEVEL) / c->head.side;
    const kl_u32 x = (kl_u32)kl_clamp((p.x - c->head.root_min[0]) * scale, 0.0f, last);
    const kl_u32 y = (kl_u32)kl_clamp((p.y - c->head.root_min[1]) * scale, 0.0f, last);
    const kl_u32 z = (kl_u32)kl_clamp((p.z - c->head.root_min[2]) * scale, 0.0f, last);
    const kl_u32 bits = c->head.top_bits;
    kl_u32 shift = KL_OCTREE_MAX_LEVEL - bits;
    kl_u32 entry = c->nodes[((z >> shift) << bits | y >> shift) << bits | x >> shift];
    while (!(entry & KL_NODE_LEAF)) {
        kl_u32 child = face;
        if (entry == KL_NODE_EMPTY) return KL_NONE;
        if (!(entry & KL_NODE_FACES)) {
            if (shift == 0u) return KL_NONE; /* no cache of ours */
            --shift;
            child = (x >> shift & 1u) | (y >> shift & 1u) << 1 | (z >> shift & 1u) << 2;
        }
        entry = c->nodes[(entry & KL_NODE_INDEX) + child];
    }
    return entry & ~KL_NODE_LEAF;
}

/* Cosine and sine of a record's axis angle: series good to 4e-6, the same on every compiler. */
KL_FN kl_vec2 kl_record_axis(kl_u32 form)
{
    const float v = kl_record_axis_angle(form) - 0.5f * KL_PI;
    const float v2 = v * v;
    kl_vec2 axis;
    axis.x =
        -v *
        (1.0f + v2 * (-1.0f / 6 + v2 * (1.0f / 120 + v2 * (-1.0f / 5040 + v2 * (1.0f / 362880)))));
    axis.y = 1.0f +
             v2 * (-0.5f + v2 * (1.0f / 24 +
                                 v2 * (-1.0f / 720 + v2 * (1.0f / 40320 - v2 * (1.0f / 3628800)))));
    return axis;
}

/* Weight of a record at point p with normal n; 0 where it does not apply. Elliptic hat of
 * Schwarzhaupt, Jensen, Jarosz 2012; behind test with the mean normal after Ward 1988. */
KL_FN float kl_record_weight(const KL_GLOBAL kl_record_hot *r, kl_vec3 p, kl_vec3 n,
                             const kl_query *q, kl_vec3 *offset, kl_frame *frame)
{
    const kl_vec3 d = kl_v3_sub(p, kl_v3_load(r->pos));
    const kl_vec3 ni = kl_oct_decode(r->normal);
    const float reach = q->reach * r->radius2;
    const float r1 = q->reach * r->radius;
    const float d2 = kl_dot(d, d);
    const float height = kl_dot(d, ni);
    const float cosine = kl_dot(n, ni);
    /* One branch that mispredicts instead of four. */
    const int applies = (d2 < reach * reach) & (cosine > q->cos_max) &
                        (kl_fabs(height) <= KL_SLAB * r1) &
                        (0.5f * (kl_dot(d, n) + height) >= -KL_BEHIND_TOLERANCE * r1);
    if (!applies) return 0.0f;
    *offset = d;
    *frame = kl_frame_from_normal(ni);
    const float steep = 1.0f / (r1 * r1);
    float t2 = d2 * steep;
    if (r->radius2 > r->radius) {
        const kl_vec2 axis = kl_record_axis(r->form);
        const float major = kl_dot(d, frame->b) * axis.x - kl_dot(d, frame->t) * axis.y;
        t2 -= major * major * (steep - 1.0f / (reach * reach));
    }
    return kl_fmax(0.0f, 1.0f - kl_sqrt(kl_fmax(t2, 0.0f))) * (cosine - q->cos_max) *
           (1.0f / (1.0f - q->cos_max));
}

/* One of KL_SECTORS azimuths for a direction in a record's frame: quadrant, then third of it. */
KL_FN kl_u32 kl_sector_of(float x, float y)
{
    const float ax = kl_fabs(x);
    const float ay = kl_fabs(y);
    const kl_u32 quadrant = (x < 0.0f ? 1u : 0u) + (y < 0.0f ? 2u : 0u);
    const kl_u32 third = (ay > 0.577350269f * ax ? 1u : 0u) + (ay > 1.732050808f * ax ? 1u : 0u);
    return 3u * quadrant + third;
}

#define KL_CLEARANCE_LEAST ((127u - 27u) * 8u) /* a float's upper bits: 2^-27 */

/* Square of what clearances are told in [m^2]. */
KL_FN float kl_clearance_unit2(const KL_GLOBAL kl_record_cold *c)
{
    const float spacing = kl_half_to_float(c->error_spacing >> 16); /* may exceed 1 */
    const float unit = kl_fmax(spacing, 1.0f) * c->raw_radius;
    return unit * unit;
}

/* Code of a squared distance [m^2], for comparison: steps of an eighth of an octave or less, from
 * 2^-13 to 5 times the largest radius that the record may be given. 0..254. */
KL_FN kl_u32 kl_clearance_code(const KL_GLOBAL kl_record_cold *c, float d2)
{
    const kl_u32 bits = kl_as_u32(kl_fmin(d2 / kl_clearance_unit2(c), 1e30f)) >> 20;
    const kl_u32 least = KL_CLEARANCE_LEAST;
    return bits <= least ? 0u : (bits - least < 254u ? bits - least : 254u);
}
/* Least distance [m] of a code: from there on a record with it is blocked. */
KL_FN float kl_clearance_distance(const KL_GLOBAL kl_record_cold *c, kl_u32 code)
{
    return kl_sqrt(kl_as_f32((code + KL_CLEARANCE_LEAST) << 20) * kl_clearance_unit2(c));
}

/* Is the horizon blocked between the record and a point at local offset (x, y)? Uses the distances
 * that the record's lowest gather rays found, so a thin wall stops the record without any ray. */
KL_FN int kl_record_is_blocked(const KL_GLOBAL kl_record_cold *c, float x, float y)
{
    const kl_u32 code = c->clearance[kl_sector_of(x, y)];
    if (code == 255u) return 0;
    return kl_clearance_code(c, x * x + y * y) >= code;
}

/* What the record says the irradiance is at an offset: first order in position and normal, as a
 * factor that is kept within bounds. Farther out than the radius that the record asked for (pixels
 * may be larger) its gradient is not followed. */
KL_FN kl_vec3 kl_record_extrapolate(const KL_GLOBAL kl_record_cold *c, const kl_frame *f,
                                    kl_vec3 offset, kl_vec3 n)
{
    const float length = kl_length(offset) / c->raw_radius;
    const float scale = kl_fmin(1.0f, KL_GRADIENT_REACH / kl_fmax(length, 1e-30f)) / c->raw_radius;
    const float x = kl_dot(offset, f->t) * scale;
    const float y = kl_dot(offset, f->b) * scale;
    const kl_vec3 turn = kl_cross(f->n, n);
    const float u = kl_dot(turn, f->t);
    const float v = kl_dot(turn, f->b);
    float e[3];
    for (int k = 0; k < 3; ++k) {
        const float g = 1.0f + kl_half_to_float(c->grad_t[2 * k]) * x +
                        kl_half_to_float(c->grad_t[2 * k + 1]) * y +
                        kl_half_to_float(c->grad_r[2 * k]) * u +
                        kl_half_to_float(c->grad_r[2 * k + 1]) * v;
        e[k] = c->irr[k] * kl_clamp(g, KL_MIN_EXTRAPOLATION, KL_MAX_EXTRAPOLATION);
    }
    return kl_v3(e[0], e[1], e[2]);
}

#define KL_CHUNK 16

/* Of the next KL_CHUNK records of a row, those whose radius reaches p; their number. No branches to
 * mispredict. *at moves on; KL_NONE behind the last. */
KL_FN kl_u32 kl_records_near(const kl_level_view *c, kl_u32 *at, kl_vec3 p, float reach2,
                             kl_u32 near[KL_CHUNK])
{
    kl_u32 found = 0;
    kl_u32 item = 0;
    for (kl_u32 k = 0; k < KL_CHUNK && !(item & KL_ROW_LAST); ++k) {
        item = c->rows[*at + k];
        const kl_u32 i = item & ~KL_ROW_LAST;
        const KL_GLOBAL kl_record_hot *r = &c->hot[i];
        const kl_vec3 d = kl_v3_sub(p, kl_v3_load(r->pos));
        near[found] = i;
        found += kl_dot(d, d) < reach2 * r->radius2 * r->radius2 ? 1u : 0u;
    }
    for (kl_u32 k = 0; k < found; ++k) {
        KL_PREFETCH(&c->cold[near[k]]);
    }
    *at = item & KL_ROW_LAST ? KL_NONE : *at + KL_CHUNK;
    return found;
}

KL_FN void kl_answer_add(const kl_level_view *c, const kl_query *q, kl_u32 i, kl_vec3 p, kl_vec3 n,
                         kl_vec3 bent, kl_answer *a)
{
    kl_vec3 offset;
    kl_frame f;
    const KL_GLOBAL kl_record_cold *cold = &c->cold[i];
    const float w = kl_record_weight(&c->hot[i], p, n, q, &offset, &f);
    if (!(w > 0.0f)) return;
    if (kl_record_is_blocked(cold, kl_dot(offset, f.t), kl_dot(offset, f.b))) return;
    /* Where a small record serves, a large one that reaches there knows less. */
    const float fine = c->head.side / c->hot[i].radius;
    const float share = w * fine * fine;
    const float error = kl_half_to_float(cold->error_spacing & 0xffffu);
    a->irr = kl_v3_mad(a->irr, share, kl_record_extrapolate(cold, &f, offset, bent));
    a->error += share * error * error;
    a->radius += share * c->hot[i].radius;
    a->weight += w;
    a->best = kl_fmax(a->best, w);
    a->shares += share;
    KL_NOTE_USE(c, i);
}

/* `n`: smooth normal, decides which records apply; `bent`: normal for which the irradiance is
 * wanted (normal map), reached through the rotational gradient. */
KL_FN kl_answer kl_cache_query(const kl_level_view *c, const kl_query *q, kl_vec3 p, kl_vec3 n,
                               kl_vec3 bent)
{
    kl_answer a;
    a.irr = kl_v3_splat(0.0f);
    a.weight = 0.0f;
    a.best = 0.0f;
    a.shares = 0.0f;
    a.error = 0.0f;
    a.radius = 0.0f;
    if (c->head.record_count == 0u) return a;
    kl_u32 at = kl_octree_row(c, p, kl_normal_face(n));
    while (at != KL_NONE && a.weight < q->enough) {
        kl_u32 near[KL_CHUNK];
        const kl_u32 found = kl_records_near(c, &at, p, q->reach * q->reach, near);
        for (kl_u32 k = 0; k < found; ++k) {
            kl_answer_add(c, q, near[k], p, n, bent, &a);
        }
    }
    if (a.weight > 0.0f) {
        a.irr = kl_v3_scale(a.irr, 1.0f / a.shares);
        a.error = kl_sqrt(a.error / a.shares);
        a.radius /= a.shares;
    }
    return a;
}

#endif
