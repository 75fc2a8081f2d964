/* SPDX-License-Identifier: MIT
 * camera.h - from pixels to the plane one millimetre before the camera, and normals that the viewer sees. Pixel (x, y) has its centre at
 * (x + 1/2, y + 1/2), y down; a sample lies (shift_x, shift_y) beside it. */
#ifndef PELL_SHARED_CAMERA_H
#define PELL_SHARED_CAMERA_H

#include "shared/language.h"

/* What a pixel's cosines to the geometric normal and to the viewer are kept above. */
#define PELL_BEND 0.01f

/* To the right of the axis. */
PELL_SHARED float pell_camera_right(float x, float shift_x, float width, float focal_px)
{
    return (x + 0.5f + shift_x - 0.5f * width) / focal_px;
}

/* Above it. */
PELL_SHARED float pell_camera_up(float y, float shift_y, float height, float focal_px)
{
    return (0.5f * height - y - 0.5f - shift_y) / focal_px;
}

/* What of a direction is added to a normal at this cosine to it, so that the viewer sees the normal: the projection onto the half-space
 * where he does. */
PELL_SHARED float pell_bend_missing(float cosine)
{
    const float missing = PELL_BEND - cosine;
    return missing > 0.0f ? missing : 0.0f;
}

#endif
