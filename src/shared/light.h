/* SPDX-License-Identifier: MIT
 *
 * light.h - falloff of lights, and the soft terminator. Names follow KHR_lights_punctual.
 */
#ifndef PELL_SHARED_LIGHT_H
#define PELL_SHARED_LIGHT_H

#include "shared/language.h"

/* Window of a light's range at a squared distance, mm^2: clamp(1 - (d/range)^4, 0, 1); inv_range = 0: no range. */
PELL_SHARED float pell_light_window(float d2, float inv_range)
{
    const float q = d2 * inv_range * inv_range, window = 1.0f - q * q;
    return window > 0.0f ? window : 0.0f;
}

/* scale/d^2 at a distance in mm, with the range; scale: 1e6 for W/sr, which gives W/m^2; 1 for areas in mm^2. */
PELL_SHARED float pell_light_falloff(float distance, float scale, float inv_range)
{
    const float d2 = distance * distance;
    return scale / (d2 > 1e-6f ? d2 : 1e-6f) * pell_light_window(d2, inv_range);
}

/* A spot light's factor in a direction with this cosine to its axis. */
PELL_SHARED float pell_light_cone(float cosine, float spot_scale, float spot_offset)
{
    const float s = pell_saturate(cosine * spot_scale + spot_offset);
    return s * s;
}

/* x times -G^3 + G^2 + G, G = min(1, ng.l / (n.l n.ng)): light fades out smoothly where the geometric normal turns away, and is
 * unchanged where the normals agree (Chiang, Li and Burley 2019, "Taming the Shadow Terminator"). */
PELL_SHARED float pell_soft_terminator(float x, float g)
{
    return x * g * (1.0f + g - g * g);
}

#endif
