/* Flat scenes made in code, for tests and benchmarks of tracing: positions, triangles, instances
 * and the view, nothing else. */
#ifndef KL_TESTS_UNIT_TEST_TRACE_SCENES_H
#define KL_TESTS_UNIT_TEST_TRACE_SCENES_H

#include "kernels/trace.h"
#include "src/scene/flat.h"

/* A small deterministic generator; any seed is fine. */
struct kl_test_random {
    uint64_t state;
};
float kl_test_uniform(struct kl_test_random *random);     /* in [0, 1) */
kl_vec3 kl_test_direction(struct kl_test_random *random); /* uniform on the sphere */

/* Random triangles of edge length about `size` in the cube [-1, 1]^3: `merged` of them as merged
 * geometry, then `shared` more under `instances` instances (turned, scaled without uniformity, some
 * mirrored; every third one uses only the second half of the shared triangles). */
struct kl_flat *kl_test_soup(uint64_t seed, uint32_t merged, float size, uint32_t shared,
                             uint32_t instances);

/* Merged geometry only: `n` x `n` quads as two triangles each over [-1, 1]^2, on a bumpy height
 * field, with `blobs` closed bumpy spheres above it. Closed surfaces: a ray that starts inside a
 * blob must leave through it. Triangles: 2 n^2 + blobs * 4 n^2 / 16. */
struct kl_flat *kl_test_landscape(uint32_t n, uint32_t blobs);

void kl_test_scene_destroy(struct kl_flat *flat);

/* The nearest hit by trying every triangle in double precision; 0 if none. */
int kl_test_brute_force(const struct kl_flat *flat, const kl_ray *ray, kl_hit *hit);

#endif
