// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// lines.comp - scans every row and every column of blocks, one workgroup each: keeps the skew of blocks where it hardly changes (fade_skews
// in measure.c), and finds the smooth range on both sides of every block (find_clear in cpu.c): blurs that reach no edge may have gaps
// between taps.
//   in  0 cells    mean skew, contents of the block: see measure.comp
//   out 1 lines    skew of the second pass (px per px); pixels in smooth blocks on either side of the block, the smaller number: along the
//                  row, down the column; 0
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Cells { vec2 cells[]; };
layout(set = 0, binding = 1) buffer Lines { vec4 lines[]; };
#include "methods/screen_space/common.glsl"

const int GROUP = 64;
shared int lasts[GROUP], firsts[GROUP]; // per invocation's part of the line: blocks that are not smooth

float skew_of(int cell, int block, int blocks)
{
    float worst = 0.0;

    for (int k = 1 - SKEW_FADE; k < SKEW_FADE; k++) {
        const float near = 1.0 - float(k < 0 ? -k - 1 : k) / float(SKEW_FADE);
        if (block + k < 0 || block + k + 1 >= blocks)
            continue;
        const vec2 a = cells[cell + k], b = cells[cell + k + 1];
        if (a.y > 0.0 && b.y > 0.0)
            worst = max(worst, min(abs(b.x - a.x) / SKEW_CHANGE, 1.0) * near);
    }
    const float skew = cells[cell].x * (1.0 - worst);
    return abs(skew) < SKEW_MIN ? 0.0 : skew;
}

void main()
{
    const int line = int(gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x), me = int(gl_LocalInvocationID.x);
    const int blocks = pc.width / BLOCK;
    const bool down = line >= pc.height, here = line < pc.height + blocks;
    const int count = !here ? 0 : down ? pc.height : blocks, first = down ? line - pc.height : line * blocks, stride = down ? blocks : 1;
    const int part = (count + GROUP - 1) / GROUP, begin = min(me * part, count), end = min(begin + part, count);
    int last = -1, next = count;

    for (int k = begin; k < end; k++)
        if (cells[first + k * stride].y != 2.0) {
            last = k;
            next = min(next, k);
        }
    lasts[me] = last;
    firsts[me] = next;
    barrier();
    last = -1;
    next = count;
    for (int k = 0; k < me; k++)
        last = max(last, lasts[k]);
    for (int k = me + 1; k < GROUP; k++)
        next = min(next, firsts[k]);
    // Before a block, then after it: the minimum of both.
    for (int k = begin; k < end; k++) {
        const int at = first + k * stride;
        last = cells[at].y != 2.0 ? k : last;
        if (down)
            lines[at].z = float(k - last - 1);
        else
            lines[at].xy = vec2(skew_of(at, k, blocks), float((k - last - 1) * BLOCK));
    }
    for (int k = end - 1; k >= begin; k--) {
        const int at = first + k * stride;
        const bool smooth_one = cells[at].y == 2.0;
        next = smooth_one ? next : k;
        if (down)
            lines[at].z = smooth_one ? min(lines[at].z, float(next - k - 1)) : 0.0;
        else
            lines[at].y = smooth_one ? min(lines[at].y, float((next - k - 1) * BLOCK)) : 0.0;
    }
}
