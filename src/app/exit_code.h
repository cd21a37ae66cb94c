/* What the process tells its caller: docs/errors.md. */
#ifndef KL_SRC_APP_EXIT_CODE_H
#define KL_SRC_APP_EXIT_CODE_H

#include "src/base/status.h"

/* The exit code of a status. */
int kl_exit_code(kl_status status);
/* One line on stderr: "keeplight: error: ...". */
void kl_say_error(const struct kl_err *err);
/* One line on stderr: "keeplight: warning: ..."; fits kl_warn_fn, `context` is not used. */
void kl_say_warning(void *context, const char *line);

#endif
