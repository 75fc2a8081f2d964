// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// add.comp - a level of the chain without a blur: adds its weighted light to the radiant exitance.
//   in     0 now   light, W/m^2; alpha
//   in/out 1 sum   radiant exitance, W/m^2; chart
layout(local_size_x = 16, local_size_y = 8) in;
layout(set = 0, binding = 0) readonly buffer Now { vec4 now[]; };
layout(set = 0, binding = 1) buffer Sum { vec4 sum[]; };
#include "methods/texture_space/common.glsl"

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);

    if (!is_inside(p))
        return;
    const int i = texel_at(p);
    if (sum[i].w > 0.0)
        sum[i].rgb += weight() * now[i].rgb;
}
