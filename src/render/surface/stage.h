/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "surface": the visible surface of each pixel, one sample per pixel. Planes of floats as in struct pell_frame: pixel (x,
 * y) at [y * stride + x], rows 64-byte aligned. Where `material` is 0 nothing was hit and the other planes are undefined.
 */
#ifndef PELL_SURFACE_H
#define PELL_SURFACE_H

#include "render/camera_view.h"
#include "visibility/tile_raster.h"

#include <pellucid/render.h>

/* Data created once per scene: mipmaps of its textures, so that far surfaces do not alias, and whether it has thin sheets. */
struct pell_mips;

PELL_NODISCARD enum pell_result pell_mips_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_pool *pool,
                                                 struct pell_mips **out);
void pell_mips_destroy(struct pell_mips **mips);

/* Packs the images of the scene's maps into 32-bit words for a device. Returns their number; `out` NULL: they are not written.
 *   256 linear values, of 65535, for sRGB of 8 bits, and 256 for linear values of 8 bits; for each material and enum pell_map PELL_MIPS_MAP
 *   words: first word of its image (PELL_MIPS_NONE: no map), UV set + 256 channel + 1024 where the nearest texel is read + 65536 wrap_u +
 *   16777216 wrap_v, matrix. Images: levels, width, height, 1 where level 0 is RGBA of 8 bits, + 2 where that is sRGB, + 4 where it is
 *   of floats, + 8 where smaller levels are; of each level first word, width and height. All else is RGBA of 16 bits. */
enum { PELL_MIPS_HEAD = 512, PELL_MIPS_MAP = 8 };
#define PELL_MIPS_NONE UINT32_MAX
size_t pell_mips_words(const struct pell_mips *mips, const struct pell_scene *scene, uint32_t *out);

struct pell_surface {
    int width, height;
    ptrdiff_t stride;
    const struct pell_mips *mips; /* borrowed: set by the caller after pell_surface_allocate; NULL: minified textures alias */
    struct pell_raster *raster;   /* likewise: for the scene and this size; NULL: camera visibility is ray traced */
    uint16_t *material;           /* scene material + 1; 0: nothing. A scene of more than 65534 materials is refused */
    float *depth;                 /* mm along the view axis */
    float *ng[3];                 /* geometric normal, unit, on the side of the viewer */
    float *ns[3];             /* shading normal, unit, after the normal map; bent to the viewer's side where interpolation turned it away */
    float *base[3];           /* base colour, linear: factor x map x vertex colour */
    float *roughness;         /* perceptual, [0.03, 1]; includes the bumps of a normal map that are smaller than a pixel */
    float *slope_variance;    /* slope variance of shading normals inside a pixel; written where `spread` > 0 */
    float spread;             /* set by the caller: footprint of a sample as variance along an axis, square pixels; 0: none */
    float *metallic;          /* [0, 1] */
    float *specular[3];       /* rho_s x map x tint: scales the specular lobe */
    float *strength;          /* of scattering, [0, 1] */
    bool omit_uniform;        /* set by the caller: do not write base, roughness, metallic and specular where pell_surface_is_plain gives
                               * them all */
    float *terminator_offset; /* mm along ng from the triangle to the smooth surface that its normals suggest: origin of shadow rays */
    float *emissive[3];       /* radiance; written where `any_emissive` */
    float *transmission[3];   /* for thin sheets: transmitted fraction of diffuse light, with its colour, without metal; 0 elsewhere */
    float *reflection;        /* the remaining fraction, 1 elsewhere. Both are written where `any_thin` */
    uint32_t *mesh, *triangle;    /* hit mesh and triangle of the scene. The caller's planes, set after pell_surface_allocate; NULL: not
                                * required */
    float *barycentric[2];        /* with `triangle`: u, v as in struct pell_hit16 */
    bool any_emissive;            /* some material of the scene emits */
    bool any_thin;                /* some material of the scene is a thin sheet */
    struct pell_rect covered;     /* bounds of the pixels with a hit */
    struct pell_rect translucent; /* bounds of the pixels with translucent materials */
    int64_t covered_pixels, translucent_pixels;
    int64_t rays;  /* traced, or rasterized instead: pixels that were sampled */
    void *scratch; /* private: per task, made in pell_surface_allocate so that a frame allocates nothing */
};

/* Whether roughness, metallic and specular are the same wherever a material is visible, as in pell_surface_uniform: a block of one such
 * material need not read five planes. Normal maps are excluded, since bumps that are smaller than a pixel make lobes wider. */
static inline bool pell_surface_is_uniform(const struct pell_material *m)
{
    return !m->normal_map.texture && !m->roughness_map.texture && !m->metallic_map.texture && !m->rho_s_map.texture &&
           !m->specular_color_map.texture;
}

/* Uniform, without base colour or metal: light that enters and leaves depends on none of the four planes. */
static inline bool pell_surface_is_plain(const struct pell_material *m)
{
    return !m->opaque && m->metallic == 0.0f && m->color_from != PELL_COLOR_FROM_TEXTURE && pell_surface_is_uniform(m);
}

struct pell_surface_uniform {
    float roughness, specular[3];
};

static inline struct pell_surface_uniform pell_surface_uniform(const struct pell_material *m)
{
    return (struct pell_surface_uniform) {
        .roughness = m->roughness < 0.03f  ? 0.03f
                     : m->roughness > 1.0f ? 1.0f
                                           : m->roughness,
        .specular = { m->rho_s * m->specular_color[0], m->rho_s * m->specular_color[1], m->rho_s * m->specular_color[2] },
    };
}

/* Value of `spread` for a sample: docs/adr/0060. With a lens each part of the image comes from few samples, and a highlight narrower
 * than their pixels would become beads. Without a lens lobes are unchanged: wider ones lose light at silhouettes. */
static inline float pell_surface_spread(const struct pell_settings *s)
{
    return s->dof ? 0.05f : 0.0f;
}

PELL_NODISCARD enum pell_result pell_surface_allocate(struct pell_context *ctx, int width, int height, struct pell_surface *surface);
void pell_surface_finish(struct pell_context *ctx, struct pell_surface *surface);

/* Fills the planes. Allocates nothing. The result does not depend on the number of threads, to the bit. */
PELL_NODISCARD enum pell_result pell_surface_render(struct pell_pool *pool, const struct pell_rays *rays, const struct pell_scene *scene,
                                                    const struct pell_view *view, struct pell_surface *surface);

/* Computes the surface at 16 hits that need not be visible, as if seen along packet->ray from pixels of `spacing` mm; `hits`: bits of valid
 * lanes. `out` is a surface of 4 x 4 pixels with a stride of 4 whose planes are the caller's; its `mips` and `omit_uniform` are set to
 * those of `like`, which was allocated. It needs no planes of emission, and those of thin sheets only where the scene has some. Allocates
 * nothing; safe from many threads. */
void pell_surface_look(const struct pell_surface *like, const struct pell_scene *scene, float spacing, const struct pell_ray_hit16 *packet,
                       uint32_t hits, struct pell_surface *out);

/* Traces a ray for each pixel that the stage samples and ignores the hits: the cost of the ray library alone, for comparison. Does not
 * write the planes. Returns seconds. */
double pell_surface_trace_bare(struct pell_pool *pool, const struct pell_rays *rays, const struct pell_scene *scene,
                               const struct pell_view *view, struct pell_surface *surface);

#endif
