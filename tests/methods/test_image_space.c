/* SPDX-License-Identifier: MIT
 * test_image_space.c - the image-space method on hand-made planes: its estimates against closed forms and against sums over every
 * visible surface element. */
#include "image_patches.h"
#include "slow.h"

#include "math/vec.h"

#include <pellucid/inversion.h>

/* --- Closed forms: a plane, lit beyond an edge -------------------------------------------------------------------------------------- */

/* Error of a pixel in column x, as a fraction of the total; the plane is slanted by `slope` to the side. */
static double step_error(const struct patch *p, const struct pell_frame_material *m, int c, int x, int y, double depth, double slope)
{
    const double f = (double) p->frame.shape.focal_px, tan = (x + 0.5 - 0.5 * p->frame.shape.width) / f, z = depth / (1.0 - slope * tan);
    const double along = (p->frame.shape.orthographic ? tan : tan * z) * sqrt(1.0 + slope * slope);
    return ((double) p->result[c][patch_at(p, x, y)] - step_of(m, c, along)) / pell_gaussians_total(&m->gaussians, c);
}

static void half_lit_planes_are_the_analytic_convolution(void **state)
{
    RELEASE_ONLY();
    static const double slopes[] = { 0.0, 0.6, -1.7 };
    static const char *const forms[][5] = { { "samples=1024", "tile=1", "renormalise=off", NULL },
                                            { "samples=1024", "tile=1", NULL },
                                            { "samples=1024", "tile=1", "renormalise=off", "sampling=importance", NULL } };
    const struct pell_frame_material m = narrow();
    struct test_device at = test_device_create(2, NULL, NULL);

    (void) state;
    for (int parallel = 0; parallel < 2; parallel++)
        for (size_t s = 0; s < PELL_COUNT(slopes); s++)
            for (size_t k = 0; k < PELL_COUNT(forms); k++) {
                struct patch *p = patch_create(140, SLOW ? 41 : 81, parallel, parallel ? 4.0 : 2400.0, 600.0, &m, 1);
                double worst = 0.0;
                patch_tilt(p, 600.0, slopes[s], 0.0);
                light_a_half(p);
                p->frame.rect = (struct pell_rect) { 0, 0, p->frame.shape.width, p->frame.shape.height };
                patch_run(&at, method(at.ctx), forms[k], p);
                /* In the middle row, so far from the ends that they have no effect. */
                for (int x = 40; x < 100; x++)
                    for (int c = 0; c < 3; c++)
                        worst = fmax(worst, fabs(step_error(p, &m, c, x, p->frame.shape.height / 2, 600.0, slopes[s])));
                if (parallel == 0)
                    print_message("# slope %4.1f, form %zu: %.4f of the step at most\n", slopes[s], k, worst);
                REQUIRE(worst < (SLOW ? 0.03 : 0.008));
                patch_destroy(p);
            }
    test_device_destroy(&at);
}

/* The mean over tiles of the estimates of 4 samples is the closed form: no bias except discretisation by pixels. */
static void the_mean_of_few_samples_is_the_closed_form(void **state)
{
    static const char *const sampling[] = { "sampling=combined", "sampling=separate", "sampling=importance" };
    const struct pell_frame_material m = narrow();
    struct test_device at = test_device_create(2, NULL, NULL);

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(sampling); k++) {
        const char *const few[] = { "samples=4", "tile=8", "renormalise=off", "reconstruct=off", sampling[k], NULL };
        struct patch *p = patch_create(144, 144, true, 4.0, 600.0, &m, 1);
        double sum = 0.0, square = 0.0, spread = 0.0, worst = 0.0;
        int count = 0;
        /* Eight edges, a pixel apart, so that each column has all patterns: columns of tiles are averaged. */
        for (int shift = 0; shift < 8; shift++) {
            for (int y = 0; y < 144; y++)
                for (int x = 0; x < 144; x++)
                    for (int c = 0; c < 3; c++)
                        p->light[c][patch_at(p, x, y)] = x >= 68 + shift;
            patch_run(&at, method(at.ctx), few, p);
            for (int x = 48; x < 96; x++)
                for (int c = 0; c < 3; c++) {
                    double mean = 0.0;
                    for (int y = 64; y < 72; y++) {
                        const double e = (double) p->result[c][patch_at(p, x, y)] - step_of(&m, c, (x + 0.5 - 68 - shift) / 4.0);
                        mean += e / 8.0;
                        spread += e * e;
                    }
                    sum += mean;
                    square += mean * mean;
                    count++;
                }
        }
        worst = fabs(sum / count);
        print_message("# 4 samples, %s: rms error %.4f, mean over tiles off by %.5f\n", sampling[k], sqrt(spread / (8.0 * count)), worst);
        REQUIRE(worst < 0.005); /* 256 samples in all */
        REQUIRE(square / count < spread / (8.0 * count));
        patch_destroy(p);
    }
    test_device_destroy(&at);
}

/* --- Sums over what is visible ------------------------------------------------------------------------------------------------------- */

/* A point of the ball, and the surface area that a subpixel covers there. */
static double ball_patch(const struct patch *p, double x, double y, double part, double at[3])
{
    const double tx = patch_tan_x(p, x), ty = patch_tan_y(p, y), z = ball_depth(p, x, y), f = (double) p->frame.shape.focal_px;
    double facing;

    if (!(z > 0.0))
        return 0.0;
    at[0] = tx * z;
    at[1] = ty * z;
    at[2] = z;
    facing = -(tx * at[0] + ty * at[1] + (z - BALL_AT)) / BALL_MM; /* -n . t */
    return part * z * z / (f * f * fmax(facing, 0.02));
}

/* M of a pixel by the sum over all visible elements of the ball, N x N per pixel. */
static void visible_sum(const struct patch *p, const struct pell_frame_material *m, int px, int py, double out[3])
{
    double from[3] = { 0 };

    ball_patch(p, px, py, 1.0, from);
    out[0] = out[1] = out[2] = 0.0;
    for (int y = 0; y < 80; y++)
        for (int x = 0; x < 80; x++) {
            const size_t i = patch_at(p, x, y);
            const int n = abs(x - px) + abs(y - py) < 6 ? 6 : 3;
            if (!p->material[i])
                continue;
            for (int s = 0; s < n * n; s++) {
                double at[3], d2 = 0.0;
                const double area = ball_patch(p, x - 0.5 + (s % n + 0.5) / n, y - 0.5 + (s / n + 0.5) / n, 1.0 / (n * n), at);
                for (int k = 0; k < 3 && area > 0.0; k++)
                    d2 += (at[k] - from[k]) * (at[k] - from[k]);
                for (int g = 0; g < 3 && area > 0.0; g++) {
                    const double v = m->gaussians.variance[g], r = exp(-d2 / (2.0 * v)) / (2.0 * PELL_PI * v) * area;
                    for (int c = 0; c < 3; c++)
                        out[c] += m->gaussians.weight[g][c] * r * (double) p->light[c][i];
                }
            }
        }
}

enum { PLACES = 60 };

struct truth {
    int x[PLACES], y[PLACES];
    double value[PLACES][3], mean;
};

/* Points all over the ball that are seen at less than 60 degrees to the normal. */
static void make_truth(const struct patch *p, const struct pell_frame_material *m, struct truth *t)
{
    t->mean = 0.0;
    for (int i = 0, k = 0; i < PLACES; k++) {
        const int x = (int) (80.0f * standard_error((unsigned) k, 1, 0)), y = (int) (80.0f * standard_error((unsigned) k, 2, 0));
        if (hypot(x - 39.5, y - 39.5) > 0.86 * BALL_MM * BALL_PX)
            continue;
        t->x[i] = x;
        t->y[i] = y;
        visible_sum(p, m, x, y, t->value[i]);
        t->mean += (t->value[i][0] + t->value[i][1] + t->value[i][2]) / (3 * PLACES);
        i++;
    }
}

/* Root mean square of the errors at these points, and their mean, relative to the mean. */
static double errors(const struct patch *p, const struct truth *t, double *bias)
{
    double square = 0.0, sum = 0.0;

    for (int i = 0; i < PLACES; i++)
        for (int c = 0; c < 3; c++) {
            const double e = (double) p->result[c][patch_at(p, t->x[i], t->y[i])] - t->value[i][c];
            square += e * e;
            sum += e;
        }
    if (bias)
        *bias = sum / (3 * PLACES) / t->mean;
    return sqrt(square / (3 * PLACES)) / t->mean;
}

static void many_samples_converge_to_the_visible_surface(void **state)
{
    static const char *const sampling[] = { "sampling=combined", "sampling=separate", "sampling=importance", "sampling=uniform" };
    const struct pell_frame_material m = narrow();
    struct test_device at = test_device_create(2, NULL, NULL);
    struct patch *p = ball(&m);
    struct truth t;

    (void) state;
    make_truth(p, &m, &t);
    for (size_t k = 0; k < (SLOW ? 1 : PELL_COUNT(sampling)); k++) {
        double error[6], slope_x = 0.0, slope_y = 0.0, xx = 0.0, xy = 0.0, bias = 0.0;
        const int most = SLOW || k > 0 ? 5 : 6;
        for (int n = 0; n < most; n++) {
            char samples[32];
            const char *const settings[] = { samples, "renormalise=off", "reconstruct=off", sampling[k], NULL };
            snprintf(samples, sizeof(samples), "samples=%d", 4 << (2 * n));
            patch_run(&at, method(at.ctx), settings, p);
            error[n] = errors(p, &t, &bias);
        }
        for (int n = 0; n < 5; n++) {
            slope_x += n / 5.0;
            slope_y += log(error[n]) / log(4.0) / 5.0;
        }
        for (int n = 0; n < 5; n++) {
            xx += (n - slope_x) * (n - slope_x);
            xy += (n - slope_x) * (log(error[n]) / log(4.0) - slope_y);
        }
        print_message("# %s: rms error %.4f at 4 samples, %.4f at 16, %.4f at 64, %.4f at 256, %.4f at 1024, %.4f at 4096, bias %.4f; "
                      "slope %.2f to 1024\n",
                      sampling[k], error[0], error[1], error[2], error[3], error[4], most > 5 ? error[5] : 0.0, bias, xy / xx);
        if (k == 0) {
            REQUIRE(xy / xx < -0.5);
            REQUIRE(error[most - 1] < 0.01);
            REQUIRE(fabs(bias) < 0.005);
        }
    }
    patch_destroy(p);
    test_device_destroy(&at);
}

/* The silhouette of the ball: effect of renormalisation. `off`: the visible part only; on a ball uniform light returns the whole total. */
static void what_renormalising_does_at_silhouettes(void **state)
{
    static const char *const forms[] = { "renormalise=off", "renormalise=count", "renormalise=weight" };
    const struct pell_frame_material m = narrow();
    struct test_device at = test_device_create(2, NULL, NULL);
    struct patch *p = ball(&m);

    (void) state;
    patch_light(p, 1.0f, 1.0f, 1.0f);
    for (size_t k = 0; k < PELL_COUNT(forms); k++) {
        const char *const settings[] = { "samples=256", "reconstruct=off", forms[k], k == 1 ? "sampling=separate" : NULL, NULL };
        double ring[2][2] = { { 0 } };
        patch_run(&at, method(at.ctx), settings, p);
        for (int y = 0; y < 80; y++)
            for (int x = 0; x < 80; x++) {
                const double r = hypot(x - 39.5, y - 39.5) / (BALL_MM * BALL_PX);
                const int rim = r > 0.9;
                if (!p->material[patch_at(p, x, y)] || (!rim && r > 0.5))
                    continue;
                ring[rim][0] += (double) p->result[1][patch_at(p, x, y)] / pell_gaussians_total(&m.gaussians, 1);
                ring[rim][1] += 1.0;
            }
        print_message("# %s: uniform light on a ball gives %.4f of the total in the middle, %.4f beyond 0.9 of the radius\n", forms[k],
                      ring[0][0] / ring[0][1], ring[1][0] / ring[1][1]);
        REQUIRE_NEAR(ring[0][0] / ring[0][1], 1.0, 0.02);
        if (k == 0)
            REQUIRE(ring[1][0] / ring[1][1] > 0.6 && ring[1][0] / ring[1][1] < 0.95); /* half of the neighbourhood is hidden there */
        if (k == 1)
            REQUIRE(ring[1][0] / ring[1][1] > 0.85);
        if (k == 2)
            REQUIRE_NEAR(ring[1][0] / ring[1][1], 1.0, 1e-4);
    }
    patch_destroy(p);
    test_device_destroy(&at);
}

/* --- Two kinds of samples -------------------------------------------------------------------------------------------------------- */

/* Errors of 16 samples near a shadow edge, for a total of 1. */
static void combined_samples_beat_either_kind_at_a_shadow(void **state)
{
    RELEASE_ONLY();
    static const char *const sampling[] = { "sampling=importance", "sampling=uniform", "sampling=combined", "sampling=separate" };
    const struct pell_frame_material m = medium("skin1");
    struct pell_profile *profile = calloc(3, sizeof(*profile));
    struct test_device at = test_device_create(2, NULL, NULL);
    double rms[4] = { 0 };

    (void) state;
    for (int c = 0; c < 3; c++)
        assert_int_equal(pell_profile_make(PELL_PROFILE_DIPOLE, &m.medium, c, NULL, &profile[c]), PELL_OK);
    struct patch *p = patch_create(192, 192, true, 4.0, 600.0, &m, 1), *q = patch_create(192, 192, true, 4.0, 600.0, &m, 1);
    static const char *const many[] = { "samples=2048", "tile=1", "renormalise=off", NULL };
    light_a_half(p);
    light_a_half(q);
    patch_run(&at, method(at.ctx), SLOW ? (const char *const[]) { "samples=1024", "tile=1", "renormalise=off", NULL } : many, q);
    for (size_t k = 0; k < 4; k++) {
        const char *const settings[] = { "samples=16", "tile=8", "renormalise=off", "reconstruct=off", "adaptive=off", sampling[k], NULL };
        double square[5] = { 0 }, value[5] = { 0 };
        for (int shift = 0; shift < 8; shift++) { /* each pattern of the tile at each distance from the edge */
            for (int y = 0; y < 192; y++)
                for (int x = 0; x < 192; x++)
                    for (int c = 0; c < 3; c++)
                        p->light[c][patch_at(p, x, y)] = x >= 96 + shift;
            patch_run(&at, method(at.ctx), settings, p);
            for (int y = 96; y < 104; y++)
                for (int x = 64; x < 128; x++)
                    for (int c = 0; c < 3; c++) {
                        const double truth = (double) q->result[c][patch_at(q, x, 96)];
                        const double e = (double) p->result[c][patch_at(p, x + shift, y)] - truth;
                        const int b = x < 72 ? 0 : x < 80 ? 1 : x < 88 ? 2 : x < 96 ? 3 : 4;
                        square[b] += e * e;
                        value[b] += truth * truth;
                        rms[k] += e * e / (truth * truth + 1e-4);
                    }
        }
        rms[k] = sqrt(rms[k] / (64 * 64 * 3));
        print_message("# 16 samples, %s: rms error over rms of M %.3f 6 to 8 mm into the shadow, %.3f 4 to 6, %.3f 2 to 4, %.3f 0 to 2, "
                      "%.3f in the light; relative %.4f\n",
                      sampling[k], sqrt(square[0] / value[0]), sqrt(square[1] / value[1]), sqrt(square[2] / value[2]),
                      sqrt(square[3] / value[3]), sqrt(square[4] / value[4]), rms[k]);
    }
    for (int k = 0; k < 2; k++)
        REQUIRE(rms[2] < rms[k]);
    patch_destroy(p);
    patch_destroy(q);
    test_device_destroy(&at);
    free(profile);
}

/* --- Reconstruction ---------------------------------------------------------------------------------------------------------------- */

static void reconstruction_keeps_light_and_takes_noise(void **state)
{
    static const char *const with[] = { "samples=16", NULL }, *const without[] = { "samples=16", "reconstruct=off", NULL };
    static const char *const many[] = { "samples=4096", "reconstruct=off", NULL };
    const struct pell_frame_material m = narrow();
    struct test_device at = test_device_create(2, NULL, NULL);
    struct patch *p = ball(&m), *q = ball(&m), *r = ball(&m);

    (void) state;
    patch_run(&at, method(at.ctx), with, p);
    patch_run(&at, method(at.ctx), without, q);
    patch_run(&at, method(at.ctx), SLOW ? (const char *const[]) { "samples=512", "reconstruct=off", NULL } : many, r);
    for (int c = 0; c < 3; c++) {
        double error[2][2] = { { 0 } };
        REQUIRE_REL(patch_sum(p, p->result, c), patch_sum(q, q->result, c), 1e-5);
        for (int y = 0; y < 80; y++)
            for (int x = 0; x < 80; x++) {
                const size_t i = patch_at(p, x, y);
                const int rim = hypot(x - 39.5, y - 39.5) > 0.85 * BALL_MM * BALL_PX;
                if (!p->material[i])
                    continue;
                error[rim][0] += pow((double) p->result[c][i] - (double) r->result[c][i], 2.0);
                error[rim][1] += pow((double) q->result[c][i] - (double) r->result[c][i], 2.0);
            }
        for (int rim = 0; rim < 2; rim++)
            print_message("# 16 samples, channel %d%s: squared error %.3f with reconstruction of that without (%.5f rms)\n", c,
                          rim ? ", rim" : "", error[rim][0] / error[rim][1], sqrt(error[rim][1] / (rim ? 1100 : 2900)));
        REQUIRE(c == 2 || error[0][0] < 0.5 * error[0][1]); /* half of channel 2 stays within 1.5 pixels */
        REQUIRE(error[0][0] < error[0][1] && error[1][0] < 1.01 * error[1][1]);
    }
    patch_destroy(p);
    patch_destroy(q);
    patch_destroy(r);
    test_device_destroy(&at);
}

/* Where light stays within a pixel there is no noise to reduce, and detail is preserved. */
static void reconstruction_leaves_what_is_sharp(void **state)
{
    static const double variance[1] = { 1e-3 }, one[1][3] = { { 1.0, 1.0, 1.0 } };
    const struct pell_frame_material m = patch_gaussians(1, variance, one);
    struct test_device at = test_device_create(1, NULL, NULL);
    struct patch *p = patch_create(60, 60, true, 1.0, 100.0, &m, 1);

    (void) state;
    for (int y = 0; y < 60; y++)
        for (int x = 0; x < 60; x++)
            p->light[0][patch_at(p, x, y)] = standard_error((unsigned) x, (unsigned) y, 0);
    patch_run(&at, method(at.ctx), NULL, p);
    for (int y = 0; y < 60; y++)
        for (int x = 0; x < 60; x++)
            REQUIRE_NEAR((double) p->result[0][patch_at(p, x, y)], (double) p->light[0][patch_at(p, x, y)], 1e-6);
    patch_destroy(p);
    test_device_destroy(&at);
}

/* Two sheets of one material, one in front of the other: light crosses the gap only as far as the profile reaches. */
static void sheets_far_apart_do_not_mix(void **state)
{
    static const char *const settings[][2] = { { "renormalise=weight", NULL }, { "renormalise=off", NULL } };
    const struct pell_frame_material m = narrow();
    struct test_device at = test_device_create(1, NULL, NULL);

    (void) state;
    for (int k = 0; k < 2; k++) {
        struct patch *p = patch_create(100, 60, false, 2400.0, 600.0, &m, 1);
        for (int y = 0; y < 60; y++)
            for (int x = 0; x < 100; x++) {
                const size_t i = patch_at(p, x, y);
                p->depth[i] = x < 50 ? 600.0f : 640.0f;
                for (int c = 0; c < 3; c++)
                    p->light[c][i] = x < 50;
            }
        patch_run(&at, method(at.ctx), settings[k], p);
        for (int y = 0; y < 60; y++)
            for (int x = 50; x < 100; x++)
                for (int c = 0; c < 3; c++)
                    REQUIRE((double) p->result[c][patch_at(p, x, y)] < 1e-4);
        patch_destroy(p);
    }
    test_device_destroy(&at);
}

/* --- Knobs ---------------------------------------------------------------------------------------------------------------------------- */

/* Strength 1/2 is the profile of half the width. */
static void strength_scales_the_radius(void **state)
{
    static const char *const settings[] = { "samples=1024", "tile=1", NULL };
    struct pell_frame_material m = narrow(), half = narrow();
    struct test_device at = test_device_create(2, NULL, NULL);
    struct patch *p = patch_create(100, 40, true, 4.0, 600.0, &m, 1), *q = patch_create(100, 40, true, 4.0, 600.0, &half, 1);

    (void) state;
    for (int i = 0; i < 3; i++)
        half.gaussians.variance[i] *= 0.25;
    light_a_half(p);
    light_a_half(q);
    for (size_t i = 0; i < (size_t) p->frame.shape.stride * 40; i++)
        p->strength[i] = 0.5f;
    patch_run(&at, method(at.ctx), settings, p);
    patch_run(&at, method(at.ctx), settings, q);
    for (int x = 0; x < 100; x++)
        for (int c = 0; c < 3; c++)
            REQUIRE_NEAR((double) p->result[c][patch_at(p, x, 20)], (double) q->result[c][patch_at(q, x, 20)], 0.005);
    for (size_t i = 0; i < (size_t) p->frame.shape.stride * 40; i++)
        p->strength[i] = 0.0f;
    patch_run(&at, method(at.ctx), settings, p);
    for (int x = 0; x < 100; x++)
        REQUIRE_NEAR((double) p->result[0][patch_at(p, x, 20)], x >= 50 ? pell_gaussians_total(&m.gaussians, 0) : 0.0, 1e-6);
    patch_destroy(p);
    patch_destroy(q);
    test_device_destroy(&at);
}

/* --- Maps ------------------------------------------------------------------------------------------------------------------------- */

enum { MAP_W = 96, MAP_H = 72 };
#define MAP_PX 2.0 /* a mm */

struct maps {
    float base[3][(MAP_W + 3) * MAP_H];
    struct pell_profile profile;
};

/* M of a facing plane at a pixel, by the sum over all its pixels: the profile is that of the pixel's own albedo and strength. */
static double sum_of_maps(const struct patch *p, struct maps *maps, const struct pell_frame_material *m, int px, int py, int c)
{
    const size_t here = patch_at(p, px, py);
    const double s = (double) p->strength[here], sigma_t = m->medium.sigma_a[c] + m->medium.sigma_s_reduced[c];
    struct pell_medium medium = m->medium;
    double reduced, sum = 0.0;

    assert_int_equal(pell_albedo_of_color(PELL_PROFILE_DIPOLE, NULL, (double) maps->base[c][here], 0.0, medium.eta, &reduced, NULL),
                     PELL_OK);
    medium.sigma_s_reduced[c] = reduced * sigma_t;
    medium.sigma_a[c] = (1.0 - reduced) * sigma_t;
    assert_int_equal(pell_profile_make(PELL_PROFILE_DIPOLE, &medium, c, NULL, &maps->profile), PELL_OK);
    for (int y = 0; y < MAP_H; y++)
        for (int x = 0; x < MAP_W; x++) {
            const int n = abs(x - px) + abs(y - py) < 8 ? 8 : 2;
            double r = 0.0;
            for (int i = 0; i < n * n; i++)
                r += pell_profile_eval(&maps->profile,
                                       hypot(x - px - 0.5 + (i % n + 0.5) / n, y - py - 0.5 + (i / n + 0.5) / n) / (MAP_PX * s));
            sum += r / (n * n * s * s) * (double) p->light[c][patch_at(p, x, y)];
        }
    return sum / (pell_profile_total(&maps->profile) * MAP_PX * MAP_PX);
}

/* A plane with colour and strength maps, with spread=albedo, against the sum over its pixels. */
static void a_texture_says_how_far_light_goes(void **state)
{
    static const char *const forms[] = { "spread=albedo", "spread=material" };
    struct test_device at = test_device_create(2, NULL, NULL);
    struct pell_frame_material m = medium("skin1");
    struct maps *maps = calloc(1, sizeof(*maps));
    struct patch *p, *q;
    double error[2][2] = { { 0 } }, mean = 0.0;
    int count = 0;

    (void) state;
    m.white = true;
    p = patch_create(MAP_W, MAP_H, true, MAP_PX, 600.0, &m, 1);
    q = patch_create(MAP_W, MAP_H, true, MAP_PX, 600.0, &m, 1);
    for (unsigned y = 0; y < MAP_H; y++)
        for (unsigned x = 0; x < MAP_W; x++) {
            const size_t i = patch_at(p, (int) x, (int) y);
            for (unsigned c = 0; c < 3; c++) {
                maps->base[c][i] = 0.05f + 0.9f * standard_error(x / 7, y / 6, c);
                p->light[c][i] = q->light[c][i] = standard_error(x / 5, y / 9, c + 3) < 0.5f ? 0.1f : 1.0f;
            }
            p->strength[i] = q->strength[i] = 0.4f + 0.6f * standard_error(x / 8, y / 5, 7);
        }
    for (int c = 0; c < 3; c++)
        p->frame.base[c] = q->frame.base[c] = maps->base[c];
    for (size_t k = 0; k < PELL_COUNT(forms); k++) {
        const char *const settings[] = { SLOW ? "samples=512" : "samples=2048", "tile=1", "renormalise=off", forms[k], NULL };
        patch_run(&at, method(at.ctx), settings, k ? q : p);
    }
    for (int y = 22; y < MAP_H - 22; y += SLOW ? 9 : 5)
        for (int x = 26; x < MAP_W - 26; x += 7)
            for (int c = 0; c < 3; c++) {
                const double truth = sum_of_maps(p, maps, &m, x, y, c);
                mean += truth;
                count++;
                for (int k = 0; k < 2; k++) {
                    const double e = (double) (k ? q : p)->result[c][patch_at(p, x, y)] - truth;
                    error[k][0] += e * e;
                    error[k][1] = fmax(error[k][1], fabs(e));
                }
            }
    mean /= count;
    for (int k = 0; k < 2; k++)
        print_message("# %s, colour and strength by texture, against the sum over the plane: rms %.4f, at most %.4f of the mean\n",
                      forms[k], sqrt(error[k][0] / count) / mean, error[k][1] / mean);
    REQUIRE(sqrt(error[0][0] / count) < (SLOW ? 0.02 : 0.01) * mean);
    REQUIRE(sqrt(error[1][0] / count) > 0.04 * mean);
    patch_destroy(p);
    patch_destroy(q);
    test_device_destroy(&at);
    free(maps);
}

/* Invalid texel colours are clamped to the nearest valid value; the map is not read where the colour comes from no texture. */
static void odd_colours_do_no_harm(void **state)
{
    static const float odd[] = { NAN, -INFINITY, INFINITY, -1.0f, 0.0f, 1.0f, 1e30f, 0.5f };
    static const char *const settings[] = { "spread=albedo", NULL };
    struct test_device at = test_device_create(1, NULL, NULL);
    struct pell_frame_material m[2] = { medium("skin1"), medium("skin1") };
    struct maps *maps = calloc(1, sizeof(*maps));
    struct patch *p, *q;

    (void) state;
    m[0].white = true;
    p = patch_create(MAP_W, MAP_H, true, MAP_PX, 600.0, m, 2);
    q = patch_create(MAP_W, MAP_H, true, MAP_PX, 600.0, m, 2);
    for (int y = 0; y < MAP_H; y++)
        for (int x = 0; x < MAP_W; x++)
            for (int c = 0; c < 3; c++) {
                maps->base[c][patch_at(p, x, y)] = odd[(x / 6 + y / 6 + c) % (int) PELL_COUNT(odd)];
                p->material[patch_at(p, x, y)] = q->material[patch_at(q, x, y)] = x < MAP_W / 2 ? 1 : 2;
            }
    for (int c = 0; c < 3; c++)
        p->frame.base[c] = maps->base[c];
    patch_run(&at, method(at.ctx), settings, p);
    patch_run(&at, method(at.ctx), settings, q); /* no colours at all */
    for (int y = 0; y < MAP_H; y++)
        for (int x = 0; x < MAP_W; x++)
            for (int c = 0; c < 3; c++) {
                const size_t i = patch_at(p, x, y);
                if (x < MAP_W / 2)
                    REQUIRE_NEAR((double) p->result[c][i], 1.0, 1e-4); /* uniform light, weights that sum to one */
                else
                    assert_true(p->result[c][i] == q->result[c][i]);
            }
    patch_destroy(p);
    patch_destroy(q);
    test_device_destroy(&at);
    free(maps);
}

static void the_uniform_disc_stops_at_half_the_object(void **state)
{
    struct kept_messages kept = { 0 };
    struct test_device at = test_device_create(1, NULL, &kept);
    const struct pell_frame_material m = medium("wholemilk");

    (void) state;
    for (int k = 0; k < 2; k++) {
        struct patch *p = patch_create(8, 8, true, 1.0, 100.0, &m, 1);
        struct pell_pass *pass;
        p->frame.shape.object_height = k ? 200.0f : 10.0f;
        kept = (struct kept_messages) { 0 };
        pass = patch_pass(&at, method(at.ctx), NULL, p);
        assert_int_equal(kept.warnings, k ? 0 : 1);
        assert_true(k || strstr(kept.last_warning, "half the object"));
        pell_pass_destroy(&pass);
        patch_destroy(p);
    }
    test_device_destroy(&at);
}

/* The effect of each misprint of the paper on the paper's form, on a slanted plane (uniform light in the middle, and the step). */
static void every_misprint_shows(void **state)
{
    static const char *const misprints[] = { "misprint=none", "misprint=two-pi", "misprint=jacobian", "misprint=one-number" };
    const struct pell_frame_material m = medium("marble");
    struct test_device at = test_device_create(2, NULL, NULL);
    struct pell_profile *profile = calloc(3, sizeof(*profile));
    double flat[4], step[4] = { 0 }, right[161] = { 0 };

    (void) state;
    for (int c = 0; c < 3; c++)
        assert_int_equal(pell_profile_make(PELL_PROFILE_DIPOLE, &m.medium, c, NULL, &profile[c]), PELL_OK);
    for (size_t k = 0; k < PELL_COUNT(misprints); k++) {
        const char *const settings[] = { "as=paper", "samples=256", "tile=1", misprints[k], NULL };
        struct patch *p = patch_create(161, 121, true, 1.5, 600.0, &m, 1);
        /* A valley with slanted sides: the tangent plane and the surface differ. */
        for (int y = 0; y < 121; y++)
            for (int x = 0; x < 161; x++)
                p->depth[patch_at(p, x, y)] = (float) (600.0 - 1.5 * fabs(x - 80.0) / 1.5);
        patch_run(&at, method(at.ctx), settings, p);
        flat[k] = (double) p->result[1][patch_at(p, 76, 60)] / pell_profile_total(&profile[1]);
        light_a_half(p);
        patch_run(&at, method(at.ctx), settings, p);
        for (int x = 40; x < 120; x++) {
            const double v = (double) p->result[1][patch_at(p, x, 60)] / pell_profile_total(&profile[1]) / flat[k];
            if (k == 0)
                right[x] = v;
            step[k] = fmax(step[k], fabs(v - right[x]));
        }
        print_message("# as=paper, %s: uniform light in a valley %.4f of the total; shape of a step off by %.4f\n", misprints[k], flat[k],
                      step[k]);
        patch_destroy(p);
    }
    REQUIRE_REL(flat[1] * 2.0 * PELL_PI, flat[0], 1e-4);
    REQUIRE(step[2] > 0.02);
    REQUIRE(step[3] > 0.02);
    test_device_destroy(&at);
    free(profile);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(half_lit_planes_are_the_analytic_convolution),
        cmocka_unit_test(the_mean_of_few_samples_is_the_closed_form),
        cmocka_unit_test(many_samples_converge_to_the_visible_surface),
        cmocka_unit_test(what_renormalising_does_at_silhouettes),
        cmocka_unit_test(combined_samples_beat_either_kind_at_a_shadow),
        cmocka_unit_test(reconstruction_keeps_light_and_takes_noise),
        cmocka_unit_test(reconstruction_leaves_what_is_sharp),
        cmocka_unit_test(sheets_far_apart_do_not_mix),
        cmocka_unit_test(strength_scales_the_radius),
        cmocka_unit_test(a_texture_says_how_far_light_goes),
        cmocka_unit_test(odd_colours_do_no_harm),
        cmocka_unit_test(the_uniform_disc_stops_at_half_the_object),
        cmocka_unit_test(every_misprint_shows),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
