// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// read.comp - the final lookup: pixels of a solid read its map at their surface points; mirror of read_map.c.
//   in  0 light    irradiance that enters (W/m^2)
//   in  1 surface  material (0: not translucent)
//   in  2 points   mesh, triangle, barycentric coordinates (bits of floats)
//   in  3 layout   per mesh its first triangle, or a mark that it is not of the solid; then per triangle x, y of its corners in texels
//                  (bits of floats), and its chart (0: none)
//   in  4 map      radiant exitance; chart
//   out 5 result   radiant exitance, W/m^2
layout(local_size_x = 16, local_size_y = 8) in;
layout(set = 0, binding = 0) readonly buffer Light { vec4 light[]; };
layout(set = 0, binding = 1) readonly buffer Surface { uvec2 surface[]; };
layout(set = 0, binding = 2) readonly buffer Points { uvec4 points[]; };
layout(set = 0, binding = 3) readonly buffer Layout { uint words[]; };
layout(set = 0, binding = 4) readonly buffer Map { vec4 map[]; };
layout(set = 0, binding = 5) writeonly buffer Result { vec4 result[]; };
#include "methods/texture_space/push.h"
layout(push_constant) uniform Push { ts_read_push pc; };

const uint NONE = 0xffffffffu;

// struct ts_bilinear: the lower left one of four texels, and the position between them.
struct Location {
    int x, y;
    float key;
    vec2 fraction;
};

bool find_location(uint t, vec2 uv, out Location p)
{
    const uint at = uint(pc.meshes) + 7u * t;
    const float w = 1.0 - uv.x - uv.y;
    vec2 sum = vec2(-0.5);

    for (uint k = 0u; k < 3u; k++)
        sum += (k == 0u ? w : k == 1u ? uv.x : uv.y) * uintBitsToFloat(uvec2(words[at + 2u * k], words[at + 2u * k + 1u]));
    const vec2 low = floor(sum);
    p = Location(int(low.x), int(low.y), float(words[at + 6u]), sum - low);
    return words[at + 6u] != 0u && low.x >= 0.0 && low.y >= 0.0 && low.x < float(pc.width) && low.y < float(pc.height - 1);
}

vec4 texel(int x, int y)
{
    return map[pc.origin + y * pc.stride + x];
}

// If none of the four texels around is valid: the mean of the nearest valid ones, of the same chart or else of any.
vec3 look_around(Location p)
{
    for (int any = 0; any < 2; any++)
        for (int reach = 1; reach <= 4; reach++) {
            vec4 sum = vec4(0.0);
            for (int y = max(p.y - reach + 1, 0); y <= min(p.y + reach, pc.height - 1); y++)
                for (int x = max(p.x - reach + 1, 0); x <= min(p.x + reach, pc.width - 1); x++) {
                    const vec4 t = texel(x, y);
                    sum += (any != 0 ? t.w > 0.0 : t.w == p.key) ? vec4(t.rgb, 1.0) : vec4(0.0);
                }
            if (sum.w > 0.0)
                return sum.rgb / sum.w;
        }
    return vec3(0.0);
}

vec3 read_map(Location p)
{
    vec4 sum = vec4(0.0);

    for (int k = 0; k < 4; k++) {
        const vec4 t = texel(p.x + k % 2, p.y + k / 2);
        const float w = (k % 2 != 0 ? p.fraction.x : 1.0 - p.fraction.x) * (k >= 2 ? p.fraction.y : 1.0 - p.fraction.y);
        sum += t.w == p.key ? w * vec4(t.rgb, 1.0) : vec4(0.0);
    }
    return sum.w > 1e-6 ? sum.rgb / sum.w : look_around(p);
}

void main()
{
    const ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    const int at = pixel.y * pc.pitch + pixel.x;
    Location location;

    if (pixel.x >= pc.pitch || pixel.y >= pc.rows)
        return;
    const bool covered = surface[at].x != 0u;
    const uint mesh = covered ? points[at].x : NONE, first = mesh < uint(pc.meshes) ? words[mesh] : NONE;
    if (first == NONE) {
        if (pc.clear != 0)
            result[at] = vec4(0.0);
        return;
    }
    const vec3 scattered = find_location(first + points[at].y, uintBitsToFloat(points[at].zw), location) ? read_map(location) : vec3(0.0);
    result[at] = vec4(scattered + vec3(pc.unblurred_r, pc.unblurred_g, pc.unblurred_b) * light[at].rgb, 0.0);
}
