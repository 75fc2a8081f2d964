/* SPDX-License-Identifier: MIT
 *
 * environment_map.h - private to the files environment*.c: a latitude-longitude image at its working resolution.
 */
#ifndef PELL_ENV_MAP_H
#define PELL_ENV_MAP_H

#include "lights/lights.h"

/* The image at one resolution, with the trigonometry of its rows and columns. */
struct pell_env_map {
    int width, height;
    float *rgb;
    float *sin_row, *cos_row;       /* of the polar angle; cos_row is y */
    float *solid_angle_row;         /* solid angle of a texel */
    float *sin_column, *cos_column; /* of the azimuth in world space: x = sin, z = -cos, times sin_row */
};

static inline struct pell_vec3 pell_env_map_direction(const struct pell_env_map *m, int x, int y)
{
    return vec3(m->sin_row[y] * m->sin_column[x], m->cos_row[y], -m->sin_row[y] * m->cos_column[x]);
}

/* environment_lookup.c: square roots of the levels' lobe widths, GGX roughness; sanitised radiance of a texel. */
extern const float pell_env_level_roughness[PELL_ENV_LEVELS];
void pell_environment_clean(const struct pell_environment *env, float rgb[3]);

/* environment_lights.c: at most `max_sources` light sources for the brightest parts of environment `index`. The caller frees out->sources,
 * which is NULL after a failure. */
PELL_NODISCARD enum pell_result pell_environment_light_sources(struct pell_context *ctx, const struct pell_env_map *map, int index,
                                                               int max_sources, struct pell_environment_lights *out);

#endif
