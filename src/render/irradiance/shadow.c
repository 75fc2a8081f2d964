/* SPDX-License-Identifier: MIT
 *
 * shadow.c - what lies between points and a light or the environment, asked of a light's grid of triangles or of rays.
 */
#include "render/irradiance/internal.h"

#include <float.h>
#include <string.h>

void pell_trace_occlusion(const struct job *job, struct packet *k, const int32_t *mask, bool coherent, struct pell_ray16 *rays,
                          int32_t *visible)
{
    pell_rays_occluded16(job->p->rays, mask, coherent, rays);
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

/* The light of the sky: share of `samples` cosine-distributed directions about sky->normal that see nothing. A lane's samples are those
 * that it would take in the sequence's order, so that what it sees does not depend on the order. */
void pell_ambient_visibility(const struct job *job, struct packet *k, const int32_t *mask, uint32_t salt, struct pell_sky *sky,
                             float share[PELL_LANES])
{
    const struct pell_sky_kernels *kernels = job->sky;
    const uint32_t samples = (uint32_t) job->lights->ambient_samples, first = job->p->sample * samples;
    uint32_t number[2][1 << PELL_SKY_BITS];
    _Alignas(64) int32_t visible[PELL_LANES];
    struct pell_ray16 rays;

    sky->bits = 0; /* a run of so many numbers has one in each part of the square */
    while (sky->bits < PELL_SKY_BITS && !(samples >> sky->bits & 1u))
        sky->bits++;
    kernels->make(&k->lanes, job->lights->ambient_bits, salt, sky);
    memset(share, 0, PELL_LANES * sizeof(*share));
    for (uint32_t s = 0; s < samples; s++) {
        const uint32_t run = 1u << sky->bits, j = s & (run - 1u);
        for (uint32_t n = first + s; j == 0 && n < first + s + run; n++) {
            const uint32_t u = pell_sobol0(n), v = pell_sobol1(n), part = pell_sky_part(u, v, sky->bits);
            number[0][part] = u;
            number[1][part] = v;
        }
        kernels->rays(sky, (const uint32_t(*)[1 << PELL_SKY_BITS]) number, j, &rays);
        pell_trace_occlusion(job, k, mask, false, &rays, visible);
        for (int i = 0; i < PELL_LANES; i++)
            share[i] -= (float) visible[i];
    }
    for (int i = 0; i < PELL_LANES; i++)
        share[i] /= (float) samples;
}
