// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// surface.comp - camera rays of a batch of tiles, and the surface at their hits: point, normals and material. Mirror of surface/hits16.h,
// and of load in irradiance/kernel.c.
//   in  0 nodes     of visibility/wide_bvh.h
//   in  1 triangles
//   in  2 meshes    of the scene
//   in  3 corners   as transmission.comp has them
//   in  4 materials in the format of the stage "irradiance"
//   in  5 surface_materials  in the format of this stage
//   in  6 frame
//   in  7 keys      per mesh: material index of the method
//   in  8 attributes of vertices, and 9 maps: see buffers.c; only if the frame has maps
//   out 10 points
//   out 11 hits
//   out 12 method_hits   13 method_bases: hits and base colours of the image, for the methods that read them
layout(local_size_x = 64) in;
#include "render/picture/device_data.h"
#include "shared/camera.h"
#include "shared/color_share.h"
#include "shared/hash.h"
#include "shared/sampling.h"
layout(set = 0, binding = 0) readonly buffer Nodes { uvec4 bvh_nodes[]; };
layout(set = 0, binding = 1) readonly buffer Triangles { uvec4 bvh_triangles[]; };
layout(set = 0, binding = 2) readonly buffer Meshes { pell_lit_mesh meshes[]; };
layout(set = 0, binding = 3) readonly buffer Corners { uint corners[]; };
layout(set = 0, binding = 4) readonly buffer Lit { pell_lit_material materials[]; };
layout(set = 0, binding = 5) readonly buffer Materials { pell_picture_material surface_materials[]; };
layout(set = 0, binding = 6) readonly buffer Frame { pell_picture_frame fr; };
layout(set = 0, binding = 7) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 8) readonly buffer Attributes { uint attributes[]; };
layout(set = 0, binding = 9) readonly buffer Maps { uint maps[]; };
layout(set = 0, binding = 10) buffer Points { pell_lit_point points[]; };
layout(set = 0, binding = 11) writeonly buffer Hits { pell_picture_hit hits[]; };
layout(set = 0, binding = 12) writeonly buffer MethodHits { uvec4 method_hits[]; };
layout(set = 0, binding = 13) writeonly buffer Bases { vec4 method_bases[]; };
layout(push_constant) uniform Push { pell_picture_push pc; };
#include "visibility/wide_bvh.glsl"
#include "render/picture/maps.glsl"
#include "render/picture/pixels.glsl"

const float FAR = 3.402823466e38; // FLT_MAX
const float NEAREST = 1e-6;       // mm: depth is positive
const float GRAZING = 0.0625;     // see hits16.h

struct SurfaceHit {
    vec3 corner[3], normals[3]; // positions and vertex normals of the triangle's corners
    vec3 weight;                // barycentric
    vec3 view;                  // unit, to the camera
    vec3 ng, ns;                // geometric and shading normal, on the viewer's side
    float terminator_offset;
    bool back; // the corners run clockwise, seen from the camera
    SurfacePoint point;
    float bumps;  // slope variance of the normal map inside the pixel,
    float slope_variance; // and of the surface
};

// Material parameters at a pixel.
struct MaterialValues {
    vec3 base, specular, emissive;
    vec4 sheet; // of struct pell_picture_hit
    float roughness, metallic, strength;
};

Ray camera_ray(Pixel p)
{
    const float x = pell_camera_right(float(p.x), fr.right.w, float(fr.width), fr.origin.w);
    const float y = pell_camera_up(float(p.y), fr.up.w, float(fr.height), fr.origin.w);
    const vec3 offset = fr.right.xyz * x + fr.up.xyz * y;

    if ((fr.flags & PELL_PICTURE_ORTHOGRAPHIC) != 0u)
        return Ray(fr.origin.xyz + offset, NEAREST, fr.forward.xyz, FAR, RAY_CAMERA);
    return Ray(fr.origin.xyz, NEAREST, fr.forward.xyz + offset, FAR, RAY_CAMERA);
}

// Unit geometric normal on the viewer's side; the direction to the viewer if the triangle has no area.
vec3 geometric_normal(SurfaceHit s)
{
    const vec3 n = cross(s.corner[1] - s.corner[0], s.corner[2] - s.corner[0]);
    const float largest = max(max(abs(n.x), abs(n.y)), abs(n.z));
    const vec3 g = largest > 0.0 ? n / largest : s.view;
    const float inverse = 1.0 / sqrt(dot(g, g));

    return g * (dot(g, s.view) < 0.0 ? -inverse : inverse);
}

// Distance along the normal from the point to the smooth surface over its triangle.
float terminator_offset(SurfaceHit s)
{
    vec3 at = vec3(0.0), sum = vec3(0.0);

    for (int k = 0; k < 3; k++)
        at += s.weight[k] * s.corner[k];
    for (int k = 0; k < 3; k++) {
        const float side = dot(s.normals[k], s.ng) < 0.0 ? -1.0 : 1.0; // seen from inside, the normals are flipped
        sum += side * s.weight[k] * abs(dot(s.corner[k] - at, s.normals[k])) * s.normals[k];
    }
    return max(dot(sum, s.ng), 0.0);
}

// The nearest normal that faces `to`.
vec3 bend(vec3 n, vec3 to)
{
    const float missing = pell_bend_missing(dot(n, to));

    return missing > 0.0 ? normalize(n + missing * to) : n;
}

bool is_mapped()
{
    return (fr.flags & PELL_PICTURE_MAPPED) != 0u;
}

vec3 shading_normal(Sampled found, inout SurfaceHit s)
{
    const vec3 sum = s.weight[0] * s.normals[0] + s.weight[1] * s.normals[1] + s.weight[2] * s.normals[2];
    vec3 n = dot(sum, sum) > 1e-8 ? sum * (1.0 / sqrt(dot(sum, sum))) : s.ng;
    const float side = dot(n, s.ng) < 0.0 ? -1.0 : 1.0; // the whole shading frame is flipped, after normal mapping

    s.bumps = 0.0;
    if (is_mapped())
        n = mapped_normal(found, s.point, n, surface_materials[s.point.material].normal_scale, s.bumps);
    return bend(bend(side * n, s.ng), s.view);
}

// Slope variance of the smooth surface inside the pixel.
float slope_variance_of(SurfaceHit s, Ray ray, float depth)
{
    const vec3 a = s.corner[1] - s.corner[0], b = s.corner[2] - s.corner[0], n = cross(a, b), d = ray.direction;
    const float nn = dot(n, n), nd = dot(n, d), size = max(abs(nd), GRAZING * sqrt(dot(d, d) * nn)), facing = nd < 0.0 ? -size : size;
    const float pixel = depth * fr.depth_mm + fr.fixed_mm;
    float sum = 0.0;

    for (int k = 0; k < 2; k++) {
        const vec3 axis = k == 0 ? fr.right.xyz : fr.up.xyz, step = axis - dot(n, axis) / facing * d;
        const vec3 turn = dot(cross(step, b), n) / nn * (s.normals[1] - s.normals[0]) +
                          dot(cross(a, step), n) / nn * (s.normals[2] - s.normals[0]);
        sum += dot(turn, turn);
    }
    return pell_slope_variance(pixel * pixel * sum, fr.spread);
}

// Area of the pixel's footprint on the surface, over twice the triangle's area.
float footprint_of(SurfaceHit s, Ray ray, float depth)
{
    const float SMALLEST = 1.175494351e-38;
    const vec3 n = cross(s.corner[1] - s.corner[0], s.corner[2] - s.corner[0]);
    const float least = GRAZING * length(ray.direction) * length(n), pixel = depth * fr.depth_mm + fr.fixed_mm;

    return pixel * pixel / max(max(abs(dot(n, ray.direction)), least), SMALLEST);
}

SurfaceHit surface_at(Ray ray, Hit hit, out Sampled found)
{
    const pell_lit_mesh mesh = meshes[hit.mesh];
    SurfaceHit s;

    s.weight = vec3(1.0 - hit.u - hit.v, hit.u, hit.v);
    s.view = ray.direction * (-1.0 / sqrt(dot(ray.direction, ray.direction)));
    for (uint k = 0u; k < 3u; k++)
        s.corner[k] = uintBitsToFloat(bvh_triangles[3u * hit.at + k].xyz);
    s.ng = geometric_normal(s);
    s.back = dot(cross(s.corner[1] - s.corner[0], s.corner[2] - s.corner[0]), s.ng) < 0.0;
    s.point.mesh = hit.mesh;
    s.point.material = uint(mesh.material);
    s.point.weight = s.weight;
    s.point.footprint = footprint_of(s, ray, hit.t);
    for (uint k = 0u; k < 3u; k++) {
        s.point.corner[k] = corners[mesh.corners + 3u * hit.triangle + k];
        const uint at = mesh.normals + 3u * s.point.corner[k];
        s.normals[k] = mesh.normals == PELL_LIT_NONE ? s.ng : uintBitsToFloat(uvec3(corners[at], corners[at + 1u], corners[at + 2u]));
    }
    s.terminator_offset = terminator_offset(s);
    s.slope_variance = slope_variance_of(s, ray, hit.t);
    if (is_mapped())
        found = sample_maps(s.point);
    s.ns = shading_normal(found, s);
    return s;
}

// Material factors, maps and vertex colours: shade_material in hits16.h.
MaterialValues material_values(Sampled found, SurfaceHit s)
{
    const pell_picture_material m = surface_materials[s.point.material];
    MaterialValues values = MaterialValues(m.base.rgb, m.specular.rgb, m.emissive.rgb, m.sheet, m.specular.w, m.emissive.w, m.base.w);

    if (is_mapped()) {
        const SurfacePoint p = s.point;
        values.base *= found.map[MAP_BASE].rgb;
        if (has_attribute(p, COLOR))
            values.base *= interpolated(p, COLOR).rgb;
        values.roughness *= map_channel(found, p, MAP_ROUGHNESS);
        values.metallic *= values.metallic > 0.0 ? map_channel(found, p, MAP_METALLIC) : 1.0;
        values.roughness = pell_bumpy_roughness(values.roughness, s.bumps, (m.flags & PELL_PICTURE_LINEAR_WIDTH) != 0u ? 1 : 0);
        values.specular *= map_channel(found, p, MAP_RHO_S) * found.map[MAP_SPECULAR].rgb;
        values.strength *= map_channel(found, p, MAP_STRENGTH);
        if (values.emissive.r > 0.0 || values.emissive.g > 0.0 || values.emissive.b > 0.0)
            values.emissive *= found.map[MAP_EMISSIVE].rgb;
        if (m.sheet.w > 0.0)
            values.sheet *= vec4(found.map[MAP_TRANSMISSION_COLOR].rgb, map_channel(found, p, MAP_TRANSMISSION));
    }
    values.roughness = clamp(values.roughness, PELL_LIT_ROUGHNESS_MIN, 1.0);
    values.metallic = clamp(values.metallic, 0.0, 1.0);
    values.strength = clamp(values.strength, 0.0, 1.0);
    const float through = clamp(values.sheet.w, 0.0, 1.0);
    values.sheet = vec4(values.sheet.rgb * (through * (1.0 - values.metallic)), 1.0 - through);
    return values;
}

vec3 applied_color(vec3 base, float exponent)
{
    return vec3(pell_color_share(base.r, exponent), pell_color_share(base.g, exponent), pell_color_share(base.b, exponent));
}

// Writes the far side of a thin sheet as a point.
void write_far_side(uint i, uint at)
{
    points[at].position = points[i].position;
    points[at].geometric = vec4(-points[i].geometric.xyz, 0.0);
    points[at].normal = vec4(-points[i].normal.xyz, points[i].normal.w);
    points[at].view = points[i].view;
    points[at].tint = points[i].tint;
    points[at].f0 = points[i].f0;
    points[at].hash0 = points[i].hash0;
    points[at].hash1 = points[i].hash1;
    points[at].curve = points[i].curve;
    points[at].first = points[i].first;
    points[at].material = points[i].material;
    points[at].flags = (points[i].flags & ~PELL_LIT_STRAIGHT) ^ PELL_LIT_BACK;
    points[at].sample_index = points[i].sample_index;
    points[at].slope_variance = points[i].slope_variance;
}

void main()
{
    const uint i = gl_GlobalInvocationID.x;
    const Pixel p = pixel_of(i);
    Hit hit;

    if (i >= 64u * pc.count)
        return;
    points[i].material = PELL_LIT_NONE;
    if (pc.far_sides != 0u)
        points[i + pc.far_sides].material = PELL_LIT_NONE;
    const Ray ray = camera_ray(p);
    if (!p.inside || !trace_ray(ray, false, hit))
        return;
    const uint material = uint(meshes[hit.mesh].material), x = uint(p.x), y = uint(p.y), seed = pell_hash(fr.seed);
    const uint block = pell_hash(x >> PELL_CURVE_LEVELS ^ pell_hash(y >> PELL_CURVE_LEVELS ^ seed));
    const pell_picture_material m = surface_materials[material];
    Sampled found;
    const SurfaceHit s = surface_at(ray, hit, found);
    const MaterialValues values = material_values(found, s);
    const vec3 position = ray.origin + hit.t * ray.direction, far = abs(position), solid = values.base * (1.0 - values.metallic);
    const bool is_opaque = (m.flags & PELL_PICTURE_OPAQUE) != 0u, textured = (m.flags & PELL_PICTURE_TEXTURED) != 0u;

    points[i].position = vec4(position, 6e-6 * (max(max(far.x, far.y), far.z) + hit.t));
    points[i].geometric = vec4(s.ng, s.terminator_offset);
    points[i].normal = vec4(s.ns, values.roughness);
    points[i].view = vec4(s.view, 0.0);
    points[i].tint = vec4(values.specular, 0.0);
    points[i].f0 = vec4(materials[material].fd + values.metallic * (values.base - materials[material].fd), 0.0);
    points[i].hash0 = pell_hash(block ^ 0x68bc21ebu);
    points[i].hash1 = pell_hash(block ^ 0x02e5be93u);
    points[i].curve = pell_pixel_curve(x, y, seed);
    points[i].first = pell_hash(x ^ pell_hash(y ^ seed));
    points[i].material = material;
    points[i].flags = ((fr.flags & PELL_PICTURE_SKY) != 0u ? PELL_LIT_AMBIENT : 0u) | PELL_LIT_STRAIGHT | PELL_LIT_SEEN |
                      (s.back ? PELL_LIT_BACK : 0u) | (fr.flags & PELL_LIT_TOGETHER);
    points[i].sample_index = fr.sample_index;
    points[i].slope_variance = s.slope_variance;
    hits[i].albedo = vec4(is_opaque ? solid : textured ? applied_color(values.base, m.total.w) : vec3(1.0), hit.t);
    hits[i].exit_color = vec4(textured ? applied_color(values.base, m.exit_base.w) : vec3(1.0), values.strength);
    hits[i].emissive = vec4(values.emissive, uintBitsToFloat(keys[hit.mesh]));
    hits[i].sheet = values.sheet;
    if (m.sheet.w > 0.0)
        write_far_side(i, i + pc.far_sides);
    hits[i].mesh = hit.mesh;
    hits[i].triangle = hit.triangle;
    hits[i].u = hit.u;
    hits[i].v = hit.v;
    if ((fr.flags & PELL_PICTURE_HITS) != 0u)
        method_hits[p.at] = uvec4(hit.mesh, hit.triangle, floatBitsToUint(vec2(hit.u, hit.v)));
    if ((fr.flags & PELL_PICTURE_BASES) != 0u)
        method_bases[p.at] = vec4(values.base, 0.0);
}
