/* SPDX-License-Identifier: MIT
 * test_light_sampling.c - light sampling: each light alone against closed forms, light samples against BSDF-like direction samples and
 * their MIS combination, and all lights against the irradiance stage. */
#include "lights_rig.h"

#include "image/color.h"
#include "lights/light_sampling.h"

#define SAMPLES 40000

/* Low-discrepancy points of a unit cube of 2 or 5 dimensions (an additive recurrence by powers of the root of x^(d+1) = x + 1), shifted
 * by `shift`. */
static void low_discrepancy(int dimensions, int i, double shift, double *u)
{
    const double g = dimensions == 2 ? 1.3247179572447460 : 1.1347241384015194;
    double p = 1.0;

    for (int k = 0; k < dimensions; k++) {
        double whole;
        p /= g;
        u[k] = modf(shift + 0.5 + p * (i + 1), &whole);
    }
}

/* Pseudo-random numbers (the mixer of Steele et al. 2014): a regular sequence would be correlated with the choice of the light. */
static void random_numbers(int dimensions, int i, double *u)
{
    for (int k = 0; k < dimensions; k++) {
        uint64_t x = ((uint64_t) i * 8 + (uint64_t) k + 1) * 0x9e3779b97f4a7c15u;
        x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9u;
        x = (x ^ x >> 27) * 0x94d049bb133111ebu;
        u[k] = (double) ((x ^ x >> 31) >> 11) * 0x1p-53;
    }
}

static struct pell_texture *image(struct rig *r, int width, int height, const float *rgb)
{
    struct pell_texture *t = NULL;
    const size_t size = 3 * sizeof(float) * (size_t) width * (size_t) height;

    OK(pell_scene_add_texture(r->scene, "picture", &t));
    t->image = (struct pell_image) { width, height, 3, PELL_PIXEL_F32, false, pell_alloc(r->ctx, size) };
    memcpy(t->image.pixels, rgb, size);
    return t;
}

/* Dark blue above, dim below, and one bright texel as a sun. */
static struct pell_texture *environment_picture(struct rig *r)
{
    float rgb[16 * 8 * 3];

    for (int i = 0; i < 16 * 8; i++) {
        rgb[3 * i] = i < 64 ? 0.1f + 0.01f * (float) (i % 16) : 0.0f;
        rgb[3 * i + 1] = i < 64 ? 0.2f : 0.02f;
        rgb[3 * i + 2] = i < 64 ? 0.4f : 0.01f;
    }
    rgb[3 * 37] = rgb[3 * 37 + 1] = rgb[3 * 37 + 2] = 60.0f;
    return image(r, 16, 8, rgb);
}

static struct pell_light_sampler *light_sampler_of(struct rig *r)
{
    struct pell_light_sampler *e;

    rig_bounds(r->scene);
    OK(pell_light_sampler_create(r->ctx, r->scene, &e));
    return e;
}

/* Contribution of a sample to the irradiance of a plane at p, divided by the density of the sample. */
static void contribution(const struct pell_light_sampler *e, const struct pell_light_sample *s, struct pell_vec3 p, struct pell_vec3 n,
                         double out[3], struct pell_vec3 *toward, double *per_sr)
{
    const struct pell_vec3 d = vec3_sub(s->at, p);
    const double d2 = (double) vec3_dot(d, d);
    float power[3];
    double w, cosine = 1.0;

    *toward = s->distant ? s->toward : vec3_normalize(d);
    pell_light_sampler_power_at(e, s, p, power);
    w = fmax(0.0, (double) vec3_dot(*toward, n));
    if (!s->delta && !s->distant)
        cosine = fmax(0.0, -(double) vec3_dot(*toward, s->normal));
    if (!s->distant)
        w *= cosine / d2;
    *per_sr = s->distant ? s->pdf : cosine > 0.0 ? s->pdf * d2 / cosine : 0.0;
    for (int c = 0; c < 3; c++)
        out[c] = w * (double) power[c] / s->pdf;
}

/* Irradiance of a plane by sampling lights (0), by sampling directions (1: area and environment lights only), or by both with the
 * balance heuristic (2). */
static void irradiance(const struct pell_light_sampler *e, struct pell_vec3 p, struct pell_vec3 n, int strategy, int samples, double out[3])
{
    struct pell_vec3 t, b;

    vec3_basis(n, &t, &b);
    out[0] = out[1] = out[2] = 0.0;
    for (int i = 0; i < samples; i++) {
        struct pell_light_sample s;
        struct pell_light_hit hit;
        struct pell_vec3 w;
        double u[5], one[3], density, r, c;

        if (pell_light_sampler_count(e) > 1)
            random_numbers(5, i, u);
        else
            low_discrepancy(5, i, 0.123, u);
        if (strategy != 1 && pell_light_sampler_sample(e, p, u, &s)) {
            REQUIRE_REL(pell_light_sampler_pdf(e, p, &s), s.pdf, 1e-3);
            contribution(e, &s, p, n, one, &w, &density);
            c = fmax(0.0, (double) vec3_dot(w, n)) / PELL_PI;
            for (int k = 0; k < 3; k++)
                out[k] += one[k] * (strategy == 2 && !s.delta && density > 0.0 ? density / (density + c) : 1.0);
        }
        if (strategy == 0)
            continue;
        r = sqrt(u[3]);
        c = sqrt(1.0 - u[3]);
        w = vec3_add(vec3_mul(n, (float) c),
                     vec3_add(vec3_mul(t, (float) (r * cos(2.0 * PELL_PI * u[4]))), vec3_mul(b, (float) (r * sin(2.0 * PELL_PI * u[4])))));
        for (int k = 0; pell_light_sampler_hit(e, p, p, w, INFINITY, k, &hit); k++) {
            const double facing = hit.sample.distant ? 1.0 : -(double) vec3_dot(w, hit.sample.normal);
            density = hit.sample.pdf * (hit.sample.distant ? 1.0 : hit.distance * hit.distance / facing);
            assert_false(hit.sample.delta);
            for (int j = 0; j < 3; j++)
                out[j] += PELL_PI * (double) hit.radiance[j] * (strategy == 2 ? c / PELL_PI / (c / PELL_PI + density) : 1.0);
        }
    }
    for (int c = 0; c < 3; c++)
        out[c] /= samples;
}

/* --- Closed forms ----------------------------------------------------------------------------------------------------------------- */

/* Each light alone, at a point of a plane: point light E = I cos/d^2; directional E cos; a rectangle by Lambert's polygon; a disc that
 * faces along the normal pi L R^2/(R^2 + h^2) on its axis; a constant environment pi L. */
static void lights_are_what_formulas_say(void **state)
{
    const struct pell_vec3 p = vec3(3, -2, 1), n = vec3(0, 0, 1);

    (void) state;
    for (int kind = 0; kind < 6; kind++) {
        struct rig r;
        struct pell_light_sampler *e;
        struct pell_light *l;
        double expected = 0.0, got[3];

        rig_start(&r, 4, 4);
        rig_plane(&r, rig_material(&r, true), 0, 0.0f, 50.0f);
        switch (kind) {
        case 0:
            rig_light(&r, PELL_LIGHT_POINT, vec3(3, 28, 41), vec3(0, 0, 0), 2.0f);
            expected = 2e6 / 2500.0 * 0.8;
            break;
        case 1: /* full power inside of the inner cone */
            rig_light(&r, PELL_LIGHT_SPOT, vec3(3, 28, 41), p, 2.0f);
            expected = 2e6 / 2500.0 * 0.8;
            break;
        case 2:
            rig_light(&r, PELL_LIGHT_DIRECTIONAL, vec3(0, 30, 40), vec3(0, 0, 0), 2.0f);
            expected = 1.6;
            break;
        case 3: {
            const struct pell_vec3 at = vec3(10, -20, 30);
            struct pell_vec3 right, corner[4];
            l = rig_light(&r, PELL_LIGHT_RECT, at, p, 2.0f);
            l->width = 10.0f;
            l->height = 25.0f;
            right = vec3_cross(vec3_load(l->direction), vec3_load(l->up));
            for (int k = 0; k < 4; k++)
                corner[k] = vec3_mad(vec3_mad(at, k == 1 || k == 2 ? 5.0f : -5.0f, right), k >= 2 ? 12.5f : -12.5f, vec3_load(l->up));
            expected = 2.0 * polygon_irradiance(p, n, corner, 4);
            break;
        }
        case 4:
            rig_light(&r, PELL_LIGHT_DISC, vec3(3, -2, 21), p, 2.0f)->radius = 15.0f;
            expected = 2.0 * PELL_PI * 225.0 / (225.0 + 400.0);
            break;
        default: rig_light(&r, PELL_LIGHT_ENVIRONMENT, p, n, 2.0f); expected = 2.0 * PELL_PI;
        }
        e = light_sampler_of(&r);
        assert_int_equal(pell_light_sampler_count(e), 1);
        for (int strategy = 0; strategy < 3; strategy++) {
            if (strategy == 1 && kind < 3)
                continue;
            irradiance(e, p, n, strategy, SAMPLES, got);
            print_message("# light %d, strategy %d: %.6g of the closed form\n", kind, strategy, got[0] / expected);
            REQUIRE_REL(got[0], expected, strategy == 1 ? 0.01 : kind < 3 ? 1e-5 : 3e-3);
            REQUIRE_REL(got[2], 0.25 * got[0], 1e-5);
        }
        pell_light_sampler_destroy(&e);
        rig_finish(&r);
    }
}

/* A scene of lights with all of their features, against the irradiance stage. */
static void light_samples_are_what_the_irradiance_stage_says(void **state)
{
    (void) state;
    for (int kind = 0; kind < 8; kind++) {
        struct rig r;
        struct pell_light_sampler *e;
        struct pell_light *l = NULL;
        double worst = 0.0, largest = 0.0;

        rig_start(&r, 12, 12);
        r.settings.light_samples = 1024;
        rig_plane(&r, rig_material(&r, true), 0, 0.0f, 100.0f);
        rig_camera(&r, 60.0f);
        switch (kind) {
        case 0:
            l = rig_light(&r, PELL_LIGHT_POINT, vec3(4, 8, 30), vec3(0, 1, 0), 1.0f);
            l->range = 40.0f;
            break;
        case 1:
            l = rig_light(&r, PELL_LIGHT_SPOT, vec3(4, 8, 30), vec3(0, 1, 0), 1.0f);
            l->range = 60.0f;
            break;
        case 2:
            l = rig_light(&r, PELL_LIGHT_DIRECTIONAL, vec3(0, 10, 40), vec3(0, 0, 0), 1.0f);
            l->width = 40.0f;
            l->height = 30.0f;
            break;
        case 3:
            l = rig_light(&r, PELL_LIGHT_RECT, vec3(30, 10, 20), vec3(0, 0, 0), 1.0f);
            l->width = 20.0f;
            l->height = 10.0f;
            break;
        case 4:
            l = rig_light(&r, PELL_LIGHT_DISC, vec3(-30, 10, 20), vec3(0, 0, 0), 1.0f);
            l->radius = 12.0f;
            break;
        case 5: /* half of the plane is behind it */
            l = rig_light(&r, PELL_LIGHT_RECT, vec3(0, 0, 15), vec3(10, 3, 15), 1.0f);
            l->width = l->height = 12.0f;
            break;
        default:
            l = rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 1.0f);
            l->rotate = kind == 6 ? 1.0f : -2.2f;
            l->image = environment_picture(&r);
        }
        if (kind < 3 || kind == 4) {
            float rgb[4 * 3 * 3];
            for (int i = 0; i < 36; i++)
                rgb[i] = 0.2f + 0.11f * (float) (i * 7 % 13);
            l->image = image(&r, 4, 3, rgb);
        }
        rig_render(&r);
        e = light_sampler_of(&r);
        for (int y = 0; y < 12; y++)
            for (int x = 0; x < 12; x++) {
                double got[3];
                irradiance(e, rig_point(&r, x, y), vec3(0, 0, 1), kind < 6 ? 0 : 2, kind < 3 ? 1 : 2000, got);
                for (int c = 0; c < 3; c++) {
                    const double says = (double) r.light.irradiance[c][rig_at(&r, x, y)];
                    worst = fmax(worst, fabs(got[c] - says));
                    largest = fmax(largest, says);
                }
            }
        print_message("# light %d: off by %.2g of the largest irradiance, %.4g\n", kind, worst / largest, largest);
        REQUIRE(largest > 0.0);
        REQUIRE(worst < (kind < 3 ? 1e-5 : 0.012) * largest);
        pell_light_sampler_destroy(&e);
        rig_finish(&r);
    }
}

/* --- Densities -------------------------------------------------------------------------------------------------------------------- */

static void many_lights(struct rig *r)
{
    struct pell_light *l;

    rig_start(r, 4, 4);
    rig_plane(r, rig_material(r, true), 0, 0.0f, 50.0f);
    rig_light(r, PELL_LIGHT_POINT, vec3(0, 40, 40), vec3(0, 0, 0), 1e-3f);
    l = rig_light(r, PELL_LIGHT_RECT, vec3(20, 0, 30), vec3(0, 0, 0), 3.0f);
    l->width = l->height = 15.0f;
    l = rig_light(r, PELL_LIGHT_DISC, vec3(25, 2, 45), vec3(0, 0, 0), 4.0f); /* partly occluded by the rectangle */
    l->radius = 10.0f;
    l = rig_light(r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 0.7f);
    l->image = environment_picture(r);
    rig_light(r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 0.05f);
}

static void both_ways_have_one_mean(void **state)
{
    const struct pell_vec3 p = vec3(3, -2, 0.5f), n = vec3_normalize(vec3(0.1f, 0.3f, 1));
    const struct pell_vec3 to_point = vec3_sub(vec3(0, 40, 40), p);
    const double d = (double) vec3_length(to_point), by_point = 1e3 / (d * d) * (double) vec3_dot(to_point, n) / d;
    struct rig r;
    struct pell_light_sampler *e;
    double sampled[3], hit_lights[3], both[3];

    (void) state;
    many_lights(&r);
    e = light_sampler_of(&r);
    assert_int_equal(pell_light_sampler_count(e), 4);
    irradiance(e, p, n, 0, 2 * SAMPLES, sampled);
    irradiance(e, p, n, 1, 4 * SAMPLES, hit_lights);
    irradiance(e, p, n, 2, 2 * SAMPLES, both);
    for (int c = 0; c < 3; c++) {
        hit_lights[c] += by_point * (c == 0 ? 1.0 : c == 1 ? 0.5 : 0.25);
        print_message("# channel %d: lights %.6g, directions %.6g, both %.6g\n", c, sampled[c], hit_lights[c], both[c]);
        REQUIRE_REL(hit_lights[c], both[c], 0.02);
        REQUIRE_REL(both[c], sampled[c], 0.01);
    }
    pell_light_sampler_destroy(&e);
    rig_finish(&r);
}

/* The density integrated over all directions is 1, and samples are distributed by it. */
static void an_environment_is_sampled_by_its_density(void **state)
{
    enum { ROWS = 8, COLUMNS = 16 };
    struct rig r;
    struct pell_light_sampler *e;
    struct pell_light *l;
    double expected_share[ROWS][COLUMNS] = { { 0 } }, total = 0.0, chi2 = 0.0, ratio_low = INFINITY, ratio_high = 0.0;
    int count[ROWS][COLUMNS] = { { 0 } }, bins = 0;
    const struct pell_vec3 p = vec3(0, 0, 0);

    (void) state;
    rig_start(&r, 4, 4);
    rig_plane(&r, rig_material(&r, true), 0, 0.0f, 50.0f);
    l = rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 1.0f);
    l->image = environment_picture(&r);
    l->rotate = 0.4f;
    e = light_sampler_of(&r);
    for (int y = 0; y < 400; y++)
        for (int x = 0; x < 800; x++) {
            const double height = 1.0 - 2.0 * (y + 0.5) / 400, azimuth = 2.0 * PELL_PI * (x + 0.5) / 800,
                         ring = sqrt(1.0 - height * height);
            const struct pell_vec3 w = vec3((float) (ring * sin(azimuth)), (float) height, (float) (-ring * cos(azimuth)));
            struct pell_light_hit hit;
            assert_true(pell_light_sampler_hit(e, p, p, w, INFINITY, 0, &hit));
            assert_false(pell_light_sampler_hit(e, p, p, w, INFINITY, 1, &hit));
            assert_true(hit.sample.distant && hit.distance == INFINITY);
            const double pdf = hit.sample.pdf;
            expected_share[y * ROWS / 400][x * COLUMNS / 800] += pdf * 4.0 * PELL_PI / (400 * 800);
            total += pdf * 4.0 * PELL_PI / (400 * 800);
            if (pdf > 0.0) {
                ratio_low = fmin(ratio_low, (double) pell_luminance(hit.radiance) / pdf);
                ratio_high = fmax(ratio_high, (double) pell_luminance(hit.radiance) / pdf);
            }
        }
    print_message("# density over the sphere: %.6f; radiance over density from %.4g to %.4g\n", total, ratio_low, ratio_high);
    REQUIRE_NEAR(total, 1.0, 2e-3);
    REQUIRE(ratio_high < 3.0 * ratio_low);
    for (int i = 0; i < SAMPLES; i++) {
        struct pell_light_sample s;
        double u[3], y;
        random_numbers(3, i, u);
        assert_true(pell_light_sampler_sample(e, p, u, &s));
        REQUIRE_NEAR((double) vec3_length(s.toward), 1.0, 1e-5);
        y = fmin(fmax((1.0 - (double) s.toward.y) / 2.0, 0.0), 0.999999);
        count[(int) (y * ROWS)][(int) (fmod(atan2((double) s.toward.x, -(double) s.toward.z) / (2.0 * PELL_PI) + 1.0, 1.0) * COLUMNS)]++;
    }
    for (int i = 0; i < ROWS * COLUMNS; i++) {
        const double expected = expected_share[i / COLUMNS][i % COLUMNS] / total * SAMPLES;
        if (expected < 5.0)
            continue;
        chi2 += pow(count[i / COLUMNS][i % COLUMNS] - expected, 2) / expected;
        bins++;
    }
    print_message("# chi^2 = %.1f over %d bins\n", chi2, bins);
    REQUIRE(bins > 20);
    REQUIRE(chi2 < bins + 4.0 * sqrt(2.0 * bins));
    pell_light_sampler_destroy(&e);
    rig_finish(&r);
}

/* A rectangle in front of a disc in front of the environment: a ray hits each in order, only from the front and within its range. */
static void lights_hide_nothing(void **state)
{
    const struct pell_vec3 p = vec3(0, 0, 0), up = vec3(0, 0, 1);
    struct rig r;
    struct pell_light_sampler *e;
    struct pell_light_hit hit;

    (void) state;
    rig_start(&r, 4, 4);
    rig_light(&r, PELL_LIGHT_DISC, vec3(0, 0, 20), p, 2.0f)->radius = 4.0f;
    rig_light(&r, PELL_LIGHT_RECT, vec3(1, 0, 10), vec3(1, 0, 0), 3.0f);
    r.scene->lights[1].width = r.scene->lights[1].height = 5.0f;
    rig_light(&r, PELL_LIGHT_ENVIRONMENT, p, up, 0.5f);
    e = light_sampler_of(&r);
    for (int k = 0; k < 3; k++) {
        assert_true(pell_light_sampler_hit(e, p, p, up, INFINITY, k, &hit));
        assert_true(hit.distance == (k == 0 ? 10.0 : k == 1 ? 20.0 : INFINITY));
        REQUIRE_REL(hit.radiance[0], k == 0 ? 3.0 : k == 1 ? 2.0 : 0.5, 1e-6);
    }
    assert_false(pell_light_sampler_hit(e, p, p, up, INFINITY, 3, &hit));
    assert_true(pell_light_sampler_hit(e, p, p, up, 12.0, 0, &hit));
    assert_false(pell_light_sampler_hit(e, p, p, up, 12.0, 1, &hit));
    assert_false(pell_light_sampler_hit(e, p, p, up, 9.0, 0, &hit));
    assert_true(pell_light_sampler_hit(e, p, vec3(0, 0, 30), vec3(0, 0, -1), INFINITY, 0, &hit));
    assert_true(hit.sample.distant); /* both backs */
    pell_light_sampler_destroy(&e);
    rig_finish(&r);
}

/* --- Emission sampling ------------------------------------------------------------------------------------------------------------- */

/* pi r^2 times the integral of the environment image over the sphere, by the texture look-up itself. */
static double environment_flux(struct rig *r, struct pell_vec3 centre)
{
    struct pell_light_sampler *e = light_sampler_of(r);
    double sum = 0.0;

    for (int i = 0; i < 200000; i++) {
        struct pell_light_hit hit;
        double u[2];
        low_discrepancy(2, i, 0.0, u);
        const double y = 1.0 - 2.0 * u[0], ring = sqrt(1.0 - y * y), azimuth = 2.0 * PELL_PI * u[1];
        const struct pell_vec3 w = vec3((float) (ring * cos(azimuth)), (float) y, (float) (ring * sin(azimuth)));
        assert_true(pell_light_sampler_hit(e, centre, centre, w, INFINITY, 0, &hit));
        sum += (double) hit.radiance[0] * 4.0 * PELL_PI / 200000.0 * PELL_PI * 36.0;
    }
    pell_light_sampler_destroy(&e);
    return sum;
}

/* Adds a light of a kind, and returns its flux into the sphere of radius 6 mm about `centre`, by a closed form where one exists. */
static double add_light_of_known_flux(struct rig *r, int kind, struct pell_vec3 centre)
{
    struct pell_light *l;
    double expected = 0.0;

    switch (kind) {
    case 0: /* I Omega */
        rig_light(r, PELL_LIGHT_POINT, vec3(1, 2, 13), centre, 2.0f);
        expected = 2e6 * 2.0 * PELL_PI * (1.0 - 0.8);
        break;
    case 1: /* inside: the whole flux */
        rig_light(r, PELL_LIGHT_POINT, vec3(1, 2, 4), centre, 2.0f);
        expected = 2e6 * 4.0 * PELL_PI;
        break;
    case 2: /* a cone narrower than the sphere; the smoothstep s^2 between contributes a third of its width */
    case 3:
        l = rig_light(r, PELL_LIGHT_SPOT, vec3(1, 2, 13), centre, 2.0f);
        l->cos_inner = kind == 2 ? 0.98f : 0.75f; /* a wider cone: the whole sphere has full intensity */
        l->cos_outer = kind == 2 ? 0.95f : 0.5f;
        expected = kind == 2 ? 2e6 * 2.0 * PELL_PI * (0.02 + 0.03 / 3.0) : 2e6 * 2.0 * PELL_PI * 0.2;
        break;
    case 4:
        rig_light(r, PELL_LIGHT_DIRECTIONAL, vec3(5, 5, 5), centre, 2.0f);
        expected = 2.0 * PELL_PI * 36.0;
        break;
    case 5: /* pi r^2 L Omega, Omega = 4 asin(ab / sqrt((a^2 + h^2)(b^2 + h^2))) of a rectangle 2a x 2b */
        l = rig_light(r, PELL_LIGHT_RECT, vec3(1, 2, 23), centre, 2.0f);
        l->width = 10.0f;
        l->height = 20.0f;
        expected = PELL_PI * 36.0 * 2.0 * 4.0 * asin(5.0 * 10.0 / sqrt((25.0 + 400.0) * (100.0 + 400.0)));
        break;
    case 6: /* nearby: cosine-weighted, and many samples miss */
        l = rig_light(r, PELL_LIGHT_DISC, vec3(1, 2, 10), centre, 2.0f);
        l->radius = 5.0f;
        expected = PELL_PI * 36.0 * 2.0 * 2.0 * PELL_PI * (1.0 - 7.0 / sqrt(25.0 + 49.0));
        break;
    case 7:
        rig_light(r, PELL_LIGHT_ENVIRONMENT, centre, vec3(0, 0, 0), 2.0f);
        expected = 4.0 * PELL_PI * PELL_PI * 36.0 * 2.0;
        break;
    default:
        rig_light(r, PELL_LIGHT_ENVIRONMENT, centre, vec3(0, 0, 0), 2.0f)->image = environment_picture(r);
        expected = environment_flux(r, centre);
    }
    return expected;
}

static void rays_of_lights_carry_the_flux(void **state)
{
    const struct pell_vec3 centre = vec3(1, 2, 3);
    const double radius = 6.0;

    (void) state;
    for (int kind = 0; kind < 9; kind++) {
        struct rig r;
        struct pell_light_sampler *e;
        double expected, sum[3] = { 0 };
        int missed = 0;

        rig_start(&r, 4, 4);
        rig_sphere(&r, rig_material(&r, true), 0, centre, 6.0f, 12);
        expected = add_light_of_known_flux(&r, kind, centre);
        e = light_sampler_of(&r);
        for (int i = 0; i < SAMPLES; i++) {
            struct pell_light_ray ray;
            struct pell_vec3 off;
            double u[5], along;
            low_discrepancy(5, i, 0.7, u);
            if (!pell_light_sampler_emit(e, centre, radius, u, &ray))
                continue;
            REQUIRE_NEAR((double) vec3_length(ray.direction), 1.0, 1e-5);
            REQUIRE(ray.pdf > 0.0 && isfinite(ray.pdf));
            off = vec3_sub(centre, ray.origin);
            along = (double) vec3_dot(off, ray.direction);
            off = vec3_mad(off, (float) -along, ray.direction);
            if ((kind != 1 && along < 0.0) || (double) vec3_length(off) > radius * 1.001) {
                missed++;
                continue;
            }
            if (ray.sample.distant)
                REQUIRE(along > 2.0 * radius);
            for (int c = 0; c < 3; c++)
                sum[c] += ray.weight[c] / SAMPLES;
        }
        print_message("# light %d: %.6f of the flux; %d of %d rays missed\n", kind, sum[0] / expected, missed, SAMPLES);
        REQUIRE_REL(sum[0], expected, kind == 6 ? 0.01 : 4e-3);
        REQUIRE(kind < 6 ? missed == 0 : missed < SAMPLES);
        if (kind != 8)
            REQUIRE_REL(sum[2], 0.25 * sum[0], 1e-5);
        pell_light_sampler_destroy(&e);
        rig_finish(&r);
    }
}

/* --- Hostile ---------------------------------------------------------------------------------------------------------------------- */

static void nothing_shines_and_nothing_breaks(void **state)
{
    const float wild[8] = { NAN, INFINITY, -INFINITY, -1.0f, 0.0f, 1e-30f, 1e30f, 1e15f };
    float rgb[6 * 3 * 3];
    struct rig r;
    struct pell_light_sampler *e;
    struct pell_light *l;
    struct pell_light_sample s;
    struct pell_light_hit hit;
    struct pell_light_ray ray;
    double u[5] = { 0.5, 0.5, 0.5, 0.5, 0.5 };
    float power[3];

    (void) state;
    rig_start(&r, 4, 4); /* no lights, no meshes */
    e = light_sampler_of(&r);
    assert_int_equal(pell_light_sampler_count(e), 0);
    assert_false(pell_light_sampler_sample(e, vec3(0, 0, 0), u, &s));
    assert_false(pell_light_sampler_hit(e, vec3(0, 0, 0), vec3(0, 0, 0), vec3(0, 0, 1), INFINITY, 0, &hit));
    assert_false(pell_light_sampler_emit(e, vec3(0, 0, 0), 1.0, u, &ray));
    pell_light_sampler_destroy(&e);
    pell_light_sampler_destroy(&e);

    /* Black lights count as no lights. */
    for (int k = 0; k < 6; k++)
        rig_light(&r, (enum pell_light_type) k, vec3(0, 0, 10), vec3(0, 0, 0), k % 2 ? 0.0f : -1.0f)->radius = 2.0f;
    for (int k = 0; k < 3; k++) {
        l = rig_light(&r, k == 1 ? PELL_LIGHT_DISC : PELL_LIGHT_RECT, vec3(0, 0, 10), vec3(0, 0, 0), 1.0f);
        l->width = k == 0 ? 0.0f : NAN; /* no area */
        l->radius = 0.0f;
    }
    rig_light(&r, PELL_LIGHT_POINT, vec3(NAN, 0, 10), vec3(0, 0, 0), 1.0f);
    l = rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 1.0f);
    memset(rgb, 0, sizeof(rgb));
    l->image = image(&r, 1, 1, rgb);
    e = light_sampler_of(&r);
    assert_int_equal(pell_light_sampler_count(e), 0);
    pell_light_sampler_destroy(&e);

    /* Extreme lights: no result is NaN. */
    for (int k = 0; k < 54; k++)
        rgb[k] = wild[k * 5 % 8];
    l = rig_light(&r, PELL_LIGHT_ENVIRONMENT, vec3(0, 0, 0), vec3(0, 0, 1), 1.0f);
    l->image = image(&r, 6, 3, rgb);
    rig_light(&r, PELL_LIGHT_POINT, vec3(0, 0, 0), vec3(0, 0, 1), 1e30f)->range = 1e-20f;
    rig_light(&r, PELL_LIGHT_SPOT, vec3(0, 0, 0), vec3(0, 0, 0), 1.0f)->cos_inner = 0.1f; /* below cos_outer, no direction */
    l = rig_light(&r, PELL_LIGHT_RECT, vec3(0, 0, 0), vec3(0, 0, 1), 1.0f);
    l->width = l->height = 1e-6f;
    l = rig_light(&r, PELL_LIGHT_DIRECTIONAL, vec3(0, 0, 0), vec3(0, 0, 1), 1.0f);
    l->image = r.scene->lights[r.scene->num_lights - 4].image;
    e = light_sampler_of(&r);
    print_message("# %zu lights left\n", pell_light_sampler_count(e));
    assert_true(pell_light_sampler_count(e) >= 4);
    for (int i = 0; i < 4000; i++) {
        const struct pell_vec3 at[4] = { vec3(0, 0, 0), vec3(1e-12f, 0, 0), vec3(3, 2, 1), vec3(1e9f, -1e9f, 1e9f) };
        low_discrepancy(5, i, 0.0, u);
        if (i < 32)
            for (int k = 0; k < 5; k++)
                u[k] = i >> k & 1 ? 1.0 - 1e-16 : 0.0;
        if (pell_light_sampler_sample(e, at[i % 4], u, &s)) {
            REQUIRE(s.pdf > 0.0);
            for (int k = 0; k < 4; k++) {
                pell_light_sampler_power_at(e, &s, at[k], power);
                for (int c = 0; c < 3; c++)
                    REQUIRE(power[c] >= 0.0f && !isnan(power[c]));
            }
            if (s.distant)
                for (int k = 0; pell_light_sampler_hit(e, at[1], at[2], s.toward, INFINITY, k, &hit); k++)
                    REQUIRE(hit.sample.pdf >= 0.0 && hit.radiance[0] >= 0.0f && !isnan(hit.radiance[0]));
        }
        if (pell_light_sampler_emit(e, at[i % 4], i % 3 ? 1e-3 : 100.0, u, &ray))
            REQUIRE(ray.pdf > 0.0 && ray.weight[0] >= 0.0 && ray.weight[1] >= 0.0 && ray.weight[2] >= 0.0 &&
                    !isnan(ray.weight[0] + ray.weight[1] + ray.weight[2]));
    }
    assert_false(pell_light_sampler_emit(e, vec3(0, 0, 0), 0.0, u, &ray));
    assert_false(pell_light_sampler_emit(e, vec3(0, 0, 0), (double) NAN, u, &ray));
    pell_light_sampler_destroy(&e);
    rig_finish(&r);
}

static void survives_the_nth_allocation(void **state)
{
    struct rig r;
    struct pell_alloc_fault fault = { 0 };
    struct pell_context *ctx = test_context(&fault, NULL);
    enum pell_result res = PELL_ERR_NOMEM;

    (void) state;
    many_lights(&r);
    rig_bounds(r.scene);
    for (uint64_t n = 1; res != PELL_OK; n++) {
        const int64_t live = fault.live;
        struct pell_light_sampler *e;
        fault.calls = 0;
        fault.fail_at = n;
        res = pell_light_sampler_create(ctx, r.scene, &e);
        fault.fail_at = 0;
        REQUIRE(res == PELL_OK || (res == PELL_ERR_NOMEM && !e));
        pell_light_sampler_destroy(&e);
        assert_true(fault.live == live);
    }
    pell_context_destroy(&ctx);
    rig_finish(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lights_are_what_formulas_say),
        cmocka_unit_test(light_samples_are_what_the_irradiance_stage_says),
        cmocka_unit_test(both_ways_have_one_mean),
        cmocka_unit_test(an_environment_is_sampled_by_its_density),
        cmocka_unit_test(lights_hide_nothing),
        cmocka_unit_test(rays_of_lights_carry_the_flux),
        cmocka_unit_test(nothing_shines_and_nothing_breaks),
        cmocka_unit_test(survives_the_nth_allocation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
