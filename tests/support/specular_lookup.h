/* SPDX-License-Identifier: MIT
 * specular_lookup.h - reflection and transmission of a scene's material, looked up in the renderer's tables as its kernels do. */
#ifndef PELL_TEST_SPECULAR_LOOKUP_H
#define PELL_TEST_SPECULAR_LOOKUP_H

#include "lights/specular_tables.h"

#include <string.h>

static inline struct pell_specular_table specular_table_of(const struct pell_specular_tables *t, size_t material)
{
    struct pell_specular_table table;
    memcpy(table.albedo, t->albedo[t->model[material]], sizeof(table.albedo));
    memcpy(table.mean, t->mean[t->model[material]], sizeof(table.mean));
    return table;
}

static inline const struct pell_boundary_table *boundary_of(const struct pell_specular_tables *t, size_t material)
{
    return &t->boundaries[t->boundary[material]];
}

static inline double material_albedo_f0(const struct pell_specular_tables *t, size_t material, float f0, float mu, float roughness)
{
    const struct pell_specular_table table = specular_table_of(t, material);
    return (double) pell_specular_albedo(&table, f0, mu, roughness);
}

static inline double material_albedo(const struct pell_specular_tables *t, size_t material, float mu, float roughness)
{
    return material_albedo_f0(t, material, boundary_of(t, material)->f0, mu, roughness);
}

static inline double material_mean(const struct pell_specular_tables *t, size_t material, float roughness)
{
    const struct pell_specular_table table = specular_table_of(t, material);
    return (double) pell_specular_mean(&table, boundary_of(t, material)->f0, roughness);
}

static inline double material_transmittance(const struct pell_specular_tables *t, size_t material, float mu)
{
    return (double) pell_boundary_lookup(boundary_of(t, material)->transmittance, mu);
}

#endif
