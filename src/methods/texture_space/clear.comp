// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// clear.comp - initialises the sums of a map before its first light.
//   in  0 lines    chart (0: none), mm from texel to texel along x
//   out 1 sum      radiant exitance, W/m^2: 0; the chart
//   out 2 transmitted   transmitted light before softening, W/m^2: 0; 0
layout(local_size_x = 16, local_size_y = 8) in;
layout(set = 0, binding = 0) readonly buffer Lines { vec2 lines[]; };
layout(set = 0, binding = 1) writeonly buffer Sum { vec4 sum[]; };
layout(set = 0, binding = 2) writeonly buffer Transmitted { vec4 transmitted[]; };
#include "methods/texture_space/common.glsl"

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);

    if (p.x >= pc.stride || p.y >= pc.height)
        return;
    const int i = texel_at(p);
    sum[i] = vec4(0.0, 0.0, 0.0, lines[i].x);
    transmitted[i] = vec4(0.0);
}
