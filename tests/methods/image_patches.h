/* SPDX-License-Identifier: MIT
 * image_patches.h - surfaces and illumination shared by the tests of the image-space method. */
#ifndef PELL_IMAGE_PATCHES_H
#define PELL_IMAGE_PATCHES_H

#include "patch.h"

#include "methods/image_space/image_space.h"

static inline const struct pell_method *method(struct pell_context *ctx)
{
    return pell_method_find(ctx, "test", "image-space");
}

static inline struct pell_frame_material narrow(void)
{
    static const double variance[3] = { 0.5, 2.0, 6.0 }, weight[3][3] = { { 0.3, 0.2, 0.6 }, { 0.3, 0.3, 0.1 }, { 0.3, 0.4, 0.1 } };
    return patch_gaussians(3, variance, weight);
}

static inline struct pell_frame_material medium(const char *name)
{
    return (struct pell_frame_material) { .name = name, .preset = name, .medium = pell_material_find(name)->medium };
}

static inline float standard_error(unsigned x, unsigned y, unsigned c)
{
    unsigned h = x * 374761393u + y * 668265263u + c * 2246822519u + 12345u;

    h = (h ^ (h >> 13)) * 1274126177u;
    return (float) ((h ^ (h >> 16)) & 0xffffff) / 16777216.0f;
}

static inline void light_a_half(struct patch *p)
{
    for (int y = 0; y < p->frame.shape.height; y++)
        for (int x = 0; x < p->frame.shape.width; x++)
            for (int c = 0; c < 3; c++)
                p->light[c][patch_at(p, x, y)] = 2 * x >= p->frame.shape.width;
}

static inline double step_of(const struct pell_frame_material *m, int c, double x_mm)
{
    double sum = 0.0;

    for (int i = 0; i < m->gaussians.count; i++)
        sum += m->gaussians.weight[i][c] * 0.5 * (1.0 + erf(x_mm / sqrt(2.0 * m->gaussians.variance[i])));
    return sum;
}

#define BALL_MM 12.0
#define BALL_AT 600.0
#define BALL_PX 3.0 /* per mm, at its centre */

/* Depth of the ball at a pixel (or a position within one); 0 where the ray misses. */
static inline double ball_depth(const struct patch *p, double x, double y)
{
    const double tx = patch_tan_x(p, x), ty = patch_tan_y(p, y), a = 1.0 + tx * tx + ty * ty;
    const double under = BALL_AT * BALL_AT - a * (BALL_AT * BALL_AT - BALL_MM * BALL_MM);
    return under > 0.0 ? (BALL_AT - sqrt(under)) / a : 0.0;
}

static inline struct patch *ball(const struct pell_frame_material *m)
{
    struct patch *p = patch_create(80, 80, false, BALL_PX * BALL_AT, BALL_AT, m, 1);

    for (int y = 0; y < 80; y++)
        for (int x = 0; x < 80; x++) {
            const size_t i = patch_at(p, x, y);
            const double z = ball_depth(p, x, y);
            p->material[i] = z > 0.0;
            p->depth[i] = z > 0.0 ? (float) z : NAN;
            for (int c = 0; c < 3; c++) /* a light on the left, the shadow of a post, a texture */
                p->light[c][i] =
                    (float) (fmax(0.0, 0.9 - 0.02 * x) * (x > 30 && x < 38 ? 0.1 : 1.0) * (0.8 + 0.2 * sin(0.7 * x + c) * cos(0.9 * y)));
        }
    return p;
}

#endif
