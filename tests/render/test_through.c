/* SPDX-License-Identifier: MIT
 * test_through.c - light that passes thin parts of media into their shadows, against closed forms. */
#include "stage.h"

enum { SIZE = 8 };

/* Extinction, 1/mm: absorption and little scattering. */
static const double absorbed[3] = { 0.05, 0.1, 0.2 }, scattered = 0.01;
static const double eta = 1.4;

/* Fresnel transmittance of unpolarised light from outside at the given cosine. */
static double passes(double c)
{
    const double t = sqrt(1.0 - (1.0 - c * c) / (eta * eta)), s = (c - eta * t) / (c + eta * t), p = (t - eta * c) / (t + eta * c);

    return 1.0 - 0.5 * (s * s + p * p);
}

enum caster {
    NOTHING,
    SLAB,
    BALL,
    TWO_SLABS,     /* with a gap */
    SLAB_IN_SLAB,  /* of the same object: no boundary */
    OVERLAPPING,   /* two slabs that share 2 mm */
    OPAQUE_BEHIND, /* above the slab */
    DENSE,
    PROFILE_ONLY,
    CASTERS
};

enum { THICK = 5 };

static void add_clear(struct stage *s, double density, size_t *material)
{
    struct pell_material *m = stage_medium(s, "marble", material);

    m->medium = (struct pell_medium) { .eta = eta };
    for (int c = 0; c < 3; c++) {
        m->medium.sigma_a[c] = density * absorbed[c];
        m->medium.sigma_s_reduced[c] = density * scattered;
    }
}

static void add_caster(struct stage *s, enum caster caster)
{
    size_t clear, wall;

    if (caster == PROFILE_ONLY)
        stage_gaussians(s, 1.0, &clear);
    else
        add_clear(s, caster == DENSE ? 100.0 : 1.0, &clear);
    if (caster == BALL)
        stage_ball(s, clear, 1, vec3(0, 0, 40), 15.0f, 200);
    else if (caster != NOTHING)
        stage_box(s, clear, 1, vec3(-60, -60, 20), vec3(60, 60, 20 + THICK));
    if (caster == TWO_SLABS)
        stage_box(s, clear, 2, vec3(-60, -60, 40), vec3(60, 60, 40 + THICK));
    if (caster == OVERLAPPING)
        stage_box(s, clear, 2, vec3(-60, -60, 18 + THICK), vec3(60, 60, 18 + 2 * THICK));
    if (caster == SLAB_IN_SLAB)
        stage_box(s, clear, 1, vec3(-50, -50, 21), vec3(50, 50, 23));
    if (caster == OPAQUE_BEHIND) {
        stage_opaque(s, 0.5f, &wall);
        stage_box(s, wall, 2, vec3(-60, -60, 40), vec3(60, 60, 41));
    }
}

/* Radiance of a white floor at the origin, in the shadow of the caster; light at an angle from above. */
static void light_below(enum caster caster, enum pell_light_type type, double angle, bool unscattered, double rgb[3])
{
    struct stage s;
    struct shot shot;
    size_t floor;

    stage_start(&s, SIZE, SIZE);
    s.settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
    s.settings.unscattered = unscattered;
    stage_opaque(&s, 1.0f, &floor);
    stage_box(&s, floor, 0, vec3(-300, -300, -10), vec3(300, 300, 0));
    add_caster(&s, caster);
    stage_light(&s, type, vec3((float) (5000.0 * sin(angle)), 0, (float) (5000.0 * cos(angle))), vec3(0, 0, 0),
                type == PELL_LIGHT_DIRECTIONAL ? 1.0f : 3e4f);
    stage_camera(&s, vec3(0, -250, 60), vec3(0, 0, 0), 0.002f, 0.0f);
    stage_method(&s, "screen-space", NULL);
    shot = stage_shot(&s);
    shot_check(&shot);
    for (size_t c = 0; c < 3; c++)
        rgb[c] = shot_at(&shot, c, SIZE / 2, SIZE / 2);
    shot_free(&shot);
    stage_finish(&s);
}

/* What the closed form lets through: two boundaries and a length of medium for each solid. */
static double expected_of(enum caster caster, double angle, int c)
{
    const double extinction = absorbed[c] + scattered, cosine = caster == BALL ? 1.0 : cos(angle);
    const double length = caster == BALL ? 30.0 : caster == TWO_SLABS ? 2.0 * THICK : caster == OVERLAPPING ? 2.0 * THICK - 2.0 : THICK;
    const double boundary = passes(cosine) * passes(cosine);

    if (caster == OPAQUE_BEHIND || caster == DENSE || caster == PROFILE_ONLY)
        return 0.0;
    return caster == NOTHING ? 1.0 : exp(-extinction * length / cosine) * (caster == TWO_SLABS ? boundary * boundary : boundary);
}

static void shadows_have_their_closed_forms(void **state)
{
    (void) state;
    for (int k = 0; k < 2; k++) {
        const double angle = 0.6 - 0.6 * k;
        double free[3];

        light_below(NOTHING, PELL_LIGHT_DIRECTIONAL, angle, true, free);
        for (int caster = SLAB; caster < CASTERS; caster++) {
            double rgb[3];
            if (caster == BALL && angle > 0.0)
                continue;
            light_below((enum caster) caster, PELL_LIGHT_DIRECTIONAL, angle, true, rgb);
            for (int c = 0; c < 3; c++) {
                const double expected = expected_of((enum caster) caster, angle, c);
                print_message("# caster %d at %.1f rad: %.5f, %.5f expected\n", caster, angle, rgb[c] / free[c], expected);
                REQUIRE(fabs(rgb[c] / free[c] - expected) < 2e-3 * expected + 1e-6);
            }
        }
    }
}

static void switched_off_they_are_black(void **state)
{
    double rgb[3];
    (void) state;

    light_below(SLAB, PELL_LIGHT_DIRECTIONAL, 0.3, false, rgb);
    REQUIRE(rgb[0] == 0.0 && rgb[1] == 0.0 && rgb[2] == 0.0);
}

/* Their shadows are shared by neighbouring pixels, which keeps what passes. */
static void area_lights_pass_the_same(void **state)
{
    double free[3], rgb[3];
    (void) state;

    light_below(NOTHING, PELL_LIGHT_RECT, 0.2, true, free);
    light_below(SLAB, PELL_LIGHT_RECT, 0.2, true, rgb);
    for (int c = 0; c < 3; c++)
        REQUIRE_REL(rgb[c] / free[c], expected_of(SLAB, 0.2, c), 0.005);
}

/* A floor below a wide slab in a uniform environment: the light of all directions, the mean of the channels. */
static void environments_pass_it_too(void **state)
{
    enum { COSINES = 2000 };
    double seen[2] = { 0.0 }, expected = 0.0;
    (void) state;

    for (int with = 0; with < 2; with++) {
        struct stage s;
        struct shot shot;
        size_t floor, clear;
        stage_start(&s, SIZE, SIZE);
        s.settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
        s.settings.unscattered = true;
        s.settings.ambient_samples = 256;
        stage_opaque(&s, 1.0f, &floor);
        stage_box(&s, floor, 0, vec3(-300, -300, -10), vec3(300, 300, 0));
        add_clear(&s, 1.0, &clear);
        if (with)
            stage_box(&s, clear, 1, vec3(-9000, -9000, 20), vec3(9000, 9000, 20 + THICK));
        stage_environment(&s, 1.0f);
        stage_camera(&s, vec3(0, -250, 15), vec3(0, 0, 0), 0.002f, 0.0f);
        stage_method(&s, "screen-space", NULL);
        shot = stage_shot(&s);
        shot_check(&shot);
        for (size_t c = 0; c < 3; c++)
            seen[with] += shot_at(&shot, c, SIZE / 2, SIZE / 2) / 3.0;
        shot_free(&shot);
        stage_finish(&s);
    }
    for (int i = 0; i < COSINES; i++)
        for (int c = 0; c < 3; c++) {
            const double cosine = (i + 0.5) / COSINES;
            expected += 2.0 * cosine * pow(passes(cosine), 2.0) * exp(-(absorbed[c] + scattered) * THICK / cosine) / (3.0 * COSINES);
        }
    print_message("# %.4f of the light, %.4f expected\n", seen[1] / seen[0], expected);
    REQUIRE_REL(seen[1] / seen[0], expected, 0.01);
}

/* Rays meet one of two faces in the same place: a warning names a material. */
static void faces_in_common_are_warned_of(void **state)
{
    static const float gap[] = { 0.0f, 0.5f, -0.5f };
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(gap); k++) {
        struct stage s;
        struct shot shot;
        size_t clear[2];
        stage_start(&s, SIZE, SIZE);
        s.settings.unscattered = true;
        add_clear(&s, 1.0, &clear[0]);
        add_clear(&s, 2.0, &clear[1]);
        stage_box(&s, clear[0], 0, vec3(-60, -60, 0), vec3(60, 60, THICK));
        stage_box(&s, clear[1], 1, vec3(-60, -60, THICK + gap[k]), vec3(60, 60, 2 * THICK));
        stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 100), vec3(0, 0, 0), 1.0f);
        stage_camera(&s, vec3(0, -250, 60), vec3(0, 0, 0), 0.2f, 0.0f);
        stage_method(&s, "screen-space", NULL);
        shot = stage_shot(&s);
        shot_free(&shot);
        REQUIRE(k == 0 ? s.kept.warnings > 0 : s.kept.warnings == 0);
        REQUIRE(k != 0 || strstr(s.kept.last_warning, "its faces coincide with those of another translucent object"));
        stage_finish(&s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shadows_have_their_closed_forms), cmocka_unit_test(switched_off_they_are_black),
        cmocka_unit_test(area_lights_pass_the_same),       cmocka_unit_test(environments_pass_it_too),
        cmocka_unit_test(faces_in_common_are_warned_of),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
