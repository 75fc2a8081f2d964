/* SPDX-License-Identifier: MIT
 * devices.c - enumerates Vulkan devices and their missing features. */
#include "vulkan/instance.h"

enum { MAX_FAMILIES = 64 };

static void lacks(struct pell_vulkan_device *d, bool has, const char *name)
{
    if (!has)
        pell_text_add(&d->missing, "%s%s", d->missing.length > 0 ? ", " : "", name);
}

static void find_missing(const struct pell_vk_instance *v, VkPhysicalDevice handle, uint32_t version, struct pell_vulkan_device *d)
{
    VkPhysicalDeviceVulkan13Features v13 = { .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES };
    VkPhysicalDeviceVulkan12Features v12 = { .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES, .pNext = &v13 };
    VkPhysicalDeviceFeatures2 features = { .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, .pNext = &v12 };
    VkQueueFamilyProperties families[MAX_FAMILIES];
    uint32_t count = MAX_FAMILIES;
    bool compute = false;

    if (version < VK_API_VERSION_1_3) {
        lacks(d, false, "Vulkan 1.3");
        return;
    }
    v->GetPhysicalDeviceFeatures2(handle, &features);
    v->GetPhysicalDeviceQueueFamilyProperties(handle, &count, families);
    for (uint32_t i = 0; i < count; i++)
        compute |= (families[i].queueFlags & VK_QUEUE_COMPUTE_BIT) != 0;
    lacks(d, v12.timelineSemaphore, "timelineSemaphore");
    lacks(d, v12.hostQueryReset, "hostQueryReset");
    lacks(d, v13.synchronization2, "synchronization2");
    lacks(d, v13.maintenance4, "maintenance4");
    lacks(d, compute, "a compute queue");
}

static void describe(const struct pell_vk_instance *v, VkPhysicalDevice handle, struct pell_vulkan_device *d)
{
    VkPhysicalDeviceProperties properties;
    VkPhysicalDeviceMemoryProperties memory;

    v->GetPhysicalDeviceProperties(handle, &properties);
    v->GetPhysicalDeviceMemoryProperties(handle, &memory);
    properties.deviceName[sizeof(properties.deviceName) - 1] = '\0';
    pell_printable(properties.deviceName, d->name, sizeof(d->name));
    d->kind = properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU     ? PELL_VULKAN_DISCRETE
              : properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU ? PELL_VULKAN_INTEGRATED
              : properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU    ? PELL_VULKAN_VIRTUAL
              : properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU            ? PELL_VULKAN_CPU
                                                                                : PELL_VULKAN_OTHER;
    d->version[0] = VK_API_VERSION_MAJOR(properties.apiVersion);
    d->version[1] = VK_API_VERSION_MINOR(properties.apiVersion);
    d->version[2] = VK_API_VERSION_PATCH(properties.apiVersion);
    for (uint32_t i = 0; i < memory.memoryHeapCount; i++)
        if ((memory.memoryHeaps[i].flags & VK_MEMORY_HEAP_DEVICE_LOCAL_BIT) && memory.memoryHeaps[i].size > d->memory)
            d->memory = memory.memoryHeaps[i].size;
    find_missing(v, handle, properties.apiVersion, d);
}

enum pell_result pell_vk_list_devices(struct pell_context *ctx, const struct pell_vk_instance *v, VkPhysicalDevice *handles,
                                      struct pell_vulkan_devices *out)
{
    VkPhysicalDevice found[PELL_VK_MAX_DEVICES];
    uint32_t count = PELL_VK_MAX_DEVICES;
    const VkResult result = v->EnumeratePhysicalDevices(v->handle, &count, found);

    if (result != VK_SUCCESS && result != VK_INCOMPLETE)
        return pell_vk_failed(ctx, "vkEnumeratePhysicalDevices", result);
    if (!(out->list = pell_calloc(ctx, count, sizeof(*out->list))))
        return PELL_ERR_NOMEM;
    out->count = count;
    for (uint32_t i = 0; i < count; i++) {
        describe(v, found[i], &out->list[i]);
        if (handles)
            handles[i] = found[i];
    }
    pell_vulkan_devices_choose(out);
    return PELL_OK;
}

enum pell_result pell_vulkan_devices_find(struct pell_context *ctx, struct pell_vulkan_devices *out)
{
    struct pell_vk_instance v;
    enum pell_result res;

    *out = (struct pell_vulkan_devices) { .taken = -1 };
    res = pell_vk_instance_open(ctx, false, &v, &out->why);
    if (res == PELL_OK && v.handle)
        res = pell_vk_list_devices(ctx, &v, NULL, out);
    pell_vk_instance_close(&v);
    return res;
}
