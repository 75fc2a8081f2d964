/* SPDX-License-Identifier: MIT
 * test_layered_refraction.c - layered with refraction=exact: a ball in closed form, a slab, and single-scatter. */
#include "stage.h"

#include <string.h>

#define SIGMA_S 0.8
#define SIGMA_T 1.0
#define G 0.5
#define ETA 1.4

static void give_layer(struct stage *s, double eta)
{
    struct pell_material *m = stage_medium(s, "marble", NULL);

    m->medium.eta = eta;
    m->layers = pell_calloc(s->ctx, 1, sizeof(*m->layers));
    assert_non_null(m->layers);
    m->num_layers = 1;
    m->substrate = PELL_SUBSTRATE_LAST;
    m->layers[0].name = pell_strdup(s->ctx, "layer");
    m->layers[0].medium.eta = eta;
    m->layers[0].depth = 1.0f;
    for (int c = 0; c < 3; c++) {
        m->layers[0].phase[c] = (struct pell_phase) { PELL_PHASE_HENYEY_GREENSTEIN, { G, 0.0 }, 0.0 };
        m->layers[0].medium.g[c] = G;
        m->layers[0].medium.sigma_s_reduced[c] = SIGMA_S * (1.0 - G);
        m->layers[0].medium.sigma_a[c] = SIGMA_T - SIGMA_S;
    }
}

static double mean_of(struct stage *s, const char *const *knobs)
{
    struct shot shot = stage_shot_of(s, "layered", knobs);
    double mean;

    mean = shot_mean_green(&shot);
    shot_free(&shot);
    return mean;
}

/* --- A ball --------------------------------------------------------------------------------------------------------------------- */

/* A light ray at distance b from the axis through the ball's centre to the light: entry point and refracted direction, in the axes (to
 * the light, perpendicular). */
struct inside {
    double k[2], direction[2], co, ci;
};

static struct inside enter(double radius, double b)
{
    const double so = b / radius, si = so / ETA;
    struct inside in = { .co = sqrt(fmax(1.0 - so * so, 0.0)), .ci = sqrt(1.0 - si * si) };
    const double n[2] = { in.co, so };

    for (int i = 0; i < 2; i++) {
        in.k[i] = radius * n[i];
        in.direction[i] = (i == 0 ? -1.0 : 0.0) / ETA + (in.co / ETA - in.ci) * n[i];
    }
    return in;
}

/* Signed distance of a point from the refracted ray. */
static double distance_from_ray(double radius, double b, const double at[2])
{
    const struct inside in = enter(radius, b);

    return (at[0] - in.k[0]) * in.direction[1] - (at[1] - in.k[1]) * in.direction[0];
}

/* Single scattering toward the camera at a point at height r on its axis, over all refracted rays that pass through the point; `angle`
 * between both axes. */
static double light_at(double radius, double r, double angle)
{
    enum { RAYS = 1500 };
    const double at[2] = { r * cos(angle), r * sin(angle) }, to_camera[2] = { cos(angle), sin(angle) };
    const struct pell_phase phase = { PELL_PHASE_HENYEY_GREENSTEIN, { G, 0.0 }, 0.0 };
    double sum = 0.0, before = distance_from_ray(radius, -radius, at);

    for (int i = 1; i <= RAYS; i++) {
        double low = radius * (2.0 * (i - 1) / RAYS - 1.0), high = radius * (2.0 * i / RAYS - 1.0),
               after = distance_from_ray(radius, high, at), far;
        struct inside in;
        const double end = after;
        if ((before < 0.0) == (after < 0.0)) {
            before = end;
            continue;
        }
        for (int k = 0; k < 40; k++) {
            const double middle = 0.5 * (low + high), d = distance_from_ray(radius, middle, at);
            if ((d < 0.0) == (before < 0.0))
                low = middle;
            else
                high = middle;
        }
        before = end;
        in = enter(radius, low);
        far = (at[0] - in.k[0]) * in.direction[0] + (at[1] - in.k[1]) * in.direction[1];
        if (far > 0.0 && in.co > 1e-9) { /* how refraction changes the area of a ring of light: around the axis, and along the radius */
            const double h = 1e-5 * radius, b = fmin(fmax(low, h - radius), radius - h);
            const double along = fabs(distance_from_ray(radius, b + h, at) - distance_from_ray(radius, b - h, at)) / (2.0 * h);
            const double spread = fabs(b) / fmax(fabs(at[1]), 1e-12) / along;
            sum += spread * (1.0 - pell_fresnel(ETA, in.co)) * exp(-SIGMA_T * far) *
                   pell_phase_value(&phase, -(in.direction[0] * to_camera[0] + in.direction[1] * to_camera[1]));
        }
    }
    return sum;
}

static double ball_closed_form(double radius, double angle)
{
    enum { STEPS = 400 };
    const double end = fmin(2.0 * radius, 12.0 / SIGMA_T);
    double sum = 0.0;

    for (int i = 0; i < STEPS; i++) {
        const double u = (i + 0.5) / STEPS, x = end * u * u; /* denser near the surface */
        sum += 2.0 * u * end / STEPS * exp(-SIGMA_T * x) * light_at(radius, radius - x, angle);
    }
    return sum * SIGMA_S * (1.0 - pell_fresnel(ETA, 1.0)) / (ETA * ETA);
}

/* The middle of a ball, with a light at an angle to the camera. */
static double ball_layered(double radius, double angle, const char *const *knobs)
{
    struct stage s;
    double mean;

    stage_start(&s, 4, 4);
    give_layer(&s, ETA);
    stage_ball(&s, 0, 0, vec3(0, 0, 0), (float) radius, 60);
    stage_light(&s, PELL_LIGHT_DIRECTIONAL, vec3(0.0f, (float) sin(angle), (float) cos(angle)), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 0.02f * (float) radius);
    mean = mean_of(&s, knobs);
    stage_finish(&s);
    return mean;
}

static void balls(void **state)
{
    static const double radii[] = { 10.0, 3.0, 1.0 }, degrees[] = { 20, 60, 85, 100, 140 };
    static const char *const kinds[][5] = { { "samples=40", "tolerance=0", NULL },
                                            { "samples=40", "tolerance=0", "light-path=rays", NULL },
                                            { "samples=40", "tolerance=0", "refraction=exact", NULL } };

    (void) state;
    for (size_t k = 0; k < PELL_COUNT(radii); k++)
        for (size_t a = 0; a < PELL_COUNT(degrees); a += SLOW ? 2 : 1) {
            const double angle = degrees[a] * PELL_PI / 180.0, expected = ball_closed_form(radii[k], angle);
            double error[3];
            for (int i = 0; i < 3; i++)
                error[i] = ball_layered(radii[k], angle, kinds[i]) / expected - 1.0;
            print_message("# radius %2.0f mm, light at %3.0f degrees: planes+rays %6.2f %%, rays %6.2f %%, exact %6.2f %% (%.3g)\n",
                          radii[k], degrees[a], 100.0 * error[0], 100.0 * error[1], 100.0 * error[2], expected);
            if (expected > 1e-3) { /* radiance; for the smallest ball, of the caustic on its far side */
                REQUIRE(fabs(error[2]) < (degrees[a] < 120 ? radii[k] < 2.0 ? 0.1 : 0.02 : 0.25));
                REQUIRE(fabs(error[2]) < fabs(error[0]));
            }
        }
}

/* --- Other solids --------------------------------------------------------------------------------------------------------------- */

/* A flat boundary focuses no light, for a direction and for a distant point. */
static void slab(void **state)
{
    static const char *const kinds[][4] = { { "samples=10", "tolerance=0", NULL }, { "samples=10", "tolerance=0", "refraction=exact" } };

    (void) state;
    for (int point_light = 0; point_light < 2; point_light++) {
        double mean[2];
        for (int k = 0; k < 2; k++) {
            const char *const knobs[] = { kinds[k][0], kinds[k][1], kinds[k][2], NULL };
            struct stage s;
            stage_start(&s, 4, 4);
            give_layer(&s, ETA);
            stage_box(&s, 0, 0, vec3(-300, -300, -80), vec3(300, 300, 0));
            stage_light(&s, point_light ? PELL_LIGHT_POINT : PELL_LIGHT_DIRECTIONAL, vec3(400, 200, 600), vec3(0, 0, 0), 1.0f);
            stage_camera(&s, vec3(-30, 0, 80), vec3(0, 0, 0), 0.0f, 4.0f);
            mean[k] = mean_of(&s, knobs);
            stage_finish(&s);
        }
        print_message("# slab under a %s: planar %.6g, exact %.6g\n", point_light ? "point" : "direction", mean[0], mean[1]);
        REQUIRE_REL(mean[1], mean[0], 2e-3);
    }
}

/* Radiance of translucent pixels. */
static double sum_of(const char *method, const char *const *knobs)
{
    struct shot shot;
    struct stage s;
    double sum = 0.0;

    stage_start(&s, 16, 16);
    give_layer(&s, ETA);
    stage_ball(&s, 0, 0, vec3(0, 0, 0), 3.0f, 40);
    stage_light(&s, PELL_LIGHT_POINT, vec3(20.0f, 8.0f, 25.0f), vec3(0, 0, 0), 1.0f);
    stage_camera(&s, vec3(0, 0, 100), vec3(0, 0, 0), 0.0f, 6.4f);
    shot = stage_shot_of(&s, method, knobs);
    for (int i = 0; i < 16 * 16; i++)
        sum += shot_at(&shot, SHOT_G, i % 16, i / 16);
    shot_free(&shot);
    stage_finish(&s);
    return sum;
}

static void beside_single_scatter(void **state)
{
    static const char *const truth[] = { "error=0.03", "most=1024", NULL }, *const planar[] = { "samples=20", NULL };
    static const char *const exact[] = { "samples=20", "refraction=exact", NULL };
    const double expected = sum_of("single-scatter", truth);
    const double by_planes = sum_of("layered", planar) / expected - 1.0, refracted = sum_of("layered", exact) / expected - 1.0;

    (void) state;
    print_message("# a ball of three free paths, against single-scatter: planar %.2f %%, exact %.2f %%\n", 100.0 * by_planes,
                  100.0 * refracted);
    REQUIRE(fabs(refracted) < 0.03 && fabs(refracted) < 0.3 * fabs(by_planes));
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(balls), cmocka_unit_test(slab), cmocka_unit_test(beside_single_scatter) };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
