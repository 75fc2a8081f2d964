/* SPDX-License-Identifier: MIT
 * test_unscattered.c - light that passes a slab without scattering, against its closed form; and none where none can pass. */
#include "stage.h"

#include "render/unscattered/boundary.h"
#include "shared/sampling.h"
#include "slow.h"

enum { SIZE = 24, SMALL = 6, MIDDLE = 48 };

/* Extinction of a medium with little scattering, 1/mm. */
static const double absorbed[3] = { 0.05, 0.1, 0.2 }, scattered = 0.01;
static const double eta = 1.4;

/* Fresnel transmittance of unpolarised light from outside at the given cosine; *inside: the refracted cosine. */
static double passes(double c, double *inside)
{
    const double t = sqrt(1.0 - (1.0 - c * c) / (eta * eta)), s = (c - eta * t) / (c + eta * t), p = (t - eta * c) / (t + eta * c);

    *inside = t;
    return 1.0 - 0.5 * (s * s + p * p);
}

/* Radiance in the middle of the image for a slab in a uniform environment with unscattered light, and without; `overlapping`: it is made of
 * two objects that share a third of it. */
static void look(double thickness, bool overlapping, double tilt, double extinction, double shown[2][3], struct shot shots[2])
{
    struct stage s;
    struct pell_material *m;
    size_t material;

    stage_start(&s, SIZE, SIZE);
    s.settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
    m = stage_medium(&s, "marble", &material);
    m->medium = (struct pell_medium) { .eta = eta };
    for (int c = 0; c < 3; c++) {
        m->medium.sigma_a[c] = extinction * absorbed[c];
        m->medium.sigma_s_reduced[c] = extinction * scattered;
    }
    stage_box(&s, material, 0, vec3(-300, -300, (float) -thickness), vec3(300, 300, overlapping ? (float) (-thickness / 3.0) : 0.0f));
    if (overlapping)
        stage_box(&s, material, 1, vec3(-300, -300, (float) (-2.0 * thickness / 3.0)), vec3(300, 300, 0));
    stage_environment(&s, 1.0f);
    stage_camera(&s, vec3(0, (float) (400.0 * sin(tilt)), (float) (400.0 * cos(tilt))), vec3(0, 0, 0), 0.0f, 2.0f);
    stage_method(&s, "screen-space", NULL);
    for (int on = 0; on < 2; on++) {
        s.settings.unscattered = on;
        shots[on] = stage_shot(&s);
        shot_check(&shots[on]);
        for (size_t c = 0; c < 3; c++)
            shown[on][c] = shot_at(&shots[on], c, SIZE / 2, SIZE / 2);
    }
    stage_finish(&s);
}

/* T^2 exp(-sigma_t d / cos) times the radiance behind: the n^2 factors of refraction cancel. Internal reflections are left out, by the
 * stage and here. */
static void a_slab_shows_what_is_behind_it_as_its_closed_form(void **state)
{
    (void) state;
    for (int k = 0; k < 7; k++) {
        const double thickness = k % 2 ? 12.0 : 4.0, tilt = 0.4 * (k / 2 % 3);
        double shown[2][3], inside;
        const double passed = passes(cos(tilt), &inside);
        struct shot shots[2];

        look(thickness, k == 6, tilt, 1.0, shown, shots);
        for (int c = 0; c < 3; c++) {
            const double expected = passed * passed * exp(-(absorbed[c] + scattered) * thickness / inside);
            print_message("# %g mm, %.1f rad, channel %d: %.5f, %.5f expected\n", thickness, tilt, c, shown[1][c] - shown[0][c], expected);
            REQUIRE_REL(shown[1][c] - shown[0][c], expected, 0.005);
        }
        shot_free(&shots[0]);
        shot_free(&shots[1]);
    }
}

/* A clear ball with randomly perturbed normals, in front of a light: the transmitted radiance in the middle of the image. */
static void look_through_bumps(int samples, uint32_t seed, float *shown)
{
    enum { WIDE = 2 * MIDDLE };
    struct stage s;
    struct pell_material *m;
    struct pell_mesh *ball;
    size_t material;
    uint32_t number = 1;

    stage_start(&s, WIDE, WIDE);
    s.settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
    s.settings.msaa = samples;
    s.settings.seed = seed;
    m = stage_medium(&s, "marble", &material);
    m->medium = (struct pell_medium) { .eta = eta };
    for (int c = 0; c < 3; c++) {
        m->medium.sigma_a[c] = 0.005;
        m->medium.sigma_s_reduced[c] = 0.0005;
    }
    stage_ball(&s, material, 0, vec3(0, 0, 0), 30.0f, 120);
    ball = &s.scene->meshes[s.scene->num_meshes - 1];
    for (uint32_t i = 0; i < ball->num_vertices; i++) {
        struct pell_vec3 n = vec3_load(ball->normal + 3 * (size_t) i);
        n.x += 0.8f * pell_unit_float(pell_hash(number++)) - 0.4f;
        n.y += 0.8f * pell_unit_float(pell_hash(number++)) - 0.4f;
        vec3_store(vec3_normalize(n), ball->normal + 3 * (size_t) i);
    }
    stage_light(&s, PELL_LIGHT_RECT, vec3(20, 20, -150), vec3(0, 0, 0), 2e5f);
    stage_camera(&s, vec3(0, 0, 300), vec3(0, 0, 0), 0.0f, 80.0f);
    stage_method(&s, "screen-space", NULL);
    for (int on = 0; on < 2; on++) {
        struct shot shot;
        s.settings.unscattered = on;
        shot = stage_shot(&s);
        shot_check(&shot);
        for (int i = 0; i < MIDDLE * MIDDLE; i++) {
            const float here = (float) shot_at(&shot, SHOT_G, MIDDLE / 2 + i % MIDDLE, MIDDLE / 2 + i / MIDDLE);
            shown[i] = on ? here - shown[i] : here;
        }
        shot_free(&shot);
    }
    stage_finish(&s);
}

/* Randomly directed paths: pixels have the correct mean, and no light is lost. */
static void bumps_do_not_make_specks_of_a_lamp(void **state)
{
    static float one[MIDDLE * MIDDLE], many[MIDDLE * MIDDLE];
    double squares = 0.0, sum = 0.0, expected = 0.0, peaks;
    (void) state;

    look_through_bumps(1, 1, one);
    look_through_bumps(SLOW ? 2 : 16, 5, many);
    for (int i = 0; i < MIDDLE * MIDDLE; i++) {
        squares += (double) one[i] * (double) one[i];
        sum += (double) one[i];
        expected += (double) many[i];
    }
    peaks = squares * MIDDLE * MIDDLE / (sum * sum); /* with light 1 on all pixels, and 10 on a tenth of them */
    print_message("# peaks %.2f, all %.4g, of many samples %.4g\n", peaks, sum, expected);
    REQUIRE(peaks < 8.0); /* 12 for unmodified paths */
    REQUIRE_REL(sum, expected, SLOW ? 0.2 : 0.05);
}

/* Mean over the bundles against two separate lobes, by many slopes of the second. */
static void lobes_of_two_boundaries_have_their_density(void **state)
{
    enum { SLOPES = 20000 };
    static const float wide[] = { 0.1f, 0.06f, 0.03f }, offsets[] = { 0.5f, 1.0f, 1.5f, 2.0f, 3.0f, 5.0f };
    (void) state;

    for (size_t k = 0; k < PELL_COUNT(wide); k++)
        for (size_t i = 0; i < PELL_COUNT(offsets); i++) {
            const struct unscattered_lobe lobe = { .earlier = 0.1f, .last = wide[k] };
            const double x = (double) (offsets[i] * (0.1f + wide[k])), far = 1.0 + x * x;
            double found = 0.0, expected = 0.0, most = 0.0;
            for (uint32_t b = 0; b < UNSCATTERED_BUNDLES; b++) {
                float bundle[4][UNSCATTERED_BUNDLE];
                double one;
                unscattered_bundle_make(b, bundle);
                one = (double) unscattered_density(&lobe, (const float(*)[UNSCATTERED_BUNDLE]) bundle, (float) x, 0.0f);
                found += one / UNSCATTERED_BUNDLES;
                most = fmax(most, one);
            }
            for (int j = 0; j < SLOPES; j++) {
                const double u = (j + 0.5) / SLOPES, m = (double) wide[k] * sqrt(u / (1.0 - u)), turn = 2.399963 * j;
                const double dx = x - m * cos(turn), dy = m * sin(turn), d = 0.01 + dx * dx + dy * dy;
                expected += 0.01 / (d * d) / SLOPES / PELL_PI * far * sqrt(far);
            }
            print_message("# widths 0.1 and %g, at %g of both: %.3f of it, at most %.2f\n", (double) wide[k], (double) offsets[i],
                          found / expected, most / expected);
            REQUIRE_REL(found, expected, 0.06);
            REQUIRE(most < 2.5 * expected);
        }
}

/* Over a block of pixels: facets from a disc of slopes, uniformly, with the narrower lobe about each, against the whole lobe. */
static void drawn_facets_and_the_rest_are_the_whole_lobe(void **state)
{
    enum { SIDE = 32 };
    static const float offsets[] = { 0.0f, 0.5f, 1.0f };
    const float alpha = 0.1f;
    struct unscattered_lobe rest = { .last = alpha };
    const float none[4][UNSCATTERED_BUNDLE] = { 0 };
    double mean[2] = { 0.0 }, squares = 0.0, found[PELL_COUNT(offsets)] = { 0.0 };
    (void) state;

    unscattered_narrow(&rest);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        struct unscattered_random draw = { .x = SIDE + i % SIDE, .y = i / SIDE, .seed = 7 };
        const struct pell_vec3 f = unscattered_facet(&draw, alpha, vec3(0, 0, 1), vec3(0, 0, -1));
        const double x = (double) (f.x / f.z), y = (double) (f.y / f.z);
        REQUIRE_REL(vec3_length(f), 1.0, 1e-5);
        REQUIRE(hypot(x, y) < 1.001 * (double) (UNSCATTERED_DISC * alpha));
        mean[0] += x / (SIDE * SIDE);
        mean[1] += y / (SIDE * SIDE);
        squares += (x * x + y * y) / (SIDE * SIDE);
        for (size_t k = 0; k < PELL_COUNT(offsets); k++)
            found[k] += (double) unscattered_density(&rest, none, (float) x - offsets[k] * alpha, (float) y) / (SIDE * SIDE);
    }
    REQUIRE(hypot(mean[0], mean[1]) < 0.01 * (double) alpha);
    REQUIRE_REL(squares, 0.5 * (double) (UNSCATTERED_DISC * UNSCATTERED_DISC * alpha * alpha), 0.01);
    for (size_t k = 0; k < PELL_COUNT(offsets); k++) {
        const double m2 = (double) (offsets[k] * offsets[k]),
                     expected = 1.0 / (PELL_PI * (double) (alpha * alpha) * (1.0 + m2) * (1.0 + m2));
        print_message("# at %g: %.3f of it\n", (double) offsets[k], found[k] / expected);
        REQUIRE_REL(found[k], expected, k == 0 ? 0.02 : 0.15);
    }
}

/* Fraction of pixels' paths that leave a dense medium, by facets, against the area of the disc of slopes below the critical angle. */
static void ways_come_out_by_degrees_around_the_critical_angle(void **state)
{
    enum { SIDE = 32, SLOPES = 400 };
    const float n1 = 1.4f, n2 = 1.2f, roughness = 0.5f;
    const double slope = (double) (UNSCATTERED_DISC * roughness * roughness), critical = asin((double) (n2 / n1));
    const struct pell_unscattered_params p = { .smooth = false };
    (void) state;

    for (int k = -4; k <= 4; k++) {
        const double angle = critical + 0.05 * k, sine = sin(angle), cosine = cos(angle);
        double found = 0.0, expected = 0.0, all = 0.0;
        for (uint32_t i = 0; i < SIDE * SIDE; i++) {
            const struct unscattered_hit f = {
                .n = vec3(0, 0, 1), .ng = vec3(0, 0, 1), .boundary.roughness = roughness, .n1 = n1, .n2 = n2
            };
            struct unscattered_path w = { .direction = vec3((float) sine, 0, (float) -cosine), .weight = { 1, 1, 1 } };
            bool out;
            w.random = (struct unscattered_random) { .x = i % SIDE, .y = i / SIDE, .seed = 3 };
            out = unscattered_cross(&p, &f, &w);
            found += out ? 1.0 / (SIDE * SIDE) : 0.0;
            REQUIRE(out ? w.direction.z < 0.0f : w.direction.z > 0.0f);
            REQUIRE(w.lobe.sampled > 0.0f || out);
        }
        for (int i = 0; i < SLOPES * SLOPES; i++) {
            const double x = (2.0 * (i % SLOPES) + 1.0) / SLOPES - 1.0, y = (2.0 * (int) (i / SLOPES) + 1.0) / SLOPES - 1.0;
            const double c = (cosine - slope * x * sine) / sqrt(1.0 + slope * slope * (x * x + y * y));
            if (x * x + y * y > 1.0)
                continue;
            all++;
            expected += c > cos(critical) ? 1.0 : 0.0;
        }
        print_message("# %+.2f rad of the critical angle: %.3f come out, %.3f expected\n", 0.05 * k, found, expected / all);
        REQUIRE(fabs(found - expected / all) < 0.02);
    }
}

static void thick_parts_keep_their_bits(void **state)
{
    double shown[2][3];
    struct shot shots[2];
    (void) state;

    look(12.0, false, 0.0, 30.0, shown, shots);
    REQUIRE(shot_equal(&shots[0], &shots[1]));
    shot_free(&shots[0]);
    shot_free(&shots[1]);
}

/* Clear, with a phase function as peaked as apple juice's; white, like skimmed milk; and one that mostly absorbs. 1/mm. */
static const struct medium {
    double sigma_a, sigma_s_reduced, g;
} clear = { 0.05, 2.5e-4, 0.945 }, white = { 0.0015, 0.7, 0.82 }, dark = { 0.2, 0.02, 0.0 };

/* Radiance of a slab under uniform illumination of 1 W/(m^2 sr), averaged over its middle. */
static double uniform_light_of(const char *method, const char *const *knobs, const struct medium *of, float thickness)
{
    struct stage s;
    struct pell_material *m;
    struct shot shot;
    size_t material;
    double shown = 0.0;

    stage_start(&s, SIZE, SIZE);
    pell_knobs_default(pell_settings_knobs(), &s.settings);
    s.settings.width = s.settings.height = SMALL;
    s.settings.indirect_samples = 2048;
    s.settings.exposure = 1.0f;
    s.settings.boundary = PELL_BOUNDARY_MODEL_SMOOTH;
    m = stage_medium(&s, "marble", &material);
    m->medium = (struct pell_medium) { .eta = eta };
    for (int c = 0; c < 3; c++) {
        m->medium.sigma_a[c] = of->sigma_a;
        m->medium.sigma_s_reduced[c] = of->sigma_s_reduced;
        m->medium.g[c] = of->g;
    }
    stage_box(&s, material, 0, vec3(-80, -80, -thickness), vec3(80, 80, 0));
    stage_environment(&s, 1.0f);
    stage_camera(&s, vec3(0, 0, 400), vec3(0, 0, 0), 0.0f, 2.0f);
    stage_method(&s, method, knobs);
    shot = stage_shot(&s);
    shot_check(&shot);
    for (int i = 0; i < SMALL * SMALL; i++)
        shown += (double) shot_at(&shot, 0, i % SMALL, i / SMALL) / (SMALL * SMALL);
    print_message("# %s, %g mm: %.4f\n", method, (double) thickness, shown);
    shot_free(&shot);
    stage_finish(&s);
    return shown;
}

/* Each component of the light is counted once: scattered, forward-scattered, and unscattered. */
static void slabs_in_even_light_show_as_much_as_there_is(void **state)
{
    static const char *const methods[] = { "screen-space", "texture-space", "hierarchical", "dipole" };
    static const float thicknesses[] = { 1.0f, 12.0f };
    (void) state;
    RELEASE_ONLY();

    for (size_t k = 0; k < PELL_COUNT(methods); k++)
        for (size_t i = 0; i < PELL_COUNT(thicknesses); i++) {
            const double d = (double) thicknesses[i], most = exp(-clear.sigma_a * d);
            const double shown = uniform_light_of(methods[k], NULL, &clear, thicknesses[i]),
                         of_white = uniform_light_of(methods[k], NULL, &white, thicknesses[i]);
            REQUIRE(shown > 0.87 * most && shown < 1.06 * most);
            REQUIRE(of_white > 0.9 * exp(-white.sigma_a * d) && of_white < 1.06);
        }
}

/* Methods scale diffuse light up where it enters, for its single scattering in a half-space, which does not reach the far side: in a medium
 * of low albedo that is most of the light. */
static void single_scattering_of_diffuse_light_does_not_cross(void **state)
{
    static const char *const methods[] = { "screen-space", "texture-space", "hierarchical", "dipole" }, *const knobs[] = { "samples=64",
                                                                                                                           NULL };
    const float thickness = 5.0f;
    double expected;
    (void) state;
    RELEASE_ONLY();

    expected = uniform_light_of("path-trace", knobs, &dark, thickness);
    for (size_t k = 0; k < PELL_COUNT(methods); k++)
        REQUIRE_REL(uniform_light_of(methods[k], NULL, &dark, thickness), expected, 0.03);
}

/* The reference agrees at every thickness, including flights longer than split flights (walk.c). Internal reflections are 1 %. */
static void path_trace_lets_it_through_at_every_thickness(void **state)
{
    static const char *const knobs[] = { "samples=256", NULL };
    static const struct medium absorbs = { 1.0, 1e-6, 0.0 };
    double inside;
    const double passed = passes(1.0, &inside);
    (void) state;
    RELEASE_ONLY();

    for (float d = 1.0f; d < 4.6f; d += 0.7f) {
        const double expected = passed * passed * exp(-(double) d);
        REQUIRE_REL(uniform_light_of("path-trace", knobs, &absorbs, d), expected, d < 3.0f ? 0.04 : 0.3); /* the rest is noise */
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_slab_shows_what_is_behind_it_as_its_closed_form),
        cmocka_unit_test(slabs_in_even_light_show_as_much_as_there_is),
        cmocka_unit_test(single_scattering_of_diffuse_light_does_not_cross),
        cmocka_unit_test(path_trace_lets_it_through_at_every_thickness),
        cmocka_unit_test(bumps_do_not_make_specks_of_a_lamp),
        cmocka_unit_test(lobes_of_two_boundaries_have_their_density),
        cmocka_unit_test(thick_parts_keep_their_bits),
        cmocka_unit_test(drawn_facets_and_the_rest_are_the_whole_lobe),
        cmocka_unit_test(ways_come_out_by_degrees_around_the_critical_angle),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
