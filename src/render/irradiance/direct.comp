// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// direct.comp - direct light at points, one point per invocation: a slice of the samples of all lights, each with its shadow ray. Mirror of
// cpu.c, kernel.c, gloss.c and shadow.c, with the formulas of src/shared. See buffers.glsl.
layout(local_size_x = 64) in;
#include "render/irradiance/buffers.glsl"
#include "visibility/wide_bvh.glsl"
#include "render/irradiance/direct.glsl"
#include "render/irradiance/lit_rays.glsl"
#include "render/irradiance/gloss.glsl"
#include "render/irradiance/through.glsl"

// Light at a point; `rays`: traced for it.
struct Sums {
    vec3 irradiance, specular, hidden, lost, single, unshadowed;
    uint rays;
};

void store_result(uint at, vec3 rgb, uint word)
{
    results[at] = uvec4(floatBitsToUint(rgb), word);
}

void add_result(uint at, vec3 rgb, uint word)
{
    store_result(at, uintBitsToFloat(results[at].rgb) + rgb, results[at].a + word);
}

// State of the light's highlight from earlier slices.
void resume(uint at, inout Highlight highlight)
{
    highlight.visible = uintBitsToFloat(results[at].rgb);
    highlight.occluded = uintBitsToFloat(results[at + 1u].rgb);
}

// Adds what passes media of a light that is occluded; what passes was counted as lost.
void add_passed(pell_light_data light, Point p, Aim a, vec3 through, bool highlights, inout Sums sums)
{
    vec3 passed = vec3(0.0);

    if (max(through.r, max(through.g, through.b)) <= 0.0)
        return;
    a.intensity *= through;
    add_front(p, a, passed, sums.single);
    sums.irradiance += passed;
    if (highlights && is_area_light(light))
        sums.lost -= passed;
}

// Adds the slice's samples of a light. `state`: in the results.
void add_light(pell_light_data light, Point p, uint state, inout Sums sums)
{
    const bool highlights = p.highlights && light.environment < 0;
    Highlight highlight = begin_highlight(light, p);
    vec3 unused = vec3(0.0);

    if (highlights && (pc.flags & PELL_LIT_RESUME) != 0u)
        resume(state, highlight);
    for (int s = int(pc.first); s < min(int(pc.last), light.samples); s++) {
        const uint n = p.sample_index * uint(light.samples) + uint(s);
        Aim a = aim(light, p, pell_sobol0(n), pell_sobol1(n));
        const bool lit = project_image(light, p, a) && a.falloff * (a.intensity.r + a.intensity.g + a.intensity.b) > 0.0;

        if (lit && (a.gl > 0.0 || p.lifted) && a.nl > 0.0) {
            const bool away = light.type == PELL_LIGHT_DATA_DIRECTIONAL;
            const vec3 to = away ? a.direction : a.end - p.origin;
            const float far = away ? FAR : 0.9999;
            const bool visible = is_unoccluded(p.origin, to, far);
            sums.rays++;
            if (visible)
                add_front(p, a, sums.irradiance, sums.single);
            else if (highlights && is_area_light(light))
                add_front(p, a, sums.lost, unused);
            if (highlights)
                add_highlight(light, p, a, visible, highlight);
            if (!visible && (pc.flags & PELL_LIT_PASSES) != 0u)
                add_passed(light, p, a, pass_shadow(p.origin, to, far, PELL_THROUGH_LEAST, sums.rays), highlights, sums);
        }
        if (light.environment >= 0 && (light.flags & PELL_LIGHT_DATA_COMPACT) == 0u)
            sums.unshadowed += min(a.intensity * (a.falloff * transmittance(p, max(a.nl, 0.0)) * max(a.nl, 0.0)), vec3(BIG));
    }
    if (highlights && (pc.flags & PELL_LIT_PAUSE) != 0u) {
        store_result(state, highlight.visible, 0u);
        store_result(state + 1u, highlight.occluded, 0u);
    } else if (highlights)
        end_highlight(light, p, highlight, sums.specular, sums.hidden, sums.rays);
}

// Adds the lights of environment e to its words; lights of no environment to the first words.
void add_entered(uint first, uint env, int e, inout Sums sums)
{
    add_result(e < 0 ? first : env + 2u * uint(e), sums.irradiance, 0u);
    if (e >= 0)
        add_result(env + 2u * uint(e) + 1u, sums.unshadowed, 0u);
    sums.irradiance = sums.unshadowed = vec3(0.0);
}

void main()
{
    const uint i = gl_GlobalInvocationID.x, first = i * pc.results;

    if (i >= pc.count || points[i].material == PELL_LIT_NONE)
        return;
    const bool highlights = (pc.flags & PELL_LIT_HIGHLIGHTS) != 0u, single = (pc.flags & PELL_LIT_SINGLE) != 0u;
    const uint after = first + (highlights ? 1u + PELL_LIT_HIGHLIGHT_WORDS : 1u), env = after + (single ? 1u : 0u);
    Point p = load_point(i, highlights, single);
    Sums sums = Sums(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), 0u);
    int e = -1;

    if ((pc.flags & PELL_LIT_START) != 0u)
        for (uint k = 0u; k < pc.highlight_state; k++)
            results[first + k] = uvec4(0u);
    if (pc.sky_end > pc.sky && (points[i].flags & PELL_LIT_AMBIENT) != 0u) {
        const uvec2 pattern = pattern_at(i, pc.ambient_bits, PELL_AMBIENT_SALT);
        const uint seen = count_sky(p.origin, p.geometric, p.sample_index, pattern, sums.rays);
        for (uint k = 0u; k < pc.environments; k++)
            add_result(env + 2u * k, vec3(0.0), seen);
    }
    for (uint light = pc.light; light < pc.light_end; light++) {
        if (!is_requested(lights[light].light))
            continue;
        if (lights[light].environment != e)
            add_entered(first, env, e, sums);
        e = lights[light].environment;
        add_light(lights[light], p, first + pc.highlight_state, sums);
    }
    add_entered(first, env, e, sums);
    add_result(first, vec3(0.0), sums.rays);
    if (highlights) {
        add_result(first + 1u, sums.specular, 0u);
        add_result(first + 2u, sums.hidden, 0u);
        add_result(first + 3u, sums.lost, 0u);
    }
    if (single)
        add_result(after, sums.single, 0u);
}
