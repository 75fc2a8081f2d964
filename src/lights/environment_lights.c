/* SPDX-License-Identifier: MIT
 *
 * environment_lights.c - directional lights for the parts of an environment above a luminance clamp: the image is split where energy times
 * angular variance is largest, at the median of the energy (after Debevec 2005, "A Median Cut Algorithm for Light Probe Sampling"). Each
 * light is as wide as its region: its samples come from a rectangle of directions with the same mean and variances, so that shadows have
 * the region's penumbra. No random numbers: the same image gives the same lights. */
#include "lights/environment_map.h"

#include <string.h>

#define CLAMP 2.0f   /* relative to the mean luminance: light below it stays in the smooth table */
#define COMPACT 2e-4 /* 1 - |mean direction|: half the variance of the angle; 1.15 degrees */

struct region {
    int x0, y0, x1, y1;
    double energy, direction[3], rgb[3]; /* of the excess; direction weighted by energy */
};

/* The fraction of a texel's light above the clamp. */
static double excess(const float *rgb, float clamp)
{
    const float l = pell_luminance(rgb);
    return l > clamp ? 1.0 - (double) clamp / l : 0.0;
}

static double texel_energy(const struct pell_env_map *m, float clamp, int x, int y)
{
    const float *p = m->rgb + 3 * ((size_t) y * (size_t) m->width + (size_t) x);
    return excess(p, clamp) * pell_luminance(p) * m->solid_angle_row[y];
}

static void measure(const struct pell_env_map *m, float clamp, struct region *r)
{
    r->energy = 0.0;
    memset(r->direction, 0, sizeof(r->direction));
    memset(r->rgb, 0, sizeof(r->rgb));
    for (int y = r->y0; y < r->y1; y++)
        for (int x = r->x0; x < r->x1; x++) {
            const float *p = m->rgb + 3 * ((size_t) y * (size_t) m->width + (size_t) x);
            const double fraction = excess(p, clamp) * m->solid_angle_row[y], e = fraction * pell_luminance(p);
            if (fraction > 0.0) {
                const struct pell_vec3 d = pell_env_map_direction(m, x, y);
                r->energy += e;
                r->direction[0] += e * d.x;
                r->direction[1] += e * d.y;
                r->direction[2] += e * d.z;
                for (int c = 0; c < 3; c++)
                    r->rgb[c] += fraction * p[c];
            }
        }
}

static double region_length(const struct region *r)
{
    return sqrt(r->direction[0] * r->direction[0] + r->direction[1] * r->direction[1] + r->direction[2] * r->direction[2]);
}

/* Splits r at the median of its energy across the longer side; false: it can't be split. */
static bool split_region(const struct pell_env_map *m, float clamp, struct region *r, struct region *other)
{
    const double across = (r->x1 - r->x0) * 2.0 * PELL_PI / m->width * m->sin_row[(r->y0 + r->y1 - 1) / 2];
    const double down = (r->y1 - r->y0) * PELL_PI / m->height;
    const bool columns = r->x1 - r->x0 > 1 && (across >= down || r->y1 - r->y0 < 2);
    const int first = columns ? r->x0 : r->y0, last = columns ? r->x1 : r->y1;
    int at = first + 1;
    double sum = 0.0;

    if (last - first < 2)
        return false;
    for (int i = first; i < last - 1; i++) {
        if (columns)
            for (int y = r->y0; y < r->y1; y++)
                sum += texel_energy(m, clamp, i, y);
        else
            for (int x = r->x0; x < r->x1; x++)
                sum += texel_energy(m, clamp, x, i);
        at = i + 1;
        if (sum >= 0.5 * r->energy)
            break;
    }
    *other = *r;
    if (columns)
        r->x1 = other->x0 = at;
    else
        r->y1 = other->y0 = at;
    measure(m, clamp, r);
    measure(m, clamp, other);
    return true;
}

/* Half extents of the rectangle of directions around source->direction: uniform over it, directions have the same variances as the region's
 * light. */
static void set_extent(const struct pell_env_map *m, float clamp, const struct region *r, struct pell_light_source *source)
{
    struct pell_vec3 t, b;
    double tt = 0.0, tb = 0.0, bb = 0.0, angle, mean, half_difference; /* the last two: of the eigenvalues of the covariance */

    vec3_basis(source->direction, &t, &b);
    for (int y = r->y0; y < r->y1; y++)
        for (int x = r->x0; x < r->x1; x++) {
            const double e = texel_energy(m, clamp, x, y) / r->energy;
            if (e > 0.0) {
                const struct pell_vec3 d = pell_env_map_direction(m, x, y);
                const double dt = vec3_dot(d, t), db = vec3_dot(d, b);
                tt += e * dt * dt;
                tb += e * dt * db;
                bb += e * db * db;
            }
        }
    angle = 0.5 * atan2(2.0 * tb, tt - bb);
    mean = 0.5 * (tt + bb);
    half_difference = sqrt(0.25 * (tt - bb) * (tt - bb) + tb * tb);
    source->right = vec3_mad(vec3_mul(t, (float) cos(angle)), (float) sin(angle), b);
    source->up = vec3_cross(source->right, source->direction);
    source->right = vec3_mul(source->right, (float) sqrt(3.0 * (mean + half_difference)));
    source->up = vec3_mul(source->up, (float) sqrt(3.0 * fmax(mean - half_difference, 0.0)));
}

static void add_region(const struct pell_env_map *m, float clamp, struct pell_environment_lights *out, const struct region *r, int index)
{
    const double length = region_length(r);
    struct pell_light_source source = { .type = PELL_LIGHT_DIRECTIONAL, .scale = 1.0f, .samples = 1, .environment = index };

    if (!(r->energy > 0.0) || !(length > 1e-6 * r->energy))
        return; /* nearly isotropic light is left to the table */
    source.direction = vec3_normalize(vec3((float) -r->direction[0], (float) -r->direction[1], (float) -r->direction[2]));
    set_extent(m, clamp, r, &source);
    source.compact = 1.0 - length / r->energy < COMPACT;
    for (int c = 0; c < 3; c++)
        source.power[c] = (float) r->rgb[c];
    out->sources[out->count++] = source;
}

enum pell_result pell_environment_light_sources(struct pell_context *ctx, const struct pell_env_map *m, int index, int max_sources,
                                                struct pell_environment_lights *out)
{
    struct region *regions;
    double mean = 0.0;
    float clamp;
    int count = 1;

    *out = (struct pell_environment_lights) { 0 };
    for (int y = 0; y < m->height; y++) {
        double row = 0.0;
        for (int x = 0; x < m->width; x++)
            row += pell_luminance(m->rgb + 3 * ((size_t) y * (size_t) m->width + (size_t) x));
        mean += row * m->solid_angle_row[y] / (4.0 * PELL_PI);
    }
    clamp = (float) (CLAMP * mean);
    if (max_sources < 1 || !(mean > 0.0))
        return PELL_OK;
    regions = pell_calloc(ctx, (size_t) max_sources, sizeof(*regions));
    out->sources = regions ? pell_calloc(ctx, (size_t) max_sources, sizeof(*out->sources)) : NULL;
    if (!out->sources) {
        pell_free(ctx, regions);
        return PELL_ERR_NOMEM;
    }
    regions[0] = (struct region) { .x1 = m->width, .y1 = m->height };
    measure(m, clamp, &regions[0]);
    if (regions[0].energy < 0.005 * mean * 4.0 * PELL_PI)
        count = 0; /* a uniform environment has nothing to extract */
    while (count > 0 && count < max_sources) {
        struct region other;
        int best = 0;
        double largest = -1.0;
        for (int i = 0; i < count; i++) {
            const double variance = regions[i].energy - region_length(&regions[i]); /* energy x half the variance of the angle */
            if (variance > largest) {
                largest = variance;
                best = i;
            }
        }
        if (largest <= 1e-6 * regions[0].energy || !split_region(m, clamp, &regions[best], &other))
            break;
        memmove(&regions[best + 2], &regions[best + 1], (size_t) (count - best - 1) * sizeof(*regions)); /* halves are adjacent */
        regions[best + 1] = other;
        count++;
    }
    for (int i = 0; i < count; i++)
        add_region(m, clamp, out, &regions[i], index);
    pell_free(ctx, regions);
    return PELL_OK;
}
