/* SPDX-License-Identifier: MIT
 *
 * pellucid/material.h - the materials that are built in (data/materials).
 *
 * Threads    all functions are pure and safe.
 */
#ifndef PELLUCID_MATERIAL_H
#define PELLUCID_MATERIAL_H

#include <pellucid/gaussians.h>
#include <pellucid/medium.h>

#ifdef __cplusplus
extern "C" {
#endif

enum pell_material_kind {
    PELL_MATERIAL_MEDIUM,    /* coefficients: `medium` holds */
    PELL_MATERIAL_GAUSSIANS, /* a published sum of Gaussians: `gaussians` holds, normalised to white; colour comes from textures */
};

/* One entry of data/materials, built in. Constant data. */
struct pell_material_entry {
    const char *name;  /* "wholemilk" */
    const char *title; /* "Whole milk" */
    enum pell_material_kind kind;
    struct pell_medium medium;       /* GAUSSIANS: eta only, coefficients 0 */
    struct pell_gaussians gaussians;
    double color[3];                 /* what it looks like where nothing else says: diffuse reflectance or base colour, [0, 1] */
    double roughness;                /* of its specular lobe, (0, 1] */
    double mix;                      /* mix exponent of a colour texture, [0, 1] */
    bool color_from_texture;         /* base colour textures apply (skin presets), else the profile's own colour */
    const char *note;                /* "artistic", or what a user should know; may be "" */
    const char *source;              /* where every number comes from */
};

PELL_API size_t pell_material_count(void);
PELL_API const struct pell_material_entry *pell_material_at(size_t index); /* sorted by name; NULL past the end */
PELL_API const struct pell_material_entry *pell_material_find(const char *name); /* NULL if there is none of that name */

#ifdef __cplusplus
}
#endif
#endif
