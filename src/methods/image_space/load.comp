// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// load.comp - the camera's irradiance image: light of each pixel and the plane visible in it. T. Mertens et al., "Efficient Rendering of
// Local Subsurface Scattering", 2003; mirror of measure.c.
//   in  0 light    irradiance (W/m^2), depth (mm)
//   in  1 surface  material (0: not translucent), strength (bits of a float)
//   in  2 solids   solid + 1 if these are the keys; else unused
//   out 3 texels   see common.glsl
layout(local_size_x = 16, local_size_y = 8) in;
layout(set = 0, binding = 0) readonly buffer Light { vec4 light[]; };
layout(set = 0, binding = 1) readonly buffer Surface { uvec2 surface[]; };
layout(set = 0, binding = 2) readonly buffer Solids { uint solids[]; };
layout(set = 0, binding = 3) writeonly buffer Texels { vec4 texels[]; };
#include "methods/image_space/common.glsl"

// Key (0: none) and w.
vec2 seen_at(ivec2 p)
{
    if (!is_inside(p) || pc.x0 + p.x >= pc.image_width)
        return vec2(0.0, 1.0);
    const int i = pixel_at(p);
    const uint m = surface[i].x <= uint(pc.materials) ? surface[i].x : 0u;
    const float z = m != 0u ? light[i].w : 1.0, safe = z > 1e-30 && z < 1e30 ? z : 1.0;

    return vec2(float(m != 0u && pc.solids != 0 ? solids[i] : m), pc.orthographic != 0 ? safe : 1.0 / safe);
}

// Derivative of w from a pixel to the next along `step_dir`: the mean of both sides, limited to twice the smaller one, so that a depth
// discontinuity is no slope; one-sided if only that side is on the same object.
float rise(ivec2 p, ivec2 step_dir, vec2 own)
{
    const vec2 before = seen_at(p - step_dir), after = seen_at(p + step_dir);
    const float low = own.y - before.y, high = after.y - own.y, most = 2.0 * min(abs(low), abs(high));

    if (before.x == own.x)
        return after.x == own.x ? max(min(0.5 * (low + high), most), -most) : low;
    return after.x == own.x ? high : 0.0;
}

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    const int i = pixel_at(p);

    if (!is_inside(p))
        return;
    const vec2 own = seen_at(p);
    if (own.x == 0.0) {
        texels[2 * i] = texels[2 * i + 1] = vec4(0.0);
        return;
    }
    const bool parallel = pc.orthographic != 0;
    const vec2 t = parallel ? vec2(0.0) : ray_of(p);
    vec2 slope = pc.focal_px * vec2(rise(p, ivec2(1, 0), own), rise(p, ivec2(0, 1), own));
    const float most = IS_SLOPE_MAX * (parallel ? 1.0 : own.y) / sqrt(t.x * t.x + (t.y * t.y + 1.0));
    float ahead = parallel ? -1.0 : own.y - slope.x * t.x - slope.y * t.y;
    const float norm = sqrt(slope.x * slope.x + slope.y * slope.y + ahead * ahead);

    slope *= norm > most ? most / norm : 1.0;
    ahead = parallel ? -1.0 : own.y - slope.x * t.x - slope.y * t.y;
    texels[2 * i] = vec4(own.y, slope / pc.focal_px, own.x);
    texels[2 * i + 1] = vec4(light[i].rgb, sqrt(slope.x * slope.x + slope.y * slope.y + ahead * ahead));
}
