#include "src/render/swept.h"

#include "src/base/memory.h"

#include <math.h>
#include <stdlib.h>

static const float margin = 1e-4f; /* of the scene's radius: faces that touch */

struct box {
    float lo[3], hi[3];
};

struct kl_swept {
    uint32_t count;
    float margin;
    struct box boxes[]; /* one for each thing that moves */
};

static void add(struct box *box, kl_vec3 p)
{
    const float c[3] = {p.x, p.y, p.z};
    for (int k = 0; k < 3; ++k) {
        box->lo[k] = fminf(box->lo[k], c[k]);
        box->hi[k] = fmaxf(box->hi[k], c[k]);
    }
}

/* All places of all corners of an instance, at the steps of its motion. Between two steps vertices
 * go straight, and stay in the box. */
static struct box sweep(const kl_scene_view *view, uint32_t instance)
{
    const kl_moving *m = &view->moving[instance];
    const kl_instance *in = &view->instances[instance];
    struct box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

    for (uint32_t k = 0; k < m->steps; ++k) {
        const float time = m->steps > 1 ? (float)k / (float)(m->steps - 1) : 0.0f;
        const kl_map x = m->deforms ? (kl_map){{0}} : kl_map_at(view, m, time);
        for (uint32_t t = 0; t < in->triangle_count; ++t) {
            const kl_triangle *triangle = &view->triangles[in->first_triangle + t];
            const kl_corners c = m->deforms ? kl_corners_at(m, view->step_positions, triangle, time)
                                            : kl_corners_of(view->positions, triangle);
            add(&box, m->deforms ? c.a : kl_map_point(&x, c.a));
            add(&box, m->deforms ? c.b : kl_map_point(&x, c.b));
            add(&box, m->deforms ? c.c : kl_map_point(&x, c.c));
        }
    }
    return box;
}

kl_status kl_swept_create(const struct kl_motion *motion, struct kl_swept **out, struct kl_err *err)
{
    struct kl_swept *s = NULL;
    kl_status st =
        kl_alloc_array(&s, 1, sizeof *s + motion->instance_count * sizeof(struct box), err);

    if (st != KL_OK) return st;
    s->margin = margin * motion->view.scene_radius;
    for (uint32_t i = 0; i < motion->instance_count; ++i) {
        if (motion->moving[i].steps > 0) s->boxes[s->count++] = sweep(&motion->view, i);
    }
    *out = s;
    return KL_OK;
}

void kl_swept_destroy(struct kl_swept *swept)
{
    free(swept);
}

static bool is_near(const struct kl_swept *s, kl_vec3 p)
{
    const float c[3] = {p.x, p.y, p.z};
    for (uint32_t i = 0; i < s->count; ++i) {
        bool inside = true;
        for (int k = 0; k < 3; ++k) {
            inside = inside && c[k] >= s->boxes[i].lo[k] - s->margin &&
                     c[k] <= s->boxes[i].hi[k] + s->margin;
        }
        if (inside) return true;
    }
    return false;
}

/* Inside: the first thing over the surface shows its back. */
bool kl_swept_covers(const struct kl_swept *swept, const kl_scene_view *reference,
                     const kl_surface *surface)
{
    kl_hit hit;
    kl_surface over;

    if (swept == NULL || !is_near(swept, surface->pos)) return false;
    const kl_ray ray = kl_ray_make(kl_leave_surface(reference, surface->pos, surface->geometric),
                                   surface->geometric, KL_INF);
    if (!kl_trace_closest(reference, &ray, &hit)) return false;
    kl_surface_at(reference, &ray, &hit, &over);
    return !over.front;
}
