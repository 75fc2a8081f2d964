/* SPDX-License-Identifier: MIT
 * choose.c - selects a Vulkan device: hardware before software. Needs no Vulkan. */
#include "vulkan/devices.h"

const char *pell_vulkan_kind_name(enum pell_vulkan_kind kind)
{
    static const char *const names[] = { "discrete GPU", "integrated GPU", "virtual GPU", "other", "CPU" };

    return (size_t) kind < PELL_COUNT(names) ? names[kind] : "other";
}

void pell_vulkan_devices_choose(struct pell_vulkan_devices *devices)
{
    static const char *const why[] = { "a discrete GPU comes first", "an integrated GPU, and no discrete one can be taken",
                                       "a virtual GPU, and no better one can be taken", "no GPU can be taken",
                                       "no hardware device is usable; this driver runs on the CPU" };

    devices->taken = -1;
    devices->why = devices->count > 0 ? "every device lacks something" : "there is no device: install its Vulkan driver";
    for (size_t i = 0; i < devices->count; i++) {
        const struct pell_vulkan_device *d = &devices->list[i];

        if (d->missing.length > 0 || (devices->taken >= 0 && d->kind >= devices->list[devices->taken].kind))
            continue;
        devices->taken = (int) i;
        devices->why = why[d->kind];
    }
}

void pell_vulkan_devices_release(struct pell_context *ctx, struct pell_vulkan_devices *devices)
{
    pell_free(ctx, devices->list);
    *devices = (struct pell_vulkan_devices) { .taken = -1 };
}
