/* SPDX-License-Identifier: MIT
 * refracted.c - light along exact refracted paths (refraction=exact), found as in single-scatter. */
#include "methods/layered/state.h"

#include "transport/refraction/connect.h"

/* Upper bound of focused light, relative to a flat boundary: a node represents all points of the march around it, and caustics are thin. */
#define FOCUSED 16.0

enum pell_result layered_refracted_make(struct layered_state *st, const struct pell_scene *scene)
{
    enum pell_result res;

    PELL_TRY(pell_services_solids(st->services, &st->solids));
    PELL_TRY(pell_connector_create(st->ctx, scene, st->services->rays, st->solids, false, &st->connector));

fail:
    return res;
}

void layered_refracted_destroy(struct layered_state *st)
{
    pell_connector_destroy(&st->connector);
    pell_solids_destroy(&st->solids);
}

/* Irradiance at x behind a flat boundary, the bound for focused light. */
static double flat_spread(const struct pell_connection *c, double eta)
{
    const double co = (double) vec3_dot(c->normal, c->outside), ci = sqrt(1.0 - (1.0 - co * co) / (eta * eta));
    const double far = c->outside_mm < (double) INFINITY ? c->outside_mm + c->inside_mm : 1.0;

    return fmax(co, 1e-3) / (ci * far * far);
}

bool layered_refract(const struct layered_state *st, const struct layered_medium *m, int solid, struct pell_vec3 x, bool distant,
                     struct pell_vec3 light, struct layered_entry *out, int64_t *rays)
{
    struct pell_connection paths[PELL_CONNECTIONS];
    const struct pell_connection_query query = {
        .solid = solid, .eta = (double) m->eta, .x = x, .light = light, .distant = distant, .reach = 4.0 * (double) st->size
    };
    const int n = solid >= 0 ? pell_connect(st->connector, &query, paths, PELL_CONNECTIONS, rays) : 0;
    double beam = 0.0;

    if (n == 0)
        return false;
    for (int i = 0; i < n; i++) {
        const double longer = (paths[i].inside_mm - paths[0].inside_mm) * (double) m->first;
        beam += paths[i].transmit * fmin(paths[i].spread, FOCUSED * flat_spread(&paths[i], query.eta)) * exp(-longer);
    }
    *out = (struct layered_entry) { .mesh = paths[0].mesh,
                                    .triangle = paths[0].triangle,
                                    .u = paths[0].u,
                                    .v = paths[0].v,
                                    .km = (float) paths[0].inside_mm,
                                    .cosine = fmaxf(vec3_dot(paths[0].normal, paths[0].inside), LAYERED_GRAZING),
                                    .dir = paths[0].inside,
                                    .beam = isfinite(beam) ? (float) fmin(beam, 1e30) : 0.0f };
    return true;
}
