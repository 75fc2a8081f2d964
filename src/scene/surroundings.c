/* SPDX-License-Identifier: MIT
 * surroundings.c - the environment and the background of the load parameters, which override those of the file. */
#include "base/base.h"
#include "image/color.h"
#include "scene/scene.h"

#include <string.h>

#define MOST_TURN_DEG 36000.0
#define MOST_SCALE 1e12

static const struct named_background {
    const char *name;
    enum pell_background kind;
    uint8_t srgb; /* value of all channels */
} backgrounds[] = {
    { "environment", PELL_BACKGROUND_ENVIRONMENT, 0 },
    { "transparent", PELL_BACKGROUND_TRANSPARENT, 0 },
    { "white", PELL_BACKGROUND_COLOR, 255 },
    { "grey", PELL_BACKGROUND_COLOR, 128 },
    { "black", PELL_BACKGROUND_COLOR, 0 },
};

const char *pell_background_name(size_t i)
{
    return i < PELL_COUNT(backgrounds) ? backgrounds[i].name : NULL;
}

static int hex_digit(char c)
{
    return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

/* "#f4f1ec": three sRGB bytes. */
static bool read_hex(const char *text, float *rgb)
{
    if (text[0] != '#' || strlen(text) != 7)
        return false;
    for (int c = 0; c < 3; c++) {
        const int high = hex_digit(text[1 + 2 * c]), low = hex_digit(text[2 + 2 * c]);
        if (high < 0 || low < 0)
            return false;
        rgb[c] = pell_srgb_u8[16 * high + low];
    }
    return true;
}

enum pell_result pell_background_read(struct pell_context *ctx, enum pell_result code, const char *where, const char *text,
                                      enum pell_background *kind, float *color)
{
    const char *names[PELL_COUNT(backgrounds)];
    struct pell_text hint = { .length = 0 };
    char shown[96];

    *kind = PELL_BACKGROUND_COLOR;
    if (read_hex(text, color))
        return PELL_OK;
    for (size_t i = 0; i < PELL_COUNT(backgrounds); i++) {
        names[i] = backgrounds[i].name;
        if (strcmp(text, backgrounds[i].name) != 0)
            continue;
        *kind = backgrounds[i].kind;
        for (int c = 0; c < 3; c++)
            color[c] = pell_srgb_u8[backgrounds[i].srgb];
        return PELL_OK;
    }
    pell_printable(text, shown, sizeof(shown));
    if (text[0] == '#')
        return pell_error(ctx, code, where, "#RRGGBB, in hexadecimal digits: #f4f1ec", "\"%s\" is no colour", shown);
    pell_text_suggest_or_list(&hint, "allowed: #RRGGBB, ", text, names, PELL_COUNT(names));
    return pell_error(ctx, code, where, hint.str, "there is no \"%s\", must be a name or a colour like #f4f1ec", shown);
}

enum pell_result pell_surroundings_read(struct pell_context *ctx, const struct pell_load_params *params, struct pell_surroundings *s)
{
    *s = (struct pell_surroundings) { .environment = params->environment };
    if (params->environment && params->studio)
        return pell_error(ctx, PELL_ERR_INVALID, "--environment", "give one of them", "--environment and --studio both replace the lights");
    if (!params->environment && (params->environment_scale != 0.0 || params->environment_rotate_deg != 0.0))
        return pell_error(ctx, PELL_ERR_INVALID, params->environment_scale != 0.0 ? "--environment-scale" : "--environment-rotate", NULL,
                          "goes with --environment");
    if (!(params->environment_scale >= 0.0 && params->environment_scale <= MOST_SCALE))
        return pell_error(ctx, PELL_ERR_INVALID, "--environment-scale", NULL, "is %g, must be above 0 and at most %g",
                          params->environment_scale, MOST_SCALE);
    if (!(fabs(params->environment_rotate_deg) <= MOST_TURN_DEG))
        return pell_error(ctx, PELL_ERR_INVALID, "--environment-rotate", NULL, "is %g, must be in [-%g, %g] degrees",
                          params->environment_rotate_deg, MOST_TURN_DEG, MOST_TURN_DEG);
    s->scale = params->environment_scale > 0.0 ? (float) params->environment_scale : 1.0f;
    s->rotate = (float) (params->environment_rotate_deg * PELL_PI / 180.0);
    s->background = params->background != NULL;
    return s->background ? pell_background_read(ctx, PELL_ERR_INVALID, "--background", params->background, &s->kind, s->color) : PELL_OK;
}

bool pell_scene_has_environment(const struct pell_scene *scene)
{
    for (size_t i = 0; i < scene->num_lights; i++)
        if (scene->lights[i].type == PELL_LIGHT_ENVIRONMENT)
            return true;
    return false;
}

void pell_scene_drop_lights(struct pell_scene *scene)
{
    while (scene->num_lights)
        pell_free(scene->ctx, scene->lights[--scene->num_lights].name);
    if (scene->background == PELL_BACKGROUND_ENVIRONMENT)
        scene->background = PELL_BACKGROUND_COLOR;
}

static enum pell_result add_environment(struct pell_scene *scene, const struct pell_surroundings *s)
{
    struct pell_image image = { 0 };
    struct pell_texture *texture;
    struct pell_light *l;
    size_t index;
    enum pell_result res;

    PELL_TRY(pell_image_read(scene->ctx, s->environment, PELL_ROLE_COLOR, &image));
    PELL_TRY(pell_scene_add_texture(scene, s->environment, &texture));
    texture->image = image;
    image = (struct pell_image) { 0 };
    texture->wrap_u = texture->wrap_v = PELL_WRAP_REPEAT;
    texture->sampled = true;
    pell_scene_drop_lights(scene);
    PELL_TRY(pell_scene_add_light(scene, "environment", &index));
    l = &scene->lights[index];
    l->type = PELL_LIGHT_ENVIRONMENT;
    l->power[0] = l->power[1] = l->power[2] = s->scale;
    l->rotate = s->rotate;
    l->image = texture;
    scene->background = PELL_BACKGROUND_ENVIRONMENT;
    return PELL_OK;

fail:
    pell_image_finish(scene->ctx, &image);
    return res;
}

enum pell_result pell_scene_surround(struct pell_scene *scene, const struct pell_surroundings *s)
{
    enum pell_result res;

    if (s->environment)
        PELL_TRY(add_environment(scene, s));
    if (!s->background)
        return PELL_OK;
    if (s->kind == PELL_BACKGROUND_ENVIRONMENT && !pell_scene_has_environment(scene))
        return pell_error(scene->ctx, PELL_ERR_INVALID, "--background", "--environment FILE gives one",
                          "is the environment, but no light is one");
    scene->background = s->kind;
    memcpy(scene->background_color, s->color, sizeof(s->color));
    return PELL_OK;

fail:
    return res;
}
