/* SPDX-License-Identifier: MIT
 *
 * bloom.h - down- and upsampling for Gaussians at a smaller size (render/post/bloom.h). Units: pixels.
 */
#ifndef PELL_SHARED_BLOOM_H
#define PELL_SHARED_BLOOM_H

#include "shared/language.h"

/* Mirrors a row or column index beyond the border of n: ... 1 0 | 0 1 ... n-1 | n-1 ... */
PELL_SHARED int pell_mirror(int32_t i, int n)
{
    const int period = 2 * n, wrapped = (i < 0 ? -1 - i : i) % period;
    return wrapped < n ? wrapped : period - 1 - wrapped;
}

/* Cell of pixel i in a grid of points f pixels apart, f even: between point `cell` and the next; -1: before the first. */
PELL_SHARED int pell_grid_cell(int32_t i, int f)
{
    return 2 * i + 1 - f < 0 ? -1 : (2 * i + 1 - f) / (2 * f);
}

/* Position of pixel i in its cell, [0, 1]. */
PELL_SHARED float pell_grid_fraction(int32_t i, int f, int cell)
{
    return (PELL_TO_FLOAT(i - (cell * f + f / 2)) + 0.5f) / PELL_TO_FLOAT(f);
}

#endif
