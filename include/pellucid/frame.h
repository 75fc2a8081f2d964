/* SPDX-License-Identifier: MIT
 *
 * pellucid/frame.h - what a method sees of one view of one scene, on the cpu engine: planes of floats.
 *
 * A plane holds pixel (x, y) at [y * stride + x], top row first. Rows are 64-byte aligned where the library makes them (stride is a
 * multiple of 16); a caller's own planes may have any stride >= width. Planes that a method did not ask for may be NULL.
 * Where `material` is 0 the other planes hold anything: methods must not let those values (not even NaN) reach a result.
 */
#ifndef PELLUCID_FRAME_H
#define PELLUCID_FRAME_H

#include <pellucid/material.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What a method must know of one translucent material. */
struct pell_frame_material {
    struct pell_medium medium;
    struct pell_gaussians gaussians;    /* count > 0: the profile is this sum, as it is */
    const struct pell_profile *profile; /* of R, G and B, borrowed; NULL: of `gaussians`, or the dipole of `medium`: methods never see
                                         * NULL */
    bool white;                         /* normalise each channel's profile to 1: the colour comes with the irradiance */
    const char *name;                   /* for messages; not NULL */
    const char *preset;                 /* the built-in medium (pell_material_find) of whose coefficients the profile is made; NULL: none,
                                         * or a profile or Gaussians of its own */
};

#define PELL_FRAME_MATERIALS 4095

struct pell_frame {
    /* The shape: known before any pixel; `create` of a method sees only these. */
    int width, height;
    ptrdiff_t stride;
    bool orthographic;
    float focal_px;         /* perspective: pixels per mm at depth d is focal_px / d; orthographic: pixels per mm */
    float object_height;    /* mm, of what is looked at: the unit of depth in papers that count it in object heights */
    const struct pell_frame_material *materials;
    size_t num_materials;   /* [1, PELL_FRAME_MATERIALS] */

    /* The pixels. */
    struct pell_rect rect;      /* holds every pixel whose material is not 0, inside the picture */
    const uint16_t *material;   /* 0: not translucent; i + 1: materials[i]; above num_materials: as 0 */
    const float *depth;         /* mm along the view axis, > 0 */
    const float *strength;      /* scales the scattering radius, [0, 1]; NULL: 1 */
    const float *base[3];       /* base colour, where the material is `white`; elsewhere anything. NULL: not known */
    const float *irradiance[3]; /* light that entered, with albedo^m: W/m^2 */
    const float *lit[3];        /* the composited picture without scattering: W/(m^2 sr) */
    const float *normal[3];     /* unit, shading */
    const float *position[3];   /* mm */
    const uint32_t *mesh, *triangle; /* of the scene, that is seen */
    const float *barycentric[2];     /* u, v: the point is (1 - u - v) p0 + u p1 + v p2 */
};

/* What a method writes, at pixels whose material is not 0, inside the frame's rect; planes as in the frame, never the frame's own.
 * A method whose plan gives a part apart (struct pell_plan) leaves it out of `light` where its planes are there; else `light` has it. */
struct pell_frame_light {
    float *light[3];   /* radiant exitance M, W/m^2, or radiance, W/(m^2 sr): struct pell_plan says which */
    float *single[3];  /* scattered once below the surface, radiance; may be NULL */
    float *surface[3]; /* reflected at the surface, radiance; may be NULL */
};

#define PELL_THICKNESS_STEPS 512

/* Share of the irradiance at A that leaves at a point whose perpendicular distance through the medium is d: entry i is for
 * d = max_mm (i / (PELL_THICKNESS_STEPS - 1))^2, interpolated linearly over i; 0 beyond max_mm. 1/1, monotone falling. */
struct pell_thickness_table {
    float max_mm;
    float value[PELL_THICKNESS_STEPS][3];
};

#ifdef __cplusplus
}
#endif
#endif
