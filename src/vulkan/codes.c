/* SPDX-License-Identifier: MIT
 *
 * codes.c - the files of a folder of shaders, each reloaded when it has changed, and shared by all passes of its name, present and future.
 * A file that can't replace the built-in shader (spirv.h) causes one warning, and the previous code is kept.
 */
#include "vulkan/core.h"
#include "vulkan/spirv.h"

#include "base/file.h"

#include <string.h>
#include <unistd.h>

/* Reads the file, which the caller frees; NULL: unusable. `*examined`: the file could be examined; else it could not be read now. */
static uint32_t *read_words(struct pell_gpu *gpu, const struct pell_shader *builtin, const char *path, const struct stat *st, size_t *size,
                            bool *examined)
{
    const char *why = NULL;
    uint8_t *data = NULL;
    enum pell_result res;

    *examined = true;
    if (!S_ISREG(st->st_mode) || st->st_size > PELL_SPIRV_MAX || access(path, R_OK) != 0) {
        pell_warn(gpu->ctx, path, PELL_VK_SHADER_HINT, "is no file that can be read, of at most %d MiB", PELL_SPIRV_MAX >> 20);
        return NULL;
    }
    pell_log_downgrade(gpu->ctx, 1);
    if (pell_file_read(gpu->ctx, path, &data, size) != PELL_OK)
        data = NULL;
    pell_log_downgrade(gpu->ctx, -1);
    res = data ? pell_spirv_check(gpu->ctx, (const uint32_t *) (const void *) data, *size, builtin, &why) : PELL_ERR_IO;
    *examined = res == PELL_OK;
    if (res == PELL_OK && !why)
        return (uint32_t *) (void *) data;
    if (why)
        pell_warn(gpu->ctx, path, PELL_VK_SHADER_HINT, "%s", why);
    pell_free(gpu->ctx, data);
    return NULL;
}

static bool is_same(const struct stat *a, const struct stat *b)
{
    return a->st_mtim.tv_sec == b->st_mtim.tv_sec && a->st_mtim.tv_nsec == b->st_mtim.tv_nsec && a->st_size == b->st_size &&
           a->st_ino == b->st_ino;
}

/* Checks the file, and reloads it if it has changed. */
static void reload_if_changed(struct pell_gpu *gpu, struct pell_vk_code *code, const char *path)
{
    struct stat st;
    uint32_t *words;
    size_t size = 0;
    bool examined;

    if (stat(path, &st) != 0) {
        code->version += code->words != NULL;
        pell_free(gpu->ctx, code->words);
        code->words = NULL;
        memset(&code->seen, 0, sizeof(code->seen));
        return;
    }
    if (is_same(&st, &code->seen))
        return;
    words = read_words(gpu, code->builtin, path, &st, &size, &examined);
    if (examined) /* the state before reading: later writes are found by the next check */
        code->seen = st;
    if (!words)
        return;
    pell_free(gpu->ctx, code->words);
    code->words = words;
    code->size = size;
    code->version++;
    pell_info(gpu->ctx, path, "is read");
}

struct pell_vk_code *pell_vk_code_of(struct pell_gpu *gpu, const struct pell_shader *builtin, const char *path)
{
    struct pell_vk_code *code = gpu->codes;

    while (code && code->builtin != builtin)
        code = code->next;
    if (!code) {
        code = pell_zalloc(gpu->ctx, sizeof(*code));
        if (!code)
            return NULL;
        code->builtin = builtin;
        code->next = gpu->codes;
        gpu->codes = code;
        if (access(path, F_OK) != 0)
            pell_debug(gpu->ctx, path, "is not there: the built-in shader is in use");
    }
    reload_if_changed(gpu, code, path);
    return code;
}

void pell_vk_codes_destroy(struct pell_gpu *gpu)
{
    while (gpu->codes) {
        struct pell_vk_code *code = gpu->codes;
        gpu->codes = code->next;
        pell_free(gpu->ctx, code->words);
        pell_free(gpu->ctx, code);
    }
}
