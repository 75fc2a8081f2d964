/* SPDX-License-Identifier: MIT
 *
 * specular_tables.c - see specular_tables.h. */
#include "lights/specular_tables.h"

#include <string.h>

/* The table of an index of refraction. Only the last few are compared, so that thousands of materials with different indices cost linear
 * time; no real scene has that many. */
static uint32_t find_boundary(struct pell_specular_tables *t, double eta)
{
    for (size_t i = t->num_boundaries; i > 0 && t->num_boundaries - i < 64; i--)
        if (t->boundaries[i - 1].eta == eta)
            return (uint32_t) (i - 1);
    pell_boundary_table_make(eta, &t->boundaries[t->num_boundaries]);
    return (uint32_t) t->num_boundaries++;
}

static size_t count_etas(const struct pell_scene *scene)
{
    size_t n = 0;
    for (size_t i = 0; i < scene->num_materials; i++)
        n += i == 0 || scene->materials[i].medium.eta != scene->materials[i - 1].medium.eta;
    return n;
}

void pell_specular_tables_choose(struct pell_specular_tables *t, const struct pell_scene *scene, int lobe)
{
    for (size_t i = 0; i < t->num_materials; i++) {
        const enum pell_specular_model own = lobe > 0 ? (enum pell_specular_model)(lobe - 1) : scene->materials[i].specular;
        const enum pell_specular_model model = pell_specular_known(own);
        struct pell_specular_table table;
        t->model[i] = (uint8_t) model;
        if (t->made[model])
            continue;
        pell_specular_table_make(model, &table);
        memcpy(t->mean[model], table.mean, sizeof(table.mean));
        memcpy(t->albedo[model], table.albedo, sizeof(table.albedo));
        t->made[model] = true;
    }
}

enum pell_result pell_specular_tables_create(struct pell_context *ctx, const struct pell_scene *scene, int lobe,
                                             struct pell_specular_tables **out)
{
    const size_t n = scene->num_materials;
    struct pell_specular_tables *t = pell_zalloc(ctx, sizeof(*t));

    *out = NULL;
    if (!t)
        return PELL_ERR_NOMEM;
    t->ctx = ctx;
    t->num_materials = n;
    t->model = pell_calloc(ctx, n ? n : 1, sizeof(*t->model));
    t->boundary = t->model ? pell_calloc(ctx, n ? n : 1, sizeof(*t->boundary)) : NULL;
    t->boundaries = t->boundary ? pell_calloc(ctx, n ? count_etas(scene) : 1, sizeof(*t->boundaries)) : NULL;
    if (!t->boundaries) {
        pell_specular_tables_destroy(&t);
        return PELL_ERR_NOMEM;
    }
    for (size_t i = 0; i < n; i++) {
        const struct pell_material *m = &scene->materials[i];
        const double eta = m->medium.eta >= 1.0 && m->medium.eta <= 4.0 ? m->medium.eta : 1.5;
        t->boundary[i] = i > 0 && scene->materials[i - 1].medium.eta == m->medium.eta ? t->boundary[i - 1] : find_boundary(t, eta);
    }
    pell_specular_tables_choose(t, scene, lobe);
    *out = t;
    return PELL_OK;
}

void pell_specular_tables_destroy(struct pell_specular_tables **tables)
{
    struct pell_specular_tables *t = *tables;
    if (!t)
        return;
    *tables = NULL;
    pell_free(t->ctx, t->model);
    pell_free(t->ctx, t->boundary);
    pell_free(t->ctx, t->boundaries);
    pell_free(t->ctx, t);
}
