// SPDX-License-Identifier: MIT
// boundary.glsl - transmittance of a material's boundary, from the tables. A file that includes it declares the buffers `pell_lit_material
// materials[]` and `float tables[]`.
#include "shared/boundary.h"
#include "shared/table.h"

const int ALBEDO_MU = PELL_LIT_ALBEDO_MU, ALBEDO_ROUGHNESS = PELL_LIT_ALBEDO_ROUGHNESS, BOUNDARY_MU = PELL_LIT_BOUNDARY_MU;

// Position of a roughness in the tables.
struct Lobe {
    uint material;
    int at;
    float fraction;
};

Lobe lobe_of(uint material, float roughness)
{
    const float y = pell_roughness_coord(roughness, PELL_LIT_ROUGHNESS_MIN, ALBEDO_ROUGHNESS);
    const int k = pell_table_cell(y, ALBEDO_ROUGHNESS);

    return Lobe(material, materials[material].model * ALBEDO_MU * ALBEDO_ROUGHNESS * 2 + 2 * k, y - float(k));
}

// Scale and bias of the directional albedo at a cosine.
vec2 albedo_at(Lobe lobe, float mu)
{
    const float coord = pell_cosine_coord(pell_saturate(mu), ALBEDO_MU);
    const int k = pell_table_cell(coord, ALBEDO_MU), at = lobe.at + 2 * ALBEDO_ROUGHNESS * k, next = at + 2 * ALBEDO_ROUGHNESS;
    const float f = coord - float(k);

    return vec2(pell_bilinear(tables[at], tables[at + 2], tables[next], tables[next + 2], lobe.fraction, f),
                pell_bilinear(tables[at + 1], tables[at + 3], tables[next + 1], tables[next + 3], lobe.fraction, f));
}

// T of a smooth boundary, whose table begins there.
float smooth_transmittance(int table, float mu)
{
    const float coord = pell_cosine_coord(pell_saturate(mu), BOUNDARY_MU);
    const int k = pell_table_cell(coord, BOUNDARY_MU);

    return pell_lerp(tables[table + k], tables[table + k + 1], coord - float(k));
}

// T at a cosine.
float boundary_transmittance(Lobe lobe, float rho_s, float mu)
{
    const int smooth_at = materials[lobe.material].smooth_at;

    if (smooth_at >= 0)
        return smooth_transmittance(smooth_at, mu);
    const vec2 albedo = albedo_at(lobe, mu);
    return pell_transmittance(rho_s, materials[lobe.material].fd, albedo.x, albedo.y);
}
