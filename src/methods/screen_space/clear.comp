// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// clear.comp - how far along each axis every block is smooth: blurs that meet no edge may skip more samples. One invocation a row, then one
// a column of blocks; mirror of find_clear in cpu.c.
//   in     0 cells    mean lean, what is in the block: see cells.comp
//   in/out 1 lines    adds in y and z: pixels before and behind the block, along the row and down the column, that are of smooth blocks
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Cells { vec2 cells[]; };
layout(set = 0, binding = 1) buffer Lines { vec4 lines[]; };
#include "methods/screen_space/common.glsl"

void main()
{
    const int i = int(gl_GlobalInvocationID.x), blocks = pc.width / BLOCK;
    const bool down = i >= pc.height;
    const int count = down ? pc.height : blocks, first = down ? i - pc.height : i * blocks, pace = down ? blocks : 1;
    float run = 0.0;

    if (i >= pc.height + blocks)
        return;
    for (int k = 0; k < count; k++) {
        const int at = first + k * pace;
        const bool clear = cells[at].y == 2.0;
        if (down)
            lines[at].z = clear ? run : 0.0;
        else
            lines[at].y = clear ? run : 0.0;
        run = clear ? run + (down ? 1.0 : float(BLOCK)) : 0.0;
    }
    run = 0.0;
    for (int k = count - 1; k >= 0; k--) {
        const int at = first + k * pace;
        const bool clear = cells[at].y == 2.0;
        if (down)
            lines[at].z = min(lines[at].z, run);
        else
            lines[at].y = min(lines[at].y, run);
        run = clear ? run + (down ? 1.0 : float(BLOCK)) : 0.0;
    }
}
