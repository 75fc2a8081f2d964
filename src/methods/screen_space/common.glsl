// SPDX-License-Identifier: MIT
// common.glsl - shared by the shaders of the screen-space method: push constants, the table of steps. An including file declares the buffer
// `table` if it calls applied(), and defines USES_TABLE.
#include "methods/screen_space/formulas.h"
#include "methods/screen_space/push.h"

#define BLOCK 16

layout(push_constant) uniform Push { screen_push pc; };

int pixel_at(ivec2 p)
{
    return p.y * pc.width + p.x;
}

bool is_inside(ivec2 p)
{
    return p.x >= 0 && p.y >= 0 && p.x < pc.width && p.y < pc.height;
}

// Slopes of the ray through a pixel: x/f and y/f.
vec2 ray_of(ivec2 p)
{
    return (vec2(p + ivec2(pc.x0, pc.y0)) + 0.5 - 0.5 * vec2(pc.image_width, pc.image_height)) * pc.depth_mm;
}

#ifdef USES_TABLE
// Variance of the chain after a step, mm^2.
float variance_of(int step, int material)
{
    return table[(pc.base + step) * pc.row + material].w;
}

// Variance before a step where a material's pixels have this scale; returns whether the step blurs them. As in blocks.h.
bool applied(int step, int material, float scale, out float before)
{
    float last = 0.0;

    for (int i = 0; i < step; i++) {
        const float v = variance_of(i, material);
        last = (v - last) * scale > pc.skip ? v : last;
    }
    before = last;
    return (variance_of(step, material) - last) * scale > pc.skip;
}
#endif
