/* SPDX-License-Identifier: MIT
 *
 * wide_light.h - solid-angle sampling of rectangular lights that fill much of a point's view: samples by area would be rare and bright
 * where the light is near. Spherical rectangle of C. Urena, M. Fajardo and A. King, "An Area-Preserving Parametrization for Spherical
 * Rectangles", Computer Graphics Forum 32(4), 2013: the point is the origin, the rectangle extends from (x0, y0) to (x1, y1) in the plane
 * at -h.
 */
#ifndef PELL_SHARED_WIDE_LIGHT_H
#define PELL_SHARED_WIDE_LIGHT_H

#include "shared/sampling.h"
#ifndef __STDC_VERSION__
#include "shared/elementary.glsl"
#endif

/* Area of a light over its squared distance from which it is wide. */
#define PELL_WIDE_LIGHT 2.0f

struct pell_wide {
    float x0, x1, y0, y1, h;
    float g, b0, b1, angle; /* angle: sr; too small from 1e-3 down */
};

PELL_SHARED float pell_clamp1(float x)
{
    return x < -1.0f ? -1.0f : x > 1.0f ? 1.0f : x;
}

/* The light's centre is at (x, y), with these half extents, mm; h > 0. */
PELL_SHARED PELL_STRUCT(pell_wide) pell_wide_make(float x, float y, float half_x, float half_y, float h)
{
    const float x0 = x - half_x, x1 = x + half_x, y0 = y - half_y, y1 = y + half_y;
    /* Normals of the planes through the point and each side; neighbours' meet at its angles. */
    const float n0 = -y0 * (1.0f / sqrtf(h * h + y0 * y0)), n1 = x1 * (1.0f / sqrtf(h * h + x1 * x1));
    const float n2 = y1 * (1.0f / sqrtf(h * h + y1 * y1)), n3 = -x0 * (1.0f / sqrtf(h * h + x0 * x0));
    const float a0 = acosf(pell_clamp1(-n0 * n1)), a1 = acosf(pell_clamp1(-n1 * n2));
    const float a2 = acosf(pell_clamp1(-n2 * n3)), a3 = acosf(pell_clamp1(-n3 * n0));
    PELL_STRUCT(pell_wide) w;

    w.x0 = x0;
    w.x1 = x1;
    w.y0 = y0;
    w.y1 = y1;
    w.h = h;
    w.b0 = n0;
    w.b1 = n2;
    w.g = 2.0f * PELL_PI_F - a2 - a3;
    w.angle = a0 + a1 - w.g;
    return w;
}

/* Position of a sample on the light, in half extents. */
PELL_SHARED PELL_STRUCT(pell_point2) pell_wide_sample(PELL_STRUCT(pell_wide) w, float u, float v)
{
    const float phi = u * w.angle + w.g, f = (cosf(phi) * w.b0 - w.b1) / sinf(phi);
    const float c = pell_clamp1((f > 0.0f ? 1.0f : -1.0f) / sqrtf(f * f + w.b0 * w.b0)), s2 = fmaxf(1.0f - c * c, 1e-12f);
    const float at_x = fminf(fmaxf(c * w.h / sqrtf(s2), w.x0), w.x1), d2 = at_x * at_x + w.h * w.h;
    const float h0 = w.y0 / sqrtf(d2 + w.y0 * w.y0), h1 = w.y1 / sqrtf(d2 + w.y1 * w.y1), h = h0 + v * (h1 - h0);
    const float at_y = h * h < 0.999999f ? fminf(fmaxf(h * sqrtf(d2 / (1.0f - h * h)), w.y0), w.y1) : w.y1;
    PELL_STRUCT(pell_point2) p;

    p.x = 2.0f * (at_x - w.x0) / (w.x1 - w.x0) - 1.0f;
    p.y = 2.0f * (at_y - w.y0) / (w.y1 - w.y0) - 1.0f;
    return p;
}

#endif
