/* SPDX-License-Identifier: MIT
 * test_convolution.c - the convolution method on hand-made planes: its tables, kernels and transfers between depth planes against closed
 * forms and direct sums. */
#include "patch.h"
#include "slow.h"

#include "math/vec.h"
#include "methods/convolution/convolution.h"

static const struct pell_method *method(struct pell_context *ctx)
{
    return pell_method_find(ctx, "test", "convolution");
}

static struct pell_frame_material narrow(void)
{
    static const double variance[3] = { 0.5, 2.0, 6.0 }, weight[3][3] = { { 0.3, 0.2, 0.6 }, { 0.3, 0.3, 0.1 }, { 0.3, 0.4, 0.1 } };
    return patch_gaussians(3, variance, weight);
}

static struct pell_frame_material one(double variance)
{
    static const double weight[1][3] = { { 1.0, 0.8, 0.5 } };
    return patch_gaussians(1, &variance, weight);
}

static float standard_error(unsigned x, unsigned y, unsigned c)
{
    unsigned h = x * 374761393u + y * 668265263u + c * 2246822519u + 12345u;

    h = (h ^ (h >> 13)) * 1274126177u;
    return (float) ((h ^ (h >> 16)) & 0xffffff) / 16777216.0f;
}

/* --- Tables ---------------------------------------------------------------------------------------------------------------------- */

struct tables {
    struct pell_frame_material m;
    struct pell_profile profile[3];
    float memory[3 * CONV_RADIAL_FLOATS];
    struct conv_radial radial[3];
};

static struct tables *tables_of(const struct pell_frame_material *m)
{
    struct tables *t = calloc(1, sizeof(*t));

    t->m = *m;
    for (int c = 0; c < 3; c++)
        assert_int_equal(m->gaussians.count > 0 ? pell_profile_from_gaussians(&m->gaussians, c, &t->profile[c])
                                                : pell_profile_make(PELL_PROFILE_DIPOLE, &m->medium, c, NULL, &t->profile[c]),
                         PELL_OK);
    t->m.profile = t->profile;
    convolution_radial_make(&t->m, 1.0, t->memory, t->radial);
    return t;
}

/* With the refractive index 1.3 of the numbers in docs/errata.md. */
static struct pell_frame_material medium(const char *name)
{
    struct pell_frame_material m = { .name = name, .preset = name, .medium = pell_material_find(name)->medium };

    m.medium.eta = 1.3;
    return m;
}

static double inside_step(double low, double high, double variance)
{
    return 0.5 * (erf(high / sqrt(2.0 * variance)) - erf(low / sqrt(2.0 * variance)));
}

static void squares_hold_what_gaussians_put_there(void **state)
{
    static const double pixels[] = { 0.01, 0.3, 1.0, 4.0, 50.0 };
    const struct pell_frame_material m = narrow();
    struct tables *t = tables_of(&m);
    double worst = 0.0;

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(pixels); k++)
        for (int c = 0; c < 3; c++) {
            double out[49];
            convolution_radial_squares(&t->radial[c], pixels[k], 7, out);
            for (int y = 0; y < 7; y++)
                for (int x = 0; x < 7; x++) {
                    double exact = 0.0;
                    for (int i = 0; i < 3; i++)
                        exact += m.gaussians.weight[i][c] *
                                 inside_step((x - 0.5) * pixels[k], (x + 0.5) * pixels[k], m.gaussians.variance[i]) *
                                 inside_step((y - 0.5) * pixels[k], (y + 0.5) * pixels[k], m.gaussians.variance[i]);
                    worst = fmax(worst, fabs(out[7 * y + x] - exact));
                }
        }
    print_message("# squares: %.1e of the light\n", worst);
    REQUIRE(worst < 2e-6);
    free(t);
}

static void tables_are_the_profile(void **state)
{
    static const char *const names[] = { "marble", "wholemilk", "skin1" };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(names); i++) {
        const struct pell_frame_material m = medium(names[i]);
        struct tables *t = tables_of(&m);
        for (int c = 0; c < 3; c++)
            for (double cdf = 0.001; cdf < 0.9999; cdf += 0.00917) {
                const double r = pell_profile_sample(&t->profile[c], cdf);
                REQUIRE_REL((double) convolution_radial_value(&t->radial[c], (float) (r * r)), pell_profile_eval(&t->profile[c], r), 2e-3);
                REQUIRE_NEAR(convolution_radial_beyond(&t->radial[c], r), (1.0 - cdf) * pell_profile_total(&t->profile[c]), 1e-6);
            }
        free(t);
    }
}

/* docs/errata.md, munoz-6: light beyond the distance at which R has fallen to a thousandth of R(0). */
static void the_printed_threshold_drops_light(void **state)
{
    static const struct {
        const char *name;
        int channel;
        double lost[2]; /* at 0.1 % and 5 % */
    } cases[] = { { "wholemilk", 0, { 0.100, 0.51 } }, { "marble", 1, { 0.073, 0.48 } }, { "skin1", 0, { 0.022, 0.30 } } };

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(cases); i++)
        for (int k = 0; k < 2; k++) {
            const struct pell_frame_material m = medium(cases[i].name);
            struct tables *t = tables_of(&m);
            const struct conv_radial *r = &t->radial[cases[i].channel];
            const float least = (k ? 0.05f : 0.001f) * convolution_radial_value(r, 0.0f);
            double low = 0.0, high = 1000.0;
            for (int step = 0; step < 60; step++) {
                const double d = 0.5 * (low + high);
                if (convolution_radial_value(r, (float) (d * d)) > least)
                    low = d;
                else
                    high = d;
            }
            REQUIRE_NEAR(convolution_radial_beyond(r, low) / (double) r->total, cases[i].lost[k], k ? 0.006 : 0.002);
            free(t);
        }
}

/* --- Surfaces that face the camera -------------------------------------------------------------------------------------------------- */

/* A surface at `depth` between two far corners at `low` and `high`, lit right of the middle column. */
static struct patch *facing(const struct pell_frame_material *m, bool parallel, double focal, double low, double high, double depth,
                            bool half)
{
    struct patch *p = patch_create(181, 121, parallel, focal, depth, m, 1);

    for (int i = 0; i < 2; i++)
        p->depth[patch_at(p, 0, i)] = (float) (i ? high : low);
    for (int y = 0; y < p->frame.shape.height; y++)
        for (int x = 0; x < p->frame.shape.width; x++)
            for (int c = 0; c < 3; c++)
                p->light[c][patch_at(p, x, y)] = !half || 2 * x >= p->frame.shape.width;
    return p;
}

static double step_of(const struct pell_frame_material *m, int c, double x_mm)
{
    double sum = 0.0;

    for (int i = 0; i < m->gaussians.count; i++)
        sum += m->gaussians.weight[i][c] * 0.5 * (1.0 + erf(x_mm / sqrt(2.0 * m->gaussians.variance[i])));
    return sum;
}

static void planes_at_any_depth_are_the_exact_convolution(void **state)
{
    static const char *const forms[][5] = { { "surfaces=1", "borders=open", "planes=4", NULL },
                                            { "surfaces=1", "borders=open", "planes=2", NULL },
                                            { "surfaces=1", "borders=open", "planes=7", "placement=surface", NULL } };
    const struct pell_frame_material m = narrow();
    struct test_device at = test_device_create(2, NULL, NULL);

    (void) state;
    for (int parallel = 0; parallel < 2; parallel++)
        for (size_t k = 0; k < PELL_COUNT(forms); k++) {
            double worst = 0.0;
            for (int i = 0; i < 20; i += SLOW ? 7 : parallel || k > 0 ? 4 : 1) {
                const double depth = 600.0 + i;
                struct patch *p = facing(&m, parallel, parallel ? 3.0 : 1800.0, 600.0, 619.0, depth, true);
                patch_run(&at, method(at.ctx), forms[k], p);
                for (int x = 60; x < 121; x++)
                    for (int c = 0; c < 3; c++) {
                        const double mm = (x + 0.5 - 91.0) / 3.0 * (parallel ? 1.0 : depth / 600.0);
                        worst = fmax(worst, fabs((double) p->result[c][patch_at(p, x, 60)] - step_of(&m, c, mm)) /
                                                pell_gaussians_total(&m.gaussians, c));
                    }
                patch_destroy(p);
            }
            print_message("# %s rays, %s: depths within %.5f of the step\n", parallel ? "parallel" : "diverging", forms[k][2], worst);
            REQUIRE(worst < 1e-3);
        }
    test_device_destroy(&at);
}

/* Each depth is blurred like the middle one, at its own pixel size; for parallel rays the result is independent of depth. */
static void pixels_of_one_size_are_those_of_the_middle(void **state)
{
    static const char *const form[] = { "surfaces=1", "borders=open", "pixels=one", NULL };
    static const char *const each[] = { "surfaces=1", "borders=open", NULL };
    const struct pell_frame_material m = narrow();
    struct test_device at = test_device_create(2, NULL, NULL);

    (void) state;
    for (double depth = 600.0; depth < 801.0; depth += 66.0) {
        struct patch *p = facing(&m, false, 2100.0, 600.0, 800.0, depth, true);
        patch_run(&at, method(at.ctx), form, p);
        for (int x = 60; x < 121; x++)
            for (int c = 0; c < 3; c++) {
                const double total = pell_gaussians_total(&m.gaussians, c), mm = (x + 0.5 - 91.0) * 700.0 / 2100.0;
                REQUIRE_NEAR((double) p->result[c][patch_at(p, x, 60)], step_of(&m, c, mm), 2e-3 * total);
            }
        patch_destroy(p);
    }
    {
        struct patch *p = facing(&m, true, 3.0, 600.0, 800.0, 633.0, true), *q = facing(&m, true, 3.0, 600.0, 800.0, 633.0, true);
        patch_run(&at, method(at.ctx), form, p);
        patch_run(&at, method(at.ctx), each, q);
        for (int x = 0; x < 181; x++)
            for (int c = 0; c < 3; c++)
                REQUIRE_NEAR((double) p->result[c][patch_at(p, x, 60)], (double) q->result[c][patch_at(q, x, 60)], 1e-6);
        patch_destroy(p);
        patch_destroy(q);
    }
    test_device_destroy(&at);
}

static void facing_planes_keep_their_light(void **state)
{
    static const char *const restore[] = { "restore=between", "restore=response" };
    const struct pell_frame_material m = narrow();
    struct test_device at = test_device_create(2, NULL, NULL);

    (void) state;
    for (int r = 0; r < 2; r++) {
        double worst = 0.0;
        for (int planes = 2; planes <= 16; planes += SLOW || r ? 7 : 2)
            for (int i = 0; i < 4; i += 1 + (planes > 8)) {
                char text[32];
                const char *const form[] = { "surfaces=1", "borders=open", restore[r], text, NULL };
                struct patch *p = facing(&m, false, 1200.0, 600.0, 660.0, 603.0 + 17.0 * i, false);
                snprintf(text, sizeof(text), "planes=%d", planes);
                patch_run(&at, method(at.ctx), form, p);
                for (int c = 0; c < 3; c++)
                    worst = fmax(worst, fabs((double) p->result[c][patch_at(p, 90, 60)] / pell_gaussians_total(&m.gaussians, c) - 1.0));
                patch_destroy(p);
            }
        print_message("# %s: 2 to 16 planes keep all light but %.4f\n", restore[r], worst);
        REQUIRE(worst < 0.01);
    }
    test_device_destroy(&at);
}

/* docs/errata.md, munoz-5: half of the light assigned to each plane and linear gathering yield (rho(0) + rho(dz))/2 at every depth. */
static void splitting_in_halves_loses_light(void **state)
{
    static const struct {
        const char *name;
        int channel;
        double spacing, left;
    } cases[] = {
        { "wholemilk", 0, 1.0, 0.790 },
        { "wholemilk", 0, 5.0, 0.570 },
        { "marble", 1, 1.0, 0.769 },
        { "marble", 1, 5.0, 0.547 },
    };
    static const char *const paper[] = { "as=paper", "surfaces=1", "borders=open", "planes=2", "resolution=1", "threshold=0", NULL };
    static const char *const best[] = { "surfaces=1", "borders=open", "planes=2", NULL };
    struct test_device at = test_device_create(2, NULL, NULL);

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(cases); i++)
        for (int k = 1; k < 4; k++) {
            const struct pell_frame_material m = medium(cases[i].name);
            double light[2];
            for (int form = 0; form < 2; form++) {
                struct patch *p = facing(&m, true, 1.0, 600.0, 600.0 + cases[i].spacing, 600.0 + 0.25 * k * cases[i].spacing, false);
                patch_run(&at, method(at.ctx), form ? best : paper, p);
                light[form] = (double) p->result[cases[i].channel][patch_at(p, 90, 60)];
                patch_destroy(p);
            }
            REQUIRE_NEAR(light[0] / light[1], cases[i].left, 0.005);
        }
    test_device_destroy(&at);
}

/* A lit plane in front of an unlit one, separated by much more than the diffuse mean free path; depth planes are even farther apart. */
static void edges_in_depth_keep_light_apart(void **state)
{
    static const char *const forms[][6] = { { "surfaces=1", "borders=open", "planes=4", "edges=off", NULL },
                                            { "surfaces=1", "borders=open", "planes=4", NULL } };
    const struct pell_frame_material m = one(0.04);
    struct test_device at = test_device_create(2, NULL, NULL);
    double over[2], left[2];

    (void) state;
    for (int form = 0; form < 2; form++) {
        struct patch *p = patch_create(90, 60, true, 3.0, 600.0, &m, 1);
        over[form] = 0.0;
        left[form] = 1.0;
        p->depth[patch_at(p, 0, 0)] = 700.0f; /* uses depth planes 33 mm apart */
        for (int y = 0; y < 60; y++)
            for (int x = 45; x < 90; x++) {
                p->depth[patch_at(p, x, y)] = 610.0f;
                for (int c = 0; c < 3; c++)
                    p->light[c][patch_at(p, x, y)] = 0.0f;
            }
        patch_run(&at, method(at.ctx), forms[form], p);
        for (int x = 40; x < 50; x++) {
            const double v = (double) p->result[0][patch_at(p, x, 30)];
            if (x < 45)
                left[form] = fmin(left[form], v);
            else
                over[form] = fmax(over[form], v);
        }
        patch_destroy(p);
    }
    print_message("# across an edge %.4f of the light, %.4f left before it; edges=off %.4f, %.4f\n", over[1], left[1], over[0], left[0]);
    REQUIRE(over[1] < 0.002 && fabs(left[1] - 1.0) < 0.002);
    REQUIRE(over[0] > 0.1 && left[0] < 0.9);
    test_device_destroy(&at);
}

/* --- Slanted surfaces ------------------------------------------------------------------------------------------------------------ */

static void leaning_planes_keep_most_of_their_light(void **state)
{
    static const char *const forms[][8] = { { "surfaces=1", "borders=open", "planes=4", NULL },
                                            { "surfaces=1", "borders=open", "planes=16", NULL },
                                            { "as=paper", "surfaces=1", "borders=open", "planes=4", "resolution=1", "threshold=0", NULL } };
    const struct pell_frame_material m = one(2.0);
    struct test_device at = test_device_create(2, NULL, NULL);
    double printed = 0.0;

    (void) state;
    for (int degrees = 0; degrees <= 80; degrees += SLOW ? 40 : 20) {
        const double slope = tan(degrees * PELL_PI / 180.0);
        double light[3], worst[3];
        for (int form = 0; form < 3; form++) {
            struct patch *p = patch_create(181, 121, true, 3.0, 600.0, &m, 1);
            patch_tilt(p, 600.0, slope, 0.0);
            patch_run(&at, method(at.ctx), forms[form], p);
            light[form] = worst[form] = 0.0;
            for (int x = 60; x < 121; x++) {
                const double v = (double) p->result[0][patch_at(p, x, 60)];
                light[form] += v / 61.0;
                worst[form] = fmax(worst[form], fabs(v - 1.0));
            }
            patch_destroy(p);
        }
        print_message("# %2d degrees: 4 planes %.3f of the light (pixels within %.3f), 16 planes %.3f (%.3f), as printed %.3f (%.3f)\n",
                      degrees, light[0], worst[0], light[1], worst[1], light[2], worst[2]);
        REQUIRE(fabs(light[0] - 1.0) < 0.03 && fabs(light[1] - 1.0) < 0.03);
        REQUIRE(worst[0] < 0.1 && worst[1] < 0.1);
        printed = fmax(printed, fabs(light[2] - 1.0));
    }
    REQUIRE(printed > 0.4);
    test_device_destroy(&at);
}

/* A slanted surface, half of it lit. Across the slope light spreads as on a facing surface; along it, as far as depth planes parallel to
 * the image resolve depths. */
static void a_step_across_a_slope_is_exact(void **state)
{
    static const char *const forms[][3] = { { "surfaces=1", "planes=4", NULL }, { "surfaces=1", "planes=16", NULL } };
    const struct pell_frame_material m = one(2.0);
    struct test_device at = test_device_create(2, NULL, NULL);

    (void) state;
    for (int degrees = 0; degrees <= 75; degrees += SLOW ? 75 : 15) {
        const double slope = tan(degrees * PELL_PI / 180.0), longer = sqrt(1.0 + slope * slope);
        double worst[2][2] = { { 0.0 } };
        for (int k = 0; k < 4; k++) {
            const int form = k / 2, along = k % 2;
            struct patch *p = patch_create(181, 121, true, 3.0, 600.0, &m, 1);
            patch_tilt(p, 600.0, slope, 0.0);
            for (int y = 0; y < 121; y++)
                for (int x = 0; x < 181; x++)
                    for (int c = 0; c < 3; c++)
                        p->light[c][patch_at(p, x, y)] = (along ? x < 90 : y < 60) ? 1.0f : 0.0f;
            patch_run(&at, method(at.ctx), forms[form], p);
            for (int i = -20; i < 20; i++) {
                const double v = (double) p->result[0][along ? patch_at(p, 90 + i, 60) : patch_at(p, 90, 60 + i)];
                const double mm = -(i + 0.5) / 3.0 * (along ? longer : 1.0);
                worst[form][along] = fmax(worst[form][along], fabs(v - inside_step(-INFINITY, mm, 2.0)));
            }
            patch_destroy(p);
        }
        print_message("# %2d degrees: off by %.3f of the step across the slope, %.3f along it; 16 planes %.3f, %.3f\n", degrees,
                      worst[0][0], worst[0][1], worst[1][0], worst[1][1]);
        for (int form = 0; form < 2; form++)
            REQUIRE(worst[form][0] < 1e-3 && worst[form][1] < (degrees <= 45 ? 0.1 : 0.3));
    }
    test_device_destroy(&at);
}

/* A diffuse mean free path much smaller than the pixel, next to a depth discontinuity: at the next pixel R is close to the smallest
 * float. */
static void light_that_stays_in_its_pixel_is_kept(void **state)
{
    static const char *const form[] = { "surfaces=1", NULL };
    struct test_device at = test_device_create(2, NULL, NULL);

    (void) state;
    for (double variance = 4e-4; variance < 7e-4; variance += 2e-5) {
        const struct pell_frame_material m = one(variance);
        struct patch *p = patch_create(40, 20, true, 3.0, 600.0, &m, 1);
        for (int y = 0; y < 20; y++)
            for (int x = 20; x < 40; x++)
                p->depth[patch_at(p, x, y)] = 610.0f;
        patch_run(&at, method(at.ctx), form, p);
        for (int x = 0; x < 40; x++)
            REQUIRE_NEAR((double) p->result[0][patch_at(p, x, 10)], 1.0, 1e-3);
        patch_destroy(p);
    }
    test_device_destroy(&at);
}

/* --- No wrap-around ---------------------------------------------------------------------------------------------------------------- */

/* Exiting light of a facing plane against the sum over all pixels, with profiles narrower than a pixel and wider than the image. */
static void a_picture_is_the_sum_over_its_pixels(void **state)
{
    static const double variances[] = { 0.02, 0.5, 9.0, 400.0, 4e4 };
    static const char *const form[] = { "surfaces=1", "borders=open", "resolution=1", NULL };
    enum { W = 53, H = 37 };
    struct test_device at = test_device_create(2, NULL, NULL);

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(variances); k++) {
        const struct pell_frame_material m = one(variances[k]);
        struct patch *p = patch_create(W, H, true, 1.0, 100.0, &m, 1);
        double worst = 0.0, brightest = 0.0;
        for (int y = 0; y < H; y++)
            for (int x = 0; x < W; x++)
                for (int c = 0; c < 3; c++)
                    p->light[c][patch_at(p, x, y)] = x < 3 ? 1.0f + standard_error((unsigned) x, (unsigned) y, (unsigned) c) : 0.0f;
        patch_run(&at, method(at.ctx), form, p);
        for (int y = 0; y < H; y += 3)
            for (int x = 0; x < W; x++) {
                double sum = 0.0;
                for (int v = 0; v < H; v++)
                    for (int u = 0; u < 3; u++)
                        sum += (double) p->light[0][patch_at(p, u, v)] * inside_step(u - x - 0.5, u - x + 0.5, variances[k]) *
                               inside_step(v - y - 0.5, v - y + 0.5, variances[k]);
                worst = fmax(worst, fabs((double) p->result[0][patch_at(p, x, y)] - sum));
                brightest = fmax(brightest, sum);
            }
        print_message("# variance %g px^2: within %.1e of the brightest pixel\n", variances[k], worst / brightest);
        REQUIRE(worst < 1e-3 * brightest);
        patch_destroy(p);
    }
    test_device_destroy(&at);
}

/* Irradiance `left` in the first columns and `right` in the last. */
static struct patch *lit_at_ends(const struct test_device *at, const struct pell_frame_material *m, float left, float right)
{
    static const char *const form[] = { "surfaces=1", "borders=open", NULL };
    struct patch *p = patch_create(300, 40, true, 1.0, 100.0, m, 1);

    patch_light(p, 0.0f, 0.0f, 0.0f);
    for (int y = 0; y < 40; y++)
        for (int x = 0; x < 4; x++) {
            p->light[0][patch_at(p, x, y)] = left;
            p->light[0][patch_at(p, 299 - x, y)] = right;
        }
    patch_run(at, method(at->ctx), form, p);
    return p;
}

/* No light wraps around beyond the padding: where no light arrives the result is exactly zero. Where other light arrives, an FFT leaves
 * the rounding error of everything that it transforms, whatever its padding: the bound is relative to the brightest light, not to the
 * local one. */
static void the_left_edge_does_not_light_the_right(void **state)
{
    const struct pell_frame_material m = one(4.0);
    struct test_device at = test_device_create(2, NULL, NULL);
    struct patch *left = lit_at_ends(&at, &m, 1.0f, 0.0f), *right = lit_at_ends(&at, &m, 0.0f, 1e-3f);
    struct patch *both = lit_at_ends(&at, &m, 1.0f, 1e-3f);
    double rounding = 0.0, brightest = 0.0;

    (void) state;
    for (int y = 0; y < 40; y++)
        for (int x = 0; x < 300; x++) {
            const ptrdiff_t i = patch_at(left, x, y);
            assert_true(left->result[1][i] == 0.0f && both->result[1][i] == 0.0f);
            brightest = fmax(brightest, (double) left->result[0][i]);
            if (x >= 40) {
                assert_true(left->result[0][i] == 0.0f);
                rounding = fmax(rounding, fabs((double) both->result[0][i] - (double) right->result[0][i]));
            }
        }
    print_message("# light at the left: none at the right alone, %.1e of it next to other light\n", rounding / brightest);
    REQUIRE(left->result[0][patch_at(left, 8, 20)] > 0.01f && right->result[0][patch_at(right, 291, 20)] > 1e-5f);
    REQUIRE(rounding < 2e-7 * brightest);
    patch_destroy(left);
    patch_destroy(right);
    patch_destroy(both);
    test_device_destroy(&at);
}

/* --- Resolution -------------------------------------------------------------------------------------------------------------------- */

static void coarse_planes_lose_detail_alone(void **state)
{
    static const char *const names[] = { "resolution=1", "resolution=1/2", "resolution=1/4" };
    const struct pell_frame_material m = one(60.0);
    struct test_device at = test_device_create(2, NULL, NULL);
    struct patch *p[3];

    (void) state;
    for (int k = 0; k < 3; k++) {
        const char *const form[] = { "surfaces=1", names[k], NULL };
        p[k] = patch_create(150, 110, false, 1500.0, 500.0, &m, 1);
        patch_tilt(p[k], 500.0, 0.4, 0.2);
        for (int y = 0; y < 110; y++)
            for (int x = 0; x < 150; x++)
                for (int c = 0; c < 3; c++)
                    p[k]->light[c][patch_at(p[k], x, y)] = x / 20 % 2 == y / 20 % 2;
        patch_run(&at, method(at.ctx), form, p[k]);
    }
    for (int k = 1; k < 3; k++) {
        double square = 0.0;
        for (int y = 0; y < 110; y++)
            for (int x = 0; x < 150; x++) {
                const double d = (double) p[k]->result[0][patch_at(p[k], x, y)] - (double) p[0]->result[0][patch_at(p[0], x, y)];
                square += d * d / (110.0 * 150.0);
            }
        print_message("# %s: root mean square difference %.4f of full light\n", names[k], sqrt(square));
        REQUIRE(sqrt(square) < 0.01 * k);
    }
    for (int k = 0; k < 3; k++)
        patch_destroy(p[k]);
    test_device_destroy(&at);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(squares_hold_what_gaussians_put_there),
        cmocka_unit_test(tables_are_the_profile),
        cmocka_unit_test(the_printed_threshold_drops_light),
        cmocka_unit_test(planes_at_any_depth_are_the_exact_convolution),
        cmocka_unit_test(pixels_of_one_size_are_those_of_the_middle),
        cmocka_unit_test(facing_planes_keep_their_light),
        cmocka_unit_test(splitting_in_halves_loses_light),
        cmocka_unit_test(edges_in_depth_keep_light_apart),
        cmocka_unit_test(leaning_planes_keep_most_of_their_light),
        cmocka_unit_test(a_step_across_a_slope_is_exact),
        cmocka_unit_test(light_that_stays_in_its_pixel_is_kept),
        cmocka_unit_test(a_picture_is_the_sum_over_its_pixels),
        cmocka_unit_test(the_left_edge_does_not_light_the_right),
        cmocka_unit_test(coarse_planes_lose_detail_alone),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
