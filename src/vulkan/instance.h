/* SPDX-License-Identifier: MIT
 *
 * instance.h - the Vulkan loader, found at run time, and one instance with its functions. For the files of this room alone.
 *
 * The functions belong to the instance: nothing is shared by threads, as the global variables of a meta-loader would be.
 *
 * Ownership  pell_vk_instance_close takes what pell_vk_instance_open gave, also where it failed.
 */
#ifndef PELL_VULKAN_INSTANCE_H
#define PELL_VULKAN_INSTANCE_H

#define VK_NO_PROTOTYPES
#include <vulkan/vulkan.h>

#include "vulkan/devices.h"

#define PELL_VK_INSTANCE_FUNCTIONS(F)                                                                                                      \
    F(CreateDevice)                                                                                                                        \
    F(DestroyInstance)                                                                                                                     \
    F(EnumeratePhysicalDevices)                                                                                                            \
    F(GetDeviceProcAddr)                                                                                                                   \
    F(GetPhysicalDeviceFeatures2)                                                                                                          \
    F(GetPhysicalDeviceMemoryProperties)                                                                                                   \
    F(GetPhysicalDeviceProperties)                                                                                                         \
    F(GetPhysicalDeviceQueueFamilyProperties)

struct pell_vk_instance {
    void *loader;
    PFN_vkGetInstanceProcAddr address;
    VkInstance handle;
#define PELL_VK_MEMBER(name) PFN_vk##name name;
    PELL_VK_INSTANCE_FUNCTIONS(PELL_VK_MEMBER)
    bool labels; /* VK_EXT_debug_utils is there */
    VkDebugUtilsMessengerEXT messenger;
};

enum { PELL_VK_DEVICES_MOST = 64 };

/* PELL_OK with handle NULL where there is no loader or driver: *why says so. `validate`: with the validation layer (of calls and of
 * synchronisation), whose messages are logged as errors; PELL_ERR_DEVICE where it is not installed. */
PELL_NODISCARD enum pell_result pell_vk_instance_open(struct pell_context *ctx, bool validate, struct pell_vk_instance *out,
                                                      const char **why);
void pell_vk_instance_close(struct pell_vk_instance *v);

/* The devices as pell_vulkan_devices_find gives them, and their handles: room for PELL_VK_DEVICES_MOST, or NULL. */
PELL_NODISCARD enum pell_result pell_vk_list_devices(struct pell_context *ctx, const struct pell_vk_instance *v, VkPhysicalDevice *handles,
                                                     struct pell_vulkan_devices *out);

/* Logs a call that failed. */
enum pell_result pell_vk_failed(struct pell_context *ctx, const char *call, VkResult result);

#endif
