/* SPDX-License-Identifier: MIT
 *
 * listing.c - the paper's taps: listing 7.1 of the screen-space method; compiled once per level of base/simd.h.
 */
#include "methods/screen_space/blocks.h"

/* Span in pixels relative to that of a facing surface. */
INLINE float paper_slope(const struct screen_work *w, size_t index, int x, int y, int axis)
{
    const float d = w->depth[index];
    float change, level;

    if (!(w->forms & SCREEN_FORM_PAPER_SLOPE)) {
        const float mm = d * w->depth_mm + w->fixed_mm;
        return w->length[axis][index] > 0.0f ? mm / w->length[axis][index] : 0.0f;
    }
    /* Derivatives are those of a quad of 2 x 2 pixels. If the other pixel is not on this surface, their limit: the background is far
     * away. */
    {
        const ptrdiff_t other = axis == 0 ? ((x & 1) ? -1 : 1) : ((y & 1) ? -w->stride : w->stride);
        const ptrdiff_t at = (ptrdiff_t) index + other;
        change = w->key[at] == w->key[index] ? fabsf(w->depth[at] - d) * w->unit : w->maxdd;
    }
    if (change > w->maxdd)
        change = w->maxdd;
    level = w->in->shape.orthographic ? 1.0f : d * w->unit;
    return level / (level + w->correction * change);
}

#define SPAN_MAX 262144.0f /* px: tap positions are integers */

static const float weights[7] = { 0.006f, 0.061f, 0.242f, 0.382f, 0.242f, 0.061f, 0.006f };

struct taps {
    float sum[3], weight;
};

/* A bilinear tap: mean of the pixels around it that are in the mask. */
INLINE void add_tap(const struct screen_work *w, size_t index, int x, int y, const float position[2], float weight,
                    const float *const light[3], struct taps *taps)
{
    const float base[2] = { floorf(position[0]), floorf(position[1]) };
    const float f[2] = { position[0] - base[0], position[1] - base[1] };

    for (int k = 0; k < 4; k++) {
        const int ox = (int) base[0] + (k & 1), oy = (int) base[1] + (k >> 1);
        const float fraction = weight * ((k & 1) ? f[0] : 1.0f - f[0]) * ((k >> 1) ? f[1] : 1.0f - f[1]);
        const ptrdiff_t by = oy * w->stride + ox;

        if (!(fraction > 0.0f) || x + ox < w->block0 * SCREEN_BLOCK || x + ox >= w->block1 * SCREEN_BLOCK || y + oy < w->in->rect.y0 ||
            y + oy >= w->in->rect.y1 || w->key[(ptrdiff_t) index + by] != w->key[index])
            continue;
        taps->weight += fraction;
        for (int i = 0; i < 3; i++)
            taps->sum[i] += fraction * light[i][by];
    }
}

/* Seven bilinear taps over +-span; those outside the mask are left out. */
int PELL_SIMD(screen_gather_listing)(const struct screen_work *w, int y, int axis, const struct job *job, const float *const row[3],
                                     float (*restrict result)[SCREEN_BLOCK], float *restrict on)
{
    const int x = job->x;
    const size_t index = (size_t) (y * w->stride + x);
    struct block b;
    const bool any = choose(w, index, job->cell, &b);

    for (int l = 0; l < SCREEN_BLOCK; l++)
        on[l] = any && w->scale[index + (size_t) l] > 0.0f && (b.uniform || b.afters[l] > 0.0f) ? 1.0f : 0.0f;
    for (int l = 0; any && l < SCREEN_BLOCK; l++) {
        const size_t at = index + (size_t) l;
        const int rotation = w->rotated ? pell_ss_turn(x + l, y, w->turn) : 0;
        const float *turn = w->rotated ? w->turns[rotation] : NULL, shift = w->rotated ? pell_ss_jitter(rotation) - 0.5f : 0.0f;
        const float *const light[3] = { row[0] + x + l, row[1] + x + l, row[2] + x + l };
        struct taps taps = { { 0 }, 0.0f };
        float span, step_dir[2] = { axis == 0 ? 1.0f : 0.0f, axis == 0 ? 0.0f : 1.0f };

        for (int i = 0; i < 3; i++)
            result[i][l] = row[i][x + l];
        if (!(on[l] > 0.0f))
            continue;
        span = SCREEN_SPAN * sqrtf((b.uniform ? b.after - b.before : b.afters[l] - b.befores[l]) * w->scale[at]);
        if (turn) {
            step_dir[0] = axis == 0 ? turn[0] : -turn[1];
            step_dir[1] = axis == 0 ? turn[1] : turn[0];
        }
        for (int k = 0; k < 2; k++)
            if (step_dir[k] != 0.0f)
                step_dir[k] *= fminf(span * paper_slope(w, at, x + l, y, k), SPAN_MAX);
        for (int t = 0; t < 7; t++) {
            const float offset = ((float) (t - 3) + shift) * (1.0f / 3.0f);
            add_tap(w, at, x + l, y, (const float[2]) { offset * step_dir[0], offset * step_dir[1] }, weights[t], light, &taps);
        }
        for (int i = 0; i < 3 && taps.weight > 0.0f; i++) /* no tap of a rotated and shifted line may be on the surface */
            result[i][l] = taps.sum[i] / taps.weight;
    }
    return b.num_active;
}
