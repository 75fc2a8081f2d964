/* SPDX-License-Identifier: MIT
 *
 * specular.c - see pellucid/specular.h. Kelemen and Szirmay-Kalos 2001, "A Microfacet Based Coupled Specular-Matte BRDF Model with
 * Importance Sampling"; Walter et al. 2007, "Microfacet Models for Refraction through Rough Surfaces"; Heitz 2014, "Understanding the
 * Masking-Shadowing Function" (height-correlated G, eq. 99); Heitz 2018, "Sampling the GGX Distribution of Visible Normals".
 *
 * The albedo is an integral over half vectors drawn from the lobe's own distribution, whose weight is smooth and bounded:
 *
 *     Kelemen  h ~ D cos(h):   f n.l dl = F (2 - n.v / ((h.v) cos h)) over n.l > 0
 *     GGX      h ~ visible:    f n.l dl = F G2 / G1
 */
#include "optics/specular.h"

#include "math/quadrature.h"

/* A product rule over the unit square: Gauss and Legendre's over the radius, midpoints over half the turn (the integrand is even). */
#define RADII 24
#define TURNS_GGX 32
#define TURNS_KELEMEN 64 /* more: its integrand has a kink where light grazes */
#define POINTS (RADII * TURNS_KELEMEN)

struct rule {
    float a[POINTS], b[POINTS], c[POINTS], weight[POINTS];
};

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
    const double sin2 = dot(cross, cross); /* not from nh: narrow lobes would drown in the rounding of 1 - cos^2 */

    if (!(nl > 0.0) || !(nv > 0.0) || !(hh > 0.0))
        return 0.0;
    const double F = f0 + (1.0 - f0) * pow(1.0 - fmin(dot(h, v) / sqrt(hh), 1.0), 5.0);
    if (model == PELL_SPECULAR_GGX) {
        const double a2 = r * r * r * r, d = (sin2 + nh * nh * a2) / hh;
        const double sl = sqrt(a2 + (1.0 - a2) * nl * nl), sv = sqrt(a2 + (1.0 - a2) * nv * nv);
        return F * a2 / (2.0 * PELL_PI * d * d * (nl * sv + nv * sl));
    }
    const double m2 = r * r, c2 = nh * nh;
    return F * exp(-sin2 / (c2 * m2)) * hh / (PELL_PI * m2 * c2 * c2);
}

/* Kelemen: a half vector (a, b, c), Beckmann's distribution of width m: tan^2 = -m^2 ln(1 - u). */
static void kelemen_rule(float m, struct rule *rule)
{
    double x[RADII], w[RADII];

    pell_gauss_legendre(RADII, x, w);
    for (int i = 0; i < RADII; i++) {
        /* u = 1 - (1 - x)^2 takes the logarithm's end out of the rule */
        const double rest = (1.0 - x[i]) * (1.0 - x[i]), tan2 = -(double) m * m * log(rest);
        const double c = 1.0 / sqrt(1.0 + tan2), s = sqrt(tan2) * c;
        for (int j = 0; j < TURNS_KELEMEN; j++) {
            const double phi = PELL_PI * (j + 0.5) / TURNS_KELEMEN;
            const int k = i * TURNS_KELEMEN + j;
            rule->a[k] = (float) (s * cos(phi));
            rule->b[k] = (float) (s * sin(phi));
            rule->c[k] = (float) c;
            rule->weight[k] = (float) (w[i] * 2.0 * (1.0 - x[i]) / TURNS_KELEMEN);
        }
    }
}

static void kelemen_albedo(const struct rule *rule, float mu, float *scale, float *bias)
{
    const float s = sqrtf(1.0f - mu * mu);
    float a = 0.0f, b = 0.0f;

    for (int k = 0; k < POINTS; k++) {
        const float vh = s * rule->a[k] + mu * rule->c[k], safe = vh > 1e-7f ? vh : 1e-7f;
        const float f = 2.0f - mu / (safe * rule->c[k]);
        const float w = vh > 0.0f && f > 0.0f ? f * rule->weight[k] : 0.0f;
        const float d = vh < 1.0f ? 1.0f - vh : 0.0f, d2 = d * d, c = d2 * d2 * d;
        a += w * (1.0f - c);
        b += w * c;
    }
    *scale = a;
    *bias = b;
}

/* GGX: points (a, b) of half the unit disc, c = sqrt(1 - a^2). */
static void ggx_rule(struct rule *rule)
{
    double x[RADII], w[RADII];

    pell_gauss_legendre(RADII, x, w);
    for (int i = 0; i < RADII; i++)
        for (int j = 0; j < TURNS_GGX; j++) {
            /* radius 1 - (1 - x)^2 gathers points at the rim, where normals turn away */
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
        const float w = nl > 0.0f ? g * rule->weight[k] : 0.0f;
        const float d = vh < 1.0f ? 1.0f - vh : 0.0f, d2 = d * d, c = d2 * d2 * d;
        a += w * (1.0f - c);
        b += w * c;
    }
    *scale = a;
    *bias = b;
}

/* 2 Int albedo mu dmu of what the look-up interpolates: over t = sqrt(mu) it is piecewise linear, and mu dmu = 2 t^3 dt. Sums to 1
 * for an albedo of 1. */
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
    struct rule rule;

    if (model == PELL_SPECULAR_GGX)
        ggx_rule(&rule);
    for (int j = 0; j < PELL_ALBEDO_ROUGHNESS; j++) {
        const float r = PELL_ROUGHNESS_MIN + (1.0f - PELL_ROUGHNESS_MIN) * (float) j / (PELL_ALBEDO_ROUGHNESS - 1);
        const float width = pell_lobe_width(model, r);
        if (model != PELL_SPECULAR_GGX)
            kelemen_rule(width, &rule);
        for (int i = 0; i < PELL_ALBEDO_MU; i++) {
            const float mu = (float) (i * i) / ((PELL_ALBEDO_MU - 1) * (PELL_ALBEDO_MU - 1));
            float *pair = t->albedo[i][j];
            if (model == PELL_SPECULAR_GGX)
                ggx_albedo(&rule, width, mu, &pair[0], &pair[1]);
            else
                kelemen_albedo(&rule, mu, &pair[0], &pair[1]);
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

static float clamp01(float x)
{
    return x > 0.0f ? x < 1.0f ? x : 1.0f : 0.0f;
}

float pell_specular_albedo(const struct pell_specular_table *table, float f0, float mu, float roughness)
{
    float fraction, scale, bias;
    int j;

    pell_roughness_position(roughness, &j, &fraction);
    pell_albedo_pair(table->albedo[0][j], fraction, mu, &scale, &bias);
    return clamp01(f0 * scale + bias);
}

float pell_specular_mean(const struct pell_specular_table *table, float f0, float roughness)
{
    float fraction;
    int j;

    pell_roughness_position(roughness, &j, &fraction);
    const float *low = table->mean[j], *high = table->mean[j + 1];
    return clamp01(f0 * (low[0] + fraction * (high[0] - low[0])) + low[1] + fraction * (high[1] - low[1]));
}
