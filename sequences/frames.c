#include "sequences/frames.h"

#include "sequences/text_impl.h"
#include "src/base/memory.h"

#include <stdlib.h>
#include <string.h>

/* Bounds the time that a list full of repetitions takes. */
static const size_t visit_limit = 4 * (size_t)KL_FRAMES_MAX;

struct builder {
    struct kl_frames list;
    size_t capacity, visits;
    unsigned char *seen; /* a bit per possible frame */
};

static kl_status add_frame(struct builder *b, int64_t frame, struct kl_err *err)
{
    const size_t bit = (size_t)(frame + KL_FRAME_LIMIT);
    const unsigned char mask = (unsigned char)(1u << (bit % 8));

    if (++b->visits > visit_limit) {
        return kl_fail(err, KL_ERR_USAGE, "frames: too many repetitions");
    }
    if ((b->seen[bit / 8] & mask) != 0) return KL_OK;
    if (b->list.count == KL_FRAMES_MAX) {
        return kl_fail(err, KL_ERR_USAGE, "frames: more than %d", KL_FRAMES_MAX);
    }
    b->seen[bit / 8] |= mask;
    kl_status st = kl_grow_array(&b->list.frames, &b->capacity, b->list.count + 1,
                                 sizeof *b->list.frames, err);
    if (st == KL_OK) b->list.frames[b->list.count++] = (int32_t)frame;
    return st;
}

static bool take_separator(struct text *text)
{
    return text_take(text, "-") || text_take(text, ":") || text_take(text, "..");
}

static kl_status read_item(struct builder *b, struct text *text, struct kl_err *err)
{
    int64_t first = 0;
    int64_t step = 1;

    text_skip_spaces(text);
    kl_status st = text_read_int(text, KL_FRAME_LIMIT, &first, err);
    if (st != KL_OK) return st;
    int64_t last = first;
    if (take_separator(text)) {
        st = text_read_int(text, KL_FRAME_LIMIT, &last, err);
        if (st != KL_OK) return st;
        if (text_take(text, "x")) {
            const struct text at = *text;
            st = text_read_int(text, 2 * (int64_t)KL_FRAME_LIMIT, &step, err);
            if (st == KL_OK && step < 1) st = text_fail(&at, "a step above 0", err);
            if (st != KL_OK) return st;
        }
    }
    text_skip_spaces(text);
    if (!text_is_at_end(text) && *text->next != ',') {
        return text_fail(text, "',' or a range such as 1-48x2", err);
    }
    const int64_t direction = last < first ? -1 : 1;
    for (int64_t f = first; (last - f) * direction >= 0 && st == KL_OK; f += step * direction) {
        st = add_frame(b, f, err);
    }
    return st;
}

kl_status kl_frames_parse(const char *text, struct kl_frames *out, struct kl_err *err)
{
    struct builder b = {0};
    struct text t = text_start("frames", text);
    kl_status st = kl_alloc_array(&b.seen, 2 * (size_t)KL_FRAME_LIMIT / 8 + 1, 1, err);

    if (st != KL_OK) return st;
    do {
        st = read_item(&b, &t, err);
    } while (st == KL_OK && text_take(&t, ","));
    free(b.seen);
    if (st != KL_OK) {
        kl_frames_fini(&b.list);
        return st;
    }
    *out = b.list;
    return KL_OK;
}

void kl_frames_fini(struct kl_frames *frames)
{
    free(frames->frames);
    frames->frames = NULL;
    frames->count = 0;
}
