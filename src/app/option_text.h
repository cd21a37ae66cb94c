/* Numbers and words of options. */
#ifndef KL_SRC_APP_OPTION_TEXT_H
#define KL_SRC_APP_OPTION_TEXT_H

#include "src/base/status.h"

#include <stddef.h>
#include <stdint.h>

/* KL_ERR_USAGE: "--spp: 'x' is not a whole number from 1 to 65536". */
kl_status kl_option_read_u32(const char *option, const char *text, uint32_t least, uint32_t most,
                             uint32_t *out, struct kl_err *err) KL_MUST_CHECK;
kl_status kl_option_read_number(const char *option, const char *text, double least, double most,
                                double *out, struct kl_err *err) KL_MUST_CHECK;
/* "1%" or "0.01": more than nothing, at most everything. */
kl_status kl_option_read_share(const char *option, const char *text, double *out,
                               struct kl_err *err) KL_MUST_CHECK;
/* "500M": bytes, with K, M or G for powers of 1024. */
kl_status kl_option_read_bytes(const char *option, const char *text, uint64_t *out,
                               struct kl_err *err) KL_MUST_CHECK;
/* "0,0,0,1,2.5,3": two corners in any order; out[0] has the smaller numbers. */
kl_status kl_option_read_box(const char *option, const char *text, double out[2][3],
                             struct kl_err *err) KL_MUST_CHECK;
/* "1280x720". */
kl_status kl_option_read_size(const char *option, const char *text, uint32_t *width,
                              uint32_t *height, struct kl_err *err) KL_MUST_CHECK;

struct kl_option_word {
    const char *word; /* NULL ends the list */
    int value;
};
/* The message lists the words. */
kl_status kl_option_read_word(const char *option, const char *text,
                              const struct kl_option_word *words, int *out,
                              struct kl_err *err) KL_MUST_CHECK;

#endif
