/* SPDX-License-Identifier: MIT
 * engine_cpu_lend.c - light at any points, for methods and for the engine's own stages. */
#include "render/engine_cpu_state.h"

struct pell_irradiance_params pell_cpu_light(const struct pell_cpu *e, float mix, bool separate_single)
{
    return (struct pell_irradiance_params) {
        .rays = e->rays,
        .scene = e->scene,
        .surface = &e->surface,
        .tables = e->tables,
        .mix = mix,
        .smooth = e->settings->boundary == PELL_BOUNDARY_MODEL_SMOOTH,
        .angle = separate_single       ? e->materials->angle_without_single
                 : e->settings->angles ? e->materials->angle
                                       : NULL,
        .curvature = e->curvature,
        .opposed = e->settings->opposed,
        .unscattered = e->unscattered,
        .indirect = e->indirect_solved ? e->indirect : NULL,
        .seed = pell_settings_seed(e->settings),
    };
}

struct pell_irradiance_params pell_cpu_points_light(const struct pell_cpu *e, const struct pell_points_params *params)
{
    struct pell_irradiance_params p =
        pell_cpu_light(e, params->mix, e->materials->separates_single && (e->indirect_solved || !e->indirect));

    p.solid_light = params->local && !params->flat && !e->whole_solid ? e->solid_light : NULL;
    p.between_faces = p.solid_light && e->between_faces;
    return p;
}

int64_t pell_cpu_light_points(void *engine, const struct pell_points_params *params, const struct pell_surface_points *in, size_t n,
                              const struct pell_surface_light *out)
{
    const struct pell_cpu *e = engine;
    const struct pell_irradiance_params p = pell_cpu_points_light(e, params);

    return pell_irradiance_points(e->lights, &p, params, in, n, out);
}

static const struct pell_light_grid *cpu_light_grid(void *engine, size_t light)
{
    const struct pell_cpu *e = engine;

    return e->lights ? pell_lights_grid(e->lights, light) : NULL;
}

static void activate_first(int count, int32_t active[16])
{
    for (int i = 0; i < 16; i++)
        active[i] = -(int32_t) (i < count);
}

static void cpu_transmitted(void *engine, const struct pell_points16 *points, int count, float fraction[3][16])
{
    const struct pell_cpu *e = engine;
    struct pell_indirect_insides inside = { .sum_weight = { { 0.0f } } };
    int32_t active[16];

    activate_first(count, active);
    if (e->solid_light && !e->whole_solid)
        pell_indirect_lookup16(e->solid_light, points, active, &inside);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < 16; i++)
            fraction[c][i] = (1.0f - inside.sum_weight[c][i]) * (1.0f - inside.solved[c][i]);
}

static void cpu_returned(void *engine, const struct pell_points16 *points, int count, float factor[3][16], float crossed[3][16])
{
    const struct pell_cpu *e = engine;
    struct pell_indirect_insides inside = { .sum_weight = { { 0.0f } } };
    struct pell_curvature_effects effects;
    int32_t active[16];

    activate_first(count, active);
    if (e->curvature)
        pell_curvature_effects_at(e->curvature, points, active, &effects);
    if (e->solid_light)
        pell_indirect_lookup16(e->solid_light, points, active, &inside);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < 16; i++) {
            const float remaining = 1.0f - inside.solved[c][i];
            factor[c][i] = e->curvature ? 1.0f + remaining * (effects.returned[c][i] - 1.0f) : 1.0f;
            crossed[c][i] = e->curvature ? 1.0f + remaining * (effects.crossed[c][i] - 1.0f) : 1.0f;
        }
}

void pell_cpu_lend(void *engine, struct pell_services *services)
{
    struct pell_cpu *e = engine;

    services->rays = e->rays;
    services->engine = e;
    services->light_points = pell_cpu_light_points;
    services->light_grid = cpu_light_grid;
    services->transmitted = cpu_transmitted;
    services->returned = cpu_returned;
}
