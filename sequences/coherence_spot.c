#include "sequences/coherence_impl.h"

#include <math.h>
#include <string.h>

static const double snap = 1.0 / 256.0;
static const double neighbour_normal_cos = 0.9;
static const double followed_normal_cos = 0.8; /* things may turn by 37 degrees in a frame */
static const double depth_bend = 0.01;         /* second difference of 1 / depth, relative */
static const double depth_change = 0.25;       /* from a frame to the next, relative */

double luminance_at(const float *const rgb[3], size_t i)
{
    return 0.2126 * (double)rgb[0][i] + 0.7152 * (double)rgb[1][i] + 0.0722 * (double)rgb[2][i];
}

static bool normals_agree(const struct kl_coherence_frame *a, size_t i,
                          const struct kl_coherence_frame *b, size_t j, double least_cos)
{
    double dot = 0.0;

    if (a->normal[0] == NULL || b->normal[0] == NULL) return true;
    for (int c = 0; c < 3; ++c)
        dot += (double)a->normal[c][i] * (double)b->normal[c][j];
    return dot >= least_cos;
}

/* 1 / depth is linear on the screen over a plane. `step`: from the pixel to one neighbour, the
 * other lies opposite. */
static bool is_smooth(const struct kl_coherence_frame *f, size_t i, size_t step)
{
    const double w = 1.0 / (double)f->depth[i];
    const double bend = 1.0 / (double)f->depth[i - step] + 1.0 / (double)f->depth[i + step] - 2 * w;

    return fabs(bend) <= depth_bend * fabs(w);
}

static bool is_inner(const struct view *v, uint32_t x, uint32_t y)
{
    const struct kl_coherence_frame *f = &v->frame;
    const size_t w = v->width;
    const size_t i = y * w + x;

    if (f->ids[i] == UINT32_MAX || !isfinite(f->depth[i]) || !(f->depth[i] > 0.0f)) return false;
    for (size_t ny = y - 1; ny <= (size_t)y + 1; ++ny) {
        for (size_t nx = x - 1; nx <= (size_t)x + 1; ++nx) {
            const size_t n = ny * w + nx;
            if (f->ids[n] != f->ids[i]) return false;
            if (!normals_agree(f, i, f, n, neighbour_normal_cos)) return false;
        }
    }
    return is_smooth(f, i, 1) && is_smooth(f, i, w);
}

void find_inner(struct view *view)
{
    const struct view *v = view;

    memset(v->inner, 0, (size_t)v->width * v->height);
    for (uint32_t y = 1; y + 1 < v->height; ++y) {
        for (uint32_t x = 1; x + 1 < v->width; ++x)
            v->inner[(size_t)y * v->width + x] = is_inner(v, x, y);
    }
}

static void split(double at, uint32_t side, size_t *first, double *rest)
{
    const double base = floor(at);

    *first = (size_t)base;
    *rest = at - base;
    if (*rest > 1.0 - snap && *first + 1 < side) {
        ++*first;
        *rest = 0.0;
    }
    if (*rest < snap) *rest = 0.0;
}

bool find_spot(const struct view *view, double x, double y, struct spot *spot)
{
    const double px = x - 0.5;
    const double py = y - 0.5;
    size_t x0, y0;
    double fx, fy;

    if (!(px > -snap && py > -snap && px < view->width - 1 + snap &&
          py < view->height - 1 + snap)) {
        return false;
    }
    split(fmax(px, 0.0), view->width, &x0, &fx);
    split(fmax(py, 0.0), view->height, &y0, &fy);
    spot->used = 0;
    for (size_t k = 0; k < 4; ++k) {
        const double weight = (k & 1 ? fx : 1.0 - fx) * (k & 2 ? fy : 1.0 - fy);
        if (weight == 0.0) continue;
        spot->at[spot->used] = (y0 + (k >> 1)) * view->width + x0 + (k & 1);
        spot->weight[spot->used++] = weight;
    }
    return true;
}

double spot_value(const struct spot *spot, const float *data)
{
    double sum = 0.0;

    for (int k = 0; k < spot->used; ++k)
        sum += spot->weight[k] * (double)data[spot->at[k]];
    return sum;
}

double spot_luminance(const struct spot *spot, const float *const rgb[3])
{
    double sum = 0.0;

    for (int k = 0; k < spot->used; ++k)
        sum += spot->weight[k] * luminance_at(rgb, spot->at[k]);
    return sum;
}

bool spot_is_inner(const struct spot *spot, const struct view *view, uint32_t id)
{
    for (int k = 0; k < spot->used; ++k) {
        if (!view->inner[spot->at[k]] || view->frame.ids[spot->at[k]] != id) return false;
    }
    return true;
}

bool follow(const struct view *later, uint32_t x, uint32_t y, const struct view *now,
            struct spot *spot)
{
    const struct kl_coherence_frame *f = &later->frame;
    const struct kl_coherence_frame *g = &now->frame;
    const size_t i = (size_t)y * later->width + x;
    const uint32_t id = f->ids[i];
    const double mx = (double)f->motion[0][i];
    const double my = (double)f->motion[1][i];

    if (id == UINT32_MAX || !find_spot(now, x + 0.5 + mx, y + 0.5 + my, spot)) return false;
    const bool rests = spot->used == 1 && spot->at[0] == i;
    if (rests && g->ids[i] != id) return false;
    if (!rests && !(later->inner[i] && spot_is_inner(spot, now, id))) return false;
    for (int k = 0; k < spot->used; ++k) {
        if (!normals_agree(f, i, g, spot->at[k], followed_normal_cos)) return false;
    }
    const double ratio = spot_value(spot, g->depth) / (double)f->depth[i];
    return fabs(ratio - 1.0) <= depth_change;
}
