// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// blur.comp - one of the two passes of a blur: d'Eon, Luebke and Enderton, EGSR 2007, section 4, by lengths on the surface (README.md);
// mirror of kernels.c. AXIS 0: along x; 1: perpendicular to it, and added to the sum.
//   in     0 lines    chart (0: none), mm from texel to texel along this axis
//   in     1 tilts    relative change of a tap's weight per texel along x, and perpendicular to it
//   in     2 cells    of each block of 16 texels: least and most mm along x and perpendicular to it; skew of the line (texels back along x
//                     per texel along y), texels to the inside of a chart
//   in     3 from     light, W/m^2; alpha of the thickness
//   out    4 to       the same, blurred
//   in/out 5 sum      AXIS 1: radiant exitance, W/m^2; chart
layout(local_size_x = 16, local_size_y = 8) in;
layout(constant_id = 0) const int AXIS = 0;
layout(set = 0, binding = 0) readonly buffer Lines { vec2 lines[]; };
layout(set = 0, binding = 1) readonly buffer Tilts { vec2 tilts[]; };
layout(set = 0, binding = 2) readonly buffer Cells { vec4 cells[]; };
layout(set = 0, binding = 3) readonly buffer From { vec4 from[]; };
layout(set = 0, binding = 4) writeonly buffer To { vec4 to[]; };
layout(set = 0, binding = 5) buffer Sum { vec4 sum[]; };
#include "methods/texture_space/common.glsl"

float kernel_of(float y)
{
    const float a = min(y, Y_SHIFT) - 1.0;
    float k = (a * a + 1.0) * 0.5;

    k *= k;
    k *= k;
    k *= k;
    return k * k - K_END;
}

// Variance in texels^2 that the chain has added where a texel has this length; the variance that reading the map adds is subtracted.
float on_grid(float variance, float length_mm)
{
    return max(variance / (length_mm * length_mm) - pc.read_variance, 0.0);
}

// The texel that is blurred, and the line of taps through it.
struct Centre {
    ivec2 p;
    float key, own, kernel_scale, tilt;
    int stride;
    float skew; // 0: upright
};

struct Gathered {
    vec4 light;
    float weight;
};

// The taps of one side: distances accumulate along the line, from the length of each texel.
void side(const Centre c, int direction, int count, inout Gathered g)
{
    const float half_stride = 0.5 * float(c.stride), tilt = direction < 0 ? -c.tilt : c.tilt;
    float last = c.own, distance_mm = 0.0;

    for (int j = 1; j <= count; j++) {
        const int step = direction * c.stride * j;
        ivec2 q = c.p + (AXIS == 0 ? ivec2(step, 0) : ivec2(0, step));
        if (AXIS == 1) {
            const float exact = -c.skew * float(step);
            q.x += exact < 0.0 ? -int(0.5 - exact) : int(exact + 0.5);
        }
        if (!is_inside(q))
            return;
        const int i = texel_at(q);
        const vec2 here = lines[i];
        distance_mm += (last + here.y) * half_stride;
        last = here.y;
        if (here.x != c.key)
            continue;
        const float tap = kernel_of(distance_mm * distance_mm * c.kernel_scale) * here.y * max(distance_mm * tilt + 1.0, 0.0);
        g.weight += tap;
        g.light += tap * from[i];
    }
}

vec4 blurred(ivec2 p, vec2 own, vec4 extremes, float skew)
{
    const vec2 ends = AXIS == 0 ? extremes.xz : extremes.yw; // the shortest and the longest texel of the block
    const int i = texel_at(p);
    const vec4 light = from[i];
    const float add_most = on_grid(pc.after, ends.x) - on_grid(pc.before, ends.x), before = on_grid(pc.before, ends.y);
    const float smooth_by = min(before, on_grid(pc.after, ends.y) - before);
    const float reach = add_most > ADD_LEAST ? K_REACH * sqrt(max(add_most, S2_MIN)) : 0.0;

    if (!(reach > 0.0))
        return light;
    // Taps may be 1.5 standard deviations of the previous blurs apart.
    const float space = 1.5 * sqrt(smooth_by);
    const int stride = space >= 2.0 ? (space < 4096.0 ? int(space) : 4096) : 1;
    const int count = max(reach < float(MAX_TAPS * stride) ? int(reach / float(stride)) : MAX_TAPS, 1);
    const float inverse = 1.0 / own.y, density2 = inverse * inverse;
    const float add = max(density2 * pc.after - pc.read_variance, 0.0) - max(density2 * pc.before - pc.read_variance, 0.0);
    const float mixed = min(add * (1.0 / S2_MIN_VARIANCE), 1.0);
    const bool skews = AXIS == 1 && abs(skew) * reach >= 0.5; // with less than half a texel to the side, taps follow the column
    const float tilt = pc.tilts != 0 ? (AXIS == 0 ? tilts[i].x : tilts[i].y) * inverse : 0.0;
    const Centre c = Centre(p, own.x, own.y, K_SCALE * density2 / max(add, S2_MIN), tilt, stride, skews ? skew : 0.0);
    Gathered g;

    g.weight = own.y * (1.0 - K_END);
    g.light = g.weight * light;
    side(c, -1, count, g);
    side(c, 1, count, g);
    return g.light * (mixed / g.weight) + (1.0 - mixed) * light;
}

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);

    if (!is_inside(p))
        return;
    const int i = texel_at(p), cell = p.y * pc.blocks + p.x / 16;
    const vec2 own = lines[i];
    const vec4 more = cells[2 * cell + 1];
    if (!(own.x > 0.0) || int(more.y) > pc.near)
        return;
    const vec4 result = blurred(p, own, cells[2 * cell], more.x);
    to[i] = result;
    if (AXIS == 1 && pc.add != 0)
        sum[i].rgb += weight() * result.rgb;
}
