// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// spread_split.comp - splits straight transmission between Gaussians: adds the fraction of one Gaussian to its input plane; at the end
// (level 0) adds up the blurred light and the light that is not blurred. Mirror of add_row and finish_row in spread/cpu.c.
//   in  0 surface   1 shown   2 materials   3 thickness   4 frame
//   i/o 5 through   6 sum
layout(local_size_x = 8, local_size_y = 8) in;
#include "render/picture/device_data.h"
#include "shared/spread.h"
layout(set = 0, binding = 0) readonly buffer Surface { uvec2 surface[]; };
layout(set = 0, binding = 1) readonly buffer Shown { pell_picture_shown shown[]; };
layout(set = 0, binding = 2) readonly buffer Lit { pell_lit_material materials[]; };
layout(set = 0, binding = 3) readonly buffer Thickness { float thickness[]; };
layout(set = 0, binding = 4) readonly buffer Frame { pell_picture_frame fr; };
layout(set = 0, binding = 5) buffer Through { vec4 through[]; };
layout(set = 0, binding = 6) buffer Sum { vec4 sum[]; };
layout(push_constant) uniform Push { pell_spread_push pc; };
#include "render/picture/spread.glsl"

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy) + ivec2(pc.x0, pc.y0);
    const int at = p.y * fr.pitch + p.x;
    vec3 variance, fraction = vec3(0.0);

    if (p.x >= pc.x1 || p.y >= pc.y1)
        return;
    const bool straight = spread_variance(at, variance);
    const float straight_fraction = pell_spread_straight(through[at].w);
    for (int c = 0; c < 3; c++)
        fraction[c] = pell_spread_gaussian_fraction(variance[c], pc.below, pc.here, pc.above);
    if (pc.level > 0)
        sum[at] = vec4((pc.first != 0u ? vec3(0.0) : sum[at].rgb) +
                           (straight ? straight_fraction * through[at].rgb * fraction : vec3(0.0)), 0.0);
    else if (surface[at].x != 0u)
        through[at].rgb = through[at].rgb * (straight ? 1.0 - straight_fraction + straight_fraction * fraction : vec3(1.0)) + sum[at].rgb;
}
