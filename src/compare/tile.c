/* SPDX-License-Identifier: MIT
 *
 * tile.c - see tile.h. Compiled once per SIMD level; plain loops over floats.
 *
 *     colour    dE_c = (|dL| + |d(a, b)|)^0.7 of filtered, Hunt-adjusted L*a*b*, mapped to [0, 1]   (Andersson et al. 2020, section 4.1)
 *     features  dE_f = sqrt(max(||edges|| - ||edges'||, ||points|| - ||points'||) / sqrt 2)         (section 4.2)
 *     error     dE_c^(1 - dE_f)                                                                     (section 4.3)
 */
#include "compare/tile.h"

#include "shared/tone.h"

#include <pellucid/compare.h>

#include <math.h>
#include <string.h>

#ifndef PELL_SIMD_NAME
#define PELL_SIMD_NAME base
#endif

#define W PELL_TILE_WIDTH
#define H PELL_TILE_HEIGHT
#define BLOCK 32 /* pixels that are summed at a time, in registers */
#define INLINE static inline __attribute__((always_inline))

_Static_assert(W % BLOCK == 0, "blocks tile a row");

/* --- Functions of one number -------------------------------------------------------------------------------------------------- */

/* log2 of the mantissa in [sqrt 1/2, sqrt 2) by 2/ln 2 artanh((m - 1)/(m + 1)); the first term left out is 4e-9. */
INLINE float log2_of(float x)
{
    uint32_t bits;
    int32_t exponent;
    float m, t, t2;

    memcpy(&bits, &x, sizeof(bits));
    exponent = (int32_t) (bits - 0x3f3504f3u) >> 23;
    bits -= (uint32_t) exponent << 23;
    memcpy(&m, &bits, sizeof(m));
    t = (m - 1.0f) / (m + 1.0f);
    t2 = t * t;
    return (float) exponent + t * (2.88539008f + t2 * (0.961796694f + t2 * (0.577078016f + t2 * (0.412198583f + t2 * 0.320598898f))));
}

/* 2^x for |x| <= 126 by its Taylor series about the nearest integer. */
INLINE float exp2_of(float x)
{
    const float magic = 12582912.0f; /* 1.5 2^23: the sum's last bits hold the rounded integer */
    const float sum = x + magic, f = (x - (sum - magic)) * 0.693147181f;
    uint32_t bits;
    float scale;

    memcpy(&bits, &sum, sizeof(bits));
    bits = (bits - 0x4b400000u + 127u) << 23;
    memcpy(&scale, &bits, sizeof(scale));
    return scale * (1.0f + f * (1.0f + f * (0.5f + f * (0.166666667f + f * (0.0416666667f + f * (0.00833333333f + f * 0.00138888889f))))));
}

/* x^e for x in [0, 1e4], e in [0, 2]; 0 for x below 1e-30, whatever e. */
INLINE float power_of(float x, float e)
{
    const float v = exp2_of(e * log2_of(x > 1e-30f ? x : 1.0f));
    return x > 1e-30f ? v : 0.0f;
}

/* Two Halley iterations from a guess accurate to 4 %; x > 1e-30. */
INLINE float cube_root_of(float x)
{
    int32_t bits;
    float y, y3;

    memcpy(&bits, &x, sizeof(bits));
    bits = (int32_t) ((float) bits * (1.0f / 3.0f)) + 0x2a514067;
    memcpy(&y, &bits, sizeof(y));
    y3 = y * y * y;
    y *= (y3 + 2.0f * x) / (2.0f * y3 + x);
    y3 = y * y * y;
    return y * ((y3 + 2.0f * x) / (2.0f * y3 + x));
}

/* The sRGB transfer function of [0, 1]. */
INLINE float encode(float x)
{
    const float root = power_of(x, 1.0f / 2.4f);
    return x > 0.0031308f ? 1.055f * root - 0.055f : 12.92f * x;
}

/* The function of L*a*b* (CIE 1976). */
INLINE float lightness(float x)
{
    const float root = cube_root_of(x > 1e-3f ? x : 1e-3f);
    return x > 216.0f / 24389.0f ? root : x * (841.0f / 108.0f) + 4.0f / 29.0f;
}

static void power_all(const float *x, float exponent, float *out, int count)
{
    for (int i = 0; i < count; i++)
        out[i] = power_of(x[i], exponent);
}

static void cube_root_all(const float *x, float *out, int count)
{
    for (int i = 0; i < count; i++)
        out[i] = cube_root_of(x[i]);
}

/* --- Sums along a line -------------------------------------------------------------------------------------------------------- */

/* out[x] = sum of weight[k] (in[x - k step] + in[x + k step]): along a row for step 1, down a column for the length of a row. */
static void sum_symmetric(const float *restrict in, ptrdiff_t step, const float *restrict weight, int radius, float *restrict out,
                          int count)
{
    for (int x0 = 0; x0 < count; x0 += BLOCK) {
        const float *middle = in + x0;
        float sum[BLOCK];
        for (int i = 0; i < BLOCK; i++)
            sum[i] = weight[0] * middle[i];
        for (int k = 1; k <= radius; k++) {
            const float w = weight[k], *before = middle - k * step, *after = middle + k * step;
            for (int i = 0; i < BLOCK; i++)
                sum[i] += w * (before[i] + after[i]);
        }
        memcpy(out + x0, sum, sizeof(sum));
    }
}

/* The same of weight[k] (in[x - k step] - in[x + k step]). */
static void sum_antisymmetric(const float *restrict in, ptrdiff_t step, const float *restrict weight, int radius, float *restrict out,
                              int count)
{
    for (int x0 = 0; x0 < count; x0 += BLOCK) {
        const float *middle = in + x0;
        float sum[BLOCK] = { 0.0f };
        for (int k = 1; k <= radius; k++) {
            const float w = weight[k], *before = middle - k * step, *after = middle + k * step;
            for (int i = 0; i < BLOCK; i++)
                sum[i] += w * (before[i] - after[i]);
        }
        memcpy(out + x0, sum, sizeof(sum));
    }
}

/* Row length processed: whole blocks. */
static int blocks(const struct pell_tile *tile)
{
    return (tile->width + BLOCK - 1) / BLOCK * BLOCK;
}

/* --- Display ------------------------------------------------------------------------------------------------------------------ */

/* The filmic curve of `render`. */
static void tone_map_filmic(float exposure, const float *const light[3], size_t count, float *restrict r, float *restrict g,
                            float *restrict b)
{
    const float *restrict lr = light[0], *restrict lg = light[1], *restrict lb = light[2];
    const float e = PELL_FILMIC_SCALE * exposure;

    for (size_t i = 0; i < count; i++) {
        const float x = fmaxf(e * lr[i], 0.0f), y = fmaxf(e * lg[i], 0.0f), z = fmaxf(e * lb[i], 0.0f);
        const float u = fminf(PELL_FILMIC_TO_R(x, y, z), PELL_FILMIC_MOST), v = fminf(PELL_FILMIC_TO_G(x, y, z), PELL_FILMIC_MOST),
                    w = fminf(PELL_FILMIC_TO_B(x, y, z), PELL_FILMIC_MOST);
        const float p = PELL_FILMIC_CURVE(u), q = PELL_FILMIC_CURVE(v), s = PELL_FILMIC_CURVE(w);
        r[i] = pell_saturate(PELL_FILMIC_FROM_R(p, q, s));
        g[i] = pell_saturate(PELL_FILMIC_FROM_G(p, q, s));
        b[i] = pell_saturate(PELL_FILMIC_FROM_B(p, q, s));
    }
}

/* Tone-maps to [0, 1], linear. */
static void tone_map(const struct pell_tone *tone, const float *const light[3], size_t count, float *restrict r, float *restrict g,
                     float *restrict b)
{
    const float *restrict lr = light[0], *restrict lg = light[1], *restrict lb = light[2];
    const float e = tone->exposure, ws = tone->white_scale;

    if (tone->curve == PELL_COMPARE_FILMIC) {
        tone_map_filmic(e, light, count, r, g, b);
        return;
    }
    if (tone->curve == PELL_COMPARE_ACES) {
        const float *const in[3] = { lr, lg, lb };
        float *const out[3] = { r, g, b };
        for (int c = 0; c < 3; c++)
            for (size_t i = 0; i < count; i++) {
                const float v = e * in[c][i], x = v > 0.0f ? v < 1e6f ? v : 1e6f : 0.0f;
                out[c][i] = pell_saturate(x * (0.36f * 2.51f * x + 0.6f * 0.03f) / (x * (0.36f * 2.43f * x + 0.6f * 0.59f) + 0.14f));
            }
        return;
    }
    for (size_t i = 0; i < count; i++) {
        const float lum = e * PELL_LUMINANCE(lr[i], lg[i], lb[i]), y = lum > 0.0f ? lum < 1e12f ? lum : 1e12f : 0.0f;
        const float scale = tone->curve == PELL_COMPARE_LINEAR ? e : e * ((1.0f + y * ws) / (1.0f + y));
        r[i] = pell_saturate(scale * lr[i]);
        g[i] = pell_saturate(scale * lg[i]);
        b[i] = pell_saturate(scale * lb[i]);
    }
}

/* --- FLIP --------------------------------------------------------------------------------------------------------------------- */

/* In place: R, G, B to y, x - y, y - z. */
static void to_opponent_colors(const struct pell_flip_filters *f, size_t count, float *restrict r, float *restrict g, float *restrict b)
{
    const float *m = f->to_xyz;

    for (size_t i = 0; i < count; i++) {
        const float x = m[0] * r[i] + m[1] * g[i] + m[2] * b[i], y = m[3] * r[i] + m[4] * g[i] + m[5] * b[i];
        const float z = m[6] * r[i] + m[7] * g[i] + m[8] * b[i];
        r[i] = y;
        g[i] = x - y;
        b[i] = y - z;
    }
}

/* Perceptual features of an image: L, a, b after Hunt, and the strength of edges and of points. */
enum { FEATURE_L, FEATURE_A, FEATURE_B, FEATURE_EDGE, FEATURE_POINT, FEATURE_PLANES };
/* Filtered along rows. */
enum { ROW_Y, ROW_RG, ROW_BY0, ROW_BY1, ROW_SMOOTH, ROW_EDGE, ROW_POINT, ROW_PLANES };

static void filter_rows(const struct pell_tile *t, const struct pell_flip_filters *f, float *const opponent[3], float *rows)
{
    const size_t plane = (size_t) t->rows * W;
    const int n = blocks(t);

    for (int i = 0; i < t->rows; i++) {
        const size_t at = (size_t) i * (size_t) t->row + (size_t) t->pad;
        const float *y = opponent[0] + at, *rg = opponent[1] + at, *by = opponent[2] + at;
        float *out = rows + (size_t) i * W;
        sum_symmetric(y, 1, f->achromatic, f->achromatic_radius, out + ROW_Y * plane, n);
        sum_symmetric(rg, 1, f->red_green, f->red_green_radius, out + ROW_RG * plane, n);
        sum_symmetric(by, 1, f->blue_yellow[0], f->blue_yellow_radius, out + ROW_BY0 * plane, n);
        sum_symmetric(by, 1, f->blue_yellow[1], f->blue_yellow_radius, out + ROW_BY1 * plane, n);
        sum_symmetric(y, 1, f->smooth, f->feature_radius, out + ROW_SMOOTH * plane, n);
        sum_antisymmetric(y, 1, f->edge, f->feature_radius, out + ROW_EDGE * plane, n);
        sum_symmetric(y, 1, f->point, f->feature_radius, out + ROW_POINT * plane, n);
    }
}

/* One row of filtered y, x - y, y - z to L, a, b, a and b times L/100 (Hunt). */
static void to_hunt_lab(const struct pell_flip_filters *f, float line[4][W], float *out, int count)
{
    const float *restrict y = line[0], *restrict rg = line[1], *restrict by0 = line[2], *restrict by1 = line[3];
    float *restrict out_l = out + FEATURE_L * W * H, *restrict out_a = out + FEATURE_A * W * H, *restrict out_b = out + FEATURE_B * W * H;
    const float *m = f->to_xyz, *inverse = f->from_xyz, w0 = f->blue_yellow_weight[0], w1 = f->blue_yellow_weight[1];

    for (int i = 0; i < count; i++) {
        const float Y = y[i], X = Y + rg[i], Z = Y - (w0 * by0[i] + w1 * by1[i]);
        const float r = pell_saturate(inverse[0] * X + inverse[1] * Y + inverse[2] * Z);
        const float g = pell_saturate(inverse[3] * X + inverse[4] * Y + inverse[5] * Z);
        const float b = pell_saturate(inverse[6] * X + inverse[7] * Y + inverse[8] * Z);
        const float fx = lightness(m[0] * r + m[1] * g + m[2] * b), fy = lightness(m[3] * r + m[4] * g + m[5] * b);
        const float fz = lightness(m[6] * r + m[7] * g + m[8] * b), L = 116.0f * fy - 16.0f;
        out_l[i] = L;
        out_a[i] = 0.01f * L * 500.0f * (fx - fy);
        out_b[i] = 0.01f * L * 200.0f * (fy - fz);
    }
}

static void find_features(const struct pell_tile *t, const struct pell_flip_filters *f, const struct pell_tone *tone, int which,
                          float *scratch, float *features)
{
    const size_t padded = (size_t) t->row * (size_t) t->rows, plane = (size_t) t->rows * W;
    float *const opponent[3] = { scratch, scratch + padded, scratch + 2 * padded };
    float *rows = scratch + 3 * padded;
    const int n = blocks(t);

    tone_map(tone, t->light[which], padded, opponent[0], opponent[1], opponent[2]);
    to_opponent_colors(f, padded, opponent[0], opponent[1], opponent[2]);
    filter_rows(t, f, opponent, rows);
    for (int i = 0; i < t->height; i++) {
        const float *in = rows + (size_t) (i + t->pad) * W;
        float line[4][W], *out = features + (size_t) i * W;

        sum_symmetric(in + ROW_Y * plane, W, f->achromatic, f->achromatic_radius, line[0], n);
        sum_symmetric(in + ROW_RG * plane, W, f->red_green, f->red_green_radius, line[1], n);
        sum_symmetric(in + ROW_BY0 * plane, W, f->blue_yellow[0], f->blue_yellow_radius, line[2], n);
        sum_symmetric(in + ROW_BY1 * plane, W, f->blue_yellow[1], f->blue_yellow_radius, line[3], n);
        to_hunt_lab(f, line, out, n);

        sum_symmetric(in + ROW_EDGE * plane, W, f->smooth, f->feature_radius, line[0], n);
        sum_antisymmetric(in + ROW_SMOOTH * plane, W, f->edge, f->feature_radius, line[1], n);
        sum_symmetric(in + ROW_POINT * plane, W, f->smooth, f->feature_radius, line[2], n);
        sum_symmetric(in + ROW_SMOOTH * plane, W, f->point, f->feature_radius, line[3], n);
        for (int x = 0; x < n; x++) {
            out[FEATURE_EDGE * W * H + x] = sqrtf(line[0][x] * line[0][x] + line[1][x] * line[1][x]);
            out[FEATURE_POINT * W * H + x] = sqrtf(line[2][x] * line[2][x] + line[3][x] * line[3][x]);
        }
    }
}

static void flip(const struct pell_tile *t, const struct pell_flip_filters *f, const struct pell_tone *tone, float *error)
{
    float *features[2] = { t->scratch, t->scratch + FEATURE_PLANES * W * H }, *scratch = t->scratch + 2 * FEATURE_PLANES * W * H;
    const int n = blocks(t);

    for (int p = 0; p < 2; p++)
        find_features(t, f, tone, p, scratch, features[p]);
    for (int i = 0; i < t->height; i++) {
        const float *restrict a = features[0] + i * W, *restrict b = features[1] + i * W;
        float *restrict out = error + i * W;
        for (int x = 0; x < n; x++) {
            const float dl = fabsf(a[FEATURE_L * W * H + x] - b[FEATURE_L * W * H + x]);
            const float da = a[FEATURE_A * W * H + x] - b[FEATURE_A * W * H + x], db = a[FEATURE_B * W * H + x] - b[FEATURE_B * W * H + x];
            const float color = power_of(dl + sqrtf(da * da + db * db), 0.7f);
            const float low = f->low_slope * color, high = 1.0f - f->high_slope * (f->scale - color);
            const float edge = fabsf(a[FEATURE_EDGE * W * H + x] - b[FEATURE_EDGE * W * H + x]);
            const float point = fabsf(a[FEATURE_POINT * W * H + x] - b[FEATURE_POINT * W * H + x]);
            const float feature = sqrtf((edge > point ? edge : point) * 0.707106781f);
            out[x] = power_of(pell_saturate(color < f->knee ? low : high), 1.0f - pell_saturate(feature));
        }
    }
}

/* --- SSIM --------------------------------------------------------------------------------------------------------------------- */

static void moments(const float *restrict a, const float *restrict b, size_t count, float *restrict aa, float *restrict bb,
                    float *restrict ab)
{
    for (size_t i = 0; i < count; i++) {
        aa[i] = a[i] * a[i];
        bb[i] = b[i] * b[i];
        ab[i] = a[i] * b[i];
    }
}

/* `line`: the windowed means of a, b, a^2, b^2, a b. The moments of bright flat areas cancel down to rounding, which may yield a covariance
 * impossible for these variances: it is clamped by the Cauchy-Schwarz inequality, so that the index stays within -1 to 1. */
static void similarity(const float line[5][W], float *restrict out, int count)
{
    const float c1 = 0.01f * 0.01f, c2 = 0.03f * 0.03f;

    for (int x = 0; x < count; x++) {
        const float a = line[0][x], b = line[1][x], ab = a * b, squares = a * a + b * b;
        const float difference = line[2][x] + line[3][x] - squares, variances = difference > 0.0f ? difference : 0.0f;
        const float twice = 2.0f * (line[4][x] - ab), least = twice > -variances ? twice : -variances;
        const float covariances = least < variances ? least : variances;
        out[x] = (2.0f * ab + c1) * (covariances + c2) / ((squares + c1) * (variances + c2));
    }
}

/* planes: a, b, a^2, b^2, a b, padded. */
static void compare_channel(const struct pell_tile *t, const float *window, float *planes, float *rows, float *map)
{
    const size_t padded = (size_t) t->row * (size_t) t->rows, plane = (size_t) t->rows * W;
    const int n = blocks(t);

    moments(planes, planes + padded, padded, planes + 2 * padded, planes + 3 * padded, planes + 4 * padded);
    for (int m = 0; m < 5; m++)
        for (int i = t->pad - PELL_SSIM_RADIUS; i < t->pad + t->height + PELL_SSIM_RADIUS; i++)
            sum_symmetric(planes + (size_t) m * padded + (size_t) i * (size_t) t->row + (size_t) t->pad, 1, window, PELL_SSIM_RADIUS,
                          rows + (size_t) m * plane + (size_t) i * W, n);
    for (int i = 0; i < t->height; i++) {
        float line[5][W];
        for (int m = 0; m < 5; m++)
            sum_symmetric(rows + (size_t) m * plane + (size_t) (i + t->pad) * W, W, window, PELL_SSIM_RADIUS, line[m], n);
        similarity((const float(*)[W]) line, map + i * W, n);
    }
}

static void ssim(const struct pell_tile *t, const float *window, const struct pell_tone *tone, float *map[4])
{
    const size_t padded = (size_t) t->row * (size_t) t->rows;
    float *display[2] = { t->scratch, t->scratch + 3 * padded }, *planes = t->scratch + 6 * padded, *rows = planes + 5 * padded;

    for (int p = 0; p < 2; p++) {
        float *restrict r = display[p], *restrict g = r + padded, *restrict b = g + padded, *restrict luma = planes + (size_t) p * padded;
        tone_map(tone, t->light[p], padded, r, g, b);
        for (size_t i = 0; i < padded; i++) {
            r[i] = encode(r[i]);
            g[i] = encode(g[i]);
            b[i] = encode(b[i]);
            luma[i] = PELL_LUMINANCE(r[i], g[i], b[i]);
        }
    }
    compare_channel(t, window, planes, rows, map[0]);
    for (int c = 0; c < 3; c++) {
        for (int p = 0; p < 2; p++)
            memcpy(planes + (size_t) p * padded, display[p] + (size_t) c * padded, padded * sizeof(float));
        compare_channel(t, window, planes, rows, map[c + 1]);
    }
}

extern const struct pell_tile_kernels PELL_SIMD(pell_tile); /* may be declared nowhere else, as tile.h does not know all levels */
const struct pell_tile_kernels PELL_SIMD(pell_tile) = { flip, ssim, power_all, cube_root_all };
