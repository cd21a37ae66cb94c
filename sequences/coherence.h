/* How well the frames of a sequence hold together: flicker, popping and lag, measured along exact
 * motion vectors. Y is luminance (Rec. 709), I the sequence, R its reference. */
#ifndef KL_SEQUENCES_COHERENCE_H
#define KL_SEQUENCES_COHERENCE_H

#include "src/base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    KL_COHERENCE_BLOCK = 16,       /* [pixels], side of the blocks */
    KL_COHERENCE_LEAST_FRAMES = 8, /* a point must be followed for so many, or for all */
    KL_COHERENCE_MOST_FRAMES = 4096,
};
#define KL_COHERENCE_POP 0.02 /* a step above this share of the block's mean is a pop */

/* One frame: width * height values each, row by row from the top. */
struct kl_coherence_frame {
    const float *test[3], *reference[3]; /* linear RGB; reference[0] NULL: none */
    const float *motion[2];              /* [pixels] to where the point was one frame earlier */
    const float *depth;                  /* along the view [m]; infinite where nothing was hit */
    const uint32_t *ids;                 /* of objects; UINT32_MAX: none */
    /* May be NULL. Position [m] in world space tells what stands still; without it, all that can be
     * followed counts as standing still. Normals find creases. */
    const float *position[3], *normal[3];
};

/* From a frame to the next. NAN: nothing could be followed, or no reference. */
struct kl_coherence_step {
    double followed;       /* share of pixels that were followed */
    double step;           /* mean |Y_t - Y_t-1| of those over their mean Y */
    double reference_step; /* the same of R */
    double t_mse, t_relmse;
    uint32_t pops;
};

/* A pixel p of frame t is followed to the place w(p) that its motion vector names in frame t - 1,
 * between four pixels of it (bilinear), if these belong to the same object with about the same
 * depth and normal; where p moves on the screen, p and the four must have neighbours of the same
 * smooth surface all round. What was hidden in frame t - 1 is so left out. NAN: not known. */
struct kl_coherence_result {
    /* Flicker of what stands still: std_t(Y) / mean_t(Y) of surface points that are followed over
     * at least 8 frames (all, of fewer), over pixels and frames. Points darker than 1/1000 of the
     * mean are left out. */
    double flicker_mean, flicker_p99;
    double reference_flicker_mean, reference_flicker_p99; /* of R at the same points */
    uint64_t points;                                      /* that were followed so long */
    double followed; /* share of pixels that could be followed to the frame before */
    /* Mean over frames, pixels and channels of ((I_t - I_t-1) - (R_t - R_t-1))^2, undivided and
     * divided by R_t^2 + 0.01, after division of both by the mean of R_t: true changes cancel. */
    double t_mse, t_relmse;
    /* Blocks whose mean makes a step of more than 2 % that R does not make (any, without R). */
    uint64_t pops, block_steps; /* block_steps: that could be judged */
    /* Shift [frames] of I's changes against R's at which their cross-correlation, over all blocks,
     * is highest; above 0: I is late. NAN also where R does not change or I does not follow. */
    double lag_frames, lag_correlation;
    /* Root of the mean over blocks of the power of Y_I - Y_R above a quarter of the frame rate,
     * over the block's mean of Y_R. */
    double high_band_rms;

    uint32_t frames;                       /* of `steps` */
    const struct kl_coherence_step *steps; /* [0] is empty: borrowed until kl_coherence_destroy */
    /* Flicker of the points that the last frame shows, per pixel; NAN where not known. Borrowed. */
    const float *heat;
};

struct kl_coherence;

/* For `frames` (2 to 4096) frames. *out is the caller's. */
kl_status kl_coherence_create(uint32_t width, uint32_t height, uint32_t frames,
                              struct kl_coherence **out, struct kl_err *err) KL_MUST_CHECK;
/* NULL is accepted. */
void kl_coherence_destroy(struct kl_coherence *coherence);
/* From the last frame to the first, as motion vectors point backwards. The arrays stay as they are
 * until the next call returns. Either all frames have a reference or none has. */
kl_status kl_coherence_add(struct kl_coherence *coherence, const struct kl_coherence_frame *frame,
                           struct kl_err *err) KL_MUST_CHECK;
/* After the first frame was added, once. */
kl_status kl_coherence_finish(struct kl_coherence *coherence, struct kl_coherence_result *out,
                              struct kl_err *err) KL_MUST_CHECK;

#ifdef __cplusplus
}
#endif
#endif
