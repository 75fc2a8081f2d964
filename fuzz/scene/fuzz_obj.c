/* SPDX-License-Identifier: MIT
 * fuzz_obj.c - the OBJ reader and the completion of a scene, on arbitrary bytes. */
#include "fuzz_scene.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const struct pell_load_params params = { .mm_per_unit = 1.0 };

    load("fuzz.obj", data, size, NULL, &params);
    return 0;
}
