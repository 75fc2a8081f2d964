// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// finish.comp - combines the light of a batch's pixels into the planes of methods and composite. Mirror of cpu.c, device_light.c and
// inside.c of irradiance/ for light computed on the device, and of composite/kernel.c for the surface.
//   in  0 points    in 1 results   in 2 hits   in 3 insides, of the batch
//   in  4 materials in the format of the stage "irradiance"
//   in  5 surface_materials  in the format of the stage "surface"
//   in  6 tables    as in buffers.glsl, then mean albedos
//   in  7 frame
//   in  8 sky       pell_lights_environment_words, if there are environments
//   out 9 light     entering irradiance, and depth: the method's plane, or the input of highlights.comp where shadows are filtered
//   out 10 surface  also a plane of the method: its material, and strength
//   out 11 shown    12 around   13 through (w: mm)   14 single
layout(local_size_x = 64) in;
#include "render/picture/device_data.h"
#include "shared/highlights.h"
#include "shared/leaving.h"
#include "shared/single.h"
#include "shared/spread.h"
#include "shared/thickness.h"
#include "shared/tone.h"
layout(set = 0, binding = 0) readonly buffer Points { pell_lit_point points[]; };
layout(set = 0, binding = 1) readonly buffer Results { uvec4 results[]; };
layout(set = 0, binding = 2) readonly buffer Hits { pell_picture_hit hits[]; };
layout(set = 0, binding = 3) readonly buffer Insides { pell_picture_inside insides[]; };
layout(set = 0, binding = 4) readonly buffer Lit { pell_lit_material materials[]; };
layout(set = 0, binding = 5) readonly buffer Materials { pell_picture_material surface_materials[]; };
layout(set = 0, binding = 6) readonly buffer Tables { float tables[]; };
layout(set = 0, binding = 7) readonly buffer Frame { pell_picture_frame fr; };
layout(set = 0, binding = 8) readonly buffer Sky { uint sky[]; };
layout(set = 0, binding = 9) writeonly buffer Light { vec4 light[]; };
layout(set = 0, binding = 10) writeonly buffer Surface { uvec2 surface[]; };
layout(set = 0, binding = 11) writeonly buffer Shown { pell_picture_shown shown[]; };
layout(set = 0, binding = 12) writeonly buffer Around { pell_picture_around around[]; };
layout(set = 0, binding = 13) writeonly buffer Through { vec4 through[]; };
layout(set = 0, binding = 14) writeonly buffer Single { vec4 single[]; };
layout(push_constant) uniform Push { pell_picture_push pc; };
#include "render/irradiance/boundary.glsl"
#include "render/picture/pixels.glsl"
#include "render/picture/sky.glsl"

// Light at a point.
struct Arrived {
    vec3 irradiance, specular, hidden, lost, single, transmitted;
    vec3 solved, entered; // exitance of solved diffusion, and the part of the irradiance that it accounts for, with albedo^m
    float straight; // straight transmission in `transmitted`, sum of the channels,
    float path;     // and the same times the path length, mm
};

bool has(uint flag)
{
    return (fr.flags & flag) != 0u;
}

vec3 word(uint at)
{
    return uintBitsToFloat(results[at].rgb);
}

bool is_straight(uint i, uint material)
{
    return has(PELL_PICTURE_THROUGH) && (points[i].flags & PELL_LIT_STRAIGHT) != 0u && materials[material].thickness_at >= 0;
}

// Reads the light computed by earlier passes.
Arrived arrived_at(uint i, uint material)
{
    const uint first = i * pc.results;
    const bool straight = is_straight(i, material);
    Arrived a;

    a.irradiance = word(first);
    a.specular = hits[i].emissive.rgb + word(first + 1u);
    a.hidden = word(first + 2u);
    a.lost = word(first + 3u);
    a.single = has(PELL_PICTURE_SINGLE) ? word(first + 1u + PELL_LIT_HIGHLIGHT_WORDS) : vec3(0.0);
    a.transmitted = straight ? word(first + pc.through) : vec3(0.0);
    a.solved = a.entered = vec3(0.0);
    a.straight = a.transmitted.r + a.transmitted.g + a.transmitted.b;
    a.path = straight ? uintBitsToFloat(results[first + pc.through].a) : 0.0;
    return a;
}

// Numbers of rays for direct light, and in the upper 16 bits for transmission.
uint rays_of(uint i, uint material)
{
    const uint transmission = is_straight(i, material) ? results[i * pc.results + pc.through + 2u].a : 0u;
    const uint far_side = surface_materials[material].sheet.w > 0.0 ? results[(i + pc.far_sides) * pc.results].a : 0u;
    const uint direct = results[i * pc.results].a + far_side;

    return min(direct, 65535u) | min(transmission, 65535u) << 16;
}

// Light of environments without the light sources that are excluded from their smooth remainder.
void add_environments(uint i, Lobe lobe, float rho_s, inout Arrived a)
{
    const uint env = i * pc.results + 1u + PELL_LIT_HIGHLIGHT_WORDS + (has(PELL_PICTURE_SINGLE) ? 1u : 0u);
    const uint exit = i * pc.results + pc.through;
    const vec3 normal = points[i].normal.xyz, view = points[i].view.xyz, enter = surface_materials[lobe.material].enter_mean.rgb;
    const pell_lit_material m = materials[lobe.material];
    const float mu = pell_saturate(dot(normal, view)), off = pell_angle_off(m.inverse_eta2, mu);
    const bool straight = is_straight(i, lobe.material), has_highlight = points[i].tint.r + points[i].tint.g + points[i].tint.b > 0.0;
    const vec3 fraction = straight ? word(exit + 1u) : vec3(0.0); // fraction of the smooth remainder at the exit point of the straight ray
    const vec2 albedo = albedo_at(lobe, mu);

    for (uint e = 0u; e < sky[0]; e++) {
        const float visibility = float(results[env + 2u * e].a) / (float(PELL_THROUGH_WHOLE) * float(sky[1]));
        const Entering entering = entering_of(e, lobe, points[i].normal.w, rho_s);
        const vec3 lights = word(env + 2u * e), unshadowed = word(env + 2u * e + 1u);
        a.irradiance += max(lights + visibility * enter * (rest_at(entering, normal) - unshadowed), vec3(0.0));
        if (has_highlight) {
            const float width = pell_lobe_width(m.model, points[i].normal.w), slope_variance = points[i].slope_variance;
            const vec3 out_of = normalize(2.0 * max(dot(normal, view), 0.0) * normal - view);
            const vec3 mirrored = mirrored_by(e, out_of, sqrt(width * width + 2.0 * slope_variance));
            for (int c = 0; c < 3; c++)
                a.specular[c] += mirrored[c] * points[i].tint[c] * pell_saturate(points[i].f0[c] * albedo.x + albedo.y) * visibility;
        }
        if (fraction.r + fraction.g + fraction.b > 0.0) {
            const vec3 passes = fraction * broad_rest_at(entering, word(exit + 2u));
            const float path_mm = uintBitsToFloat(results[exit + 1u].a);
            for (int c = 0; c < 3; c++) {
                const float exiting = passes[c] * pell_thickness_exit(m.pass_per_mm[c], path_mm, m.pass_base[c] + m.pass_slope[c] * off);
                a.transmitted[c] += exiting;
                a.straight += exiting;
                a.path += path_mm * exiting;
            }
        }
    }
}

// Applies the effects of the solid's shape and of the light inside it.
void apply_inside(uint i, uint material, inout Arrived a)
{
    const pell_picture_inside n = insides[i];

    a.path *= pell_spread_path_fraction(n.all.w);
    a.irradiance += n.indirect.rgb * surface_materials[material].enter_mean.rgb;
    a.transmitted += n.indirect_transmitted.rgb;
    a.irradiance *= n.all.rgb;
    a.single *= n.single.rgb;
    const vec3 kept = a.transmitted * (1.0 - n.sum_weight.rgb) * (1.0 - n.solved.rgb);
    const float all = a.transmitted.r + a.transmitted.g + a.transmitted.b;
    const float fraction = all > 0.0 ? (kept.r + kept.g + kept.b) / all : 0.0;
    a.straight *= fraction;
    a.path *= fraction;
    a.transmitted = (1.0 - n.solved.rgb) * (a.transmitted * (1.0 - n.sum_weight.rgb) + n.transmitted.rgb);
    a.solved = n.light.rgb;
    a.entered = n.entered.rgb;
}

// Light of the far side of a thin sheet.
vec3 arrived_far_side(uint i, Lobe lobe, float rho_s)
{
    const uint at = i + pc.far_sides;
    Arrived a = Arrived(word(at * pc.results), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), 0.0, 0.0);

    if (has(PELL_PICTURE_SKY))
        add_environments(at, lobe, rho_s, a);
    if (has(PELL_PICTURE_INSIDES))
        apply_inside(at, lobe.material, a);
    return a.irradiance;
}

// Factor from radiant exitance to radiance toward the camera.
float exit_factor(Lobe lobe, float rho_s, float mu)
{
    const pell_picture_material m = surface_materials[lobe.material];
    const bool published = has(PELL_PICTURE_PUBLISHED);

    if ((m.flags & PELL_PICTURE_SMOOTH) != 0u)
        return pell_smooth_exit_factor(smooth_transmittance(materials[lobe.material].smooth_at, mu), published ? 1.0 : m.exit_slope.w);
    const vec2 albedo = albedo_at(lobe, mu);
    const int model = materials[lobe.material].model, per_model = ALBEDO_MU * ALBEDO_ROUGHNESS * 2;
    const int at = fr.mean_at + model * ALBEDO_ROUGHNESS * 2 + (lobe.at - model * per_model);
    const float f0 = materials[lobe.material].fd, g = lobe.fraction;
    const float mean = f0 * pell_lerp(tables[at], tables[at + 2], g) + pell_lerp(tables[at + 1], tables[at + 3], g);
    return pell_exit_factor(rho_s, f0 * albedo.x + albedo.y, mean, published ? 0.0 : 1.0);
}

void clear(int at)
{
    light[at] = vec4(0.0);
    surface[at] = uvec2(0u);
    shown[at].factor = vec4(0.0);
    shown[at].specular = vec4(0.0);
    around[at].hidden = around[at].lost = around[at].meter_factor = vec4(0.0);
    around[at].normal = vec4(0.0);
    through[at] = vec4(0.0);
}

void main()
{
    const uint i = gl_GlobalInvocationID.x;
    const Pixel p = pixel_of(i);

    if (!p.inside)
        return;
    if (points[i].material == PELL_LIT_NONE) {
        clear(p.at);
        return;
    }
    const uint material = points[i].material;
    const pell_picture_material m = surface_materials[material];
    const vec3 normal = points[i].normal.xyz, view = points[i].view.xyz, tint = points[i].tint.rgb, albedo = hits[i].albedo.rgb;
    const float rho_s = (tint.r + tint.g + tint.b) * (1.0 / 3.0), mu = pell_saturate(dot(normal, view));
    const Lobe lobe = lobe_of(material, points[i].normal.w);
    Arrived a = arrived_at(i, material);

    if (has(PELL_PICTURE_SKY))
        add_environments(i, lobe, rho_s, a);
    if (has(PELL_PICTURE_INSIDES))
        apply_inside(i, material, a);
    const float off = pell_angle_off(m.enter_mean.w, mu);
    const vec3 factor = exit_factor(lobe, rho_s, mu) * (m.exit_base.rgb + m.exit_slope.rgb * off) * hits[i].exit_color.rgb;
    const bool sheet = m.sheet.w > 0.0;
    if (sheet)
        a.transmitted = arrived_far_side(i, lobe, rho_s);
    const vec3 entered = a.irradiance * albedo * hits[i].sheet.w;
    const vec3 transmitted = a.transmitted * (sheet ? hits[i].sheet.rgb : albedo) + a.solved;
    const vec3 arriving = (entered + (sheet ? transmitted : vec3(0.0))) / max(albedo, vec3(0.02));
    const vec3 metered = vec3(pell_meter_fraction(m.enter_mean.r, m.diffuse), pell_meter_fraction(m.enter_mean.g, m.diffuse),
                             pell_meter_fraction(m.enter_mean.b, m.diffuse));
    const vec3 passing = a.transmitted + a.solved;
    const float all = passing.r + passing.g + passing.b;
    const uint key = floatBitsToUint(hits[i].emissive.w);
    const float pixel_mm = hits[i].albedo.w * fr.depth_mm + fr.fixed_mm;
    const vec3 filtered_fraction = vec3(pell_highlights_share(m.radius.r, pixel_mm), pell_highlights_share(m.radius.g, pixel_mm),
                             pell_highlights_share(m.radius.b, pixel_mm));
    const bool emits = hits[i].emissive.r + hits[i].emissive.g + hits[i].emissive.b > 0.0;

    light[p.at] = vec4(entered - a.entered, hits[i].albedo.w);
    surface[p.at] = uvec2(key, floatBitsToUint(has(PELL_PICTURE_STRENGTH) ? hits[i].exit_color.w : 1.0));
    shown[p.at].factor = vec4(factor, uintBitsToFloat(material + 1u));
    shown[p.at].specular = vec4(a.specular, PELL_LUMINANCE(metered.r * arriving.r, metered.g * arriving.g, metered.b * arriving.b));
    around[p.at].hidden = vec4(emits ? vec3(-1.0) : a.hidden, uintBitsToFloat(rays_of(i, material)));
    around[p.at].lost = vec4(a.lost * filtered_fraction * albedo * hits[i].sheet.w, 0.0);
    around[p.at].meter_factor = vec4(vec3(PELL_LUMINANCE_R, PELL_LUMINANCE_G, PELL_LUMINANCE_B) * metered / max(albedo, vec3(0.02)), 0.0);
    around[p.at].normal = vec4(normal, hits[i].albedo.w);
    through[p.at] = vec4(transmitted, pell_spread_pack_sums(a.path, a.straight, all));
    if (has(PELL_PICTURE_SINGLE)) {
        const float exit = boundary_transmittance(lobe, rho_s, dot(normal, view)) * materials[material].single_eta2;
        single[p.at] = vec4(a.single * exit, 0.0);
    }
}
