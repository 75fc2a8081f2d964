/* SPDX-License-Identifier: MIT
 *
 * devices.h - the Vulkan devices of this machine, and which of them an engine uses.
 *
 * Units      memory in bytes.
 * Ownership  pell_vulkan_devices_release releases the result of pell_vulkan_devices_find.
 * Errors     a machine without Vulkan is not an error: it has no device, and `why` gives the reason.
 * Threads    all safe.
 */
#ifndef PELL_VULKAN_DEVICES_H
#define PELL_VULKAN_DEVICES_H

#include "base/base.h"

/* Better kinds first. */
enum pell_vulkan_kind { PELL_VULKAN_DISCRETE, PELL_VULKAN_INTEGRATED, PELL_VULKAN_VIRTUAL, PELL_VULKAN_OTHER, PELL_VULKAN_CPU };

struct pell_vulkan_device {
    char name[256]; /* printable */
    enum pell_vulkan_kind kind;
    unsigned version[3];      /* Vulkan version */
    uint64_t memory;          /* of its largest device-local heap */
    struct pell_text missing; /* required features that it lacks, by name; empty if it can be used */
};

struct pell_vulkan_devices {
    struct pell_vulkan_device *list; /* in the driver's order */
    size_t count;
    int taken;       /* index of the selected device; -1: none */
    const char *why; /* reason for the selection, or for none */
};

PELL_NODISCARD enum pell_result pell_vulkan_devices_find(struct pell_context *ctx, struct pell_vulkan_devices *out);
void pell_vulkan_devices_release(struct pell_context *ctx, struct pell_vulkan_devices *devices);

/* Sets `taken` and `why`: among devices that lack nothing the best kind, of one kind the first. */
void pell_vulkan_devices_choose(struct pell_vulkan_devices *devices);

/* "discrete GPU", "CPU". */
const char *pell_vulkan_kind_name(enum pell_vulkan_kind kind);

#endif
