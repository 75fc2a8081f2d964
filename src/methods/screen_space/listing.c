/* SPDX-License-Identifier: MIT
 *
 * listing.c - the paper's taps: listing 7.1 of the screen-space method; compiled once per level of base/simd.h.
 */
#include "methods/screen_space/blocks.h"

/* Span in pixels over that of a facing surface. */
INLINE float paper_slope(const struct screen_work *w, size_t index, int x, int y, int axis)
{
    const float d = w->depth[index];
    float change, level;

    if (!(w->forms & SCREEN_FORM_PAPER_SLOPE)) {
        const float mm = d * w->depth_mm + w->fixed_mm;
        return w->length[axis][index] > 0.0f ? mm / w->length[axis][index] : 0.0f;
    }
    /* Derivatives are those of a quad of 2 x 2 pixels. Where the other pixel is not of this surface, the limit: the depth behind it is
     * far away. */
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

/* Seven bilinear taps over +-span; those outside the mask are left out. */
int PELL_SIMD(screen_gather_listing)(const struct screen_work *w, int y, int axis, const struct job *job, const float *const row[3],
                                     float (*restrict result)[SCREEN_BLOCK], float *restrict on)
{
    static const float weights[7] = { 0.006f, 0.061f, 0.242f, 0.382f, 0.242f, 0.061f, 0.006f };
    const int low = axis == 0 ? w->block0 * SCREEN_BLOCK : w->in->rect.y0, high = axis == 0 ? w->block1 * SCREEN_BLOCK : w->in->rect.y1;
    const int x = job->x, here = axis == 0 ? x : y;
    const size_t index = (size_t) (y * w->stride + x);
    const ptrdiff_t pace = axis == 0 ? 1 : w->stride;
    struct block b;
    const bool any = choose(w, index, job->cell, &b);

    for (int l = 0; l < SCREEN_BLOCK; l++)
        on[l] = any && w->scale[index + (size_t) l] > 0.0f && (b.uniform || b.afters[l] > 0.0f) ? 1.0f : 0.0f;
    for (int l = 0; any && l < SCREEN_BLOCK; l++) {
        const size_t at = index + (size_t) l;
        const int place = axis == 0 ? here + l : here;
        float sum[3] = { 0 }, all = 0.0f, span;

        for (int i = 0; i < 3; i++)
            result[i][l] = row[i][x + l];
        if (!(on[l] > 0.0f))
            continue;
        span = SCREEN_SPAN * sqrtf((b.uniform ? b.after - b.before : b.afters[l] - b.befores[l]) * w->scale[at]);
        span *= paper_slope(w, at, x + l, y, axis);
        if (span > 262144.0f)
            span = 262144.0f;
        for (int t = 0; t < 7; t++) {
            const float offset = (float) (t - 3) * (1.0f / 3.0f) * span, whole = floorf(offset), part = offset - whole;
            const float share[2] = { weights[t] * (1.0f - part), weights[t] * part };

            for (int k = 0; k < 2; k++) {
                const int step = (int) whole + k;
                if (place + step < low || place + step >= high || w->key[(ptrdiff_t) at + step * pace] != w->key[at])
                    continue;
                all += share[k];
                for (int i = 0; i < 3; i++)
                    sum[i] += share[k] * row[i][x + l + step * pace];
            }
        }
        for (int i = 0; i < 3; i++)
            result[i][l] = sum[i] / all;
    }
    return b.active;
}
