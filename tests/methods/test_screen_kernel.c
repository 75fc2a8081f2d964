/* SPDX-License-Identifier: MIT
 * test_screen_kernel.c - the screen-space method with kernel=separable and with rotated lines of taps: against closed forms, its own
 * total, and the energy error that it reports. */
#include "patch.h"

#include <pellucid/kernel.h>

static const double two_variance[2] = { 0.5, 4.0 };
static const double two_weight[2][3] = { { 0.5, 0.2, 0.7 }, { 0.3, 0.6, 0.1 } };

static const struct pell_method *method(struct pell_context *ctx)
{
    return pell_method_find(ctx, "test", "screen-space");
}

static struct pell_frame_material single(double variance)
{
    static const double one[1][3] = { { 1.0, 1.0, 1.0 } };
    return patch_gaussians(1, &variance, one);
}

static double phi(double x)
{
    return 0.5 * erfc(-x / sqrt(2.0));
}

/* A Gaussian is separable, so one pair of passes is exact: the largest difference to the step's closed form. */
static double step_error(const struct test_device *at, const char *const *settings, double px_per_mm, int axis)
{
    const struct pell_frame_material m = single(1.0);
    const int half = (int) (5.0 * px_per_mm) + 24, size = 2 * half;
    struct patch *p = patch_create(axis ? 40 : size, axis ? size : 40, true, px_per_mm, 500.0, &m, 1);
    double worst = 0.0;

    patch_light_half(p, axis, half);
    patch_run(at, method(at->ctx), settings, p);
    for (int i = size / 8; i < size - size / 8; i++) {
        const size_t k = axis ? patch_at(p, 20, i) : patch_at(p, i, 20);
        worst = fmax(worst, fabs((double) p->result[1][k] - phi((i + 0.5 - half) / px_per_mm)));
    }
    patch_destroy(p);
    return worst;
}

static void a_gaussian_is_its_own_separable_kernel(void **state)
{
    static const char *const dense[] = { "kernel=separable", "rank=1", "taps=64", NULL };
    static const char *const fewer[] = { "kernel=separable", "rank=1", NULL };
    struct test_device at = test_device_create(2, NULL, NULL);
    double every = 0.0, gaps = 0.0;
    (void) state;

    for (double scale = 0.1; scale < 18.0; scale *= 1.7)
        every = fmax(every, fmax(step_error(&at, dense, scale, 0), step_error(&at, dense, scale, 1)));
    for (double scale = 4.0; scale < 60.0; scale *= 2.3)
        gaps = fmax(gaps, fmax(step_error(&at, fewer, scale, 0), step_error(&at, fewer, scale, 1)));
    print_message("# half-lit plane: %.4f of the step by every pixel, %.4f by 25 taps\n", every, gaps);
    REQUIRE(every < 0.003);
    REQUIRE(gaps < 0.06);
    test_device_destroy(&at);
}

static void keep_reported(void *user, const struct pell_message *m)
{
    char *reported = user;

    if (strstr(m->what, "energy error"))
        snprintf(reported, 256, "%s", strstr(m->what, "energy error"));
}

/* Squared difference between the response to a single lit pixel and the profile, relative to the profile's square. */
static void the_energy_error_is_that_of_the_image(void **state)
{
    const struct pell_frame_material m = patch_gaussians(2, two_variance, two_weight);
    const double px_per_mm = 8.0;
    const int middle = 60, size = 2 * middle + 1;
    char report_text[256] = "";
    const struct pell_context_params kept = { .log = keep_reported, .log_user = report_text };
    const struct pell_device_params threads = { .threads = 2 };
    struct test_device at = { 0 };
    double before[3] = { 1.0, 1.0, 1.0 };
    (void) state;

    assert_int_equal(pell_context_create(&kept, &at.ctx), PELL_OK);
    assert_int_equal(pell_device_create(at.ctx, &threads, &at.device), PELL_OK);
    for (int rank = 1; rank <= 3; rank++) {
        char text[16];
        const char *const settings[] = { "kernel=separable", "taps=64", text, NULL };
        struct patch *p = patch_create(size, size, true, px_per_mm, 500.0, &m, 1);
        double reported[3];

        snprintf(text, sizeof(text), "rank=%d", rank);
        patch_light(p, 0, 0, 0);
        for (int c = 0; c < 3; c++)
            p->light[c][patch_at(p, middle, middle)] = 1.0f;
        patch_run(&at, method(at.ctx), settings, p);
        assert_int_equal(sscanf(report_text, "energy error %lf %lf %lf", &reported[0], &reported[1], &reported[2]), 3);
        for (int c = 0; c < 3; c++) {
            double wrong = 0.0, all = 0.0, error;
            for (int y = 0; y < size; y++)
                for (int x = 0; x < size; x++) {
                    const double r = hypot(x - middle, y - middle) / px_per_mm;
                    const double is = (double) p->result[c][patch_at(p, x, y)] * px_per_mm * px_per_mm;
                    const double should = pell_gaussians_eval(&m.gaussians, c, r);
                    wrong += (is - should) * (is - should);
                    all += should * should;
                }
            error = sqrt(wrong / all);
            print_message("# rank %d, channel %d: energy error %.4f in the image, %.4f reported\n", rank, c, error, 0.01 * reported[c]);
            REQUIRE(fabs(error - 0.01 * reported[c]) < 0.001 * reported[c] + 0.008); /* the reported error uses finer cells than pixels */
            REQUIRE(error < before[c] + 1e-3);
            before[c] = error;
        }
        patch_destroy(p);
    }
    REQUIRE(before[0] < 0.01 && before[1] < 0.01 && before[2] < 0.01);
    test_device_destroy(&at);
}

/* Solid angle of a ball seen through a pixel, mm^2. */
static double ball_area(double radius, double x, double y, double size)
{
    double sum = 0.0;

    for (int k = 0; k < 64; k++) {
        const double px = x + ((k % 8 + 0.5) / 8.0 - 0.5) * size, py = y + ((k / 8 + 0.5) / 8.0 - 0.5) * size;
        const double z2 = radius * radius - px * px - py * py;
        if (z2 > 0.0)
            sum += fmin(radius / sqrt(z2), 200.0) / 64.0;
    }
    return sum;
}

static double ball_total(const struct test_device *at, const char *const *settings, const struct pell_frame_material *m, double pixels)
{
    const double radius = 40.0, scale = pixels / (2.0 * radius);
    const int size = (int) pixels + 20;
    struct patch *p = patch_create(size, size, true, scale, 100.0, m, 1);
    double in = 0.0, out = 0.0;

    for (int y = 0; y < size; y++)
        for (int x = 0; x < size; x++) {
            const size_t i = patch_at(p, x, y);
            const double px = (x + 0.5 - 0.5 * size) / scale, py = (y + 0.5 - 0.5 * size) / scale, z2 = radius * radius - px * px - py * py;
            p->material[i] = z2 > 0.0;
            p->depth[i] = (float) (100.0 - (z2 > 0.0 ? sqrt(z2) : 0.0));
            for (int c = 0; c < 3; c++)
                p->light[c][i] = z2 > 0.0 ? (float) fmax(0.0, (0.6 * px + 0.3 * py + 0.742 * sqrt(z2)) / radius) : 0.0f;
        }
    patch_run(at, method(at->ctx), settings, p);
    for (int y = 0; y < size; y++)
        for (int x = 0; x < size; x++) {
            const size_t i = patch_at(p, x, y);
            const double area =
                p->material[i] ? ball_area(radius, (x + 0.5 - 0.5 * size) / scale, (y + 0.5 - 0.5 * size) / scale, 1.0 / scale) : 0.0;
            in += area * (double) p->light[0][i];
            out += area * (double) p->result[0][i];
        }
    patch_destroy(p);
    return out / in;
}

static void total_light_is_kept_within_a_percent(void **state)
{
    static const char *const forms[][5] = {
        { "kernel=separable", "rank=1", NULL },
        { "kernel=separable", "rank=2", NULL },
        { "kernel=separable", "rank=3", NULL },
        { "kernel=separable", "rank=2", "rotate=true", "taps=6", NULL },
    };
    static const double widths[] = { 0.1, 0.8, 6.4, 52.0 };
    struct test_device at = test_device_create(2, NULL, NULL);
    (void) state;

    for (size_t f = 0; f < PELL_COUNT(forms); f++)
        for (size_t i = 0; i < PELL_COUNT(widths); i++) {
            const double variance[2] = { widths[i], 8.0 * widths[i] }, weight[2][3] = { { 0.6, 0.6, 0.6 }, { 0.4, 0.4, 0.4 } };
            const struct pell_frame_material m = patch_gaussians(2, variance, weight);
            const double total = ball_total(&at, forms[f], &m, 160.0);
            print_message("# %s %s: ball of 80 mm, profile %.2f mm wide: %.4f of the light exits\n", forms[f][1],
                          forms[f][2] ? forms[f][2] : "", sqrt(widths[i] * (0.6 + 0.4 * 8.0)), total);
            REQUIRE(fabs(total - 1.0) < (f == 3 && i == 3 ? 0.03 : 0.01)); /* outside the ball, with rotated lines */
        }
    test_device_destroy(&at);
}

static void even_light_stays_even(void **state)
{
    const struct pell_frame_material m = patch_gaussians(2, two_variance, two_weight);
    struct test_device at = test_device_create(1, NULL, NULL);
    (void) state;

    for (int rank = 1; rank <= 3; rank++)
        for (int turned = 0; turned < 2; turned++) {
            char text[16];
            const char *const settings[] = { "kernel=separable", text, turned ? "rotate=true" : "rotate=false", "taps=5", NULL };
            struct patch *p = patch_create(90, 70, false, 1500.0, 300.0, &m, 1);
            snprintf(text, sizeof(text), "rank=%d", rank);
            patch_tilt(p, 300.0, 0.6, -0.3);
            patch_run(&at, method(at.ctx), settings, p);
            for (int c = 0; c < 3; c++)
                for (int y = 0; y < 70; y++)
                    for (int x = 0; x < 90; x++)
                        REQUIRE_REL((double) p->result[c][patch_at(p, x, y)], pell_gaussians_total(&m.gaussians, c), 2e-5);
            patch_destroy(p);
        }
    test_device_destroy(&at);
}

/* Rotated and shifted lines of taps far longer than the surface may have no tap on it: such a pixel keeps its unblurred light. */
static void taps_that_all_miss_leave_the_light(void **state)
{
    static const char *const forms[][6] = {
        { "edges=paper", "ssslevel=6580", "rotate=true", NULL },
        { "edges=paper", "foreshortening=paper", "ssslevel=1e5", "rotate=true", NULL },
        { "kernel=separable", "rank=3", "taps=1", "ssslevel=1e5", "rotate=true", NULL },
    };
    const struct pell_frame_material m = patch_gaussians(2, two_variance, two_weight);
    struct test_device at = test_device_create(1, NULL, NULL);
    (void) state;

    for (size_t f = 0; f < PELL_COUNT(forms); f++) {
        struct patch *p = patch_create(40, 30, false, 300.0, 300.0, &m, 1);
        for (int y = 0; y < 30; y++)
            for (int x = 0; x < 40; x++)
                p->material[patch_at(p, x, y)] = x / 3 == 5 && y / 3 == 4; /* nine pixels */
        patch_run(&at, method(at.ctx), forms[f], p);
        for (int c = 0; c < 3; c++)
            for (int y = 12; y < 15; y++)
                for (int x = 15; x < 18; x++)
                    REQUIRE_REL((double) p->result[c][patch_at(p, x, y)], pell_gaussians_total(&m.gaussians, c), 2e-5);
        patch_destroy(p);
    }
    test_device_destroy(&at);
}

/* A plane slanted about a diagonal of the image: a Gaussian that is isotropic on the surface, seen obliquely. */
static void a_slanting_plane_has_its_kernel_on_the_surface(void **state)
{
    static const char *const settings[] = { "kernel=separable", "rank=1", "taps=64", NULL };
    const struct pell_frame_material m = single(9.0);
    struct test_device at = test_device_create(2, NULL, NULL);
    struct patch *p = patch_create(140, 140, true, 3.0, 500.0, &m, 1);
    double worst = 0.0, squares = 0.0, lit = 0.0;
    const int middle = 70;
    (void) state;

    patch_tilt(p, 500.0, 0.8, 0.8);
    patch_light(p, 0, 0, 0);
    p->light[0][patch_at(p, middle, middle)] = 1.0f;
    patch_run(&at, method(at.ctx), settings, p);
    for (int y = 0; y < 140; y++)
        for (int x = 0; x < 140; x++) {
            const size_t i = patch_at(p, x, y), o = patch_at(p, middle, middle);
            double d2 = 0.0, should;
            for (int k = 0; k < 3; k++)
                d2 += pow((double) p->position[k][i] - (double) p->position[k][o], 2.0);
            should = exp(-d2 / 18.0);
            worst = fmax(worst, fabs((double) p->result[0][i] / (double) p->result[0][o] - should));
            squares += pow((double) p->result[0][i] / (double) p->result[0][o] - should, 2.0) * (should > 0.01);
            lit += should > 0.01;
        }
    print_message("# a lit pixel, slanting by 48 degrees about a diagonal: %.4f of the peak at most, %.4f rms\n", worst,
                  sqrt(squares / lit));
    REQUIRE(worst < 0.04); /* taps of the second pass are rounded to the nearest pixel of their line */
    REQUIRE(sqrt(squares / lit) < 0.015);
    patch_destroy(p);
    test_device_destroy(&at);
}

/* A bright line under a wide kernel of few taps causes banding at tap positions; rotation from pixel to pixel turns the banding into
 * noise, whose mean along the line is the kernel. */
static double echoes(const struct test_device *at, const char *const *settings)
{
    const double px_per_mm = 10.0, sigma = 3.0;
    const struct pell_frame_material m = single(sigma * sigma);
    struct patch *p = patch_create(321, 96, true, px_per_mm, 500.0, &m, 1);
    double worst = 0.0;

    patch_light(p, 0, 0, 0);
    for (int y = 0; y < 96; y++)
        for (int x = 158; x < 163; x++)
            p->light[0][patch_at(p, x, y)] = 1.0f;
    patch_run(at, method(at->ctx), settings, p);
    for (int x = 60; x < 261; x++) {
        double mean = 0.0;
        for (int y = 20; y < 76; y++)
            mean += (double) p->result[0][patch_at(p, x, y)] / 56.0;
        worst = fmax(worst, fabs(mean - (phi((x - 157.5) / (px_per_mm * sigma)) - phi((x - 162.5) / (px_per_mm * sigma)))));
    }
    patch_destroy(p);
    return worst / (2.0 * phi(2.5 / (px_per_mm * sigma)) - 1.0);
}

static void turned_taps_make_noise_of_banding(void **state)
{
    static const char *const forms[][2][5] = {
        { { "kernel=separable", "rank=1", "taps=6", NULL }, { "kernel=separable", "rank=1", "taps=6", "rotate=true", NULL } },
        { { "edges=paper", "foreshortening=surface", NULL }, { "edges=paper", "foreshortening=surface", "rotate=true", NULL } },
    };
    struct test_device at = test_device_create(2, NULL, NULL);
    (void) state;

    for (size_t f = 0; f < PELL_COUNT(forms); f++) {
        const double straight = echoes(&at, forms[f][0]), turned = echoes(&at, forms[f][1]);
        print_message("# %s: echoes of a line are %.3f of the kernel's peak; turned, the mean along the line is off by %.3f\n",
                      forms[f][0][0], straight, turned);
        REQUIRE(straight > 0.5);
        REQUIRE(turned < 0.35 * straight);
    }
    test_device_destroy(&at);
}

/* Bit-identical for any number of threads. */
static void threads_and_simd_levels_change_nothing(void **state)
{
    static const char *const levels[] = { "base", "v2", "v3" };
    static const char *const forms[][5] = { { "kernel=separable", "rank=3", "rotate=true", "taps=4", NULL },
                                            { "edges=paper", "rotate=true", NULL } };
    static const double variance[2] = { 1.0, 9.0 };
    const struct pell_frame_material m[2] = { patch_gaussians(2, variance, two_weight), patch_gaussians(2, two_variance, two_weight) };
    (void) state;

    for (size_t f = 0; f < PELL_COUNT(forms); f++) {
        struct patch *p[4];
        for (int t = 0; t < 4; t++) {
            struct test_device at;
            if (t < 3)
                setenv("PELL_SIMD", levels[t], 1);
            else
                unsetenv("PELL_SIMD");
            at = test_device_create(t > 1 ? 3 : 1, NULL, NULL);
            p[t] = patch_create(123, 77, false, 900.0, 300.0, m, 2);
            for (int y = 0; y < 77; y++)
                for (int x = 0; x < 123; x++) {
                    p[t]->material[patch_at(p[t], x, y)] = (uint16_t) (x < 12 ? 0 : x < 60 ? 1 : 2);
                    p[t]->light[0][patch_at(p[t], x, y)] = (float) ((x / 9 + y / 7) % 3);
                }
            patch_run(&at, method(at.ctx), forms[f], p[t]);
            test_device_destroy(&at);
        }
        for (int t = 1; t < 4; t++)
            for (int c = 0; c < 3; c++)
                assert_memory_equal(p[0]->result[c], p[t]->result[c], sizeof(float) * (size_t) p[0]->frame.shape.stride * 77);
        for (int t = 0; t < 4; t++)
            patch_destroy(p[t]);
    }
}

/* Each allocation of creating the pass fails in turn. */
static void allocations_that_fail_are_told_of(void **state)
{
    static const char *const settings[] = { "kernel=separable", "rank=2", NULL };
    const struct pell_frame_material m = patch_gaussians(2, two_variance, two_weight);
    int failed = 0;
    (void) state;

    for (uint64_t n = 1;; n++) {
        struct pell_alloc_fault fault = { 0 };
        struct test_device at = test_device_create(1, &fault, NULL);
        struct patch *p = patch_create(40, 30, true, 2.0, 300.0, &m, 1);
        void *values = calloc(1, method(at.ctx)->knobs_size);
        struct pell_pass *pass;
        enum pell_result res;

        patch_configure(at.ctx, method(at.ctx), settings, values);
        fault.fail_at = fault.calls + n;
        res = pell_pass_create(at.device, method(at.ctx), values, &p->frame.shape, &pass);
        free(values);
        patch_destroy(p);
        pell_pass_destroy(&pass);
        test_device_destroy(&at);
        if (res == PELL_OK)
            break;
        assert_int_equal(res, PELL_ERR_NOMEM);
        failed++;
    }
    REQUIRE(failed > 10);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_gaussian_is_its_own_separable_kernel), cmocka_unit_test(the_energy_error_is_that_of_the_image),
        cmocka_unit_test(total_light_is_kept_within_a_percent),   cmocka_unit_test(even_light_stays_even),
        cmocka_unit_test(taps_that_all_miss_leave_the_light),     cmocka_unit_test(a_slanting_plane_has_its_kernel_on_the_surface),
        cmocka_unit_test(turned_taps_make_noise_of_banding),      cmocka_unit_test(threads_and_simd_levels_change_nothing),
        cmocka_unit_test(allocations_that_fail_are_told_of),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
