/* SPDX-License-Identifier: MIT
 * absent.c - devices.h where the build found no headers of Vulkan. */
#include "vulkan/devices.h"

enum pell_result pell_vulkan_devices_find(struct pell_context *ctx, struct pell_vulkan_devices *out)
{
    (void) ctx;
    *out = (struct pell_vulkan_devices) { .taken = -1, .why = "this build has no Vulkan" };
    return PELL_OK;
}
