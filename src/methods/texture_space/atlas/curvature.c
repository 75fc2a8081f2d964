/* SPDX-License-Identifier: MIT
 *
 * curvature.c - geodesic curvature of the lines of texels, and the tilt of the blur's taps that compensates for it.
 */
#include "methods/texture_space/atlas/internal.h"

#include "base/pool.h"

/* The end of a line of texels along x, or perpendicular to it. */
struct line_end {
    struct pell_vec3 end;
    float length; /* mm */
};

/* Follows a line for up to `steps` texels within a chart; false: it ends before half of them. */
static bool follow_line(const struct ts_atlas_build *b, int x, int y, int axis, int sign, int steps, struct line_end *out)
{
    const struct ts_atlas *a = b->a;
    const ptrdiff_t from = y * a->stride + x;
    const float skew = axis == 0 ? 0.0f : a->cells[(ptrdiff_t) y * a->blocks + x / TS_BLOCK].skew;
    float last = a->length[axis][from];
    int done = 0;

    out->length = 0.0f;
    out->end = b->texel_position[from];
    for (int j = 1; j <= steps; j++) {
        const int px = axis == 0 ? x + sign * j : x + (int) floorf(0.5f - skew * (float) (sign * j)), py = axis == 0 ? y : y + sign * j;
        const ptrdiff_t at = py * a->stride + px;
        if (px < 0 || py < 0 || px >= a->width || py >= a->height || a->key[at] != a->key[from])
            break;
        if (vec3_length(vec3_sub(b->texel_position[at], out->end)) > a->length[0][at] + a->length[1][at])
            break; /* two edges' borders touch */
        out->length += 0.5f * (last + a->length[axis][at]);
        last = a->length[axis][at];
        out->end = b->texel_position[at];
        done = j;
    }
    return 2 * done > steps;
}

/* Second derivative of the position along a line of texels. */
static struct pell_vec3 bend_of(const struct ts_atlas_build *b, int x, int y, int axis, int steps)
{
    const struct pell_vec3 at = b->texel_position[y * b->a->stride + x];
    struct line_end line[2];

    if (!follow_line(b, x, y, axis, 1, steps, &line[0]) || !follow_line(b, x, y, axis, -1, steps, &line[1]))
        return vec3(0.0f, 0.0f, 0.0f);
    return vec3_mul(
        vec3_add(vec3_mul(vec3_sub(line[0].end, at), 1.0f / line[0].length), vec3_mul(vec3_sub(line[1].end, at), 1.0f / line[1].length)),
        2.0f / (line[0].length + line[1].length));
}

/* In texels. */
static float tilt_of(struct pell_vec3 bend, struct pell_vec3 dir, float length, float most)
{
    return clamp_tilt(-0.5f * vec3_dot(bend, vec3_normalize(dir)) * length, most);
}

/* Blurs follow straight lines of the layout, which are not geodesics of the surface: their taps drift aside by s^2/2 times the geodesic
 * curvature. Diffusion along the surface has no such drift (the Laplacian of the position is normal to the surface), so taps on the other
 * side get more weight, until their mean is centred. */
static void tilt_rows(void *arg, int band, int worker)
{
    const struct ts_atlas_build *b = arg;
    const struct ts_atlas *a = b->a;
    const int steps = b->p->border > 2 * TAPS_SIGMAS ? b->p->border / TAPS_SIGMAS : 2;

    (void) worker;
    for (int y = band * BAND; y < (band + 1) * BAND && y < a->height && !pell_cancelled(b->ctx); y++)
        for (int x = 0; x < a->width; x++) {
            const ptrdiff_t at = y * a->stride + x;
            struct pell_vec3 along, down, p[3], e[2];
            struct ts_flat f;
            if (a->source[at] == NONE || !flatten(a->corners[a->source[at]], &f))
                continue;
            corner_points(a, a->source[at], p);
            e[0] = vec3_sub(p[1], p[0]);
            e[1] = vec3_sub(p[2], p[0]);
            along = vec3_mad(vec3_mul(e[0], (float) f.u[1]), (float) f.v[1], e[1]);
            down = vec3_mad(vec3_mul(e[0], (float) f.u[2]), (float) f.v[2], e[1]);
            down = vec3_mad(down, -a->skew[at], along);
            a->tilt[0][at] = tilt_of(bend_of(b, x, y, 1, steps), along, a->length[0][at], MAX_TILT / (float) steps);
            a->tilt[1][at] = tilt_of(bend_of(b, x, y, 0, steps), down, a->length[1][at], MAX_TILT / (float) steps);
        }
}

void ts_atlas_tilt(struct ts_atlas_build *b)
{
    pell_pool_run(b->p->pool, (b->a->height + BAND - 1) / BAND, tilt_rows, b);
}
