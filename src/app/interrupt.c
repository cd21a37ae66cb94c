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

/* A page of a mapped cache file could not be read, or is no longer there. Nothing can be given in
 * its place, so the program ends here; what is on disk is whole. */
static void end_for_page(int number)
{
    static const char line[] =
        "keeplight: error: a mapped file could not be read: the disk failed, "
        "or another program cut the file short\n";

    (void)number;
    if (write(STDERR_FILENO, line, sizeof line - 1) < 0) _exit(2);
    _exit(2); /* kl_exit_code(KL_ERR_IO) */
}

kl_status kl_interrupt_watch(struct kl_err *err)
{
    struct sigaction action = {.sa_handler = note, .sa_flags = SA_RESTART};

    struct sigaction page = {.sa_handler = end_for_page};

    (void)sigemptyset(&action.sa_mask);
    (void)sigemptyset(&page.sa_mask);
    if (sigaction(SIGBUS, &page, NULL) != 0) return kl_fail_errno(err, "signals");
    if (sigaction(SIGINT, &action, NULL) != 0 || sigaction(SIGTERM, &action, NULL) != 0) {
        return kl_fail_errno(err, "signals");
    }
    return KL_OK;
}

bool kl_interrupt_is_asked(void)
{
    return asked != 0;
}
