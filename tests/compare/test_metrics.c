/* SPDX-License-Identifier: MIT
 * test_metrics.c - error metrics: sums, masks, noise and non-finite values; SSIM against closed forms and a second, literal evaluation. */
#include "compare_test.h"
#include "slow.h"

#include "base/pool.h"
#include "compare/rows.h"
#include "compare/tile.h"
#include "shared/tone.h"

static void speckle(struct pair *p, int seed)
{
    for (int i = 0; i < PICTURES; i++)
        for (int c = 0; c < 3; c++)
            for (int y = 0; y < p->height; y++)
                for (int x = 0; x < p->width; x++)
                    p->plane[i][c][y * p->width + x] =
                        (float) (0.3 + 0.2 * sin(0.1 * x + c) + 0.2 * noise(x, y, c, seed + i) + (i == TEST ? 0.05 * cos(0.2 * y) : 0.0));
}

static void alike_is_alike(void **state)
{
    struct pair p;
    (void) state;

    pair_begin(&p, 133, 67);
    speckle(&p, 1);
    for (int c = 0; c < 3; c++)
        memcpy(p.plane[TEST][c], p.plane[REFERENCE][c], (size_t) (133 * 67) * sizeof(float));
    pair_compare(&p);
    for (int region = 0; region < 2; region++) {
        const struct pell_metrics *m = region ? &p.out.whole : &p.out.masked;
        assert_int_equal(m->pixels, 133 * 67);
        REQUIRE(m->mse == 0.0 && m->rel_mse == 0.0 && m->mae == 0.0 && m->bias[0] == 0.0 && m->rel_bias[2] == 0.0);
        REQUIRE(m->flip == 0.0 && m->flip_hdr == 0.0 && m->noise_mse == 0.0);
        for (int c = 0; c < 4; c++)
            REQUIRE_NEAR(c ? m->ssim_rgb[c - 1] : m->ssim, 1.0, 1e-12);
    }
    for (int i = 0; i < 133 * 67; i++)
        REQUIRE(p.out.relative[i] == 0.0f && p.out.flip[i] == 0.0f && p.out.flip_hdr[i] == 0.0f && p.out.ssim[i] == 1.0f);
    pair_end(&p);
}

static void constant_pictures_have_closed_forms(void **state)
{
    const double b[3] = { 0.5, 0.25, 2.0 }, d[3] = { 0.125, -0.0625, 0.5 };
    double square = 0.0, relative = 0.0, absolute = 0.0, e;
    struct pair p;
    (void) state;

    pair_begin(&p, 20, 13);
    pair_fill(&p, REFERENCE, b[0], b[1], b[2]);
    pair_fill(&p, TEST, b[0] + d[0], b[1] + d[1], b[2] + d[2]);
    p.params.floor = 0.5f;
    e = 0.5 * (0.2126 * b[0] + 0.7152 * b[1] + 0.0722 * b[2]);
    for (int c = 0; c < 3; c++) {
        square += d[c] * d[c] / 3.0;
        relative += d[c] * d[c] / (b[c] * b[c] + e * e) / 3.0;
        absolute += fabs(d[c]) / 3.0;
    }
    pair_compare(&p);
    REQUIRE_REL(p.out.whole.mse, square, 1e-12);
    REQUIRE_REL(p.out.whole.rel_mse, relative, 1e-9);
    REQUIRE_REL(p.out.whole.mae, absolute, 1e-12);
    for (int c = 0; c < 3; c++) {
        REQUIRE_REL(p.out.whole.bias[c], d[c], 1e-12);
        REQUIRE_REL(p.out.whole.rel_bias[c], d[c] / b[c], 1e-12);
    }
    REQUIRE_REL(p.out.relative[7], (0.2126 * d[0] + 0.7152 * d[1] + 0.0722 * d[2]) / (3.0 * e), 1e-6);
    REQUIRE_REL(p.out.exposure, 0.18 / (2.0 * e), 1e-6);
    pair_end(&p);
}

static double encoded(double v)
{
    return v > 0.0031308 ? 1.055 * pow(v, 1.0 / 2.4) - 0.055 : 12.92 * v;
}

/* Without variance SSIM is (2 a b + C1)/(a^2 + b^2 + C1), C1 = 0.01^2; a, b sRGB-encoded. */
static void ssim_of_constants_has_a_closed_form(void **state)
{
    struct pair p;
    (void) state;

    pair_begin(&p, 40, 30);
    p.in.display = true;
    for (int k = 0; k < 6; k++) {
        const double va[3] = { 0.1 * k, 0.5, 0.02 }, vb[3] = { 0.3, 0.5, 0.9 - 0.1 * k }, weight[3] = { 0.2126, 0.7152, 0.0722 };
        double ya = 0.0, yb = 0.0;
        pair_fill(&p, TEST, va[0], va[1], va[2]);
        pair_fill(&p, REFERENCE, vb[0], vb[1], vb[2]);
        pair_compare(&p);
        for (int c = 0; c < 3; c++) {
            const double a = encoded(va[c]), b = encoded(vb[c]);
            ya += weight[c] * a;
            yb += weight[c] * b;
            REQUIRE_NEAR(p.out.whole.ssim_rgb[c], (2.0 * a * b + 1e-4) / (a * a + b * b + 1e-4), 1e-3);
        }
        REQUIRE_NEAR(p.out.whole.ssim, (2.0 * ya * yb + 1e-4) / (ya * ya + yb * yb + 1e-4), 1e-3);
    }
    pair_end(&p);
}

/* Moments of constant areas cancel: rounding errors of the covariance must not move SSIM out of its range. */
static void ssim_of_flat_areas_stays_within_its_range(void **state)
{
    struct pair p;
    float most = 0.0f;
    (void) state;

    pair_begin(&p, 40, 30);
    p.in.display = true;
    for (int k = 0; k < 64; k++) {
        const double level = 1.0 - k / 64.0;
        pair_fill(&p, TEST, level, level, level);
        pair_fill(&p, REFERENCE, level, level, level);
        for (int i = 0; i < 40 * 30; i++)
            p.plane[REFERENCE][0][i] += 1e-5f * (float) noise(i, k, 0, 3);
        pair_compare(&p);
        for (int i = 0; i < 40 * 30; i++)
            most = fmaxf(most, fabsf(p.out.ssim[i]));
        for (int c = 0; c < 3; c++)
            most = fmaxf(most, (float) fabs(p.out.whole.ssim_rgb[c]));
    }
    assert_true(most > 0.999f && most <= 1.0f + 5e-7f);
    pair_end(&p);
}

/* SSIM of Wang et al. 2004, literally: two-dimensional windows, central moments, double precision. */
static double ssim_at(const float *a, const float *b, int width, int x, int y)
{
    double sum = 0.0, ma = 0.0, mb = 0.0, va = 0.0, vb = 0.0, cov = 0.0;

    for (int pass = 0; pass < 2; pass++) {
        for (int j = -5; j <= 5; j++)
            for (int i = -5; i <= 5; i++) {
                const double w = exp(-(i * i + j * j) / (2.0 * 1.5 * 1.5)), u = encoded(a[(y + j) * width + x + i]),
                             v = encoded(b[(y + j) * width + x + i]);
                if (pass == 0) {
                    sum += w;
                    ma += w * u;
                    mb += w * v;
                } else {
                    va += w / sum * (u - ma) * (u - ma);
                    vb += w / sum * (v - mb) * (v - mb);
                    cov += w / sum * (u - ma) * (v - mb);
                }
            }
        ma /= pass ? 1.0 : sum;
        mb /= pass ? 1.0 : sum;
    }
    return (2.0 * ma * mb + 1e-4) * (2.0 * cov + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (va + vb + 9e-4));
}

static void ssim_is_what_its_paper_defines(void **state)
{
    double mean = 0.0;
    struct pair p;
    (void) state;

    pair_begin(&p, 141, 75);
    speckle(&p, 5);
    for (int i = 0; i < PICTURES; i++) /* grey: luma equals the value */
        for (int c = 1; c < 3; c++)
            memcpy(p.plane[i][c], p.plane[i][0], (size_t) (141 * 75) * sizeof(float));
    p.in.display = true;
    pair_compare(&p);
    for (int y = 5; y < 70; y++)
        for (int x = 5; x < 136; x++) {
            const double s = ssim_at(p.plane[TEST][0], p.plane[REFERENCE][0], 141, x, y);
            mean += s / (65.0 * 131.0);
            REQUIRE_NEAR(p.out.ssim[y * 141 + x], s, 3e-4);
        }
    REQUIRE_NEAR(p.out.whole.ssim, mean, 2e-5); /* over windows inside the image */
    REQUIRE_NEAR(p.out.whole.ssim_rgb[1], mean, 2e-5);
    assert_true(mean > 0.05 && mean < 0.95);
    pair_end(&p);
}

static void a_mask_restricts_means(void **state)
{
    struct pair p;
    (void) state;

    pair_begin(&p, 140, 70);
    pair_fill(&p, REFERENCE, 0.5, 0.5, 0.5);
    pair_fill(&p, TEST, 0.5, 0.5, 0.5);
    p.in.mask = p.mask;
    for (int y = 0; y < 70; y++)
        for (int x = 0; x < 140; x++) {
            p.mask[y * 140 + x] = x >= 70 ? 1.0f : x == 10 ? NAN : 0.5f; /* half and NaN are excluded */
            if (x >= 70)
                p.plane[TEST][1][y * 140 + x] = 0.75f;
        }
    pair_compare(&p);
    assert_int_equal(p.out.masked.pixels, 4900);
    assert_int_equal(p.out.whole.pixels, 9800);
    REQUIRE_REL(p.out.masked.mse, 0.0625 / 3.0, 1e-12);
    REQUIRE_REL(p.out.whole.mse, 0.03125 / 3.0, 1e-12);
    REQUIRE_REL(p.out.masked.bias[1], 0.25, 1e-12);
    REQUIRE_REL(p.out.whole.rel_bias[1], 0.25, 1e-12);
    REQUIRE(p.out.masked.flip > 1.8 * p.out.whole.flip && p.out.masked.ssim < p.out.whole.ssim);
    memset(p.mask, 0, 9800 * sizeof(float));
    pair_compare(&p);
    assert_int_equal(p.out.masked.pixels, 0);
    REQUIRE(p.out.masked.mse == 0.0 && p.out.masked.ssim == 0.0 && p.out.whole.mse > 0.0);
    pair_end(&p);
}

/* Two halves of a reference with noise of variance v each, so that the variance of their mean is v/2: an exact image has an MSE of v/2
 * against the mean, which the correction removes; an image with an error keeps that error. */
static void the_references_noise_is_not_charged(void **state)
{
    RELEASE_ONLY();
    const double sd = 0.03, variance = sd * sd, error = 0.05; /* noise of one half: uniform, with this standard deviation */
    double inverse = 0.0;                                     /* mean of 1/b^2 */
    struct pair p;
    (void) state;

    pair_begin(&p, 400, 300);
    for (int x = 0; x < 400; x++)
        inverse += pow(1.0 + 0.5 * sin(0.05 * x), -2.0) / 400.0;
    for (int k = 0; k < 2; k++) {
        const double d = k ? error : 0.0;
        for (int c = 0; c < 3; c++)
            for (int y = 0; y < 300; y++)
                for (int x = 0; x < 400; x++) {
                    const double truth = 1.0 + 0.5 * sin(0.05 * x);
                    p.plane[TEST][c][y * 400 + x] = (float) (truth + d);
                    for (int h = 0; h < 2; h++)
                        p.plane[REFERENCE + h][c][y * 400 + x] = (float) (truth + sd * sqrt(12.0) * (noise(x, y, c, 20 + h) - 0.5));
                }
        for (int c = 0; c < 3; c++)
            p.in.half[c] = p.plane[HALF][c];
        pair_compare(&p);
        REQUIRE_REL(p.out.whole.noise_mse, 0.5 * variance, 0.01);
        REQUIRE_NEAR(p.out.whole.mse, d * d, 2e-5); /* 6 standard errors of 360000 values */
        REQUIRE_NEAR(p.out.whole.bias[1], d, 4e-4);
        REQUIRE_REL(p.out.whole.noise_rel_mse, 0.5 * variance * inverse, 0.02);
        REQUIRE_NEAR(p.out.whole.rel_mse, d * d * inverse, k ? 4e-5 : 1.5e-5);
        for (int c = 0; c < 3; c++)
            p.in.half[c] = NULL;
        pair_compare(&p);
        REQUIRE_REL(p.out.whole.mse, variance + d * d, 0.02); /* a single half has all of its noise counted */
        REQUIRE(p.out.whole.noise_mse == 0.0);
        for (int c = 0; c < 3; c++) { /* the same noise, given as a variance */
            for (int i = 0; i < 400 * 300; i++)
                p.plane[HALF][c][i] = (float) variance;
            p.in.variance[c] = p.plane[HALF][c];
        }
        pair_compare(&p);
        REQUIRE_REL(p.out.whole.noise_mse, variance, 1e-6);
        REQUIRE_NEAR(p.out.whole.mse, d * d, 4e-5);
        REQUIRE_REL(p.out.whole.noise_rel_mse, variance * inverse, 0.02);
        p.plane[HALF][1][77] = NAN;
        pair_compare(&p);
        REQUIRE(p.out.bad_reference == 1 && p.out.whole.pixels == 400 * 300 - 1 && isfinite(p.out.whole.mse));
        p.plane[HALF][1][78] = -1e38f; /* a variance is never negative */
        pair_compare(&p);
        REQUIRE(p.out.bad_reference == 2 && p.out.whole.pixels == 400 * 300 - 2);
        REQUIRE_REL(p.out.whole.noise_mse, variance, 1e-5);
        for (int c = 0; c < 3; c++)
            p.in.variance[c] = NULL;
    }
    pair_end(&p);
}

static bool all_finite(const struct pell_comparison *o)
{
    const struct pell_metrics *m[2] = { &o->masked, &o->whole };
    for (int i = 0; i < 2; i++) {
        const double v[] = { m[i]->mse,       m[i]->rel_mse, m[i]->mae,  m[i]->bias[0],  m[i]->bias[1],     m[i]->bias[2],
                             m[i]->noise_mse, m[i]->ssim,    m[i]->flip, m[i]->flip_hdr, m[i]->ssim_rgb[0], m[i]->rel_bias[0] };
        for (size_t k = 0; k < PELL_COUNT(v); k++)
            if (!isfinite(v[k]))
                return false;
    }
    for (int i = 0; i < o->width * o->height; i++)
        if (!isfinite(o->relative[i]) || !isfinite(o->ssim[i]) || !isfinite(o->flip[i]) || !isfinite(o->flip_hdr[i]))
            return false;
    return true;
}

static void what_is_not_finite_is_counted_and_goes_no_further(void **state)
{
    struct pair p;
    struct pell_metrics clean;
    (void) state;

    pair_begin(&p, 90, 80);
    pair_fill(&p, REFERENCE, 0.5, 0.4, 0.3);
    pair_fill(&p, TEST, 0.6, 0.4, 0.3);
    pair_compare(&p);
    clean = p.out.whole;
    p.plane[TEST][0][5] = NAN;
    p.plane[TEST][2][5] = INFINITY; /* of one pixel */
    p.plane[TEST][1][90 * 40 + 40] = -INFINITY;
    p.plane[REFERENCE][1][90 * 40 + 40] = NAN; /* both */
    p.plane[REFERENCE][2][90 * 79 + 89] = NAN;
    pair_compare(&p);
    assert_int_equal(p.out.bad_test, 2);
    assert_int_equal(p.out.bad_reference, 2);
    assert_int_equal(p.out.whole.pixels, 90 * 80 - 3);
    assert_true(all_finite(&p.out));
    REQUIRE_REL(p.out.whole.mse, clean.mse, 1e-12);
    REQUIRE_REL(p.out.whole.bias[0], clean.bias[0], 1e-12);
    REQUIRE(p.out.flip[5] < p.out.flip[90 * 20 + 20]); /* where both images agree */
    pair_end(&p);
}

/* Large, small and negative values over the range of float. */
static void wild_values_stay_finite(void **state)
{
    static const float wild[] = { 3e38f, -3e38f, 1e-40f, -1e-40f, 0.0f, -0.0f, 1e20f, -1.0f, 65504.0f, 1e-30f };
    struct pair p;
    (void) state;

    pair_begin(&p, 140, 20);
    for (int round = 0; round < 4; round++) {
        for (int i = 0; i < PICTURES; i++)
            for (int c = 0; c < 3; c++)
                for (int k = 0; k < 140 * 20; k++)
                    p.plane[i][c][k] = wild[(int) (PELL_COUNT(wild) * noise(k, round, c, i))];
        for (int c = 0; c < 3; c++)
            p.in.half[c] = round % 2 ? p.plane[HALF][c] : NULL;
        pair_compare(&p);
        assert_int_equal(p.out.bad_test + p.out.bad_reference, 0);
        assert_true(all_finite(&p.out));
        REQUIRE(p.out.whole.flip <= 1.0 && p.out.whole.flip_hdr <= 1.0 && p.out.whole.ssim <= 1.0);
    }
    pair_end(&p);
}

static void any_size_will_do(void **state)
{
    static const int sizes[][2] = { { 1, 1 }, { 1, 200 }, { 200, 1 }, { 10, 12 }, { 11, 11 }, { 128, 64 }, { 129, 65 }, { 3, 2 } };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(sizes); i++) {
        struct pair p;
        pair_begin(&p, sizes[i][0], sizes[i][1]);
        speckle(&p, (int) i);
        pair_compare(&p);
        assert_int_equal(p.out.whole.pixels, sizes[i][0] * sizes[i][1]);
        assert_true(all_finite(&p.out));
        REQUIRE(p.out.whole.flip > 0.0 && p.out.whole.ssim < 1.0 && p.out.whole.flip_hdr > 0.0);
        pair_end(&p);
    }
}

/* The stride may exceed the width; values between rows are not read. */
static void rows_may_have_a_stride(void **state)
{
    struct pell_metrics wide;
    struct pair p;
    (void) state;

    pair_begin(&p, 100, 60);
    speckle(&p, 3);
    p.in.width = 70;
    for (int i = 0; i < PICTURES; i++)
        for (int c = 0; c < 3; c++)
            for (int y = 0; y < 60; y++)
                p.plane[i][c][y * 100 + 70] = NAN;
    wide = pair_compare(&p)->whole;
    assert_int_equal(p.out.bad_test, 0);
    p.in.width = p.in.stride = 70;
    for (int i = 0; i < PICTURES; i++)
        for (int c = 0; c < 3; c++)
            for (int y = 0; y < 60; y++)
                memmove(p.plane[i][c] + y * 70, p.plane[i][c] + y * 100, 70 * sizeof(float));
    pair_compare(&p);
    assert_memory_equal(&wide, &p.out.whole, sizeof(wide));
    pair_end(&p);
}

static void figures_alone_are_the_same_without_maps(void **state)
{
    struct pair p, q;
    (void) state;

    for (int display = 0; display < 2; display++) {
        pair_begin(&p, 300, 200);
        pair_begin(&q, 300, 200);
        speckle(&p, 7);
        speckle(&q, 7);
        p.in.display = q.in.display = display == 1;
        q.in.figures_only = true;
        pair_compare(&p);
        pair_compare(&q);
        assert_memory_equal(&p.out.masked, &q.out.masked, sizeof(p.out.masked));
        assert_memory_equal(&p.out.whole, &q.out.whole, sizeof(p.out.whole));
        assert_true(p.out.relative && p.out.ssim && p.out.flip && p.out.flip_hdr);
        assert_true(!q.out.relative && !q.out.ssim && !q.out.flip && !q.out.flip_hdr);
        pair_end(&p);
        pair_end(&q);
    }
}

static void threads_and_levels_give_the_same_bits(void **state)
{
    static const char *const levels[] = { "base", "v2", "v3", "v4" };
    struct pair p, q;
    const size_t bytes = 300 * 200 * sizeof(float);
    (void) state;

    pair_begin(&p, 300, 200);
    pair_begin(&q, 300, 200);
    speckle(&p, 7);
    speckle(&q, 7);
    pair_compare(&p);
    for (int k = 0; k < 7; k++) {
        q.params.threads = k < 3 ? k + 2 : 1;
        if (k >= 3)
            setenv("PELL_SIMD", levels[k - 3], 1);
        pair_compare(&q);
        assert_memory_equal(&p.out.masked, &q.out.masked, sizeof(p.out.masked));
        assert_memory_equal(&p.out.whole, &q.out.whole, sizeof(p.out.whole));
        assert_memory_equal(p.out.relative, q.out.relative, bytes);
        assert_memory_equal(p.out.ssim, q.out.ssim, bytes);
        assert_memory_equal(p.out.flip, q.out.flip, bytes);
        assert_memory_equal(p.out.flip_hdr, q.out.flip_hdr, bytes);
    }
    unsetenv("PELL_SIMD");
    pair_end(&p);
    pair_end(&q);
}

static void curves_and_exposures_are_what_is_asked_for(void **state)
{
    struct pair p;
    double first;
    (void) state;

    pair_begin(&p, 40, 40);
    pair_fill(&p, REFERENCE, 2.0, 2.0, 2.0);
    pair_fill(&p, TEST, 4.0, 4.0, 4.0);
    for (int k = 0; k < 4; k++) { /* reinhard, aces, linear, filmic */
        const double e = 0.1, w = 8.0, a = 4.0 * e, b = 2.0 * e, fa = (double) PELL_FILMIC_SCALE * a, fb = (double) PELL_FILMIC_SCALE * b;
        const double shown[4][2] = { { a * (1.0 + a / (w * w)) / (1.0 + a), b * (1.0 + b / (w * w)) / (1.0 + b) },
                                     { pell_aces(a), pell_aces(b) },
                                     { a, b },
                                     { PELL_FILMIC_CURVE(fa), PELL_FILMIC_CURVE(fb) } };
        const double u = encoded(shown[k][0]), v = encoded(shown[k][1]);
        p.params.tonemap = k;
        p.params.exposure = 0.1f;
        p.params.white = 8.0f;
        pair_compare(&p);
        REQUIRE_NEAR(p.out.whole.ssim, (2.0 * u * v + 1e-4) / (u * u + v * v + 1e-4), 1e-3);
    }
    p.params.exposure = p.params.white = 0.0f;
    p.params.tonemap = PELL_COMPARE_REINHARD;
    first = pair_compare(&p)->whole.flip; /* exposure metered on the reference: independent of the unit */
    pair_fill(&p, REFERENCE, 2048.0, 2048.0, 2048.0);
    pair_fill(&p, TEST, 4096.0, 4096.0, 4096.0);
    REQUIRE_NEAR(pair_compare(&p)->whole.flip, first, 1e-6);
    REQUIRE_REL(p.out.exposure, 0.18 / 2048.0, 1e-6);
    pair_end(&p);
}

static void bad_arguments_are_refused(void **state)
{
    static const struct {
        float ppd, floor;
        int threads, exposures, width, height;
    } bad[] = { { 0.5f, 0.01f, 1, 0, 8, 8 }, { 401, 0.01f, 1, 0, 8, 8 },  { NAN, 0.01f, 1, 0, 8, 8 },
                { 67, 0, 1, 0, 8, 8 },       { 67, 0.01f, 257, 0, 8, 8 }, { 67, 0.01f, 1, 65, 8, 8 },
                { 67, 0.01f, 1, 0, 0, 8 },   { 67, 0.01f, 1, 0, 8, -1 },  { 67, 0.01f, 1, 0, 9, 8 } };
    struct pair p;
    (void) state;

    pair_begin(&p, 8, 8);
    for (size_t i = 0; i < PELL_COUNT(bad); i++) {
        p.params.ppd = bad[i].ppd;
        p.params.floor = bad[i].floor;
        p.params.threads = bad[i].threads;
        p.params.exposures = bad[i].exposures;
        p.in.width = bad[i].width;
        p.in.height = bad[i].height;
        memset(&p.out, 0xff, sizeof(p.out));
        assert_int_equal(pell_compare(p.ctx, &p.in, &p.params, &p.out), PELL_ERR_INVALID);
        assert_null(p.out.flip);
        assert_int_equal(p.kept.errors, (int) i + 1);
    }
    pair_end(&p);
}

static void a_cancelled_context_gives_nothing(void **state)
{
    struct pair p;
    (void) state;

    pair_begin(&p, 200, 200);
    pell_context_cancel(p.ctx);
    assert_int_equal(pell_compare(p.ctx, &p.in, &p.params, &p.out), PELL_ERR_CANCELLED);
    assert_null(p.out.relative);
    pair_end(&p);
}

static void every_failing_allocation_is_survived(void **state)
{
    struct pair p;
    uint64_t n = 1;
    (void) state;

    pair_begin(&p, 16, 16);
    for (;; n++) {
        struct pell_alloc_fault fault = { .fail_at = n };
        struct pell_context *ctx = test_context(&fault, NULL);
        struct pell_comparison out;
        enum pell_result res;
        if (!ctx)
            continue;
        p.params.threads = 2;
        res = pell_compare(ctx, &p.in, &p.params, &out);
        pell_comparison_finish(ctx, &out);
        assert_int_equal(pell_memory_used(ctx), 0);
        pell_context_destroy(&ctx);
        assert_int_equal(fault.live, 0);
        if (res == PELL_OK)
            break;
        assert_int_equal(res, PELL_ERR_NOMEM);
    }
    assert_true(n > 12);
    pair_end(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(alike_is_alike),
        cmocka_unit_test(constant_pictures_have_closed_forms),
        cmocka_unit_test(ssim_of_constants_has_a_closed_form),
        cmocka_unit_test(ssim_of_flat_areas_stays_within_its_range),
        cmocka_unit_test(ssim_is_what_its_paper_defines),
        cmocka_unit_test(a_mask_restricts_means),
        cmocka_unit_test(the_references_noise_is_not_charged),
        cmocka_unit_test(what_is_not_finite_is_counted_and_goes_no_further),
        cmocka_unit_test(wild_values_stay_finite),
        cmocka_unit_test(any_size_will_do),
        cmocka_unit_test(rows_may_have_a_stride),
        cmocka_unit_test(figures_alone_are_the_same_without_maps),
        cmocka_unit_test(threads_and_levels_give_the_same_bits),
        cmocka_unit_test(curves_and_exposures_are_what_is_asked_for),
        cmocka_unit_test(bad_arguments_are_refused),
        cmocka_unit_test(a_cancelled_context_gives_nothing),
        cmocka_unit_test(every_failing_allocation_is_survived),
    };
    return cmocka_run_group_tests_name("compare.metrics", tests, NULL, NULL);
}
