// SPDX-License-Identifier: MIT
#version 460
#extension GL_GOOGLE_include_directive : require
// gather.comp - M of each pixel from samples in the tangent plane, projected to the surface along the rays of irradiance images. T. Mertens
// et al., "Efficient Rendering of Local Subsurface Scattering", 2003, equation (9), corrected; README.md. Mirror of kernels.c and points.h.
// VIEWS 1: with images from the lights, combined by the balance heuristic.
//   in  0 texels     the camera's irradiance image: see common.glsl
//   in  1 surface    material (0: not translucent), strength (bits of a float)
//   in  2 base       base colour, if the scattering distance depends on it; else unused
//   in  3 sets       per material, then per level: see points.glsl
//   in  4 offsets    samples: x, y in the tangent plane (mm), 1/density, 0
//   in  5 rows       radial tables, two each: R of the channels and their mean over their totals, times length^2; increments per row
//   in  6 views      per view of a light: see points.glsl
//   in  7 lights     the irradiance images of these views, one after the other
//   in  10 regions   see choose.comp, with adaptive sampling
//   out 8 light      M (W/m^2), 0
//   out 9 alpha      weight of a pixel's channels in the reconstruction; footprints off its plane for a difference of one in w
// Estimator: biased where the images do not contain the surface (renormalised), otherwise only by rounding of radii to table rows.
layout(local_size_x = 16, local_size_y = 8) in;
layout(constant_id = 0) const int VIEWS = 0;
layout(set = 0, binding = 0) readonly buffer Texels { vec4 texels[]; };
layout(set = 0, binding = 1) readonly buffer Surface { uvec2 surface[]; };
layout(set = 0, binding = 2) readonly buffer Base { vec4 base[]; };
layout(set = 0, binding = 3) readonly buffer Sets { uvec4 sets[]; };
layout(set = 0, binding = 4) readonly buffer Offsets { vec4 offsets[]; };
layout(set = 0, binding = 5) readonly buffer Rows { vec4 rows[]; };
layout(set = 0, binding = 6) readonly buffer Views { vec4 views[]; };
layout(set = 0, binding = 7) readonly buffer Lights { vec4 lights[]; };
layout(set = 0, binding = 8) writeonly buffer Light { vec4 light[]; };
layout(set = 0, binding = 9) writeonly buffer Alpha { vec4 alpha[]; };
layout(set = 0, binding = 10) readonly buffer Regions { uint regions[]; };
#include "methods/image_space/common.glsl"
#include "methods/image_space/points.glsl"

struct Sums {
    vec3 light, weight;
    float count;
};

// R of the channels at a squared radius over length^2, interpolated between the levels of each channel if there are levels.
vec3 weights_at(ShadingPoint p, int row, float fraction)
{
    if (!p.varies)
        return (rows[p.rows + row] + fraction * rows[p.rows + row + 1]).rgb;
    vec3 result;
    for (int c = 0; c < 3; c++) {
        const int at = p.channel_rows[c] + row, next = at + 2 * IS_ROWS;
        const float low = rows[at][c] + fraction * rows[at + 1][c], high = rows[next][c] + fraction * rows[next + 1][c];
        result[c] = low + p.level_fraction[c] * (high - low);
    }
    return result;
}

// Adds a sample that hit the surface; `inv_density`: 1/density, or the reciprocal of the sum of densities over views. Returns its validity.
bool add(ShadingPoint p, SurfaceHit f, float inv_density, inout Sums s)
{
    const float square = dot(f.to, f.to) * p.per_length2;
    float fraction;
    const int row = find_row(square, fraction);
    const vec3 weight = weights_at(p, row, fraction) * inv_density;

    if (!(square < IS_SQUARE_MAX && inv_density >= 0.0 && all(lessThanEqual(weight, vec3(IS_WEIGHT_MAX)))))
        return false;
    s.weight += weight;
    s.light += weight * f.light;
    return true;
}

float jacobian_factor(float jacobian)
{
    return pc.jacobian == 0 ? 1.0 : pc.jacobian < 0 ? 1.0 / jacobian : jacobian;
}

void take_samples(ShadingPoint p, int from, int to, inout Sums s)
{
    for (int k = from; k < to; k++) {
        const vec4 offset = offsets[p.offset + k * pc.tile];
        const vec2 at = offset.xy * p.strength;
        bool valid = false;

        if (!(offset.z > 0.0))
            continue;
        if (VIEWS == 0) {
            const SurfaceHit f = find_in_camera(p, at);
            if (f.valid)
                valid = add(p, f, offset.z * jacobian_factor(f.jacobian), s);
        } else {
            for (int v = 0; v <= pc.views; v++) {
                SurfaceHit f;
                if (v == 0)
                    f = find_in_camera(p, at);
                else
                    f = find_in_light(v, p, at);
                if (!f.valid)
                    continue;
                float sum = 1.0 / (offset.z * jacobian_factor(f.jacobian));
                for (int u = 0; u <= pc.views; u++)
                    if (u != v)
                        sum += density_from(u, p, f.to);
                valid = add(p, f, 1.0 / sum, s) || valid;
            }
        }
        s.count += valid ? 1.0 : 0.0;
    }
}

void main()
{
    const ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    const int i = pixel_at(p);

    if (!is_inside(p))
        return;
    const vec4 texel_plane = texels[2 * i], texel_light = texels[2 * i + 1];
    if (texel_plane.w == 0.0) {
        light[i] = alpha[i] = vec4(0.0);
        return;
    }
    const bool parallel = pc.orthographic != 0;
    const ShadingPoint shading_point = start(p, texel_plane, texel_light.a);
    Sums s = Sums(vec3(0.0), vec3(0.0), 0.0);

    take_samples(shading_point, 0, pc.by_count != 0 ? pc.first_kind : shading_point.samples, s);
    if (pc.by_count != 0) { // valid samples of a kind also represent the invalid ones of that kind
        s.light *= s.count > 0.0 ? float(pc.first_kind) / s.count : 0.0;
        if (pc.first_kind < pc.samples) {
            Sums rest = Sums(vec3(0.0), vec3(0.0), 0.0);
            take_samples(shading_point, pc.first_kind, pc.samples, rest);
            s.light += rest.light * (rest.count > 0.0 ? float(pc.samples - pc.first_kind) / rest.count : 0.0);
            s.count += rest.count;
        }
    }
    vec3 result, blend;
    for (int c = 0; c < 3; c++) {
        const float px = shading_point.quarter[c] * shading_point.strength * (parallel ? pc.focal_px : pc.focal_px / shading_point.z);
        const float t = clamp((px - IS_RECONSTRUCT_FROM) / (IS_RECONSTRUCT_TO - IS_RECONSTRUCT_FROM), 0.0, 1.0);
        const bool kept = shading_point.strength > IS_STRENGTH_MIN && (pc.by_weight != 0  ? s.weight[c] > 1e-20
                                                          : pc.by_count != 0 ? s.count > 0.0
                                                                             : true);
        result[c] = (!kept ? texel_light[c] : pc.by_weight != 0 ? s.light[c] / s.weight[c] : s.light[c]) *
                    (shading_point.scale[c] * pc.factor);
        blend[c] = kept ? IS_RECONSTRUCT(t) : 0.0;
    }
    light[i] = vec4(result, 0.0);
    alpha[i] = vec4(blend, pc.focal_px * shading_point.per_h / (parallel ? 1.0 : sqrt(dot(shading_point.t, shading_point.t) + 1.0)));
}
