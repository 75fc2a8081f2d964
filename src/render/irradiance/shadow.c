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

#define SORTED 16 /* samples of a lane that are put in order together */

/* The square's samples first + 0, 1, ... of a lane in an order of quadrants of quadrants: then the rays that lanes send at the same time go
 * much the same way, since each lane's samples are spread over the square alike. What a lane sees does not depend on the order. */
static void sort_lane(uint32_t first, int count, const uint32_t pattern[2], uint32_t at[SORTED][2])
{
    uint32_t place[SORTED];

    for (int s = 0; s < count; s++) {
        const uint32_t u = pell_sobol0(first + (uint32_t) s) ^ pattern[0], v = pell_sobol1(first + (uint32_t) s) ^ pattern[1];
        const uint32_t here = (u >> 30 & 2u) << 2 | (v >> 30 & 2u) << 1 | (u >> 29 & 2u) | (v >> 30 & 1u);
        int i = s;
        for (; i > 0 && place[i - 1] > here; i--) {
            place[i] = place[i - 1];
            memcpy(at[i], at[i - 1], sizeof(at[i]));
        }
        place[i] = here;
        at[i][0] = u;
        at[i][1] = v;
    }
}

/* Share of `samples` cosine-distributed directions about the normal that see nothing. */
void pell_ambient_visibility(const struct job *job, struct packet *k, const int32_t *mask, const struct pell_vec3 *origin,
                             const struct pell_vec3 *normal, uint32_t salt, float *share)
{
    const int samples = job->lights->ambient_samples;
    _Alignas(64) int32_t visible[PELL_LANES];
    struct pell_vec3 t[PELL_LANES], b[PELL_LANES];
    uint32_t pattern[PELL_LANES][2], at[PELL_LANES][SORTED][2];
    struct pell_ray16 rays;

    for (int i = 0; i < PELL_LANES; i++) {
        pell_lane_pattern(&k->lanes, i, job->lights->ambient_bits, salt, &pattern[i][0], &pattern[i][1]);
        vec3_basis(normal[i], &t[i], &b[i]);
        share[i] = 0.0f;
    }
    for (int s = 0; s < samples; s++) {
        const int place = s % SORTED, left = samples - s;
        for (int i = 0; i < PELL_LANES; i++) {
            float x, y, z;
            if (place == 0)
                sort_lane(job->p->sample * (uint32_t) samples + (uint32_t) s, left < SORTED ? left : SORTED, pattern[i], at[i]);
            pell_disc_point(pell_unit_float(at[i][place][0]), pell_unit_float(at[i][place][1]), &x, &y);
            z = sqrtf(max0(1.0f - x * x - y * y));
            pell_ray16_set(&rays, i, origin[i], vec3_mad(vec3_mad(vec3_mul(normal[i], z), x, t[i]), y, b[i]), FLT_MAX);
        }
        pell_trace_occlusion(job, k, mask, false, &rays, visible);
        for (int i = 0; i < PELL_LANES; i++)
            share[i] -= (float) visible[i];
    }
    for (int i = 0; i < PELL_LANES; i++)
        share[i] /= (float) samples;
}
