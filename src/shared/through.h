/* SPDX-License-Identifier: MIT
 * through.h - light that passes media into their shadows (render/unscattered/stage.h): limits of a ray that is followed through them. */
#ifndef PELL_SHARED_THROUGH_H
#define PELL_SHARED_THROUGH_H

#include "shared/language.h"

#define PELL_THROUGH_SURFACES 8          /* largest number on a ray */
#define PELL_THROUGH_NESTING 4           /* nested solids */
#define PELL_THROUGH_LEAST 0.0009765625f /* transmittance of the clearest channel below which a light is dropped, */
#define PELL_THROUGH_AMBIENT 0.015625f   /* and an environment's smooth part */
#define PELL_THROUGH_STEP 1e-5f          /* least distance between two surfaces, relative to their coordinates */

#define PELL_THROUGH_WHOLE 4096u /* unit of the count of an environment's directions */

/* Count of a direction from which this fraction of the light arrives. */
PELL_SHARED uint32_t pell_through_ambient(float r, float g, float b)
{
    return PELL_TO_UINT((r + g + b) * (0.333333333f * PELL_TO_FLOAT(PELL_THROUGH_WHOLE)) + 0.5f);
}

/* Where a ray goes on after a hit at t; `largest`: of its origin's coordinates, mm; `length`: of its direction. */
PELL_SHARED float pell_through_near(float t, float largest, float length)
{
    return t + PELL_THROUGH_STEP * (largest / length + t);
}

#endif
