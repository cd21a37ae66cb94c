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
/* A directional light [lx] that travels along `way`, unit length. */
void hard_sun(struct kl_scene *scene, const double way[3], double illuminance);
/* Let a node without a matrix move, turn or grow: straight between `count` keys. */
void hard_animate(struct kl_scene *scene, uint32_t node, enum kl_channel_path path, uint32_t count,
                  const float *times, const float *values);
/* Put everything under one more transform: p' = scale * p + offset. */
void hard_move(struct kl_scene *scene, double scale, const double offset[3]);

/* A closed box of side 2 about the origin: grey walls, a lamp of 0.8 x 0.8 below the ceiling, two
 * blocks; camera 0 looks in from its open side's plane. All that a Cornell box is, in 36 triangles.
 */
struct kl_scene *hard_room(void);

#define HARD_PI 3.14159265358979323846

/* A scene ready to render; it is freed with the stage. */
struct hard_stage {
    struct kl_scene *scene;
    struct kl_renderer *renderer;
    enum kl_indirect indirect;
    double time;                /* [s] the present instant, at first 0 */
    const char *store;          /* folder of the cache, NULL: in memory */
    struct kl_fill_stats stats; /* of the last image */
    struct kl_counts counts;
    uint64_t bad; /* samples of it that were not finite */
};
/* At time 0. error, rays: 0 for the defaults. */
void hard_open(struct hard_stage *stage, struct kl_scene *scene, enum kl_indirect indirect,
               double error, uint32_t rays);
/* Not anywhere yet; `carry`: records go on from frame to frame. */
void hard_begin(struct hard_stage *stage, struct kl_scene *scene, enum kl_indirect indirect,
                double error, uint32_t rays, bool carry);
/* Go to an instant [s] with a shutter that is open for so long around it. The one where the stage
 * stood becomes the frame before. */
void hard_go(struct hard_stage *stage, double time, double shutter);
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

#endif
