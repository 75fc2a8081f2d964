// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// blur.comp - one of the two passes of a step: Jimenez and Gutierrez, GPU Pro, 2010, ch. 7. AXIS 0: along x; 1: along D, and into the
// weighted sum of section 7.3.3. PAPER 0: taps are weighted by their distance on the surface (README.md; mirror of kernels.c and taps.c);
// bits 1: the seven taps of listing 7.1 (listing.c), 2: with its slope.
//   in     0 geometry depth (mm), |Tx|, |D| (mm), material
//   in     1 rate     px^2 per mm^2 of the variances: facing, along Tx, along D; 0
//   in     2 table    share of a step's result in the sum (R, G, B), mm^2 applied after the step; by step and material
//   in     3 plans    taps a side, pixels between them, lean of the taps (bits of a float), 0
//   in     4 from     light, W/m^2 or W/(m^2 sr)
//   in/out 5 to       out: the pass's result; in (AXIS 1, fresh): light before the first step
//   in/out 6 sum      AXIS 1: the weighted sum of all steps so far
#define USES_TABLE
layout(local_size_x = 16, local_size_y = 8) in;
layout(constant_id = 0) const int AXIS = 0;
layout(constant_id = 1) const int PAPER = 0;
layout(set = 0, binding = 0) readonly buffer Geometry { vec4 geometry[]; };
layout(set = 0, binding = 1) readonly buffer Rate { vec4 rate[]; };
layout(set = 0, binding = 2) readonly buffer Table { vec4 table[]; };
layout(set = 0, binding = 3) readonly buffer Plans { ivec4 plans[]; };
layout(set = 0, binding = 4) readonly buffer From { vec4 from[]; };
layout(set = 0, binding = 5) buffer To { vec4 to[]; };
layout(set = 0, binding = 6) buffer Sum { vec4 sum[]; };
#include "methods/screen_space/common.glsl"

// So many pixels along the axis. (Not a constant vector: Mesa 22.3 takes the wrong one of a specialised choice between two.)
ivec2 along(int pixels)
{
    return AXIS == 0 ? ivec2(pixels, 0) : ivec2(0, pixels);
}

float kernel_of(float shifted)
{
    float q = shifted * shifted + Q_LEAST;
    q *= q;
    q *= q;
    return q * q;
}

// grid_variance(u1) - grid_variance(u0), with one division: kernels.c.
float grid_difference(float u1, float u0)
{
    const vec2 u = vec2(u1, u0), low = min(u, vec2(WIDE)), low3 = low * low * low;
    const vec2 a = GRID_A(low3), b = GRID_B(low3 * low), over = GRID_OVER(low, low3, a, b), under = a * b, rest = u - low;

    return (over.x * under.y - over.y * under.x) / (under.x * under.y) + (rest.x - rest.y);
}

// What the taps sum up to: light times weight, weight.
struct Gathered {
    vec3 light;
    float weight;
};

// A tap j steps away. Between the points of two pixels lies h (x, y, 0) + dz (tx, ty, 1), with h = mm per pixel at the tap.
void tap(ivec2 p, int j, ivec4 plan, vec4 own, vec2 t, float fall, inout Gathered g)
{
    const float skew = intBitsToFloat(plan.z);
    const int pace = plan.y * j;
    ivec2 offset = along(pace);
    float beside = 0.0;

    if (AXIS == 1 && skew != 0.0) {
        const float exact = -skew * float(pace);
        offset.x = exact < 0.0 ? -int(0.5 - exact) : int(exact + 0.5);
        beside = float(offset.x) - exact;
    }
    if (!is_inside(p + offset))
        return;
    const vec4 other = geometry[pixel_at(p + offset)];
    if (other.w != own.w)
        return;
    const float dz = other.x - own.x, h = fall * (other.x * pc.depth_mm + pc.fixed_mm);
    const vec3 way = vec3(h * vec2(offset) + fall * dz * t, fall * dz);
    const float across = beside * own.y * fall; // from the line that the tap stands for, along x
    const float y = max(dot(way, way) - across * across, 0.0);
    const float weight = (kernel_of(min(y, Y_MAX) + Y_SHIFT) - kernel_of(Y_MAX + Y_SHIFT)) * (AXIS == 0 ? other.y : other.z);

    g.light += weight * from[pixel_at(p + offset)].rgb;
    g.weight += weight;
}

// The blur along the surface. Light that a tap would have brought but does not stays where it is.
vec3 blur_surface(ivec2 p, vec4 own, ivec4 plan, float before, float after)
{
    const int i = pixel_at(p);
    const float to_px = AXIS == 0 ? rate[i].y : rate[i].z, len = AXIS == 0 ? own.y : own.z;
    const float add = grid_difference(after * to_px, before * to_px);
    const float inverse = 1.0 / (sqrt(max(add, S2_MIN)) * (len > 0.0 ? len : 1.0));
    const float mixed = max(min(add / S2_MIN_VARIANCE, 1.0), 0.0), fall = inverse * K_SCALE_ROOT;
    const vec2 t = ray_of(p);
    float share = inverse * mixed * (K_NORM * float(plan.y));
    Gathered g = Gathered(vec3(0.0), 0.0);

    for (int j = 1; j <= plan.x; j++) {
        const ivec2 reach = along(j * plan.y);
        if (!is_inside(p - reach) && !is_inside(p + reach))
            break;
        tap(p, -j, plan, own, t, fall, g);
        tap(p, j, plan, own, t, fall, g);
    }
    const float weight = g.weight * share;
    const float keep = max(1.0 - weight, 0.0);
    share /= max(weight, 1.0);
    return g.light * share + keep * from[i].rgb;
}

// Span in pixels over that of a facing surface: listing 7.1, or by the surface.
float paper_slope(ivec2 p, vec4 own)
{
    if ((PAPER & 2) == 0) {
        const float len = AXIS == 0 ? own.y : own.z;
        return len > 0.0 ? (own.x * pc.depth_mm + pc.fixed_mm) / len : 0.0;
    }
    // Derivatives are those of a quad of 2 x 2 pixels. Where the other pixel is not of this surface, the limit.
    const ivec2 at = p + ivec2(pc.x0, pc.y0);
    const ivec2 q = p + along(((AXIS == 0 ? at.x : at.y) & 1) == 1 ? -1 : 1);
    float change = pc.maxdd;
    if (is_inside(q) && geometry[pixel_at(q)].w == own.w)
        change = min(abs(geometry[pixel_at(q)].x - own.x) * pc.unit, pc.maxdd);
    const float level = pc.orthographic != 0 ? 1.0 : own.x * pc.unit;
    return level / (level + pc.correction * change);
}

// Seven bilinear taps over +-span; those outside the mask are left out.
vec3 blur_paper(ivec2 p, vec4 own, float added)
{
    const float weights[7] = float[](0.006, 0.061, 0.242, 0.382, 0.242, 0.061, 0.006);
    const float span = min(SCREEN_SPAN * sqrt(added * rate[pixel_at(p)].x) * paper_slope(p, own), 262144.0);
    vec3 light = vec3(0.0);
    float all = 0.0;

    for (int t = 0; t < 7; t++) {
        const float offset = float(t - 3) * (1.0 / 3.0) * span, whole = floor(offset), part = offset - whole;
        for (int k = 0; k < 2; k++) {
            const ivec2 q = p + along(int(whole) + k);
            const float share = weights[t] * (k == 0 ? 1.0 - part : part);
            if (!is_inside(q) || geometry[pixel_at(q)].w != own.w)
                continue;
            all += share;
            light += share * from[pixel_at(q)].rgb;
        }
    }
    return light / all;
}

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    const int i = pixel_at(p);

    if (!is_inside(p))
        return;
    const vec4 own = geometry[i];
    if (!(own.w > 0.0)) {
        to[i] = vec4(0.0);
        if (AXIS == 1)
            sum[i] = vec4(0.0);
        return;
    }
    const int material = int(own.w), cells = pc.width / BLOCK * pc.height;
    const ivec4 plan = plans[AXIS * cells + i / BLOCK];
    float before;
    const bool on = applied(material, rate[i].x, before);
    vec3 result = from[i].rgb;
    if (on) {
        const float after = variance_of(pc.step, material);
        result = PAPER != 0 ? blur_paper(p, own, after - before) : blur_surface(p, own, plan, before, after);
    }
    if (AXIS == 1) {
        // Where a pixel left the step out, its weight goes to the last result, or, as in the paper, to all that the sum holds.
        vec3 share = pc.whole != 0 ? vec3(1.0) : table[(pc.base + pc.step) * pc.row + material].rgb;
        if (PAPER != 0 && !on)
            share = vec3(0.0);
        sum[i] = vec4(mix(pc.fresh != 0 ? to[i].rgb : sum[i].rgb, result, share), 0.0);
    }
    to[i] = vec4(result, 0.0);
}
