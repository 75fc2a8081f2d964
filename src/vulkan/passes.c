/* SPDX-License-Identifier: MIT
 * passes.c - a compute shader with the buffers that it works on. */
#include "vulkan/core.h"

static enum pell_result create_set(struct pell_gpu_pass *p)
{
    struct pell_gpu *gpu = p->gpu;
    const uint32_t count = (uint32_t) p->shader->num_bindings;
    const VkDescriptorPoolSize size = { VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, count };
    const VkDescriptorPoolCreateInfo pool = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO, .maxSets = 1, .poolSizeCount = 1, .pPoolSizes = &size
    };
    VkDescriptorSetAllocateInfo set = { .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                        .descriptorSetCount = 1,
                                        .pSetLayouts = &p->program->set_layout };
    VkDescriptorBufferInfo buffers[PELL_GPU_BINDINGS];
    VkWriteDescriptorSet writes[PELL_GPU_BINDINGS];
    enum pell_result res;

    PELL_TRY(PELL_VK(gpu, CreateDescriptorPool, (gpu->device, &pool, NULL, &p->pool)));
    set.descriptorPool = p->pool;
    PELL_TRY(PELL_VK(gpu, AllocateDescriptorSets, (gpu->device, &set, &p->set)));
    for (uint32_t i = 0; i < count; i++) {
        buffers[i] = (VkDescriptorBufferInfo) { p->buffers[i]->handle, 0, p->buffers[i]->size };
        writes[i] = (VkWriteDescriptorSet) {
            .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
            .dstSet = p->set,
            .dstBinding = i,
            .descriptorCount = 1,
            .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
            .pBufferInfo = &buffers[i],
        };
    }
    gpu->vk.UpdateDescriptorSets(gpu->device, count, writes, 0, NULL);
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_gpu_pass_create(struct pell_gpu *gpu, const struct pell_shader *shader, const uint32_t *constants,
                                      size_t num_constants, struct pell_gpu_buffer *const *buffers, struct pell_gpu_pass **out)
{
    const VkPhysicalDeviceLimits *l = &gpu->limits;
    struct pell_gpu_pass *p;
    enum pell_result res;

    *out = NULL;
    if ((uint32_t) shader->num_bindings > l->maxPerStageDescriptorStorageBuffers || shader->push_size > l->maxPushConstantsSize ||
        shader->local[0] * shader->local[1] * shader->local[2] > l->maxComputeWorkGroupInvocations)
        return pell_error(gpu->ctx, PELL_ERR_UNSUPPORTED, gpu->name, "use --engine cpu",
                          "pass %s has %d buffers, %u bytes of push constants and %u invocations, the device allows %u, %u and %u",
                          shader->name, shader->num_bindings, shader->push_size, shader->local[0] * shader->local[1] * shader->local[2],
                          l->maxPerStageDescriptorStorageBuffers, l->maxPushConstantsSize, l->maxComputeWorkGroupInvocations);
    p = pell_zalloc(gpu->ctx, sizeof(*p));
    if (!p)
        return PELL_ERR_NOMEM;
    p->gpu = gpu;
    p->shader = shader;
    for (int i = 0; i < shader->num_bindings; i++)
        p->buffers[i] = buffers[i];
    PELL_TRY(pell_vk_program_of(gpu, shader, constants, num_constants, &p->program));
    p->pipeline = p->program->pipeline;
    PELL_TRY(create_set(p));
    *out = p;
    return PELL_OK;

fail:
    pell_gpu_pass_destroy(&p);
    return res;
}

void pell_gpu_pass_destroy(struct pell_gpu_pass **pass)
{
    struct pell_gpu_pass *p = *pass;
    struct pell_gpu *gpu;

    if (!p)
        return;
    *pass = NULL;
    gpu = p->gpu;
    if (p->pool)
        gpu->vk.DestroyDescriptorPool(gpu->device, p->pool, NULL); /* frees its set, too */
    pell_vk_replaced_destroy(p);
    pell_free(gpu->ctx, p);
}
