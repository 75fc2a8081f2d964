/* SPDX-License-Identifier: MIT
 * pipeline.c - compiled compute shaders: programs that passes share, and pipelines of replacement code. */
#define _GNU_SOURCE /* MAP_ANONYMOUS */
#include "vulkan/core.h"

#include <string.h>
#include <sys/mman.h>

#define COMPILER_MEMORY ((size_t) 32 << 20)

VkResult pell_vk_pipeline(struct pell_gpu *gpu, const struct pell_vk_program *p, const uint32_t *words, size_t size, VkPipeline *out)
{
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

static enum pell_result create_layouts(struct pell_gpu *gpu, struct pell_vk_program *p)
{
    const struct pell_shader *s = p->shader;
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

/* A driver that compiles on the CPU can end the process if it runs out of memory: check for enough first. */
static enum pell_result need_memory(struct pell_gpu *gpu)
{
    void *room = mmap(NULL, COMPILER_MEMORY, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);

    if (room == MAP_FAILED)
        return pell_error(gpu->ctx, PELL_ERR_NOMEM, gpu->name, "use --engine cpu", "too little memory to compile a shader");
    munmap(room, COMPILER_MEMORY);
    return PELL_OK;
}

static void destroy(struct pell_gpu *gpu, struct pell_vk_program *p)
{
    if (p->pipeline)
        gpu->vk.DestroyPipeline(gpu->device, p->pipeline, NULL);
    if (p->layout)
        gpu->vk.DestroyPipelineLayout(gpu->device, p->layout, NULL);
    if (p->set_layout)
        gpu->vk.DestroyDescriptorSetLayout(gpu->device, p->set_layout, NULL);
    pell_free(gpu->ctx, p);
}

static enum pell_result make(struct pell_gpu *gpu, const struct pell_shader *shader, const uint32_t *constants, size_t num_constants,
                             struct pell_vk_program **out)
{
    struct pell_vk_program *p = pell_zalloc(gpu->ctx, sizeof(*p));
    enum pell_result res;

    if (!p)
        return PELL_ERR_NOMEM;
    p->shader = shader;
    p->num_constants = num_constants;
    for (size_t i = 0; i < num_constants; i++)
        p->constants[i] = constants[i];
    PELL_TRY(create_layouts(gpu, p));
    PELL_TRY(need_memory(gpu));
    PELL_TRY(pell_vk_check(gpu, "vkCreateComputePipelines", pell_vk_pipeline(gpu, p, shader->words, shader->size, &p->pipeline)));
    *out = p;
    return PELL_OK;

fail:
    destroy(gpu, p);
    return res;
}

enum pell_result pell_vk_program_of(struct pell_gpu *gpu, const struct pell_shader *shader, const uint32_t *constants, size_t num_constants,
                                    const struct pell_vk_program **out)
{
    const size_t size = num_constants * sizeof(*constants);
    enum pell_result res = PELL_OK;
    struct pell_vk_program *p;

    pthread_mutex_lock(&gpu->programs_lock);
    for (p = gpu->programs; p; p = p->next)
        if (p->shader == shader && p->num_constants == num_constants && (size == 0 || memcmp(p->constants, constants, size) == 0))
            break;
    if (!p && (res = make(gpu, shader, constants, num_constants, &p)) == PELL_OK) {
        p->next = gpu->programs;
        gpu->programs = p;
    }
    pthread_mutex_unlock(&gpu->programs_lock);
    *out = p;
    return res;
}

void pell_vk_programs_destroy(struct pell_gpu *gpu)
{
    while (gpu->programs) {
        struct pell_vk_program *p = gpu->programs;
        gpu->programs = p->next;
        destroy(gpu, p);
    }
}
