/* SPDX-License-Identifier: MIT
 *
 * instance.h - the Vulkan loader, found at run time, and one instance with its functions. Internal to src/vulkan.
 *
 * The functions belong to the instance: nothing is shared by threads, as the global variables of a meta-loader would be.
 *
 * Ownership  pell_vk_instance_close releases the result of pell_vk_instance_open, even if that failed.
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
    bool labels; /* VK_EXT_debug_utils is available */
    VkDebugUtilsMessengerEXT messenger;
};

enum { PELL_VK_MAX_DEVICES = 64 };

/* PELL_OK with handle NULL if there is no loader or driver: *why gives the reason. `validate`: with the validation layer (for calls and
 * synchronisation), whose messages are logged as errors; PELL_ERR_DEVICE if it is not installed. */
PELL_NODISCARD enum pell_result pell_vk_instance_open(struct pell_context *ctx, bool validate, struct pell_vk_instance *out,
                                                      const char **why);
void pell_vk_instance_close(struct pell_vk_instance *v);

/* Lists the devices as pell_vulkan_devices_find does, and their handles: room for PELL_VK_MAX_DEVICES, or NULL. */
PELL_NODISCARD enum pell_result pell_vk_list_devices(struct pell_context *ctx, const struct pell_vk_instance *v, VkPhysicalDevice *handles,
                                                     struct pell_vulkan_devices *out);

/* Logs a call that failed. */
enum pell_result pell_vk_failed(struct pell_context *ctx, const char *call, VkResult result);

#endif
