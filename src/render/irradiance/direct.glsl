// SPDX-License-Identifier: MIT
// direct.glsl - for direct.comp and transmission.comp: a point, one sample of a light seen from it, and the light that arrives. Mirror of
// kernel.c.
#include "render/irradiance/boundary.glsl"
#include "shared/hash.h"
#include "shared/light.h"
#include "shared/lobe.h"
#include "shared/sampling.h"
#include "shared/single.h"
#include "shared/wide_light.h"

const float FAR = 3.402823466e38; // FLT_MAX
const float BIG = 1e25;           // upper limit of an irradiance
const float TINY = 1e-12;
const float TERMINATOR_LIFTED = 1.0 / 64.0;

// Values used by rays and most formulas; others are read where they are used, which saves registers while tracing.
struct Point {
    vec3 position, origin, geometric, normal;
    float gn, rho;
    Lobe lobe;
    uint at, material; // indices in points and materials
    bool lifted, single, highlights;
    uvec2 pattern;
    uint sample_index; // of the multisample
};

// pell_lane_pattern of a point.
uvec2 pattern_at(uint point, int bits, uint salt)
{
    const uint start = points[point].curve << bits | (points[point].first & ((1u << bits) - 1u));
    return uvec2(points[point].hash0 ^ salt ^ pell_sobol0(start), points[point].hash1 ^ pell_hash(salt) ^ pell_sobol1(start));
}

Point load_point(uint at, bool highlights, bool single)
{
    const vec3 tint = points[at].tint.rgb;
    const float epsilon = points[at].position.w, terminator_offset = points[at].geometric.w;
    Point p;

    p.at = at;
    p.material = points[at].material;
    p.position = points[at].position.xyz;
    p.geometric = points[at].geometric.xyz;
    p.normal = points[at].normal.xyz;
    p.origin = p.position + (terminator_offset + epsilon) * p.geometric;
    p.lifted = terminator_offset > TERMINATOR_LIFTED * epsilon;
    p.gn = max(dot(p.geometric, p.normal), 1e-3);
    p.rho = (tint.r + tint.g + tint.b) * (1.0 / 3.0);
    p.lobe = lobe_of(p.material, points[at].normal.w);
    p.pattern = pattern_at(at, pc.light_bits, 0u);
    p.sample_index = points[at].sample_index;
    p.highlights = highlights;
    p.single = single;
    return p;
}

// T at a cosine.
float transmittance(Point p, float mu)
{
    return boundary_transmittance(p.lobe, p.rho, mu);
}

// --- One sample of a light ---------------------------------------------------------------------------------------------------------

struct Aim {
    vec3 direction; // unit, to the light
    vec3 end;       // sample position; unused for directional lights
    vec3 intensity; // irradiance on a facing surface = intensity falloff
    float falloff, solid_angle, gl, nl;
    float distance; // mm; unused for directional lights
    bool wide;      // samples are by solid angle
    uvec2 at; // for rect and disc lights: position on the light, as fractions of 2^32
};

// Orthonormal basis around a normal: vec3_basis of math/vec.h.
void basis_of(vec3 n, out vec3 t, out vec3 b)
{
    const float side = floatBitsToInt(n.z) < 0 ? -1.0 : 1.0, a = -1.0 / (side + n.z), c = n.x * n.y * a;
    t = vec3(1.0 + side * n.x * n.x * a, side * c, -side * n.x);
    b = vec3(c, side + n.y * n.y * a, -n.y);
}

bool is_area_light(pell_light_data light)
{
    return light.type == PELL_LIGHT_DATA_RECT || light.type == PELL_LIGHT_DATA_DISC;
}

vec3 on_face(pell_light_data light, float x, float y)
{
    return light.position.xyz + x * light.right.xyz + y * light.up.xyz;
}

// Position of two fractions in the rectangle around a centre.
vec3 on_rectangle(vec3 middle, pell_light_data light, uvec2 at)
{
    const vec2 offset = 2.0 * vec2(pell_unit_float(at.x), pell_unit_float(at.y)) - 1.0;
    return middle + offset.x * light.right.xyz + offset.y * light.up.xyz;
}

// Position of two fractions on the light.
vec3 face_at(pell_light_data light, uvec2 at)
{
    if (light.type == PELL_LIGHT_DATA_DISC) {
        const pell_point2 disc = pell_disc_at(pell_unit_float(at.x), pell_unit_float(at.y));
        return on_face(light, disc.x, disc.y);
    }
    return on_rectangle(light.position.xyz, light, at);
}

// Solid-angle sample of a wide light: solid angle of the sample, sr; 0: sample by area, which is left unchanged; -1: no light there.
float sample_wide(pell_light_data light, vec3 position, inout uvec2 face, inout vec3 end)
{
    const bool disc = light.type == PELL_LIGHT_DATA_DISC;
    const float half_x = length(light.right.xyz), half_y = length(light.up.xyz), area = 4.0 * half_x * half_y;
    const vec3 to = light.position.xyz - position;
    const float h = -dot(to, light.direction.xyz);

    if (!(h > 0.0) || area < PELL_WIDE_LIGHT * h * h)
        return 0.0;
    const float x = dot(to, light.right.xyz) / half_x, y = dot(to, light.up.xyz) / half_y;
    const vec2 outside = max(abs(vec2(x, y)) - vec2(half_x, half_y), vec2(0.0));
    if (area < PELL_WIDE_LIGHT * (h * h + dot(outside, outside)))
        return 0.0;
    const pell_wide w = pell_wide_make(x, y, half_x, half_y, h);
    if (!(w.angle > 1e-3))
        return 0.0;
    const pell_point2 at = pell_wide_sample(w, pell_unit_float(face.x), pell_unit_float(face.y));
    face = uvec2(min(0.5 + 0.5 * vec2(at.x, at.y), vec2(0.9999999)) * 4294967296.0);
    end = on_face(light, at.x, at.y);
    return disc && at.x * at.x + at.y * at.y > 1.0 ? -1.0 : w.angle * light.power.w / ((disc ? PELL_PI_F : 4.0) * half_x * half_y);
}

// `u`, `v`: the sample's Sobol numbers. Without the projected image.
Aim aim(pell_light_data light, Point p, uint u, uint v)
{
    const vec3 d = light.direction.xyz;
    float wide = 0.0;
    Aim a;

    a.distance = FAR;
    a.wide = false;
    a.end = light.position.xyz;
    a.at = uvec2(u, v) ^ p.pattern;
    if (light.type == PELL_LIGHT_DATA_DIRECTIONAL) {
        a.direction = -d;
        if (light.environment >= 0)
            a.direction = -normalize(on_rectangle(d, light, uvec2(u, v) ^ (p.pattern & ~(points[p.at].flags & PELL_LIT_TOGETHER))));
        a.falloff = 1.0;
        a.solid_angle = 0.0;
        a.intensity = light.power.rgb;
    } else {
        if (is_area_light(light)) {
            a.end = face_at(light, a.at);
            wide = sample_wide(light, p.position, a.at, a.end);
        }
        const vec3 to = a.end - p.position;
        const float distance = sqrt(max(dot(to, to), TINY));
        a.distance = distance;
        a.direction = to * (1.0 / distance);
        a.falloff = pell_light_falloff(distance, light.position.w, light.direction.w);
        const float back = -dot(d, a.direction), cosine = max(back, 0.0);
        const float w = is_area_light(light)                 ? cosine
                        : light.type == PELL_LIGHT_DATA_SPOT ? pell_light_cone(back, light.spot_scale, light.spot_offset)
                                                             : 1.0;
        a.intensity = light.power.rgb * w;
        a.solid_angle = light.power.w * cosine / (distance * distance);
        if (wide != 0.0) {
            a.wide = true;
            a.falloff = 1.0;
            a.solid_angle = max(wide, 0.0);
            a.intensity = light.power.rgb / light.power.w * a.solid_angle;
        }
    }
    a.gl = dot(p.geometric, a.direction);
    a.nl = dot(p.normal, a.direction);
    return a;
}

// --- A projected image ---------------------------------------------------------------------------------------------------------------

// Clamped at the borders, as in pell_image_sample.
vec3 image_at(uvec4 image, ivec2 at)
{
    const ivec2 inside = clamp(at, ivec2(0), ivec2(image.yz) - 1);
    return uintBitsToFloat(images[image.x + uint(inside.y) * image.y + uint(inside.x)].rgb);
}

vec3 image_sample(uvec4 image, float u, float v)
{
    const vec2 at = vec2(u, v) * vec2(image.yz);

    if (image.w != 0u)
        return image_at(image, ivec2(floor(at)));
    const vec2 low = floor(at - 0.5), f = at - 0.5 - low;
    const ivec2 k = ivec2(low);
    return (1.0 - f.x) * (1.0 - f.y) * image_at(image, k) + f.x * (1.0 - f.y) * image_at(image, k + ivec2(1, 0)) +
           (1.0 - f.x) * f.y * image_at(image, k + ivec2(0, 1)) + f.x * f.y * image_at(image, k + ivec2(1, 1));
}

// Colour of the projected image toward the point, as in pell_light_source_image. Returns whether there is light.
bool project_image(pell_light_data light, Point p, inout Aim a)
{
    const vec3 right = light.right.xyz, up = light.up.xyz;
    float x, y;

    if (light.image < 0)
        return true;
    if (is_area_light(light)) {
        const vec3 d = a.end - light.position.xyz;
        x = -0.5 * dot(d, right) / dot(right, right); // not mirrored when seen from the front
        y = 0.5 * dot(d, up) / dot(up, up);
    } else if (light.type == PELL_LIGHT_DATA_DIRECTIONAL) {
        const vec3 d = p.position - light.position.xyz;
        x = dot(d, right) * light.right.w;
        y = dot(d, up) * light.up.w;
    } else {
        const float depth = -dot(a.direction, light.direction.xyz), inverse = depth > 1e-6 ? 1.0 / depth : 1e12;
        x = -dot(a.direction, right) * inverse * light.right.w;
        y = -dot(a.direction, up) * inverse * light.up.w;
    }
    const float u = 0.5 + x, v = 0.5 - y;
    vec3 rgb = vec3(0.0);
    if (u >= 0.0 && u <= 1.0 && v >= 0.0 && v <= 1.0)
        rgb = image_sample(images[light.image], u, v);
    a.intensity *= vec3(rgb.r > 0.0 ? min(rgb.r, 1e10) : 0.0, rgb.g > 0.0 ? min(rgb.g, 1e10) : 0.0, rgb.b > 0.0 ? min(rgb.b, 1e10) : 0.0);
    return a.intensity.r + a.intensity.g + a.intensity.b > 0.0;
}

/* --- Arriving light ------------------------------------------------------------------------------------------------------------------- */

// Light that is scattered once right below the surface, as it arrives there again.
vec3 scattered_once(Point p, Aim a, float facing, float transmitted)
{
    const vec3 view = points[p.at].view.xyz;
    const float eta2 = materials[p.material].single_eta2, nl = pell_saturate(a.nl), nv = pell_saturate(dot(p.normal, view));
    const float into = pell_single_cosine(eta2, nl), out_of = pell_single_cosine(eta2, nv);
    const float cosine = pell_single_phase_cosine(eta2, dot(a.direction, view), nl, nv, into, out_of);
    vec3 sum = vec3(0.0);

    for (int c = 0; c < 3; c++) {
        const float albedo = materials[p.material].single_albedo[c], g = materials[p.material].single_g[c];
        if (albedo > 0.0)
            sum[c] = min(a.intensity[c] * a.falloff * transmitted * facing * pell_single_radiance(albedo, g, cosine, into, out_of), BIG);
    }
    return sum;
}

// Cosine with a soft terminator, from the cosines with the triangle's normal and with the smooth one.
float facing_at(Point p, float gl, float mu)
{
    const float ratio = gl / (mu * p.gn), g = ratio < 1.0 && !p.lifted ? ratio : 1.0;

    return pell_soft_terminator(mu, g);
}

// Adds unoccluded light to the front.
void add_front(Point p, Aim a, inout vec3 irradiance, inout vec3 single)
{
    const float mu = max(a.nl, 1e-6), facing = facing_at(p, a.gl, mu), transmitted = transmittance(p, mu);
    const float off = 1.0 - pell_single_cosine(materials[p.material].inverse_eta2, mu);
    const vec3 factor = materials[p.material].enter_base.rgb + materials[p.material].enter_slope.rgb * off;
    const vec3 shift = vec3(points[p.at].view.w, points[p.at].tint.w, points[p.at].f0.w);

    const vec3 enters = max(facing + shift * (1.0 - 3.0 * mu * mu), vec3(0.0));

    if (!(facing > 0.0))
        return;
    irradiance += min(a.intensity * (a.falloff * transmitted) * factor * enters, vec3(BIG));
    if (p.single)
        single += scattered_once(p, a, facing, transmitted);
}
