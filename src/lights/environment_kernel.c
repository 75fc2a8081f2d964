/* SPDX-License-Identifier: MIT
 * environment_kernel.c - see environment_kernel.h. */
#include "lights/environment_kernel.h"

static inline __attribute__((always_inline)) void deposit_to(const struct pell_env_element *elements, size_t count,
                                                             const struct pell_vec3 *normals, int nodes, float (*bins)[PELL_ENV_BINS][4])
{
    for (size_t k = 0; k < count; k++) {
        const struct pell_env_element *e = &elements[k];
        for (int i = 0; i < nodes; i++) {
            const float mu = normals[i].x * e->x + normals[i].y * e->y + normals[i].z * e->z;
            if (mu > 0.0f)
                pell_env_deposit(bins[i], mu, e->rgb, 1.0f);
        }
    }
}

static void deposit(const struct pell_env_element *elements, size_t count, const struct pell_vec3 *normals, int nodes,
                    float (*bins)[PELL_ENV_BINS][4])
{
    if (nodes == PELL_ENV_TOGETHER)
        deposit_to(elements, count, normals, PELL_ENV_TOGETHER, bins);
    else
        deposit_to(elements, count, normals, nodes, bins);
}

static void add_bins(const float *kernels, int rows, const float (*bins)[4], float *node)
{
    for (int first = 0; first < rows; first += PELL_ENV_ROWS) { /* accumulators that fit in registers */
        const int count = rows - first < PELL_ENV_ROWS ? rows - first : PELL_ENV_ROWS;
        float sum[3][PELL_ENV_ROWS] = { { 0 } };
        for (int b = 0; b < PELL_ENV_BINS; b++) {
            const float *restrict kernel = kernels + b * rows + first, red = bins[b][0], green = bins[b][1], blue = bins[b][2];
            for (int k = 0; k < PELL_ENV_ROWS; k++) {
                sum[0][k] += red * kernel[k];
                sum[1][k] += green * kernel[k];
                sum[2][k] += blue * kernel[k];
            }
        }
        for (int k = 0; k < count; k++)
            for (int c = 0; c < 3; c++)
                node[3 * (first + k) + c] = sum[c][k];
    }
}

static void add_row(const struct pell_env_row *row, int from, int to, const struct pell_env_lobe *lobe, float sums[4][PELL_ENV_WIDE])
{
    const float *azimuth = lobe->azimuth, a = lobe->a, b = lobe->b, a2 = lobe->a2;
    const float scale = row->solid_angle * a2;
    float sum[4][PELL_ENV_WIDE];

    memcpy(sum, sums, sizeof(sum));
    for (int i = from; i < to; i += PELL_ENV_WIDE) {
        const float *s = row->sin_column + i, *c = row->cos_column + i;
        const float *red = row->plane[0] + i, *green = row->plane[1] + i, *blue = row->plane[2] + i;
        for (int k = 0; k < PELL_ENV_WIDE; k++) {
            const float cosine = a + b * (azimuth[1] * c[k] + azimuth[0] * s[k]);
            const float d = 0.5f * (1.0f - cosine) + 0.5f * (1.0f + cosine) * a2; /* sin^2 + alpha^2 cos^2 of the half angle */
            const float w = cosine > 0.0f && i + k < to ? scale * cosine / (d * d) : 0.0f;
            sum[0][k] += w * red[k];
            sum[1][k] += w * green[k];
            sum[2][k] += w * blue[k];
            sum[3][k] += w;
        }
    }
    memcpy(sums, sum, sizeof(sum));
}

extern const struct pell_env_kernels PELL_SIMD(pell_env_kernels);
const struct pell_env_kernels PELL_SIMD(pell_env_kernels) = { deposit, add_bins, add_row };
