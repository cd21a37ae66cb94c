/* Interpolated irradiance from the records around a point. No stack, no pointers: the same on the
 * host and on devices. */
#ifndef KL_KERNELS_CACHE_QUERY_H
#define KL_KERNELS_CACHE_QUERY_H
#include "kernels/cache_data.h"
#include "kernels/lanes.h"
#include "kernels/sampling.h"

#define KL_BEHIND_TOLERANCE  0.01f /* of the radius: Ward 1988, relative here; decision 0028 */
#define KL_SLAB              0.4f  /* height above the record's plane, in radii: same surface */
#define KL_STEEPEST          0.35f /* of a chord over the record's plane: normals turn by 0.35 */
#define KL_FLAT              0.02f /* height that may be anything, in radii */
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
    float way;    /* [m] along the surface, from the records' weighted mean place to the point */
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

/* One of KL_SECTORS azimuths for a direction in a record's frame: quadrant, then third of it. */
KL_FN kl_u32 kl_sector_of(float x, float y)
{
    const float ax = kl_fabs(x);
    const float ay = kl_fabs(y);
    const kl_u32 quadrant = (x < 0.0f ? 1u : 0u) + (y < 0.0f ? 2u : 0u);
    const kl_u32 third = (ay > 0.577350269f * ax ? 1u : 0u) + (ay > 1.732050808f * ax ? 1u : 0u);
    return 3u * quadrant + third;
}

/* A point and its normals as a record sees them. */
typedef struct kl_bearing {
    float weight;  /* 0: the record does not apply */
    float x, y;    /* [m] of the point, along the record's tangents */
    float u, v;    /* turn from the record's normal to `bent`, about these tangents */
    float inverse; /* [1/m] of the distance */
    kl_u32 sector; /* azimuth, for the leak test */
} kl_bearing;

/* Bearing of a point at distance d from a record with normal `ni`. Weight: elliptic hat of
 * Schwarzhaupt, Jensen, Jarosz 2012; behind test with the mean normal after Ward 1988; fades out
 * before the height at which another surface begins (0030, 0032). No branches: the host asks
 * several records at once. */
KL_FN kl_bearing kl_bearing_of(kl_vec3 d, kl_vec3 ni, float radius, float radius2, kl_u32 form,
                               const kl_query *q, kl_vec3 n, kl_vec3 bent)
{
    const kl_frame f = kl_frame_from_normal(ni);
    const kl_vec2 axis = kl_record_axis(form);
    const float r1 = q->reach * radius;
    const float r2 = q->reach * radius2;
    const float d2 = kl_dot(d, d);
    const float height = kl_dot(d, ni);
    const float cosine = kl_dot(n, ni);
    kl_bearing b;
    b.inverse = 1.0f / kl_sqrt(kl_fmax(d2, 1e-37f));
    const float most = kl_fmin(KL_SLAB * r1, KL_STEEPEST * (d2 * b.inverse) + KL_FLAT * r1);
    const float apart = height * height / (most * most); /* 1: another surface */
    const float apart4 = apart * apart * apart * apart;
    const int applies = (d2 < r2 * r2) & (cosine > q->cos_max) & (apart < 1.0f) &
                        (0.5f * (kl_dot(d, n) + height) >= -KL_BEHIND_TOLERANCE * r1);
    b.x = kl_dot(d, f.t);
    b.y = kl_dot(d, f.b);
    b.u = -kl_dot(bent, f.b);
    b.v = kl_dot(bent, f.t);
    b.sector = kl_sector_of(b.x, b.y);
    const float steep = 1.0f / (r1 * r1);
    const float major = b.y * axis.x - b.x * axis.y;
    const float t2 = d2 * steep - major * major * (steep - 1.0f / (r2 * r2));
    const float hat = kl_fmax(0.0f, 1.0f - kl_sqrt(kl_fmax(t2, 0.0f)));
    const float alike = (cosine - q->cos_max) * (1.0f / (1.0f - q->cos_max));
    b.weight = applies ? hat * alike * (1.0f - apart4) : 0.0f;
    return b;
}

/* The same, of one record. */
KL_FN kl_bearing kl_record_bearing(const KL_GLOBAL kl_record_hot *r, const kl_query *q, kl_vec3 p,
                                   kl_vec3 n)
{
    const kl_vec3 d = kl_v3_sub(p, kl_v3_load(r->pos));
    return kl_bearing_of(d, kl_oct_decode(r->normal), r->radius, r->radius2, r->form, q, n, n);
}

#define KL_CLEARANCE_LEAST ((127u - 27u) * 8u) /* a float's upper bits: 2^-27 */

/* Square of what clearances are told in [m^2]. */
KL_FN float kl_clearance_unit2(kl_u32 error_spacing, float raw_radius)
{
    const float spacing = kl_half_to_float(error_spacing >> 16); /* may exceed 1 */
    const float unit = kl_fmax(spacing, 1.0f) * raw_radius;
    return unit * unit;
}

/* Code of a squared distance [m^2], for comparison: steps of an eighth of an octave or less, from
 * 2^-13 to 5 times the largest radius that the record may be given. 0..254. */
KL_FN kl_u32 kl_clearance_code(float unit2, float d2)
{
    const kl_u32 bits = kl_as_u32(kl_fmin(d2 / unit2, 1e30f)) >> 20;
    const kl_u32 least = KL_CLEARANCE_LEAST;
    return bits <= least ? 0u : (bits - least < 254u ? bits - least : 254u);
}
/* Square of the least distance of a code [m^2]: from there on a record with it is blocked. */
KL_FN float kl_clearance_distance2(float unit2, kl_u32 code)
{
    return kl_as_f32((code + KL_CLEARANCE_LEAST) << 20) * unit2;
}

/* Is the horizon blocked between the record and a point in its plane at squared distance d2 [m^2]?
 * Uses the distances that the record's lowest gather rays found, so a thin wall stops the record
 * without any ray. */
KL_FN int kl_is_blocked(kl_u32 code, float unit2, float d2)
{
    return (code != 255u) & ((code == 0u) | (d2 >= kl_clearance_distance2(unit2, code)));
}
KL_FN int kl_record_is_blocked(const KL_GLOBAL kl_record_cold *c, const kl_bearing *b)
{
    const float unit2 = kl_clearance_unit2(c->error_spacing, c->raw_radius);
    return kl_is_blocked(c->clearance[b->sector], unit2, b->x * b->x + b->y * b->y);
}

/* Halves 2 * i and 2 * i + 1 of a record's gradients. */
KL_FN kl_u32 kl_gradient_pair(const KL_GLOBAL kl_record_cold *c, int i)
{
    return c->grad[2 * i] | (kl_u32)c->grad[2 * i + 1] << 16;
}

/* A pair of a record's components times (x, y). */
KL_FN float kl_pair_dot(kl_u32 pair, float x, float y)
{
    return kl_half_to_float(pair & 0xffffu) * x + kl_half_to_float(pair >> 16) * y;
}

/* What to multiply translational gradients by, which are told times the raw radius [1/m]. Farther
 * out than the radius that the record asked for (pixels may be larger) they are not followed.
 * `inverse`: of the distance. */
KL_FN float kl_gradient_scale(float raw_radius, float inverse)
{
    return kl_fmin(1.0f / raw_radius, KL_GRADIENT_REACH * inverse);
}

/* What a record says that irradiance gains on half of the way to a bearing and half of the turn,
 * over what it has itself, in one channel: first order. The other half goes by gradients at the
 * other end. `scale`: kl_gradient_scale. The bearing comes by value: with its address taken GCC 12
 * does not turn the loop over lanes into vectors. */
KL_FN float kl_half_gain(kl_u32 along, kl_u32 turn, float scale, kl_bearing b)
{
    return 0.5f * (scale * kl_pair_dot(along, b.x, b.y) + kl_pair_dot(turn, b.u, b.v));
}

/* Irradiance with a relative gain, which is kept within bounds. */
KL_FN float kl_with_gain(float irr, float gain)
{
    return irr * kl_clamp(1.0f + gain, KL_MIN_EXTRAPOLATION, KL_MAX_EXTRAPOLATION);
}

/* kl_half_gain of all channels. */
KL_FN kl_vec3 kl_record_half_gain(const KL_GLOBAL kl_record_cold *c, kl_bearing b)
{
    const float scale = kl_gradient_scale(c->raw_radius, b.inverse);
    float gain[3];
    for (int i = 0; i < 3; ++i) {
        gain[i] = kl_half_gain(kl_gradient_pair(c, i), kl_gradient_pair(c, 3 + i), scale, b);
    }
    return kl_v3(gain[0], gain[1], gain[2]);
}

/* A record's irradiance with relative gains. */
KL_FN kl_vec3 kl_record_with_gain(const KL_GLOBAL kl_record_cold *c, kl_vec3 gain)
{
    return kl_v3(kl_with_gain(c->irr[0], gain.x), kl_with_gain(c->irr[1], gain.y),
                 kl_with_gain(c->irr[2], gain.z));
}

/* Words of a record, hot and cold. */
enum {
    KL_HOT_POS = 0,
    KL_HOT_NORMAL = 3,
    KL_HOT_RADIUS = 4,
    KL_HOT_RADIUS2 = 5,
    KL_HOT_FORM = 6,
    KL_HOT_WORDS = 8,
    KL_COLD_IRR = 0,
    KL_COLD_GRAD = 3,
    KL_COLD_RAW_RADIUS = 9,
    KL_COLD_ERROR_SPACING = 10,
    KL_COLD_CLEARANCE = 11,
    KL_COLD_WORDS = 16,
};

#define KL_GROUP 8u /* records that are asked together, before looking whether they are enough */

/* The next KL_GROUP records of a row whose radius reaches p, fewer at its end; their number. No
 * branches to mispredict. *at moves on; KL_NONE behind the last. */
KL_FN kl_u32 kl_records_near(const kl_level_view *c, kl_u32 *at, kl_vec3 p, float reach2,
                             kl_u32 near[KL_GROUP])
{
    kl_u32 found = 0;
    kl_u32 item = 0;
    kl_u32 next = *at;
    while (found < KL_GROUP && !(item & KL_ROW_LAST)) {
        item = c->rows[next++];
        const kl_u32 i = item & ~KL_ROW_LAST;
        const KL_GLOBAL kl_record_hot *r = &c->hot[i];
        const kl_vec3 d = kl_v3_sub(p, kl_v3_load(r->pos));
        near[found] = i;
        found += kl_dot(d, d) < reach2 * r->radius2 * r->radius2 ? 1u : 0u;
    }
    for (kl_u32 k = 0; k < found; ++k) {
        KL_PREFETCH(&c->cold[near[k]]);
    }
    *at = item & KL_ROW_LAST ? KL_NONE : next;
    return found;
}

/* Bearings from KL_LANES records. */
typedef struct kl_lanes {
    float radius[KL_LANES];
    float share[KL_LANES]; /* weight over squared radius, in edges of the root */
    float weight[KL_LANES], x[KL_LANES], y[KL_LANES], u[KL_LANES], v[KL_LANES], inverse[KL_LANES];
    float dx[KL_LANES], dy[KL_LANES]; /* way to the point, in the point's frame */
    float nx[KL_LANES], ny[KL_LANES]; /* way from the record's normal to `bent`, likewise */
    float tx[KL_LANES], ty[KL_LANES]; /* the record's tangents, likewise */
    float bx[KL_LANES], by[KL_LANES];
    kl_u32 sector[KL_LANES];
} kl_lanes;

KL_FN void kl_lanes_weigh(const kl_level_view *c, const kl_u32 *records, const kl_query *q,
                          kl_vec3 p, const kl_frame *at, kl_vec3 bent, kl_lanes *l)
{
    kl_columns hot;
    kl_columns_load(c->hot, KL_HOT_WORDS, 0, records, &hot);
    KL_SIMD
    for (kl_u32 k = 0; k < KL_LANES; ++k) {
        const kl_vec3 d = kl_v3(p.x - kl_as_f32(hot.at[KL_HOT_POS][k]),
                                p.y - kl_as_f32(hot.at[KL_HOT_POS + 1][k]),
                                p.z - kl_as_f32(hot.at[KL_HOT_POS + 2][k]));
        const float radius = kl_as_f32(hot.at[KL_HOT_RADIUS][k]);
        const kl_vec3 ni = kl_oct_decode(hot.at[KL_HOT_NORMAL][k]);
        const kl_frame f = kl_frame_from_normal(ni);
        const kl_bearing b = kl_bearing_of(d, ni, radius, kl_as_f32(hot.at[KL_HOT_RADIUS2][k]),
                                           hot.at[KL_HOT_FORM][k], q, at->n, bent);
        /* Where a small record serves, a large one that reaches there knows less. */
        const float fine = c->head.side / radius;
        l->radius[k] = radius;
        l->share[k] = b.weight * fine * fine;
        l->weight[k] = b.weight;
        l->x[k] = b.x;
        l->y[k] = b.y;
        l->u[k] = b.u;
        l->v[k] = b.v;
        l->inverse[k] = b.inverse;
        l->sector[k] = b.sector;
        l->tx[k] = kl_dot(f.t, at->t);
        l->ty[k] = kl_dot(f.t, at->b);
        l->bx[k] = kl_dot(f.b, at->t);
        l->by[k] = kl_dot(f.b, at->b);
        l->dx[k] = kl_dot(d, at->t);
        l->dy[k] = kl_dot(d, at->b);
        l->nx[k] = kl_dot(bent, at->t) - kl_dot(ni, at->t);
        l->ny[k] = kl_dot(bent, at->b) - kl_dot(ni, at->b);
    }
}

KL_FN int kl_lanes_serve(const kl_lanes *l)
{
    int any = 0;
    for (kl_u32 k = 0; k < KL_LANES; ++k) {
        any |= l->weight[k] > 0.0f;
    }
    return any;
}

/* What KL_LANES records add to an answer in one channel: shares times what they say. */
typedef struct kl_channel_terms {
    float irr[KL_LANES];
    float x[KL_LANES], y[KL_LANES]; /* gradient by position, in the point's frame */
    float u[KL_LANES], v[KL_LANES]; /* gradient by the normal, likewise */
} kl_channel_terms;

typedef struct kl_terms {
    kl_channel_terms red, green, blue;
    float dx[KL_LANES], dy[KL_LANES]; /* ways to the point */
    float nx[KL_LANES], ny[KL_LANES]; /* ways to its normal */
    float error[KL_LANES];            /* squared */
    float radius[KL_LANES];
} kl_terms;

/* One channel of lane k, with irradiance `irr` and gradients `along` and `turn`. */
KL_FN void kl_lane_say(const kl_lanes *l, kl_u32 k, float share, float scale, kl_bearing b,
                       float irr, kl_u32 along, kl_u32 turn, kl_channel_terms *out)
{
    const float much = share * irr;
    out->irr[k] = share * kl_with_gain(irr, kl_half_gain(along, turn, scale, b));
    out->x[k] = much * scale * kl_pair_dot(along, l->tx[k], l->bx[k]);
    out->y[k] = much * scale * kl_pair_dot(along, l->ty[k], l->by[k]);
    out->u[k] = much * kl_pair_dot(turn, -l->bx[k], l->tx[k]);
    out->v[k] = much * kl_pair_dot(turn, -l->by[k], l->ty[k]);
}

/* The records at their bearings; shares and weights of those that are blocked become 0. */
KL_FN void kl_lanes_extrapolate(const kl_level_view *c, const kl_u32 *records, kl_lanes *l,
                                kl_terms *terms)
{
    kl_columns head;
    kl_columns tail;
    kl_columns_load(c->cold, KL_COLD_WORDS, 0, records, &head);
    kl_columns_load(c->cold, KL_COLD_WORDS, 8, records, &tail);
    KL_SIMD
    for (kl_u32 k = 0; k < KL_LANES; ++k) {
        const kl_bearing b = {l->weight[k], l->x[k],       l->y[k],     l->u[k],
                              l->v[k],      l->inverse[k], l->sector[k]};
        const float raw_radius = kl_as_f32(tail.at[KL_COLD_RAW_RADIUS - 8][k]);
        const kl_u32 error_spacing = tail.at[KL_COLD_ERROR_SPACING - 8][k];
        const float unit2 = kl_clearance_unit2(error_spacing, raw_radius);
        const kl_u32 codes = b.sector < 4u   ? tail.at[KL_COLD_CLEARANCE - 8][k]
                             : b.sector < 8u ? tail.at[KL_COLD_CLEARANCE - 7][k]
                                             : tail.at[KL_COLD_CLEARANCE - 6][k];
        const kl_u32 code = codes >> 8u * (b.sector & 3u) & 255u;
        const int blocked = kl_is_blocked(code, unit2, b.x * b.x + b.y * b.y);
        const float share = blocked ? 0.0f : l->share[k];
        const float error = kl_half_to_float(error_spacing & 0xffffu);
        const float red = kl_as_f32(head.at[KL_COLD_IRR][k]);
        const float green = kl_as_f32(head.at[KL_COLD_IRR + 1][k]);
        const float blue = kl_as_f32(head.at[KL_COLD_IRR + 2][k]);
        l->share[k] = share;
        l->weight[k] = blocked ? 0.0f : b.weight;
        const float scale = kl_gradient_scale(raw_radius, b.inverse);
        kl_lane_say(l, k, share, scale, b, red, head.at[KL_COLD_GRAD][k],
                    head.at[KL_COLD_GRAD + 3][k], &terms->red);
        kl_lane_say(l, k, share, scale, b, green, head.at[KL_COLD_GRAD + 1][k],
                    head.at[KL_COLD_GRAD + 4][k], &terms->green);
        kl_lane_say(l, k, share, scale, b, blue, head.at[KL_COLD_GRAD + 2][k],
                    tail.at[KL_COLD_GRAD + 5 - 8][k], &terms->blue);
        terms->dx[k] = share * l->dx[k];
        terms->dy[k] = share * l->dy[k];
        terms->nx[k] = share * l->nx[k];
        terms->ny[k] = share * l->ny[k];
        terms->error[k] = share * error * error;
        terms->radius[k] = share * l->radius[k];
    }
}

/* By position and by the normal, in the point's frame: a gradient, or a way. */
typedef struct kl_slope {
    float x, y, u, v;
} kl_slope;

/* Sums over records: shares times gradients, and times ways from records to the point. */
typedef struct kl_slopes {
    kl_slope red, green, blue;
    kl_slope way;
} kl_slopes;

KL_FN void kl_channel_add(const kl_channel_terms *terms, kl_u32 k, float *irr, kl_slope *s)
{
    *irr += terms->irr[k];
    s->x += terms->x[k];
    s->y += terms->y[k];
    s->u += terms->u[k];
    s->v += terms->v[k];
}

KL_FN void kl_answer_add(const kl_lanes *l, const kl_terms *terms, kl_u32 count, kl_answer *a,
                         kl_slopes *s)
{
    for (kl_u32 k = 0; k < count; ++k) {
        kl_channel_add(&terms->red, k, &a->irr.x, &s->red);
        kl_channel_add(&terms->green, k, &a->irr.y, &s->green);
        kl_channel_add(&terms->blue, k, &a->irr.z, &s->blue);
        s->way.x += terms->dx[k];
        s->way.y += terms->dy[k];
        s->way.u += terms->nx[k];
        s->way.v += terms->ny[k];
        a->error += terms->error[k];
        a->radius += terms->radius[k];
        a->weight += l->weight[k];
        a->best = kl_fmax(a->best, l->weight[k]);
        a->shares += l->share[k];
    }
}

/* A channel's mean irradiance and the other half of the mean way, by the mean gradient. Of a field
 * of second order that leaves d^T H d / 2, d being the mean way; own gradients alone leave that and
 * the spread of ways about it (decision 0031). `each`: 1 over the sum of shares. */
KL_FN float kl_answer_bend(float irr, const kl_slope *gradient, const kl_slope *way, float each)
{
    const float gain =
        (each * gradient->x) * (each * way->x) + (each * gradient->y) * (each * way->y) +
        (each * gradient->u) * (each * way->u) + (each * gradient->v) * (each * way->v);
    return kl_clamp(irr + 0.5f * gain, KL_MIN_EXTRAPOLATION * irr, KL_MAX_EXTRAPOLATION * irr);
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
    a.way = 0.0f;
    if (c->head.record_count == 0u) return a;
    const kl_frame frame = kl_frame_from_normal(n);
    const kl_slope flat = {0.0f, 0.0f, 0.0f, 0.0f};
    kl_slopes slopes = {flat, flat, flat, flat};
    kl_u32 at = kl_octree_row(c, p, kl_normal_face(n));
    while (at != KL_NONE && a.weight < q->enough) {
        kl_u32 near[KL_GROUP];
        const kl_u32 found = kl_records_near(c, &at, p, q->reach * q->reach, near);
        for (kl_u32 k = found; k < KL_GROUP; ++k) {
            near[k] = near[0]; /* lanes that nobody listens to */
        }
        for (kl_u32 first = 0; first < found; first += KL_LANES) {
            const kl_u32 count = found - first < KL_LANES ? found - first : KL_LANES;
            kl_lanes l;
            kl_terms terms;
            kl_lanes_weigh(c, near + first, q, p, &frame, bent, &l);
            if (!kl_lanes_serve(&l)) continue;
            kl_lanes_extrapolate(c, near + first, &l, &terms);
            kl_answer_add(&l, &terms, count, &a, &slopes);
            for (kl_u32 k = 0; k < count; ++k) {
                if (l.weight[k] > 0.0f) KL_NOTE_USE(c, near[first + k]);
            }
        }
    }
    if (a.weight > 0.0f) {
        const float each = 1.0f / a.shares;
        a.irr = kl_v3_scale(a.irr, each);
        a.irr.x = kl_answer_bend(a.irr.x, &slopes.red, &slopes.way, each);
        a.irr.y = kl_answer_bend(a.irr.y, &slopes.green, &slopes.way, each);
        a.irr.z = kl_answer_bend(a.irr.z, &slopes.blue, &slopes.way, each);
        a.error = kl_sqrt(a.error * each);
        a.radius *= each;
        a.way = each * kl_sqrt(slopes.way.x * slopes.way.x + slopes.way.y * slopes.way.y);
    }
    return a;
}

#endif
