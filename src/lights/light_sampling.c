/* SPDX-License-Identifier: MIT
 *
 * light_sampling.c - see light_sampling.h. What a light gives is asked of the irradiance stage's own lights and look-ups; here are the
 * densities.
 *
 * A light is chosen by an estimate of its irradiance at a place, with a tenth of the choices left to all alike, so that none is missed.
 * Environments are found by luminance x sin(theta), which between texel centres is taken for bilinear, as the look-up is: cells between
 * four centres, half cells at the poles. Cells of a row are chosen by integers, so that the density is the very chance of a cell.
 */
#include "lights/light_sampling.h"
#include "image/color.h"
#include "lights/lights.h"
#include "shared/light.h"

#include <string.h>

#define ALIKE 0.1      /* of the choices: for lights whose estimate is wrong */
#define UNSEEN 0.1     /* what an estimate leaves of lights that face away: nearby places may be lit */
#define IMAGE_STEPS 32 /* a side of the grid that a projected image's mean is taken over */

struct environment {
    struct pell_environment env;
    int width, height;  /* of the picture; 0: constant */
    double *rows;       /* share of the rows of cells up to and with each; height + 1 of them */
    uint32_t *columns;  /* of each row: 2^32 times the share of the cells up to and with each, less 1 */
    double energy;      /* luminance over the sphere, sr W/(m^2 sr) */
    double share, upto; /* of all environments' energy; and of those up to and with this one */
};

struct sampled_light {
    struct pell_light_source source; /* but of the environment */
    bool environment;
    double power;       /* luminance: of intensity, irradiance, radiance x area, and the environment's mean irradiance */
    double area;        /* mm^2 */
    double radiance[3]; /* rect, disc */
};

struct pell_light_sampler {
    struct pell_context *ctx;
    struct sampled_light *list;
    size_t count;
    struct environment *environments;
    size_t num_skies;
    double soft2;            /* mm^2 that squared distances have at least: lights at the very place */
    double middle[3], reach; /* of the scene's bounds: centre and half diagonal, mm */
};

/* --- The environment
 * -------------------------------------------------------------------------------------------------------------------- */

/* Luminance of a texel as the look-up cleans it. */
static double texel(const struct environment *s, int x, int y)
{
    float rgba[4];

    pell_image_texel(&s->env.image->image, x, y, rgba);
    for (int c = 0; c < 3; c++) {
        const float v = rgba[c] * s->env.power[c];
        rgba[c] = v > 0.0f ? v < 1e15f ? v : 1e15f : 0.0f;
    }
    return (double) pell_luminance(rgba);
}

/* Where rows of cells begin: 0, 1/2h, 3/2h, ..., 1. */
static double row_start(const struct environment *s, int row)
{
    return row == 0 ? 0.0 : row > s->height ? 1.0 : (row - 0.5) / s->height;
}

/* The four corners of a cell, of the density over (u, v): upper left, upper right, lower left, lower right. */
static double cell_corners(const struct environment *s, int column, int row, double f[4])
{
    const int next = column + 1 < s->width ? column + 1 : 0, above = row > 0 ? row - 1 : 0, below = row < s->height ? row : s->height - 1;
    const double upper = sin(PELL_PI * row_start(s, row)), lower = row < s->height ? sin(PELL_PI * row_start(s, row + 1)) : 0.0;

    f[0] = upper > 0.0 ? upper * texel(s, column, above) : 0.0;
    f[1] = upper > 0.0 ? upper * texel(s, next, above) : 0.0;
    f[2] = lower > 0.0 ? lower * texel(s, column, below) : 0.0;
    f[3] = lower > 0.0 ? lower * texel(s, next, below) : 0.0;
    return 0.25 * (f[0] + f[1] + f[2] + f[3]);
}

static enum pell_result make_table(struct pell_context *ctx, struct environment *s)
{
    const int w = s->env.image->image.width, h = s->env.image->image.height;
    double *line, sum = 0.0;

    s->width = w;
    s->height = h;
    s->rows = pell_alloc_array(ctx, (size_t) h + 1, sizeof(*s->rows));
    s->columns = s->rows ? pell_alloc_array(ctx, ((size_t) h + 1) * (size_t) w, sizeof(*s->columns)) : NULL;
    line = s->columns ? pell_alloc_array(ctx, (size_t) w, sizeof(*line)) : NULL;
    if (!line)
        return PELL_ERR_NOMEM;
    for (int y = 0; y <= h; y++) {
        uint32_t *columns = s->columns + (size_t) y * (size_t) w;
        double f[4], total = 0.0;
        for (int x = 0; x < w; x++)
            line[x] = total += cell_corners(s, x, y, f);
        /* Each cell gets one of the 2^32 numbers at least. */
        for (int x = 0; x < w; x++) {
            const double share = x == w - 1 ? 1.0 : total > 0.0 ? line[x] / total : (x + 1.0) / w;
            columns[x] = (uint32_t) (share * (4294967296.0 - w)) + (uint32_t) x;
        }
        s->rows[y] = sum += total / w * (row_start(s, y + 1) - row_start(s, y));
    }
    pell_free(ctx, line);
    for (int y = 0; y <= h && sum > 0.0; y++)
        s->rows[y] = y == h ? 1.0 : s->rows[y] / sum;
    s->energy = sum * 2.0 * PELL_PI * PELL_PI;
    return PELL_OK;
}

/* A number in [0, 1] of a density that goes from a to b linearly. */
static double linear_sample(double u, double a, double b)
{
    const double root = sqrt(a * a + u * (b * b - a * a));
    return a + root > 0.0 ? fmin(u * (a + b) / (a + root), 1.0) : u;
}

/* Per sr: of (s, t) in [0, 1]^2 of a cell. */
static double cell_density(const struct environment *k, int column, int row, const double f[4], double mean, double s, double t)
{
    const uint32_t *columns = k->columns + (size_t) row * (size_t) k->width;
    const double chance = (columns[column] - (column > 0 ? (double) columns[column - 1] : -1.0)) * (1.0 / 4294967296.0);
    const double high = row_start(k, row), size = row_start(k, row + 1) - high, sine = sin(PELL_PI * (high + t * size));
    const double value = (1.0 - t) * ((1.0 - s) * f[0] + s * f[1]) + t * ((1.0 - s) * f[2] + s * f[3]);

    return (k->rows[row] - (row > 0 ? k->rows[row - 1] : 0.0)) * chance * (mean > 0.0 ? value / mean : 1.0) * k->width /
           (size * 2.0 * PELL_PI * PELL_PI * fmax(sine, 1e-12));
}

static double environment_density(const struct environment *k, struct pell_vec3 direction)
{
    double f[4], mean, x, y;
    float u, v;
    int column, row;

    if (k->width == 0)
        return 0.25 / PELL_PI;
    pell_environment_place(&k->env, direction, &u, &v);
    x = (double) u * k->width - 0.5;
    y = (double) v * k->height + 0.5;
    column = (int) floor(x);
    x -= column;
    column = (column + k->width) % k->width;
    row = (int) fmin(fmax(floor(y), 0.0), k->height);
    y = row == 0 ? 2.0 * (double) v * k->height : row == k->height ? 2.0 * (y - row) : y - row;
    mean = cell_corners(k, column, row, f);
    return cell_density(k, column, row, f, mean, x, fmin(fmax(y, 0.0), 1.0));
}

static struct pell_vec3 environment_sample(const struct environment *k, double u, double v)
{
    int low = 0, high = k->height, row;
    double f[4], s, t, before;
    uint64_t number;

    if (k->width == 0) {
        const double y = 1.0 - 2.0 * u, r = sqrt(fmax(0.0, 1.0 - y * y));
        return vec3((float) (r * cos(2.0 * PELL_PI * v)), (float) y, (float) (r * sin(2.0 * PELL_PI * v)));
    }
    while (low < high) {
        const int middle = (low + high) / 2;
        if (k->rows[middle] > u)
            high = middle;
        else
            low = middle + 1;
    }
    row = low;
    before = row > 0 ? k->rows[row - 1] : 0.0;
    t = fmin(fmax((u - before) / (k->rows[row] - before), 0.0), 1.0);
    v *= 4294967296.0;
    number = (uint64_t) v;
    low = 0;
    high = k->width - 1;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (k->columns[(size_t) row * (size_t) k->width + (size_t) middle] >= number)
            high = middle;
        else
            low = middle + 1;
    }
    before = low > 0 ? (double) k->columns[(size_t) row * (size_t) k->width + (size_t) low - 1] + 1.0 : 0.0;
    s = fmin(fmax((v - before) / ((double) k->columns[(size_t) row * (size_t) k->width + (size_t) low] + 1.0 - before), 0.0), 1.0);
    cell_corners(k, low, row, f);
    t = linear_sample(t, f[0] + f[1], f[2] + f[3]);
    s = linear_sample(s, (1.0 - t) * f[0] + t * f[2], (1.0 - t) * f[1] + t * f[3]);
    return pell_environment_direction(&k->env, (low + 0.5 + s) / k->width,
                                      row_start(k, row) + t * (row_start(k, row + 1) - row_start(k, row)));
}

static double skies_density(const struct pell_light_sampler *e, struct pell_vec3 direction)
{
    double density = 0.0;

    for (size_t i = 0; i < e->num_skies; i++)
        density += e->environments[i].share * environment_density(&e->environments[i], direction);
    return density;
}

static void skies_radiance(const struct pell_light_sampler *e, struct pell_vec3 direction, float rgb[3])
{
    memset(rgb, 0, 3 * sizeof(*rgb));
    for (size_t i = 0; i < e->num_skies; i++) {
        float one[3];
        pell_environment_radiance(&e->environments[i].env, direction, one);
        for (int c = 0; c < 3; c++)
            rgb[c] += one[c];
    }
}

static enum pell_result add_skies(struct pell_light_sampler *e, const struct pell_scene *scene)
{
    struct sampled_light *environment = &e->list[e->count];
    double total = 0.0, upto = 0.0;

    for (size_t i = 0; i < scene->num_lights; i++) {
        struct environment *s = &e->environments[e->num_skies];
        if (scene->lights[i].type != PELL_LIGHT_ENVIRONMENT)
            continue;
        e->num_skies++; /* finished also where it fails half-way */
        pell_environment_aim(&s->env, &scene->lights[i]);
        s->energy = 4.0 * PELL_PI * (double) pell_luminance(s->env.power);
        if (s->env.image && s->energy > 0.0) {
            const enum pell_result res = make_table(e->ctx, s);
            if (res != PELL_OK)
                return res;
        }
        total += s->energy;
    }
    if (!(total > 0.0)) {
        for (size_t i = 0; i < e->num_skies; i++)
            e->environments[i].share = 0.0;
        return PELL_OK;
    }
    for (size_t i = 0; i < e->num_skies; i++) {
        e->environments[i].share = e->environments[i].energy / total;
        e->environments[i].upto = upto += e->environments[i].share;
    }
    environment->environment = true;
    environment->power = 0.25 * total;
    e->count++;
    return PELL_OK;
}

/* --- Lights ---------------------------------------------------------------------------------------------------------------------- */

/* Mean luminance of a projected image under its light's colour. */
static double image_power(const struct pell_light_source *source)
{
    double sum = 0.0;

    for (int y = 0; y < IMAGE_STEPS; y++)
        for (int x = 0; x < IMAGE_STEPS; x++) {
            float rgba[4];
            pell_image_sample(&source->image->image, PELL_WRAP_CLAMP, PELL_WRAP_CLAMP, source->image->nearest,
                              ((float) x + 0.5f) / IMAGE_STEPS, ((float) y + 0.5f) / IMAGE_STEPS, rgba);
            for (int c = 0; c < 3; c++)
                rgba[c] = rgba[c] > 0.0f ? fminf(rgba[c], 1e10f) * source->power[c] : 0.0f;
            sum += (double) pell_luminance(rgba);
        }
    return sum / (IMAGE_STEPS * IMAGE_STEPS);
}

static void add_light(struct pell_light_sampler *e, const struct pell_scene *scene, const struct pell_light *light)
{
    struct sampled_light *out = &e->list[e->count];
    const float *p = light->position, *d = light->direction;

    if (!isfinite(p[0] + p[1] + p[2]) || !isfinite(d[0] + d[1] + d[2]) || !pell_light_source_make(scene, light, 1, &out->source))
        return;
    out->area = (double) out->source.sample_area;
    out->power = out->source.image ? image_power(&out->source) : (double) pell_luminance(out->source.power);
    if (out->source.type == PELL_LIGHT_RECT || out->source.type == PELL_LIGHT_DISC) {
        if (!(out->area > 0.0 && out->area < INFINITY))
            return;
        for (int c = 0; c < 3; c++)
            out->radiance[c] = (double) out->source.power[c] / out->area;
    }
    if (isfinite(out->power))
        e->count++;
}

enum pell_result pell_light_sampler_create(struct pell_context *ctx, const struct pell_scene *scene, struct pell_light_sampler **out)
{
    struct pell_light_sampler *e = pell_zalloc(ctx, sizeof(*e));
    const float *low = scene->bounds_min, *high = scene->bounds_max;
    double diagonal2 = 0.0;
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!e)
        return PELL_ERR_NOMEM;
    e->ctx = ctx;
    for (int k = 0; k < 3; k++) {
        const double size = (double) high[k] - low[k];
        if (!(size >= 0.0 && size < INFINITY))
            continue;
        e->middle[k] = 0.5 * ((double) high[k] + low[k]);
        diagonal2 += size * size;
    }
    e->reach = diagonal2 > 0.0 ? 0.5 * sqrt(diagonal2) : 1.0;
    e->soft2 = 1e-6 * e->reach * e->reach;
    e->list = pell_calloc(ctx, scene->num_lights + 1, sizeof(*e->list));
    e->environments = pell_calloc(ctx, scene->num_lights + 1, sizeof(*e->environments));
    if (!e->list || !e->environments)
        goto fail;
    for (size_t i = 0; i < scene->num_lights; i++)
        if (scene->lights[i].type != PELL_LIGHT_ENVIRONMENT)
            add_light(e, scene, &scene->lights[i]);
    PELL_TRY(add_skies(e, scene));
    *out = e;
    return PELL_OK;

fail:
    pell_light_sampler_destroy(&e);
    return res;
}

void pell_light_sampler_destroy(struct pell_light_sampler **light_sampler)
{
    struct pell_light_sampler *e = *light_sampler;

    if (!e)
        return;
    *light_sampler = NULL;
    for (size_t i = 0; i < e->num_skies; i++) {
        pell_free(e->ctx, e->environments[i].rows);
        pell_free(e->ctx, e->environments[i].columns);
    }
    pell_free(e->ctx, e->environments);
    pell_free(e->ctx, e->list);
    pell_free(e->ctx, e);
}

size_t pell_light_sampler_count(const struct pell_light_sampler *light_sampler)
{
    return light_sampler->count;
}

/* --- Choosing a light ------------------------------------------------------------------------------------------------------------ */

static double partly(double seen)
{
    return UNSEEN + (1.0 - UNSEEN) * seen;
}

/* What a light gives about `near`, W/m^2; `soft2`: the squared distance is this at least. Never 0. */
static double estimate(const struct sampled_light *e, struct pell_vec3 near, double soft2)
{
    const struct pell_light_source *source = &e->source;
    struct pell_dvec3 d;
    double d2, cosine;

    if (e->environment || source->type == PELL_LIGHT_DIRECTIONAL)
        return e->power;
    d = dvec3_between(near, source->position);
    d2 = dvec3_dot(d, d);
    cosine = d2 > 0.0 ? dvec3_dot(d, dvec3_widen(source->direction)) / sqrt(d2) : 0.0;
    if (e->area > 0.0)
        return e->power * partly(fmax(cosine, 0.0)) / (fmax(d2, soft2) + e->area);
    return e->power * source->scale / fmax(d2, soft2) * partly((double) pell_light_window((float) fmin(d2, 1e30), source->inv_range)) *
           (source->type == PELL_LIGHT_SPOT ? partly((double) pell_light_cone((float) cosine, source->spot_scale, source->spot_offset))
                                            : 1.0);
}

static double estimate_all(const struct pell_light_sampler *e, struct pell_vec3 near, double soft2)
{
    double sum = 0.0;

    for (size_t i = 0; i < e->count; i++)
        sum += estimate(&e->list[i], near, soft2);
    return sum;
}

static double chance_of(const struct pell_light_sampler *e, size_t source, struct pell_vec3 near, double soft2, double all)
{
    const double alike = 1.0 / (double) e->count;
    return all > 0.0 && all < INFINITY ? ALIKE * alike + (1.0 - ALIKE) * estimate(&e->list[source], near, soft2) / all : alike;
}

/* The light that *u chooses, which is a fresh number then. */
static size_t choose(const struct pell_light_sampler *e, struct pell_vec3 near, double soft2, double *u, double *chance)
{
    const double all = e->count > 1 ? estimate_all(e, near, soft2) : 0.0;
    size_t i = 0;

    for (;; i++) {
        *chance = chance_of(e, i, near, soft2, all);
        if (*u < *chance || i + 1 == e->count)
            break;
        *u -= *chance;
    }
    *u = fmin(*u / *chance, 1.0 - 1e-16);
    return i;
}

static double chance(const struct pell_light_sampler *e, int source, struct pell_vec3 near, double soft2)
{
    return e->count > 1 ? chance_of(e, (size_t) source, near, soft2, estimate_all(e, near, soft2)) : 1.0;
}

/* --- Sampling ------------------------------------------------------------------------------------------------------------------- */

static bool is_delta(const struct sampled_light *e)
{
    return !e->environment && !(e->area > 0.0);
}

static bool is_away(const struct sampled_light *e)
{
    return e->environment || e->source.type == PELL_LIGHT_DIRECTIONAL;
}

/* A place on light `index`; out->pdf is its own, without the choice. `choice`: which of several environments. */
static void place_on(const struct pell_light_sampler *e, size_t index, double choice, double u, double v, struct pell_light_sample *out)
{
    const struct sampled_light *l = &e->list[index];
    const struct pell_light_source *source = &l->source;

    memset(out, 0, sizeof(*out));
    out->source = (int) index;
    out->away = is_away(l);
    out->delta = is_delta(l);
    out->pdf = 1.0;
    if (l->environment) {
        size_t k = 0;
        while (k + 1 < e->num_skies && !(choice < e->environments[k].upto && e->environments[k].share > 0.0))
            k++;
        out->toward = environment_sample(&e->environments[k], u, v);
        out->pdf = skies_density(e, out->toward);
        return;
    }
    if (out->away) {
        out->toward = vec3_mul(source->direction, -1.0f);
        return;
    }
    out->at = source->position;
    out->normal = out->delta ? vec3(0.0f, 0.0f, 0.0f) : source->direction;
    if (!out->delta) {
        const bool disc = source->type == PELL_LIGHT_DISC;
        const double r = sqrt(u), x = disc ? r * cos(2.0 * PELL_PI * v) : 2.0 * u - 1.0,
                     y = disc ? r * sin(2.0 * PELL_PI * v) : 2.0 * v - 1.0;
        out->at =
            dvec3_narrow(dvec3_mad(dvec3_mad(dvec3_widen(source->position), x, dvec3_widen(source->right)), y, dvec3_widen(source->up)));
        out->pdf = 1.0 / l->area;
    }
}

bool pell_light_sampler_sample(const struct pell_light_sampler *light_sampler, struct pell_vec3 near, const double u[3],
                               struct pell_light_sample *out)
{
    double choice = u[0], chance;
    size_t i;

    memset(out, 0, sizeof(*out));
    if (light_sampler->count == 0)
        return false;
    i = choose(light_sampler, near, light_sampler->soft2, &choice, &chance);
    place_on(light_sampler, i, choice, u[1], u[2], out);
    out->pdf *= chance;
    return out->pdf > 0.0;
}

/* The density of a place alone. */
static double place_density(const struct pell_light_sampler *e, const struct pell_light_sample *sample)
{
    const struct sampled_light *l = &e->list[sample->source];
    return l->environment ? skies_density(e, sample->toward) : is_delta(l) ? 1.0 : 1.0 / l->area;
}

double pell_light_sampler_pdf(const struct pell_light_sampler *light_sampler, struct pell_vec3 near, const struct pell_light_sample *sample)
{
    return chance(light_sampler, sample->source, near, light_sampler->soft2) * place_density(light_sampler, sample);
}

/* What light gives along a unit direction, without its range. */
static void power_along(const struct pell_light_sampler *e, const struct pell_light_sample *sample, struct pell_vec3 direction,
                        struct pell_vec3 place, float power[3])
{
    const struct sampled_light *l = &e->list[sample->source];
    const struct pell_light_source *source = &l->source;
    float projected[3] = { 1.0f, 1.0f, 1.0f };
    double scale = 1.0;

    if (l->environment) {
        skies_radiance(e, sample->toward, power);
        return;
    }
    if (l->area > 0.0)
        scale = vec3_dot(source->direction, direction) > 0.0f ? 1.0 : 0.0;
    else if (!is_away(l))
        scale = (double) source->scale;
    if (source->type == PELL_LIGHT_SPOT)
        scale *= (double) pell_light_cone(vec3_dot(source->direction, direction), source->spot_scale, source->spot_offset);
    if (source->image && scale > 0.0)
        pell_light_source_image(source, sample->at, direction, place, projected);
    for (int c = 0; c < 3; c++)
        power[c] = (float) (scale * (double) projected[c] * (l->area > 0.0 ? l->radiance[c] : (double) source->power[c]));
}

void pell_light_sampler_power_at(const struct pell_light_sampler *light_sampler, const struct pell_light_sample *sample,
                                 struct pell_vec3 target, float power[3])
{
    const struct pell_dvec3 d = dvec3_between(target, sample->at);
    const double length = sqrt(dvec3_dot(d, d));
    struct pell_vec3 direction = vec3_mul(sample->toward, -1.0f);
    double window = 1.0;

    if (!sample->away) {
        direction = length > 0.0 ? dvec3_narrow((struct pell_dvec3) { d.x / length, d.y / length, d.z / length }) : vec3(0.0f, 0.0f, 0.0f);
        window = pell_light_sampler_range(light_sampler, sample->source, length);
    }
    power_along(light_sampler, sample, direction, target, power);
    for (int c = 0; c < 3; c++)
        power[c] *= (float) window;
}

double pell_light_sampler_range(const struct pell_light_sampler *light_sampler, int source, double distance)
{
    const struct sampled_light *l = &light_sampler->list[source];
    if (l->environment || l->source.inv_range <= 0.0f)
        return 1.0;
    return (double) pell_light_window((float) fmin(distance * distance, 1e30), l->source.inv_range);
}

/* --- Rays that meet lights ------------------------------------------------------------------------------------------------------- */

/* How far along the ray a rect or disc shows its front; INFINITY: nowhere up to `reach`. */
static double meets(const struct sampled_light *l, struct pell_vec3 x, struct pell_vec3 w, double reach)
{
    const struct pell_dvec3 n = dvec3_widen(l->source.direction), right = dvec3_widen(l->source.right), up = dvec3_widen(l->source.up),
                            d = dvec3_between(x, l->source.position);
    const double facing = -dvec3_dot(n, dvec3_widen(w)), t = facing > 0.0 ? dvec3_dot(n, d) / facing : -1.0;
    struct pell_dvec3 p;
    double a, b;

    if (!(t > 0.0 && t <= reach))
        return INFINITY;
    p = dvec3_mad(d, t, dvec3_widen(w));
    a = dvec3_dot(p, right) / dvec3_dot(right, right);
    b = dvec3_dot(p, up) / dvec3_dot(up, up);
    return (l->source.type == PELL_LIGHT_DISC ? a * a + b * b <= 1.0 : fabs(a) <= 1.0 && fabs(b) <= 1.0) ? t : INFINITY;
}

bool pell_light_sampler_hit(const struct pell_light_sampler *light_sampler, struct pell_vec3 near, struct pell_vec3 x, struct pell_vec3 w,
                            double reach, int k, struct pell_light_sample *sample, double *distance, float radiance[3], double *pdf)
{
    const struct sampled_light *list = light_sampler->list;
    double last = -1.0, nearest = INFINITY;
    size_t last_at = 0, at = 0;

    for (; k >= 0; k--) { /* the k-th by (distance, number) */
        nearest = INFINITY;
        for (size_t i = 0; i < light_sampler->count; i++) {
            const double t = list[i].area > 0.0 ? meets(&list[i], x, w, reach) : INFINITY;
            if (t < nearest && (t > last || (t == last && i > last_at))) {
                nearest = t;
                at = i;
            }
        }
        if (nearest == INFINITY)
            break;
        last = nearest;
        last_at = at;
    }
    if (nearest == INFINITY) {
        if (k > 0 || reach != INFINITY || light_sampler->count == 0 || !list[light_sampler->count - 1].environment)
            return false;
        at = light_sampler->count - 1;
    }
    memset(sample, 0, sizeof(*sample));
    sample->source = (int) at;
    sample->away = list[at].environment;
    if (list[at].environment) {
        sample->toward = w;
    } else {
        sample->at = dvec3_narrow(dvec3_mad(dvec3_widen(x), nearest, dvec3_widen(w)));
        sample->normal = list[at].source.direction;
    }
    *distance = nearest;
    power_along(light_sampler, sample, vec3_mul(w, -1.0f), x, radiance);
    *pdf = sample->pdf = pell_light_sampler_pdf(light_sampler, near, sample);
    return true;
}

/* --- Light that sets out -------------------------------------------------------------------------------------------------------- */

/* Directions from a light: all, those of a cone, or by cosine about the normal. */
struct grid {
    struct pell_dvec3 axis;
    double versed; /* 1 - cosine of the cone's angle; 2: all directions */
    bool cosine;
};

static struct grid grid_of(const struct sampled_light *l, struct pell_vec3 centre, double radius, struct pell_vec3 at)
{
    const struct pell_dvec3 d = dvec3_between(centre, at);
    const double d2 = dvec3_dot(d, d), r2 = radius * radius;
    struct grid grid = { dvec3_widen(l->source.direction), 2.0, false };

    if (d2 > r2 * (1.0 + 1e-9)) {
        const double length = sqrt(d2);
        grid.axis = (struct pell_dvec3) { d.x / length, d.y / length, d.z / length };
        grid.versed = r2 / d2 / (1.0 + sqrt(1.0 - r2 / d2));
    }
    if (l->area > 0.0 && grid.versed > 0.5) {
        grid.axis = dvec3_widen(l->source.direction);
        grid.cosine = true;
    }
    if (l->source.type == PELL_LIGHT_SPOT) {
        const double own = 1.0 + (double) l->source.spot_offset / (double) l->source.spot_scale; /* 1 - cos_outer */
        if (own < grid.versed) {
            grid.axis = dvec3_widen(l->source.direction);
            grid.versed = own;
        }
    }
    return grid;
}

static double grid_density(const struct grid *grid, struct pell_vec3 direction)
{
    const struct pell_dvec3 w = dvec3_widen(direction);
    const double cosine = dvec3_dot(grid->axis, w), limit = 1.0 - grid->versed;
    const struct pell_dvec3 off = dvec3_mad(w, -cosine, grid->axis);

    if (grid->cosine)
        return fmax(cosine, 0.0) / PELL_PI;
    /* by the sine, which small angles keep; directions are floats */
    if (limit > 0.0 ? cosine <= 0.0 || dvec3_dot(off, off) > (1.0 - limit * limit) * (1.0 + 1e-5) : cosine < limit - 1e-6)
        return 0.0;
    return 1.0 / (2.0 * PELL_PI * grid->versed);
}

static struct pell_vec3 grid_sample(const struct grid *grid, double u, double v)
{
    const double versed = grid->cosine ? 1.0 - sqrt(1.0 - u) : u * grid->versed, c = 1.0 - versed,
                 s = sqrt(fmax(0.0, versed * (2.0 - versed)));
    struct pell_vec3 t, b;

    vec3_basis(dvec3_narrow(grid->axis), &t, &b);
    return dvec3_narrow(dvec3_mad(dvec3_mad(dvec3_mul(grid->axis, c), s * cos(2.0 * PELL_PI * v), dvec3_widen(t)),
                                  s * sin(2.0 * PELL_PI * v), dvec3_widen(b)));
}

bool pell_light_sampler_emit(const struct pell_light_sampler *light_sampler, struct pell_vec3 centre, double radius, const double u[5],
                             struct pell_light_sample *sample, struct pell_vec3 *origin, struct pell_vec3 *direction, double weight[3],
                             double *pdf)
{
    const struct sampled_light *l;
    double choice = u[0], share;
    float power[3];
    size_t i;

    if (light_sampler->count == 0 || !(radius > 0.0 && radius < INFINITY))
        return false;
    i = choose(light_sampler, centre, radius * radius, &choice, &share);
    l = &light_sampler->list[i];
    place_on(light_sampler, i, choice, u[1], u[2], sample);
    *pdf = sample->pdf;
    sample->pdf *= share;
    if (sample->away) {
        const double r = radius * sqrt(u[3]);
        const struct pell_dvec3 off = { centre.x - light_sampler->middle[0], centre.y - light_sampler->middle[1],
                                        centre.z - light_sampler->middle[2] };
        const double back = radius + light_sampler->reach + sqrt(dvec3_dot(off, off));
        struct pell_vec3 t, b;
        vec3_basis(sample->toward, &t, &b);
        *direction = vec3_mul(sample->toward, -1.0f);
        const struct pell_dvec3 aside = dvec3_mad(dvec3_widen(centre), r * cos(2.0 * PELL_PI * u[4]), dvec3_widen(t));
        *origin =
            dvec3_narrow(dvec3_mad(dvec3_mad(aside, r * sin(2.0 * PELL_PI * u[4]), dvec3_widen(b)), back, dvec3_widen(sample->toward)));
        *pdf /= PELL_PI * radius * radius;
    } else {
        const struct grid grid = grid_of(l, centre, radius, sample->at);
        *direction = grid_sample(&grid, u[3], u[4]);
        *origin = sample->at;
        *pdf *= grid.cosine ? grid_density(&grid, *direction) : 1.0 / (2.0 * PELL_PI * grid.versed);
    }
    *pdf *= share;
    power_along(light_sampler, sample, *direction, *origin, power);
    for (int c = 0; c < 3; c++)
        weight[c] = (double) power[c] * (l->area > 0.0 ? (double) vec3_dot(sample->normal, *direction) : 1.0) / *pdf;
    return *pdf > 0.0 && weight[0] + weight[1] + weight[2] > 0.0;
}

double pell_light_sampler_emit_pdf(const struct pell_light_sampler *light_sampler, struct pell_vec3 centre, double radius,
                                   const struct pell_light_sample *sample, struct pell_vec3 direction, struct pell_vec3 target)
{
    const struct sampled_light *l = &light_sampler->list[sample->source];
    const double share = chance(light_sampler, sample->source, centre, radius * radius), place = place_density(light_sampler, sample);
    struct pell_dvec3 d;
    struct grid grid;

    if (!sample->away) {
        grid = grid_of(l, centre, radius, sample->at);
        return share * place * grid_density(&grid, direction);
    }
    d = dvec3_between(target, centre);
    d = dvec3_mad(d, -dvec3_dot(d, dvec3_widen(sample->toward)), dvec3_widen(sample->toward));
    return dvec3_dot(d, d) <= radius * radius * (1.0 + 1e-6) ? share * place / (PELL_PI * radius * radius) : 0.0;
}
