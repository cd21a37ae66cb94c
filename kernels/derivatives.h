/* From the cells of one hemisphere to irradiance, its error, its gradients and the distances that
 * bound where the record may be used. */
#ifndef KL_KERNELS_DERIVATIVES_H
#define KL_KERNELS_DERIVATIVES_H
#include "kernels/hessian.h"

/* Tables that depend only on the number of cells, for an unrotated grid; src/cache/grid.h. */
typedef struct kl_grid_view {
    kl_u32 side;
    const KL_GLOBAL float *corners; /* 2 per corner, (side + 1)^2: disc points */
    const KL_GLOBAL float *turn;    /* 2 per cell: integral of tan(theta) t over the cell */
} kl_grid_view;

typedef struct kl_gather_result {
    float irr[3];                /* [W m^-2] */
    kl_u32 side;                 /* rays a side */
    float error;                 /* relative standard error of the luminance */
    float grad_t[6];             /* d irr_c / dt, d irr_c / db [W m^-3], record frame, c = RGB */
    float grad_r[6];             /* rotational gradient, record frame */
    float hessian[3];            /* xx, xy, yy of the luminance's second derivative [W m^-4] */
    float harmonic;              /* [m] harmonic mean distance; KL_INF under an open sky */
    float clearance[KL_SECTORS]; /* [m] where the horizon is blocked, KL_INF: open */
    kl_u32 touched[2];           /* parts that the light depends on: kernels/parts.h */
} kl_gather_result;

/* E = (pi / N) sum L over cosine-distributed rays; error from the quarter blocks of the sequence,
 * each of which is a net itself (odd and even sums of a base-2 sequence would be two halves of the
 * hemisphere). Rows are summed first, then the rows: pairwise enough for float. */
KL_FN void kl_reduce_irradiance(const KL_GLOBAL kl_gather_cell *cells,
                                const KL_GLOBAL kl_direction *dirs, kl_u32 side,
                                kl_gather_result *out)
{
    const kl_u32 n = side * side;
    out->side = side;
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

/* Samples brighter than this many times the mean must not own the derivatives (E itself has them
 * whole). */
#define KL_WINSOR       32.0f
#define KL_SAME_SURFACE 0.1f /* inverse distances of neighbours differ relatively by less */

/* Radiance for the derivatives: the mean over neighbours at about the same distance. The noise of
 * single samples would not average out in differences between cells, however many rays there are;
 * a step between near and far keeps its place. */
KL_FN void kl_smooth_cell(const KL_GLOBAL kl_gather_cell *cells, kl_u32 side, kl_u32 x, kl_u32 y,
                          float limit, KL_GLOBAL kl_gather_cell *out)
{
    const KL_GLOBAL kl_gather_cell *center = cells + y * side + x;
    const float inverse = kl_cell_inverse(center);
    float sum[3] = {0.0f, 0.0f, 0.0f};
    float weight = 0.0f;
    for (kl_u32 v = y > 0u ? y - 1u : 0u; v <= y + 1u && v < side; ++v) {
        for (kl_u32 u = x > 0u ? x - 1u : 0u; u <= x + 1u && u < side; ++u) {
            const KL_GLOBAL kl_gather_cell *c = cells + v * side + u;
            const float other = kl_cell_inverse(c);
            if (kl_fabs(other - inverse) > KL_SAME_SURFACE * kl_fmax(other, inverse)) continue;
            const float l = kl_cell_luminance(c);
            const float cut = l > limit ? limit / l : 1.0f;
            for (int k = 0; k < 3; ++k) {
                sum[k] += cut * c->radiance[k];
            }
            weight += 1.0f;
        }
    }
    for (int k = 0; k < 3; ++k) {
        out->radiance[k] = sum[k] / weight;
    }
    out->distance = center->distance;
}

KL_FN void kl_smooth_cells(const KL_GLOBAL kl_gather_cell *cells, kl_u32 side,
                           const kl_gather_result *result, KL_GLOBAL kl_gather_cell *out)
{
    const float mean =
        KL_INV_PI * kl_luminance(kl_v3(result->irr[0], result->irr[1], result->irr[2]));
    for (kl_u32 y = 0; y < side; ++y) {
        for (kl_u32 x = 0; x < side; ++x) {
            kl_smooth_cell(cells, side, x, y, KL_WINSOR * mean, out + y * side + x);
        }
    }
}

/* Flux through the edge P0 -> P1 with cell a on its left: docs/references.md, edge flux form of the
 * translational gradient (Ward and Heckbert 1992 on any decomposition of the disc). */
KL_FN void kl_edge_flux(const KL_GLOBAL kl_gather_cell *a, const KL_GLOBAL kl_gather_cell *b,
                        const KL_GLOBAL float *p0, const KL_GLOBAL float *p1, float grad[6])
{
    const float inverse = kl_fmax(kl_cell_inverse(a), kl_cell_inverse(b));
    const float nx = p1[1] - p0[1];
    const float ny = p0[0] - p1[0];
    const float px = 0.5f * (p0[0] + p1[0]);
    const float py = 0.5f * (p0[1] + p1[1]);
    const float along = px * nx + py * ny;
    const float fx = (nx - px * along) * inverse;
    const float fy = (ny - py * along) * inverse;
    for (int k = 0; k < 3; ++k) {
        const float step = a->radiance[k] - b->radiance[k];
        grad[2 * k] -= step * fx;
        grad[2 * k + 1] -= step * fy;
    }
}

KL_FN void kl_reduce_gradients(const KL_GLOBAL kl_gather_cell *cells, const kl_grid_view *grid,
                               kl_gather_result *out)
{
    const kl_u32 side = grid->side;
    const kl_u32 pitch = 2u * (side + 1u);
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
            if (x + 1u < side) kl_edge_flux(c, c + 1, corner + 2, corner + pitch + 2, row_t);
            if (y + 1u < side) {
                kl_edge_flux(c + side, c, corner + pitch, corner + pitch + 2, row_t);
            }
            for (int k = 0; k < 3; ++k) {
                row_r[2 * k] += c->radiance[k] * turn[0];
                row_r[2 * k + 1] += c->radiance[k] * turn[1];
            }
        }
        for (int k = 0; k < 6; ++k) {
            out->grad_t[k] += row_t[k];
            out->grad_r[k] += row_r[k];
        }
    }
}

/* Distances along the tangent plane at which the outermost ring of rays is stopped. A ray speaks
 * for half the gap to its neighbours on either side, also across the border of its sector. */
KL_FN void kl_reduce_clearance(const KL_GLOBAL kl_gather_cell *cells,
                               const KL_GLOBAL kl_direction *dirs, kl_u32 side,
                               const KL_GLOBAL kl_gather_point *point, kl_gather_result *out)
{
    const float gap = KL_PI / (2.0f * (float)(side - 1u)); /* between neighbours on the ring */
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
            const float open = d * kl_sqrt(px * px + py * py);
            for (int turn = -1; turn <= 1; turn += 2) {
                const float t = (float)turn * gap;
                const kl_u32 sector = kl_sector_of(px - t * py, py + t * px);
                out->clearance[sector] = kl_fmin(out->clearance[sector], open);
            }
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

KL_FN void kl_reduce_hessian(const KL_GLOBAL kl_gather_cell *cells,
                             const KL_GLOBAL kl_direction *dirs, kl_u32 side,
                             const KL_GLOBAL kl_gather_point *point, kl_gather_result *out)
{
    const float c = point->rot_cos;
    const float s = point->rot_sin;
    const kl_vec3 e = kl_v3(out->irr[0], out->irr[1], out->irr[2]);
    float h[3];
    kl_hessian(cells, dirs, side, KL_INV_PI * kl_luminance(e), h);
    out->hessian[0] = c * c * h[0] - 2.0f * c * s * h[1] + s * s * h[2];
    out->hessian[1] = c * s * (h[0] - h[2]) + (c * c - s * s) * h[1];
    out->hessian[2] = s * s * h[0] + 2.0f * c * s * h[1] + c * c * h[2];
}

/* All of it for one record: cells and smooth (scratch) are side x side. Derivatives come out in the
 * record's own frame. */
KL_FN void kl_reduce_record(const KL_GLOBAL kl_gather_cell *cells,
                            const KL_GLOBAL kl_direction *dirs, const kl_grid_view *grid,
                            const KL_GLOBAL kl_gather_point *point,
                            KL_GLOBAL kl_gather_cell *smooth, kl_gather_result *out)
{
    kl_reduce_irradiance(cells, dirs, grid->side, out);
    kl_reduce_clearance(cells, dirs, grid->side, point, out);
    kl_smooth_cells(cells, grid->side, out, smooth);
    kl_reduce_gradients(smooth, grid, out);
    kl_reduce_hessian(smooth, dirs, grid->side, point, out);
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
