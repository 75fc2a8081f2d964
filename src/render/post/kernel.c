/* SPDX-License-Identifier: MIT
 *
 * kernel.c - see kernel.h; compiled once per SIMD level. All levels give the same bits.
 */
#include "render/post/kernel.h"

#include "math/lanes.h"
#include "shared/tone.h"

#include <float.h>

#define LANES 16
#define LN2 0.69314718055994530942

/* --- Measuring ------------------------------------------------------------------------------------------------------------------ */

/* A product of many numbers, per lane: one logarithm per row is taken of it, since a logarithm costs more than all the rest. */
struct product {
    _Alignas(64) double mantissa[LANES];
    int64_t exponent; /* of the power of two that multiplies all of them */
    int factors;      /* since the last call of normalize */
};

/* Moves powers of two from the mantissas to the exponent, so that products stay far inside a double's range. */
static void normalize(struct product *restrict p)
{
    _Alignas(64) int64_t bits[LANES];
    int64_t sum = 0;

    memcpy(bits, p->mantissa, sizeof(bits));
    for (int i = 0; i < LANES; i++) {
        sum += (bits[i] >> 52) - 1023;
        bits[i] = (bits[i] & 0xfffffffffffff) | (int64_t) 1023 << 52;
    }
    memcpy(p->mantissa, bits, sizeof(bits));
    p->exponent += sum;
    p->factors = 0;
}

static double logarithm(struct product *p)
{
    double all = 1.0;

    normalize(p);
    for (int i = 0; i < LANES; i++)
        all *= p->mantissa[i];
    return log(all) + (double) p->exponent * LN2;
}

static void clear_invalid(int count, float *restrict r, float *restrict g, float *restrict b, const float *a, struct pell_post_measure *out)
{
    for (int i = 0; i < count; i++)
        if (a[i] != 0.0f && !isfinite(r[i] + g[i] + b[i])) {
            r[i] = g[i] = b[i] = 0.0f;
            out->invalid += 1.0;
        }
}

INLINE void finish_filmic(vf exposure, const vf v[3], float *const display[3], int at)
{
    const vf e = PELL_FILMIC_SCALE * exposure, r = vmax(e * v[0], splat(0.0f)), g = vmax(e * v[1], splat(0.0f)),
             b = vmax(e * v[2], splat(0.0f));
    const vf in[3] = { vmin(PELL_FILMIC_TO_R(r, g, b), splat(PELL_FILMIC_MOST)), vmin(PELL_FILMIC_TO_G(r, g, b), splat(PELL_FILMIC_MOST)),
                       vmin(PELL_FILMIC_TO_B(r, g, b), splat(PELL_FILMIC_MOST)) };
    const vf x = PELL_FILMIC_CURVE(in[0]), y = PELL_FILMIC_CURVE(in[1]), z = PELL_FILMIC_CURVE(in[2]);

    store(display[0] + at, vmin(vmax(PELL_FILMIC_FROM_R(x, y, z), splat(0.0f)), splat(1.0f)));
    store(display[1] + at, vmin(vmax(PELL_FILMIC_FROM_G(x, y, z), splat(0.0f)), splat(1.0f)));
    store(display[2] + at, vmin(vmax(PELL_FILMIC_FROM_B(x, y, z), splat(0.0f)), splat(1.0f)));
}

/* Measures a whole block. */
INLINE void measure_block(float *restrict r, float *restrict g, float *restrict b, float *restrict a, struct product *restrict p,
                          float *restrict largest, struct pell_post_measure *restrict out)
{
    _Alignas(64) float factor[LANES];
    vi covered = { 0 }, bad = { 0 };

    for (int at = 0; at < LANES; at += WIDTH) {
        const vf sum = vabs(load(r + at) + load(g + at) + load(b + at));
        covered |= load(a + at) != 0.0f;
        bad |= ~(sum <= FLT_MAX);
    }
    if (!any(covered))
        return;
    if (any(bad))
        clear_invalid(LANES, r, g, b, a, out);
    for (int at = 0; at < LANES; at += WIDTH) {
        const vf sum = load(a + at), alpha = select(sum > 0.9999f, splat(1.0f), sum); /* a sum of weights 1/n is rounded */
        const vf l = PELL_LUMINANCE(load(r + at), load(g + at), load(b + at)) / select(alpha != 0.0f, alpha, splat(1.0f));
        const vi on = (alpha > 0.5f) & (l > 1e-30f);
        const vf counted = select(on, l, splat(0.0f)), before = load(largest + at);
        store(a + at, alpha);
        store(factor + at, select(on, select(l < 1e30f, l, splat(1e30f)), splat(1.0f)));
        store(largest + at, select(counted > before, counted, before));
        out->count += (double) __builtin_popcount(movemask(on));
    }
    for (int i = 0; i < LANES; i++)
        p->mantissa[i] *= (double) factor[i];
    if (++p->factors == 8)
        normalize(p);
}

static void measure(int count, float *const color[3], float *alpha, struct pell_post_measure *out)
{
    _Alignas(64) float largest[LANES] = { 0 };
    struct product p = { .exponent = 0 };
    int x = 0;

    *out = (struct pell_post_measure) { 0 };
    for (int i = 0; i < LANES; i++)
        p.mantissa[i] = 1.0;
    for (; x + LANES <= count; x += LANES)
        measure_block(color[0] + x, color[1] + x, color[2] + x, alpha + x, &p, largest, out);
    if (x < count) {
        const size_t bytes = (size_t) (count - x) * sizeof(float);
        _Alignas(64) float rest[4][LANES] = { { 0 } };
        for (int c = 0; c < 4; c++)
            memcpy(rest[c], (c < 3 ? color[c] : alpha) + x, bytes);
        measure_block(rest[0], rest[1], rest[2], rest[3], &p, largest, out);
        for (int c = 0; c < 4; c++)
            memcpy((c < 3 ? color[c] : alpha) + x, rest[c], bytes);
    }
    for (int i = 0; i < LANES; i++)
        out->maximum = (double) largest[i] > out->maximum ? (double) largest[i] : out->maximum;
    out->sum_log = logarithm(&p);
}

/* --- Showing -------------------------------------------------------------------------------------------------------------------- */

INLINE void put(const float v[3], int count, float *const planes[3], int x)
{
    for (int c = 0; c < 3; c++) {
        float *restrict out = planes[c] + x;
        for (int i = 0; i < count; i++)
            out[i] = v[c];
    }
}

/* Tone maps a whole block. */
INLINE void finish_block(const struct pell_post_tone *t, float *const color[3], const float *alpha, float *const display[3], int x)
{
    for (int at = x; at < x + LANES; at += WIDTH) {
        const vf a = load(alpha + at), transparency = 1.0f - a, e = t->exposure / select(a > t->min_alpha, a, splat(1.0f));
        vf v[3], lum, l, scale;

        for (int c = 0; c < 3; c++) {
            v[c] = load(color[c] + at);
            if (t->composites)
                store(color[c] + at, v[c] + transparency * t->background[c]);
        }
        if (t->filmic) {
            finish_filmic(e, v, display, at);
        } else {
            lum = e * PELL_LUMINANCE(v[0], v[1], v[2]);
            l = vmax(lum, splat(0.0f));
            scale = PELL_TONE_SCALE(e, l, t->curve, t->white_scale);
            for (int c = 0; c < 3; c++)
                store(display[c] + at, vmin(vmax(v[c] * scale, splat(0.0f)), splat(1.0f)));
        }
        for (int c = 0; t->composites && c < 3; c++)
            store(display[c] + at, a * load(display[c] + at) + transparency * t->shown[c]);
    }
}

static void finish(const struct pell_post_tone *tone, int count, float *const color[3], const float *alpha, float *const display[3])
{
    const struct pell_post_tone t = *tone;
    int x = 0;

    for (; x + LANES <= count; x += LANES) {
        vi covered = { 0 };
        for (int at = x; at < x + LANES; at += WIDTH)
            covered |= load(alpha + at) != 0.0f;
        if (t.composites && !any(covered)) { /* uncovered pixels are black */
            put(t.background, LANES, color, x);
            put(t.shown, LANES, display, x);
        } else {
            finish_block(&t, color, alpha, display, x);
        }
    }
    if (x < count) {
        const size_t bytes = (size_t) (count - x) * sizeof(float);
        _Alignas(64) float rest[7][LANES] = { { 0 } };
        for (int c = 0; c < 4; c++)
            memcpy(rest[c], (c < 3 ? color[c] : alpha) + x, bytes);
        finish_block(&t, (float *const[]) { rest[0], rest[1], rest[2] }, rest[3], (float *const[]) { rest[4], rest[5], rest[6] }, 0);
        for (int c = 0; c < 3; c++) {
            memcpy(color[c] + x, rest[c], bytes);
            memcpy(display[c] + x, rest[4 + c], bytes);
        }
    }
}

static void empty(const struct pell_post_tone *tone, int count, float *const color[3], float *alpha, float *const display[3])
{
    memset(alpha, 0, (size_t) count * sizeof(*alpha));
    put(tone->background, count, color, 0);
    put(tone->shown, count, display, 0);
}

static void blend(int count, float aside, const float *before, const float *here, const float *after, float *restrict out)
{
    for (int i = 0; i < count; i++)
        out[i] = here[i] + aside * ((before[i] - here[i]) + (after[i] - here[i]));
}

extern const struct pell_post_kernels PELL_SIMD(pell_post_kernels);
const struct pell_post_kernels PELL_SIMD(pell_post_kernels) = { measure, finish, empty, blend };
