// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// rows.comp - statistics of a row of the image, one workgroup per row: metered light, and the bounds of pixels that later passes
// process. Sums are those of 64 columns.
//   in  0 surface   1 shown   2 around   3 through   4 frame
//   in  5 materials as the stage "irradiance" sees them   6 thickness   7 materials as the stage "surface" does
//   i/o 8 rows
layout(local_size_x = 64) in;
#include "render/picture/device_data.h"
layout(set = 0, binding = 0) readonly buffer Surface { uvec2 surface[]; };
layout(set = 0, binding = 1) readonly buffer Shown { pell_picture_shown shown[]; };
layout(set = 0, binding = 2) readonly buffer Around { pell_picture_around around[]; };
layout(set = 0, binding = 3) readonly buffer Through { vec4 through[]; };
layout(set = 0, binding = 4) readonly buffer Frame { pell_picture_frame fr; };
layout(set = 0, binding = 5) readonly buffer Lit { pell_lit_material materials[]; };
layout(set = 0, binding = 6) readonly buffer Thickness { float thickness[]; };
layout(set = 0, binding = 7) readonly buffer Materials { pell_picture_material surface_materials[]; };
layout(set = 0, binding = 8) buffer Rows { pell_picture_row rows[]; };
layout(push_constant) uniform Push { pell_picture_push pc; };
#include "render/picture/spread.glsl"

const uint NONE = 0xffffffffu;
shared pell_picture_row partial[64];

pell_picture_row empty_row()
{
    return pell_picture_row(0.0, 0.0, 0u, 0u, NONE, 0u, 0u, 0u, 0.0, 0.0, 1e38, -1.0, NONE, 0u);
}

// Proportional to the width of a method's kernel in pixels.
float width_of(float depth, float strength)
{
    return strength / (depth * fr.depth_mm + fr.fixed_mm);
}

void add_pixel(int x, int at, inout pell_picture_row row)
{
    const float depth = around[at].normal.w, strength = min(uintBitsToFloat(surface[at].y), 1.0);
    vec3 variance;

    if (floatBitsToUint(shown[at].factor.w) == 0u)
        return;
    row.arriving += shown[at].specular.w;
    row.pixels++;
    row.rays += floatBitsToUint(around[at].hidden.w) & 65535u;
    row.through += floatBitsToUint(around[at].hidden.w) >> 16;
    if ((surface_materials[floatBitsToUint(shown[at].factor.w) - 1u].flags & PELL_PICTURE_OPAQUE) != 0u)
        return;
    row.translucent++;
    row.x0 = min(row.x0, uint(x));
    row.x1 = uint(x) + 1u;
    if (surface[at].x != 0u && (row.depth == 0.0 || width_of(depth, strength) > width_of(row.depth, row.strength))) {
        row.depth = depth;
        row.strength = strength;
    }
    if ((fr.flags & PELL_PICTURE_SPREADS) != 0u && spread_variance(at, variance)) {
        row.finest = min(row.finest, depth * fr.depth_mm + fr.fixed_mm);
        row.widest = max(row.widest, max(max(variance.r, variance.g), variance.b));
        row.straight0 = min(row.straight0, uint(x));
        row.straight1 = uint(x) + 1u;
    }
}

pell_picture_row joined(pell_picture_row a, pell_picture_row b)
{
    a.arriving += b.arriving;
    a.pixels += b.pixels;
    a.rays += b.rays;
    a.through += b.through;
    a.translucent += b.translucent;
    a.x0 = min(a.x0, b.x0);
    a.x1 = max(a.x1, b.x1);
    if (b.depth != 0.0 && (a.depth == 0.0 || width_of(b.depth, b.strength) > width_of(a.depth, a.strength))) {
        a.depth = b.depth;
        a.strength = b.strength;
    }
    a.finest = min(a.finest, b.finest);
    a.widest = max(a.widest, b.widest);
    a.straight0 = min(a.straight0, b.straight0);
    a.straight1 = max(a.straight1, b.straight1);
    return a;
}

void main()
{
    const uint y = uint(fr.y0) + gl_WorkGroupID.x, i = gl_LocalInvocationID.x;
    pell_picture_row row = empty_row();

    for (int x = fr.x0 + int(i); x < fr.x1; x += 64)
        add_pixel(x, int(y) * fr.pitch + x, row);
    partial[i] = row;
    for (uint half_of = 32u; half_of > 0u; half_of /= 2u) {
        barrier();
        if (i < half_of)
            partial[i] = joined(partial[i], partial[i + half_of]);
    }
    if (i != 0u)
        return;
    row = partial[0];
    row.covered = float(row.pixels);
    if ((fr.flags & PELL_PICTURE_FIRST) == 0u) {
        row.arriving += rows[y].arriving;
        row.covered += rows[y].covered;
    }
    rows[y] = row;
}
