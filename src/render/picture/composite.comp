// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// composite.comp - adds a sample to the image: the method's radiant exitance, transmitted light and specular reflection. Mirror of
// shade_block in composite/kernel.c.
//   in  0 light    entering irradiance
//   in  1 exitance the method's result: radiant exitance
//   in  2 shown   3 highlights   4 through   5 single   6 materials   7 frame   8 around
//   i/o 9 sum     radiance, and coverage; with depth of field, instead:
//   out 10 lens   planes: radiance, coverage, inverse depth
layout(local_size_x = 8, local_size_y = 8) in;
#include "render/picture/device_data.h"
layout(set = 0, binding = 0) readonly buffer Light { vec4 light[]; };
layout(set = 0, binding = 1) readonly buffer Exitance { vec4 exitance[]; };
layout(set = 0, binding = 2) readonly buffer Shown { pell_picture_shown shown[]; };
layout(set = 0, binding = 3) readonly buffer Highlights { vec4 highlights[]; };
layout(set = 0, binding = 4) readonly buffer Through { vec4 through[]; };
layout(set = 0, binding = 5) readonly buffer Single { vec4 single[]; };
layout(set = 0, binding = 6) readonly buffer Materials { pell_picture_material surface_materials[]; };
layout(set = 0, binding = 7) readonly buffer Frame { pell_picture_frame fr; };
layout(set = 0, binding = 8) readonly buffer Around { pell_picture_around around[]; };
layout(set = 0, binding = 9) buffer Sum { vec4 sum[]; };
layout(set = 0, binding = 10) writeonly buffer Lens { float lens[]; };
layout(push_constant) uniform Push { pell_composite_push pc; };

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy) + ivec2(fr.x0, fr.y0);
    const int at = p.y * fr.pitch + p.x;
    vec4 color = vec4(0.0);

    if (p.x >= fr.x1 || p.y >= fr.y1)
        return;
    const uint material = floatBitsToUint(shown[at].factor.w);
    if (material != 0u) {
        const pell_picture_material m = surface_materials[material - 1u];
        const bool scatters = (fr.flags & PELL_PICTURE_SCATTERS) != 0u && (m.flags & PELL_PICTURE_OPAQUE) == 0u;
        const vec3 factor = shown[at].factor.rgb;
        const vec3 through_light = scatters || m.sheet.w > 0.0 ? through[at].rgb : vec3(0.0);
        color.rgb = factor * ((scatters ? exitance[at].rgb : m.total.rgb * light[at].rgb) + through_light);
        color.rgb += (fr.flags & PELL_PICTURE_SHARED) != 0u ? highlights[at].rgb : shown[at].specular.rgb;
        if (scatters && (fr.flags & PELL_PICTURE_SINGLE) != 0u)
            color.rgb += single[at].rgb;
        color.a = 1.0;
    }
    if ((fr.flags & PELL_PICTURE_LENS) != 0u) {
        const uint pixel = uint(p.y - pc.y0) * pc.stride + uint(p.x);
        for (uint c = 0u; c < 4u; c++)
            lens[c * pc.plane + pixel] = fr.weight * color[c];
        lens[4u * pc.plane + pixel] = material != 0u ? 1.0 / around[at].normal.w : 0.0;
        return;
    }
    sum[at] = ((fr.flags & PELL_PICTURE_FIRST) != 0u ? vec4(0.0) : sum[at]) + fr.weight * color;
}
