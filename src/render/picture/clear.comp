// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// clear.comp - clears the planes of an image: pixels that no sample may cover are written by no other pass.
//   out 0 light   1 surface
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) writeonly buffer Light { vec4 light[]; };
layout(set = 0, binding = 1) writeonly buffer Surface { uvec2 surface[]; };
layout(push_constant) uniform Push
{
    uint count;  // pixels
    uint across; // invocations of a row of workgroups
} pc;

void main()
{
    const uint i = gl_GlobalInvocationID.y * pc.across + gl_GlobalInvocationID.x;

    if (i >= pc.count)
        return;
    light[i] = vec4(0.0);
    surface[i] = uvec2(0u);
}
