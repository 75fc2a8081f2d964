// SPDX-License-Identifier: MIT
// maps.glsl - trilinear lookups of a material's maps at a pixel's hit. Mirror of surface/sample16.h, and of look_up in surface/hits16.h. A
// file that includes it declares the buffers `uint attributes[]` and `uint maps[]` (pell_mips_words).
#include "shared/texture.h"

#define MAPS 10u // PELL_MAPS
const uint MAP_BASE = 0u, MAP_NORMAL = 1u, MAP_ROUGHNESS = 2u, MAP_METALLIC = 3u, MAP_RHO_S = 4u, MAP_SPECULAR = 5u, MAP_STRENGTH = 6u,
           MAP_EMISSIVE = 7u, MAP_TRANSMISSION = 8u, MAP_TRANSMISSION_COLOR = 9u;
const uint TANGENT = 4u, COLOR = 5u; // slots of a mesh's attributes, after four UV sets

// Surface point of a map lookup.
struct SurfacePoint {
    uint mesh, material;
    uint corner[3]; // vertices
    vec3 weight;
    float footprint; // area of the pixel on the surface, over twice the triangle's area
};

float vertex_float(uint at)
{
    return uintBitsToFloat(attributes[at]);
}

bool has_attribute(SurfacePoint p, uint which)
{
    return attributes[8u * p.mesh + which] != PELL_LIT_NONE;
}

// Interpolates a vertex attribute of four floats.
vec4 interpolated(SurfacePoint p, uint which)
{
    const uint first = attributes[8u * p.mesh + which];
    vec4 sum = vec4(0.0);

    for (uint k = 0u; k < 3u; k++) {
        const uint at = first + 4u * p.corner[k];
        sum += p.weight[k] * vec4(vertex_float(at), vertex_float(at + 1u), vertex_float(at + 2u), vertex_float(at + 3u));
    }
    return sum;
}

// Texture coordinates, and the area of the pixel in the texture's unit square.
vec3 coordinates(SurfacePoint p, uint uv_set)
{
    const uint first = attributes[8u * p.mesh + uv_set];
    vec2 uv[3];

    for (uint k = 0u; k < 3u; k++)
        uv[k] = vec2(vertex_float(first + 2u * p.corner[k]), vertex_float(first + 2u * p.corner[k] + 1u));
    const vec2 a = uv[1] - uv[0], b = uv[2] - uv[0];
    return vec3(p.weight[0] * uv[0] + p.weight[1] * uv[1] + p.weight[2] * uv[2], abs(a.x * b.y - b.x * a.y) * p.footprint);
}

// A texel, decoded to linear values.
vec4 texel(uint image, uint level, uint at)
{
    const uint kind = maps[image + 3u], first = maps[image + 4u + 3u * level];

    if (level == 0u && (kind & 1u) != 0u) {
        const uvec4 rgba = uvec4(maps[first + at]) >> uvec4(0u, 8u, 16u, 24u) & 255u;
        const uint table = (kind & 2u) != 0u ? 0u : 256u;
        return (1.0 / 65535.0) * vec4(uvec4(maps[table + rgba.r], maps[table + rgba.g], maps[table + rgba.b], maps[256u + rgba.a]));
    }
    if ((kind & (level == 0u ? 4u : 8u)) != 0u) {
        const uint f = first + 4u * at;
        return uintBitsToFloat(uvec4(maps[f], maps[f + 1u], maps[f + 2u], maps[f + 3u]));
    }
    const uint low = maps[first + 2u * at], high = maps[first + 2u * at + 1u];
    return (1.0 / 65535.0) * vec4(uvec4(low & 65535u, low >> 16, high & 65535u, high >> 16));
}

// Bilinear interpolation of four texels; `nearest`: the nearest texel.
vec4 bilinear(uint image, uint level, vec2 uv, uint wrap_u, uint wrap_v, bool nearest)
{
    const int width = int(maps[image + 5u + 3u * level]), height = int(maps[image + 6u + 3u * level]);
    pell_texels x = pell_texels_of(int(wrap_u), uv.x, width), y = pell_texels_of(int(wrap_v), uv.y, height);
    vec4 sum = vec4(0.0);

    if (nearest) {
        x.f = x.f >= 0.5 ? 1.0 : 0.0;
        y.f = y.f >= 0.5 ? 1.0 : 0.0;
    }
    for (int k = 0; k < 4; k++) {
        const float w = ((k & 1) != 0 ? x.f : 1.0 - x.f) * (k >= 2 ? y.f : 1.0 - y.f);
        sum += w * texel(image, level, uint((k >= 2 ? y.b : y.a) * width + ((k & 1) != 0 ? x.b : x.a)));
    }
    return sum;
}

uint map_row(SurfacePoint p, uint which)
{
    return 512u + 8u * (MAPS * p.material + which);
}

float map_float(uint row, uint k)
{
    return uintBitsToFloat(maps[row + 2u + k]);
}

// The pixel's area in texels of the full size, at least 1.
float texels_covered(uint row, float area)
{
    const float matrix = abs(map_float(row, 0u) * map_float(row, 4u) - map_float(row, 1u) * map_float(row, 3u));

    return area * matrix * float(maps[maps[row] + 1u]) * float(maps[maps[row] + 2u]);
}

// Samples a map; 1 if the material has no such map or the mesh no such UV set.
vec4 look_up(SurfacePoint p, uint which)
{
    const uint row = map_row(p, which), image = maps[row], how = maps[row + 1u];
    vec4 rgba = vec4(0.0);

    if (image == PELL_LIT_NONE || !has_attribute(p, how & 255u))
        return vec4(1.0);
    const vec3 at = coordinates(p, how & 255u);
    vec2 uv = vec2(map_float(row, 0u) * at.x + map_float(row, 1u) * at.y + map_float(row, 2u),
                   map_float(row, 3u) * at.x + map_float(row, 4u) * at.y + map_float(row, 5u));
    uv = vec2(abs(uv.x) < 16777216.0 ? uv.x : 0.0, abs(uv.y) < 16777216.0 ? uv.y : 0.0);
    const bool nearest = (how & 1024u) != 0u;
    const pell_mip_levels mip = pell_mip_levels_of(max(texels_covered(row, at.z), 1.0), nearest ? 0.0 : float(int(maps[image]) - 1));
    for (int k = 0; k < (mip.blend > 0.0 ? 2 : 1); k++)
        rgba += (k == 0 ? 1.0 - mip.blend : mip.blend) *
                bilinear(image, uint(k == 0 ? mip.lower : mip.upper), uv, how >> 16 & 255u, how >> 24, nearest);
    return rgba;
}

// Samples all maps, in a loop, so that drivers compile the lookup once.
struct Sampled {
    vec4 map[MAPS];
};

Sampled sample_maps(SurfacePoint p)
{
    Sampled found;

    for (uint which = 0u; which < MAPS; which++)
        found.map[which] = look_up(p, which);
    return found;
}

// One channel of a linear map.
float map_channel(Sampled found, SurfacePoint p, uint which)
{
    return found.map[which][maps[map_row(p, which) + 1u] >> 8 & 3u];
}

// The normal after the normal map (glTF 2.0, section 3.9.3). `bumps`: slope variance of the map inside the pixel.
vec3 mapped_normal(Sampled found, SurfacePoint p, vec3 n, float scale, out float bumps)
{
    const uint row = map_row(p, MAP_NORMAL);
    const vec3 mapped = 2.0 * found.map[MAP_NORMAL].rgb - 1.0;

    bumps = 0.0;
    if (maps[row] == PELL_LIT_NONE || !has_attribute(p, maps[row + 1u] & 255u) || !has_attribute(p, TANGENT))
        return n;
    const vec4 tangent = interpolated(p, TANGENT);
    const float tt = dot(tangent.xyz, tangent.xyz);
    bumps = pell_bumps(dot(mapped, mapped), texels_covered(row, coordinates(p, maps[row + 1u] & 255u).z), scale);
    const vec3 t = tangent.xyz * (tt > 0.0 ? 1.0 / sqrt(tt) : 0.0), b = (tangent.w < 0.0 ? -1.0 : 1.0) * cross(n, t);
    const vec3 sum = scale * mapped.x * t + scale * mapped.y * b + mapped.z * n;
    return tt > 0.0 && dot(sum, sum) > 1e-8 ? sum * (1.0 / sqrt(dot(sum, sum))) : n;
}
