#include "src/cache/falloff.h"

#include "kernels/vec.h"
#include "src/base/memory.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

enum { LEAF_POINTS = 8, MAX_DEPTH = 64 };

struct node {
    float lo[3], hi[3];
    float least;           /* smallest value below */
    uint32_t first, count; /* points of a leaf; count 0: inner node */
    uint32_t right;        /* second child; the first follows its parent */
};

struct kl_falloff {
    struct kl_falloff_point *points;
    struct node *nodes;
    uint32_t count, used;
};

static float axis_value(const struct kl_falloff_point *p, int axis)
{
    return p->pos[axis];
}

/* Quickselect about the median of one axis. Ties keep any order: the envelope does not see it. */
static void partition_median(struct kl_falloff_point *p, uint32_t n, int axis)
{
    const uint32_t middle = n / 2;
    uint32_t lo = 0;
    uint32_t hi = n - 1;
    while (lo < hi) {
        const float pivot = axis_value(&p[lo + (hi - lo) / 2], axis);
        uint32_t i = lo;
        uint32_t j = hi;
        for (;;) {
            while (axis_value(&p[i], axis) < pivot) {
                ++i;
            }
            while (axis_value(&p[j], axis) > pivot) {
                --j;
            }
            if (i >= j) break;
            const struct kl_falloff_point swap = p[i];
            p[i++] = p[j];
            p[j--] = swap;
        }
        if (middle <= j) {
            hi = j;
        } else {
            lo = j + 1;
        }
    }
}

static void set_bounds(struct node *node, const struct kl_falloff_point *p, uint32_t n)
{
    node->least = FLT_MAX;
    for (int k = 0; k < 3; ++k) {
        node->lo[k] = FLT_MAX;
        node->hi[k] = -FLT_MAX;
    }
    for (uint32_t i = 0; i < n; ++i) {
        node->least = kl_fmin(node->least, p[i].value);
        for (int k = 0; k < 3; ++k) {
            node->lo[k] = kl_fmin(node->lo[k], p[i].pos[k]);
            node->hi[k] = kl_fmax(node->hi[k], p[i].pos[k]);
        }
    }
}

struct job {
    uint32_t first, count, parent; /* parent whose second child this is, or UINT32_MAX */
};

static void build(struct kl_falloff *f)
{
    struct job stack[MAX_DEPTH];
    uint32_t depth = 0;
    stack[depth++] = (struct job){0, f->count, UINT32_MAX};
    while (depth > 0) {
        const struct job job = stack[--depth];
        struct node *node = &f->nodes[f->used];
        if (job.parent != UINT32_MAX) f->nodes[job.parent].right = f->used;
        set_bounds(node, f->points + job.first, job.count);
        if (job.count <= LEAF_POINTS) {
            node->first = job.first;
            node->count = job.count;
            ++f->used;
            continue;
        }
        int axis = 0;
        for (int k = 1; k < 3; ++k) {
            if (node->hi[k] - node->lo[k] > node->hi[axis] - node->lo[axis]) axis = k;
        }
        partition_median(f->points + job.first, job.count, axis);
        const uint32_t left = job.count / 2;
        stack[depth++] = (struct job){job.first + left, job.count - left, f->used};
        stack[depth++] = (struct job){job.first, left, UINT32_MAX};
        ++f->used;
    }
}

kl_status kl_falloff_create(const struct kl_falloff_point *points, uint32_t count,
                            struct kl_falloff **out, struct kl_err *err)
{
    struct kl_falloff *f = NULL;
    kl_status st = kl_alloc_array(&f, 1, sizeof *f, err);
    if (st != KL_OK) return st;
    f->count = count;
    st = kl_alloc_array(&f->points, count, sizeof *f->points, err);
    if (st == KL_OK) st = kl_alloc_array(&f->nodes, (size_t)count + 1, sizeof *f->nodes, err);
    if (st != KL_OK) {
        kl_falloff_destroy(f);
        return st;
    }
    for (uint32_t i = 0; i < count; ++i) {
        f->points[i] = points[i];
    }
    if (count > 0) build(f);
    *out = f;
    return KL_OK;
}

void kl_falloff_destroy(struct kl_falloff *falloff)
{
    if (falloff == NULL) return;
    free(falloff->points);
    free(falloff->nodes);
    free(falloff);
}

static float box_distance(const struct node *n, const float pos[3])
{
    float d2 = 0.0f;
    for (int k = 0; k < 3; ++k) {
        const float d = kl_fmax(0.0f, kl_fmax(n->lo[k] - pos[k], pos[k] - n->hi[k]));
        d2 += d * d;
    }
    return sqrtf(d2);
}

float kl_falloff_at(const struct kl_falloff *falloff, const float pos[3], float limit)
{
    uint32_t stack[MAX_DEPTH];
    uint32_t depth = 0;
    float best = limit;

    if (falloff->count == 0) return best;
    stack[depth++] = 0;
    while (depth > 0) {
        const uint32_t number = stack[--depth];
        const struct node *n = &falloff->nodes[number];
        if (n->least + box_distance(n, pos) >= best) continue;
        if (n->count == 0) {
            stack[depth++] = n->right;
            stack[depth++] = number + 1;
            continue;
        }
        for (uint32_t i = n->first; i < n->first + n->count; ++i) {
            const struct kl_falloff_point *p = &falloff->points[i];
            const kl_vec3 d = kl_v3(pos[0] - p->pos[0], pos[1] - p->pos[1], pos[2] - p->pos[2]);
            best = kl_fmin(best, p->value + kl_length(d));
        }
    }
    return best;
}
