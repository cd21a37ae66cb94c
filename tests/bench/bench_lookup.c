/* What a look-up costs: queries among records on the surfaces of a scene against incoherent rays in
 * the same scene, both in processor time of one core, median of 5. Prints JSON.
 * usage: bench_lookup SCENE.glb [records, 300000] [reach, 1.3] [records within reach, 8]
 *        bench_lookup SCENE.glb CACHE.klc [cache level, 0]
 * The second form looks up what a bake left, at points that it serves, and also with the radii that
 * its records have without clamping by validity. */
#include "cache_io/store.h"
#include "kernels/surface.h"
#include "src/base/memory.h"
#include "src/cache/cache.h"
#include "src/cache/clamp.h"
#include "src/cache/octree.h"
#include "src/import/import.h"
#include "src/scene/flat.h"
#include "src/trace/tracer.h"
#include "tests/bench/bench_sort.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { RUNS = 5, QUERIES = 1 << 19 };
static const float cos_max = 0.9394f;

struct bench {
    struct kl_scene *scene;
    struct kl_flat *flat;
    struct kl_tracer *tracer;
    struct kl_cache *cache;
    uint32_t records;
    float reach, overlap;   /* overlap: records within reach of a point, on average */
    const char *store_path; /* NULL: made here */
    uint32_t level;
    struct kl_store *store;
    kl_level_view view;
    kl_vec3 *points, *normals; /* QUERIES of them */
    kl_ray *rays;
};

/* Processor time of this thread [s]: other programs do not change it. */
static double now(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static double surface_area(const struct kl_flat *flat)
{
    double sum = 0.0;
    for (uint32_t i = 0; i < flat->instance_count; ++i) {
        const kl_instance *inst = &flat->instances[i];
        for (uint32_t t = 0; t < inst->triangle_count; ++t) {
            const kl_triangle *tri = &flat->triangles[inst->first_triangle + t];
            kl_vec3 p[3];
            for (int k = 0; k < 3; ++k) {
                p[k] = kl_affine_point(inst->render_from_object,
                                       kl_v3_load(flat->positions + 3 * (size_t)tri->v[k]));
            }
            sum += 0.5 * (double)kl_length(kl_cross(kl_v3_sub(p[1], p[0]), kl_v3_sub(p[2], p[0])));
        }
    }
    return sum;
}

/* A point on the surface, uniform by area through walks: rays in random directions, hit to hit. */
static bool next_point(const kl_scene_view *s, kl_ray *ray, kl_sampler *sampler, kl_surface *out)
{
    kl_hit hit;
    if (!kl_trace_closest(s, ray, &hit)) return false;
    kl_surface_at(s, ray, &hit, out);
    const kl_frame f = kl_frame_from_normal(out->geometric);
    const kl_vec3 d = kl_frame_to_world(&f, kl_cosine_direction(kl_sampler_2d(sampler)));
    *ray = kl_ray_make(kl_leave_surface(s, out->pos, out->geometric), d, KL_INF);
    return true;
}

/* `count` surface points: positions, smooth normals and the rays that leave them. A walk ends after
 * 16 hits or in the open and starts anew from the middle of the scene. */
static void make_points(const struct bench *b, uint32_t count, uint32_t seed, kl_vec3 *points,
                        kl_vec3 *normals, kl_ray *rays)
{
    const kl_vec3 center = kl_v3_load(b->flat->center);
    uint32_t made = 0;
    for (uint32_t walk = 0; made < count && walk < 64 * count; ++walk) {
        kl_sampler sampler = kl_sampler_make(walk, seed);
        const kl_vec2 u = kl_sampler_2d(&sampler);
        const float z = 2.0f * u.x - 1.0f;
        const float s = sqrtf(fmaxf(0.0f, 1.0f - z * z));
        const kl_vec3 d = kl_v3(s * cosf(2.0f * KL_PI * u.y), s * sinf(2.0f * KL_PI * u.y), z);
        kl_ray ray = kl_ray_make(center, d, KL_INF);
        kl_surface surface;
        for (int k = 0; k < 16 && made < count; ++k) {
            if (!next_point(&b->flat->view, &ray, &sampler, &surface)) break;
            if (k < 2) continue; /* seen from the middle: too regular */
            points[made] = surface.pos;
            normals[made] = surface.smooth;
            if (rays != NULL) rays[made] = ray;
            ++made;
        }
    }
}

/* Records of constant density and radius. */
static kl_status fill_cache(struct bench *b, struct kl_err *err)
{
    const uint32_t n = b->records;
    kl_record_hot *hot = NULL;
    kl_record_cold *cold = NULL;
    kl_vec3 *points = NULL;
    kl_vec3 *normals = NULL;
    kl_status st = kl_alloc_array(&hot, n, sizeof *hot, err);
    if (st == KL_OK) st = kl_alloc_array(&cold, n, sizeof *cold, err);
    if (st == KL_OK) st = kl_alloc_array(&points, n, sizeof *points, err);
    if (st == KL_OK) st = kl_alloc_array(&normals, n, sizeof *normals, err);
    if (st != KL_OK) goto cleanup;
    make_points(b, n, 1, points, normals, NULL);
    const float area = (float)surface_area(b->flat);
    const float radius = sqrtf(b->overlap * area / (KL_PI * (float)n)) / b->reach;
    for (uint32_t i = 0; i < n; ++i) {
        memcpy(hot[i].pos, &points[i], sizeof hot[i].pos);
        hot[i].normal = kl_oct_encode(normals[i]);
        hot[i].object = KL_NONE;
        hot[i].radius = radius;
        hot[i].radius2 = radius;
        cold[i].irr[0] = 1.0f;
        cold[i].irr[1] = 1.0f;
        cold[i].irr[2] = 1.0f;
        cold[i].raw_radius = radius;
        memset(cold[i].clearance, 255, sizeof cold[i].clearance);
    }
    st = kl_cache_insert(b->cache, 0, hot, cold, n, err);
    if (st == KL_OK) st = kl_cache_finish(b->cache, err);

cleanup:
    free(hot);
    free(cold);
    free(points);
    free(normals);
    return st;
}

/* Serve a level of a store as it lies on disk. */
static kl_status open_store(struct bench *b, struct kl_err *err)
{
    struct kl_level_arrays levels[KL_CACHE_LEVELS];
    kl_status st = kl_store_open(b->store_path, KL_STORE_READ, NULL, &b->store, err);
    if (st != KL_OK) return st;
    kl_store_segment_get(b->store, 0, NULL, levels);
    const struct kl_level_arrays *l = &levels[b->level];
    if (l->octree.record_count == 0)
        return kl_fail(err, KL_ERR_INPUT, "no records in this level, or no index yet: render once");
    b->view = (kl_level_view){l->octree, l->hot, l->cold, l->nodes, l->rows, NULL};
    b->records = l->record_count;
    b->reach = l->octree.reach;
    return KL_OK;
}

static kl_status make_cache(struct bench *b, struct kl_err *err)
{
    struct kl_cache_settings settings = {.scene_radius = b->flat->radius,
                                         .accuracy = {1.0f, 1.0f},
                                         .reach = {b->reach, 1.0f},
                                         .cos_max = cos_max};
    memcpy(settings.center, b->flat->center, sizeof settings.center);
    kl_status st = kl_cache_create(&settings, &b->cache, err);
    if (st == KL_OK) st = fill_cache(b, err);
    if (st == KL_OK) b->view = kl_cache_view(b->cache, 0);
    return st;
}

/* Query points: those that are served, where the records cover only part of the scene. */
static kl_status make_queries(struct bench *b, struct kl_err *err)
{
    const kl_query q = {1.0f, cos_max, KL_INF};
    kl_status st = kl_alloc_array(&b->points, QUERIES, sizeof *b->points, err);
    if (st == KL_OK) st = kl_alloc_array(&b->normals, QUERIES, sizeof *b->normals, err);
    if (st == KL_OK) st = kl_alloc_array(&b->rays, QUERIES, sizeof *b->rays, err);
    if (st != KL_OK) return st;
    make_points(b, QUERIES, 2, b->points, b->normals, b->rays);
    if (b->store == NULL) return KL_OK;
    uint32_t kept = 0;
    for (uint32_t i = 0; i < QUERIES; ++i) {
        if (!(kl_cache_query(&b->view, &q, b->points[i], b->normals[i], b->normals[i]).weight >
              0.0f)) {
            continue;
        }
        b->points[kept] = b->points[i];
        b->normals[kept++] = b->normals[i];
    }
    if (kept == 0) return kl_fail(err, KL_ERR_INPUT, "the cache serves nothing here");
    for (uint32_t i = kept; i < QUERIES; ++i) {
        b->points[i] = b->points[i % kept];
        b->normals[i] = b->normals[i % kept];
    }
    return KL_OK;
}

static kl_status prepare(struct bench *b, const char *path, struct kl_err *err)
{
    struct kl_pose *pose = NULL;
    double origin[3];
    kl_status st = kl_import_gltf(path, NULL, NULL, &b->scene, err);
    if (st == KL_OK) st = kl_pose_create(b->scene, KL_NONE, 0.0, &pose, err);
    if (st == KL_OK) st = kl_flat_choose_origin(b->scene, pose, origin, err);
    if (st == KL_OK) st = kl_flat_create(b->scene, pose, origin, &b->flat, err);
    kl_pose_destroy(pose);
    if (st == KL_OK) st = kl_tracer_create(b->flat, &b->tracer, err);
    if (st != KL_OK) return st;
    st = b->store_path != NULL ? open_store(b, err) : make_cache(b, err);
    if (st == KL_OK) st = make_queries(b, err);
    return st;
}

struct ordered {
    uint32_t code; /* place along a Z-curve of 1024^3 cells */
    kl_vec3 point, normal;
};

static int compare_codes(const void *a, const void *b)
{
    const struct ordered *x = a;
    const struct ordered *y = b;
    return (x->code > y->code) - (x->code < y->code);
}

static uint32_t spread_bits(uint32_t x)
{
    uint32_t out = 0;
    for (uint32_t k = 0; k < 10; ++k) {
        out |= (x >> k & 1u) << 3 * k;
    }
    return out;
}

/* Queries in an order in which neighbours follow each other, as the pixels of a tile do. */
static kl_status sort_queries(struct bench *b, struct kl_err *err)
{
    struct ordered *all = NULL;
    const kl_vec3 low = kl_v3_sub(kl_v3_load(b->flat->center), kl_v3_splat(b->flat->radius));
    const float scale = 1023.0f / (2.0f * b->flat->radius);
    kl_status st = kl_alloc_array(&all, QUERIES, sizeof *all, err);
    if (st != KL_OK) return st;
    for (uint32_t i = 0; i < QUERIES; ++i) {
        const kl_vec3 q = kl_v3_scale(kl_v3_sub(b->points[i], low), scale);
        const uint32_t code = spread_bits((uint32_t)q.x) | spread_bits((uint32_t)q.y) << 1 |
                              spread_bits((uint32_t)q.z) << 2;
        all[i] = (struct ordered){code, b->points[i], b->normals[i]};
    }
    qsort(all, QUERIES, sizeof *all, compare_codes);
    for (uint32_t i = 0; i < QUERIES; ++i) {
        b->points[i] = all[i].point;
        b->normals[i] = all[i].normal;
    }
    free(all);
    return KL_OK;
}

static double time_lookups(const struct bench *b, double *served, double *weight)
{
    const kl_level_view view = b->view;
    const kl_query q = {b->reach, cos_max, KL_INF};
    const double start = now();
    uint32_t hits = 0;
    double sum = 0.0;
    for (uint32_t i = 0; i < QUERIES; ++i) {
        const kl_answer a = kl_cache_query(&view, &q, b->points[i], b->normals[i], b->normals[i]);
        hits += a.weight > 0.0f;
        sum += (double)a.weight;
    }
    const double seconds = now() - start;
    *served = (double)hits / QUERIES;
    *weight = sum / QUERIES;
    return seconds;
}

static kl_status index_records(const struct bench *b, const kl_record_hot *hot,
                               struct kl_octree *octree, kl_level_view *view, struct kl_err *err)
{
    const struct kl_octree_root root = kl_octree_root_make(b->flat->center, b->flat->radius);
    const struct kl_octree_limits limits = {b->reach, cos_max};
    kl_octree_fini(octree);
    kl_status st = kl_octree_build(&root, hot, b->records, &limits, octree, err);
    *view = (kl_level_view){octree->head, hot, b->view.cold, octree->nodes, octree->rows, NULL};
    return st;
}

static double time_rays(const struct bench *b, double *hit_share)
{
    const double start = now();
    uint32_t hits = 0;
    for (uint32_t i = 0; i < QUERIES; ++i) {
        kl_hit hit;
        hits += kl_trace_closest(&b->flat->view, &b->rays[i], &hit) != 0;
    }
    const double seconds = now() - start;
    *hit_share = (double)hits / QUERIES;
    return seconds;
}

/* Records that contribute to a query on average, and those that were looked at for it. */
static double count_serving(const struct bench *b, double *candidates)
{
    const kl_query q = {b->reach, cos_max, KL_INF};
    uint64_t serving = 0;
    uint64_t tested = 0;
    for (uint32_t i = 0; i < QUERIES / 16; ++i) {
        const kl_vec3 p = b->points[i];
        kl_u32 at = kl_octree_row(&b->view, p, kl_normal_face(b->normals[i]));
        for (kl_u32 item = 0; at != KL_NONE && !(item & KL_ROW_LAST); ++at) {
            item = b->view.rows[at];
            const kl_record_hot *hot = &b->view.hot[item & ~KL_ROW_LAST];
            ++tested;
            serving += kl_record_bearing(hot, &q, p, b->normals[i]).weight > 0.0f;
        }
    }
    *candidates = (double)tested / (QUERIES / 16);
    return (double)serving / (QUERIES / 16);
}

/* The same look-ups among radii with and without the clamp by validity, five times in turns. */
static void time_both(struct bench *b, const kl_level_view *without, const kl_level_view *with)
{
    const kl_query q = {b->reach, cos_max, KL_INF};
    const kl_level_view *views[2] = {without, with};
    double seconds[2][RUNS], served[2], serving[2], weight, candidates;
    for (int i = 0; i < 2 * RUNS; ++i) {
        b->view = *views[i % 2];
        seconds[i % 2][i / 2] = time_lookups(b, &served[i % 2], &weight);
        if (i < 2) serving[i] = count_serving(b, &candidates);
    }
    double square = 0.0;
    for (uint32_t i = 0; i < QUERIES; ++i) {
        double y[2];
        for (int k = 0; k < 2; ++k) {
            const kl_answer a =
                kl_cache_query(views[k], &q, b->points[i], b->normals[i], b->normals[i]);
            y[k] = (double)kl_luminance(a.irr);
        }
        if (y[0] > 0.0) square += (y[1] / y[0] - 1.0) * (y[1] / y[0] - 1.0);
    }
    for (int k = 0; k < 2; ++k) {
        bench_sort(seconds[k], RUNS);
    }
    (void)printf("{\"validity\": {\"reach\": %g, \"times_as_fast\": %.3f, \"serving\": [%.2f, "
                 "%.2f], \"served\": [%.5f, %.5f], \"relative_rms_difference\": %.5f}}\n",
                 (double)b->reach, seconds[0][RUNS / 2] / seconds[1][RUNS / 2], serving[0],
                 serving[1], served[0], served[1], sqrt(square / QUERIES));
}

/* Radii as the cache makes them, but for validity: set->hot. What is left to do, too: `clamped`. */
static void clamp_twice(const struct bench *b, const struct kl_record_set *set,
                        const struct kl_radius_settings *settings, kl_record_hot *clamped,
                        float *scratch)
{
    struct kl_record_set all = *set;
    all.hot = clamped;
    kl_clamp_by_neighbours(set, settings);
    kl_clamp_by_agreement(set, b->level, settings, scratch);
    memcpy(clamped, set->hot, b->records * sizeof *clamped);
    kl_clamp_by_validity(&all, scratch);
}

static kl_status compare_validity(struct bench *b, struct kl_err *err)
{
    const kl_level_view original = b->view;
    const struct kl_radius_settings settings = {KL_RADIUS_HESSIAN, b->view.head.accuracy,
                                                b->flat->radius};
    kl_record_hot *hot = NULL;
    kl_record_hot *clamped = NULL;
    struct kl_point_tree *tree = NULL;
    float *scratch = NULL;
    struct kl_octree octrees[2] = {0};
    kl_level_view without, with;
    kl_status st = kl_alloc_array(&hot, b->records, sizeof *hot, err);
    if (st == KL_OK) st = kl_alloc_array(&clamped, b->records, sizeof *clamped, err);
    if (st == KL_OK) st = kl_alloc_array(&scratch, b->records, sizeof *scratch, err);
    if (st == KL_OK) {
        memcpy(hot, b->view.hot, b->records * sizeof *hot);
        st = kl_clamp_tree(hot, b->view.cold, b->records, &settings, &tree, err);
    }
    if (st == KL_OK) {
        const struct kl_record_set set = {hot, b->view.cold, b->records, tree, b->reach, cos_max};
        clamp_twice(b, &set, &settings, clamped, scratch);
        st = index_records(b, hot, &octrees[0], &without, err);
    }
    if (st == KL_OK) st = index_records(b, clamped, &octrees[1], &with, err);
    if (st == KL_OK) time_both(b, &without, &with);
    b->view = original;
    for (int k = 0; k < 2; ++k) {
        kl_octree_fini(&octrees[k]);
    }
    kl_point_tree_destroy(tree);
    free(scratch);
    free(clamped);
    free(hot);
    return st;
}

static kl_status run(struct bench *b, struct kl_err *err)
{
    double lookups[RUNS], rays[RUNS], coherent[RUNS];
    double served, weight, hits;
    (void)time_lookups(b, &served, &weight); /* warms up */
    for (int i = 0; i < RUNS; ++i) {
        lookups[i] = time_lookups(b, &served, &weight);
        rays[i] = time_rays(b, &hits);
    }
    const kl_status st = sort_queries(b, err);
    if (st != KL_OK) return st;
    for (int i = 0; i < RUNS; ++i) {
        coherent[i] = time_lookups(b, &served, &weight);
    }
    bench_sort(coherent, RUNS);
    bench_sort(lookups, RUNS);
    bench_sort(rays, RUNS);
    const kl_octree_header *head = &b->view.head;
    double candidates;
    const double serving = count_serving(b, &candidates);
    const double median_lookup = lookups[RUNS / 2];
    const double median_ray = rays[RUNS / 2];
    (void)printf("{\"records\": %u, \"triangles\": %u, \"reach\": %g, \"served\": %.4f, "
                 "\"mean_weight\": %.3f,\n \"serving\": %.2f, \"candidates\": %.1f, "
                 "\"index_bytes_per_record\": %.1f, \"row_items_per_record\": %.2f,\n"
                 " \"lookups_per_s_per_core\": %.0f, \"lookups_spread\": %.3f,\n"
                 " \"coherent_lookups_per_s_per_core\": %.0f,\n"
                 " \"rays_per_s_per_core\": %.0f, \"rays_spread\": %.3f, \"ray_hits\": %.4f,\n"
                 " \"lookups_per_ray\": %.3f}\n",
                 b->records, b->flat->triangle_count, (double)b->reach, served, weight, serving,
                 candidates, 4.0 * ((double)head->row_size + head->node_count) / b->records,
                 (double)head->row_size / b->records, QUERIES / median_lookup,
                 (lookups[RUNS - 1] - lookups[0]) / median_lookup, QUERIES / coherent[RUNS / 2],
                 QUERIES / median_ray, (rays[RUNS - 1] - rays[0]) / median_ray, hits,
                 median_ray / median_lookup);
    return b->store_path != NULL ? compare_validity(b, err) : KL_OK;
}

int main(int argc, char **argv)
{
    struct bench b = {.records = argc > 2 ? (uint32_t)strtoul(argv[2], NULL, 10) : 300000,
                      .reach = argc > 3 ? strtof(argv[3], NULL) : 1.3f,
                      .overlap = argc > 4 ? strtof(argv[4], NULL) : 8.0f};
    struct kl_err err = {0};
    if (argc < 2) {
        (void)fprintf(stderr, "usage: bench_lookup SCENE.glb [records] [reach] [overlap]\n"
                              "       bench_lookup SCENE.glb CACHE.klc [cache level]\n");
        return 1;
    }
    if (argc > 2 && b.records == 0) {
        b.store_path = argv[2];
        b.level = argc > 3 ? (uint32_t)strtoul(argv[3], NULL, 10) % KL_CACHE_LEVELS : 0;
    }
    kl_status st = prepare(&b, argv[1], &err);
    if (st == KL_OK) st = run(&b, &err);
    if (st != KL_OK) (void)fprintf(stderr, "%s\n", err.msg);
    kl_cache_destroy(b.cache);
    kl_store_close(b.store);
    kl_tracer_destroy(b.tracer);
    kl_flat_destroy(b.flat);
    kl_scene_destroy(b.scene);
    free(b.points);
    free(b.normals);
    free(b.rays);
    return st == KL_OK ? 0 : 1;
}
