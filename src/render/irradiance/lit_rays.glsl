// SPDX-License-Identifier: MIT
// lit_rays.glsl - for direct.comp and transmission.comp: selection of lights, and occlusion between a point and a light. Mirror of
// shadow.c.
#include "shared/sampling.h"

const uint RAY_ALL = 3u; // PELL_RAY_ALL

// Whether the ray is unoccluded.
bool is_unoccluded(vec3 origin, vec3 direction, float far)
{
    Hit hit;
    return !trace_ray(Ray(origin, 0.0, direction, far, RAY_ALL), true, hit);
}

bool is_requested(int light)
{
    const uint bit = uint(min(light, 62)), word = bit < 32u ? pc.low : pc.high;
    return (pc.low | pc.high) == 0u || (word >> (bit & 31u) & 1u) != 0u;
}

// Number of the slice's cosine-distributed directions about n that hit nothing; `sample_index`: of the multisample.
uint count_unoccluded(vec3 origin, vec3 n, uint sample_index, uvec2 pattern)
{
    vec3 t, b;
    uint seen = 0u;

    basis_of(n, t, b);
    for (uint s = pc.sky; s < pc.sky_end; s++) {
        const uint at = sample_index * pc.ambient_samples + s;
        const pell_point2 disc = pell_disc_at(pell_unit_float(pell_sobol0(at) ^ pattern.x), pell_unit_float(pell_sobol1(at) ^ pattern.y));
        const float z = sqrt(max(1.0 - disc.x * disc.x - disc.y * disc.y, 0.0));
        seen += is_unoccluded(origin, n * z + disc.x * t + disc.y * b, FAR) ? 1u : 0u;
    }
    return seen;
}
