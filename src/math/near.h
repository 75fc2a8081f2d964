/* SPDX-License-Identifier: MIT
 *
 * near.h - distances between points, segments and triangles, in double precision.
 */
#ifndef PELL_NEAR_H
#define PELL_NEAR_H

#include "math/vec.h"

#include <stdbool.h>

/* Squared distance from the point a + d to the segment from a to a + e; *t in [0, 1]: parameter of the nearest point. */
static inline double pell_segment_distance2(struct pell_dvec3 d, struct pell_dvec3 e, double *t)
{
    const double ee = dvec3_dot(e, e), along = ee > 0.0 ? dvec3_dot(d, e) / ee : 0.0;
    struct pell_dvec3 off;

    *t = along > 0.0 ? along < 1.0 ? along : 1.0 : 0.0;
    off = dvec3_mad(d, -*t, e);
    return dvec3_dot(off, off);
}

/* Squared distance from the point p0 + d to the triangle of edges e, f from p0, and the barycentrics of the nearest point: the projection
 * if it is inside, else on the nearest side. */
static inline double pell_triangle_distance2(struct pell_dvec3 d, struct pell_dvec3 e, struct pell_dvec3 f, double *u, double *v)
{
    const double ee = dvec3_dot(e, e), ef = dvec3_dot(e, f), ff = dvec3_dot(f, f), de = dvec3_dot(d, e), df = dvec3_dot(d, f);
    const double det = ee * ff - ef * ef, pu = ff * de - ef * df, pv = ee * df - ef * de;
    struct pell_dvec3 h;
    double best, d2, t;

    if (pu > 0.0 && pv > 0.0 && pu + pv < det) {
        *u = pu / det;
        *v = pv / det;
        h = dvec3_mad(dvec3_mad(d, -*u, e), -*v, f);
        return dvec3_dot(h, h);
    }
    best = pell_segment_distance2(d, e, &t);
    *u = t;
    *v = 0.0;
    d2 = pell_segment_distance2(d, f, &t);
    if (d2 < best) {
        best = d2;
        *u = 0.0;
        *v = t;
    }
    d2 = pell_segment_distance2(dvec3_sub(d, e), dvec3_sub(f, e), &t);
    if (d2 < best) {
        best = d2;
        *u = 1.0 - t;
        *v = t;
    }
    return best;
}

/* Squared distance between the segments from 0 along d and from a along e (Ericson 2005, section 5.1.9). */
static inline double pell_segments_distance2(struct pell_dvec3 d, struct pell_dvec3 a, struct pell_dvec3 e)
{
    const double dd = dvec3_dot(d, d), de = dvec3_dot(d, e), ee = dvec3_dot(e, e), da = dvec3_dot(d, a), ea = dvec3_dot(e, a);
    const double det = dd * ee - de * de;
    struct pell_dvec3 off;
    double s = det > 0.0 ? (da * ee - ea * de) / det : 0.0, t;

    s = s > 0.0 ? s < 1.0 ? s : 1.0 : 0.0;
    t = ee > 0.0 ? (s * de - ea) / ee : 0.0;
    t = t > 0.0 ? t < 1.0 ? t : 1.0 : 0.0;
    s = dd > 0.0 ? (t * de + da) / dd : 0.0;
    s = s > 0.0 ? s < 1.0 ? s : 1.0 : 0.0;
    off = dvec3_mad(dvec3_mad(a, t, e), -s, d);
    return dvec3_dot(off, off);
}

/* Whether the segment from a to b passes through a triangle (Moller and Trumbore 1997). */
static inline bool pell_segment_pierces(struct pell_dvec3 a, struct pell_dvec3 b, const struct pell_dvec3 triangle[3])
{
    const struct pell_dvec3 e = dvec3_sub(triangle[1], triangle[0]), f = dvec3_sub(triangle[2], triangle[0]), d = dvec3_sub(b, a);
    const struct pell_dvec3 from = dvec3_sub(a, triangle[0]), p = dvec3_cross(d, f), q = dvec3_cross(from, e);
    const double det = dvec3_dot(e, p);
    double u, v, along;

    if (det == 0.0)
        return false;
    u = dvec3_dot(from, p) / det;
    v = dvec3_dot(d, q) / det;
    along = dvec3_dot(f, q) / det;
    return u >= 0.0 && v >= 0.0 && u + v <= 1.0 && along >= 0.0 && along <= 1.0;
}

/* Whether a corner of s is within a distance of t, or a side of s passes through it. */
static inline bool pell_triangle_reaches(const struct pell_dvec3 s[3], const struct pell_dvec3 t[3], double distance2)
{
    const struct pell_dvec3 e = dvec3_sub(t[1], t[0]), f = dvec3_sub(t[2], t[0]);
    double u, v;

    for (int k = 0; k < 3; k++)
        if (pell_triangle_distance2(dvec3_sub(s[k], t[0]), e, f, &u, &v) <= distance2 || pell_segment_pierces(s[k], s[(k + 1) % 3], t))
            return true;
    return false;
}

/* Whether two triangles are within a distance of each other, given squared. */
static inline bool pell_triangles_touch(const struct pell_dvec3 s[3], const struct pell_dvec3 t[3], double distance2)
{
    if (pell_triangle_reaches(s, t, distance2) || pell_triangle_reaches(t, s, distance2))
        return true;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            if (pell_segments_distance2(dvec3_sub(s[(i + 1) % 3], s[i]), dvec3_sub(t[k], s[i]), dvec3_sub(t[(k + 1) % 3], t[k])) <=
                distance2)
                return true;
    return false;
}

#endif
