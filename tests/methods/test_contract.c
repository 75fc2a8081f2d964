/* SPDX-License-Identifier: MIT
 * test_contract.c - properties that every method must have, on every engine, for the quantity that it computes: runs over the registry,
 * through pell_pass, on hand-made planes. A method that needs a whole scene declares this, and is tested in test_contract_scene.c
 * instead. Built twice: with the methods' defaults, and with their papers' settings. */
#include "contract.h"
#include "patch.h"
#include "slow.h"

#include <pthread.h>

#ifndef PAPER
#define PAPER 0 /* 1: the methods with their papers' settings */
#endif

/* 2, 4 and 8 pixels wide at 1 pixel per mm; the channels differ. */
static const double broad_variance[3] = { 4.0, 16.0, 64.0 };
static const double broad_weight[3][3] = { { 0.1, 0.2, 0.3 }, { 0.3, 0.2, 0.1 }, { 0.4, 0.3, 0.2 } };

static struct pell_frame_material broad(void)
{
    return patch_gaussians(3, broad_variance, broad_weight);
}

/* The knobs of a method, as for patch_configure. */
static const char *const *form(const struct pell_method *m)
{
    static const char *const best[] = { NULL }, *const paper[] = { "as=paper", NULL };
    /* A fixed level scatters over a fixed fraction of the object's height, whatever the material's profile. */
    static const char *const screen_space[] = { "as=paper", "ssslevel=0", NULL };
    /* Methods that converge are compared at their limit; pixels with sampling patterns of their own differ from position to position. */
    static const char *const image_space[2][4] = { { "samples=256", "tile=1", NULL }, { "as=paper", "samples=256", "tile=1", NULL } };

    /* Without a scene there is only light that entered from the front. */
    static const char *const convolution[2][3] = { { "surfaces=1", NULL }, { "as=paper", "surfaces=1", NULL } };

    if (strcmp(m->name, "image-space") == 0)
        return image_space[PAPER];
    if (strcmp(m->name, "convolution") == 0)
        return convolution[PAPER];
    if (!PAPER)
        return best;
    return strcmp(m->name, "screen-space") == 0 ? screen_space : paper;
}

/* The same, for tests that require more than identical results at every position. */
static const char *const *fine_form(const struct pell_method *m)
{
    static const char *const image_space[2][4] = { { "samples=1024", "tile=1", NULL }, { "as=paper", "samples=1024", "tile=1", NULL } };

    return strcmp(m->name, "image-space") == 0 ? image_space[PAPER] : form(m);
}

/* The reason why a method cannot be tested on planes. */
static const char *needs_scene(const struct pell_method *m)
{
    void *knobs = calloc(1, m->knobs_size);
    bool runs;

    patch_configure(NULL, m, form(m), knobs);
    runs = pell_method_runs_on_planes(m, knobs);
    free(knobs);
    return runs ? NULL : "needs a scene: see contract_scene";
}

/* In either build: the settings with which a method runs on planes. */
static const char *const *either_form(const struct pell_method *m, bool as_paper)
{
    static const char *const plain[2][2] = { { "as=best", NULL }, { "as=paper", NULL } };
    static const char *const front[2][3] = { { "as=best", "surfaces=1", NULL }, { "as=paper", "surfaces=1", NULL } };

    return strcmp(m->name, "convolution") == 0 ? front[as_paper] : plain[as_paper];
}

/* Properties that a method's published form is known to violate, and why. */
static const struct promise_exception exceptions[] = {
#if PAPER
    { "screen-space", "impulse_gives_the_profile", "seven taps far apart leave gaps in what is not smooth" },
    { "screen-space", "a_larger_radius_spreads_more", "spans under 2 pixels are dropped" },
    { "image-space", "uniform_light_gives_the_albedo", "what is missing at borders is made up for by count, not by weight" },
    { "image-space", "white_profiles_give_back_uniform_light",
      "what is missing at the picture's border is made up for by count, not by weight" },
    { "image-space", "any_size_and_any_rectangle", "what is missing at borders is made up for by count, not by weight" },
    { "image-space", "no_radius_is_lambert", "the weights of 256 samples sum to one within 0.2 %" },
    { "image-space", "all_albedos_are_legal", "what is missing at borders is made up for by count, not by weight" },
    { "image-space", "materials_that_touch_do_not_bleed", "light does not bleed, but borders are made up for by count" },
    { "image-space", "a_frame_of_another_shape_is_refused", "asks a border pixel for the albedo" },
    { "convolution", "impulse_gives_the_profile", "planes have half the resolution" },
    { "convolution", "light_that_moves_moves_the_result", "planes have half the resolution: every second pixel" },
    { "convolution", "a_larger_radius_spreads_more", "planes have half the resolution: no less than two pixels" },
    { "convolution", "no_radius_is_lambert", "planes have half the resolution" },
#endif
    { 0 },
};

/* The response to uniform irradiance of 1: the profile's total, or 1 for methods that blur a shaded image. */
static double even_total(const struct pell_method *method, const struct pell_frame_material *m, int channel)
{
    void *knobs = calloc(1, method->knobs_size);
    struct pell_plan plan;

    patch_configure(NULL, method, form(method), knobs);
    method->plan(knobs, &plan);
    free(knobs);
    if (plan.quantity == PELL_QUANTITY_RADIANCE)
        return 1.0;
    if (m->gaussians.count == 0) {
        const struct pell_medium *d = &m->medium;
        const struct pell_dipole dipole = pell_dipole_make(d->sigma_a[channel], d->sigma_s_reduced[channel], d->eta, PELL_FRESNEL_EXACT);
        return pell_dipole_total(&dipole);
    }
    return pell_gaussians_total(&m->gaussians, channel);
}

/* Irradiance that differs from pixel to pixel, in [0, 1]. */
static float standard_error(unsigned x, unsigned y, unsigned c)
{
    unsigned h = x * 374761393u + y * 668265263u + c * 2246822519u + 12345u;

    h = (h ^ (h >> 13)) * 1274126177u;
    return (float) ((h ^ (h >> 16)) & 0xffffff) / 16777216.0f;
}

static void light_noise(struct patch *p)
{
    for (int y = 0; y < p->frame.shape.height; y++)
        for (int x = 0; x < p->frame.shape.width; x++)
            for (int c = 0; c < 3; c++)
                p->light[c][patch_at(p, x, y)] = standard_error((unsigned) x, (unsigned) y, (unsigned) c);
}

static size_t patch_floats(const struct patch *p)
{
    return (size_t) p->frame.shape.stride * (size_t) p->frame.shape.height;
}

static bool same_result(const struct patch *a, const struct patch *b)
{
    for (int c = 0; c < 3; c++)
        if (memcmp(a->result[c], b->result[c], patch_floats(a) * sizeof(float)) != 0)
            return false;
    return true;
}

static void impulse_gives_the_profile(void **state)
{
    const struct party *const on = *state;
    static const double radii[] = { 1.5, 3.5, 6.5, 10.5, 15.5, 25.5 };
    const struct pell_frame_material m = broad();
    struct test_device at = test_device_create_on(on->engine, 1, NULL, NULL);
    struct patch *p = patch_create(129, 129, true, 1.0, 100.0, &m, 1);
    double worst = 0.0;

    patch_light(p, 0.0f, 0.0f, 0.0f);
    for (int c = 0; c < 3; c++)
        p->light[c][patch_at(p, 64, 64)] = 1.0f;
    patch_run(&at, on->method, form(on->method), p);
    for (size_t i = 0; i < PELL_COUNT(radii); i++) {
        for (int c = 0; c < 3; c++) {
            double inside = 0.0, expected = 0.0;
            /* Each pixel by the fraction of its area inside the circle, on a grid of 16 x 16. */
            for (int y = 0; y < 129; y++)
                for (int x = 0; x < 129; x++) {
                    int hits = 0;
                    for (int s = 0; s < 256; s++)
                        hits += hypot(x - 64.5 + (s % 16 + 0.5) / 16.0, y - 64.5 + (s / 16 + 0.5) / 16.0) < radii[i];
                    inside += hits / 256.0 * (double) p->result[c][patch_at(p, x, y)];
                }
            /* The source is a pixel wide, and so is each receiving pixel: adds 1/6 mm^2 to the variance. */
            for (int k = 0; k < 3; k++)
                expected += broad_weight[k][c] * (1.0 - exp(-radii[i] * radii[i] / (2.0 * (broad_variance[k] + 1.0 / 6.0))));
            worst = fmax(worst, fabs(inside - expected) / even_total(on->method, &m, c));
        }
    }
    print_message("# %s: light inside a radius differs from the profile's by %.4f of the total at most\n", on->method->name, worst);
    REQUIRE(worst < 0.01);
    patch_destroy(p);
    test_device_destroy(&at);
}

static void light_adds_up(void **state)
{
    const struct party *const on = *state;
    const struct pell_frame_material m = broad();
    struct test_device at = test_device_create_on(on->engine, 2, NULL, NULL);
    struct patch *p[3];

    for (int i = 0; i < 3; i++) {
        p[i] = patch_create(70, 50, false, 700.0, 500.0, &m, 1);
        patch_tilt(p[i], 500.0, 0.5, -0.3);
        for (int y = 0; y < 50; y++)
            for (int x = 0; x < 70; x++)
                for (int c = 0; c < 3; c++) {
                    const float a = standard_error((unsigned) x, (unsigned) y, (unsigned) c),
                                b = standard_error((unsigned) y, (unsigned) x, (unsigned) c + 7);
                    p[i]->light[c][patch_at(p[i], x, y)] = i == 0 ? a : i == 1 ? b : 2.0f * a + 0.5f * b;
                }
        patch_run(&at, on->method, form(on->method), p[i]);
    }
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < 50; y++)
            for (int x = 0; x < 70; x++) {
                const size_t i = patch_at(p[0], x, y);
                REQUIRE_NEAR((double) p[2]->result[c][i], 2.0 * (double) p[0]->result[c][i] + 0.5 * (double) p[1]->result[c][i], 1e-5);
            }
    for (int i = 0; i < 3; i++)
        patch_destroy(p[i]);
    test_device_destroy(&at);
}

static void light_that_moves_moves_the_result(void **state)
{
    const struct party *const on = *state;
    static const int shifts[][2] = { { 1, 0 }, { 0, 1 }, { 5, 3 }, { 16, 8 }, { -7, -11 } };
    const struct pell_frame_material m = broad();
    struct test_device at = test_device_create_on(on->engine, 1, NULL, NULL);
    struct patch *p = patch_create(150, 140, true, 1.0, 100.0, &m, 1), *q = patch_create(150, 140, true, 1.0, 100.0, &m, 1);

    patch_light(p, 0.0f, 0.0f, 0.0f);
    p->light[0][patch_at(p, 75, 70)] = p->light[1][patch_at(p, 76, 70)] = p->light[2][patch_at(p, 75, 71)] = 1.0f;
    patch_run(&at, on->method, form(on->method), p);
    for (size_t s = 0; s < PELL_COUNT(shifts); s++) {
        const int dx = shifts[s][0], dy = shifts[s][1];
        patch_light(q, 0.0f, 0.0f, 0.0f);
        q->light[0][patch_at(q, 75 + dx, 70 + dy)] = q->light[1][patch_at(q, 76 + dx, 70 + dy)] =
            q->light[2][patch_at(q, 75 + dx, 71 + dy)] = 1.0f;
        patch_run(&at, on->method, form(on->method), q);
        for (int c = 0; c < 3; c++)
            for (int y = 20; y < 120; y++)
                for (int x = 20; x < 120; x++)
                    REQUIRE_NEAR((double) q->result[c][patch_at(q, x + dx, y + dy)], (double) p->result[c][patch_at(p, x, y)], 1e-6);
    }
    patch_destroy(p);
    patch_destroy(q);
    test_device_destroy(&at);
}

static void total_light_is_kept(void **state)
{
    const struct party *const on = *state;
    const struct pell_frame_material m = broad();
    struct test_device at = test_device_create_on(on->engine, 2, NULL, NULL);
    struct patch *p = patch_create(200, 180, true, 1.0, 100.0, &m, 1);

    for (int y = 0; y < 180; y++)
        for (int x = 0; x < 200; x++)
            for (int c = 0; c < 3; c++)
                p->light[c][patch_at(p, x, y)] =
                    x > 70 && x < 120 && y > 60 && y < 110 ? standard_error((unsigned) x, (unsigned) y, (unsigned) c) : 0.0f;
    patch_run(&at, on->method, form(on->method), p);
    for (int c = 0; c < 3; c++)
        REQUIRE_REL(patch_sum(p, p->result, c), patch_sum(p, p->light, c) * even_total(on->method, &m, c), 0.003);
    patch_destroy(p);
    test_device_destroy(&at);
}

static void uniform_light_gives_the_albedo(void **state)
{
    const struct party *const on = *state;
    const struct pell_frame_material m = broad();
    struct test_device at = test_device_create_on(on->engine, 2, NULL, NULL);
    struct patch *p = patch_create(131, 77, false, 600.0, 500.0, &m, 1);

    patch_tilt(p, 500.0, 0.8, 1.1);
    for (int y = 0; y < 77; y++)
        for (int x = 0; x < 131; x++)
            p->material[patch_at(p, x, y)] = hypot(x - 60, y - 40) < 36.0 && hypot(x - 70, y - 30) > 8.0;
    patch_light(p, 1.0f, 2.0f, 3.0f);
    patch_run(&at, on->method, form(on->method), p);
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < 77; y++)
            for (int x = 0; x < 131; x++)
                if (p->material[patch_at(p, x, y)])
                    REQUIRE_REL((double) p->result[c][patch_at(p, x, y)], (c + 1.0) * even_total(on->method, &m, c), 1e-4);
    patch_destroy(p);
    test_device_destroy(&at);
}

static void white_profiles_give_back_uniform_light(void **state)
{
    const struct party *const on = *state;
    struct pell_frame_material m = broad();
    struct test_device at = test_device_create_on(on->engine, 1, NULL, NULL);

    m.white = true;
    struct patch *p = patch_create(64, 40, true, 1.0, 100.0, &m, 1);
    patch_light(p, 1.0f, 2.0f, 3.0f);
    patch_run(&at, on->method, form(on->method), p);
    for (int c = 0; c < 3; c++)
        REQUIRE_REL((double) p->result[c][patch_at(p, 20, 30)], c + 1.0, 1e-4);
    patch_destroy(p);
    test_device_destroy(&at);
}

/* A bumpy, partly covered surface of two materials with strength maps, to execute all code paths. */
static void rough_scene(struct patch *p, unsigned seed)
{
    for (int y = 0; y < p->frame.shape.height; y++)
        for (int x = 0; x < p->frame.shape.width; x++) {
            const size_t i = patch_at(p, x, y);
            const float n = standard_error((unsigned) x, (unsigned) y, seed),
                        coarse = standard_error((unsigned) x / 9, (unsigned) y / 7, seed + 1);
            p->material[i] = coarse < 0.2f ? 0 : (uint16_t) (1 + (coarse > 0.7f && p->frame.shape.num_materials > 1));
            p->depth[i] = 500.0f + 20.0f * sinf(0.1f * (float) x) * cosf(0.13f * (float) y) + (coarse > 0.5f ? 30.0f : 0.0f) + 0.3f * n;
            p->strength[i] = coarse > 0.6f ? coarse : 1.0f;
            for (int c = 0; c < 3; c++)
                p->light[c][i] = standard_error((unsigned) x, (unsigned) y, seed + 2 + (unsigned) c);
        }
}

static void any_number_of_threads_gives_the_same_bits(void **state)
{
    const struct party *const on = *state;
    struct pell_frame_material m[2] = { broad(), broad() };

    m[1].gaussians.count = 2;
    struct patch *first = NULL;
    for (int threads = 1; threads <= 3; threads++) {
        struct test_device at = test_device_create_on(on->engine, threads, NULL, NULL);
        struct patch *p = patch_create(251, 143, false, 1200.0, 500.0, m, 2);
        struct pell_pass *pass;
        rough_scene(p, 5);
        pass = patch_pass(&at, on->method, form(on->method), p);
        for (int again = 0; again < (SLOW || on->engine != PELL_ENGINE_CPU ? 1 : 3); again++) {
            assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_OK);
            if (first)
                assert_true(same_result(first, p));
            else
                first = patch_create(251, 143, false, 1200.0, 500.0, m, 2);
            for (int c = 0; c < 3; c++)
                memcpy(first->result[c], p->result[c], patch_floats(p) * sizeof(float));
        }
        pell_pass_destroy(&pass);
        patch_destroy(p);
        test_device_destroy(&at);
    }
    patch_destroy(first);
}

static void every_simd_level_gives_the_same_bits(void **state)
{
    const struct party *const on = *state;
    static const char *const levels[] = { "base", "v2", "v3", "v4" };
    const struct pell_frame_material m = broad();
    struct patch *p[4];

    for (int i = 0; i < 4; i++) {
        struct test_device at;
        setenv("PELL_SIMD", levels[i], 1);
        at = test_device_create_on(on->engine, 1, NULL, NULL);
        p[i] = patch_create(201, 93, false, 1200.0, 500.0, &m, 1);
        rough_scene(p[i], 11);
        patch_run(&at, on->method, form(on->method), p[i]);
        test_device_destroy(&at);
        assert_true(same_result(p[0], p[i]));
    }
    unsetenv("PELL_SIMD");
    for (int i = 0; i < 4; i++)
        patch_destroy(p[i]);
}

static void any_size_and_any_rectangle(void **state)
{
    const struct party *const on = *state;
    static const int sizes[][2] = { { 1, 1 }, { 1, 9 }, { 2, 1 }, { 15, 3 }, { 16, 16 }, { 17, 5 }, { 31, 33 }, { 97, 2 }, { 3, 61 } };
    const struct pell_frame_material m = broad();
    struct test_device at = test_device_create_on(on->engine, 2, NULL, NULL);

    for (size_t s = 0; s < PELL_COUNT(sizes); s++) {
        const int w = sizes[s][0], h = sizes[s][1];
        struct patch *p = patch_create(w, h, false, 50.0, 50.0, &m, 1);
        struct pell_pass *pass;
        patch_run(&at, on->method, form(on->method), p);
        REQUIRE_REL((double) p->result[0][patch_at(p, w - 1, h - 1)], even_total(on->method, &m, 0), 1e-4);
        /* Nothing is written outside the image (rows have padding), nor outside the rectangle. */
        for (int y = 0; y < h; y++)
            for (ptrdiff_t x = w; x < p->frame.shape.stride; x++)
                assert_true(p->result[0][y * p->frame.shape.stride + x] == 0.0f);
        pass = patch_pass(&at, on->method, form(on->method), p);
        p->frame.rect = (struct pell_rect) { 0, 0, 0, 0 };
        for (int c = 0; c < 3; c++)
            p->result[c][0] = -5.0f;
        assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_OK);
        assert_true(p->result[0][0] == -5.0f);
        p->frame.rect = (struct pell_rect) { w / 2, h / 2, w, h };
        for (int y = 0; y < h; y++)
            for (int x = 0; x < w; x++)
                p->material[patch_at(p, x, y)] = x >= w / 2 && y >= h / 2;
        assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_OK);
        REQUIRE_REL((double) p->result[2][patch_at(p, w - 1, h - 1)], even_total(on->method, &m, 2), 1e-4);
        pell_pass_destroy(&pass);
        patch_destroy(p);
    }
    test_device_destroy(&at);
}

static void a_frame_leaves_nothing_for_the_next(void **state)
{
    const struct party *const on = *state;
    const struct pell_frame_material m = broad();
    struct test_device at = test_device_create_on(on->engine, 2, NULL, NULL);
    struct patch *p = patch_create(90, 80, false, 500.0, 500.0, &m, 1), *q = patch_create(90, 80, false, 500.0, 500.0, &m, 1);
    struct pell_pass *pass = patch_pass(&at, on->method, form(on->method), p);

    rough_scene(p, 21);
    assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_OK);
    for (int i = 0; i < 2; i++) {
        struct patch *r = i ? q : p;
        light_noise(r);
        memset(r->material, 0, patch_floats(r) * sizeof(uint16_t));
        for (int c = 0; c < 3; c++)
            memset(r->result[c], 0, patch_floats(r) * sizeof(float));
        r->frame.rect = (struct pell_rect) { 21, 17, 63, 50 };
        for (int y = 17; y < 50; y++)
            for (int x = 21; x < 63; x++) {
                r->material[patch_at(r, x, y)] = 1;
                r->depth[patch_at(r, x, y)] = 400.0f + (float) x;
                r->strength[patch_at(r, x, y)] = 1.0f;
            }
    }
    assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_OK);
    patch_run(&at, on->method, form(on->method), q);
    assert_true(same_result(p, q));
    pell_pass_destroy(&pass);
    patch_destroy(p);
    patch_destroy(q);
    test_device_destroy(&at);
}

static void knobs_out_of_range_are_refused(void **state)
{
    const struct party *const on = *state;
    const struct pell_frame_material m = broad();
    struct kept_messages kept = { 0 };
    struct test_device at = test_device_create_on(on->engine, 1, NULL, &kept);
    struct patch *p = patch_create(20, 20, true, 1.0, 100.0, &m, 1);
    void *values = calloc(1, on->method->knobs_size);

    assert_string_equal(on->method->knobs[0].name, "as");
    for (const struct pell_knob *k = on->method->knobs; k->type; k++) {
        for (int bad = 0; bad < 3; bad++) {
            struct pell_pass *pass;
            char *field;
            patch_configure(at.ctx, on->method, NULL, values);
            field = (char *) values + k->offset;
            if (k->type == PELL_KNOB_INT)
                *(int *) field = (int) (bad == 0 ? k->min - 1.0 : bad == 1 ? k->max + 1.0 : -2147483647.0);
            else if (k->type == PELL_KNOB_ENUM)
                *(int *) field = bad == 0 ? -1 : bad == 1 ? 1000 : 2147483647;
            else if (k->type == PELL_KNOB_FLOAT)
                *(float *) field = bad == 0 ? nextafterf((float) k->min, -INFINITY) : bad == 1 ? (float) k->max * 1.01f + 1.0f : NAN;
            else
                continue;
            kept = (struct kept_messages) { 0 };
            assert_int_equal(pell_pass_create(at.device, on->method, values, &p->frame.shape, &pass), PELL_ERR_INVALID);
            assert_null(pass);
            assert_int_equal(kept.errors, 1);
            assert_non_null(strstr(kept.what, k->name));
        }
    }
    free(values);
    patch_destroy(p);
    test_device_destroy(&at);
}

static void settings_are_read_and_as_comes_first(void **state)
{
    const struct party *const on = *state;
    const struct pell_setting wrong[][1] = { { { "gausians", "4", "--set" } }, { { "as", "papr", "--set" } }, { { "as", "", "--set" } } };
    struct kept_messages kept = { 0 };
    struct pell_context *ctx = test_context(NULL, &kept);
    unsigned char *a = calloc(1, on->method->knobs_size), *b = calloc(1, on->method->knobs_size);

    for (const struct pell_knob *k = on->method->knobs; k->type; k++) {
        char text[64];
        struct pell_setting s[2];
        patch_configure(ctx, on->method, NULL, a);
        pell_knob_format(k, a, text, sizeof(text));
        s[0] = (struct pell_setting) { k->name, text, "test" };
        s[1] = (struct pell_setting) { "as", "paper", "test" };
        assert_int_equal(pell_method_configure(ctx, on->method, s, strcmp(k->name, "as") == 0 ? 1 : 2, b), PELL_OK);
        /* Explicit settings are kept, although `as` follows them. */
        pell_knob_format(k, b, text, sizeof(text));
        assert_string_equal(text, s[0].value);
    }
    for (size_t i = 0; i < PELL_COUNT(wrong); i++) {
        kept = (struct kept_messages) { 0 };
        assert_int_equal(pell_method_configure(ctx, on->method, wrong[i], 1, a), PELL_ERR_INVALID);
        assert_int_equal(kept.errors, 1);
        assert_string_equal(kept.where, "--set");
    }
    kept = (struct kept_messages) { 0 };
    assert_ptr_equal(pell_method_find(ctx, "--on->method", on->method->name), on->method);
    assert_int_equal(kept.errors, 0);
    free(a);
    free(b);
    assert_null(pell_method_find(ctx, "--on->method", "screenspace"));
    assert_int_equal(kept.errors, 1);
    assert_non_null(strstr(kept.hint, "screen-space"));
    assert_null(pell_method_find(ctx, "--on->method",
                                 "\x01"
                                 "zzzzzzzzzzzzzzzzzzzz"));
    pell_context_destroy(&ctx);
}

static void swapping_channels_swaps_the_result(void **state)
{
    const struct party *const on = *state;
    static const int order[3] = { 2, 0, 1 };
    struct pell_frame_material m[2] = { broad(), broad() };
    struct test_device at = test_device_create_on(on->engine, 1, NULL, NULL);

    for (int i = 0; i < 3; i++)
        for (int c = 0; c < 3; c++)
            m[1].gaussians.weight[i][c] = m[0].gaussians.weight[i][order[c]];
    struct patch *p = patch_create(80, 60, false, 500.0, 400.0, &m[0], 1), *q = patch_create(80, 60, false, 500.0, 400.0, &m[1], 1);
    rough_scene(p, 31);
    rough_scene(q, 31);
    for (int c = 0; c < 3; c++)
        memcpy(q->light[c], p->light[order[c]], patch_floats(p) * sizeof(float));
    patch_run(&at, on->method, form(on->method), p);
    patch_run(&at, on->method, form(on->method), q);
    for (int c = 0; c < 3; c++)
        assert_memory_equal(q->result[c], p->result[order[c]], patch_floats(p) * sizeof(float));
    patch_destroy(p);
    patch_destroy(q);
    test_device_destroy(&at);
}

static double second_moment(const struct test_device *at, const struct pell_method *method, double variance)
{
    static const double one[1][3] = { { 1.0, 1.0, 1.0 } };
    const struct pell_frame_material m = patch_gaussians(1, &variance, one);
    const int half = (int) fmin(80.0, 8.0 * sqrt(variance) + 4.0), size = 2 * half + 1; /* all of the light, as far as 161 pixels hold it */
    struct patch *p = patch_create(size, size, true, 1.0, 100.0, &m, 1);
    double sum = 0.0, moment = 0.0;

    patch_light(p, 0.0f, 0.0f, 0.0f);
    for (int c = 0; c < 3; c++)
        p->light[c][patch_at(p, half, half)] = 1.0f;
    patch_run(at, method, fine_form(method), p);
    for (int y = 0; y < size; y++)
        for (int x = 0; x < size; x++) {
            const double v = (double) p->result[1][patch_at(p, x, y)];
            sum += v;
            moment += v * ((x - half) * (x - half) + (y - half) * (y - half));
        }
    patch_destroy(p);
    return moment / sum;
}

/* The engines' results are equal (test_vulkan_parity.c), and a device's driver may be one for CPUs: fewer radii where 1024 samples of each
 * pixel take long. */
static void a_larger_radius_spreads_more(void **state)
{
    const struct party *const on = *state;
    const double step = on->engine == PELL_ENGINE_CPU || strcmp(on->method->name, "image-space") != 0 ? 1.3 : 3.0;
    struct test_device at = test_device_create_on(on->engine, 1, NULL, NULL);
    double before = -1.0;

    for (double v = 0.02; v < 200.0; v *= step) {
        const double moment = second_moment(&at, on->method, v);
        REQUIRE(moment >= before);
        if (v > 1.0)
            REQUIRE_REL(moment, 2.0 * (v + 1.0 / 12.0), 0.02);
        before = moment;
    }
    test_device_destroy(&at);
}

static void no_radius_is_lambert(void **state)
{
    const struct party *const on = *state;
    struct pell_frame_material m = broad(), dense = { .name = "dense", .medium = { .eta = 1.3 } };
    struct test_device at = test_device_create_on(on->engine, 1, NULL, NULL);

    for (int i = 0; i < 3; i++) {
        m.gaussians.variance[i] *= 1e-9;
        dense.medium.sigma_a[i] = 0.1;
        dense.medium.sigma_s_reduced[i] = 1e5;
    }
    for (int i = 0; i < 2; i++) {
        struct patch *p = patch_create(50, 40, false, 1000.0, 1000.0, i ? &dense : &m, 1);
        light_noise(p);
        patch_run(&at, on->method, form(on->method), p);
        for (int c = 0; c < 3; c++)
            for (int y = 0; y < 40; y++)
                for (int x = 0; x < 50; x++)
                    REQUIRE_NEAR((double) p->result[c][patch_at(p, x, y)],
                                 even_total(on->method, i ? &dense : &m, c) * (double) p->light[c][patch_at(p, x, y)], 1e-3);
        patch_destroy(p);
    }
    test_device_destroy(&at);
}

static void all_albedos_are_legal(void **state)
{
    const struct party *const on = *state;
    static const double coefficients[][2] = {
        { 1.0, 0.0 }, { 0.0, 1.0 }, { 1e-6, 0.0 }, { 1e6, 0.0 }, { 0.0, 1e6 }, { 1e6, 1e6 }, { 1e-7, 1e-6 }, { 1e-3, 50.0 },
    };
    struct test_device at = test_device_create_on(on->engine, 1, NULL, NULL);

    for (size_t k = 0; k < PELL_COUNT(coefficients); k++) {
        struct pell_frame_material m = { .name = "medium", .medium = { .eta = 1.3 } };
        struct patch *p;
        for (int c = 0; c < 3; c++) {
            m.medium.sigma_a[c] = c == 1 ? 0.01 : coefficients[k][0];
            m.medium.sigma_s_reduced[c] = c == 1 ? 1.0 : coefficients[k][1];
        }
        p = patch_create(40, 30, false, 500.0, 500.0, &m, 1);
        patch_run(&at, on->method, form(on->method), p);
        for (int c = 0; c < 3; c++)
            REQUIRE_NEAR((double) p->result[c][patch_at(p, 20, 15)], even_total(on->method, &m, c), 1e-4);
        patch_destroy(p);
    }
    test_device_destroy(&at);
}

static void what_lies_outside_the_mask_changes_nothing(void **state)
{
    const struct party *const on = *state;
    const float junk[] = { 0.0f, 1e30f, -1e30f, NAN, INFINITY, -INFINITY, 1e-40f };
    struct pell_frame_material m[2] = { broad(), broad() };
    struct test_device at = test_device_create_on(on->engine, 2, NULL, NULL);
    struct patch *first = NULL;

    for (size_t j = 0; j < PELL_COUNT(junk); j++) {
        struct patch *p = patch_create(120, 90, false, 900.0, 500.0, m, 2);
        float *const planes[] = { p->depth,     p->strength,  p->light[0],    p->light[1],    p->light[2],   p->normal[0],
                                  p->normal[1], p->normal[2], p->position[0], p->position[1], p->position[2] };
        rough_scene(p, 41);
        for (size_t i = 0; i < patch_floats(p); i++)
            for (size_t k = 0; !p->material[i] && k < PELL_COUNT(planes); k++)
                planes[k][i] = junk[j];
        patch_run(&at, on->method, form(on->method), p);
        for (size_t i = 0; i < patch_floats(p); i++)
            for (int c = 0; c < 3; c++)
                assert_true(p->material[i] ? isfinite(p->result[c][i]) : p->result[c][i] == 0.0f);
        if (first) {
            assert_true(same_result(first, p));
            patch_destroy(p);
        } else {
            first = p;
        }
    }
    patch_destroy(first);
    test_device_destroy(&at);
}

/* A plane of an engine may hold ids of its own: an id of no material of the frame means not translucent. */
static void ids_beyond_the_materials_count_as_none(void **state)
{
    const struct party *const on = *state;
    const uint16_t ids[] = { 0, 3, 4095, 4096, 32768, 65535 };
    struct pell_frame_material m[2] = { broad(), broad() };
    struct test_device at = test_device_create_on(on->engine, 2, NULL, NULL);
    struct patch *first = NULL;

    for (size_t j = 0; j < PELL_COUNT(ids); j++) {
        struct patch *p = patch_create(120, 90, false, 900.0, 500.0, m, 2);
        rough_scene(p, 43);
        for (int y = 0; y < 90; y++)
            for (int x = 0; x < 120; x++) {
                uint16_t *id = &p->material[patch_at(p, x, y)];
                if (*id == 0 || (x >= 32 && x < 64 && y < 40)) /* holes of single pixels, and whole blocks */
                    *id = ids[j];
            }
        patch_run(&at, on->method, form(on->method), p);
        if (first) {
            assert_true(same_result(first, p));
            patch_destroy(p);
        } else {
            first = p;
        }
    }
    patch_destroy(first);
    test_device_destroy(&at);
}

static void materials_that_touch_do_not_bleed(void **state)
{
    const struct party *const on = *state;
    struct pell_frame_material m[2] = { broad(), broad() };
    struct test_device at = test_device_create_on(on->engine, 1, NULL, NULL);

    m[1].gaussians.variance[0] = 1.0;
    struct patch *p = patch_create(101, 64, true, 1.0, 100.0, m, 2);
    for (int y = 0; y < 64; y++)
        for (int x = 0; x < 101; x++) {
            const bool left = x + y / 4 < 53;
            p->material[patch_at(p, x, y)] = left ? 1 : 2;
            p->light[0][patch_at(p, x, y)] = left ? 1.0f : 0.0f;
            p->light[1][patch_at(p, x, y)] = left ? 0.0f : 1.0f;
        }
    patch_run(&at, on->method, form(on->method), p);
    for (int y = 0; y < 64; y++)
        for (int x = 0; x < 101; x++) {
            const bool left = x + y / 4 < 53;
            const size_t i = patch_at(p, x, y);
            REQUIRE_NEAR((double) p->result[0][i], left ? even_total(on->method, &m[0], 0) : 0.0, 1e-5);
            REQUIRE_NEAR((double) p->result[1][i], left ? 0.0 : even_total(on->method, &m[1], 1), 1e-5);
        }
    patch_destroy(p);
    test_device_destroy(&at);
}

static void failed_allocations_leak_nothing(void **state)
{
    const struct party *const on = *state;
    struct pell_frame_material m[2] = { broad(), { .name = "medium", .medium = { .eta = 1.3 } } };

    for (int c = 0; c < 3; c++) {
        m[1].medium.sigma_a[c] = 0.01;
        m[1].medium.sigma_s_reduced[c] = 1.0;
    }
    bool done = false;
    int64_t compiled = 0;
    for (uint64_t n = 1; !done && n < 200; n++) {
        struct pell_alloc_fault fault = { 0 };
        struct kept_messages kept = { 0 };
        struct test_device at = test_device_create_on(on->engine, 2, &fault, &kept);
        struct patch *p = patch_create(50, 40, false, 500.0, 500.0, m, 2);
        const int64_t live = fault.live;
        struct pell_pass *pass;
        void *knobs = calloc(1, on->method->knobs_size);
        enum pell_result res;
        fault.fail_at = fault.calls + n;
        patch_configure(NULL, on->method, either_form(on->method, false), knobs);
        res = pell_pass_create(at.device, on->method, knobs, &p->frame.shape, &pass);
        if (res == PELL_OK) {
            assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_OK);
            done = fault.calls < fault.fail_at;
            pell_pass_destroy(&pass);
        } else {
            assert_int_equal(res, PELL_ERR_NOMEM);
            assert_null(pass);
            assert_true(kept.errors >= 1);
        }
        if (on->engine == PELL_ENGINE_VULKAN) { /* the compiled shaders, and nothing else, remain on the device */
            fault.fail_at = 0;
            assert_int_equal(pell_pass_create(at.device, on->method, knobs, &p->frame.shape, &pass), PELL_OK);
            pell_pass_destroy(&pass);
            compiled = n == 1 ? fault.live - live : compiled;
        }
        free(knobs);
        assert_int_equal(fault.live, live + compiled);
        patch_destroy(p);
        test_device_destroy(&at);
        assert_int_equal(fault.live, 0);
    }
    assert_true(done);
}

static void a_frame_allocates_nothing(void **state)
{
    const struct party *const on = *state;
    const struct pell_frame_material m = broad();
    struct test_device at = test_device_create_on(on->engine, 2, NULL, NULL);
    struct patch *p = patch_create(200, 100, false, 900.0, 500.0, &m, 1);
    struct pell_pass *pass = patch_pass(&at, on->method, form(on->method), p);
    const uint64_t before = pell_allocations(at.ctx);

    for (unsigned i = 0; i < 3; i++) {
        rough_scene(p, 50 + i);
        assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_OK);
    }
    assert_int_equal(pell_allocations(at.ctx), before);
    pell_pass_destroy(&pass);
    patch_destroy(p);
    test_device_destroy(&at);
}

struct racer {
    const struct pell_method *method;
    struct test_device at;
    struct patch *p;
    enum pell_result res;
};

static void *race(void *arg)
{
    struct racer *r = arg;
    struct pell_pass *pass = NULL;
    void *knobs = calloc(1, r->method->knobs_size);

    patch_configure(NULL, r->method, either_form(r->method, false), knobs);
    r->res = pell_pass_create(r->at.device, r->method, knobs, &r->p->frame.shape, &pass);
    for (int i = 0; r->res == PELL_OK && i < 5; i++)
        r->res = pell_pass_render(pass, &r->p->frame, &r->p->out);
    pell_pass_destroy(&pass);
    free(knobs);
    return NULL;
}

static void two_renderers_run_at_once(void **state)
{
    const struct party *const on = *state;
    const struct pell_frame_material m = broad();
    struct racer racers[3];

    pthread_t threads[2];
    for (int i = 0; i < 3; i++) {
        racers[i] = (struct racer) { .method = on->method,
                                     .at = test_device_create_on(on->engine, 2, NULL, NULL),
                                     .p = patch_create(160, 120, false, 900.0, 500.0, &m, 1) };
        rough_scene(racers[i].p, 61);
    }
    for (int i = 0; i < 2; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, race, &racers[i]), 0);
    for (int i = 0; i < 2; i++)
        pthread_join(threads[i], NULL);
    race(&racers[2]);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(racers[i].res, PELL_OK);
        assert_true(same_result(racers[i].p, racers[2].p));
    }
    for (int i = 0; i < 3; i++) {
        patch_destroy(racers[i].p);
        test_device_destroy(&racers[i].at);
    }
}

static void a_frame_of_another_shape_is_refused(void **state)
{
    const struct party *const on = *state;
    const struct pell_frame_material m = broad();
    struct kept_messages kept = { 0 };
    struct test_device at = test_device_create_on(on->engine, 1, NULL, &kept);
    struct patch *p = patch_create(40, 30, false, 500.0, 500.0, &m, 1), *q = patch_create(61, 47, false, 500.0, 500.0, &m, 1);
    struct pell_pass *pass = patch_pass(&at, on->method, form(on->method), p);
    struct pell_frame_light twice;
    struct pell_frame out;

    kept = (struct kept_messages) { 0 };
    assert_int_equal(pell_pass_render(pass, &q->frame, &q->out), PELL_ERR_INVALID);
    out = p->frame;
    out.rect.x1 = 41;
    assert_int_equal(pell_pass_render(pass, &out, &p->out), PELL_ERR_INVALID);
    out = p->frame;
    out.depth = NULL;
    assert_int_equal(pell_pass_render(pass, &out, &p->out), PELL_ERR_INVALID);
    twice = p->out;
    twice.light[1] = twice.light[2];
    assert_int_equal(pell_pass_render(pass, &p->frame, &twice), PELL_ERR_INVALID);
    twice = p->out;
    twice.light[0] = (float *) p->frame.depth;
    assert_int_equal(pell_pass_render(pass, &p->frame, &twice), PELL_ERR_INVALID);
    assert_int_equal(kept.errors, 5);
    twice = p->out;
    twice.light[1] = twice.light[0] + p->frame.shape.stride + 3; /* part of the same memory */
    assert_int_equal(pell_pass_render(pass, &p->frame, &twice), PELL_ERR_INVALID);
    assert_int_equal(kept.errors, 6);
    pell_pass_destroy(&pass);
    patch_run(&at, on->method, form(on->method), q);
    REQUIRE_REL((double) q->result[0][patch_at(q, 60, 46)], even_total(on->method, &m, 0), 1e-4);
    patch_destroy(p);
    patch_destroy(q);
    test_device_destroy(&at);
}

static void dim_and_bright_light_is_scaled_exactly(void **state)
{
    const struct party *const on = *state;
    static const double scales[] = { 1e-20, 1e20 };
    const struct pell_frame_material m = broad();
    struct test_device at = test_device_create_on(on->engine, 1, NULL, NULL);
    struct patch *p = patch_create(90, 60, false, 900.0, 500.0, &m, 1), *q = patch_create(90, 60, false, 900.0, 500.0, &m, 1);

    rough_scene(p, 71);
    patch_run(&at, on->method, form(on->method), p);
    for (size_t s = 0; s < PELL_COUNT(scales); s++) {
        rough_scene(q, 71);
        for (int c = 0; c < 3; c++)
            for (size_t i = 0; i < patch_floats(q); i++)
                q->light[c][i] *= (float) scales[s];
        patch_run(&at, on->method, form(on->method), q);
        for (int c = 0; c < 3; c++)
            for (size_t i = 0; i < patch_floats(q); i++)
                REQUIRE_NEAR((double) q->result[c][i] / (double) (float) scales[s], (double) p->result[c][i], 1e-5);
    }
    patch_destroy(p);
    patch_destroy(q);
    test_device_destroy(&at);
}

static void only_planes_of_the_plan_are_read(void **state)
{
    const struct party *const on = *state;
    const struct pell_frame_material m = broad();
    struct test_device at = test_device_create_on(on->engine, 1, NULL, NULL);

    for (int f = 0; f < 2; f++) {
        const char *const *settings = either_form(on->method, f);
        struct patch *p = patch_create(60, 40, false, 900.0, 500.0, &m, 1);
        struct pell_pass *pass = patch_pass(&at, on->method, settings, p);
        const unsigned needs = pell_pass_plan(pass)->needs;
        for (int c = 0; c < 3; c++) {
            if (!(needs & PELL_NEED_IRRADIANCE))
                p->frame.irradiance[c] = NULL;
            if (!(needs & PELL_NEED_SHADED))
                p->frame.shaded[c] = NULL;
            if (!(needs & PELL_NEED_NORMAL))
                p->frame.normal[c] = NULL;
            if (!(needs & PELL_NEED_POSITION))
                p->frame.position[c] = NULL;
        }
        p->frame.strength = NULL;
        assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_OK);
        for (int c = 0; c < 3; c++)
            p->frame.irradiance[c] = p->frame.shaded[c] = NULL;
        assert_int_equal(pell_pass_render(pass, &p->frame, &p->out), PELL_ERR_INVALID);
        pell_pass_destroy(&pass);
        patch_destroy(p);
    }
    test_device_destroy(&at);
}

static void wild_frames_give_finite_light(void **state)
{
    const struct party *const on = *state;
    const unsigned frames = SLOW || on->engine != PELL_ENGINE_CPU ? 60 : 200; /* of all kinds */
    struct test_device at = test_device_create_on(on->engine, 2, NULL, NULL);

    for (unsigned k = 0; k < frames; k++) {
        const char *const *settings = either_form(on->method, k % 5 == 4);
        /* A sample that was assumed to be distant may be close: with the paper's sample count its weight then exceeds one. */
        /* Likewise all light that the paper's planes place close together. */
        const bool unbounded = k % 5 == 4 && (strcmp(on->method->name, "image-space") == 0 || strcmp(on->method->name, "convolution") == 0);
        const int w = 1 + (int) (70.0f * standard_error(k, 1, 1)), h = 1 + (int) (50.0f * standard_error(k, 2, 1));
        struct pell_frame_material m[2] = { broad(), broad() };
        struct patch *p;
        for (int i = 0; i < 3; i++)
            m[0].gaussians.variance[i] *= pow(10.0, 12.0 * (double) standard_error(k, 3, 1) - 6.0);
        p = patch_create(w, h, k % 3 == 0, pow(10.0, 8.0 * (double) standard_error(k, 4, 1) - 2.0), 500.0, m, 2);
        rough_scene(p, k);
        for (int i = 0; i < (int) patch_floats(p); i++)
            if (standard_error((unsigned) i, k, 9) < 0.1f)
                p->depth[i] = powf(10.0f, 20.0f * standard_error((unsigned) i, k, 10) - 8.0f);
        patch_run(&at, on->method, settings, p);
        for (size_t i = 0; i < patch_floats(p); i++)
            for (int c = 0; c < 3; c++)
                REQUIRE(isfinite(p->result[c][i]) && p->result[c][i] >= 0.0f && (unbounded || p->result[c][i] < 1.001f));
        patch_destroy(p);
    }
    test_device_destroy(&at);
}

static void thickness_tables_fall_from_the_albedo_to_nothing(void **state)
{
    const struct party *const on = *state;
    const struct pell_frame_material m = broad();
    struct test_device at = test_device_create_on(on->engine, 1, NULL, NULL);
    struct patch *p = patch_create(10, 10, true, 1.0, 100.0, &m, 1);
    struct pell_pass *pass = patch_pass(&at, on->method, form(on->method), p);
    const struct pell_thickness_table *t = pell_pass_thickness(pass, 0);

    assert_null(pell_pass_thickness(pass, 1));
    assert_true(!(pell_pass_plan(pass)->needs & PELL_NEED_TRANSMISSION) || t);
    for (int c = 0; t && c < 3; c++) {
        REQUIRE(t->value[0][c] <= 1.0f && t->max_mm > 0.0f && isfinite(t->max_mm));
        for (int i = 1; i < PELL_THICKNESS_STEPS; i++)
            REQUIRE(t->value[i][c] >= 0.0f && t->value[i][c] <= t->value[i - 1][c]);
        REQUIRE(t->value[PELL_THICKNESS_STEPS - 1][c] <= 1.01e-4f * (float) even_total(on->method, &m, c));
    }
    pell_pass_destroy(&pass);
    patch_destroy(p);
    test_device_destroy(&at);
}

static void says_what_it_is(void **state)
{
    const struct pell_method *m = ((const struct party *) *state)->method;

    assert_true(m->name && m->title && m->cite && m->limits && m->knobs && m->plan && m->knobs_size > 0);
    assert_int_equal(strspn(m->name, "abcdefghijklmnopqrstuvwxyz0123456789-"), strlen(m->name));
    for (size_t i = 0; i < pell_method_count(); i++)
        assert_true(pell_method_at(i) == m || strcmp(pell_method_at(i)->name, m->name) != 0);
    assert_null(pell_method_at(pell_method_count()));
    assert_null(pell_method_at(SIZE_MAX));
    for (const struct pell_knob *k = m->knobs; k->type; k++) {
        assert_true(k->name && k->help && k->unit && k->offset < m->knobs_size);
        assert_ptr_equal(pell_knob_find(m->knobs, k->name), k);
    }
}

/* A method that needs a scene refuses planes, and says how to proceed. */
static void refuses_planes(void **state)
{
    const struct party *const on = *state;
    const struct pell_frame_material m = broad();
    struct kept_messages kept = { 0 };
    struct test_device at = test_device_create_on(on->engine, 1, NULL, &kept);
    struct patch *p = patch_create(20, 20, true, 1.0, 100.0, &m, 1);
    struct pell_pass *pass;

    assert_int_equal(pell_pass_create(at.device, on->method, NULL, &p->frame.shape, &pass), PELL_ERR_UNSUPPORTED);
    assert_null(pass);
    assert_int_equal(kept.errors, 1);
    assert_string_equal(kept.where, on->method->name);
    assert_non_null(strstr(kept.what, "scene"));
    patch_destroy(p);
    test_device_destroy(&at);
}

#define PROMISE(name)                                                                                                                      \
    {                                                                                                                                      \
#name, name, false, false                                                                                                          \
    }
/* Identical in both builds: the test sets its own knobs, or tries both. */
#define ONCE(name)                                                                                                                         \
    {                                                                                                                                      \
#name, name, false, true                                                                                                           \
    }
#define ANYWHERE_ONCE(name)                                                                                                                \
    {                                                                                                                                      \
#name, name, true, true                                                                                                            \
    }

int main(int argc, char **argv)
{
    static const struct promise promises[] = {
        ANYWHERE_ONCE(says_what_it_is),
        PROMISE(impulse_gives_the_profile),
        PROMISE(light_adds_up),
        PROMISE(light_that_moves_moves_the_result),
        PROMISE(total_light_is_kept),
        PROMISE(uniform_light_gives_the_albedo),
        PROMISE(white_profiles_give_back_uniform_light),
        PROMISE(any_number_of_threads_gives_the_same_bits),
        PROMISE(every_simd_level_gives_the_same_bits),
        PROMISE(any_size_and_any_rectangle),
        PROMISE(a_frame_leaves_nothing_for_the_next),
        ANYWHERE_ONCE(knobs_out_of_range_are_refused),
        ANYWHERE_ONCE(settings_are_read_and_as_comes_first),
        PROMISE(swapping_channels_swaps_the_result),
        PROMISE(a_larger_radius_spreads_more),
        PROMISE(no_radius_is_lambert),
        PROMISE(all_albedos_are_legal),
        PROMISE(what_lies_outside_the_mask_changes_nothing),
        PROMISE(ids_beyond_the_materials_count_as_none),
        PROMISE(materials_that_touch_do_not_bleed),
        ONCE(failed_allocations_leak_nothing),
        PROMISE(a_frame_allocates_nothing),
        ONCE(two_renderers_run_at_once),
        PROMISE(a_frame_of_another_shape_is_refused),
        PROMISE(dim_and_bright_light_is_scaled_exactly),
        ONCE(only_planes_of_the_plan_are_read),
        ONCE(wild_frames_give_finite_light),
        PROMISE(thickness_tables_fall_from_the_albedo_to_nothing),
        { 0 },
    };
    static const struct contract contract = { promises, exceptions, needs_scene, refuses_planes, PAPER };

    return contract_run(&contract, argc, argv);
}
