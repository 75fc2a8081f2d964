// SPDX-License-Identifier: MIT
// through.glsl - for direct.comp and transmission.comp: light that passes media into their shadows, of lights and of
// environments. Mirror of ../unscattered/shadow.c.
#include "shared/sampling.h"
#include "shared/through.h"

// Solids that a ray is in, the innermost last.
struct Nest {
    int object[PELL_THROUGH_NESTING];
    uint material[PELL_THROUGH_NESTING];
    int inside[PELL_THROUGH_NESTING]; // surfaces of the same object inside it that the ray has entered
    int depth;
};

// Passes a boundary. Returns false if the light ends there.
bool pass_boundary(pell_lit_mesh mesh, bool outer, inout Nest nest)
{
    int at = nest.depth - 1;

    if (materials[mesh.material].is_traced == 0)
        return false;
    while (at >= 0 && nest.object[at] != mesh.object)
        at--;
    if (at >= 0 && (outer || nest.inside[at] > 0)) {
        nest.inside[at] += outer ? 1 : -1;
        return true;
    }
    if (at >= 0) { // which need not be the last one where solids overlap
        nest.depth--;
        for (; at < nest.depth; at++) {
            nest.object[at] = nest.object[at + 1];
            nest.material[at] = nest.material[at + 1];
            nest.inside[at] = nest.inside[at + 1];
        }
        return true;
    }
    if (!outer || nest.depth == PELL_THROUGH_NESTING)
        return false;
    nest.object[nest.depth] = mesh.object;
    nest.material[nest.depth] = uint(mesh.material);
    nest.inside[nest.depth++] = 0;
    return true;
}

// Transmittance of what is on an occluded ray; 0 below `least`.
vec3 pass_shadow(vec3 origin, vec3 direction, float far, float least, inout uint rays)
{
    const float span = length(direction), largest = max(abs(origin.x), max(abs(origin.y), abs(origin.z)));
    vec3 through = vec3(1.0);
    float near = 0.0;
    Nest nest;

    nest.depth = 0;
    for (int step = 0; step <= PELL_THROUGH_SURFACES; step++) {
        const int before = nest.depth;
        Hit hit;
        rays++;
        if (!trace_ray(Ray(origin, near, direction, far, RAY_ALL), false, hit))
            return before > 0 ? vec3(0.0) : through; // inside: the light is
        if (before > 0)
            through *= exp(-materials[nest.material[before - 1]].sigma_t.rgb * ((hit.t - near) * span));
        const pell_lit_mesh mesh = meshes[hit.mesh];
        const vec3 a = hit_corner(hit, 0u), n = normalize(cross(hit_corner(hit, 1u) - a, hit_corner(hit, 2u) - a));
        const float cosine = dot(n, direction) / span;
        if (step == PELL_THROUGH_SURFACES || max(through.r, max(through.g, through.b)) <= least ||
            !pass_boundary(mesh, cosine < 0.0, nest))
            return vec3(0.0);
        if (nest.depth != before && (before == 0 || nest.depth == 0)) {
            const pell_lit_material m = materials[mesh.material];
            through *= boundary_transmittance(lobe_of(uint(mesh.material), m.roughness), m.rho_s, abs(cosine));
        }
        near = pell_through_near(hit.t, largest, span);
    }
    return vec3(0.0);
}

// Count, in units of PELL_THROUGH_WHOLE, of the slice's cosine-distributed directions about n from which light arrives; `sample_index`: of
// the multisample.
uint count_sky(vec3 origin, vec3 n, uint sample_index, uvec2 pattern, inout uint rays)
{
    vec3 t, b;
    uint seen = 0u;

    basis_of(n, t, b);
    for (uint s = pc.sky; s < pc.sky_end; s++) {
        const uint at = sample_index * pc.ambient_samples + s;
        const pell_point2 disc = pell_disc_at(pell_unit_float(pell_sobol0(at) ^ pattern.x), pell_unit_float(pell_sobol1(at) ^ pattern.y));
        const float z = sqrt(max(1.0 - disc.x * disc.x - disc.y * disc.y, 0.0));
        const vec3 direction = n * z + disc.x * t + disc.y * b;
        vec3 through = vec3(1.0);
        rays++;
        if (!is_unoccluded(origin, direction, FAR))
            through = (pc.flags & PELL_LIT_PASSES) != 0u ? pass_shadow(origin, direction, FAR, PELL_THROUGH_AMBIENT, rays) : vec3(0.0);
        seen += pell_through_ambient(through.r, through.g, through.b);
    }
    return seen;
}
