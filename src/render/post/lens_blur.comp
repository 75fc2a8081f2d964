// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// lens_blur.comp - gathers the discs of neighbouring pixels at a pixel, one invocation each, and adds the result to the sum over the
// samples. Mirror of `blur` in dof.c.
//   in  0 planes  of lens_measure.comp
//   in  1 table   weight by radius
//   in  2 discs
//   in  3 tiles
//   io  4 sum     R, G, B and alpha
layout(local_size_x = 16, local_size_y = 4) in;
#include "render/post/device_data.h"
#include "shared/lens.h"
layout(set = 0, binding = 0) readonly buffer Planes { float planes[]; };
layout(set = 0, binding = 1) readonly buffer Table { float table[]; };
layout(set = 0, binding = 2) readonly buffer Discs { vec2 discs[]; };
layout(set = 0, binding = 3) readonly buffer Tiles { float tiles[]; };
layout(set = 0, binding = 4) buffer Sum { float sum[]; };
layout(push_constant) uniform Push { pell_lens_push pc; };

float weight_of(float r)
{
    const float at = r * float(PELL_LENS_STEPS), cell = floor(at);
    return table[int(cell)] + (at - cell) * (table[int(cell) + 1] - table[int(cell)]);
}

vec4 color_at(uint at)
{
    return vec4(planes[at], planes[pc.plane + at], planes[2u * pc.plane + at], planes[3u * pc.plane + at]);
}

// Radius of the widest disc that may reach the workgroup's tile.
float widest_around()
{
    const int column = int(gl_WorkGroupID.x), row = int(gl_WorkGroupID.y) / (PELL_LENS_MOST / PELL_POST_GROUP_Y);
    float widest = 0.0;

    for (int y = max(row - 1, 0); y <= min(row + 1, int(pc.rows) - 1); y++)
        for (int x = max(column - 1, 0); x <= min(column + 1, int(pc.columns) - 1); x++)
            widest = max(widest, tiles[pc.columns * pc.rows + uint(y) * pc.columns + uint(x)]);
    return min(widest, float(PELL_LENS_MOST));
}

void main()
{
    const int x = int(gl_GlobalInvocationID.x), y = int(gl_GlobalInvocationID.y);
    const float widest = widest_around();

    if (x < pc.x0 || x >= pc.x1 || y < pc.y0 || y >= pc.y1)
        return;
    const uint here = uint(y) * pc.stride + uint(x);
    vec4 value = color_at(here);

    if (widest >= PELL_LENS_SHARP) {
        const int reach = int(ceil(widest));
        const float mine = discs[here].x, radius = abs(mine), band = pell_disc_band(radius), narrow = min(radius, widest);
        float near = 0.0, same = 0.0, far = 0.0, own = 0.0;
        vec4 near_sum = vec4(0.0), same_sum = vec4(0.0), far_sum = vec4(0.0);

        for (int dy = max(-reach, pc.y0 - y); dy <= min(reach, pc.y1 - 1 - y); dy++)
            for (int dx = max(-reach, pc.x0 - x); dx <= min(reach, pc.x1 - 1 - x); dx++) {
                const float d = sqrt(float(dx * dx + dy * dy));
                if (!(d < widest + 0.5))
                    continue;
                const uint other = uint(int(here) + dy * int(pc.stride) + dx);
                const vec2 disc = discs[other];
                const float difference = disc.x - mine, w = pell_disc_cover(abs(disc.x), d) * disc.y, o = pell_disc_cover(narrow, d);
                const vec4 color = color_at(other);
                own += o;
                if (difference < -band) {
                    near += w;
                    near_sum += w * color;
                } else {
                    same += difference > band ? 0.0 : w;
                    same_sum += (difference > band ? 0.0 : w) * color;
                }
                if (difference > band) {
                    far += o;
                    far_sum += o * color;
                }
            }
        const float inside = min(own * weight_of(narrow), 1.0);
        for (int c = 0; c < 4; c++)
            value[c] = pell_disc_composite(near, near_sum[c], same, same_sum[c], far, far_sum[c], inside);
    }
    for (int c = 0; c < 4; c++) {
        const uint at = uint(c) * pc.plane + here;
        sum[at] = pc.first != 0u ? value[c] : sum[at] + value[c];
    }
}
