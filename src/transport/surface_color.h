/* SPDX-License-Identifier: MIT
 *
 * surface_color.h - texture values at a surface point, and the tint of a boundary.
 *
 * If a translucent material's colour is the base colour b, a half-space of its medium must have the reflectance b, as with the blurring
 * methods: entering light is multiplied by b^m, and leaving light by b^(1-m)/rho, with m the material's mix and rho the half-space's
 * reflectance for diffuse light that has entered it. The medium determines the scattering distance, the texture the amount of light.
 *
 * Threads    all functions are safe.
 */
#ifndef PELL_SURFACE_COLOR_H
#define PELL_SURFACE_COLOR_H

#include <pellucid/scene.h>

/* Value of a map at a point of a triangle (u, v: barycentric as in struct pell_hit); 1 without the map or its coordinates. */
void pell_texel_at(const struct pell_texture_map *map, const struct pell_mesh *mesh, uint32_t triangle, float u, float v, float texel[4]);

/* Base colour there, [0, 1]: the product of the material's, its texture's and the vertices', without the metallic part. */
void pell_base_color_at(const struct pell_material *m, const struct pell_mesh *mesh, uint32_t triangle, float u, float v, float rgb[3]);

/* Tint of light that crosses a boundary. */
struct pell_tint {
    bool enabled; /* false: no tint */
    float mix;
    float per_reflectance[3]; /* 1/rho */
};

void pell_tint_make(const struct pell_material *m, struct pell_tint *out);

/* Multiplies light that enters, or leaves, where the base colour is `color`. */
void pell_tint_apply(const struct pell_tint *t, const float color[3], bool enters, float light[3]);

#endif
