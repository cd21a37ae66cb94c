/* The parts of frame coherence: where points were (spots), surface points through time (tracks),
 * means of blocks (blocks). */
#ifndef KL_SEQUENCES_COHERENCE_IMPL_H
#define KL_SEQUENCES_COHERENCE_IMPL_H

#include "sequences/coherence.h"

/* A frame with what is derived from it. */
struct view {
    struct kl_coherence_frame frame;
    uint32_t width, height;
    unsigned char *inner; /* 1: all eight neighbours belong to the same smooth surface */
};

/* A place between pixels: the four around it and their weights; `used` have weight. */
struct spot {
    size_t at[4];
    double weight[4];
    int used;
};

void find_inner(struct view *view);
/* False outside the middles of the border pixels. x, y: 0.5 is the middle of the first pixel.
 * Places within 1/256 of a pixel's middle are that pixel. */
bool find_spot(const struct view *view, double x, double y, struct spot *spot);
double spot_value(const struct spot *spot, const float *data);
bool spot_is_inner(const struct spot *spot, const struct view *view, uint32_t id);
double spot_luminance(const struct spot *spot, const float *const rgb[3]);
double luminance_at(const float *const rgb[3], size_t i);
/* Where pixel (x, y) of `later` was in `now`. False where that is not known. */
bool follow(const struct view *later, uint32_t x, uint32_t y, const struct view *now,
            struct spot *spot);

struct tracks; /* surface points that stand still */

kl_status tracks_create(uint32_t width, uint32_t height, uint32_t frames, struct tracks **out,
                        struct kl_err *err) KL_MUST_CHECK;
void tracks_destroy(struct tracks *tracks);
/* `later` is NULL for the last frame. */
kl_status tracks_add(struct tracks *tracks, const struct view *later, const struct view *now,
                     struct kl_err *err) KL_MUST_CHECK;
kl_status tracks_finish(struct tracks *tracks, bool has_reference, struct kl_coherence_result *out,
                        struct kl_err *err) KL_MUST_CHECK;

struct blocks; /* means of blocks in every frame */

kl_status blocks_create(uint32_t width, uint32_t height, uint32_t frames, struct blocks **out,
                        struct kl_err *err) KL_MUST_CHECK;
void blocks_destroy(struct blocks *blocks);
/* Y_I - Y_R of a frame. */
void blocks_add_frame(struct blocks *blocks, uint32_t frame, const struct view *view);
/* A followed pixel of frame `frame`: its Y there, and how much that is above the frame before. */
void blocks_add_step(struct blocks *blocks, uint32_t frame, uint32_t x, uint32_t y,
                     const double now[2], const double change[2]);
/* Pops, lag and power; steps[].pops. */
void blocks_finish(struct blocks *blocks, bool has_reference, struct kl_coherence_step *steps,
                   struct kl_coherence_result *out);

#endif
