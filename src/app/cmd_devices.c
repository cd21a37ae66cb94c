#include "src/app/commands.h"
#include "src/app/json_text.h"
#include "src/device/device.h"

#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>

static void print_device(const struct kl_device_info *d, size_t number)
{
    (void)printf("opencl:%zu  %s: %s, %u units, %llu MiB\n", number, d->type, d->name,
                 (unsigned)d->compute_units, (unsigned long long)(d->memory_bytes >> 20));
    (void)printf("          %s, %s, driver %s\n", d->platform, d->version, d->driver);
    if (!d->usable) (void)printf("          not usable: %s\n", d->reason);
}

static json_t *describe_device(const struct kl_device_info *d, size_t number)
{
    char selector[32];
    (void)snprintf(selector, sizeof selector, "opencl:%zu", number);
    return json_pack("{s:s,s:s,s:s,s:s,s:s,s:s,s:I,s:I,s:b,s:b,s:s}", "device", selector, "name",
                     d->name, "type", d->type, "platform", d->platform, "version", d->version,
                     "driver", d->driver, "compute_units", (json_int_t)d->compute_units,
                     "memory_bytes", (json_int_t)d->memory_bytes, "shares_memory",
                     (int)d->shares_memory, "usable", (int)d->usable, "reason", d->reason);
}

static kl_status write_json(const struct kl_options *o, const struct kl_device_info *devices,
                            size_t count, struct kl_err *err)
{
    json_t *list = json_array();
    kl_status st = KL_OK;
    int failed = json_array_append_new(list, json_pack("{s:s,s:s,s:b}", "device", "embree", "name",
                                                       "this machine's processor", "usable", 1));
    for (size_t i = 0; failed == 0 && i < count; ++i) {
        failed = json_array_append_new(list, describe_device(&devices[i], i));
    }
    st = failed == 0 ? kl_json_write(list, o->json_file, err)
                     : kl_fail(err, KL_ERR_NO_MEMORY, "devices: out of memory");
    json_decref(list);
    return st;
}

kl_status kl_command_devices(const struct kl_options *options, struct kl_err *err)
{
    struct kl_device_info *devices = NULL;
    size_t count = 0;
    kl_status st = kl_device_list(&devices, &count, err);

    if (st != KL_OK) return st;
    if (options->json) st = write_json(options, devices, count, err);
    if (!options->json || options->json_file != NULL) {
        (void)printf("embree    this machine's processor, always there\n");
        for (size_t i = 0; i < count; ++i) {
            print_device(&devices[i], i);
        }
    }
    free(devices);
    return st;
}
