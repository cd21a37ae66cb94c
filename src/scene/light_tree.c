#include "src/scene/light_tree.h"

#include "src/base/memory.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

float kl_light_power(const kl_light *l)
{
    const float y = 0.2126f * l->color[0] + 0.7152f * l->color[1] + 0.0722f * l->color[2];
    const float strongest = fmaxf(l->color[0], fmaxf(l->color[1], l->color[2]));
    const float value = fmaxf(y, 1e-3f * strongest); /* deep blue is dark, but not nothing */
    if (l->type == KL_LIGHT_TRIANGLE) return value * l->area * (l->two_sided ? 2.0f : 1.0f);
    return value * 4.0f; /* intensity over the sphere against radiance over pi */
}

struct builder {
    kl_light *lights;
    const struct kl_light_bounds *leaves; /* may be NULL */
    uint32_t *order;                      /* light numbers, partitioned in place */
    kl_light_node *nodes;
    struct kl_light_bounds *bounds; /* of every node */
    uint32_t used;
};

void kl_light_bounds_init(const kl_light *l, struct kl_light_bounds *out)
{
    for (int k = 0; k < 3; ++k) {
        const float a = l->pos[k];
        const float b = l->type == KL_LIGHT_TRIANGLE ? a + l->edge1[k] : a;
        const float c = l->type == KL_LIGHT_TRIANGLE ? a + l->edge2[k] : a;
        out->box_min[k] = fminf(a, fminf(b, c));
        out->box_max[k] = fmaxf(a, fmaxf(b, c));
    }
    out->power = kl_light_power(l);
    out->cos_cone = -1.0f;
    out->two_sided = l->two_sided;
    if (l->type != KL_LIGHT_TRIANGLE) return; /* spots are left open: cheap and safe */
    const kl_vec3 n = kl_normalize(kl_cross(kl_v3_load(l->edge1), kl_v3_load(l->edge2)));
    out->axis[0] = n.x;
    out->axis[1] = n.y;
    out->axis[2] = n.z;
    out->cos_cone = 1.0f;
}

/* A cone that holds two cones: axis and cosine into `out`; open where none narrower does. */
static void merge_cones(const struct kl_light_bounds *a, const struct kl_light_bounds *b,
                        struct kl_light_bounds *out)
{
    const kl_vec3 u = kl_v3_load(a->axis);
    kl_vec3 v = kl_v3_load(b->axis);
    out->two_sided = a->two_sided || b->two_sided;
    out->cos_cone = -1.0f;
    if (a->cos_cone <= -1.0f || b->cos_cone <= -1.0f) return;
    if (out->two_sided && kl_dot(u, v) < 0.0f) v = kl_v3_scale(v, -1.0f);
    const float angle = acosf(kl_clamp(kl_dot(u, v), -1.0f, 1.0f));
    const float half_a = acosf(kl_clamp(a->cos_cone, -1.0f, 1.0f));
    const float half_b = acosf(kl_clamp(b->cos_cone, -1.0f, 1.0f));
    const kl_vec3 middle = kl_v3_add(u, v);
    if (kl_dot(middle, middle) < 1e-4f) return;
    /* About the bisector the cone must reach both outer rims. */
    const float reach = 0.5f * angle + fmaxf(half_a, half_b) + 1e-3f;
    if (reach >= KL_PI) return;
    const kl_vec3 axis = kl_normalize(middle);
    out->axis[0] = axis.x;
    out->axis[1] = axis.y;
    out->axis[2] = axis.z;
    out->cos_cone = cosf(reach);
}

void kl_light_bounds_merge(const struct kl_light_bounds *a, const struct kl_light_bounds *b,
                           struct kl_light_bounds *out)
{
    for (int k = 0; k < 3; ++k) {
        out->box_min[k] = fminf(a->box_min[k], b->box_min[k]);
        out->box_max[k] = fmaxf(a->box_max[k], b->box_max[k]);
    }
    out->power = a->power + b->power;
    merge_cones(a, b, out);
}

/* What the kernels ask a node. The sphere makes up for its centre's rounding. */
static void set_bounds(kl_light_node *node, const struct kl_light_bounds *b)
{
    double r2 = 0.0;
    double off2 = 0.0;
    for (int k = 0; k < 3; ++k) {
        const double lo = (double)b->box_min[k];
        const double hi = (double)b->box_max[k];
        node->center[k] = (float)(0.5 * (lo + hi));
        node->axis[k] = b->axis[k];
        r2 += 0.25 * (hi - lo) * (hi - lo);
        off2 += pow(0.5 * (lo + hi) - (double)node->center[k], 2.0);
    }
    node->radius = (float)((sqrt(r2) + sqrt(off2)) * (1.0 + 1e-6));
    node->cos_cone = b->cos_cone;
    node->sin_cone = sqrtf(fmaxf(0.0f, 1.0f - b->cos_cone * b->cos_cone));
    node->power = b->power;
    node->two_sided = b->two_sided;
}

static float light_center(const kl_light *l, int axis)
{
    if (l->type != KL_LIGHT_TRIANGLE) return l->pos[axis];
    return l->pos[axis] + (l->edge1[axis] + l->edge2[axis]) * (1.0f / 3.0f);
}

/* Partition order[first, last) about the middle of the longest side of the centres' box, then by
 * number where all centres coincide. Deterministic. */
static uint32_t split_lights(struct builder *b, uint32_t first, uint32_t last)
{
    float lo[3] = {FLT_MAX, FLT_MAX, FLT_MAX};
    float hi[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX};
    for (uint32_t i = first; i < last; ++i) {
        for (int k = 0; k < 3; ++k) {
            const float c = light_center(&b->lights[b->order[i]], k);
            lo[k] = fminf(lo[k], c);
            hi[k] = fmaxf(hi[k], c);
        }
    }
    int axis = 0;
    for (int k = 1; k < 3; ++k) {
        if (hi[k] - lo[k] > hi[axis] - lo[axis]) axis = k;
    }
    const float middle = 0.5f * (lo[axis] + hi[axis]);
    uint32_t split = first;
    for (uint32_t i = first; i < last; ++i) {
        if (light_center(&b->lights[b->order[i]], axis) < middle) {
            const uint32_t swap = b->order[i];
            b->order[i] = b->order[split];
            b->order[split++] = swap;
        }
    }
    return split == first || split == last ? first + (last - first) / 2 : split;
}

struct job {
    uint32_t node, first, last;
};

/* Top-down with an explicit stack; children always follow their parent in the array. */
static void split_all(struct builder *b, uint32_t count, struct job *stack)
{
    uint32_t depth = 0;
    b->used = 1;
    b->nodes[0].parent = KL_NONE;
    stack[depth++] = (struct job){0, 0, count};
    while (depth > 0) {
        const struct job job = stack[--depth];
        kl_light_node *node = &b->nodes[job.node];
        node->child = KL_NONE;
        node->light = KL_NONE;
        if (job.last - job.first == 1) {
            const uint32_t number = b->order[job.first];
            if (b->leaves != NULL) {
                b->bounds[job.node] = b->leaves[number];
            } else {
                kl_light_bounds_init(&b->lights[number], &b->bounds[job.node]);
            }
            node->light = number;
            b->lights[number].leaf = job.node;
            continue;
        }
        const uint32_t split = split_lights(b, job.first, job.last);
        node->child = b->used;
        b->nodes[b->used].parent = job.node;
        b->nodes[b->used + 1].parent = job.node;
        stack[depth++] = (struct job){b->used, job.first, split};
        stack[depth++] = (struct job){b->used + 1, split, job.last};
        b->used += 2;
    }
}

kl_status kl_light_tree_build(kl_light *lights, uint32_t first, uint32_t count,
                              const struct kl_light_bounds *leaves, kl_light_node **nodes,
                              uint32_t *node_count, struct kl_err *err)
{
    struct builder b = {.lights = lights, .leaves = leaves};
    struct job *stack = NULL;
    const uint32_t n = count - first;
    kl_status st = KL_OK;

    *nodes = NULL;
    *node_count = 0;
    if (n == 0) return KL_OK;
    st = kl_alloc_array(&b.nodes, 2 * (size_t)n - 1, sizeof *b.nodes, err);
    if (st == KL_OK) st = kl_alloc_array(&b.bounds, 2 * (size_t)n - 1, sizeof *b.bounds, err);
    if (st == KL_OK) st = kl_alloc_array(&b.order, n, sizeof *b.order, err);
    if (st == KL_OK) st = kl_alloc_array(&stack, (size_t)n + 1, sizeof *stack, err);
    if (st != KL_OK) goto cleanup;
    for (uint32_t i = 0; i < n; ++i) {
        b.order[i] = first + i;
    }
    split_all(&b, n, stack);
    for (uint32_t i = b.used; i-- > 0;) {
        const uint32_t child = b.nodes[i].child;
        if (child != KL_NONE) {
            kl_light_bounds_merge(&b.bounds[child], &b.bounds[child + 1], &b.bounds[i]);
        }
        set_bounds(&b.nodes[i], &b.bounds[i]);
    }
    *nodes = b.nodes;
    *node_count = b.used;
    b.nodes = NULL;

cleanup:
    free(stack);
    free(b.order);
    free(b.bounds);
    free(b.nodes);
    return st;
}
