// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// cells.comp - what is known of a block of 16 pixels of a row: one invocation a block; mirror of measure.c.
//   in  0 place    depth (mm), material, px^2 per mm^2, 0
//   in  1 slopes   Tx.Tx, Ty.Ty, Tx.Ty (mm^2), whether it is rough
//   out 2 cells    mean lean of the second pass (pixels that x falls as y grows by one); 0 nothing is translucent, 1 something, 2 all is
//                  of one material and smooth
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Place { vec4 place[]; };
layout(set = 0, binding = 1) readonly buffer Slopes { vec4 slopes[]; };
layout(set = 0, binding = 2) writeonly buffer Cells { vec2 cells[]; };
#include "methods/screen_space/common.glsl"

void main()
{
    const int cell = int(gl_GlobalInvocationID.x), first = cell * BLOCK;
    int full = 0, blurred = 0;
    bool even = true;
    float lean = 0.0;

    if (first >= pc.width * pc.height)
        return;
    const float owner = place[first].y;
    for (int i = first; i < first + BLOCK; i++) {
        const vec4 s = slopes[i];
        full += place[i].y > 0.0 ? 1 : 0;
        blurred += place[i].z > 0.0 ? 1 : 0;
        even = even && place[i].y == owner && s.w == 0.0;
        lean += s.x > 0.0 ? s.z / s.x : 0.0;
    }
    lean = blurred > 0 ? clamp(lean / float(blurred), -LEAN_MAX, LEAN_MAX) : 0.0;
    cells[cell] = vec2(lean, full == 0 ? 0.0 : full == BLOCK && even ? 2.0 : 1.0);
}
