/* SPDX-License-Identifier: MIT
 *
 * surface_color.h - what textures say of a place on a surface, and the tint of a boundary.
 *
 * Where a translucent material takes its colour from the base colour b, a half-space of its medium has the reflectance b, as with the
 * methods that blur: light that enters is multiplied by b^m, and light that leaves by b^(1-m)/rho, m the material's mix, rho what the
 * half-space reflects of diffuse light that entered it. The medium says how far light spreads, the texture how much returns.
 *
 * Threads    all functions are safe.
 */
#ifndef PELL_SURFACE_COLOR_H
#define PELL_SURFACE_COLOR_H

#include <pellucid/scene.h>

/* What a map says at a point of a triangle (u, v: barycentric as in struct pell_hit); 1 where the map or its coordinates are missing. */
void pell_texel_at(const struct pell_texture_map *map, const struct pell_mesh *mesh, uint32_t triangle, float u, float v, float texel[4]);

/* Base colour there, [0, 1]: the material's, its texture's, the vertices', less the share that is metal. */
void pell_base_color_at(const struct pell_material *m, const struct pell_mesh *mesh, uint32_t triangle, float u, float v, float rgb[3]);

/* What a boundary does to light that passes it. */
struct pell_tint {
    bool is; /* else nothing */
    float mix;
    float per_reflectance[3]; /* 1/rho */
};

void pell_tint_make(const struct pell_material *m, struct pell_tint *out);

/* Multiplies light that enters, or leaves, where the base colour is `color`. */
void pell_tint_apply(const struct pell_tint *t, const float color[3], bool enters, float light[3]);

#endif
