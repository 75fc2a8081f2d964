// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// size.comp - lengths on the surface along the two passes: Tx, and D = Ty - lean Tx; mirror of the second half of measure.c.
//   in     0 place    depth (mm), material, px^2 per mm^2, 0
//   in     1 lines    lean of the second pass, ...
//   in/out 2 rate     in: Tx.Tx, Ty.Ty, Tx.Ty (mm^2), whether it is rough; out: px^2 per mm^2 of the variances facing, along Tx, along D; 0
//   out    3 geometry depth (mm), |Tx|, |D| (mm), material
layout(local_size_x = 16, local_size_y = 8) in;
layout(set = 0, binding = 0) readonly buffer Place { vec4 place[]; };
layout(set = 0, binding = 1) readonly buffer Lines { vec4 lines[]; };
layout(set = 0, binding = 2) buffer Rate { vec4 rate[]; };
layout(set = 0, binding = 3) writeonly buffer Geometry { vec4 geometry[]; };
#include "methods/screen_space/common.glsl"

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    const int i = pixel_at(p);

    if (!is_inside(p))
        return;
    const vec4 own = place[i], slopes = rate[i];
    const float lean = lines[i / BLOCK].x, mm = own.x * pc.depth_mm + pc.fixed_mm, facing = own.z * mm * mm;
    const vec2 size2 = vec2(slopes.x, slopes.y + lean * (lean * slopes.x - 2.0 * slopes.z));
    const vec2 to_px = vec2(size2.x > 0.0 ? facing / size2.x : 0.0, size2.y > 0.0 ? facing / size2.y : 0.0);

    geometry[i] = vec4(own.x, sqrt(max(size2, vec2(0.0))), own.y);
    rate[i] = vec4(own.z, to_px, 0.0);
}
