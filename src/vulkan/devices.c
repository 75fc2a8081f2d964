/* SPDX-License-Identifier: MIT
 * devices.c - asks the Vulkan loader, which is found at run time, for devices and for what they lack. */
#define VK_NO_PROTOTYPES
#include <vulkan/vulkan.h>

#include "vulkan/devices.h"

#include <dlfcn.h>

enum { MAX_DEVICES = 64, MAX_FAMILIES = 64 };

/* The loader and one instance with its functions. Held here and not by volk, whose functions are variables that all threads share. */
struct instance {
    void *loader;
    PFN_vkGetInstanceProcAddr address;
    VkInstance handle;
    PFN_vkDestroyInstance destroy;
    PFN_vkEnumeratePhysicalDevices enumerate;
    PFN_vkGetPhysicalDeviceProperties properties;
    PFN_vkGetPhysicalDeviceFeatures2 features;
    PFN_vkGetPhysicalDeviceMemoryProperties memory;
    PFN_vkGetPhysicalDeviceQueueFamilyProperties families;
};

static enum pell_result failed(struct pell_context *ctx, const char *call, VkResult result)
{
    const bool memory = result == VK_ERROR_OUT_OF_HOST_MEMORY || result == VK_ERROR_OUT_OF_DEVICE_MEMORY;

    return pell_error(ctx, memory ? PELL_ERR_NOMEM : PELL_ERR_DEVICE, "vulkan", NULL, "%s failed with VkResult %d", call, (int) result);
}

/* VK_ERROR_INCOMPATIBLE_DRIVER, with nothing made, where there is no driver. */
static VkResult open_instance(struct instance *v)
{
    const VkApplicationInfo application = { .sType = VK_STRUCTURE_TYPE_APPLICATION_INFO,
                                            .pApplicationName = "pellucid",
                                            .apiVersion = VK_API_VERSION_1_3 };
    const VkInstanceCreateInfo info = { .sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, .pApplicationInfo = &application };
    const PFN_vkCreateInstance create = (PFN_vkCreateInstance) v->address(NULL, "vkCreateInstance");
    const VkResult result = create ? create(&info, NULL, &v->handle) : VK_ERROR_INITIALIZATION_FAILED;

    if (result != VK_SUCCESS)
        return result;
#define LOAD(member, name) v->member = (PFN_##name) v->address(v->handle, #name)
    LOAD(destroy, vkDestroyInstance);
    LOAD(enumerate, vkEnumeratePhysicalDevices);
    LOAD(properties, vkGetPhysicalDeviceProperties);
    LOAD(features, vkGetPhysicalDeviceFeatures2);
    LOAD(memory, vkGetPhysicalDeviceMemoryProperties);
    LOAD(families, vkGetPhysicalDeviceQueueFamilyProperties);
#undef LOAD
    return VK_SUCCESS;
}

static void lacks(struct pell_vulkan_device *d, bool has, const char *name)
{
    if (!has)
        pell_text_add(&d->missing, "%s%s", d->missing.length > 0 ? ", " : "", name);
}

static void find_missing(const struct instance *v, VkPhysicalDevice handle, uint32_t version, struct pell_vulkan_device *d)
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
    v->features(handle, &features);
    v->families(handle, &count, families);
    for (uint32_t i = 0; i < count; i++)
        compute |= (families[i].queueFlags & VK_QUEUE_COMPUTE_BIT) != 0;
    lacks(d, v12.timelineSemaphore, "timelineSemaphore");
    lacks(d, v12.hostQueryReset, "hostQueryReset");
    lacks(d, v13.synchronization2, "synchronization2");
    lacks(d, compute, "a compute queue");
}

static void describe(const struct instance *v, VkPhysicalDevice handle, struct pell_vulkan_device *d)
{
    VkPhysicalDeviceProperties properties;
    VkPhysicalDeviceMemoryProperties memory;

    v->properties(handle, &properties);
    v->memory(handle, &memory);
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

/* Whether the loader is there and knows instances above 1.0; if not, *why says so. */
static bool open_loader(struct instance *v, const char **why)
{
    PFN_vkEnumerateInstanceVersion get_version;
    uint32_t version = VK_API_VERSION_1_0;

    *why = "there is no Vulkan loader: install libvulkan1";
    v->loader = dlopen("libvulkan.so.1", RTLD_NOW | RTLD_LOCAL);
    v->address = v->loader ? (PFN_vkGetInstanceProcAddr) dlsym(v->loader, "vkGetInstanceProcAddr") : NULL;
    if (!v->address)
        return false;
    *why = "the Vulkan loader is older than 1.1";
    get_version = (PFN_vkEnumerateInstanceVersion) v->address(NULL, "vkEnumerateInstanceVersion");
    return get_version && get_version(&version) == VK_SUCCESS && version >= VK_API_VERSION_1_1;
}

static enum pell_result list_devices(struct pell_context *ctx, const struct instance *v, struct pell_vulkan_devices *out)
{
    VkPhysicalDevice handles[MAX_DEVICES];
    uint32_t count = MAX_DEVICES;
    const VkResult result = v->enumerate(v->handle, &count, handles);

    if (result != VK_SUCCESS && result != VK_INCOMPLETE)
        return failed(ctx, "vkEnumeratePhysicalDevices", result);
    if (!(out->list = pell_calloc(ctx, count, sizeof(*out->list))))
        return PELL_ERR_NOMEM;
    out->count = count;
    for (uint32_t i = 0; i < count; i++)
        describe(v, handles[i], &out->list[i]);
    pell_vulkan_devices_choose(out);
    return PELL_OK;
}

enum pell_result pell_vulkan_devices_find(struct pell_context *ctx, struct pell_vulkan_devices *out)
{
    struct instance v = { .loader = NULL };
    enum pell_result res = PELL_OK;
    VkResult result;

    *out = (struct pell_vulkan_devices) { .taken = -1 };
    if (open_loader(&v, &out->why)) {
        out->why = "there is no Vulkan driver: install one (mesa-vulkan-drivers)";
        result = open_instance(&v);
        if (result == VK_SUCCESS) {
            res = list_devices(ctx, &v, out);
            v.destroy(v.handle, NULL);
        } else if (result != VK_ERROR_INCOMPATIBLE_DRIVER) {
            res = failed(ctx, "vkCreateInstance", result);
        }
    }
    if (v.loader)
        dlclose(v.loader);
    return res;
}
