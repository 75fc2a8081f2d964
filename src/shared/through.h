/* SPDX-License-Identifier: MIT
 * through.h - light that passes media into their shadows (render/unscattered/stage.h): limits of a ray that is followed through them. */
#ifndef PELL_SHARED_THROUGH_H
#define PELL_SHARED_THROUGH_H

#include "shared/language.h"

#define PELL_THROUGH_SURFACES 8          /* largest number on a ray */
#define PELL_THROUGH_NESTING 4           /* nested solids */
#define PELL_THROUGH_LEAST 0.0009765625f /* transmittance of the clearest channel below which the light is dropped */
#define PELL_THROUGH_STEP 1e-5f          /* least distance between two surfaces, relative to their coordinates */

/* Where a ray goes on after a hit at t; `largest`: of its origin's coordinates, mm; `length`: of its direction. */
PELL_SHARED float pell_through_near(float t, float largest, float length)
{
    return t + PELL_THROUGH_STEP * (largest / length + t);
}

#endif
