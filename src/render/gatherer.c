#include "src/render/gatherer.h"

#include "src/base/memory.h"
#include "src/device/gather_device.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct kl_gatherer {
    struct kl_gather_device *device; /* NULL: the host gathers */
    char name[300];
};

/* Is there a GPU among the OpenCL devices? A system without OpenCL has none. */
static bool has_gpu(void)
{
    struct kl_device_info *list = NULL;
    struct kl_err ignored;
    size_t count = 0;
    bool found = false;

    if (kl_device_list(&list, &count, &ignored) != KL_OK) return false;
    for (size_t i = 0; i < count; ++i) {
        found = found || (list[i].usable && strcmp(list[i].type, "gpu") == 0);
    }
    free(list);
    return found;
}

kl_status kl_gatherer_create(const char *device, struct kl_flat *flat, struct kl_motion *motion,
                             struct kl_gatherer **out, struct kl_err *err)
{
    struct kl_gatherer *g = NULL;
    kl_status st = KL_OK;

    if (device == NULL || strcmp(device, "auto") == 0) device = has_gpu() ? "opencl" : "embree";
    st = kl_alloc_array(&g, 1, sizeof *g, err);
    if (st != KL_OK) return st;
    (void)snprintf(g->name, sizeof g->name, "embree");
    if (strcmp(device, "embree") != 0) {
        st = kl_gather_device_create(device, flat, motion, &g->device, err);
        if (st != KL_OK) {
            free(g);
            return st;
        }
        const struct kl_device_info *info = kl_gather_device_get_info(g->device);
        (void)snprintf(g->name, sizeof g->name, "opencl: %s, %s", info->name, info->platform);
    }
    *out = g;
    return KL_OK;
}

void kl_gatherer_destroy(struct kl_gatherer *gatherer)
{
    if (gatherer == NULL) return;
    kl_gather_device_destroy(gatherer->device);
    free(gatherer);
}

const char *kl_gatherer_get_name(const struct kl_gatherer *gatherer)
{
    return gatherer->name;
}

kl_status kl_gatherer_run(void *context, const struct kl_gather_job *job, struct kl_err *err)
{
    struct kl_gatherer *g = context;
    if (g->device == NULL) return kl_gather_host(job, err);
    return kl_gather_device_run(g->device, job, err);
}

kl_status kl_gatherer_run_picks(struct kl_gatherer *gatherer, const struct kl_gather_picks *picks,
                                struct kl_err *err)
{
    if (gatherer->device != NULL) return kl_gather_device_picks(gatherer->device, picks, err);
    kl_gather_host_picks(picks);
    return KL_OK;
}
