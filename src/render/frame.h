/* One frame: every pixel's samples, the image layers they make, and what it took. */
#ifndef KL_SRC_RENDER_FRAME_H
#define KL_SRC_RENDER_FRAME_H

#include "src/image/image.h"
#include "src/render/camera.h"
#include "src/render/shade.h"
#include "src/scene/motion.h"

struct kl_frame_job {
    struct kl_shade_context shade;
    struct kl_camera camera;         /* at the reference instant */
    const struct kl_camera *cameras; /* evenly spaced while the shutter is open */
    uint32_t camera_count;           /* 0: it stands still */
    const float *times;              /* kl_scene_view.shutter_times; NULL: open all the time */
    struct kl_camera before;         /* one frame earlier: motion vectors */
    const struct kl_motion *before_motion; /* things one frame earlier; NULL: where they are */
    double origin[3]; /* [m] world position of render space's origin: the P layer */
    uint32_t spp;
    uint32_t seed; /* of this frame */
    /* Called by one thread now and then with the share that is done; true asks to stop. */
    bool (*progress)(void *context, double done);
    void *progress_context;
};

/* Layers (docs/cli.md lists them) as a comma-separated list, NULL or "all": every one. Beauty is
 * always there. KL_ERR_USAGE names the unknown layer. */
kl_status kl_frame_add_layers(struct kl_image *image, const char *list,
                              struct kl_err *err) KL_MUST_CHECK;

/* Render into the channels that the image has. Bit for bit the same for any number of threads.
 * KL_ERR_INTERRUPTED: progress asked to stop; the image is unfinished. NaN and Inf samples are set
 * to 0 and counted in *bad_samples. */
kl_status kl_frame_render(const struct kl_frame_job *job, struct kl_image *image,
                          struct kl_counts *counts, uint64_t *bad_samples,
                          struct kl_err *err) KL_MUST_CHECK;

#endif
