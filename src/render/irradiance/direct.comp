// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// direct.comp - direct light at points, a point an invocation: all samples of all lights, each with its ray. Mirror of cpu.c, kernel.c,
// gloss.c and shadow.c, by the formulas of src/shared. See device_data.h.
//   in  0 nodes      of visibility/wide_bvh.h
//   in  1 triangles
//   in  2 lights     sorted by environment, those of none first; `light` is the number in the scene, `image` one of the images below
//   in  3 materials  of the scene
//   in  4 tables     directional albedos, as struct pell_specular_tables has them; then smooth boundaries
//   in  5 images     a struct pell_lit_image each, then texels
//   in  6 points
//   out 7 results    bits of floats
layout(local_size_x = 64) in;
#include "render/irradiance/device_data.h"
layout(set = 0, binding = 0) readonly buffer Nodes { uvec4 bvh_nodes[]; };
layout(set = 0, binding = 1) readonly buffer Triangles { uvec4 bvh_triangles[]; };
layout(set = 0, binding = 2) readonly buffer Lights { pell_light_data lights[]; };
layout(set = 0, binding = 3) readonly buffer Materials { pell_lit_material materials[]; };
layout(set = 0, binding = 4) readonly buffer Tables { float tables[]; };
layout(set = 0, binding = 5) readonly buffer Images { uvec4 images[]; };
layout(set = 0, binding = 6) readonly buffer Points { pell_lit_point points[]; };
layout(set = 0, binding = 7) writeonly buffer Results { uvec4 results[]; };
layout(push_constant) uniform Push { pell_lit_push pc; };
#include "visibility/wide_bvh.glsl"
#include "render/irradiance/direct.glsl"
#include "render/irradiance/gloss.glsl"

const uint RAY_ALL = 3u; // PELL_RAY_ALL

// What a point receives; `rays`: sent for it.
struct Sums {
    vec3 irradiance, specular, hidden, single, unshadowed;
    uint rays;
};

// Whether nothing is in the way.
bool is_open(vec3 origin, vec3 direction, float far)
{
    Hit hit;
    return !trace_ray(Ray(origin, 0.0, direction, far, RAY_ALL), true, hit);
}

bool counts(int light)
{
    const uint bit = uint(min(light, 62)), word = bit < 32u ? pc.low : pc.high;
    return (pc.low | pc.high) == 0u || (word >> (bit & 31u) & 1u) != 0u;
}

// All samples of a light.
void shine(pell_light_data light, Point p, inout Sums sums)
{
    const bool highlights = p.highlights && light.environment < 0;
    Shine highlight = begin_highlight(light, p);

    for (int s = 0; s < light.samples; s++) {
        const uint n = p.number * uint(light.samples) + uint(s);
        Aim a = aim(light, p, pell_sobol0(n), pell_sobol1(n));
        const bool lit = project_image(light, p, a) && a.falloff * (a.intensity.r + a.intensity.g + a.intensity.b) > 0.0;

        if (lit && (a.gl > 0.0 || p.lifted) && a.nl > 0.0) {
            const bool away = light.type == PELL_LIGHT_DATA_DIRECTIONAL;
            const bool open = is_open(p.origin, away ? a.direction : a.end - p.origin, away ? FAR : 0.9999);
            sums.rays++;
            if (open)
                add_front(p, a, sums.irradiance, sums.single);
            if (highlights)
                add_highlight(light, p, a, open, highlight);
        }
        if (light.environment >= 0 && (light.flags & PELL_LIGHT_DATA_COMPACT) == 0u)
            sums.unshadowed += min(a.intensity * (a.falloff * transmittance(p, max(a.nl, 0.0)) * max(a.nl, 0.0)), vec3(BIG));
    }
    if (highlights)
        end_highlight(light, p, highlight, sums.specular, sums.hidden);
}

// Share of cosine-distributed directions about the geometric normal that see nothing.
float ambient_visibility(Point p, uvec2 pattern, inout uint rays)
{
    const vec3 n = p.geometric;
    vec3 t, b;
    uint seen = 0u;

    basis_of(n, t, b);

    for (uint s = 0u; s < pc.ambient_samples; s++) {
        const uint number = p.number * pc.ambient_samples + s;
        const pell_place2 at = pell_disc_at(pell_unit_float(pell_sobol0(number) ^ pattern.x),
                                            pell_unit_float(pell_sobol1(number) ^ pattern.y));
        const float z = sqrt(max(1.0 - at.x * at.x - at.y * at.y, 0.0));
        seen += is_open(p.origin, n * z + at.x * t + at.y * b, FAR) ? 1u : 0u;
    }
    rays += pc.ambient_samples;
    return float(seen) / float(pc.ambient_samples);
}

void give(uint at, vec3 rgb, uint word)
{
    results[at] = uvec4(floatBitsToUint(rgb), word);
}

void main()
{
    const uint i = gl_GlobalInvocationID.x;

    if (i >= pc.count || points[i].material == PELL_LIT_NONE)
        return;
    const bool highlights = (pc.flags & PELL_LIT_HIGHLIGHTS) != 0u;
    Point p = load_point(i, highlights, (pc.flags & PELL_LIT_SINGLE) != 0u);
    const bool sky = (points[i].flags & PELL_LIT_AMBIENT) != 0u;
    Sums sums = Sums(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), 0u);
    const float ambient = sky ? ambient_visibility(p, uvec2(points[i].ambient0, points[i].ambient1), sums.rays) : 0.0;
    uint light = 0u, at = i * pc.results + 1u + (highlights ? 2u : 0u) + (p.single ? 1u : 0u);
    vec3 direct = vec3(0.0);

    for (int e = -1; e < int(pc.environments); e++) { // -1: the lights that are of none
        sums.irradiance = sums.unshadowed = vec3(0.0);
        for (; light < pc.lights && lights[light].environment == e; light++)
            if (counts(lights[light].light))
                shine(lights[light], p, sums);
        if (e < 0) {
            direct = sums.irradiance;
            continue;
        }
        give(at++, sums.irradiance, floatBitsToUint(ambient));
        give(at++, sums.unshadowed, 0u);
    }
    at = i * pc.results;
    give(at++, direct, sums.rays);
    if (highlights) {
        give(at++, sums.specular, 0u);
        give(at++, sums.hidden, 0u);
    }
    if (p.single)
        give(at, sums.single, 0u);
}
