/* Flicker of surface points that stand still. A point begins at the middle of a pixel in the last
 * frame that shows it and is followed backwards with the motion vectors between pixels. */
#include "sequences/coherence_impl.h"
#include "src/base/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double darkest = 1e-3;   /* of the mean luminance */
static const double same_place = 0.5; /* [pixels] that a point may seem to move in the world */

/* Points come together where the camera moves away: this many are kept. */
static const unsigned char most_in_pixel = 4;

/* Welford's running moments. */
struct moments {
    double mean, square;
};

struct track {
    float x, y; /* in the frame that was added last */
    uint32_t id, count;
    size_t seed; /* pixel of the last frame, or SIZE_MAX */
    float position[3];
    struct moments test, reference;
};

struct finished {
    float flicker, reference, mean;
    uint32_t count;
    size_t seed;
};

struct tracks {
    uint32_t width, height, least;
    struct track *live;
    size_t live_count, live_capacity;
    struct finished *finished;
    size_t finished_count, finished_capacity;
    unsigned char *crowd; /* points in each pixel of the frame */
    float *heat;
};

kl_status tracks_create(uint32_t width, uint32_t height, uint32_t frames, struct tracks **out,
                        struct kl_err *err)
{
    const size_t pixels = (size_t)width * height;
    struct tracks *t = NULL;
    kl_status st = kl_alloc_array(&t, 1, sizeof *t, err);

    if (st != KL_OK) return st;
    t->width = width;
    t->height = height;
    t->least = frames < KL_COHERENCE_LEAST_FRAMES ? frames : KL_COHERENCE_LEAST_FRAMES;
    st = kl_alloc_array(&t->crowd, pixels, 1, err);
    if (st == KL_OK) st = kl_alloc_array(&t->heat, pixels, sizeof *t->heat, err);
    if (st != KL_OK) {
        tracks_destroy(t);
        return st;
    }
    for (size_t i = 0; i < pixels; ++i)
        t->heat[i] = NAN;
    *out = t;
    return KL_OK;
}

void tracks_destroy(struct tracks *tracks)
{
    if (tracks == NULL) return;
    free(tracks->live);
    free(tracks->finished);
    free(tracks->crowd);
    free(tracks->heat);
    free(tracks);
}

static void add_moment(struct moments *m, uint32_t count, double value)
{
    const double d = value - m->mean;

    m->mean += d / count;
    m->square += d * (value - m->mean);
}

static double relative_deviation(const struct moments *m, uint32_t count)
{
    return m->mean > 0.0 ? sqrt(m->square / (count - 1)) / m->mean : 0.0;
}

static kl_status end_track(struct tracks *t, const struct track *track, struct kl_err *err)
{
    if (track->count < t->least || !(track->test.mean > 0.0)) return KL_OK;
    kl_status st = kl_grow_array(&t->finished, &t->finished_capacity, t->finished_count + 1,
                                 sizeof *t->finished, err);
    if (st != KL_OK) return st;
    struct finished *f = &t->finished[t->finished_count++];
    f->flicker = (float)relative_deviation(&track->test, track->count);
    f->reference = (float)relative_deviation(&track->reference, track->count);
    f->mean = (float)track->test.mean;
    f->count = track->count;
    f->seed = track->seed;
    return KL_OK;
}

/* Distance in the world between a pixel and its neighbours, the larger of both axes. */
static double footprint(const struct view *v, size_t i)
{
    double size = 0.0;

    for (int axis = 0; axis < 2; ++axis) {
        const size_t step = axis == 0 ? 1 : v->width;
        double square = 0.0;
        for (int c = 0; c < 3; ++c) {
            const float *p = v->frame.position[c];
            const double d = ((double)p[i + step] - (double)p[i - step]) / 2;
            square += d * d;
        }
        size = fmax(size, square);
    }
    return sqrt(size);
}

static bool is_at_rest(const struct track *track, const struct spot *spot, const struct view *v)
{
    double square = 0.0;

    if (v->frame.position[0] == NULL) return true;
    for (int c = 0; c < 3; ++c) {
        const double d = spot_value(spot, v->frame.position[c]) - (double)track->position[c];
        square += d * d;
    }
    return sqrt(square) <= same_place * footprint(v, spot->at[0]);
}

static bool sample(struct track *track, const struct spot *spot, const struct view *v)
{
    const double y = spot_luminance(spot, v->frame.test);

    if (!isfinite(y)) return false;
    ++track->count;
    add_moment(&track->test, track->count, y);
    if (v->frame.reference[0] != NULL) {
        add_moment(&track->reference, track->count, spot_luminance(spot, v->frame.reference));
    }
    return true;
}

/* Take a track one frame back. False where it ends. */
static bool advance(struct tracks *t, struct track *track, const struct view *later,
                    const struct view *now)
{
    struct spot spot;

    if (!find_spot(later, (double)track->x, (double)track->y, &spot)) return false;
    const double depth = spot_value(&spot, later->frame.depth);
    track->x += (float)spot_value(&spot, later->frame.motion[0]);
    track->y += (float)spot_value(&spot, later->frame.motion[1]);
    if (!find_spot(now, (double)track->x, (double)track->y, &spot)) return false;
    if (!spot_is_inner(&spot, now, track->id) || !is_at_rest(track, &spot, now)) return false;
    const double ratio = spot_value(&spot, now->frame.depth) / depth;
    if (!(fabs(ratio - 1.0) <= 0.25)) return false;
    const size_t pixel = (size_t)track->y * now->width + (size_t)track->x;
    if (t->crowd[pixel] == most_in_pixel || !sample(track, &spot, now)) return false;
    ++t->crowd[pixel];
    return true;
}

static kl_status begin_tracks(struct tracks *t, const struct view *now, bool is_last,
                              struct kl_err *err)
{
    const size_t pixels = (size_t)t->width * t->height;

    for (size_t i = 0; i < pixels; ++i) {
        if (!now->inner[i] || t->crowd[i] > 0) continue;
        kl_status st =
            kl_grow_array(&t->live, &t->live_capacity, t->live_count + 1, sizeof *t->live, err);
        if (st != KL_OK) return st;
        struct track *track = &t->live[t->live_count];
        const struct spot spot = {.at = {i}, .weight = {1.0}, .used = 1};
        *track = (struct track){.x = (float)(i % t->width) + 0.5f,
                                .y = (float)(i / t->width) + 0.5f,
                                .id = now->frame.ids[i],
                                .seed = is_last ? i : SIZE_MAX};
        for (int c = 0; c < 3 && now->frame.position[0] != NULL; ++c)
            track->position[c] = now->frame.position[c][i];
        if (sample(track, &spot, now)) ++t->live_count;
    }
    return KL_OK;
}

kl_status tracks_add(struct tracks *tracks, const struct view *later, const struct view *now,
                     struct kl_err *err)
{
    struct tracks *t = tracks;
    size_t kept = 0;
    kl_status st = KL_OK;

    memset(t->crowd, 0, (size_t)t->width * t->height);
    for (size_t i = 0; later != NULL && st == KL_OK && i < t->live_count; ++i) {
        if (advance(t, &t->live[i], later, now)) {
            t->live[kept++] = t->live[i];
        } else {
            st = end_track(t, &t->live[i], err);
        }
    }
    t->live_count = kept;
    return st == KL_OK ? begin_tracks(t, now, later == NULL, err) : st;
}

static int by_flicker(const void *a, const void *b)
{
    const struct finished *x = a;
    const struct finished *y = b;

    return (x->flicker > y->flicker) - (x->flicker < y->flicker);
}

static int by_reference(const void *a, const void *b)
{
    const struct finished *x = a;
    const struct finished *y = b;

    return (x->reference > y->reference) - (x->reference < y->reference);
}

/* Drop what is too dark to have a relative deviation; frames per point are its weight. */
static void drop_dark(struct tracks *t)
{
    double sum = 0.0;
    double weight = 0.0;
    size_t kept = 0;

    for (size_t i = 0; i < t->finished_count; ++i) {
        sum += (double)t->finished[i].mean * t->finished[i].count;
        weight += t->finished[i].count;
    }
    for (size_t i = 0; i < t->finished_count; ++i) {
        if ((double)t->finished[i].mean >= darkest * sum / weight) {
            t->finished[kept++] = t->finished[i];
        }
    }
    t->finished_count = kept;
}

/* Weighted mean and 99th percentile; sorts. */
static void summarise(struct tracks *t, bool reference, double *mean, double *p99)
{
    double sum = 0.0;
    double weight = 0.0;
    double below = 0.0;
    const size_t n = t->finished_count;

    *mean = *p99 = NAN;
    if (n == 0) return;
    qsort(t->finished, n, sizeof *t->finished, reference ? by_reference : by_flicker);
    for (size_t i = 0; i < n; ++i) {
        const struct finished *f = &t->finished[i];
        sum += (double)(reference ? f->reference : f->flicker) * f->count;
        weight += f->count;
    }
    *mean = sum / weight;
    for (size_t i = 0; i < n && below < 0.99 * weight; ++i) {
        const struct finished *f = &t->finished[i];
        below += f->count;
        *p99 = (double)(reference ? f->reference : f->flicker);
    }
}

kl_status tracks_finish(struct tracks *tracks, bool has_reference, struct kl_coherence_result *out,
                        struct kl_err *err)
{
    struct tracks *t = tracks;

    for (size_t i = 0; i < t->live_count; ++i) {
        kl_status st = end_track(t, &t->live[i], err);
        if (st != KL_OK) return st;
    }
    t->live_count = 0;
    drop_dark(t);
    for (size_t i = 0; i < t->finished_count; ++i) {
        const struct finished *f = &t->finished[i];
        if (f->seed != SIZE_MAX) t->heat[f->seed] = f->flicker;
    }
    summarise(t, false, &out->flicker_mean, &out->flicker_p99);
    out->reference_flicker_mean = out->reference_flicker_p99 = NAN;
    if (has_reference) {
        summarise(t, true, &out->reference_flicker_mean, &out->reference_flicker_p99);
    }
    out->points = t->finished_count;
    out->heat = t->heat;
    return KL_OK;
}
