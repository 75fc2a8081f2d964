/* SPDX-License-Identifier: MIT
 * fuzz_mtl.c - the reader of material libraries on arbitrary bytes. */
#include "fuzz_scene.h"
#include "scene/obj/mtl.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct pell_limits limits;
    int errors = 0;
    struct pell_context_params context = { .log = count_errors, .log_user = &errors, .limits = &limits };
    struct pell_import import = { .path = "fuzz.obj", .root = "/nowhere" };
    struct pell_mtl mtl = { .import = &import };
    struct pell_context *ctx = NULL;
    uint8_t *copy = malloc(size + 1);
    enum pell_result res;

    pell_knobs_default(pell_limit_knobs(), &limits);
    limits.memory_bytes = 256 << 20;
    limits.items = 2000;
    require(copy && pell_context_create(&context, &ctx) == PELL_OK);
    memcpy(copy, data, size);
    copy[size] = 0;
    import.ctx = mtl.names.ctx = mtl.libraries.ctx = ctx;
    mtl.names.where = mtl.libraries.where = import.path;
    require(pell_scene_create(ctx, &import.scene) == PELL_OK);
    res = pell_mtl_read(&mtl, "fuzz.mtl", "", copy, size);
    require((res == PELL_OK) == (errors == 0));
    for (size_t i = 0; i < import.scene->num_materials; i++) {
        const struct pell_material *m = &import.scene->materials[i];
        require(m->roughness >= 0.0f && m->roughness <= 1.0f && m->metallic >= 0.0f && m->metallic <= 1.0f);
        require(m->rho_s >= 0.0f && m->rho_s <= 1.0f && m->base_color[0] >= 0.0f && m->base_color[0] <= 1.0f);
    }
    pell_mtl_finish(&mtl);
    pell_scene_destroy(&import.scene);
    require(pell_memory_used(ctx) == 0);
    pell_context_destroy(&ctx);
    free(copy);
    return 0;
}
