/* Scenes made in memory for the hard cases, and what the tests ask of their images. */
#ifndef KL_TESTS_HARD_HARD_SCENE_H
#define KL_TESTS_HARD_HARD_SCENE_H

#include "src/render/renderer.h"

#include <stdbool.h>

/* An empty scene; every function below fails the running test when memory is out. */
struct kl_scene *hard_scene(void);
/* Pure Lambert, grey; returns its number. `emission` [nit], from the front. */
uint32_t hard_material(struct kl_scene *scene, double albedo, double emission);
/* A node with a column-major matrix, NULL: identity. Returns its number. */
uint32_t hard_node(struct kl_scene *scene, const double matrix[16]);

/* Meshes, each with one instance at `node`. Fronts look along edge_u x edge_v, out of a box, out of
 * a sphere; `inward` turns them round. */
void hard_quad(struct kl_scene *scene, uint32_t node, uint32_t material, const double corner[3],
               const double edge_u[3], const double edge_v[3]);
void hard_box(struct kl_scene *scene, uint32_t node, uint32_t material, const double lo[3],
              const double hi[3], bool inward);
/* `rings` from pole to pole, twice as many around. `smooth`: normals of the sphere. */
void hard_sphere(struct kl_scene *scene, uint32_t node, uint32_t material, const double center[3],
                 double radius, uint32_t rings, bool smooth, bool inward);
/* Returns its number. `yfov` [rad]. */
uint32_t hard_camera(struct kl_scene *scene, const double eye[3], const double target[3],
                     double yfov);
void hard_forget_cameras(struct kl_scene *scene);
void hard_sky(struct kl_scene *scene, uint32_t width, uint32_t height, double radiance);
/* Put everything under one more transform: p' = scale * p + offset. */
void hard_move(struct kl_scene *scene, double scale, const double offset[3]);

/* A closed box of side 2 about the origin: grey walls, a lamp of 0.8 x 0.8 below the ceiling, two
 * blocks; camera 0 looks in from its open side's plane. All that a Cornell box is, in 36 triangles.
 */
struct kl_scene *hard_room(void);

/* The scene at time 0, ready to render; the scene is freed with the stage. error, rays: 0 for the
 * defaults. */
#define HARD_PI 3.14159265358979323846

struct hard_stage {
    struct kl_scene *scene;
    struct kl_renderer *renderer;
    enum kl_indirect indirect;
    struct kl_counts counts; /* of the last image */
    uint64_t bad;            /* samples of it that were not finite */
};
void hard_open(struct hard_stage *stage, struct kl_scene *scene, enum kl_indirect indirect,
               double error, uint32_t rays);
void hard_close(struct hard_stage *stage);
/* Fill (by the cache) and render scene camera `camera`; the caller's to kl_image_destroy. */
struct kl_image *hard_render(struct hard_stage *stage, uint32_t camera, uint32_t width,
                             uint32_t height, uint32_t spp);
/* Open, render camera 0, close. *records (may be NULL): of level 0 and 1 together. */
struct kl_image *hard_image(struct kl_scene *scene, enum kl_indirect indirect, uint32_t side,
                            uint32_t spp, uint32_t *records);

/* Of a channel, over pixels that show something. */
struct hard_spread {
    double mean, lowest, highest, deviation;
    uint32_t pixels;
};
struct hard_spread hard_measure(const struct kl_image *image, const char *channel);
/* sqrt(mean (a - b)^2) / mean b, over pixels that show something in both; and the means' ratio. */
double hard_difference(const struct kl_image *a, const struct kl_image *b, const char *channel,
                       double *ratio);
void hard_expect(const char *what, double value, double wanted, double tolerance);
/* Tell that a case waits, and skip the test. */
void hard_waits(const char *row, const char *why);

#endif
