/* SPDX-License-Identifier: MIT
 *
 * levels.c - strength maps: each group is convolved with its profile at radii that halve from level to level, and a pixel of strength s
 * interpolates between the two nearest levels in log s:
 *
 *     M(s) = (1 - f) M(a) + f M(a/2),     f = log2(a/s),     a = 1, 1/2, 1/4, ..
 *
 * Only levels that visible pixels need are computed.
 */
#include "methods/convolution/state.h"

#include "scene/material_maps.h"

#include <pellucid/scene.h>

#define ALIKE 1e-3f /* relative to the strength: smaller variations count as constant */

static float fraction_of(float strength, int level)
{
    const float s = strength > 0.0f ? fminf(strength, 1.0f) : strength <= 0.0f ? 0.0f : 1.0f; /* NaN becomes 1 */
    const float at = s > 0.0f ? fminf(-log2f(s), (float) (CONV_LEVELS - 1)) : (float) (CONV_LEVELS - 1);

    return fmaxf(1.0f - fabsf(at - (float) level), 0.0f);
}

bool convolution_has_strength_maps(const struct pell_scene *scene)
{
    for (size_t i = 0; scene && i < scene->num_materials; i++)
        if (scene->materials[i].strength_map.texture)
            return true;
    return false;
}

void convolution_find_levels(struct convolution_state *st, float constant)
{
    struct conv_job *j = &st->job;
    const struct conv_extent *e = &j->extent;

    j->first_level = j->last_level = -1;
    constant = constant > 0.0f ? fminf(constant, 1.0f) : 1.0f;
    if (!j->in->strength || !st->knobs.strength || e->weakest > e->strongest ||
        (e->weakest >= (1.0f - ALIKE) * constant && e->strongest <= (1.0f + ALIKE) * constant))
        return;
    for (int l = CONV_LEVELS - 1; l >= 0; l--)
        if (fraction_of(e->strongest, l) > 0.0f)
            j->first_level = l;
    for (int l = 0; l < CONV_LEVELS; l++)
        if (fraction_of(e->weakest, l) > 0.0f)
            j->last_level = l;
}

void convolution_take_level(struct convolution_state *st, const struct pell_frame_material *m, size_t material, int level)
{
    struct conv_job *j = &st->job;

    j->level = level;
    j->radial = st->radial[material];
    if (level < 0)
        return;
    if (st->level_material[level] != material + 1)
        convolution_radial_make(m, exp2(-level), st->level_tables + (size_t) level * 3 * CONV_RADIAL_FLOATS, st->level_radial[level]);
    st->level_material[level] = material + 1;
    j->radial = st->level_radial[level];
}

void convolution_blend_row(const struct convolution_state *st, int y, const float *row)
{
    const struct conv_job *j = &st->job;
    const struct conv_front *f = &st->sources.front;
    const ptrdiff_t to = y * j->in->shape.stride;

    for (int x = j->extent.rect.x0; x < j->extent.rect.x1; x++) {
        float *light = &j->out->light[j->channel][to + x];
        if (f->group[y * f->stride + x] != j->group + 1)
            continue;
        *light = (j->level == j->first_level ? 0.0f : *light) + fraction_of(j->in->strength[to + x], j->level) * row[x - j->extent.rect.x0];
    }
}
