/* SPDX-License-Identifier: MIT
 * pipeline.c - a compute shader, compiled for a pass. */
#include "vulkan/core.h"

VkResult pell_vk_pipeline(struct pell_gpu_pass *p, const uint32_t *words, size_t size, VkPipeline *out)
{
    struct pell_gpu *gpu = p->gpu;
    const VkShaderModuleCreateInfo module_info = { .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, .codeSize = size, .pCode = words };
    VkSpecializationMapEntry entries[PELL_GPU_BINDINGS];
    const VkSpecializationInfo special = { (uint32_t) p->num_constants, entries, p->num_constants * sizeof(*p->constants), p->constants };
    VkShaderModule module = VK_NULL_HANDLE;
    VkComputePipelineCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
        .stage = { .sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                   .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                   .pName = "main",
                   .pSpecializationInfo = p->num_constants > 0 ? &special : NULL },
        .layout = p->layout,
    };
    VkResult result;

    for (size_t i = 0; i < p->num_constants; i++)
        entries[i] = (VkSpecializationMapEntry) { (uint32_t) i, (uint32_t) (i * sizeof(*p->constants)), sizeof(*p->constants) };
    *out = VK_NULL_HANDLE;
    result = pell_vk_fails(gpu) ? pell_vk_injected(gpu) : gpu->vk.CreateShaderModule(gpu->device, &module_info, NULL, &module);
    if (result != VK_SUCCESS)
        return result;
    info.stage.module = module;
    result = pell_vk_fails(gpu) ? pell_vk_injected(gpu) : gpu->vk.CreateComputePipelines(gpu->device, gpu->cache, 1, &info, NULL, out);
    gpu->vk.DestroyShaderModule(gpu->device, module, NULL);
    atomic_store(&gpu->cache_used, true);
    if (result == VK_SUCCESS)
        pell_vk_name(gpu, VK_OBJECT_TYPE_PIPELINE, (uint64_t) *out, p->shader->name);
    return result;
}
