#include "src/cache/point_tree.h"

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

struct point {
    float pos[3];
    float value;
    uint32_t number;
};

struct kl_point_tree {
    struct point *points;
    struct node *nodes;
    uint32_t count, used;
};

static float axis_value(const struct point *p, int axis)
{
    return p->pos[axis];
}

/* Quickselect about the median of one axis. Ties keep any order: no answer depends on it. */
static void partition_median(struct point *p, uint32_t n, int axis)
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
            const struct point swap = p[i];
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

static void set_bounds(struct node *node, const struct point *p, uint32_t n)
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

static void build(struct kl_point_tree *f)
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

kl_status kl_point_tree_create(const struct kl_tree_point *points, uint32_t count,
                               struct kl_point_tree **out, struct kl_err *err)
{
    struct kl_point_tree *f = NULL;
    kl_status st = kl_alloc_array(&f, 1, sizeof *f, err);
    if (st != KL_OK) return st;
    f->count = count;
    st = kl_alloc_array(&f->points, count, sizeof *f->points, err);
    if (st == KL_OK) st = kl_alloc_array(&f->nodes, (size_t)count + 1, sizeof *f->nodes, err);
    if (st != KL_OK) {
        kl_point_tree_destroy(f);
        return st;
    }
    for (uint32_t i = 0; i < count; ++i) {
        const struct kl_tree_point *p = &points[i];
        f->points[i] = (struct point){{p->pos[0], p->pos[1], p->pos[2]}, p->value, i};
    }
    if (count > 0) build(f);
    *out = f;
    return KL_OK;
}

void kl_point_tree_destroy(struct kl_point_tree *tree)
{
    if (tree == NULL) return;
    free(tree->points);
    free(tree->nodes);
    free(tree);
}

static float box_distance2(const struct node *n, const float pos[3])
{
    float d2 = 0.0f;
    for (int k = 0; k < 3; ++k) {
        const float d = kl_fmax(0.0f, kl_fmax(n->lo[k] - pos[k], pos[k] - n->hi[k]));
        d2 += d * d;
    }
    return d2;
}

float kl_point_tree_envelope(const struct kl_point_tree *tree, const float pos[3], float limit)
{
    uint32_t stack[MAX_DEPTH];
    uint32_t depth = 0;
    float best = limit;

    if (tree->count == 0) return best;
    stack[depth++] = 0;
    while (depth > 0) {
        const uint32_t number = stack[--depth];
        const struct node *n = &tree->nodes[number];
        if (n->least + sqrtf(box_distance2(n, pos)) >= best) continue;
        if (n->count == 0) {
            stack[depth++] = n->right;
            stack[depth++] = number + 1;
            continue;
        }
        for (uint32_t i = n->first; i < n->first + n->count; ++i) {
            const struct point *p = &tree->points[i];
            const kl_vec3 d = kl_v3(pos[0] - p->pos[0], pos[1] - p->pos[1], pos[2] - p->pos[2]);
            best = kl_fmin(best, p->value + kl_length(d));
        }
    }
    return best;
}

struct near {
    float distance2;
    const struct point *point;
};

static bool is_nearer(const struct near *a, const struct near *b)
{
    if (a->distance2 != b->distance2) return a->distance2 < b->distance2;
    for (int k = 0; k < 3; ++k) {
        if (a->point->pos[k] != b->point->pos[k]) return a->point->pos[k] < b->point->pos[k];
    }
    if (a->point->value != b->point->value) return a->point->value < b->point->value;
    return a->point->number < b->point->number;
}

struct nearest {
    const float *pos;
    float radius2; /* what is farther does not count */
    uint32_t most, count;
    struct near best[KL_NEAREST_MOST]; /* nearest first */
};

static void consider(struct nearest *n, const struct point *p)
{
    const kl_vec3 d = kl_v3_sub(kl_v3_load(p->pos), kl_v3_load(n->pos));
    const struct near c = {kl_dot(d, d), p};
    if (!(c.distance2 <= n->radius2)) return;
    if (n->count == n->most && !is_nearer(&c, &n->best[n->count - 1])) return;
    uint32_t at = n->count < n->most ? n->count++ : n->count - 1;
    for (; at > 0 && is_nearer(&c, &n->best[at - 1]); --at) {
        n->best[at] = n->best[at - 1];
    }
    n->best[at] = c;
    if (n->count == n->most) n->radius2 = n->best[n->count - 1].distance2;
}

struct visit {
    uint32_t node;
    float distance2; /* of its box: at most that of any point in it, rounded alike */
};

uint32_t kl_point_tree_nearest(const struct kl_point_tree *tree, const float pos[3], float radius,
                               uint32_t most, uint32_t *found)
{
    struct visit stack[MAX_DEPTH];
    uint32_t depth = 0;
    struct nearest n = {.pos = pos, .radius2 = radius * radius, .most = most};

    if (tree->count > 0 && most > 0) stack[depth++] = (struct visit){0, 0.0f};
    while (depth > 0) {
        const struct visit at = stack[--depth];
        const struct node *node = &tree->nodes[at.node];
        if (at.distance2 > n.radius2) continue;
        if (node->count == 0) {
            const struct visit a = {at.node + 1, box_distance2(&tree->nodes[at.node + 1], pos)};
            const struct visit b = {node->right, box_distance2(&tree->nodes[node->right], pos)};
            stack[depth++] = a.distance2 < b.distance2 ? b : a;
            stack[depth++] = a.distance2 < b.distance2 ? a : b;
            continue;
        }
        for (uint32_t i = node->first; i < node->first + node->count; ++i) {
            consider(&n, &tree->points[i]);
        }
    }
    for (uint32_t i = 0; i < n.count; ++i) {
        found[i] = n.best[i].point->number;
    }
    return n.count;
}
