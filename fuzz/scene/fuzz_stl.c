/* SPDX-License-Identifier: MIT
 * fuzz_stl.c - the STL reader and the completion of a scene, on arbitrary bytes. */
#include "fuzz_scene.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const struct pell_load_params params = { .size_mm = 70.0 };

    load("fuzz.stl", data, size, NULL, &params);
    return 0;
}
