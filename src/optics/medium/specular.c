/* SPDX-License-Identifier: MIT
 *
 * specular.c - see pellucid/specular.h. Kelemen and Szirmay-Kalos 2001, "A Microfacet Based Coupled Specular-Matte BRDF Model with
 * Importance Sampling"; Walter et al. 2007, "Microfacet Models for Refraction through Rough Surfaces"; Heitz 2014, "Understanding the
 * Masking-Shadowing Function" (height-correlated G, eq. 99); Heitz 2018, "Sampling the GGX Distribution of Visible Normals"; Phong 1975,
 * "Illumination for Computer Generated Pictures"; Blinn 1977, "Models of Light Reflection for Computer Synthesized Pictures"; Lafortune and
 * Willems 1994, "Using the Modified Phong Reflectance Model for Physically Based Rendering".
 *
 * The albedo is an integral over directions drawn from the lobe's own distribution, whose weight is smooth and bounded, over n.l > 0:
 *
 *     GGX      h ~ visible:    f n.l dl = F G2 / G1
 *     Kelemen  h ~ D cos(h):   f n.l dl = F (2 - n.v / ((h.v) cos h))
 *     Phong    l ~ cos^n(l,r): f n.l dl = F n.l (n + 2)/(n + 1)
 *     Blinn    h ~ cos^n(h):   f n.l dl = F n.l h.v (n + 2)(n + 4)/((n + 1)(2^(-n/2) + n))
 */
#include "optics/medium/specular.h"

#include "math/quadrature.h"
#include "math/vec.h"

/* A product rule over the unit square: Gauss-Legendre over the radius, midpoints over half the turn (the integrand is even). */
#define RADII 24
#define TURNS_GGX 32
#define TURNS 64 /* for the other models: their integrands have a kink at grazing angles */
#define POINTS (RADII * TURNS)

struct rule {
    float a[POINTS], b[POINTS], c[POINTS], weight[POINTS];
};

/* Exponents of Beckmann's width. */
static double phong_exponent(double alpha)
{
    return 0.5 / (alpha * alpha) - 0.5;
}

static double blinn_exponent(double alpha)
{
    return 2.0 / (alpha * alpha) - 2.0;
}

/* normalisation of Blinn's lobe over 8 pi */
static double blinn_factor(double n)
{
    return (n + 2.0) * (n + 4.0) / (exp2(-0.5 * n) + n);
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

double pell_specular_value(enum pell_specular_model model, double roughness, double f0, const double n[3], const double l[3],
                           const double v[3])
{
    const double r = fmin(fmax(roughness, (double) PELL_ROUGHNESS_MIN), 1.0), nl = dot(n, l), nv = dot(n, v), nh = nl + nv;
    const double h[3] = { l[0] + v[0], l[1] + v[1], l[2] + v[2] }, hh = dot(h, h);
    const double cross[3] = { n[1] * h[2] - n[2] * h[1], n[2] * h[0] - n[0] * h[2], n[0] * h[1] - n[1] * h[0] };
    const double sin2 = dot(cross, cross); /* not from nh: narrow lobes would be lost in the rounding of 1 - cos^2 */

    if (!(nl > 0.0) || !(nv > 0.0) || !(hh > 0.0))
        return 0.0;
    const double F = f0 + (1.0 - f0) * pow(1.0 - fmin(dot(h, v) / sqrt(hh), 1.0), 5.0), alpha = r * r;
    switch (model) {
    case PELL_SPECULAR_KELEMEN: {
        const double m2 = r * r, c2 = nh * nh;
        return F * exp(-sin2 / (c2 * m2)) * hh / (PELL_PI * m2 * c2 * c2);
    }
    case PELL_SPECULAR_PHONG: {
        /* l minus the mirror direction is nl - nv along n, plus a part perpendicular to n */
        const double n_phong = phong_exponent(alpha), rest = 0.5 * (sin2 + (nl - nv) * (nl - nv));
        return rest < 1.0 ? F * (n_phong + 2.0) / (2.0 * PELL_PI) * exp(n_phong * log1p(-rest)) : 0.0;
    }
    case PELL_SPECULAR_BLINN_PHONG: {
        const double n_blinn = blinn_exponent(alpha);
        return F * blinn_factor(n_blinn) / (8.0 * PELL_PI) * exp(0.5 * n_blinn * log1p(-fmin(sin2 / hh, 1.0 - 1e-16)));
    }
    default: {
        const double a2 = alpha * alpha, d = (sin2 + nh * nh * a2) / hh;
        const double sl = sqrt(a2 + (1.0 - a2) * nl * nl), sv = sqrt(a2 + (1.0 - a2) * nv * nv);
        return F * a2 / (2.0 * PELL_PI * d * d * (nl * sv + nv * sl));
    }
    }
}

/* Unit vectors (a, b, c) around (0, 0, 1), with uniform azimuth; tan2(rest) gives tan^2 of the angle that encloses all but `rest` of them,
 * and `rest` = (1 - x)^2 removes the logarithmic end point from the rule. */
static void round_rule(double (*tan2)(double width, double rest), float width, struct rule *rule)
{
    double x[RADII], w[RADII];

    pell_gauss_legendre(RADII, x, w);
    for (int i = 0; i < RADII; i++) {
        const double t2 = tan2((double) width, (1.0 - x[i]) * (1.0 - x[i])), c = 1.0 / sqrt(1.0 + t2), s = sqrt(t2) * c;
        for (int j = 0; j < TURNS; j++) {
            const double phi = PELL_PI * (j + 0.5) / TURNS;
            const int k = i * TURNS + j;
            rule->a[k] = (float) (s * cos(phi));
            rule->b[k] = (float) (s * sin(phi));
            rule->c[k] = (float) c;
            rule->weight[k] = (float) (w[i] * 2.0 * (1.0 - x[i]) / TURNS);
        }
    }
}

/* Beckmann's distribution of width m. */
static double beckmann_tan2(double m, double rest)
{
    return -m * m * log(rest);
}

static void kelemen_rule(float m, struct rule *rule)
{
    round_rule(beckmann_tan2, m, rule);
}

static void kelemen_albedo(const struct rule *rule, float m, float mu, float *scale, float *bias)
{
    const float s = sqrtf(1.0f - mu * mu);
    float a = 0.0f, b = 0.0f;
    (void) m;

    for (int k = 0; k < POINTS; k++) {
        const float vh = s * rule->a[k] + mu * rule->c[k], safe = vh > 1e-7f ? vh : 1e-7f;
        const float f = 2.0f - mu / (safe * rule->c[k]);
        const float all = f * rule->weight[k], w = vh > 0.0f && f > 0.0f ? all : 0.0f, c = pell_schlick_weight(vh);
        a += w * (1.0f - c);
        b += w * c;
    }
    *scale = a;
    *bias = b;
}

/* cos^n: the fraction within an angle t is 1 - cos^(n+1) t. */
static double phong_tan2(double alpha, double rest)
{
    return expm1(-2.0 * log(rest) / (phong_exponent(alpha) + 1.0));
}

static void phong_rule(float alpha, struct rule *rule)
{
    round_rule(phong_tan2, alpha, rule);
}

/* The rule's vectors are around r = (-s, 0, mu); v has the component 2 mu^2 - 1 along it, and 2 s mu perpendicular to it. */
static void phong_albedo(const struct rule *rule, float alpha, float mu, float *scale, float *bias)
{
    const float n = (float) phong_exponent((double) alpha), factor = (n + 2.0f) / (n + 1.0f), s = sqrtf(1.0f - mu * mu);
    const float along = 2.0f * mu * mu - 1.0f, across = 2.0f * s * mu;
    float a = 0.0f, b = 0.0f;

    for (int k = 0; k < POINTS; k++) {
        const float nl = mu * rule->c[k] + s * rule->a[k], lv = along * rule->c[k] + across * rule->a[k];
        const float vh2 = 0.5f + 0.5f * lv, c = pell_schlick_weight(sqrtf(vh2 > 0.0f ? vh2 : 0.0f));
        const float all = factor * nl * rule->weight[k], w = nl > 0.0f ? all : 0.0f;
        a += w * (1.0f - c);
        b += w * c;
    }
    *scale = a;
    *bias = b;
}

static double blinn_tan2(double alpha, double rest)
{
    return expm1(-2.0 * log(rest) / (blinn_exponent(alpha) + 1.0));
}

static void blinn_rule(float alpha, struct rule *rule)
{
    round_rule(blinn_tan2, alpha, rule);
}

static void blinn_albedo(const struct rule *rule, float alpha, float mu, float *scale, float *bias)
{
    const double n = blinn_exponent((double) alpha);
    const float factor = (float) (blinn_factor(n) / (n + 1.0)), s = sqrtf(1.0f - mu * mu);
    float a = 0.0f, b = 0.0f;

    for (int k = 0; k < POINTS; k++) {
        const float vh = s * rule->a[k] + mu * rule->c[k], nl = 2.0f * vh * rule->c[k] - mu;
        const float all = factor * vh * nl * rule->weight[k], w = vh > 0.0f && nl > 0.0f ? all : 0.0f, c = pell_schlick_weight(vh);
        a += w * (1.0f - c);
        b += w * c;
    }
    *scale = a;
    *bias = b;
}

/* Points (a, b) of half the unit disc, c = sqrt(1 - a^2), for every width. */
static void ggx_rule(float alpha, struct rule *rule)
{
    double x[RADII], w[RADII];
    (void) alpha;

    pell_gauss_legendre(RADII, x, w);
    for (int i = 0; i < RADII; i++)
        for (int j = 0; j < TURNS_GGX; j++) {
            /* radius 1 - (1 - x)^2 concentrates points at the rim, where normals are grazing */
            const double phi = PELL_PI * (j + 0.5) / TURNS_GGX - 0.5 * PELL_PI, r = 1.0 - (1.0 - x[i]) * (1.0 - x[i]);
            const int k = i * TURNS_GGX + j;
            rule->a[k] = (float) (r * cos(phi));
            rule->b[k] = (float) (r * sin(phi));
            rule->c[k] = (float) sqrt(1.0 - (double) rule->a[k] * rule->a[k]);
            rule->weight[k] = (float) (w[i] * 2.0 * (1.0 - x[i]) * 2.0 * r / TURNS_GGX);
        }
}

static void ggx_albedo(const struct rule *rule, float alpha, float mu, float *scale, float *bias)
{
    const float sin_v = sqrtf(1.0f - mu * mu), length = sqrtf(alpha * alpha * sin_v * sin_v + mu * mu);
    const float vx = alpha * sin_v / length, vz = mu / length, half = 0.5f * (1.0f + vz);
    const float a2 = alpha * alpha, sv = sqrtf(a2 + (1.0f - a2) * mu * mu);
    float a = 0.0f, b = 0.0f;

    for (int k = 0; k < RADII * TURNS_GGX; k++) {
        const float t1 = rule->a[k], t2 = (1.0f - half) * rule->c[k] + half * rule->b[k];
        const float rest = 1.0f - t1 * t1 - t2 * t2, t3 = sqrtf(rest > 0.0f ? rest : 0.0f);
        float x = alpha * (t3 * vx - t2 * vz), y = alpha * t1, z = t2 * vx + t3 * vz;
        z = z > 1e-7f ? z : 1e-7f;
        const float inv = 1.0f / sqrtf(x * x + y * y + z * z);
        const float hz = z * inv, vh = sin_v * x * inv + mu * hz;
        const float nl = 2.0f * vh * hz - mu, sl = sqrtf(a2 + (1.0f - a2) * nl * nl);
        const float g = nl * (mu + sv) / (nl * sv + mu * sl + 1e-30f);
        const float all = g * rule->weight[k], w = nl > 0.0f ? all : 0.0f, c = pell_schlick_weight(vh);
        a += w * (1.0f - c);
        b += w * c;
    }
    *scale = a;
    *bias = b;
}

/* Data needed to tabulate a lobe. `width`: from pell_lobe_width; a rule holds for all mu, and for all widths if `fixed`. */
static const struct lobe {
    const char *name;
    bool fixed;
    void (*rule)(float width, struct rule *rule);
    void (*albedo)(const struct rule *rule, float width, float mu, float *scale, float *bias);
} lobes[PELL_SPECULAR_MODELS] = {
    [PELL_SPECULAR_GGX] = { "ggx", true, ggx_rule, ggx_albedo },
    [PELL_SPECULAR_KELEMEN] = { "kelemen", false, kelemen_rule, kelemen_albedo },
    [PELL_SPECULAR_PHONG] = { "phong", false, phong_rule, phong_albedo },
    [PELL_SPECULAR_BLINN_PHONG] = { "blinn-phong", false, blinn_rule, blinn_albedo },
};

const char *pell_specular_name(enum pell_specular_model model)
{
    return lobes[pell_specular_known(model)].name;
}

/* 2 Int albedo mu dmu of the interpolated table: it is piecewise linear over t = sqrt(mu), and mu dmu = 2 t^3 dt. The weights sum to 1 for
 * an albedo of 1. */
static float interpolated_mean(const float *first, size_t step)
{
    double sum = 0.0;
    for (int i = 0; i + 1 < PELL_ALBEDO_MU; i++) {
        const double h = 1.0 / (PELL_ALBEDO_MU - 1), t0 = i * h, t1 = t0 + h;
        const double p4 = (pow(t1, 4) - pow(t0, 4)) / 4.0, p5 = (pow(t1, 5) - pow(t0, 5)) / 5.0;
        const double slope = ((double) first[(size_t) (i + 1) * step] - first[(size_t) i * step]) / h;
        sum += 4.0 * (first[(size_t) i * step] * p4 + slope * (p5 - t0 * p4));
    }
    return (float) sum;
}

void pell_specular_table_make(enum pell_specular_model model, struct pell_specular_table *t)
{
    const enum pell_specular_model known = pell_specular_known(model);
    struct rule rule;

    for (int j = 0; j < PELL_ALBEDO_ROUGHNESS; j++) {
        const float r = PELL_ROUGHNESS_MIN + (1.0f - PELL_ROUGHNESS_MIN) * (float) j / (PELL_ALBEDO_ROUGHNESS - 1);
        const float width = pell_lobe_width((int) known, r);
        if (j == 0 || !lobes[known].fixed)
            lobes[known].rule(width, &rule);
        for (int i = 0; i < PELL_ALBEDO_MU; i++) {
            const float mu = (float) (i * i) / ((PELL_ALBEDO_MU - 1) * (PELL_ALBEDO_MU - 1));
            lobes[known].albedo(&rule, width, mu, &t->albedo[i][j][0], &t->albedo[i][j][1]);
        }
        for (int k = 0; k < 2; k++)
            t->mean[j][k] = interpolated_mean(&t->albedo[0][j][k], (size_t) PELL_ALBEDO_ROUGHNESS * 2);
    }
}

void pell_boundary_table_make(double eta, struct pell_boundary_table *b)
{
    const double f0 = (eta - 1.0) / (eta + 1.0);

    b->eta = eta;
    b->f0 = (float) (f0 * f0);
    b->mean = (float) pell_fresnel_exit_norm(eta);
    for (int i = 0; i < PELL_BOUNDARY_MU; i++) {
        const double t = (double) i / (PELL_BOUNDARY_MU - 1);
        b->transmittance[i] = eta == 1.0 ? 1.0f : (float) (1.0 - pell_fresnel(eta, t * t));
    }
}

float pell_specular_albedo(const struct pell_specular_table *table, float f0, float mu, float roughness)
{
    float fraction, scale, bias;
    int j;

    pell_roughness_position(roughness, &j, &fraction);
    pell_albedo_pair(table->albedo[0][j], fraction, mu, &scale, &bias);
    return pell_saturate(f0 * scale + bias);
}

float pell_specular_mean(const struct pell_specular_table *table, float f0, float roughness)
{
    float fraction;
    int j;

    pell_roughness_position(roughness, &j, &fraction);
    const float *low = table->mean[j], *high = table->mean[j + 1];
    return pell_saturate(f0 * (low[0] + fraction * (high[0] - low[0])) + low[1] + fraction * (high[1] - low[1]));
}
