/* Frame coherence as a plot, drawn by gnuplot. */
#ifndef KL_SRC_APP_FLICKER_PLOT_H
#define KL_SRC_APP_FLICKER_PLOT_H

#include "sequences/coherence.h"

/* KL_ERR_USAGE: `path` ends neither in .svg nor in .png. */
kl_status kl_flicker_plot_check(const char *path, struct kl_err *err) KL_MUST_CHECK;
/* `first`: number of the first frame. KL_ERR_IO: gnuplot is not installed or fails. */
kl_status kl_flicker_plot(const char *path, const struct kl_coherence_result *result, int32_t first,
                          struct kl_err *err) KL_MUST_CHECK;

#endif
