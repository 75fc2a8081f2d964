/* SPDX-License-Identifier: MIT
 *
 * replace.c - shaders from a folder in place of the built-in ones: FOLDER/NAME.spv of the shader NAME, read when a pass runs and is not yet
 * as the file is. A file that may not stand in for the built-in shader (spirv.h), or that the driver does not take, is warned of once, and
 * the pass goes on with what it had; where the file is gone, with the built-in shader.
 */
#include "vulkan/core.h"
#include "vulkan/spirv.h"

#include "base/file.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

struct pell_vk_replaced {
    struct pell_vk_replaced *before;
    VkPipeline pipeline;
};

static const char HINT[] = "the shader before it stays in use";

/* What the file holds, the caller's; NULL: it is of no use. */
static uint32_t *read_words(struct pell_gpu_pass *p, const char *path, const struct stat *st, size_t *size)
{
    struct pell_gpu *gpu = p->gpu;
    const char *why = NULL;
    uint8_t *data = NULL;

    if (!S_ISREG(st->st_mode) || st->st_size > PELL_SPIRV_MOST || access(path, R_OK) != 0) {
        pell_warn(gpu->ctx, path, HINT, "is no file that can be read, of at most %d MiB", PELL_SPIRV_MOST >> 20);
        return NULL;
    }
    pell_log_downgrade(gpu->ctx, 1);
    if (pell_file_read(gpu->ctx, path, &data, size) != PELL_OK)
        data = NULL;
    pell_log_downgrade(gpu->ctx, -1);
    if (!data)
        return NULL;
    if (pell_spirv_check(gpu->ctx, (const uint32_t *) (const void *) data, *size, p->shader, &why) == PELL_OK && !why)
        return (uint32_t *) (void *) data;
    if (why)
        pell_warn(gpu->ctx, path, HINT, "%s", why);
    pell_free(gpu->ctx, data);
    return NULL;
}

/* Makes the pipeline of the file that of the pass. Those before it may be in lists that are not done, and go with the pass. */
static void take(struct pell_gpu_pass *p, const char *path, const struct stat *st)
{
    struct pell_gpu *gpu = p->gpu;
    struct pell_vk_replaced *made;
    size_t size = 0;
    uint32_t *words = read_words(p, path, st, &size);

    if (!words)
        return;
    made = pell_zalloc(gpu->ctx, sizeof(*made));
    if (made && pell_vk_pipeline(p, words, size, &made->pipeline) == VK_SUCCESS) {
        made->before = p->replaced;
        p->replaced = made;
        p->pipeline = made->pipeline;
        pell_info(gpu->ctx, path, "is in use");
    } else {
        if (made)
            pell_warn(gpu->ctx, path, HINT, "the driver does not take it");
        pell_free(gpu->ctx, made);
    }
    pell_free(gpu->ctx, words);
}

void pell_vk_replace(struct pell_gpu_pass *p)
{
    char path[sizeof(p->gpu->shaders) + 80];
    const int length = snprintf(path, sizeof(path), "%s/%s.spv", p->gpu->shaders, p->shader->name);
    struct stat st;

    if (length < 0 || (size_t) length >= sizeof(path))
        return;
    if (stat(path, &st) != 0) {
        if (!p->looked)
            pell_debug(p->gpu->ctx, path, "is not there: the built-in shader is in use");
        p->looked = true;
        p->pipeline = p->built_in;
        memset(&p->seen, 0, sizeof(p->seen));
        return;
    }
    if (st.st_mtim.tv_sec == p->seen.st_mtim.tv_sec && st.st_mtim.tv_nsec == p->seen.st_mtim.tv_nsec && st.st_size == p->seen.st_size &&
        st.st_ino == p->seen.st_ino)
        return;
    p->seen = st;
    take(p, path, &st);
}

void pell_vk_replaced_destroy(struct pell_gpu_pass *p)
{
    while (p->replaced) {
        struct pell_vk_replaced *r = p->replaced;
        p->replaced = r->before;
        p->gpu->vk.DestroyPipeline(p->gpu->device, r->pipeline, NULL);
        pell_free(p->gpu->ctx, r);
    }
}
