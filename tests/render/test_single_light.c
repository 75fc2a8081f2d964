/* SPDX-License-Identifier: MIT
 * test_single_light.c - single scattering rendered separately from the profile: in closed form on planes, counted exactly once in the
 * sum, and without any effect when switched off. */
#include "stage.h"

#include "math/vec.h"

#include <pellucid/inversion.h>

#define SIZE 16

/* Planes of a shot that has the layer, after the depth and the coverage. */
enum { SHOT_SINGLE = SHOT_TRANSLUCENT + 1 };

/* A wide plane of a medium under the stage's light, with default settings except indirect light; its radiance in the middle. */
static void start(struct stage *s, const char *medium, struct pell_vec3 from, struct pell_vec3 light)
{
    size_t material;

    stage_start(s, SIZE, SIZE);
    stage_medium(s, medium, &material)->rho_s = 1.0f;
    stage_box(s, material, 0, vec3(-2000, -2000, -400), vec3(2000, 2000, 0));
    if (vec3_length(light) > 0.0f)
        stage_light(s, PELL_LIGHT_DIRECTIONAL, light, vec3(0, 0, 0), 2.0f);
    else
        stage_environment(s, 1.0f);
    stage_camera(s, from, vec3(0, 0, 0), 0.0f, 20.0f);
    s->settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
    s->settings.profile = 1 + PELL_PROFILE_MONTE_CARLO;
    s->settings.angles = s->settings.curvature = s->settings.single_scattering = true;
    s->settings.layers = true;
}

static double middle(const struct shot *shot, int plane, int c)
{
    return (double) shot->data[(size_t) (plane + c) * shot->size + (size_t) (SIZE / 2 * SIZE + SIZE / 2)];
}

/* albedo p/(m_in + m_out) of the light that entered, for isotropic scattering: with the refraction of both directions in double
 * precision. */
static void a_plane_has_the_closed_form(void **state)
{
    static const struct pell_vec3 lights[] = { { 0, 0, 900 }, { 700, 0, 600 }, { -300, 800, 200 } },
                                  eyes[] = { { 0, 0, 900 }, { 500, 0, 700 }, { -800, 100, 300 } };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(lights); i++)
        for (size_t k = 0; k < PELL_COUNT(eyes); k++) {
            const double mi = (double) vec3_normalize(lights[i]).z, mo = (double) vec3_normalize(eyes[k]).z;
            struct pell_medium m;
            struct stage s;
            struct shot shot;
            double eta, in, out;

            start(&s, "skin1", eyes[k], lights[i]);
            m = s.scene->materials[0].medium;
            eta = (double) m.eta;
            shot = stage_shot_of(&s, "screen-space", NULL);
            in = sqrt(1.0 - (1.0 - mi * mi) / (eta * eta));
            out = sqrt(1.0 - (1.0 - mo * mo) / (eta * eta));
            for (int c = 0; c < 3; c++) {
                const double albedo = m.sigma_s_reduced[c] / (m.sigma_s_reduced[c] + m.sigma_a[c]);
                const double want = 2.0 * mi * (1.0 - pell_fresnel(eta, mi)) * (1.0 - pell_fresnel(eta, mo)) / (eta * eta) * albedo /
                                    (4.0 * PELL_PI * (in + out));
                REQUIRE_REL(middle(&shot, SHOT_SINGLE, c), want, 2e-3);
            }
            shot_free(&shot);
            stage_finish(&s);
        }
}

/* Of diffuse light, which has no direction, nothing is separated; for light at normal incidence the flux of both components is the
 * profile's. */
static void light_is_counted_exactly_once(void **state)
{
    static const char *const media[] = { "skin1", "marble", "wholemilk" };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(media); i++)
        for (int diffuse = 0; diffuse < 2; diffuse++) {
            struct shot shot[2];
            struct stage s;
            struct pell_medium m;

            start(&s, media[i], vec3(0, 0, 900), diffuse ? vec3(0, 0, 0) : vec3(0, 0, 900));
            s.settings.environment_lights = 0;
            s.settings.angles = false;
            m = s.scene->materials[0].medium;
            for (int on = 0; on < 2; on++) {
                s.settings.single_scattering = on;
                shot[on] = stage_shot_of(&s, "screen-space", NULL);
            }
            for (int c = 0; c < 3; c++) {
                const double eta = (double) m.eta, reduced = m.sigma_s_reduced[c] / (m.sigma_s_reduced[c] + m.sigma_a[c]);
                const double entered = 2.0 * (1.0 - pell_fresnel(eta, 1.0)), once = pell_albedo_of_reduced(reduced, m.g[c]);
                const double single_fraction = once * pell_single_scattering_albedo_at(m.g[c], eta, 1.0);
                /* Without directional profiles the exiting light is distributed by T/(pi n), n the mean of T. */
                const double leaves =
                    (1.0 - pell_fresnel(eta, 1.0)) / (PELL_PI * (1.0 - pell_fresnel_diffuse(1.0 / eta, PELL_FRESNEL_EXACT)));
                const double all = middle(&shot[0], SHOT_MULTIPLE, c), rest = middle(&shot[1], SHOT_MULTIPLE, c);
                REQUIRE_REL(diffuse ? rest : rest + entered * single_fraction * leaves, all, 1e-2);
                REQUIRE(diffuse ? middle(&shot[1], SHOT_SINGLE, c) == 0.0 : middle(&shot[1], SHOT_SINGLE, c) > 0.0);
            }
            shot_free(&shot[0]);
            shot_free(&shot[1]);
            stage_finish(&s);
        }
}

/* Methods that blur a shaded image, profiles without coefficients and textured colours keep one profile. */
static void what_has_no_part_apart_keeps_its_bits(void **state)
{
    (void) state;
    for (int kind = 0; kind < 3; kind++) {
        struct shot shot[2];
        struct stage s;

        start(&s, "skin1", vec3(300, 0, 900), vec3(500, 0, 700));
        if (kind == 1)
            s.settings.profile = 1 + PELL_PROFILE_DIPOLE;
        if (kind == 2)
            s.scene->materials[0].color_from = PELL_COLOR_FROM_TEXTURE;
        for (int on = 0; on < 2; on++) {
            s.settings.single_scattering = on;
            shot[on] = stage_shot_of(&s, kind == 0 ? "none" : "screen-space", NULL);
        }
        assert_int_equal(shot[0].planes, shot[1].planes);
        assert_memory_equal(shot[0].data, shot[1].data, shot[0].planes * shot[0].size * sizeof(float));
        shot_free(&shot[0]);
        shot_free(&shot[1]);
        stage_finish(&s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_plane_has_the_closed_form),
        cmocka_unit_test(light_is_counted_exactly_once),
        cmocka_unit_test(what_has_no_part_apart_keeps_its_bits),
    };
    return cmocka_run_group_tests_name("render.single-light", tests, NULL, NULL);
}
