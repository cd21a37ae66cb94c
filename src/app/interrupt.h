/* Ctrl-C and kill: the first asks to stop at the next safe point, the second ends the process. */
#ifndef KL_SRC_APP_INTERRUPT_H
#define KL_SRC_APP_INTERRUPT_H

#include "src/base/status.h"

#include <stdbool.h>

/* SIGINT and SIGTERM. What is on disk is whole at any moment, so the second signal exits with the
 * code of KL_ERR_INTERRUPTED too. */
kl_status kl_interrupt_watch(struct kl_err *err) KL_MUST_CHECK;
bool kl_interrupt_is_asked(void);

#endif
