// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// seven_taps.comp - one of the two passes of a blur as published: d'Eon, Luebke and Enderton, EGSR 2007, section 4: seven taps one standard
// deviation apart, spaced by the stretch, which is blurred as well; mirror of kernels.c. AXIS 0: along x; 1: along y, and added to the sum.
//   in     0 lines    chart (0: none), mm
//   in     1 from     light, W/m^2; alpha of the thickness
//   in     2 stretch  texels per mm along x and y
//   out    3 to       light and alpha, blurred
//   out    4 blurred_stretch  the stretch, blurred
//   in/out 5 sum      AXIS 1: radiant exitance, W/m^2; chart
layout(local_size_x = 16, local_size_y = 8) in;
layout(constant_id = 0) const int AXIS = 0;
layout(set = 0, binding = 0) readonly buffer Lines { vec2 lines[]; };
layout(set = 0, binding = 1) readonly buffer From { vec4 from[]; };
layout(set = 0, binding = 2) readonly buffer Stretch { vec2 stretch[]; };
layout(set = 0, binding = 3) writeonly buffer To { vec4 to[]; };
layout(set = 0, binding = 4) writeonly buffer BlurredStretch { vec2 blurred_stretch[]; };
layout(set = 0, binding = 5) buffer Sum { vec4 sum[]; };
#include "methods/texture_space/common.glsl"

void main()
{
    const float weights[4] = float[](1.0, 0.60653066, 0.13533528, 0.011108997);
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);

    if (!is_inside(p))
        return;
    const int i = texel_at(p);
    const float key = lines[i].x;
    if (!(key > 0.0))
        return;
    const float span = sqrt(pc.after - pc.before) * (1.0 / SEVEN_SPAN);
    const float spacing = min(span * (AXIS == 0 ? stretch[i].x : stretch[i].y), 1e4);
    vec4 light = vec4(0.0);
    vec2 density = vec2(0.0);
    float total = 0.0;
    for (int j = -3; j <= 3; j++) {
        const float offset = float(j) * spacing, base = floor(offset), fraction = offset - base;
        for (int k = 0; k < 2; k++) {
            const int step = int(base) + k;
            const float tap = weights[abs(j)] * (k == 1 ? fraction : 1.0 - fraction);
            const ivec2 q = p + (AXIS == 0 ? ivec2(step, 0) : ivec2(0, step));
            if (!is_inside(q) || !(tap > 0.0) || lines[texel_at(q)].x != key)
                continue;
            total += tap;
            light += tap * from[texel_at(q)];
            density += tap * stretch[texel_at(q)];
        }
    }
    light /= total; // the centre tap always contributes
    to[i] = light;
    blurred_stretch[i] = density / total;
    if (AXIS == 1 && pc.add != 0)
        sum[i].rgb += weight() * light.rgb;
}
