#include "src/app/interrupt.h"

#include "src/app/exit_code.h"

#include <signal.h>
#include <stddef.h>
#include <unistd.h>

/* The one global: a signal handler can reach nothing else. */
static volatile sig_atomic_t asked;

static void note(int number)
{
    (void)number;
    if (asked != 0) _exit(3); /* kl_exit_code(KL_ERR_INTERRUPTED) */
    asked = 1;
}

kl_status kl_interrupt_watch(struct kl_err *err)
{
    struct sigaction action = {.sa_handler = note, .sa_flags = SA_RESTART};

    (void)sigemptyset(&action.sa_mask);
    if (sigaction(SIGINT, &action, NULL) != 0 || sigaction(SIGTERM, &action, NULL) != 0) {
        return kl_fail_errno(err, "signals");
    }
    return KL_OK;
}

bool kl_interrupt_is_asked(void)
{
    return asked != 0;
}
