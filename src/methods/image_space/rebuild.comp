// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// rebuild.comp - mean over a tile of pixels along the surface, in which each pattern of the tile has the same weight: 1/2 1 .. 1 1/2 along
// both axes, over n^2. The weight of a tap falls with the distance of either pixel from the other's plane. Weights are symmetric, so the
// sum over pixels is preserved. Mirror of rebuild.c; README.md, "Reconstruction".
//   in  0 texels   see common.glsl
//   in  1 light    M of each pixel (W/m^2), 0
//   in  2 alpha    weight of a pixel's channels; footprints off its plane for a difference of one in w
//   out 3 result   M (W/m^2), 0
layout(local_size_x = 16, local_size_y = 8) in;
layout(set = 0, binding = 0) readonly buffer Texels { vec4 texels[]; };
layout(set = 0, binding = 1) readonly buffer Light { vec4 light[]; };
layout(set = 0, binding = 2) readonly buffer Alpha { vec4 alpha[]; };
layout(set = 0, binding = 3) writeonly buffer Result { vec4 result[]; };
#include "methods/image_space/common.glsl"

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    const int i = pixel_at(p), reach = pc.tile / 2;

    if (!is_inside(p))
        return;
    const vec4 own = texels[2 * i]; // w, gu, gv, key
    if (own.w == 0.0) {
        result[i] = vec4(0.0);
        return;
    }
    const vec3 here = light[i].rgb;
    const vec4 center = alpha[i];
    const float over = 1.0 / float(pc.tile * pc.tile);
    vec3 moved = vec3(0.0);

    for (int dy = -reach; dy <= reach; dy++)
        for (int dx = -reach; dx <= reach; dx++) {
            const ivec2 q = p + ivec2(dx, dy);
            const int k = pixel_at(q);
            if ((dx == 0 && dy == 0) || !is_inside(q) || texels[2 * k].w != own.w)
                continue;
            const vec4 other = texels[2 * k], its = alpha[k];
            const vec2 d = vec2(dx, dy);
            const float to = own.x + own.y * d.x + own.z * d.y - other.x;
            const float back = other.x - other.y * d.x - other.z * d.y - own.x;
            const float off = abs(to) * center.w + abs(back) * its.w;
            const float box = (abs(dx) == reach ? 0.5 : 1.0) * (abs(dy) == reach ? 0.5 : 1.0);
            const float weight = max(1.0 - off * off * IS_OFF_PLANE, 0.0) * (box * over);
            moved += weight * its.rgb * (light[k].rgb - here);
        }
    result[i] = vec4(here + center.rgb * moved, 0.0);
}
