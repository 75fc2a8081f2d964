/* SPDX-License-Identifier: MIT
 * kernel.c - see kernel.h and stage.h; compiled once per SIMD level. */
#include "render/denoise/kernel.h"

#include <math.h>
#include <string.h>

#define INLINE static inline __attribute__((always_inline))
#define SPAN (TILE + 2 * PATCH)

/* exp(-d), ending at 8. */
INLINE float fall(float d)
{
    float t = 1.0f - 0.125f * (d > 0.0f ? d : 0.0f);
    t = t > 0.0f ? t : 0.0f;
    t *= t;
    t *= t;
    return t * t;
}

/* Distances of the light of pixels and that at (dx, dy) from them, in variances; and which pairs are valid. */
INLINE void compare_pixels(const struct pell_denoise_tile *t, int dx, int dy, float (*restrict patch_distance)[SPAN],
                           float (*restrict pairs)[SPAN])
{
    for (int y = 0; y < SPAN; y++) {
        const int py = y + BORDER - PATCH, px = BORDER - PATCH;
        const float *valid = &t->valid[py][px], *other = &t->valid[py + dy][px + dx];
        for (int x = 0; x < SPAN; x++) {
            pairs[y][x] = valid[x] * other[x];
            patch_distance[y][x] = 0.0f;
        }
        for (int c = 0; c < 3; c++) {
            const float *a = &t->light[c][py][px], *b = &t->light[c][py + dy][px + dx];
            const float *va = &t->variance[c][py][px], *vb = &t->variance[c][py + dy][px + dx];
            for (int x = 0; x < SPAN; x++) {
                const float d = a[x] - b[x], v = va[x] + vb[x];
                patch_distance[y][x] += pairs[y][x] * (d * d - v) / (1e-30f + CLOSE * CLOSE * v);
            }
        }
    }
}

/* Sums over patches. */
INLINE void add_patches(float (*restrict values)[SPAN], float (*restrict out)[TILE])
{
    for (int y = 0; y < SPAN; y++) {
        float row[TILE];
        for (int x = 0; x < TILE; x++) {
            float sum = values[y][x];
            for (int k = 1; k <= 2 * PATCH; k++)
                sum += values[y][x + k];
            row[x] = sum;
        }
        memcpy(values[y], row, sizeof(row));
    }
    for (int y = 0; y < TILE; y++)
        for (int x = 0; x < TILE; x++) {
            float sum = values[y][x];
            for (int k = 1; k <= 2 * PATCH; k++)
                sum += values[y + k][x];
            out[y][x] = sum;
        }
}

/* Weights of the tile's pixels and those at (dx, dy) from them. */
INLINE void weigh_pairs(const struct pell_denoise_tile *t, int dx, int dy, float (*restrict weight)[TILE])
{
    const float reach = sqrtf((float) (dx * dx + dy * dy));
    float patch_distance[SPAN][SPAN], pairs[SPAN][SPAN], distance[TILE][TILE], count[TILE][TILE];

    compare_pixels(t, dx, dy, patch_distance, pairs);
    for (int y = 0; y < TILE; y++)
        for (int x = 0; x < TILE; x++)
            weight[y][x] = pairs[y + PATCH][x + PATCH];
    add_patches(patch_distance, distance);
    add_patches(pairs, count);
    for (int y = 0; y < TILE; y++) {
        const int py = y + BORDER;
        const float *sa = &t->steep[py][BORDER], *sb = &t->steep[py + dy][BORDER + dx];
        const float *za = &t->feature[DEPTH][py][BORDER], *zb = &t->feature[DEPTH][py + dy][BORDER + dx];
        float differ[TILE];
        for (int x = 0; x < TILE; x++) {
            const float steep = sa[x] > sb[x] ? sa[x] : sb[x], d = (za[x] - zb[x]) / (1.0f + reach * steep);
            differ[x] = d * d;
        }
        for (int k = 0; k < DEPTH; k++) {
            const float *a = &t->feature[k][py][BORDER], *b = &t->feature[k][py + dy][BORDER + dx];
            for (int x = 0; x < TILE; x++)
                differ[x] += (a[x] - b[x]) * (a[x] - b[x]);
        }
        for (int x = 0; x < TILE; x++) {
            const float color = fall(distance[y][x] / (3.0f * (count[y][x] > 1.0f ? count[y][x] : 1.0f))), feature = fall(differ[x]);
            weight[y][x] *= color < feature ? color : feature;
        }
    }
}

static void weigh(struct pell_denoise_tile *t)
{
    float weight[TILE][TILE];

    for (int y = 0; y < TILE; y++)
        for (int x = 0; x < TILE; x++)
            t->sum[y][x] = 1.0f;
    for (int dy = -WINDOW; dy <= WINDOW; dy++)
        for (int dx = -WINDOW; dx <= WINDOW; dx++) {
            if (dx == 0 && dy == 0)
                continue;
            weigh_pairs(t, dx, dy, weight);
            for (int y = 0; y < TILE; y++) {
                const int py = y + BORDER;
                const float *sa = &t->translucent[py][BORDER], *sb = &t->translucent[py + dy][BORDER + dx];
                for (int x = 0; x < TILE; x++)
                    t->sum[y][x] += weight[y][x] * (sa[x] > sb[x] ? sb[x] / sa[x] : 1.0f);
            }
        }
}

static void move(struct pell_denoise_tile *t)
{
    float weight[TILE][TILE];

    memset(t->moved, 0, sizeof(t->moved));
    for (int dy = -WINDOW; dy <= WINDOW; dy++)
        for (int dx = -WINDOW; dx <= WINDOW; dx++) {
            if (dx == 0 && dy == 0)
                continue;
            weigh_pairs(t, dx, dy, weight);
            for (int y = 0; y < TILE; y++) {
                const int py = y + BORDER;
                const float *wa = &t->total[py][BORDER], *wb = &t->total[py + dy][BORDER + dx];
                const float *sa = &t->translucent[py][BORDER], *sb = &t->translucent[py + dy][BORDER + dx];
                float factor[TILE];
                for (int x = 0; x < TILE; x++)
                    factor[x] = weight[y][x] * (sa[x] < sb[x] ? sa[x] : sb[x]) / (wa[x] > wb[x] ? wa[x] : wb[x]);
                for (int c = 0; c < 3; c++) {
                    const float *a = &t->light[c][py][BORDER], *b = &t->light[c][py + dy][BORDER + dx];
                    for (int x = 0; x < TILE; x++)
                        t->moved[c][y][x] += factor[x] * (b[x] - a[x]);
                }
            }
        }
}

const struct pell_denoise_kernels PELL_SIMD(pell_denoise_kernels) = { weigh, move };
