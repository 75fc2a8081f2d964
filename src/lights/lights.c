/* SPDX-License-Identifier: MIT
 *
 * lights.c - the lights of a scene made ready: samples, cones, projected images, environments. Units and names follow
 * KHR_lights_punctual where that has the light.
 *
 * A projected image is a slide: the light's colour times the picture looked up where the ray leaves the projector; outside of it is
 * dark. Directional lights throw it in parallel over width x height mm round the position (0: round the whole scene). Rectangles and
 * discs shine with the picture on their face, upright and unmirrored to who looks at it.
 */
#include "lights/lights.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

static enum pell_result add_lamp(struct pell_lights *lights, const struct pell_lamp *lamp)
{
    void *array = lights->lamps;
    const enum pell_result res = pell_grow(lights->ctx, &array, lights->num_lamps, &lights->capacity, sizeof(*lights->lamps));

    lights->lamps = array;
    if (res == PELL_OK)
        lights->lamps[lights->num_lamps++] = *lamp;
    return res;
}

/* Picture coordinates of a slide: u = 1/2 + x image_u, v = 1/2 - y image_v, with x, y in the plane at distance 1. */
static void aim_slide(struct pell_lamp *lamp, const struct pell_light *light, const struct pell_scene *scene)
{
    const struct pell_image *image = &light->image->image;
    const float aspect = (float) image->width / (float) image->height;
    float fov = light->image_fov, tangent, w = light->width, h = light->height;

    lamp->image = light->image;
    if (light->type == PELL_LIGHT_DIRECTIONAL) {
        if (!(w > 0.0f) || !(h > 0.0f)) {
            const struct pell_vec3 lo = vec3_load(scene->bounds_min), hi = vec3_load(scene->bounds_max);
            const float size = vec3_length(vec3_sub(hi, lo));
            lamp->position = vec3_mul(vec3_add(lo, hi), 0.5f);
            h = size > 0.0f && isfinite(size) ? size : 1.0f;
            h = aspect < 1.0f ? h / aspect : h;
            w = h * aspect;
        }
        lamp->image_u = 1.0f / w;
        lamp->image_v = 1.0f / h;
        return;
    }
    if (!(fov > 0.0f))
        fov = light->type == PELL_LIGHT_SPOT ? 2.0f * acosf(fminf(fmaxf(light->cos_outer, -1.0f), 1.0f)) : 0.5f * PELL_PI_F;
    fov = fminf(fmaxf(fov, 1e-3f), 3.1f);
    tangent = tanf(0.5f * fov);
    lamp->image_v = 0.5f / tangent;
    lamp->image_u = lamp->image_v / aspect;
}

void pell_lamp_slide(const struct pell_lamp *lamp, struct pell_vec3 from, struct pell_vec3 direction, struct pell_vec3 place, float rgb[3])
{
    float rgba[4] = { 0 }, x, y, u, v;

    if (lamp->type == PELL_LIGHT_RECT || lamp->type == PELL_LIGHT_DISC) {
        const struct pell_vec3 d = vec3_sub(from, lamp->position);
        x = -0.5f * vec3_dot(d, lamp->right) / vec3_dot(lamp->right, lamp->right); /* unmirrored from the front */
        y = 0.5f * vec3_dot(d, lamp->up) / vec3_dot(lamp->up, lamp->up);
    } else if (lamp->type == PELL_LIGHT_DIRECTIONAL) {
        const struct pell_vec3 d = vec3_sub(place, lamp->position);
        x = vec3_dot(d, lamp->right) * lamp->image_u;
        y = vec3_dot(d, lamp->up) * lamp->image_v;
    } else {
        const float depth = vec3_dot(direction, lamp->direction), inv = depth > 1e-6f ? 1.0f / depth : 1e12f;
        x = vec3_dot(direction, lamp->right) * inv * lamp->image_u;
        y = vec3_dot(direction, lamp->up) * inv * lamp->image_v;
    }
    u = 0.5f + x;
    v = 0.5f - y;
    if (u >= 0.0f && u <= 1.0f && v >= 0.0f && v <= 1.0f)
        pell_image_sample(&lamp->image->image, PELL_WRAP_CLAMP, PELL_WRAP_CLAMP, lamp->image->nearest, u, v, rgba);
    for (int c = 0; c < 3; c++)
        rgb[c] = rgba[c] > 0.0f ? fminf(rgba[c], 1e10f) : 0.0f;
}

bool pell_lamp_make(const struct pell_scene *scene, const struct pell_light *light, int samples, struct pell_lamp *out)
{
    const bool rect = light->type == PELL_LIGHT_RECT, disc = light->type == PELL_LIGHT_DISC;
    struct pell_lamp lamp = {
        .type = light->type,
        .position = vec3_load(light->position),
        .direction = vec3_normalize(vec3_load(light->direction)),
        .up = vec3_normalize(vec3_load(light->up)),
        .scale = rect || disc ? 1.0f : 1e6f, /* W/sr over m^2 */
        .inv_range = light->range > 0.0f && !rect && !disc ? 1.0f / light->range : 0.0f,
        .samples = 1,
        .environment = -1,
    };

    if (!(vec3_length(lamp.direction) > 0.0f))
        lamp.direction = vec3(0.0f, 0.0f, -1.0f);
    lamp.right = vec3_cross(lamp.direction, lamp.up);
    if (!(vec3_length(lamp.right) > 1e-4f))
        vec3_basis(lamp.direction, &lamp.right, &lamp.up);
    lamp.right = vec3_normalize(lamp.right);
    lamp.up = vec3_cross(lamp.right, lamp.direction);
    memcpy(lamp.power, light->power, sizeof(lamp.power));

    if (light->type == PELL_LIGHT_SPOT) {
        const float width = light->cos_inner - light->cos_outer;
        lamp.spot_scale = 1.0f / (width > 1e-3f ? width : 1e-3f);
        lamp.spot_offset = -light->cos_outer * lamp.spot_scale;
    }
    if (light->image && light->image->image.pixels)
        aim_slide(&lamp, light, scene);
    if (rect || disc) {
        const float hw = rect ? 0.5f * light->width : light->radius, hh = rect ? 0.5f * light->height : light->radius;
        lamp.samples = samples;
        lamp.sample_area = (rect ? 4.0f : PELL_PI_F) * hw * hh / (float) lamp.samples;
        for (int c = 0; c < 3; c++)
            lamp.power[c] *= lamp.sample_area;
        lamp.right = vec3_mul(lamp.right, hw);
        lamp.up = vec3_mul(lamp.up, hh);
    }
    for (int c = 0; c < 3; c++)
        lamp.power[c] = lamp.power[c] > 0.0f ? fminf(lamp.power[c], 1e18f) : 0.0f;
    *out = lamp;
    return lamp.power[0] + lamp.power[1] + lamp.power[2] > 0.0f;
}

_Static_assert((int) PELL_LIGHT_POINT == PELL_LIGHT_DATA_POINT && (int) PELL_LIGHT_SPOT == PELL_LIGHT_DATA_SPOT &&
                   (int) PELL_LIGHT_DIRECTIONAL == PELL_LIGHT_DATA_DIRECTIONAL && (int) PELL_LIGHT_RECT == PELL_LIGHT_DATA_RECT &&
                   (int) PELL_LIGHT_DISC == PELL_LIGHT_DATA_DISC,
               "shared/light_data.h numbers the kinds alike");
#define AT(member, bytes) (offsetof(struct pell_light_data, member) == (bytes))
_Static_assert(sizeof(struct pell_light_data) == 112 && AT(direction, 16) && AT(right, 32) && AT(up, 48) && AT(power, 64) &&
                   AT(spot_scale, 80) && AT(spot_offset, 84) && AT(type, 88) && AT(samples, 92) && AT(environment, 96) && AT(light, 100) &&
                   AT(image, 104) && AT(flags, 108),
               "as std430 lays it out");

static struct pell_vec4 vec4(struct pell_vec3 v, float w)
{
    return (struct pell_vec4) { v.x, v.y, v.z, w };
}

struct pell_light_data pell_light_data_of(const struct pell_scene *scene, const struct pell_lamp *lamp)
{
    struct pell_light_data data = {
        .position = vec4(lamp->position, lamp->scale),
        .direction = vec4(lamp->direction, lamp->inv_range),
        .right = vec4(lamp->right, lamp->image_u),
        .up = vec4(lamp->up, lamp->image_v),
        .power = { lamp->power[0], lamp->power[1], lamp->power[2], lamp->sample_area },
        .spot_scale = lamp->spot_scale,
        .spot_offset = lamp->spot_offset,
        .type = (int32_t) lamp->type,
        .samples = lamp->samples,
        .environment = lamp->environment,
        .light = lamp->light,
        .image = -1,
        .flags = lamp->compact ? PELL_LIGHT_DATA_COMPACT : 0u,
    };

    for (size_t i = 0; lamp->image && i < scene->num_textures; i++)
        if (scene->textures[i] == lamp->image)
            data.image = (int32_t) i;
    return data;
}

static int compare_parts(const void *a, const void *b)
{
    const struct pell_lights_part *p = a, *q = b;
    if (p->object != q->object)
        return p->object < q->object ? -1 : 1;
    return (p->material > q->material) - (p->material < q->material);
}

bool pell_lights_part(const struct pell_lights *lights, int object, int material)
{
    const struct pell_lights_part key = { object, material };
    return lights->num_parts > 0 && bsearch(&key, lights->parts, lights->num_parts, sizeof(key), compare_parts) != NULL;
}

#define FANS_MOST 4   /* lamps that get a fan: each holds a copy of the triangles */
#define FANS_TRIED 16 /* lamps of which it is tried: that one will not do may be known late */

static enum pell_result make_fans(struct pell_lights *lights, const struct pell_scene *scene)
{
    enum pell_result res = PELL_OK;
    int fans = 0, tried = 0;

    for (size_t i = 0; i < lights->num_lamps && fans < FANS_MOST && tried < FANS_TRIED && res == PELL_OK; i++) {
        struct pell_lamp *lamp = &lights->lamps[i];
        if (lamp->environment >= 0 || (lamp->type != PELL_LIGHT_POINT && lamp->type != PELL_LIGHT_SPOT))
            continue;
        if (pell_cancelled(lights->ctx))
            return PELL_ERR_CANCELLED;
        tried++;
        res = pell_fan_create(lights->ctx, scene, lamp->position, &lamp->fan);
        fans += lamp->fan != NULL;
    }
    return res;
}

/* One slot per index of refraction, the nearest where there are more than fit. */
static void choose_etas(struct pell_lights *lights, const struct pell_specular_tables *t)
{
    for (size_t i = 0; i < t->num_materials; i++) {
        const double eta = t->boundaries[t->boundary[i]].eta;
        int best = 0;
        for (int k = 1; k < PELL_ENV_ETAS && (size_t) k < t->num_boundaries; k++)
            if (fabs(t->boundaries[k].eta - eta) < fabs(t->boundaries[best].eta - eta))
                best = k;
        lights->eta_slot[i] = (uint8_t) best;
    }
}

static enum pell_result add_environment(struct pell_lights *lights, int number, const struct pell_light *light,
                                        const struct pell_environment_params *params)
{
    struct pell_environment *env = &lights->environments[lights->num_environments++]; /* finished also where it fails half-way */
    struct pell_environment_lights brightest;
    enum pell_result res;

    env->light = number;
    res = pell_environment_create(lights->ctx, light, params, env, &brightest);
    for (size_t i = 0; i < brightest.count && res == PELL_OK; i++)
        res = add_lamp(lights, &brightest.lamps[i]);
    pell_free(lights->ctx, brightest.lamps);
    return res;
}

enum pell_result pell_lights_create(struct pell_context *ctx, const struct pell_scene *scene, const struct pell_settings *settings,
                                    struct pell_pool *pool, struct pell_lights **out)
{
    struct pell_lights *lights = pell_zalloc(ctx, sizeof(*lights));
    struct pell_specular_tables *tables = NULL;
    const int msaa = settings->msaa > 0 ? settings->msaa : 1;
    size_t environments = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!lights)
        return PELL_ERR_NOMEM;
    lights->ctx = ctx;
    lights->num_materials = scene->num_materials;
    /* shared out over the multisamples */
    lights->light_samples = settings->light_samples > msaa ? (settings->light_samples + msaa - 1) / msaa : 1;
    lights->ambient_samples = settings->ambient_samples > msaa ? (settings->ambient_samples + msaa - 1) / msaa : 1;
    for (size_t i = 0; i < scene->num_lights; i++)
        environments += scene->lights[i].type == PELL_LIGHT_ENVIRONMENT;

    lights->parts = pell_calloc(ctx, scene->num_meshes ? scene->num_meshes : 1, sizeof(*lights->parts));
    lights->eta_slot = lights->parts ? pell_calloc(ctx, scene->num_materials ? scene->num_materials : 1, 1) : NULL;
    lights->environments = lights->eta_slot ? pell_calloc(ctx, environments ? environments : 1, sizeof(*lights->environments)) : NULL;
    if (!lights->environments)
        goto fail;
    for (size_t i = 0; i < scene->num_meshes; i++)
        lights->parts[lights->num_parts++] = (struct pell_lights_part){ scene->meshes[i].object, scene->meshes[i].material };
    qsort(lights->parts, lights->num_parts, sizeof(*lights->parts), compare_parts);

    for (size_t i = 0; i < scene->num_lights; i++) {
        const struct pell_light *light = &scene->lights[i];
        struct pell_lamp lamp;
        if (light->type != PELL_LIGHT_ENVIRONMENT) {
            if (pell_lamp_make(scene, light, lights->light_samples, &lamp)) {
                lamp.light = (int) i;
                PELL_TRY(add_lamp(lights, &lamp));
            }
            continue;
        }
        if (!tables) {
            PELL_TRY(pell_specular_tables_create(ctx, scene, &tables));
            choose_etas(lights, tables);
        }
        PELL_TRY(add_environment(lights, (int) i, light, &(struct pell_environment_params) {
            .index = (int) lights->num_environments, .max_lights = settings->environment_lights, .tables = tables, .pool = pool }));
    }
    PELL_TRY(make_fans(lights, scene));
    res = PELL_ERR_NOMEM;
    lights->data = pell_alloc_array(ctx, lights->num_lamps ? lights->num_lamps : 1, sizeof(*lights->data));
    if (!lights->data)
        goto fail;
    for (size_t i = 0; i < lights->num_lamps; i++)
        lights->data[i] = pell_light_data_of(scene, &lights->lamps[i]);
    pell_specular_tables_destroy(&tables);
    *out = lights;
    return PELL_OK;

fail:
    pell_specular_tables_destroy(&tables);
    pell_lights_destroy(&lights);
    return res;
}

void pell_lights_destroy(struct pell_lights **lights)
{
    struct pell_lights *l = *lights;
    if (!l)
        return;
    *lights = NULL;
    for (size_t i = 0; i < l->num_environments; i++)
        pell_environment_finish(l->ctx, &l->environments[i]);
    for (size_t i = 0; i < l->num_lamps; i++)
        pell_fan_destroy(&l->lamps[i].fan);
    pell_free(l->ctx, l->environments);
    pell_free(l->ctx, l->eta_slot);
    pell_free(l->ctx, l->parts);
    pell_free(l->ctx, l->data);
    pell_free(l->ctx, l->lamps);
    pell_free(l->ctx, l);
}

const struct pell_fan *pell_lights_fan(const struct pell_lights *lights, size_t light)
{
    for (size_t i = 0; i < lights->num_lamps; i++)
        if (lights->lamps[i].environment < 0 && (size_t) lights->lamps[i].light == light)
            return lights->lamps[i].fan;
    return NULL;
}

bool pell_lights_background(const struct pell_lights *lights, struct pell_vec3 direction, float rgb[3])
{
    if (lights->num_environments == 0)
        return false;
    pell_environment_radiance(&lights->environments[0], vec3_normalize(direction), rgb);
    return true;
}
