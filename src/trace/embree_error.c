#include "src/trace/embree_error.h"

#include <stdio.h>
#include <string.h>

static void on_error(void *user, enum RTCError code, const char *text)
{
    struct kl_embree_error *report = user;

    if (report->code != RTC_ERROR_NONE) return; /* the first one is the cause */
    report->code = code;
    (void)snprintf(report->text, sizeof report->text, "%s", text != NULL ? text : "no text");
}

kl_status kl_embree_open(struct kl_embree_error *report, RTCDevice *out, struct kl_err *err)
{
    memset(report, 0, sizeof *report);
    RTCDevice device = rtcNewDevice("threads=1,user_threads=0,set_affinity=0");
    if (device == NULL) {
        return kl_fail(err, KL_ERR_DEVICE, "Embree: no device (error %d)",
                       (int)rtcGetDeviceError(NULL));
    }
    rtcSetDeviceErrorFunction(device, on_error, report);
    *out = device;
    return KL_OK;
}

kl_status kl_embree_check(struct kl_embree_error *report, const char *what, struct kl_err *err)
{
    const struct kl_embree_error seen = *report;

    if (seen.code == RTC_ERROR_NONE) return KL_OK;
    memset(report, 0, sizeof *report);
    return kl_fail(err, seen.code == RTC_ERROR_OUT_OF_MEMORY ? KL_ERR_NO_MEMORY : KL_ERR_DEVICE,
                   "Embree: %s: %s (error %d)", what, seen.text, (int)seen.code);
}
