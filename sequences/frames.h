/* Frame lists as people write them: "1-48x2,60". */
#ifndef KL_SEQUENCES_FRAMES_H
#define KL_SEQUENCES_FRAMES_H

#include "src/base/status.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { KL_FRAMES_MAX = 1000000, KL_FRAME_LIMIT = 10000000 };

/* In the order of the text, each frame once. */
struct kl_frames {
    size_t count;
    int32_t *frames;
};

/* list  = item { "," item }
 * item  = frame | frame sep frame [ "x" step ]
 * sep   = "-" | ":" | ".."
 * Frames are whole numbers of at most KL_FRAME_LIMIT either way, steps are above 0; "10-1" runs
 * backwards. At most KL_FRAMES_MAX frames. KL_ERR_USAGE: the message names the character.
 * *out is the caller's: kl_frames_fini. */
kl_status kl_frames_parse(const char *text, struct kl_frames *out,
                          struct kl_err *err) KL_MUST_CHECK;
void kl_frames_fini(struct kl_frames *frames);

#ifdef __cplusplus
}
#endif
#endif
