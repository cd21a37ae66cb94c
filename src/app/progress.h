/* How far a run is, on stderr, and whether it is time to stop. */
#ifndef KL_SRC_APP_PROGRESS_H
#define KL_SRC_APP_PROGRESS_H

#include "src/app/options.h"
#include "src/base/status.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct kl_progress {
    enum kl_progress_mode mode;
    double start;    /* kl_seconds() of the program's start */
    double deadline; /* kl_seconds(), 0: none */
    const char *phase;
    double phase_start, last;
    size_t frame, frame_count; /* done so far, of */
    uint32_t records;
    kl_status stopped; /* KL_OK, KL_ERR_INTERRUPTED or KL_ERR_LIMIT: why update said stop */
    bool line_is_open; /* a terminal line without newline stands */
};

/* auto becomes terminal or plain. */
void kl_progress_init(struct kl_progress *progress, const struct kl_options *options);
/* A phase begins: "fill" or "render"; borrowed. */
void kl_progress_begin(struct kl_progress *progress, const char *phase, size_t frame_count);
/* `done`: share of the present frame, or of the phase where it has no frames. True: stop. */
bool kl_progress_update(struct kl_progress *progress, double done);
/* Another frame of the phase is done. */
void kl_progress_next_frame(struct kl_progress *progress);
/* Before anything else is printed. */
void kl_progress_end(struct kl_progress *progress);
/* Whether a signal or the time limit asks to stop; sets `stopped`. */
bool kl_progress_is_stopped(struct kl_progress *progress);

#endif
