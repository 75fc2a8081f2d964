// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// load.comp - converts the frame's pixels to the format of the blurs: Jimenez and Gutierrez, GPU Pro, 2010, ch. 7; mirror of load.c.
//   in  0 light          light to be blurred (W/m^2 or W/(m^2 sr)), depth (mm)
//   in  1 frame_surface  material (0: not translucent), strength (bits of a float)
//   in  2 table          see blur.comp; the last row: totals of the profiles
//   out 3 surface        depth (mm), material
//   out 4 scale          px^2 per mm^2 of the variances
//   out 5 now            light times the total, material
//   out 6 sum            light times the total, 0
layout(local_size_x = 16, local_size_y = 8) in;
layout(set = 0, binding = 0) readonly buffer Light { vec4 light[]; };
layout(set = 0, binding = 1) readonly buffer FrameSurface { uvec2 frame_surface[]; };
layout(set = 0, binding = 2) readonly buffer Table { vec4 table[]; };
layout(set = 0, binding = 3) writeonly buffer Surface { vec2 surface[]; };
layout(set = 0, binding = 4) writeonly buffer Scale { float scale[]; };
layout(set = 0, binding = 5) writeonly buffer Now { vec4 now[]; };
layout(set = 0, binding = 6) writeonly buffer Sum { vec4 sum[]; };
#include "methods/screen_space/common.glsl"

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    const int i = pixel_at(p);

    if (!is_inside(p))
        return;
    // Outside of the image or of the valid materials it is 0.
    const int material = pc.x0 + p.x < pc.image_width && frame_surface[i].x < uint(pc.row) ? int(frame_surface[i].x) : 0;
    if (material == 0) {
        surface[i] = vec2(0.0);
        scale[i] = 0.0;
        now[i] = vec4(0.0);
        sum[i] = vec4(0.0);
        return;
    }
    const float depth = light[i].w, strength = pc.strength != 0 ? uintBitsToFloat(frame_surface[i].y) : 1.0;
    const bool good = depth > 0.0 && depth < 1e12;
    const float d = good ? depth : 0.0, mm = d * pc.depth_mm + pc.fixed_mm, s = min(strength, 1.0);
    const vec3 entered = light[i].rgb * table[pc.total * pc.row + material].rgb;
    surface[i] = vec2(d, float(material));
    scale[i] = good && strength > 0.0 ? min(s * s * pc.ratio2 / (mm * mm), 1e30) : 0.0;
    now[i] = vec4(entered, float(material));
    sum[i] = vec4(entered, 0.0);
}
