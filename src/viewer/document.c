/* SPDX-License-Identifier: MIT
 * document.c - the displayed scene, as a scene file. */
#include "viewer/document.h"

#include "base/file.h"
#include "scene/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define DEGREES (180.0 / PELL_PI)

/* --- Values ----------------------------------------------------------------------------------------------------------------------- */

/* The shortest decimal that reads back as the same float. */
static json_t *number(float x)
{
    char text[40];
    double value = (double) x;

    pell_format_number((double) x, true, text, sizeof(text));
    pell_parse_number(text, strlen(text), &value);
    return json_real(value);
}

static json_t *numbers(const float *v)
{
    json_t *a = json_array();

    for (int i = 0; i < 3; i++)
        json_array_append_new(a, number(v[i]));
    return a;
}

static json_t *length(double mm)
{
    char text[40];
    return json_sprintf("%smm", pell_format_number(mm, true, text, sizeof(text)));
}

static json_t *position(const float *v)
{
    json_t *a = json_array();

    for (int i = 0; i < 3; i++)
        json_array_append_new(a, length((double) v[i]));
    return a;
}

/* A point `distance` mm along a direction. */
static json_t *target(const float *from, const float *direction, float distance)
{
    float to[3];

    for (int i = 0; i < 3; i++)
        to[i] = from[i] + distance * direction[i];
    return position(to);
}

/* Distance of the centre of the bounds along a direction, at least a small one. */
static float distance_to_middle(const struct pell_scene *scene, const float *from, const float *direction)
{
    float along = 0.0f, extent = 0.0f;

    for (int i = 0; i < 3; i++) {
        along += (0.5f * (scene->bounds_min[i] + scene->bounds_max[i]) - from[i]) * direction[i];
        extent = fmaxf(extent, scene->bounds_max[i] - scene->bounds_min[i]);
    }
    return fmaxf(along, 0.01f * extent);
}

/* --- Camera and lights of a scene ----------------------------------------------------------------------------------------------------- */

static json_t *camera_json(const struct pell_scene *scene)
{
    const struct pell_camera *c = &scene->cameras[0];
    json_t *o = json_pack("{s:o,s:o,s:o}", "from", position(c->position), "to",
                          target(c->position, c->forward, distance_to_middle(scene, c->position, c->forward)), "up", numbers(c->up));

    if (o && c->ortho_height > 0.0f)
        json_object_set_new(o, "ortho_height", length((double) c->ortho_height));
    else if (o)
        json_object_set_new(o, "fov_deg", number((float) ((double) c->fov * DEGREES)));
    if (o && c->focus > 0.0f)
        json_object_set_new(o, "focus", length((double) c->focus));
    if (o && c->f_number > 0.0f)
        json_object_set_new(o, "f_number", number(c->f_number));
    return o;
}

static const char *const light_names[] = { "point", "spot", "directional", "rect", "disc", "environment" };
static const char *const power_keys[] = { "intensity", "intensity", "irradiance", "radiance", "radiance", "color" };

static void set_shape(json_t *o, const struct pell_light *l)
{
    if (l->type == PELL_LIGHT_RECT) {
        json_object_set_new(o, "width", length((double) l->width));
        json_object_set_new(o, "height", length((double) l->height));
    }
    if (l->type == PELL_LIGHT_DISC)
        json_object_set_new(o, "radius", length((double) l->radius));
    if (l->type == PELL_LIGHT_SPOT) {
        json_object_set_new(o, "cone_deg", number((float) (2.0 * DEGREES * acos((double) l->cos_outer))));
        json_object_set_new(o, "inner_deg", number((float) (2.0 * DEGREES * acos((double) l->cos_inner))));
    }
}

/* A light's JSON from the file (`given`, or NULL), with lengths in mm. */
static json_t *light_json(const struct pell_scene *scene, const struct pell_light *l, const json_t *given)
{
    json_t *o = given ? json_deep_copy(given) : json_object();

    if (!o)
        return NULL;
    json_object_set_new(o, "type", json_string(light_names[l->type]));
    if (l->name && l->name[0])
        json_object_set_new(o, "name", json_string(l->name));
    if (!given || (l->type != PELL_LIGHT_ENVIRONMENT && !json_object_get(o, power_keys[l->type])))
        json_object_set_new(o, power_keys[l->type], numbers(l->power));
    if (l->type == PELL_LIGHT_ENVIRONMENT) {
        if (!json_object_get(o, "scale"))
            json_object_set_new(o, "scale", json_integer(1));
        if (!json_object_get(o, "rotate_deg"))
            json_object_set_new(o, "rotate_deg", number((float) ((double) l->rotate * DEGREES)));
        return o;
    }
    if (l->type == PELL_LIGHT_DIRECTIONAL) {
        json_object_set_new(o, "direction", numbers(l->direction));
        return o;
    }
    json_object_set_new(o, "at", position(l->position));
    if (l->type != PELL_LIGHT_POINT || json_object_get(o, "to") || json_object_get(o, "project")) {
        json_object_set_new(o, "to", target(l->position, l->direction, distance_to_middle(scene, l->position, l->direction)));
        json_object_set_new(o, "up", numbers(l->up));
    }
    set_shape(o, l);
    return o;
}

enum pell_result viewer_document_note(struct viewer_document *d, const struct pell_scene *scene)
{
    const json_t *given = json_object_get(d->base, "lights");
    const bool listed = json_array_size(given) == scene->num_lights;

    json_decref(d->camera);
    json_decref(d->lights);
    d->camera = camera_json(scene);
    d->lights = json_array();
    d->studio = false;
    if (scene->ground_mesh >= 0 && !json_object_get(d->base, "ground") &&
        !json_object_get(json_object_get(d->base, "background"), "ground"))
        json_object_set_new(d->base, "ground", json_true()); /* also if its lights are listed one by one */
    for (size_t i = 0; i < scene->num_lights; i++) {
        const struct pell_light *l = &scene->lights[i];
        const json_t *one = listed ? json_array_get(given, i) : NULL;
        d->studio |= strncmp(l->name, "studio ", 7) == 0;
        if (json_array_append_new(d->lights, light_json(scene, l, json_object_get(one, "studio") ? NULL : one)) != 0)
            return pell_error(d->ctx, PELL_ERR_NOMEM, d->path, NULL, "out of memory: lights");
    }
    return d->camera ? PELL_OK : pell_error(d->ctx, PELL_ERR_NOMEM, d->path, NULL, "out of memory: camera");
}

/* --- The input ------------------------------------------------------------------------------------------------------------------------ */

static enum pell_result read_base(struct viewer_document *d, const char *path, json_t **base)
{
    struct pell_json_file file = { .ctx = d->ctx, .path = path, .range_error = PELL_ERR_FORMAT };
    struct pell_json root;
    uint8_t *data = NULL;
    size_t size;
    bool scene;
    enum pell_result res;

    *base = NULL;
    PELL_TRY(pell_file_read(d->ctx, path, &data, &size));
    scene = pell_scene_detect_format(path, data, size) == PELL_SCENE_SCENE;
    res = PELL_ERR_NOMEM;
    if (!(d->path = pell_strdup(d->ctx, path)))
        goto fail;
    res = PELL_OK;
    if (scene) {
        PELL_TRY(pell_json_parse(&file, data, size));
        root = pell_json_root(&file);
        PELL_TRY(pell_json_is_object(&root));
        *base = json_incref(file.root);
    } else {
        *base = json_pack("{s:i,s:s}", "pellucid", 1, "mesh", pell_path_name(path));
    }
    if (!json_is_object(*base))
        res = pell_error(d->ctx, PELL_ERR_FORMAT, path, NULL, "its name or its content is not valid UTF-8, which scene files need");

fail:
    pell_json_finish(&file);
    pell_free(d->ctx, data);
    return res;
}

/* Adds --environment as a light. A file below the input's folder is named relative to it, as in a hand-written scene file. */
static enum pell_result add_environment(struct viewer_document *d, const char *input, const struct pell_load_params *params)
{
    const double scale = params->environment_scale > 0.0 ? params->environment_scale : 1.0;
    char *folder = pell_path_folder(d->ctx, input), *file = NULL;
    json_t *light;
    bool below;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!folder)
        goto fail;
    PELL_TRY(pell_path_relative(d->ctx, "--environment", folder, params->environment, &below, &file));
    light =
        json_pack("{s:s,s:s,s:f,s:f}", "type", "environment", "image", file, "scale", scale, "rotate_deg", params->environment_rotate_deg);
    if (!light) {
        res = pell_error(d->ctx, PELL_ERR_INVALID, "--environment", NULL, "its name is not valid UTF-8, which scene files need");
        goto fail;
    }
    json_object_set_new(d->base, "lights", json_pack("[o]", light));
    json_object_set_new(d->base, "background", json_string("environment"));
    if (!below) {
        d->granted = file;
        file = NULL;
    }

fail:
    pell_free(d->ctx, folder);
    pell_free(d->ctx, file);
    return res;
}

/* Sets a key of every mesh, which may be given as a path alone. */
static void set_of_meshes(struct viewer_document *d, const char *key, json_t *value)
{
    json_t *meshes = json_object_get(d->base, "meshes"), *mesh = json_object_get(d->base, "mesh"), *all, *one;
    size_t i;

    all = meshes ? json_deep_copy(meshes) : json_pack("[O*]", mesh);
    if (json_is_string(mesh))
        json_object_del(d->base, "mesh");
    json_array_foreach(all, i, one)
    {
        json_t *o = json_is_string(one) ? json_pack("{s:O}", "path", one) : json_incref(one);
        json_object_set(o, key, value);
        json_array_set_new(all, i, o);
    }
    json_object_set_new(d->base, "meshes", all);
    json_decref(value);
}

/* Adds the command line's meshes, moment and camera in the form of a scene file. */
static void pose(struct viewer_document *d, const char *input, const struct pell_load_params *params)
{
    const bool own = params->camera && strcmp(params->camera, "scene file") == 0 && json_is_object(json_object_get(d->base, "camera"));

    if (params->up && strcmp(params->up, "z") == 0) {
        json_object_del(d->base, "mesh");
        json_object_set_new(d->base, "meshes", json_pack("[{s:s,s:[i,i,i]}]", "path", pell_path_name(input), "rotate_deg", -90, 0, 0));
    }
    if (params->normals)
        set_of_meshes(d, "normals", json_string(params->normals));
    if (params->thicken_mm > 0.0)
        set_of_meshes(d, "thicken", length(params->thicken_mm));
    if (params->animation)
        json_object_set_new(d->base, "animation", json_string(params->animation));
    if (params->timed)
        json_object_set_new(d->base, "time", json_real(params->time));
    if (params->camera && !own)
        json_object_set_new(d->base, "camera", json_string(params->camera));
    d->params.timed = false;
    d->params.time = d->params.thicken_mm = 0.0;
    d->params.up = d->params.normals = d->params.animation = d->params.camera = NULL;
}

/* Adds the command line's sides, lights and background in the form of a scene file. They were validated when the scene was loaded for the
 * command line. */
static enum pell_result surround(struct viewer_document *d, const char *input, const struct pell_load_params *params)
{
    const json_t *background = json_object_get(d->base, "background");
    const bool plain = !json_is_string(background) && !json_object_get(background, "image");
    enum pell_result res;
    int studio;

    if (params->ground && !json_object_get(d->base, "ground") && !json_object_get(background, "ground"))
        json_object_set_new(d->base, "ground", json_true());
    if (params->from)
        json_object_set_new(d->base, "camera", json_pack("{s:s}", "side", params->from));
    if (params->studio) {
        PELL_TRY(pell_studio_read(d->ctx, PELL_ERR_INVALID, "--studio", params->studio, &studio));
        json_object_set_new(d->base, "lights", json_pack("[{s:s}]", "studio", params->studio));
        if (pell_studio_has_backdrop(studio) && plain && !params->background && !json_object_get(background, "ground"))
            json_object_set_new(d->base, "ground", json_true());
    }
    if (params->environment)
        PELL_TRY(add_environment(d, input, params));
    if (params->background)
        json_object_set_new(d->base, "background", json_string(params->background));
    d->params.ground = false;
    d->params.from = d->params.studio = d->params.environment = d->params.background = NULL;
    d->params.environment_scale = d->params.environment_rotate_deg = 0.0;
    return PELL_OK;

fail:
    return res;
}

enum pell_result viewer_document_open(struct pell_context *ctx, const char *path, const struct pell_load_params *params, const char *size,
                                      const char *unit, struct viewer_document *out)
{
    enum pell_result res;

    *out = (struct viewer_document) { .ctx = ctx, .params = *params };
    PELL_TRY(read_base(out, path, &out->base));
    out->params.size_mm = out->params.mm_per_unit = 0.0;
    out->params.aspect = 0.0f;
    if (size || unit) {
        json_object_del(out->base, "size");
        json_object_del(out->base, "unit");
        json_object_set_new(out->base, size ? "size" : "unit", json_string(size ? size : unit));
    }
    if (params->material && !pell_material_is_path(params->material)) {
        out->params.material = NULL;
        json_object_set_new(out->base, "materials", json_pack("{s:{s:s}}", "*", "preset", params->material));
    }
    pose(out, path, params);
    PELL_TRY(surround(out, path, params));
    return PELL_OK;

fail:
    viewer_document_close(out);
    return res;
}

bool viewer_document_holds(const struct viewer_document *d, const char *option)
{
    static const char *const others[] = { "allow-outside", "limit", "engine", "device", "threads" };

    for (size_t i = 0; i < PELL_COUNT(others); i++)
        if (strcmp(option, others[i]) == 0)
            return false;
    return strcmp(option, "material") != 0 || !d->params.material;
}

void viewer_document_close(struct viewer_document *d)
{
    if (d->ctx) {
        pell_free(d->ctx, d->path);
        pell_free(d->ctx, d->granted);
    }
    json_decref(d->base);
    json_decref(d->camera);
    json_decref(d->lights);
    *d = (struct viewer_document) { .ctx = NULL };
}

/* --- With a page's changes ------------------------------------------------------------------------------------------------------------ */

/* The camera that frames the object depends on the image's aspect ratio. */
static json_t *size_of(const struct viewer_message *view)
{
    struct pell_settings settings;
    int64_t n;

    pell_settings_default(NULL, NULL, &settings);
    for (size_t i = 0; i < view->num_settings; i++) {
        const struct pell_setting *s = &view->settings[i];
        int *to = strcmp(s->name, "width") == 0 ? &settings.width : strcmp(s->name, "height") == 0 ? &settings.height : NULL;
        if (to && pell_parse_int(s->value, strlen(s->value), &n) && n > 0 && n <= 65536)
            *to = (int) n;
    }
    return json_pack("{s:i,s:i}", "width", settings.width, "height", settings.height);
}

json_t *viewer_document_merge(const struct viewer_document *d, const struct viewer_message *view)
{
    json_t *o = json_copy(d->base), *lights = view->lights;

    if (!o)
        return NULL;
    json_object_set_new(o, "render", size_of(view));
    if (!lights && view->camera && d->studio) /* they are fixed while the camera moves */
        lights = d->lights;
    if (view->camera)
        json_object_set(o, "camera", view->camera);
    if (lights)
        json_object_set(o, "lights", lights);
    if (view->materials)
        json_object_set(o, "materials", view->materials);
    if (view->timed)
        json_object_set_new(o, "time", json_real(view->time));
    return o;
}

static struct pell_load_params params_of(const struct viewer_document *d, const struct viewer_message *view)
{
    struct pell_load_params params = d->params;

    if (view && view->materials)
        params.material = NULL;
    return params;
}

enum pell_result viewer_document_load(const struct viewer_document *d, const struct viewer_message *view, json_t *document,
                                      struct pell_scene **out)
{
    const struct pell_load_params params = params_of(d, view);
    struct pell_loader loader = { .ctx = d->ctx, .params = &params, .is_scene_file = true, .granted = d->granted };
    char *text = json_dumps(document, JSON_COMPACT), *folder = pell_path_folder(d->ctx, d->path);
    enum pell_result res;

    *out = NULL;
    loader.root = folder;
    res = text && folder ? pell_scene_load_bytes(&loader, d->path, (const uint8_t *) text, strlen(text), out)
                         : pell_error(d->ctx, PELL_ERR_NOMEM, d->path, NULL, "out of memory: scene");
    pell_free(d->ctx, folder);
    free(text);
    return res;
}

char *viewer_document_structure(const struct viewer_document *d, const struct viewer_message *view, json_t *document)
{
    const struct pell_load_params params = params_of(d, view);
    json_t *rest = json_copy(document), *types = json_array(), *light;
    const json_t *lights = json_object_get(document, "lights");
    char *text = NULL;
    size_t i;

    if (!view->lights)
        lights = d->lights;
    json_array_foreach(lights, i, light) json_array_append(types, json_object_get(light, "type"));
    if (rest && types) {
        json_object_set_new(rest, "camera", json_true());
        json_object_set(rest, "lights", types);
        json_object_set_new(rest, "material", json_string(params.material ? params.material : ""));
        text = json_dumps(rest, JSON_COMPACT | JSON_SORT_KEYS);
    }
    json_decref(rest);
    json_decref(types);
    return text;
}
