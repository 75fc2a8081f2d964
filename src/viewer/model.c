/* SPDX-License-Identifier: MIT
 * model.c - the loaded scene, and its renderers. */
#include "viewer/model.h"

#include "cli/cli.h"
#include "math/scalar.h"
#include "scene/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum pell_result viewer_model_open(struct pell_context *ctx, struct pell_device *device, struct viewer_document *document,
                                   struct viewer_model *out)
{
    *out = (struct viewer_model) { .ctx = ctx, .device = device, .document = *document };
    *document = (struct viewer_document) { .ctx = NULL };
    return PELL_OK;
}

static void finish_view_key(struct viewer_view_key *s)
{
    free(s->structure);
    free(s->camera);
    free(s->lights);
    *s = (struct viewer_view_key) { NULL };
}

void viewer_model_close(struct viewer_model *m)
{
    for (int i = 0; i < VIEWER_SLOTS; i++) {
        pell_renderer_destroy(&m->slots[i].renderer);
        free(m->slots[i].setup);
        if (m->ctx)
            pell_method_knobs_destroy(m->ctx, &m->slots[i].knobs);
    }
    pell_scene_destroy(&m->scene);
    viewer_document_close(&m->document);
    finish_view_key(&m->view_key);
    free(m->loaded_camera);
    free(m->metered);
    *m = (struct viewer_model) { .ctx = NULL };
}

static enum pell_result no_memory(const struct viewer_model *m)
{
    return pell_error(m->ctx, PELL_ERR_NOMEM, "viewer", NULL, "out of memory");
}

static bool same(const char *a, const char *b)
{
    return a && b && strcmp(a, b) == 0;
}

static void replace(char **to, char **from)
{
    free(*to);
    *to = *from;
    *from = NULL;
}

/* --- The scene ------------------------------------------------------------------------------------------------------------------------ */

/* A part of the document as text; "null": unchanged. NULL if out of memory. */
static char *text_of(const json_t *part)
{
    return part ? json_dumps(part, JSON_COMPACT | JSON_SORT_KEYS) : strdup("null");
}

/* The lights of a document that a page moved, or that depend on a camera that has moved. */
static json_t *lights_of(const struct viewer_model *m, const json_t *document, const struct viewer_message *view)
{
    return view->lights || (view->camera && m->document.studio) ? json_object_get(document, "lights") : NULL;
}

static enum pell_result load(struct viewer_model *m, const struct viewer_message *view, json_t *document)
{
    struct pell_scene *scene = NULL;
    enum pell_result res;

    PELL_TRY(viewer_document_load(&m->document, view, document, &scene));
    if (!m->document.camera || m->stale)
        PELL_TRY(viewer_document_note(&m->document, scene));
    for (int i = 0; i < VIEWER_SLOTS; i++)
        if (m->slots[i].renderer)
            PELL_TRY(pell_renderer_set_scene(m->slots[i].renderer, NULL));
    pell_scene_destroy(&m->scene);
    m->scene = scene;
    m->loads++;
    m->stale = false;
    return PELL_OK;

fail:
    pell_scene_destroy(&scene);
    return res;
}

/* Updates camera and lights of the loaded scene. */
static enum pell_result move(struct viewer_model *m, json_t *camera, json_t *lights)
{
    json_t *o = json_object();
    char *text = NULL;
    enum pell_result res = PELL_ERR_NOMEM;

    if (camera)
        json_object_set(o, "camera", camera);
    if (lights)
        json_object_set(o, "lights", lights);
    if (o && (text = json_dumps(o, JSON_COMPACT)))
        res = pell_scene_read_view(m->scene, m->document.path, text, strlen(text));
    json_decref(o);
    free(text);
    return res;
}

static enum pell_result load_or_move(struct viewer_model *m, const struct viewer_message *view, json_t *document,
                                     const struct viewer_view_key *next, bool exact)
{
    const struct viewer_view_key *last = &m->view_key;
    const bool back = (!view->camera && !same(last->camera, "null")) || (strcmp(next->lights, "null") == 0 && !same(last->lights, "null"));
    const bool grounded = exact && m->scene && m->scene->ground_mesh >= 0; /* the ground depends on the first camera */
    enum pell_result res = PELL_OK;

    if (!m->scene || m->stale || !same(next->structure, last->structure) || back || (grounded && !same(next->camera, m->loaded_camera))) {
        char *camera = strdup(next->camera);
        if (!camera)
            return no_memory(m);
        res = load(m, view, document);
        if (res == PELL_OK)
            replace(&m->loaded_camera, &camera);
        free(camera);
        return res;
    }
    if (same(next->camera, last->camera) && same(next->lights, last->lights))
        return PELL_OK;
    res = move(m, view->camera, lights_of(m, document, view));
    if (res != PELL_OK) { /* some lights may have been removed */
        free(m->view_key.structure);
        m->view_key.structure = NULL;
        return res;
    }
    for (int i = 0; i < VIEWER_SLOTS; i++)
        if (m->slots[i].renderer && !same(next->lights, last->lights))
            pell_renderer_lights_changed(m->slots[i].renderer);
    return PELL_OK;
}

enum pell_result viewer_model_apply(struct viewer_model *m, const struct viewer_message *view, bool exact)
{
    json_t *document = viewer_document_merge(&m->document, view);
    struct viewer_view_key next = { NULL };
    const uint64_t loads = m->loads;
    enum pell_result res;

    if (document) {
        next.structure = viewer_document_structure(&m->document, view, document);
        next.camera = text_of(view->camera);
        next.lights = text_of(lights_of(m, document, view));
    }
    res = next.structure && next.camera && next.lights ? load_or_move(m, view, document, &next, exact) : no_memory(m);
    if (res == PELL_OK && loads != m->loads) { /* the types of its lights are known now */
        free(next.structure);
        next.structure = viewer_document_structure(&m->document, view, document);
    }
    if (res == PELL_OK) {
        replace(&m->view_key.structure, &next.structure);
        replace(&m->view_key.camera, &next.camera);
        replace(&m->view_key.lights, &next.lights);
    }
    json_decref(document);
    finish_view_key(&next);
    return res;
}

/* --- Renderers ------------------------------------------------------------------------------------------------------------------------ */

static char *setup_text(const struct viewer_setup *setup)
{
    json_t *o = json_object();
    char *text;

    json_object_set_new(o, "", json_string(setup->method ? setup->method : ""));
    for (size_t i = 0; i < setup->num_knobs; i++)
        json_object_set_new(o, setup->knobs[i].name, json_string(setup->knobs[i].value));
    text = o ? json_dumps(o, JSON_COMPACT | JSON_SORT_KEYS) : NULL;
    json_decref(o);
    return text;
}

/* Switches the slot to the method of the setup, if it has another. */
static enum pell_result choose(struct viewer_model *m, enum viewer_slot slot, const struct viewer_setup *setup)
{
    const char *name = setup->method ? setup->method : "screen-space";
    const struct pell_method *method = NULL;
    char *text = setup_text(setup);
    void *knobs = NULL;
    enum pell_result res = PELL_OK;

    if (!text)
        return no_memory(m);
    if (same(text, m->slots[slot].setup))
        goto fail;
    if (strcmp(name, "none") != 0) {
        res = PELL_ERR_INVALID;
        if (!(method = pell_method_find(m->ctx, "method", name)))
            goto fail;
        PELL_TRY(pell_method_knobs_create(m->ctx, method, NULL, &knobs));
        PELL_TRY(pell_method_configure(m->ctx, method, setup->knobs, setup->num_knobs, knobs));
    }
    PELL_TRY(pell_renderer_set_method(m->slots[slot].renderer, method, knobs));
    if (m->slots[slot].knobs)
        pell_method_knobs_destroy(m->ctx, &m->slots[slot].knobs);
    m->slots[slot].method = method;
    m->slots[slot].knobs = knobs;
    knobs = NULL;
    replace(&m->slots[slot].setup, &text);

fail:
    pell_method_knobs_destroy(m->ctx, &knobs);
    free(text);
    return res;
}

static enum pell_result read_settings(const struct viewer_model *m, enum viewer_slot slot, const struct viewer_message *view,
                                      struct pell_settings *settings)
{
    enum pell_result res = PELL_OK;

    pell_settings_default(m->slots[slot].method, m->slots[slot].knobs, settings);
    for (size_t i = 0; i < view->num_settings && res == PELL_OK; i++)
        res = pell_knob_set(m->ctx, pell_settings_knobs(), "render", view->settings[i].where, settings, view->settings[i].name,
                            view->settings[i].value);
    settings->layers = false;
    return res;
}

static void apply_quality(const struct viewer_quality *quality, struct pell_settings *s)
{
    s->width = (int) fmax(16.0, round(quality->scale * s->width));
    s->height = (int) fmax(9.0, round(quality->scale * s->height));
    s->seed += quality->seed_offset;
    s->layers = quality->layers;
    if (!quality->quick)
        return;
    s->msaa = 1;
    s->dof = false;
    s->light_samples = SMALLER(s->light_samples, 1);
    s->ambient_samples = SMALLER(s->ambient_samples, 1);
    s->environment_lights = SMALLER(s->environment_lights, 4);
    s->indirect_samples = SMALLER(s->indirect_samples, 2048);
}

/* Exposure and white are metered once for a scene and its lights, so that its images do not flicker, and methods can be compared. */
static char *meter_text(const struct viewer_model *m, bool lights_moved)
{
    /* Default lights count as unchanged if they are only listed because the camera has moved. */
    const char *structure = m->view_key.structure ? m->view_key.structure : "", *lights = lights_moved ? m->view_key.lights : "";
    const size_t size = strlen(structure) + strlen(lights) + 1;
    char *text = malloc(size);

    if (text)
        snprintf(text, size, "%s%s", structure, lights);
    return text;
}

enum pell_result viewer_model_render(struct viewer_model *m, enum viewer_slot slot, const struct viewer_message *view,
                                     const struct viewer_setup *setup, const struct viewer_quality *quality, struct pell_settings *settings,
                                     struct pell_render_result *image)
{
    char *metered = NULL;
    bool automatic;
    enum pell_result res;

    if (!m->slots[slot].renderer)
        PELL_TRY(pell_renderer_create(m->device, &m->slots[slot].renderer));
    PELL_TRY(choose(m, slot, setup));
    PELL_TRY(read_settings(m, slot, view, settings));
    apply_quality(quality, settings);
    if (m->slots[slot].loads != m->loads) {
        PELL_TRY(pell_renderer_set_scene(m->slots[slot].renderer, m->scene));
        m->slots[slot].loads = m->loads;
    }
    automatic = !(settings->exposure > 0.0f && settings->white > 0.0f);
    if (automatic && !(metered = meter_text(m, view->lights != NULL))) {
        res = no_memory(m);
        goto fail;
    }
    if (automatic && same(metered, m->metered)) {
        settings->exposure = settings->exposure > 0.0f ? settings->exposure : m->exposure;
        settings->white = settings->white > 0.0f ? settings->white : m->white;
    }
    PELL_TRY(pell_renderer_render(m->slots[slot].renderer, settings, image));
    settings->exposure = image->exposure;
    settings->white = image->white;
    if (automatic) {
        m->exposure = image->exposure;
        m->white = image->white;
        replace(&m->metered, &metered);
    }

fail:
    free(metered);
    return res;
}

const struct pell_method *viewer_model_method(const struct viewer_model *m, enum viewer_slot slot)
{
    return m->slots[slot].method;
}

/* --- For pages ------------------------------------------------------------------------------------------------------------------------ */

static json_t *texts(const struct pell_setting *list, size_t count)
{
    json_t *o = json_object();

    for (size_t i = 0; i < count; i++)
        json_object_set_new(o, list[i].name, json_string(list[i].value));
    return o;
}

json_t *viewer_model_saved(const struct viewer_model *m, const struct viewer_message *view)
{
    json_t *o = viewer_document_merge(&m->document, view), *settings = texts(view->settings, view->num_settings), *render;
    char text[40];

    if (!o || !settings || !(render = json_copy(settings))) {
        json_decref(o);
        json_decref(settings);
        return NULL;
    }
    json_object_update(render, json_object_get(o, "render")); /* width and height as numbers */
    json_decref(settings);
    json_object_set_new(render, "method", json_string(view->setup.method ? view->setup.method : "screen-space"));
    if (view->setup.num_knobs)
        json_object_set_new(render, "knobs", texts(view->setup.knobs, view->setup.num_knobs));
    if (!json_object_get(render, "exposure") && m->exposure > 0.0f)
        json_object_set_new(render, "exposure", json_string(pell_format_number((double) m->exposure, true, text, sizeof(text))));
    if (!json_object_get(render, "white") && m->white > 0.0f)
        json_object_set_new(render, "white", json_string(pell_format_number((double) m->white, true, text, sizeof(text))));
    json_object_set_new(o, "render", render);
    return o;
}

/* Layers from top to bottom; the depth is from the surface to the bottom of a layer, null for an infinite one. */
static json_t *layers_json(const struct pell_material *m)
{
    json_t *layers = json_array();

    for (int i = 0; i < m->num_layers; i++) {
        const struct pell_scene_layer *l = &m->layers[i];
        json_array_append_new(layers,
                              json_pack("{s:o,s:o,s:b,s:o,s:o}", "name", cli_text(l->name ? l->name : ""), "depth_mm",
                                        cli_number((double) l->depth), "mapped", l->depth_map.texture != NULL, "sigma_a",
                                        cli_numbers(l->medium.sigma_a, 3), "sigma_s_reduced", cli_numbers(l->medium.sigma_s_reduced, 3)));
    }
    return layers;
}

json_t *viewer_model_facts(const struct viewer_model *m)
{
    const struct pell_scene *s = m->scene;
    json_t *materials = json_array(), *bounds = json_array();
    int64_t triangles = 0;

    for (size_t i = 0; i < s->num_meshes; i++)
        triangles += (int) i == s->ground_mesh ? 0 : s->meshes[i].num_triangles;
    for (size_t i = 0; i < s->num_materials; i++) {
        const struct pell_material *x = &s->materials[i];
        json_array_append_new(materials, json_pack("{s:o,s:o,s:b,s:o}", "name", cli_text(x->name ? x->name : ""), "preset",
                                                   cli_text(x->preset ? x->preset : ""), "opaque", x->opaque, "layers", layers_json(x)));
    }
    for (int i = 0; i < 3; i++) {
        json_array_append_new(bounds, json_real((double) s->bounds_min[i]));
        json_array_append_new(bounds, json_real((double) s->bounds_max[i]));
    }
    return json_pack("{s:s,s:o,s:o,s:O,s:O,s:O*,s:I,s:b}", "type", "scene", "materials", materials, "bounds", bounds, "camera",
                     m->document.camera, "lights", m->document.lights, "said", json_object_get(m->document.base, "materials"), "triangles",
                     (json_int_t) triangles, "animated", s->animated);
}
