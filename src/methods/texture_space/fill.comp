// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// fill.comp - border texels from the chart texels that they stand for; mirror of fill.c. One invocation per border texel.
//   in     0 fills    the texel; the lower left one of four source texels, or the first of its sources; position between the four (x, y: 16
//                     bits each, scaled by 65535); texels to the chart (8 bits), number of sources (8 bits)
//   in     1 sources  a texel; its weight (bits of a float)
//   in/out 2 plane    the plane to fill
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Fills { uvec4 fills[]; };
layout(set = 0, binding = 1) readonly buffer Sources { uvec2 sources[]; };
layout(set = 0, binding = 2) buffer Plane { vec4 plane[]; };
#include "methods/texture_space/common.glsl"

void main()
{
    const int e = entry();

    if (e >= pc.count)
        return;
    const uvec4 b = fills[e];
    const int at = pc.origin + int(b.x), from = int(b.y);
    const uint far = b.w & 255u, count = b.w >> 8 & 255u;
    vec4 light = vec4(0.0);
    if (int(far) > pc.far)
        return;
    if (count > 0u) {
        for (uint k = 0u; k < count; k++) {
            const uvec2 source = sources[uint(from) + k];
            light += uintBitsToFloat(source.y) * plane[pc.origin + int(source.x)];
        }
    } else {
        const float x = float(b.z & 65535u) * (1.0 / 65535.0), y = float(b.z >> 16) * (1.0 / 65535.0);
        const float both = x * y, right = x - both, up = y - both, least = 1.0 - x - up;
        const int i = pc.origin + from;
        light = least * plane[i] + right * plane[i + 1] + up * plane[i + pc.stride] + both * plane[i + pc.stride + 1];
    }
    plane[at] = vec4(light.rgb, pc.keep != 0 ? plane[at].w : light.a);
}
