#include "sequences/plan.h"

#include "sequences/pattern.h"
#include "src/base/hash.h"
#include "src/base/memory.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { PATH_SIZE = 4096 };

void kl_fingerprint_make(const uint8_t scene[16], const uint8_t settings[16], int32_t frame,
                         char text[KL_FINGERPRINT_SIZE])
{
    const uint32_t bits = (uint32_t)frame;
    const uint8_t number[4] = {(uint8_t)(bits & 255u), (uint8_t)(bits >> 8 & 255u),
                               (uint8_t)(bits >> 16 & 255u), (uint8_t)(bits >> 24)};
    uint8_t digest[KL_HASH_SIZE];
    struct kl_hash hash;

    kl_hash_init(&hash);
    kl_hash_update(&hash, scene, 16);
    kl_hash_update(&hash, settings, 16);
    kl_hash_update(&hash, number, sizeof number);
    kl_hash_finish(&hash, digest);
    kl_hash_to_hex(digest, sizeof digest, text);
}

static kl_status look(const struct kl_plan_options *options, struct kl_plan_frame *frame,
                      struct kl_err *err)
{
    char text[KL_FINGERPRINT_SIZE] = "";
    bool complete = false;
    struct stat info;

    if (stat(frame->path, &info) != 0) {
        if (errno != ENOENT) return kl_fail_errno(err, "%s", frame->path);
        frame->found = KL_PLAN_MISSING;
        return KL_OK;
    }
    if (!S_ISREG(info.st_mode)) {
        return kl_fail(err, KL_ERR_IO, "%s: in the way, not a regular file", frame->path);
    }
    frame->found = KL_PLAN_DIFFERENT;
    if (options->read == NULL) return KL_OK;
    kl_status st = options->read(options->context, frame->path, &complete, text, err);
    if (st != KL_OK) return st;
    if (!complete) {
        frame->found = KL_PLAN_INCOMPLETE;
    } else if (strcmp(text, frame->fingerprint) == 0) {
        frame->found = KL_PLAN_DONE;
    }
    return KL_OK;
}

static enum kl_plan_action decide(enum kl_plan_found found, bool overwrite)
{
    if (overwrite || found == KL_PLAN_MISSING || found == KL_PLAN_INCOMPLETE) return KL_PLAN_RENDER;
    return found == KL_PLAN_DONE ? KL_PLAN_SKIP : KL_PLAN_REFUSE;
}

static kl_status plan_frame(const struct kl_plan_options *options, int32_t number,
                            struct kl_plan *plan, struct kl_err *err)
{
    struct kl_plan_frame *frame = &plan->frames[plan->count];
    char path[PATH_SIZE];
    kl_status st = kl_pattern_format(options->pattern, number, options->frames->count > 1, path,
                                     sizeof path, err);

    if (st == KL_OK) st = kl_copy_string(&frame->path, path, err);
    if (st != KL_OK) return st;
    ++plan->count; /* from here on kl_plan_fini frees the path */
    frame->frame = number;
    kl_fingerprint_make(options->scene, options->settings, number, frame->fingerprint);
    st = look(options, frame, err);
    if (st != KL_OK) return st;
    frame->action = decide(frame->found, options->overwrite);
    if (frame->action == KL_PLAN_RENDER) ++plan->render_count;
    if (frame->action == KL_PLAN_SKIP) ++plan->skip_count;
    if (frame->action == KL_PLAN_REFUSE) ++plan->refuse_count;
    return KL_OK;
}

kl_status kl_plan_make(const struct kl_plan_options *options, struct kl_plan *out,
                       struct kl_err *err)
{
    struct kl_plan plan = {0};
    kl_status st = kl_alloc_array(&plan.frames, options->frames->count, sizeof *plan.frames, err);

    if (st != KL_OK) return st;
    for (size_t i = 0; i < options->frames->count && st == KL_OK; ++i) {
        st = plan_frame(options, options->frames->frames[i], &plan, err);
    }
    if (st != KL_OK) {
        kl_plan_fini(&plan);
        return st;
    }
    *out = plan;
    return KL_OK;
}

void kl_plan_fini(struct kl_plan *plan)
{
    for (size_t i = 0; i < plan->count; ++i)
        free(plan->frames[i].path);
    free(plan->frames);
    memset(plan, 0, sizeof *plan);
}
