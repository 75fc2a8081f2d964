/* SPDX-License-Identifier: MIT
 * sky_kernel.c - see sky_kernel.h. */
#include "render/irradiance/sky_kernel.h"

#include "render/irradiance/lanes.h"

#include <float.h>

static void make(const struct pell_lanes *restrict p, int pattern_bits, uint32_t salt, struct pell_sky *restrict s)
{
    for (int i = 0; i < N; i++) {
        pell_lane_pattern(p, i, pattern_bits, salt, s->pattern[0] + i, s->pattern[1] + i);
        s->cell[i] = pell_sky_cell(s->pattern[0][i], s->pattern[1][i], s->bits);
    }
    for (int i = 0; i < N; i++) { /* vec3_basis */
        const float x = s->normal[0][i], y = s->normal[1][i], z = s->normal[2][i];
        const float sign = copysignf(1.0f, z), a = -1.0f / (sign + z), c = x * y * a;
        s->right[0][i] = 1.0f + sign * x * x * a;
        s->right[1][i] = sign * c;
        s->right[2][i] = -sign * x;
        s->up[0][i] = c;
        s->up[1][i] = sign + y * y * a;
        s->up[2][i] = -y;
    }
}

static void rays(const struct pell_sky *restrict s, const uint32_t sequence[2][1 << PELL_SKY_BITS], uint32_t j,
                 struct pell_ray16 *restrict r)
{
    _Alignas(64) uint32_t u[N], v[N];

    for (int i = 0; i < N; i++) {
        u[i] = sequence[0][j ^ s->cell[i]] ^ s->pattern[0][i];
        v[i] = sequence[1][j ^ s->cell[i]] ^ s->pattern[1][i];
    }
    for (int i = 0; i < N; i++) {
        float x, y, z;
        pell_disc_point(pell_unit_float(u[i]), pell_unit_float(v[i]), &x, &y);
        z = 1.0f - x * x - y * y;
        z = sqrtf(z > 0.0f ? z : 0.0f);
        r->ox[i] = s->origin[0][i];
        r->oy[i] = s->origin[1][i];
        r->oz[i] = s->origin[2][i];
        r->dx[i] = s->normal[0][i] * z + x * s->right[0][i] + y * s->up[0][i];
        r->dy[i] = s->normal[1][i] * z + x * s->right[1][i] + y * s->up[1][i];
        r->dz[i] = s->normal[2][i] * z + x * s->right[2][i] + y * s->up[2][i];
        r->tnear[i] = r->time[i] = 0.0f;
        r->tfar[i] = FLT_MAX;
        r->mask[i] = PELL_RAY_ALL;
        r->id[i] = (uint32_t) i;
        r->flags[i] = 0;
    }
}

extern const struct pell_sky_kernels PELL_SIMD(pell_sky_kernels);
const struct pell_sky_kernels PELL_SIMD(pell_sky_kernels) = { make, rays };
