/* SPDX-License-Identifier: MIT
 * calls.c - Vulkan calls: failure injection for tests, error reporting, and debug names of objects. */
#include "vulkan/core.h"

bool pell_vk_fails(struct pell_gpu *gpu)
{
    const uint64_t call = atomic_fetch_add(&gpu->calls, 1) + 1;

    return call == atomic_load(&gpu->fail_at);
}

enum pell_result pell_vk_check(struct pell_gpu *gpu, const char *call, VkResult result)
{
    return result == VK_SUCCESS ? PELL_OK : pell_vk_failed(gpu->ctx, call, result);
}

void pell_vk_name(struct pell_gpu *gpu, VkObjectType type, uint64_t handle, const char *name)
{
    const VkDebugUtilsObjectNameInfoEXT info = {
        .sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_OBJECT_NAME_INFO_EXT, .objectType = type, .objectHandle = handle, .pObjectName = name
    };

    if (gpu->vk.SetDebugUtilsObjectNameEXT)
        gpu->vk.SetDebugUtilsObjectNameEXT(gpu->device, &info); /* a missing name does no harm */
}

uint64_t pell_gpu_fail_at(struct pell_gpu *gpu, uint64_t n)
{
    const uint64_t calls = atomic_load(&gpu->calls);

    atomic_store(&gpu->fail_at, n ? calls + n : 0);
    return calls;
}
