// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// measure.comp - surface metric at each pixel, and the summary of a block of 16 pixels of a row, which is a row of a workgroup; mirror of
// the first half of measure.c. Tx, Ty: from the pixel's surface point to the next one along x and y.
//   in  0 surface  depth (mm), material
//   in  1 scale    px^2 per mm^2
//   out 2 slopes   Tx.Tx, Ty.Ty, Tx.Ty (mm^2), 0
//   out 3 cells    mean skew of the second pass (decrease of x in pixels per pixel of y); 0: nothing is translucent, 1: some pixels are,
//                  2: all are of one material, without depth discontinuities and creases
layout(local_size_x = 16, local_size_y = 8) in;
layout(set = 0, binding = 0) readonly buffer Surface { vec2 surface[]; };
layout(set = 0, binding = 1) readonly buffer Scale { float scale[]; };
layout(set = 0, binding = 2) writeonly buffer Slopes { vec4 slopes[]; };
layout(set = 0, binding = 3) writeonly buffer Cells { vec2 cells[]; };
#include "methods/screen_space/common.glsl"

shared float skews[8][16];
shared uint flags[8][16]; // bits FULL, BLURRED, ROUGH, OTHER
const uint FULL = 1u, BLURRED = 2u, ROUGH = 4u, OTHER = 8u;

vec2 neighbour(ivec2 p) // depth, material
{
    return is_inside(p) ? surface[pixel_at(p)] : vec2(0.0);
}

// Change of depth per pixel: the central difference, limited to twice the smaller one-sided one (van Leer 1977).
float limited(float back, float ahead, bool has_back, bool has_ahead)
{
    const float a = has_back ? back : ahead, b = has_ahead ? ahead : back;
    const float least = 2.0 * min(abs(a), abs(b)), mean = 0.5 * (a + b), low = min(abs(mean), least);

    return (has_back || has_ahead) && a * b > 0.0 ? (mean < 0.0 ? -low : low) : 0.0;
}

vec3 slopes_at(ivec2 p, vec2 own, out bool rough)
{
    const float z = own.x, mm = z * pc.depth_mm + pc.fixed_mm;
    const vec2 l = neighbour(p - ivec2(1, 0)), r = neighbour(p + ivec2(1, 0));
    const vec2 u = neighbour(p - ivec2(0, 1)), d = neighbour(p + ivec2(0, 1));
    const float left = z - l.x, right = r.x - z, above = z - u.x, under = d.x - z;
    const float dx = limited(left, right, l.y == own.y, r.y == own.y), dy = limited(above, under, u.y == own.y, d.y == own.y);
    const vec2 t = ray_of(p);
    const float ray2 = 1.0 + dot(t, t);
    const float x2 = STEP_LENGTH2(mm, dx, t.x, ray2), y2 = STEP_LENGTH2(mm, dy, t.y, ray2);
    const float both = STEP_PRODUCT(mm, dx, dy, t.x, t.y, ray2);
    const bool on = own.y > 0.0 && z > 0.0 && x2 > 0.0 && y2 > 0.0;

    rough = max(max(abs(left), abs(right)), max(abs(above), abs(under))) > mm * JUMP ||
            max(abs(right - left), abs(under - above)) > mm * CREASE;
    return on ? vec3(x2, y2, both) : vec3(0.0);
}

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    const uint x = gl_LocalInvocationID.x, y = gl_LocalInvocationID.y;
    const bool here = is_inside(p);

    skews[y][x] = 0.0;
    flags[y][x] = 0u;
    if (here) {
        const int i = pixel_at(p);
        const vec2 own = surface[i];
        bool rough = false;
        const vec3 s = own.y > 0.0 ? slopes_at(p, own, rough) : vec3(0.0);
        slopes[i] = vec4(s, 0.0);
        skews[y][x] = s.x > 0.0 ? s.z / s.x : 0.0;
        flags[y][x] = (own.y > 0.0 ? FULL : 0u) | (scale[i] > 0.0 ? BLURRED : 0u) | (rough ? ROUGH : 0u) |
                      (own.y != surface[i - int(x)].y ? OTHER : 0u);
    }
    barrier();
    if (!here || x != 0u)
        return;
    int blurred = 0;
    float skew = 0.0;
    uint all = FULL, any = 0u;
    for (int k = 0; k < BLOCK; k++) {
        skew += skews[y][k];
        blurred += (flags[y][k] & BLURRED) != 0u ? 1 : 0;
        all &= flags[y][k];
        any |= flags[y][k];
    }
    skew = blurred > 0 ? clamp(skew / float(blurred), -SKEW_MAX, SKEW_MAX) : 0.0;
    const bool smooth_all = all == FULL && (any & (ROUGH | OTHER)) == 0u;
    cells[pixel_at(p) / BLOCK] = vec2(skew, (any & FULL) == 0u ? 0.0 : smooth_all ? 2.0 : 1.0);
}
