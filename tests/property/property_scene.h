/* A scene file made ready to render, for the property tests. */
#ifndef KL_TESTS_PROPERTY_PROPERTY_SCENE_H
#define KL_TESTS_PROPERTY_PROPERTY_SCENE_H

#include "src/render/renderer.h"

#include <stdbool.h>

struct property_stage {
    struct kl_scene *scene;
    struct kl_renderer *renderer;
};

/* Whether the scene file is there: in KEEPLIGHT_DATA/scenes/exact, else ../shared/scenes/exact.
 * Says which one is missing if not; the test then calls skip(). */
bool property_has(const char *name);

/* Fails the running test where anything goes wrong. `dir`: of the cache, NULL: in memory. */
void property_open(struct property_stage *stage, const char *name, enum kl_indirect indirect,
                   double error, const char *dir);
/* The same, in memory, after a change of the scene. */
void property_open_changed(struct property_stage *stage, const char *name,
                           enum kl_indirect indirect, void (*change)(struct kl_scene *scene));
void property_close(struct property_stage *stage);

/* Number of the camera with this name. */
uint32_t property_camera(const struct property_stage *stage, const char *name);
struct kl_camera property_look(const struct property_stage *stage, const char *name, double time,
                               uint32_t side);
void property_fill(struct property_stage *stage, const struct kl_camera *cameras, uint32_t count,
                   bool keep, struct kl_fill_stats *stats);
/* All layers; the caller's to kl_image_destroy. No sample may be NaN or infinite. */
struct kl_image *property_render(struct property_stage *stage, const struct kl_camera *camera,
                                 int64_t frame, uint32_t spp, struct kl_counts *counts);

/* Mean and largest deviation from `about` of a channel where the id layer is not empty. */
struct property_spread {
    double mean, worst, deviation; /* deviation: standard, of pixels */
    uint32_t pixels;
};
struct property_spread property_measure(const struct kl_image *image, const char *channel,
                                        double about);
/* True where all channels are the same bit for bit. */
bool property_same(const struct kl_image *a, const struct kl_image *b);

#endif
