// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// blur.comp - one of the two passes of a step: Jimenez and Gutierrez, GPU Pro, 2010, ch. 7. AXIS 0: along x; 1: along D, and added to the
// weighted sum of section 7.3.3. PAPER 0: taps are weighted by their distance on the surface (README.md; mirror of kernels.c and taps.c);
// bit 1: the seven taps of listing 7.1 (listing.c), bit 2: with its slope correction.
//   in     0 geometry depth (mm), length on the surface along this axis, |Tx| or |D| (mm)
//   in     1 across   depth (mm), |Tx| (mm)
//   in     2 scale    px^2 per mm^2 of the variances
//   in     3 table    weight of a step's result in the sum (R, G, B), mm^2 applied after the step; by step and material
//   in     4 plans    see plan.comp
//   in     5 from     light, W/m^2 or W/(m^2 sr); material
//   out    6 to       the pass's result, material
//   in/out 7 sum      AXIS 1: the weighted sum of all steps so far, initially the unblurred light; 0
#define USES_TABLE
layout(local_size_x = 16, local_size_y = 8) in;
layout(constant_id = 0) const int AXIS = 0;
layout(constant_id = 1) const int PAPER = 0;
layout(set = 0, binding = 0) readonly buffer Geometry { vec2 geometry[]; };
layout(set = 0, binding = 1) readonly buffer Across { vec2 across[]; };
layout(set = 0, binding = 2) readonly buffer Scale { float scale[]; };
layout(set = 0, binding = 3) readonly buffer Table { vec4 table[]; };
layout(set = 0, binding = 4) readonly buffer Plans { ivec4 plans[]; };
layout(set = 0, binding = 5) readonly buffer From { vec4 from[]; };
layout(set = 0, binding = 6) writeonly buffer To { vec4 to[]; };
layout(set = 0, binding = 7) buffer Sum { vec4 sum[]; };
#include "methods/screen_space/common.glsl"

// An offset of this many pixels along the axis. (Not a constant vector: Mesa 22.3 miscompiles a specialised choice between two.)
ivec2 along(int pixels)
{
    return AXIS == 0 ? ivec2(pixels, 0) : ivec2(0, pixels);
}

float kernel_of(float shifted)
{
    float q = shifted * shifted + Q_MIN;
    q *= q;
    q *= q;
    return q * q;
}

// grid_variance(u1) - grid_variance(u0), with one division: kernels.c.
float grid_difference(float u1, float u0)
{
    const vec2 u = vec2(u1, u0), low = min(u, vec2(WIDE)), low3 = low * low * low;
    const vec2 a = GRID_A(low3), b = GRID_B(low3 * low), numerator = GRID_NUMERATOR(low, low3, a, b), denominator = a * b, rest = u - low;

    return (numerator.x * denominator.y - numerator.y * denominator.x) / (denominator.x * denominator.y) + (rest.x - rest.y);
}

// The pixel that is blurred.
struct Centre {
    ivec2 p;
    vec2 own;      // depth, length along the axis, mm
    float across;  // AXIS 1: |Tx|
    float scale;
    vec4 light;    // with its material
};

// Sums over the taps: light times weight, weight.
struct Gathered {
    vec3 light;
    float weight;
};

// The tap `ahead` pixels along the line. The points of two pixels differ by h (x, y, 0) + dz (tx, ty, 1), with h = mm per pixel at the tap.
void tap(const Centre c, int ahead, float skew, vec2 t, float kernel_scale, inout Gathered g)
{
    ivec2 offset = along(ahead);
    float off_line = 0.0;

    if (AXIS == 1 && skew != 0.0) {
        const float exact = -skew * float(ahead);
        offset.x = exact < 0.0 ? -int(0.5 - exact) : int(exact + 0.5);
        off_line = float(offset.x) - exact;
    }
    if (!is_inside(c.p + offset))
        return;
    const int i = pixel_at(c.p + offset);
    const vec4 light = from[i];
    if (light.w != c.light.w)
        return;
    const vec2 other = geometry[i];
    const float dz = other.x - c.own.x, h = kernel_scale * (other.x * pc.depth_mm + pc.fixed_mm);
    const vec3 offset_mm = vec3(h * vec2(offset) + kernel_scale * dz * t, kernel_scale * dz);
    const float across_mm = off_line * c.across * kernel_scale; // from the line that the tap represents, along x
    const float y = max(dot(offset_mm, offset_mm) - across_mm * across_mm, 0.0);
    const float weight = (kernel_of(min(y, Y_MAX) + Y_SHIFT) - kernel_of(Y_MAX + Y_SHIFT)) * other.y;

    g.light += weight * light.rgb;
    g.weight += weight;
}

// The blur along the surface. The weight of taps that contribute nothing stays with the pixel itself. `mm2`: before and after.
vec3 blur_surface(const Centre c, ivec4 plan, vec2 mm2)
{
    const int count = plan.x & 65535, stride = plan.x >> 16;
    const float len = c.own.y, mm = c.own.x * pc.depth_mm + pc.fixed_mm;
    const float to_px = len > 0.0 ? c.scale * mm * mm / (len * len) : 0.0;
    const float add = grid_difference(mm2.y * to_px, mm2.x * to_px);
    const float inverse = 1.0 / (sqrt(max(add, S2_MIN)) * (len > 0.0 ? len : 1.0));
    const float mixed = max(min(add / S2_MIN_VARIANCE, 1.0), 0.0), kernel_scale = inverse * K_SCALE_ROOT;
    const vec2 t = ray_of(c.p);
    float fraction = inverse * mixed * (K_NORM * float(stride));
    Gathered g = Gathered(vec3(0.0), 0.0);

    for (int j = 1; j <= count; j++) {
        const ivec2 reach = along(j * stride);
        if (!is_inside(c.p - reach) && !is_inside(c.p + reach))
            break;
        tap(c, -j * stride, intBitsToFloat(plan.y), t, kernel_scale, g);
        tap(c, j * stride, intBitsToFloat(plan.y), t, kernel_scale, g);
    }
    const float weight = g.weight * fraction;
    const float keep = max(1.0 - weight, 0.0);
    fraction /= max(weight, 1.0);
    return g.light * fraction + keep * c.light.rgb;
}

// Span in pixels relative to that of a facing surface: by listing 7.1, or by the surface.
float paper_slope(const Centre c)
{
    if ((PAPER & 2) == 0)
        return c.own.y > 0.0 ? (c.own.x * pc.depth_mm + pc.fixed_mm) / c.own.y : 0.0;
    // Derivatives are those of a quad of 2 x 2 pixels. If the other pixel is not on this surface, their limit.
    const ivec2 at = c.p + ivec2(pc.x0, pc.y0);
    const ivec2 q = c.p + along(((AXIS == 0 ? at.x : at.y) & 1) == 1 ? -1 : 1);
    float change = pc.maxdd;
    if (is_inside(q) && from[pixel_at(q)].w == c.light.w)
        change = min(abs(geometry[pixel_at(q)].x - c.own.x) * pc.unit, pc.maxdd);
    const float level = pc.orthographic != 0 ? 1.0 : c.own.x * pc.unit;
    return level / (level + pc.correction * change);
}

// Seven bilinear taps over +-span; those outside the mask are left out.
vec3 blur_paper(const Centre c, float added)
{
    const float weights[7] = float[](0.006, 0.061, 0.242, 0.382, 0.242, 0.061, 0.006);
    const float span = min(SCREEN_SPAN * sqrt(added * c.scale) * paper_slope(c), 262144.0);
    vec3 light = vec3(0.0);
    float total_weight = 0.0;

    for (int t = 0; t < 7; t++) {
        const float offset = float(t - 3) * (1.0 / 3.0) * span, base = floor(offset), between = offset - base;
        for (int k = 0; k < 2; k++) {
            const ivec2 q = c.p + along(int(base) + k);
            const float fraction = weights[t] * (k == 0 ? 1.0 - between : between);
            if (!is_inside(q) || from[pixel_at(q)].w != c.light.w)
                continue;
            total_weight += fraction;
            light += fraction * from[pixel_at(q)].rgb;
        }
    }
    return light / total_weight;
}

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    const int i = pixel_at(p);

    if (!is_inside(p))
        return;
    const vec4 light = from[i];
    if (!(light.w > 0.0)) {
        to[i] = vec4(0.0);
        return;
    }
    const Centre c = Centre(p, geometry[i], AXIS == 1 ? across[i].y : 0.0, scale[i], light);
    const int material = int(light.w), cells = pc.width / BLOCK * pc.height;
    const ivec4 plan = PAPER != 0 ? ivec4(0, 0, 0, floatBitsToInt(-1.0))
                                  : plans[((pc.step - pc.planned) * 2 + AXIS) * cells + i / BLOCK];
    vec2 mm2 = intBitsToFloat(plan.zw);
    if (mm2.y < 0.0)
        mm2.y = applied(pc.step, material, c.scale, mm2.x) ? variance_of(pc.step, material) : 0.0;
    const bool on = mm2.y > 0.0;
    const vec3 result = !on ? light.rgb : PAPER != 0 ? blur_paper(c, mm2.y - mm2.x) : blur_surface(c, plan, mm2);
    if (AXIS == 1) {
        // Where a pixel skipped the step, its weight goes to the last result or, as in the paper, to the whole sum.
        vec3 fraction = pc.whole != 0 ? vec3(1.0) : table[(pc.base + pc.step) * pc.row + material].rgb;
        if (PAPER != 0 && !on)
            fraction = vec3(0.0);
        sum[i] = vec4(mix(sum[i].rgb, result, fraction), 0.0);
    }
    if (AXIS == 0 || pc.step + 1 < pc.end)
        to[i] = vec4(result, light.w);
}
