/* Time limits as people write them. */
#ifndef KL_SEQUENCES_DURATION_H
#define KL_SEQUENCES_DURATION_H

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* "90", "90s", "10m", "1h30m", "0.1h", "30d": *out in [0, 1e9] seconds. Units go from large to
 * small, each once; a number without a unit is seconds and stands alone. KL_ERR_USAGE otherwise. */
kl_status kl_duration_parse(const char *text, double *out, struct kl_err *err) KL_MUST_CHECK;

#ifdef __cplusplus
}
#endif
#endif
