// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// plan.comp - lengths on the surface along the two passes, Tx and D = Ty - skew Tx (mirror of the second half of measure.c); and, for each
// of SCREEN_PLANNED steps, the blocks that it blurs, with the number and spacing of their taps (`choose` in blocks.h, `space` in
// kernels.c). A row of a workgroup is a block: its invocations are first pixels, then steps and axes. FORM 0: Gaussians, 1: seven taps,
// which need no plan, 2: a separable kernel.
//   in  0 surface  depth (mm), material
//   in  1 scale    px^2 per mm^2 of the variances
//   in  2 slopes   Tx.Tx, Ty.Ty, Tx.Ty (mm^2), 0
//   in  3 lines    skew (px per px), pixels in smooth blocks along the row, down the column, 0
//   in  4 table    weight of a step's result in the sum (R, G, B), mm^2 applied after the step; by step, material; the last row's fourth:
//                  extent of the separable kernel, mm
//   out 5 across   depth (mm), |Tx|
//   out 6 down     depth (mm), |D|
//   out 7 plans    per block, axis and step: taps per side and 65536 times the pixels between them, skew of the taps (bits of a float),
//                  mm^2 before the step and after it (bits of floats): -1 if its pixels differ, and 0 if the step blurs none. FORM 2:
//                  reach of the taps, px; skew; 0; 0
#define USES_TABLE
layout(local_size_x = 16, local_size_y = 8) in;
layout(constant_id = 0) const int FORM = 0;
layout(set = 0, binding = 0) readonly buffer Surface { vec2 surface[]; };
layout(set = 0, binding = 1) readonly buffer Scale { float scale[]; };
layout(set = 0, binding = 2) readonly buffer Slopes { vec4 slopes[]; };
layout(set = 0, binding = 3) readonly buffer Lines { vec4 lines[]; };
layout(set = 0, binding = 4) readonly buffer Table { vec4 table[]; };
layout(set = 0, binding = 5) writeonly buffer Across { vec2 across[]; };
layout(set = 0, binding = 6) writeonly buffer Down { vec2 down[]; };
layout(set = 0, binding = 7) writeonly buffer Plans { ivec4 plans[]; };
#include "methods/screen_space/common.glsl"

// A pixel: scale, px^2 per mm^2 along Tx and along D, material.
shared vec4 pixels[8][16];

// Whether a line of taps stays in smooth blocks. A skewed line must stay within the columns that it crosses.
bool is_clear(int cell, int block, int blocks, int axis, float skew, float reach)
{
    if (!(reach < (axis == 0 ? lines[cell].y : lines[cell].z)))
        return false;
    if (axis == 0 || skew == 0.0)
        return true;
    const int margin = int(abs(skew) * reach / float(BLOCK)) + 1;
    if (block - margin < 0 || block + margin >= blocks)
        return false;
    for (int k = -margin; k <= margin; k++)
        if (!(reach < lines[cell + k].z))
            return false;
    return true;
}

// Variances of the block's pixels before and after a step, mm^2: after is 0 if the step blurs none, -1 if they differ.
vec2 in_common(uint y, int step)
{
    float low = 1e30, high = 0.0, material = 0.0, before, before_high;
    bool one = true;

    for (int l = 0; l < BLOCK; l++) {
        const vec4 pixel = pixels[y][l];
        if (!(pixel.w > 0.0))
            continue;
        one = one && (material == 0.0 || material == pixel.w);
        material = pixel.w;
        low = min(low, pixel.x);
        high = max(high, pixel.x);
    }
    if (material == 0.0)
        return vec2(0.0);
    // Each decision is monotonic in the scale: if the extremes agree in all of them, so do the pixels in between.
    const bool on = applied(step, int(material), low, before), on_high = applied(step, int(material), high, before_high);
    if (!one || on != on_high || before != before_high)
        return vec2(0.0, -1.0);
    return vec2(before, on ? variance_of(step, int(material)) : 0.0);
}

// In px^2: the largest variance that the step adds, and the smallest before it or added.
vec2 range_of(uint y, int axis, int step, vec2 common_of)
{
    vec2 range = vec2(0.0, 1e30);

    for (int l = 0; l < BLOCK; l++) {
        const vec4 pixel = pixels[y][l];
        const float to_px = axis == 0 ? pixel.y : pixel.z;
        vec2 mm2 = common_of;
        if (!(pixel.w > 0.0) || !(to_px > 0.0))
            continue;
        if (mm2.y < 0.0)
            mm2.y = applied(step, int(pixel.w), pixel.x, mm2.x) ? variance_of(step, int(pixel.w)) : 0.0;
        if (!(mm2.y > 0.0))
            continue;
        const float low = mm2.x * to_px, add = (mm2.y - mm2.x) * to_px;
        range = vec2(max(range.x, add), min(range.y, min(low, add)));
    }
    return range;
}

ivec4 plan_of(int cell, int block, int blocks, uint y, int axis, int step)
{
    const vec2 common_of = in_common(y, step);
    if (common_of.y == 0.0)
        return ivec4(0);
    const vec2 range = range_of(y, axis, step, common_of);
    const float reach = K_REACH * sqrt(max(range.x + 0.1, S2_MIN)); // 0.1: upper bound of the grid's contribution
    // With less than half a pixel to the side, taps follow the column.
    const float skew = axis == 0 || abs(lines[cell].x) * reach < 0.5 ? 0.0 : lines[cell].x;
    // Taps may be 1.5 standard deviations of the previous blurs apart: aliasing is then below 2e-4 of a step.
    const float dense = is_clear(cell, block, blocks, axis, skew, reach) ? reach : reach * (1.0 / TAPS_DENSE);
    const float spacing = min(1.5 * sqrt(range.y), dense);
    const int stride = spacing >= 2.0 ? int(min(spacing, 32767.0)) : 1;
    return ivec4(int(min(reach / float(stride), 65535.0)) | stride << 16, floatBitsToInt(vec3(skew, common_of)));
}

ivec4 separable_of(int cell, uint y, int axis)
{
    float most = 0.0, extent = 0.0;

    for (int l = 0; l < BLOCK; l++) {
        const vec4 pixel = pixels[y][l];
        if (!(pixel.w > 0.0))
            continue;
        most = max(most, axis == 0 ? pixel.y : pixel.z);
        extent = max(extent, table[pc.total * pc.row + int(pixel.w)].w);
    }
    return ivec4(floatBitsToInt(vec2(min(extent * sqrt(most), 65536.0), axis == 0 ? 0.0 : lines[cell].x)), 0, 0);
}

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    const uint x = gl_LocalInvocationID.x, y = gl_LocalInvocationID.y;
    const int i = pixel_at(p), blocks = pc.width / BLOCK, cell = i / BLOCK;
    const bool here = is_inside(p);

    if (here) {
        const vec4 s = slopes[i];
        const vec2 own = surface[i];
        const float skew = lines[cell].x, mm = own.x * pc.depth_mm + pc.fixed_mm, facing = scale[i] * mm * mm;
        const vec2 size2 = vec2(s.x, s.y + skew * (skew * s.x - 2.0 * s.z));
        const vec2 size = sqrt(max(size2, vec2(0.0)));
        across[i] = vec2(own.x, size.x);
        down[i] = vec2(own.x, size.y);
        pixels[y][x] =
            vec4(scale[i], size2.x > 0.0 ? facing / size2.x : 0.0, size2.y > 0.0 ? facing / size2.y : 0.0, own.y);
    }
    barrier();
    const int axis = int(x & 1u), slot = int(x >> 1);
    if (!here || FORM == 1 || pc.planned + slot >= pc.end || (FORM == 2 && slot > 0))
        return;
    plans[(slot * 2 + axis) * (blocks * pc.height) + cell] =
        FORM == 2 ? separable_of(cell, y, axis) : plan_of(cell, p.x / BLOCK, blocks, y, axis, pc.planned + slot);
}
