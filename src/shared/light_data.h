/* SPDX-License-Identifier: MIT
 *
 * light_data.h - a prepared light source as plain data, with the same bytes in C and in a GLSL buffer (std430). CPU-only data, its
 * projected image and its grid of triangles, is in the prepared light itself (lights/lights.h).
 *
 * Units    mm; power in W/sr, W/m^2 or, for rect and disc, radiance x mm^2.
 */
#ifndef PELL_SHARED_LIGHT_DATA_H
#define PELL_SHARED_LIGHT_DATA_H

#include "shared/language.h"

/* Types, with the values of enum pell_light_type. */
#define PELL_LIGHT_DATA_POINT 0
#define PELL_LIGHT_DATA_SPOT 1
#define PELL_LIGHT_DATA_DIRECTIONAL 2
#define PELL_LIGHT_DATA_RECT 3
#define PELL_LIGHT_DATA_DISC 4

/* Flag of an environment's light that is excluded from the environment's table over the normal. */
#define PELL_LIGHT_DATA_COMPACT 1u

struct pell_light_data {
    PELL_VEC4 position;  /* w: scale, factor of 1/d_mm^2: 1e6 for W/sr, 1 for areas */
    PELL_VEC4 direction; /* unit, direction of propagation; w: 1/range, 1/mm; 0: no cut-off */
    PELL_VEC4 right, up; /* unit; rect, disc: half the extent, mm; environment: half the extent of the offsets added to the direction; w:
                          * halves of the image per unit of the plane at distance 1 */
    PELL_VEC4 power;     /* per sample; rect and disc: radiance x area / samples; w: mm^2 per sample, 0: no extent */
    float spot_scale, spot_offset; /* pell_light_cone */
    int32_t type;                  /* PELL_LIGHT_DATA_POINT etc. */
    int32_t samples;               /* per frame and multisample, >= 1 */
    int32_t environment;           /* index of its environment; -1: none */
    int32_t light;                 /* index in the scene, if it belongs to no environment */
    int32_t image;                 /* projected image, as an index of the scene's textures; -1: none */
    uint32_t flags;
};

#endif
