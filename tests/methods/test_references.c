/* SPDX-License-Identifier: MIT
 * test_references.c - the reference methods against closed forms and against each other, end to end: integration of entering light over
 * whole surfaces. */
#include "scenes.h"

#include "render/renderer.h"

#include <pellucid/gaussians.h>

/* Every reference of the registry that uses a diffusion profile, with knobs that are quick and accurate enough for the tests. */
struct reference {
    const char *name;
    const char *const *knobs;
    double standard_error; /* relative standard error requested by the knobs */
};

static const char *const fine[] = { "error=0.02", "density=16", NULL };
static const char *const both[] = { "error=0.02", "most=3000", NULL };
static const char *const probes[] = { "error=0.02", "most=3000", "sampling=probes", NULL };
static const struct reference references[] = { { "hierarchical", fine, 0.0 }, { "dipole", both, 0.02 }, { "dipole", probes, 0.02 } };

/* The standard error that the method states for a pixel of the image, in radiance; 0 where it states none. */
static double bar_at(const struct stage *s, size_t c, int x, int y)
{
    const float *standard_error[3];
    return pell_pass_standard_error(pell_renderer_pass(s->r), standard_error)
               ? (double) standard_error[c][y * s->image.stride + x] / PELL_PI
               : 0.0;
}

static bool inside(const struct shot *shot, int x, int y)
{
    for (int k = 0; k < 9; k++) {
        const int u = x + k % 3 - 1, v = y + k / 3 - 1;
        if (u < 0 || v < 0 || u >= shot->width || v >= shot->height || shot_at(shot, SHOT_A, u, v) < 1.0)
            return false;
    }
    return true;
}

/* --- Closed forms ----------------------------------------------------------------------------------------------------------------- */

/* On a ball the area within a chord r is pi r^2, so in a uniform environment every point receives the profile's light within the
 * diameter. */
static void ball_in_a_uniform_environment(void **state)
{
    static const double radii[] = { 2.0, 8.0, 30.0 };

    (void) state;
    for (size_t n = 0; n < PELL_COUNT(references); n++)
        for (size_t k = n == 2; k < (n == 2 ? 2 : PELL_COUNT(radii)); k++) { /* probe rays alone: one ball */
            const double radius = radii[k];
            double worst = 0.0, mean[3] = { 0 };
            int count = 0;
            struct stage s;
            struct shot shot;
            size_t m;

            stage_start(&s, 12, 12);
            stage_gaussians(&s, 1.0, &m);
            stage_ball(&s, m, 0, vec3(0, 0, 0), (float) radius, 96);
            stage_environment(&s, 1.0f);
            stage_camera(&s, vec3(0, 0, 300), vec3(0, 0, 0), 0.0f, (float) (2.2 * radius));
            shot = stage_shot_of(&s, references[n].name, references[n].knobs);
            for (int y = 0; y < 12; y++)
                for (int x = 0; x < 12; x++) {
                    count += inside(&shot, x, y);
                    for (size_t c = 0; inside(&shot, x, y) && c < 3; c++) {
                        const struct pell_gaussians *g = &s.scene->materials[m].gaussians;
                        double expected = 0.0, e;
                        for (int i = 0; i < 3; i++)
                            expected += g->weight[i][c] * (1.0 - exp(-4.0 * radius * radius / (2.0 * g->variance[i])));
                        e = shot_at(&shot, c, x, y) / expected;
                        mean[c] += e;
                        worst = fmax(worst, fabs(e - 1.0) - 5.0 * bar_at(&s, c, x, y) / expected);
                    }
                }
            print_message("# %s, ball of %g mm: mean %.5f %.5f %.5f of the closed form, worst pixel off by %.4f beyond 5 bars\n",
                          references[n].name, radius, mean[0] / count, mean[1] / count, mean[2] / count, worst);
            for (int c = 0; c < 3; c++)
                REQUIRE_NEAR(mean[c] / count, 1.0, 0.005 + 0.5 * references[n].standard_error);
            REQUIRE(worst < 0.015);
            shot_free(&shot);
            stage_finish(&s);
        }
}

/* A plane, lit right of an edge: each Gaussian gives an error function. */
static void step_of_light_on_a_plane(void **state)
{
    (void) state;
    for (size_t n = 0; n < PELL_COUNT(references); n++) {
        double worst = 0.0, square = 0.0;
        struct stage s;
        struct shot shot;
        size_t m, black;

        stage_start(&s, 48, 12);
        stage_gaussians(&s, 0.5, &m);
        stage_opaque(&s, 0.0f, &black);
        stage_box(&s, m, 0, vec3(-30, -30, -30), vec3(30, 30, 0));
        stage_box(&s, black, 1, vec3(-40, -40, 50), vec3(0, 40, 55));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 100), vec3(0, 0, 0), 3.0f);
        stage_camera(&s, vec3(0, 0, 20), vec3(0, 0, 0), 0.0f, 5.0f);
        shot = stage_shot_of(&s, references[n].name, references[n].knobs);
        for (int x = 0; x < 48; x++)
            for (size_t c = 0; c < 3; c++) {
                const struct pell_gaussians *g = &s.scene->materials[m].gaussians;
                const double at = (x + 0.5 - 24.0) * 5.0 / 12.0;
                double expected = 0.0, total = 0.0, e;
                for (int i = 0; i < 3; i++) {
                    expected += g->weight[i][c] * 0.5 * (1.0 + erf(at / sqrt(2.0 * g->variance[i])));
                    total += g->weight[i][c];
                }
                e = (shot_at(&shot, c, x, 6) * PELL_PI / 3.0 - expected) / total;
                worst = fmax(worst, fabs(e) - 5.0 * bar_at(&s, c, x, 6) * PELL_PI / 3.0 / total);
                square += e * e;
            }
        print_message("# %s, step of light: %.4f of the step at most (beyond 5 bars), %.4f root mean square\n", references[n].name, worst,
                      sqrt(square / (48 * 3)));
        REQUIRE(worst < 0.025);
        REQUIRE(sqrt(square / (48 * 3)) < 0.01 + references[n].standard_error);
        shot_free(&shot);
        stage_finish(&s);
    }
}

/* --- Against each other ------------------------------------------------------------------------------------------------------------- */

/* The lit side of an object a few mean free paths large, on black. `object` 0: ball, 1: sheet thinner than the mean free path. */
static void shaded_object(struct stage *s, int size, int threads, int object, size_t *material)
{
    stage_start_threads(s, size, size, threads);
    stage_medium(s, "marble", material);
    if (object == 0)
        stage_ball(s, *material, 0, vec3(0, 0, 0), 5.0f, 48);
    else
        stage_box(s, *material, 0, vec3(-6, -6, -1), vec3(6, 6, 0));
    stage_light(s, PELL_LIGHT_DIRECTIONAL, vec3(80, 30, object ? -60 : 60), vec3(0, 0, 0), 3.0f);
    stage_light(s, PELL_LIGHT_POINT, vec3(-20, 30, 40), vec3(0, 0, 0), 2e-3f);
    stage_camera(s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 8.0f);
}

/* Root mean square of the difference of two images, in units of the second one's standard errors with `slack` of its value added; mean
 * of the ratio. */
static double distance(const struct shot *a, const struct shot *b, const double *bars, double slack, double *ratio)
{
    double square = 0.0, sum_a = 0.0, sum_b = 0.0;
    int n = 0;

    for (int y = 0; y < a->height; y++)
        for (int x = 0; x < a->width; x++)
            for (size_t c = 0; inside(a, x, y) && c < 3; c++) {
                const double u = shot_at(a, c, x, y), v = shot_at(b, c, x, y);
                const double bar = bars[((size_t) y * (size_t) a->width + (size_t) x) * 3 + c];
                square += (u - v) * (u - v) / (bar * bar + slack * v * slack * v);
                sum_a += u;
                sum_b += v;
                n++;
            }
    REQUIRE(n > 0);
    *ratio = sum_a / sum_b;
    return sqrt(square / n);
}

/* Two sampling strategies and the octree are three estimators of one integral. */
static void all_ways_agree(void **state)
{
    static const char *const area[] = { "error=0.02", "most=8000", "sampling=area", NULL };
    static const char *const probe[] = { "error=0.02", "most=8000", "sampling=probes", NULL };
    static const char *const mixed[] = { "error=0.02", "most=8000", NULL };
    static const char *const *const knobs[] = { fine, area, probe, mixed };

    (void) state;
    for (int object = 0; object < 2; object++) {
        struct stage s;
        struct shot shot[4];
        const int size = 8;
        size_t m;

        shaded_object(&s, size, 2, object, &m);
        for (int k = 0; k < 4; k++) {
            double bars[300], ratio, rms;
            shot[k] = stage_shot_of(&s, k == 0 ? "hierarchical" : "dipole", knobs[k]);
            if (k == 0)
                continue;
            for (int i = 0; i < size * size * 3; i++)
                bars[i] = bar_at(&s, (size_t) (i % 3), i / 3 % size, i / 3 / size);
            rms = distance(&shot[0], &shot[k], bars, 0.01, &ratio);
            print_message("# object %d: hierarchical / dipole with %s: mean %.5f, difference %.3f standard errors\n", object,
                          knobs[k][2] ? knobs[k][2] : "both", ratio, rms);
            REQUIRE_NEAR(ratio, 1.0, 0.025); /* few pixels: noisy */
            REQUIRE(rms < 1.6);
        }
        for (int k = 0; k < 4; k++)
            shot_free(&shot[k]);
        stage_finish(&s);
    }
}

/* A scan of some 70,000 triangles, small compared with the diffuse mean free path and lit from two sides. */
static void the_bunny(void **state)
{
    static const char file[] = "/usr/share/glmark2/models/bunny.obj";
    static const char *const knobs[] = { "error=0.02", "most=6000", NULL };
    const struct pell_load_params params = { .size_mm = 20.0, .bare = true, .material = "wholemilk" };
    const int size = 10;
    struct stage s;
    struct pell_scene *scene;
    struct shot octree, sampled;
    double bars[300], ratio, rms;

    (void) state;
    if (access(file, R_OK) != 0) {
        print_message("# skipped: %s is not here\n", file);
        skip();
    }
    stage_start(&s, size, size);
    OK(pell_scene_load(s.ctx, file, &params, &scene));
    pell_scene_destroy(&s.scene);
    s.scene = scene;
    for (size_t i = 0; i < scene->num_materials; i++)
        scene->materials[i].rho_s = 0.0f;
    {
        const struct pell_vec3 middle = vec3_mul(vec3_add(vec3_load(scene->bounds_min), vec3_load(scene->bounds_max)), 0.5f);
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(80, 30, 60), vec3(0, 0, 0), 3.0f);
        stage_light(&s, PELL_LIGHT_POINT, vec3_add(middle, vec3(-20, 30, -40)), middle, 5e-3f);
        stage_camera(&s, vec3_add(middle, vec3(0, 0, 100)), middle, 0.0f, 18.0f);
    }
    octree = stage_shot_of(&s, "hierarchical", NULL);
    sampled = stage_shot_of(&s, "dipole", knobs);
    for (int i = 0; i < size * size * 3; i++)
        bars[i] = bar_at(&s, (size_t) (i % 3), i / 3 % size, i / 3 / size);
    rms = distance(&octree, &sampled, bars, 0.01, &ratio);
    print_message("# bunny of 20 mm: hierarchical / dipole: mean %.5f, difference %.3f standard errors\n", ratio, rms);
    REQUIRE_NEAR(ratio, 1.0, 0.015);
    REQUIRE(rms < 1.6);
    shot_free(&octree);
    shot_free(&sampled);
    stage_finish(&s);
}

/* Intersecting balls, much smaller than the distance that light travels: distant nodes of the octree have normals of all directions, and
 * a few samples represent each. The image is that of the sum over all samples. */
static void distant_balls_are_sampled(void **state)
{
    static const char *const plain[] = { "error=1e-6", NULL };
    struct shot shot[2];
    double square = 0.0, sum[2] = { 0.0 };

    (void) state;
    for (int exact = 0; exact < 2; exact++) {
        struct stage s;
        size_t material;
        stage_start(&s, 16, 16);
        stage_medium(&s, "wholemilk", &material);
        for (int i = 0; i < 5; i++)
            for (int k = 0; k < 5; k++)
                for (int l = 0; l < 3; l++)
                    stage_ball(&s, material, 0, vec3(1.9f * (float) (i - 2), 1.9f * (float) (k - 2), -1.9f * (float) l), 1.0f, 10);
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(80, 30, 60), vec3(0, 0, 0), 3.0f);
        stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 9.0f);
        s.settings.opposed = true;
        shot[exact] = stage_shot_of(&s, "hierarchical", exact ? plain : NULL);
        stage_finish(&s);
    }
    for (size_t c = 0; c < 3; c++)
        for (int i = 0; i < 16 * 16; i++) {
            const double a = shot_at(&shot[0], c, i % 16, i / 16), b = shot_at(&shot[1], c, i % 16, i / 16);
            square += (a - b) * (a - b) / (16 * 16 * 3);
            sum[0] += a / (16 * 16 * 3);
            sum[1] += b / (16 * 16 * 3);
        }
    print_message("# octree / all samples: mean %.5f, difference %.5f of the mean\n", sum[0] / sum[1], sqrt(square) / sum[1]);
    REQUIRE_NEAR(sum[0] / sum[1], 1.0, 0.006);
    REQUIRE(sqrt(square) / sum[1] < 0.0085);
    shot_free(&shot[0]);
    shot_free(&shot[1]);
}

/* Gaussians instead of the profile: on a ball in a uniform environment the light within the diameter is that of the fit, which differs
 * little from the dipole's. */
static void gaussians_in_the_profiles_place(void **state)
{
    static const int counts[] = { 1, 4, 8 };
    double before = INFINITY;

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(counts); k++) {
        const struct pell_fit_params params = { .count = counts[k] };
        char knob[32];
        const char *const knobs[] = { "error=0.02", knob, NULL };
        struct stage s;
        struct shot shot, itself;
        struct pell_gaussians g;
        double off = 0.0;
        size_t m;
        int count = 0;

        snprintf(knob, sizeof(knob), "gaussians=%d", counts[k]);
        stage_start(&s, 12, 12);
        stage_medium(&s, "marble", &m);
        stage_ball(&s, m, 0, vec3(0, 0, 0), 2.0f, 64);
        stage_environment(&s, 1.0f);
        stage_camera(&s, vec3(0, 0, 300), vec3(0, 0, 0), 0.0f, 4.4f);
        OK(pell_fit_medium(&s.scene->materials[m].medium, &params, &g, NULL));
        itself = stage_shot_of(&s, "hierarchical", fine);
        shot = stage_shot_of(&s, "hierarchical", knobs);
        for (int y = 0; y < 12; y++)
            for (int x = 0; x < 12; x++)
                for (size_t c = 0; inside(&shot, x, y) && c < 3; c++) {
                    double expected = 0.0;
                    for (int i = 0; i < g.count; i++)
                        expected += g.weight[i][c] * (1.0 - exp(-16.0 / (2.0 * g.variance[i])));
                    REQUIRE_REL(shot_at(&shot, c, x, y), expected, 0.02);
                    off += fabs(shot_at(&shot, c, x, y) / shot_at(&itself, c, x, y) - 1.0);
                    count++;
                }
        off /= count;
        print_message("# %d Gaussians: %.4f from the dipole itself\n", counts[k], off);
        REQUIRE(count > 100 && off < before);
        before = off;
        shot_free(&shot);
        shot_free(&itself);
        stage_finish(&s);
    }
    REQUIRE(before < 0.003);
}

/* The stated standard errors match the spread over seeds, and decrease with the root of the number of samples. */
static void error_bars_are_honest(void **state)
{
    static const char *const few[] = { "error=0.0001", "most=400", NULL }, *const many[] = { "error=0.0001", "most=6400", NULL };
    double said[2] = { 0 }, z2 = 0.0;
    int count = 0;
    struct stage s;
    struct shot truth, shot;
    const float *standard_error[3];
    size_t m;

    (void) state;
    shaded_object(&s, 8, 2, 0, &m);
    truth = stage_shot_of(&s, "dipole", many);
    for (int k = 0; k < 2; k++) {
        s.settings.seed = 17;
        shot = stage_shot_of(&s, "dipole", k ? many : few);
        assert_true(pell_pass_standard_error(pell_renderer_pass(s.r), standard_error));
        for (int y = 0; y < 8; y++)
            for (int x = 0; x < 8; x++)
                for (size_t c = 0; inside(&shot, x, y) && c < 3; c++) {
                    const double e = (double) standard_error[c][y * s.image.stride + x] / PELL_PI;
                    said[k] += e;
                    if (k == 0) {
                        const double z = (shot_at(&shot, c, x, y) - shot_at(&truth, c, x, y)) / e;
                        z2 += z * z;
                        count++;
                    }
                }
        shot_free(&shot);
    }
    print_message("# errors over error bars: %.3f root mean square; 16 times the samples: bars %.2f times smaller\n", sqrt(z2 / count),
                  said[0] / said[1]);
    REQUIRE(sqrt(z2 / count) > 0.6 && sqrt(z2 / count) < 1.6);
    REQUIRE(said[0] / said[1] > 3.2 && said[0] / said[1] < 5.0);
    shot_free(&truth);
    stage_finish(&s);
}

/* Light does not pass from one object to another, even where they touch; within one object it does. */
static void light_stays_in_its_object(void **state)
{
    (void) state;
    for (size_t n = 0; n < 2; n++)
        require_light_stays_in_its_object(references[n].name, references[n].knobs, false, -1.0f, 1.0f, 8, 4, 4);
}

/* After a change of the lights alone the image must not show the previous illumination. */
static void new_settings_light_anew(void **state)
{
    struct stage s;
    struct shot a, b, c;
    size_t m;

    (void) state;
    shaded_object(&s, 8, 2, 0, &m);
    stage_light(&s, PELL_LIGHT_RECT, vec3(-60, 0, 60), vec3(0, 0, 0), 3.0f);
    s.settings.light_samples = 1;
    a = stage_shot_of(&s, "hierarchical", fine);
    s.settings.light_samples = 64;
    b = stage_shot(&s);
    c = stage_shot_of(&s, "hierarchical", fine);
    assert_false(shot_equal(&a, &b));
    assert_true(shot_equal(&b, &c));
    shot_free(&a);
    shot_free(&b);
    shot_free(&c);
    stage_finish(&s);
}

static void planes_alone_are_refused(void **state)
{
    (void) state;
    for (size_t n = 0; n < 2; n++) {
        struct stage s;
        struct pell_frame_shape shape = { .width = 4, .height = 4, .stride = 4, .focal_px = 1.0f, .num_materials = 1 };
        const struct pell_frame_material material = { .medium = { .eta = 1.3 }, .gaussians = { .count = 1, .variance = { 1.0 } } };
        struct pell_pass *pass;

        stage_start(&s, 4, 4);
        shape.materials = &material;
        assert_int_equal(pell_pass_create(s.device, pell_method_find(s.ctx, "test", references[n].name), NULL, &shape, &pass),
                         PELL_ERR_UNSUPPORTED);
        assert_null(pass);
        assert_int_equal(s.kept.errors, 1);
        stage_finish(&s);
    }
}

static void survives_the_nth_allocation(void **state)
{
    (void) state;
    for (size_t n = 0; n < 2; n++) {
        bool done = false;
        for (uint64_t at = 1; !done; at = next_allocation(at)) {
            struct pell_alloc_fault fault = { 0 };
            struct stage s = { 0 };
            size_t m;
            const struct pell_device_params params = { .threads = 1, .engine = PELL_ENGINE_CPU };
            s.ctx = test_context(&fault, &s.kept);
            OK(pell_scene_create(s.ctx, &s.scene));
            OK(pell_device_create(s.ctx, &params, &s.device));
            OK(pell_renderer_create(s.device, &s.r));
            pell_knobs_default(pell_settings_knobs(), &s.settings);
            s.settings.width = s.settings.height = 4;
            s.settings.msaa = 1;
            stage_medium(&s, "marble", &m);
            stage_box(&s, m, 0, vec3(-1, -1, -1), vec3(1, 1, 1));
            stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 9), vec3(0, 0, 0), 3.0f);
            stage_camera(&s, vec3(0, 0, 9), vec3(0, 0, 0), 0.0f, 1.0f);
            stage_complete(&s);
            OK(pell_renderer_set_scene(s.r, s.scene));
            stage_method(&s, references[n].name, (const char *const[]) { n ? "most=128" : "points=64", NULL });
            fault.fail_at = fault.calls + at;
            switch (pell_renderer_render(s.r, &s.settings, &s.image)) {
            case PELL_OK: done = fault.calls < fault.fail_at; break;
            case PELL_ERR_NOMEM: break;
            default: fail_msg("allocation %d gave another error", (int) at);
            }
            stage_finish(&s);
            assert_int_equal(fault.live, 0);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(new_settings_light_anew),
        cmocka_unit_test(planes_alone_are_refused),
        cmocka_unit_test(survives_the_nth_allocation),
        cmocka_unit_test(light_stays_in_its_object),
    };
    /* Accurate numbers need many samples but run the same code: skipped under sanitizers, where they take minutes. */
    const struct CMUnitTest numbers[] = {
        cmocka_unit_test(ball_in_a_uniform_environment),
        cmocka_unit_test(step_of_light_on_a_plane),
        cmocka_unit_test(all_ways_agree),
        cmocka_unit_test(the_bunny),
        cmocka_unit_test(distant_balls_are_sampled),
        cmocka_unit_test(gaussians_in_the_profiles_place),
        cmocka_unit_test(error_bars_are_honest),
    };
    struct CMUnitTest all[PELL_COUNT(tests) + PELL_COUNT(numbers)];

    memcpy(all, tests, sizeof(tests));
    memcpy(all + PELL_COUNT(tests), numbers, sizeof(numbers));
    return _cmocka_run_group_tests("tests", all, SLOW ? PELL_COUNT(tests) : PELL_COUNT(all), NULL, NULL);
}
