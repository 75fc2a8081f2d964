// SPDX-License-Identifier: MIT
#version 460
// grow.comp - for test_gpu.c: what[i] = 2 what[i] + other[i], in place: a wrong order of passes changes the result.
//   in/out 0 what   numbers
//   in     1 other  numbers
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) buffer What { float what[]; };
layout(set = 0, binding = 1) readonly buffer Other { float other[]; };
layout(push_constant) uniform Push { int count; };

void main()
{
    const int i = int(gl_GlobalInvocationID.x);

    if (i < count)
        what[i] = 2.0 * what[i] + other[i];
}
