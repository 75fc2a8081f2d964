/* SPDX-License-Identifier: MIT
 * scene_file.c - Pellucid's own scene file: JSON that names meshes and adds what glTF can't express (data/scene.schema.json).
 *
 * Numbers of positions and lengths are in units of the mesh; texts include their unit. Materials are overridden in file/materials.c. */
#include "scene/file/scene_file.h"

#include "scene/material_maps.h"

#include <stdio.h>
#include <string.h>

/* --- Keys: with those of file/lights.c and file/materials.c the only list ----------------------------------------------------- */

#define KEYS(name, ...) static const char *const name[] = { __VA_ARGS__ }
KEYS(root_keys, "$schema", "pellucid", "mesh", "meshes", "unit", "size", "time", "animation", "image_rate", "camera", "lights", "materials",
     "background", "ground", "render");
KEYS(camera_keys, "from", "to", "up", "fov_deg", "ortho_height", "focus", "f_number");
KEYS(side_keys, "side");
KEYS(background_keys, "color", "image", "ground");
KEYS(render_keys, "method", "width", "height", "knobs"); /* and any other option of the command line: checked by whoever renders */

#define ROW(object, keys)                                                                                                                  \
    {                                                                                                                                      \
        object, keys, PELL_COUNT(keys)                                                                                                     \
    }
const struct pell_scene_keys pell_scene_keys[] = {
    ROW("", root_keys),
    { "mesh", pell_mesh_keys, PELL_MESH_KEYS },
    ROW("camera", camera_keys),
    ROW("camera_side", side_keys),
    ROW("background", background_keys),
    ROW("render", render_keys),
    { "material", pell_material_keys, PELL_MATERIAL_KEYS },
    { "skin", pell_skin_keys, PELL_SKIN_KEYS },
    { "specular", pell_specular_keys, PELL_SPECULAR_KEYS },
    { "textures", pell_texture_keys, PELL_TEXTURE_KEYS },
    { "layer", pell_layer_keys, PELL_LAYER_KEYS },
    { 0 },
};

#define ONLY(at, keys) pell_json_only(at, keys, PELL_COUNT(keys))

/* --- Camera ------------------------------------------------------------------------------------------------------------------- */

/* "side": the camera frames the objects, once all are known. The caller's camera overrides it. */
static enum pell_result read_side(struct pell_scene_reader *r, const struct pell_json *at, struct pell_extras *extras)
{
    const struct pell_json side = pell_json_get(at, "side");
    struct pell_viewpoint view = { .studio = extras->view.studio, .has_studio = extras->view.has_studio };
    struct pell_text where;
    const char *text;
    enum pell_result res;

    for (size_t i = 0; i < PELL_COUNT(camera_keys); i++)
        if (pell_json_has(at, camera_keys[i])) {
            const struct pell_json other = pell_json_get(at, camera_keys[i]);
            return pell_json_error(&other, PELL_ERR_FORMAT, "give \"from\" and \"to\" instead of \"side\"",
                                   "does not go with \"side\", by which the camera frames the objects");
        }
    PELL_TRY(ONLY(at, side_keys));
    PELL_TRY(pell_json_to_string(&side, &text));
    PELL_TRY(pell_side_read(r->ctx, PELL_ERR_FORMAT, pell_json_where(&side, &where), text, &view));
    if (!extras->view.has_from && !(r->loader && r->loader->params->camera))
        extras->view = view;

fail:
    return res;
}

static enum pell_result read_camera(struct pell_scene_reader *r, const struct pell_json *root, struct pell_extras *extras)
{
    const struct pell_json at = pell_json_get(root, "camera");
    double from[3], to[3] = { 0 }, fov = 20.0;
    struct pell_camera camera = { .up = { 0, 1, 0 } }, swap;
    struct pell_text where;
    const char *name;
    size_t index;
    enum pell_result res;

    if (!at.value)
        return PELL_OK;
    if (json_is_string(at.value)) {
        PELL_TRY(pell_json_to_string(&at, &name));
        return pell_scene_choose_camera(r->scene, pell_json_where(&at, &where), name, PELL_ERR_FORMAT);
    }
    if (pell_json_has(&at, "side"))
        return read_side(r, &at, extras);
    PELL_TRY(ONLY(&at, camera_keys));
    PELL_TRY(pell_json_require(&at, "from"));
    PELL_TRY(pell_scene_position(&at, "from", r->unit, from));
    PELL_TRY(pell_scene_position(&at, "to", r->unit, to));
    PELL_TRY(pell_scene_aim(&at, "to", from, to, camera.forward));
    PELL_TRY(pell_scene_direction(&at, "up", camera.up));
    if (pell_json_has(&at, "fov_deg") && pell_json_has(&at, "ortho_height"))
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "has both fov_deg and ortho_height; one is allowed");
    PELL_TRY(pell_json_number(&at, "fov_deg", 0.01, 179.0, &fov));
    PELL_TRY(pell_scene_length(&at, "ortho_height", r->unit, &camera.ortho_height));
    PELL_TRY(pell_scene_length(&at, "focus", r->unit, &camera.focus));
    PELL_TRY(pell_json_float(&at, "f_number", 0.1, 1e6, &camera.f_number));
    for (int c = 0; c < 3; c++)
        camera.position[c] = (float) from[c];
    camera.fov = (float) (fov * RADIANS);
    PELL_TRY(pell_scene_add_camera(r->scene, "scene file", &index));
    camera.name = r->scene->cameras[index].name;
    r->scene->cameras[index] = camera;
    swap = r->scene->cameras[0];
    r->scene->cameras[0] = r->scene->cameras[index];
    r->scene->cameras[index] = swap;
    return PELL_OK;

fail:
    return res;
}

/* --- Background, ground ------------------------------------------------------------------------------------------------------- */

static enum pell_result read_background(struct pell_scene_reader *r, const struct pell_json *root, struct pell_json *ground)
{
    const struct pell_json at = pell_json_get(root, "background");
    const struct pell_load_params *params = r->loader->params;
    struct pell_scene *scene = r->scene;
    struct pell_text where;
    const bool environment = pell_scene_has_environment(scene);
    const char *text;
    enum pell_result res;

    if (environment)
        scene->background = PELL_BACKGROUND_ENVIRONMENT;
    if (!at.value)
        return PELL_OK;
    if (json_is_string(at.value)) {
        PELL_TRY(pell_json_to_string(&at, &text));
        PELL_TRY(
            pell_background_read(r->ctx, PELL_ERR_FORMAT, pell_json_where(&at, &where), text, &scene->background, scene->background_color));
        /* The parameters may add an environment, or replace the background. */
        if (scene->background == PELL_BACKGROUND_ENVIRONMENT && !environment && !params->environment && !params->background)
            return pell_json_error(&at, PELL_ERR_FORMAT, "add { \"type\": \"environment\", ... } to the lights, or give --environment FILE",
                                   "is the environment, but no light is one");
        return PELL_OK;
    }
    if (!json_is_object(at.value))
        return pell_json_wrong_type(&at, "a name, a colour (#rrggbb), or an object");
    PELL_TRY(ONLY(&at, background_keys));
    if (pell_json_has(&at, "color") && pell_json_has(&at, "image"))
        return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "has both color and image; one is allowed");
    if (pell_json_has(&at, "color"))
        scene->background = PELL_BACKGROUND_COLOR;
    PELL_TRY(pell_scene_rgb(&at, "color", 1e6, scene->background_color));
    PELL_TRY(pell_scene_need_picture_at(r, &at, "image", &scene->background_image));
    if (scene->background_image)
        scene->background = PELL_BACKGROUND_IMAGE;
    if (pell_json_has(&at, "ground")) {
        if (ground->value)
            return pell_json_error(&at, PELL_ERR_FORMAT, NULL, "ground stands here and beside background; one is allowed");
        r->background = at; /* `ground` keeps a pointer to it */
        *ground = pell_json_get(&r->background, "ground");
    }
    return PELL_OK;

fail:
    return res;
}

/* true, a material's name, or an inline material. */
static enum pell_result read_ground(struct pell_scene_reader *r, const struct pell_json *at, struct pell_extras *extras)
{
    struct pell_material_entry entry = { 0 };
    const char *name = "ground";
    size_t index;
    enum pell_result res;

    if (!at->value || json_is_false(at->value))
        return PELL_OK;
    extras->ground = true;
    if (json_is_true(at->value))
        return PELL_OK;
    if (json_is_object(at->value)) {
        PELL_TRY(pell_scene_add_material(r->scene, name, &index));
        PELL_TRY(pell_material_apply(r->scene, index, r->scene->path, "marble"));
        PELL_TRY(pell_scene_overlay(r, at, index));
        extras->ground_material = (int) index;
        return PELL_OK;
    }
    if (!json_is_string(at->value))
        return pell_json_error(at, PELL_ERR_FORMAT, NULL, "must be true, a material's name, or a material");
    PELL_TRY(pell_json_to_string(at, &name));
    for (size_t i = 0; i < r->scene->num_materials; i++)
        if (strcmp(r->scene->materials[i].name, name) == 0) {
            extras->ground_material = (int) i;
            return PELL_OK;
        }
    PELL_TRY(pell_scene_material_entry(r, at, name, &entry));
    PELL_TRY(pell_scene_add_material(r->scene, "ground", &index));
    PELL_TRY(pell_material_set(r->ctx, &r->scene->materials[index], &entry));
    extras->ground_material = (int) index;

fail:
    pell_free(r->ctx, (char *) entry.name);
    return res;
}

/* --- Render options ----------------------------------------------------------------------------------------------------------- */

static bool number_text(const json_t *value, char *text, size_t size)
{
    if (json_is_integer(value))
        snprintf(text, size, "%" JSON_INTEGER_FORMAT, json_integer_value(value));
    else if (json_is_real(value))
        pell_format_number(json_real_value(value), false, text, size);
    else
        return false;
    return true;
}

static enum pell_result add_option(struct pell_scene_reader *r, const struct pell_json *at, const char *prefix, const char *key)
{
    struct pell_text name = { 0 }, value = { 0 }, where;
    const char *text = value.str;
    char number[64];

    pell_text_add(&name, "%s%s", prefix, key);
    if (json_is_string(at->value)) {
        text = json_string_value(at->value);
    } else if (json_is_boolean(at->value)) {
        text = json_is_true(at->value) ? "true" : "false";
    } else if (number_text(at->value, number, sizeof(number))) {
        text = number;
    } else if (json_is_array(at->value) && json_array_size(at->value) == 3) {
        for (size_t i = 0; i < 3; i++) {
            const struct pell_json element = pell_json_at(at, i);
            if (!number_text(element.value, number, sizeof(number)))
                return pell_json_error(&element, PELL_ERR_FORMAT, NULL, "must be a number");
            pell_text_add(&value, "%s%s", i ? "," : "", number);
        }
    } else {
        return pell_json_error(at, PELL_ERR_FORMAT, json_is_object(at->value) ? "knobs of the method go into \"knobs\"" : NULL,
                               "must be a number, a text, true, false, or three numbers");
    }
    return pell_scene_add_option(r->scene, name.str, text, pell_json_where(at, &where));
}

static enum pell_result read_render(struct pell_scene_reader *r, const struct pell_json *root, struct pell_extras *extras)
{
    struct pell_json render, knobs;
    double width = 1280.0, height = 720.0;
    const char *key;
    json_t *value;
    enum pell_result res;

    PELL_TRY(pell_json_object(root, "render", &render));
    if (!render.value)
        return PELL_OK;
    json_object_foreach((json_t *) render.value, key, value)
    {
        const struct pell_json at = pell_json_get(&render, key);
        if (strcmp(key, "knobs") != 0)
            PELL_TRY(add_option(r, &at, "", key));
    }
    PELL_TRY(pell_json_object(&render, "knobs", &knobs));
    json_object_foreach((json_t *) knobs.value, key, value)
    {
        const struct pell_json at = pell_json_get(&knobs, key);
        PELL_TRY(add_option(r, &at, "knobs/", key));
    }
    PELL_TRY(pell_json_number(&render, "width", 1.0, PELL_PICTURE_MOST, &width));
    PELL_TRY(pell_json_number(&render, "height", 1.0, PELL_PICTURE_MOST, &height));
    extras->aspect = (float) (width / height);
    return PELL_OK;

fail:
    return res;
}

/* --- Time --------------------------------------------------------------------------------------------------------------------- */

/* "time" and "animation": a name, or a number from 0. */
static enum pell_result read_moment(struct pell_scene_reader *r, const struct pell_json *root)
{
    const struct pell_json at = pell_json_get(root, "animation");
    struct pell_moment *m = &r->moment;
    int64_t number;
    enum pell_result res;

    m->timed = pell_json_has(root, "time") || at.value;
    PELL_TRY(pell_json_number(root, "time", -1e9, 1e9, &m->time));
    if (json_is_number(at.value)) {
        PELL_TRY(pell_json_to_int(&at, 0, pell_context_limits(r->ctx)->items, &number));
        snprintf(r->animation, sizeof(r->animation), "%lld", (long long) number);
        m->animation = r->animation;
    } else if (at.value) {
        PELL_TRY(pell_json_to_string(&at, &m->animation));
    }
    m->where = pell_json_where(&at, &r->moment_where);
    m->code = PELL_ERR_FORMAT;
    pell_load_moment(r->loader->params, m);
    return pell_json_number(root, "image_rate", 1e-6, 1e6, &r->image_rate);

fail:
    return res;
}

static enum pell_result check_moment(const struct pell_scene_reader *r, const struct pell_json *root)
{
    const struct pell_json animation = pell_json_get(root, "animation");

    if (r->scene->animated || !animation.value)
        return PELL_OK;
    return pell_json_error(&animation, PELL_ERR_FORMAT, NULL, "no mesh file has an animation");
}

/* Checks times once everything is read. */
static void check_time(const struct pell_scene_reader *r, const struct pell_json *root)
{
    const struct pell_json time = pell_json_get(root, "time"), rate = pell_json_get(root, "image_rate");

    if (time.value && !r->scene->animated)
        pell_json_warn(&time, NULL, "changes nothing: no mesh file has an animation, and no image is one of a sequence");
    if (rate.value && !r->sequences)
        pell_json_warn(&rate, NULL, "changes nothing: no image is one of a sequence (\"veins_%%04d.png\")");
}

/* --- All ---------------------------------------------------------------------------------------------------------------------- */

static bool is_among(const char *key, const struct pell_scene_keys *keys)
{
    for (size_t i = 0; i < keys->count; i++)
        if (strcmp(keys->keys[i], key) == 0)
            return true;
    return false;
}

/* Refuses keys at the top that belong into one of its objects. */
static enum pell_result refuse_misplaced(const struct pell_json *root)
{
    for (const struct pell_scene_keys *of = &pell_scene_keys[1]; of->object; of++)
        for (size_t i = 0; i < of->count; i++)
            if (pell_json_has(root, of->keys[i]) && !is_among(of->keys[i], &pell_scene_keys[0])) {
                const struct pell_json at = pell_json_get(root, of->keys[i]);
                struct pell_text hint = { .length = 0 };
                pell_text_add(&hint, "it is a key of \"%.*s\"", (int) strcspn(of->object, "_"), of->object);
                return pell_json_error(&at, PELL_ERR_FORMAT, hint.str, "unknown key");
            }
    return PELL_OK;
}

static enum pell_result read_root(struct pell_scene_reader *r, const struct pell_json *root, struct pell_extras *extras)
{
    struct pell_json ground = pell_json_get(root, "ground");
    const char *schema;
    int64_t version;
    enum pell_result res;

    PELL_TRY(pell_json_require(root, "pellucid"));
    PELL_TRY(pell_json_int(root, "pellucid", 1, 1, &version));
    PELL_TRY(refuse_misplaced(root));
    PELL_TRY(ONLY(root, root_keys));
    PELL_TRY(pell_json_string(root, "$schema", &schema));
    PELL_TRY(read_moment(r, root));
    PELL_TRY(pell_scene_meshes(r, root));
    PELL_TRY(check_moment(r, root));
    PELL_TRY(read_camera(r, root, extras));
    PELL_TRY(pell_scene_lights(r, root, extras));
    PELL_TRY(pell_scene_overlay_all(r, root));
    PELL_TRY(read_background(r, root, &ground));
    PELL_TRY(read_ground(r, &ground, extras));
    extras->own_background = pell_json_has(root, "background");
    if (!ground.value && !extras->own_background)
        extras->backdrop = extras->studio && pell_studio_has_backdrop(extras->view.studio);
    PELL_TRY(read_render(r, root, extras));
    check_time(r, root);
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_read_scene_file(const struct pell_loader *loader, const char *path, const uint8_t *data, size_t size,
                                      struct pell_scene **out, struct pell_extras *extras)
{
    struct pell_scene_reader r = { .ctx = loader->ctx,
                                   .loader = loader,
                                   .file = { .ctx = loader->ctx, .path = path, .range_error = PELL_ERR_FORMAT },
                                   .objects = { .ctx = loader->ctx, .where = path },
                                   .unit = 1.0,
                                   .image_rate = 24.0 };
    struct pell_json root;
    enum pell_result res;

    *out = NULL;
    r.import =
        (struct pell_import) { .ctx = loader->ctx, .path = path, .root = loader->root, .allow_outside = loader->params->allow_outside };
    r.granted = loader->granted;
    PELL_TRY(pell_json_parse(&r.file, data, size));
    root = pell_json_root(&r.file);
    PELL_TRY(pell_json_is_object(&root));
    PELL_TRY(pell_scene_create(loader->ctx, &r.scene));
    pell_free(loader->ctx, r.scene->path);
    r.scene->path = pell_strdup(loader->ctx, path);
    if (!r.scene->path) {
        res = PELL_ERR_NOMEM;
        goto fail;
    }
    PELL_TRY(read_root(&r, &root, extras));
    *out = r.scene;
    r.scene = NULL;

fail:
    pell_scene_destroy(&r.scene);
    pell_names_finish(&r.objects);
    pell_free(r.ctx, r.first_of_object);
    pell_json_finish(&r.file);
    return res;
}

/* --- Camera and lights of a complete scene ------------------------------------------------------------------------------------- */

/* Removes image keys: a light keeps its image. */
static void drop_pictures(json_t *lights)
{
    json_t *light;
    size_t i;

    json_array_foreach(lights, i, light)
    {
        if (json_object_get(light, "image") && !json_object_get(light, "color"))
            json_object_set_new(light, "color", json_pack("[i,i,i]", 1, 1, 1));
        if (json_object_get(light, "project") && !json_object_get(light, "to"))
            json_object_set_new(light, "to", json_pack("[i,i,i]", 0, 0, 0)); /* the default target */
        json_object_del(light, "image");
        json_object_del(light, "project");
    }
}

static enum pell_result reread_lights(struct pell_scene_reader *r, const struct pell_json *root)
{
    struct pell_scene *scene = r->scene;
    const size_t count = scene->num_lights;
    struct pell_extras extras = { 0 };
    struct pell_light *old;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!pell_json_has(root, "lights"))
        return PELL_OK;
    if (!(old = pell_alloc_array(r->ctx, count + 1, sizeof(*old))))
        return res;
    for (size_t i = 0; i < count; i++)
        old[i] = scene->lights[i];
    drop_pictures(json_object_get(r->file.root, "lights"));
    PELL_TRY(pell_scene_lights(r, root, &extras));
    res = scene->num_lights == count && !extras.studio
              ? PELL_OK
              : pell_error(r->ctx, PELL_ERR_FORMAT, r->file.path, NULL, "lists %s, must list %zu",
                           pell_counted((long long) scene->num_lights, "light", "lights").str, count);
    for (size_t i = 0; res == PELL_OK && i < count; i++) {
        if (scene->lights[i].type != old[i].type)
            res = pell_error(r->ctx, PELL_ERR_FORMAT, r->file.path, NULL, "light %zu has another type", i);
        scene->lights[i].image = old[i].image;
    }

fail:
    pell_free(r->ctx, old);
    return res;
}

enum pell_result pell_scene_read_view(struct pell_scene *scene, const char *path, const void *data, size_t size)
{
    struct pell_scene_reader r = { .ctx = scene->ctx,
                                   .scene = scene,
                                   .file = { .ctx = scene->ctx, .path = path, .range_error = PELL_ERR_FORMAT },
                                   .unit = scene->mm_per_unit };
    const size_t cameras = scene->num_cameras;
    struct pell_extras extras = { .ground_material = -1 };
    struct pell_json root;
    enum pell_result res;

    PELL_TRY(pell_json_parse(&r.file, data, size));
    root = pell_json_root(&r.file);
    PELL_TRY(pell_json_is_object(&root));
    PELL_TRY(read_camera(&r, &root, &extras));
    if (extras.view.has_from)
        PELL_TRY(pell_scene_frame_from(scene, &extras.view, 0.0f));
    if (scene->num_cameras > cameras) /* it replaced the first camera, which moved to the end */
        pell_free(r.ctx, scene->cameras[--scene->num_cameras].name);
    PELL_TRY(reread_lights(&r, &root));
    PELL_TRY(pell_scene_check_view(scene));

fail:
    pell_json_finish(&r.file);
    return res;
}
