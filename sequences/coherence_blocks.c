/* What happens to the means of blocks of pixels from frame to frame: pops, lag, fast changes. */
#include "sequences/coherence_impl.h"
#include "src/base/memory.h"

#include <math.h>
#include <stdlib.h>

static const uint32_t longest_lag = 8;       /* [frames] */
static const double least_correlation = 0.5; /* below, nothing follows the reference */
static const double darkest = 1e-3;          /* blocks below this share of the mean do not pop */
static const double pi = 3.14159265358979323846;

/* Sums over the followed pixels of a block in one frame. */
struct step_sums {
    double test, reference;         /* changes from the frame before */
    double now_test, now_reference; /* Y */
    uint32_t pixels;
};

struct blocks {
    uint32_t columns, frames;
    size_t count;
    uint32_t *area;          /* [count] pixels of the block */
    struct step_sums *steps; /* [frames * count] */
    double *residual;        /* [count * frames]: mean of Y_I - Y_R */
    double *mean;            /* [count]: of Y_R over frames */
};

kl_status blocks_create(uint32_t width, uint32_t height, uint32_t frames, struct blocks **out,
                        struct kl_err *err)
{
    const uint32_t side = KL_COHERENCE_BLOCK;
    struct blocks *b = NULL;
    kl_status st = kl_alloc_array(&b, 1, sizeof *b, err);

    if (st != KL_OK) return st;
    b->columns = (width + side - 1) / side;
    b->frames = frames;
    b->count = (size_t)b->columns * ((height + side - 1) / side);
    st = kl_alloc_array(&b->area, b->count, sizeof *b->area, err);
    if (st == KL_OK) st = kl_alloc_array(&b->steps, b->count * frames, sizeof *b->steps, err);
    if (st == KL_OK) st = kl_alloc_array(&b->residual, b->count * frames, sizeof(double), err);
    if (st == KL_OK) st = kl_alloc_array(&b->mean, b->count, sizeof *b->mean, err);
    if (st != KL_OK) {
        blocks_destroy(b);
        return st;
    }
    for (uint32_t y = 0; y < height; ++y) {
        for (uint32_t x = 0; x < width; ++x)
            ++b->area[(size_t)(y / side) * b->columns + x / side];
    }
    *out = b;
    return KL_OK;
}

void blocks_destroy(struct blocks *blocks)
{
    if (blocks == NULL) return;
    free(blocks->area);
    free(blocks->steps);
    free(blocks->residual);
    free(blocks->mean);
    free(blocks);
}

static size_t block_of(const struct blocks *b, uint32_t x, uint32_t y)
{
    return (size_t)(y / KL_COHERENCE_BLOCK) * b->columns + x / KL_COHERENCE_BLOCK;
}

void blocks_add_frame(struct blocks *blocks, uint32_t frame, const struct view *view)
{
    struct blocks *b = blocks;

    for (uint32_t y = 0; y < view->height; ++y) {
        for (uint32_t x = 0; x < view->width; ++x) {
            const size_t i = (size_t)y * view->width + x;
            const size_t block = block_of(b, x, y);
            const double test = luminance_at(view->frame.test, i);
            const double reference = luminance_at(view->frame.reference, i);
            if (!isfinite(test) || !isfinite(reference)) continue;
            b->residual[block * b->frames + frame] += (test - reference) / b->area[block];
            b->mean[block] += reference / b->area[block] / b->frames;
        }
    }
}

void blocks_add_step(struct blocks *blocks, uint32_t frame, uint32_t x, uint32_t y,
                     const double now[2], const double change[2])
{
    struct step_sums *s = &blocks->steps[frame * blocks->count + block_of(blocks, x, y)];

    s->test += change[0];
    s->reference += change[1];
    s->now_test += now[0];
    s->now_reference += now[1];
    ++s->pixels;
}

/* A quarter of the block was followed. */
static bool is_judged(const struct blocks *b, const struct step_sums *s, size_t block)
{
    return s->pixels > 0 && 4 * s->pixels >= b->area[block];
}

/* Y of a block's followed pixels, of the reference where there is one. */
static double local_sum(const struct step_sums *s, bool has_reference)
{
    return has_reference ? s->now_reference : s->now_test;
}

static uint32_t count_pops(const struct blocks *b, uint32_t frame, bool has_reference,
                           uint64_t *judged)
{
    const struct step_sums *steps = b->steps + frame * b->count;
    double sum = 0.0;
    double pixels = 0.0;
    uint32_t pops = 0;

    for (size_t i = 0; i < b->count; ++i) {
        sum += local_sum(&steps[i], has_reference);
        pixels += steps[i].pixels;
    }
    for (size_t i = 0; i < b->count; ++i) {
        const struct step_sums *s = &steps[i];
        const double local = local_sum(s, has_reference);
        if (!is_judged(b, s, i) || !(local > darkest * sum / pixels * s->pixels)) continue;
        ++*judged;
        pops += fabs(s->test - s->reference) > KL_COHERENCE_POP * local;
    }
    return pops;
}

/* Sum over blocks and frames of I's change at t + shift times R's change at t, over the root of the
 * product of their powers. */
static double correlate(const struct blocks *b, int32_t shift, bool *changes)
{
    double product = 0.0;
    double test = 0.0;
    double reference = 0.0;

    *changes = false;
    for (uint32_t t = 1; t < b->frames; ++t) {
        const int64_t u = (int64_t)t + shift;
        for (size_t i = 0; i < b->count; ++i) {
            const struct step_sums *r = &b->steps[t * b->count + i];
            if (is_judged(b, r, i)) {
                const double d = r->reference / r->pixels;
                reference += d * d;
                *changes = *changes || fabs(r->reference) > KL_COHERENCE_POP * r->now_reference;
                const double own = r->test / r->pixels;
                test += own * own;
            }
            if (u < 1 || u >= (int64_t)b->frames) continue;
            const struct step_sums *s = &b->steps[(size_t)u * b->count + i];
            if (!is_judged(b, r, i) || !is_judged(b, s, i)) continue;
            product += s->test / s->pixels * (r->reference / r->pixels);
        }
    }
    const double power = sqrt(test * reference);
    return power > 0.0 ? product / power : 0.0;
}

static void measure_lag(const struct blocks *b, struct kl_coherence_result *out)
{
    const int32_t most = (int32_t)(b->frames - 2 < longest_lag ? b->frames - 2 : longest_lag);
    int32_t best = 0;
    double highest = -1.0;
    bool changes = false;

    for (int32_t shift = -most; shift <= most; ++shift) {
        const double c = correlate(b, shift, &changes);
        if (c <= highest) continue;
        highest = c;
        best = shift;
    }
    if (!changes || highest < least_correlation) return;
    const double before = correlate(b, best - 1, &changes);
    const double after = correlate(b, best + 1, &changes);
    const double bend = before - 2.0 * highest + after;
    out->lag_frames = best + (bend < 0.0 ? 0.5 * (before - after) / bend : 0.0);
    out->lag_correlation = highest;
}

/* Power [Y^2] of a series above a quarter of the frame rate (discrete Fourier transform). */
static double high_band_power(const double *series, uint32_t n)
{
    double power = 0.0;

    for (uint32_t k = n / 4 + 1; k <= n / 2; ++k) {
        double re = 0.0;
        double im = 0.0;
        for (uint32_t t = 0; t < n; ++t) {
            const double angle = 2.0 * pi * (double)((uint64_t)k * t % n) / n;
            re += series[t] * cos(angle);
            im -= series[t] * sin(angle);
        }
        power += (2 * k == n ? 1.0 : 2.0) * (re * re + im * im);
    }
    return power / ((double)n * n);
}

static double measure_high_band(const struct blocks *b)
{
    double mean = 0.0;
    double sum = 0.0;
    size_t n = 0;

    for (size_t i = 0; i < b->count; ++i)
        mean += b->mean[i] / (double)b->count;
    for (size_t i = 0; i < b->count; ++i) {
        if (!(b->mean[i] > darkest * mean)) continue;
        sum += high_band_power(b->residual + i * b->frames, b->frames) / (b->mean[i] * b->mean[i]);
        ++n;
    }
    return n > 0 ? sqrt(sum / (double)n) : (double)NAN;
}

void blocks_finish(struct blocks *blocks, bool has_reference, struct kl_coherence_step *steps,
                   struct kl_coherence_result *out)
{
    for (uint32_t t = 1; t < blocks->frames; ++t) {
        steps[t].pops = count_pops(blocks, t, has_reference, &out->block_steps);
        out->pops += steps[t].pops;
    }
    out->lag_frames = out->lag_correlation = out->high_band_rms = NAN;
    if (!has_reference) return;
    measure_lag(blocks, out);
    out->high_band_rms = measure_high_band(blocks);
}
