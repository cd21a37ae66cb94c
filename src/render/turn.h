/* Processes that fill one store take turns where they would do the same work: the second waits
 * while the first lives, then finds it done. */
#ifndef KL_SRC_RENDER_TURN_H
#define KL_SRC_RENDER_TURN_H

#include "cache_io/claim.h"
#include "src/render/camera.h"

typedef bool (*kl_turn_progress_fn)(void *context, int stage, double done, uint32_t records);

struct kl_turn {
    struct kl_claim *claim;
    double renewed;               /* kl_seconds() */
    kl_turn_progress_fn progress; /* asked while waiting and while filling; may be NULL */
    void *progress_context;
};

/* Wait until no living process fills `store` for these cameras, then claim it; the store may
 * hold more by then. KL_ERR_INTERRUPTED: progress asked to stop. After KL_OK: kl_turn_end. Claims
 * are advice, so nothing here fails for the disk's sake. */
kl_status kl_turn_begin(struct kl_turn *turn, const struct kl_store *store,
                        const struct kl_camera *cameras, uint32_t camera_count,
                        struct kl_err *err) KL_MUST_CHECK;
/* turn->progress, and the claim renewed; fits kl_fill_job.progress. */
bool kl_turn_note(void *turn, int stage, double done, uint32_t records);
void kl_turn_end(struct kl_turn *turn);

#endif
