// SPDX-License-Identifier: MIT
#version 460
// twice.comp - for test_replace.c, in place of scale.comp: to[i] = 2 SCALE from[i] + add.
//   in  0 from   numbers
//   out 1 to     numbers
layout(local_size_x = 64) in;
layout(constant_id = 0) const float SCALE = 1.0;
layout(set = 0, binding = 0) readonly buffer From { float from[]; };
layout(set = 0, binding = 1) writeonly buffer To { float to[]; };
layout(push_constant) uniform Push { int count; float add; };

void main()
{
    const int i = int(gl_GlobalInvocationID.x);

    if (i < count)
        to[i] = 2.0 * SCALE * from[i] + add;
}
