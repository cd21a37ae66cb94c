#include "src/base/status.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

static void KL_PRINTF(4, 0)
    format_into(struct kl_err *err, kl_status status, int os_error, const char *fmt, va_list args)
{
    err->status = status;
    err->os_error = os_error;
    int n = vsnprintf(err->msg, sizeof err->msg, fmt, args);
    if (n >= 0 && (size_t)n < sizeof err->msg && os_error != 0) {
        char text[128];
        if (strerror_r(os_error, text, sizeof text) != 0) text[0] = '\0';
        (void)!snprintf(err->msg + n, sizeof err->msg - (size_t)n, ": %s", text);
    }
}

kl_status kl_fail(struct kl_err *err, kl_status status, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    format_into(err, status, 0, fmt, args);
    va_end(args);
    return status;
}

kl_status kl_fail_errno(struct kl_err *err, const char *fmt, ...)
{
    int os_error = errno;
    va_list args;
    va_start(args, fmt);
    format_into(err, KL_ERR_IO, os_error, fmt, args);
    va_end(args);
    return KL_ERR_IO;
}

kl_status kl_wrap(struct kl_err *err, const char *fmt, ...)
{
    char inner[sizeof err->msg];
    memcpy(inner, err->msg, sizeof inner);
    va_list args;
    va_start(args, fmt);
    int n = vsnprintf(err->msg, sizeof err->msg, fmt, args);
    va_end(args);
    if (n >= 0 && (size_t)n < sizeof err->msg) {
        (void)!snprintf(err->msg + n, sizeof err->msg - (size_t)n, ": %s", inner);
    }
    return err->status;
}
