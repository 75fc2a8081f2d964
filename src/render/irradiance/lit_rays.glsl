// SPDX-License-Identifier: MIT
// lit_rays.glsl - for direct.comp and transmission.comp: selection of lights, and occlusion between a point and a light. Mirror of
// shadow.c.
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
