/* Reading numbers out of option texts, the same in every locale. Private to this folder. */
#ifndef KL_SEQUENCES_TEXT_IMPL_H
#define KL_SEQUENCES_TEXT_IMPL_H

#include "src/base/status.h"

#include <stdbool.h>
#include <stdint.h>

/* What is being read: option name for messages, whole text, next character. */
struct text {
    const char *what, *start, *next;
};

struct text text_start(const char *what, const char *text);
void text_skip_spaces(struct text *text);
/* Consumes `token` if it comes next. */
bool text_take(struct text *text, const char *token);
bool text_is_at_end(const struct text *text);

/* [-]digits, |value| <= limit. */
kl_status text_read_int(struct text *text, int64_t limit, int64_t *out,
                        struct kl_err *err) KL_MUST_CHECK;
/* [-]digits[.digits] or .digits; `sign` allows the minus. Below 1e15. */
kl_status text_read_decimal(struct text *text, bool sign, double *out,
                            struct kl_err *err) KL_MUST_CHECK;
/* KL_ERR_USAGE: what was found here and what was expected. */
kl_status text_fail(const struct text *text, const char *expected, struct kl_err *err);

#endif
