/* SPDX-License-Identifier: MIT
 *
 * environment_sampling.c - importance sampling of environments by luminance x sin(theta), bilinear between texel centres like the lookup:
 * cells between four centres, half cells at the poles. Cells of a row are chosen by integers, so that the density equals the exact
 * probability of a cell.
 */
#include "lights/environment_sampling.h"
#include "image/color.h"
#include "lights/environment_map.h"

#include <string.h>

struct pell_sampled_environment {
    struct pell_environment env;
    int width, height;           /* of the image; 0: constant */
    double *rows;                /* cumulative distribution over rows of cells; height + 1 entries */
    uint32_t *columns;           /* per row: cumulative distribution over its cells, scaled by 2^32, minus 1 */
    double energy;               /* luminance integrated over the sphere, W/m^2 */
    double fraction, cumulative; /* fraction of all environments' energy; and cumulative, including this one */
};

/* Luminance of a texel, sanitised like in the lookup. */
static double texel(const struct pell_sampled_environment *s, int x, int y)
{
    float rgba[4];

    pell_image_texel(&s->env.image->image, x, y, rgba);
    pell_environment_clean(&s->env, rgba);
    return (double) pell_luminance(rgba);
}

/* Boundaries of rows of cells: 0, 1/2h, 3/2h, ..., 1. */
static double row_start(const struct pell_sampled_environment *s, int row)
{
    return row == 0 ? 0.0 : row > s->height ? 1.0 : (row - 0.5) / s->height;
}

/* Density over (u, v) at the four corners of a cell: upper left, upper right, lower left, lower right. */
static double cell_corners(const struct pell_sampled_environment *s, int column, int row, double f[4])
{
    const int next = column + 1 < s->width ? column + 1 : 0, above = row > 0 ? row - 1 : 0, below = row < s->height ? row : s->height - 1;
    const double upper = sin(PELL_PI * row_start(s, row)), lower = row < s->height ? sin(PELL_PI * row_start(s, row + 1)) : 0.0;

    f[0] = upper > 0.0 ? upper * texel(s, column, above) : 0.0;
    f[1] = upper > 0.0 ? upper * texel(s, next, above) : 0.0;
    f[2] = lower > 0.0 ? lower * texel(s, column, below) : 0.0;
    f[3] = lower > 0.0 ? lower * texel(s, next, below) : 0.0;
    return 0.25 * (f[0] + f[1] + f[2] + f[3]);
}

static enum pell_result make_table(struct pell_context *ctx, struct pell_sampled_environment *s)
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
        /* Each cell gets at least one of the 2^32 integers. */
        for (int x = 0; x < w; x++) {
            const double fraction = x == w - 1 ? 1.0 : total > 0.0 ? line[x] / total : (x + 1.0) / w;
            columns[x] = (uint32_t) (fraction * (4294967296.0 - w)) + (uint32_t) x;
        }
        s->rows[y] = sum += total / w * (row_start(s, y + 1) - row_start(s, y));
    }
    pell_free(ctx, line);
    for (int y = 0; y <= h && sum > 0.0; y++)
        s->rows[y] = y == h ? 1.0 : s->rows[y] / sum;
    s->energy = sum * 2.0 * PELL_PI * PELL_PI;
    return PELL_OK;
}

/* Samples [0, 1] with a density that is linear from a to b. */
static double linear_sample(double u, double a, double b)
{
    const double root = sqrt(a * a + u * (b * b - a * a));
    return a + root > 0.0 ? fmin(u * (a + b) / (a + root), 1.0) : u;
}

/* Per sr, at (s, t) in [0, 1]^2 of a cell. */
static double cell_density(const struct pell_sampled_environment *k, int column, int row, const double f[4], double mean, double s,
                           double t)
{
    const uint32_t *columns = k->columns + (size_t) row * (size_t) k->width;
    const double probability = (columns[column] - (column > 0 ? (double) columns[column - 1] : -1.0)) * (1.0 / 4294967296.0);
    const double top = row_start(k, row), height = row_start(k, row + 1) - top, sine = sin(PELL_PI * (top + t * height));
    const double value = (1.0 - t) * ((1.0 - s) * f[0] + s * f[1]) + t * ((1.0 - s) * f[2] + s * f[3]);

    return (k->rows[row] - (row > 0 ? k->rows[row - 1] : 0.0)) * probability * (mean > 0.0 ? value / mean : 1.0) * k->width /
           (height * 2.0 * PELL_PI * PELL_PI * fmax(sine, 1e-12));
}

static double environment_density(const struct pell_sampled_environment *k, struct pell_vec3 direction)
{
    double f[4], mean, x, y;
    float u, v;
    int column, row;

    if (k->width == 0)
        return 0.25 / PELL_PI;
    pell_environment_uv(&k->env, direction, &u, &v);
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

static struct pell_vec3 environment_sample(const struct pell_sampled_environment *k, double u, double v)
{
    int low = 0, high = k->height, row;
    double f[4], s, t, before;
    uint64_t target;

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
    target = (uint64_t) v;
    low = 0;
    high = k->width - 1;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (k->columns[(size_t) row * (size_t) k->width + (size_t) middle] >= target)
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

double pell_environment_sampler_density(const struct pell_environment_sampler *e, struct pell_vec3 direction)
{
    double density = 0.0;

    for (size_t i = 0; i < e->count; i++)
        density += e->list[i].fraction * environment_density(&e->list[i], direction);
    return density;
}

void pell_environment_sampler_radiance(const struct pell_environment_sampler *e, struct pell_vec3 direction, float rgb[3])
{
    memset(rgb, 0, 3 * sizeof(*rgb));
    for (size_t i = 0; i < e->count; i++) {
        float one[3];
        pell_environment_radiance(&e->list[i].env, direction, one);
        for (int c = 0; c < 3; c++)
            rgb[c] += one[c];
    }
}

struct pell_vec3 pell_environment_sampler_sample(const struct pell_environment_sampler *e, double choice, double u, double v)
{
    size_t k = 0;

    while (k + 1 < e->count && !(choice < e->list[k].cumulative && e->list[k].fraction > 0.0))
        k++;
    return environment_sample(&e->list[k], u, v);
}

enum pell_result pell_environment_sampler_make(struct pell_context *ctx, const struct pell_scene *scene, struct pell_environment_sampler *e)
{
    double total = 0.0, cumulative = 0.0;

    e->list = pell_calloc(ctx, scene->num_lights + 1, sizeof(*e->list));
    if (!e->list)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < scene->num_lights; i++) {
        struct pell_sampled_environment *s = &e->list[e->count];
        if (scene->lights[i].type != PELL_LIGHT_ENVIRONMENT)
            continue;
        e->count++; /* counted first, so that it is released after a failure */
        pell_environment_init(&s->env, &scene->lights[i]);
        s->energy = 4.0 * PELL_PI * (double) pell_luminance(s->env.power);
        if (s->env.image && s->energy > 0.0) {
            const enum pell_result res = make_table(ctx, s);
            if (res != PELL_OK)
                return res;
        }
        total += s->energy;
    }
    if (!(total > 0.0))
        return PELL_OK;
    for (size_t i = 0; i < e->count; i++) {
        e->list[i].fraction = e->list[i].energy / total;
        e->list[i].cumulative = cumulative += e->list[i].fraction;
    }
    e->irradiance = 0.25 * total;
    return PELL_OK;
}

void pell_environment_sampler_finish(struct pell_context *ctx, struct pell_environment_sampler *e)
{
    for (size_t i = 0; i < e->count; i++) {
        pell_free(ctx, e->list[i].rows);
        pell_free(ctx, e->list[i].columns);
    }
    pell_free(ctx, e->list);
}
