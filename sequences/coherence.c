#include "sequences/coherence.h"

#include "sequences/coherence_impl.h"
#include "src/base/memory.h"

#include <math.h>
#include <stdlib.h>

static const double relmse_epsilon = 1e-2;

struct kl_coherence {
    uint32_t width, height, frames, added;
    struct view views[2]; /* [added % 2] is the next */
    struct tracks *tracks;
    struct blocks *blocks;
    struct kl_coherence_step *steps;
    uint64_t followed;
};

kl_status kl_coherence_create(uint32_t width, uint32_t height, uint32_t frames,
                              struct kl_coherence **out, struct kl_err *err)
{
    struct kl_coherence *c = NULL;

    if (frames < 2 || frames > KL_COHERENCE_MOST_FRAMES) {
        return kl_fail(err, KL_ERR_USAGE, "%u frames: expected 2 to %d", frames,
                       KL_COHERENCE_MOST_FRAMES);
    }
    kl_status st = kl_alloc_array(&c, 1, sizeof *c, err);
    if (st != KL_OK) return st;
    c->width = width;
    c->height = height;
    c->frames = frames;
    for (int i = 0; st == KL_OK && i < 2; ++i) {
        c->views[i].width = width;
        c->views[i].height = height;
        st = kl_alloc_array(&c->views[i].inner, (size_t)width * height, 1, err);
    }
    if (st == KL_OK) st = kl_alloc_array(&c->steps, frames, sizeof *c->steps, err);
    if (st == KL_OK) st = tracks_create(width, height, frames, &c->tracks, err);
    if (st == KL_OK) st = blocks_create(width, height, frames, &c->blocks, err);
    if (st != KL_OK) {
        kl_coherence_destroy(c);
        return st;
    }
    *out = c;
    return KL_OK;
}

void kl_coherence_destroy(struct kl_coherence *coherence)
{
    struct kl_coherence *c = coherence;

    if (c == NULL) return;
    tracks_destroy(c->tracks);
    blocks_destroy(c->blocks);
    free(c->views[0].inner);
    free(c->views[1].inner);
    free(c->steps);
    free(c);
}

/* 1 / mean of R, or of I without R: so that the constant of relMSE means the same for every
 * exposure. */
static double exposure(const struct view *v)
{
    const float *const *rgb = v->frame.reference[0] != NULL ? v->frame.reference : v->frame.test;
    double sum = 0.0;
    size_t n = 0;

    for (int c = 0; c < 3; ++c) {
        for (size_t i = 0; i < (size_t)v->width * v->height; ++i) {
            if (!isfinite(rgb[c][i])) continue;
            sum += (double)rgb[c][i];
            ++n;
        }
    }
    return n > 0 && sum > 0.0 ? (double)n / sum : 1.0;
}

struct sums {
    double now[2], step[2], square, relative;
    uint64_t pixels;
};

/* Squares of the difference of both changes, over the channels. False where one is not finite. */
static bool add_squares(const struct kl_coherence_frame *later,
                        const struct kl_coherence_frame *before, size_t i, const struct spot *spot,
                        double scale, struct sums *sums)
{
    double square = 0.0;
    double relative = 0.0;

    for (int c = 0; c < 3; ++c) {
        const double r = scale * (double)later->reference[c][i];
        const double change =
            scale * ((double)later->test[c][i] - spot_value(spot, before->test[c]));
        const double d = change - (r - scale * spot_value(spot, before->reference[c]));
        square += d * d;
        relative += d * d / (r * r + relmse_epsilon);
    }
    if (!isfinite(relative)) return false;
    sums->square += square;
    sums->relative += relative;
    return true;
}

/* `later` is frame number t. */
static void measure_pixel(struct kl_coherence *c, uint32_t t, const struct view *later,
                          const struct view *before, uint32_t x, uint32_t y, double scale,
                          struct sums *sums)
{
    const bool has_reference = later->frame.reference[0] != NULL;
    const size_t i = (size_t)y * c->width + x;
    double now[2] = {0};
    double change[2] = {0};
    struct spot spot;

    if (!follow(later, x, y, before, &spot)) return;
    now[0] = luminance_at(later->frame.test, i);
    change[0] = now[0] - spot_luminance(&spot, before->frame.test);
    if (has_reference) {
        now[1] = luminance_at(later->frame.reference, i);
        change[1] = now[1] - spot_luminance(&spot, before->frame.reference);
    }
    if (!isfinite(change[0]) || !isfinite(change[1])) return;
    if (has_reference && !add_squares(&later->frame, &before->frame, i, &spot, scale, sums)) return;
    blocks_add_step(c->blocks, t, x, y, now, change);
    for (int k = 0; k < 2; ++k) {
        sums->now[k] += now[k];
        sums->step[k] += fabs(change[k]);
    }
    ++sums->pixels;
}

static void measure_step(struct kl_coherence *c, uint32_t t, const struct view *later,
                         const struct view *before)
{
    const bool has_reference = later->frame.reference[0] != NULL;
    const double scale = exposure(later);
    struct kl_coherence_step *step = &c->steps[t];
    struct sums s = {0};

    for (uint32_t y = 0; y < c->height; ++y) {
        for (uint32_t x = 0; x < c->width; ++x)
            measure_pixel(c, t, later, before, x, y, scale, &s);
    }
    c->followed += s.pixels;
    step->followed = (double)s.pixels / ((double)c->width * c->height);
    step->step = s.pixels > 0 && s.now[0] > 0.0 ? s.step[0] / s.now[0] : (double)NAN;
    step->reference_step = step->t_mse = step->t_relmse = NAN;
    if (!has_reference || s.pixels == 0) return;
    if (s.now[1] > 0.0) step->reference_step = s.step[1] / s.now[1];
    step->t_mse = s.square / (3.0 * (double)s.pixels);
    step->t_relmse = s.relative / (3.0 * (double)s.pixels);
}

kl_status kl_coherence_add(struct kl_coherence *coherence, const struct kl_coherence_frame *frame,
                           struct kl_err *err)
{
    struct kl_coherence *c = coherence;
    struct view *now = &c->views[c->added % 2];
    const struct view *later = c->added > 0 ? &c->views[(c->added + 1) % 2] : NULL;

    if (c->added == c->frames) return kl_fail(err, KL_ERR_USAGE, "more frames than were announced");
    const uint32_t t = c->frames - 1 - c->added;
    now->frame = *frame;
    find_inner(now);
    if (frame->reference[0] != NULL) blocks_add_frame(c->blocks, t, now);
    if (later != NULL) measure_step(c, t + 1, later, now);
    ++c->added;
    return tracks_add(c->tracks, later, now, err);
}

/* Mean over the frames that have a value; NAN where none has. */
static double mean_of_steps(const struct kl_coherence *c, size_t offset)
{
    double sum = 0.0;
    uint32_t n = 0;

    for (uint32_t t = 1; t < c->frames; ++t) {
        const double v = *(const double *)(const void *)((const char *)&c->steps[t] + offset);
        if (isnan(v)) continue;
        sum += v;
        ++n;
    }
    return n > 0 ? sum / n : (double)NAN;
}

kl_status kl_coherence_finish(struct kl_coherence *coherence, struct kl_coherence_result *out,
                              struct kl_err *err)
{
    struct kl_coherence *c = coherence;

    if (c->added != c->frames) {
        return kl_fail(err, KL_ERR_USAGE, "%u of %u frames were added", c->added, c->frames);
    }
    *out = (struct kl_coherence_result){.frames = c->frames, .steps = c->steps};
    const bool has_reference = c->views[0].frame.reference[0] != NULL;
    kl_status st = tracks_finish(c->tracks, has_reference, out, err);
    if (st != KL_OK) return st;
    blocks_finish(c->blocks, has_reference, c->steps, out);
    out->followed = (double)c->followed / ((double)c->width * c->height * (c->frames - 1));
    out->t_mse = mean_of_steps(c, offsetof(struct kl_coherence_step, t_mse));
    out->t_relmse = mean_of_steps(c, offsetof(struct kl_coherence_step, t_relmse));
    return KL_OK;
}
