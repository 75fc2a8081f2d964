// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// adapt.comp - local variation of the light around a region, which determines the number of samples per pixel. One invocation per region.
// Mirror of adapt.c: sums are exact to the last bit (precise), everything else is integer arithmetic.
//   in  0 light    irradiance (W/m^2), depth (mm)
//   in  1 surface  material (0: not translucent), strength (bits of a float)
//   in  2 sets     see points.glsl
//   out 3 regions  from the second element on: per region, in rows of the grid, translucent pixels + 256 times the step
layout(local_size_x = 8, local_size_y = 8) in;
layout(set = 0, binding = 0) readonly buffer Light { vec4 light[]; };
layout(set = 0, binding = 1) readonly buffer Surface { uvec2 surface[]; };
layout(set = 0, binding = 2) readonly buffer Sets { uvec4 sets[]; };
layout(set = 0, binding = 3) writeonly buffer Regions { uint regions[]; };
#include "methods/image_space/common.glsl"

const ivec2 step_dir[4] = { ivec2(1, 0), ivec2(-1, 0), ivec2(0, 1), ivec2(0, -1) };

uint material_at(ivec2 p)
{
    if (!is_inside(p) || pc.x0 + p.x >= pc.image_width)
        return 0u;
    const uint m = surface[pixel_at(p)].x;
    return m <= uint(pc.materials) ? m : 0u;
}

float depth_at(ivec2 p)
{
    const float z = light[pixel_at(p)].w;
    return z > 1e-30 && z < 1e30 ? z : 1.0;
}

float strength_at(ivec2 p)
{
    const float s = pc.strength != 0 ? uintBitsToFloat(surface[pixel_at(p)].y) : 1.0, low = s < 1.0 ? s : 1.0;
    return low > 0.0 ? low : 0.0;
}

int log_of(float x)
{
    return floatBitsToInt(x);
}

// Adds the squared differences between p and pixels on the same surface px away; returns their number.
int compare(ivec2 p, int px, float count, float near, inout float sum)
{
    const uint m = material_at(p);
    int found = 0;

    if (m == 0u)
        return 0;
    const vec3 here = light[pixel_at(p)].rgb, scale = uintBitsToFloat(sets[4 * (m - 1u) + 1u].xyz);
    precise const float mean2 = (here.r * here.r + here.g * here.g + here.b * here.b) * IS_DIFFERENCE_BIAS;
    for (int k = 0; k < 4; k++) {
        const ivec2 q = p + step_dir[k] * px;
        if (material_at(q) != m)
            continue;
        precise const float off = (depth_at(q) - depth_at(p)) * count;
        if (!(off < near && -off < near))
            continue;
        precise const vec3 d = (light[pixel_at(q)].rgb - here) * scale;
        precise const float more = sum + (d.r * d.r + d.g * d.g + d.b * d.b + mean2);
        sum = more;
        found++;
    }
    return found;
}

int step_of(ivec2 first)
{
    precise float depth = 0.0, median = 0.0;
    float sum = 0.0;
    int count = 0, found = 0, px = 1;

    for (int y = 0; y < IS_REGION_Y; y += 2)
        for (int x = (first.y + y + pc.y0) & 2; x < IS_REGION_X; x += 4) {
            const ivec2 p = first + ivec2(x, y);
            const uint m = material_at(p);
            if (m == 0u)
                continue;
            count++;
            depth += pc.orthographic != 0 ? 1.0 : depth_at(p);
            median += uintBitsToFloat(sets[4 * (m - 1u) + 3u].y) * strength_at(p);
        }
    if (count == 0)
        return 0;
    precise const float wide = pc.focal_px * median, wide2 = wide * wide, deep2 = depth * depth, both = wide2 + 2.0 * deep2;
    precise const float near = IS_NEAR * median, farther = float(IS_SECOND_DISTANCE) * near;
    for (; px < IS_MAX_DISTANCE; px++) {
        precise const float reached = float(px) * depth;
        if (!(reached < wide))
            break;
    }
    for (int y = 0; y < IS_REGION_Y; y += 2)
        for (int x = (first.y + y + pc.y0) & 2; x < IS_REGION_X; x += 4)
            {
            const bool far = ((first.y + y + pc.y0) & 2) != 0;
            found += compare(first + ivec2(x, y), far ? IS_SECOND_DISTANCE * px : px, float(count), far ? farther : near, sum);
        }
    if (!(sum > 1e-30 && sum < 1e30 && wide2 > 1e-30 && wide2 < 1e30 && deep2 < 1e30))
        return 0;
    int log = log_of(sum) - log_of(float(found)) + 2 * (log_of(float(4 * count)) - log_of(float(found)));
    log += log_of(wide2) - log_of(both); // reduced where the profile is narrower than a pixel
    return clamp((log >> IS_STEP_SHIFT) + IS_STEP_OF_ONE, 0, IS_STEPS - 1);
}

void main()
{
    const ivec2 region = ivec2(gl_GlobalInvocationID.xy);
    // Regions are counted from the frame's first pixel: those of the grid begin above its first row.
    const ivec2 first = region * ivec2(IS_REGION_X, IS_REGION_Y) - ivec2(0, pc.y0 % IS_REGION_Y);
    uint count = 0u;

    if (region.x >= regions_x() || region.y >= regions_y())
        return;
    for (int y = 0; y < IS_REGION_Y; y++)
        for (int x = 0; x < IS_REGION_X; x++)
            count += material_at(first + ivec2(x, y)) != 0u ? 1u : 0u;
    regions[1 + region.y * regions_x() + region.x] = count + 256u * (count > 0u ? uint(step_of(first)) : 0u);
}
