// SPDX-License-Identifier: MIT
// spread.glsl - how far light that went straight through spreads. Mirror of spread/cpu.c. A file that includes it declares `surface`,
// `shown`, `through`, `materials` (as the stage "irradiance" sees them) and `thickness`.
#include "shared/table.h"

const float LEAST = 2e-3; // of light that arrives behind: what less of it gets through is left as it is

// mm^2 of each channel at a pixel; false where no light went straight.
bool spread_variance(int at, out vec3 variance)
{
    const uint material = floatBitsToUint(shown[at].factor.w);
    const float way = through[at].w;

    variance = vec3(0.0);
    if (!(way > 0.0) || surface[at].x == 0u || material == 0u || materials[material - 1u].thickness_at < 0)
        return false;
    const float place = pell_thickness_place(way, materials[material - 1u].thickest, PELL_LIT_THICKNESS_STEPS);
    const int cell = pell_table_cell(place, PELL_LIT_THICKNESS_STEPS), table = materials[material - 1u].thickness_at;
    const int slab = table + 3 * (PELL_LIT_THICKNESS_STEPS + cell), spread = slab + 3 * PELL_LIT_THICKNESS_STEPS;
    if (max(max(thickness[slab], thickness[slab + 1]), thickness[slab + 2]) < LEAST)
        return false;
    for (int c = 0; c < 3; c++)
        variance[c] = pell_lerp(thickness[spread + c], thickness[spread + 3 + c], min(place - float(cell), 1.0));
    return true;
}
