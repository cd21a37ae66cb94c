#include "src/app/progress.h"

#include "src/app/interrupt.h"
#include "src/base/clock.h"

#include <math.h>
#include <stdio.h>
#include <unistd.h>

void kl_progress_init(struct kl_progress *progress, const struct kl_options *options)
{
    *progress = (struct kl_progress){.mode = options->progress, .start = options->start};
    if (options->time_limit > 0.0) progress->deadline = options->start + options->time_limit;
    if (progress->mode == KL_PROGRESS_AUTO) {
        progress->mode = isatty(STDERR_FILENO) ? KL_PROGRESS_TERMINAL : KL_PROGRESS_PLAIN;
    }
}

bool kl_progress_is_stopped(struct kl_progress *progress)
{
    if (kl_interrupt_is_asked()) {
        progress->stopped = KL_ERR_INTERRUPTED;
    } else if (progress->deadline > 0.0 && kl_seconds() >= progress->deadline) {
        progress->stopped = KL_ERR_LIMIT;
    }
    return progress->stopped != KL_OK;
}

/* [s] between two lines. */
static double interval_of(enum kl_progress_mode mode)
{
    if (mode == KL_PROGRESS_TERMINAL) return 0.2;
    return mode == KL_PROGRESS_JSON ? 1.0 : 10.0;
}

static void format_time(double seconds, char *out, size_t size)
{
    const long s = lround(seconds);
    if (s >= 3600) {
        (void)snprintf(out, size, "%ld:%02ld:%02ld", s / 3600, s / 60 % 60, s % 60);
    } else {
        (void)snprintf(out, size, "%ld:%02ld", s / 60, s % 60);
    }
}

/* Share of the phase that is done, in [0, 1]. */
static double phase_share(const struct kl_progress *p, double done)
{
    if (p->frame_count == 0) return done;
    return fmin(1.0, ((double)p->frame + done) / (double)p->frame_count);
}

static void print_json(const struct kl_progress *p, double share, double elapsed, double left)
{
    (void)fprintf(stderr,
                  "{\"phase\":\"%s\",\"frame\":%zu,\"frames\":%zu,\"percent\":%.1f,\"records\":%lu,"
                  "\"elapsed\":%.1f,\"remaining\":%.1f}\n",
                  p->phase, p->frame, p->frame_count, 100.0 * share, (unsigned long)p->records,
                  elapsed, left);
}

static void print_line(struct kl_progress *p, double done)
{
    const double now = kl_seconds();
    const double share = phase_share(p, done);
    const double left = share > 0.0 ? (now - p->phase_start) * (1.0 - share) / share : 0.0;
    char elapsed_text[32];
    char left_text[32];
    char frame_text[64] = "";

    p->last = now;
    if (p->mode == KL_PROGRESS_JSON) {
        print_json(p, share, now - p->start, left);
        return;
    }
    format_time(now - p->start, elapsed_text, sizeof elapsed_text);
    format_time(left, left_text, sizeof left_text);
    if (p->frame_count > 0) {
        const size_t present = p->frame < p->frame_count ? p->frame + 1 : p->frame_count;
        (void)snprintf(frame_text, sizeof frame_text, "  frame %zu of %zu", present,
                       p->frame_count);
    }
    const bool terminal = p->mode == KL_PROGRESS_TERMINAL;
    (void)fprintf(stderr, "%s%s%s  %3.0f %%  %lu records  elapsed %s  left %s%s",
                  terminal ? "\r" : "", p->phase, frame_text, 100.0 * share,
                  (unsigned long)p->records, elapsed_text, left_text, terminal ? "\x1b[K" : "\n");
    p->line_is_open = terminal;
    if (terminal) (void)fflush(stderr);
}

void kl_progress_begin(struct kl_progress *progress, const char *phase, size_t frame_count)
{
    progress->phase = phase;
    progress->phase_start = kl_seconds();
    progress->last = progress->phase_start;
    progress->frame = 0;
    progress->frame_count = frame_count;
}

bool kl_progress_update(struct kl_progress *progress, double done)
{
    if (progress->mode != KL_PROGRESS_OFF &&
        kl_seconds() - progress->last >= interval_of(progress->mode)) {
        print_line(progress, done);
    }
    return kl_progress_is_stopped(progress);
}

void kl_progress_next_frame(struct kl_progress *progress)
{
    ++progress->frame;
    if (progress->mode == KL_PROGRESS_JSON) print_line(progress, 0.0);
}

void kl_progress_end(struct kl_progress *progress)
{
    if (progress->line_is_open) (void)fputs("\r\x1b[K", stderr);
    progress->line_is_open = false;
}
