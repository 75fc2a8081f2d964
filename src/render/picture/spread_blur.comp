// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// spread_blur.comp - one axis of a blur of straight transmission over pixels of the same object, weighted by distance in space. Mirror of
// blur_block in spread/cpu.c.
//   in  0 surface   1 around   2 frame   3 from
//   out 4 to
layout(local_size_x = 8, local_size_y = 8) in;
#include "render/picture/device_data.h"
#include "shared/spread.h"
layout(set = 0, binding = 0) readonly buffer Surface { uvec2 surface[]; };
layout(set = 0, binding = 1) readonly buffer Around { pell_picture_around around[]; };
layout(set = 0, binding = 2) readonly buffer Frame { pell_picture_frame fr; };
layout(set = 0, binding = 3) readonly buffer From { vec4 from[]; };
layout(set = 0, binding = 4) writeonly buffer To { vec4 to[]; };
layout(push_constant) uniform Push { pell_spread_push pc; };

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy) + ivec2(pc.x0, pc.y0), along = pc.down != 0u ? ivec2(0, 1) : ivec2(1, 0);
    const int at = p.y * fr.pitch + p.x;
    vec3 sum = vec3(0.0);
    float all = 0.0;

    if (p.x >= pc.x1 || p.y >= pc.y1)
        return;
    const uint key = surface[at].x;
    const float depth = around[at].normal.w, mm = depth * fr.depth_mm + fr.fixed_mm;
    for (int k = -pc.taps; k <= pc.taps && key != 0u; k++) {
        const ivec2 tap = p + k * pc.spacing * along;
        const int tap_at = tap.y * fr.pitch + tap.x;
        if (any(lessThan(tap, ivec2(pc.x0, pc.y0))) || any(greaterThanEqual(tap, ivec2(pc.x1, pc.y1))) || surface[tap_at].x != key)
            continue;
        const float w = pell_spread_weight(float(k * pc.spacing) * mm, around[tap_at].normal.w - depth, pc.inverse);
        sum += w * from[tap_at].rgb;
        all += w;
    }
    to[at] = vec4(all > 0.0 ? sum / all : vec3(0.0), 0.0);
}
