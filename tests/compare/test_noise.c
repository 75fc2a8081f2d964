/* SPDX-License-Identifier: MIT
 * test_noise.c - errors against noisy references: the mean over many seeds equals the error without noise (no bias), the reported
 * standard errors match the spread, and the Z-test has its nominal false-positive rate and rejects images that differ. */
#include "compare_test.h"

#include "compare/errors.h"

#define SIDE 64
#define PIXELS (SIDE * SIDE)

enum { SEEDS = 80, RUNS = 200 };

/* Normally distributed numbers of variance 1, by Box and Muller. */
static double normal(int i, int c, int seed)
{
    return sqrt(-2.0 * log(1.0 - noise(i, c, 1, seed))) * cos(6.28318530717958648 * noise(i, c, 2, seed));
}

/* Noise of mean 0 and standard deviation sd: normal, or skewed like light that few paths find: sums of m squared normal numbers. */
static double noise_of(double sd, bool skewed, int i, int c, int seed)
{
    const int m = (int) lrint(2.0 / (sd * sd));
    double sum = 0.0;

    if (!skewed)
        return sd * normal(i, c, seed);
    for (int k = 0; k < m; k++) {
        const double x = normal(i, c, seed + 100000 * (k + 1));
        sum += x * x / m;
    }
    return sd * (sum - 1.0) / sqrt(2.0 / m);
}

static double truth(int i)
{
    return 1.0 + 0.5 * sin(0.1 * (i % SIDE)) * cos(0.07 * (i / SIDE));
}

/* A test image that is wrong by the factor 1 + error, against halves whose mean has noise of standard deviation `sd`, relative to the
 * radiance. */
static void make(struct pair *p, double error, double sd, bool skewed, int seed)
{
    for (int c = 0; c < 3; c++) {
        for (int i = 0; i < PIXELS; i++) {
            const double b = truth(i);
            p->plane[TEST][c][i] = (float) (b * (1.0 + error * cos(0.3 * i)));
            for (int h = 0; h < 2; h++)
                p->plane[REFERENCE + h][c][i] = (float) (b * (1.0 + noise_of(sd * sqrt(2.0), skewed, i, c, 2 * seed + h)));
        }
        p->in.half[c] = p->plane[HALF][c];
    }
}

/* The value of rel_mse without noise; the floor e of the denominator is 1 % of the mean. */
static double true_error(const struct pair *p, double e)
{
    double sum = 0.0;

    for (int c = 0; c < 3; c++)
        for (int i = 0; i < PIXELS; i++) {
            const double b = truth(i), d = (double) p->plane[TEST][c][i] - b;
            sum += d * d / (b * b + e * e);
        }
    return sum / (3.0 * PIXELS);
}

/* d^2/(b^2 + e^2) with the mean of the halves as b, minus its noise bias to first order where the noise is below a tenth: the estimator
 * before the present one. */
static double naive_error(const struct pair *p, double e)
{
    double sum = 0.0;

    for (int c = 0; c < 3; c++)
        for (int i = 0; i < PIXELS; i++) {
            const double b1 = p->plane[REFERENCE][c][i], b2 = p->plane[HALF][c][i], b = 0.5 * (b1 + b2), v = 0.25 * (b1 - b2) * (b1 - b2);
            const double d = (double) p->plane[TEST][c][i] - b, below = b * b + e * e, relative = v / below;
            const double steep = relative * (4.0 * d * b / below + d * d / below * (4.0 * b * b / below - 1.0));
            sum += d * d / below - (relative < 0.1 ? steep : 0.0) - relative;
        }
    return sum / (3.0 * PIXELS);
}

struct statistics {
    double mean, spread, stated; /* spread: of one value; stated: root mean square of its reported standard errors */
};

static void add(struct statistics *s, double value, double error)
{
    s->mean += value / SEEDS;
    s->spread += value * value / SEEDS;
    s->stated += error * error / SEEDS;
}

static void end(struct statistics *s)
{
    s->spread = sqrt((s->spread - s->mean * s->mean) * SEEDS / (SEEDS - 1.0));
    s->stated = sqrt(s->stated);
}

/* The same with one image and its variance instead of two halves. */
static void set_variance(struct pair *p, double sd)
{
    for (int c = 0; c < 3; c++) {
        for (int i = 0; i < PIXELS; i++) {
            const double b = truth(i), b1 = p->plane[REFERENCE][c][i], b2 = p->plane[HALF][c][i];
            p->plane[REFERENCE][c][i] = (float) (0.5 * (b1 + b2));
            p->plane[HALF][c][i] = (float) (sd * sd * b * b);
        }
        p->in.half[c] = NULL;
        p->in.variance[c] = p->plane[HALF][c];
    }
}

static void begin(struct pair *p)
{
    pair_begin(p, SIDE, SIDE);
    p->params.ppd = 8.0f;
    p->params.exposures = 2;
}

static void errors_are_those_without_noise(void **state)
{
    static const struct {
        double sd, error;
        bool skewed, variance;
    } cases[] = { { 0.05, 0.05, false, false }, { 0.3, 0.05, false, false }, { 0.3, 0.3, true, false },  { 1.0, 0.1, false, false },
                  { 1.0, 0.5, true, false },    { 0.05, 0.05, false, true }, { 0.3, 0.05, false, true }, { 1.0, 0.1, false, true } };
    struct pair p;
    (void) state;

    begin(&p);
    for (size_t k = 0; k < PELL_COUNT(cases); k++) {
        const double sd = cases[k].sd, few = sqrt((double) SEEDS);
        struct statistics all[4] = { { 0 } }, naive = { 0 };
        double wanted[4] = { 0.0 };
        for (int seed = 0; seed < SEEDS; seed++) {
            const struct pell_metrics *m = &p.out.whole;
            make(&p, cases[k].error, sd, cases[k].skewed, seed);
            add(&naive, naive_error(&p, 0.01), 0.0);
            if (cases[k].variance)
                set_variance(&p, sd);
            pair_compare(&p);
            add(&all[0], m->rel_mse, m->rel_mse_error);
            add(&all[1], m->mse, m->mse_error);
            add(&all[2], m->bias[1], m->bias_error[1]);
            add(&all[3], m->rel_bias[2], m->rel_bias_error[2]);
            REQUIRE_REL(sqrt(m->noise_rel_mse), sd, 0.15);
            for (int c = 0; c < 3; c++)
                p.in.variance[c] = NULL;
        }
        for (int i = 0; i < PIXELS; i++) {
            const double d = (double) p.plane[TEST][1][i] - truth(i);
            wanted[1] += d * d / PIXELS;
            wanted[2] += d / PIXELS;
            wanted[3] += d / (PIXELS * 0.999984);
        }
        wanted[0] = true_error(&p, 0.01);
        for (int n = 0; n < 4; n++) {
            end(&all[n]);
            REQUIRE_NEAR(all[n].mean, wanted[n], 3.0 * all[n].stated / few + 0.006 * fabs(wanted[n]));
            REQUIRE(all[n].stated < 1.3 * all[n].spread && all[n].spread < 1.3 * all[n].stated);
        }
        REQUIRE(fabs(naive.mean - wanted[0]) > 3.0 * all[0].stated / few);
    }
    pair_end(&p);
}

static void an_error_below_the_noise_is_not_resolved(void **state)
{
    struct pair p;
    int resolved = 0;
    (void) state;

    begin(&p);
    for (int seed = 0; seed < 20; seed++) {
        make(&p, 0.03, 1.0, false, seed);
        pair_compare(&p);
        resolved += pell_metric_resolved(p.out.whole.rel_mse, p.out.whole.rel_mse_error);
        make(&p, 0.5, 1.0, false, seed);
        pair_compare(&p);
        REQUIRE(pell_metric_resolved(p.out.whole.rel_mse, p.out.whole.rel_mse_error));
    }
    assert_true(resolved <= 3);
    for (int c = 0; c < 3; c++)
        p.in.half[c] = NULL;
    pair_compare(&p);
    REQUIRE(isnan(p.out.whole.mse_error) && isnan(p.out.whole.bias_error[0]) && isnan(p.out.whole.agreement.p));
    REQUIRE(pell_metric_resolved(p.out.whole.mse, p.out.whole.mse_error));
    pair_end(&p);
}

/* Two images with variances of their own, or one without noise against halves; equal radiance, or 3 % more in one. */
static void the_z_test_keeps_its_rate(void **state)
{
    struct pair p;
    float *variance[3];
    (void) state;

    begin(&p);
    for (int c = 0; c < 3; c++)
        REQUIRE(variance[c] = malloc(PIXELS * sizeof(float)));
    for (int mode = 0; mode < 2; mode++)
        for (int bright = 0; bright < 2; bright++) {
            int rejected = 0;
            double beyond = 0.0, most = 0.0;
            for (int seed = 0; seed < RUNS; seed++) {
                make(&p, 0.0, 0.3, false, seed);
                for (int c = 0; c < 3; c++)
                    for (int i = 0; i < PIXELS; i++) {
                        const double b = truth(i), light = bright ? 1.03 * b : b;
                        p.plane[TEST][c][i] = (float) (mode ? light : light * (1.0 + 0.2 * normal(i, c, 9000 + seed)));
                        variance[c][i] = (float) (0.04 * light * light);
                    }
                if (mode == 0)
                    set_variance(&p, 0.3);
                for (int c = 0; c < 3; c++)
                    p.in.test_variance[c] = mode == 0 ? variance[c] : NULL;
                pair_compare(&p);
                rejected += p.out.whole.agreement.p < 0.05;
                most = fmax(most, p.out.whole.agreement.p);
                beyond += p.out.whole.agreement.beyond_3 / RUNS;
                assert_int_equal(p.out.whole.agreement.pixels, PIXELS);
                assert_int_equal(p.out.whole.agreement.blocks, 16);
                for (int c = 0; c < 3; c++)
                    p.in.variance[c] = p.in.test_variance[c] = NULL;
            }
            if (bright) {
                REQUIRE(rejected == RUNS && most < 0.01);
            } else { /* 10 of 200, within 3 standard errors; Bonferroni's rate is at most that */
                REQUIRE(rejected >= 1 && rejected <= 19);
            }
            if (mode == 0 && !bright)
                REQUIRE_NEAR(beyond, 0.0027, 0.0002);
            REQUIRE(mode == 0 || isnan(beyond));
        }
    for (int c = 0; c < 3; c++)
        free(variance[c]);
    pair_end(&p);
}

/* An image that differs in one corner only, which the mean over all pixels does not reveal. */
static void the_z_test_finds_what_is_local(void **state)
{
    struct pair p;
    (void) state;

    begin(&p);
    make(&p, 0.0, 0.3, false, 5);
    for (int y = 0; y < 32; y++)
        for (int x = 0; x < 16; x++)
            p.plane[TEST][2][y * SIDE + x] *= y < 16 ? 1.1f : 0.9f;
    pair_compare(&p);
    REQUIRE(p.out.whole.agreement.p < 1e-3);
    p.in.mask = p.mask;
    for (int i = 0; i < PIXELS; i++)
        p.mask[i] = i % SIDE < 16 ? 0.0f : 1.0f;
    pair_compare(&p);
    REQUIRE(p.out.masked.agreement.p > 0.01 && p.out.whole.agreement.p < 1e-3 && p.out.masked.agreement.blocks == 12);
    pair_end(&p);
}

/* 70 % of the radiance belongs to a component that the test image has 4 % too dark, in addition to a second component that is correct;
 * both have independent noise. */
static void a_part_is_measured_relative_to_the_whole(void **state)
{
    struct pair p;
    float *planes[PICTURES][3];
    struct statistics error = { 0 }, bias = { 0 };
    double wanted = 0.0;
    (void) state;

    begin(&p);
    p.in.mask = p.mask;
    for (int i = 0; i < PIXELS; i++)
        p.mask[i] = i % 5 == 0 ? 0.0f : 1.0f;
    for (int i = 0; i < PICTURES; i++)
        for (int c = 0; c < 3; c++)
            REQUIRE(planes[i][c] = calloc(PIXELS, sizeof(float)));
    for (int seed = 0; seed < SEEDS; seed++) {
        struct pell_compare_part part = { .test = { NULL } };
        struct pell_metrics m;
        for (int c = 0; c < 3; c++) {
            for (int i = 0; i < PIXELS; i++) {
                const double b = truth(i);
                planes[TEST][c][i] = (float) (0.7 * 0.96 * b);
                p.plane[TEST][c][i] = planes[TEST][c][i] + (float) (0.3 * b);
                for (int h = 0; h < 2; h++) {
                    planes[REFERENCE + h][c][i] = (float) (0.7 * b * (1.0 + noise_of(0.3, false, i, c, 4 * seed + h)));
                    p.plane[REFERENCE + h][c][i] =
                        planes[REFERENCE + h][c][i] + (float) (0.3 * b * (1.0 + noise_of(0.5, false, i, c, 4 * seed + 2 + h)));
                }
            }
            p.in.half[c] = p.plane[HALF][c];
            part.test[c] = planes[TEST][c];
            part.reference[c] = planes[REFERENCE][c];
            part.half[c] = planes[HALF][c];
        }
        pair_compare(&p);
        m = p.out.masked;
        REQUIRE(pell_errors_of_part(p.ctx, 2, &p.in, &part, &m) == PELL_OK);
        add(&error, m.rel_mse, m.rel_mse_error);
        add(&bias, m.rel_bias[1], m.rel_bias_error[1]);
        for (int c = 0; c < 3; c++) { /* the whole image is a component, too */
            part.test[c] = p.in.test[c];
            part.reference[c] = p.in.reference[c];
            part.half[c] = p.in.half[c];
        }
        REQUIRE(pell_errors_of_part(p.ctx, 1, &p.in, &part, &m) == PELL_OK);
        REQUIRE(m.rel_mse == p.out.masked.rel_mse && m.rel_mse_error == p.out.masked.rel_mse_error && m.mae == p.out.masked.mae);
    }
    for (int i = 0; i < PIXELS; i++)
        if (i % 5 != 0) {
            const double b = truth(i), d = 0.7 * 0.04 * b;
            wanted += d * d / (b * b + 1e-4) / (PIXELS - PIXELS / 5 - 1);
        }
    end(&error);
    end(&bias);
    REQUIRE_NEAR(error.mean, wanted, 3.0 * error.stated / sqrt((double) SEEDS) + 0.006 * wanted);
    REQUIRE_NEAR(bias.mean, -0.028, 3.0 * bias.stated / sqrt((double) SEEDS));
    REQUIRE(error.stated < 1.3 * error.spread && error.spread < 1.3 * error.stated);
    REQUIRE(bias.stated < 1.3 * bias.spread && bias.spread < 1.3 * bias.stated);
    for (int i = 0; i < PICTURES; i++)
        for (int c = 0; c < 3; c++)
            free(planes[i][c]);
    pair_end(&p);
}

static void bad_variances_are_counted(void **state)
{
    struct pair p;
    (void) state;

    begin(&p);
    make(&p, 0.1, 0.3, false, 1);
    set_variance(&p, 0.3);
    p.plane[HALF][0][3] = -1.0f;
    p.plane[HALF][1][4] = INFINITY;
    p.plane[REFERENCE][1][4] = NAN;
    p.plane[HALF][2][5] = NAN;
    pair_compare(&p);
    assert_int_equal(p.out.bad_reference, 3);
    assert_int_equal(p.out.bad_variance, 2);
    assert_int_equal(p.out.whole.pixels, PIXELS - 3);
    for (int c = 0; c < 3; c++)
        p.in.test_variance[c] = p.plane[HALF][c];
    pair_compare(&p);
    assert_int_equal(p.out.bad_test, 3);
    REQUIRE(isfinite(p.out.whole.rel_mse) && isfinite(p.out.whole.rel_mse_error) && p.out.whole.agreement.p <= 1.0);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < PIXELS; i++)
            p.plane[HALF][c][i] = -1.0f;
    pair_compare(&p);
    REQUIRE(p.out.whole.pixels == 0 && p.out.whole.mse == 0.0 && p.out.whole.mse_error == 0.0 && isnan(p.out.whole.agreement.p));
    pair_end(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(errors_are_those_without_noise), cmocka_unit_test(an_error_below_the_noise_is_not_resolved),
        cmocka_unit_test(the_z_test_keeps_its_rate),      cmocka_unit_test(the_z_test_finds_what_is_local),
        cmocka_unit_test(bad_variances_are_counted),      cmocka_unit_test(a_part_is_measured_relative_to_the_whole),
    };
    return cmocka_run_group_tests_name("compare.noise", tests, NULL, NULL);
}
