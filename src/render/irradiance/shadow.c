/* SPDX-License-Identifier: MIT
 *
 * shadow.c - what lies between points and a light or the environment, asked of a light's grid of triangles or of rays.
 */
#include "render/irradiance/internal.h"

#include <float.h>

/* visible = mask where nothing is in the way. */
void pell_trace_occlusion(const struct job *job, struct packet *k, const int32_t *mask, struct pell_ray16 *rays, int32_t *visible)
{
    pell_rays_occluded16(job->p->rays, mask, true, rays);
    for (int i = 0; i < PELL_LANES; i++)
        visible[i] = mask[i] & -(int32_t) (rays->tfar[i] >= 0.0f);
    k->rays += count_lanes(mask);
}

/* The same for points that a light may light, where the light has a light grid and the points are neighbours. */
bool pell_ask_light_grid(const struct pell_light_source *source, struct packet *k, const int32_t *mask, const float *x, const float *y,
                         const float *z, int32_t *visible)
{
    if (!source->grid || !pell_light_grid_visible16(source->grid, mask, x, y, z, visible))
        return false;
    k->rays += count_lanes(mask);
    return true;
}

/* Share of `samples` cosine-distributed directions about the normal that see nothing. */
void pell_ambient_visibility(const struct job *job, struct packet *k, const int32_t *mask, const struct pell_vec3 *origin,
                             const struct pell_vec3 *normal, uint32_t salt, float *share)
{
    const int samples = job->lights->ambient_samples;
    _Alignas(64) int32_t visible[PELL_LANES];
    struct pell_vec3 t[PELL_LANES], b[PELL_LANES];
    uint32_t pattern[2][PELL_LANES];
    struct pell_ray16 rays;

    for (int i = 0; i < PELL_LANES; i++) {
        pell_lane_pattern(&k->lanes, i, job->lights->ambient_bits, salt, &pattern[0][i], &pattern[1][i]);
        vec3_basis(normal[i], &t[i], &b[i]);
        share[i] = 0.0f;
    }
    for (int s = 0; s < samples; s++) {
        const uint32_t n = job->p->sample * (uint32_t) samples + (uint32_t) s, u0 = pell_sobol0(n), u1 = pell_sobol1(n);
        for (int i = 0; i < PELL_LANES; i++) {
            float x, y, z;
            pell_disc_point(pell_unit_float(u0 ^ pattern[0][i]), pell_unit_float(u1 ^ pattern[1][i]), &x, &y);
            z = sqrtf(max0(1.0f - x * x - y * y));
            pell_ray16_set(&rays, i, origin[i], vec3_mad(vec3_mad(vec3_mul(normal[i], z), x, t[i]), y, b[i]), FLT_MAX);
        }
        pell_trace_occlusion(job, k, mask, &rays, visible);
        for (int i = 0; i < PELL_LANES; i++)
            share[i] -= (float) visible[i];
    }
    for (int i = 0; i < PELL_LANES; i++)
        share[i] /= (float) samples;
}
