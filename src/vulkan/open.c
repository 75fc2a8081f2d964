/* SPDX-License-Identifier: MIT
 * open.c - opens a Vulkan device for computing, and closes it. */
#include "vulkan/core.h"

#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

enum { MAX_FAMILIES = 64 };

const char *pell_gpu_name(const struct pell_gpu *gpu)
{
    return gpu->name;
}

/* The device of the list that `wanted` names; -1, logged: none usable. */
static int choose(struct pell_context *ctx, const struct pell_vulkan_devices *devices, const char *wanted)
{
    struct pell_text list = { .length = 0 };
    int64_t number = -1;
    int found = -1;

    if (!wanted) {
        if (devices->taken < 0)
            pell_error(ctx, PELL_ERR_DEVICE, "engine vulkan", "use --engine cpu", "no Vulkan device: %s", devices->why);
        return devices->taken;
    }
    if (pell_parse_int(wanted, strlen(wanted), &number) && number >= 0 && (uint64_t) number < devices->count)
        found = (int) number;
    for (size_t i = 0; i < devices->count; i++) {
        pell_text_add(&list, "%s%zu %s", i > 0 ? ", " : "", i, devices->list[i].name);
        if (found < 0 && number < 0 && wanted[0] && pell_text_contains(devices->list[i].name, wanted))
            found = (int) i;
    }
    if (found < 0) {
        char shown[80];
        pell_error(ctx, PELL_ERR_DEVICE, "engine vulkan", devices->count > 0 ? list.str : devices->why, "no Vulkan device is \"%s\"",
                   pell_printable(wanted, shown, sizeof(shown)));
    } else if (devices->list[found].missing.length > 0) {
        pell_error(ctx, PELL_ERR_DEVICE, "engine vulkan", "choose another device, or use --engine cpu", "%s lacks %s",
                   devices->list[found].name, devices->list[found].missing.str);
        found = -1;
    }
    return found;
}

/* Chooses a queue family that computes, without graphics if possible: such queues are free of a desktop's frames. */
static void choose_family(struct pell_gpu *gpu)
{
    VkQueueFamilyProperties families[MAX_FAMILIES];
    uint32_t count = MAX_FAMILIES;
    bool found = false, graphics = true;

    gpu->instance.GetPhysicalDeviceQueueFamilyProperties(gpu->physical, &count, families);
    for (uint32_t i = 0; i < count; i++) {
        const bool draws = families[i].queueFlags & VK_QUEUE_GRAPHICS_BIT;
        if (!(families[i].queueFlags & VK_QUEUE_COMPUTE_BIT) || (found && (draws || !graphics)))
            continue;
        gpu->family = i;
        gpu->time_mask = families[i].timestampValidBits >= 64 ? UINT64_MAX : (UINT64_C(1) << families[i].timestampValidBits) - 1;
        graphics = draws;
        found = true;
    }
}

static enum pell_result load_functions(struct pell_gpu *gpu)
{
    const struct pell_vk_instance *v = &gpu->instance;
    const char *missing = NULL;

#define LOAD(function)                                                                                                                     \
    gpu->vk.function = (PFN_vk##function) v->GetDeviceProcAddr(gpu->device, "vk" #function);                                               \
    missing = gpu->vk.function ? missing : "vk" #function;
    PELL_VK_DEVICE_FUNCTIONS(LOAD)
#undef LOAD
#define LOAD(function) gpu->vk.function = v->labels ? (PFN_vk##function) v->GetDeviceProcAddr(gpu->device, "vk" #function) : NULL;
    PELL_VK_LABEL_FUNCTIONS(LOAD)
#undef LOAD
    if (missing)
        return pell_error(gpu->ctx, PELL_ERR_DEVICE, gpu->name, "use --engine cpu", "the driver has no %s", missing);
    return PELL_OK;
}

static enum pell_result create_device(struct pell_gpu *gpu)
{
    const float priority = 1.0f;
    const VkDeviceQueueCreateInfo queue = {
        .sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO, .queueFamilyIndex = gpu->family, .queueCount = 1, .pQueuePriorities = &priority
    };
    VkPhysicalDeviceVulkan13Features v13 = { .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES,
                                             .synchronization2 = VK_TRUE,
                                             .maintenance4 = VK_TRUE };
    VkPhysicalDeviceVulkan12Features v12 = { .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES,
                                             .pNext = &v13,
                                             .timelineSemaphore = VK_TRUE,
                                             .hostQueryReset = VK_TRUE };
    const VkDeviceCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO, .pNext = &v12, .queueCreateInfoCount = 1, .pQueueCreateInfos = &queue
    };
    const struct pell_vk_instance *v = &gpu->instance;
    enum pell_result res;
    const VkResult result = pell_vk_fails(gpu) ? VK_ERROR_OUT_OF_DEVICE_MEMORY : v->CreateDevice(gpu->physical, &info, NULL, &gpu->device);

    if (result != VK_SUCCESS) {
        gpu->device = VK_NULL_HANDLE;
        return pell_vk_check(gpu, "vkCreateDevice", result);
    }
    PELL_TRY(load_functions(gpu));
    gpu->vk.GetDeviceQueue(gpu->device, gpu->family, 0, &gpu->queue);
    return PELL_OK;

fail:
    return res;
}

static enum pell_result make_locks(struct pell_gpu *gpu)
{
    pthread_mutex_t *const locks[] = { &gpu->queue_lock, &gpu->memory_lock, &gpu->codes_lock, &gpu->programs_lock };
    size_t made = 0;

    while (made < PELL_COUNT(locks) && pthread_mutex_init(locks[made], NULL) == 0)
        made++;
    gpu->locks = made == PELL_COUNT(locks);
    while (!gpu->locks && made > 0)
        pthread_mutex_destroy(locks[--made]);
    return gpu->locks ? PELL_OK : pell_error(gpu->ctx, PELL_ERR_NOMEM, "vulkan", NULL, "the system makes no more locks");
}

/* Reads the properties of the chosen device. */
static void describe(struct pell_gpu *gpu)
{
    VkPhysicalDeviceProperties properties;

    gpu->instance.GetPhysicalDeviceProperties(gpu->physical, &properties);
    gpu->instance.GetPhysicalDeviceMemoryProperties(gpu->physical, &gpu->memory);
    gpu->limits = properties.limits;
    properties.deviceName[sizeof(properties.deviceName) - 1] = '\0';
    pell_printable(properties.deviceName, gpu->name, sizeof(gpu->name));
}

static enum pell_result choose_device(struct pell_gpu *gpu, const char *wanted)
{
    VkPhysicalDevice handles[PELL_VK_MAX_DEVICES];
    struct pell_vulkan_devices devices = { .taken = -1 };
    enum pell_result res = pell_vk_list_devices(gpu->ctx, &gpu->instance, handles, &devices);
    const int found = res == PELL_OK ? choose(gpu->ctx, &devices, wanted) : -1;

    if (found >= 0) {
        gpu->physical = handles[found];
        describe(gpu);
        choose_family(gpu);
    }
    pell_vulkan_devices_release(gpu->ctx, &devices);
    return res != PELL_OK ? res : found < 0 ? PELL_ERR_DEVICE : PELL_OK;
}

enum pell_result pell_gpu_borrow(struct pell_context *ctx, const struct pell_gpu_borrowed *params, struct pell_gpu **out)
{
    struct pell_gpu *gpu = pell_zalloc(ctx, sizeof(*gpu));
    struct pell_vk_instance *v;
    enum pell_result res;

    *out = NULL;
    if (!gpu)
        return PELL_ERR_NOMEM;
    gpu->ctx = ctx;
    gpu->borrowed = true;
    gpu->physical = params->physical_device;
    gpu->device = params->device;
    v = &gpu->instance;
    v->handle = params->instance;
#define LOAD(function) v->function = (PFN_vk##function) params->address(params->instance, "vk" #function);
    PELL_VK_INSTANCE_FUNCTIONS(LOAD)
#undef LOAD
    PELL_TRY(make_locks(gpu));
    if (!v->GetDeviceProcAddr || !v->GetPhysicalDeviceProperties || !v->GetPhysicalDeviceMemoryProperties) {
        res = pell_error(ctx, PELL_ERR_INVALID, "vulkan", NULL, "vkGetInstanceProcAddr finds no functions of the instance");
        goto fail;
    }
    describe(gpu);
    PELL_TRY(load_functions(gpu));
    *out = gpu;
    return PELL_OK;

fail:
    pell_gpu_close(&gpu);
    return res;
}

static bool is_folder(const char *path)
{
    struct stat st;

    return stat(path, &st) == 0 && S_ISDIR(st.st_mode);
}

enum pell_result pell_gpu_open(struct pell_context *ctx, const struct pell_gpu_params *params, struct pell_gpu **out)
{
    static const struct pell_gpu_params none;
    struct pell_gpu *gpu = pell_zalloc(ctx, sizeof(*gpu));
    const char *why = NULL;
    enum pell_result res;

    *out = NULL;
    if (!gpu)
        return PELL_ERR_NOMEM;
    if (!params)
        params = &none;
    gpu->ctx = ctx;
    atomic_store(&gpu->fail_at, params->fail_at);
    PELL_TRY(make_locks(gpu));
    PELL_TRY(pell_vk_instance_open(ctx, params->validate, &gpu->instance, &why));
    if (!gpu->instance.handle) {
        res = pell_error(ctx, PELL_ERR_DEVICE, "engine vulkan", "use --engine cpu", "no Vulkan device: %s", why);
        goto fail;
    }
    PELL_TRY(choose_device(gpu, params->device));
    PELL_TRY(create_device(gpu));
    PELL_TRY(pell_vk_cache_open(gpu, params->cache));
    if (params->shaders && (size_t) snprintf(gpu->shaders, sizeof(gpu->shaders), "%s", params->shaders) >= sizeof(gpu->shaders)) {
        res = pell_error(ctx, PELL_ERR_INVALID, params->shaders, NULL, "the path of a folder of shaders is too long");
        goto fail;
    }
    if (gpu->shaders[0] && !is_folder(gpu->shaders))
        pell_warn(ctx, gpu->shaders, "the built-in shaders are in use", "is no folder of shaders");
    *out = gpu;
    return PELL_OK;

fail:
    pell_gpu_close(&gpu);
    return res;
}

void pell_gpu_close(struct pell_gpu **gpu)
{
    struct pell_gpu *g = *gpu;

    if (!g)
        return;
    *gpu = NULL;
    pell_vk_cache_close(g);
    pell_vk_codes_destroy(g);
    pell_vk_programs_destroy(g);
    if (g->device && !g->borrowed && g->vk.DestroyDevice)
        g->vk.DestroyDevice(g->device, NULL);
    if (!g->borrowed)
        pell_vk_instance_close(&g->instance);
    if (g->locks) {
        pthread_mutex_destroy(&g->queue_lock);
        pthread_mutex_destroy(&g->memory_lock);
        pthread_mutex_destroy(&g->codes_lock);
        pthread_mutex_destroy(&g->programs_lock);
    }
    pell_free(g->ctx, g);
}
