/* SPDX-License-Identifier: MIT
 *
 * shared.comp - every function and macro of src/shared once, as a shader uses them; check_glsl.py compiles it. */
#version 460
#extension GL_GOOGLE_include_directive : require

#include "shared/bloom.h"
#include "shared/boundary.h"
#include "shared/camera.h"
#include "shared/color_share.h"
#include "shared/curvature.h"
#include "shared/environment.h"
#include "shared/gloss.h"
#include "shared/hash.h"
#include "shared/highlights.h"
#include "shared/leaving.h"
#include "shared/lens.h"
#include "shared/light.h"
#include "shared/light_data.h"
#include "shared/lobe.h"
#include "shared/phase.h"
#include "shared/sampling.h"
#include "shared/single.h"
#include "shared/through.h"
#include "shared/spread.h"
#include "shared/subdivision.h"
#include "shared/table.h"
#include "shared/texture.h"
#include "shared/thickness.h"
#include "shared/tone.h"
#include "shared/triangle_ray.h"
#include "shared/wide_light.h"

layout(local_size_x = 64) in;

layout(std430, set = 0, binding = 0) readonly buffer lights_block {
    pell_light_data lights[];
};
layout(std430, set = 0, binding = 1) readonly buffer phases_block {
    pell_phase_terms phases[];
};
layout(std430, set = 0, binding = 2) readonly buffer table_block {
    float table[];
};
layout(std430, set = 0, binding = 3) writeonly buffer result_block {
    vec4 result[];
};
layout(push_constant) uniform push {
    uint count;
    int model;
    float eta, exposure;
};

float of_table(float place, int entries)
{
    const int i = pell_table_cell(place, entries);
    return pell_lerp(table[i], table[i + 1], place - PELL_TO_FLOAT(i));
}

float boundary(float mu)
{
    const pell_refraction r = pell_refract(eta, mu);
    const float scale = of_table(pell_cosine_coord(pell_saturate(mu), 32), 32), rough = of_table(pell_roughness_coord(mu, 0.05f, 16), 16);
    const float albedo = pell_bilinear(table[0], table[1], table[2], table[3], scale, rough);
    const float t = pell_transmittance(0.5f, r.reflectance, scale, rough);
    return t * pell_exit_factor(0.5f, albedo, rough, 1.0f) + pell_smooth_exit_factor(1.0f - r.reflectance, rough) +
           pell_schlick(0.04f, r.cos_t);
}

float lobe(float width, float nl, float nv, float sin2, float nh, float hh)
{
    const float width2 = width * width;
    switch (model) {
    case PELL_LOBE_KELEMEN: return pell_lobe_kelemen(width2, sin2, nh, hh);
    case PELL_LOBE_PHONG: return pell_lobe_phong(width2, nl, nv, sin2);
    case PELL_LOBE_BLINN_PHONG: return pell_lobe_blinn_phong(width2, sin2, hh);
    default: return pell_lobe_ggx(width2, nl, nv, sin2, nh, hh);
    }
}

float lit(pell_light_data light, vec3 place)
{
    const vec3 way = place - light.position.xyz;
    const float d = length(way), c = dot(way, light.direction.xyz) / d;
    const float window = light.image < 0 ? 1.0f : pell_light_window(d * d, light.direction.w);
    const float cone = light.type == PELL_LIGHT_DATA_SPOT ? pell_light_cone(c, light.spot_scale, light.spot_offset) : window;
    return pell_soft_terminator(cone * pell_light_falloff(d, light.position.w, light.direction.w), pell_saturate(c));
}

float scattered(float c)
{
    const float g = phases[0].a[0], base = PELL_PHASE_HG_BASE(g, c);
    const float m = pell_single_cosine(0.5f, c), turn = pell_single_phase_cosine(0.5f, c, c, g, m, m);
    return pell_phase_evaluate(phases[1], c) + PELL_PHASE_HG_VALUE(g, base, sqrt(base)) + pell_single_radiance(0.9f, g, turn, m, m) +
           pell_through_near(c, g, m) + float(pell_through_ambient(c, g, m));
}

float filmic(vec3 light)
{
    const vec3 e = PELL_FILMIC_SCALE * light;
    const vec3 mixed = vec3(PELL_FILMIC_TO_R(e.r, e.g, e.b), PELL_FILMIC_TO_G(e.r, e.g, e.b), PELL_FILMIC_TO_B(e.r, e.g, e.b));
    const vec3 x = PELL_FILMIC_CURVE(min(mixed, vec3(PELL_FILMIC_MOST)));
    const float sum = PELL_FILMIC_FROM_R(x.r, x.g, x.b) + PELL_FILMIC_FROM_G(x.r, x.g, x.b) + PELL_FILMIC_FROM_B(x.r, x.g, x.b);
    return sum + pell_filmic_inverse(0.5f);
}

float met(vec3 a, vec3 b, vec3 c, vec3 way)
{
    const pell_ray_shear shear = pell_ray_shear_of(way.x, way.y, way.z);
    const pell_triangle_hit m =
        pell_triangle_intersect(pell_ray_shear_point(shear, a.x, a.y, a.z), pell_ray_shear_point(shear, b.x, b.y, b.z),
                                pell_ray_shear_point(shear, c.x, c.y, c.z));
    const float inverse = pell_ray_inverse(pell_component(way.x, way.y, way.z, 1));
    return m.t + m.u + m.v + PELL_SLAB_NEAR(a.x, b.x, inverse) + PELL_SLAB_FAR(a.x, b.x, inverse);
}

float sampled(uint number)
{
    const float u = pell_unit_float(pell_sobol0(number)), v = pell_unit_float(pell_sobol1(number));
    const pell_point2 disc = pell_disc_at(u, v);
    const pell_point2 wide = pell_wide_sample(pell_wide_make(disc.x, disc.y, 2.0f, 1.0f, 0.5f), u, pell_clamp1(v));
    const pell_half_vector h = pell_half_vector_at(0.01f, disc.x, disc.y);
    const float odds = pell_gloss_odds(u, 0.01f, v, 8, pell_gloss_directions(4)), density = pell_half_vector_density(0.01f, h.x, h.y, h.z);
    return wide.x + wide.y + odds / (odds + density);
}

float passed(float same, float mu)
{
    const float m = pell_thickness_of(2.0f, pell_thickness_cosine(-mu, same), same), counted = pell_thickness_counted(same, mu);
    return m * pell_thickness_opposed(same) + counted * pell_thickness_facing(mu, 0.5f, 1.0f) * pell_thickness_exit(0.25f, m, mu);
}

float spread(int i, float depth)
{
    const int at = pell_mirror(i, 16), cell = pell_grid_cell(at, 4);
    const float radius = pell_disc_radius(2.0f, 0.01f, 1.0f / depth), cover = pell_disc_cover(radius, pell_grid_fraction(at, 4, cell));
    return pell_disc_composite(cover, cover, pell_disc_band(radius), 1.0f, 0.5f, 0.5f, 1.0f);
}

float curved(float mean, float thinness)
{
    const float beyond = pell_curvature_excess(mean, thinness), place = pell_curvature_thinness_coord(beyond, 2.0f);
    const float once = pell_curvature_single(pell_curvature_shift(mean, 0.5f), 0.5f), slot = pell_unit_float(pell_curvature_slot(1u, 2u));
    const float round = pell_curvature_sheet(beyond, thinness) + pell_curvature_round(mean, thinness);
    return pell_curvature_coord(place) + pell_curvature_mean_coord(mean, 0.3f) + round + once + slot;
}

float mapped(float x)
{
    const pell_texels t = pell_texels_of(PELL_TEXELS_REPEAT, x, 16);
    const pell_mip_levels m = pell_mip_levels_of(x, 4.0f);
    const float bumps = pell_bumps(0.9f, x, 1.0f);
    return t.f + PELL_TO_FLOAT(t.a + t.b + m.lower + m.upper + pell_floor_to_int(x)) + m.blend + pell_approximate_log2(x) +
           pell_bumpy_roughness(x, bumps, 0) + pell_slope_variance(x, 0.25f);
}

// From a pixel to its display value, including the stages that read neighbouring pixels.
float shown(float x)
{
    const float right = pell_camera_right(x, 0.25f, 16.0f, 9.0f), up = pell_camera_up(x, 0.25f, 16.0f, 9.0f);
    const float curve = PELL_TO_FLOAT(PELL_TO_INT(pell_pixel_curve(3u, PELL_TO_UINT(5), 7u)));
    const float bent = pell_bend_missing(right) + pell_color_share(x, 0.5f) + curve;
    const float left = pell_meter_fraction(x, up) * pell_angle_off(0.5f, up) * pell_gradient_exit(0.5f, right) *
                       pell_gradient_exit_by(pell_gradient_scale(0.5f), right);
    const float wide = pell_spread_path_fraction(x) * pell_spread_gaussian_fraction(x, 0.0f, 1.0f, 4.0f) * pell_spread_weight(x, up, 0.1f) +
                       pell_spread_straight(pell_spread_pack(right, x) + pell_spread_pack_sums(right, x, up));
    const float seen = pell_highlights_visibility(x, up, 4.0f), alike = pell_highlights_weight(0.9f, x, 2.0f);
    return bent + left + wide + curved(right, x) + mapped(x) + pell_highlights_filtered(x, up, seen, right, alike) +
           pell_highlights_share(x, up);
}

float around(vec3 n)
{
    const pell_point2 node = pell_octahedral_coord(n.x, n.y, n.z), picture = pell_panorama_uv(n.x, n.y, n.z);
    return node.x + node.y + picture.x + picture.y;
}

float child(uint word, float x)
{
    const pell_child_cell q = pell_child_cell_at(word >> PELL_CELL_PATTERN_SHIFT, 1.0f - x, 0.5f * x, 0.5f * x);
    return float((word & PELL_CELL_CHILD_MASK) + uint(q.child)) + q.w0 + q.w1 + q.w2;
}

void main()
{
    const uint i = gl_GlobalInvocationID.x;
    if (i >= count)
        return;
    const float x = table[i], place = pell_thickness_coord(x, table[0], 512);
    const float share = pell_thickness_transmission(table[pell_table_cell(place, 512)], table[i], place, 512);
    const float width = pell_lobe_width(model, x), value = lobe(width, x, 0.5f, 0.1f, 1.0f, 2.0f) + boundary(x) + scattered(x) + share;
    const float l = PELL_LUMINANCE(value, x, width), scale = PELL_TONE_SCALE(exposure, l, 1.0f, pell_tone_inverse(0.5f, 0.25f));
    const pell_light_data light = lights[i];
    const float ray = met(vec3(x), vec3(width), vec3(place), vec3(1.0f, x, value));
    const float ends = spread(int(i), x) + child(i, x) + passed(x, 0.3f) + pell_unit_float(pell_hash(i));
    const float all = lit(light, vec3(x)) + ray + sampled(i) + around(vec3(x)) + ends + shown(x);
    result[i] = vec4(pell_srgb_encode(value * scale + filmic(vec3(x))), pell_srgb_decode(x), all,
                     (light.flags & PELL_LIGHT_DATA_COMPACT) != 0u ? light.power.x : PELL_PI_F);
}
