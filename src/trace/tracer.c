#include "src/trace/tracer.h"

#include "kernels/trace.h"
#include "src/base/memory.h"
#include "src/trace/embree_error.h"
#include "src/trace/ranges.h"

#include <embree3/rtcore.h>
#include <stdlib.h>

struct kl_tracer {
    struct kl_embree_error report;
    RTCDevice device;
    RTCScene scene;               /* geometry i is instance i of the flat scene */
    const kl_instance *instances; /* borrowed */
    uint32_t instance_count;
};

static void commit_scene(RTCScene scene)
{
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
    rtcCommitScene(scene);
}

/* One triangle geometry over `count` triangles from `first`, as geometry `id` of `scene`. */
static kl_status attach_triangles(struct kl_tracer *tracer, const struct kl_flat *flat,
                                  uint32_t first, uint32_t count, RTCScene scene,
                                  struct kl_err *err)
{
    RTCGeometry geometry = rtcNewGeometry(tracer->device, RTC_GEOMETRY_TYPE_TRIANGLE);

    if (geometry == NULL) return kl_embree_check(&tracer->report, "new geometry", err);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                               flat->positions, 0, 3 * sizeof(float), flat->vertex_count);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                               flat->triangles, (size_t)first * sizeof(kl_triangle),
                               sizeof(kl_triangle), count);
    rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_HIGH);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(scene, geometry, 0);
    rtcReleaseGeometry(geometry); /* the scene holds it */
    return kl_embree_check(&tracer->report, "triangles", err);
}

static kl_status attach_instance(struct kl_tracer *tracer, uint32_t index, RTCScene shared,
                                 struct kl_err *err)
{
    RTCGeometry geometry = rtcNewGeometry(tracer->device, RTC_GEOMETRY_TYPE_INSTANCE);

    if (geometry == NULL) return kl_embree_check(&tracer->report, "new instance", err);
    rtcSetGeometryInstancedScene(geometry, shared);
    rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR,
                            tracer->instances[index].render_from_object);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(tracer->scene, geometry, index);
    rtcReleaseGeometry(geometry);
    return kl_embree_check(&tracer->report, "instance", err);
}

/* All instances of ranges[0 .. n): they share one triangle range. */
static kl_status attach_shared(struct kl_tracer *tracer, const struct kl_flat *flat,
                               const struct kl_range *ranges, size_t n, struct kl_err *err)
{
    RTCScene shared = rtcNewScene(tracer->device);

    if (shared == NULL) return kl_embree_check(&tracer->report, "new scene", err);
    kl_status st = attach_triangles(tracer, flat, ranges[0].first, ranges[0].count, shared, err);
    if (st == KL_OK) {
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

static kl_status build(struct kl_tracer *tracer, const struct kl_flat *flat, struct kl_err *err)
{
    kl_status st = kl_embree_open(&tracer->report, &tracer->device, err);

    if (st != KL_OK) return st;
    tracer->scene = rtcNewScene(tracer->device);
    if (tracer->scene == NULL) return kl_embree_check(&tracer->report, "new scene", err);
    if (flat->instance_count > 0 && flat->instances[0].triangle_count > 0) {
        st = attach_triangles(tracer, flat, flat->instances[0].first_triangle,
                              flat->instances[0].triangle_count, tracer->scene, err);
    }
    if (st == KL_OK && flat->instance_count > 1) st = attach_all_shared(tracer, flat, err);
    if (st != KL_OK) return st;
    commit_scene(tracer->scene);
    return kl_embree_check(&tracer->report, "build", err);
}

kl_status kl_tracer_create(struct kl_flat *flat, struct kl_tracer **out, struct kl_err *err)
{
    struct kl_tracer *tracer = NULL;
    kl_status st = kl_alloc_array(&tracer, 1, sizeof *tracer, err);

    if (st != KL_OK) return st;
    tracer->instances = flat->instances;
    tracer->instance_count = flat->instance_count;
    st = build(tracer, flat, err);
    if (st != KL_OK) {
        kl_tracer_destroy(tracer);
        return kl_wrap(err, "ray tracer, %u triangles", flat->triangle_count);
    }
    flat->view.tracer = tracer;
    *out = tracer;
    return KL_OK;
}

void kl_tracer_destroy(struct kl_tracer *tracer)
{
    if (tracer == NULL) return;
    if (tracer->scene != NULL) rtcReleaseScene(tracer->scene);
    if (tracer->device != NULL) rtcReleaseDevice(tracer->device);
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
    hit->instance = top == RTC_INVALID_GEOMETRY_ID ? 0 : top;
    hit->t = query.ray.tfar;
    hit->u = query.hit.u;
    hit->v = query.hit.v;
    hit->triangle = tracer->instances[hit->instance].first_triangle + query.hit.primID;
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
