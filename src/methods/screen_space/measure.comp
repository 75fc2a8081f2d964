// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// measure.comp - how the surface lies below each pixel; mirror of the first half of measure.c. Tx, Ty: from the pixel's point on the
// surface to the next one along x and y.
//   in  0 place    depth (mm), material, px^2 per mm^2, 0
//   out 1 slopes   Tx.Tx, Ty.Ty, Tx.Ty (mm^2); 1 where depth jumps or creases, else 0
layout(local_size_x = 16, local_size_y = 8) in;
layout(set = 0, binding = 0) readonly buffer Place { vec4 place[]; };
layout(set = 0, binding = 1) writeonly buffer Slopes { vec4 slopes[]; };
#include "methods/screen_space/common.glsl"

vec2 neighbour(ivec2 p) // depth, material
{
    return is_inside(p) ? place[pixel_at(p)].xy : vec2(0.0);
}

// Change of depth per pixel: the central difference, but at most twice the smaller one-sided one (van Leer 1977).
float limited(float back, float ahead, bool has_back, bool has_ahead)
{
    const float a = has_back ? back : ahead, b = has_ahead ? ahead : back;
    const float least = 2.0 * min(abs(a), abs(b)), mean = 0.5 * (a + b), low = min(abs(mean), least);

    return (has_back || has_ahead) && a * b > 0.0 ? (mean < 0.0 ? -low : low) : 0.0;
}

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);

    if (!is_inside(p))
        return;
    const vec2 own = neighbour(p);
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
    const bool rough = max(max(abs(left), abs(right)), max(abs(above), abs(under))) > mm * JUMP ||
                       max(abs(right - left), abs(under - above)) > mm * CREASE;

    slopes[pixel_at(p)] = vec4(on ? vec3(x2, y2, both) : vec3(0.0), rough ? 1.0 : 0.0);
}
