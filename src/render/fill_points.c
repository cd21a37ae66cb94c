#include "src/render/fill_points.h"

#include "kernels/bsdf.h"
#include "src/base/memory.h"

#include <math.h>
#include <stdlib.h>

enum { WALKS = 16384, WALK_LENGTH = 4, MIRRORS = 8, LOOKS = 4, LOOK_EVERY = 4 };
static const float mirror_alpha = 0.1f;        /* smoother lobes are followed as mirrors */
static const float world_spacing = 1.0f / 384; /* of the scene radius: "pixel" of the world stage */

/* A record exactly on an edge would see through the surface that meets it there: points are moved
 * towards the middle of their triangle by this share of a pixel. */
static const float inward = 0.1f;

static kl_vec3 move_inward(const kl_scene_view *scene, const kl_hit *hit, kl_vec3 pos, float pixel)
{
    const kl_triangle *t = &scene->triangles[hit->triangle];
    kl_vec3 middle = kl_v3_splat(0.0f);
    for (int k = 0; k < 3; ++k) {
        middle = kl_v3_mad(middle, 1.0f / 3.0f, kl_v3_load(scene->positions + 3 * (size_t)t->v[k]));
    }
    middle = kl_affine_point(scene->instances[hit->instance].render_from_object, middle);
    const kl_vec3 way = kl_v3_sub(middle, pos);
    const float length = kl_length(way);
    if (!(length > 0.0f)) return pos;
    return kl_v3_mad(pos, kl_fmin(inward * pixel / length, 0.05f), way);
}

static struct kl_point point_of(const kl_scene_view *scene, const kl_hit *hit, const kl_surface *s,
                                float pixel, uint32_t rank)
{
    const kl_vec3 pos = move_inward(scene, hit, s->pos, pixel);
    return (struct kl_point){pos, s->smooth, s->geometric, pixel, KL_INF, rank, false};
}

/* First surface with a base along a ray, through mirrors. *length grows by the way there. */
static bool find_diffuse(const kl_scene_view *scene, kl_ray ray, uint32_t seed, kl_hit *hit,
                         kl_surface *s, float *length)
{
    for (int k = 0; k < MIRRORS; ++k) {
        if (!kl_intersect(scene, &ray, seed + (uint32_t)k, hit)) return false;
        kl_surface_at(scene, &ray, hit, s);
        *length += hit->t;
        if (!kl_is_black(s->diffuse)) return true;
        if (!kl_has_specular(s) || kl_ggx_alpha(s) > mirror_alpha) return false;
        const float c = kl_dot(ray.dir, s->shading);
        const kl_vec3 dir = kl_normalize(kl_v3_mad(ray.dir, -2.0f * c, s->shading));
        if (!(kl_dot(dir, s->geometric) > 0.0f)) return false;
        ray = kl_ray_make(kl_leave_surface(scene, s->pos, s->geometric), dir, KL_INF);
    }
    return false;
}

/* Harmonic mean distance of what is around a point: something that hangs close over it, which
 * records further away may not have noticed. */
static float look_around(const kl_scene_view *scene, const struct kl_point *p)
{
    const kl_frame f = kl_frame_from_normal(p->smooth);
    kl_sampler sampler = kl_sampler_make(p->rank, 0x51ed270bu);
    float inverse = 0.0f;
    for (uint32_t k = 0; k < LOOKS; ++k) {
        const kl_vec3 dir = kl_frame_to_world(&f, kl_cosine_direction(kl_sampler_2d(&sampler)));
        const kl_ray ray = kl_ray_make(kl_leave_surface(scene, p->pos, p->geometric), dir, KL_INF);
        kl_hit hit;
        if (!(kl_dot(dir, p->geometric) > 0.0f)) continue;
        if (kl_intersect(scene, &ray, p->rank + k, &hit)) inverse += 1.0f / kl_fmax(hit.t, 1e-30f);
    }
    return inverse > 0.0f ? (float)LOOKS / inverse : KL_INF;
}

kl_status kl_fill_screen_points(const struct kl_fill_job *job, uint32_t camera, uint32_t every,
                                struct kl_point **points, size_t *count, struct kl_err *err)
{
    const struct kl_camera *c = &job->cameras[camera];
    const uint32_t left = camera % every; /* neighbouring frames look at other pixels */
    const uint32_t top = camera / every % every;
    const size_t columns = (c->width - left + every - 1) / every;
    const size_t rows = (c->height - top + every - 1) / every;
    struct kl_point *p = NULL;
    size_t kept = 0;
    kl_status st = kl_alloc_array(&p, columns * rows, sizeof *p, err);

    if (st != KL_OK) return st;
#pragma omp parallel for schedule(dynamic, 64)
    for (size_t i = 0; i < columns * rows; ++i) {
        const uint32_t x = left + every * (uint32_t)(i % columns);
        const uint32_t y = top + every * (uint32_t)(i / columns);
        const uint32_t pixel = y * c->width + x;
        const kl_ray ray = kl_camera_ray(c, (float)x + 0.5f, (float)y + 0.5f);
        kl_hit hit;
        kl_surface s;
        float length = 0.0f;
        p[i].covered = !find_diffuse(job->scene, ray, pixel * MIRRORS, &hit, &s, &length);
        if (!p[i].covered) {
            p[i] = point_of(job->scene, &hit, &s, kl_camera_pixel_size(c, length),
                            kl_hash2(pixel, camera + 0x7f4a7c15u));
            const bool looks = i % columns % LOOK_EVERY == 0 && i / columns % LOOK_EVERY == 0;
            if (looks) p[i].near = look_around(job->scene, &p[i]);
        }
    }
    for (size_t i = 0; i < columns * rows; ++i) {
        if (!p[i].covered) p[kept++] = p[i];
    }
    *points = p;
    *count = kept;
    return KL_OK;
}

/* One walk: cosine-distributed bounces; the camera's own hit is not a gather hit. */
static size_t walk(const struct kl_fill_job *job, uint32_t number, struct kl_point out[WALK_LENGTH])
{
    kl_sampler sampler = kl_sampler_make(number, 0x2545f491u);
    const struct kl_camera *c =
        &job->cameras[(uint32_t)((uint64_t)number * job->camera_count / WALKS)];
    const kl_vec2 u = kl_sampler_2d(&sampler);
    kl_ray ray = kl_camera_ray(c, u.x * (float)c->width, u.y * (float)c->height);
    size_t count = 0;

    for (int k = 0; k <= WALK_LENGTH; ++k) {
        kl_hit hit;
        kl_surface s;
        if (!kl_intersect(job->scene, &ray, number + (uint32_t)k, &hit)) break;
        kl_surface_at(job->scene, &ray, &hit, &s);
        if (k > 0) {
            out[count++] = point_of(job->scene, &hit, &s, world_spacing * job->scene_radius,
                                    kl_hash2(number * WALK_LENGTH + (uint32_t)k, 0x9e3779b9u));
        }
        const kl_frame f = kl_frame_from_normal(s.smooth);
        const kl_vec3 dir = kl_frame_to_world(&f, kl_cosine_direction(kl_sampler_2d(&sampler)));
        if (!(kl_dot(dir, s.geometric) > 0.0f)) break;
        ray = kl_ray_make(kl_leave_surface(job->scene, s.pos, s.geometric), dir, KL_INF);
    }
    return count;
}

kl_status kl_fill_world_points(const struct kl_fill_job *job, struct kl_point **points,
                               size_t *count, struct kl_err *err)
{
    struct kl_point *p = NULL;
    uint8_t *lengths = NULL;
    size_t kept = 0;
    kl_status st = kl_alloc_array(&p, (size_t)WALKS * WALK_LENGTH, sizeof *p, err);

    if (st == KL_OK) st = kl_alloc_array(&lengths, WALKS, 1, err);
    if (st != KL_OK || job->camera_count == 0) {
        free(p);
        free(lengths);
        *points = NULL;
        *count = 0;
        return st;
    }
#pragma omp parallel for schedule(dynamic, 64)
    for (uint32_t i = 0; i < WALKS; ++i) {
        lengths[i] = (uint8_t)walk(job, i, p + (size_t)i * WALK_LENGTH);
    }
    for (size_t i = 0; i < WALKS; ++i) {
        for (size_t k = 0; k < lengths[i]; ++k) {
            p[kept++] = p[i * WALK_LENGTH + k];
        }
    }
    free(lengths);
    *points = p;
    *count = kept;
    return KL_OK;
}

bool kl_fill_find_surface(const kl_scene_view *scene, const kl_record_hot *hot, kl_hit *hit,
                          kl_surface *out)
{
    const kl_vec3 n = kl_oct_decode(hot->normal);
    const float height = 1e-4f * scene->scene_radius;
    const kl_vec3 from = kl_v3_mad(kl_v3_load(hot->pos), height, n);
    const kl_ray ray = kl_ray_make(from, kl_v3_scale(n, -1.0f), 2.0f * height);

    if (!kl_trace_closest(scene, &ray, hit)) return false;
    kl_surface_at(scene, &ray, hit, out);
    return kl_dot(out->smooth, n) > KL_SAME_SIDE;
}

kl_ride kl_fill_find_ride(const kl_scene_view *motion, kl_vec3 pos, kl_u32 geometric)
{
    const kl_vec3 n = kl_oct_decode(geometric);
    const kl_vec3 from = kl_leave_surface(motion, pos, n);
    kl_ride ride = {0, KL_NONE, 0.0f, 0.0f};
    kl_hit hit;

    if (!KL_NEEDS(motion, KL_NEED_MOTION)) return ride;
    const float height = kl_length(kl_v3_sub(from, pos));
    const kl_ray ray = kl_ray_make(from, kl_v3_scale(n, -1.0f), 2.0f * height);
    if (!kl_trace_closest(motion, &ray, &hit)) return ride;
    if (!kl_instance_moves(motion, hit.instance)) return ride;
    return (kl_ride){hit.instance, hit.triangle, hit.u, hit.v};
}

void kl_fill_seed(kl_gather_point *point, kl_u32 seed)
{
    const float angle = kl_unit_float(kl_hash(seed ^ 0x3c6ef372u)) * 2.0f * KL_PI;
    point->seed = seed;
    point->rot_cos = cosf(angle);
    point->rot_sin = sinf(angle);
}

kl_gather_point kl_fill_gather_point(const kl_scene_view *motion, kl_vec3 pos, kl_u32 normal,
                                     kl_u32 geometric, uint32_t level)
{
    kl_gather_point p;
    p.pos[0] = pos.x;
    p.pos[1] = pos.y;
    p.pos[2] = pos.z;
    p.normal = normal;
    p.geometric = geometric;
    kl_fill_seed(&p, kl_record_seed(p.pos, p.normal, level));
    p.on = kl_fill_find_ride(motion, pos, geometric);
    return p;
}
