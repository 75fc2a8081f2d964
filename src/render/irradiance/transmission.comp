// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// transmission.comp - light that goes straight through thin parts, one point per invocation: for each of a slice of the samples of lights
// behind the point, a ray to where the light enters the solid, and a shadow ray from there. Mirror of transmission.c, with the formulas of
// shared/thickness.h. See buffers.glsl, and:
//   in  9 corners    of all triangles, by their mesh's vertices; then all normals, bits of floats
//   in 10 parts      (object, material) of every mesh, sorted
//   in 11 thickness  tables as in struct pell_thickness_table: `value`, `slab`, `spread`, and `slab` without forward-scattered light, for
//                    lights (the CPU adds that light)
layout(local_size_x = 64) in;
#include "render/irradiance/buffers.glsl"
layout(set = 0, binding = 9) readonly buffer Corners { uint corners[]; };
layout(set = 0, binding = 10) readonly buffer Parts { ivec2 parts[]; };
layout(set = 0, binding = 11) readonly buffer Thickness { float thickness[]; };
#include "visibility/wide_bvh.glsl"
#include "render/irradiance/direct.glsl"
#include "render/irradiance/lit_rays.glsl"
#include "render/irradiance/through.glsl"
#include "shared/thickness.h"

const int SLAB = 1, SLAB_OF_LIGHTS = 3; // tables of a material
const int STEPS = 5; // of transmission.c
const int NO_OBJECT = -0x7fffffff - 1;

// Exit of a ray inside the solid.
struct Exit {
    vec3 position, geometric, normal;
    float terminator_offset; // mm, of the smooth surface above the triangle
};

struct Transmitted {
    vec3 light;
    float path; // path length of `light` in mm, times the sum of channels
    uint rays;
};

vec3 normal_of(pell_lit_mesh mesh, uint corner)
{
    const uint at = mesh.normals + 3u * corner;
    return uintBitsToFloat(uvec3(corners[at], corners[at + 1u], corners[at + 2u]));
}

// The interpolated normal, and the height of the smooth surface above the triangle.
void hit_surface(Hit hit, inout Exit exit)
{
    const pell_lit_mesh mesh = meshes[hit.mesh];
    const vec3 w = vec3(1.0 - hit.u - hit.v, hit.u, hit.v);
    vec3 at = vec3(0.0), n = vec3(0.0), sum = vec3(0.0), normals[3];

    exit.normal = exit.geometric;
    exit.terminator_offset = 0.0;
    if (mesh.normals == PELL_LIT_NONE)
        return;
    for (uint k = 0u; k < 3u; k++) {
        normals[k] = normal_of(mesh, corners[mesh.corners + 3u * hit.triangle + k]);
        at += w[k] * hit_corner(hit, k);
        n += w[k] * normals[k];
    }
    for (uint k = 0u; k < 3u; k++)
        sum += w[k] * abs(dot(hit_corner(hit, k) - at, normals[k])) * normals[k];
    n = normalize(n);
    if (dot(n, exit.geometric) > 0.0) {
        exit.normal = n;
        exit.terminator_offset = max(dot(sum, exit.geometric), 0.0);
    }
}

// pell_lights_part
bool is_part(int object, int material)
{
    uint low = 0u, high = pc.parts;

    while (low < high) {
        const uint middle = (low + high) / 2u;
        const ivec2 part = parts[middle];
        if (part == ivec2(object, material))
            return true;
        if (part.x < object || (part.x == object && part.y < material))
            low = middle + 1u;
        else
            high = middle;
    }
    return false;
}

// Object of the surface at the point: the hit of a short ray from above it.
int find_object(Point p, inout uint rays)
{
    const float e = 4.0 * points[p.at].position.w;
    Hit hit;

    rays++;
    return trace_ray(Ray(p.position + e * p.geometric, 0.0, -p.geometric, 2.0 * e, RAY_ALL), false, hit) ? meshes[hit.mesh].object
                                                                                                         : NO_OBJECT;
}

// Traces a ray to where it leaves the solid that it is in. Returns false if an opaque object or another solid is in between. `depth`:
// number of shells of the same object inside it that the ray is in, -1: it has yet to enter the solid.
bool find_exit(Point p, Ray ray, int depth, inout uint rays, out Exit exit)
{
    const float limit = ray.far;
    int object = NO_OBJECT;

    for (int step = 0; step < STEPS; step++) {
        Hit hit;
        rays++;
        if (!trace_ray(ray, false, hit))
            return false;
        const pell_lit_mesh mesh = meshes[hit.mesh];
        if (materials[mesh.material].opaque != 0 || !is_part(mesh.object, int(p.material)))
            return false;
        const vec3 a = hit_corner(hit, 0u), n = normalize(cross(hit_corner(hit, 1u) - a, hit_corner(hit, 2u) - a));
        const bool is_exit = dot(n, ray.direction) > 0.0;
        if (is_exit && depth == 0) {
            exit.position = ray.origin + hit.t * ray.direction;
            exit.geometric = n;
            hit_surface(hit, exit);
            return true;
        }
        depth += !is_exit ? 1 : depth > 0 ? -1 : 0;
        if (step == 0)
            object = find_object(p, rays);
        if (mesh.object != object)
            return false;
        ray.near = hit.t * (1.0 + 1e-5) + 1e-20;
        ray.far = limit;
    }
    return false;
}

// Transmitted fraction of the light at `exit`, by the table `slabs`; `d`: the thickness, mm.
vec3 transmitted_fraction(Point p, float d, Exit exit, float same, int slabs)
{
    const float counted = pell_thickness_counted(same, dot(exit.normal, points[p.at].view.xyz)), opposed = pell_thickness_opposed(same);
    const float coord = pell_thickness_coord(max(d, 0.0), materials[p.material].thickest, PELL_LIT_THICKNESS_STEPS);
    const int value = materials[p.material].thickness_at + 3 * pell_table_cell(coord, PELL_LIT_THICKNESS_STEPS);
    const int slab = value + 3 * slabs * PELL_LIT_THICKNESS_STEPS;
    vec3 fraction;

    for (int c = 0; c < 3; c++) {
        const float here = pell_lerp(thickness[value + c], thickness[slab + c], opposed);
        const float next = pell_lerp(thickness[value + 3 + c], thickness[slab + 3 + c], opposed);
        fraction[c] = counted * pell_thickness_transmission(here, next, coord, PELL_LIT_THICKNESS_STEPS);
    }
    return fraction;
}

// Factor of transmitted light over that of light scattered near the surface (render/angle.h).
vec3 exit_factor(Point p, float d)
{
    const pell_lit_material m = materials[p.material];
    const float off = 1.0 - pell_single_cosine(m.inverse_eta2, clamp(dot(p.normal, points[p.at].view.xyz), 0.0, 1.0));
    vec3 factor = vec3(1.0);

    for (int c = 0; c < 3 && (points[p.at].flags & PELL_LIT_SEEN) != 0u; c++)
        factor[c] = pell_thickness_exit(m.pass_per_mm[c], d, m.pass_base[c] + m.pass_slope[c] * off);
    return factor;
}

// One sample of a light behind the point.
void transmit(pell_light_data light, Point p, Aim a, inout Transmitted sums)
{
    const bool away = light.type == PELL_LIGHT_DATA_DIRECTIONAL, outside = a.gl > 0.0; // the path begins in air
    const float epsilon = points[p.at].position.w, cosine = pell_thickness_cosine(a.nl, a.gl);
    const float limit = materials[p.material].thickest / cosine; // d >= m cos: no transmission beyond
    const vec3 origin = outside ? p.origin : p.position - epsilon * p.geometric;
    Ray ray = Ray(origin, 0.0, away ? a.direction : a.end - origin, away ? limit : min(0.9999, limit / a.distance), RAY_ALL);
    Exit exit;

    if (!find_exit(p, ray, outside ? -1 : 0, sums.rays, exit))
        return;
    const vec3 beyond = exit.position + (exit.terminator_offset + epsilon) * exit.geometric;
    const vec3 to = away ? a.direction : a.end - beyond;
    const float far = away ? FAR : 0.9999;
    sums.rays++;
    if (!is_unoccluded(beyond, to, far))
        a.intensity *= (pc.flags & PELL_LIT_PASSES) != 0u ? pass_shadow(beyond, to, far, PELL_THROUGH_LEAST, sums.rays) : vec3(0.0);
    if (a.intensity.r + a.intensity.g + a.intensity.b <= 0.0)
        return;
    const bool lifted = exit.terminator_offset > TERMINATOR_LIFTED * epsilon; // the triangle does not decide the facing
    const float m = length(exit.position - p.position), same = dot(exit.normal, p.normal);
    const float mu = dot(exit.normal, a.direction), facing = dot(exit.geometric, a.direction);
    if (!(mu > 0.0) || !(facing > 0.0 || lifted))
        return;
    const float g = lifted ? 1.0 : pell_thickness_facing(facing, mu, dot(exit.normal, exit.geometric));
    const float d = pell_thickness_of(m, cosine, same);
    const float falloff = away   ? 1.0
                          : a.wide ? a.falloff
                                   : pell_light_falloff(max(a.distance - m, 1e-3), light.position.w, light.direction.w);
    const float w = pell_soft_terminator(transmittance(p, mu) * mu, g) * falloff;
    const vec3 arrives = min(a.intensity * w * transmitted_fraction(p, d, exit, same, SLAB_OF_LIGHTS), vec3(BIG));
    const vec3 exiting = arrives * exit_factor(p, d);
    sums.light += exiting;
    sums.path += d * (exiting.r + exiting.g + exiting.b);
}

// Adds the slice's samples of a light. Lights that take turns: only in their turn, and then for all of them.
void transmit_light(pell_light_data light, Point p, inout Transmitted sums)
{
    const uint turns = max(light.flags >> PELL_LIT_TURNS_AT & 255u, 1u), turn = light.flags >> PELL_LIT_TURN_AT & 255u;

    if (((points[p.at].curve + p.sample_index) & (turns - 1u)) != turn)
        return;
    light.environment = -1; // through its centre: aim_at_middle of cpu.c
    for (int s = int(pc.first); s < min(int(pc.last), light.samples); s++) {
        const uint n = p.sample_index * uint(light.samples) + uint(s);
        Aim a = aim(light, p, pell_sobol0(n), pell_sobol1(n));
        const bool lit = project_image(light, p, a) && a.falloff * (a.intensity.r + a.intensity.g + a.intensity.b) > 0.0;

        if (lit && !((a.gl > 0.0 || p.lifted) && a.nl > 0.0)) {
            a.intensity *= float(turns);
            transmit(light, p, a, sums);
        }
    }
}

// Straight transmission of the environment's smooth part in the slice: the transmitted fraction at `exit`, and its distance, mm.
float transmit_ambient(Point p, inout uint rays, out vec3 fraction, out Exit exit)
{
    const vec3 inward = dot(p.geometric, p.normal) > 0.5 ? p.normal : p.geometric;
    const vec3 origin = p.position - points[p.at].position.w * p.geometric;
    uint to_exit = 0u;

    fraction = vec3(0.0);
    if (!find_exit(p, Ray(origin, 0.0, -inward, materials[p.material].thickest, RAY_ALL), 0, to_exit, exit)) {
        rays += pc.sky == 0u ? to_exit : 0u; // each slice traces them, but they are counted once
        return 0.0;
    }
    const vec3 beyond = exit.position + (exit.terminator_offset + points[p.at].position.w) * exit.geometric;
    const float m = length(exit.position - p.position);
    const uvec2 pattern = pattern_at(p.at, pc.ambient_bits, PELL_BEYOND_SALT);
    const float seen = float(count_sky(beyond, exit.geometric, p.sample_index, pattern, rays)) / float(PELL_THROUGH_WHOLE);
    fraction = seen / float(pc.ambient_samples) * transmitted_fraction(p, m, exit, dot(exit.normal, p.normal), SLAB);
    rays += pc.sky == 0u ? to_exit : 0u;
    return m;
}

void store_result(uint at, vec3 rgb, uint word)
{
    results[at] = uvec4(floatBitsToUint(rgb), word);
}

void main()
{
    const uint i = gl_GlobalInvocationID.x, at = i * pc.results + pc.through;

    if (i >= pc.count || points[i].material == PELL_LIT_NONE || (points[i].flags & PELL_LIT_STRAIGHT) == 0u ||
        materials[points[i].material].thickness_at < 0)
        return;
    const bool start = (pc.flags & PELL_LIT_START) != 0u;
    Point p = load_point(i, false, false);
    const uvec4 before = start ? uvec4(0u) : results[at];
    Transmitted sums = Transmitted(uintBitsToFloat(before.rgb), uintBitsToFloat(before.a), start ? 0u : results[at + 2u].a);

    if (start)
        results[at + 1u] = uvec4(0u);
    if (pc.sky_end > pc.sky) {
        Exit exit = Exit(vec3(0.0), vec3(0.0), vec3(0.0), 0.0);
        vec3 fraction;
        const float m = transmit_ambient(p, sums.rays, fraction, exit);
        store_result(at + 1u, uintBitsToFloat(results[at + 1u].rgb) + fraction, floatBitsToUint(m));
        store_result(at + 2u, exit.normal, sums.rays);
        store_result(at, sums.light, floatBitsToUint(sums.path));
        return;
    }
    for (uint light = pc.light; light < pc.light_end; light++)
        if (is_requested(lights[light].light))
            transmit_light(lights[light], p, sums);
    store_result(at, sums.light, floatBitsToUint(sums.path));
    results[at + 2u].a = sums.rays;
}
