// SPDX-License-Identifier: MIT
// spread.glsl - lateral spread of straight transmission. Mirror of spread/cpu.c. A file that includes it declares `surface`, `shown`,
// `through`, `materials` (in the format of the stage "irradiance") and `thickness`.
#include "shared/table.h"

const float MIN_TRANSMITTED = 2e-3; // smallest transmittance for which transmission is blurred

// Variance at a pixel, mm^2 per channel; false where there is no straight transmission.
bool spread_variance(int at, out vec3 variance)
{
    const uint material = floatBitsToUint(shown[at].factor.w);
    const float path_mm = through[at].w;

    variance = vec3(0.0);
    if (!(path_mm > 0.0) || surface[at].x == 0u || material == 0u || materials[material - 1u].thickness_at < 0)
        return false;
    const float coord = pell_thickness_coord(path_mm, materials[material - 1u].thickest, PELL_LIT_THICKNESS_STEPS);
    const int cell = pell_table_cell(coord, PELL_LIT_THICKNESS_STEPS), table = materials[material - 1u].thickness_at;
    const int slab = table + 3 * (PELL_LIT_THICKNESS_STEPS + cell), spread = slab + 3 * PELL_LIT_THICKNESS_STEPS;
    if (max(max(thickness[slab], thickness[slab + 1]), thickness[slab + 2]) < MIN_TRANSMITTED)
        return false;
    for (int c = 0; c < 3; c++)
        variance[c] = pell_lerp(thickness[spread + c], thickness[spread + 3 + c], min(coord - float(cell), 1.0));
    return true;
}
