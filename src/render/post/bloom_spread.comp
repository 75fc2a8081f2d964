// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// bloom_spread.comp - weighted sums along rows or columns: downsampling to a coarse grid, and the Gaussians on it. Mirror of `shrink`,
// `blur_rows` and `blur_columns` in bloom.c.
//   in  0 image  R, G, B and alpha
//   io  1 scratch  planes
//   in  2 table    weights
layout(local_size_x = 16, local_size_y = 4) in;
#include "render/post/device_data.h"
#include "shared/bloom.h"
layout(set = 0, binding = 0) readonly buffer Image { float image[]; };
layout(set = 0, binding = 1) buffer Scratch { float scratch[]; };
layout(set = 0, binding = 2) readonly buffer Table { float table[]; };
layout(push_constant) uniform Push { pell_bloom_push pc; };

void main()
{
    const uint x = gl_GlobalInvocationID.x, y = gl_GlobalInvocationID.y;
    float sum = 0.0;

    if (x >= pc.width || y >= pc.height)
        return;
    const int start = int(pc.down != 0u ? y : x) * pc.factor;
    const uint line = pc.from + (pc.down != 0u ? x : y * pc.stride), step = pc.down != 0u ? pc.stride : 1u;
    const bool inside = start + pc.first >= 0 && start + pc.last <= pc.size; // true for most; the modulo costs more than the rest
    for (int k = pc.first; k < pc.last; k++) {
        const uint at = line + uint(inside ? start + k : pell_mirror(start + k, pc.size)) * step;
        sum += table[pc.weights + uint(k - pc.first)] * (pc.of_color != 0u ? image[at] : scratch[at]);
    }
    scratch[pc.to + y * pc.stride + x] = sum;
}
