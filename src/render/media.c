/* SPDX-License-Identifier: MIT
 * media.c - see media.h. */
#include "render/media.h"

#include "base/base.h"
#include "optics/medium/opposed.h"
#include "optics/profile/white.h"
#include "transport/solids.h"

#include <string.h>

#define MIN_THICKNESS 1e-6f /* mm: thickness at which the tables of materials without transmission end */

/* Returns NULL if material i has no coefficients. */
static const struct pell_frame_material *medium_of(const struct pell_scene *scene, const struct pell_scene_materials *m, size_t i)
{
    const struct pell_frame_material *f = m->frame_index[i + 1] ? &m->frame[m->frame_index[i + 1] - 1] : NULL;

    return f && pell_scatters_by_medium(&scene->materials[i], f) ? f : NULL;
}

enum pell_result pell_media_curvature(struct pell_context *ctx, struct pell_pool *pool, const struct pell_scene *scene,
                                      const struct pell_rays *rays, const struct pell_scene_materials *materials,
                                      struct pell_curvature **out)
{
    struct pell_curvature_medium *media = pell_calloc(ctx, scene->num_materials + 1, sizeof(*media));
    enum pell_result res;

    if (!media)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < scene->num_materials; i++) {
        const struct pell_frame_material *f = medium_of(scene, materials, i);
        if (f)
            media[i] = (struct pell_curvature_medium) { &f->medium, f->profile };
    }
    res = pell_curvature_create(ctx, pool, scene, rays, media, out);
    pell_free(ctx, media);
    return res;
}

/* Whether diffuse light excludes a part that is scattered forward. */
static bool any_forward(const struct pell_opposed *opposed)
{
    return pell_forward_weight(fmaxf(fmaxf(opposed->kappa[0] * opposed->depth[0], opposed->kappa[1] * opposed->depth[1]),
                                     opposed->kappa[2] * opposed->depth[2])) > 0.0f;
}

/* Computes the transport of material i. Returns false if it transmits nothing. Copies the result of an earlier material with the same
 * medium. */
static bool find_transport(const struct pell_scene *scene, const struct pell_scene_materials *m, size_t i, bool thin_only, bool angles,
                           struct pell_indirect_solid *out)
{
    const struct pell_frame_material *f = medium_of(scene, m, i), *earlier = NULL;
    size_t k = 0;

    if (!f || (thin_only && !(m->thickness[i] && m->thickness[i]->max_mm > MIN_THICKNESS)))
        return false;
    while (k < i && !(out[k].profile && (earlier = medium_of(scene, m, k)) && earlier->profile == f->profile &&
                      earlier->white == f->white && memcmp(&earlier->medium, &f->medium, sizeof(f->medium)) == 0))
        k++;
    if (k < i) {
        out[i] = out[k];
        return true;
    }
    if (!pell_opposed_make(&f->medium, &out[i].opposed))
        return false;
    out[i].beams = pell_forward_make(&f->medium, &out[i].forward) && any_forward(&out[i].opposed);
    out[i].profile = f->profile;
    out[i].refracted = pell_mean_refracted((float) (1.0 / (f->medium.eta * f->medium.eta)));
    for (int c = 0; c < 3; c++) {
        const struct pell_angle *angle = m->separates_single ? &m->angle_without_single[i] : &m->angle[i];
        out[i].returned[c] = (float) pell_profile_total(&f->profile[c]);
        out[i].white[c] = (float) pell_profile_scale(&f->profile[c], f->white);
        out[i].slope[c] = angles && angle->enter_base[c] > 0.0f ? angle->enter_slope[c] / angle->enter_base[c] : 0.0f;
    }
    return true;
}

enum pell_result pell_media_solids(struct pell_context *ctx, struct pell_pool *pool, const struct pell_engine_frame *frame,
                                   const struct pell_indirect_params *params, const struct pell_indirect_lights *lights,
                                   struct pell_indirect **cached, struct pell_indirect **out)
{
    const bool thin_only = frame->plan && (frame->plan->needs & PELL_NEED_TRANSMISSION), whole_solid = frame->plan && frame->plan->opposed;
    const size_t count = params->scene->num_materials;
    struct pell_indirect_solid *solid = NULL;
    bool any = false;
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!frame->settings->opposed || !(thin_only || whole_solid || (frame->plan && frame->plan->local)))
        return PELL_OK;
    solid = pell_calloc(ctx, count, sizeof(*solid));
    if (!solid)
        goto fail;
    for (size_t i = 0; i < count; i++)
        any |= find_transport(params->scene, frame->materials, i, thin_only, frame->settings->angles, solid);
    for (size_t i = 0; i < count; i++) {
        solid[i].whole_solid = whole_solid;
        solid[i].between_faces = pell_plan_transmits(frame->plan);
    }
    res = PELL_OK;
    if (!any)
        goto fail;
    if (!*cached)
        PELL_TRY(pell_indirect_create(ctx, pool, params, cached));
    PELL_TRY(pell_indirect_solve_solids(*cached, pool, lights, solid, frame->plan ? frame->plan->mix : -1.0f));
    *out = *cached;

fail:
    if (res != PELL_OK)
        pell_indirect_destroy(cached);
    pell_free(ctx, solid);
    return res;
}
