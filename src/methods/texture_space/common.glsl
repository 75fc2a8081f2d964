// SPDX-License-Identifier: MIT
// common.glsl - shared by the shaders of the texture-space method: push constants, texels, lists.
#include "methods/texture_space/formulas.h"
#include "methods/texture_space/push.h"

layout(push_constant) uniform Push { ts_push pc; };

bool is_inside(ivec2 p)
{
    return p.x >= 0 && p.y >= 0 && p.x < pc.width && p.y < pc.height;
}

int texel_at(ivec2 p)
{
    return pc.origin + p.y * pc.stride + p.x;
}

vec3 weight()
{
    return vec3(pc.weight_r, pc.weight_g, pc.weight_b);
}

// Index of the invocation's list entry; pc.count or more: none.
int entry()
{
    return int((gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * gl_WorkGroupSize.x + gl_LocalInvocationID.x);
}
