/* Interpolated irradiance from the records around a point. No stack, no pointers: the same on the
 * host and on devices. */
#ifndef KL_KERNELS_CACHE_QUERY_H
#define KL_KERNELS_CACHE_QUERY_H
#include "kernels/cache_data.h"
#include "kernels/sampling.h"

#define KL_OCTREE_MAX_LEVEL  17
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

/* 32 bits of hash for a cell, never 0. `kind`: 8 * level + face. */
KL_FN kl_u32 kl_cell_tag(kl_u32 kind, kl_i32 x, kl_i32 y, kl_i32 z, kl_u32 salt)
{
    kl_u32 h = kl_hash((kl_u32)x + salt);
    h = kl_hash(h ^ ((kl_u32)y * 0x9e3779b1u));
    h = kl_hash(h ^ ((kl_u32)z * 0x85ebca77u) ^ (kind << 24));
    return h ? h : 1u;
}
/* 32 more bits: the first word of the cell's row. */
KL_FN kl_u32 kl_cell_check(kl_u32 kind, kl_i32 x, kl_i32 y, kl_i32 z)
{
    return kl_hash((kl_u32)x * 0xc2b2ae3du +
                   kl_hash((kl_u32)y * 0x27d4eb2fu + kl_hash((kl_u32)z + (kind << 24))));
}

/* Row of a cell (its count and records), or KL_NONE. */
KL_FN kl_u32 kl_octree_find(const kl_level_view *c, kl_u32 kind, kl_i32 x, kl_i32 y, kl_i32 z)
{
    const kl_u32 mask = c->head.slot_count - 1u;
    const kl_u32 tag = kl_cell_tag(kind, x, y, z, c->head.salt);
    kl_u32 i = tag & mask;
    for (kl_u32 n = 0; n <= mask; ++n) {
        const kl_u32 here = c->slots[i].tag;
        if (here == tag && c->rows[c->slots[i].row] == kl_cell_check(kind, x, y, z)) {
            return c->slots[i].row + 1u;
        }
        if (here == 0u) return KL_NONE;
        i = (i + 1u) & mask;
    }
    return KL_NONE;
}

/* Weight of a record at point p with normal n; 0 where it does not apply. Elliptic hat of
 * Schwarzhaupt, Jensen, Jarosz 2012; behind test with the mean normal after Ward 1988. */
KL_FN float kl_record_weight(const KL_GLOBAL kl_record_hot *r, kl_vec3 p, kl_vec3 n,
                             const kl_query *q, kl_vec3 *offset, kl_vec3 *normal)
{
    const kl_vec3 d = kl_v3_sub(p, kl_v3_load(r->pos));
    const float reach = q->reach * r->radius2;
    const float d2 = kl_dot(d, d);
    if (!(d2 < reach * reach)) return 0.0f;
    const kl_vec3 ni = kl_oct_decode(r->normal);
    const float cosine = kl_dot(n, ni);
    if (!(cosine > q->cos_max)) return 0.0f;
    const float r1 = q->reach * r->radius;
    if (kl_fabs(kl_dot(d, ni)) > KL_SLAB * r1) return 0.0f;
    if (0.5f * (kl_dot(d, n) + kl_dot(d, ni)) < -KL_BEHIND_TOLERANCE * r1) return 0.0f;
    float t2 = d2 / (r1 * r1);
    if (r->radius2 > r->radius) {
        const kl_frame f = kl_frame_from_normal(ni);
        const float angle = kl_record_axis_angle(r->form);
        const float x = kl_dot(d, f.t);
        const float y = kl_dot(d, f.b);
        const float major = y * kl_cos(angle) - x * kl_sin(angle);
        t2 -= major * major * (1.0f / (r1 * r1) - 1.0f / (reach * reach));
    }
    *offset = d;
    *normal = ni;
    return kl_fmax(0.0f, 1.0f - kl_sqrt(kl_fmax(t2, 0.0f))) * (cosine - q->cos_max) /
           (1.0f - q->cos_max);
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

/* Code of a squared distance [m^2], for comparison: steps of an eighth of an octave or less, from
 * 2^-13 to 5 times the largest radius that the record may be given. 0..254. */
KL_FN kl_u32 kl_clearance_code(const KL_GLOBAL kl_record_cold *c, float d2)
{
    const float spacing = kl_half_to_float(c->error_spacing >> 16); /* may exceed 1 */
    const float unit = kl_fmax(spacing, 1.0f) * c->raw_radius;
    const kl_u32 bits = kl_as_u32(kl_fmin(d2 / (unit * unit), 1e30f)) >> 20;
    const kl_u32 least = (127u - 27u) * 8u;
    return bits <= least ? 0u : (bits - least < 254u ? bits - least : 254u);
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

/* Levels that have anything near a point, given relative to the root's corner. */
KL_FN kl_u32 kl_octree_levels(const kl_level_view *c, kl_vec3 rel)
{
    const float cells = (float)(1 << KL_DIRECTORY_BITS);
    const float scale = cells / c->head.side;
    const kl_u32 x = (kl_u32)kl_clamp(rel.x * scale, 0.0f, cells - 1.0f);
    const kl_u32 y = (kl_u32)kl_clamp(rel.y * scale, 0.0f, cells - 1.0f);
    const kl_u32 z = (kl_u32)kl_clamp(rel.z * scale, 0.0f, cells - 1.0f);
    return c->rows[(z << (2 * KL_DIRECTORY_BITS)) | (y << KL_DIRECTORY_BITS) | x];
}

/* Rows that hold what is near a point, finest level first; their number. */
KL_FN kl_u32 kl_octree_rows(const kl_level_view *c, kl_vec3 p, kl_u32 face,
                            kl_u32 rows[KL_OCTREE_MAX_LEVEL + 1])
{
    const kl_vec3 rel =
        kl_v3_sub(p, kl_v3(c->head.root_min[0], c->head.root_min[1], c->head.root_min[2]));
    const kl_u32 levels = kl_octree_levels(c, rel);
    kl_u32 count = 0;
    for (kl_u32 level = KL_OCTREE_MAX_LEVEL + 1u; level-- > 0u;) {
        if (!((levels >> level) & 1u)) continue;
        const float scale = (float)(1u << level) / c->head.side;
        const kl_u32 row =
            kl_octree_find(c, 8u * level + face, (kl_i32)kl_floor(rel.x * scale),
                           (kl_i32)kl_floor(rel.y * scale), (kl_i32)kl_floor(rel.z * scale));
        if (row == KL_NONE) continue;
        KL_PREFETCH(&c->hot[c->rows[row + 1u]]);
        rows[count++] = row;
    }
    return count;
}

#define KL_CHUNK 16

/* Of up to KL_CHUNK records, those whose radius reaches p; their number. No branches to mispredict,
 * and what the next step reads is on its way. */
KL_FN kl_u32 kl_records_near(const kl_level_view *c, const KL_GLOBAL kl_u32 *row, kl_u32 count,
                             kl_vec3 p, float reach2, kl_u32 near[KL_CHUNK])
{
    kl_u32 found = 0;
    for (kl_u32 k = 0; k < count; ++k) {
        const KL_GLOBAL kl_record_hot *r = &c->hot[row[k]];
        const kl_vec3 d = kl_v3_sub(p, kl_v3_load(r->pos));
        near[found] = row[k];
        KL_PREFETCH(&c->cold[row[k]]);
        found += kl_dot(d, d) < reach2 * r->radius2 * r->radius2 ? 1u : 0u;
    }
    return found;
}

KL_FN void kl_answer_add(const kl_level_view *c, const kl_query *q, kl_u32 i, kl_vec3 p, kl_vec3 n,
                         kl_vec3 bent, kl_answer *a)
{
    kl_vec3 offset, normal;
    const KL_GLOBAL kl_record_cold *cold = &c->cold[i];
    const float w = kl_record_weight(&c->hot[i], p, n, q, &offset, &normal);
    if (!(w > 0.0f)) return;
    const kl_frame f = kl_frame_from_normal(normal);
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
    kl_u32 rows[KL_OCTREE_MAX_LEVEL + 1];
    kl_answer a;
    a.irr = kl_v3_splat(0.0f);
    a.weight = 0.0f;
    a.best = 0.0f;
    a.shares = 0.0f;
    a.error = 0.0f;
    a.radius = 0.0f;
    if (c->head.record_count == 0u) return a;
    const kl_u32 found = kl_octree_rows(c, p, kl_normal_face(n), rows);
    for (kl_u32 r = 0; r < found && a.weight < q->enough; ++r) {
        const KL_GLOBAL kl_u32 *row = c->rows + rows[r] + 1u;
        const kl_u32 count = c->rows[rows[r]];
        for (kl_u32 first = 0; first < count; first += KL_CHUNK) {
            kl_u32 near[KL_CHUNK];
            const kl_u32 size = count - first < KL_CHUNK ? count - first : KL_CHUNK;
            const kl_u32 n_near =
                kl_records_near(c, row + first, size, p, q->reach * q->reach, near);
            for (kl_u32 k = 0; k < n_near; ++k) {
                kl_answer_add(c, q, near[k], p, n, bent, &a);
            }
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
