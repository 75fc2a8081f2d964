// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// transmit.comp - adds a level's transmitted light, read at its entry points: d'Eon, Luebke and Enderton, EGSR 2007, section 5.2; mirror of
// run_cpu.c. One invocation per texel of the list, which holds each texel once.
//   in     0 texels   entry points of the light: struct ts_entry
//   in     1 level_weight weight of the light at the entry point
//   in     2 lines    chart (0: none), mm
//   in     3 now      light, W/m^2; alpha
//   in/out 4 transmitted   transmitted light, W/m^2
layout(local_size_x = 64) in;
#include "methods/texture_space/common.glsl"
layout(set = 0, binding = 0) readonly buffer Texels { ts_entry texels[]; };
layout(set = 0, binding = 1) readonly buffer LevelWeight { vec4 level_weight[]; };
layout(set = 0, binding = 2) readonly buffer Lines { vec2 lines[]; };
layout(set = 0, binding = 3) readonly buffer Now { vec4 now[]; };
layout(set = 0, binding = 4) buffer Transmitted { vec4 transmitted[]; };

// Bilinear mean of those of the four texels around a point that are in its chart.
vec3 read_at(int at, float key, vec2 f)
{
    vec4 sum = vec4(0.0);

    if (at < 0)
        return vec3(0.0);
    for (int k = 0; k < 4; k++) {
        const int i = pc.origin + at + (k & 1) + (k >> 1) * pc.stride;
        const float w = ((k & 1) == 1 ? f.x : 1.0 - f.x) * (k >> 1 == 1 ? f.y : 1.0 - f.y);
        if (lines[i].x == key && w > 0.0)
            sum += w * vec4(now[i].rgb, 1.0);
    }
    return sum.w > 0.0 ? sum.rgb / sum.w : vec3(0.0);
}

void main()
{
    const int e = entry();

    if (e >= pc.count)
        return;
    const vec3 weight = level_weight[e].rgb;
    if (!(weight.r > 0.0 || weight.g > 0.0 || weight.b > 0.0))
        return;
    const ts_entry t = texels[e];
    vec3 light = read_at(t.from, t.from_key, vec2(t.from_x, t.from_y));
    if (t.second_weight > 0.0)
        light += t.second_weight * (read_at(t.second, t.second_key, vec2(t.second_x, t.second_y)) - light);
    transmitted[pc.origin + t.at].rgb += weight * light;
}
