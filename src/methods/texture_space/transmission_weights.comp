// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// transmission_weights.comp - transmission weights of a chain level for each listed texel: d'Eon, Luebke and Enderton, EGSR 2007,
// section 5.2, equation (16), or a slab's T(r; d) (README.md); mirror of run_cpu.c and ts_profile_transmission. One invocation per texel of
// the list.
//   in  0 texels   entry points of the light: struct ts_entry
//   in  1 now      light, W/m^2; alpha of the thickness before the level's blur
//   in  2 table    weights of the levels in a slab's transmission (R, G, B), TS_LEVELS for each of TS_THICK thicknesses
//   out 3 level_weight  weight of the light at the entry point
layout(local_size_x = 64) in;
#include "methods/texture_space/common.glsl"
layout(set = 0, binding = 0) readonly buffer Texels { ts_entry texels[]; };
layout(set = 0, binding = 1) readonly buffer Now { vec4 now[]; };
layout(set = 0, binding = 2) readonly buffer Table { vec4 table[]; };
layout(set = 0, binding = 3) writeonly buffer LevelWeight { vec4 level_weight[]; };

// 1 - exp(-x), x >= 0.
float rest_of(float x)
{
    return x < 0.05 ? x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0)))) : 1.0 - exp(-x);
}

vec3 transmission(float d, float opposed)
{
    vec3 transmitted = d * d < 80.0 * pc.variance ? weight() * exp(-d * d / (2.0 * pc.variance)) : vec3(0.0);

    if (pc.slab == 0)
        return transmitted;
    transmitted *= 1.0 - opposed;
    if (d < pc.thickest) {
        const float f = sqrt(d / pc.thickest) * float(TS_THICK - 1);
        const int row = f < float(TS_THICK - 2) ? int(f) : TS_THICK - 2;
        const vec3 low = table[row * TS_LEVELS + pc.level].rgb, high = table[(row + 1) * TS_LEVELS + pc.level].rgb;
        transmitted += opposed * (low + (f - float(row)) * (high - low));
    }
    return transmitted;
}

void main()
{
    const int e = entry();

    if (e >= pc.count)
        return;
    const ts_entry t = texels[e];
    const float alpha = now[pc.origin + t.at].w;
    // The blurs weight A's light by exp(-s^2/(2 v)), s along the surface; a straight path has exp(-m^2/(2 v)).
    float fade = pc.linear != 0 ? min(t.surface_distance / pc.reach, 1.0)
                                : rest_of(max(t.surface_distance * t.surface_distance - t.m * t.m, 0.0) * 0.5 / pc.variance);
    fade += t.along_surface != 0 || pc.linear != 0 ? 0.0 : (1.0 - fade) * t.opposed;
    vec3 weight = vec3(0.0);
    if (alpha > 0.0 && t.strength > 0.0)
        weight = transmission(max(-log(alpha), 0.0) * pc.widest / t.strength, t.opposed) * fade *
                 vec3(t.remaining_r, t.remaining_g, t.remaining_b);
    level_weight[e] = vec4(weight, 0.0);
}
