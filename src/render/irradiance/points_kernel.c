/* SPDX-License-Identifier: MIT
 * points_kernel.c - see points_kernel.h. */
#include "render/irradiance/points_kernel.h"

#include "math/lanes.h"

#ifndef PELL_SIMD_NAME
#define PELL_SIMD_NAME base
#endif

static void position(const struct pell_triangles16 *t, struct pell_ray_hit16 *packet, float (*position)[16])
{
    struct pell_ray16 *ray = &packet->ray;
    struct pell_hit16 *hit = &packet->hit;

    for (int i = 0; i < 16; i += WIDTH) {
        const vf u = load(t->u + i), v = load(t->v + i), side = load(t->side + i);
        vf b[3], c[3], g[3], n[3], largest = { 0 }, length, scale;
        for (int k = 0; k < 3; k++) {
            const vf a = load(t->corner[0][k] + i);
            b[k] = load(t->corner[1][k] + i) - a;
            c[k] = load(t->corner[2][k] + i) - a;
            store(position[k] + i, (a + u * b[k]) + v * c[k]);
            largest = vmax(largest, vmax(vabs(a), vmax(vabs(a + b[k]), vabs(a + c[k])))); /* as rounded as that */
        }
        for (int k = 0; k < 3; k++)
            g[k] = b[(k + 1) % 3] * c[(k + 2) % 3] - b[(k + 2) % 3] * c[(k + 1) % 3];
        for (int k = 0; k < 3; k++)
            n[k] = side * g[k];
        length = vsqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        scale = select(length > 0.0f, 1.0f / length, splat(1.0f));
        store(ray->dx + i, -(n[0] * scale));
        store(ray->dy + i, -(n[1] * scale));
        store(ray->dz + i, -(n[2] * scale));
        store(ray->tfar + i, largest);
        store(hit->ngx + i, g[0]);
        store(hit->ngy + i, g[1]);
        store(hit->ngz + i, g[2]);
        store(hit->u + i, u);
        store(hit->v + i, v);
    }
}

extern const struct pell_points_kernels PELL_SIMD(pell_points_kernels);
const struct pell_points_kernels PELL_SIMD(pell_points_kernels) = { position };
