// SPDX-License-Identifier: MIT
// common.glsl - shared by the shaders of the image-space method: push constants, pixels, rays. An irradiance image holds two vec4 per
// pixel: w, gu, gv, key; then light (R, G, B; W/m^2), h (kernels.h).
#include "methods/image_space/formulas.h"
#include "methods/image_space/push.h"

layout(push_constant) uniform Push { is_push pc; };

int pixel_at(ivec2 p)
{
    return p.y * pc.width + p.x;
}

bool is_inside(ivec2 p)
{
    return p.x >= 0 && p.y >= 0 && p.x < pc.width && p.y < pc.height;
}

// --- Adaptive sampling: adapt.c -----------------------------------------------------------------------------------------------------

int regions_x()
{
    return pc.width / IS_REGION_X; // widths are multiples of it
}

int regions_y()
{
    return (pc.y0 + pc.height + IS_REGION_Y - 1) / IS_REGION_Y - pc.y0 / IS_REGION_Y;
}

int class_samples(int of)
{
    const int change = of - IS_CLASS_OF_ALL;
    return change < 0 ? max(pc.samples >> -change, 1) : pc.samples << change;
}

int class_at(int at, int from)
{
    return at < from ? 0 : min((at - from) / IS_CLASS_STEPS, IS_CLASSES - 1);
}

// Position of a pixel of the grid relative to the centre of the frame, divided by f.
vec2 ray_of(ivec2 p)
{
    return (vec2(p + ivec2(pc.x0, pc.y0)) + 0.5 - vec2(pc.mid_x, pc.mid_y)) / pc.focal_px;
}
