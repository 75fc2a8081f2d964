// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// highlights.comp - shadows of highlights, shared by the pixels around each. Mirror of highlights/cpu.c and kernel.c.
//   in  0 shown   1 around   2 frame
//   out 3 shared  what is mirrored
layout(local_size_x = 8, local_size_y = 8) in;
#include "render/picture/device_data.h"
#include "shared/highlights.h"
layout(set = 0, binding = 0) readonly buffer Shown { pell_picture_shown shown[]; };
layout(set = 0, binding = 1) readonly buffer Around { pell_picture_around around[]; };
layout(set = 0, binding = 2) readonly buffer Frame { pell_picture_frame fr; };
layout(set = 0, binding = 3) writeonly buffer Highlights { vec4 given[]; };

const int REACH = PELL_HIGHLIGHTS_REACH;

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy) + ivec2(fr.x0, fr.y0), low = max(p - REACH, ivec2(fr.x0, fr.y0)),
                high = min(p + REACH, ivec2(fr.x1, fr.y1) - 1);
    const int at = p.y * fr.pitch + p.x;
    vec3 mirrored = vec3(0.0), all = vec3(0.0);

    if (p.x >= fr.x1 || p.y >= fr.y1)
        return;
    const uint material = floatBitsToUint(shown[at].factor.w);
    const vec3 specular = shown[at].specular.rgb, hidden = around[at].hidden.rgb;
    const vec4 normal = around[at].normal;
    const float reach = (normal.w * fr.depth_mm + fr.fixed_mm) * PELL_HIGHLIGHTS_SLOPE;
    given[at] = vec4(specular, 0.0);
    if (material == 0u || hidden.r < 0.0)
        return;
    for (int y = low.y; y <= high.y; y++)
        for (int x = low.x; x <= high.x; x++) {
            const int there = y * fr.pitch + x;
            const vec4 beyond = around[there].normal;
            if (floatBitsToUint(shown[there].factor.w) != material || around[there].hidden.r < 0.0)
                continue;
            const float w = float((REACH + 1 - abs(x - p.x)) * (REACH + 1 - abs(y - p.y))) *
                            pell_highlights_alike(dot(normal.xyz, beyond.xyz), abs(beyond.w - normal.w), reach);
            mirrored += w * shown[there].specular.rgb;
            all += w * (shown[there].specular.rgb + around[there].hidden.rgb);
        }
    for (int c = 0; c < 3; c++)
        given[at][c] = pell_highlights_shared(specular[c], hidden[c], mirrored[c], all[c]);
}
