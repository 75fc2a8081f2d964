/* SPDX-License-Identifier: MIT
 * fuzz_scene.c - the scene-file reader on arbitrary JSON. Every path is a small mesh of two materials, or a material file. */
#include "fuzz_scene.h"

static enum pell_result read_mesh(void *user, struct pell_context *ctx, const char *path, uint8_t **data, size_t *size)
{
    static const char mesh[] =
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl Skin\nf 1/1 3/3 2/2\nf 1 2 4\nusemtl Cloth\nf 2 3 4\nf 1 4 3\n";
    static const char material[] = "{\"sigma_a\":[0.1,0.2,0.3],\"sigma_s_reduced\":[1,2,3]}";
    const char *text = strstr(path, ".json") ? material : mesh;
    (void) user;

    *size = strlen(text);
    *data = (uint8_t *) pell_strdup(ctx, text);
    return *data ? PELL_OK : PELL_ERR_NOMEM;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const struct pell_load_params params;

    load("fuzz.json", data, size, read_mesh, &params);
    return 0;
}
