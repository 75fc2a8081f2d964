/* SPDX-License-Identifier: MIT
 *
 * pellucid/frame.h - the input of a method for one view of one scene, on the cpu engine: planes of floats.
 *
 * A plane holds pixel (x, y) at [y * stride + x], top row first. Rows that the library allocates are 64-byte aligned (stride is a
 * multiple of 16); a caller's own planes may have any stride >= width. Planes that a method does not need may be NULL.
 * Where `material` is 0 the other planes are undefined: those values (even NaN) must not affect a result.
 *
 * Units      mm, pixels, irradiance W/m^2, radiance W/(m^2 sr); colour linear Rec.709, 0, 1, 2 = R, G, B.
 * Ownership  all planes and materials are borrowed from the caller that fills the struct.
 * Errors     this header has no functions; functions that take a frame check it.
 * Threads    a frame is plain data; a method only reads it, so threads may share it.
 */
#ifndef PELLUCID_FRAME_H
#define PELLUCID_FRAME_H

#include <pellucid/material.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Properties of one translucent material. */
struct pell_frame_material {
    struct pell_medium medium;
    struct pell_gaussians gaussians;    /* count > 0: the profile is exactly this sum */
    const struct pell_profile *profile; /* three, for R, G and B, borrowed; NULL: from `gaussians`, or the dipole of `medium`; never NULL
                                         * in a frame that a method reads */
    bool white;                         /* normalise each channel's profile to 1: the irradiance includes the colour */
    const char *name;                   /* for messages; NULL: "" */
    const char *preset;                 /* the built-in material (pell_material_find) that defines medium and Gaussians; NULL: none */
    float strength; /* scale of the scattering radius in methods that read no plane `strength` (PELL_NEED_STRENGTH), [0, 1]; 0: 1 */
    const struct pell_stack
        *stack; /* the layers whose reflectance is `gaussians`; thin parts have these layers below both faces; borrowed; NULL: none */
};

#define PELL_FRAME_MATERIALS 4095

/* The properties of a frame that do not depend on pixels: a pass is created for one shape. */
struct pell_frame_shape {
    int width, height; /* px, [1, 65536] */
    ptrdiff_t stride;  /* floats from row to row, >= width */
    bool orthographic;
    float focal_px;      /* perspective: pixels per mm at depth d is focal_px / d; orthographic: pixels per mm */
    float object_height; /* mm; for methods whose papers measure depth in object heights */
    const struct pell_frame_material *materials;
    size_t num_materials; /* [1, PELL_FRAME_MATERIALS] */
};

struct pell_view;

struct pell_frame {
    struct pell_frame_shape shape;

    /* Properties of this sample of the frame. A caller with its own planes may leave all of them 0. */
    int sample, num_samples;      /* index of the multisample in [0, num_samples), and their count */
    bool first;                   /* first sample of the frame for which the method runs; samples without a translucent pixel are skipped */
    uint32_t seed;                /* seed of the method's random numbers */
    uint64_t lights_revision;     /* changes whenever the scene's lights or their samples change; 0: no scene */
    const struct pell_view *view; /* the sample's camera, private to the library; NULL: no scene */

    /* The pixels: planes, one row each of pell_plane_at. */
    struct pell_rect rect;           /* contains every pixel whose material is not 0; inside the image */
    const uint16_t *material;        /* 0: not translucent; i + 1: materials[i]; above num_materials: the same as 0. Only pixels with
                                 * equal ids exchange light: separate objects of one medium need separate materials, which may share a
                                 * profile; all parts of one object share an id */
    const float *depth;              /* mm along the view axis, > 0 */
    const float *strength;           /* scales the scattering radius, [0, 1]; NULL: 1 */
    const float *base[3];            /* base colour, where the material is `white`; undefined elsewhere. NULL: not known */
    const float *irradiance[3];      /* irradiance that the method spreads, times albedo^m: what enters the surface, less what the engine's
                                      * solution for the solid accounts for, which leaves detail of either sign. W/m^2, finite */
    const float *shaded[3];          /* the composited image without scattering: W/(m^2 sr) */
    const float *normal[3];          /* unit, shading */
    const float *position[3];        /* mm */
    const uint32_t *mesh, *triangle; /* indices of the visible triangle in the scene */
    const float *barycentric[2];     /* u, v: the point is (1 - u - v) p0 + u p1 + v p2 */
};

/* The output of a method at pixels whose material is not 0, inside the frame's rect; planes as in the frame, never the frame's own.
 * If the plan of a method has separate outputs (struct pell_plan), `light` excludes those whose planes are not NULL and includes the
 * others. */
struct pell_frame_light {
    float *light[3];   /* radiant exitance M, W/m^2, or radiance, W/(m^2 sr), as struct pell_plan declares */
    float *single[3];  /* radiance of light scattered once below the surface; may be NULL */
    float *surface[3]; /* radiance of light reflected at the surface; may be NULL */
};

/* The planes of a frame, followed by those of its light. */
enum pell_plane {
    PELL_PLANE_MATERIAL,
    PELL_PLANE_DEPTH,
    PELL_PLANE_STRENGTH,
    PELL_PLANE_BASE,
    PELL_PLANE_IRRADIANCE,
    PELL_PLANE_SHADED,
    PELL_PLANE_NORMAL,
    PELL_PLANE_POSITION,
    PELL_PLANE_MESH,
    PELL_PLANE_TRIANGLE,
    PELL_PLANE_BARYCENTRIC,
    PELL_PLANE_LIGHT,
    PELL_PLANE_SINGLE,
    PELL_PLANE_SURFACE,
    PELL_PLANES
};

enum pell_plane_format { PELL_PLANE_F32, PELL_PLANE_U16, PELL_PLANE_U32 };

/* One row of the table of planes. Allocation, transfer and checks all read it. */
struct pell_plane_info {
    const char *name; /* of the member of struct pell_frame or struct pell_frame_light */
    const char *unit; /* "1" for a pure number */
    int components;   /* [1, 3]: the number of pointers, each to a separate plane */
    enum pell_plane_format format;
    unsigned need;    /* present if the method needs one of these bits of enum pell_need; 0: always */
    unsigned output;  /* written if the plan has one of these bits of enum pell_output; 0: always, if `of_light` */
    bool optional;    /* may be NULL even if needed */
    bool of_light;    /* a member of struct pell_frame_light */
    size_t offset;    /* of the first pointer, in its struct */
    const char *what; /* one sentence, without a full stop */
};

/* The row of enum pell_plane `plane`; NULL for an invalid value. Constant data; thread-safe. */
PELL_API const struct pell_plane_info *pell_plane_at(int plane);

#define PELL_THICKNESS_STEPS 512

/* Fraction of the irradiance at a point A that leaves at a point C, where the thickness of the medium between them is d: entry i is for d =
 * max_mm (i / (PELL_THICKNESS_STEPS - 1))^2, interpolated linearly over i; 0 beyond max_mm. Dimensionless, decreasing. The fraction depends
 * on the angle between the normals at A and C: it is lerp(value, slab, max(0, -n_A.n_C)). */
struct pell_thickness_table {
    float max_mm;
    float value[PELL_THICKNESS_STEPS][3];  /* between faces that are not opposite each other */
    float slab[PELL_THICKNESS_STEPS][3];   /* between parallel faces; equals `value` if the method has no slab model */
    float spread[PELL_THICKNESS_STEPS][3]; /* mm^2: variance along one axis of the exit points; 0: light crosses without lateral spread */
};

#ifdef __cplusplus
}
#endif
#endif
