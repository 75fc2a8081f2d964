/* SPDX-License-Identifier: MIT
 * test_screen_space.c - the screen-space method against closed forms: light edges on planes, its total, foreshortening, level of detail,
 * silhouettes, and the numbers printed in the paper. */
#include "patch.h"
#include "slow.h"

#include "methods/screen_space/screen_space.h"

#include <pellucid/layers.h>

#define PI 3.14159265358979323846

static const double skin_variance[4] = { 0.0064, 0.0516, 0.2719, 2.0062 };
static const double skin_weight[4][3] = {
    { 0.2405, 0.4474, 0.6157 },
    { 0.1158, 0.3661, 0.3439 },
    { 0.1836, 0.1864, 0.0 },
    { 0.46, 0.0, 0.0402 },
};
static const double marble_variance[4] = { 0.0362, 0.1144, 0.4555, 3.4833 };
static const double marble_weight[4][3] = {
    { 0.0544, 0.1245, 0.2177 },
    { 0.2436, 0.2435, 0.1890 },
    { 0.3105, 0.3158, 0.3742 },
    { 0.3913, 0.3161, 0.2189 },
};

static const struct pell_method *method(struct pell_context *ctx)
{
    return pell_method_find(ctx, "test", "screen-space");
}

static double phi(double x)
{
    return 0.5 * erfc(-x / sqrt(2.0));
}

static struct pell_frame_material skin(void)
{
    return patch_gaussians(4, skin_variance, skin_weight);
}

static struct pell_frame_material marble(void)
{
    return patch_gaussians(4, marble_variance, marble_weight);
}

/* A white material of one Gaussian. */
static struct pell_frame_material single(double variance)
{
    static const double one[1][3] = { { 1.0, 1.0, 1.0 } };
    return patch_gaussians(1, &variance, one);
}

/* Light at a signed distance (mm, positive on the lit side) from the edge of a half-lit plane. */
static double half_lit(const struct pell_gaussians *g, int channel, double mm)
{
    double sum = 0.0;

    for (int i = 0; i < g->count; i++)
        sum += g->weight[i][channel] * phi(mm / sqrt(g->variance[i]));
    return sum;
}

/* The largest difference to the closed form along the middle row (or column) of a facing plane that is lit on its right (lower) half. */
static double step_error(const struct test_device *at, const char *const *settings, const struct pell_frame_material *m, bool ortho,
                         double px_per_mm, int axis)
{
    const double depth = 500.0, widest = sqrt(m->gaussians.variance[m->gaussians.count - 1]);
    const int half = (int) (5.0 * px_per_mm * widest) + 24, size = 2 * half;
    struct patch *p = patch_create(axis ? 40 : size, axis ? size : 40, ortho, ortho ? px_per_mm : px_per_mm * depth, depth, m, 1);
    double worst = 0.0;

    patch_light_half(p, axis, half);
    patch_run(at, method(at->ctx), settings, p);
    for (int i = size / 8; i < size - size / 8; i++) {
        const size_t k = axis ? patch_at(p, 20, i) : patch_at(p, i, 20);
        for (int c = 0; c < 3; c++)
            worst = fmax(worst, fabs((double) p->result[c][k] - half_lit(&m->gaussians, c, (i + 0.5 - half) / px_per_mm)));
    }
    patch_destroy(p);
    return worst;
}

static void half_lit_plane_is_the_analytic_convolution(void **state)
{
    const struct pell_frame_material materials[3] = { skin(), marble(), single(1.0) };
    static const char *const names[3] = { "skin", "marble", "one Gaussian of 1 mm^2" };
    struct test_device at;

    (void) state;
    RELEASE_ONLY();
    at = test_device_create(2, NULL, NULL);
    for (int m = 0; m < 3; m++) {
        double worst[2] = { 0.0, 0.0 };
        for (double scale = 0.1; scale < 60.0; scale *= SLOW ? 1.6 : 1.17) {
            const double across = step_error(&at, NULL, &materials[m], true, scale, 0);
            const double down = step_error(&at, NULL, &materials[m], false, scale, 1);
            const bool wide = scale * sqrt(materials[m].gaussians.variance[0]) > 1.5;
            worst[wide] = fmax(worst[wide], fmax(across, down));
        }
        print_message("# %s: error of a half-lit plane %.4f of the step, %.4f where the narrowest Gaussian is over 1.5 px\n", names[m],
                      worst[0], worst[1]);
        REQUIRE(worst[0] < 0.005);
        REQUIRE(worst[1] < 0.0015);
    }
    test_device_destroy(&at);
}

static void a_measured_material_is_its_fit(void **state)
{
    const struct pell_material_entry *milk = pell_material_find("wholemilk");
    struct pell_frame_material m = { .name = "wholemilk" }, fitted = { .name = "fitted" };
    struct test_device at = test_device_create(2, NULL, NULL);

    (void) state;
    assert_non_null(milk);
    m.medium = fitted.medium = milk->medium;
    for (int k = 1; k <= 6; k++) {
        const struct pell_fit_params params = { .count = k };
        char text[32];
        const char *const settings[] = { text, NULL };
        struct patch *p = patch_create(90, 70, false, 1500.0, 500.0, &m, 1), *q = patch_create(90, 70, false, 1500.0, 500.0, &fitted, 1);
        snprintf(text, sizeof(text), "gaussians=%d", k);
        assert_int_equal(pell_fit_medium(&m.medium, &params, &fitted.gaussians, NULL), PELL_OK);
        for (int y = 20; y < 50; y++)
            p->light[0][patch_at(p, 40, y)] = q->light[0][patch_at(q, 40, y)] = 9.0f;
        patch_run(&at, method(at.ctx), settings, p);
        patch_run(&at, method(at.ctx), NULL, q);
        for (int c = 0; c < 3; c++)
            assert_memory_equal(p->result[c], q->result[c], sizeof(float) * (size_t) p->frame.shape.stride * 70);
        patch_destroy(p);
        patch_destroy(q);
    }
    test_device_destroy(&at);
}

/* Largest error over all scales at which a level of detail can have an effect. */
static double lod_error(const struct test_device *at, const char *const *settings, const struct pell_frame_material *m)
{
    double worst = 0.0;

    for (double scale = 0.15; scale < 12.0; scale *= SLOW ? 1.2 : 1.06)
        worst = fmax(worst, step_error(at, settings, m, true, scale, 0));
    return worst;
}

static void the_default_lod_is_the_smallest_under_half_a_percent(void **state)
{
    static const char *const q[] = { "lod=0.5", "lod=1", "lod=1.25", "lod=1.5", "lod=1.75", "lod=2", "lod=3", "lod=100" };
    const struct pell_frame_material materials[3] = { skin(), marble(), single(1.0) };
    struct test_device at;
    struct screen_knobs defaults;
    double used = 0.0, smaller = 0.0;

    (void) state;
    RELEASE_ONLY();
    at = test_device_create(2, NULL, NULL);
    pell_knobs_default(method(at.ctx)->knobs, &defaults);
    for (size_t i = 0; i < PELL_COUNT(q); i++) {
        const char *const settings[] = { q[i], NULL };
        double worst = 0.0;
        for (int m = 0; m < 3; m++)
            worst = fmax(worst, lod_error(&at, settings, &materials[m]));
        print_message("# %s: %.4f of the step\n", q[i], worst);
        if (strtof(q[i] + 4, NULL) == defaults.lod)
            used = worst;
        else if (strtof(q[i] + 4, NULL) < defaults.lod)
            smaller = worst;
    }
    REQUIRE(used > 0.0 && used < 0.005);
    REQUIRE(smaller > 0.005);
    test_device_destroy(&at);
}

static void blurring_the_first_gaussian_has_the_smaller_error(void **state)
{
    static const char *const unblurred[] = { "first=unblurred", NULL };
    const struct pell_frame_material materials[2] = { skin(), marble() };
    struct test_device at = test_device_create(2, NULL, NULL);

    (void) state;
    for (int m = 0; m < 2; m++) {
        for (double scale = 1.0; scale < 10.0; scale *= 1.7) {
            const double with = step_error(&at, NULL, &materials[m], true, scale, 0);
            const double without = step_error(&at, unblurred, &materials[m], true, scale, 0);
            print_message("# %s at %.1f px/mm: %.4f of the step blurred, %.4f unblurred\n", m ? "marble" : "skin", scale, with, without);
            if (scale > 4.0)
                REQUIRE(with < 0.1 * without);
        }
    }
    test_device_destroy(&at);
}

/* The plane is slanted by `degrees`, its steepest direction at `turn` degrees from x; the light's edge passes through the middle,
 * perpendicular or parallel to that direction. Returns the largest error over the middle of the image. Each pixel's irradiance is the
 * lit fraction of its area. */
static double tilt_error(const struct test_device *at, const struct pell_frame_material *m, double degrees, double turn, bool ortho,
                         bool along)
{
    const double slope = tan(degrees * PI / 180.0), ux = cos(turn * PI / 180.0), uy = sin(turn * PI / 180.0);
    const double depth = 500.0, scale = 10.0;
    const int size = 240, grid = 8;
    struct patch *p = patch_create(size, size, ortho, ortho ? scale : scale * depth, depth, m, 1);
    double worst = 0.0;

    patch_tilt(p, depth, slope * ux, slope * uy);
    for (int y = 0; y < size; y++) {
        for (int x = 0; x < size; x++) {
            const size_t i = patch_at(p, x, y);
            int hits = 0;
            for (int s = 0; s < grid * grid; s++) {
                const double px = x - size / 2 + (s % grid + 0.5) / grid, py = y - size / 2 + (s / grid + 0.5) / grid;
                const double side = along ? py * ux - px * uy : px * ux + py * uy;
                hits += fabs(side) < 1e-9 ? 1 : side > 0.0 ? 2 : 0;
            }
            for (int c = 0; c < 3; c++)
                p->light[c][i] = (float) hits / (float) (2 * grid * grid);
        }
    }
    patch_run(at, method(at->ctx), NULL, p);
    for (int y = size / 4; y < size - size / 4; y++) {
        for (int x = size / 4; x < size - size / 4; x++) {
            const size_t i = patch_at(p, x, y);
            const double X = p->position[0][i], Y = p->position[1][i];
            const double mm = along ? Y * ux - X * uy : (X * ux + Y * uy) * sqrt(1.0 + slope * slope);
            for (int c = 0; c < 3; c++)
                worst = fmax(worst, fabs((double) p->result[c][i] - half_lit(&m->gaussians, c, mm)));
        }
    }
    patch_destroy(p);
    return worst;
}

static void tilted_plane_is_the_convolution_on_the_surface(void **state)
{
    static const double turns[] = { 0.0, 90.0, 45.0, 20.0 };
    const struct pell_frame_material m = marble();
    struct test_device at;

    (void) state;
    RELEASE_ONLY();
    at = test_device_create(2, NULL, NULL);
    for (size_t t = 0; t < PELL_COUNT(turns); t++) {
        for (int degrees = 0; degrees <= 75; degrees += SLOW ? 25 : 15) {
            const double across = tilt_error(&at, &m, degrees, turns[t], true, false);
            const double along = tilt_error(&at, &m, degrees, turns[t], true, true);
            const double perspective = tilt_error(&at, &m, degrees, turns[t], false, false);
            print_message("# tilt %2d, turned by %2.0f degrees: step across the slope %.4f, perspective %.4f, along it %.4f\n", degrees,
                          turns[t], across, perspective, along);
            REQUIRE(fmax(fmax(across, perspective), along) < (turns[t] == 0.0 || turns[t] == 90.0 ? 0.0015 : degrees < 70 ? 0.01 : 0.03));
        }
    }
    test_device_destroy(&at);
}

/* Surface area of a ball behind a pixel, in units of a pixel's area. */
static double ball_area(double radius, double x, double y, double px)
{
    double sum = 0.0;

    for (int s = 0; s < 64; s++) {
        const double X = x + ((s % 8 + 0.5) / 8.0 - 0.5) * px, Y = y + ((s / 8 + 0.5) / 8.0 - 0.5) * px,
                     z2 = radius * radius - X * X - Y * Y;
        if (z2 > 0.0)
            sum += fmin(radius / sqrt(z2), 200.0) / 64.0;
    }
    return sum;
}

/* A ball of 80 mm in an image of `size` pixels, `pixels` across, lit from the side and in front. Returns the sums over the surface. */
static void ball_sums(const struct test_device *at, const struct pell_frame_material *m, int size, double pixels, double in[3],
                      double out[3])
{
    const double radius = 40.0, scale = pixels / (2.0 * radius);
    struct patch *p = patch_create(size, size, true, scale, 100.0, m, 1);

    for (int y = 0; y < size; y++) {
        for (int x = 0; x < size; x++) {
            const size_t i = patch_at(p, x, y);
            const double px = (x + 0.5 - 0.5 * size) / scale, py = (y + 0.5 - 0.5 * size) / scale, z2 = radius * radius - px * px - py * py;
            p->material[i] = z2 > 0.0;
            p->depth[i] = (float) (100.0 - (z2 > 0.0 ? sqrt(z2) : 0.0));
            for (int c = 0; c < 3; c++)
                p->light[c][i] = z2 > 0.0 ? (float) fmax(0.0, (0.6 * px + 0.3 * py + 0.742 * sqrt(z2)) / radius) : 0.0f;
        }
    }
    patch_run(at, method(at->ctx), NULL, p);
    for (int c = 0; c < 3; c++) {
        in[c] = out[c] = 0.0;
        for (int y = 0; y < size; y++)
            for (int x = 0; x < size; x++) {
                const size_t i = patch_at(p, x, y);
                const double area =
                    p->material[i] ? ball_area(radius, (x + 0.5 - 0.5 * size) / scale, (y + 0.5 - 0.5 * size) / scale, 1.0 / scale) : 0.0;
                in[c] += area * (double) p->light[c][i];
                out[c] += area * (double) p->result[c][i];
            }
    }
    patch_destroy(p);
}

static void total_light_of_a_ball_is_kept(void **state)
{
    static const double sizes[] = { 60.0, 120.0, 240.0, 480.0 };
    struct test_device at = test_device_create(2, NULL, NULL);

    (void) state;
    for (size_t s = 0; s < PELL_COUNT(sizes); s++) {
        for (double v = 0.1; v < 120.0; v *= 8.0) {
            const struct pell_frame_material m = single(v);
            double in[3], out[3];
            ball_sums(&at, &m, (int) sizes[s] + 20, sizes[s], in, out);
            print_message("# ball of 80 mm, %3.0f px across, %.2f mm wide profile: %.4f of the light exits\n", sizes[s], sqrt(v),
                          out[0] / in[0]);
            REQUIRE_REL(out[0], in[0], v < 7.0 ? 0.003 : 0.005);
        }
    }
    test_device_destroy(&at);
}

/* A facing disc with uniform light except for a bright stripe at its border: effect of the border on the total. */
static void total_light_is_kept_at_borders(void **state)
{
    const struct pell_frame_material m = single(9.0);
    struct test_device at = test_device_create(1, NULL, NULL);
    struct patch *p = patch_create(120, 120, true, 1.0, 100.0, &m, 1);
    double before, after;

    (void) state;
    for (int y = 0; y < 120; y++)
        for (int x = 0; x < 120; x++) {
            const double r = hypot(x - 59.5, y - 59.5);
            p->material[patch_at(p, x, y)] = r < 50.0;
            p->light[0][patch_at(p, x, y)] = r > 45.0 && x > 60 ? 5.0f : 1.0f;
        }
    patch_run(&at, method(at.ctx), NULL, p);
    before = patch_sum(p, p->light, 0);
    after = patch_sum(p, p->result, 0);
    print_message("# bright rim: %.5f of the light exits\n", after / before);
    REQUIRE_REL(after, before, 1e-3);
    patch_destroy(p);
    test_device_destroy(&at);
}

/* Light that decreases toward a border. Where taps skip pixels, every second pixel next to a border has one tap more than its
 * neighbours, which shows as lines. */
static void borders_draw_no_lines(void **state)
{
    enum { EDGE = 30, SIZE = 160 };
    const struct pell_frame_material m = marble();
    struct test_device at = test_device_create(1, NULL, NULL);

    (void) state;
    for (int axis = 0; axis < 2; axis++) {
        struct patch *p = patch_create(axis ? 40 : SIZE, axis ? SIZE : 40, true, 8.0, 100.0, &m, 1);
        double worst = 0.0;

        for (int i = 0; i < SIZE; i++)
            for (int k = 0; k < 40; k++) {
                const size_t index = axis ? patch_at(p, k, i) : patch_at(p, i, k);
                p->material[index] = i >= EDGE;
                for (int c = 0; c < 3; c++)
                    p->light[c][index] = (float) fmax(i - EDGE, 0) / (SIZE - EDGE);
            }
        patch_run(&at, method(at.ctx), NULL, p);
        for (int i = EDGE + 8; i < EDGE + 50; i++) { /* the component that alternates from pixel to pixel, over sixteen pixels */
            double part = 0.0, sum = 0.0;
            for (int k = -8; k < 8; k++) {
                const double light = (double) p->result[0][axis ? patch_at(p, 20, i + k) : patch_at(p, i + k, 20)];
                const double after = (double) p->result[0][axis ? patch_at(p, 20, i + k + 1) : patch_at(p, i + k + 1, 20)];
                part += (k % 2 ? -1.0 : 1.0) * (after - light) / 32.0;
                sum += light / 16.0;
            }
            worst = fmax(worst, fabs(part) / sum);
        }
        print_message("# lines next to a border across axis %d: %.5f of the light\n", axis, worst);
        REQUIRE(worst < 5e-4);
        patch_destroy(p);
    }
    test_device_destroy(&at);
}

static void surfaces_apart_in_depth_do_not_bleed(void **state)
{
    const struct pell_frame_material m = single(4.0);
    struct test_device at = test_device_create(1, NULL, NULL);
    struct patch *p = patch_create(100, 70, false, 500.0, 500.0, &m, 1);

    (void) state;
    /* A nose 12 mm in front of a cheek: six standard deviations. The same material. */
    for (int y = 0; y < 70; y++)
        for (int x = 0; x < 100; x++) {
            const bool near_one = hypot(x - 50, y - 35) < 20.0;
            p->depth[patch_at(p, x, y)] = near_one ? 488.0f : 500.0f;
            p->light[0][patch_at(p, x, y)] = near_one;
            p->light[1][patch_at(p, x, y)] = !near_one;
        }
    patch_run(&at, method(at.ctx), NULL, p);
    for (int y = 0; y < 70; y++)
        for (int x = 0; x < 100; x++) {
            const size_t i = patch_at(p, x, y);
            REQUIRE_NEAR((double) p->result[0][i], (double) p->light[0][i], 1e-6);
            REQUIRE_NEAR((double) p->result[1][i], (double) p->light[1][i], 1e-6);
        }
    patch_destroy(p);
    test_device_destroy(&at);
}

/* A disc of light, 14 mm across, on a facing plane; each pixel holds the lit fraction of its area. */
static struct patch *lit_disc(const struct pell_frame_material *m, int size, double focal, double depth)
{
    struct patch *p = patch_create(size, size, false, focal, depth, m, 1);

    for (int y = 0; y < size; y++)
        for (int x = 0; x < size; x++) {
            int hits = 0;
            for (int s = 0; s < 256; s++) {
                const double X = (x + (s % 16 + 0.5) / 16.0 - 0.5 * size) * depth / focal,
                             Y = (y + (s / 16 + 0.5) / 16.0 - 0.5 * size) * depth / focal;
                hits += X * X + Y * Y < 49.0;
            }
            for (int c = 0; c < 3; c++)
                p->light[c][patch_at(p, x, y)] = (float) hits / 256.0f;
        }
    return p;
}

static void twice_the_distance_or_half_the_pixels_change_little(void **state)
{
    const struct pell_frame_material materials[2] = { skin(), marble() };
    struct test_device at = test_device_create(2, NULL, NULL);

    (void) state;
    for (int k = 0; k < 2; k++) {
        for (double scale = 1.0; scale < (SLOW ? 5.0 : 20.0); scale *= 2.0) {
            const int n = (int) (24.0 * scale);
            /* At a distance; at twice the distance; at the distance with half the pixels; at twice the distance with twice the focal
             * length. */
            struct patch *p[4] = { lit_disc(&materials[k], 2 * n, 2.0 * scale * 300.0, 300.0),
                                   lit_disc(&materials[k], n, 2.0 * scale * 300.0, 600.0), lit_disc(&materials[k], n, scale * 300.0, 300.0),
                                   lit_disc(&materials[k], 2 * n, 4.0 * scale * 300.0, 600.0) };
            double far = 0.0, coarse = 0.0, zoomed = 0.0, squares = 0.0;
            for (int i = 0; i < 4; i++)
                patch_run(&at, method(at.ctx), NULL, p[i]);
            for (int y = 0; y < n; y++)
                for (int x = 0; x < n; x++)
                    for (int c = 0; c < 3; c++) {
                        double mean = 0.0;
                        for (int s = 0; s < 4; s++) {
                            const size_t i = patch_at(p[0], 2 * x + s % 2, 2 * y + s / 2);
                            mean += 0.25 * (double) p[0]->result[c][i];
                            zoomed = fmax(zoomed, fabs((double) p[0]->result[c][i] - (double) p[3]->result[c][i]));
                        }
                        far = fmax(far, fabs(mean - (double) p[1]->result[c][patch_at(p[1], x, y)]));
                        squares += pow(mean - (double) p[1]->result[c][patch_at(p[1], x, y)], 2.0);
                        coarse = fmax(coarse, fabs(mean - (double) p[2]->result[c][patch_at(p[2], x, y)]));
                    }
            squares = sqrt(squares / (3.0 * n * n));
            print_message("# %s, %4.1f px/mm and half of it: twice as far %.4f (rms %.5f), half the pixels %.4f, far and zoomed in %.6f\n",
                          k ? "marble" : "skin", 2.0 * scale, far, squares, coarse, zoomed);
            REQUIRE(far < 0.045 && squares < 0.006 && coarse < 0.045 && zoomed < 1e-5);
            for (int i = 0; i < 4; i++)
                patch_destroy(p[i]);
        }
    }
    test_device_destroy(&at);
}

/* Change from frame to frame while the camera moves back by half a percent each, in excess of the closed form's change: at pixels by
 * their distance from the edge of a half-lit plane. */
static void a_dolly_does_not_pop(void **state)
{
    enum { HALF = 60, ACROSS = 2 * HALF };
    const struct pell_frame_material materials[2] = { skin(), marble() };
    struct test_device at;

    (void) state;
    RELEASE_ONLY();
    at = test_device_create(2, NULL, NULL);
    for (int k = 0; k < 2; k++) {
        double before[3][ACROSS] = { { 0 } }, worst = 0.0, worst_scale = 0.0;
        int frames = 0;
        for (double scale = 12.0; scale > 0.2; scale /= 1.005, frames++) {
            struct patch *p = patch_create(ACROSS, 24, false, scale * 400.0, 400.0, &materials[k], 1);
            for (int y = 0; y < 24; y++)
                for (int x = 0; x < ACROSS; x++)
                    for (int c = 0; c < 3; c++)
                        p->light[c][patch_at(p, x, y)] = x >= HALF;
            patch_run(&at, method(at.ctx), NULL, p);
            for (int x = HALF / 2; x < ACROSS - HALF / 2; x++)
                for (int c = 0; c < 3; c++) {
                    const double e =
                        (double) p->result[c][patch_at(p, x, 12)] - half_lit(&materials[k].gaussians, c, (x + 0.5 - HALF) / scale);
                    if (frames > 0 && fabs(e - before[c][x]) > worst) {
                        worst = fabs(e - before[c][x]);
                        worst_scale = scale;
                    }
                    before[c][x] = e;
                }
            patch_destroy(p);
        }
        print_message("# %s, %d frames from 12 to 0.2 px/mm: largest pop %.5f of the step, at %.2f px/mm\n", k ? "marble" : "skin", frames,
                      worst, worst_scale);
        REQUIRE(worst < 0.004);
    }
    test_device_destroy(&at);
}

static int64_t blurred_pixels(const struct pell_pass *pass)
{
    struct pell_pass_time times[32];
    const size_t count = pell_pass_times(pass, times, PELL_COUNT(times));
    int64_t sum = 0;

    for (size_t i = 0; i < count; i++)
        if (strncmp(times[i].name, "blur", 4) == 0)
            sum += times[i].pixels;
    return sum;
}

/* A square of 100 mm at several distances, alone and with others that cover as many pixels. */
static void cost_falls_with_distance_and_grows_with_pixels_alone(void **state)
{
    const struct pell_frame_material m = skin();
    struct test_device at = test_device_create(1, NULL, NULL);
    int64_t before = INT64_MAX, whole = 0;

    (void) state;
    for (double depth = 250.0; depth < 70000.0; depth *= 2.0) {
        struct patch *p = patch_create(320, 240, false, 600.0, depth, &m, 1);
        struct pell_pass *pass = patch_pass(&at, method(at.ctx), NULL, p);
        const double half = 50.0 * 600.0 / depth;
        int64_t cost, pixels = 0;
        for (int y = 0; y < 240; y++)
            for (int x = 0; x < 320; x++) {
                p->material[patch_at(p, x, y)] = fabs(x - 159.5) < half && fabs(y - 119.5) < half;
                pixels += p->material[patch_at(p, x, y)];
            }
        assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_OK);
        cost = blurred_pixels(pass);
        print_message("# at %5.0f mm: %6lld pixels, %7lld pixels blurred in all passes\n", depth, (long long) pixels, (long long) cost);
        REQUIRE(cost < before || cost == 0);
        REQUIRE(cost <= 2 * 4 * pixels);
        before = cost;
        pell_pass_destroy(&pass);
        patch_destroy(p);
    }
    assert_int_equal(before, 0);
    /* One square, and four of a quarter each. */
    for (int k = 1; k <= 2; k++) {
        struct patch *p = patch_create(256, 256, false, 600.0, 250.0, &m, 1);
        struct pell_pass *pass = patch_pass(&at, method(at.ctx), NULL, p);
        for (int y = 0; y < 256; y++)
            for (int x = 0; x < 256; x++)
                p->material[patch_at(p, x, y)] = x % (256 / k) < 128 / k && y % (256 / k) < 128 / k;
        assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_OK);
        if (k == 1)
            whole = blurred_pixels(pass);
        else
            assert_int_equal(blurred_pixels(pass), whole);
        pell_pass_destroy(&pass);
        patch_destroy(p);
    }
    test_device_destroy(&at);
}

static void strength_scales_the_radius(void **state)
{
    const struct pell_frame_material wide = single(16.0), narrow = single(4.0);
    static const char *const off[] = { "strength=off", NULL };
    struct test_device at = test_device_create(1, NULL, NULL);
    struct patch *p[3];

    (void) state;
    for (int i = 0; i < 3; i++) {
        p[i] = patch_create(80, 60, true, 1.0, 100.0, i == 1 ? &narrow : &wide, 1);
        for (int y = 0; y < 60; y++)
            for (int x = 0; x < 80; x++) {
                p[i]->light[0][patch_at(p[i], x, y)] = x >= 40;
                p[i]->strength[patch_at(p[i], x, y)] = i == 0 ? 0.5f : i == 1 ? 1.0f : 0.0f;
            }
        patch_run(&at, method(at.ctx), NULL, p[i]);
    }
    for (int x = 0; x < 80; x++) {
        REQUIRE_NEAR((double) p[0]->result[0][patch_at(p[0], x, 30)], (double) p[1]->result[0][patch_at(p[1], x, 30)], 1e-5);
        REQUIRE_NEAR((double) p[2]->result[0][patch_at(p[2], x, 30)], x >= 40, 1e-6);
    }
    patch_run(&at, method(at.ctx), off, p[2]);
    REQUIRE_NEAR((double) p[2]->result[0][patch_at(p[2], 39, 30)], phi(-0.5 / 4.0), 2e-3);
    for (int i = 0; i < 3; i++)
        patch_destroy(p[i]);
    test_device_destroy(&at);
}

static void derived_ssslevel_is_the_papers(void **state)
{
    const double focal = 360.0 / tan(10.0 * PI / 180.0); /* 720 lines, 20 degrees */

    (void) state;
    REQUIRE_NEAR(pell_ss_level(focal, 200.0), 29.47, 0.005);
    REQUIRE_REL(pell_ss_level(focal, 187.1), 31.5, 0.001);
}

static void setting_the_derived_ssslevel_changes_nothing(void **state)
{
    const struct pell_frame_material m = skin();
    struct test_device at = test_device_create(1, NULL, NULL);
    struct patch *p = patch_create(96, 64, false, 2041.66, 700.0, &m, 1), *q = patch_create(96, 64, false, 2041.66, 700.0, &m, 1);
    char text[40];
    const char *const settings[] = { text, NULL };

    (void) state;
    for (int y = 0; y < 64; y++)
        for (int x = 48; x < 96; x++)
            p->light[0][patch_at(p, x, y)] = q->light[0][patch_at(q, x, y)] = 5.0f;
    snprintf(text, sizeof(text), "ssslevel=%.9g", pell_ss_level(2041.66, (double) p->frame.shape.object_height));
    patch_run(&at, method(at.ctx), NULL, p);
    patch_run(&at, method(at.ctx), settings, q);
    for (int x = 0; x < 96; x++)
        REQUIRE_NEAR((double) p->result[0][patch_at(p, x, 30)], (double) q->result[0][patch_at(q, x, 30)], 1e-4);
    patch_destroy(p);
    patch_destroy(q);
    test_device_destroy(&at);
}

static void table_7_1_follows_from_the_weights(void **state)
{
    static const double printed[2][4][3] = {
        { { 1.0, 1.0, 1.0 }, { 0.3251, 0.45, 0.3583 }, { 0.34, 0.1864, 0.0 }, { 0.46, 0.0, 0.0402 } },
        { { 1.0, 1.0, 1.0 }, { 0.8173, 0.6616, 0.4647 }, { 0.5101, 0.4617, 0.4791 }, { 0.3913, 0.3161, 0.2189 } },
    };
    const struct pell_frame_material materials[2] = { skin(), marble() };
    const struct pell_gaussians none = { .count = 3,
                                         .variance = { 1.0, 2.0, 3.0 },
                                         .weight = { { 0.0 }, { 0.5, 0.0, 0.0 }, { 0.5, 1.0, 0.0 } } };
    float blend[3];

    (void) state;
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < 4; i++) {
            pell_ss_blend(&materials[k].gaussians, i, blend);
            for (int c = 0; c < 3; c++)
                REQUIRE_NEAR((double) blend[c], printed[k][i][c], 2e-4);
        }
    /* Channels whose first weights are 0. */
    for (int i = 0; i < 3; i++) {
        pell_ss_blend(&none, i, blend);
        for (int c = 0; c < 3; c++)
            REQUIRE(isfinite(blend[c]));
        REQUIRE_NEAR((double) blend[0], i < 2 ? 1.0 : 0.5, 1e-6);
        REQUIRE_NEAR((double) blend[1], 1.0, 1e-6);
    }
}

/* Variance of the response to one lit pixel in the middle along an axis, in pixels. */
static double spread(const struct patch *p, int axis)
{
    double sum = 0.0, moment = 0.0;

    for (int y = 0; y < p->frame.shape.height; y++)
        for (int x = 0; x < p->frame.shape.width; x++) {
            const double v = (double) p->result[0][patch_at(p, x, y)];
            const double d = axis ? y - p->frame.shape.height / 2 : x - p->frame.shape.width / 2;
            sum += v;
            moment += v * d * d;
        }
    return moment / sum;
}

/* The sheet of figure 7.5: kernel widths on a surface slanted to the side, viewed like the head of the paper. */
static void spans_follow_ssslevel_and_correction_as_in_figure_7_5(void **state)
{
    static const double levels[] = { 15.75, 31.5, 63.0 }, corrections[] = { 0.0, 1200.0, 4000.0 };
    const double focal = 360.0 / tan(10.0 * PI / 180.0), depth = 600.0, height = 200.0;
    const struct pell_frame_material m = single(1.0);
    struct test_device at = test_device_create(1, NULL, NULL);

    (void) state;
    for (size_t l = 0; l < PELL_COUNT(levels); l++) {
        for (size_t k = 0; k < PELL_COUNT(corrections); k++) {
            char level[32], correction[32];
            const char *const settings[] = { "as=paper", level, correction, NULL };
            struct patch *p = patch_create(161, 161, false, focal, depth, &m, 1);
            double change, expected[2], seen[2];
            snprintf(level, sizeof(level), "ssslevel=%g", levels[l]);
            snprintf(correction, sizeof(correction), "correction=%g", corrections[k]);
            patch_tilt(p, depth, 0.5, 0.0);
            patch_light(p, 0.0f, 0.0f, 0.0f);
            p->light[0][patch_at(p, 80, 80)] = 1.0f;
            patch_run(&at, method(at.ctx), settings, p);
            change = fmin(0.5 * depth / focal / height, 0.001);
            expected[0] = levels[l] / (depth / height + corrections[k] * change);
            expected[1] = levels[l] / (depth / height);
            for (int axis = 0; axis < 2; axis++) {
                /* 0.12 span^2 is the variance of the listing's taps; linear interpolation adds up to a quarter of a pixel squared. */
                seen[axis] = spread(p, axis) / 0.12;
                REQUIRE(seen[axis] > 0.97 * expected[axis] * expected[axis]);
                REQUIRE(seen[axis] < 1.03 * expected[axis] * expected[axis] + 0.25 / 0.12);
            }
            print_message("# ssslevel %5.2f, correction %4.0f: span %5.2f x %5.2f px, by the formula %5.2f x %5.2f\n", levels[l],
                          corrections[k], sqrt(seen[0]), sqrt(seen[1]), expected[0], expected[1]);
            patch_destroy(p);
        }
    }
    test_device_destroy(&at);
}

/* Properties that the paper's form violates by design: light at the mask's border is not conserved, and kernel widths are those of the
 * receiver. */
static void the_papers_form_keeps_uniform_light_and_fails_where_it_must(void **state)
{
    static const char *const paper[] = { "as=paper", NULL };
    const struct pell_frame_material m = single(9.0);
    struct test_device at = test_device_create(2, NULL, NULL);
    struct patch *p = patch_create(120, 110, false, 2041.66, 600.0, &m, 1);

    (void) state;
    for (int y = 0; y < 110; y++)
        for (int x = 0; x < 120; x++) {
            p->material[patch_at(p, x, y)] = hypot(x - 59.5, y - 54.5) < 50.0;
            if (!p->material[patch_at(p, x, y)])
                p->light[0][patch_at(p, x, y)] = p->depth[patch_at(p, x, y)] = NAN;
        }
    patch_run(&at, method(at.ctx), paper, p);
    for (int y = 0; y < 110; y++)
        for (int x = 0; x < 120; x++)
            if (p->material[patch_at(p, x, y)])
                REQUIRE_NEAR((double) p->result[0][patch_at(p, x, y)], 1.0, 1e-5);
    for (int y = 0; y < 110; y++)
        for (int x = 0; x < 120; x++)
            p->light[0][patch_at(p, x, y)] = hypot(x - 59.5, y - 54.5) > 47.0 ? 1.0f : 0.0f;
    patch_run(&at, method(at.ctx), paper, p);
    REQUIRE(fabs(patch_sum(p, p->result, 0) / patch_sum(p, p->light, 0) - 1.0) > 0.02);
    patch_run(&at, method(at.ctx), NULL, p);
    REQUIRE_REL(patch_sum(p, p->result, 0), patch_sum(p, p->light, 0), 0.002);
    patch_destroy(p);
    test_device_destroy(&at);
}

static void light_a_half(struct patch *p)
{
    for (int y = 0; y < p->frame.shape.height; y++)
        for (int x = 0; x < p->frame.shape.width; x++)
            for (int c = 0; c < 3; c++)
                p->light[c][patch_at(p, x, y)] = 2 * x >= p->frame.shape.width;
}

/* Both materials blur an edge to the same image, up to the factor `total` of a channel. */
static void same_edge(const struct test_device *at, const struct pell_frame_material *m, const char *const *settings,
                      const struct pell_frame_material *reference, const char *const *reference_settings, const double total[3])
{
    struct patch *p = patch_create(200, 40, false, 3000.0, 600.0, m, 1), *q = patch_create(200, 40, false, 3000.0, 600.0, reference, 1);

    light_a_half(p);
    light_a_half(q);
    patch_run(at, method(at->ctx), settings, p);
    patch_run(at, method(at->ctx), reference_settings, q);
    for (int x = 0; x < 200; x++)
        for (int c = 0; c < 3; c++) { /* published weights sum to 1 within 2e-4 */
            const double expected = total[c] * (double) q->result[c][patch_at(q, x, 20)];
            REQUIRE_NEAR((double) p->result[c][patch_at(p, x, 20)], expected, 1e-5 + 2e-4 * expected);
        }
    patch_destroy(p);
    patch_destroy(q);
}

static void the_papers_skin_is_its_four_gaussians_with_the_first_unblurred(void **state)
{
    static const char *const paper[] = { "as=paper", "foreshortening=surface", "ssslevel=0", NULL };
    static const char *const same[] = { "edges=paper", "first=unblurred", "lod=0.5", "input=lit", NULL };
    const double one[3] = { 1.0, 1.0, 1.0 };
    const struct pell_frame_material published = skin(), preset = {
        .name = "skin", .preset = "skin", .medium = pell_material_find("skin")->medium, .gaussians = pell_material_find("skin")->gaussians
    };
    struct test_device at = test_device_create(1, NULL, NULL);

    (void) state;
    same_edge(&at, &preset, paper, &published, same, one);
    test_device_destroy(&at);
}

/* The white sets of table 7.1 replace the profiles that they are fitted to, in the material's own colour, and no other profile. */
static void published_sets_are_for_their_own_materials_only(void **state)
{
    static const char *const published[] = { "profile=published", NULL };
    const double one[3] = { 1.0, 1.0, 1.0 };
    const struct pell_material_entry *stone = pell_material_find("marble"), *layered = pell_material_find("skin-3layer");
    const struct pell_frame_material white = { .name = "white",
                                               .medium = stone->medium,
                                               .gaussians = pell_material_find("marble-4gaussian")->gaussians };
    const struct pell_frame_material by_preset = { .name = "marble", .preset = "marble", .medium = stone->medium };
    const struct pell_material_entry *six = pell_material_find("skin-6gaussian");
    const struct pell_frame_material skins[] = {
        { .name = "skin-3layer", .preset = "skin-3layer", .medium = layered->medium, .gaussians = layered->gaussians },
        { .name = "skin-6gaussian", .preset = "skin-6gaussian", .medium = six->medium, .gaussians = six->gaussians },
    };
    struct pell_frame_material others[] = {
        { .name = "skin-3layer", .medium = layered->medium, .gaussians = layered->gaussians },
        { .name = "skin-6gaussian", .preset = "skin-6gaussian", .medium = six->medium, .gaussians = layered->gaussians },
        { .name = "skin1", .preset = "skin1", .medium = pell_material_find("skin1")->medium },
        { .name = "marble", .preset = "marble", .medium = stone->medium, .gaussians = skin().gaussians },
        { .name = "skinny jeans", .medium = stone->medium },
        { .name = "marble", .medium = pell_material_find("ketchup")->medium },
        { .name = "wholemilk", .preset = "wholemilk", .medium = pell_material_find("wholemilk")->medium },
    };
    struct test_device at = test_device_create(1, NULL, NULL);
    double total[3];

    (void) state;
    for (int c = 0; c < 3; c++) {
        const struct pell_dipole d =
            pell_dipole_make(stone->medium.sigma_a[c], stone->medium.sigma_s_reduced[c], stone->medium.eta, PELL_FRESNEL_EXACT);
        total[c] = pell_dipole_total(&d);
        assert_true(total[c] < 0.999);
    }
    same_edge(&at, &by_preset, published, &white, NULL, total);
    for (size_t i = 0; i < PELL_COUNT(skins); i++) {
        const struct pell_frame_material four = skin();
        for (int c = 0; c < 3; c++)
            total[c] = pell_gaussians_total(&skins[i].gaussians, c);
        same_edge(&at, &skins[i], published, &four, NULL, total);
    }
    for (size_t i = 0; i < PELL_COUNT(others); i++) {
        struct pell_frame_material plain = others[i];
        plain.name = "plain";
        plain.preset = NULL;
        same_edge(&at, &others[i], published, &plain, NULL, one);
    }
    test_device_destroy(&at);
}

static void thickness_is_the_sum_of_gaussians(void **state)
{
    const struct pell_frame_material m = marble();
    static const char *const off[] = { "through=off", NULL };
    struct test_device at = test_device_create(1, NULL, NULL);
    struct patch *p = patch_create(8, 8, true, 1.0, 100.0, &m, 1);
    struct pell_pass *pass = patch_pass(&at, method(at.ctx), NULL, p);
    const struct pell_thickness_table *t = pell_pass_thickness(pass, 0);

    (void) state;
    assert_non_null(t);
    assert_true(pell_pass_plan(pass)->needs & PELL_NEED_TRANSMISSION);
    for (int c = 0; c < 3; c++) {
        for (double d = 0.0; d < (double) t->max_mm; d += 0.037) {
            const double position = (PELL_THICKNESS_STEPS - 1) * sqrt(d / (double) t->max_mm);
            const int i = (int) position < PELL_THICKNESS_STEPS - 2 ? (int) position : PELL_THICKNESS_STEPS - 2;
            const double f = position - i, value = (1.0 - f) * (double) t->value[i][c] + f * (double) t->value[i + 1][c];
            double expected = 0.0;
            for (int k = 0; k < 4; k++)
                expected += marble_weight[k][c] * exp(-d * d / (2.0 * marble_variance[k]));
            REQUIRE_NEAR(value, expected, 2e-5);
        }
    }
    pell_pass_destroy(&pass);
    pass = patch_pass(&at, method(at.ctx), off, p);
    assert_null(pell_pass_thickness(pass, 0));
    assert_false(pell_pass_plan(pass)->needs & PELL_NEED_TRANSMISSION);
    pell_pass_destroy(&pass);
    patch_destroy(p);
    test_device_destroy(&at);
}

/* A medium has slab transmittance, Gaussians do not; interpolation between two thicknesses of the table equals the closed form. */
static void thickness_of_a_medium_is_that_of_a_slab(void **state)
{
    static const char *const gaussian[] = { "through=gaussian", NULL };
    struct test_device at = test_device_create(1, NULL, NULL);
    struct pell_frame_material m = { .name = "plain", .medium = pell_material_find("wholemilk")->medium };
    struct patch *p = patch_create(8, 8, true, 1.0, 100.0, &m, 1);
    struct pell_pass *pass = patch_pass(&at, method(at.ctx), NULL, p);
    const struct pell_thickness_table *t = pell_pass_thickness(pass, 0);
    struct pell_slab slab[3];

    (void) state;
    for (int c = 0; c < 3; c++)
        REQUIRE(pell_slab_make(&m.medium, c, &slab[c]));
    for (int c = 0; c < 3; c++)
        for (double d = 0.05; d < (double) t->max_mm; d += 0.37) {
            const double position = (PELL_THICKNESS_STEPS - 1) * sqrt(d / (double) t->max_mm);
            const int i = (int) position < PELL_THICKNESS_STEPS - 2 ? (int) position : PELL_THICKNESS_STEPS - 2;
            const double f = position - i, value = (1.0 - f) * (double) t->slab[i][c] + f * (double) t->slab[i + 1][c];
            const double want = pell_slab_at(&slab[c], d).transmitted;
            REQUIRE_NEAR(value, want, 2e-3 * want + 1e-4);
        }
    pell_pass_destroy(&pass);
    pass = patch_pass(&at, method(at.ctx), gaussian, p);
    t = pell_pass_thickness(pass, 0);
    assert_memory_equal(t->slab, t->value, sizeof(t->slab));
    pell_pass_destroy(&pass);
    patch_destroy(p);
    test_device_destroy(&at);
}

static void depths_in_object_heights_need_a_height(void **state)
{
    static const char *const settings[] = { "ssslevel=30", NULL };
    const struct pell_frame_material m = skin();
    struct kept_messages kept = { 0 };
    struct test_device at = test_device_create(1, NULL, &kept);
    struct patch *p = patch_create(8, 8, true, 1.0, 100.0, &m, 1);
    struct screen_knobs knobs;
    struct pell_pass *pass;

    (void) state;
    p->frame.shape.object_height = 0.0f;
    patch_configure(at.ctx, method(at.ctx), settings, &knobs);
    assert_int_equal(pell_pass_create(at.device, method(at.ctx), &knobs, &p->frame.shape, &pass), PELL_ERR_INVALID);
    assert_int_equal(kept.errors, 1);
    assert_non_null(strstr(kept.what, "object_height"));
    patch_destroy(p);
    test_device_destroy(&at);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(half_lit_plane_is_the_analytic_convolution),
        cmocka_unit_test(a_measured_material_is_its_fit),
        cmocka_unit_test(the_default_lod_is_the_smallest_under_half_a_percent),
        cmocka_unit_test(blurring_the_first_gaussian_has_the_smaller_error),
        cmocka_unit_test(tilted_plane_is_the_convolution_on_the_surface),
        cmocka_unit_test(total_light_of_a_ball_is_kept),
        cmocka_unit_test(total_light_is_kept_at_borders),
        cmocka_unit_test(borders_draw_no_lines),
        cmocka_unit_test(surfaces_apart_in_depth_do_not_bleed),
        cmocka_unit_test(twice_the_distance_or_half_the_pixels_change_little),
        cmocka_unit_test(a_dolly_does_not_pop),
        cmocka_unit_test(cost_falls_with_distance_and_grows_with_pixels_alone),
        cmocka_unit_test(strength_scales_the_radius),
        cmocka_unit_test(derived_ssslevel_is_the_papers),
        cmocka_unit_test(setting_the_derived_ssslevel_changes_nothing),
        cmocka_unit_test(table_7_1_follows_from_the_weights),
        cmocka_unit_test(spans_follow_ssslevel_and_correction_as_in_figure_7_5),
        cmocka_unit_test(the_papers_form_keeps_uniform_light_and_fails_where_it_must),
        cmocka_unit_test(the_papers_skin_is_its_four_gaussians_with_the_first_unblurred),
        cmocka_unit_test(published_sets_are_for_their_own_materials_only),
        cmocka_unit_test(thickness_is_the_sum_of_gaussians),
        cmocka_unit_test(thickness_of_a_medium_is_that_of_a_slab),
        cmocka_unit_test(depths_in_object_heights_need_a_height),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
