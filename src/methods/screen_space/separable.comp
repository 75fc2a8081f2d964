// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// separable.comp - one of the two passes of a term of a separable kernel: Jimenez, Zsolnai, Jarabo et al., "Separable Subsurface
// Scattering", 2015, section 4; README.md has the mathematics; mirror of separable.c. AXIS 0: along x; 1: along D, and added to the sum of
// the terms.
//   in     0 geometry depth (mm), length on the surface along this axis (mm)
//   in     1 other    depth (mm), length along the other axis (mm)
//   in     2 scale    px^2 per mm^2 of the variances
//   in     3 factors  per material and term: integral over all x (R, G, B), extent (mm); sign (R, G, B), 0; coefficients of
//                     SCREEN_FACTOR_PARTS cubics (factors.h) for R, G and B
//   in     4 plans    reach of the taps (px), skew of the taps (bits of floats), 0, 0
//   in     5 from     light, W/m^2 or W/(m^2 sr); material
//   out    6 to       AXIS 0: the pass's result, material
//   in/out 7 sum      AXIS 1: the sum of the terms so far, 0
layout(local_size_x = 16, local_size_y = 8) in;
layout(constant_id = 0) const int AXIS = 0;
layout(set = 0, binding = 0) readonly buffer Geometry { vec2 geometry[]; };
layout(set = 0, binding = 1) readonly buffer Other { vec2 other[]; };
layout(set = 0, binding = 2) readonly buffer Scale { float scale[]; };
layout(set = 0, binding = 3) readonly buffer Factors { vec4 factors[]; };
layout(set = 0, binding = 4) readonly buffer Plans { ivec4 plans[]; };
layout(set = 0, binding = 5) readonly buffer From { vec4 from[]; };
layout(set = 0, binding = 6) writeonly buffer To { vec4 to[]; };
layout(set = 0, binding = 7) buffer Sum { vec4 sum[]; };
#include "methods/screen_space/common.glsl"

const int PARTS = SCREEN_FACTOR_PARTS;

// The pixel that is blurred.
struct Centre {
    ivec2 p;
    vec2 own;     // depth, length along the axis, mm
    float across; // AXIS 1: |Tx|
    vec4 light;   // with its material
    vec2 t;       // slopes of its ray
    float per_mm; // reciprocal of the kernel's extent at the pixel's scale
    int first;    // of the factor's cubics
};

struct Gathered {
    vec3 light, weight;
};

// Integral of the factor between two fractions of its extent.
vec3 between(int first, float near, float far)
{
    const vec2 coord = sqrt(min(vec2(near, far), vec2(1.0))) * float(PARTS);
    const ivec2 k = ivec2(min(coord, vec2(PARTS - 1)));
    const vec2 t = coord - vec2(k);
    vec3 light;

    for (int c = 0; c < 3; c++) {
        const vec4 low = factors[first + 3 * k.x + c], high = factors[first + 3 * k.y + c];
        light[c] = (high.x + t.y * (high.y + t.y * (high.z + t.y * high.w))) - (low.x + t.x * (low.y + t.x * (low.z + t.x * low.w)));
    }
    return light;
}

// The tap `ahead` pixels along the line, which represents the interval between two edges.
void tap(const Centre c, int ahead, float skew, vec2 edge, inout Gathered g)
{
    const ivec2 offset = AXIS == 0 ? ivec2(ahead, 0) : ivec2(int(floor(0.5 - float(ahead) * skew)), ahead);

    if (!is_inside(c.p + offset))
        return;
    const int i = pixel_at(c.p + offset);
    const vec4 light = from[i];
    const vec2 tap = geometry[i];
    if (light.w != c.light.w || !(tap.y > 0.0))
        return;
    const float h = tap.x * pc.depth_mm + pc.fixed_mm, dz = tap.x - c.own.x;
    const vec3 offset_mm = vec3(h * vec2(offset) + dz * c.t, dz);
    // offset of the nearest pixel from the line
    const float across = AXIS == 0 ? 0.0 : (float(offset.x) + float(ahead) * skew) * c.across;
    const float spacing = sqrt(max(dot(offset_mm, offset_mm) - across * across, 0.0)) / abs(float(ahead));
    if (!(spacing > 0.0))
        return;
    const vec3 weight = between(c.first, edge.x * spacing * c.per_mm, edge.y * spacing * c.per_mm) * (tap.y / spacing);
    g.weight += weight;
    g.light += weight * light.rgb;
}

// Distance of the i-th tap on either side, px: every pixel up to pc.taps taps, else taps spaced by squares, dense in the centre.
int tap_position(int i, int before, float reach)
{
    const float part = float(i) / (float(pc.taps) + 0.5), square = reach * part * part;
    const int at = reach > float(pc.taps) + 0.5 && square > float(i) ? int(square + 0.5) : i;

    return max(at, before + 1);
}

Gathered gather(const Centre c, float reach, float skew)
{
    const bool sparse = reach > float(pc.taps) + 0.5;
    Gathered g = Gathered(vec3(0.0), vec3(0.0));
    float near = 0.5;
    int at = 0, next = reach > 0.0 ? tap_position(1, 0, reach) : 0;

    for (int i = 1; i <= pc.taps && float(at) < reach; i++) {
        at = next;
        const bool last = i == pc.taps || !(float(at) < reach);
        next = last ? at : tap_position(i + 1, at, reach);
        // The last one represents the remainder.
        const float far = last ? (sparse ? reach : float(at) + 0.5) : 0.5 * float(at + next);
        tap(c, -at, skew, vec2(near, far), g);
        tap(c, at, skew, vec2(near, far), g);
        near = far;
    }
    return g;
}

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    const int i = pixel_at(p), term = pc.step;

    if (!is_inside(p))
        return;
    const vec4 light = from[i];
    if (!(light.w > 0.0)) {
        if (AXIS == 0)
            to[i] = vec4(0.0);
        return;
    }
    const int head = (int(light.w) * pc.rank + term) * SCREEN_FACTOR_SIZE;
    const vec4 integral_extent = factors[head];
    const vec2 own = geometry[i], across = other[i];
    const vec2 plan = intBitsToFloat(plans[AXIS * (pc.width / BLOCK * pc.height) + i / BLOCK].xy);
    const float mm = own.x * pc.depth_mm + pc.fixed_mm, extent = integral_extent.w, size = scale[i];
    Gathered g = Gathered(vec3(0.0), vec3(0.0));
    if (size > 0.0 && extent > 0.0 && own.y > 0.0 && across.y > 0.0)
        g = gather(Centre(p, own, across.y, light, ray_of(p), 1.0 / (extent * sqrt(size) * mm), head + 2), plan.x, plan.y);
    // The weight that the taps do not contribute stays with the pixel.
    vec3 result = g.light + (integral_extent.rgb - g.weight) * light.rgb;
    for (int c = 0; c < 3; c++)
        if (term == 0 && integral_extent[c] > 0.0 && g.weight[c] > integral_extent[c]) // lengths vary too fast
            result[c] = g.light[c] * (integral_extent[c] / g.weight[c]);
    if (AXIS == 0)
        to[i] = vec4(result, light.w);
    else
        sum[i] = vec4((term > 0 ? sum[i].rgb : vec3(0.0)) + factors[head + 1].rgb * result, 0.0);
}
