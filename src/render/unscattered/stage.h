/* SPDX-License-Identifier: MIT
 *
 * stage.h - stage "unscattered": light that passes thin parts of translucent media, or weak media, without being scattered. It goes along
 * one way through each pixel,
 *
 *     L = Prod T exp(-sigma_t d) L'       T: what each boundary lets through, d: of each part in a medium, sigma_t: not reduced
 *
 * refracted at each boundary by interpolated normals, and reflected inside where none of it can leave. L' is what is behind: lights with a
 * face, environments, and what surfaces there reflect, as diffuse surfaces with the light that enters them. Rough boundaries make a lobe of
 * the way (lobe.h), which faces of lights are seen through, and lights without extent by its density; where a way goes, and whether it
 * comes out, is drawn from the middle of that (facets.h). L is radiance over the square of the index, so that indices cancel from the open
 * to the open.
 *
 * Faces and environments are seen as wide as pixels are apart there; where these come out far from each other, as by chance or because
 * that was drawn, they share what they see (stray.c).
 *
 * What a slab transmits (pellucid/layers.h), and what is scattered forward (optics/medium/forward.h), holds none of this.
 *
 * Left out: what boundaries reflect beside what they let through, opaque things inside solids, media without coefficients, layers and
 * colours of textures, and light that is focused on what is behind.
 */
#ifndef PELL_UNSCATTERED_H
#define PELL_UNSCATTERED_H

#include "render/indirect/stage.h"

/* The media that have it. */
struct pell_unscattered;

/* *out is NULL where no material's parts are thin enough. PELL_ERR_NOMEM. */
PELL_NODISCARD enum pell_result pell_unscattered_create(struct pell_context *ctx, const struct pell_scene *scene,
                                                        const struct pell_rays *rays, const uint16_t *frame_index,
                                                        const struct pell_frame_material *materials, struct pell_unscattered **out);
void pell_unscattered_destroy(struct pell_unscattered **unscattered);

struct pell_unscattered_params {
    const struct pell_scene *scene;
    const struct pell_rays *rays;
    const struct pell_lights *lights;
    const struct pell_specular_tables *tables;
    const struct pell_view *view;
    const struct pell_surface *surface; /* with its meshes */
    struct pell_indirect_lights behind; /* light that enters surfaces behind */
    const float (*total)[3];            /* per scene material: total reflectance of its profile */
    bool smooth;                        /* boundaries */
    int bounces;                        /* how often a way through the open meets a surface */
    uint32_t sample;
    float *light[3]; /* W/(m^2 sr), written at the translucent pixels of the surface */
};

/* Returns the number of rays. Allocates nothing; the same bits for any number of threads. */
int64_t pell_unscattered_render(struct pell_pool *pool, const struct pell_unscattered *unscattered,
                                const struct pell_unscattered_params *params);

#endif
