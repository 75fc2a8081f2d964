// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// plan.comp - which blocks a step blurs, by how many taps and how far apart: one invocation a block (x) and axis (y); mirror of `choose` in
// blocks.h and `space` in kernels.c.
//   in  0 geometry depth (mm), |Tx|, |D| (mm), material
//   in  1 rate     px^2 per mm^2 of the variances: facing, along Tx, along D; 0
//   in  2 table    share of a step's result in the sum (R, G, B), mm^2 applied after the step; by step and material
//   in  3 lines    lean (px per px), pixels of smooth blocks along the row, down the column, 0
//   out 4 plans    taps a side, pixels between them, lean of the taps (bits of a float), 0; axis 1 after axis 0
#define USES_TABLE
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Geometry { vec4 geometry[]; };
layout(set = 0, binding = 1) readonly buffer Rate { vec4 rate[]; };
layout(set = 0, binding = 2) readonly buffer Table { vec4 table[]; };
layout(set = 0, binding = 3) readonly buffer Lines { vec4 lines[]; };
layout(set = 0, binding = 4) writeonly buffer Plans { ivec4 plans[]; };
#include "methods/screen_space/common.glsl"

// Whether a line of taps stays in smooth blocks. Those of a leaning line are within the columns that it runs through.
bool is_clear(int cell, int block, int blocks, int axis, float skew, float reach)
{
    if (!(reach < (axis == 0 ? lines[cell].y : lines[cell].z)))
        return false;
    if (axis == 0 || skew == 0.0)
        return true;
    const int beside = int(abs(skew) * reach / float(BLOCK)) + 1;
    if (block - beside < 0 || block + beside >= blocks)
        return false;
    for (int k = -beside; k <= beside; k++)
        if (!(reach < lines[cell + k].z))
            return false;
    return true;
}

void main()
{
    const int cell = int(gl_GlobalInvocationID.x), axis = int(gl_GlobalInvocationID.y);
    const int blocks = pc.width / BLOCK, cells = blocks * pc.height;
    float most = 0.0, least = 1e30;

    if (cell >= cells)
        return;
    for (int i = cell * BLOCK; i < (cell + 1) * BLOCK; i++) {
        const int material = int(geometry[i].w);
        const float to_px = axis == 0 ? rate[i].y : rate[i].z;
        float before;
        if (!applied(material, rate[i].x, before) || !(to_px > 0.0))
            continue;
        const float low = before * to_px, add = (variance_of(pc.step, material) - before) * to_px;
        most = max(most, add);
        least = min(least, min(low, add));
    }
    most += 0.1; // what the grid adds at most
    const float reach = K_REACH * sqrt(max(most, S2_MIN));
    // Under half a pixel to the side all taps are upright.
    const float skew = axis == 0 || abs(lines[cell].x) * reach < 0.5 ? 0.0 : lines[cell].x;
    // Taps may stand 1.5 standard deviations apart of what is blurred already: aliasing is under 2e-4 of a step, then.
    const float dense = is_clear(cell, cell % blocks, blocks, axis, skew, reach) ? reach
                        : reach > STRIDE_DENSE * TAPS_DENSE                      ? reach / TAPS_DENSE
                                                                                 : STRIDE_DENSE;
    const float pace = min(1.5 * sqrt(least), dense);
    const int stride = pace >= 2.0 ? int(min(pace, 65536.0)) : 1;
    plans[axis * cells + cell] = ivec4(int(min(reach, 262144.0) / float(stride)), stride, floatBitsToInt(skew), 0);
}
