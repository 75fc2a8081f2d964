/* SPDX-License-Identifier: MIT
 * environment_lookup.c - lookups in an environment: radiance, prefiltered reflection, irradiance over the normal; and its data in the
 * format of a device. */
#include "lights/environment_map.h"
#include "shared/light.h"

#include <string.h>

static struct pell_vec3 to_map(const struct pell_environment *env, struct pell_vec3 d)
{
    return vec3(d.x * env->cos_rotate - d.z * env->sin_rotate, d.y, d.x * env->sin_rotate + d.z * env->cos_rotate);
}

static void map_uv(struct pell_vec3 d, float *u, float *v)
{
    const struct pell_point2 p = pell_panorama_uv(d.x, d.y, d.z);

    *u = p.x;
    *v = p.y;
}

void pell_environment_init(struct pell_environment *env, const struct pell_light *light)
{
    env->cos_rotate = cosf(light->rotate);
    env->sin_rotate = sinf(light->rotate);
    for (int c = 0; c < 3; c++)
        env->power[c] = light->power[c] > 0.0f ? fminf(light->power[c], 1e15f) : 0.0f;
    if (light->image && light->image->image.pixels)
        env->image = light->image;
}

void pell_environment_uv(const struct pell_environment *env, struct pell_vec3 direction, float *u, float *v)
{
    map_uv(to_map(env, direction), u, v);
}

struct pell_vec3 pell_environment_direction(const struct pell_environment *env, double u, double v)
{
    const double azimuth = 2.0 * PELL_PI * (u - 0.5), sine = sin(PELL_PI * v), x = sin(azimuth) * sine, z = -cos(azimuth) * sine;

    return vec3((float) (x * env->cos_rotate + z * env->sin_rotate), (float) cos(PELL_PI * v),
                (float) (z * env->cos_rotate - x * env->sin_rotate));
}

void pell_environment_clean(const struct pell_environment *env, float rgb[3])
{
    for (int c = 0; c < 3; c++) {
        const float x = rgb[c] * env->power[c];
        rgb[c] = x > 0.0f ? x < 1e15f ? x : 1e15f : 0.0f; /* NaN becomes 0, too */
    }
}

void pell_environment_radiance(const struct pell_environment *env, struct pell_vec3 direction, float rgb[3])
{
    float rgba[4] = { 1.0f, 1.0f, 1.0f, 1.0f }, u, v;

    if (env->image) {
        pell_environment_uv(env, direction, &u, &v);
        pell_image_sample(&env->image->image, PELL_WRAP_REPEAT, PELL_WRAP_CLAMP, false, u, v, rgba);
    }
    memcpy(rgb, rgba, 3 * sizeof(*rgb));
    pell_environment_clean(env, rgb);
}

static void level_lookup(const struct pell_env_level *l, float u, float v, float rgb[3])
{
    const float x = u * (float) l->width - 0.5f, y0 = v * (float) l->height - 0.5f;
    const float y = y0 > 0.0f ? y0 < (float) (l->height - 1) ? y0 : (float) (l->height - 1) : 0.0f;
    const int xi = (int) floorf(x), yi = (int) y, yj = yi + 1 < l->height ? yi + 1 : yi;
    const int xa = (xi + l->width) % l->width, xb = (xi + 1) % l->width;
    const float f = x - (float) xi, g = y - (float) yi;
    const float *r0 = l->rgb + (size_t) yi * (size_t) l->width * 3, *r1 = l->rgb + (size_t) yj * (size_t) l->width * 3;

    for (int c = 0; c < 3; c++)
        rgb[c] = pell_bilinear(r0[3 * xa + c], r0[3 * xb + c], r1[3 * xa + c], r1[3 * xb + c], f, g);
}

const float pell_env_level_roughness[PELL_ENV_LEVELS] = { 0.0f, 0.15f, 0.3f, 0.45f, 0.6f, 0.8f, 1.0f };

void pell_environment_reflection(const struct pell_environment *env, struct pell_vec3 direction, float width, float rgb[3])
{
    const float r = sqrtf(width < 1.0f ? width > 0.0f ? width : 0.0f : 1.0f);
    float a[3], b[3], u, v, f;
    int k = 0;

    if (env->num_levels == 0) {
        memcpy(rgb, env->power, 3 * sizeof(*rgb));
        return;
    }
    while (k < PELL_ENV_LEVELS - 2 && r >= pell_env_level_roughness[k + 1])
        k++;
    f = (r - pell_env_level_roughness[k]) / (pell_env_level_roughness[k + 1] - pell_env_level_roughness[k]);
    map_uv(to_map(env, direction), &u, &v);
    level_lookup(&env->levels[k], u, v, a);
    level_lookup(&env->levels[k + 1], u, v, b);
    for (int c = 0; c < 3; c++)
        rgb[c] = pell_lerp(a[c], b[c], f);
}

void pell_environment_irradiance(const struct pell_environment *env, struct pell_vec3 n, const struct pell_env_query *q, float rgb[3])
{
    const struct pell_point2 at = pell_octahedral_coord(n.x, n.y, n.z);
    const int i = pell_table_cell(at.x, PELL_ENV_NODES), j = pell_table_cell(at.y, PELL_ENV_NODES);
    const float f = at.x - (float) i, g = at.y - (float) j;
    const float weight[4] = { (1.0f - f) * (1.0f - g), f * (1.0f - g), (1.0f - f) * g, f * g };
    const float coord = pell_roughness_coord(q->roughness, PELL_ROUGHNESS_MIN, PELL_ENV_ROUGHNESS);
    const int k = pell_table_cell(coord, PELL_ENV_ROUGHNESS);
    const float h = coord - (float) k;
    float e[3] = { 0 }, lobe[3] = { 0 };

    for (int corner = 0; corner < 4; corner++) {
        const float *node = env->nodes + (size_t) ((j + corner / 2) * PELL_ENV_NODES + i + corner % 2) * (size_t) env->size;
        if (q->smooth >= 0) {
            for (int c = 0; c < 3; c++)
                e[c] += weight[corner] * node[env->boundary_at + 3 * q->smooth + c];
            continue;
        }
        const float *m = node + env->model_at[q->model] + 6 * k; /* scale rgb, bias rgb, then the next roughness */
        for (int c = 0; c < 3; c++) {
            const float a = q->f0 * m[c] + m[3 + c], b = q->f0 * m[6 + c] + m[9 + c];
            e[c] += weight[corner] * node[c];
            lobe[c] += weight[corner] * pell_lerp(a, b, h);
        }
    }
    for (int c = 0; c < 3; c++)
        rgb[c] = e[c] - q->rho_s * lobe[c];
}

/* --- Device data ---------------------------------------------------------------------------------------------------------------- */

static uint32_t bits(float x)
{
    return (uint32_t) pell_float_bits(x);
}

/* Writes floats at word `at` unless `out` is NULL; returns the next word. */
static size_t put(uint32_t *out, size_t at, const float *from, size_t count)
{
    if (out)
        memcpy(out + at, from, count * sizeof(*out));
    return at + count;
}

/* Writes the environment's row, and its data from word `at` on; returns the next word. */
static size_t put_environment(const struct pell_lights *lights, size_t index, uint32_t *out, size_t at)
{
    const struct pell_environment *env = &lights->environments[index];
    uint32_t unused[PELL_ENV_ROW], *row = out ? out + PELL_ENV_HEAD + PELL_ENV_ROW * index : unused;

    row[0] = (uint32_t) at;
    row[1] = (uint32_t) env->size;
    row[2] = (uint32_t) env->boundary_at;
    row[3] = (uint32_t) env->num_levels;
    row[4] = bits(env->cos_rotate);
    row[5] = bits(env->sin_rotate);
    for (int c = 0; c < 3; c++)
        row[6 + c] = bits(env->power[c]);
    for (int m = 0; m < PELL_SPECULAR_MODELS; m++)
        row[12 + m] = (uint32_t) env->model_at[m];
    at = put(out, at, env->nodes, (size_t) PELL_ENV_NODES * PELL_ENV_NODES * (size_t) env->size);
    for (int k = 0; k < env->num_levels; k++) {
        const struct pell_env_level *l = &env->levels[k];
        row[20 + 4 * k] = (uint32_t) at;
        row[21 + 4 * k] = (uint32_t) l->width;
        row[22 + 4 * k] = (uint32_t) l->height;
        row[23 + 4 * k] = bits(pell_env_level_roughness[k]);
        at = put(out, at, l->rgb, 3 * (size_t) l->width * (size_t) l->height);
    }
    row[9] = (uint32_t) at;
    row[10] = 0;
    for (size_t j = 0; j < lights->num_sources; j++) {
        const struct pell_light_source *source = &lights->sources[j];
        const float light[6] = { source->direction.x, source->direction.y, source->direction.z,
                                 source->power[0],    source->power[1],    source->power[2] };
        if (source->environment != (int) index || source->compact)
            continue;
        at = put(out, at, light, 6);
        row[10]++;
    }
    return at;
}

_Static_assert(12 + PELL_SPECULAR_MODELS <= 20 && 20 + 4 * PELL_ENV_LEVELS <= PELL_ENV_ROW, "rows hold them");

size_t pell_lights_environment_words(const struct pell_lights *lights, uint32_t *out)
{
    size_t at = PELL_ENV_HEAD + PELL_ENV_ROW * lights->num_environments;

    if (lights->num_environments == 0)
        return 0;
    if (out) {
        out[0] = (uint32_t) lights->num_environments;
        out[1] = (uint32_t) lights->ambient_samples;
        out[2] = (uint32_t) at;
        out[3] = 0;
        for (size_t i = 0; i < lights->num_materials; i++)
            out[at + i] = lights->eta_slot[i];
    }
    at += lights->num_materials;
    for (size_t e = 0; e < lights->num_environments; e++)
        at = put_environment(lights, e, out, at);
    return at;
}

/* --- Non-directional light ---------------------------------------------------------------------------------------------------------- */

/* Mean irradiance of a light over all face orientations, W/m^2. */
static float mean_of_source(const struct pell_light_source *s, struct pell_vec3 at)
{
    const struct pell_vec3 to = vec3_sub(at, s->position);
    const float power = pell_luminance(s->power), distance = vec3_length(to),
                along = distance > 0.0f ? vec3_dot(s->direction, to) / distance : 1.0f;
    float fraction = 1.0f;

    if (s->type == PELL_LIGHT_DIRECTIONAL)
        return 0.25f * power;
    if (s->type == PELL_LIGHT_RECT || s->type == PELL_LIGHT_DISC)
        fraction = (float) s->samples * fmaxf(along, 0.0f);
    else if (s->type == PELL_LIGHT_SPOT)
        fraction = pell_light_cone(along, s->spot_scale, s->spot_offset);
    return 0.25f * power * fraction * pell_light_falloff(distance, s->scale, s->inv_range);
}

/* Irradiance on a face, from the table's node nearest to its normal. */
static const float *nearest_node(const struct pell_environment *env, struct pell_vec3 n)
{
    const struct pell_point2 at = pell_octahedral_coord(n.x, n.y, n.z);
    const int i = (int) (at.x + 0.5f), j = (int) (at.y + 0.5f);

    return env->nodes + (size_t) (j * PELL_ENV_NODES + i) * (size_t) env->size;
}

float pell_lights_diffuse(const struct pell_lights *lights, struct pell_vec3 at)
{
    float diffuse = 0.0f, all = 0.0f;

    for (size_t e = 0; e < lights->num_environments; e++)
        for (int side = 0; side < 6; side++) {
            const float sign = side & 1 ? -1.0f : 1.0f;
            const struct pell_vec3 n = vec3(side / 2 == 0 ? sign : 0.0f, side / 2 == 1 ? sign : 0.0f, side / 2 == 2 ? sign : 0.0f);
            diffuse += pell_luminance(nearest_node(&lights->environments[e], n)) * (1.0f / 6.0f);
        }
    for (size_t i = 0; i < lights->num_sources; i++) {
        const struct pell_light_source *s = &lights->sources[i];
        const float light = mean_of_source(s, at);
        all += light;
        if (s->environment >= 0 && !s->compact) /* included in the table */
            diffuse -= light;
    }
    diffuse = fmaxf(diffuse, 0.0f);
    return diffuse > 0.0f ? diffuse / (diffuse + all) : 0.0f;
}
