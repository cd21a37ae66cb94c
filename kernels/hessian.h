/* Second derivative of the irradiance with respect to the position, from the samples of one
 * hemisphere: the occlusion-aware Hessian of Schwarzhaupt, Jensen and Jarosz, "Practical
 * Hessian-based error control for irradiance caching" (2012).
 *
 * Neighbouring samples are joined to triangles, each with the radiance of its farthest vertex, so
 * that what is hidden behind an edge appears as the record moves. A skirt down to the tangent plane
 * closes the rim: without it the border of the triangles would act as a black edge.
 *
 * With unit directions d to the ends of an edge, inverse distances u, and everything seen from the
 * record, the Hessian of a triangle's irradiance is a sum over its edges of line integrals whose
 * integrands are polynomials in d(t) and u(t), t the angle along the edge. Both are sines in t, so
 * two Gauss points do; nothing cancels, and u = 0 is an open sky. */
#ifndef KL_KERNELS_HESSIAN_H
#define KL_KERNELS_HESSIAN_H
#include "kernels/gather.h"

#define KL_HESSIAN_FLOOR 0.01f /* share of the mean radiance that every triangle has */

typedef struct kl_corner {
    kl_vec3 dir;    /* unit, unrotated record frame */
    float inverse;  /* 1 / distance [1/m], 0: open sky */
    float radiance; /* luminance, for comparison of triangles */
} kl_corner;

/* What turns samples into corners. */
typedef struct kl_hessian_input {
    const KL_GLOBAL kl_gather_cell *cells;
    const KL_GLOBAL kl_direction *dirs;
    kl_u32 side;
    float scale, base; /* luminance is base + scale * what the sample has */
} kl_hessian_input;

KL_FN kl_corner kl_corner_at(const kl_hessian_input *in, kl_u32 x, kl_u32 y)
{
    const kl_u32 i = y * in->side + x;
    const float px = in->dirs[i].x;
    const float py = in->dirs[i].y;
    kl_corner c;
    c.dir = kl_v3(px, py, kl_sqrt(kl_fmax(0.0f, 1.0f - px * px - py * py)));
    c.inverse = kl_cell_inverse(&in->cells[i]);
    c.radiance = in->base + in->scale * kl_cell_luminance(&in->cells[i]);
    return c;
}

/* Straight down from a corner onto the tangent plane. */
KL_FN kl_corner kl_corner_below(const kl_corner *c)
{
    const float across = kl_sqrt(c->dir.x * c->dir.x + c->dir.y * c->dir.y);
    kl_corner below = *c;
    below.dir = kl_v3(c->dir.x / across, c->dir.y / across, 0.0f);
    below.inverse = c->inverse / across;
    return below;
}

KL_FN float kl_farthest(const kl_corner *a, const kl_corner *b, const kl_corner *c)
{
    const kl_corner *far = b->inverse < a->inverse ? b : a;
    return c->inverse < far->inverse ? c->radiance : far->radiance;
}

/* Add `step` times the integral along the edge a -> b to h = (xx, xy, yy). */
KL_FN void kl_hessian_edge(const kl_corner *a, const kl_corner *b, float step, float h[3])
{
    const kl_vec3 cross = kl_cross(a->dir, b->dir);
    const float sine = kl_length(cross);
    if (step == 0.0f || !(sine > 1e-6f)) return;
    const kl_vec3 chord = kl_v3_sub(b->dir, a->dir);
    const float q = 0.25f * kl_dot(chord, chord); /* sin^2 of half the angle */
    const float angle =
        2.0f * kl_sqrt(q) * (1.0f + q * (1.0f / 6.0f + q * (3.0f / 40.0f + q * (15.0f / 336.0f))));
    const float bend = angle * angle * (1.0f / 6.0f);
    const float near = 0.788675135f; /* Gauss points of two */
    const float far = 0.211324865f;
    const float wn = near * (1.0f + bend * (1.0f - near * near)); /* sin(near angle) / sine */
    const float wf = far * (1.0f + bend * (1.0f - far * far));
    const float vx = (a->inverse * b->dir.x - b->inverse * a->dir.x) / sine;
    const float vy = (a->inverse * b->dir.y - b->inverse * a->dir.y) / sine;
    const float up = cross.z / sine;
    float wx = 0.0f;
    float wy = 0.0f;
    float xx = 0.0f;
    float xy = 0.0f;
    float yy = 0.0f;
    for (int k = 0; k < 2; ++k) {
        const float wa = k ? wf : wn;
        const float wb = k ? wn : wf;
        const float x = wa * a->dir.x + wb * b->dir.x;
        const float y = wa * a->dir.y + wb * b->dir.y;
        const float u = wa * a->inverse + wb * b->inverse;
        wx += u * x;
        wy += u * y;
        xx += u * u * (4.0f * x * x - 1.0f);
        xy += u * u * (4.0f * x * y);
        yy += u * u * (4.0f * y * y - 1.0f);
    }
    const float f = 0.5f * angle * step;
    h[0] += f * (up * xx - 2.0f * vy * wx);
    h[1] += f * (up * xy - vy * wy + vx * wx);
    h[2] += f * (up * yy + 2.0f * vx * wy);
}

/* The edges that start or end in the quad at (x, y) and the quads before it. The square is split
 * along its diagonal (x, y) - (x + 1, y + 1). */
KL_FN void kl_hessian_quads(const kl_hessian_input *in, float h[3])
{
    const kl_u32 last = in->side - 1u;
    for (kl_u32 y = 0; y <= last; ++y) {
        float row[3] = {0.0f, 0.0f, 0.0f};
        float left = 0.0f; /* radiance of the triangle left of the vertical edge */
        kl_corner c00 = kl_corner_at(in, 0u, y);
        kl_corner c01 = kl_corner_at(in, 0u, y < last ? y + 1u : y);
        kl_corner below0 = kl_corner_at(in, 0u, y > 0u ? y - 1u : y);
        for (kl_u32 x = 0; x <= last; ++x) {
            const kl_u32 next = x < last ? x + 1u : x;
            const kl_corner c10 = kl_corner_at(in, next, y);
            const kl_corner c11 = kl_corner_at(in, next, y < last ? y + 1u : y);
            const int has_right = x < last;
            const int has_up = y < last;
            const float lower = has_right && has_up ? kl_farthest(&c00, &c10, &c11) : 0.0f;
            const float upper = has_right && has_up ? kl_farthest(&c00, &c11, &c01) : 0.0f;
            const float down = has_right && y > 0u ? kl_farthest(&below0, &c10, &c00) : 0.0f;
            if (has_right) kl_hessian_edge(&c00, &c10, lower - down, row);
            if (has_up) kl_hessian_edge(&c01, &c00, upper - left, row);
            if (has_right && has_up) kl_hessian_edge(&c00, &c11, upper - lower, row);
            left = lower;
            c00 = c10;
            c01 = c11;
            below0 = kl_corner_at(in, next, y > 0u ? y - 1u : y);
        }
        for (int k = 0; k < 3; ++k) {
            h[k] += row[k];
        }
    }
}

/* Corner k of the rim, counter-clockwise from (0, 0). */
KL_FN kl_corner kl_rim_corner(const kl_hessian_input *in, kl_u32 k)
{
    const kl_u32 last = in->side - 1u;
    const kl_u32 along = k % last;
    switch ((k / last) & 3u) {
    case 0u:
        return kl_corner_at(in, along, 0u);
    case 1u:
        return kl_corner_at(in, last, along);
    case 2u:
        return kl_corner_at(in, last - along, last);
    default:
        return kl_corner_at(in, 0u, last - along);
    }
}

KL_FN void kl_hessian_skirt(const kl_hessian_input *in, float h[3])
{
    const kl_u32 count = 4u * (in->side - 1u);
    kl_corner before = kl_rim_corner(in, count - 1u);
    kl_corner rim = kl_rim_corner(in, 0u);
    kl_corner foot = kl_corner_below(&rim);
    float left = kl_farthest(&before, &foot, &rim);
    for (kl_u32 k = 0; k < count; ++k) {
        const kl_corner next = kl_rim_corner(in, k + 1u);
        const kl_corner next_foot = kl_corner_below(&next);
        const float outer = kl_farthest(&rim, &foot, &next_foot);
        const float inner = kl_farthest(&rim, &next_foot, &next);
        kl_hessian_edge(&rim, &foot, outer - left, h);
        kl_hessian_edge(&foot, &next_foot, outer, h);
        kl_hessian_edge(&rim, &next_foot, inner - outer, h);
        kl_hessian_edge(&rim, &next, -inner, h);
        left = inner;
        rim = next;
        foot = next_foot;
    }
}

/* Hessian (xx, xy, yy) [W m^-4] of the luminance of the irradiance, in the unrotated frame of the
 * directions. `mean`: mean luminance of the samples; where all are black, of a uniform radiance of
 * 1: the geometry alone. */
KL_FN void kl_hessian(const KL_GLOBAL kl_gather_cell *cells, const KL_GLOBAL kl_direction *dirs,
                      kl_u32 side, float mean, float h[3])
{
    kl_hessian_input in;
    in.cells = cells;
    in.dirs = dirs;
    in.side = side;
    in.scale = mean > 0.0f ? 1.0f - KL_HESSIAN_FLOOR : 0.0f;
    in.base = mean > 0.0f ? KL_HESSIAN_FLOOR * mean : 1.0f;
    h[0] = 0.0f;
    h[1] = 0.0f;
    h[2] = 0.0f;
    kl_hessian_quads(&in, h);
    kl_hessian_skirt(&in, h);
}

#endif
