/* What a run took and how good it is, as JSON: docs/cli.md lists the keys. */
#ifndef KL_SRC_APP_REPORT_H
#define KL_SRC_APP_REPORT_H

#include "src/app/job.h"

struct kl_report;

enum kl_frame_outcome { KL_FRAME_RENDERED, KL_FRAME_SKIPPED, KL_FRAME_FILLED };

struct kl_report_frame {
    int32_t frame;
    enum kl_frame_outcome outcome;
    const char *file; /* NULL: none */
    double total_seconds, shade_seconds, write_seconds;
    struct kl_fill_stats fill; /* of the fill that came before this frame, if any */
    uint32_t loaded;
    struct kl_counts counts;
    uint64_t bad_samples;
    double uncovered;      /* share of pixels, of the fill that covers this frame */
    double error_estimate; /* < 0: no records served */
    bool verified;
    struct kl_verify_stats verify; /* if verified */
};

/* *out is the caller's: kl_report_destroy, which accepts NULL. */
kl_status kl_report_create(struct kl_report **out, struct kl_err *err) KL_MUST_CHECK;
void kl_report_destroy(struct kl_report *report);
kl_status kl_report_add_frame(struct kl_report *report, const struct kl_report_frame *frame,
                              struct kl_err *err) KL_MUST_CHECK;
/* All frames' errors together. */
kl_status kl_report_set_verify(struct kl_report *report, const struct kl_verify_stats *stats,
                               struct kl_err *err) KL_MUST_CHECK;
/* The finished report. `outcome`: how the run ended. */
kl_status kl_report_write(const struct kl_report *report, const struct kl_job *job,
                          kl_status outcome, const char *path, struct kl_err *err) KL_MUST_CHECK;

#endif
