/* SPDX-License-Identifier: MIT
 *
 * layers.h - layers of scene materials, texture-mapped or uniform: their maps, their validity, and their total reflectance.
 */
#ifndef PELL_SCENE_LAYERS_H
#define PELL_SCENE_LAYERS_H

#include "base/base.h"

#include <pellucid/layers.h>
#include <pellucid/scene.h>

#define PELL_LAYER_DEPTH_MAX 1e6f /* mm */

/* All channels of a depth map at texture coordinates of the mesh, before `inverse`. */
void pell_layer_texel(const struct pell_texture_map *map, float u, float v, float rgba[4]);
/* Whether one look-up serves both maps. */
bool pell_layer_maps_alike(const struct pell_texture_map *a, const struct pell_texture_map *b);
/* The fraction of a layer's `depth` that a channel value represents: >= 0. */
static inline float pell_layer_depth_fraction(float value, bool inverse)
{
    const float fraction = inverse ? 1.0f - value : value;
    return fraction > 0.0f ? fraction : 0.0f;
}

/* --- Validity ----------------------------------------------------------------------------------------------------------------- */

struct pell_layer_fault {
    char field[160]; /* "layer 2: sigma_a[0]" */
    double value, min, max;
};

/* Whether an image has that channel. */
bool pell_layer_has_channel(const struct pell_image *image, int channel);
/* Checks all texels that a layer uses. */
bool pell_layer_texels_valid(const struct pell_scene_layer *layer, struct pell_layer_fault *fault);
/* Checks all of a material's layers: numbers, maps and every texel of them. */
bool pell_scene_layers_valid(const struct pell_material *m, struct pell_layer_fault *fault);

/* --- Total reflectance -------------------------------------------------------------------------------------------------------- */

/* Bottoms of a layer over its map, mm; where layers cross, the upper one wins. */
struct pell_layer_measure {
    double min, mean, max;
    int64_t crossings; /* texels where the mapped bottom lies above that of a layer above it */
};

/* Measures over the texels of the largest map, for all layers whose maps use the same UV set; others are measured alone, and without
 * crossings. `out` has room for m->num_layers. Returns the number of texels; 0: no layer has a map. */
int64_t pell_scene_layers_measure(const struct pell_material *m, struct pell_layer_measure *out);

/* The layers whose bottoms lie at `bottoms` (mm, rising, the last may be INFINITY) and the substrate, as diffusion solvers accept them:
 * layers too thin to resolve are left out, neighbours of one medium are joined, excess layers are merged. */
void pell_scene_layers_stack(const struct pell_material *m, const double *bottoms, struct pell_stack *out);

/* The built-in stack that a material uses; NULL: none. A scene keeps only a stack's reflectance and name: it counts as the built-in one as
 * long as that reflectance is unchanged. */
const struct pell_material_entry *pell_scene_layers_preset(const struct pell_material *m);
/* The stack that m->gaussians was computed from: its layers at their mean depths, or a built-in one. False: none. */
bool pell_scene_profile_stack(const struct pell_material *m, struct pell_stack *out);

/* Sets m->gaussians to the reflectance of the layers at their mean depths (`measure`), and m->medium to their mean. False: they reflect no
 * light that a sum of Gaussians could represent, and only the medium is set. */
bool pell_scene_layers_solve(struct pell_material *m, const struct pell_layer_measure *measure);

/* Frees them. */
void pell_scene_layers_finish(struct pell_context *ctx, struct pell_material *m);

#endif
