/* SPDX-License-Identifier: MIT
 * test_tone.c - the default white point, the filmic curve, exposure in stops, and the pixel filter. */
#include "stage.h"

#include "base/pool.h"
#include "render/post/stage.h"
#include "shared/tone.h"

enum { W = 120, H = 100, ALL = W * H };

struct picture {
    float color[3][ALL], alpha[ALL], display[3][ALL], unfiltered[3][ALL];
};

/* Grey pixels of the luminances given by `light`, fully covered. */
static struct picture *picture_of(double (*light)(int pixel))
{
    struct picture *p = malloc(sizeof(*p));

    assert_non_null(p);
    for (int i = 0; i < ALL; i++) {
        p->alpha[i] = 1.0f;
        for (int c = 0; c < 3; c++)
            p->color[c][i] = (float) light(i);
    }
    return p;
}

/* Tone maps the image by `settings`, over the background `color`. */
static struct pell_post_result show_by(struct picture *p, const struct pell_settings *settings, enum pell_background background,
                                       const float *color)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    const struct pell_lens lens = { .radius = 0.0f };
    struct pell_post_result result;
    struct pell_scene *scene;
    struct pell_pool *pool;
    double meter[2 * H], rows[4 * H];

    assert_int_equal(pell_scene_create(ctx, &scene), PELL_OK);
    assert_int_equal(pell_pool_create(ctx, 2, &pool), PELL_OK);
    scene->background = background;
    for (int c = 0; color && c < 3; c++)
        scene->background_color[c] = color[c];
    for (int i = 0; i < 2 * H; i++)
        meter[i] = 1.0;
    assert_int_equal(
        pell_post_render(pool,
                         &(struct pell_post_params) { .scene = scene,
                                                      .lens = &lens,
                                                      .settings = settings,
                                                      .width = W,
                                                      .height = H,
                                                      .rect = { 0, 0, W, H },
                                                      .stride = W,
                                                      .meter = meter,
                                                      .rows = rows,
                                                      .unfiltered = (float *[]) { p->unfiltered[0], p->unfiltered[1], p->unfiltered[2] } },
                         (float *[]) { p->color[0], p->color[1], p->color[2] }, p->alpha,
                         (float *[]) { p->display[0], p->display[1], p->display[2] }, &result),
        PELL_OK);
    pell_pool_destroy(&pool);
    pell_scene_destroy(&scene);
    pell_context_destroy(&ctx);
    return result;
}

/* Shows the image at exposure 1 and releases it; returns the display value of pixel `at`. */
static struct pell_post_result show(struct picture *p, float white, enum pell_background background, int at, double *shown)
{
    struct pell_settings settings;
    struct pell_post_result result;

    pell_settings_default(NULL, NULL, &settings);
    settings.exposure = 1.0f;
    settings.white = white;
    result = show_by(p, &settings, background, NULL);
    *shown = (double) p->display[1][at];
    free(p);
    return result;
}

static double ramp(int i)
{
    return 10.0 * (i + 0.5) / ALL;
}

static double one_spark(int i)
{
    return i == 4321 ? 1e6 : 0.7;
}

static double highlights(int i)
{
    return i % 50 == 0 ? 5.0 : 0.7;
}

static double dark(int i)
{
    return 0.01 * ramp(i);
}

static void white_is_what_a_hundredth_of_the_object_exceeds(void **state)
{
    double shown;
    (void) state;

    REQUIRE_REL((double) show(picture_of(ramp), 0.0f, PELL_BACKGROUND_TRANSPARENT, ALL - 1, &shown).white, 9.9, 0.003);
    REQUIRE_NEAR(shown, 1.0, 0.01);
    REQUIRE_NEAR((double) show(picture_of(one_spark), 0.0f, PELL_BACKGROUND_TRANSPARENT, 0, &shown).white, 1.0, 0);
    REQUIRE_NEAR(shown, 0.7, 1e-6); /* L (1 + L) / (1 + L): white at 1 leaves values below unchanged */
    REQUIRE_REL((double) show(picture_of(highlights), 0.0f, PELL_BACKGROUND_TRANSPARENT, 0, &shown).white, 5.0, 0.05);
    REQUIRE_NEAR((double) show(picture_of(dark), 0.0f, PELL_BACKGROUND_TRANSPARENT, 0, &shown).white, 1.0, 0);
}

static void pixels_that_nothing_covers_and_what_the_user_says_count_otherwise(void **state)
{
    struct picture *p = picture_of(ramp);
    double shown;
    (void) state;

    for (int i = ALL / 2; i < ALL; i++)
        p->alpha[i] = 0.0f;
    REQUIRE_REL((double) show(p, 0.0f, PELL_BACKGROUND_TRANSPARENT, 0, &shown).white, 4.95, 0.003);
    p = picture_of(ramp);
    for (int i = 0; i < ALL; i++)
        p->alpha[i] = 0.0f;
    REQUIRE_NEAR((double) show(p, 0.0f, PELL_BACKGROUND_TRANSPARENT, 0, &shown).white, 1.0, 0);
    REQUIRE_NEAR((double) show(picture_of(ramp), 3.0f, PELL_BACKGROUND_TRANSPARENT, 0, &shown).white, 3.0, 0);
}

/* Middle grey keeps its value, more light is never darker, and bright colours end in white. */
static void the_filmic_curve_keeps_grey_and_turns_bright_colours_white(void **state)
{
    struct pell_settings settings;
    struct picture *p;
    (void) state;

    REQUIRE_NEAR((double) PELL_FILMIC_CURVE(0.18f * PELL_FILMIC_SCALE), 0.18, 1e-6);
    for (float y = 0.001f; y < 1.0f; y += 0.05f) {
        const float x = pell_filmic_inverse(y);
        REQUIRE_REL((double) PELL_FILMIC_CURVE(x), (double) y, 1e-4);
    }
    pell_settings_default(NULL, NULL, &settings);
    settings.exposure = 1.0f;
    settings.tonemap = PELL_TONEMAP_FILMIC;
    p = picture_of(ramp);
    for (int i = 0; i < ALL; i++) { /* red: saturated below, then increasingly bright */
        p->color[1][i] *= 0.1f;
        p->color[2][i] *= 0.1f;
        p->color[0][i] = i == ALL - 1 ? 1e30f : p->color[0][i];
        p->color[1][i] = p->color[2][i] = i == ALL - 1 ? 1e29f : p->color[1][i];
    }
    show_by(p, &settings, PELL_BACKGROUND_TRANSPARENT, NULL);
    for (int c = 0; c < 3; c++)
        for (int i = 1; i < ALL; i++)
            REQUIRE(p->display[c][i] >= p->display[c][i - 1] - 1e-6f && p->display[c][i] <= 1.0f);
    for (int c = 0; c < 3; c++)
        REQUIRE_NEAR((double) p->display[c][ALL - 1], 1.0, 0.02);
    /* at a luminance of 0.3 the red is red, at 10 it is becoming white */
    REQUIRE(p->display[1][ALL / 10] < 0.55f * p->display[0][ALL / 10]);
    REQUIRE(p->display[1][ALL - 2] > 0.6f * p->display[0][ALL - 2]);
    free(p);
}

static void a_background_is_shown_as_it_is_asked_for(void **state)
{
    static const float colors[][3] = { { 0.18f, 0.18f, 0.18f }, { 0.9f, 0.9f, 0.9f }, { 0.4f, 0.2f, 0.1f }, { 0.0f, 0.0f, 0.0f } };
    (void) state;

    for (int curve = 0; curve < 3; curve++)
        for (size_t k = 0; k < PELL_COUNT(colors); k++) {
            struct picture *p = picture_of(ramp);
            struct pell_settings settings;
            for (int i = 0; i < ALL / 2; i++) {
                p->alpha[i] = 0.0f;
                for (int c = 0; c < 3; c++)
                    p->color[c][i] = 0.0f;
            }
            pell_settings_default(NULL, NULL, &settings);
            settings.exposure = 0.7f;
            settings.tonemap = curve;
            settings.stops = 1.5f;
            show_by(p, &settings, PELL_BACKGROUND_COLOR, colors[k]);
            for (size_t c = 0; c < 3; c++)
                REQUIRE_NEAR((double) p->display[c][0], (double) colors[k][c], 2e-4);
            free(p);
        }
}

/* Two stops are a factor of four in exposure, given or metered; the reported exposure excludes the stops. */
static void stops_multiply_every_exposure(void **state)
{
    (void) state;

    for (int metered = 0; metered < 2; metered++) {
        struct picture *plain = picture_of(ramp), *bright = picture_of(ramp);
        struct pell_settings settings;
        struct pell_post_result a, b;

        pell_settings_default(NULL, NULL, &settings);
        settings.exposure = metered ? 0.0f : 0.01f;
        settings.tonemap = PELL_TONEMAP_LINEAR;
        a = show_by(plain, &settings, PELL_BACKGROUND_TRANSPARENT, NULL);
        settings.stops = 2.0f;
        b = show_by(bright, &settings, PELL_BACKGROUND_TRANSPARENT, NULL);
        REQUIRE(a.exposure == b.exposure && a.exposure > 0.0f);
        for (int i = 0; i < ALL; i += 97)
            REQUIRE_NEAR((double) bright->display[1][i], fmin(4.0 * (double) (a.exposure * (float) ramp(i)), 1.0), 1e-5);
        free(plain);
        free(bright);
    }
}

/* A rim far brighter than white that covers a fraction of its pixels is shown by that fraction over the background, by every curve; its
 * radiance in linear channels is the plain average. */
static void rims_are_shown_by_the_share_that_they_cover(void **state)
{
    static const enum pell_tonemap curves[] = { PELL_TONEMAP_LINEAR, PELL_TONEMAP_REINHARD, PELL_TONEMAP_FILMIC };
    const float grey[3] = { 0.2f, 0.2f, 0.2f };
    struct pell_settings settings;

    (void) state;
    pell_knobs_default(pell_settings_knobs(), &settings);
    settings.exposure = 1.0f;
    settings.pixel_filter = PELL_PIXEL_FILTER_BOX;
    for (size_t k = 0; k < PELL_COUNT(curves); k++) {
        struct picture *p = picture_of(ramp);
        settings.tonemap = curves[k];
        for (int i = 0; i < ALL; i++) {
            p->alpha[i] = (float) (i % 5) * 0.25f;
            for (int c = 0; c < 3; c++)
                p->color[c][i] = p->alpha[i] * 40.0f;
        }
        show_by(p, &settings, PELL_BACKGROUND_COLOR, grey);
        for (int i = 0; i < ALL; i++) {
            const double a = (double) p->alpha[i], all = (double) p->display[1][4], none = (double) p->display[1][0];
            REQUIRE(all > 0.9);
            REQUIRE_NEAR(none, 0.2, 1e-3);
            REQUIRE_NEAR((double) p->display[1][i], a * all + (1.0 - a) * none, 1e-5);
            REQUIRE_REL((double) p->color[1][i], a * 40.0 + (1.0 - a) * (double) p->color[1][0], 1e-5);
        }
        free(p);
    }
}

/* Display values of one white pixel, of a white corner and of pseudo-random pixels. */
static double spike(int i)
{
    return i == 50 * W + 60 ? 1.0 : 0.0;
}

static double corner(int i)
{
    return i % W < 3 && i / W < 2 ? 1.0 : 0.0;
}

static double grain(int i)
{
    return 0.5 + 0.5 * sin(i * i % 1001);
}

static struct picture *filtered(double (*light)(int pixel), int filter, int msaa, enum pell_background background)
{
    struct picture *p = picture_of(light);
    struct pell_settings settings;

    pell_settings_default(NULL, NULL, &settings);
    settings.exposure = 1.0f;
    settings.tonemap = PELL_TONEMAP_LINEAR;
    settings.pixel_filter = filter;
    settings.msaa = msaa;
    show_by(p, &settings, background, NULL);
    return p;
}

/* A pixel's own samples have a variance of 1/12 along each axis, and the filter adds 0.12 to that. No light is lost, including at
 * borders, and the linear channels are unfiltered. */
static void the_pixel_filter_is_as_wide_as_stated_and_keeps_light(void **state)
{
    double sum = 0.0, square[2] = { 0.0, 0.0 };
    struct picture *p = filtered(spike, PELL_PIXEL_FILTER_GAUSSIAN, 4, PELL_BACKGROUND_COLOR);
    (void) state;

    for (int i = 0; i < ALL; i++) {
        sum += (double) p->display[1][i];
        square[0] += (double) p->display[1][i] * (i % W - 60) * (i % W - 60);
        square[1] += (double) p->display[1][i] * (i / W - 50) * (i / W - 50);
        REQUIRE_NEAR((double) p->color[1][i], spike(i), 0);
    }
    REQUIRE_NEAR(sum, 1.0, 1e-6);
    REQUIRE_NEAR(square[0], 0.12, 1e-6);
    REQUIRE_NEAR(square[1], 0.12, 1e-6);
    free(p);
    sum = 0.0;
    p = filtered(corner, PELL_PIXEL_FILTER_GAUSSIAN, 4, PELL_BACKGROUND_COLOR);
    for (int i = 0; i < ALL; i++)
        sum += (double) p->display[1][i];
    REQUIRE_NEAR(sum, 6.0, 1e-5);
    REQUIRE_NEAR((double) p->display[1][0], 1.0, 0); /* pixels beyond the border repeat it */
    free(p);
}

/* No filter with a single sample, nor for straight colours with an alpha channel. */
static void what_is_not_to_be_filtered_keeps_its_bits(void **state)
{
    struct picture *plain = filtered(grain, PELL_PIXEL_FILTER_BOX, 4, PELL_BACKGROUND_COLOR), *others[3];
    (void) state;

    others[0] = filtered(grain, PELL_PIXEL_FILTER_GAUSSIAN, 1, PELL_BACKGROUND_COLOR);
    others[1] = filtered(grain, PELL_PIXEL_FILTER_GAUSSIAN, 4, PELL_BACKGROUND_TRANSPARENT);
    others[2] = filtered(grain, PELL_PIXEL_FILTER_GAUSSIAN, 4, PELL_BACKGROUND_COLOR);
    for (int k = 0; k < 3; k++) {
        REQUIRE((memcmp(plain->display, others[k]->display, sizeof(plain->display)) == 0) == (k < 2));
        free(others[k]);
    }
    free(plain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(white_is_what_a_hundredth_of_the_object_exceeds),
        cmocka_unit_test(pixels_that_nothing_covers_and_what_the_user_says_count_otherwise),
        cmocka_unit_test(the_filmic_curve_keeps_grey_and_turns_bright_colours_white),
        cmocka_unit_test(a_background_is_shown_as_it_is_asked_for),
        cmocka_unit_test(stops_multiply_every_exposure),
        cmocka_unit_test(rims_are_shown_by_the_share_that_they_cover),
        cmocka_unit_test(the_pixel_filter_is_as_wide_as_stated_and_keeps_light),
        cmocka_unit_test(what_is_not_to_be_filtered_keeps_its_bits),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
