/* SPDX-License-Identifier: MIT
 *
 * triangle_ray.h - watertight ray-triangle intersection, so that no ray slips between triangles that share an edge: S. Woop, C. Benthin and
 * I. Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013; and a conservative ray-box test.
 *
 * Both triangles at an edge compute the same values for its ends: these are transformed by the ray alone, and no product is contracted
 * (PELL_PRECISE). An edge that the ray hits exactly belongs to both.
 *
 * Units    of the ray: t is in units of its direction, which need not be unit.
 */
#ifndef PELL_SHARED_TRIANGLE_RAY_H
#define PELL_SHARED_TRIANGLE_RAY_H

#include "shared/language.h"

PELL_SHARED float pell_component(float x, float y, float z, int32_t k)
{
    return k == 0 ? x : k == 1 ? y : z;
}

/* Shear that maps a ray to the z axis: index of its longest axis, the two others in an order that keeps the winding, and the shear. */
struct pell_ray_shear {
    int32_t kx, ky, kz;
    float sx, sy, sz;
};

PELL_SHARED PELL_STRUCT(pell_ray_shear) pell_ray_shear_of(float dx, float dy, float dz)
{
    const float ax = dx < 0.0f ? -dx : dx, ay = dy < 0.0f ? -dy : dy, az = dz < 0.0f ? -dz : dz;
    const int32_t kz = ax > ay ? (ax > az ? 0 : 2) : ay > az ? 1 : 2;
    const int32_t next = kz == 2 ? 0 : kz + 1, last = next == 2 ? 0 : next + 1;
    const float along = pell_component(dx, dy, dz, kz);
    PELL_STRUCT(pell_ray_shear) shear;

    shear.kx = along < 0.0f ? last : next;
    shear.ky = along < 0.0f ? next : last;
    shear.kz = kz;
    shear.sx = pell_component(dx, dy, dz, shear.kx) / along;
    shear.sy = pell_component(dx, dy, dz, shear.ky) / along;
    shear.sz = 1.0f / along;
    return shear;
}

struct pell_ray_point {
    float x, y, z;
};

/* Transforms a corner; (x, y, z) is relative to the ray's origin. */
PELL_SHARED PELL_STRUCT(pell_ray_point) pell_ray_shear_point(PELL_STRUCT(pell_ray_shear) shear, float x, float y, float z)
{
    const float along = pell_component(x, y, z, shear.kz);
    PELL_PRECISE PELL_STRUCT(pell_ray_point) p;

    p.x = pell_component(x, y, z, shear.kx) - shear.sx * along;
    p.y = pell_component(x, y, z, shear.ky) - shear.sy * along;
    p.z = shear.sz * along;
    return p;
}

struct pell_triangle_hit {
    float t;    /* distance along the ray; negative: no hit */
    float u, v; /* barycentric: (1 - u - v) a + u b + v c */
    float side; /* > 0 if the corners run counterclockwise, seen from the origin */
};

/* Intersects the whole line: the caller checks the ray's interval. */
PELL_SHARED PELL_STRUCT(pell_triangle_hit)
    pell_triangle_intersect(PELL_STRUCT(pell_ray_point) a, PELL_STRUCT(pell_ray_point) b, PELL_STRUCT(pell_ray_point) c)
{
    PELL_PRECISE const float of_a = c.x * b.y - c.y * b.x, of_b = a.x * c.y - a.y * c.x, of_c = b.x * a.y - b.y * a.x;
    const float det = of_a + of_b + of_c;
    PELL_STRUCT(pell_triangle_hit) m;

    m.t = -1.0f;
    m.u = m.v = 0.0f;
    m.side = det;
    if (((of_a < 0.0f || of_b < 0.0f || of_c < 0.0f) && (of_a > 0.0f || of_b > 0.0f || of_c > 0.0f)) || det == 0.0f)
        return m;
    m.t = (of_a * a.z + of_b * b.z + of_c * c.z) / det;
    m.u = of_b / det;
    m.v = of_c / det;
    return m;
}

/* 1/d for boxes: for 0 a number so large that only the sides of a box matter. */
PELL_SHARED float pell_ray_inverse(float d)
{
    return d > 1e-30f || d < -1e-30f ? 1.0f / d : d < 0.0f ? -1e30f : 1e30f;
}

/* Interval of a ray between a pair of planes, lo and hi relative to its origin. */
#define PELL_SLAB_NEAR(lo, hi, inverse) ((inverse) < 0.0f ? (hi) * (inverse) : (lo) * (inverse))
#define PELL_SLAB_FAR(lo, hi, inverse) ((inverse) < 0.0f ? (lo) * (inverse) : (hi) * (inverse))
#define PELL_SLAB_WIDER 1.000002f /* more than what the quotients lose, each within 2.5 ulp */

#endif
