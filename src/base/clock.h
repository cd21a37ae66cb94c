/* Time for reports: never for decisions that change results. */
#ifndef KL_SRC_BASE_CLOCK_H
#define KL_SRC_BASE_CLOCK_H

/* Seconds of a clock that only goes forward. */
double kl_seconds(void);
/* Largest resident size so far [bytes]. */
double kl_peak_rss(void);

#endif
