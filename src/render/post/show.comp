// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// show.comp - the tone curve. Mirror of `finish_block` in kernel.c for an image that is already composited over its background.
//   in  0 image  R, G, B and alpha; alpha is read where colours are divided by it
//   out 1 shown    R, G and B, [0, 1]
layout(local_size_x = 16, local_size_y = 4) in;
#include "render/post/device_data.h"
#include "shared/tone.h"
layout(set = 0, binding = 0) readonly buffer Image { float image[]; };
layout(set = 0, binding = 1) writeonly buffer Shown { float shown[]; };
layout(push_constant) uniform Push { pell_show_push pc; };

vec3 filmic(float exposure, vec3 color)
{
    const vec3 v = max(PELL_FILMIC_SCALE * exposure * color, 0.0);
    const vec3 before = min(vec3(PELL_FILMIC_TO_R(v.r, v.g, v.b), PELL_FILMIC_TO_G(v.r, v.g, v.b), PELL_FILMIC_TO_B(v.r, v.g, v.b)),
                            PELL_FILMIC_MOST);
    const vec3 x = PELL_FILMIC_CURVE(before);
    return vec3(PELL_FILMIC_FROM_R(x.r, x.g, x.b), PELL_FILMIC_FROM_G(x.r, x.g, x.b), PELL_FILMIC_FROM_B(x.r, x.g, x.b));
}

void main()
{
    const uint x = gl_GlobalInvocationID.x, y = gl_GlobalInvocationID.y, at = y * pc.stride + x;

    if (x >= pc.width || y >= pc.height)
        return;
    const vec3 color = vec3(image[at], image[pc.plane + at], image[2u * pc.plane + at]);
    const float a = pc.min_alpha < 1.0 ? image[3u * pc.plane + at] : 1.0, e = pc.exposure / (a > pc.min_alpha ? a : 1.0);
    const float l = max(e * PELL_LUMINANCE(color.r, color.g, color.b), 0.0);
    const vec3 mapped = pc.filmic != 0u ? filmic(e, color) : color * PELL_TONE_SCALE(e, l, pc.curve, pc.white_scale);

    for (uint c = 0u; c < 3u; c++)
        shown[c * pc.plane + at] = clamp(mapped[c], 0.0, 1.0);
}
