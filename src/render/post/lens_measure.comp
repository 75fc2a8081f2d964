// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// lens_measure.comp - disc of each pixel, and the widest disc of each tile; one workgroup per tile. Mirror of `measure` in dof.c.
//   in  0 planes  the sample's R, G, B, alpha and inverse depth, 1/mm, 0 where nothing is seen
//   in  1 table   weight by radius
//   out 2 discs   radius, negative in front of the focus; weight of a fully covered pixel
//   io  3 tiles   widest disc of all samples so far, then of this sample
layout(local_size_x = 16, local_size_y = 4) in;
#include "render/post/device_data.h"
#include "shared/lens.h"
layout(set = 0, binding = 0) readonly buffer Planes { float planes[]; };
layout(set = 0, binding = 1) readonly buffer Table { float table[]; };
layout(set = 0, binding = 2) writeonly buffer Discs { vec2 discs[]; };
layout(set = 0, binding = 3) buffer Tiles { float tiles[]; };
layout(push_constant) uniform Push { pell_lens_push pc; };

shared float widest_of[64];

float weight_of(float r)
{
    const float at = r * float(PELL_LENS_STEPS), cell = floor(at);
    return table[int(cell)] + (at - cell) * (table[int(cell) + 1] - table[int(cell)]);
}

void main()
{
    const uint x = gl_GlobalInvocationID.x, tile = gl_WorkGroupID.y * pc.columns + gl_WorkGroupID.x;
    float widest = 0.0;

    for (uint i = 0u; i < uint(PELL_LENS_MOST); i += 4u) {
        const uint y = gl_WorkGroupID.y * uint(PELL_LENS_MOST) + gl_LocalInvocationID.y + i, at = y * pc.stride + x;
        if (x >= pc.width || y >= pc.height)
            continue;
        const bool inside = int(x) >= pc.x0 && int(x) < pc.x1 && int(y) >= pc.y0 && int(y) < pc.y1; // inside the rectangle of the composite
        const float inverse_depth = inside ? planes[4u * pc.plane + at] : 0.0;
        const float unclamped = pell_disc_radius(pc.scale, pc.inverse_focus, inverse_depth);
        const float d = clamp(unclamped, -float(PELL_LENS_MOST), float(PELL_LENS_MOST));
        discs[at] = vec2(d, weight_of(abs(d)));
        widest = inverse_depth > 0.0 ? max(widest, abs(unclamped)) : widest; // an empty pixel contributes nothing to others
    }
    widest_of[gl_LocalInvocationIndex] = widest;
    barrier();
    if (gl_LocalInvocationIndex != 0u)
        return;
    for (uint i = 1u; i < 64u; i++)
        widest = max(widest, widest_of[i]);
    tiles[tile] = pc.first != 0u ? widest : max(widest, tiles[tile]);
    tiles[pc.columns * pc.rows + tile] = widest;
}
