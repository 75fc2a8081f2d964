/* SPDX-License-Identifier: MIT
 * test_solid.c - diffusion in solids against closed forms (balls and slabs under uniform illumination, Legendre series) and photons; and
 * cases that are left unsolved. */
#include "render/indirect/internal.h"

#include "pell_test.h"
#include "random.h"
#include "slow.h"

#include <stdlib.h>
#include <string.h>

#define MAX_SAMPLES 12000

/* Profiles; attenuation coefficients of diffuse light in their media, extrapolation distances, and the fractions of entering light that
 * diffuse. */
static const double total[3] = { 0.8, 0.7, 0.65 }, kappa[3] = { 0.2, 0.45, 0.3 }, beyond[3] = { 1.2, 0.9, 1.5 },
                    enters[3] = { 0.97, 0.9, 0.8 };

struct fixture {
    struct pell_context *ctx;
    struct pell_pool *pool;
    struct pell_profile profile[3];
    struct pell_opposed opposed;
    double s[3];
    struct pell_surface_sample sample[MAX_SAMPLES];
    float thickness[MAX_SAMPLES], source[MAX_SAMPLES][3];
    struct indirect_solid_light light[MAX_SAMPLES];
    size_t count;
};

/* First scattering at the depth t z, with the density exp(-t), gives the same transmittance of a slab as the source `enters` does. */
static void set_depth(struct fixture *f, double z)
{
    for (int c = 0; c < 3; c++) {
        const double k = kappa[c], b = beyond[c];
        const double all = (sinh(k * b) + k * z * cosh(k * b)) / (1.0 - k * z * k * z); /* Int exp(-t) sinh(k (t z + b)) */
        f->opposed.depth[c] = (float) z;
        f->opposed.amount[c] = (float) (enters[c] * cosh(k * b) * all / sinh(k * (z + b)));
    }
}

static int set_up(void **state)
{
    enum { ROWS = 200 };
    struct fixture *f = calloc(1, sizeof(*f));
    double r[ROWS], R[ROWS];

    assert_non_null(f);
    f->ctx = test_context(NULL, NULL);
    assert_int_equal(pell_pool_create(f->ctx, 2, &f->pool), PELL_OK);
    for (int c = 0; c < 3; c++) {
        for (int i = 0; i < ROWS; i++) {
            r[i] = 0.1 * i;
            R[i] = total[c] * exp(-r[i]) / (2.0 * PELL_PI);
        }
        assert_int_equal(pell_profile_from_table(r, R, ROWS, &f->profile[c], NULL), PELL_OK);
        f->opposed.kappa[c] = (float) kappa[c];
        f->opposed.beyond[c] = (float) beyond[c];
        f->s[c] = tanh(kappa[c] * beyond[c]) / kappa[c];
    }
    set_depth(f, 0.4);
    *state = f;
    return 0;
}

static int tear_down(void **state)
{
    struct fixture *f = *state;

    pell_pool_destroy(&f->pool);
    pell_context_destroy(&f->ctx);
    free(f);
    return 0;
}

static void add(struct fixture *f, struct pell_vec3 position, struct pell_vec3 normal, double area)
{
    struct pell_surface_sample *p = &f->sample[f->count];

    assert_true(f->count < MAX_SAMPLES);
    vec3_store(position, p->position);
    vec3_store(normal, p->normal);
    vec3_store(vec3_mul(normal, -1.0f), p->direction);
    p->area = (float) area;
    for (int c = 0; c < 3; c++)
        p->power[c] = (float) area;
    f->thickness[f->count++] = INFINITY;
}

static void add_ball(struct fixture *f, struct pell_vec3 middle, double radius, size_t count, double curvature)
{
    for (size_t i = 0; i < count; i++) {
        const double z = 1.0 - (2.0 * (double) i + 1.0) / (double) count, r = sqrt(1.0 - z * z), t = 2.399963 * (double) i;
        const struct pell_vec3 n = vec3((float) (r * cos(t)), (float) (r * sin(t)), (float) z);
        add(f, vec3_mad(middle, (float) radius, n), n, 4.0 * PELL_PI * radius * radius / (double) count);
        f->sample[f->count - 1].curvature = (float) curvature;
    }
}

static void solve(struct fixture *f, double spacing)
{
    static const float slope[3] = { 0.0f };
    const struct indirect_solid solid = { .samples = f->sample,
                                          .source = (const float(*)[3]) f->source,
                                          .slope = slope,
                                          .thickness = f->thickness,
                                          .count = f->count,
                                          .profile = f->profile,
                                          .opposed = &f->opposed,
                                          .spacing = (float) spacing };

    for (size_t i = 0; i < f->count; i++)
        memcpy(f->source[i], f->sample[i].power, sizeof(f->source[i]));
    assert_int_equal(indirect_diffusion_solve(f->ctx, f->pool, &solid, f->light), PELL_OK);
}

/* Diffuse reflectance of a half-space, subtracted from the profile's total: the light that leaves where it entered. */
static double reflected_locally(const struct fixture *f, int c)
{
    return total[c] - enters[c] / (1.0 + kappa[c] * (double) f->opposed.depth[c]) / (1.0 + f->s[c] * kappa[c]);
}

/* Int exp(-t) times the value of `each` for sources at the depth t z, up to the depth `end`. */
static double mean_over_depth(const struct fixture *f, int c, double size,
                              double (*each)(const struct fixture *f, int c, double size, double z), double end)
{
    enum { STEPS = 400 };
    const double depth = (double) f->opposed.depth[c], most = fmin(12.0, end / depth);
    double sum = 0.0;

    for (int i = 0; i < STEPS; i++) {
        const double t = (i + 0.5) * most / STEPS;
        sum += exp(-t) * each(f, c, size, t * depth) * most / STEPS;
    }
    return sum;
}

/* Under uniform illumination the integral of a profile is its total. */
static double uniform_response(const struct fixture *f, size_t i, int c)
{
    return (1.0 - (double) f->light[i].entered[c]) * total[c] + (double) f->light[i].light[c];
}

/* phi = u/r with u = A sinh(kappa r), minus (q r'/kappa) sinh(kappa (r - r')) outside of the sources q at r' = R - depth, where phi + s'
 * phi' = 0 at R, s' = s/(1 + s/R). The radiant exitance is phi s/s'. */
static double ball_at(const struct fixture *f, int c, double R, double z)
{
    const double s = f->s[c], k = kappa[c], bent = s / (1.0 + s / R), q = enters[c] / s * R * R / (R - z);
    const double A =
        q / k * ((1.0 - bent / R) * sinh(k * z) + bent * k * cosh(k * z)) / ((1.0 - bent / R) * sinh(k * R) + bent * k * cosh(k * R));
    return (A * sinh(k * R) - q / k * sinh(k * z)) / R * s / bent;
}

static double ball(const struct fixture *f, int c, double R)
{
    return reflected_locally(f, c) + mean_over_depth(f, c, R, ball_at, R);
}

static void balls_return_what_diffusion_says(void **state)
{
    RELEASE_ONLY();
    struct fixture *f = *state;

    for (double radius = 3.0; radius < 13.0; radius *= 2.0) {
        f->count = 0;
        add_ball(f, vec3(5, 0, 0), radius, 9000, 1.0 / radius);
        solve(f, sqrt(4.0 * PELL_PI * radius * radius / 9000));
        for (int c = 0; c < 3; c++) {
            double mean = 0.0;
            for (size_t i = 0; i < f->count; i++) {
                REQUIRE(f->light[i].solved[c] > 0.9f);
                REQUIRE_REL(uniform_response(f, i, c), ball(f, c, radius), 0.03);
                mean += uniform_response(f, i, c) / (double) f->count;
            }
            REQUIRE_REL(mean, ball(f, c, radius), 0.015);
        }
    }
}

/* Another solid nearby has no effect, although both are in one array of samples. */
static void solids_of_one_object_do_not_mix(void **state)
{
    struct fixture *f = *state;
    const double radius = 6.0;

    add_ball(f, vec3(0, 0, 0), radius, 6000, 1.0 / radius);
    add_ball(f, vec3(0, 13, 0), radius, 6000, 1.0 / radius);
    solve(f, sqrt(4.0 * PELL_PI * radius * radius / 6000));
    for (size_t i = 0; i < f->count; i++)
        REQUIRE_REL(uniform_response(f, i, 1), ball(f, 1, radius), 0.03);
}

/* A square of n x n samples, or two opposite squares and the rim between them. */
static void add_slab(struct fixture *f, int n, double step, double thickness, bool both)
{
    for (int i = 0; i < n * n; i++)
        for (int side = 0; side < (both ? 2 : 1); side++) {
            const double x = ((i % n) - 0.5 * (n - 1)) * step, y = ((i / n) - 0.5 * (n - 1)) * step, up = side ? -1.0 : 1.0;
            add(f, vec3((float) x, (float) y, (float) (0.5 * up * thickness)), vec3(0, 0, (float) up), step * step);
            f->thickness[f->count - 1] = both ? (float) thickness : INFINITY;
        }
    for (int i = 0, rows = (int) (thickness / step + 0.5); both && i < 4 * n * rows; i++) {
        const double along = (i / 4 % n - 0.5 * (n - 1)) * step, z = ((i / 4 / n + 0.5) / rows - 0.5) * thickness, far = 0.5 * n * step;
        const float sign = i % 2 ? 1.0f : -1.0f;
        const bool turned = i / 2 % 2 != 0;
        add(f, turned ? vec3(sign * (float) far, (float) along, (float) z) : vec3((float) along, sign * (float) far, (float) z),
            turned ? vec3(sign, 0, 0) : vec3(0, sign, 0), step * thickness / rows);
    }
}

/* phi = A cosh(kappa z), minus (q/kappa) sinh(kappa (z - z')) beyond the sources q at z' = t/2 - depth, where phi + s phi' = 0 at t/2. */
static double slab_at(const struct fixture *f, int c, double t, double z)
{
    const double s = f->s[c], k = kappa[c], q = enters[c] / s;
    const double A = q / k * (sinh(k * z) + s * k * cosh(k * z)) / (cosh(0.5 * k * t) + s * k * sinh(0.5 * k * t));
    (void) f;
    return A * cosh(0.5 * k * t) - q / k * sinh(k * z);
}

static double slab(const struct fixture *f, int c, double t)
{
    return reflected_locally(f, c) + mean_over_depth(f, c, t, slab_at, 0.5 * t);
}

static void slabs_return_what_diffusion_says(void **state)
{
    RELEASE_ONLY();
    struct fixture *f = *state;
    const int n = 50;
    const double step = 0.6;

    for (double thickness = 6.0; thickness < 14.0; thickness *= 1.5) {
        f->count = 0;
        add_slab(f, n, step, thickness, true);
        solve(f, step);
        for (size_t i = 0; i < f->count; i++) {
            const float *p = f->sample[i].position;
            if (fabsf(p[0]) > 6.0f || fabsf(p[1]) > 6.0f)
                continue;
            for (int c = 1; c < 3; c++) {
                REQUIRE(f->light[i].solved[c] > 0.99f);
                REQUIRE_REL(uniform_response(f, i, c), slab(f, c, thickness), 0.03);
            }
        }
    }
}

/* An open surface encloses no volume; its light is that of the profile. */
static void a_plane_returns_its_profile(void **state)
{
    struct fixture *f = *state;

    add_slab(f, 70, 0.6, 0.0, false);
    solve(f, 0.6);
    for (size_t i = 0; i < f->count; i++)
        for (int c = 0; c < 3; c++)
            if (fabsf(f->sample[i].position[0]) < 10.0f && fabsf(f->sample[i].position[1]) < 10.0f)
                REQUIRE_REL(uniform_response(f, i, c), total[c], 0.03);
}

/* Legendre series of a ball with irradiance 1 where x > 0: E_l = (P_(l-1)(0) - P_(l+1)(0))/2, phi_l = E_l/(1 + s kappa i_l'/i_l), for
 * sources at the surface. */
static double half_lit(const struct fixture *f, int c, double radius, double x)
{
    enum { TERMS = 2000 };
    const double z = kappa[c] * radius;
    double P0[TERMS + 2], P[TERMS + 2], ratio[TERMS + 2], sum = 0.0; /* ratio: i_l/i_(l-1) */

    P0[0] = P[0] = 1.0;
    P0[1] = 0.0;
    P[1] = x;
    for (int l = 1; l <= TERMS; l++) {
        P0[l + 1] = -l * P0[l - 1] / (l + 1);
        P[l + 1] = ((2 * l + 1) * x * P[l] - l * P[l - 1]) / (l + 1);
    }
    ratio[TERMS + 1] = z / (2 * TERMS + 3);
    for (int l = TERMS; l >= 1; l--)
        ratio[l] = 1.0 / ((2 * l + 1) / z + ratio[l + 1]);
    for (int l = 0; l <= TERMS; l++) {
        const double E = l == 0 ? 0.5 : 0.5 * (P0[l - 1] - P0[l + 1]), slope = kappa[c] * (ratio[l + 1] + l / z);
        sum += E * P[l] / (1.0 + f->s[c] * slope);
    }
    return enters[c] * sum;
}

/* Far from the lit side all light is transmitted light of the solution, except for a little that the profile contributes. */
static void light_gets_through_as_the_series_says(void **state)
{
    struct fixture *f = *state;
    const double radius = 9.0;
    const int c = 1;

    set_depth(f, 1e-3);
    add_ball(f, vec3(0, 0, 0), radius, 9000, 0.0);
    for (size_t i = 0; i < f->count; i++)
        for (int k = 0; k < 3 && f->sample[i].position[2] < 0.0f; k++)
            f->sample[i].power[k] = 0.0f;
    solve(f, 0.34);
    for (size_t i = 0; i < f->count; i += 10) {
        const double x = (double) f->sample[i].normal[2], phi = half_lit(f, c, radius, x);
        double near = 0.0; /* returned by the profile from faces of similar orientation */
        for (size_t j = 0; j < f->count && x < -0.75; j++) {
            const struct pell_surface_sample *p = &f->sample[i], *q = &f->sample[j];
            const struct pell_vec3 to = vec3_sub(vec3_load(q->position), vec3_load(p->position));
            if (vec3_dot(vec3_load(p->normal), vec3_load(q->normal)) > 0.4f)
                near += total[c] * exp(-(double) vec3_length(to)) / (2.0 * PELL_PI) * (double) q->power[c];
        }
        if (x < -0.75)
            REQUIRE_REL((double) f->light[i].light[c] - near, phi, 0.15);
    }
}

/* Adds sources of the given flux at position (x, r): coefficients Q_l of i_l(kappa r)/i_l(kappa R) P_l(x), for l up to TERMS. */
enum { TERMS = 60 };
static void add_source(double k, double R, double x, double r, double flux, double Q[TERMS + 1])
{
    double below[TERMS + 42], at[TERMS + 42], P[TERMS + 2], share = sinh(k * r) / sinh(k * R) * R / r; /* of i_0 */

    below[TERMS + 41] = at[TERMS + 41] = 0.0;
    for (int l = TERMS + 40; l >= 1; l--) { /* i_l/i_(l-1) */
        below[l] = 1.0 / ((2 * l + 1) / (k * r) + below[l + 1]);
        at[l] = 1.0 / ((2 * l + 1) / (k * R) + at[l + 1]);
    }
    P[0] = 1.0;
    P[1] = x;
    for (int l = 0; l <= TERMS; l++) {
        Q[l] += flux * share * P[l];
        share *= below[l + 1] / at[l + 1];
        if (l > 0)
            P[l + 1] = ((2 * l + 1) * x * P[l] - l * P[l - 1]) / (l + 1);
    }
}

/* Q for a directional light, which is refracted and has its first scattering along the refracted ray. */
static void directional_sources(const struct fixture *f, int c, double R, double eta, double Q[TERMS + 1])
{
    enum { RINGS = 400, PATHS = 50 };
    const double z = (double) f->opposed.depth[c], most = 12.0;

    for (int i = 0; i < RINGS * PATHS; i++) {
        const double mu = (i / PATHS + 0.5) / RINGS, side = sqrt(1.0 - mu * mu);
        const double m = sqrt(1.0 - side * side / (eta * eta)), sine = side / eta, t = (i % PATHS + 0.5) * most / PATHS;
        const double along = -mu * R + t * z * (m * mu + sine * side), up = side * R - t * z * (m * side - sine * mu), r = hypot(along, up);
        if (r < R)
            add_source(kappa[c], R, along / r, r, exp(-t) * most / PATHS * mu * 2.0 * PELL_PI * R * R / RINGS, Q);
    }
}

/* Radiant exitance for these sources at a cosine from the light's direction. */
static double exitance_of(const struct fixture *f, int c, double R, const double Q[TERMS + 1], double x)
{
    const double k = kappa[c], bent = f->s[c] / (1.0 + f->s[c] / R);
    double ratio[TERMS + 42], before = 0.0, P = 1.0, sum = 0.0;

    ratio[TERMS + 41] = 0.0;
    for (int l = TERMS + 40; l >= 1; l--) /* i_l/i_(l-1) */
        ratio[l] = 1.0 / ((2 * l + 1) / (k * R) + ratio[l + 1]);
    for (int l = 0; l <= TERMS; l++) {
        const double next = ((2 * l + 1) * x * P - l * before) / (l + 1);
        sum += (2 * l + 1) / (4.0 * PELL_PI * R * R) * Q[l] * P / (1.0 + bent * k * (ratio[l + 1] + l / (k * R)));
        before = P;
        P = next;
    }
    return enters[c] * sum;
}

/* Light at grazing incidence continues behind the terminator: sources below the point of entry give a third less light on the dark side. */
static void light_that_grazes_goes_on(void **state)
{
    struct fixture *f = *state;
    const double radius = 9.0, eta = 1.3;
    const int c = 1;
    double Q[TERMS + 1] = { 0.0 }, ratio = 0.0, count = 0.0;

    set_depth(f, 1.0);
    directional_sources(f, c, radius, eta, Q);
    add_ball(f, vec3(0, 0, 0), radius, 9000, 1.0 / radius);
    for (size_t i = 0; i < f->count; i++) { /* toward z */
        struct pell_surface_sample *p = &f->sample[i];
        const float mu = fmaxf(-p->normal[2], 0.0f), m = sqrtf(1.0f - (1.0f - mu * mu) / (float) (eta * eta)), deep = mu / (float) eta - m;
        for (int k = 0; k < 3; k++) {
            p->power[k] *= mu;
            p->direction[k] = deep * p->normal[k] + (k == 2 ? 1.0f / (float) eta : 0.0f);
        }
    }
    solve(f, 0.34);
    for (size_t i = 0; i < f->count; i += 10) {
        const double x = (double) f->sample[i].normal[2], out = exitance_of(f, c, radius, Q, x);
        if (!(x > 0.1 && x < 0.95))
            continue;
        REQUIRE_REL((double) f->light[i].exitance[c], out, 0.4);
        ratio += (double) f->light[i].exitance[c] / out;
        count += 1.0;
    }
    print_message("# %.3f of the series\n", ratio / count);
    REQUIRE_REL(ratio / count, 1.0, 0.15);
}

/* --- Media with little scattering ---------------------------------------------------------------------------------------------------- */

#define BANDS 4 /* of a side of the box, from the lit top */
#define BOX 10.0

/* A direction behind the boundary, z downwards: normal incidence, or diffuse light. */
static void enter(double eta, bool diffuse, uint64_t *random, double w[3])
{
    const double turn = 2.0 * PELL_PI * random_unit(random);
    double sine = 0.0;

    while (diffuse) {
        const double mu = sqrt(random_unit(random));
        sine = sqrt(1.0 - mu * mu) / eta;
        if (random_unit(random) >= pell_fresnel(eta, mu))
            break;
    }
    w[0] = sine * cos(turn);
    w[1] = sine * sin(turn);
    w[2] = sqrt(1.0 - sine * sine);
}

/* One step of a photon in the box, in units of the mean free path: returns the axis of the face that it hits, or -1. */
static int step(double x[3], const double w[3], uint64_t *random)
{
    double to = -log(random_unit(random));
    int face = -1;

    for (int k = 0; k < 3; k++) {
        const double far = w[k] > 0.0 ? (BOX - x[k]) / w[k] : w[k] < 0.0 ? -x[k] / w[k] : INFINITY;
        if (far < to) {
            to = far;
            face = k;
        }
    }
    for (int k = 0; k < 3; k++)
        x[k] += to * w[k];
    return face;
}

/* Radiant exitance of the box's sides over the entering irradiance of its top; returns the mean cosine behind the boundary. */
static double walk(double albedo, double eta, bool diffuse, double leaves[BANDS])
{
    enum { PHOTONS = 1000000 };
    uint64_t random = 7;
    double down = 0.0;

    for (int n = 0; n < PHOTONS; n++) {
        double x[3] = { BOX * random_unit(&random), BOX * random_unit(&random), 0.0 }, w[3], weight = 1.0;
        enter(eta, diffuse, &random, w);
        down += w[2];
        while (weight > 0.0) {
            const int face = step(x, w, &random);
            if (face >= 0 && random_unit(&random) < pell_fresnel(1.0 / eta, fabs(w[face]))) {
                w[face] = -w[face];
                continue;
            }
            if (face >= 0) {
                if (face < 2)
                    leaves[(int) fmin(fmax(x[2] / BOX * BANDS, 0.0), BANDS - 1.0)] += weight * BANDS / (4.0 * PHOTONS);
                break;
            }
            weight *= albedo;
            if (weight < 0.02)
                weight = random_unit(&random) < 0.1 ? 10.0 * weight : 0.0;
            w[2] = 2.0 * random_unit(&random) - 1.0;
            w[0] = 2.0 * PELL_PI * random_unit(&random);
            w[1] = sqrt(1.0 - w[2] * w[2]) * sin(w[0]);
            w[0] = sqrt(1.0 - w[2] * w[2]) * cos(w[0]);
        }
    }
    return down / PHOTONS;
}

/* A cube that is lit from above, and the radiant exitance of its sides. */
static void light_turns_corners_as_photons_do(void **state)
{
    RELEASE_ONLY();
    static const double albedo[3] = { 0.95, 0.85, 0.75 }, allowed[3] = { 0.15, 0.3, 0.5 };
    struct fixture *f = *state;
    struct pell_medium medium = { .eta = 1.3 };
    const int n = 36;

    for (int c = 0; c < 3; c++) {
        medium.sigma_s_reduced[c] = albedo[c];
        medium.sigma_a[c] = 1.0 - albedo[c];
    }
    assert_true(pell_opposed_make(&medium, &f->opposed));
    for (int c = 0; c < 3; c++)
        assert_int_equal(pell_profile_make(PELL_PROFILE_MONTE_CARLO, &medium, c, NULL, &f->profile[c]), PELL_OK);
    for (int diffuse = 0; diffuse < 2; diffuse++) {
        double walked[3][BANDS] = { { 0.0 } }, found[3][BANDS] = { { 0.0 } }, area[BANDS] = { 0.0 }, down = 1.0;
        for (int c = 0; c < 3; c++)
            down = walk(albedo[c], medium.eta, diffuse, walked[c]);
        f->count = 0;
        add_slab(f, n, BOX / n, BOX, true);
        for (size_t i = 0; i < f->count; i++) {
            struct pell_surface_sample *p = &f->sample[i];
            if (!(p->normal[2] > 0.0f))
                memset(p->power, 0, sizeof(p->power));
            vec3_store(vec3_mul(vec3_load(p->direction), (float) down), p->direction);
        }
        solve(f, BOX / n);
        for (size_t i = 0; i < f->count; i++) {
            const struct pell_surface_sample *p = &f->sample[i];
            const int band = (int) fmin(fmax((0.5 - (double) p->position[2] / BOX) * BANDS, 0.0), BANDS - 1.0);
            area[band] += p->normal[2] == 0.0f ? (double) p->area : 0.0;
            for (int c = 0; c < 3; c++)
                found[c][band] += p->normal[2] == 0.0f ? (double) (p->area * f->light[i].exitance[c]) : 0.0;
        }
        for (int c = 0; c < 3; c++) {
            double mean = 0.0;
            for (int k = 0; k < BANDS; k++) {
                const double ratio = found[c][k] / area[k] / walked[c][k];
                mean += log(ratio) / BANDS;
                print_message("# albedo %g, %s, %g deep: %.3f of photons\n", albedo[c], diffuse ? "diffuse" : "straight",
                              (k + 0.5) * BOX / BANDS, ratio);
                REQUIRE(fabs(ratio - 1.0) < allowed[c]);
            }
            REQUIRE_NEAR(mean, 0.0, 0.08);
        }
    }
}

struct edge_light {
    double deep, light;
};

static int by_depth(const void *a, const void *b)
{
    const double x = ((const struct edge_light *) a)->deep, y = ((const struct edge_light *) b)->deep;

    return x < y ? -1 : x > y;
}

/* Two opposite faces of a cube around the origin, with irregular sample positions. */
static void add_faces(struct fixture *f, int axis, double size, int count)
{
    for (int i = 0; i < 2 * count; i++) {
        const double side = i < count ? 1.0 : -1.0, along = (i % count + 0.5) / count, across = 0.6180339887 * i + 0.37 * axis;
        float at[3], normal[3] = { 0.0f };
        at[axis] = (float) (0.5 * side * size);
        at[(axis + 1) % 3] = (float) (size * (along - 0.5));
        at[(axis + 2) % 3] = (float) (size * (across - floor(across) - 0.5));
        normal[axis] = (float) side;
        add(f, vec3_load(at), vec3_load(normal), size * size / count);
    }
}

/* On a dark face adjacent to the edge of a lit one, light depends only on the distance from the edge, independent of the positions of
 * samples and of the surface patches that they represent, which are four mean free paths wide here. */
static void light_beside_an_edge_is_even(void **state)
{
    enum { COUNT = 700 };
    static const double size = 16.0, allowed[3] = { 0.055, 0.065, 0.055 };
    static struct edge_light found[6 * COUNT];
    struct fixture *f = *state;

    set_depth(f, 0.22);
    for (int axis = 0; axis < 3; axis++)
        add_faces(f, axis, size, COUNT);
    for (size_t i = 0; i < f->count; i++)
        if (!(f->sample[i].normal[2] > 0.5f))
            memset(f->sample[i].power, 0, sizeof(f->sample[i].power));
    solve(f, size / sqrt(COUNT));
    for (int c = 0; c < 3; c++) {
        size_t n = 0;
        double sum = 0.0, differences = 0.0, relative_noise;
        for (size_t i = 0; i < f->count; i++) {
            const struct pell_surface_sample *p = &f->sample[i];
            const double along = p->normal[0] != 0.0f ? (double) p->position[1] : (double) p->position[0];
            const double deep = 0.5 * size - (double) p->position[2];
            if (p->normal[2] == 0.0f && fabs(along) < 0.35 * size && deep < 2.0)
                found[n++] = (struct edge_light) { deep, (double) f->light[i].exitance[c] };
        }
        REQUIRE(n > 100);
        qsort(found, n, sizeof(found[0]), by_depth);
        for (size_t i = 0; i < n; i++) {
            sum += found[i].light;
            differences += i > 0 ? pow(found[i].light - found[i - 1].light, 2.0) : 0.0;
        }
        relative_noise = sqrt(0.5 * differences / (double) (n - 1)) * (double) n / sum;
        print_message("# channel %d: %.4f uneven\n", c, relative_noise);
        REQUIRE(relative_noise < allowed[c]);
    }
}

static void what_samples_are_too_coarse_for_is_not_solved(void **state)
{
    struct fixture *f = *state;

    add_ball(f, vec3(0, 0, 0), 300.0, 9000, 0.0);
    solve(f, sqrt(4.0 * PELL_PI * 9e4 / 9000));
    for (size_t i = 0; i < f->count; i++)
        for (int c = 0; c < 3; c++)
            REQUIRE(f->light[i].solved[c] == 0.0f);
    f->count = 0; /* thin parts are not solved either, whatever surrounds them */
    add_ball(f, vec3(0, 0, 0), 6.0, 9000, 0.0);
    f->thickness[4500] = 0.1f;
    solve(f, 0.22);
    REQUIRE(f->light[4500].solved[0] == 0.0f && f->light[4502].solved[0] == 1.0f);
}

/* No light, a single sample, coincident samples, normals that cancel. */
static void odd_solids_are_survived(void **state)
{
    struct fixture *f = *state;

    solve(f, 1.0);
    add(f, vec3(0, 0, 0), vec3(0, 0, 1), 1.0);
    solve(f, 1.0);
    for (int i = 0; i < 1000; i++)
        add(f, vec3(1, 2, 3), vec3(0, 0, i % 2 ? 1 : -1), 0.5);
    for (int i = 0; i < 1000; i++)
        add(f, vec3((float) i, 1e7f, -1e7f), vec3(1, 0, 0), 1e-20);
    solve(f, 0.5);
    add_ball(f, vec3(0, 0, 0), 6.0, 5000, 0.0);
    for (size_t i = 0; i < f->count; i++)
        memset(f->sample[i].power, 0, sizeof(f->sample[i].power));
    solve(f, 0.3);
    for (size_t i = 0; i < f->count; i++)
        for (int c = 0; c < 3; c++) {
            REQUIRE(isfinite(f->light[i].gain[c]) && isfinite(f->light[i].entered[c]) && isfinite(f->light[i].light[c]));
            REQUIRE(f->light[i].solved[c] >= 0.0f && f->light[i].solved[c] <= 1.0f);
            REQUIRE(f->light[i].light[c] == 0.0f);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(balls_return_what_diffusion_says, set_up, tear_down),
        cmocka_unit_test_setup_teardown(solids_of_one_object_do_not_mix, set_up, tear_down),
        cmocka_unit_test_setup_teardown(slabs_return_what_diffusion_says, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_plane_returns_its_profile, set_up, tear_down),
        cmocka_unit_test_setup_teardown(light_gets_through_as_the_series_says, set_up, tear_down),
        cmocka_unit_test_setup_teardown(light_that_grazes_goes_on, set_up, tear_down),
        cmocka_unit_test_setup_teardown(light_turns_corners_as_photons_do, set_up, tear_down),
        cmocka_unit_test_setup_teardown(light_beside_an_edge_is_even, set_up, tear_down),
        cmocka_unit_test_setup_teardown(what_samples_are_too_coarse_for_is_not_solved, set_up, tear_down),
        cmocka_unit_test_setup_teardown(odd_solids_are_survived, set_up, tear_down),
    };
    return cmocka_run_group_tests_name("solid", tests, NULL, NULL);
}
