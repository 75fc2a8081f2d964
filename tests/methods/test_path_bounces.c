/* SPDX-License-Identifier: MIT
 * test_path_bounces.c - the knob bounces of path-trace: interreflections between surfaces outside the media. Closed forms, the limit of
 * many bounces, agreement of all sampling techniques, and the render setting of the same name, which other methods have. Seeds are
 * fixed; statistical tests allow 3.5 standard errors. */
#include "path_trace_rig.h"

#include "slow.h"

#define FEWER(n) (SLOW ? (n) / 8 : (n))

/* Opaque surfaces are seen through a small clear cube with nearly the index of air, at `at`: the segment from the cube to them counts as
 * a bounce. */
static void add_window(struct stage *s, struct pell_vec3 at, float half)
{
    const struct pell_vec3 d = vec3(half, half, half);

    stage_box(s, rig_medium(s, 1.0, 0.1, 0.0, 1.3), 9, vec3_sub(at, d), vec3_add(at, d));
}

/* The same with negligible scattering, which the checks of a complete scene would refuse. */
static struct pt_scene *clear_scene(struct stage *s, const struct pt_knobs *knobs)
{
    stage_method(s, NULL, NULL);
    stage_render(s);
    for (size_t i = 0; i < s->scene->num_materials; i++) {
        s->scene->materials[i].medium.eta = 1.0005;
        for (int c = 0; c < 3; c++) {
            s->scene->materials[i].medium.sigma_s_reduced[c] = 1e-6;
            s->scene->materials[i].medium.sigma_a[c] = 1e-9;
        }
    }
    OK(pell_renderer_set_scene(s->r, s->scene));
    return rig_scene(s, knobs);
}

/* Radiance through the window at `at` along w. */
static struct pt_point through(struct pell_vec3 at, float half, struct pell_vec3 w)
{
    const float most = fmaxf(fabsf(w.x), fmaxf(fabsf(w.y), fabsf(w.z)));
    const struct pell_vec3 face = vec3_mad(at, -half / most, w);

    return rig_point(face, vec3_mad(face, -1.0f, w), 3);
}

static void require_mean(const char *name, double value, double error, double expected, double slack)
{
    print_message("# %s: %.5g +- %.2g, expected %.5g\n", name, value, error, expected);
    REQUIRE_NEAR(value, expected, SIGMAS * error + slack * fabs(expected) + 1e-6);
}

/* A light at the centre of a sphere of reflectance rho gives it a uniform irradiance E0; with n bounces its radiance is rho E0/pi (1 +
 * rho + ... + rho^n). */
static void an_integrating_sphere_sums_the_geometric_series(void **state)
{
    static const float rho[3] = { 0.2f, 0.5f, 0.9f };
    static const int bounces[] = { 0, 1, 2, 3, 9, 64, PT_BOUNCES_ALL };
    const struct pell_vec3 window = vec3(0, 0, 20), w = vec3_normalize(vec3(1.0f, 0.2f, 0.3f));
    struct pt_knobs knobs = rig_knobs();
    struct stage s;
    struct pt_scene *scene;
    size_t material;

    (void) state;
    stage_start_threads(&s, 8, 8, 1);
    memcpy(stage_opaque(&s, 1.0f, &material)->base_color, rho, sizeof(rho));
    stage_ball(&s, material, 0, vec3(0, 0, 0), 50.0f, 48);
    stage_light(&s, PELL_LIGHT_POINT, vec3(0, 0, 0), vec3(0, 0, 1), 1e-3f);
    add_window(&s, window, 0.2f);
    stage_camera(&s, vec3(-5, 0, 20), window, 0.5f, 0.0f);
    knobs.techniques = PT_LIGHT_SAMPLES;
    for (size_t k = 0; k < PELL_COUNT(bounces); k++) {
        const struct pt_point at = through(window, 0.2f, w);
        struct rig_mean r;
        knobs.bounces = bounces[k];
        scene = clear_scene(&s, &knobs);
        r = rig_measure(scene, &at, 0, FEWER(4000));
        for (int c = 0; c < 3; c++) {
            const double p = (double) rho[c], terms = bounces[k] < 0 ? 1.0 / (1.0 - p) : (1.0 - pow(p, bounces[k])) / (1.0 - p);
            const double first = p / PELL_PI * 1e-3 / (50e-3 * 50e-3);
            char name[64];
            snprintf(name, sizeof(name), "sphere of %.1f, %d bounces", p, bounces[k]);
            require_mean(name, r.mean[3][c], r.error[3][c], first * terms, 0.01);
        }
        pt_scene_destroy(&scene);
    }
    stage_finish(&s);
}

/* Form factor from a small square to a parallel square of side 2 a at the distance `h` over its middle (Howell, "A Catalog of Radiation
 * Heat Transfer Configuration Factors", B-3, four times). */
static double parallel_factor(double a, double h)
{
    const double x = a / h, r = sqrt(1.0 + x * x);
    return 4.0 / (2.0 * PELL_PI) * 2.0 * x / r * atan(x / r);
}

/* A light below illuminates a plate, which illuminates a small tile that faces up to it: zero with one bounce, which is used up by the
 * window. */
static void a_plate_lights_a_tile_that_faces_it(void **state)
{
    static const float heights[] = { 12.0f, 30.0f, 80.0f };
    const struct pell_vec3 window = vec3(0.3f, 0.0f, 2.0f);
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(heights); k++) {
        struct pt_knobs knobs = rig_knobs();
        struct stage s;
        size_t material;

        stage_start_threads(&s, 8, 8, 1);
        stage_opaque(&s, 0.8f, &material);
        shapes_quad(s.scene, material, vec3(0, 0, 0), vec3(1, 0, 0), vec3(0, 1, 0))->object = 0;
        shapes_quad(s.scene, material, vec3(0, 0, heights[k]), vec3(50, 0, 0), vec3(0, -50, 0))->object = 1;
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, -500), vec3(0, 0, 0), 2.0f);
        add_window(&s, window, 0.02f);
        stage_camera(&s, vec3(0, 0, 5), window, 0.5f, 0.0f);
        knobs.techniques = PT_LIGHT_SAMPLES;
        for (int bounces = 0; bounces < 5; bounces++) {
            const struct pt_point at = through(window, 0.02f, vec3_normalize(vec3_mul(window, -1.0f)));
            const double expected = bounces < 2 ? 0.0 : 0.8 * 0.8 * 2.0 * parallel_factor(50.0, (double) heights[k]) / PELL_PI;
            struct pt_scene *scene;
            struct rig_mean r;
            knobs.bounces = bounces;
            scene = clear_scene(&s, &knobs);
            r = rig_measure(scene, &at, 0, FEWER(4000));
            require_mean("plate", r.mean[3][1], r.error[3][1], expected, 0.003);
            pt_scene_destroy(&scene);
        }
        stage_finish(&s);
    }
}

/* Light that leaves a convex solid hits nothing: bit-identical images. */
static void convex_solids_do_not_see_themselves(void **state)
{
    static const int accelerations[] = { PT_ACCELERATION_NONE, PT_ACCELERATION_LANES, PT_ACCELERATION_GRID };
    (void) state;

    for (int rough = 0; rough < 2; rough++)
        for (size_t k = 0; k < PELL_COUNT(accelerations); k++) {
            struct pt_knobs knobs = rig_knobs();
            struct rig_mean r[2];
            struct stage s;

            stage_start_threads(&s, 8, 8, 1);
            stage_box(&s, rig_medium(&s, 2.0, 0.01, 0.3, 1.4), 0, vec3(-4, -4, -4), vec3(4, 4, 4));
            s.scene->materials[0].roughness = rough ? 0.5f : 0.0f;
            stage_light(&s, PELL_LIGHT_POINT, vec3(30, 20, 50), vec3(0, 0, 0), 1.0f);
            stage_environment(&s, 1.0f);
            stage_camera(&s, vec3(0, 0, 500), vec3(0, 0, 0), 0.0f, 9.0f);
            knobs.acceleration = accelerations[k];
            knobs.boundary = rough ? PT_BOUNDARY_ROUGH : PT_BOUNDARY_SMOOTH;
            for (int on = 0; on < 2; on++) {
                struct pt_scene *scene;
                const struct pt_point at = rig_point(vec3(1.0f, 0.7f, 4.0f), vec3(3, 2, 100), 5);
                knobs.bounces = on ? PT_BOUNCES_ALL : 0;
                scene = rig_scene(&s, &knobs);
                r[on] = rig_measure(scene, &at, 0, FEWER(400));
                pt_scene_destroy(&scene);
            }
            REQUIRE(r[0].mean[3][1] > 0.0);
            REQUIRE(memcmp(r[0].mean, r[1].mean, sizeof(r[0].mean)) == 0);
            stage_finish(&s);
        }
}

/* Two balls above a floor. */
static void crowded_stage(struct stage *s)
{
    size_t m, grey;

    stage_start_threads(s, 8, 8, 1);
    m = rig_medium(s, 2.0, 0.0, 0.0, 1.4);
    s->scene->materials[m].roughness = 0.0f;
    stage_ball(s, m, 0, vec3(0, 0, 0), 3.0f, 24);
    stage_ball(s, m, 1, vec3(5.0f, 0, 1.0f), 2.5f, 24);
    stage_opaque(s, 0.8f, &grey);
    stage_box(s, grey, 2, vec3(-20, -20, -4.5f), vec3(20, 20, -3.5f));
    stage_camera(s, vec3(0, 0, 500), vec3(0, 0, 0), 0.0f, 9.0f);
}

static struct rig_mean crowded(struct stage *s, int bounces, int acceleration, unsigned techniques, int samples)
{
    struct pt_knobs knobs = rig_knobs();
    const struct pt_point at = rig_point(vec3(2.0f, 0.1f, sqrtf(9.0f - 4.01f)), vec3(2.0f, 0.1f, 500), 7);
    struct pt_scene *scene;
    struct rig_mean r;

    knobs.bounces = bounces;
    knobs.acceleration = acceleration;
    knobs.techniques = techniques;
    scene = rig_scene(s, &knobs);
    r = rig_measure(scene, &at, 0, samples);
    pt_scene_destroy(&scene);
    return r;
}

/* Paths with fewer bounces are prefixes of paths with more: sums never decrease, and 64 bounces are converged. */
static void more_bounces_are_all_bounces(void **state)
{
    static const int bounces[] = { 0, 1, 2, 4, 8, 16, 64, PT_BOUNCES_ALL };
    struct rig_mean last = { 0 }, all;
    struct stage s;
    (void) state;

    crowded_stage(&s);
    stage_environment(&s, 1.0f);
    all = crowded(&s, PT_BOUNCES_ALL, PT_ACCELERATION_NONE, PT_HIT_LIGHTS, FEWER(2000));
    REQUIRE_NEAR(all.mean[0][1] + all.mean[1][1] + all.mean[2][1], all.mean[3][1], 1e-9);
    for (size_t k = 0; k < PELL_COUNT(bounces); k++) {
        const struct rig_mean r = crowded(&s, bounces[k], PT_ACCELERATION_NONE, PT_HIT_LIGHTS, FEWER(2000)),
                              lanes = crowded(&s, bounces[k], PT_ACCELERATION_LANES, PT_HIT_LIGHTS, FEWER(2000));
        print_message("# %d bounces: %.5g\n", bounces[k], r.mean[3][1]);
        REQUIRE(memcmp(r.mean, lanes.mean, sizeof(r.mean)) == 0);
        for (int part = 0; part < 3; part++)
            REQUIRE(r.mean[part][1] >= last.mean[part][1]);
        last = r;
        if (k == 0)
            REQUIRE(r.mean[3][1] < 0.97 * all.mean[3][1]);
    }
    REQUIRE_REL(last.mean[3][1], all.mean[3][1], 0.0);
    stage_finish(&s);
}

/* Lights all around equal an environment, for any number of bounces: refractive connections, light paths and specular manifolds find
 * the same light as paths that hit the environment at random. */
static void every_technique_counts_alike(void **state)
{
    static const int bounces[] = { 0, 1, 2 };
    const int lights = 64;
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(bounces); k++) {
        struct rig_mean found, by_chance;
        struct stage s;

        crowded_stage(&s);
        stage_environment(&s, 1.0f);
        by_chance = crowded(&s, bounces[k], PT_ACCELERATION_NONE, PT_HIT_LIGHTS, FEWER(20000));
        stage_finish(&s);
        crowded_stage(&s);
        for (int i = 0; i < lights; i++) {
            const double z = 1.0 - 2.0 * (i + 0.5) / lights, phi = 2.399963229728653 * i, sine = sqrt(1.0 - z * z);
            stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3((float) (sine * cos(phi)), (float) (sine * sin(phi)), (float) z), vec3(0, 0, 0),
                        (float) (4.0 * PELL_PI / lights));
        }
        found = crowded(&s, bounces[k], PT_ACCELERATION_NONE, PT_ALL, FEWER(6000));
        stage_finish(&s);
        for (int part = 0; part < 2; part++) {
            char name[64];
            snprintf(name, sizeof(name), "%d bounces, lights against the environment, part %d", bounces[k], part);
            require_mean(name, found.mean[part][1], hypot(found.error[part][1], by_chance.error[part][1]), by_chance.mean[part][1], 0.02);
        }
    }
}

/* A black floor mirrors a ball of milk above it: all of this is surface reflection, like the reflection of lights, at smooth and rough
 * boundaries. The floor's own diffuse light is the light that it receives and reflects. */
static void a_mirror_image_is_surface_reflection(void **state)
{
    (void) state;

    for (int rough = 0; rough < 2; rough++) {
        struct pt_knobs knobs = rig_knobs();
        const struct pt_point at = rig_point(vec3(0, 0, 0), vec3(40, 0, 40), 3);
        struct pt_scene *scene;
        struct rig_mean r;
        struct stage s;
        size_t milk, black;

        stage_start_threads(&s, 8, 8, 1);
        milk = rig_medium(&s, 2.0, 0.001, 0.0, 1.3);
        black = rig_medium(&s, 1e-4, 100.0, 0.0, 1.5);
        s.scene->materials[milk].roughness = 0.0f;
        s.scene->materials[black].roughness = rough ? 0.2f : 0.0f;
        stage_ball(&s, milk, 0, vec3(-12, 0, 12), 6.0f, 24);
        stage_box(&s, black, 1, vec3(-60, -60, -5), vec3(60, 60, 0));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(300, 0, 100), vec3(0, 0, 0), 1.0f);
        stage_camera(&s, vec3(0, 0, 500), vec3(0, 0, 0), 0.0f, 9.0f);
        knobs.boundary = rough ? PT_BOUNDARY_ROUGH : PT_BOUNDARY_SMOOTH;
        scene = rig_scene(&s, &knobs);
        r = rig_measure(scene, &at, 0, FEWER(2000));
        print_message("# multiple %.3g, single %.3g, surface %.3g\n", r.mean[0][1], r.mean[1][1], r.mean[2][1]);
        REQUIRE(r.mean[2][1] > 1e-3);
        REQUIRE(r.mean[0][1] + r.mean[1][1] < 1e-2 * r.mean[2][1]);
        pt_scene_destroy(&scene);
        stage_finish(&s);
    }
}

/* --- The render setting bounces ----------------------------------------------------------------------------------------------------- */

#define BOX_SIZE 24
#define BOX_FOV 0.9f

static void open_box(struct stage *s)
{
    size_t white, red;

    stage_start_threads(s, BOX_SIZE, BOX_SIZE, 2);
    stage_opaque(s, 0.8f, &white);
    stage_opaque(s, 0.2f, &red)->base_color[0] = 0.7f;
    shapes_quad(s->scene, white, vec3(0, -50, 0), vec3(50, 0, 0), vec3(0, 0, -50))->object = 0;
    shapes_quad(s->scene, white, vec3(0, 50, 0), vec3(50, 0, 0), vec3(0, 0, 50))->object = 1;
    shapes_quad(s->scene, white, vec3(0, 0, -50), vec3(50, 0, 0), vec3(0, 50, 0))->object = 2;
    shapes_quad(s->scene, red, vec3(-50, 0, 0), vec3(0, 0, -50), vec3(0, 50, 0))->object = 3;
    shapes_quad(s->scene, white, vec3(50, 0, 0), vec3(0, 0, 50), vec3(0, 50, 0))->object = 4;
    stage_light(s, PELL_LIGHT_POINT, vec3(10, 35, 5), vec3(0, 0, 0), 1.0f);
    stage_camera(s, vec3(0, 0, 160), vec3(0, 0, 0), BOX_FOV, 0.0f);
}

/* An opaque box: the radiance of its walls after n bounces equals that of path-trace through a window after n + 1, as the window uses
 * one. */
static void the_render_setting_means_the_same(void **state)
{
    static const int bounces[] = { 0, 1, 2, 8 };
    const struct pell_vec3 window = vec3(0, 0, 150);
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(bounces); k++) {
        double sum[2][3] = { { 0 } }, square[3] = { 0 };
        struct pt_knobs knobs = rig_knobs();
        struct pt_scene *scene;
        struct shot shot;
        struct stage s;

        open_box(&s);
        s.settings.layers = true;
        s.settings.bounces = bounces[k];
        shot = stage_shot_of(&s, "none", NULL);
        stage_finish(&s);
        open_box(&s);
        add_window(&s, window, 8.0f);
        knobs.techniques = PT_LIGHT_SAMPLES;
        knobs.bounces = bounces[k] + 1;
        scene = clear_scene(&s, &knobs);
        for (int y = 4; y < BOX_SIZE - 2; y += 5) /* no edge of the box is visible */
            for (int x = 3; x < BOX_SIZE - 2; x += 5) {
                const float t = tanf(0.5f * BOX_FOV), u = ((float) x + 0.5f) / BOX_SIZE * 2.0f - 1.0f,
                            v = 1.0f - ((float) y + 0.5f) / BOX_SIZE * 2.0f;
                const struct pell_vec3 w = vec3_normalize(vec3(u * t, v * t, -1.0f));
                struct pt_point at = rig_point(vec3_mad(vec3(0, 0, 160), -2.0f / w.z, w), vec3(0, 0, 160), (uint32_t) (y * BOX_SIZE + x));
                const struct rig_mean r = rig_measure(scene, &at, 0, FEWER(600));
                for (size_t c = 0; c < 3; c++) {
                    const double fast = shot_at(&shot, SHOT_IRRADIANCE + c, x, y) / PELL_PI;
                    sum[0][c] += fast;
                    sum[1][c] += r.mean[3][c];
                    square[c] += r.error[3][c] * r.error[3][c];
                    if (bounces[k] == 0)
                        REQUIRE_REL(r.mean[3][c], fast, 0.02);
                }
            }
        for (int c = 0; c < 3; c++) {
            char name[64];
            snprintf(name, sizeof(name), "box, %d bounces, channel %d, path-trace against the setting", bounces[k], c);
            require_mean(name, sum[1][c], sqrt(square[c]), sum[0][c], 0.015);
        }
        pt_scene_destroy(&scene);
        shot_free(&shot);
        stage_finish(&s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_integrating_sphere_sums_the_geometric_series),
        cmocka_unit_test(a_plate_lights_a_tile_that_faces_it),
        cmocka_unit_test(convex_solids_do_not_see_themselves),
        cmocka_unit_test(more_bounces_are_all_bounces),
        cmocka_unit_test(every_technique_counts_alike),
        cmocka_unit_test(a_mirror_image_is_surface_reflection),
        cmocka_unit_test(the_render_setting_means_the_same),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
