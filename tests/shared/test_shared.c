/* SPDX-License-Identifier: MIT
 * test_shared.c - the formulas that C and GLSL share, compiled as C, against closed forms. */
#include "pell_test.h"

#include "shared/bloom.h"
#include "shared/boundary.h"
#include "shared/environment.h"
#include "shared/gloss.h"
#include "shared/lens.h"
#include "shared/light.h"
#include "shared/lobe.h"
#include "shared/phase.h"
#include "shared/sampling.h"
#include "shared/subdivision.h"
#include "shared/table.h"
#include "shared/thickness.h"
#include "shared/tone.h"
#include "shared/wide_light.h"

#define PI 3.14159265358979323846

static void reflectance_at_its_special_angles(void **state)
{
    (void) state;
    for (double eta = 1.1; eta < 2.6; eta += 0.2) {
        const double straight = (eta - 1.0) / (eta + 1.0), brewster = 1.0 / sqrt(1.0 + eta * eta);
        const double s = (1.0 - eta * eta) / (1.0 + eta * eta);
        REQUIRE_NEAR((double) pell_refract((float) eta, 1.0f).reflectance, straight * straight, 1e-6);
        REQUIRE_NEAR((double) pell_refract((float) eta, (float) brewster).reflectance, 0.5 * s * s, 1e-6);
        REQUIRE_NEAR((double) pell_refract((float) eta, 0.0f).reflectance, 1.0, 1e-6);
        /* from the dense side, on both sides of the critical angle */
        const double critical = sqrt(1.0 - 1.0 / (eta * eta));
        REQUIRE(pell_refract((float) (1.0 / eta), (float) (0.99 * critical)).reflectance == 1.0f);
        REQUIRE(pell_refract((float) (1.0 / eta), (float) (0.99 * critical)).cos_t == 0.0f);
        REQUIRE(pell_refract((float) (1.0 / eta), (float) fmin(1.0, 1.01 * critical)).reflectance < 1.0f);
    }
}

static void refraction_is_snells_and_reversible(void **state)
{
    (void) state;
    for (int i = 1; i <= 50; i++) {
        const float c = (float) i / 50.0f, eta = 1.33f;
        const struct pell_refraction in = pell_refract(eta, c), out = pell_refract(1.0f / eta, in.cos_t);
        REQUIRE_NEAR(1.0 - (double) (in.cos_t * in.cos_t), (1.0 - (double) (c * c)) / (double) (eta * eta), 1e-6);
        REQUIRE_NEAR((double) out.reflectance, (double) in.reflectance, 5e-5); /* steep at grazing angles */
        REQUIRE_NEAR((double) out.cos_t, (double) c, 1e-5);
    }
}

static void schlicks_weight_is_a_fifth_power(void **state)
{
    (void) state;
    for (int i = 0; i <= 20; i++) {
        const double c = i / 20.0;
        REQUIRE_NEAR((double) pell_schlick_weight((float) c), pow(1.0 - c, 5.0), 1e-6);
        REQUIRE_NEAR((double) pell_schlick(0.04f, (float) c), 0.04 + 0.96 * pow(1.0 - c, 5.0), 1e-6);
    }
    assert_true(pell_schlick_weight(1.5f) == 0.0f);
}

static void light_that_enters_and_leaves(void **state)
{
    (void) state;
    REQUIRE_NEAR((double) pell_transmittance(0.8f, 0.04f, 0.5f, 0.25f), 1.0 - 0.8 * 0.27, 1e-6);
    REQUIRE_NEAR((double) pell_transmittance(1.0f, 0.04f, 50.0f, 0.25f), 0.0, 1e-6); /* the albedo is at most 1 */
    REQUIRE_NEAR((double) pell_exit_factor(0.8f, 0.3f, 0.2f, 1.0f), (1.0 - 0.24) / (PI * (1.0 - 0.16)), 1e-6);
    REQUIRE_NEAR((double) pell_exit_factor(0.8f, 0.3f, 0.2f, 0.0f), (1.0 - 0.24) / PI, 1e-6);
    assert_true(pell_exit_factor(1.0f, 1.0f, 1.0f, 1.0f) == 0.0f);
    REQUIRE_NEAR((double) pell_smooth_exit_factor(0.9f, 0.75f), 1.2 / PI, 1e-6);
}

/* l = v = n: h = 2 n, and the value of each lobe is the peak of its distribution. */
static void lobes_straight_on(void **state)
{
    (void) state;
    for (int i = 1; i <= 10; i++) {
        const double roughness = 0.1 * i, a2 = pow(roughness, 4.0), m2 = roughness * roughness, n = 0.5 / a2 - 0.5, k = 2.0 / a2 - 2.0;
        const float ggx = pell_lobe_width(PELL_LOBE_GGX, (float) roughness);
        const float beckmann = pell_lobe_width(PELL_LOBE_KELEMEN, (float) roughness);
        REQUIRE_REL((double) pell_lobe_ggx(ggx * ggx, 1.0f, 1.0f, 0.0f, 2.0f, 4.0f), 1.0 / (4.0 * PI * a2), 1e-5);
        REQUIRE_REL((double) pell_lobe_kelemen(beckmann * beckmann, 0.0f, 2.0f, 4.0f), 1.0 / (4.0 * PI * m2), 1e-5);
        REQUIRE_REL((double) pell_lobe_phong(ggx * ggx, 1.0f, 1.0f, 0.0f), (n + 2.0) / (2.0 * PI), 1e-5);
        REQUIRE_REL((double) pell_lobe_blinn_phong(ggx * ggx, 0.0f, 4.0f), (k + 2.0) * (k + 4.0) / (8.0 * PI * (exp2(-0.5 * k) + k)), 1e-5);
    }
}

/* The number of directions reflected at sampled half vectors in a cap around n agrees with the density, for oblique views. */
static void mirrored_directions_have_their_density(void **state)
{
    enum { DRAWN = 1 << 14, RINGS = 1500, STEPS = 1500 };
    const float width2 = 0.04f;
    const double vx = sin(0.6), vz = cos(0.6), cap = 0.5;
    double drawn = 0.0, sum = 0.0;

    (void) state;
    for (uint32_t i = 0; i < DRAWN; i++) {
        const struct pell_point2 at = pell_disc_at(pell_unit_float(pell_sobol0(i)), pell_unit_float(pell_sobol1(i)));
        const struct pell_half_vector h = pell_half_vector_at(width2, at.x, at.y);
        const double x = h.x, y = h.y, z = h.z, hv = x * vx + z * vz;
        REQUIRE_NEAR(x * x + y * y + z * z, 1.0, 1e-5);
        drawn += 2.0 * hv * z - vz > cap ? 1.0 / DRAWN : 0.0;
    }
    for (int k = 0; k < RINGS * STEPS; k++) {
        const double lz = cap + (1.0 - cap) * (k / STEPS + 0.5) / RINGS, phi = 2.0 * PI * (k % STEPS + 0.5) / STEPS,
                     s = sqrt(1.0 - lz * lz);
        const double hx = s * cos(phi) + vx, hy = s * sin(phi), hz = lz + vz;
        sum += (double) pell_half_vector_density(width2, (float) (hx * hx + hy * hy), (float) hz, (float) (hx * hx + hy * hy + hz * hz));
    }
    REQUIRE_REL(drawn, sum * 2.0 * PI * (1.0 - cap) / (RINGS * STEPS), 1e-3);
}

static struct pell_phase_terms terms_of(int shape, double g, double second, double weight)
{
    const double uniform = 1.0 / (4.0 * PI), gs[2] = { g, second }, ws[2] = { weight, 1.0 - weight };
    struct pell_phase_terms f = { .shape = shape };

    for (int k = 0; k < 2; k++) {
        f.n[k] = (float) (ws[k] * (1.0 - gs[k] * gs[k]) * uniform);
        f.a[k] = (float) (1.0 + gs[k] * gs[k]);
        f.b[k] = (float) (2.0 * gs[k]);
    }
    if (shape == PELL_PHASE_TERMS_ISOTROPIC)
        f.n[0] = (float) uniform;
    if (shape == PELL_PHASE_TERMS_RAYLEIGH)
        f.n[0] = (float) (0.75 * uniform);
    if (shape == PELL_PHASE_TERMS_SCHLICK)
        f.b[0] = (float) g;
    return f;
}

/* 2 pi Int f dc = 1, and the mean of -c. */
static void phase_functions_hold_all_light(void **state)
{
    const double g = 0.6, k = 0.6, schlick = 1.0 / k - (1.0 / (k * k) - 1.0) * atanh(k);
    const struct {
        struct pell_phase_terms f;
        double mean;
    } cases[] = {
        { terms_of(PELL_PHASE_TERMS_ISOTROPIC, 0.0, 0.0, 1.0), 0.0 },
        { terms_of(PELL_PHASE_TERMS_HENYEY_GREENSTEIN, g, 0.0, 1.0), g },
        { terms_of(PELL_PHASE_TERMS_HENYEY_GREENSTEIN, -g, 0.0, 1.0), -g },
        { terms_of(PELL_PHASE_TERMS_SCHLICK, k, 0.0, 1.0), schlick },
        { terms_of(PELL_PHASE_TERMS_RAYLEIGH, 0.0, 0.0, 1.0), 0.0 },
        { terms_of(PELL_PHASE_TERMS_TWO_LOBE, g, -0.3, 0.7), 0.7 * g - 0.3 * 0.3 },
    };
    const int n = 20000;
    (void) state;

    for (size_t j = 0; j < PELL_COUNT(cases); j++) {
        double sum = 0.0, mean = 0.0;
        for (int i = 0; i < n; i++) {
            const double c = -1.0 + 2.0 * (i + 0.5) / n, f = (double) pell_phase_evaluate(cases[j].f, (float) c);
            sum += 2.0 * PI * f * 2.0 / n;
            mean -= 2.0 * PI * f * c * 2.0 / n;
        }
        REQUIRE_NEAR(sum, 1.0, 1e-5);
        REQUIRE_NEAR(mean, cases[j].mean, 1e-5);
    }
}

static void henyey_and_greensteins_two_forms_agree(void **state)
{
    (void) state;
    for (double g = -0.9; g < 0.95; g += 0.3)
        for (double c = -1.0; c <= 1.0; c += 0.125) {
            const float base = PELL_PHASE_HG_BASE((float) g, (float) -c);
            const double value = (1.0 - g * g) / (4.0 * PI * pow(1.0 + g * g + 2.0 * g * c, 1.5));
            REQUIRE_REL((double) PELL_PHASE_HG_VALUE((float) g, base, sqrtf(base)), value, 1e-5);
            REQUIRE_REL((double) pell_phase_evaluate(terms_of(PELL_PHASE_TERMS_HENYEY_GREENSTEIN, g, 0.0, 1.0), (float) c), value, 5e-5);
        }
}

static void places_are_the_entries(void **state)
{
    (void) state;
    for (int n = 2; n <= 512; n *= 2)
        for (int i = 0; i < n; i++) {
            const double t = (double) i / (n - 1);
            REQUIRE_NEAR((double) pell_cosine_coord((float) (t * t), n), i, 1e-4);
            REQUIRE_NEAR((double) pell_thickness_coord((float) (7.0 * t * t), 7.0f, n), i, 1e-4);
            REQUIRE_NEAR((double) pell_roughness_coord((float) (0.1 + 0.9 * t), 0.1f, n), i, 1e-4);
            assert_int_equal(pell_table_cell((float) i + 0.5f, n), i < n - 2 ? i : n - 2);
        }
    assert_true(pell_roughness_coord(0.0f, 0.1f, 16) == 0.0f);
    assert_true(pell_roughness_coord(2.0f, 0.1f, 16) == 15.0f);
    assert_int_equal(pell_table_cell(1e30f, 16), 14);
    assert_int_equal(pell_table_cell(NAN, 16), 14); /* inside the table for any input */
    assert_true(pell_saturate(NAN) == 0.0f);
    REQUIRE_NEAR((double) pell_bilinear(1.0f, 2.0f, 3.0f, 5.0f, 0.25f, 0.5f), 0.5 * (1.25 + 3.5), 1e-6);
    REQUIRE_NEAR((double) pell_thickness_transmission(0.5f, 0.25f, 3.25f, 8), 0.5 - 0.25 * 0.25, 1e-6);
    assert_true(pell_thickness_transmission(0.5f, 0.25f, 7.0f, 8) == 0.0f); /* no light arrives beyond the last entry */
}

static void tone_curve_and_its_inverse(void **state)
{
    (void) state;
    for (float white = 1.0f; white < 9.0f; white *= 2.0f) {
        const float a = 1.0f / (white * white);
        REQUIRE_NEAR((double) (white * PELL_TONE_SCALE(1.0f, white, 1.0f, a)), 1.0, 1e-6);
        for (float l = 0.01f; l <= white; l *= 1.7f) {
            const double shown = (double) l * (1.0 + (double) l * (double) a) / (1.0 + (double) l);
            REQUIRE_REL((double) (l * PELL_TONE_SCALE(1.0f, l, 1.0f, a)), shown, 1e-6);
            REQUIRE_REL((double) pell_tone_inverse((float) shown, a), (double) l, 1e-4);
        }
    }
    REQUIRE_NEAR((double) PELL_TONE_SCALE(3.0f, 0.7f, 0.0f, 0.0f), 3.0, 1e-6);
    REQUIRE_NEAR((double) PELL_LUMINANCE(1.0f, 1.0f, 1.0f), 1.0, 1e-6);
    for (int i = 0; i <= 255; i++)
        REQUIRE_NEAR((double) pell_srgb_encode(pell_srgb_decode((float) i / 255.0f)), i / 255.0, 1e-6);
    REQUIRE_NEAR((double) pell_srgb_decode(0.5f), pow((0.5 + 0.055) / 1.055, 2.4), 1e-6);
}

static void lights_fall_off(void **state)
{
    const double inner = 0.9, outer = 0.5, scale = 1.0 / (inner - outer);
    (void) state;
    REQUIRE_REL((double) pell_light_falloff(2000.0f, 1e6f, 0.0f), 0.25, 1e-6);
    REQUIRE_REL((double) pell_light_falloff(50.0f, 1.0f, 0.01f), 15.0 / 16.0 / 2500.0, 1e-6);
    assert_true(pell_light_window(100.0f * 100.0f, 0.0101f) == 0.0f);
    for (int i = 0; i <= 10; i++) {
        const double c = outer + (inner - outer) * i / 10.0;
        REQUIRE_NEAR((double) pell_light_cone((float) c, (float) scale, (float) (-outer * scale)), i * i / 100.0, 1e-5);
    }
    assert_true(pell_light_cone(0.3f, (float) scale, (float) (-outer * scale)) == 0.0f);
    REQUIRE_NEAR((double) pell_light_cone(1.0f, (float) scale, (float) (-outer * scale)), 1.0, 1e-6);
}

/* 0 at 0, x at 1, and zero slope there: no visible change of brightness where normals begin to differ. */
static void soft_terminator_is_smooth(void **state)
{
    (void) state;
    assert_true(pell_soft_terminator(0.7f, 0.0f) == 0.0f && pell_soft_terminator(0.7f, 1.0f) == 0.7f);
    REQUIRE_NEAR((double) (pell_soft_terminator(1.0f, 1.0f) - pell_soft_terminator(1.0f, 0.99f)) / 0.01, 0.0, 0.03);
    for (float g = 0.0f; g < 0.95f; g += 0.1f)
        assert_true(pell_soft_terminator(1.0f, g + 0.1f) > pell_soft_terminator(1.0f, g));
}

/* The solid angle of a rectangle over a point is 4 asin(ab / sqrt((a^2 + 4 h^2)(b^2 + 4 h^2))); uniform directions in it have the mean
 * cosine that its irradiance by Lambert (1760) implies, and cells of the unit square receive directions in proportion. */
/* Between parallel faces the thickness of a slab is the distance of its faces, for any direction of the light; near a corner it is the
 * length of the segment. */
static void slabs_are_as_thick_as_they_are(void **state)
{
    (void) state;
    for (int i = 1; i <= 20; i++) {
        const float cosine = (float) i / 20.0f, m = 3.0f / cosine;
        assert_true(pell_thickness_cosine(-cosine, -cosine) == cosine);
        REQUIRE_NEAR((double) pell_thickness_of(m, cosine, -1.0f), 3.0, 1e-6);
        assert_true(pell_thickness_of(m, cosine, 0.0f) == m && pell_thickness_of(m, cosine, 1.0f) == m);
        /* a normal map with grazing light keeps half of the triangle's cosine */
        assert_true(pell_thickness_cosine(-0.1f * cosine, -cosine) == 0.5f * cosine);
        /* full weight where A faces away from the viewer or from C, none where it is visible and faces the same direction */
        assert_true(pell_thickness_counted(cosine, -0.1f) == 1.0f && pell_thickness_counted(-cosine, 1.0f) == 1.0f);
        REQUIRE_NEAR((double) pell_thickness_counted(cosine, 0.25f), 1.0 - (double) cosine, 1e-6);
        assert_true(pell_thickness_opposed(-cosine) == cosine && pell_thickness_opposed(cosine) == 0.0f);
        assert_true(pell_thickness_facing(cosine, cosine, 1.0f) == 1.0f);
        REQUIRE_NEAR((double) pell_thickness_facing(0.5f * cosine, cosine, 1.0f), 0.5, 1e-6);
    }
    assert_true(pell_thickness_cosine(0.5f, 0.5f) == 1e-6f);
    assert_true(pell_thickness_exit(0.25f, 9.0f, 1.5f) == 1.5f && pell_thickness_exit(0.25f, 2.0f, 1.5f) == 1.25f);
}

static void a_wide_light_is_sampled_by_solid_angle(void **state)
{
    const double a = 30.0, b = 12.0, h = 4.0;
    const struct pell_wide w = pell_wide_make(0.0f, 0.0f, 15.0f, 6.0f, 4.0f), oblique = pell_wide_make(12.0f, 3.0f, 15.0f, 6.0f, 4.0f);
    const double x = 0.5 * a / h, y = 0.5 * b / h, rx = sqrt(1.0 + x * x), ry = sqrt(1.0 + y * y);
    const double lambert = 4.0 * 0.5 * (x / rx * atan(y / rx) + y / ry * atan(x / ry)); /* Int cos over the solid angle */
    double cosine = 0.0, left = 0.0;
    enum { SIDE = 200 };

    (void) state;
    REQUIRE_NEAR((double) w.angle, 4.0 * asin(a * b / sqrt((a * a + 4.0 * h * h) * (b * b + 4.0 * h * h))), 1e-5);
    for (int i = 0; i < SIDE; i++)
        for (int k = 0; k < SIDE; k++) {
            const float u = ((float) i + 0.5f) / SIDE, v = ((float) k + 0.5f) / SIDE;
            const struct pell_point2 p = pell_wide_sample(w, u, v), q = pell_wide_sample(oblique, u, v);
            const double px = 0.5 * a * (double) p.x, py = 0.5 * b * (double) p.y;
            REQUIRE(fabsf(p.x) <= 1.00001f && fabsf(p.y) <= 1.00001f && fabsf(q.x) <= 1.00001f && fabsf(q.y) <= 1.00001f);
            cosine += h / sqrt(px * px + py * py + h * h) / (SIDE * SIDE);
            left += q.x < -0.8f ? 1.0 / (SIDE * SIDE) : 0.0; /* the weight that remains for the point */
        }
    REQUIRE_NEAR(cosine * (double) w.angle, lambert, 1e-3);
    REQUIRE_NEAR(left * (double) oblique.angle, (double) pell_wide_make(-1.5f, 3.0f, 1.5f, 6.0f, 4.0f).angle, 2e-2);
    REQUIRE_NEAR((double) pell_wide_sample(w, 0.5f, 0.5f).x, 0.0, 1e-4);
    REQUIRE_NEAR((double) pell_wide_sample(w, 0.5f, 0.5f).y, 0.0, 1e-4);
}

/* Beyond an edge an image is continued by reflection, and a pixel lies between the nearest points of a grid. */
static void edges_mirror_and_cells_hold_pixels(void **state)
{
    static const int row[] = { 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1, 2, 2 };
    (void) state;
    for (int i = -3; i < 10; i++) {
        assert_int_equal(pell_mirror(i, 3), row[i + 3]);
        assert_int_equal(pell_mirror(i, 1), 0);
    }
    for (int f = 2; f <= 1024; f *= 2)
        for (int i = 0; i < 3000; i++) {
            const int cell = pell_grid_cell(i, f);
            const double point = (cell + 0.5) * f; /* of the first, px from the edge */
            REQUIRE(i + 0.5 >= point && i + 0.5 < point + f);
            REQUIRE_NEAR((double) pell_grid_fraction(i, f, cell), (i + 0.5 - point) / f, 1e-6);
        }
}

/* A disc covers its area; it is a point at the focus; a uniform image stays uniform for any depth order. */
static void discs_cover_and_lay(void **state)
{
    static const float weights[][3] = { { 0.2f, 0.3f, 0.9f }, { 0.0f, 1.0f, 0.0f },  { 0.0f, 0.4f, 0.0f },
                                        { 1.5f, 0.2f, 0.1f }, { 0.6f, 0.0f, 0.01f }, { 0.1f, 2.0f, 0.5f } };
    (void) state;
    for (float r = 4.0f; r <= 16.0f; r += 1.5f) {
        double area = 0.0;
        for (int y = -20; y <= 20; y++)
            for (int x = -20; x <= 20; x++)
                area += (double) pell_disc_cover(r, sqrtf((float) (x * x + y * y)));
        REQUIRE_NEAR(area / ((double) (PELL_PI_F * r * r)), 1.0, 0.01);
    }
    REQUIRE(pell_disc_radius(500.0f, 0.01f, 0.01f) == 0.0f && pell_disc_radius(500.0f, 0.01f, 0.02f) == -5.0f);
    REQUIRE(pell_disc_band(10.0f) == 1.5f);
    for (size_t i = 0; i < PELL_COUNT(weights); i++) {
        const float n = weights[i][0], s = weights[i][1], f = weights[i][2];
        REQUIRE_NEAR((double) pell_disc_composite(n, 3.0f * n, s, 3.0f * s, f, 3.0f * f, 1.0f), 3.0, 1e-6);
    }
    /* A near surface covers a fraction of a far one, and all of it where its discs cover the pixel. */
    REQUIRE_NEAR((double) pell_disc_composite(0.25f, 0.25f, 0.0f, 0.0f, 1.0f, 0.0f, 1.0f), 0.25, 1e-6);
    REQUIRE_NEAR((double) pell_disc_composite(1.25f, 1.25f, 0.0f, 0.0f, 1.0f, 0.0f, 1.0f), 1.0, 1e-6);
}

/* From octahedral coordinates back to the direction, by the faces: |x| + |y| + |z| = 1, the lower half folded out. And the environment's
 * azimuth and height are those of the direction made of them. */
static void directions_have_their_places(void **state)
{
    const double last = PELL_ENV_NODES - 1;
    (void) state;

    for (int j = 0; j <= 40; j++)
        for (int i = 0; i <= 40; i++) {
            const double a = 2.0 * i / 40.0 - 1.0, b = 2.0 * j / 40.0 - 1.0, y = 1.0 - fabs(a) - fabs(b);
            const double x = y < 0.0 ? copysign(1.0 - fabs(b), a) : a, z = y < 0.0 ? copysign(1.0 - fabs(a), b) : b;
            const double n = sqrt(x * x + y * y + z * z);
            const struct pell_point2 p = pell_octahedral_coord((float) (x / n), (float) (y / n), (float) (z / n));
            const bool folds = y < -1e-9 && (fabs(a) < 1e-9 || fabs(b) < 1e-9); /* an edge has coordinates on both of its sides */
            REQUIRE(p.x >= 0.0f && (double) p.x <= last && p.y >= 0.0f && (double) p.y <= last);
            REQUIRE_NEAR(folds ? fabs((double) p.x / last - 0.5) : (double) p.x / last, folds ? fabs(a / 2.0) : (a + 1.0) / 2.0, 1e-5);
            REQUIRE_NEAR(folds ? fabs((double) p.y / last - 0.5) : (double) p.y / last, folds ? fabs(b / 2.0) : (b + 1.0) / 2.0, 1e-5);
        }
    for (int j = 1; j < 20; j++)
        for (int i = 1; i < 40; i++) {
            const double azimuth = 2.0 * PI * (i / 40.0 - 0.5), polar = PI * j / 20.0;
            const struct pell_point2 p =
                pell_panorama_uv((float) (sin(azimuth) * sin(polar)), (float) cos(polar), (float) (-cos(azimuth) * sin(polar)));
            REQUIRE_NEAR((double) p.x, i / 40.0, 1e-6);
            REQUIRE_NEAR((double) p.y, j / 20.0, 1e-6);
        }
    REQUIRE(pell_panorama_uv(0.0f, 1.5f, 0.0f).y == 0.0f); /* rounded beyond the pole */
}

/* A point keeps its position in the child that contains it. Corners 3, 4, 5 of a child are the midpoints of sides 0, 1, 2. */
static void points_of_a_cell_are_in_one_of_its_children(void **state)
{
    static const float corner[6][2] = { { 0, 0 }, { 1, 0 }, { 0, 1 }, { 0.5f, 0.5f }, { 0, 0.5f }, { 0.5f, 0 } };
    static const int child_corner[4][4][3] = { { { 0, 5, 4 }, { 5, 1, 3 }, { 4, 3, 2 }, { 3, 4, 5 } },
                                               { { 0, 1, 3 }, { 0, 3, 2 } },
                                               { { 4, 1, 2 }, { 0, 1, 4 } },
                                               { { 0, 5, 2 }, { 5, 1, 2 } } };
    (void) state;

    for (uint32_t pattern = 0; pattern < 4; pattern++)
        for (int i = 0; i <= 16; i++)
            for (int j = 0; j <= 16 - i; j++) {
                const float u = (float) i / 16.0f, v = (float) j / 16.0f;
                const struct pell_child_cell q = pell_child_cell_at(pattern, 1.0f - u - v, u, v);
                const float w[3] = { q.w0, q.w1, q.w2 };
                float at[2] = { 0.0f, 0.0f };
                REQUIRE(q.child >= 0 && q.child < (pattern == 0 ? 4 : 2));
                for (int k = 0; k < 3; k++)
                    for (int axis = 0; axis < 2; axis++)
                        at[axis] += w[k] * corner[child_corner[pattern][q.child][k]][axis];
                REQUIRE(w[0] >= 0.0f && w[1] >= 0.0f && w[2] >= 0.0f);
                REQUIRE_NEAR((double) (w[0] + w[1] + w[2]), 1.0, 1e-6);
                REQUIRE_NEAR((double) at[0], (double) u, 1e-6);
                REQUIRE_NEAR((double) at[1], (double) v, 1e-6);
            }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_of_a_cell_are_in_one_of_its_children),
        cmocka_unit_test(reflectance_at_its_special_angles),
        cmocka_unit_test(refraction_is_snells_and_reversible),
        cmocka_unit_test(schlicks_weight_is_a_fifth_power),
        cmocka_unit_test(light_that_enters_and_leaves),
        cmocka_unit_test(lobes_straight_on),
        cmocka_unit_test(mirrored_directions_have_their_density),
        cmocka_unit_test(phase_functions_hold_all_light),
        cmocka_unit_test(henyey_and_greensteins_two_forms_agree),
        cmocka_unit_test(places_are_the_entries),
        cmocka_unit_test(tone_curve_and_its_inverse),
        cmocka_unit_test(lights_fall_off),
        cmocka_unit_test(soft_terminator_is_smooth),
        cmocka_unit_test(slabs_are_as_thick_as_they_are),
        cmocka_unit_test(a_wide_light_is_sampled_by_solid_angle),
        cmocka_unit_test(edges_mirror_and_cells_hold_pixels),
        cmocka_unit_test(discs_cover_and_lay),
        cmocka_unit_test(directions_have_their_places),
    };
    return cmocka_run_group_tests_name("shared", tests, NULL, NULL);
}
