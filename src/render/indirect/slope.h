/* SPDX-License-Identifier: MIT
 * slope.h - least-squares slope of a value over a plane from weighted points, and linear corrections of the weights that move their
 * centroid to the origin. */
#ifndef RENDER_INDIRECT_SLOPE_H
#define RENDER_INDIRECT_SLOPE_H

#include <math.h>
#include <stdbool.h>

#define SLOPE_LEVEL 0.05f /* regularization, of the variance of the positions: added in all directions so that collinear samples work */

/* Weighted moments of positions in a plane, and of a value there. */
struct slope_sums {
    float one, x, y, value, xx, xy, yy, x_value, y_value;
};

static inline void slope_add(struct slope_sums *l, float weight, float x, float y, float value)
{
    l->one += weight;
    l->x += weight * x;
    l->y += weight * y;
    l->value += weight * value;
    l->xx += weight * x * x;
    l->xy += weight * x * y;
    l->yy += weight * y * y;
    l->x_value += weight * x * value;
    l->y_value += weight * y * value;
}

/* Gradient of the value by least squares. Returns false if it is undetermined. */
static inline bool slope_fit(const struct slope_sums *l, float slope[2])
{
    const float spread = l->xx + l->yy - (l->x * l->x + l->y * l->y) / l->one;
    const float xx = l->xx - l->x * l->x / l->one + SLOPE_LEVEL * spread, yy = l->yy - l->y * l->y / l->one + SLOPE_LEVEL * spread;
    const float xy = l->xy - l->x * l->y / l->one, det = xx * yy - xy * xy;
    const float x_value = l->x_value - l->x * l->value / l->one, y_value = l->y_value - l->y * l->value / l->one;

    if (!(det > 0.0f))
        return false;
    slope[0] = (yy * x_value - xy * y_value) / det;
    slope[1] = (xx * y_value - xy * x_value) / det;
    return true;
}

/* Finds `slope` so that the weights times 1 + slope . (x, y) have their centroid at the origin, or near it if its length would exceed
 * `max_slope`. */
static inline void slope_centre(const struct slope_sums *l, float max_slope, float slope[2])
{
    const float level = SLOPE_LEVEL * (l->xx + l->yy), xx = l->xx + level, yy = l->yy + level, det = xx * yy - l->xy * l->xy;
    float length;

    slope[0] = slope[1] = 0.0f;
    if (!(det > 0.0f))
        return;
    slope[0] = (l->xy * l->y - yy * l->x) / det;
    slope[1] = (l->xy * l->x - xx * l->y) / det;
    length = sqrtf(slope[0] * slope[0] + slope[1] * slope[1]);
    if (length > max_slope) {
        slope[0] *= max_slope / length;
        slope[1] *= max_slope / length;
    }
}

#endif
