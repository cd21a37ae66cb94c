#include "src/trace/tracer.h"

#include "kernels/trace.h"
#include "src/base/memory.h"
#include "src/trace/embree_error.h"
#include "src/trace/ranges.h"

#include <embree3/rtcore.h>
#include <stdlib.h>

/* What a geometry of the top scene is: hits say which geometry and which of its triangles. */
struct target {
    uint32_t instance, first_triangle;
};

struct kl_tracer {
    struct kl_embree_error report;
    RTCDevice device;
    RTCScene scene;
    struct target *targets; /* per geometry of `scene` */
    uint32_t target_count;
    /* Borrowed. */
    const kl_instance *instances;
    const struct kl_motion *motion; /* may be NULL */
};

static void commit_scene(RTCScene scene)
{
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
    rtcCommitScene(scene);
}

/* Put a finished geometry into the top scene. */
static kl_status attach(struct kl_tracer *tracer, RTCGeometry geometry, uint32_t instance,
                        uint32_t first_triangle, const char *what, struct kl_err *err)
{
    const uint32_t id = tracer->target_count++;
    tracer->targets[id] = (struct target){instance, first_triangle};
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(tracer->scene, geometry, id);
    rtcReleaseGeometry(geometry); /* the scene holds it */
    return kl_embree_check(&tracer->report, what, err);
}

/* One triangle geometry over `count` triangles from `first`. */
static kl_status new_triangles(struct kl_tracer *tracer, const struct kl_flat *flat, uint32_t first,
                               uint32_t count, RTCGeometry *out, struct kl_err *err)
{
    RTCGeometry geometry = rtcNewGeometry(tracer->device, RTC_GEOMETRY_TYPE_TRIANGLE);

    if (geometry == NULL) return kl_embree_check(&tracer->report, "new geometry", err);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                               flat->positions, 0, 3 * sizeof(float), flat->vertex_count);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                               flat->triangles, (size_t)first * sizeof(kl_triangle),
                               sizeof(kl_triangle), count);
    rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_HIGH);
    *out = geometry;
    return KL_OK;
}

/* Merged triangles that stand still. */
static kl_status attach_still(struct kl_tracer *tracer, const struct kl_flat *flat, uint32_t first,
                              uint32_t count, struct kl_err *err)
{
    RTCGeometry geometry = NULL;
    if (count == 0) return KL_OK;
    kl_status st = new_triangles(tracer, flat, first, count, &geometry, err);
    return st == KL_OK ? attach(tracer, geometry, 0, first, "triangles", err) : st;
}

static kl_status attach_instance(struct kl_tracer *tracer, uint32_t index, RTCScene shared,
                                 struct kl_err *err)
{
    const kl_instance *instance = &tracer->instances[index];
    const struct kl_motion *motion = tracer->motion;
    RTCGeometry geometry = rtcNewGeometry(tracer->device, RTC_GEOMETRY_TYPE_INSTANCE);

    if (geometry == NULL) return kl_embree_check(&tracer->report, "new instance", err);
    rtcSetGeometryInstancedScene(geometry, shared);
    if (motion != NULL && motion->moving[index].steps > 0) {
        const kl_moving *m = &motion->moving[index];
        rtcSetGeometryTimeStepCount(geometry, m->steps);
        for (uint32_t k = 0; k < m->steps; ++k) {
            rtcSetGeometryTransform(geometry, k, RTC_FORMAT_FLOAT3X4_ROW_MAJOR,
                                    motion->matrices + 12 * (size_t)(m->first + k));
        }
    } else {
        rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR,
                                instance->render_from_object);
    }
    return attach(tracer, geometry, index, instance->first_triangle, "instance", err);
}

/* All instances of ranges[0 .. n): they share one triangle range. */
static kl_status attach_shared(struct kl_tracer *tracer, const struct kl_flat *flat,
                               const struct kl_range *ranges, size_t n, struct kl_err *err)
{
    RTCScene shared = rtcNewScene(tracer->device);
    RTCGeometry geometry = NULL;

    if (shared == NULL) return kl_embree_check(&tracer->report, "new scene", err);
    kl_status st = new_triangles(tracer, flat, ranges[0].first, ranges[0].count, &geometry, err);
    if (st == KL_OK) {
        rtcCommitGeometry(geometry);
        rtcAttachGeometryByID(shared, geometry, 0);
        rtcReleaseGeometry(geometry);
        commit_scene(shared);
        st = kl_embree_check(&tracer->report, "build", err);
    }
    for (size_t i = 0; st == KL_OK && i < n; ++i) {
        st = attach_instance(tracer, ranges[i].instance, shared, err);
    }
    rtcReleaseScene(shared); /* the instances hold it */
    return st;
}

static kl_status attach_all_shared(struct kl_tracer *tracer, const struct kl_flat *flat,
                                   struct kl_err *err)
{
    struct kl_range *ranges = NULL;
    size_t count = 0;
    kl_status st = kl_ranges_sorted(flat, &ranges, &count, err);

    if (st != KL_OK) return st;
    for (size_t i = 0, end = 0; st == KL_OK && i < count; i = end) {
        end = kl_ranges_run_end(ranges, count, i);
        st = attach_shared(tracer, flat, ranges + i, end - i, err);
    }
    free(ranges);
    return st;
}

/* Triangles whose vertices move: a vertex buffer per step, and indices that begin with the first of
 * these vertices. */
static kl_status attach_deforming(struct kl_tracer *tracer, const struct kl_flat *flat,
                                  uint32_t index, struct kl_err *err)
{
    const struct kl_motion *motion = tracer->motion;
    const kl_moving *m = &motion->moving[index];
    const kl_instance *instance = &tracer->instances[index];
    RTCGeometry geometry = rtcNewGeometry(tracer->device, RTC_GEOMETRY_TYPE_TRIANGLE);

    if (geometry == NULL) return kl_embree_check(&tracer->report, "new geometry", err);
    rtcSetGeometryTimeStepCount(geometry, m->steps);
    for (uint32_t k = 0; k < m->steps; ++k) {
        const size_t first = m->first + (size_t)k * m->vertex_count;
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, k, RTC_FORMAT_FLOAT3,
                                   motion->positions, 12 * first, 12, m->vertex_count);
    }
    uint32_t *indices =
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                3 * sizeof(uint32_t), instance->triangle_count);
    if (indices == NULL) {
        rtcReleaseGeometry(geometry);
        return kl_embree_check(&tracer->report, "indices", err);
    }
    for (size_t i = 0; i < 3 * (size_t)instance->triangle_count; ++i) {
        indices[i] = flat->triangles[instance->first_triangle + i / 3].v[i % 3] - m->first_vertex;
    }
    rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_HIGH);
    return attach(tracer, geometry, index, instance->first_triangle, "moving triangles", err);
}

/* Merged triangles as a scene of their own, moved as a whole. */
static kl_status attach_rigid(struct kl_tracer *tracer, const struct kl_flat *flat, uint32_t index,
                              struct kl_err *err)
{
    const kl_instance *instance = &tracer->instances[index];
    const struct kl_range range = {
        .first = instance->first_triangle, .count = instance->triangle_count, .instance = index};
    return attach_shared(tracer, flat, &range, 1, err);
}

/* Merged geometry: what moves by itself, what lies between together. */
static kl_status attach_merged(struct kl_tracer *tracer, const struct kl_flat *flat,
                               struct kl_err *err)
{
    const uint32_t end = flat->instances[0].triangle_count;
    const struct kl_motion *motion = tracer->motion;
    uint32_t next = 0;
    kl_status st = KL_OK;

    for (uint32_t i = flat->instance_count; motion != NULL && i < motion->instance_count; ++i) {
        const kl_instance *in = &motion->instances[i];
        st = attach_still(tracer, flat, next, in->first_triangle - next, err);
        if (st == KL_OK) {
            st = motion->moving[i].deforms ? attach_deforming(tracer, flat, i, err)
                                           : attach_rigid(tracer, flat, i, err);
        }
        if (st != KL_OK) return st;
        next = in->first_triangle + in->triangle_count;
    }
    return attach_still(tracer, flat, next, end - next, err);
}

static kl_status build(struct kl_tracer *tracer, const struct kl_flat *flat, struct kl_err *err)
{
    const size_t instances =
        tracer->motion != NULL ? tracer->motion->instance_count : flat->instance_count;
    kl_status st = kl_embree_open(&tracer->report, &tracer->device, err);

    if (st == KL_OK) { /* merged runs between what moves are as many, and one */
        st = kl_alloc_array(&tracer->targets, 2 * instances + 1, sizeof *tracer->targets, err);
    }
    if (st != KL_OK) return st;
    tracer->scene = rtcNewScene(tracer->device);
    if (tracer->scene == NULL) return kl_embree_check(&tracer->report, "new scene", err);
    if (flat->instance_count > 0) st = attach_merged(tracer, flat, err);
    if (st == KL_OK && flat->instance_count > 1) st = attach_all_shared(tracer, flat, err);
    if (st != KL_OK) return st;
    commit_scene(tracer->scene);
    return kl_embree_check(&tracer->report, "build", err);
}

static kl_status create(struct kl_flat *flat, const struct kl_motion *motion,
                        struct kl_tracer **out, struct kl_err *err)
{
    struct kl_tracer *tracer = NULL;
    kl_status st = kl_alloc_array(&tracer, 1, sizeof *tracer, err);

    if (st != KL_OK) return st;
    tracer->motion = motion;
    tracer->instances = motion != NULL ? motion->instances : flat->instances;
    st = build(tracer, flat, err);
    if (st != KL_OK) {
        kl_tracer_destroy(tracer);
        return kl_wrap(err, "ray tracer, %u triangles", flat->triangle_count);
    }
    flat->view.tracer = tracer;
    *out = tracer;
    return KL_OK;
}

kl_status kl_tracer_create(struct kl_flat *flat, struct kl_tracer **out, struct kl_err *err)
{
    return create(flat, NULL, out, err);
}

kl_status kl_tracer_create_moving(struct kl_flat *flat, struct kl_motion *motion,
                                  struct kl_tracer **out, struct kl_err *err)
{
    kl_status st = create(flat, motion, out, err);
    if (st != KL_OK) return st;
    motion->view.tracer = *out;
    motion->reference.tracer = *out;
    return KL_OK;
}

void kl_tracer_destroy(struct kl_tracer *tracer)
{
    if (tracer == NULL) return;
    if (tracer->scene != NULL) rtcReleaseScene(tracer->scene);
    if (tracer->device != NULL) rtcReleaseDevice(tracer->device);
    free(tracer->targets);
    free(tracer);
}

/* Embree counts a hit at exactly tnear, our range is open: a ray that starts in a surface's plane
 * does not hit it. */
static struct RTCRay make_ray(const kl_ray *ray)
{
    const float least = 1e-30f;

    return (struct RTCRay){
        .org_x = ray->origin.x,
        .org_y = ray->origin.y,
        .org_z = ray->origin.z,
        .tnear = ray->tmin > least ? ray->tmin : least,
        .time = ray->time,
        .dir_x = ray->dir.x,
        .dir_y = ray->dir.y,
        .dir_z = ray->dir.z,
        .tfar = ray->tmax,
        .mask = 0xffffffffu,
    };
}

int kl_trace_closest(const kl_scene_view *scene, const kl_ray *ray, kl_hit *hit)
{
    const struct kl_tracer *tracer = scene->tracer;
    struct RTCIntersectContext context;
    struct RTCRayHit query = {.ray = make_ray(ray)};

    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    rtcInitIntersectContext(&context);
    rtcIntersect1(tracer->scene, &context, &query);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return 0;
    const kl_u32 top = query.hit.instID[0];
    const struct target *target =
        &tracer->targets[top == RTC_INVALID_GEOMETRY_ID ? query.hit.geomID : top];
    hit->instance = target->instance;
    hit->t = query.ray.tfar;
    hit->u = query.hit.u;
    hit->v = query.hit.v;
    hit->triangle = target->first_triangle + query.hit.primID;
    kl_hit_settle(scene, ray, hit);
    return 1;
}

int kl_trace_any(const kl_scene_view *scene, const kl_ray *ray)
{
    const struct kl_tracer *tracer = scene->tracer;
    struct RTCIntersectContext context;
    struct RTCRay query = make_ray(ray);

    rtcInitIntersectContext(&context);
    rtcOccluded1(tracer->scene, &context, &query);
    return query.tfar < 0.0f; /* Embree's mark of an occluded ray: -infinity */
}
