// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// choose.comp - the lowest step of the first class with which a frame takes at most `samples` times its pixels: one workgroup. Mirror of
// is_adapt_choose.
//   in/out 0 regions  see adapt.comp; the first element: that step
layout(local_size_x = 256) in;
layout(set = 0, binding = 0) buffer Regions { uint regions[]; };
#include "methods/image_space/common.glsl"

shared uvec2 sums[256];

// Sums over all regions, in units of 2^16 and of 1: a large frame exceeds 2^32.
uvec2 samples_from(int from, bool of_all)
{
    const uint i = gl_LocalInvocationID.x;
    const int count = regions_x() * regions_y();
    uint sum = 0u;

    for (int r = int(i); r < count; r += 256) {
        const uint region = regions[1 + r];
        sum += (region & 255u) * uint(class_samples(of_all ? IS_CLASS_OF_ALL : class_at(int(region >> 8), from)));
    }
    barrier();
    sums[i] = uvec2(sum >> 16, sum & 0xffffu);
    for (uint half_size = 128u; half_size > 0u; half_size /= 2u) {
        barrier();
        if (i < half_size)
            sums[i] += sums[i + half_size];
    }
    barrier();
    return uvec2(sums[0].x + (sums[0].y >> 16), sums[0].y & 0xffffu);
}

void main()
{
    const uvec2 most = samples_from(0, true);
    int low = -IS_CLASSES * IS_CLASS_STEPS, high = IS_STEPS;

    while (low < high) {
        const int from = (low + high) >> 1;
        const uvec2 samples = samples_from(from, false);
        if (samples.x < most.x || (samples.x == most.x && samples.y <= most.y))
            high = from;
        else
            low = from + 1;
    }
    if (gl_LocalInvocationID.x == 0u)
        regions[0] = uint(low);
}
