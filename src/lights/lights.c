/* SPDX-License-Identifier: MIT
 *
 * lights.c - prepares the lights of a scene: samples, cones, projected images, environments. Units and names follow KHR_lights_punctual
 * where it defines the light.
 *
 * A projected image multiplies the light's colour, looked up where the ray leaves the projector; outside of the image the light is 0.
 * Directional lights project it in parallel over width x height mm around the position (0: over the whole scene). Rectangles and discs have
 * the image on their face, upright and unmirrored when seen from the front.
 */
#include "lights/lights.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

static enum pell_result add_light(struct pell_lights *lights, const struct pell_light_source *source)
{
    void *array = lights->sources;
    const enum pell_result res = pell_grow(lights->ctx, &array, lights->num_sources, &lights->capacity, sizeof(*lights->sources));

    lights->sources = array;
    if (res == PELL_OK)
        lights->sources[lights->num_sources++] = *source;
    return res;
}

/* Image coordinates of a projected image: u = 1/2 + x image_u, v = 1/2 - y image_v, with x, y in the plane at distance 1. */
static void aim_image(struct pell_light_source *source, const struct pell_light *light, const struct pell_scene *scene)
{
    const struct pell_image *image = &light->image->image;
    const float aspect = (float) image->width / (float) image->height;
    float fov = light->image_fov, tangent, w = light->width, h = light->height;

    source->image = light->image;
    if (light->type == PELL_LIGHT_DIRECTIONAL) {
        if (!(w > 0.0f) || !(h > 0.0f)) {
            const struct pell_vec3 lo = vec3_load(scene->bounds_min), hi = vec3_load(scene->bounds_max);
            const float size = vec3_length(vec3_sub(hi, lo));
            source->position = vec3_mul(vec3_add(lo, hi), 0.5f);
            h = size > 0.0f && isfinite(size) ? size : 1.0f;
            h = aspect < 1.0f ? h / aspect : h;
            w = h * aspect;
        }
        source->image_u = 1.0f / w;
        source->image_v = 1.0f / h;
        return;
    }
    if (!(fov > 0.0f))
        fov = light->type == PELL_LIGHT_SPOT ? 2.0f * acosf(fminf(fmaxf(light->cos_outer, -1.0f), 1.0f)) : 0.5f * PELL_PI_F;
    fov = fminf(fmaxf(fov, 1e-3f), 3.1f);
    tangent = tanf(0.5f * fov);
    source->image_v = 0.5f / tangent;
    source->image_u = source->image_v / aspect;
}

void pell_light_source_image(const struct pell_light_source *source, struct pell_vec3 from, struct pell_vec3 direction,
                             struct pell_vec3 receiver, float rgb[3])
{
    float rgba[4] = { 0 }, x, y, u, v;

    if (source->type == PELL_LIGHT_RECT || source->type == PELL_LIGHT_DISC) {
        const struct pell_vec3 d = vec3_sub(from, source->position);
        x = -0.5f * vec3_dot(d, source->right) / vec3_dot(source->right, source->right); /* unmirrored from the front */
        y = 0.5f * vec3_dot(d, source->up) / vec3_dot(source->up, source->up);
    } else if (source->type == PELL_LIGHT_DIRECTIONAL) {
        const struct pell_vec3 d = vec3_sub(receiver, source->position);
        x = vec3_dot(d, source->right) * source->image_u;
        y = vec3_dot(d, source->up) * source->image_v;
    } else {
        const float depth = vec3_dot(direction, source->direction), inv = depth > 1e-6f ? 1.0f / depth : 1e12f;
        x = vec3_dot(direction, source->right) * inv * source->image_u;
        y = vec3_dot(direction, source->up) * inv * source->image_v;
    }
    u = 0.5f + x;
    v = 0.5f - y;
    if (u >= 0.0f && u <= 1.0f && v >= 0.0f && v <= 1.0f)
        pell_image_sample(&source->image->image, PELL_WRAP_CLAMP, PELL_WRAP_CLAMP, source->image->nearest, u, v, rgba);
    for (int c = 0; c < 3; c++)
        rgb[c] = rgba[c] > 0.0f ? fminf(rgba[c], 1e10f) : 0.0f;
}

bool pell_light_source_make(const struct pell_scene *scene, const struct pell_light *light, int samples, struct pell_light_source *out)
{
    const bool rect = light->type == PELL_LIGHT_RECT, disc = light->type == PELL_LIGHT_DISC;
    struct pell_light_source source = {
        .type = light->type,
        .position = vec3_load(light->position),
        .direction = vec3_normalize(vec3_load(light->direction)),
        .up = vec3_normalize(vec3_load(light->up)),
        .scale = rect || disc ? 1.0f : 1e6f, /* W/sr over m^2 */
        .inv_range = light->range > 0.0f && !rect && !disc ? 1.0f / light->range : 0.0f,
        .samples = 1,
        .environment = -1,
    };

    if (!(vec3_length(source.direction) > 0.0f))
        source.direction = vec3(0.0f, 0.0f, -1.0f);
    source.right = vec3_cross(source.direction, source.up);
    if (!(vec3_length(source.right) > 1e-4f))
        vec3_basis(source.direction, &source.right, &source.up);
    source.right = vec3_normalize(source.right);
    source.up = vec3_cross(source.right, source.direction);
    memcpy(source.power, light->power, sizeof(source.power));

    if (light->type == PELL_LIGHT_SPOT) {
        const float width = light->cos_inner - light->cos_outer;
        source.spot_scale = 1.0f / (width > 1e-3f ? width : 1e-3f);
        source.spot_offset = -light->cos_outer * source.spot_scale;
    }
    if (light->image && light->image->image.pixels)
        aim_image(&source, light, scene);
    if (rect || disc) {
        const float hw = rect ? 0.5f * light->width : light->radius, hh = rect ? 0.5f * light->height : light->radius;
        source.samples = samples;
        source.sample_area = (rect ? 4.0f : PELL_PI_F) * hw * hh / (float) source.samples;
        for (int c = 0; c < 3; c++)
            source.power[c] *= source.sample_area;
        source.right = vec3_mul(source.right, hw);
        source.up = vec3_mul(source.up, hh);
    }
    for (int c = 0; c < 3; c++)
        source.power[c] = source.power[c] > 0.0f ? fminf(source.power[c], 1e18f) : 0.0f;
    *out = source;
    return source.power[0] + source.power[1] + source.power[2] > 0.0f;
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

struct pell_light_data pell_light_data_of(const struct pell_scene *scene, const struct pell_light_source *source)
{
    struct pell_light_data data = {
        .position = vec4(source->position, source->scale),
        .direction = vec4(source->direction, source->inv_range),
        .right = vec4(source->right, source->image_u),
        .up = vec4(source->up, source->image_v),
        .power = { source->power[0], source->power[1], source->power[2], source->sample_area },
        .spot_scale = source->spot_scale,
        .spot_offset = source->spot_offset,
        .type = (int32_t) source->type,
        .samples = source->samples,
        .environment = source->environment,
        .light = source->light,
        .image = -1,
        .flags = source->compact ? PELL_LIGHT_DATA_COMPACT : 0u,
    };

    for (size_t i = 0; source->image && i < scene->num_textures; i++)
        if (scene->textures[i] == source->image)
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

#define MAX_GRIDS 4  /* maximum number of lights with a light grid: each holds a copy of the triangles */
#define MAX_TRIED 16 /* maximum number of attempts, because an unsuitable light may be detected late */

static enum pell_result make_grids(struct pell_lights *lights, const struct pell_scene *scene)
{
    enum pell_result res = PELL_OK;
    int grids = 0, tried = 0;

    for (size_t i = 0; i < lights->num_sources && grids < MAX_GRIDS && tried < MAX_TRIED && res == PELL_OK; i++) {
        struct pell_light_source *source = &lights->sources[i];
        if (source->environment >= 0 || (source->type != PELL_LIGHT_POINT && source->type != PELL_LIGHT_SPOT))
            continue;
        if (pell_cancelled(lights->ctx))
            return PELL_ERR_CANCELLED;
        tried++;
        res = pell_light_grid_create(lights->ctx, scene, source->position, &source->grid);
        grids += source->grid != NULL;
    }
    return res;
}

/* One slot per index of refraction, the nearest one if there are more indices than slots. */
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

#define MAX_GROUP 4 /* maximum number of lights per group */

/* Forms groups of adjacent lights of an environment that take turns over the multisamples, like the samples of an area light. A light
 * with a large fraction of the environment is in every group: at an object's rim, which only some multisamples cover, its edge would be
 * visible. */
static void share_turns(struct pell_light_source *sources, size_t count, int msaa)
{
    const int turns = msaa % MAX_GROUP == 0 ? MAX_GROUP : msaa % 2 == 0 ? 2 : 1;
    float total = 0.0f;
    int turn = 0;

    for (size_t i = 0; i < count; i++)
        total += pell_luminance(sources[i].power);
    for (size_t i = 0; i < count; i++) {
        const bool small = pell_luminance(sources[i].power) * (float) (2 * turns) <= total;
        sources[i].turn = small ? turn++ % turns : 0;
        sources[i].turns = small ? turns : 1;
    }
}

static enum pell_result add_environment(struct pell_lights *lights, int light_index, const struct pell_light *light,
                                        const struct pell_environment_params *params)
{
    struct pell_environment *env = &lights->environments[lights->num_environments++]; /* counted first, for release after a failure */
    struct pell_environment_lights brightest;
    enum pell_result res;

    env->light = light_index;
    res = pell_environment_create(lights->ctx, light, params, env, &brightest);
    if (res == PELL_OK)
        share_turns(brightest.sources, brightest.count, params->msaa);
    for (size_t i = 0; i < brightest.count && res == PELL_OK; i++)
        res = add_light(lights, &brightest.sources[i]);
    pell_free(lights->ctx, brightest.sources);
    return res;
}

/* Bits of an index below n: at most as many as a position on the curve (PELL_CURVE_LEVELS) leaves of 32. */
static int bits_of(int n)
{
    int bits = 0;

    while (bits < 32 - 2 * PELL_CURVE_LEVELS && n > 1 << bits)
        bits++;
    return bits;
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
    /* distributed over the multisamples */
    lights->light_samples = settings->light_samples > msaa ? (settings->light_samples + msaa - 1) / msaa : 1;
    lights->ambient_samples = settings->ambient_samples > msaa ? (settings->ambient_samples + msaa - 1) / msaa : 1;
    lights->light_bits = bits_of(lights->light_samples * msaa);
    lights->ambient_bits = bits_of(lights->ambient_samples * msaa);
    lights->together = msaa % 4 == 0 ? 0xc0000000u : msaa % 2 == 0 ? 0x80000000u : 0u; /* a frame has all of them in each axis */
    for (size_t i = 0; i < scene->num_lights; i++)
        environments += scene->lights[i].type == PELL_LIGHT_ENVIRONMENT;

    lights->simd = pell_simd_best();
    lights->parts = pell_calloc(ctx, scene->num_meshes ? scene->num_meshes : 1, sizeof(*lights->parts));
    lights->eta_slot = lights->parts ? pell_calloc(ctx, scene->num_materials ? scene->num_materials : 1, 1) : NULL;
    lights->environments = lights->eta_slot ? pell_calloc(ctx, environments ? environments : 1, sizeof(*lights->environments)) : NULL;
    if (!lights->environments)
        goto fail;
    for (size_t i = 0; i < scene->num_meshes; i++)
        lights->parts[lights->num_parts++] = (struct pell_lights_part) { pell_mesh_assembly(&scene->meshes[i]), scene->meshes[i].material };
    qsort(lights->parts, lights->num_parts, sizeof(*lights->parts), compare_parts);

    for (size_t i = 0; i < scene->num_lights; i++) {
        const struct pell_light *light = &scene->lights[i];
        struct pell_light_source source;
        if (light->type != PELL_LIGHT_ENVIRONMENT) {
            if (pell_light_source_make(scene, light, lights->light_samples, &source)) {
                source.light = (int) i;
                PELL_TRY(add_light(lights, &source));
            }
            continue;
        }
        if (!tables) {
            PELL_TRY(pell_specular_tables_create(ctx, scene, settings->specular, &tables));
            choose_etas(lights, tables);
        }
        PELL_TRY(add_environment(lights, (int) i, light,
                                 &(struct pell_environment_params) { .index = (int) lights->num_environments,
                                                                     .max_lights = settings->environment_lights,
                                                                     .msaa = msaa,
                                                                     .tables = tables,
                                                                     .pool = pool }));
    }
    PELL_TRY(make_grids(lights, scene));
    res = PELL_ERR_NOMEM;
    lights->data = pell_alloc_array(ctx, lights->num_sources ? lights->num_sources : 1, sizeof(*lights->data));
    if (!lights->data)
        goto fail;
    for (size_t i = 0; i < lights->num_sources; i++) {
        lights->data[i] = pell_light_data_of(scene, &lights->sources[i]);
        lights->data[i].power.w /= (float) msaa;
    }
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
    for (size_t i = 0; i < l->num_sources; i++)
        pell_light_grid_destroy(&l->sources[i].grid);
    pell_free(l->ctx, l->environments);
    pell_free(l->ctx, l->eta_slot);
    pell_free(l->ctx, l->parts);
    pell_free(l->ctx, l->data);
    pell_free(l->ctx, l->sources);
    pell_free(l->ctx, l);
}

const struct pell_light_grid *pell_lights_grid(const struct pell_lights *lights, size_t light)
{
    for (size_t i = 0; i < lights->num_sources; i++)
        if (lights->sources[i].environment < 0 && (size_t) lights->sources[i].light == light)
            return lights->sources[i].grid;
    return NULL;
}

bool pell_lights_background(const struct pell_lights *lights, struct pell_vec3 direction, float rgb[3])
{
    if (lights->num_environments == 0)
        return false;
    pell_environment_radiance(&lights->environments[0], vec3_normalize(direction), rgb);
    return true;
}
