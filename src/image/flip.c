#include "src/image/flip.h"

#include "src/base/memory.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* Names and constants follow the HPG 2020 paper. */
static const float qc = 0.7f;
static const float qf = 0.5f;
static const float pc = 0.4f;
static const float pt = 0.95f;
static const float feature_width = 0.082f; /* [degree] w: the width of an edge that eyes find */

enum { MAX_RADIUS = 64 };

struct kernel {
    int radius;
    float weight[2 * MAX_RADIUS + 1];
};

/* What one image needs on the way to its difference. Planes of width * height. */
struct planes {
    float *opponent[3];          /* YCxCz, later L*a*b* after Hunt */
    float *gauss, *edge, *point; /* luminance filtered along rows */
    float *edge_norm, *point_norm;
};

struct work {
    uint32_t width, height;
    struct kernel csf[4]; /* achromatic, red-green, blue-yellow narrow, blue-yellow wide */
    float share[2];       /* of the two blue-yellow Gaussians */
    struct kernel gauss, edge, point;
    struct planes image[2];
    float *scratch, *sum; /* one plane each */
    float *memory;
};

/* ---- colour ---- */

struct color {
    float x, y, z;
};

static const float white[3] = {0.950428545f, 1.0f, 1.088900371f}; /* D65 of linear RGB (1, 1, 1) */

/* XYZ relative to the white point. */
static struct color xyz_from_rgb(float r, float g, float b)
{
    struct color c;

    c.x = (0.41238656f * r + 0.35759149f * g + 0.18045049f * b) / white[0];
    c.y = (0.21263682f * r + 0.71518298f * g + 0.07218020f * b) / white[1];
    c.z = (0.01933062f * r + 0.11919716f * g + 0.95037259f * b) / white[2];
    return c;
}

static struct color rgb_from_xyz(struct color c)
{
    const float x = c.x * white[0];
    const float y = c.y * white[1];
    const float z = c.z * white[2];
    struct color rgb;

    rgb.x = 3.24100326f * x - 1.53739899f * y - 0.49861587f * z;
    rgb.y = -0.96922426f * x + 1.87592999f * y + 0.04155422f * z;
    rgb.z = 0.05563942f * x - 0.20401120f * y + 1.05714897f * z;
    return rgb;
}

static float lab_curve(float t)
{
    const float delta = 6.0f / 29.0f;

    return t > delta * delta * delta ? cbrtf(t) : t / (3.0f * delta * delta) + 4.0f / 29.0f;
}

/* L*a*b* with the chroma scaled by lightness: colours differ less in the dark (Hunt). */
static struct color hunt_lab_from_rgb(float r, float g, float b)
{
    const struct color n = xyz_from_rgb(r, g, b);
    const float fx = lab_curve(n.x);
    const float fy = lab_curve(n.y);
    const float fz = lab_curve(n.z);
    struct color lab;

    lab.x = 116.0f * fy - 16.0f;
    lab.y = 0.01f * lab.x * 500.0f * (fx - fy);
    lab.z = 0.01f * lab.x * 200.0f * (fy - fz);
    return lab;
}

static float hyab(struct color a, struct color b)
{
    return fabsf(a.x - b.x) + sqrtf((a.y - b.y) * (a.y - b.y) + (a.z - b.z) * (a.z - b.z));
}

static float clip01(float x)
{
    if (!(x > 0.0f)) return 0.0f;
    return x < 1.0f ? x : 1.0f;
}

/* ---- filters: all kernels of the paper are products of one-dimensional ones ---- */

/* exp(-pi^2 x^2 / b), unnormalised, x in degrees; returns its sum. */
static float csf_kernel(struct kernel *k, int radius, float b, float pixels_per_degree)
{
    const float pi = 3.14159265358979f;
    float sum = 0.0f;

    k->radius = radius;
    for (int i = -radius; i <= radius; ++i) {
        const float x = (float)i / pixels_per_degree;
        k->weight[i + radius] = expf(-pi * pi * x * x / b);
        sum += k->weight[i + radius];
    }
    for (int i = 0; i <= 2 * radius; ++i)
        k->weight[i] /= sum;
    return sum;
}

static void setup_csf(struct work *w, float ppd)
{
    const float pi = 3.14159265358979f;
    const float b[4] = {0.0047f, 0.0053f, 0.04f, 0.025f};
    const float amplitude[2] = {34.1f, 13.5f};
    const int radius = (int)ceilf(3.0f * sqrtf(0.04f / (2.0f * pi * pi)) * ppd);
    float mass[2];

    for (int i = 0; i < 4; ++i) {
        const float sum = csf_kernel(&w->csf[i], radius, b[i], ppd);
        if (i >= 2) mass[i - 2] = amplitude[i - 2] * sqrtf(pi / b[i]) * sum * sum;
    }
    w->share[0] = mass[0] / (mass[0] + mass[1]);
    w->share[1] = 1.0f - w->share[0];
}

/* Scale positive weights to sum 1 and negative ones to sum -1. */
static void balance(struct kernel *k)
{
    float plus = 0.0f;
    float minus = 0.0f;

    for (int i = 0; i <= 2 * k->radius; ++i) {
        if (k->weight[i] > 0.0f) {
            plus += k->weight[i];
        } else {
            minus -= k->weight[i];
        }
    }
    for (int i = 0; i <= 2 * k->radius; ++i) {
        const float scale = k->weight[i] > 0.0f ? plus : minus;
        if (scale > 0.0f) k->weight[i] /= scale;
    }
}

static void setup_features(struct work *w, float ppd)
{
    const float sd = 0.5f * feature_width * ppd;
    const int radius = (int)ceilf(3.0f * sd);
    float sum = 0.0f;

    w->gauss.radius = w->edge.radius = w->point.radius = radius;
    for (int i = -radius; i <= radius; ++i) {
        const float x = (float)i;
        const float g = expf(-x * x / (2.0f * sd * sd));
        w->gauss.weight[i + radius] = g;
        w->edge.weight[i + radius] = -x * g;
        w->point.weight[i + radius] = (x * x / (sd * sd) - 1.0f) * g;
        sum += g;
    }
    for (int i = 0; i <= 2 * radius; ++i)
        w->gauss.weight[i] /= sum;
    balance(&w->edge);
    balance(&w->point);
}

/* Pixels beyond the edge repeat the edge. `line` holds width + 2 * MAX_RADIUS values. */
static void filter_rows(const struct work *w, const struct kernel *k, const float *from, float *to,
                        float *line)
{
    const int width = (int)w->width;
    const int r = k->radius;

    for (uint32_t y = 0; y < w->height; ++y) {
        const float *in = from + (size_t)y * w->width;
        float *out = to + (size_t)y * w->width;
        for (int i = 0; i < r; ++i) {
            line[i] = in[0];
            line[r + width + i] = in[width - 1];
        }
        memcpy(line + r, in, (size_t)width * sizeof *line);
        memset(out, 0, (size_t)width * sizeof *out);
        for (int t = 0; t <= 2 * r; ++t) {
            const float weight = k->weight[t];
            const float *shifted = line + t;
            for (int x = 0; x < width; ++x)
                out[x] += weight * shifted[x];
        }
    }
}

/* The sign convention is a correlation, as above; norms do not see it. */
static void filter_columns(const struct work *w, const struct kernel *k, const float *from,
                           float *to)
{
    const int height = (int)w->height;

    memset(to, 0, (size_t)w->width * w->height * sizeof *to);
    for (int y = 0; y < height; ++y) {
        float *out = to + (size_t)y * w->width;
        for (int t = -k->radius; t <= k->radius; ++t) {
            const int row = y + t < 0 ? 0 : (y + t >= height ? height - 1 : y + t);
            const float *in = from + (size_t)row * w->width;
            const float weight = k->weight[t + k->radius];
            for (uint32_t x = 0; x < w->width; ++x)
                out[x] += weight * in[x];
        }
    }
}

/* In place, through w->scratch. */
static void blur(struct work *w, const struct kernel *k, float *plane, float *line)
{
    filter_rows(w, k, plane, w->scratch, line);
    filter_columns(w, k, w->scratch, plane);
}

/* ---- one image ---- */

/* Norm of the x and y responses of a feature: kernel `k` across, a Gaussian along. `rows_k` is the
 * luminance filtered by k along rows, p->gauss by the Gaussian along rows. */
static void feature_norm(struct work *w, struct planes *p, const struct kernel *k,
                         const float *rows_k, float *norm)
{
    const size_t count = (size_t)w->width * w->height;

    filter_columns(w, &w->gauss, rows_k, norm);
    filter_columns(w, k, p->gauss, w->scratch);
    for (size_t i = 0; i < count; ++i) {
        norm[i] = sqrtf(norm[i] * norm[i] + w->scratch[i] * w->scratch[i]);
    }
}

static void find_features(struct work *w, struct planes *p, float *line)
{
    const size_t count = (size_t)w->width * w->height;

    for (size_t i = 0; i < count; ++i)
        w->sum[i] = (p->opponent[0][i] + 16.0f) / 116.0f;
    filter_rows(w, &w->gauss, w->sum, p->gauss, line);
    filter_rows(w, &w->edge, w->sum, p->edge, line);
    filter_rows(w, &w->point, w->sum, p->point, line);
    feature_norm(w, p, &w->edge, p->edge, p->edge_norm);
    feature_norm(w, p, &w->point, p->point, p->point_norm);
}

/* Blur by what the eye resolves, then L*a*b* with Hunt's adjustment, in place of p->opponent. */
static void perceive(struct work *w, struct planes *p, float *line)
{
    const size_t count = (size_t)w->width * w->height;

    blur(w, &w->csf[0], p->opponent[0], line);
    blur(w, &w->csf[1], p->opponent[1], line);
    memcpy(w->sum, p->opponent[2], count * sizeof *w->sum);
    blur(w, &w->csf[2], p->opponent[2], line);
    blur(w, &w->csf[3], w->sum, line);
    for (size_t i = 0; i < count; ++i) {
        const float cz = w->share[0] * p->opponent[2][i] + w->share[1] * w->sum[i];
        const float y = (p->opponent[0][i] + 16.0f) / 116.0f;
        const struct color xyz = {y + p->opponent[1][i] / 500.0f, y, y - cz / 200.0f};
        const struct color rgb = rgb_from_xyz(xyz);
        const struct color lab = hunt_lab_from_rgb(clip01(rgb.x), clip01(rgb.y), clip01(rgb.z));
        p->opponent[0][i] = lab.x;
        p->opponent[1][i] = lab.y;
        p->opponent[2][i] = lab.z;
    }
}

/* The tone curve of HDR-FLIP, (k0 x^2 + k1 x + k2) / (k3 x^2 + k4 x + k5): ACES by Narkowicz with
 * the factor 0.6 of the paper folded in. */
static const float aces[6] = {0.6f * 0.6f * 2.51f, 0.6f * 0.03f, 0.0f,
                              0.6f * 0.6f * 2.43f, 0.6f * 0.59f, 0.14f};

static float aces_curve(float x)
{
    if (!(x > 0.0f)) return 0.0f;
    if (x > 1e6f) return 1.0f;
    return clip01((aces[0] * x * x + aces[1] * x + aces[2]) /
                  (aces[3] * x * x + aces[4] * x + aces[5]));
}

/* scale 0: no tone curve, just clipped. */
static void load(struct work *w, struct planes *p, const float *const rgb[3], float scale)
{
    const size_t count = (size_t)w->width * w->height;

    for (size_t i = 0; i < count; ++i) {
        float v[3];
        for (int c = 0; c < 3; ++c) {
            v[c] = scale > 0.0f ? aces_curve(rgb[c][i] * scale) : clip01(rgb[c][i]);
        }
        const struct color n = xyz_from_rgb(v[0], v[1], v[2]);
        p->opponent[0][i] = 116.0f * n.y - 16.0f;
        p->opponent[1][i] = 500.0f * (n.x - n.y);
        p->opponent[2][i] = 200.0f * (n.y - n.z);
    }
}

/* ---- the difference ---- */

static void merge(const struct work *w, float *map)
{
    const size_t count = (size_t)w->width * w->height;
    const struct planes *a = &w->image[0];
    const struct planes *b = &w->image[1];
    const float largest =
        powf(hyab(hunt_lab_from_rgb(0.0f, 1.0f, 0.0f), hunt_lab_from_rgb(0.0f, 0.0f, 1.0f)), qc);
    const float knee = pc * largest;

    for (size_t i = 0; i < count; ++i) {
        const struct color x = {a->opponent[0][i], a->opponent[1][i], a->opponent[2][i]};
        const struct color y = {b->opponent[0][i], b->opponent[1][i], b->opponent[2][i]};
        const float d = powf(hyab(x, y), qc);
        const float color =
            d < knee ? pt / knee * d : pt + (d - knee) / (largest - knee) * (1.0f - pt);
        const float edge = fabsf(a->edge_norm[i] - b->edge_norm[i]);
        const float point = fabsf(a->point_norm[i] - b->point_norm[i]);
        const float feature = powf((edge > point ? edge : point) * 0.70710678f, qf);
        const float flip = clip01(powf(color, 1.0f - feature));
        if (flip > map[i]) map[i] = flip;
    }
}

/* Raise `map` to the LDR-FLIP at this exposure where it is larger. */
static void compare_at(struct work *w, const struct kl_flip_images *images, float scale, float *map,
                       float *line)
{
    load(w, &w->image[0], images->test, scale);
    load(w, &w->image[1], images->reference, scale);
    for (int i = 0; i < 2; ++i) {
        find_features(w, &w->image[i], line);
        perceive(w, &w->image[i], line);
    }
    merge(w, map);
}

static kl_status setup(struct work *w, const struct kl_flip_images *images, float ppd,
                       struct kl_err *err)
{
    enum { PLANES = 2 * 8 + 2 };
    const size_t count = (size_t)images->width * images->height;

    memset(w, 0, sizeof *w);
    if (!(ppd >= 1.0f && ppd <= 200.0f)) {
        (void)kl_fail(err, KL_ERR_USAGE, "FLIP: %g pixels per degree is not within 1 to 200",
                      (double)ppd);
        return KL_ERR_USAGE; /* said outright, for the static analyzer */
    }
    w->width = images->width;
    w->height = images->height;
    setup_csf(w, ppd);
    setup_features(w, ppd);
    kl_status st = kl_alloc_array(&w->memory, count * PLANES + w->width + (size_t)2 * MAX_RADIUS,
                                  sizeof *w->memory, err);
    if (st != KL_OK) return st;
    float *next = w->memory;
    for (int i = 0; i < 2; ++i) {
        struct planes *p = &w->image[i];
        float **all[] = {&p->opponent[0], &p->opponent[1], &p->opponent[2], &p->gauss,
                         &p->edge,        &p->point,       &p->edge_norm,   &p->point_norm};
        for (size_t k = 0; k < sizeof all / sizeof all[0]; ++k, next += count)
            *all[k] = next;
    }
    w->scratch = next;
    w->sum = next + count;
    return KL_OK;
}

static float *line_get(const struct work *w)
{
    return w->sum + (size_t)w->width * w->height;
}

kl_status kl_flip_ldr(const struct kl_flip_images *images, float pixels_per_degree, float *map,
                      struct kl_err *err)
{
    struct work w;
    kl_status st = setup(&w, images, pixels_per_degree, err);

    if (st != KL_OK) return st;
    memset(map, 0, (size_t)w.width * w.height * sizeof *map);
    compare_at(&w, images, 0.0f, map, line_get(&w));
    free(w.memory);
    return KL_OK;
}

static int compare_floats(const void *a, const void *b)
{
    const float x = *(const float *)a;
    const float y = *(const float *)b;

    return (x > y) - (x < y);
}

/* The x > 0 at which the tone curve reaches t. */
static double curve_inverse(double t)
{
    const double a = (double)aces[0] - t * (double)aces[3];
    const double b = (double)aces[1] - t * (double)aces[4];
    const double c = (double)aces[2] - t * (double)aces[5];
    const double d1 = -0.5 * (b / a);
    const double d2 = sqrt(d1 * d1 - c / a);

    return d1 + d2;
}

/* Exposures [stops] from the one that brings the brightest pixel to 0.85 of white to the one that
 * brings the median there. False: the reference is black. */
static bool exposure_range(const struct kl_flip_images *images, float *scratch, double *start,
                           double *stop)
{
    const size_t count = (size_t)images->width * images->height;
    const double x = curve_inverse(0.85);

    for (size_t i = 0; i < count; ++i) {
        const float y = 0.21263682f * images->reference[0][i] +
                        0.71518298f * images->reference[1][i] +
                        0.07218020f * images->reference[2][i];
        scratch[i] = y > 0.0f ? y : 0.0f;
    }
    qsort(scratch, count, sizeof *scratch, compare_floats);
    const double largest = (double)scratch[count - 1];
    double median = (double)scratch[count / 2];
    if (count % 2 == 0) median = 0.5 * (median + (double)scratch[count / 2 - 1]);
    if (!(largest > 0.0)) return false;
    /* Mostly black pictures: 16 stops below the brightest is dark enough. */
    if (median < largest * 0x1p-16) median = largest * 0x1p-16;
    *start = log2(x / largest);
    *stop = log2(x / median);
    return true;
}

kl_status kl_flip_hdr(const struct kl_flip_images *images, float pixels_per_degree, float *map,
                      struct kl_err *err)
{
    struct work w;
    double start = 0.0;
    double stop = 0.0;
    kl_status st = setup(&w, images, pixels_per_degree, err);

    if (st != KL_OK) return st;
    memset(map, 0, (size_t)w.width * w.height * sizeof *map);
    int count = 1;
    if (exposure_range(images, w.scratch, &start, &stop)) {
        count = (int)fmax(2.0, ceil(stop - start));
    }
    for (int i = 0; i < count; ++i) {
        const double stops = count > 1 ? start + i * (stop - start) / (count - 1) : start;
        compare_at(&w, images, (float)exp2(stops), map, line_get(&w));
    }
    free(w.memory);
    return KL_OK;
}
