/* SPDX-License-Identifier: MIT
 * passes.c - a compute shader with the buffers that it works on. */
#define _GNU_SOURCE /* MAP_ANONYMOUS */
#include "vulkan/core.h"

#include <sys/mman.h>

#define COMPILER_MEMORY ((size_t) 32 << 20)

static enum pell_result create_layouts(struct pell_gpu_pass *p)
{
    const struct pell_shader *s = p->shader;
    struct pell_gpu *gpu = p->gpu;
    VkDescriptorSetLayoutBinding bindings[PELL_GPU_BINDINGS];
    const VkDescriptorSetLayoutCreateInfo set = { .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO,
                                                  .bindingCount = (uint32_t) s->num_bindings,
                                                  .pBindings = bindings };
    const VkPushConstantRange push = { VK_SHADER_STAGE_COMPUTE_BIT, 0, s->push_size };
    const VkPipelineLayoutCreateInfo layout = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
        .setLayoutCount = 1,
        .pSetLayouts = &p->set_layout,
        .pushConstantRangeCount = s->push_size > 0,
        .pPushConstantRanges = &push,
    };
    enum pell_result res;

    for (int i = 0; i < s->num_bindings; i++)
        bindings[i] = (VkDescriptorSetLayoutBinding) { .binding = (uint32_t) i,
                                                       .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                                       .descriptorCount = 1,
                                                       .stageFlags = VK_SHADER_STAGE_COMPUTE_BIT };
    PELL_TRY(PELL_VK(gpu, CreateDescriptorSetLayout, (gpu->device, &set, NULL, &p->set_layout)));
    PELL_TRY(PELL_VK(gpu, CreatePipelineLayout, (gpu->device, &layout, NULL, &p->layout)));
    return PELL_OK;

fail:
    return res;
}

/* A driver that compiles for the CPU can end the process where its memory ends: it is asked for first. */
static enum pell_result need_memory(struct pell_gpu *gpu)
{
    void *room = mmap(NULL, COMPILER_MEMORY, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);

    if (room == MAP_FAILED)
        return pell_error(gpu->ctx, PELL_ERR_NOMEM, gpu->name, "use --engine cpu", "too little memory to compile a shader");
    munmap(room, COMPILER_MEMORY);
    return PELL_OK;
}

static enum pell_result create_pipeline(struct pell_gpu_pass *p)
{
    struct pell_gpu *gpu = p->gpu;
    enum pell_result res = need_memory(gpu);

    if (res == PELL_OK)
        res = pell_vk_check(gpu, "vkCreateComputePipelines", pell_vk_pipeline(p, p->shader->words, p->shader->size, &p->built_in));
    p->pipeline = p->built_in;
    return res;
}

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
                                        .pSetLayouts = &p->set_layout };
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
    p->num_constants = num_constants;
    for (size_t i = 0; i < num_constants; i++)
        p->constants[i] = constants[i];
    for (int i = 0; i < shader->num_bindings; i++)
        p->buffers[i] = buffers[i];
    PELL_TRY(create_layouts(p));
    PELL_TRY(create_pipeline(p));
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
        gpu->vk.DestroyDescriptorPool(gpu->device, p->pool, NULL); /* and its set */
    pell_vk_replaced_destroy(p);
    if (p->built_in)
        gpu->vk.DestroyPipeline(gpu->device, p->built_in, NULL);
    if (p->layout)
        gpu->vk.DestroyPipelineLayout(gpu->device, p->layout, NULL);
    if (p->set_layout)
        gpu->vk.DestroyDescriptorSetLayout(gpu->device, p->set_layout, NULL);
    pell_free(gpu->ctx, p);
}
