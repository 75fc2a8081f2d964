/* SPDX-License-Identifier: MIT
 * test_flip.c - FLIP and HDR-FLIP against a second implementation that follows the papers literally (double precision, two-dimensional
 * filters as printed), against closed forms, and against values printed by the authors' program. */
#include "compare_test.h"

#include "compare/tile.h"

#define PI 3.14159265358979323846

/* --- The papers, literally ------------------------------------------------------------------------------------------------------ */

static const double rgb_to_xyz[3][3] = {
    { 10135552.0 / 24577794, 8788810.0 / 24577794, 4435075.0 / 24577794 },
    { 2613072.0 / 12288897, 8788810.0 / 12288897, 887015.0 / 12288897 },
    { 1425312.0 / 73733382, 8788810.0 / 73733382, 70074185.0 / 73733382 },
};
static const double xyz_to_rgb[3][3] = {
    { 3.241003275, -1.537398934, -0.498615861 },
    { -0.969224334, 1.875930071, 0.041554224 },
    { 0.055639423, -0.204011202, 1.057148933 },
};
static const double white[3] = { 0.950428545, 1.0, 1.088900371 };

static void multiply(const double m[3][3], const double v[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = m[i][0] * v[0] + m[i][1] * v[1] + m[i][2] * v[2];
}

static void hunt_lab(const double rgb[3], double lab[3])
{
    const double delta = 6.0 / 29.0;
    double xyz[3], f[3];

    multiply(rgb_to_xyz, rgb, xyz);
    for (int i = 0; i < 3; i++) {
        const double t = xyz[i] / white[i];
        f[i] = t > delta * delta * delta ? cbrt(t) : t / (3.0 * delta * delta) + 4.0 / 29.0;
    }
    lab[0] = 116.0 * f[1] - 16.0;
    lab[1] = 0.01 * lab[0] * 500.0 * (f[0] - f[1]);
    lab[2] = 0.01 * lab[0] * 200.0 * (f[1] - f[2]);
}

static double hyab(const double a[3], const double b[3])
{
    return fabs(a[0] - b[0]) + hypot(a[1] - b[1], a[2] - b[2]);
}

static double largest_power(void)
{
    const double green[3] = { 0, 1, 0 }, blue[3] = { 0, 0, 1 };
    double a[3], b[3];
    hunt_lab(green, a);
    hunt_lab(blue, b);
    return pow(hyab(a, b), 0.7);
}

static double redistribute(double power)
{
    const double end = largest_power(), knee = 0.4 * end;
    return power < knee ? 0.95 / knee * power : 0.95 + (power - knee) / (end - knee) * 0.05;
}

struct picture {
    int width, height;
    const float *const *rgb; /* linear, in [0, 1] */
};

static void ycxcz(const struct picture *p, int x, int y, double out[3])
{
    const int i = (x < 0 ? 0 : x < p->width ? x : p->width - 1) + p->width * (y < 0 ? 0 : y < p->height ? y : p->height - 1);
    const double rgb[3] = { p->rgb[0][i], p->rgb[1][i], p->rgb[2][i] };
    double xyz[3];
    multiply(rgb_to_xyz, rgb, xyz);
    out[0] = 116.0 * xyz[1] / white[1] - 16.0;
    out[1] = 500.0 * (xyz[0] / white[0] - xyz[1] / white[1]);
    out[2] = 200.0 * (xyz[1] / white[1] - xyz[2] / white[2]);
}

static void filtered_lab(const struct picture *p, double ppd, int x, int y, double lab[3])
{
    static const double csf[3][4] = { { 1, 0.0047, 0, 1e-5 }, { 1, 0.0053, 0, 1e-5 }, { 34.1, 0.04, 13.5, 0.025 } };
    const int r = (int) ceil(3.0 * sqrt(0.04 / (2.0 * PI * PI)) * ppd);
    double sum[3] = { 0 }, weights[3] = { 0 }, xyz[3], rgb[3];

    for (int j = -r; j <= r; j++)
        for (int i = -r; i <= r; i++) {
            const double z = (i * i + j * j) / (ppd * ppd);
            double v[3];
            ycxcz(p, x + i, y + j, v);
            for (int c = 0; c < 3; c++) {
                const double w = csf[c][0] * sqrt(PI / csf[c][1]) * exp(-PI * PI * z / csf[c][1]) +
                                 csf[c][2] * sqrt(PI / csf[c][3]) * exp(-PI * PI * z / csf[c][3]);
                sum[c] += w * v[c];
                weights[c] += w;
            }
        }
    for (int c = 0; c < 3; c++)
        sum[c] /= weights[c];
    xyz[1] = (sum[0] + 16.0) / 116.0;
    xyz[0] = (xyz[1] + sum[1] / 500.0) * white[0];
    xyz[2] = (xyz[1] - sum[2] / 200.0) * white[2];
    multiply(xyz_to_rgb, xyz, rgb);
    for (int c = 0; c < 3; c++)
        rgb[c] = fmin(fmax(rgb[c], 0.0), 1.0);
    hunt_lab(rgb, lab);
}

/* Norm of the responses along x and y. */
static double feature(const struct picture *p, double ppd, int x, int y, bool point)
{
    const double sd = 0.5 * 0.082 * ppd;
    const int r = (int) ceil(3.0 * sd);
    double above = 0.0, below = 0.0, plus[2] = { 0 }, minus[2] = { 0 };

    for (int j = -r; j <= r; j++)
        for (int i = -r; i <= r; i++) {
            const double g = exp(-(i * i + j * j) / (2.0 * sd * sd)), w = point ? (i * i / (sd * sd) - 1.0) * g : -i * g;
            double v[2][3];
            ycxcz(p, x + i, y + j, v[0]);
            ycxcz(p, x + j, y + i, v[1]);
            *(w > 0.0 ? &above : &below) += w;
            for (int k = 0; k < 2; k++)
                (w > 0.0 ? plus : minus)[k] += w * (v[k][0] + 16.0) / 116.0;
        }
    return hypot(plus[0] / above - minus[0] / below, plus[1] / above - minus[1] / below);
}

static double flip_at(const struct picture *t, const struct picture *b, double ppd, int x, int y)
{
    double lab[2][3], color, edges, points;
    filtered_lab(t, ppd, x, y, lab[0]);
    filtered_lab(b, ppd, x, y, lab[1]);
    color = redistribute(pow(hyab(lab[0], lab[1]), 0.7));
    edges = fabs(feature(t, ppd, x, y, false) - feature(b, ppd, x, y, false));
    points = fabs(feature(t, ppd, x, y, true) - feature(b, ppd, x, y, true));
    return pow(color, 1.0 - sqrt(fmax(edges, points) / sqrt(2.0)));
}

/* --- Against the literal implementation ----------------------------------------------------------------------------------------- */

/* Smooth colours, edges, points and noise. */
static void paint(struct pair *p, double scale)
{
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < p->height; y++)
            for (int x = 0; x < p->width; x++) {
                const int i = y * p->width + x;
                const double smooth = 0.5 + 0.4 * sin(0.11 * x + 0.07 * y + 2.0 * c), bar = x > p->width / 2 ? 0.6 : 1.0;
                p->plane[REFERENCE][c][i] = (float) (scale * smooth * bar);
                p->plane[TEST][c][i] = (float) (scale * fmin(smooth * (x > p->width / 2 + 2 ? 0.55 : 1.0) + 0.15 * noise(x, y, c, 1) -
                                                                 (x % 17 == 3 && y % 13 == 5 ? 0.3 : 0.0),
                                                             1.0));
                if (!(p->plane[TEST][c][i] > 0.0f))
                    p->plane[TEST][c][i] = 0.0f;
            }
}

static void flip_is_what_its_paper_defines(void **state)
{
    static const double ppds[] = { 67.0206432765, 20.0, 1.0, 110.5 };
    struct pair p;
    (void) state;

    pair_begin(&p, 150, 71); /* more than one tile in both directions */
    paint(&p, 1.0);
    p.in.display = true;
    for (size_t k = 0; k < PELL_COUNT(ppds); k++) {
        const struct picture t = { p.width, p.height, p.in.test }, b = { p.width, p.height, p.in.reference };
        p.params.ppd = (float) ppds[k];
        pair_compare(&p);
        for (int i = 0; i < (k == 0 ? 400 : 60); i++) {
            const int x = i < 4 ? i % 2 * 149 : (int) (150.0 * noise(i, 0, 0, 9)),
                      y = i < 4 ? i / 2 * 70 : (int) (71.0 * noise(i, 1, 0, 9));
            REQUIRE_NEAR(p.out.flip[y * p.width + x], flip_at(&t, &b, (double) p.params.ppd, x, y), 2e-5);
        }
        assert_true(p.out.whole.flip > 0.03 && p.out.whole.flip < 0.9);
    }
    pair_end(&p);
}

/* Constant images: filters do nothing, features are 0, and the error depends on two colours alone. */
static void constant_pictures_have_closed_forms(void **state)
{
    static const double colors[][3] = {
        { 0, 0, 0 }, { 1, 1, 1 }, { 0, 1, 0 }, { 0, 0, 1 }, { 1, 0, 0 }, { 0.2, 0.5, 0.1 }, { 0.001, 0.002, 0.001 },
    };
    struct pair p;
    (void) state;

    pair_begin(&p, 37, 21);
    p.in.display = true;
    for (size_t i = 0; i < PELL_COUNT(colors); i++)
        for (size_t j = 0; j < PELL_COUNT(colors); j++) {
            double a[3], b[3], expected;
            hunt_lab(colors[i], a);
            hunt_lab(colors[j], b);
            expected = redistribute(pow(hyab(a, b), 0.7));
            pair_fill(&p, TEST, colors[i][0], colors[i][1], colors[i][2]);
            pair_fill(&p, REFERENCE, colors[j][0], colors[j][1], colors[j][2]);
            pair_compare(&p);
            REQUIRE_NEAR(p.out.whole.flip, expected, i == j ? 0.0 : 3e-5);
            REQUIRE_NEAR(p.out.flip[400], expected, i == j ? 0.0 : 3e-5);
        }
    pair_fill(&p, TEST, 0, 1, 0);
    pair_fill(&p, REFERENCE, 0, 0, 1);
    REQUIRE_NEAR(pair_compare(&p)->whole.flip, 1.0, 1e-5); /* the largest possible colour difference */
    pair_fill(&p, TEST, 0, 0, 0);
    pair_fill(&p, REFERENCE, 1, 1, 1);
    REQUIRE_NEAR(pair_compare(&p)->whole.flip, 0.967382, 2e-5); /* 0.95 + 0.05 (100^0.7 - 0.4 m)/(0.6 m), m = 41.2761 */
    pair_end(&p);
}

/* Test and reference may be swapped, and images may be mirrored and rotated, without a change of the error. */
static void flip_is_symmetric(void **state)
{
    struct pair p, q;
    (void) state;

    pair_begin(&p, 60, 60);
    pair_begin(&q, 60, 60);
    paint(&p, 1.0);
    p.in.display = q.in.display = true;
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < 60; y++)
            for (int x = 0; x < 60; x++) {
                q.plane[TEST][c][x * 60 + 59 - y] = p.plane[REFERENCE][c][y * 60 + x];
                q.plane[REFERENCE][c][x * 60 + 59 - y] = p.plane[TEST][c][y * 60 + x];
            }
    pair_compare(&p);
    pair_compare(&q);
    for (int y = 0; y < 60; y++)
        for (int x = 0; x < 60; x++)
            REQUIRE_NEAR(p.out.flip[y * 60 + x], q.out.flip[x * 60 + 59 - y], 1e-5);
    REQUIRE_NEAR(p.out.whole.flip, q.out.whole.flip, 1e-6);
    pair_end(&p);
    pair_end(&q);
}

/* A change of one pixel raises the error there and nowhere beyond the filters' radius; a larger change raises it more. */
static void one_pixel_is_seen_where_it_is(void **state)
{
    float last = 0.0f;
    struct pair p;
    (void) state;

    pair_begin(&p, 61, 61);
    p.in.display = true;
    for (int step = 1; step <= 4; step++) {
        pair_fill(&p, TEST, 0.4, 0.4, 0.4);
        pair_fill(&p, REFERENCE, 0.4, 0.4, 0.4);
        for (int c = 0; c < 3; c++)
            p.plane[TEST][c][30 * 61 + 30] = 0.4f + 0.1f * (float) step;
        pair_compare(&p);
        for (int y = 0; y < 61; y++)
            for (int x = 0; x < 61; x++) {
                const float v = p.out.flip[y * 61 + x];
                REQUIRE(v <= p.out.flip[30 * 61 + 30]);
                if (abs(x - 30) > 10 || abs(y - 30) > 10)
                    REQUIRE(v < 1e-5f);
            }
        REQUIRE(p.out.flip[30 * 61 + 30] > last);
        last = p.out.flip[30 * 61 + 30];
    }
    pair_end(&p);
}

/* --- HDR ------------------------------------------------------------------------------------------------------------------------ */

/* The authors' program prints -12.5423 to 0.9427 and 14 exposures for its example; the largest and median luminance below follow from
 * these. */
static void the_range_of_exposures_is_that_of_the_paper(void **state)
{
    double start, stop, x;
    int count;
    (void) state;

    pell_flip_exposures(pow(2.0, 12.5423), pow(2.0, -0.9427), &start, &stop, &count);
    x = exp2(start) * pow(2.0, 12.5423);
    REQUIRE_NEAR(pell_aces(x), 0.85, 1e-9);
    REQUIRE_NEAR(pell_aces(exp2(stop) * pow(2.0, -0.9427)), 0.85, 1e-9);
    REQUIRE_NEAR(stop - start, 12.5423 + 0.9427, 1e-12);
    assert_int_equal(count, 14);
    pell_flip_exposures(1.0, 1.0, &start, &stop, &count);
    assert_int_equal(count, 2);
    REQUIRE_NEAR(start, stop, 0.0);
    pell_flip_exposures(8.0, 1.0, &start, &stop, &count);
    assert_int_equal(count, 3);
    REQUIRE(pell_aces(0.0) == 0.0 && pell_aces(1e30) == 1.0);
}

static void hdr_flip_is_the_largest_over_exposures(void **state)
{
    struct pair p;
    double step;
    float *aces[2][3];
    (void) state;

    pair_begin(&p, 70, 40);
    paint(&p, 3.0);
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < 6; y++)
            for (int x = 0; x < 6; x++)
                p.plane[REFERENCE][c][y * 70 + x] = 90.0f; /* a light */
    pair_compare(&p);
    assert_true(p.out.hdr_exposures >= 5 && !p.out.hdr_above_black);
    REQUIRE_NEAR(pell_aces(exp2(p.out.hdr_start) * 90.0), 0.85, 1e-6);
    step = (p.out.hdr_stop - p.out.hdr_start) / (p.out.hdr_exposures - 1);
    for (int i = 0; i < 2; i++)
        for (int c = 0; c < 3; c++)
            REQUIRE(aces[i][c] = malloc(70 * 40 * sizeof(float)));
    for (int i = 0; i < 40; i++) {
        const int x = (int) (70.0 * noise(i, 0, 0, 3)), y = (int) (40.0 * noise(i, 1, 0, 3));
        double largest = 0.0;
        for (int k = 0; k < p.out.hdr_exposures; k++) {
            const struct picture t = { 70, 40, (const float *const *) aces[0] }, b = { 70, 40, (const float *const *) aces[1] };
            for (int v = 0; v < 70 * 40; v++)
                for (int c = 0; c < 3; c++) {
                    aces[0][c][v] = (float) pell_aces(exp2(p.out.hdr_start + k * step) * (double) p.plane[TEST][c][v]);
                    aces[1][c][v] = (float) pell_aces(exp2(p.out.hdr_start + k * step) * (double) p.plane[REFERENCE][c][v]);
                }
            largest = fmax(largest, flip_at(&t, &b, (double) p.params.ppd, x, y));
        }
        REQUIRE_NEAR(p.out.flip_hdr[y * 70 + x], largest, 3e-5);
    }
    for (int i = 0; i < 2; i++)
        for (int c = 0; c < 3; c++)
            free(aces[i][c]);
    pair_end(&p);
}

/* HDR-FLIP is independent of the unit: multiplying both images by a power of two gives the same error. */
static void hdr_flip_does_not_depend_on_the_unit(void **state)
{
    struct pair p;
    double first = 0.0;
    (void) state;

    pair_begin(&p, 50, 50);
    for (int k = 0; k < 3; k++) {
        paint(&p, k == 0 ? 1.0 : k == 1 ? 1024.0 : 1.0 / 1024.0);
        pair_compare(&p);
        first = k == 0 ? p.out.whole.flip_hdr : first;
        REQUIRE_NEAR(p.out.whole.flip_hdr, first, 1e-6);
    }
    REQUIRE(first > 0.05);
    pair_end(&p);
}

/* An object in front of black: the median over the whole image is 0, and no exposure would map anything to 0.85. */
static void black_around_an_object_is_no_trap(void **state)
{
    struct pair p;
    (void) state;

    pair_begin(&p, 64, 64);
    for (int c = 0; c < 3; c++)
        for (int y = 20; y < 40; y++)
            for (int x = 20; x < 40; x++) {
                p.plane[REFERENCE][c][y * 64 + x] = 0.5f;
                p.plane[TEST][c][y * 64 + x] = 0.6f;
            }
    pair_compare(&p);
    assert_true(p.out.hdr_above_black);
    assert_int_equal(p.out.hdr_exposures, 2);
    REQUIRE(p.out.whole.flip_hdr > 0.0 && isfinite(p.out.hdr_start) && isfinite(p.out.hdr_stop));
    pair_fill(&p, REFERENCE, 0, 0, 0);
    pair_compare(&p);
    assert_int_equal(p.out.hdr_exposures, 1);
    REQUIRE(p.out.whole.flip_hdr > 0.0 && isinf(p.out.whole.rel_mse));
    pair_end(&p);
}

/* --- Levels --------------------------------------------------------------------------------------------------------------------- */

static void powers_and_roots_are_right_to_a_millionth(void **state)
{
    enum { N = 4096 };
    static float x[N], power[N], root[N], other[N];
    const enum pell_simd_level best = pell_simd_best();
    (void) state;

    for (int i = 0; i < N; i++)
        x[i] = i < 8 ? (float[]) { 0.0f, 1.0f, 1e4f, 0.5f, 2.0f, 1e-20f, 0.70710678f, 0.70710684f }[i]
                     : (float) pow(10.0, 10.0 * noise(i, 0, 0, 1) - 6.0);
    for (int k = 0; k < 5; k++) {
        const float e = (float[]) { 0.7f, 0.5f, 1.0f, 1.0f / 2.4f, 0.03f }[k];
        pell_tile_tables[0]->power(x, e, power, N);
        for (int i = 0; i < N; i++)
            REQUIRE_REL(power[i], pow((double) x[i], (double) e), 2e-6);
        for (int level = 1; level <= (int) best; level++) {
            pell_tile_tables[level]->power(x, e, other, N);
            assert_memory_equal(power, other, sizeof(power));
        }
    }
    pell_tile_tables[0]->cube_root(x + 1, root, N - 1);
    for (int i = 0; i < N - 1; i++)
        REQUIRE_REL(root[i], cbrt((double) x[i + 1]), 4e-7);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(flip_is_what_its_paper_defines),
        cmocka_unit_test(constant_pictures_have_closed_forms),
        cmocka_unit_test(flip_is_symmetric),
        cmocka_unit_test(one_pixel_is_seen_where_it_is),
        cmocka_unit_test(the_range_of_exposures_is_that_of_the_paper),
        cmocka_unit_test(hdr_flip_is_the_largest_over_exposures),
        cmocka_unit_test(hdr_flip_does_not_depend_on_the_unit),
        cmocka_unit_test(black_around_an_object_is_no_trap),
        cmocka_unit_test(powers_and_roots_are_right_to_a_millionth),
    };
    return cmocka_run_group_tests_name("compare.flip", tests, NULL, NULL);
}
