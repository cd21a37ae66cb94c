#include "src/device/gather.h"

#include "src/base/memory.h"

#include <math.h>
#include <stdlib.h>

enum { DIRECTION_SETS = 16 };

/* Third Sobol' coordinate of point i (Joe and Kuo 2008: x^2 + x + 1; 1, 3), bits reversed. */
static uint32_t sobol_third(uint32_t i)
{
    uint32_t out = 0;
    uint32_t before = 1; /* direction numbers, as odd integers below 2^(k+1) */
    uint32_t now = 1;
    for (uint32_t k = 0; i >> k != 0; ++k) {
        const uint32_t next = k == 0 ? 3 : (2 * now) ^ (4 * before) ^ before;
        if (i >> k & 1) out ^= kl_reverse_bits(now << (31 - k));
        before = now;
        now = next;
    }
    return out;
}

/* One net: point i goes to the cell it falls in. Every cell gets exactly one point, because a
 * prefix of 4^k points of a (0,2)-sequence is a full net. */
static void fill_directions(kl_direction *out, uint32_t side, uint32_t seed)
{
    for (uint32_t i = 0; i < side * side; ++i) {
        const kl_vec2 u = kl_sobol_2d(i, seed);
        const uint32_t x = (uint32_t)(u.x * (float)side);
        const uint32_t y = (uint32_t)(u.y * (float)side);
        const kl_vec2 p = kl_concentric_disc(u);
        const uint32_t when = kl_reverse_bits(kl_owen_hash(sobol_third(i), kl_hash(~seed)));
        out[y * side + x] = (kl_direction){p.x, p.y, i, kl_unit_float(when)};
    }
}

static void fill_corners(float *corners, uint32_t side)
{
    for (uint32_t y = 0; y <= side; ++y) {
        for (uint32_t x = 0; x <= side; ++x) {
            const kl_vec2 u = {(float)x / (float)side, (float)y / (float)side};
            const kl_vec2 p = kl_concentric_disc(u);
            corners[2 * (y * (side + 1) + x)] = p.x;
            corners[2 * (y * (side + 1) + x) + 1] = p.y;
        }
    }
}

/* kl_concentric_disc in double: the rim needs it. */
static void disc_point(double u, double v, double p[2])
{
    const double a = 2.0 * u - 1.0;
    const double b = 2.0 * v - 1.0;
    const double quarter = 0.785398163397448310;
    const double r = fabs(a) > fabs(b) ? a : b;
    const double phi = fabs(a) > fabs(b) ? quarter * (b / a)
                                         : 2.0 * quarter - (b != 0.0 ? quarter * (a / b) : 0.0);
    p[0] = r * cos(phi);
    p[1] = r * sin(phi);
}

/* Midpoint k of `steps` across a cell, in [0, 1], and its share of the width. In a rim cell the
 * points crowd quadratically towards the rim, which takes the singularity 1 / cos(theta) away. */
static double spread(uint32_t k, uint32_t steps, int low_rim, int high_rim, double *share)
{
    const double t = (k + 0.5) / steps;
    const double crowded = low_rim ? t : 1.0 - t;
    *share = 1.0 / steps;
    if (!low_rim && !high_rim) return t;
    *share *= 2.0 * crowded;
    return low_rim ? crowded * crowded : 1.0 - crowded * crowded;
}

/* Integral over a cell of tan(theta) t dA with t = (-p_y, p_x) / |p|, that is of (-p_y, p_x) /
 * sqrt(1 - |p|^2): a table, because each sample's own tangent has infinite variance at the rim. */
static void cell_turn(uint32_t x, uint32_t y, uint32_t side, float turn[2])
{
    const uint32_t steps = 16;
    double sum[2] = {0.0, 0.0};
    for (uint32_t k = 0; k < steps * steps; ++k) {
        double wx;
        double wy;
        double p[2];
        const double u = (x + spread(k % steps, steps, x == 0, x == side - 1, &wx)) / side;
        const double v = (y + spread(k / steps, steps, y == 0, y == side - 1, &wy)) / side;
        disc_point(u, v, p);
        const double inverse = wx * wy / sqrt(fmax(1e-15, 1.0 - p[0] * p[0] - p[1] * p[1]));
        sum[0] -= p[1] * inverse;
        sum[1] += p[0] * inverse;
    }
    const double area = 3.14159265358979323846 / ((double)side * side);
    turn[0] = (float)(sum[0] * area);
    turn[1] = (float)(sum[1] * area);
}

static void fill_turn(float *turn, uint32_t side)
{
    for (uint32_t y = 0; y < side; ++y) {
        for (uint32_t x = 0; x < side; ++x) {
            cell_turn(x, y, side, turn + 2 * ((size_t)y * side + x));
        }
    }
}

kl_status kl_gather_tables_create(uint32_t side, struct kl_gather_tables **out, struct kl_err *err)
{
    struct kl_gather_tables *t = NULL;
    const size_t cells = (size_t)side * side;
    kl_status st = KL_OK;

    if (side < 4 || side > 256 || (side & (side - 1)) != 0) {
        return kl_fail(err, KL_ERR_USAGE,
                       "%u gather rays a side, expected a power of two in 4..256", side);
    }
    st = kl_alloc_array(&t, 1, sizeof *t, err);
    if (st != KL_OK) return st;
    t->side = side;
    t->sets = DIRECTION_SETS;
    st = kl_alloc_array(&t->directions, cells * t->sets, sizeof(kl_direction), err);
    if (st == KL_OK) {
        st = kl_alloc_array(&t->corners, 2 * (size_t)(side + 1) * (side + 1), sizeof(float), err);
    }
    if (st == KL_OK) st = kl_alloc_array(&t->turn, 2 * cells, sizeof(float), err);
    if (st != KL_OK) {
        kl_gather_tables_destroy(t);
        return st;
    }
    for (uint32_t s = 0; s < t->sets; ++s) {
        fill_directions(t->directions + cells * s, side, kl_hash(0x9d2c5680u + s));
    }
    fill_corners(t->corners, side);
    fill_turn(t->turn, side);
    *out = t;
    return KL_OK;
}

void kl_gather_tables_destroy(struct kl_gather_tables *tables)
{
    if (tables == NULL) return;
    free(tables->directions);
    free(tables->corners);
    free(tables->turn);
    free(tables);
}

kl_grid_view kl_gather_tables_grid(const struct kl_gather_tables *tables)
{
    return (kl_grid_view){tables->side, tables->corners, tables->turn};
}
