#include "src/app/exit_code.h"

#include <stddef.h>
#include <stdio.h>

static const struct {
    kl_status status;
    int code;
} codes[] = {
    {KL_OK, 0},
    {KL_ERR_USAGE, 1},
    {KL_ERR_INPUT, 1},
    {KL_ERR_IO, 2},
    {KL_ERR_NO_MEMORY, 2},
    {KL_ERR_DEVICE, 2},
    {KL_ERR_INTERRUPTED, 3},
    {KL_ERR_STALE, 4},
    {KL_ERR_CORRUPT, 4},
    {KL_ERR_VERSION, 4},
    {KL_ERR_LIMIT, 5},
};

int kl_exit_code(kl_status status)
{
    for (size_t i = 0; i < sizeof codes / sizeof codes[0]; ++i) {
        if (codes[i].status == status) return codes[i].code;
    }
    return 2;
}

void kl_say_error(const struct kl_err *err)
{
    (void)fprintf(stderr, "keeplight: error: %s\n", err->msg);
}

void kl_say_warning(void *context, const char *line)
{
    (void)context;
    (void)fprintf(stderr, "keeplight: warning: %s\n", line);
}
