// SPDX-License-Identifier: MIT
// sky.glsl - lookups in environments: entering irradiance by normal, and prefiltered reflection. Mirror of lights/environment_lookup.c, and
// of smooth_environment in irradiance/transmission.c. A file that includes it declares the buffer `uint sky[]`
// (pell_lights_environment_words), and includes irradiance/boundary.glsl.
#include "shared/environment.h"
#include "shared/lobe.h"

const uint SKY_ROW = 48u, SKY_LEVELS = 20u, SKY_MODELS = 12u; // words of PELL_ENV_ROW

float sky_float(uint at)
{
    return uintBitsToFloat(sky[at]);
}

vec3 sky_rgb(uint at)
{
    return uintBitsToFloat(uvec3(sky[at], sky[at + 1u], sky[at + 2u]));
}

// Query of an environment's entering light for a material (struct pell_env_query), and the offsets of its data in a node.
struct Entering {
    uint row;
    Lobe lobe;
    float rho_s, fd;
    bool smooth_one;
    uint at; // index among a node's floats
    float between; // fraction between two roughnesses
};

Entering entering_of(uint e, Lobe lobe, float roughness, float rho_s)
{
    const pell_lit_material m = materials[lobe.material];
    const float coord = pell_roughness_coord(roughness, PELL_LIT_ROUGHNESS_MIN, PELL_ENV_ROUGHNESS);
    const int k = pell_table_cell(coord, PELL_ENV_ROUGHNESS);
    Entering n;

    n.row = 4u + SKY_ROW * e;
    n.lobe = lobe;
    n.rho_s = rho_s;
    n.fd = m.fd;
    n.smooth_one = m.smooth_at >= 0;
    n.at = n.smooth_one ? sky[n.row + 2u] + 3u * sky[sky[2] + lobe.material] : sky[n.row + SKY_MODELS + uint(m.model)] + 6u * uint(k);
    n.between = coord - float(k);
    return n;
}

// Entering irradiance at a normal, W/m^2.
vec3 rest_at(Entering n, vec3 normal)
{
    const pell_point2 at = pell_octahedral_coord(normal.x, normal.y, normal.z);
    const int i = pell_table_cell(at.x, PELL_ENV_NODES), j = pell_table_cell(at.y, PELL_ENV_NODES);
    const float f = at.x - float(i), g = at.y - float(j);
    vec3 enters = vec3(0.0), lobe = vec3(0.0);

    for (int corner = 0; corner < 4; corner++) {
        const uint node = sky[n.row] + uint((j + corner / 2) * PELL_ENV_NODES + i + corner % 2) * sky[n.row + 1u], k = node + n.at;
        const float weight = ((corner & 1) != 0 ? f : 1.0 - f) * (corner >= 2 ? g : 1.0 - g);
        if (n.smooth_one) {
            enters += weight * sky_rgb(k);
            continue;
        }
        const vec3 a = n.fd * sky_rgb(k) + sky_rgb(k + 3u), b = n.fd * sky_rgb(k + 6u) + sky_rgb(k + 9u);
        enters += weight * sky_rgb(node);
        lobe += weight * (a + n.between * (b - a));
    }
    return enters - n.rho_s * lobe;
}

// The same without the light sources that represent the environment's broad bright parts.
vec3 broad_rest_at(Entering n, vec3 normal)
{
    vec3 rest = rest_at(n, normal);

    for (uint k = 0u; k < sky[n.row + 10u]; k++) {
        const uint light = sky[n.row + 9u] + 6u * k;
        const float mu = -dot(normal, sky_rgb(light));
        if (mu > 0.0)
            rest -= mu * boundary_transmittance(n.lobe, n.rho_s, mu) * sky_rgb(light + 3u);
    }
    return max(rest, vec3(0.0));
}

// Bilinear lookup in a level.
vec3 level_at(uint level, pell_point2 uv)
{
    const int width = int(sky[level + 1u]), height = int(sky[level + 2u]);
    const float x = uv.x * float(width) - 0.5, y = clamp(uv.y * float(height) - 0.5, 0.0, float(height - 1));
    const int xi = int(floor(x)), yi = int(y);
    vec3 sum = vec3(0.0);

    for (int k = 0; k < 4; k++) {
        const int column = (xi + width + (k & 1)) % width, line = min(yi + (k >> 1), height - 1);
        const float f = x - float(xi), g = y - float(yi);
        sum += ((k & 1) != 0 ? f : 1.0 - f) * (k >= 2 ? g : 1.0 - g) * sky_rgb(sky[level] + 3u * uint(line * width + column));
    }
    return sum;
}

// Radiance from a unit direction, prefiltered for a lobe of this width.
vec3 mirrored_by(uint e, vec3 d, float width)
{
    const uint row = 4u + SKY_ROW * e, levels = sky[row + 3u];
    const float r = sqrt(pell_saturate(width));
    const float cosine = sky_float(row + 4u), sine = sky_float(row + 5u);
    uint level = row + SKY_LEVELS;

    if (levels == 0u)
        return sky_rgb(row + 6u);
    for (uint k = 0u; k + 2u < levels && r >= sky_float(level + 7u); k++)
        level += 4u;
    const pell_point2 uv = pell_panorama_uv(d.x * cosine - d.z * sine, d.y, d.x * sine + d.z * cosine);
    const vec3 a = level_at(level, uv), b = level_at(level + 4u, uv);
    return a + (r - sky_float(level + 3u)) / (sky_float(level + 7u) - sky_float(level + 3u)) * (b - a);
}
