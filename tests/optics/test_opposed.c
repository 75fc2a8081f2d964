/* SPDX-License-Identifier: MIT
 * test_opposed.c - diffusion between faces at an angle: slabs by transport, an edge by the method of images, balls by the series of
 * exact diffusion, and cases that must stay unchanged. */
#include "pell_test.h"

#include "math/vec.h"
#include "optics/medium/opposed.h"

static struct pell_medium medium_of(double sigma_a, double sigma_s_reduced, double eta)
{
    struct pell_medium m = { .eta = eta };

    for (int c = 0; c < 3; c++) {
        m.sigma_a[c] = sigma_a;
        m.sigma_s_reduced[c] = sigma_s_reduced;
    }
    return m;
}

/* skin1's R, G, B and marble's R (Jensen et al. 2001), whole milk's R. */
static const double media[][3] = {
    { 0.032, 0.74, 1.3 }, { 0.17, 0.88, 1.3 }, { 0.48, 1.01, 1.3 }, { 0.0021, 2.19, 1.5 }, { 0.0011, 2.55, 1.3 },
};

/* The light that arrives at one face of a slab from the other equals T, where the slab is thick enough for one exponential. */
static void slabs_transmit_what_transport_says(void **state)
{
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(media); i++)
        for (double deep = 8.0; deep < 20.0; deep *= 1.5) { /* mean free paths */
            const struct pell_medium m = medium_of(media[i][0], media[i][1], media[i][2]);
            const double d = deep / (media[i][0] + media[i][1]);
            struct pell_opposed o;
            struct pell_slab slab;
            double sum = 0.0, T;
            REQUIRE(pell_opposed_make(&m, &o) && pell_slab_make(&m, 0, &slab));
            T = pell_slab_at(&slab, d).transmitted;
            for (int k = 0; k < 4000; k++) {
                const double r = 10.0 * d * (k + 0.5) / 4000;
                const struct pell_opposed_pair pair = { (float) (d * d + r * r), (float) -d, (float) d, -1.0f, 0.0f };
                float through[3];
                REQUIRE(pell_opposed_split(&o, &pair, through) == 0.0f);
                sum += 2.0 * PELL_PI * r * (double) through[0] * 10.0 * d / 4000;
            }
            REQUIRE_REL(pell_opposed_slab(&o, 0, d), sum, 0.02);
            print_message("# medium %zu, %.1f mean free paths: %.4f of T\n", i, deep, sum / T);
            REQUIRE_REL(sum, T, i == 2 ? 0.2 : 0.05); /* skin1's blue absorbs a third at each collision */
        }
}

/* As scattering decreases, the source decreases: the fraction that similarity counts as unscattered is no source. */
static void the_source_is_in_proportion_to_what_is_scattered(void **state)
{
    double before = 0.0;
    (void) state;

    for (double albedo = 0.08; albedo > 0.004; albedo *= 0.5) {
        struct pell_medium m = medium_of(1.0 - albedo, albedo, 1.33);
        struct pell_opposed o;
        m.g[0] = m.g[1] = m.g[2] = 0.9;
        REQUIRE(pell_opposed_make(&m, &o));
        if (before > 0.0)
            REQUIRE_REL((double) o.amount[0] / albedo, before, 0.1);
        before = (double) o.amount[0] / albedo;
    }
}

/* (1 + s) exp(-s)/(4 pi d^3) times the component of `to` - `from` along x. */
static double flux(double k, const double from[2], const double to[2])
{
    const double x = to[0] - from[0], y = to[1] - from[1], d = sqrt(x * x + y * y);

    return x * (1.0 + k * d) * exp(-k * d) / (4.0 * PELL_PI * d * d * d);
}

/* Two faces at right angles, y <= 0 and x <= 0 inside: a source below one face, its image, and the images of both in the other face. */
static void an_edge_of_right_angles_has_four_images(void **state)
{
    const struct pell_opposed o = { { 0.4f, 0.4f, 0.4f }, { 1.5f, 1.5f, 1.5f }, { 1.0f, 1.0f, 1.0f }, { 0.7f, 0.7f, 0.7f } };
    (void) state;

    for (double enter = 4.0; enter < 20.0; enter += 3.0)
        for (double leave = 8.0; leave < 20.0; leave += 3.0) {
            const double at[2] = { 1.5, -leave }, below[2] = { -enter, -1.0 }, above[2] = { -enter, 4.0 };
            const double image_below[2] = { 3.0 + enter, -1.0 }, image_above[2] = { 3.0 + enter, 4.0 };
            const double exact =
                0.7 * (flux(0.4, below, at) - flux(0.4, above, at) - flux(0.4, image_below, at) + flux(0.4, image_above, at));
            const struct pell_opposed_pair pair = { (float) (enter * enter + leave * leave), (float) -leave, (float) enter, 0.0f, 0.0f };
            float through[3];
            REQUIRE(pell_opposed_split(&o, &pair, through) == 0.0f);
            for (int c = 0; c < 3; c++)
                REQUIRE_REL((double) through[c], exact, 0.03);
        }
}

enum { ORDERS = 1200 };

/* Quotients i_{l + 1}/i_l of modified spherical Bessel functions, by their recurrence from above. */
static void quotients(double x, double *q)
{
    double at = x / (2.0 * (ORDERS + 60) + 3.0);

    for (int l = ORDERS + 59; l > 0; l--) {
        at = 1.0 / (at + (2 * l + 1) / x);
        if (l <= ORDERS)
            q[l - 1] = at;
    }
}

/* Flux through a ball of radius 1 at the angle from a source at `depth` below it, fluence 0 on it:
 * Sum (2 l + 1)/(4 pi) i_l(k (1 - depth))/i_l(k) P_l. */
static double ball(double k, double angle, double depth)
{
    static double inner[ORDERS], outer[ORDERS];
    const double x = k * (1.0 - depth), c = cos(angle);
    double ratio = sinh(x) / x / (sinh(k) / k), before = 1.0, at = c, sum = 0.0;

    quotients(x, inner);
    quotients(k, outer);
    for (int l = 0; l < ORDERS; l++) {
        const double p = l == 0 ? 1.0 : at;
        sum += (2 * l + 1) * ratio * p / (4.0 * PELL_PI);
        ratio *= inner[l] / outer[l];
        if (l > 0) {
            const double next = ((2 * l + 1) * c * at - l * before) / (l + 1);
            before = at;
            at = next;
        }
    }
    return sum;
}

static void balls_are_near_exact_diffusion(void **state)
{
    const double depth = 0.02;
    (void) state;

    for (double k = 0.5; k < 7.0; k *= 1.5)
        for (int degrees = 90; degrees <= 160; degrees += 10) {
            const double angle = degrees * PELL_PI / 180.0, d = 2.0 * sin(0.5 * angle), exact = ball(k, angle, depth);
            const float e = 0.0f, z = (float) depth, kappa = (float) k;
            const struct pell_opposed o = { { kappa, kappa, kappa }, { e, e, e }, { z, z, z }, { 1.0f, 1.0f, 1.0f } };
            const struct pell_opposed_pair pair = { (float) (d * d), (float) (-0.5 * d * d), (float) (0.5 * d * d), (float) cos(angle),
                                                    1.0f };
            float through[3];
            pell_opposed_split(&o, &pair, through);
            REQUIRE((double) through[0] > 0.75 * exact && (double) through[0] < 1.35 * exact);
        }
}

static void a_plane_keeps_its_profile_and_air_carries_nothing(void **state)
{
    const struct pell_medium m = medium_of(0.032, 0.74, 1.3);
    const float one[3] = { 1.0f, 1.0f, 1.0f };
    struct pell_opposed o;
    (void) state;

    REQUIRE(pell_opposed_make(&m, &o));
    for (float d = 0.5f; d < 30.0f; d *= 2.0f) {
        const struct pell_opposed_pair plane = { d * d, 0.0f, 0.0f, 1.0f, 0.0f }, step = { d * d, 0.3f * d, 0.3f * d, 1.0f, 0.0f };
        const struct pell_opposed_pair gap = { d * d, d, -d, -1.0f, 0.0f }, groove = { d * d, 0.707f * d, -0.707f * d, 0.0f, 0.0f };
        float R[3] = { 1.0f, 1.0f, 1.0f }, through[3];
        pell_opposed_apply(&o, &plane, one, R, through);
        REQUIRE(R[0] == 1.0f && through[0] == 0.0f);
        pell_opposed_apply(&o, &step, one, R, through);
        REQUIRE(R[0] == 1.0f && through[0] == 0.0f);
        pell_opposed_apply(&o, &groove, one, R, through); /* 3 pi/2 inside: p^2 sin^2(3 pi/4) of it, p = 2/3 */
        REQUIRE_REL((double) (R[0] + through[0]), 4.0 / 9.0 / 2.0, 1e-3);
        pell_opposed_apply(&o, &gap, one, R, through);
        REQUIRE_NEAR((double) (R[0] + through[0]), 0.0, 1e-6);
    }
}

/* Under uniform illumination a ball returns the exact diffusion result, whatever the sum over pairs of faces is. */
static void the_gain_keeps_even_light(void **state)
{
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(media); i++)
        for (double free_paths = 8.0; free_paths < 60.0; free_paths *= 1.6) {
            const struct pell_medium m = medium_of(media[i][0], media[i][1], media[i][2]);
            const double radius = free_paths / (media[i][0] + media[i][1]);
            const float one[3] = { 1.0f, 1.0f, 1.0f };
            struct pell_profile profile;
            struct pell_opposed o;
            double gain, sum = 0.0;
            REQUIRE(pell_opposed_make(&m, &o));
            REQUIRE(pell_profile_make(PELL_PROFILE_DIPOLE, &m, 0, NULL, &profile) == PELL_OK);
            gain = pell_curvature_gain(&m, 0, &profile, 1.0 / radius);
            for (int k = 0; k < 20000; k++) {
                const double d = 2.0 * radius * (k + 0.5) / 20000;
                const struct pell_opposed_pair pair = { (float) (d * d), (float) (-0.5 * d * d / radius), (float) (0.5 * d * d / radius),
                                                        (float) (1.0 - 0.5 * d * d / (radius * radius)), (float) (1.0 / radius) };
                float R[3] = { (float) pell_profile_eval(&profile, d), 0.0f, 0.0f }, through[3];
                pell_opposed_apply(&o, &pair, one, R, through);
                sum += 2.0 * PELL_PI * d * (double) (R[0] + through[0]) * 2.0 * radius / 20000;
            }
            REQUIRE_REL(pell_opposed_gain(&o, 0, &profile, 1.0 / radius, gain) * sum,
                        gain * pell_profile_total(&profile) * pell_profile_cdf(&profile, 2.0 * radius), 0.01);
            REQUIRE(pell_opposed_across(&o, 0, 1.0 / radius) > 0.0 && pell_opposed_across(&o, 0, -1.0 / radius) == 0.0);
            REQUIRE(pell_opposed_gain(&o, 0, &profile, 0.0, 1.0) == 1.0);
        }
}

static void media_that_say_nothing_are_left_alone(void **state)
{
    const struct pell_medium nothing = medium_of(0.0, 0.0, 1.3);
    const struct pell_opposed_pair pair = { 4.0f, -2.0f, 2.0f, -1.0f, 0.0f };
    const float one[3] = { 1.0f, 1.0f, 1.0f };
    float R[3] = { 0.5f, 0.5f, 0.5f }, through[3];
    struct pell_opposed o;
    (void) state;

    REQUIRE(!pell_opposed_make(&nothing, &o));
    pell_opposed_apply(&o, &pair, one, R, through);
    REQUIRE(R[0] == 0.5f && R[1] == 0.5f && R[2] == 0.5f && through[0] + through[1] + through[2] == 0.0f);
}

static float uniform(uint32_t *state)
{
    *state = *state * 1664525u + 1013904223u;
    return (float) (*state >> 8) * 0x1p-24f;
}

static struct pell_vec3 direction(uint32_t *state)
{
    const float z = 2.0f * uniform(state) - 1.0f, azimuth = 6.2831853f * uniform(state), s = sqrtf(1.0f - z * z);

    return vec3(s * cosf(azimuth), s * sinf(azimuth), z);
}

/* Where a mean free path is as long as parts are thick, the sources of some points coincide with other points. Light that enters over an
 * area contributes no more there than an area of uniform light at a distance equal to its width. */
static void sources_are_as_wide_as_what_enters(void **state)
{
    const struct pell_medium m = medium_of(0.009, 0.004, 1.3);
    const float area = 1.0f;
    float most = 0.0f, of_points = 0.0f;
    struct pell_opposed o;
    uint32_t random = 1;
    (void) state;

    REQUIRE(pell_opposed_make(&m, &o));
    for (int i = 0; i < 300000; i++) {
        const struct pell_vec3 n = direction(&random), x = direction(&random), w = direction(&random);
        const struct pell_vec3 t = vec3_mul(vec3_mad(w, -vec3_dot(w, n), n), 0.75f), source = vec3_mul(vec3_sub(t, n), o.depth[0]);
        const struct pell_vec3 v = vec3_mad(vec3_mad(source, -o.beyond[0], x), 2.0f * uniform(&random), direction(&random));
        struct pell_opposed_pair pair = { vec3_dot(v, v), vec3_dot(n, v), vec3_dot(x, v), vec3_dot(x, n),
                                          0.0f,           vec3_dot(t, v), vec3_dot(t, x), vec3_dot(t, t) };
        float through[3];
        pell_opposed_split(&o, &pair, through);
        of_points = fmaxf(of_points, through[0] * area / o.amount[0]);
        pair.area = area;
        pell_opposed_split(&o, &pair, through);
        most = fmaxf(most, through[0] * area / o.amount[0]);
    }
    print_message("# at most %.3f of a source, %.3g of points\n", (double) most, (double) of_points);
    REQUIRE(most > 0.05f && most < 1.0f && of_points > 10.0f);
}

/* Diffusion is not valid for solids that are smaller than a few mean free paths: a finger of a hand with a mean free path 100 times as
 * long was 340 times as bright as by photons. */
static void small_solids_count_as_bent_like_larger_ones(void **state)
{
    const struct pell_medium m = medium_of(0.014, 7e-4, 1.33);
    struct pell_opposed o;
    float through[3], least[3];
    (void) state;

    REQUIRE(pell_opposed_make(&m, &o));
    for (float facing = 0.9f; facing > -1.0f; facing -= 0.2f) {
        struct pell_opposed_pair pair = { .distance2 = 0.01f, .from = -0.02f, .to = 0.03f, .facing = facing };
        pair.curvature = 1.0f / (PELL_OPPOSED_MIN_RADIUS * (o.beyond[0] + o.depth[0]));
        pell_opposed_split(&o, &pair, least);
        pair.curvature = 2.0f;
        pell_opposed_split(&o, &pair, through);
        REQUIRE(through[0] == least[0] && through[0] < 1e-4f);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slabs_transmit_what_transport_says),
        cmocka_unit_test(the_source_is_in_proportion_to_what_is_scattered),
        cmocka_unit_test(an_edge_of_right_angles_has_four_images),
        cmocka_unit_test(balls_are_near_exact_diffusion),
        cmocka_unit_test(a_plane_keeps_its_profile_and_air_carries_nothing),
        cmocka_unit_test(the_gain_keeps_even_light),
        cmocka_unit_test(media_that_say_nothing_are_left_alone),
        cmocka_unit_test(small_solids_count_as_bent_like_larger_ones),
        cmocka_unit_test(sources_are_as_wide_as_what_enters),
    };

    return cmocka_run_group_tests_name("optics.opposed", tests, NULL, NULL);
}
