/* Which frames of a sequence are still to be rendered. */
#ifndef KL_SEQUENCES_PLAN_H
#define KL_SEQUENCES_PLAN_H

#include "sequences/frames.h"
#include "src/base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { KL_FINGERPRINT_SIZE = 33 }; /* 32 hexadecimal digits and a zero */

/* What a frame's pixels depend on, as the text that its file carries. */
void kl_fingerprint_make(const uint8_t scene[16], const uint8_t settings[16], int32_t frame,
                         char text[KL_FINGERPRINT_SIZE]);

/* What lies where a frame is to go. */
enum kl_plan_found {
    KL_PLAN_MISSING,    /* nothing: render */
    KL_PLAN_DONE,       /* whole, and its fingerprint is ours: skip */
    KL_PLAN_INCOMPLETE, /* a picture that is cut short: render */
    KL_PLAN_DIFFERENT,  /* whole, of other settings or not ours: refuse unless told to overwrite */
};

enum kl_plan_action { KL_PLAN_RENDER, KL_PLAN_SKIP, KL_PLAN_REFUSE };

struct kl_plan_frame {
    int32_t frame;
    enum kl_plan_found found;
    enum kl_plan_action action;
    char fingerprint[KL_FINGERPRINT_SIZE];
    char *path; /* owned by the plan */
};

struct kl_plan {
    size_t count;
    struct kl_plan_frame *frames; /* in the order of the frame list */
    size_t render_count, skip_count, refuse_count;
};

/* Reads what a file that exists says of itself: `text` = its fingerprint or "", *complete = false
 * only for a picture that is cut short. A file that is no picture at all is somebody else's:
 * complete, no fingerprint. */
typedef kl_status (*kl_plan_reader)(void *context, const char *path, bool *complete,
                                    char text[KL_FINGERPRINT_SIZE], struct kl_err *err);

struct kl_plan_options {
    const struct kl_frames *frames;
    const char *pattern;             /* sequences/pattern.h */
    const uint8_t *scene, *settings; /* digests of 16 bytes */
    bool overwrite;                  /* render every frame, whatever lies there */
    kl_plan_reader read;             /* may be NULL: every file that exists is KL_PLAN_DIFFERENT */
    void *context;
};

/* *out is the caller's: kl_plan_fini. */
kl_status kl_plan_make(const struct kl_plan_options *options, struct kl_plan *out,
                       struct kl_err *err) KL_MUST_CHECK;
void kl_plan_fini(struct kl_plan *plan);

#ifdef __cplusplus
}
#endif
#endif
