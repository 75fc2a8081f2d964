// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// rays.comp - for test_gpu_rays.c: one ray per invocation through a scene's triangles.
//   in  0 nodes       see visibility/wide_bvh.h
//   in  1 triangles
//   in  2 rays        origin (mm), near; direction, far
//   out 3 hits        t, u, v, 1 where a triangle was hit; mesh, triangle (bits)
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Nodes { uvec4 bvh_nodes[]; };
layout(set = 0, binding = 1) readonly buffer Triangles { uvec4 bvh_triangles[]; };
layout(set = 0, binding = 2) readonly buffer Rays { vec4 rays[]; };
layout(set = 0, binding = 3) writeonly buffer Hits { uvec4 hits[]; };
layout(push_constant) uniform Push { uint count, mask, any; } pc;
#include "visibility/wide_bvh.glsl"

void main()
{
    const uint i = gl_GlobalInvocationID.x;

    if (i >= pc.count)
        return;
    const vec4 from = rays[2 * i], direction = rays[2 * i + 1];
    Hit hit;
    const bool any_hit = trace_ray(Ray(from.xyz, from.w, direction.xyz, direction.w, pc.mask), pc.any != 0u, hit);
    hits[2 * i] = uvec4(floatBitsToUint(hit.t), floatBitsToUint(hit.u), floatBitsToUint(hit.v), any_hit ? 1u : 0u);
    hits[2 * i + 1] = uvec4(hit.mesh, hit.triangle, 0u, 0u);
}
