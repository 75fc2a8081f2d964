/* SPDX-License-Identifier: MIT
 * test_forward.c - forward scattering: the exponential attenuation of beams against discrete ordinates, and the fraction of a beam that
 * remains against photons. */
#include "pell_test.h"
#include "random.h"
#include "slow.h"

#include "math/quadrature.h"
#include "math/vec.h"
#include "optics/medium/forward.h"

#include <string.h>

enum { NODES = 48 };

static struct pell_medium medium_of(double sigma_a, double sigma_s, double g)
{
    struct pell_medium m = { .eta = 1.33 };

    for (int c = 0; c < 3; c++) {
        m.sigma_a[c] = sigma_a;
        m.sigma_s_reduced[c] = sigma_s * (1.0 - g);
        m.g[c] = g;
    }
    return m;
}

/* Largest eigenvalue of psi = sigma_s/(sigma_t - k mu) Int p psi by power iteration, with p averaged over azimuths by Legendre
 * polynomials. */
static double growth(double sigma_t, double sigma_s, double g, double k)
{
    double mu[NODES], weight[NODES], legendre[NODES][NODES], psi[NODES], grown = 0.0;

    pell_gauss_legendre(NODES, mu, weight);
    for (int i = 0; i < NODES; i++) {
        mu[i] = 2.0 * mu[i] - 1.0;
        weight[i] *= 2.0;
        psi[i] = 1.0;
        legendre[0][i] = 1.0;
        legendre[1][i] = mu[i];
        for (int l = 1; l + 1 < NODES; l++)
            legendre[l + 1][i] = ((2 * l + 1) * mu[i] * legendre[l][i] - l * legendre[l - 1][i]) / (l + 1);
    }
    for (int n = 0; n < 300; n++) {
        double next[NODES] = { 0.0 }, most = 0.0, power = 1.0;
        for (int l = 0; l < NODES; l++, power *= g) {
            double moment = 0.0;
            for (int i = 0; i < NODES; i++)
                moment += weight[i] * legendre[l][i] * psi[i];
            for (int i = 0; i < NODES; i++)
                next[i] += 0.5 * (2 * l + 1) * power * legendre[l][i] * moment;
        }
        for (int i = 0; i < NODES; i++) {
            next[i] *= sigma_s / (sigma_t - k * mu[i]);
            most = fmax(most, fabs(next[i]));
        }
        for (int i = 0; i < NODES; i++)
            psi[i] = next[i] / most;
        grown = most;
    }
    return grown;
}

static void beams_fall_as_discrete_ordinates_say(void **state)
{
    static const double media[][3] = { { 0.1, 0.9, 0.8 }, { 0.5, 0.5, 0.8 }, { 0.3, 0.7, 0.5 }, { 0.02, 0.98, 0.85 }, { 0.6, 0.4, 0.2 } };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(media); i++) {
        const double a = media[i][0], s = media[i][1], g = media[i][2];
        const struct pell_medium m = medium_of(a, s, g);
        double low = 0.0, high = (a + s) * (1.0 - 1e-9);
        struct pell_forward f;
        REQUIRE(pell_forward_make(&m, &f));
        for (int k = 0; k < 40; k++) {
            const double middle = 0.5 * (low + high);
            if (growth(a + s, s, g, middle) < 1.0)
                low = middle;
            else
                high = middle;
        }
        print_message("# albedo %.2f, g %.2f: %.6f, by ordinates %.6f\n", s / (a + s), g, (double) (f.sigma_a[0] + f.spread[0]), low);
        REQUIRE_REL((double) (f.sigma_a[0] + f.spread[0]), low, 2e-3);
    }
}

static struct pell_vec3 scattered(struct pell_vec3 w, double g, uint64_t *state)
{
    const double s = (1.0 - g * g) / (1.0 - g + 2.0 * g * random_unit(state)), c = (1.0 + g * g - s * s) / (2.0 * g);
    const double azimuth = 2.0 * PELL_PI * random_unit(state), sine = sqrt(fmax(1.0 - c * c, 0.0));
    struct pell_vec3 a, b;

    vec3_basis(w, &a, &b);
    return vec3_normalize(vec3_mad(vec3_mad(vec3_mul(w, (float) c), (float) (sine * cos(azimuth)), a), (float) (sine * sin(azimuth)), b));
}

enum { RADII = 4, PHOTONS = 100000 };
static const double radii[RADII] = { 1.0, 2.0, 5.0, 10.0 }; /* relative to the reduced mean free path */
#define AHEAD 0.7                                           /* least cosine to the beam */

/* Fraction of a beam that crosses spheres around its start in the forward direction, after scattering. */
static void shoot(double sigma_a, double sigma_s, double g, double sum[RADII])
{
    const double unit = 1.0 / (sigma_a + sigma_s * (1.0 - g));
    uint64_t random = 7;

    memset(sum, 0, RADII * sizeof(*sum));
    for (int i = 0; i < PHOTONS; i++) {
        struct pell_vec3 x = vec3(0, 0, 0), w = vec3(0, 0, 1);
        double weight = 1.0;
        for (int event = 0; weight > 1e-7; event++) {
            const double d = -log(random_unit(&random)) / sigma_s, b = (double) vec3_dot(x, w), x2 = (double) vec3_dot(x, x);
            for (int k = 0; k < RADII; k++) {
                const double r = radii[k] * unit, to = -b + sqrt(fmax(b * b + r * r - x2, 0.0));
                if (x2 < r * r && to < d && event > 0 && ((double) x.z + to * (double) w.z) > AHEAD * r)
                    sum[k] += weight * exp(-sigma_a * to) / PHOTONS;
            }
            x = vec3_mad(x, (float) d, w);
            weight *= exp(-sigma_a * d);
            if ((double) vec3_dot(x, x) > 400.0 * unit * unit)
                break;
            w = scattered(w, g, &random);
        }
    }
}

static void beams_are_as_strong_as_photons_say(void **state)
{
    /* ruby grapefruit juice's R and G, shampoo's R, head and shoulders' R */
    static const double media[][3] = {
        { 0.0859, 0.155, 0.929 }, { 0.183, 0.154, 0.929 }, { 0.0141, 0.00797, 0.91 }, { 0.0846, 0.268, 0.911 }
    };
    (void) state;

    RELEASE_ONLY();
    for (size_t i = 0; i < PELL_COUNT(media); i++) {
        const double a = media[i][0], s = media[i][1], g = media[i][2];
        const struct pell_medium m = medium_of(a, s, g);
        struct pell_forward f;
        double photons[RADII];
        REQUIRE(pell_forward_make(&m, &f));
        shoot(a, s, g, photons);
        for (int k = 0; k < RADII; k++) {
            const double r = radii[k] / (a + s * (1.0 - g));
            double sum = 0.0;
            for (int n = 0; n < 1000; n++) {
                const double c = AHEAD + (1.0 - AHEAD) * (n + 0.5) / 1000;
                float flux[3], cosine[3];
                pell_forward_at(&f, (float) (r * r), (float) c, 1.0f, 100.0f, flux, cosine);
                sum += 2.0 * PELL_PI * r * r * (double) flux[0] * (1.0 - AHEAD) / 1000;
            }
            print_message("# medium %zu, %g mean free paths: %.3g of a beam, %.2f of photons\n", i, radii[k], sum, sum / photons[k]);
            REQUIRE(sum > 0.7 * photons[k] && sum < 1.2 * photons[k]);
        }
    }
}

/* --- Broad beams -------------------------------------------------------------------------------------------------------------------- */

enum { ANGLES = 5 };
static const double angles[ANGLES + 1] = { 0.0, 10.0, 20.0, 30.0, 45.0, 80.0 }; /* degrees to the beam */

/* Fraction of a broad beam, entering at the cosine `enters` to the normal of a slab `thick` mm thick without a boundary, that is
 * transmitted per angle after scattering. */
static void pass_slab(double sigma_a, double sigma_s, double g, double enters, double thick, double sum[ANGLES])
{
    const struct pell_vec3 beam = vec3((float) sqrt(1.0 - enters * enters), 0, (float) enters);
    uint64_t random = 11;

    memset(sum, 0, ANGLES * sizeof(*sum));
    for (int i = 0; i < PHOTONS; i++) {
        struct pell_vec3 w = beam;
        double z = 0.0, weight = 1.0;
        for (int event = 0; weight > 1e-7; event++) {
            const double d = -log(random_unit(&random)) / sigma_s, up = (double) w.z, to = up > 0.0 ? (thick - z) / up : -z / up;
            if (to < d) {
                const double angle = acos(fmin((double) vec3_dot(w, beam), 1.0)) * 180.0 / PELL_PI;
                for (int k = 0; k < ANGLES && up > 0.0 && event > 0; k++)
                    if (angle >= angles[k] && angle < angles[k + 1])
                        sum[k] += weight * exp(-sigma_a * to) / PHOTONS;
                break;
            }
            z += d * up;
            weight *= exp(-sigma_a * d);
            w = scattered(w, g, &random);
        }
    }
}

/* The same by the analytic model. */
static double model_transmittance(const struct pell_forward *f, double enters, double thick, double from, double to)
{
    enum { RINGS = 60, SECTORS = 40 };
    const double sine = sqrt(1.0 - enters * enters), step = (to - from) / RINGS;
    double sum = 0.0;

    for (int i = 0; i < RINGS; i++)
        for (int j = 0; j < SECTORS; j++) {
            const double angle = from + (i + 0.5) * step, azimuth = (j + 0.5) * 2.0 * PELL_PI / SECTORS;
            const double leaves = enters * cos(angle) - sine * sin(angle) * cos(azimuth), mean = sqrt(enters * fmax(leaves, 0.0));
            float cosine, left;
            if (!(leaves > 0.05))
                continue;
            left = pell_forward_broad(f, 0, (float) (thick / mean), &cosine);
            sum += (double) (left * pell_forward_phase(cosine, (float) cos(angle))) / mean * leaves * sin(angle) * step * 2.0 * PELL_PI /
                   SECTORS;
        }
    return sum;
}

static void broad_beams_are_what_goes_through_slabs(void **state)
{
    /* ruby grapefruit juice's R and G, shampoo's R, strawberry shampoo's R */
    static const double media[][3] = {
        { 0.0859, 0.155, 0.929 }, { 0.183, 0.154, 0.929 }, { 0.0141, 0.00797, 0.91 }, { 0.01449, 0.002147, 0.927 }
    };
    (void) state;

    for (size_t i = 0; i < PELL_COUNT(media); i++)
        for (int n = 0; n < 6; n++) {
            const double a = media[i][0], s = media[i][1], g = media[i][2], unit = 1.0 / (a + s * (1.0 - g));
            const double enters = n < 3 ? 1.0 : 0.75, thick = n % 3 == 0 ? 0.3 : n % 3;
            const struct pell_medium m = medium_of(a, s, g);
            struct pell_forward f;
            double photons[ANGLES], all = 0.0, sum = 0.0;
            REQUIRE(pell_forward_make(&m, &f));
            pass_slab(a, s, g, enters, thick * unit, photons);
            for (int k = 0; k < ANGLES; k++) {
                const double model =
                    model_transmittance(&f, enters, thick * unit, angles[k] * PELL_PI / 180.0, angles[k + 1] * PELL_PI / 180.0);
                print_message("# medium %zu, %g mean free paths at %.2f, %2.0f degrees: %.2f of %.2g\n", i, thick, enters, angles[k],
                              model / photons[k], photons[k]);
                REQUIRE(model > (thick > 1.5 ? 0.66 : 0.8) * photons[k] && model < 1.16 * photons[k]);
                all += photons[k];
                sum += model;
            }
            REQUIRE(sum > (thick > 1.5 ? 0.8 : 0.9) * all && sum < 1.05 * all);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(beams_fall_as_discrete_ordinates_say),
        cmocka_unit_test(beams_are_as_strong_as_photons_say),
        cmocka_unit_test(broad_beams_are_what_goes_through_slabs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
