/* SPDX-License-Identifier: MIT
 * lights.c - the lights of a scene file. */
#include "scene/file/scene_file.h"

#include <string.h>

#define KEYS(name, ...) static const char *const name[] = { __VA_ARGS__ }
KEYS(point_keys, "type", "name", "at", "intensity", "project", "to", "up", "project_fov_deg");
KEYS(spot_keys, "type", "name", "at", "to", "up", "intensity", "cone_deg", "inner_deg", "project", "project_fov_deg");
KEYS(directional_keys, "type", "name", "direction", "irradiance", "project", "at", "up", "width", "height");
KEYS(rect_keys, "type", "name", "at", "to", "up", "width", "height", "radiance", "project");
KEYS(disc_keys, "type", "name", "at", "to", "up", "radius", "radiance", "project");
KEYS(environment_keys, "type", "name", "image", "color", "scale", "rotate_deg");
KEYS(studio_keys, "studio");

#define ROW(object, keys)                                                                                                                  \
    {                                                                                                                                      \
        object, keys, PELL_COUNT(keys)                                                                                                     \
    }
const struct pell_scene_keys pell_light_keys[PELL_LIGHT_KINDS] = {
    ROW("light_point", point_keys),   ROW("light_spot", spot_keys), ROW("light_directional", directional_keys),
    ROW("light_rect", rect_keys),     ROW("light_disc", disc_keys), ROW("light_environment", environment_keys),
    ROW("light_studio", studio_keys),
};

static const char *const light_names[] = { "point", "spot", "directional", "rect", "disc", "environment" };
static const char *const power_keys[] = { "intensity", "intensity", "irradiance", "radiance", "radiance" };

static enum pell_result read_environment(struct pell_scene_reader *r, const struct pell_json *at, struct pell_light *l)
{
    double scale = 1.0, rotate = 0.0;
    enum pell_result res;

    if (!pell_json_has(at, "image") && !pell_json_has(at, "color"))
        return pell_json_error(at, PELL_ERR_FORMAT, NULL, "has neither image nor color");
    l->power[0] = l->power[1] = l->power[2] = 1.0f;
    PELL_TRY(pell_scene_rgb(at, "color", 1e12, l->power));
    PELL_TRY(pell_json_number(at, "scale", 0.0, 1e12, &scale));
    PELL_TRY(pell_json_number(at, "rotate_deg", -36000.0, 36000.0, &rotate));
    PELL_TRY(pell_scene_need_picture_at(r, at, "image", &l->image));
    for (int c = 0; c < 3; c++)
        l->power[c] *= (float) scale;
    l->rotate = (float) (rotate * RADIANS);
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_cone(const struct pell_json *at, struct pell_light *l)
{
    double cone = 45.0, inner = -1.0;
    enum pell_result res;

    PELL_TRY(pell_json_number(at, "cone_deg", 0.1, 360.0, &cone));
    PELL_TRY(pell_json_number(at, "inner_deg", 0.0, cone, &inner));
    if (inner < 0.0)
        inner = 0.8 * cone;
    l->cos_outer = (float) cos(0.5 * cone * RADIANS);
    l->cos_inner = (float) cos(0.5 * inner * RADIANS);
    return PELL_OK;

fail:
    return res;
}

/* Reads any light but an environment. */
static enum pell_result read_source(struct pell_scene_reader *r, const struct pell_json *at, struct pell_light *l)
{
    const bool area = l->type == PELL_LIGHT_RECT || l->type == PELL_LIGHT_DISC;
    const char *power = power_keys[l->type];
    double from[3] = { 0 }, to[3] = { 0 }, fov = 0.0;
    enum pell_result res;

    PELL_TRY(pell_json_require(at, power));
    PELL_TRY(pell_scene_rgb(at, power, 1e15, l->power));
    if (l->type == PELL_LIGHT_DIRECTIONAL) {
        PELL_TRY(pell_json_require(at, "direction"));
        PELL_TRY(pell_scene_direction(at, "direction", l->direction));
    } else {
        PELL_TRY(pell_json_require(at, "at"));
    }
    PELL_TRY(pell_scene_position(at, "at", r->unit, from));
    PELL_TRY(pell_scene_position(at, "to", r->unit, to));
    if (l->type == PELL_LIGHT_SPOT || area)
        PELL_TRY(pell_scene_aim(at, "to", from, to, l->direction));
    else if (l->type == PELL_LIGHT_POINT && (pell_json_has(at, "to") || pell_json_has(at, "project")))
        PELL_TRY(pell_scene_aim(at, "to", from, to, l->direction));
    PELL_TRY(pell_scene_direction(at, "up", l->up));
    for (int c = 0; c < 3; c++)
        l->position[c] = (float) from[c];
    if (l->type == PELL_LIGHT_SPOT)
        PELL_TRY(read_cone(at, l));
    if (l->type == PELL_LIGHT_RECT) {
        PELL_TRY(pell_json_require(at, "width"));
        PELL_TRY(pell_json_require(at, "height"));
    }
    if (l->type == PELL_LIGHT_DISC)
        PELL_TRY(pell_json_require(at, "radius"));
    PELL_TRY(pell_scene_length(at, "width", r->unit, &l->width));
    PELL_TRY(pell_scene_length(at, "height", r->unit, &l->height));
    PELL_TRY(pell_scene_length(at, "radius", r->unit, &l->radius));
    PELL_TRY(pell_json_number(at, "project_fov_deg", 0.1, 179.0, &fov));
    l->image_fov = (float) (fov * RADIANS);
    PELL_TRY(pell_scene_need_picture_at(r, at, "project", &l->image));
    return PELL_OK;

fail:
    return res;
}

/* true: the soft lights; or a studio's name, overridden by the caller's. */
static enum pell_result read_studio(struct pell_scene_reader *r, const struct pell_json *at, struct pell_extras *extras)
{
    const struct pell_json value = pell_json_get(at, "studio");
    struct pell_text where;
    bool studio = true;
    const char *name;
    int index;
    enum pell_result res;

    PELL_TRY(pell_json_only(at, studio_keys, PELL_COUNT(studio_keys)));
    if (json_is_string(value.value)) {
        PELL_TRY(pell_json_to_string(&value, &name));
        PELL_TRY(pell_studio_read(r->ctx, PELL_ERR_FORMAT, pell_json_where(&value, &where), name, &index));
        if (!extras->view.has_studio)
            extras->view.studio = index;
    } else {
        PELL_TRY(pell_json_bool(at, "studio", &studio));
    }
    extras->studio |= studio;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result read_light(struct pell_scene_reader *r, const struct pell_json *at, struct pell_extras *extras)
{
    struct pell_light light = { .up = { 0, 1, 0 }, .direction = { 0, 0, -1 } };
    const char *name = "";
    int type = 0;
    size_t index;
    enum pell_result res;

    PELL_TRY(pell_json_is_object(at));
    if (pell_json_has(at, "studio"))
        return read_studio(r, at, extras);
    PELL_TRY(pell_json_require(at, "type"));
    PELL_TRY(pell_json_choice(at, "type", light_names, PELL_COUNT(light_names), &type));
    PELL_TRY(pell_json_only(at, pell_light_keys[type].keys, pell_light_keys[type].count));
    light.type = (enum pell_light_type) type;
    PELL_TRY(pell_json_string(at, "name", &name));
    if (light.type == PELL_LIGHT_ENVIRONMENT)
        PELL_TRY(read_environment(r, at, &light));
    else
        PELL_TRY(read_source(r, at, &light));
    PELL_TRY(pell_scene_add_light(r->scene, *name ? name : light_names[type], &index));
    light.name = r->scene->lights[index].name;
    r->scene->lights[index] = light;
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_scene_lights(struct pell_scene_reader *r, const struct pell_json *root, struct pell_extras *extras)
{
    struct pell_json lights;
    enum pell_result res;

    PELL_TRY(pell_json_array(root, "lights", 0, (size_t) pell_context_limits(r->ctx)->items, &lights));
    if (!lights.value)
        return PELL_OK;
    if (r->scene->num_lights)
        pell_info(r->ctx, r->scene->path, "lists its own lights: %s not used",
                  pell_counted((long long) r->scene->num_lights, "light of the mesh files is", "lights of the mesh files are").str);
    while (r->scene->num_lights)
        pell_free(r->ctx, r->scene->lights[--r->scene->num_lights].name);
    extras->own_lights = true;
    for (size_t i = 0; i < pell_json_count(&lights); i++) {
        const struct pell_json at = pell_json_at(&lights, i);
        PELL_TRY(read_light(r, &at, extras));
    }
    return PELL_OK;

fail:
    return res;
}
