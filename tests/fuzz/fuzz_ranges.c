/* Any text as a frame list, a file pattern, a duration, a frame rate and a shutter. */
#include "sequences/duration.h"
#include "sequences/frames.h"
#include "sequences/pattern.h"
#include "sequences/shutter.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void try_frames(const char *text)
{
    struct kl_err err;
    struct kl_frames frames;

    if (kl_frames_parse(text, &frames, &err) != KL_OK) return;
    if (frames.count == 0 || frames.count > KL_FRAMES_MAX) abort();
    for (size_t i = 0; i < frames.count; ++i) {
        if (labs((long)frames.frames[i]) > KL_FRAME_LIMIT) abort();
    }
    kl_frames_fini(&frames);
}

static void try_numbers(const char *text)
{
    struct kl_err err;
    struct kl_fps fps;
    double x = 0.0;

    if (kl_duration_parse(text, &x, &err) == KL_OK && !(x >= 0.0 && x <= 1e9)) abort();
    if (kl_fps_parse(text, &fps, &err) == KL_OK && (fps.numerator < 1 || fps.denominator < 1)) {
        abort();
    }
    if (kl_shutter_parse_length(text, &x, &err) == KL_OK && !(x >= 0.0 && x <= 10.0)) abort();
    if (kl_shutter_parse_offset(text, &x, &err) == KL_OK && !(fabs(x) <= 10.0)) abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct kl_err err;
    char name[300];
    char *text = malloc(size + 1);

    if (text == NULL) return 0;
    if (size > 0) memcpy(text, data, size);
    text[size] = '\0';
    try_frames(text);
    try_numbers(text);
    if (kl_pattern_format(text, -7, (size & 1) != 0, name, sizeof name, &err) == KL_OK &&
        strlen(name) + 1 > sizeof name) {
        abort();
    }
    free(text);
    return 0;
}
