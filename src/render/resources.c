/* SPDX-License-Identifier: MIT
 * resources.c - what a renderer makes for frames of some size, settings and method, and keeps from frame to frame. */
#include "render/renderer_state.h"

#include "render/plane_buffers.h"

#include <string.h>

/* --- What hangs on the size --------------------------------------------------------------------------------------------------- */

void pell_renderer_drop_size(struct pell_renderer *r)
{
    pell_surface_finish(r->ctx, &r->surface);
    pell_raster_destroy(&r->raster);
    r->rastered = false;
    pell_free(r->ctx, r->lighting.irradiance[0]); /* owns all float planes, but for those made when asked for */
    pell_free(r->ctx, r->position[0]);
    pell_free(r->ctx, r->hit[0]);
    pell_free(r->ctx, r->single[0]);
    pell_free(r->ctx, r->glow[0]);
    pell_free(r->ctx, r->open[0]);
    pell_free(r->ctx, r->open_tiles);
    pell_free(r->ctx, r->material);
    pell_free(r->ctx, r->rows);
    memset(&r->lighting, 0, sizeof(r->lighting));
    memset(&r->sum, 0, sizeof(r->sum));
    memset(r->position, 0, sizeof(r->position));
    memset(r->hit, 0, sizeof(r->hit));
    memset(r->single, 0, sizeof(r->single));
    memset(r->glow, 0, sizeof(r->glow));
    memset(r->open, 0, sizeof(r->open));
    r->open_tiles = NULL;
    memset(r->reflected, 0, sizeof(r->reflected));
    r->material = NULL;
    r->rows = NULL;
    r->sized = false;
}

static enum pell_result make_size(struct pell_renderer *r, const struct pell_settings *s)
{
    const size_t pixels = (size_t) pell_plane_stride(s->width) * (size_t) s->height;
    struct pell_lighting *l = &r->lighting;
    struct pell_accumulator *a = &r->sum;
    float **planes[64];
    size_t n = 0;
    enum pell_result res;

    for (int c = 0; c < 3; c++) {
        planes[n++] = &l->irradiance[c];
        planes[n++] = &l->through[c];
        planes[n++] = &l->specular[c];
        planes[n++] = &a->color[c];
        planes[n++] = &r->light[c];
        planes[n++] = &r->lit[c];
        planes[n++] = &r->display[c];
        if (s->layers) {
            planes[n++] = &a->multiple[c];
            planes[n++] = &a->transmission[c];
            planes[n++] = &a->specular[c];
            planes[n++] = &a->irradiance[c];
            planes[n++] = &a->normal[c];
            planes[n++] = &a->variance[c];
        }
    }
    planes[n++] = &a->alpha;
    if (s->layers) {
        planes[n++] = &a->depth;
        planes[n++] = &a->translucent;
    }

    PELL_TRY(pell_surface_allocate(r->ctx, s->width, s->height, &r->surface));
    PELL_TRY(pell_planes_allocate(r->ctx, s->width, s->height, planes, n));
    res = PELL_ERR_NOMEM;
    r->material = pell_calloc(r->ctx, pixels, sizeof(*r->material));
    r->rows = pell_calloc(r->ctx, (size_t) s->height * 6, sizeof(*r->rows));
    if (!r->material || !r->rows)
        goto fail;
    r->sum.meter = r->rows + (size_t) s->height * 4;
    r->sized = true;
    return PELL_OK;

fail:
    pell_renderer_drop_size(r);
    return res;
}

/* --- What hangs on the settings ------------------------------------------------------------------------------------------------ */

static enum pell_profile_model model_of(const struct pell_material *m, int setting)
{
    return setting > 0 ? (enum pell_profile_model) (setting - 1) : m->model;
}

/* Materials with one profile share it: the profile is large, and some models take their time. */
static bool same_profile(const struct pell_material *a, const struct pell_material *b, int setting)
{
    return !b->opaque && !a->profile && !b->profile && a->gaussians.count == 0 && b->gaussians.count == 0 &&
           model_of(a, setting) == model_of(b, setting) && memcmp(&a->medium, &b->medium, sizeof(a->medium)) == 0;
}

/* Makes the profile of a scene's material into *out, which is for three channels. */
static enum pell_result make_profile(struct pell_renderer *r, const struct pell_material *m, struct pell_profile *out)
{
    const enum pell_profile_model model = model_of(m, r->settings.profile);

    for (int c = 0; c < 3; c++) {
        const enum pell_result res = m->gaussians.count > 0 ? pell_profile_from_gaussians(&m->gaussians, c, &out[c])
                                                            : pell_profile_make(model, &m->medium, c, NULL, &out[c]);
        if (res != PELL_OK)
            return pell_error(r->ctx, res, m->name, "choose another profile", "has no profile %s",
                              pell_profile_model_at(model) ? pell_profile_model_at(model)->name : "of that model");
    }
    return PELL_OK;
}

/* Gives every translucent material its profile, and says how much light each reflects. */
static enum pell_result make_profiles(struct pell_renderer *r)
{
    const struct pell_scene *scene = r->scene;
    struct pell_frame_material *const frame = r->frame_materials;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!r->profiles)
        r->profiles = pell_calloc(r->ctx, r->num_frame_materials + 1, sizeof(*r->profiles));
    if (!r->profiles)
        goto fail;
    for (size_t i = 0; i < scene->num_materials; i++) {
        const struct pell_material *m = &scene->materials[i];
        const size_t at = r->frame_index[i + 1];
        size_t k = 0;

        if (at == 0)
            continue;
        if (r->settings.profile > 0 && (m->profile || m->gaussians.count > 0))
            pell_warn(r->ctx, m->name, "a model makes profiles of coefficients", "has no coefficients: its own profile is used, not %s",
                      pell_profile_model_at(model_of(m, r->settings.profile))->name);
        while (k < i && !(r->frame_index[k + 1] && same_profile(m, &scene->materials[k], r->settings.profile)))
            k++;
        if (k < i) {
            frame[at - 1].profile = frame[r->frame_index[k + 1] - 1].profile;
        } else if (m->profile) {
            frame[at - 1].profile = m->profile;
        } else {
            if (!r->profiles[at - 1])
                r->profiles[at - 1] = pell_calloc(r->ctx, 3, sizeof(**r->profiles));
            res = PELL_ERR_NOMEM;
            if (!r->profiles[at - 1])
                goto fail;
            PELL_TRY(make_profile(r, m, r->profiles[at - 1]));
            frame[at - 1].profile = r->profiles[at - 1];
        }
        for (int c = 0; c < 3; c++)
            r->total[i][c] = frame[at - 1].white ? 1.0f : (float) pell_profile_total(&frame[at - 1].profile[c]);
    }
    r->profiled = true;
    return PELL_OK;

fail:
    return res;
}

struct pell_frame pell_renderer_frame(const struct pell_renderer *r, const struct pell_view *view)
{
    return (struct pell_frame) {
        .width = view->width,
        .height = view->height,
        .stride = r->surface.stride,
        .orthographic = view->orthographic,
        .focal_px = view->focal_px,
        .object_height = r->scene->bounds_max[1] - r->scene->bounds_min[1],
        .materials = r->frame_materials,
        .num_materials = r->num_frame_materials,
    };
}

/* The surface keeps what its rays hit for methods that ask. */
static void lend_hits(struct pell_renderer *r)
{
    const bool asked = r->pass && (pell_pass_plan(r->pass)->needs & PELL_NEED_HIT);

    r->surface.mesh = asked ? (uint32_t *) r->hit[0] : NULL;
    r->surface.triangle = asked ? (uint32_t *) r->hit[1] : NULL;
    r->surface.barycentric[0] = asked ? r->hit[2] : NULL;
    r->surface.barycentric[1] = asked ? r->hit[3] : NULL;
}

enum pell_result pell_renderer_prepare(struct pell_renderer *r, const struct pell_settings *s, const struct pell_view *view)
{
    const struct pell_settings *old = &r->settings;
    const bool same_size = r->sized && old->width == s->width && old->height == s->height && old->layers == s->layers;
    const bool same_lights = r->lights && old->light_samples == s->light_samples && old->ambient_samples == s->ambient_samples &&
                             old->environment_lights == s->environment_lights && old->msaa == s->msaa && old->boundary == s->boundary &&
                             old->seed == s->seed;
    enum pell_result res;

    if (!same_size || r->focal_px != view->focal_px || r->orthographic != view->orthographic)
        pell_pass_destroy(&r->pass);
    if (!same_size)
        pell_renderer_drop_size(r);
    if (!same_lights) {
        pell_lights_destroy(&r->lights);
        if (r->pass && (pell_pass_plan(r->pass)->needs & PELL_NEED_SCENE) && !pell_pass_plan(r->pass)->relights)
            pell_pass_destroy(&r->pass); /* it keeps what they lit */
    }
    if (old->profile != s->profile) {
        pell_pass_destroy(&r->pass);
        r->profiled = false;
    }
    r->settings = *s;
    if (!r->profiled)
        PELL_TRY(make_profiles(r));
    if (!r->sized)
        PELL_TRY(make_size(r, s));
    r->surface.mips = r->mips; /* before a pass is made: methods light points of this scene then */
    r->surface.lean = true;
    if (!r->lights) {
        PELL_TRY(pell_lights_create(r->ctx, r->scene, s, r->pool, &r->lights));
        r->lights_number++;
    }
    if (!r->pass) {
        memset(r->thickness, 0, r->scene->num_materials * sizeof(*r->thickness));
        if (r->method && r->num_frame_materials > 0) {
            const struct pell_frame shape = pell_renderer_frame(r, view);
            PELL_TRY(pell_pass_create(r, r->method, r->knobs, &shape, &r->pass));
            r->focal_px = view->focal_px;
            r->orthographic = view->orthographic;
            for (size_t i = 0; i < r->scene->num_materials; i++)
                if (r->frame_index[i + 1])
                    r->thickness[i] = pell_pass_thickness(r->pass, (size_t) r->frame_index[i + 1] - 1);
        }
    }
    if (r->pass && (pell_pass_plan(r->pass)->needs & PELL_NEED_POSITION) && !r->position[0]) {
        float **const planes[] = { &r->position[0], &r->position[1], &r->position[2] };
        PELL_TRY(pell_planes_allocate(r->ctx, s->width, s->height, planes, PELL_COUNT(planes)));
    }
    if (r->pass && (pell_pass_plan(r->pass)->needs & PELL_NEED_HIT) && !r->hit[0]) {
        float **const planes[] = { &r->hit[0], &r->hit[1], &r->hit[2], &r->hit[3] };
        PELL_TRY(pell_planes_allocate(r->ctx, s->width, s->height, planes, PELL_COUNT(planes)));
    }
    lend_hits(r);
    if (!r->rastered)
        PELL_TRY(pell_raster_create(r->ctx, r->scene, s->width, s->height, &r->raster));
    r->rastered = true;
    r->surface.raster = r->raster;
    if (s->bloom > 0.0f && !r->glow[0]) {
        float **const planes[PELL_BLOOM_PLANES] = { &r->glow[0], &r->glow[1], &r->glow[2] };
        PELL_TRY(pell_planes_allocate(r->ctx, s->width, s->height, planes, PELL_COUNT(planes)));
    }
    if (s->dof && !r->open[0]) {
        float **const planes[PELL_DOF_PLANES] = { &r->open[0], &r->open[1], &r->open[2], &r->open[3], &r->open[4], &r->open[5] };
        PELL_TRY(pell_planes_allocate(r->ctx, s->width, s->height, planes, PELL_COUNT(planes)));
    }
    if (s->dof && !r->open_tiles && !(r->open_tiles = pell_calloc(r->ctx, pell_dof_tiles(s->width, s->height), sizeof(float))))
        return PELL_ERR_NOMEM;
    if (r->pass && pell_pass_plan(r->pass)->gives && s->layers && !r->single[0]) {
        float **planes[9];
        for (size_t c = 0; c < 3; c++) {
            planes[c] = &r->single[c];
            planes[3 + c] = &r->reflected[c];
            planes[6 + c] = &r->sum.single[c];
        }
        PELL_TRY(pell_planes_allocate(r->ctx, s->width, s->height, planes, PELL_COUNT(planes)));
    }
    return PELL_OK;

fail:
    return res;
}
