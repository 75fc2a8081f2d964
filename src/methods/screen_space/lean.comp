// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// lean.comp - lets leans be where they hardly change along the row: one invocation a block; mirror of fade_leans in measure.c.
//   in  0 cells    mean lean, what is in the block: see cells.comp
//   out 1 lines    lean of the second pass (px per px); 0, 0, 0
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Cells { vec2 cells[]; };
layout(set = 0, binding = 1) writeonly buffer Lines { vec4 lines[]; };
#include "methods/screen_space/common.glsl"

void main()
{
    const int cell = int(gl_GlobalInvocationID.x), blocks = pc.width / BLOCK, block = cell % blocks;
    float worst = 0.0;

    if (cell >= blocks * pc.height)
        return;
    for (int k = 1 - LEAN_FADE; k < LEAN_FADE; k++) {
        const float near = 1.0 - float(k < 0 ? -k - 1 : k) / float(LEAN_FADE);
        if (block + k < 0 || block + k + 1 >= blocks)
            continue;
        const vec2 a = cells[cell + k], b = cells[cell + k + 1];
        if (a.y > 0.0 && b.y > 0.0)
            worst = max(worst, min(abs(b.x - a.x) / LEAN_CHANGE, 1.0) * near);
    }
    const float lean = cells[cell].x * (1.0 - worst);
    lines[cell] = vec4(abs(lean) < LEAN_MIN ? 0.0 : lean, 0.0, 0.0, 0.0);
}
