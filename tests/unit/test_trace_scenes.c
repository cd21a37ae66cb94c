#include "test_trace_scenes.h"

#include "src/base/memory.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

float kl_test_uniform(struct kl_test_random *random)
{
    /* splitmix64 */
    uint64_t z = (random->state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    z ^= z >> 31;
    return (float)(z >> 40) * 0x1p-24f;
}

kl_vec3 kl_test_direction(struct kl_test_random *random)
{
    const float z = 1.0f - 2.0f * kl_test_uniform(random);
    const float phi = 2.0f * KL_PI * kl_test_uniform(random);
    const float r = sqrtf(fmaxf(0.0f, 1.0f - z * z));
    return kl_normalize(kl_v3(r * cosf(phi), r * sinf(phi), z));
}

static void *must_alloc(size_t count, size_t size)
{
    void *memory = NULL;
    struct kl_err err = {0};
    if (kl_alloc_array(&memory, count, size, &err) != KL_OK) {
        (void)fprintf(stderr, "%s\n", err.msg);
        abort();
    }
    return memory;
}

static struct kl_flat *new_flat(uint32_t vertices, uint32_t triangles, uint32_t instances)
{
    struct kl_flat *flat = must_alloc(1, sizeof *flat);

    flat->vertex_count = vertices;
    flat->triangle_count = triangles;
    flat->instance_count = instances;
    flat->positions = must_alloc(vertices, 3 * sizeof(float));
    flat->triangles = must_alloc(triangles, sizeof(kl_triangle));
    flat->instances = must_alloc(instances, sizeof(kl_instance));
    flat->radius = 10.0f;
    flat->view.scene_radius = flat->radius;
    flat->view.instance_count = instances;
    flat->view.positions = flat->positions;
    flat->view.triangles = flat->triangles;
    flat->view.instances = flat->instances;
    flat->view.needs = instances > 1 ? KL_NEED_INSTANCES : 0;
    for (int i = 0; i < 12; i += 5) {
        flat->instances[0].render_from_object[i] = 1.0f;
        flat->instances[0].object_from_render[i] = 1.0f;
    }
    flat->instances[0].object = KL_NONE;
    for (uint32_t i = 0; i < triangles; ++i) {
        flat->triangles[i].object = KL_NONE;
        flat->triangles[i].light = KL_NONE;
    }
    return flat;
}

void kl_test_scene_destroy(struct kl_flat *flat)
{
    free(flat->positions);
    free(flat->triangles);
    free(flat->instances);
    free(flat);
}

static float *put3(float *p, float x, float y, float z)
{
    p[0] = x;
    p[1] = y;
    p[2] = z;
    return p + 3;
}

/* m = a random affine map (rotation x stretch, mirrored on demand), inverse by cofactors. */
static void random_transform(struct kl_test_random *random, bool mirror, kl_instance *instance)
{
    const kl_frame f = kl_frame_from_normal(kl_test_direction(random));
    const kl_vec3 axes[3] = {f.t, f.b, f.n};
    double m[9], inverse[9], t[3];

    for (int c = 0; c < 3; ++c) {
        double s = 0.3 + (double)kl_test_uniform(random);
        if (mirror && c == 0) s = -s;
        m[c] = s * (double)axes[c].x;
        m[3 + c] = s * (double)axes[c].y;
        m[6 + c] = s * (double)axes[c].z;
        t[c] = 4.0 * (double)kl_test_uniform(random) - 2.0;
    }
    double det = 0.0;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            const int a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
            inverse[3 * j + i] = m[3 * a + c] * m[3 * b + d] - m[3 * a + d] * m[3 * b + c];
        }
        det += m[i] * inverse[3 * i];
    }
    for (int i = 0; i < 3; ++i) {
        double back = 0.0;
        for (int j = 0; j < 3; ++j) {
            instance->render_from_object[4 * i + j] = (float)m[3 * i + j];
            instance->object_from_render[4 * i + j] = (float)(inverse[3 * i + j] / det);
            back -= inverse[3 * i + j] / det * t[j];
        }
        instance->render_from_object[4 * i + 3] = (float)t[i];
        instance->object_from_render[4 * i + 3] = (float)back;
    }
    instance->mirrored = det < 0.0;
}

struct kl_flat *kl_test_soup(uint64_t seed, uint32_t merged, float size, uint32_t shared,
                             uint32_t instances)
{
    const uint32_t n = merged + shared;
    struct kl_flat *flat = new_flat(3 * n, n, 1 + instances);
    struct kl_test_random random = {seed};
    float *p = flat->positions;

    for (uint32_t i = 0; i < n; ++i) {
        float c[3];
        for (int k = 0; k < 3; ++k) {
            c[k] = 2.0f * kl_test_uniform(&random) - 1.0f;
        }
        for (uint32_t v = 0; v < 3; ++v) {
            for (int k = 0; k < 3; ++k) {
                *p++ = c[k] + size * (kl_test_uniform(&random) - 0.5f);
            }
            flat->triangles[i].v[v] = 3 * i + v;
        }
    }
    flat->instances[0].triangle_count = merged;
    for (uint32_t i = 1; i <= instances; ++i) {
        kl_instance *instance = &flat->instances[i];
        const uint32_t skip = i % 3 == 0 ? shared / 2 : 0;
        random_transform(&random, i % 2 == 0, instance);
        instance->first_triangle = merged + skip;
        instance->triangle_count = shared - skip;
        instance->object = i;
    }
    return flat;
}

static kl_vec3 blob_point(float u, float v, uint32_t k)
{
    const float a = 2.0f * KL_PI * u;
    const float b = KL_PI * v;
    const float r = 0.1f + 0.01f * sinf(7.0f * a) * sinf(b) * sinf(9.0f * b);
    const float x = -0.8f + 0.4f * (float)(k % 5);
    const float z = -0.8f + 0.4f * (float)(k / 5 % 5);
    return kl_v3(x + r * sinf(b) * cosf(a), 0.35f + 0.25f * (float)(k / 25) + r * cosf(b),
                 z + r * sinf(b) * sinf(a));
}

/* Triangles of a grid of (nx + 1) x (ny + 1) vertices from `first`. `wrap`: the last column is the
 * first one again, so that the seam is closed exactly. */
static kl_triangle *put_grid(kl_triangle *t, uint32_t first, uint32_t nx, uint32_t ny, bool wrap)
{
    for (uint32_t y = 0; y < ny; ++y) {
        for (uint32_t x = 0; x < nx; ++x) {
            const uint32_t next = wrap && x + 1 == nx ? 0 : x + 1;
            const uint32_t a = first + y * (nx + 1) + x;
            const uint32_t b = first + y * (nx + 1) + next;
            const kl_u32 quad[6] = {a, b, b + nx + 1, a, b + nx + 1, a + nx + 1};
            for (int k = 0; k < 6; ++k) {
                t[k / 3].v[k % 3] = quad[k];
            }
            t += 2;
        }
    }
    return t;
}

struct kl_flat *kl_test_landscape(uint32_t n, uint32_t blobs)
{
    const uint32_t bn = n / 4; /* a blob has bn x bn / 2 quads */
    const uint32_t by = bn / 2;
    const uint32_t vertices = (n + 1) * (n + 1) + blobs * (bn + 1) * (by + 1);
    const uint32_t triangles = 2 * n * n + blobs * 2 * bn * by;
    struct kl_flat *flat = new_flat(vertices, triangles, 1);
    float *p = flat->positions;
    kl_triangle *t = put_grid(flat->triangles, 0, n, n, false);

    for (uint32_t j = 0; j <= n; ++j) {
        for (uint32_t i = 0; i <= n; ++i) {
            const float x = 2.0f * (float)i / (float)n - 1.0f;
            const float z = 2.0f * (float)j / (float)n - 1.0f;
            const float y = 0.1f * sinf(9.0f * x) * cosf(7.0f * z) + 0.02f * sinf(60.0f * x * z);
            p = put3(p, x, y, z);
        }
    }
    for (uint32_t k = 0; k < blobs; ++k) {
        t = put_grid(t, (n + 1) * (n + 1) + k * (bn + 1) * (by + 1), bn, by, true);
        for (uint32_t j = 0; j <= by; ++j) {
            for (uint32_t i = 0; i <= bn; ++i) {
                const float v = (float)j / (float)by;
                const kl_vec3 q = blob_point(j == 0 || j == by ? 0.0f : (float)i / (float)bn, v, k);
                p = put3(p, q.x, q.y, q.z);
            }
        }
    }
    flat->instances[0].triangle_count = triangles;
    return flat;
}

struct ray_d {
    double o[3], d[3];
};

static double dot_d(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross_d(const double *a, const double *b, double *out)
{
    for (int i = 0; i < 3; ++i) {
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
    }
}

/* Moeller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997, in double. */
static int hit_triangle(const struct kl_flat *flat, uint32_t index, const struct ray_d *ray,
                        double tuv[3])
{
    double v[3][3], p[3], s[3], q[3];

    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) {
            v[i][k] = (double)flat->positions[3 * (size_t)flat->triangles[index].v[i] + (size_t)k];
        }
    }
    for (int k = 0; k < 3; ++k) {
        v[1][k] -= v[0][k];
        v[2][k] -= v[0][k];
        s[k] = ray->o[k] - v[0][k];
    }
    cross_d(ray->d, v[2], p);
    const double det = dot_d(v[1], p);
    if (det == 0.0) return 0;
    tuv[1] = dot_d(s, p) / det;
    cross_d(s, v[1], q);
    tuv[2] = dot_d(ray->d, q) / det;
    tuv[0] = dot_d(v[2], q) / det;
    return tuv[1] >= 0.0 && tuv[2] >= 0.0 && tuv[1] + tuv[2] <= 1.0;
}

int kl_test_brute_force(const struct kl_flat *flat, const kl_ray *ray, kl_hit *hit)
{
    const double o[3] = {(double)ray->origin.x, (double)ray->origin.y, (double)ray->origin.z};
    const double d[3] = {(double)ray->dir.x, (double)ray->dir.y, (double)ray->dir.z};
    double best = (double)ray->tmax;
    int found = 0;

    for (uint32_t i = 0; i < flat->instance_count; ++i) {
        const kl_instance *instance = &flat->instances[i];
        const float *m = instance->object_from_render;
        struct ray_d local = {{0}, {0}};
        for (int r = 0; r < 3; ++r) {
            local.o[r] = (double)m[4 * r + 3];
            for (int k = 0; k < 3; ++k) {
                local.o[r] += (double)m[4 * r + k] * o[k];
                local.d[r] += (double)m[4 * r + k] * d[k];
            }
        }
        for (uint32_t k = 0; k < instance->triangle_count; ++k) {
            double tuv[3];
            if (!hit_triangle(flat, instance->first_triangle + k, &local, tuv)) continue;
            if (!(tuv[0] > (double)ray->tmin && tuv[0] < best)) continue;
            best = tuv[0];
            found = 1;
            *hit = (kl_hit){(float)tuv[0], (float)tuv[1], (float)tuv[2],
                            instance->first_triangle + k, i};
        }
    }
    return found;
}
