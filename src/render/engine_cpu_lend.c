/* SPDX-License-Identifier: MIT
 * engine_cpu_lend.c - light at any points, for methods and for the engine's own stages. */
#include "render/engine_cpu_state.h"

struct pell_irradiance_params pell_cpu_light(const struct pell_cpu *e, float mix, bool apart)
{
    return (struct pell_irradiance_params) {
        .rays = e->rays,
        .scene = e->scene,
        .surface = &e->surface,
        .tables = e->tables,
        .mix = mix,
        .smooth = e->settings->boundary == PELL_BOUNDARY_MODEL_SMOOTH,
        .angle = apart                 ? e->materials->angle_apart
                 : e->settings->angles ? e->materials->angle
                                       : NULL,
        .curvature = e->curvature,
        .opposed = e->settings->opposed,
        .indirect = e->lit ? e->indirect : NULL,
        .seed = pell_settings_seed(e->settings),
    };
}

struct pell_irradiance_params pell_cpu_points_light(const struct pell_cpu *e, const struct pell_points_params *params)
{
    struct pell_irradiance_params p = pell_cpu_light(e, params->mix, e->materials->single_apart && (e->lit || !e->indirect));

    p.through = params->local && !params->flat && !e->whole ? e->through : NULL;
    p.between = p.through && e->between;
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

static void cpu_transmitted(void *engine, uint32_t mesh, uint32_t triangle, float u, float v, float share[3])
{
    const struct pell_cpu *e = engine;
    struct pell_indirect_inside inside = { .thick = { 0.0f } };

    if (e->through && !e->whole)
        pell_indirect_look(e->through, mesh, triangle, u, v, &inside);
    for (int c = 0; c < 3; c++)
        share[c] = (1.0f - inside.thick[c]) * (1.0f - inside.solved[c]);
}

static void cpu_returned(void *engine, uint32_t mesh, uint32_t triangle, float u, float v, float share[3])
{
    const struct pell_cpu *e = engine;
    struct pell_curvature_effect effect = { .returned = { 1.0f, 1.0f, 1.0f } };
    struct pell_indirect_inside inside = { .thick = { 0.0f } };

    if (e->curvature)
        pell_curvature_effect_at(e->curvature, mesh, triangle, u, v, &effect);
    if (e->through)
        pell_indirect_look(e->through, mesh, triangle, u, v, &inside);
    for (int c = 0; c < 3; c++)
        share[c] = 1.0f + (1.0f - inside.solved[c]) * (effect.returned[c] - 1.0f);
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
