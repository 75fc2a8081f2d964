// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// highlights.comp - shadows of area lights, filtered over neighbouring pixels. Mirror of highlights/cpu.c and kernel.c.
//   i/o 0 shown: the metered luminance follows the entering light
//   in  1 around   2 frame   3 entered, of finish.comp
//   out 4 filtered specular reflection
//   out 5 light   entering irradiance, and depth: the method's plane
layout(local_size_x = 8, local_size_y = 8) in;
#include "render/picture/device_data.h"
#include "shared/highlights.h"
layout(set = 0, binding = 0) buffer Shown { pell_picture_shown shown[]; };
layout(set = 0, binding = 1) readonly buffer Around { pell_picture_around around[]; };
layout(set = 0, binding = 2) readonly buffer Frame { pell_picture_frame fr; };
layout(set = 0, binding = 3) readonly buffer Entered { vec4 entered[]; };
layout(set = 0, binding = 4) writeonly buffer Highlights { vec4 filtered[]; };
layout(set = 0, binding = 5) writeonly buffer Light { vec4 light[]; };

const int REACH = PELL_HIGHLIGHTS_REACH;

// Filtered light of one channel of a pixel: `seen` of `all` is unoccluded in its window, and the same in the nine pixels next to it.
float filtered_light(float light, float hidden, float seen, float all, float next_seen, float next_all)
{
    const float wide = seen / (all > 0.0 ? all : 1.0), next = next_all > 0.0 ? next_seen / next_all : wide;

    return pell_highlights_filtered(light, hidden, pell_highlights_visibility(next, wide, fr.forward.w), seen, all);
}

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy) + ivec2(fr.x0, fr.y0), low = max(p - REACH, ivec2(fr.x0, fr.y0)),
                high = min(p + REACH, ivec2(fr.x1, fr.y1) - 1);
    const int at = p.y * fr.pitch + p.x;
    // sums of specular reflection, and of entering light, each with and without shadows: over the window, and over the nine pixels
    vec3 sum[4] = vec3[4](vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0)), next[4] = sum;

    if (p.x >= fr.x1 || p.y >= fr.y1)
        return;
    const uint material = floatBitsToUint(shown[at].factor.w);
    const vec3 specular = shown[at].specular.rgb, hidden = around[at].hidden.rgb;
    const vec4 normal = around[at].normal;
    const float reach = (normal.w * fr.depth_mm + fr.fixed_mm) * PELL_HIGHLIGHTS_SLOPE;
    const vec4 center = entered[at];
    filtered[at] = vec4(specular, 0.0);
    light[at] = center;
    if (material == 0u || hidden.r < 0.0)
        return;
    for (int y = low.y; y <= high.y; y++)
        for (int x = low.x; x <= high.x; x++) {
            const int tap = y * fr.pitch + x;
            const vec4 beyond = around[tap].normal;
            if (floatBitsToUint(shown[tap].factor.w) != material || around[tap].hidden.r < 0.0)
                continue;
            const int u = abs(x - p.x), v = abs(y - p.y);
            const float alike = pell_highlights_weight(dot(normal.xyz, beyond.xyz), abs(beyond.w - normal.w), reach);
            const float w = float((REACH + 1 - u) * (REACH + 1 - v)) * alike, near = float(max(2 - u, 0) * max(2 - v, 0)) * alike;
            const vec3 seen = shown[tap].specular.rgb, lit = entered[tap].rgb;
            const vec3 here[4] = vec3[4](seen, seen + around[tap].hidden.rgb, lit, lit + around[tap].lost.rgb);
            for (int k = 0; k < 4; k++) {
                sum[k] += w * here[k];
                next[k] += near * here[k];
            }
        }
    vec3 enters = center.rgb;
    for (int c = 0; c < 3; c++) {
        filtered[at][c] = filtered_light(specular[c], hidden[c], sum[0][c], sum[1][c], next[0][c], next[1][c]);
        enters[c] = filtered_light(center[c], around[at].lost[c], sum[2][c], sum[3][c], next[2][c], next[3][c]);
    }
    light[at] = vec4(enters, center.w);
    shown[at].specular.w += dot(around[at].meter_factor.rgb, enters - center.rgb);
}
