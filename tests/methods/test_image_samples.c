/* SPDX-License-Identifier: MIT
 * test_image_samples.c - samples of the image-space method: their distribution against the profiles, their number per pixel, and their
 * change from image to image. */
#include "image_patches.h"

#include <pellucid/inversion.h>

/* --- Samples --------------------------------------------------------------------------------------------------------------------- */

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *) a, y = *(const double *) b;
    return (x > y) - (x < y);
}

/* All samples of a tile together follow the profile, and so does each pixel's own subset. */
static void radii_are_distributed_as_the_profile(void **state)
{
    static const char *const names[] = { "marble", "wholemilk", "skin1", "ketchup" };
    static const enum pell_profile_model models[] = { PELL_PROFILE_DIPOLE, PELL_PROFILE_NORMALIZED_DIFFUSION, PELL_PROFILE_BETTER_DIPOLE };
    struct pell_profile *profile = calloc(3, sizeof(*profile));
    double worst_all = 0.0, worst_pixel = 0.0, mean = 0.0;

    (void) state;
    for (size_t i = 0; i < PELL_COUNT(names); i++)
        for (size_t k = 0; k < PELL_COUNT(models); k++) {
            struct pell_frame_material m = medium(names[i]);
            struct is_knobs knobs = { .samples = 32, .sampling = IS_SEPARATE, .tile = IS_TILE_4 };
            double r[256], turns[256];
            m.profile = profile;
            for (int c = 0; c < 3; c++)
                assert_int_equal(pell_profile_make(models[k], &m.medium, c, NULL, &profile[c]), PELL_OK);
            for (int uniform = 0; uniform < 2; uniform++) {
                const double reach = is_reach(&m);
                double c = 0.0, s = 0.0;
                for (int x = 0; x < 16; x++) {
                    for (int j = 0; j < 16; j++) {
                        is_set_sample(&m, &knobs, reach, x % 4, x / 4, j + 16 * uniform, &r[16 * x + j], &turns[16 * x + j]);
                        c += cos(2.0 * PELL_PI * turns[16 * x + j]);
                        s += sin(2.0 * PELL_PI * turns[16 * x + j]);
                    }
                    qsort(&r[16 * x], 16, sizeof(double), by_size);
                }
                mean = fmax(mean, hypot(c, s) / 256.0);
                for (int all = 0; all < 2; all++) {
                    const int n = all ? 256 : 16;
                    if (all)
                        qsort(r, 256, sizeof(double), by_size);
                    for (int j = 0; j < 256; j++) {
                        double inside = 0.0;
                        for (int ch = 0; ch < 3; ch++)
                            inside += pell_profile_cdf(&profile[ch], r[j]) / 3.0;
                        if (uniform)
                            inside = r[j] * r[j] / (reach * reach);
                        double *const worst = all ? &worst_all : &worst_pixel;
                        *worst = fmax(*worst, fabs(inside - ((double) (j % n) + 0.5) / n));
                    }
                }
            }
        }
    print_message("# distance to the distribution: %.5f of 256 samples of a tile, %.4f of 16 of a pixel; mean direction %.4f\n", worst_all,
                  worst_pixel, mean);
    REQUIRE(worst_all < 1e-4);
    REQUIRE(worst_pixel <= 0.5 / 16.0);
    REQUIRE(mean < 0.02);
    free(profile);
}

/* The effect of using one random number twice on the dipole's distribution: docs/errata.md, mertens-2, has 0.203 for marble's green. */
static void one_number_for_two_choices_bends_the_distribution(void **state)
{
    struct pell_profile *profile = calloc(3, sizeof(*profile));
    struct pell_frame_material m = medium("marble");
    double distance[2];

    (void) state;
    for (int c = 0; c < 3; c++) {
        m.medium.sigma_a[c] = m.medium.sigma_a[1];
        m.medium.sigma_s_reduced[c] = m.medium.sigma_s_reduced[1];
    }
    m.medium.eta = 1.3;
    for (int c = 0; c < 3; c++)
        assert_int_equal(pell_profile_make(PELL_PROFILE_DIPOLE, &m.medium, c, NULL, &profile[c]), PELL_OK);
    m.profile = profile;
    for (int printed = 0; printed < 2; printed++) {
        const struct is_knobs knobs = { .samples = 4096, .sampling = IS_IMPORTANCE, .misprint = printed ? IS_MISPRINT_ONE_NUMBER : 0 };
        double *r = calloc(4096, sizeof(*r)), turns;
        distance[printed] = 0.0;
        for (int k = 0; k < 4096; k++)
            is_set_sample(&m, &knobs, 1.0, 0, 0, k, &r[k], &turns);
        qsort(r, 4096, sizeof(*r), by_size);
        for (int k = 0; k < 4096; k++)
            distance[printed] = fmax(distance[printed], fabs(pell_profile_cdf(&profile[0], r[k]) - (k + 0.5) / 4096));
        free(r);
    }
    print_message("# marble G: Kolmogorov distance %.5f, with one number %.4f\n", distance[0], distance[1]);
    REQUIRE(distance[0] < 2e-4);
    REQUIRE_NEAR(distance[1], 0.203, 0.002);
    free(profile);
}

/* The range of the radial tables and their interpolation error, over the radii with all but 1e-6 of the light. */
static void tables_are_the_profile(void **state)
{
    static const char *const names[] = { "marble", "wholemilk", "skin1", "ketchup" };
    static const enum pell_profile_model models[] = { PELL_PROFILE_DIPOLE, PELL_PROFILE_NORMALIZED_DIFFUSION };
    struct pell_profile *profile = calloc(3, sizeof(*profile));
    struct pell_context *ctx = test_context(NULL, NULL);

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(models); k++) {
        double worst = 0.0, lost = 0.0;
        for (size_t i = 0; i < PELL_COUNT(names); i++) {
            const struct is_knobs knobs = { .samples = 1 };
            struct pell_frame_material m = medium(names[i]);
            struct is_set set;
            double last;
            m.profile = profile;
            for (int c = 0; c < 3; c++)
                assert_int_equal(pell_profile_make(models[k], &m.medium, c, NULL, &profile[c]), PELL_OK);
            assert_int_equal(is_set_make(ctx, &m, &knobs, is_reach(&m), &set), PELL_OK);
            last = sqrt(exp2(IS_OCTAVES) / (double) set.per_length2);
            for (int c = 0; c < 3; c++) {
                const double far = pell_profile_sample(&profile[c], 1.0 - 1e-6);
                lost = fmax(lost, 1.0 - pell_profile_cdf(&profile[c], last));
                for (int row = 0; row < IS_ROWS; row++)
                    for (int f = 1; f < 4; f++) {
                        const double square =
                            exp2(row / IS_ROWS_OCTAVE - IS_OCTAVES) * (1.0 + (row % IS_ROWS_OCTAVE + 0.25 * f) / IS_ROWS_OCTAVE);
                        const double r = sqrt(square / (double) set.per_length2),
                                     seen = (double) set.rows[row][c] + 0.25 * f * (double) set.rows[row][4 + c];
                        const double exact = pell_profile_pdf(&profile[c], r) / (double) set.per_length2;
                        if (r < far)
                            worst = fmax(worst, fabs(seen / exact - 1.0));
                    }
            }
            pell_free(ctx, set.offset);
            pell_free(ctx, set.rows);
            pell_free(ctx, set.level);
        }
        print_message("# %s: tables within %.5f of R where all but 1e-6 of the light is, and lose %.1e of it beyond\n",
                      pell_profile_model_at(models[k])->name, worst, lost);
        REQUIRE(worst < 0.008);
        REQUIRE(lost < 1e-6);
    }
    pell_context_destroy(&ctx);
    free(profile);
}

/* --- Counts of samples ------------------------------------------------------------------------------------------------------------- */

/* A plane with a light edge in its middle, and squared errors of 16 samples against its closed form. */
static double edge_error(const struct test_device *at, const char *adaptive, bool even)
{
    const struct pell_frame_material m = narrow();
    const char *const settings[] = { "samples=16", "renormalise=off", "reconstruct=off", adaptive, NULL };
    struct patch *p = patch_create(256, 64, true, 4.0, 600.0, &m, 1);
    double square = 0.0;

    if (!even)
        light_a_half(p);
    patch_run(at, method(at->ctx), settings, p);
    for (int y = 24; y < 40; y++)
        for (int x = 108; x < 148; x++)
            for (int c = 0; c < 3; c++) {
                const double v = (double) p->result[c][patch_at(p, x, y)];
                const double e = v - (even ? pell_gaussians_total(&m.gaussians, c) : step_of(&m, c, (x + 0.5 - 128.0) / 4.0));
                square += e * e;
            }
    patch_destroy(p);
    return sqrt(square / (40 * 16 * 3));
}

/* More samples at the edge reduce its error; uniform light is sampled as without them. */
static void samples_go_where_light_varies(void **state)
{
    struct test_device at = test_device_create(2, NULL, NULL);
    const double on = edge_error(&at, "adaptive=on", false), off = edge_error(&at, "adaptive=off", false);

    (void) state;
    print_message("# 16 samples near an edge: rms error %.4f, the same number for all pixels %.4f\n", on, off);
    REQUIRE(on < 0.85 * off);
    assert_true(edge_error(&at, "adaptive=on", true) == edge_error(&at, "adaptive=off", true));
    test_device_destroy(&at);
}

/* At most pixels times `samples` samples, and nearly that many; doubling the light changes nothing. */
static void counts_keep_to_their_mean(void **state)
{
    const struct is_knobs knobs = { .samples = 16, .adaptive = true };
    struct pell_context *ctx = test_context(NULL, NULL);
    struct pell_frame_material m = narrow();
    struct patch *p = patch_create(150, 90, true, 4.0, 600.0, &m, 1);
    struct is_set set = { .median = 1.0f, .scale = { 1.0f, 1.0f, 1.0f } };
    struct is_work w = { .in = &p->frame, .sets = &set, .focal_px = 4.0f };
    uint8_t count[120], classes[120], before[120];
    uint16_t step[120];
    struct is_adapt a = { 10, 12, count, step, classes };

    (void) state;
    for (int k = 0; k < IS_CLASSES; k++)
        w.counts[k].samples = is_class_samples(&knobs, k);
    assert_int_equal(is_row_samples(&knobs), 8 + 16 + 32 + 64);
    p->frame.rect = (struct pell_rect) { 3, 5, 150, 90 };
    for (int round = 0; round < 2; round++) {
        int64_t samples = 0, pixels = 0;
        for (int y = 0; y < 90; y++)
            for (int x = 0; x < 150; x++)
                for (int c = 0; c < 3; c++)
                    p->light[c][patch_at(p, x, y)] =
                        (float) (1 + round) * (x > 90 ? 0.2f + standard_error((unsigned) x, (unsigned) y, 1) : 1.0f);
        memset(classes, 0, sizeof(classes));
        for (int ry = 0; ry < 12; ry++)
            is_adapt_row(&w, &a, ry);
        is_adapt_choose(&w, &a);
        for (int i = 0; i < 120; i++) {
            samples += (int64_t) count[i] * w.counts[classes[i]].samples;
            pixels += count[i];
        }
        assert_int_equal(pixels, 147 * 85);
        REQUIRE(samples <= 16 * pixels && samples > 12 * pixels);
        REQUIRE(classes[5 * 10 + 8] > classes[5 * 10 + 2]);
        if (round > 0)
            assert_memory_equal(classes, before, sizeof(classes));
        memcpy(before, classes, sizeof(classes));
    }
    patch_destroy(p);
    pell_context_destroy(&ctx);
}

/* --- From image to image -------------------------------------------------------------------------------------------------------- */

/* Images of seeds 0, 1, ... use different patterns: their mean equals that of proportionally more samples. */
static void the_mean_of_images_converges(void **state)
{
    static const char *const reconstruct[] = { "reconstruct=off", "reconstruct=on" };
    const struct pell_frame_material m = narrow();
    struct test_device at = test_device_create(2, NULL, NULL);
    struct patch *p = ball(&m), *q = ball(&m);

    (void) state;
    for (int k = 0; k < 2; k++) {
        const char *const few[] = { "samples=16", reconstruct[k], NULL }, *const many[] = { "samples=4096", reconstruct[k], NULL };
        struct pell_pass *pass = patch_pass(&at, method(at.ctx), few, p);
        double error[4] = { 0 }, *sum = calloc(3 * 80 * 80, sizeof(*sum));
        patch_run(&at, method(at.ctx), many, q);
        for (uint32_t n = 0; n < 64; n++) {
            const int which = n == 0 ? 0 : n == 3 ? 1 : n == 15 ? 2 : 3;
            p->frame.seed = n;
            assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_OK);
            error[which] = 0.0;
            for (int i = 0; i < 3 * 80 * 80; i++) {
                const size_t j = patch_at(p, i / 3 % 80, i / 240);
                sum[i] += p->material[j] ? (double) p->result[i % 3][j] : 0.0;
                error[which] += p->material[j] ? pow(sum[i] / (n + 1) - (double) q->result[i % 3][j], 2.0) : 0.0;
            }
        }
        print_message("# 16 samples, %s: rms error of the mean of 4, 16 and 64 images less by a factor of %.1f, %.1f, %.1f\n",
                      reconstruct[k], sqrt(error[0] / error[1]), sqrt(error[0] / error[2]), sqrt(error[0] / error[3]));
        /* Ratios of the squared errors: independent samples would give 16. One reconstructed image already uses many of its neighbours'
         * samples. */
        REQUIRE(error[0] > (k ? 6.0 : 16.0) * error[2] && error[0] > (k ? 16.0 : 64.0) * error[3]);
        p->frame.seed = 0; /* the first seed again */
        assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_OK);
        patch_run(&at, method(at.ctx), few, q);
        for (int c = 0; c < 3; c++)
            assert_memory_equal(p->result[c], q->result[c], sizeof(float) * (size_t) p->frame.shape.stride * 80);
        pell_pass_destroy(&pass);
        free(sum);
    }
    patch_destroy(p);
    patch_destroy(q);
    test_device_destroy(&at);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(radii_are_distributed_as_the_profile),
        cmocka_unit_test(one_number_for_two_choices_bends_the_distribution),
        cmocka_unit_test(tables_are_the_profile),
        cmocka_unit_test(samples_go_where_light_varies),
        cmocka_unit_test(counts_keep_to_their_mean),
        cmocka_unit_test(the_mean_of_images_converges),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
