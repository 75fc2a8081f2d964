/* SPDX-License-Identifier: MIT
 *
 * pellucid/material.h - the built-in materials (data/materials): measured media and solutions, published sums of Gaussians,
 * stacks of layers.
 *
 * Units      mm, 1/mm; colours linear Rec.709. Channel 0, 1, 2 = R, G, B.
 * Ownership  numbers and arrays are the caller's; what is returned by pointer is constant data.
 * Errors     enum pell_result; nothing is logged here: the caller knows the names.
 * Threads    all functions are pure and safe.
 */
#ifndef PELLUCID_MATERIAL_H
#define PELLUCID_MATERIAL_H

#include <pellucid/gaussians.h>
#include <pellucid/medium.h>
#include <pellucid/phase.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Values are stable. */
enum pell_material_kind {
    PELL_MATERIAL_MEDIUM,    /* coefficients, in `medium` */
    PELL_MATERIAL_GAUSSIANS, /* a published sum of Gaussians, in `gaussians`, normalised to white; textures give the colour */
    PELL_MATERIAL_LAYERS,    /* a stack, in `layers`; `gaussians` is its reflectance profile, with the total in the weights */
};

#define PELL_MATERIAL_LAYERS_MAX 8
#define PELL_CONCENTRATION_MAX 1000.0

/* One layer of a material. */
struct pell_material_layer {
    char name[32];              /* "epidermis"; a label */
    double thickness_mm;        /* [1e-6, 1e6]; INFINITY for a last layer without a bottom */
    struct pell_medium medium;  /* its g is the mean cosine of `phase`; its eta is relative to the medium outside the stack */
    struct pell_phase phase[3]; /* per channel; isotropic where only the reduced coefficient is known */
};

/* Layers from top to bottom, in air. */
struct pell_material_layers {
    int count; /* 1..PELL_MATERIAL_LAYERS_MAX; 0: none */
    struct pell_material_layer item[PELL_MATERIAL_LAYERS_MAX];
};

/* One entry of data/materials, built in. Constant data. */
struct pell_material_entry {
    const char *name;  /* "wholemilk" */
    const char *title; /* "Whole milk" */
    enum pell_material_kind kind;
    const char *family;                 /* origin of the numbers, by which lists are grouped: "Jensen et al. 2001", "artistic"; may be "" */
    struct pell_medium medium;          /* MEDIUM at `concentration`; else eta only, coefficients 0 */
    double concentration;               /* MEDIUM: relative to the source's, 1 if undiluted; else 0 */
    double dilution;                    /* dilution factor of the measured sample; 0: not a measured solution */
    struct pell_gaussians gaussians;    /* not MEDIUM */
    struct pell_material_layers layers; /* LAYERS */
    double color[3];                    /* default colour: diffuse reflectance or base colour, [0, 1] */
    double roughness;                   /* roughness of the specular lobe, (0, 1] */
    double mix;                         /* mix exponent of a colour texture, [0, 1] */
    bool color_from_texture;            /* base colour textures apply (skin presets), else the profile's own colour */
    const char *note;                   /* "artistic", or a note for users; may be "" */
    const char *source;                 /* source of every number */
};

/* The built-in materials, sorted by name; NULL for an index of pell_material_count() or more. Constant data. */
PELL_API size_t pell_material_count(void);
PELL_API const struct pell_material_entry *pell_material_at(size_t index);
PELL_API const struct pell_material_entry *pell_material_find(const char *name); /* NULL for an unknown name */

/* Sets *out to the entry at another concentration, relative to that of its coefficients. sigma_a and
 * sigma_s are proportional to it (Narasimhan et al. 2006, section 3; particles do not shadow each other); g, eta and the diffuse
 * reflectance do not change; absorption by the water itself is not included. `out` may be `entry`. PELL_ERR_INVALID, *out unchanged: the
 * entry is no medium, the concentration is not in (0, PELL_CONCENTRATION_MAX], or coefficients leave the range of pell_medium_valid. */
PELL_API PELL_NODISCARD enum pell_result pell_material_dilute(const struct pell_material_entry *entry, double concentration,
                                                              struct pell_material_entry *out);

/* The stack for the solvers of pellucid/layers.h, which also check it (pell_stack_valid). Layers beyond the maximum
 * are dropped. */
struct pell_stack;
PELL_API void pell_material_stack(const struct pell_material_layers *layers, struct pell_stack *out);

#define PELL_MATERIAL_LAYERS_GAUSSIANS 6

/* The reflectance profile of a stack as a sum of PELL_MATERIAL_LAYERS_GAUSSIANS Gaussians with shared variances: its profiles by the Hankel
 * solver (pell_stack_profile), fitted with each channel's total kept (pell_fit_profiles). Some seven milliseconds and 230 KiB of stack.
 * `report` may be NULL. PELL_ERR_INVALID, *out unchanged: the stack is invalid or reflects nothing. */
PELL_API PELL_NODISCARD enum pell_result pell_material_solve(const struct pell_material_layers *layers, struct pell_gaussians *out,
                                                             struct pell_fit_report *report);

#ifdef __cplusplus
}
#endif
#endif
