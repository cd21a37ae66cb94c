/* From the cells of one hemisphere to irradiance, its error, its gradients and the distances that
 * bound where the record may be used. */
#ifndef KL_KERNELS_DERIVATIVES_H
#define KL_KERNELS_DERIVATIVES_H
#include "kernels/gather.h"

/* Tables that depend only on the number of cells, for an unrotated grid; src/cache/grid.h. */
typedef struct kl_grid_view {
    kl_u32 side;
    const KL_GLOBAL float *corners; /* 2 per corner, (side + 1)^2: disc points */
    const KL_GLOBAL float *turn;    /* 2 per cell: integral of tan(theta) t over the cell */
} kl_grid_view;

typedef struct kl_gather_result {
    float irr[3];                /* [W m^-2] */
    float error;                 /* relative standard error of the luminance */
    float grad_t[6];             /* d irr_c / dt, d irr_c / db [W m^-3], record frame, c = RGB */
    float grad_r[6];             /* rotational gradient, record frame */
    float harmonic;              /* [m] harmonic mean distance; KL_INF under an open sky */
    float clearance[KL_SECTORS]; /* [m] where the horizon is blocked, KL_INF: open */
    kl_u32 touched[2];           /* parts that the light depends on: kernels/parts.h */
} kl_gather_result;

KL_FN float kl_cell_inverse(const KL_GLOBAL kl_gather_cell *c)
{
    const float d = kl_fabs(c->distance);
    return d < KL_INF ? 1.0f / kl_fmax(d, 1e-30f) : 0.0f;
}
KL_FN float kl_cell_luminance(const KL_GLOBAL kl_gather_cell *c)
{
    return 0.2126f * c->radiance[0] + 0.7152f * c->radiance[1] + 0.0722f * c->radiance[2];
}

/* E = (pi / N) sum L over cosine-distributed rays; error from the quarter blocks of the sequence,
 * each of which is a net itself (odd and even sums of a base-2 sequence would be two halves of the
 * hemisphere). Rows are summed first, then the rows: pairwise enough for float. */
KL_FN void kl_reduce_irradiance(const KL_GLOBAL kl_gather_cell *cells,
                                const KL_GLOBAL kl_direction *dirs, kl_u32 side,
                                kl_gather_result *out)
{
    const kl_u32 n = side * side;
    float total[3] = {0.0f, 0.0f, 0.0f};
    float block[4] = {0.0f, 0.0f, 0.0f, 0.0f};
    float inverse = 0.0f;
    for (kl_u32 row = 0; row < side; ++row) {
        float sum[3] = {0.0f, 0.0f, 0.0f};
        float quarter[4] = {0.0f, 0.0f, 0.0f, 0.0f};
        float row_inverse = 0.0f;
        for (kl_u32 i = row * side; i < (row + 1u) * side; ++i) {
            sum[0] += cells[i].radiance[0];
            sum[1] += cells[i].radiance[1];
            sum[2] += cells[i].radiance[2];
            quarter[(dirs[i].index * 4u / n) & 3u] += kl_cell_luminance(&cells[i]);
            row_inverse += kl_cell_inverse(&cells[i]);
        }
        for (int k = 0; k < 3; ++k) {
            total[k] += sum[k];
        }
        for (int k = 0; k < 4; ++k) {
            block[k] += quarter[k];
        }
        inverse += row_inverse;
    }
    for (int k = 0; k < 3; ++k) {
        out->irr[k] = total[k] * (KL_PI / (float)n);
    }
    const float mean = 0.25f * (block[0] + block[1] + block[2] + block[3]);
    float variance = 0.0f;
    for (int k = 0; k < 4; ++k) {
        variance += (block[k] - mean) * (block[k] - mean);
    }
    out->error = mean > 0.0f ? kl_sqrt(variance * (1.0f / 12.0f)) / mean : 0.0f;
    out->harmonic = inverse > 0.0f ? (float)n / inverse : KL_INF;
}

/* Factor that keeps a single very bright ray from owning the derivatives (not E itself). */
KL_FN float kl_winsor(const KL_GLOBAL kl_gather_cell *c, float limit)
{
    const float l = kl_cell_luminance(c);
    return l > limit ? limit / l : 1.0f;
}

/* Flux through the edge P0 -> P1 with cell a on its left: docs/references.md, edge flux form of the
 * translational gradient (Ward and Heckbert 1992 on any decomposition of the disc). */
KL_FN void kl_edge_flux(const KL_GLOBAL kl_gather_cell *a, const KL_GLOBAL kl_gather_cell *b,
                        const KL_GLOBAL float *p0, const KL_GLOBAL float *p1, float limit,
                        float grad[6])
{
    const float inverse = kl_fmax(kl_cell_inverse(a), kl_cell_inverse(b));
    const float nx = p1[1] - p0[1];
    const float ny = p0[0] - p1[0];
    const float px = 0.5f * (p0[0] + p1[0]);
    const float py = 0.5f * (p0[1] + p1[1]);
    const float along = px * nx + py * ny;
    const float fx = (nx - px * along) * inverse;
    const float fy = (ny - py * along) * inverse;
    const float wa = kl_winsor(a, limit);
    const float wb = kl_winsor(b, limit);
    for (int k = 0; k < 3; ++k) {
        const float step = wa * a->radiance[k] - wb * b->radiance[k];
        grad[2 * k] -= step * fx;
        grad[2 * k + 1] -= step * fy;
    }
}

KL_FN void kl_reduce_gradients(const KL_GLOBAL kl_gather_cell *cells, const kl_grid_view *grid,
                               kl_gather_result *out)
{
    const kl_u32 side = grid->side;
    const kl_u32 pitch = 2u * (side + 1u);
    const kl_vec3 e = kl_v3(out->irr[0], out->irr[1], out->irr[2]);
    const float limit = 32.0f * kl_luminance(e) * KL_INV_PI;
    for (int k = 0; k < 6; ++k) {
        out->grad_t[k] = 0.0f;
        out->grad_r[k] = 0.0f;
    }
    for (kl_u32 y = 0; y < side; ++y) {
        float row_t[6] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
        float row_r[6] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
        for (kl_u32 x = 0; x < side; ++x) {
            const KL_GLOBAL kl_gather_cell *c = cells + y * side + x;
            const KL_GLOBAL float *corner = grid->corners + y * pitch + 2u * x;
            const KL_GLOBAL float *turn = grid->turn + 2u * (y * side + x);
            const float w = kl_winsor(c, limit);
            if (x + 1u < side) kl_edge_flux(c, c + 1, corner + 2, corner + pitch + 2, limit, row_t);
            if (y + 1u < side) {
                kl_edge_flux(c + side, c, corner + pitch, corner + pitch + 2, limit, row_t);
            }
            for (int k = 0; k < 3; ++k) {
                row_r[2 * k] += w * c->radiance[k] * turn[0];
                row_r[2 * k + 1] += w * c->radiance[k] * turn[1];
            }
        }
        for (int k = 0; k < 6; ++k) {
            out->grad_t[k] += row_t[k];
            out->grad_r[k] += row_r[k];
        }
    }
}

/* Distances along the tangent plane at which the outermost ring of rays is stopped. */
KL_FN void kl_reduce_clearance(const KL_GLOBAL kl_gather_cell *cells,
                               const KL_GLOBAL kl_direction *dirs, kl_u32 side,
                               const KL_GLOBAL kl_gather_point *point, kl_gather_result *out)
{
    for (int k = 0; k < KL_SECTORS; ++k) {
        out->clearance[k] = KL_INF;
    }
    for (kl_u32 y = 0; y < side; ++y) {
        const kl_u32 step = (y == 0u || y == side - 1u) ? 1u : side - 1u;
        for (kl_u32 x = 0; x < side; x += step) {
            const kl_u32 i = y * side + x;
            const float d = cells[i].distance;
            if (d < 0.0f || d >= KL_INF) continue;
            const float px = point->rot_cos * dirs[i].x - point->rot_sin * dirs[i].y;
            const float py = point->rot_sin * dirs[i].x + point->rot_cos * dirs[i].y;
            const kl_u32 sector = kl_sector_of(px, py);
            out->clearance[sector] =
                kl_fmin(out->clearance[sector], d * kl_sqrt(px * px + py * py));
        }
    }
}

/* The parts of the scene whose share of the record's light reaches `threshold`. Of an object counts
 * what it would send if it were white: that bounds what any other colour of it could add or take
 * away. Of what a path met behind the first surface counts twice what it sent. Of a light, what it
 * sent. */
KL_FN void kl_reduce_touched(const KL_GLOBAL kl_gather_cell *cells, kl_u32 count, float threshold,
                             kl_gather_result *out)
{
    float share[64];
    float total = 0.0f;
    for (kl_u32 k = 0; k < 64u; ++k) {
        share[k] = 0.0f;
    }
    for (kl_u32 i = 0; i < count; ++i) {
        const float l = kl_cell_luminance(&cells[i]);
        const kl_u32 touch = cells[i].touch;
        const kl_u32 light = (touch >> 8) & 255u;
        const float direct = (float)((touch >> 16) & 255u) * (1.0f / 255.0f);
        total += l;
        if ((touch & 255u) < 64u) share[touch & 255u] += cells[i].potential;
        if (light < 64u) share[light] += l * direct;
        if (touch >> 24 < 64u) share[touch >> 24] += 2.0f * l * (1.0f - direct);
    }
    out->touched[0] = 0u;
    out->touched[1] = 0u;
    for (kl_u32 k = 0; k < 64u; ++k) {
        if (share[k] > 0.0f && share[k] >= threshold * total)
            out->touched[k >> 5] |= 1u << (k & 31u);
    }
}

/* All of it for one record: cells are side x side. Gradients come out in the record's own frame. */
KL_FN void kl_reduce_record(const KL_GLOBAL kl_gather_cell *cells,
                            const KL_GLOBAL kl_direction *dirs, const kl_grid_view *grid,
                            const KL_GLOBAL kl_gather_point *point, kl_gather_result *out)
{
    kl_reduce_irradiance(cells, dirs, grid->side, out);
    kl_reduce_gradients(cells, grid, out);
    kl_reduce_clearance(cells, dirs, grid->side, point, out);
    for (int k = 0; k < 3; ++k) {
        const float tx = out->grad_t[2 * k];
        const float ty = out->grad_t[2 * k + 1];
        const float rx = out->grad_r[2 * k];
        const float ry = out->grad_r[2 * k + 1];
        out->grad_t[2 * k] = point->rot_cos * tx - point->rot_sin * ty;
        out->grad_t[2 * k + 1] = point->rot_sin * tx + point->rot_cos * ty;
        out->grad_r[2 * k] = point->rot_cos * rx - point->rot_sin * ry;
        out->grad_r[2 * k + 1] = point->rot_sin * rx + point->rot_cos * ry;
    }
}

#endif
