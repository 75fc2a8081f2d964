/* SPDX-License-Identifier: MIT
 *
 * engine_cpu.c - the stages on the CPU: planes of floats in host memory, rays by the ray library.
 */
#include "render/engine_cpu_state.h"
#include "render/highlights/stage.h"
#include "render/layers.h"
#include "render/media.h"
#include "render/spread/stage.h"

#include <string.h>

#define HIGHLIGHTS_SAMPLES 256 /* samples of a light from which shadows of highlights need no filtering */

static enum pell_result cpu_open(struct pell_context *ctx, struct pell_pool *pool, struct pell_gpu *gpu, void **engine)
{
    struct pell_cpu *e = pell_zalloc(ctx, sizeof(*e));

    (void) gpu;
    *engine = e;
    if (!e)
        return PELL_ERR_NOMEM;
    e->ctx = ctx;
    e->pool = pool;
    return PELL_OK;
}

/* --- Persistent resources ------------------------------------------------------------------------------------------------------------- */

static void drop_scene(struct pell_cpu *e)
{
    pell_compositor_destroy(&e->compositor);
    pell_specular_tables_destroy(&e->tables);
    pell_rays_destroy(&e->rays);
    pell_mips_destroy(&e->mips);
    e->surface.mips = NULL;
    e->scene = NULL;
}

static enum pell_result make_scene(struct pell_cpu *e, const struct pell_scene *scene)
{
    enum pell_result res;

    PELL_TRY(pell_specular_tables_create(e->ctx, scene, 0, &e->tables));
    PELL_TRY(pell_compositor_create(e->ctx, scene->num_materials, &e->compositor));
    PELL_TRY(pell_rays_create(e->ctx, scene, e->pool, &e->rays));
    PELL_TRY(pell_mips_create(e->ctx, scene, e->pool, &e->mips));
    e->scene = scene;
    e->surface.mips = e->mips;
    return PELL_OK;

fail:
    drop_scene(e);
    return res;
}

static void drop_planes(struct pell_cpu *e)
{
    pell_surface_finish(e->ctx, &e->surface);
    for (int i = 0; i < e->num_blocks; i++)
        pell_free(e->ctx, e->blocks[i]);
    pell_free(e->ctx, e->pinhole_tiles);
    pell_free(e->ctx, e->rows);
    pell_free(e->ctx, e->spread_lit);
    pell_free(e->ctx, e->has_hidden);
    memset(&e->lighting, 0, sizeof(e->lighting));
    memset(&e->sum, 0, sizeof(e->sum));
    memset(e->display, 0, sizeof(e->display));
    memset(e->plane, 0, sizeof(e->plane));
    memset(e->bloom_scratch, 0, sizeof(e->bloom_scratch));
    memset(e->pinhole, 0, sizeof(e->pinhole));
    e->num_blocks = 0;
    e->pinhole_tiles = NULL;
    e->rows = NULL;
    e->spread_lit = e->has_hidden = NULL;
    e->has_planes = false;
}

static enum pell_result allocate(struct pell_cpu *e, const struct pell_settings *s, const struct pell_planes_wanted *w)
{
    enum pell_result res;

    if (w->count == 0)
        return PELL_OK;
    res = pell_planes_allocate(e->ctx, s->width, s->height, w->planes, w->count);
    if (res == PELL_OK)
        e->blocks[e->num_blocks++] = *w->planes[0];
    return res;
}

/* Whether the engine owns this plane of the frame: it is required, and belongs to no stage. */
static bool has_own_plane(int plane, const struct pell_engine_frame *frame)
{
    const struct pell_plane_info *p = pell_plane_at(plane);
    const struct pell_plan *plan = frame->plan;

    switch (plane) {
    case PELL_PLANE_DEPTH:
    case PELL_PLANE_STRENGTH:
    case PELL_PLANE_BASE:
    case PELL_PLANE_IRRADIANCE:
    case PELL_PLANE_NORMAL: return false;
    }
    if (p->output)
        return plan && (plan->outputs & p->output) && (frame->settings->layers || plan->quantity == PELL_QUANTITY_EXITANCE);
    return !p->need || (plan && (plan->needs & p->need));
}

bool pell_cpu_spreads(const struct pell_engine_frame *frame)
{
    return frame->plan && (frame->plan->needs & PELL_NEED_TRANSMISSION) && frame->plan->spreads;
}

/* Only methods whose result is exitance need it: others return images, which include it, or only other light. */
bool pell_cpu_sees_through(const struct pell_cpu *e, const struct pell_engine_frame *frame)
{
    return e->unscattered && frame->plan && frame->plan->quantity == PELL_QUANTITY_EXITANCE && !(frame->plan->outputs & PELL_OUTPUT_SINGLE);
}

/* Whether the shadows of highlights are noisy, so that pixels share them. */
static bool shares_highlights(const struct pell_engine_frame *frame)
{
    bool any = false;

    for (size_t i = 0; i < frame->scene->num_lights; i++)
        any |= frame->scene->lights[i].type == PELL_LIGHT_RECT || frame->scene->lights[i].type == PELL_LIGHT_DISC;
    return any && frame->settings->light_samples < HIGHLIGHTS_SAMPLES;
}

/* Allocates first the planes of every frame of this size; then those that the method and the settings require. */
static enum pell_result make_planes(struct pell_cpu *e, const struct pell_engine_frame *frame)
{
    const struct pell_settings *s = frame->settings;
    const bool separates_single = frame->plan && frame->materials->separates_single,
               has_outputs = frame->plan && (frame->plan->outputs || separates_single),
               hits = s->bounces > 0 || pell_cpu_sees_through(e, frame) || s->curvature ||
                      (frame->plan && (frame->plan->needs & PELL_NEED_HIT));
    const bool by_object = pell_separates_objects(frame->materials, frame->plan);
    struct pell_planes_wanted w = { .count = 0 };
    enum pell_result res;

    if (!e->has_planes)
        PELL_TRY(pell_surface_allocate(e->ctx, s->width, s->height, &e->surface));
    pell_planes_want(&w, e->lighting.irradiance, 3);
    if (s->opposed && frame->plan && (frame->plan->local || (frame->plan->needs & PELL_NEED_TRANSMISSION)))
        pell_planes_want(&w, e->lighting.entered, 3);
    pell_planes_want(&w, e->lighting.transmitted, 3);
    pell_planes_want(&w, e->lighting.specular, 3);
    if (separates_single)
        pell_planes_want(&w, e->lighting.single, 3);
    if (shares_highlights(frame)) {
        pell_planes_want(&w, e->lighting.hidden, 3);
        pell_planes_want(&w, e->lighting.lost, 3);
    }
    if (pell_cpu_spreads(frame))
        pell_planes_want(&w, &e->lighting.path, 1);
    pell_planes_want(&w, e->display, 3);
    for (size_t i = 0; i < PELL_OUTPUT_LAYERS; i++) {
        const struct pell_output_layer *l = &pell_output_layers[i];
        if (l->when == PELL_LAYER_ALWAYS || (s->layers && (l->when != PELL_LAYER_SINGLE || has_outputs)))
            pell_planes_want(&w, pell_output_layer_planes(&e->sum, l), l->components);
    }
    for (int i = 0; i < PELL_PLANES; i++)
        if (has_own_plane(i, frame))
            pell_planes_want(&w, e->plane[i], pell_plane_at(i)->components);
    if (by_object || hits)
        pell_planes_want(&w, e->plane[PELL_PLANE_MESH], 1);
    if (hits) {
        pell_planes_want(&w, e->plane[PELL_PLANE_TRIANGLE], 1);
        pell_planes_want(&w, e->plane[PELL_PLANE_BARYCENTRIC], 2);
    }
    if (s->bloom > 0.0f)
        pell_planes_want(&w, e->bloom_scratch, PELL_BLOOM_PLANES);
    if (s->dof)
        pell_planes_want(&w, e->pinhole, PELL_DOF_PLANES);
    PELL_TRY(allocate(e, s, &w));
    res = PELL_ERR_NOMEM;
    if (!e->rows && !(e->rows = pell_calloc(e->ctx, (size_t) s->height * 6, sizeof(*e->rows))))
        goto fail;
    if (s->dof && !e->pinhole_tiles && !(e->pinhole_tiles = pell_calloc(e->ctx, pell_dof_tiles(s->width, s->height), sizeof(float))))
        goto fail;
    if (pell_cpu_spreads(frame) && !e->spread_lit &&
        !(e->spread_lit = pell_calloc(e->ctx, pell_spread_blocks(e->surface.stride) * (size_t) s->height, 2)))
        goto fail;
    if (shares_highlights(frame) && !e->has_hidden &&
        !(e->has_hidden = pell_calloc(e->ctx, pell_highlights_blocks(e->surface.stride) * (size_t) s->height, 1)))
        goto fail;
    e->sum.meter = e->rows + (size_t) s->height * 4;
    e->surface.mips = e->mips;
    e->surface.omit_uniform = true;
    /* Keeps the hits for methods that need them, and the mesh where it identifies the object. */
    e->surface.mesh = hits || by_object ? (uint32_t *) e->plane[PELL_PLANE_MESH][0] : NULL;
    e->surface.triangle = hits ? (uint32_t *) e->plane[PELL_PLANE_TRIANGLE][0] : NULL;
    e->surface.barycentric[0] = hits ? e->plane[PELL_PLANE_BARYCENTRIC][0] : NULL;
    e->surface.barycentric[1] = hits ? e->plane[PELL_PLANE_BARYCENTRIC][1] : NULL;
    e->has_planes = true;
    return PELL_OK;

fail:
    if (!e->has_planes)
        drop_planes(e);
    return res;
}

static enum pell_result make_contact(struct pell_cpu *e, const struct pell_engine_frame *frame)
{
    const double start = pell_seconds();
    const enum pell_result res = pell_contact_create(e->ctx, e->pool, e->scene, e->rays, &e->contact);

    if (e->contact)
        pell_stage_note(frame->notes, "contact shadow", pell_seconds() - start, 0, 0, 0);
    return res;
}

static enum pell_result make_curvature(struct pell_cpu *e, const struct pell_engine_frame *frame)
{
    const double start = pell_seconds();
    enum pell_result res;

    if (!frame->settings->curvature)
        return PELL_OK;
    res = pell_media_curvature(e->ctx, e->pool, e->scene, e->rays, frame->materials, &e->curvature);
    pell_stage_note(frame->notes, "curvature", pell_seconds() - start, 0, 0, 0);
    return res;
}

static enum pell_result make_links(struct pell_cpu *e, const struct pell_engine_frame *frame)
{
    const struct pell_settings *s = frame->settings;
    const double start = pell_seconds();
    enum pell_result res;
    const struct pell_indirect_params params = {
        .scene = e->scene,
        .rays = e->rays,
        .tables = e->tables,
        .smooth = s->boundary == PELL_BOUNDARY_MODEL_SMOOTH,
        .samples = s->indirect_samples,
        .seed = pell_settings_seed(s),
    };

    if (s->bounces == 0)
        return PELL_OK;
    res = pell_indirect_create(e->ctx, e->pool, &params, &e->indirect);
    pell_stage_note(frame->notes, "indirect links", pell_seconds() - start, 0, 0, 0);
    return res;
}

static enum pell_result make_indirect(struct pell_cpu *e, const struct pell_engine_frame *frame)
{
    const double start = pell_seconds();
    enum pell_result res;

    if (!e->indirect)
        return PELL_OK;
    res = pell_indirect_solve(e->indirect, e->pool, &(struct pell_indirect_lights) { pell_cpu_light_points, e },
                              (const float(*)[3]) frame->materials->total, frame->settings->bounces);
    e->indirect_solved = res == PELL_OK;
    pell_stage_note(frame->notes, "indirect light", pell_seconds() - start, 0, 0, 0);
    return res;
}

static enum pell_result make_through(struct pell_cpu *e, const struct pell_engine_frame *frame)
{
    const struct pell_indirect_params params = {
        .scene = e->scene,
        .rays = e->rays,
        .tables = e->tables,
        .samples = frame->settings->indirect_samples,
        .solids_only = true,
        .samples_from = e->indirect,
    };
    const double start = pell_seconds();
    enum pell_result res = PELL_OK;

    if (e->curvature)
        res = pell_media_solids(e->ctx, e->pool, frame, &params, &(struct pell_indirect_lights) { pell_cpu_light_points, e }, &e->solids,
                                &e->solid_light);
    e->whole_solid = frame->plan && frame->plan->opposed;
    e->between_faces = frame->plan && pell_plan_transmits(frame->plan);
    pell_stage_note(frame->notes, "through", pell_seconds() - start, 0, 0, 0);
    return res;
}

static enum pell_result make_unscattered(struct pell_cpu *e, const struct pell_engine_frame *frame)
{
    const double start = pell_seconds();
    enum pell_result res;

    if (!frame->settings->unscattered)
        return PELL_OK;
    res = pell_unscattered_create(e->ctx, e->scene, e->rays, frame->materials->frame_index, frame->materials->frame, &e->unscattered);
    pell_stage_note(frame->notes, "unscattered", pell_seconds() - start, 0, 0, 0);
    return res;
}

static enum pell_result cpu_make(void *engine, enum pell_engine_resource resource, const struct pell_engine_frame *frame)
{
    struct pell_cpu *e = engine;
    const struct pell_settings *s = frame->settings;
    enum pell_result res = PELL_OK;

    e->solids_version += resource >= PELL_ENGINE_CURVATURE && resource <= PELL_ENGINE_THROUGH;
    switch (resource) {
    case PELL_ENGINE_SCENE: return make_scene(e, frame->scene);
    case PELL_ENGINE_PLANES: return make_planes(e, frame);
    case PELL_ENGINE_RASTER:
        if (!e->raster_tried)
            res = pell_raster_create(e->ctx, e->scene, s->width, s->height, &e->raster);
        e->raster_tried = res == PELL_OK;
        e->surface.raster = e->raster;
        return res;
    case PELL_ENGINE_LIGHTS:
        e->settings = s;
        e->materials = frame->materials;
        pell_specular_tables_choose(e->tables, e->scene, s->specular);
        return pell_lights_create(e->ctx, e->scene, s, e->pool, &e->lights);
    case PELL_ENGINE_CONTACT: return make_contact(e, frame);
    case PELL_ENGINE_CURVATURE: return make_curvature(e, frame);
    case PELL_ENGINE_LINKS: return make_links(e, frame);
    case PELL_ENGINE_INDIRECT: return make_indirect(e, frame);
    case PELL_ENGINE_THROUGH: return make_through(e, frame);
    case PELL_ENGINE_UNSCATTERED: return make_unscattered(e, frame);
    case PELL_ENGINE_RESOURCES: break;
    }
    return PELL_OK;
}

static void cpu_drop(void *engine, enum pell_engine_resource resource)
{
    struct pell_cpu *e = engine;

    e->solids_version += resource >= PELL_ENGINE_CURVATURE && resource <= PELL_ENGINE_THROUGH;
    switch (resource) {
    case PELL_ENGINE_SCENE: drop_scene(e); break;
    case PELL_ENGINE_PLANES: drop_planes(e); break;
    case PELL_ENGINE_RASTER:
        pell_raster_destroy(&e->raster);
        e->surface.raster = NULL;
        e->raster_tried = false;
        break;
    case PELL_ENGINE_LIGHTS: pell_lights_destroy(&e->lights); break;
    case PELL_ENGINE_CONTACT: pell_contact_destroy(&e->contact); break;
    case PELL_ENGINE_CURVATURE: pell_curvature_destroy(&e->curvature); break;
    case PELL_ENGINE_LINKS:                /* depends on the surfaces, like solids */
        pell_indirect_destroy(&e->solids); /* it may borrow from the links */
        pell_indirect_destroy(&e->indirect);
        break;
    case PELL_ENGINE_INDIRECT: e->indirect_solved = false; break;
    case PELL_ENGINE_THROUGH: e->solid_light = NULL; break;
    case PELL_ENGINE_UNSCATTERED: pell_unscattered_destroy(&e->unscattered); break;
    case PELL_ENGINE_RESOURCES: break;
    }
}

static void cpu_close(void *engine)
{
    struct pell_cpu *e = engine;

    for (int i = 0; e && i < PELL_ENGINE_RESOURCES; i++)
        cpu_drop(e, (enum pell_engine_resource) i);
    if (e)
        pell_free(e->ctx, e);
}

/* --- The stages of a sample ------------------------------------------------------------------------------------------------------- */

static enum pell_result cpu_surface(void *engine, const struct pell_engine_sample *sample, struct pell_engine_seen *seen)
{
    struct pell_cpu *e = engine;
    const struct pell_surface *s = &e->surface;
    const double start = pell_seconds();
    enum pell_result res;

    e->surface.spread = pell_surface_spread(sample->frame->settings);
    res = pell_surface_render(e->pool, e->rays, e->scene, &sample->view, &e->surface);
    if (res != PELL_OK)
        return res;
    pell_stage_note(sample->frame->notes, "surface", pell_seconds() - start, s->covered_pixels, s->rays, s->covered_pixels * 72);
    *seen = (struct pell_engine_seen) { s->translucent, s->translucent_pixels };
    return PELL_OK;
}

/* Notes the part of the stage "irradiance" that ran on the device. Returns its seconds. */
static double note_device(struct pell_cpu *e, struct pell_stage_notes *notes)
{
    const char *why = e->light_device ? pell_light_device_refuses(e->light_device) : NULL, *also;
    struct pell_light_device_times t;

    if (why)
        pell_stage_note(notes, why, 0.0, 0, 0, 0);
    if (!e->light_device || why)
        return 0.0;
    also = pell_light_device_refuses_transmission(e->light_device);
    if (also)
        pell_stage_note(notes, also, 0.0, 0, 0, 0);
    t = pell_light_device_times(e->light_device);
    pell_stage_note(notes, "light upload", t.upload, t.points, 0, 2 * t.bytes_up);
    pell_stage_note(notes, "direct light", t.light, t.points, e->lighting.device_rays, t.bytes_up + t.bytes_down);
    if (e->lighting.through_rays > 0)
        pell_stage_note(notes, "transmission", t.transmission, t.points, e->lighting.through_rays, t.bytes_up);
    pell_stage_note(notes, "light download", t.download, t.points, 0, 2 * t.bytes_down);
    return t.upload + t.light + t.transmission + t.download;
}

struct pell_irradiance_params pell_cpu_sample_light(const struct pell_cpu *e, const struct pell_engine_sample *sample)
{
    const struct pell_engine_frame *f = sample->frame;
    const float mix = f->plan ? f->plan->mix : -1.0f;
    const bool separate = f->plan && f->materials->separates_single;
    struct pell_irradiance_params light = pell_cpu_light(e, mix, separate);

    light.view = &sample->view;
    light.local = f->plan && (f->plan->needs & PELL_NEED_TRANSMISSION);
    light.transmits = f->plan && (light.local || f->plan->local);
    light.opposed &= f->plan && f->plan->opposed;
    if (!f->plan) /* light leaves where it enters, whatever the shape */
        light.curvature = NULL;
    light.solid_light = e->solid_light;
    light.whole_solid = e->whole_solid;
    light.between_faces = light.local && e->solid_light && e->between_faces;
    light.thickness = light.local ? f->materials->thickness : NULL;
    light.sample = (uint32_t) sample->index;
    light.device = e->light_device && !pell_light_device_refuses(e->light_device) ? e->light_device : NULL;
    light.separate = separate ? f->materials->separate : NULL;
    light.shared = shares_highlights(f);
    light.radius = (const float(*)[3]) f->materials->radius;
    return light;
}

struct pell_composite_params pell_cpu_sample_composite(const struct pell_cpu *e, const struct pell_engine_sample *sample,
                                                       const struct pell_irradiance_params *light)
{
    const struct pell_engine_frame *f = sample->frame;
    const struct pell_settings *settings = f->settings;
    const struct pell_vec3 middle = vec3_mul(vec3_add(vec3_load(e->scene->bounds_min), vec3_load(e->scene->bounds_max)), 0.5f);
    const float straight = (1.0f - pell_lights_diffuse(e->lights, middle)) * (1.0f - pell_indirect_diffuse(e->indirect));

    return (struct pell_composite_params) {
        .scene = e->scene,
        .view = &sample->view,
        .surface = &e->surface,
        .tables = e->tables,
        .lighting = &e->lighting,
        .total = (const float(*)[3]) f->materials->total,
        .angle = light->angle,
        .mix = light->mix,
        .diffuse = 1.0f - straight,
        .smooth = settings->boundary == PELL_BOUNDARY_MODEL_SMOOTH,
        .published = settings->exit == PELL_EXIT_NORMALIZATION_PUBLISHED,
        .rect = f->covered,
        .weight = 1.0f / (float) settings->msaa,
        .first = sample->index == 0,
    };
}

static enum pell_result cpu_irradiance(void *engine, const struct pell_engine_sample *sample)
{
    struct pell_cpu *e = engine;
    const struct pell_engine_frame *f = sample->frame;
    const struct pell_irradiance_params light = pell_cpu_sample_light(e, sample);
    const double start = pell_seconds();
    const enum pell_result res = pell_irradiance_render(e->pool, e->lights, &light, &e->lighting);

    if (res != PELL_OK)
        return res;
    pell_stage_note(f->notes, "irradiance", pell_seconds() - start - note_device(e, f->notes), e->surface.covered_pixels,
                    e->lighting.shadow_rays, e->surface.covered_pixels * 108);
    if (light.shared)
        pell_cpu_share_highlights(e, sample);
    e->composite = pell_cpu_sample_composite(e, sample, &light);
    return PELL_OK;
}

static enum pell_result cpu_shade(void *engine, const struct pell_engine_sample *sample)
{
    struct pell_cpu *e = engine;
    const double start = pell_seconds();

    pell_composite_shaded(e->pool, e->compositor, &e->composite, e->plane[PELL_PLANE_SHADED]);
    pell_stage_note(sample->frame->notes, "lit", pell_seconds() - start, e->surface.translucent_pixels, 0,
                    e->surface.translucent_pixels * 48);
    return PELL_OK;
}

struct remap_task {
    const struct pell_surface *surface;
    const struct pell_view *view;
    const uint16_t *frame_index;
    const uint16_t *of_mesh; /* replaces `frame_index` where it is not NULL */
    uint16_t *out;
    float *const *position; /* NULL: not requested */
};

static void remap_row(void *arg, int index, int worker)
{
    const struct remap_task *t = arg;
    const struct pell_surface *s = t->surface;
    const int y = s->translucent.y0 + index;
    const ptrdiff_t row = y * s->stride;
    (void) worker;
    for (int x = s->translucent.x0; x < s->translucent.x1; x++)
        t->out[row + x] = t->frame_index[s->material[row + x]];
    for (int x = s->translucent.x0; t->of_mesh && x < s->translucent.x1; x++)
        if (t->out[row + x])
            t->out[row + x] = t->of_mesh[s->mesh[row + x]];
    for (int x = s->translucent.x0; t->position && x < s->translucent.x1; x++) {
        struct pell_vec3 start, direction, p;
        if (!t->out[row + x])
            continue;
        pell_view_ray(t->view, (float) x, (float) y, &start, &direction);
        p = vec3_mad(start, s->depth[row + x], direction);
        t->position[0][row + x] = p.x;
        t->position[1][row + x] = p.y;
        t->position[2][row + x] = p.z;
    }
}

static void cpu_hand_over(void *engine, const struct pell_engine_sample *sample, struct pell_frame *in, struct pell_frame_light *out)
{
    struct pell_cpu *e = engine;
    const struct pell_surface *s = &e->surface;
    float *const *const of_stages[PELL_PLANES] = {
        [PELL_PLANE_DEPTH] = &s->depth,
        [PELL_PLANE_STRENGTH] = &s->strength,
        [PELL_PLANE_BASE] = s->base,
        [PELL_PLANE_NORMAL] = s->ns,
        [PELL_PLANE_IRRADIANCE] = e->lighting.irradiance,
    };
    const struct remap_task remap = {
        .surface = s,
        .view = &sample->view,
        .frame_index = sample->frame->materials->frame_index,
        .of_mesh = pell_separates_objects(sample->frame->materials, sample->frame->plan) ? sample->frame->materials->of_mesh : NULL,
        .out = (uint16_t *) e->plane[PELL_PLANE_MATERIAL][0],
        .position = has_own_plane(PELL_PLANE_POSITION, sample->frame) ? e->plane[PELL_PLANE_POSITION] : NULL,
    };

    pell_pool_run(e->pool, s->translucent.y1 - s->translucent.y0, remap_row, (void *) &remap);
    if (pell_cpu_spreads(sample->frame))
        pell_cpu_spread(e, sample, remap.out);
    in->rect = s->translucent;
    for (int i = 0; i < PELL_PLANES; i++) {
        const struct pell_plane_info *p = pell_plane_at(i);
        float *const *from = of_stages[i] ? of_stages[i] : has_own_plane(i, sample->frame) ? e->plane[i] : NULL;
        if (from)
            memcpy((char *) (p->of_light ? (void *) out : (void *) in) + p->offset, from, (size_t) p->components * sizeof(*from));
    }
}

static enum pell_result cpu_composite(void *engine, const struct pell_engine_sample *sample, const struct pell_engine_scattered *scattered)
{
    struct pell_cpu *e = engine;
    const struct pell_plan *plan = sample->frame->plan;
    struct pell_composite_params *p = &e->composite;
    double start;

    if (scattered->present && pell_cpu_sees_through(e, sample->frame))
        pell_cpu_see_through(e, sample);
    start = pell_seconds();
    if (scattered->present) {
        if (e->solid_light && e->whole_solid)
            pell_indirect_correct(e->solid_light, e->pool, &sample->view, p->angle, &e->surface, e->plane[PELL_PLANE_LIGHT]);
        p->exitance = (const float *const *) e->plane[PELL_PLANE_LIGHT];
        p->radiance = plan->quantity == PELL_QUANTITY_RADIANCE;
        p->excludes_surface_reflection = plan->excludes_surface_reflection;
        p->single = has_own_plane(PELL_PLANE_SINGLE, sample->frame) ? (const float *const *) e->plane[PELL_PLANE_SINGLE]
                    : sample->frame->materials->separates_single    ? (const float *const *) e->lighting.single
                                                                    : NULL;
        p->unscattered = pell_cpu_sees_through(e, sample->frame) ? (const float *const *) e->display : NULL;
        p->reflected = has_own_plane(PELL_PLANE_SURFACE, sample->frame) ? (const float *const *) e->plane[PELL_PLANE_SURFACE] : NULL;
        p->standard_error = scattered->standard_error[0] ? scattered->standard_error : NULL;
    }
    if (sample->frame->lens->radius > 0.0f) {
        const enum pell_result res = pell_cpu_composite_through_lens(e, sample);
        if (res != PELL_OK)
            return res;
    } else {
        e->lens_pending = false; /* of a frame that failed */
        pell_composite_render(e->pool, e->compositor, p, &e->sum);
        pell_stage_note(sample->frame->notes, "composite", pell_seconds() - start, e->surface.covered_pixels, 0,
                        e->surface.covered_pixels * 64);
    }
    return pell_cancelled(e->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

/* --- The end of a frame ------------------------------------------------------------------------------------------------------------ */

static void cpu_read_back(void *engine, const struct pell_engine_frame *frame, bool noisy, struct pell_channel *channels,
                          struct pell_engine_result *out)
{
    const struct pell_cpu *e = engine;
    const bool single = frame->plan && (frame->plan->outputs & PELL_OUTPUT_SINGLE || frame->materials->separates_single);

    *out = (struct pell_engine_result) {
        .display = { e->display[0], e->display[1], e->display[2] },
        .alpha = e->sum.alpha,
        .stride = e->surface.stride,
        .exposure = e->post.exposure,
        .white = e->post.white,
        .invalid = e->post.invalid,
        .covered = e->post.covered,
        .any_light = e->post.any_light,
        .negligible = e->post.negligible,
        .widest_disc = frame->lens->radius > 0.0f ? e->widest_disc : 0.0f,
    };
    for (size_t k = 0; k < PELL_OUTPUT_LAYERS; k++) {
        const struct pell_output_layer *l = &pell_output_layers[k];
        float *const *planes = pell_output_layer_planes(&e->sum, l);
        for (int c = 0; c < l->components && pell_output_layer_given(l, frame->settings, single, noisy); c++)
            channels[out->num_channels++] = (struct pell_channel) { l->names[c], planes[c], out->stride, l->full_float };
    }
}

double pell_engine_cpu_trace_bare(void *engine, const struct pell_view *view)
{
    struct pell_cpu *e = engine;

    return e->rays && e->has_planes ? pell_surface_trace_bare(e->pool, e->rays, e->scene, view, &e->surface) : 0.0;
}

void pell_engine_cpu_record_rays(void *engine, struct pell_ray_record *record)
{
    struct pell_cpu *e = engine;

    if (e->rays)
        pell_rays_record(e->rays, record);
}

static const struct pell_method_engine *cpu_method(const struct pell_method *method)
{
    return method->cpu;
}

const struct pell_engine_interface pell_engine_cpu = {
    .name = "cpu",
    .method = cpu_method,
    .open = cpu_open,
    .close = cpu_close,
    .make = cpu_make,
    .drop = cpu_drop,
    .lend = pell_cpu_lend,
    .surface = cpu_surface,
    .irradiance = cpu_irradiance,
    .shade = cpu_shade,
    .hand_over = cpu_hand_over,
    .composite = cpu_composite,
    .average = pell_cpu_average,
    .post = pell_cpu_post,
    .read_back = cpu_read_back,
};
