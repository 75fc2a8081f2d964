/* SPDX-License-Identifier: MIT
 * camera.h - mapping of pixels to the plane one millimetre in front of the camera, and visible normals. Pixel (x, y) has its centre at (x +
 * 1/2, y + 1/2), y down; a sample is offset by (shift_x, shift_y). */
#ifndef PELL_SHARED_CAMERA_H
#define PELL_SHARED_CAMERA_H

#include "shared/language.h"

/* Lower limit of a pixel's cosines to the geometric normal and to the viewer. */
#define PELL_MIN_VISIBLE_COSINE 0.01f

/* Position in that plane to the right of the optical axis. */
PELL_SHARED float pell_camera_right(float x, float shift_x, float width, float focal_px)
{
    return (x + 0.5f + shift_x - 0.5f * width) / focal_px;
}

/* Position in that plane above the optical axis. */
PELL_SHARED float pell_camera_up(float y, float shift_y, float height, float focal_px)
{
    return (0.5f * height - y - 0.5f - shift_y) / focal_px;
}

/* Multiple of a direction that is added to a normal with this cosine to it, so that the normal is visible: a projection onto the visible
 * half-space. */
PELL_SHARED float pell_bend_missing(float cosine)
{
    const float missing = PELL_MIN_VISIBLE_COSINE - cosine;
    return missing > 0.0f ? missing : 0.0f;
}

#endif
