/* SPDX-License-Identifier: MIT
 *
 * replace.c - shaders from a folder that replace the built-in ones: FOLDER/NAME.spv for the shader NAME, checked when a pass runs. If the
 * driver rejects it, the pass keeps its previous code; if the file is removed, it returns to the built-in shader.
 */
#include "vulkan/core.h"

#include <stdio.h>

struct pell_vk_replaced {
    struct pell_vk_replaced *previous;
    VkPipeline pipeline;
};

/* Switches the pass to the code. Earlier pipelines may be in lists that are not finished, and are freed with the pass. */
static void switch_code(struct pell_gpu_pass *p, struct pell_vk_code *code, const char *path)
{
    struct pell_vk_replaced *made;

    p->version = code->version;
    if (!code->words) {
        p->pipeline = p->program->pipeline;
        return;
    }
    made = pell_zalloc(p->gpu->ctx, sizeof(*made));
    if (!made)
        return;
    if (pell_vk_pipeline(p->gpu, p->program, code->words, code->size, &made->pipeline) == VK_SUCCESS) {
        made->previous = p->replaced;
        p->replaced = made;
        p->pipeline = made->pipeline;
    } else {
        if (code->warned != code->version) /* otherwise other passes of the shader have reported it */
            pell_warn(p->gpu->ctx, path, PELL_VK_SHADER_HINT, "the driver does not take it");
        code->warned = code->version;
        pell_free(p->gpu->ctx, made);
    }
}

void pell_vk_replace(struct pell_gpu_pass *p)
{
    char path[sizeof(p->gpu->shaders) + 80];
    const int length = snprintf(path, sizeof(path), "%s/%s.spv", p->gpu->shaders, p->shader->name);
    struct pell_vk_code *code;

    if (length < 0 || (size_t) length >= sizeof(path))
        return;
    pthread_mutex_lock(&p->gpu->codes_lock);
    code = pell_vk_code_of(p->gpu, p->shader, path);
    if (code && code->version != p->version)
        switch_code(p, code, path);
    pthread_mutex_unlock(&p->gpu->codes_lock);
}

void pell_vk_replaced_destroy(struct pell_gpu_pass *p)
{
    while (p->replaced) {
        struct pell_vk_replaced *r = p->replaced;
        p->replaced = r->previous;
        p->gpu->vk.DestroyPipeline(p->gpu->device, r->pipeline, NULL);
        pell_free(p->gpu->ctx, r);
    }
}
