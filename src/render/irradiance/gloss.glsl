// SPDX-License-Identifier: MIT
// gloss.glsl - for direct.comp: the highlight of one light at a point. Mirror of gloss.c.
#include "shared/gloss.h"
#include "shared/sampling.h"

// View, colours and lobe at a point.
struct Gloss {
    vec3 view, tint, f0;
    float nv, width2;
    int model;
};

// The highlight of one light by visible and by occluded points on the light, with their MIS weights.
struct Highlight {
    vec3 visible, occluded;
    float odds; // pell_gloss_odds
};

Gloss gloss_of(Point p)
{
    Gloss gloss;

    gloss.view = points[p.at].view.xyz;
    gloss.tint = points[p.at].tint.rgb;
    gloss.f0 = points[p.at].f0.rgb;
    gloss.nv = dot(p.normal, gloss.view);
    gloss.model = materials[p.material].model;
    gloss.width2 = pell_lobe_width(gloss.model, points[p.at].normal.w);
    gloss.width2 = gloss.width2 * gloss.width2 + 2.0 * points[p.at].slope_variance;
    return gloss;
}

float face_area(pell_light_data light)
{
    const float square = dot(light.right.xyz, light.right.xyz) * dot(light.up.xyz, light.up.xyz);
    return (light.type == PELL_LIGHT_DATA_DISC ? PELL_PI_F : 4.0) * sqrt(square);
}

// Lobe value, Schlick's weight and sampling density of a direction: x, y, z. The lobe is widened by the solid angle of a sample (gloss.c).
vec3 shape_lobe(Gloss gloss, vec3 normal, vec3 l, float solid_angle)
{
    const vec3 h = l + gloss.view, c = cross(normal, h);
    const float hh = max(dot(h, h), 1e-12), nl = max(dot(normal, l), 1e-6), nv = max(gloss.nv, 1e-4), nh = nl + nv, sin2 = dot(c, c);
    const float vh = 0.5 * sqrt(hh), width2 = gloss.width2 + solid_angle * (1.0 / 24.0) / vh, most = min(width2, 1.0);
    const float shape = gloss.model == PELL_LOBE_GGX       ? pell_lobe_ggx(most, nl, nv, sin2, nh, hh)
                        : gloss.model == PELL_LOBE_KELEMEN ? pell_lobe_kelemen(width2, sin2, nh, hh)
                        : gloss.model == PELL_LOBE_PHONG   ? pell_lobe_phong(most, nl, nv, sin2)
                                                           : pell_lobe_blinn_phong(most, sin2, hh);
    return vec3(shape, pell_schlick_weight(vh), pell_half_vector_density(gloss.width2, sin2, nh, hh));
}

Highlight begin_highlight(pell_light_data light, Point p)
{
    const vec3 to = p.position - light.position.xyz;
    const float height = dot(to, light.direction.xyz), d2 = max(dot(to, to), TINY);
    Highlight highlight = Highlight(vec3(0.0), vec3(0.0), 0.0);

    if (p.highlights && light.environment < 0 && light.image < 0 && is_area_light(light) && height > 0.0) {
        const Gloss gloss = gloss_of(p);
        if (gloss.model != PELL_LOBE_PHONG)
            highlight.odds = pell_gloss_odds(face_area(light) * height / (d2 * sqrt(d2)), gloss.width2, gloss.nv,
                                         light.samples * PELL_GLOSS_POINTS, pell_gloss_directions(light.samples));
    }
    return highlight;
}

// Evaluates a sample's cell at more points than its shadow ray.
void add_highlight(pell_light_data light, Point p, Aim a, bool visible, inout Highlight highlight)
{
    const int num_points = is_area_light(light) ? PELL_GLOSS_POINTS : 1;
    const float mu = max(a.nl, 1e-6), facing = facing_at(p, a.gl, mu);
    const float solid_angle = highlight.odds > 0.0 ? 0.0 : a.solid_angle * (1.0 / float(PELL_GLOSS_POINTS));
    const Gloss gloss = gloss_of(p);
    vec2 sum = vec2(0.0); // factors of f0 and of 1 - f0

    if (!(facing > 0.0) || !(visible || is_area_light(light)))
        return;
    for (int j = 0; j < num_points; j++) {
        vec3 l = a.direction;
        float cosine = mu;
        if (j > 0) {
            const uvec2 cell = uvec2(pell_sobol0(uint(j)) >> ((pc.light_bits + 1) / 2), pell_sobol1(uint(j)) >> (pc.light_bits / 2));
            l = face_at(light, a.at ^ cell) - p.position;
            l *= 1.0 / sqrt(max(dot(l, l), TINY));
            cosine = dot(p.normal, l);
        }
        if (cosine > 0.0) {
            const vec3 lobe = shape_lobe(gloss, p.normal, l, solid_angle);
            const vec2 add = lobe.x * cosine * vec2(1.0, lobe.y);
            sum += highlight.odds > 0.0 ? add * (highlight.odds / (highlight.odds + lobe.z)) : add;
        }
    }
    const vec3 w = facing / (float(num_points) * mu) * a.falloff * a.intensity * gloss.tint;
    const vec3 lit = min(w * (gloss.f0 * sum.x + (1.0 - gloss.f0) * sum.y), vec3(BIG));
    highlight.visible += visible ? lit : vec3(0.0);
    highlight.occluded += visible ? vec3(0.0) : lit;
}

// The light in a direction: the window of its range, 0 outside the light's area and behind it; and its distance.
float intersect_light(pell_light_data light, vec3 position, vec3 l, out float distance)
{
    const vec3 to = position - light.position.xyz, r = light.right.xyz, s = light.up.xyz;
    const float height = dot(to, light.direction.xyz), cosine = -dot(l, light.direction.xyz);
    distance = height / max(cosine, 1e-12);
    const vec3 q = to + distance * l;
    const float x = dot(q, r) / dot(r, r), y = dot(q, s) / dot(s, s);
    const float most = light.type == PELL_LIGHT_DATA_DISC ? x * x + y * y : max(x * x, y * y);

    return height > 0.0 && cosine > 1e-12 && most <= 1.0 ? pell_light_window(distance * distance, light.direction.w) : 0.0;
}

// Adds the directions of the lobe that hit the light.
void add_mirrored(pell_light_data light, Point p, float odds, inout vec3 specular, inout vec3 hidden, inout uint rays)
{
    const int count = pell_gloss_directions(light.samples);
    const vec3 n = p.normal;
    const Gloss gloss = gloss_of(p);
    const vec3 tangential = gloss.view - dot(n, gloss.view) * n;
    const float square = dot(tangential, tangential);
    vec3 t, b;
    vec2 visible = vec2(0.0), occluded = vec2(0.0); // factors of f0 and of 1 - f0

    basis_of(n, t, b);
    if (square > 1e-8) { // relative to the plane of incidence, so that a rotated scene has the same directions
        t = tangential * (1.0 / sqrt(square));
        b = cross(n, t);
    }
    for (int j = 0; j < count; j++) {
        const uint index = p.sample_index * uint(count) + uint(j);
        const pell_point2 at = pell_disc_at(pell_unit_float(pell_sobol0(index) ^ p.pattern.x),
                                            pell_unit_float(pell_sobol1(index) ^ p.pattern.y));
        const pell_half_vector drawn = pell_half_vector_at(gloss.width2, at.x, at.y);
        const vec3 h = drawn.x * t + drawn.y * b + drawn.z * n, l = 2.0 * dot(h, gloss.view) * h - gloss.view;
        const float nl = dot(n, l), gl = dot(p.geometric, l);
        float distance;
        const float hit = intersect_light(light, p.position, l, distance);

        if (hit > 0.0 && nl > 0.0 && (gl > 0.0 || p.lifted)) {
            const vec3 lobe = shape_lobe(gloss, n, l, 0.0);
            const vec2 add = hit * lobe.x * facing_at(p, gl, max(nl, 1e-6)) / (odds + lobe.z) * vec2(1.0, lobe.y);
            if (add.x > 0.0) {
                rays++;
                if (is_unoccluded(p.origin, l, 0.9999 * distance))
                    visible += add;
                else
                    occluded += add;
            }
        }
    }
    const vec3 radiance = light.power.rgb * (float(light.samples) / (face_area(light) * float(count)));
    specular += min(radiance * gloss.tint * (gloss.f0 * visible.x + (1.0 - gloss.f0) * visible.y), vec3(BIG));
    hidden += min(radiance * gloss.tint * (gloss.f0 * occluded.x + (1.0 - gloss.f0) * occluded.y), vec3(BIG));
}

// Adds the highlight once all samples of the light are in `highlight`.
void end_highlight(pell_light_data light, Point p, Highlight highlight, inout vec3 specular, inout vec3 hidden, inout uint rays)
{
    specular += highlight.visible;
    hidden += is_area_light(light) ? highlight.occluded : vec3(0.0);
    if (highlight.odds > 0.0)
        add_mirrored(light, p, highlight.odds, specular, hidden, rays);
}
