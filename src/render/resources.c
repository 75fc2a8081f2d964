/* SPDX-License-Identifier: MIT
 * resources.c - resources that a renderer keeps from frame to frame: one table lists the dependencies of each, and drives dropping and
 * creation. */
#include "render/renderer_state.h"

#include "optics/medium/passing.h"
#include "render/frame_material.h"
#include "render/object_materials.h"
#include "render/pass.h"
#include "render/plane_buffers.h"
#include "scene/layers.h"
#include "transport/solids.h"

#include <pellucid/inversion.h>

#include <math.h>
#include <string.h>

/* --- Materials --------------------------------------------------------------------------------------------------------------------- */

static void drop_materials(struct pell_renderer *r)
{
    struct pell_scene_materials *m = &r->materials;

    pell_free(r->ctx, m->frame_index);
    pell_free(r->ctx, m->frame);
    pell_free(r->ctx, m->of_mesh);
    pell_free(r->ctx, m->total);
    pell_free(r->ctx, m->radius);
    pell_free(r->ctx, m->angle);
    pell_free(r->ctx, m->thickness);
    pell_free(r->ctx, m->separate);
    pell_free(r->ctx, m->angle_without_single);
    for (size_t i = 0; i < m->num_stacks; i++)
        pell_free(r->ctx, m->stack[i]);
    pell_free(r->ctx, m->stack);
    memset(m, 0, sizeof(*m));
}

static enum pell_result keep_stack(struct pell_renderer *r, const struct pell_material *m, struct pell_frame_material *f)
{
    struct pell_scene_materials *out = &r->materials;
    struct pell_stack stack;

    if (!pell_scene_profile_stack(m, &stack))
        return PELL_OK;
    out->stack[out->num_stacks] = pell_alloc(r->ctx, sizeof(stack));
    if (!out->stack[out->num_stacks])
        return PELL_ERR_NOMEM;
    f->stack = out->stack[out->num_stacks];
    *out->stack[out->num_stacks++] = stack;
    return PELL_OK;
}

static enum pell_result make_materials(struct pell_renderer *r)
{
    const struct pell_scene *scene = r->scene;
    struct pell_scene_materials *out = &r->materials;
    const size_t n = scene->num_materials;
    uint32_t *same = NULL;
    enum pell_result res;

    if (n < 1 || n > 65534)
        return pell_error(r->ctx, PELL_ERR_INVALID, scene->path, NULL, "%zu materials, must be in [1, 65534]", n);
    res = PELL_ERR_NOMEM;
    out->frame_index = pell_calloc(r->ctx, n + 1, sizeof(*out->frame_index));
    out->frame = pell_calloc(r->ctx, n, sizeof(*out->frame));
    out->total = pell_calloc(r->ctx, n, sizeof(*out->total));
    out->radius = pell_calloc(r->ctx, n, sizeof(*out->radius));
    out->angle = pell_calloc(r->ctx, n, sizeof(*out->angle));
    out->thickness = pell_calloc(r->ctx, n, sizeof(*out->thickness));
    out->separate = pell_calloc(r->ctx, n, sizeof(*out->separate));
    out->angle_without_single = pell_calloc(r->ctx, n, sizeof(*out->angle_without_single));
    out->stack = pell_calloc(r->ctx, n, sizeof(*out->stack));
    same = pell_alloc_array(r->ctx, n, sizeof(*same));
    if (!same || !out->frame_index || !out->frame || !out->total || !out->radius || !out->angle || !out->thickness || !out->separate ||
        !out->angle_without_single || !out->stack)
        goto fail;
    pell_scene_same_media(scene, same);
    for (size_t i = 0; i < n; i++) {
        const struct pell_material *m = &scene->materials[i];
        struct pell_frame_material *f = &out->frame[out->count];

        if (m->opaque)
            continue;
        if (same[i] < i) {
            out->frame_index[i + 1] = out->frame_index[same[i] + 1];
            continue;
        }
        if (out->count == PELL_FRAME_MATERIALS) {
            res = pell_error(r->ctx, PELL_ERR_UNSUPPORTED, scene->path, "mark some \"opaque\": true", "more than %d translucent materials",
                             PELL_FRAME_MATERIALS);
            goto fail;
        }
        f->medium = m->medium;
        f->gaussians = m->gaussians;
        f->profile = m->profile;
        if (m->profile)
            f->gaussians.count = 0; /* scattering is defined by the profile, not by coefficients or a published set */
        f->white = m->color_from == PELL_COLOR_FROM_TEXTURE;
        f->strength = fmaxf(m->strength, 1.0f / 1024.0f);
        f->name = m->preset && m->preset[0] ? m->preset : m->name;
        f->preset = m->profile ? NULL : m->preset;
        PELL_TRY(keep_stack(r, m, f));
        PELL_TRY(pell_frame_material_check(r->ctx, pell_material_shown_name(m), f));
        out->frame_index[i + 1] = (uint16_t) ++out->count;
    }
    PELL_TRY(pell_object_materials_make(r->ctx, scene, out));

fail:
    pell_free(r->ctx, same);
    if (res != PELL_OK)
        drop_materials(r);
    return res;
}

static enum pell_profile_model model_of(const struct pell_material *m, int setting)
{
    return setting > 0 ? (enum pell_profile_model)(setting - 1) : m->model;
}

/* Materials with equal profiles share them and derived data: profiles are large, and some models are slow. */
static bool same_profile(const struct pell_material *a, const struct pell_material *b, int setting)
{
    return !b->opaque && !a->profile && !b->profile && a->gaussians.count == 0 && b->gaussians.count == 0 &&
           (a->color_from == PELL_COLOR_FROM_TEXTURE) == (b->color_from == PELL_COLOR_FROM_TEXTURE) &&
           model_of(a, setting) == model_of(b, setting) && memcmp(&a->medium, &b->medium, sizeof(a->medium)) == 0;
}

static void drop_profiles(struct pell_renderer *r)
{
    for (size_t i = 0; r->profiles && i < r->materials.count; i++)
        pell_free(r->ctx, r->profiles[i]);
    pell_free(r->ctx, r->profiles);
    pell_free(r->ctx, r->profiles_of);
    r->profiles = NULL;
    r->profiles_of = NULL;
}

#define DARK 0.02   /* total of a profile up to which transmitted light is scattered too rarely for the factor of set_pass, */
#define BRIGHT 0.06 /* and from which the factor applies in full */

/* Sets the factor of transmitted light over that of other light that leaves: the ratio of two factors that are linear in 1 - m, as a linear
 * factor. */
static void set_pass(const struct pell_medium *medium, double total, int c, struct pell_angle *out)
{
    const struct pell_half_space_angle a = pell_passing_angle(medium, c);
    const float off = out->inverse_eta2 < 1.0f ? 1.0f - sqrtf(1.0f - out->inverse_eta2) : 1.0f;
    const float weight = (float) fmin(fmax((total - DARK) / (BRIGHT - DARK), 0.0), 1.0);
    const float grazing = (float) ((1.0 + a.slope * (double) off) / a.mean) / (out->exit_base[c] + out->exit_slope[c] * off);

    out->pass_base[c] = (float) (1.0 / a.mean) / out->exit_base[c];
    out->pass_slope[c] = (grazing - out->pass_base[c]) / off;
    out->pass_base[c] = 1.0f + weight * (out->pass_base[c] - 1.0f);
    out->pass_slope[c] *= weight;
    out->pass_per_mm[c] = (float) ((medium->sigma_a[c] + medium->sigma_s_reduced[c]) / PELL_PASSING_THICK);
}

/* A profile that is made white keeps its total under diffuse light; a medium's profile keeps its total at normal incidence. */
static void fill_angle(const struct pell_frame_material *m, bool is_medium, struct pell_angle *out)
{
    const double eta = (double) m->medium.eta;

    out->inverse_eta2 = (float) (1.0 / (eta * eta));
    for (int c = 0; c < 3; c++) {
        const struct pell_half_space_angle a = pell_half_space_angle_of(pell_profile_total(&m->profile[c]), eta);
        const double scale = m->white ? 1.0 / a.mean : 1.0;
        out->enter_base[c] = (float) scale;
        out->enter_slope[c] = (float) (scale * a.slope);
        out->enter_mean[c] = (float) (scale * a.mean);
        out->exit_base[c] = (float) (1.0 / a.mean);
        out->exit_slope[c] = (float) (a.slope / a.mean);
        out->pass_base[c] = 1.0f;
        if (is_medium)
            set_pass(&m->medium, pell_profile_total(&m->profile[c]), c, out);
    }
}

/* No refraction, and no factor. */
static const struct pell_angle no_angle = {
    .enter_base = { 1, 1, 1 }, .enter_mean = { 1, 1, 1 }, .exit_base = { 1, 1, 1 }, .pass_base = { 1, 1, 1 }
};

/* Removes single scattering from a medium's profile, for frames that add it separately: `whole` and `multiple` are the profiles of all and
 * of multiply scattered light. Diffuse light, which has no direction, keeps its single scattering, as a larger entering factor. */
static void set_separate_single(const struct pell_material *m, const struct pell_profile *whole, const struct pell_profile *multiple,
                                bool angles, struct pell_separate_single *single, const struct pell_angle *angle, struct pell_angle *out)
{
    const double eta = (double) m->medium.eta;

    single->inverse_eta2 = (float) (1.0 / (eta * eta));
    *out = angles ? *angle : no_angle;
    for (int c = 0; c < 3; c++) {
        const double reduced = m->medium.sigma_s_reduced[c] / (m->medium.sigma_a[c] + m->medium.sigma_s_reduced[c]);
        const double total = pell_profile_total(&whole[c]), left = pell_profile_total(&multiple[c]);
        struct pell_half_space_angle all = { 0.0, 1.0 }, a = all;

        if (!(left > 0.0 && left < total))
            continue;
        single->albedo[c] = (float) pell_albedo_of_reduced(reduced, m->medium.g[c]);
        single->g[c] = (float) m->medium.g[c];
        if (angles) {
            all = pell_half_space_angle_of(total, eta);
            a = pell_half_space_angle_multiple(total, reduced, eta, all);
        }
        out->enter_base[c] = 1.0f;
        out->enter_slope[c] = (float) a.slope;
        out->enter_mean[c] = (float) (total * all.mean / left);
        out->exit_base[c] = (float) (1.0 / a.mean);
        out->exit_slope[c] = (float) (a.slope / a.mean);
        out->pass_base[c] = 1.0f;
        if (angles)
            set_pass(&m->medium, total, c, out);
    }
}

/* Makes the profiles of a medium's multiply scattered light, after those of all light; returns false if its model cannot. */
static bool make_multiple(const struct pell_renderer *r, const struct pell_material *m, enum pell_profile_model model,
                          struct pell_profile *out)
{
    const struct pell_profile_params params = { .without_single = true };

    if (!r->settings.single_scattering || m->gaussians.count > 0 || m->profile || m->color_from == PELL_COLOR_FROM_TEXTURE)
        return false;
    for (int c = 0; c < 3; c++)
        if (pell_profile_make(model, &m->medium, c, &params, &out[c]) != PELL_OK)
            return false;
    return true;
}

/* Assigns profiles to the frame's materials, including copies for further objects of a material. */
static void hand_out_profiles(struct pell_renderer *r, bool separate_single)
{
    struct pell_scene_materials *m = &r->materials;

    for (size_t i = 0; i < m->count; i++)
        m->frame[i].profile = separate_single && r->profiles_of[i].multiple ? r->profiles_of[i].multiple : r->profiles_of[i].all;
    for (size_t i = 0; m->of_mesh && i < r->scene->num_meshes; i++)
        if (m->of_mesh[i])
            m->frame[m->of_mesh[i] - 1].profile = m->frame[m->frame_index[r->scene->meshes[i].material + 1] - 1].profile;
}

/* Assigns profiles to all translucent materials, and computes what follows from them: total reflectance, mean radius, angular factors. */
static enum pell_result make_profiles(struct pell_renderer *r)
{
    const struct pell_scene *scene = r->scene;
    const uint16_t *index = r->materials.frame_index;
    struct pell_frame_material *const frame = r->materials.frame;
    const int setting = r->settings.profile;
    enum pell_result res = PELL_ERR_NOMEM;

    r->profiles = pell_calloc(r->ctx, r->materials.count + 1, sizeof(*r->profiles));
    r->profiles_of = pell_calloc(r->ctx, r->materials.count + 1, sizeof(*r->profiles_of));
    if (!r->profiles || !r->profiles_of)
        goto fail;
    for (size_t i = 0; i < scene->num_materials; i++) {
        const struct pell_material *m = &scene->materials[i];
        const size_t id = index[i + 1]; /* from 1; 0: opaque */
        struct pell_profiles_of *of = id ? &r->profiles_of[id - 1] : NULL;
        size_t k = 0;

        if (id == 0)
            continue;
        if (setting > 0 && m->num_layers == 0 && (m->profile || m->gaussians.count > 0)) /* layers have coefficients of their own */
            pell_warn(r->ctx, pell_material_shown_name(m), "--profile needs a material with scattering coefficients",
                      "has no coefficients: its own profile is used, not %s", pell_profile_model_at(model_of(m, setting))->name);
        while (k < i && index[k + 1] != id && !(index[k + 1] && same_profile(m, &scene->materials[k], setting)))
            k++;
        if (k < i) {
            *of = r->profiles_of[index[k + 1] - 1];
        } else if (m->profile) {
            of->all = m->profile;
        } else {
            res = PELL_ERR_NOMEM;
            if (!(r->profiles[id - 1] = pell_calloc(r->ctx, 6, sizeof(**r->profiles))))
                goto fail;
            PELL_TRY(pell_frame_material_profile(r->ctx, pell_material_shown_name(m), &frame[id - 1], model_of(m, setting),
                                                 r->profiles[id - 1]));
            of->all = r->profiles[id - 1];
            of->multiple = make_multiple(r, m, model_of(m, setting), r->profiles[id - 1] + 3) ? r->profiles[id - 1] + 3 : NULL;
        }
        frame[id - 1].profile = of->all;
        if (k < i) {
            memcpy(r->materials.total[i], r->materials.total[k], sizeof(r->materials.total[i]));
            memcpy(r->materials.radius[i], r->materials.radius[k], sizeof(r->materials.radius[i]));
            r->materials.angle[i] = r->materials.angle[k];
            r->materials.separate[i] = r->materials.separate[k];
            r->materials.angle_without_single[i] = r->materials.angle_without_single[k];
            continue;
        }
        if (r->settings.angles)
            fill_angle(&frame[id - 1], pell_scatters_by_medium(m, &frame[id - 1]), &r->materials.angle[i]);
        for (int c = 0; c < 3; c++) {
            r->materials.total[i][c] = frame[id - 1].white ? 1.0f : (float) pell_profile_total(&frame[id - 1].profile[c]);
            r->materials.radius[i][c] = m->strength * (float) pell_profile_mean_radius(&frame[id - 1].profile[c]);
        }
        r->materials.separate[i] = (struct pell_separate_single) { .inverse_eta2 = 0.0f };
        r->materials.angle_without_single[i] = r->settings.angles ? r->materials.angle[i] : no_angle;
        if (frame[id - 1].white)
            of->multiple = NULL;
        else if (of->multiple)
            set_separate_single(m, of->all, of->multiple, r->settings.angles, &r->materials.separate[i], &r->materials.angle[i],
                                &r->materials.angle_without_single[i]);
    }
    hand_out_profiles(r, false);
    return PELL_OK;

fail:
    drop_profiles(r);
    return res;
}

/* --- Engine resources ----------------------------------------------------------------------------------------------------------------- */

static enum pell_result make_in_engine(struct pell_renderer *r, enum pell_engine_resource resource, const struct pell_plan *plan)
{
    const struct pell_engine_frame frame = {
        .scene = r->scene, .settings = &r->settings, .materials = &r->materials, .plan = plan, .notes = &r->notes
    };

    return r->device->engine->make(r->engine, resource, &frame);
}

static enum pell_result make_scene(struct pell_renderer *r)
{
    const enum pell_result res = make_in_engine(r, PELL_ENGINE_SCENE, NULL);

    if (res != PELL_OK)
        return res;
    r->services = (struct pell_services) {
        .ctx = r->ctx,
        .pool = r->device->pool,
        .gpu = r->device->gpu,
        .scene = r->scene,
        .frame_index = r->materials.frame_index,
        .materials = r->materials.frame,
        .settings = &r->settings,
    };
    r->device->engine->lend(r->engine, &r->services);
    return PELL_OK;
}

static void drop_scene(struct pell_renderer *r)
{
    r->device->engine->drop(r->engine, PELL_ENGINE_SCENE);
    memset(&r->services, 0, sizeof(r->services));
}

static enum pell_result make_planes(struct pell_renderer *r)
{
    return make_in_engine(r, PELL_ENGINE_PLANES, NULL);
}

static void drop_planes(struct pell_renderer *r)
{
    r->device->engine->drop(r->engine, PELL_ENGINE_PLANES);
}

static enum pell_result make_raster(struct pell_renderer *r)
{
    return make_in_engine(r, PELL_ENGINE_RASTER, NULL);
}

static void drop_raster(struct pell_renderer *r)
{
    r->device->engine->drop(r->engine, PELL_ENGINE_RASTER);
}

static enum pell_result make_lights(struct pell_renderer *r)
{
    const enum pell_result res = make_in_engine(r, PELL_ENGINE_LIGHTS, NULL);

    r->lights_revision += res == PELL_OK;
    return res;
}

static void drop_lights(struct pell_renderer *r)
{
    r->device->engine->drop(r->engine, PELL_ENGINE_LIGHTS);
}

static enum pell_result make_unscattered(struct pell_renderer *r)
{
    return make_in_engine(r, PELL_ENGINE_UNSCATTERED, NULL);
}

static void drop_unscattered(struct pell_renderer *r)
{
    r->device->engine->drop(r->engine, PELL_ENGINE_UNSCATTERED);
}

static enum pell_result make_curvature(struct pell_renderer *r)
{
    return make_in_engine(r, PELL_ENGINE_CURVATURE, NULL);
}

static void drop_curvature(struct pell_renderer *r)
{
    r->device->engine->drop(r->engine, PELL_ENGINE_CURVATURE);
}

static enum pell_result make_contact(struct pell_renderer *r)
{
    return make_in_engine(r, PELL_ENGINE_CONTACT, NULL);
}

static void drop_contact(struct pell_renderer *r)
{
    r->device->engine->drop(r->engine, PELL_ENGINE_CONTACT);
}

static enum pell_result make_links(struct pell_renderer *r)
{
    return make_in_engine(r, PELL_ENGINE_LINKS, NULL);
}

static void drop_links(struct pell_renderer *r)
{
    r->device->engine->drop(r->engine, PELL_ENGINE_LINKS);
}

static enum pell_result make_indirect(struct pell_renderer *r)
{
    return make_in_engine(r, PELL_ENGINE_INDIRECT, NULL);
}

static void drop_indirect(struct pell_renderer *r)
{
    r->device->engine->drop(r->engine, PELL_ENGINE_INDIRECT);
}

static enum pell_result make_through(struct pell_renderer *r)
{
    return make_in_engine(r, PELL_ENGINE_THROUGH, r->pass ? pell_pass_plan(r->pass) : NULL);
}

static void drop_through(struct pell_renderer *r)
{
    r->device->engine->drop(r->engine, PELL_ENGINE_THROUGH);
}

/* --- The method's pass ------------------------------------------------------------------------------------------------------------- */

struct pell_frame_shape pell_renderer_shape(const struct pell_renderer *r, const struct pell_view *view)
{
    struct pell_plan plan;

    r->method->plan(r->knobs, &plan);
    return (struct pell_frame_shape) {
        .width = view->width,
        .height = view->height,
        .stride = pell_plane_stride(view->width),
        .orthographic = view->orthographic,
        .focal_px = view->focal_px,
        .object_height = r->scene->bounds_max[1] - r->scene->bounds_min[1],
        .materials = r->materials.frame,
        .num_materials = pell_separates_objects(&r->materials, &plan) ? r->materials.count_with_copies : r->materials.count,
    };
}

/* Whether the method leaves single scattering to the stages: its result is exitance, not an image, and excludes single scattering. */
static bool adds_single(const struct pell_renderer *r)
{
    struct pell_plan plan = { .quantity = PELL_QUANTITY_RADIANCE };
    bool any = false;

    if (r->method)
        r->method->plan(r->knobs, &plan);
    for (size_t i = 0; i < r->materials.count; i++)
        any |= r->profiles_of[i].multiple != NULL;
    return r->settings.single_scattering && any && plan.quantity == PELL_QUANTITY_EXITANCE && !(plan.outputs & PELL_OUTPUT_SINGLE);
}

static enum pell_result make_pass(struct pell_renderer *r)
{
    const struct pell_view view = pell_view_make(&r->scene->cameras[0], r->settings.width, r->settings.height, 0.0f, 0.0f);
    struct pell_scene_materials *m = &r->materials;
    struct pell_frame_shape shape;
    enum pell_result res;

    memset(m->thickness, 0, r->scene->num_materials * sizeof(*m->thickness));
    m->separates_single = adds_single(r);
    hand_out_profiles(r, m->separates_single);
    if (!r->method || m->count == 0)
        return PELL_OK;
    pell_renderer_warn_ignored(r);
    shape = pell_renderer_shape(r, &view);
    r->services.communicator = r->communicator;
    r->services.checkpoint = r->has_checkpoint ? &r->checkpoint : NULL;
    r->services.observer = r->observer.show ? &r->observer : NULL;
    r->services.kept = &r->kept;
    res = pell_pass_make(r->device->engine, &r->services, r->method, r->knobs, &shape, &r->pass);
    for (size_t i = 0; res == PELL_OK && i < r->scene->num_materials; i++)
        if (m->frame_index[i + 1])
            m->thickness[i] = pell_pass_thickness(r->pass, (size_t) m->frame_index[i + 1] - 1);
    return res;
}

static void drop_pass(struct pell_renderer *r)
{
    pell_pass_destroy(&r->pass);
}

/* Further inputs of the pass: a method that reads the scene keeps its lighting, unless it declares that it recomputes it. */
static unsigned pass_depends(const struct pell_renderer *r)
{
    const struct pell_plan *plan = r->pass ? pell_pass_plan(r->pass) : NULL;

    return plan && (plan->needs & PELL_NEED_SCENE) && !plan->survives_light_change ? PELL_INPUT_LIGHTS | PELL_INPUT_BOUNCES : 0;
}

/* --- Dependencies --------------------------------------------------------------------------------------------------------------------- */

/* Each may use those above it, and is dropped before them. */
static const struct resource {
    unsigned depends;                                  /* depends on these of enum pell_input, */
    unsigned (*more)(const struct pell_renderer *r);   /* and on those that this returns; NULL: none */
    enum pell_result (*make)(struct pell_renderer *r); /* leaves nothing behind on failure */
    void (*drop)(struct pell_renderer *r);
} resources[] = {
    { PELL_INPUT_SCENE, NULL, make_materials, drop_materials },
    { PELL_INPUT_SCENE, NULL, make_scene, drop_scene },
    { PELL_INPUT_SCENE | PELL_INPUT_PROFILE, NULL, make_profiles, drop_profiles },
    { PELL_INPUT_SIZE, NULL, make_planes, drop_planes },
    { PELL_INPUT_SCENE | PELL_INPUT_SIZE, NULL, make_raster, drop_raster },
    { PELL_INPUT_SCENE | PELL_INPUT_LIGHTS, NULL, make_lights, drop_lights },
    { PELL_INPUT_SCENE | PELL_INPUT_PROFILE, NULL, make_unscattered, drop_unscattered },
    { PELL_INPUT_SCENE | PELL_INPUT_PROFILE, NULL, make_curvature, drop_curvature },
    { PELL_INPUT_SCENE, NULL, make_contact, drop_contact },
    { PELL_INPUT_SCENE | PELL_INPUT_BOUNCES, NULL, make_links, drop_links },
    { PELL_INPUT_SCENE | PELL_INPUT_LIGHTS | PELL_INPUT_PROFILE | PELL_INPUT_BOUNCES, NULL, make_indirect, drop_indirect },
    { PELL_INPUT_SCENE | PELL_INPUT_METHOD | PELL_INPUT_CHECKPOINT | PELL_INPUT_SIZE | PELL_INPUT_CAMERA | PELL_INPUT_PROFILE, pass_depends,
      make_pass, drop_pass },
    { PELL_INPUT_SCENE | PELL_INPUT_METHOD | PELL_INPUT_CHECKPOINT | PELL_INPUT_PROFILE | PELL_INPUT_LIGHTS | PELL_INPUT_BOUNCES, NULL,
      make_through, drop_through },
};
enum { OF_SCENE = 2 /* the first ones, which depend on the scene alone */ };

void pell_renderer_invalidate(struct pell_renderer *r, unsigned inputs)
{
    for (size_t i = PELL_COUNT(resources); i-- > 0;) {
        const struct resource *x = &resources[i];
        const unsigned depends = x->depends | (x->more ? x->more(r) : 0);
        if (!(r->made >> i & 1) || !(depends & inputs))
            continue;
        x->drop(r);
        r->made &= ~(1u << i);
    }
    if ((inputs & PELL_INPUT_METHOD) && r->kept.state) {
        r->kept.destroy(r->kept.state);
        r->kept.state = NULL;
    }
}

static enum pell_result make_first(struct pell_renderer *r, size_t count)
{
    enum pell_result res = PELL_OK;

    for (size_t i = 0; res == PELL_OK && i < count; i++) {
        if (r->made >> i & 1)
            continue;
        res = resources[i].make(r);
        r->made |= (unsigned) (res == PELL_OK) << i;
    }
    return res;
}

enum pell_result pell_renderer_prepare_scene(struct pell_renderer *r)
{
    const enum pell_result res = make_first(r, OF_SCENE);

    if (res != PELL_OK)
        pell_renderer_invalidate(r, PELL_INPUT_SCENE);
    return res;
}

/* Inputs that differ from those of the last frame. */
static unsigned find_changes(const struct pell_renderer *r, const struct pell_settings *s, const struct pell_view *view)
{
    const struct pell_settings *old = &r->settings;
    unsigned changes = 0;

    if (old->width != s->width || old->height != s->height || old->layers != s->layers)
        changes |= PELL_INPUT_SIZE;
    if (r->focal_px != view->focal_px || r->orthographic != view->orthographic)
        changes |= PELL_INPUT_CAMERA;
    if (old->light_samples != s->light_samples || old->ambient_samples != s->ambient_samples ||
        old->environment_lights != s->environment_lights || old->specular != s->specular || old->msaa != s->msaa ||
        old->boundary != s->boundary || old->seed != s->seed)
        changes |= PELL_INPUT_LIGHTS;
    if (old->bounces != s->bounces || old->indirect_samples != s->indirect_samples || old->boundary != s->boundary || old->seed != s->seed)
        changes |= PELL_INPUT_BOUNCES;
    if (old->profile != s->profile)
        changes |= PELL_INPUT_PROFILE;
    if (old->angles != s->angles || old->curvature != s->curvature || old->opposed != s->opposed ||
        old->single_scattering != s->single_scattering || old->unscattered != s->unscattered)
        changes |= PELL_INPUT_PROFILE | PELL_INPUT_LIGHTS;
    return changes;
}

enum pell_result pell_renderer_prepare(struct pell_renderer *r, const struct pell_settings *s, const struct pell_view *view)
{
    enum pell_result res;

    pell_renderer_invalidate(r, find_changes(r, s, view));
    r->settings = *s;
    r->focal_px = view->focal_px;
    r->orthographic = view->orthographic;
    res = make_first(r, PELL_COUNT(resources));
    return res == PELL_OK ? make_in_engine(r, PELL_ENGINE_PLANES, r->pass ? pell_pass_plan(r->pass) : NULL) : res;
}
