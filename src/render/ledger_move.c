/* Records of a ledger go along with what they lie on. */
#include "src/render/fill_points.h"
#include "src/render/ledger_impl.h"

#include <math.h>
#include <string.h>

static const float turned = 0.9394f; /* cosine, 20 degrees: normals beyond do not share records */
static const float quick = 0.015f;   /* change of the light from which on a record is not slow */

static void age(struct kl_ledger_entry *e)
{
    e->shot = 0;
    e->faded = false;
    if (e->leaves) {
        --e->age_frames;
    } else if (e->age_frames < KL_LEDGER_FADE) {
        ++e->age_frames;
    }
    e->hasty = e->change >= quick;
    e->change = 0.0f;
    e->added = 0.0f;
}

static void put(struct kl_ledger_entry *e, kl_vec3 pos, kl_vec3 normal, kl_vec3 geometric)
{
    e->point.pos[0] = pos.x;
    e->point.pos[1] = pos.y;
    e->point.pos[2] = pos.z;
    e->point.normal = kl_oct_encode(normal);
    e->point.geometric = kl_oct_encode(geometric);
    memcpy(e->hot.pos, e->point.pos, sizeof e->hot.pos);
    e->hot.normal = e->point.normal;
}

static kl_vec3 turn(const float m[9], kl_vec3 n)
{
    return kl_normalize(kl_v3(m[0] * n.x + m[1] * n.y + m[2] * n.z,
                              m[3] * n.x + m[4] * n.y + m[5] * n.z,
                              m[6] * n.x + m[7] * n.y + m[8] * n.z));
}

/* With something that moved as a whole. */
static void go(struct kl_ledger_entry *e, const struct kl_moved_object *object)
{
    const kl_vec3 was = kl_v3_load(e->point.pos);
    const kl_vec3 looked = kl_oct_decode(e->point.normal);
    const kl_vec3 pos = kl_affine_point(object->now_from_before, was);
    const kl_vec3 normal = turn(object->normals, looked);

    put(e, pos, normal, turn(object->normals, kl_oct_decode(e->point.geometric)));
    e->step = kl_length(kl_v3_sub(pos, was));
    if (kl_dot(looked, normal) < turned) e->step = KL_INF;
}

/* With the triangle that it lies on, when its mesh deformed: all its rays have other things around
 * them. False: that triangle is gone, or has no area. */
static bool bend(struct kl_ledger_entry *e, const kl_scene_view *scene)
{
    const kl_triangle *t = &scene->triangles[e->lies.triangle];
    if (e->lies.triangle >= scene->instances[0].triangle_count || t->object != e->object) {
        return false;
    }
    const kl_corners is = kl_corners_of(scene->positions, t);
    const kl_corners from = kl_ride_basis(&e->corners);
    const kl_corners to = kl_ride_basis(&is);
    if (!(kl_dot(from.c, from.c) > 0.0f) || !(kl_dot(to.c, to.c) > 0.0f)) return false;
    const float u = e->lies.u;
    const float v = e->lies.v;
    const kl_vec3 step = kl_v3_sub(kl_lerp3(is.a, is.b, is.c, u, v),
                                   kl_lerp3(e->corners.a, e->corners.b, e->corners.c, u, v));
    const kl_vec3 normal = kl_ride_frame(&from, &to, kl_oct_decode(e->point.normal)).n;
    const kl_vec3 geometric = kl_ride_frame(&from, &to, kl_oct_decode(e->point.geometric)).n;
    put(e, kl_v3_add(kl_v3_load(e->point.pos), step), normal, geometric);
    e->step = KL_INF;
    return true;
}

void kl_ledger_move_entry(const struct kl_ledger_refresh *refresh, struct kl_ledger_entry *entry)
{
    struct kl_ledger_entry *e = entry;
    const struct kl_moved *m = refresh->moved;
    const struct kl_moved_object *object = &m->objects[e->object];
    const uint32_t except = object->moved ? e->object : KL_NONE;
    const kl_vec3 over = kl_oct_decode(e->point.normal);

    age(e);
    e->step = 0.0f;
    e->dropped = e->age_frames == 0;
    if (object->deformed) {
        e->dropped = !bend(e, refresh->job->scene) || e->dropped;
    } else if (object->moved) {
        go(e, object);
    }
    const kl_ray here = kl_ray_make(kl_v3_load(e->point.pos), over, 0.0f);
    e->dropped = e->dropped || kl_moved_meets(m->is, m->count, except, &here);
    e->point.on = kl_fill_find_ride(refresh->job->motion, here.origin, e->point.geometric);
}
