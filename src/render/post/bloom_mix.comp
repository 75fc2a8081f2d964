// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// bloom_mix.comp - adds the weighted Gaussians to a channel of the image, in place. Mirror of `mix` and `add` in bloom.c.
//   io  0 image  R, G, B and alpha
//   in  1 scratch  the Gaussians at their smaller sizes
layout(local_size_x = 16, local_size_y = 4) in;
#include "render/post/device_data.h"
#include "shared/bloom.h"
layout(set = 0, binding = 0) buffer Image { float image[]; };
layout(set = 0, binding = 1) readonly buffer Scratch { float scratch[]; };
layout(push_constant) uniform Push { pell_mix_push pc; };

// Interpolates the points of the coarse grid at a pixel.
float value_at(uint low, int f, int width, int height, int x, int y)
{
    if (f == 1)
        return scratch[low + uint(y) * pc.stride + uint(x)];
    const int row = pell_grid_cell(y, f), column = pell_grid_cell(x, f);
    const float wy = pell_grid_fraction(y, f, row), wx = pell_grid_fraction(x, f, column);
    const uint up = low + uint(pell_mirror(row, height)) * pc.stride, down = low + uint(pell_mirror(row + 1, height)) * pc.stride;
    const uint j = uint(pell_mirror(column, width)), next = uint(pell_mirror(column + 1, width));
    const float left = scratch[up + j] + wy * (scratch[down + j] - scratch[up + j]);
    const float right = scratch[up + next] + wy * (scratch[down + next] - scratch[up + next]);
    return left + wx * (right - left);
}

void main()
{
    const int x = int(gl_GlobalInvocationID.x), y = int(gl_GlobalInvocationID.y);

    if (x >= int(pc.width) || y >= int(pc.height))
        return;
    const uint at = pc.from + uint(y) * pc.stride + uint(x);
    float sum = pc.rest * image[at];
    sum += pc.weight * value_at(pc.low0, pc.factor0, pc.width0, pc.height0, x, y);
    sum += pc.weight * value_at(pc.low1, pc.factor1, pc.width1, pc.height1, x, y);
    image[at] = sum;
}
