/* SPDX-License-Identifier: MIT
 *
 * shadow.c - occlusion between points and a light or the environment, by a light's grid of triangles or by rays.
 */
#include "render/irradiance/internal.h"
#include "render/unscattered/stage.h"
#include "shared/through.h"

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

bool pell_query_light_grid(const struct pell_light_source *source, struct packet *k, const int32_t *mask, const float *x, const float *y,
                           const float *z, int32_t *visible)
{
    if (!source->grid || !pell_light_grid_visible16(source->grid, mask, x, y, z, visible))
        return false;
    k->rays += count_lanes(mask);
    return true;
}

bool pell_follow_shadow(const struct job *job, struct packet *k, const int32_t *occluded, const struct pell_ray16 *rays, bool ambient,
                        float through[3][PELL_LANES])
{
    const struct pell_irradiance_params *p = job->p;
    const struct pell_unscattered_shadow shadow = { p->unscattered, p->scene, p->rays, p->tables, p->smooth, ambient };
    float any = 0.0f;

    if (!p->unscattered || count_lanes(occluded) == 0)
        return false;
    k->rays += pell_unscattered_shadow(&shadow, occluded, rays, through);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < PELL_LANES; i++)
            any += through[c][i];
    return any > 0.0f;
}

void pell_pass_shadow(const struct job *job, const struct pell_light_data *data, const int32_t *visible, struct packet *k,
                      struct pell_sums *sums)
{
    _Alignas(64) int32_t occluded[PELL_LANES];
    _Alignas(64) float through[3][PELL_LANES];
    struct pell_ray16 rays;

    for (int i = 0; i < PELL_LANES; i++)
        occluded[i] = k->aim.front[i] & ~visible[i];
    job->kernels->shadow_rays(data, &k->lanes, &k->aim, &rays);
    if (pell_follow_shadow(job, k, occluded, &rays, false, through))
        job->kernels->pass(data, &job->tables, &k->lanes, &k->aim, occluded, (const float(*)[PELL_LANES]) through, sums);
}

/* Mean over the channels of what passes of the occluded lanes of `mask`, rounded as on a device. */
static void add_ambient_passed(const struct job *job, struct packet *k, const int32_t *mask, const int32_t *visible,
                               const struct pell_ray16 *rays, float fraction[PELL_LANES])
{
    _Alignas(64) int32_t occluded[PELL_LANES];
    _Alignas(64) float through[3][PELL_LANES];

    for (int i = 0; i < PELL_LANES; i++)
        occluded[i] = mask[i] & ~visible[i];
    if (!pell_follow_shadow(job, k, occluded, rays, true, through))
        return;
    for (int i = 0; i < PELL_LANES; i++)
        fraction[i] += (float) pell_through_ambient(through[0][i], through[1][i], through[2][i]) * (1.0f / PELL_THROUGH_WHOLE);
}

/* A lane traces its samples in the order of cells, but uses the same ones as in the sequence's order: the result does not depend on it. */
void pell_ambient_visibility(const struct job *job, struct packet *k, const int32_t *mask, uint32_t salt, struct pell_sky *sky,
                             float fraction[PELL_LANES])
{
    const struct pell_sky_kernels *kernels = job->sky;
    const uint32_t samples = (uint32_t) job->lights->ambient_samples, first = job->p->sample * samples;
    uint32_t elements[2][1 << PELL_SKY_BITS];
    _Alignas(64) int32_t visible[PELL_LANES];
    struct pell_ray16 rays;

    sky->bits = 0; /* a run of 2^bits elements has one in each cell of the square */
    while (sky->bits < PELL_SKY_BITS && !(samples >> sky->bits & 1u))
        sky->bits++;
    kernels->make(&k->lanes, job->lights->ambient_bits, salt, sky);
    memset(fraction, 0, PELL_LANES * sizeof(*fraction));
    for (uint32_t s = 0; s < samples; s++) {
        const uint32_t run = 1u << sky->bits, j = s & (run - 1u);
        for (uint32_t n = first + s; j == 0 && n < first + s + run; n++) {
            const uint32_t u = pell_sobol0(n), v = pell_sobol1(n), cell = pell_sky_cell(u, v, sky->bits);
            elements[0][cell] = u;
            elements[1][cell] = v;
        }
        kernels->rays(sky, (const uint32_t(*)[1 << PELL_SKY_BITS]) elements, j, &rays);
        pell_trace_occlusion(job, k, mask, false, &rays, visible);
        for (int i = 0; i < PELL_LANES; i++)
            fraction[i] -= (float) visible[i];
        if (job->p->unscattered) {
            kernels->rays(sky, (const uint32_t(*)[1 << PELL_SKY_BITS]) elements, j, &rays);
            add_ambient_passed(job, k, mask, visible, &rays, fraction);
        }
    }
    for (int i = 0; i < PELL_LANES; i++)
        fraction[i] /= (float) samples;
}
