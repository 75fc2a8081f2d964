/* SPDX-License-Identifier: MIT
 * test_render_lens.c - depth of field and bloom in the whole renderer: circles of confusion of the size that the lens implies, depth
 * order on both sides of the focus, conservation of light, and no effect where they are off. */
#include "stage.h"

/* A plane that faces the camera at the origin from `depth` mm, from x = `left` mm to the right. */
static void half_plane(struct stage *s, size_t material, float depth, float left)
{
    const float far = 4.0f * depth, half = 0.5f * (far - left);
    shapes_quad(s->scene, material, vec3(left + half, 0, -depth), vec3(half, 0, 0), vec3(0, far, 0));
}

/* An emissive plane, so that no shadows are involved. */
static void lens_stage(struct stage *s, float depth, float left, float focus, float f_number, int msaa)
{
    struct pell_camera *c;
    struct pell_material *m;
    size_t white;

    stage_start(s, 128, 32);
    m = stage_opaque(s, 0.0f, &white);
    m->emissive[0] = m->emissive[1] = m->emissive[2] = 1.0f;
    half_plane(s, white, depth, left);
    c = stage_camera(s, vec3(0, 0, 0), vec3(0, 0, -1), 0.1f, 0.0f);
    c->focus = focus;
    c->f_number = f_number;
    s->settings.msaa = msaa;
    s->settings.dof = true;
}

/* Fraction of a disc of diameter d that lies beyond a line at distance x from its centre. */
static double beyond(double x, double d)
{
    const double u = 2.0 * x / d;
    return u >= 1.0 ? 0.0 : u <= -1.0 ? 1.0 : 0.5 - (asin(u) + u * sqrt(1.0 - u * u)) / PELL_PI;
}

/* An edge out of focus is the disc's integral, and surfaces in focus are sharp, on whichever side the focus is. */
static void an_edge_is_spread_over_the_disc_that_the_lens_says(void **state)
{
    static const struct {
        float depth, focus, f_number;
    } cases[] = { { 1000, 500, 8 }, { 500, 1000, 8 }, { 1000, 1000, 1.4f }, { 600, 400, 4 } };
    static const int samples[] = { 1, 4, 64 };
    (void) state;
    for (size_t i = 0; i < PELL_COUNT(cases) * PELL_COUNT(samples); i++) {
        const int n = samples[i / PELL_COUNT(cases)];
        const size_t k = i % PELL_COUNT(cases);
        const double focal_px = 16.0 / tan(0.05), lens = 12.0 / tan(0.05) / (double) cases[k].f_number;
        const double disc = lens * focal_px * fabs(1.0 / (double) cases[k].depth - 1.0 / (double) cases[k].focus);
        double worst = 0.0, sum = 0.0;
        struct stage s;
        struct shot shot;
        lens_stage(&s, cases[k].depth, 0.0f, cases[k].focus, cases[k].f_number, n);
        shot = stage_shot(&s);
        for (int x = 0; x < 128; x++) {
            const double got = (double) shot.data[SHOT_A * shot.size + 16 * 128 + (size_t) x];
            double want = 0.0;
            for (int j = 0; j < 16; j++) /* integrated over the pixel */
                want += beyond(64.0 - (x + (j + 0.5) / 16.0), fmax(disc, 1e-6)) / 16.0;
            worst = fmax(worst, fabs(got - want));
            sum += got - want;
        }
        print_message("# %d samples, at %g mm, focus %g mm, f/%g: a disc of %.1f px, off by %.3f at most\n", n, (double) cases[k].depth,
                      (double) cases[k].focus, (double) cases[k].f_number, disc, worst);
        REQUIRE(disc < 60.0);
        REQUIRE(worst < (disc < 1e-3 || n == 1 ? 0.01 : n == 4 ? 0.13 : 0.03));
        REQUIRE(fabs(sum) <
                (n == 4 ? 0.6 : 0.25)); /* px: the edge's position is preserved, except that each sample rounds it to a whole pixel */
        shot_free(&shot);
        stage_finish(&s);
    }
}

/* The discs of 4 samples for a disc of 76.7 pixels would be clamped; those of 6 are 15.7 pixels in radius. Few samples miss parts
 * visible from the lens' edge, and increase the number of samples. */
static void too_few_samples_for_a_lens_are_told(void **state)
{
    const double disc = 12.0 / tan(0.05) / 0.5 * (16.0 / tan(0.05)) * (1.0 / 400.0 - 1.0 / 500.0);
    char needed[32];

    (void) state;
    for (int n = 1; n <= 6; n++) {
        struct stage s;
        struct shot shot;
        snprintf(needed, sizeof(needed), "needs %.0f samples", ceil(disc * disc / (32.0 * 32.0) * (1.0 + 1.0 / (n * n))));
        lens_stage(&s, 500.0f, 0.0f, 400.0f, 0.5f, n);
        shot = stage_shot(&s);
        REQUIRE((strstr(s.kept.all_warnings, needed) != NULL) == (n < 6));
        shot_free(&shot);
        stage_finish(&s);
    }
}

/* Of two half planes the sharp near one hides the far one right up to its edge; where the far one is sharp, it is visible through the
 * blurred edge of the near one by the complement of its coverage. */
static void what_is_near_hides_what_is_far(void **state)
{
    (void) state;
    for (int i = 0; i < 6; i++) {
        const int sharp_near = i % 2, n = i < 2 ? 1 : i < 4 ? 4 : 64;
        const double disc = 12.0 / tan(0.05) / 8.0 * 16.0 / tan(0.05) * (1.0 / 500.0 - 1.0 / 1000.0);
        struct stage s;
        struct shot shot;
        size_t red;
        lens_stage(&s, 500.0f, 0.0f, sharp_near ? 500.0f : 1000.0f, 8.0f, n);
        stage_opaque(&s, 0.0f, &red)->emissive[0] = 1.0f;
        half_plane(&s, red, 1000.0f, -900.0f);
        shot = stage_shot(&s);
        for (int x = 0; x < 128; x++) {
            const double near = (double) (shot.data[SHOT_G * shot.size + 16 * 128 + (size_t) x]),
                         all = (double) shot.data[SHOT_R * shot.size + 16 * 128 + (size_t) x], edge = x - 63.5;
            if (sharp_near && fabs(edge) > 1.0)
                REQUIRE_NEAR(near, edge > 0.0 ? 1.0 : 0.0, 0.01); /* no green beyond it, nor from the far one in front */
            if (!sharp_near)
                REQUIRE_NEAR(near, beyond(-edge, disc), n == 1 ? 0.01 : n == 4 ? 0.12 : 0.03);
            REQUIRE_NEAR(all, 1.0, 1e-5); /* both are red, and every point is covered by one of them */
        }
        shot_free(&shot);
        stage_finish(&s);
    }
}

static void without_it_nothing_changes(void **state)
{
    struct stage s;
    struct shot plain, pinhole, one;
    (void) state;
    lens_stage(&s, 800.0f, -20.0f, 300.0f, 2.0f, 4);
    s.settings.dof = false;
    plain = stage_shot(&s);
    s.settings.bloom_radius = 20.0f;
    s.scene->cameras[0].focus = 77.0f;
    pinhole = stage_shot(&s);
    assert_memory_equal(plain.data, pinhole.data, plain.planes * plain.size * sizeof(float));
    shot_free(&pinhole);
    /* one sample is at the centre of the lens, and a tiny aperture gives a sharp image */
    s.settings.msaa = 1;
    shot_free(&plain);
    plain = stage_shot(&s);
    s.settings.dof = true;
    s.scene->cameras[0].f_number = 1e5f;
    one = stage_shot(&s);
    assert_memory_equal(plain.data, one.data, plain.planes * plain.size * sizeof(float));
    shot_free(&plain);
    shot_free(&one);
    stage_finish(&s);
}

static void refuse(struct stage *s, const char *what)
{
    memset(&s->kept, 0, sizeof(s->kept));
    assert_int_equal(pell_renderer_render(s->r, &s->settings, &s->image), PELL_ERR_INVALID);
    if (!strstr(s->kept.what, what))
        fail_msg("said \"%s\", wanted \"%s\"", s->kept.what, what);
}

static void lenses_that_cannot_be_are_refused(void **state)
{
    struct stage s;
    struct pell_camera *c;
    (void) state;
    lens_stage(&s, 800.0f, -20.0f, 0.0f, 0.0f, 4);
    stage_render(&s); /* f/2.8 on the middle of the bounds */
    c = &s.scene->cameras[0];
    c->f_number = 0.01f;
    refuse(&s, "f_number = 0.01");
    c->f_number = NAN;
    refuse(&s, "f_number = nan");
    c->f_number = 2.8f;
    c->focus = -1.0f;
    refuse(&s, "focus = -1 mm");
    c->focus = NAN;
    refuse(&s, "focus = nan");
    c->focus = 0.0f;
    c->position[2] = -900.0f;
    refuse(&s, "can't focus on it");
    c->position[2] = 0.0f;
    c->ortho_height = 10.0f;
    refuse(&s, "no lens");
    s.settings.dof = false;
    stage_render(&s);
    s.settings.bloom = 1.5f;
    refuse(&s, "bloom = 1.5");
    s.settings.bloom = NAN;
    refuse(&s, "bloom");
    stage_finish(&s);
}

/* Methods that read the camera's position: the radiance of a sample is as seen from that point of the lens. */
static void methods_see_through_the_lens(void **state)
{
    static const char *const names[] = { "screen-space", "image-space" };
    (void) state;
    for (int i = 0; i < 2; i++) {
        struct shot sharp, open;
        struct difference d;
        struct stage s;
        size_t medium;
        stage_start(&s, 64, 64);
        stage_gaussians(&s, 0.5, &medium);
        stage_ball(&s, medium, 0, vec3(0, 0, -500), 30.0f, 24);
        stage_light(&s, PELL_LIGHT_POINT, vec3(200, 200, -200), vec3(0, 0, -500), 0.3f);
        stage_camera(&s, vec3(0, 0, 0), vec3(0, 0, -1), 0.15f, 0.0f);
        s.settings.msaa = 8;
        stage_method(&s, names[i], NULL);
        sharp = stage_shot(&s);
        s.settings.dof = true;
        s.scene->cameras[0].f_number = 100.0f; /* a disc of a sixth of a pixel at 30 mm out of focus */
        open = stage_shot(&s);
        d = shot_difference(&sharp, &open);
        print_message("# %s, f/100: %.2g root mean square\n", names[i], d.rms);
        REQUIRE(d.rms < 0.02);
        shot_free(&sharp);
        shot_free(&open);
        stage_finish(&s);
    }
}

/* Bloom moves light from bright pixels to other pixels of the image; where a background is composited later, so is the corresponding
 * fraction of it. */
static void bloom_keeps_light_and_lies_over_any_background(void **state)
{
    struct shot black, laid, clear;
    struct stage s;
    size_t white;
    double sum[2] = { 0.0, 0.0 }, worst = 0.0;
    (void) state;
    stage_start(&s, 128, 96);
    stage_opaque(&s, 1.0f, &white);
    stage_ball(&s, white, 0, vec3(0, 0, -500), 30.0f, 24);
    stage_environment(&s, 1.0f);
    stage_camera(&s, vec3(0, 0, 0), vec3(0, 0, -1), 0.3f, 0.0f);
    s.settings.msaa = 2;
    s.settings.tonemap = PELL_TONEMAP_LINEAR;
    s.scene->background = PELL_BACKGROUND_TRANSPARENT;
    black = stage_shot(&s);
    s.settings.bloom = 0.3f;
    s.settings.bloom_radius = 6.0f;
    clear = stage_shot(&s);
    for (size_t i = 0; i < black.size; i++) {
        sum[0] += (double) black.data[SHOT_R * black.size + i];
        sum[1] += (double) clear.data[SHOT_R * clear.size + i];
    }
    REQUIRE_REL(sum[1], sum[0], 1e-4);
    REQUIRE(clear.data[SHOT_A * clear.size + 48 * 128 + 40] > 0.0f);
    s.scene->background = PELL_BACKGROUND_COLOR;
    for (int c = 0; c < 3; c++)
        s.scene->background_color[c] = 0.5f;
    laid = stage_shot(&s);
    for (size_t i = 0; i < laid.size; i++) {
        const double over = (double) clear.data[SHOT_R * clear.size + i] + 0.5 * (1.0 - (double) clear.data[SHOT_A * clear.size + i]);
        worst = fmax(worst, fabs(over - (double) laid.data[SHOT_R * laid.size + i]));
    }
    REQUIRE(worst < 1e-5);
    assert_string_equal(s.image.stages[s.image.num_stages - 1].name, "bloom");
    shot_free(&black);
    shot_free(&clear);
    shot_free(&laid);
    stage_finish(&s);
}

static void bloom_and_lens_allocate_nothing_after_the_first_frame(void **state)
{
    struct stage s;
    uint64_t before;
    (void) state;
    lens_stage(&s, 800.0f, -20.0f, 300.0f, 2.0f, 4);
    s.settings.bloom = 0.1f;
    stage_render(&s);
    before = pell_allocations(s.ctx);
    for (int i = 0; i < 3; i++) {
        s.settings.bloom_radius = 1.0f + (float) i;
        s.scene->cameras[0].focus = 100.0f * (float) (i + 1);
        stage_render(&s);
    }
    assert_int_equal(pell_allocations(s.ctx), before);
    stage_finish(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_edge_is_spread_over_the_disc_that_the_lens_says),
        cmocka_unit_test(too_few_samples_for_a_lens_are_told),
        cmocka_unit_test(what_is_near_hides_what_is_far),
        cmocka_unit_test(without_it_nothing_changes),
        cmocka_unit_test(lenses_that_cannot_be_are_refused),
        cmocka_unit_test(methods_see_through_the_lens),
        cmocka_unit_test(bloom_keeps_light_and_lies_over_any_background),
        cmocka_unit_test(bloom_and_lens_allocate_nothing_after_the_first_frame),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
