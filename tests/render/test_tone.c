/* SPDX-License-Identifier: MIT
 * test_tone.c - what becomes display white where nobody says it. */
#include "stage.h"

#include "base/pool.h"
#include "render/post/stage.h"

enum { W = 120, H = 100, ALL = W * H };

struct picture {
    float color[3][ALL], alpha[ALL], display[3][ALL];
};

/* Grey pixels of the luminances that `light` gives by number, all covered. */
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

/* Shows the picture at exposure 1 and releases it; the display value of pixel `at`. */
static struct pell_post_result show(struct picture *p, float white, enum pell_background background, int at, double *shown)
{
    struct pell_context *ctx = test_context(NULL, NULL);
    const struct pell_lens lens = { .radius = 0.0f };
    struct pell_settings settings;
    struct pell_post_result result;
    struct pell_scene *scene;
    struct pell_pool *pool;
    double meter[2 * H], rows[4 * H];

    assert_int_equal(pell_scene_create(ctx, &scene), PELL_OK);
    assert_int_equal(pell_pool_create(ctx, 2, &pool), PELL_OK);
    scene->background = background;
    pell_settings_default(NULL, NULL, &settings);
    settings.exposure = 1.0f;
    settings.white = white;
    for (int i = 0; i < 2 * H; i++)
        meter[i] = 1.0;
    pell_post_render(pool,
                     &(struct pell_post_params) { .scene = scene,
                                                  .lens = &lens,
                                                  .settings = &settings,
                                                  .width = W,
                                                  .height = H,
                                                  .rect = { 0, 0, W, H },
                                                  .stride = W,
                                                  .meter = meter,
                                                  .rows = rows },
                     (float *[]) { p->color[0], p->color[1], p->color[2] }, p->alpha,
                     (float *[]) { p->display[0], p->display[1], p->display[2] }, &result);
    *shown = (double) p->display[1][at];
    pell_pool_destroy(&pool);
    pell_scene_destroy(&scene);
    pell_context_destroy(&ctx);
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
    REQUIRE_NEAR(shown, 0.7, 1e-6); /* L (1 + L) / (1 + L): white at 1 leaves what is below as it is */
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(white_is_what_a_hundredth_of_the_object_exceeds),
        cmocka_unit_test(pixels_that_nothing_covers_and_what_the_user_says_count_otherwise),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
