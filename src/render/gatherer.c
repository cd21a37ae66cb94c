#include "src/render/gatherer.h"

#include "src/base/memory.h"

#include <stdlib.h>

struct kl_gatherer {
    char name[128];
};

kl_status kl_gatherer_create(const char *device, struct kl_flat *flat, struct kl_gatherer **out,
                             struct kl_err *err)
{
    (void)device;
    (void)flat;
    return kl_alloc_array(out, 1, sizeof **out, err);
}

void kl_gatherer_destroy(struct kl_gatherer *gatherer)
{
    free(gatherer);
}

const char *kl_gatherer_get_name(const struct kl_gatherer *gatherer)
{
    return gatherer->name;
}

kl_status kl_gatherer_run(void *context, const struct kl_gather_job *job, struct kl_err *err)
{
    (void)context;
    return kl_gather_host(job, err);
}
