/* SPDX-License-Identifier: MIT
 *
 * material_solve.c - the reflectance profile of a layered material, as a few Gaussians. */
#include <pellucid/layers.h>
#include <pellucid/material.h>

enum pell_result pell_material_solve(const struct pell_material_layers *layers, struct pell_gaussians *out, struct pell_fit_report *report)
{
    if (!layers || !out)
        return PELL_ERR_INVALID;

    const struct pell_fit_params params = { .count = PELL_MATERIAL_LAYERS_GAUSSIANS };
    struct pell_profile profiles[3];
    struct pell_stack stack;
    struct pell_gaussians found;
    enum pell_result res;

    if (layers->count < 1 || layers->count > PELL_MATERIAL_LAYERS_MAX)
        return PELL_ERR_INVALID;
    pell_material_stack(layers, &stack);
    for (int c = 0; c < 3; c++) {
        res = pell_stack_profile(&stack, c, PELL_STACK_R_PLUS, &profiles[c], NULL);
        if (res != PELL_OK)
            return res;
    }
    res = pell_fit_profiles(profiles, &params, &found, report);
    if (res == PELL_OK && found.count < 1)
        res = PELL_ERR_INVALID;
    if (res == PELL_OK)
        *out = found;
    return res;
}
