/* SPDX-License-Identifier: MIT
 * test_image_views.c - the image-space method on whole scenes: contribution of the lights' views in addition to the camera's, against an
 * integral over the whole surface. */
#include "scenes.h"

#include "render/renderer.h"

static const char *const camera[] = { "renormalise=off", "through=off", "samples=256", "reconstruct=off", NULL };
static const char *const lights[] = { "samples=256", "views=eye+lights", "view-size=256", "reconstruct=off", NULL };

/* Mean of R, G and B over fully covered pixels; with `other`, the root mean square of the difference, too. */
static double mean_of(const struct shot *a, const struct shot *other, double *rms)
{
    double sum = 0.0, square = 0.0;
    int n = 0;

    for (int y = 0; y < a->height; y++)
        for (int x = 0; x < a->width; x++)
            for (size_t c = 0; c < 3 && shot_at(a, SHOT_A, x, y) >= 1.0; c++) {
                const double v = shot_at(a, c, x, y), e = other ? v - shot_at(other, c, x, y) : 0.0;
                sum += v;
                square += e * e;
                n++;
            }
    if (rms)
        *rms = sqrt(square / n);
    return sum / n;
}

/* 0: a ball lit from the side; 1: two merged balls with the crease in view; 2: a backlit sheet; 3: a ball lit by a directional light
 * from behind and the side. */
static void object(struct stage *s, int which, int size)
{
    size_t m;

    stage_start(s, size, size);
    stage_gaussians(s, 0.5, &m);
    if (which == 1) {
        stage_ball(s, m, 0, vec3(-4, 0, 0), 6.0f, 48);
        stage_ball(s, m, 0, vec3(4, 0, 0), 6.0f, 48);
    } else if (which == 2) {
        stage_box(s, m, 0, vec3(-8, -8, -1.5), vec3(8, 8, 0));
    } else {
        stage_ball(s, m, 0, vec3(0, 0, 0), 6.0f, 64);
    }
    if (which == 3)
        stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3(60, 30, -50), vec3(0, 0, 0), 3.0f);
    else
        stage_light(s, PELL_LIGHT_POINT, which == 2 ? vec3(10, 10, -60) : vec3(60, 40, 5), vec3(0, 0, 0), 5e-3f);
    stage_camera(s, vec3(0, 0, 100), vec3(0, 0, 0), which == 3 ? 0.0f : 0.17f, 20.0f * (which == 3));
}

static void views_of_lights_close_the_gap_to_the_whole_surface(void **state)
{
    static const char *const names[] = { "ball lit from the side", "two balls in one", "sheet lit from behind", "ball lit from behind" };
    static const char *const fine[] = { "density=16", NULL };

    (void) state;
    for (int k = 0; k < 4; k++) {
        struct stage s;
        struct shot whole, one, all;
        double truth, rms[2], seen[2];
        object(&s, k, 48);
        whole = stage_shot_of(&s, "hierarchical", fine);
        one = stage_shot_of(&s, "image-space", camera);
        all = stage_shot_of(&s, "image-space", lights);
        truth = mean_of(&whole, NULL, NULL);
        seen[0] = mean_of(&one, &whole, &rms[0]);
        seen[1] = mean_of(&all, &whole, &rms[1]);
        print_message("# %s: the camera's view gives %.4f of hierarchical's light (rms difference %.4f), with the light's %.4f (%.4f)\n",
                      names[k], seen[0] / truth, rms[0] / truth, seen[1] / truth, rms[1] / truth);
        REQUIRE(fabs(seen[1] / truth - 1.0) < 0.03);
        REQUIRE(rms[1] < 0.1 * truth && rms[1] < 0.2 * rms[0]);
        REQUIRE(seen[0] < 0.97 * truth);
        shot_free(&whole);
        shot_free(&one);
        shot_free(&all);
        stage_finish(&s);
    }
}

/* A uniform environment is not a light with a view: views along the axes cover the surfaces that it lights. */
static void views_around_see_what_the_sky_lights(void **state)
{
    static const char *const names[] = { "sheet under a sky", "two balls under a sky", "ball lit from behind" };
    static const char *const around[] = { "samples=64", "views=eye+around", "view-size=128", NULL }, *const fine[] = { "density=16", NULL };

    (void) state;
    for (int k = 0; k < 3; k++) {
        struct stage s;
        struct shot whole, one, all;
        double truth, rms[2], seen[2];
        object(&s, k == 0 ? 2 : k == 1 ? 1 : 3, 32);
        if (k < 2) {
            s.scene->lights[0].type = PELL_LIGHT_ENVIRONMENT;
            for (int c = 0; c < 3; c++)
                s.scene->lights[0].power[c] = 0.3f;
        }
        whole = stage_shot_of(&s, "hierarchical", fine);
        one = stage_shot_of(&s, "image-space", camera);
        all = stage_shot_of(&s, "image-space", around);
        truth = mean_of(&whole, NULL, NULL);
        seen[0] = mean_of(&one, &whole, &rms[0]);
        seen[1] = mean_of(&all, &whole, &rms[1]);
        print_message("# %s: the camera's view gives %.4f of hierarchical's light (rms difference %.4f), views around %.4f (%.4f)\n",
                      names[k], seen[0] / truth, rms[0] / truth, seen[1] / truth, rms[1] / truth);
        REQUIRE(fabs(seen[1] / truth - 1.0) < 0.04 && fabs(seen[0] / truth - 1.0) > 0.15);
        REQUIRE(rms[1] < 0.25 * rms[0]);
        shot_free(&whole);
        shot_free(&one);
        shot_free(&all);
        stage_finish(&s);
    }
}

/* A surface that a second view also covers must not count twice: a uniformly lit front with two more views of it. */
static void what_several_views_see_counts_once(void **state)
{
    struct stage s;
    struct shot one, all;
    double rms, a, b;
    size_t m;

    (void) state;
    stage_start(&s, 40, 40);
    stage_gaussians(&s, 0.5, &m);
    stage_box(&s, m, 0, vec3(-30, -30, -30), vec3(30, 30, 0));
    stage_light(&s, PELL_LIGHT_POINT, vec3(20, 0, 80), vec3(0, 0, 0), 5e-3f);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(-40, 10, 60), vec3(0, 0, 0), 2.0f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.3f, 0.0f);
    one = stage_shot_of(&s, "image-space", camera);
    all = stage_shot_of(&s, "image-space", lights);
    a = b = 0.0;
    for (int y = 14; y < 26; y++)
        for (int x = 14; x < 26; x++)
            for (size_t c = 0; c < 3; c++) {
                a += shot_at(&one, c, x, y);
                b += shot_at(&all, c, x, y);
            }
    mean_of(&all, &one, &rms);
    print_message("# a wall seen by the camera and two lights: %.4f of the light by the camera's view alone\n", b / a);
    REQUIRE_NEAR(b / a, 1.0, 0.02);
    shot_free(&one);
    shot_free(&all);
    stage_finish(&s);
}

/* No light passes from one object to another, even where they touch: with more views the method knows solids; with the camera's view
 * alone the renderer gives objects of one material separate ids. */
static void light_stays_in_its_object(void **state)
{
    static const char *const around[] = { "views=eye+around", "view-size=128", NULL };

    (void) state;
    require_light_stays_in_its_object("image-space", lights, false, 0.0f, 16.0f, 16, 6, 8);
    require_light_stays_in_its_object("image-space", around, false, 0.0f, 16.0f, 16, 6, 8);
    require_light_stays_in_its_object("image-space", camera, false, 0.0f, 16.0f, 16, 6, 8);
    require_light_stays_in_its_object("image-space", NULL, false, 0.0f, 16.0f, 16, 6, 8);
}

/* Bit-identical for any number of threads, and after other scenes: geometry, topology, materials, lights and camera may all change from
 * frame to frame. */
static void everything_may_change_from_frame_to_frame(void **state)
{
    static const char *const quick[] = { "views=eye+lights", "view-size=64", NULL }, *const plain[] = { NULL };

    (void) state;
    for (int form = 0; form < 2; form++) {
        const char *const *knobs = form ? quick : plain;
        struct shot first[4];
        struct stage moving;
        for (int k = 0; k < 4; k++) {
            struct stage s;
            object(&s, k, 32);
            if (k == 2)
                s.scene->materials[0].gaussians.variance[0] = 0.1;
            first[k] = stage_shot_of(&s, "image-space", knobs);
            stage_finish(&s);
        }
        stage_start_threads(&moving, 32, 32, 3);
        for (int round = 0; round < 2; round++)
            for (int k = 3; k >= 0; k--) {
                struct stage s;
                struct shot shot;
                object(&s, k, 32);
                if (k == 2)
                    s.scene->materials[0].gaussians.variance[0] = 0.1;
                stage_complete(&s);
                OK(pell_renderer_set_scene(moving.r, s.scene));
                moving.set = true;
                shot = stage_shot_of(&moving, "image-space", knobs);
                assert_true(shot_equal(&shot, &first[k]));
                OK(pell_renderer_set_scene(moving.r, NULL));
                shot_free(&shot);
                stage_finish(&s);
            }
        for (int k = 0; k < 4; k++)
            shot_free(&first[k]);
        stage_finish(&moving);
    }
}

/* A light among the objects, one behind the camera, one without power, a uniform environment: every result is valid. */
static void odd_lights_are_views_or_none(void **state)
{
    static const char *const quick[] = { "views=eye+lights", "view-size=48", NULL };
    struct stage s;
    struct shot shot;
    size_t m;

    (void) state;
    stage_start(&s, 24, 24);
    stage_medium(&s, "marble", &m);
    stage_ball(&s, m, 0, vec3(0, 0, 0), 6.0f, 24);
    stage_light(&s, PELL_LIGHT_POINT, vec3(0, 0, 0), vec3(0, 0, -1), 1e-3f); /* exactly in the middle */
    stage_light(&s, PELL_LIGHT_POINT, vec3(0, 6.5, 0), vec3(0, 0, 0), 1e-3f);
    stage_light(&s, PELL_LIGHT_RECT, vec3(60, 0, 200), vec3(0, 0, 0), 1.0f);
    stage_light(&s, PELL_LIGHT_DISC, vec3(0, 60, 0), vec3(0, 0, 0), 0.0f);
    stage_environment(&s, 0.1f);
    for (int i = 0; i < 6; i++)
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(50, (float) i, 10), vec3(0, 0, 0), 0.1f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.15f, 0.0f);
    shot = stage_shot_of(&s, "image-space", quick);
    shot_check(&shot);
    assert_non_null(strstr(s.kept.last_warning, "2 lights have no irradiance image"));
    REQUIRE(mean_of(&shot, NULL, NULL) > 0.0);
    shot_free(&shot);
    stage_finish(&s);
}

static void planes_alone_are_refused_with_views_of_lights(void **state)
{
    struct stage s;
    struct pell_frame_shape shape = { .width = 4, .height = 4, .stride = 4, .focal_px = 1.0f, .num_materials = 1 };
    const struct pell_frame_material material = { .medium = { .eta = 1.3 }, .gaussians = { .count = 1, .variance = { 1.0 } } };
    const struct pell_setting setting = { "views", "eye+lights", "test" };
    const struct pell_method *m;
    struct pell_pass *pass;
    void *values;

    (void) state;
    stage_start(&s, 4, 4);
    m = pell_method_find(s.ctx, "test", "image-space");
    values = calloc(1, m->knobs_size);
    OK(pell_method_configure(s.ctx, m, &setting, 1, values));
    shape.materials = &material;
    assert_int_equal(pell_pass_create(s.device, m, values, &shape, &pass), PELL_ERR_UNSUPPORTED);
    assert_null(pass);
    free(values);
    stage_finish(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(views_of_lights_close_the_gap_to_the_whole_surface),
        cmocka_unit_test(views_around_see_what_the_sky_lights),
        cmocka_unit_test(what_several_views_see_counts_once),
        cmocka_unit_test(light_stays_in_its_object),
        cmocka_unit_test(everything_may_change_from_frame_to_frame),
        cmocka_unit_test(odd_lights_are_views_or_none),
        cmocka_unit_test(planes_alone_are_refused_with_views_of_lights),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
