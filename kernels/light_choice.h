/* Choosing one of many lights for a receiver, and the chance that it is chosen. */
#ifndef KL_KERNELS_LIGHT_CHOICE_H
#define KL_KERNELS_LIGHT_CHOICE_H
#include "kernels/surface.h"

/* --- Triangles as a point sees them. --- */

/* Where a triangle light is at a time. */
typedef struct kl_light_shape {
    kl_vec3 pos, edge1, edge2;
    float area;
} kl_light_shape;

KL_FN kl_light_shape kl_light_shape_at(const kl_scene_view *s, kl_u32 light, float time)
{
    const KL_GLOBAL kl_light *l = &s->lights[light];
    kl_light_shape shape;
    if (KL_NEEDS(s, KL_NEED_MOTION) && s->light_motion[light] != KL_NONE) {
        const kl_corners k =
            kl_moved_corners(s, s->light_motion[light], &s->triangles[l->triangle], time);
        shape.pos = k.a;
        shape.edge1 = kl_v3_sub(k.b, k.a);
        shape.edge2 = kl_v3_sub(k.c, k.a);
        shape.area = 0.5f * kl_length(kl_cross(shape.edge1, shape.edge2));
        return shape;
    }
    shape.pos = kl_v3_load(l->pos);
    shape.edge1 = kl_v3_load(l->edge1);
    shape.edge2 = kl_v3_load(l->edge2);
    shape.area = l->area;
    return shape;
}

/* A triangle light as seen from a point: unit directions to its corners and the solid angle. */
typedef struct kl_spherical {
    kl_vec3 a, b, c;
    float solid_angle; /* [sr] */
} kl_spherical;

KL_FN kl_spherical kl_light_spherical(const kl_light_shape *l, kl_vec3 p)
{
    kl_spherical s;
    const kl_vec3 to = kl_v3_sub(l->pos, p);
    s.a = kl_normalize(to);
    s.b = kl_normalize(kl_v3_add(to, l->edge1));
    s.c = kl_normalize(kl_v3_add(to, l->edge2));
    /* Van Oosterom and Strackee 1983. */
    const float volume = kl_fabs(kl_dot(s.a, kl_cross(s.b, s.c)));
    const float scale = 1.0f + kl_dot(s.a, s.b) + kl_dot(s.b, s.c) + kl_dot(s.c, s.a);
    s.solid_angle = 2.0f * kl_atan2(volume, scale);
    return s;
}

/* --- The light tree. --- */

/* Cosine of max(0, a - b) from cosines and sines of a, b in [0, pi]. */
KL_FN float kl_cos_sub(float sin_a, float cos_a, float sin_b, float cos_b)
{
    return cos_a > cos_b ? 1.0f : cos_a * cos_b + sin_a * sin_b;
}
KL_FN float kl_sin_sub(float sin_a, float cos_a, float sin_b, float cos_b)
{
    return cos_a > cos_b ? 0.0f : sin_a * cos_b - cos_a * sin_b;
}
KL_FN float kl_safe_sin(float c)
{
    return kl_sqrt(kl_fmax(0.0f, 1.0f - c * c));
}

/* Bound on emitter cosine times receiver cosine, wherever the lights of a node are: what faces the
 * way the receiver does cannot shine on it. */
KL_FN float kl_light_facing(const KL_GLOBAL kl_light_node *node, kl_vec3 n)
{
    float cos_n = kl_dot(n, kl_v3_load(node->axis));
    if (node->two_sided) cos_n = -kl_fabs(cos_n);
    const float cos_most = cos_n > -node->cos_cone
                               ? cos_n * node->cos_cone - kl_safe_sin(cos_n) * node->sin_cone
                               : -1.0f; /* of the angle between the normals */
    return kl_fmax(0.5f * (1.0f - cos_most), 1e-4f);
}

/* Bound on what the lights below a node can give to a receiver, up to a common factor: power times
 * emitter cosine times receiver cosine over distance^2. 0 only where nothing can arrive. */
KL_FN float kl_light_importance(const KL_GLOBAL kl_light_node *node, kl_vec3 p, kl_vec3 n)
{
    const kl_vec3 to = kl_v3_sub(kl_v3_load(node->center), p);
    const float d2 = kl_dot(to, to);
    const float r2 = node->radius * node->radius;
    if (!(d2 > r2)) return node->power * kl_light_facing(node, n) / kl_fmax(r2, 1e-30f);
    const float nearness = 1.0f / kl_sqrt(d2);
    const float sin_u = kl_fmin(1.0f, node->radius * nearness); /* it is seen under this angle */
    const float cos_u = kl_safe_sin(sin_u);
    float cos_w = -kl_dot(to, kl_v3_load(node->axis)) * nearness;
    if (node->two_sided) cos_w = kl_fabs(cos_w);
    const float sin_w = kl_safe_sin(cos_w);
    const float cos_x = kl_cos_sub(sin_w, cos_w, node->sin_cone, node->cos_cone);
    const float sin_x = kl_sin_sub(sin_w, cos_w, node->sin_cone, node->cos_cone);
    const float bound = kl_cos_sub(sin_x, cos_x, sin_u, cos_u);
    const float cos_i = kl_dot(to, n) * nearness;
    const float receiver = kl_cos_sub(kl_safe_sin(cos_i), cos_i, sin_u, cos_u);
    if (!(bound > 0.0f && receiver > 0.0f)) return 0.0f;
    return node->power * bound * receiver * (nearness * nearness);
}

/* A child that can contribute is chosen this often at least: what outshines it may be hidden, and a
 * probability that rounds to 0 would lose its light. */
#define KL_LEAST_CHOICE (1.0f / 4096.0f)

/* Probability of going to the first of a node's two children; -1 where neither can contribute. */
KL_FN float kl_light_first(const kl_scene_view *s, kl_u32 child, kl_vec3 p, kl_vec3 n)
{
    const float a = kl_light_importance(&s->light_nodes[child], p, n);
    const float b = kl_light_importance(&s->light_nodes[child + 1u], p, n);
    if (!(a + b > 0.0f)) return -1.0f;
    if (!(a > 0.0f && b > 0.0f)) return a > 0.0f ? 1.0f : 0.0f;
    return kl_clamp(a / (a + b), KL_LEAST_CHOICE, 1.0f - KL_LEAST_CHOICE);
}

#define KL_LIGHT_CUT  32   /* nodes at most */
#define KL_LIGHT_NEAR 2.0f /* distance^2 over radius^2: measured, docs/decisions/0022 */

/* Nodes that together hold all lights that can contribute to a receiver, as far as there is room
 * none so near that its bound says little: a tree alone tosses a coin where its upper nodes
 * surround the receiver (adaptive splitting, Conty Estevez and Kulla 2018, to choose one light by).
 */
typedef struct kl_light_cut {
    kl_u32 node[KL_LIGHT_CUT];
    float weight[KL_LIGHT_CUT];
    kl_u32 count;
    float sum; /* of the weights */
} kl_light_cut;

/* Is a node seen under so large an angle that its children are better asked one by one? */
KL_FN int kl_light_is_near(const KL_GLOBAL kl_light_node *node, kl_vec3 p)
{
    const kl_vec3 to = kl_v3_sub(kl_v3_load(node->center), p);
    return kl_dot(to, to) < KL_LIGHT_NEAR * node->radius * node->radius;
}

/* Importance of a triangle that near: its radiance times the solid angle it is seen under. A sphere
 * about it would say too little of long ones, and too much of those that lie in the receiver's
 * plane. */
KL_FN float kl_light_close(const kl_scene_view *s, const KL_GLOBAL kl_light_node *node, kl_vec3 p,
                           kl_vec3 n)
{
    const KL_GLOBAL kl_light *l = &s->lights[node->light];
    const int moves = KL_NEEDS(s, KL_NEED_MOTION) && s->light_motion[node->light] != KL_NONE;
    if (l->type != KL_LIGHT_TRIANGLE || moves) return kl_light_importance(node, p, n);
    const kl_light_shape shape = kl_light_shape_at(s, node->light, KL_TIME_REFERENCE);
    const kl_spherical seen = kl_light_spherical(&shape, p);
    const float up = kl_fmax(kl_dot(seen.a, n), kl_fmax(kl_dot(seen.b, n), kl_dot(seen.c, n)));
    const float away = kl_dot(kl_v3_sub(shape.pos, p), kl_v3_load(node->axis));
    if (!(up > 0.0f) || (!node->two_sided && !(away < 0.0f))) return 0.0f;
    return node->power / shape.area * kl_fmax(seen.solid_angle, 1e-6f);
}

KL_FN void kl_light_cut_make(const kl_scene_view *s, kl_vec3 p, kl_vec3 n, kl_light_cut *cut)
{
    kl_u32 i = 0;
    cut->node[0] = 0u;
    cut->count = 1u;
    cut->sum = 0.0f;
    while (i < cut->count) {
        const KL_GLOBAL kl_light_node *node = &s->light_nodes[cut->node[i]];
        const int near = kl_light_is_near(node, p);
        if (near && node->child != KL_NONE && cut->count < KL_LIGHT_CUT) {
            cut->node[i] = node->child;
            cut->node[cut->count++] = node->child + 1u;
            continue;
        }
        const float weight = near && node->child == KL_NONE ? kl_light_close(s, node, p, n)
                                                            : kl_light_importance(node, p, n);
        if (weight > 0.0f) {
            cut->weight[i++] = weight;
            cut->sum += weight;
        } else {
            cut->node[i] = cut->node[--cut->count];
        }
    }
    const float least = KL_LEAST_CHOICE * cut->sum;
    for (i = 0; i < cut->count; ++i) {
        cut->weight[i] += least;
    }
    cut->sum += least * (float)cut->count;
}

/* Choose a light for a receiver at p with normal n; KL_NONE where none can contribute. */
KL_FN kl_u32 kl_light_choose(const kl_scene_view *s, kl_vec3 p, kl_vec3 n, float u, float *prob)
{
    *prob = 0.0f;
    if (s->light_count == 0u) return KL_NONE;
    if (u < s->far_probability) {
        *prob = s->far_probability / (float)s->far_count;
        const kl_u32 i = (kl_u32)(u / *prob);
        return i < s->far_count ? i : s->far_count - 1u;
    }
    *prob = 1.0f - s->far_probability;
    u = (u - s->far_probability) / *prob;
    kl_light_cut cut;
    kl_light_cut_make(s, p, n, &cut);
    if (cut.count == 0u) return KL_NONE;
    kl_u32 k = 0;
    float left = u * cut.sum;
    while (k + 1u < cut.count && left >= cut.weight[k])
        left -= cut.weight[k++];
    *prob *= cut.weight[k] / cut.sum;
    u = kl_clamp(left / cut.weight[k], 0.0f, 0.99999994f);
    kl_u32 node = cut.node[k];
    while (s->light_nodes[node].child != KL_NONE) {
        const kl_u32 child = s->light_nodes[node].child;
        const float first = kl_light_first(s, child, p, n);
        if (first < 0.0f) return KL_NONE;
        if (u < first) {
            node = child;
            u /= first;
            *prob *= first;
        } else {
            node = child + 1u;
            u = (u - first) / (1.0f - first);
            *prob *= 1.0f - first;
        }
        u = kl_clamp(u, 0.0f, 0.99999994f);
    }
    return s->light_nodes[node].light;
}

/* Probability with which kl_light_choose finds this light. */
KL_FN float kl_light_probability(const kl_scene_view *s, kl_u32 light, kl_vec3 p, kl_vec3 n)
{
    if (light < s->far_count) return s->far_probability / (float)s->far_count;
    float prob = 1.0f - s->far_probability;
    kl_light_cut cut;
    kl_light_cut_make(s, p, n, &cut);
    kl_u32 node = s->lights[light].leaf;
    for (;;) {
        for (kl_u32 k = 0; k < cut.count; ++k) {
            if (cut.node[k] == node) return prob * cut.weight[k] / cut.sum;
        }
        const kl_u32 parent = s->light_nodes[node].parent;
        if (parent == KL_NONE) return 0.0f;
        const kl_u32 child = s->light_nodes[parent].child;
        const float first = kl_light_first(s, child, p, n);
        if (first < 0.0f) return 0.0f;
        prob *= node == child ? first : 1.0f - first;
        node = parent;
    }
}

#endif
