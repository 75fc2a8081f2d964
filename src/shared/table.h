/* SPDX-License-Identifier: MIT
 *
 * table.h - lookup and interpolation in the tables that pixels read. A position is a real number with entry i at i; the cell is the integer
 * below it, at most the last but one, and the fraction is position - cell.
 */
#ifndef PELL_SHARED_TABLE_H
#define PELL_SHARED_TABLE_H

#include "shared/language.h"

/* Position of a cosine in [0, 1], in a table whose entry i is for mu = (i / (entries - 1))^2: directional albedos, smooth boundaries. */
PELL_SHARED float pell_cosine_coord(float mu, int32_t entries)
{
    return sqrtf(mu) * PELL_TO_FLOAT(entries - 1);
}

/* Position of a roughness, in a table whose entries are uniform from `lowest` to 1. */
PELL_SHARED float pell_roughness_coord(float roughness, float lowest, int32_t entries)
{
    const float y = (roughness - lowest) * (PELL_TO_FLOAT(entries - 1) / (1.0f - lowest)), above = y > 0.0f ? y : 0.0f;
    return above < PELL_TO_FLOAT(entries - 1) ? above : PELL_TO_FLOAT(entries - 1);
}

/* Position of a distance d >= 0 through the medium, mm, in a table whose entry i is for d = max_mm (i / (entries - 1))^2 (struct
 * pell_thickness_table). No light travels farther than max_mm: pell_thickness_transmission. */
PELL_SHARED float pell_thickness_coord(float d_mm, float max_mm, int32_t entries)
{
    return sqrtf(d_mm / max_mm) * PELL_TO_FLOAT(entries - 1);
}

PELL_SHARED int32_t pell_table_cell(float coord, int32_t entries)
{
    const float last = PELL_TO_FLOAT(entries - 2);
    return PELL_TO_INT(coord < last ? coord : last);
}

/* a at f = 0, b at f = 1 except for rounding. */
PELL_SHARED float pell_lerp(float a, float b, float f)
{
    return a + f * (b - a);
}

/* Interpolates four entries: a and b of the first row, c and d of the second, f along a row, g from the first row to the second. */
PELL_SHARED float pell_bilinear(float a, float b, float c, float d, float f, float g)
{
    return pell_lerp(pell_lerp(a, b, f), pell_lerp(c, d, f), g);
}

/* Transmitted fraction at a position in the thickness table, from the values of its cell and the next. */
PELL_SHARED float pell_thickness_transmission(float value, float next, float coord, int32_t entries)
{
    const float result = pell_lerp(value, next, coord - PELL_TO_FLOAT(pell_table_cell(coord, entries)));
    return coord < PELL_TO_FLOAT(entries - 1) ? result : 0.0f;
}

#endif
