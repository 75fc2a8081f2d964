/* SPDX-License-Identifier: MIT
 *
 * inversion.c - see pellucid/inversion.h. H. C. van de Hulst, "Multiple Light Scattering", 1980; E. d'Eon, "A Hitchhiker's Guide to
 * Multiple Scattering"; C. Kulla, A. Conty, "Revisiting Physically Based Shading at Imageworks", 2017; M. J.-Y. Chiang, P. Kutz, B.
 * Burley, "Practical and Controllable Subsurface Scattering for Production Path Tracing", 2016; P. H. Christensen, B. Burley,
 * "Approximate Reflectance Profiles for Efficient Subsurface Scattering", 2015; OpenPBR 1.1; Cycles' documentation of its subsurface
 * closures. */
#include <pellucid/inversion.h>

#include "math/vec.h"
#include "optics/medium/range.h"

#include <math.h>
#include <string.h>

static double clamp(double x, double min, double max)
{
    return x < min ? min : x > max ? max : x; /* NaN stays */
}

double pell_albedo_of_reduced(double albedo_reduced, double g)
{
    return albedo_reduced / (1.0 - g * (1.0 - albedo_reduced));
}

double pell_albedo_reduced_of(double albedo, double g)
{
    return albedo * (1.0 - g) / (1.0 - g * albedo);
}

/* --- A function that falls ------------------------------------------------------------------------------------------------------- */

/* All inversions are over x = sqrt(1 - alpha') in [0, 1], in which totals of half-spaces are smooth and decreasing (1 - c x next to
 * white). */
typedef enum pell_result (*falling)(double x, const void *arg, double *out);

/* x with f(x) = target, f(0) = top >= target >= f(1) = bottom: regula falsi after Anderson and Bjorck 1973, with a bisection after every
 * two steps that did not halve the bracket. */
static enum pell_result solve(falling f, const void *arg, double target, double top, double bottom, double *x)
{
    const double tolerance = 1e-13 + 1e-11 * target;
    double low = 0.0, high = 1.0, over = top - target, under = bottom - target, before = 1.0;
    int side = 0;

    if (over <= tolerance || under >= -tolerance) {
        *x = over <= tolerance ? 0.0 : 1.0;
        return PELL_OK;
    }
    for (int step = 1; high - low > 1e-12; step++) {
        double middle = low + (high - low) * over / (over - under), value = 0.0;
        const bool slow = step % 3 == 0 && high - low > 0.5 * before;

        if (step % 3 == 0)
            before = high - low;
        if (slow || !(middle > low && middle < high))
            middle = 0.5 * (low + high);
        const enum pell_result res = f(middle, arg, &value);
        if (res != PELL_OK)
            return res;
        value -= target;
        *x = middle;
        if (fabs(value) <= tolerance)
            return PELL_OK;
        if (value > 0.0) {
            if (side > 0)
                under *= value < over ? 1.0 - value / over : 0.5;
            low = middle;
            over = value;
            side = 1;
        } else {
            if (side < 0)
                over *= value > under ? 1.0 - value / under : 0.5;
            high = middle;
            under = value;
            side = -1;
        }
    }
    *x = 0.5 * (low + high);
    return PELL_OK;
}

/* --- Closed maps ---------------------------------------------------------------------------------------------------------------- */

static const struct pell_albedo_map_row map_rows[PELL_ALBEDO_MAPS] = {
    [PELL_ALBEDO_VAN_DE_HULST] = { "van-de-hulst",
                                   "H. C. van de Hulst, \"Multiple Light Scattering\", 1980; C. Kulla, A. Conty, SIGGRAPH 2017 course" },
    [PELL_ALBEDO_CHIANG] = { "chiang",
                             "M. J.-Y. Chiang, P. Kutz, B. Burley, \"Practical and Controllable Subsurface Scattering for Production "
                             "Path Tracing\", SIGGRAPH 2016" },
    [PELL_ALBEDO_DIPOLE] = { "dipole", "H. W. Jensen, S. R. Marschner, M. Levoy, P. Hanrahan, \"A Practical Model for Subsurface Light "
                                       "Transport\", SIGGRAPH 2001" },
};

size_t pell_albedo_map_count(void)
{
    return PELL_ALBEDO_MAPS;
}

const struct pell_albedo_map_row *pell_albedo_map_at(size_t index)
{
    return index < PELL_ALBEDO_MAPS ? &map_rows[index] : NULL;
}

/* s = h0 + h1 A - sqrt(h2 + h3 A + h4 A^2), the lesser root of 0.139 s^2 - (1.139 + 1.17 A) s + 1 - A = 0, with the six digits that are in
 * print: files of other programs were made with these. */
static const double hulst[5] = { 4.09712, 4.20863, 9.59217, 41.6808, 17.7126 };

/* Its inverse, a quadratic equation whose leading coefficient nearly vanishes. */
static double hulst_color(double s)
{
    const double d = hulst[0] - s, a = hulst[1] * hulst[1] - hulst[4], b = 2.0 * hulst[1] * d - hulst[3], c = d * d - hulst[2];
    return clamp(2.0 * c / (-b + sqrt(b * b - 4.0 * a * c)), 0.0, 1.0);
}

/* -ln(1 - alpha') of Chiang et al. */
static double chiang(double A)
{
    return A * (5.09406 + A * (-2.61188 + A * 4.31805));
}

static enum pell_result chiang_color(double x, const void *arg, double *out)
{
    const double *depth = arg; /* of the colour 1 - x */
    *out = chiang(1.0 - x) / depth[0];
    return PELL_OK;
}

static double dipole_total(double fdr, double x)
{
    const double A = (1.0 + fdr) / (1.0 - fdr), s = sqrt(3.0) * x;
    return 0.5 * (1.0 - x) * (1.0 + x) * (exp(-s) + exp(-s * (1.0 + 4.0 / 3.0 * A)));
}

static enum pell_result dipole_color(double x, const void *arg, double *out)
{
    *out = dipole_total(*(const double *) arg, x);
    return PELL_OK;
}

static double clamped_fdr(double eta, enum pell_fresnel_model model)
{
    return pell_fresnel_diffuse(clamp(eta, PELL_ETA_MIN, PELL_ETA_MAX), model);
}

static double invert_dipole(double color, double fdr)
{
    double x = 0.0;
    return solve(dipole_color, &fdr, color, 1.0, 0.0, &x) == PELL_OK ? (1.0 - x) * (1.0 + x) : 0.0;
}

double pell_albedo_map_color(enum pell_albedo_map map, double albedo_reduced, double eta)
{
    const double a = clamp(albedo_reduced, 0.0, 1.0), s = sqrt(1.0 - a), one = 1.0;
    double x = 0.0;

    if (isnan(a) || isnan(eta))
        return NAN;
    if (map == PELL_ALBEDO_DIPOLE)
        return dipole_total(clamped_fdr(eta, PELL_FRESNEL_EXACT), s);
    if (map != PELL_ALBEDO_CHIANG)
        return hulst_color(s);
    /* the fit ends at a = 0.9989 */
    return solve(chiang_color, &one, fmin(-log1p(-a), chiang(1.0)), chiang(1.0), 0.0, &x) == PELL_OK ? 1.0 - x : 0.0;
}

double pell_albedo_map_invert(enum pell_albedo_map map, double color, double eta)
{
    const double A = clamp(color, 0.0, 1.0);

    if (isnan(A) || isnan(eta))
        return NAN;
    if (map == PELL_ALBEDO_DIPOLE)
        return invert_dipole(A, clamped_fdr(eta, PELL_FRESNEL_EXACT));
    if (map == PELL_ALBEDO_CHIANG)
        return -expm1(-chiang(A));
    if (A <= 0.0)
        return 0.0; /* which the six digits miss by 6e-6 */
    const double s = clamp(hulst[0] + hulst[1] * A - sqrt(hulst[2] + A * (hulst[3] + A * hulst[4])), 0.0, 1.0);
    return (1.0 - s) * (1.0 + s);
}

double pell_color_under_boundary(double color, double eta)
{
    const double c = clamp(color, 0.0, 1.0), F = isnan(eta) ? NAN : clamped_fdr(eta, PELL_FRESNEL_EXACT);
    return (1.0 - F) * c / (1.0 - F * c);
}

double pell_color_without_boundary(double color, double eta)
{
    const double c = clamp(color, 0.0, 1.0), F = isnan(eta) ? NAN : clamped_fdr(eta, PELL_FRESNEL_EXACT);
    return c / (1.0 - F * (1.0 - c));
}

/* --- Numeric inversion ---------------------------------------------------------------------------------------------------------- */

struct query {
    enum pell_profile_model model;
    const struct pell_profile_params *params;
    double g, eta;
};

/* The profile of a medium whose reduced mean free path is 1 mm, from its absorption and scattering. */
static enum pell_result make_profile(const struct query *q, double absorbed, double scattered, struct pell_profile *out)
{
    const double a = absorbed, s = scattered;
    const struct pell_medium m = { .sigma_a = { a, a, a }, .sigma_s_reduced = { s, s, s }, .g = { q->g, q->g, q->g }, .eta = q->eta };

    return pell_profile_make(q->model, &m, 0, q->params, out);
}

static enum pell_result total_of(double x, const void *arg, double *out)
{
    struct pell_profile profile;
    const enum pell_result res = make_profile(arg, x * x, (1.0 - x) * (1.0 + x), &profile);

    *out = pell_profile_total(&profile);
    return res;
}

static enum pell_result invert_model(const struct query *q, double color, double *albedo_reduced, const char *field,
                                     struct pell_medium_fault *fault)
{
    double top = 0.0, bottom = 0.0, x = 1.0;
    enum pell_result res = total_of(0.0, q, &top);

    if (res == PELL_OK)
        res = total_of(1.0, q, &bottom);
    if (res != PELL_OK)
        return res;
    /* the last digits of a total are quadrature errors: a colour within them is the largest */
    if (!pell_in_range(field, color, 0.0, top + 1e-9, fault)) {
        if (fault)
            fault->max = top;
        return PELL_ERR_INVALID;
    }
    if (color > 0.0)
        res = solve(total_of, q, fmin(color, top), top, bottom, &x);
    *albedo_reduced = (1.0 - x) * (1.0 + x);
    return res;
}

enum pell_result pell_albedo_of_color(enum pell_profile_model model, const struct pell_profile_params *params, double color, double g,
                                      double eta, double *albedo_reduced, struct pell_medium_fault *fault)
{
    if (!albedo_reduced)
        return PELL_ERR_INVALID;

    const struct query q = { model, params, g, eta };

    *albedo_reduced = 0.0;
    if (fault)
        *fault = (struct pell_medium_fault) { 0 };
    if (!pell_in_range("color", color, 0.0, 1.0, fault) || !pell_in_range("g", g, -PELL_G_MAX, PELL_G_MAX, fault) ||
        !pell_in_range("eta", eta, PELL_ETA_MIN, PELL_ETA_MAX, fault))
        return PELL_ERR_INVALID;
    return invert_model(&q, color, albedo_reduced, "color", fault);
}

/* --- Colour and radius ---------------------------------------------------------------------------------------------------------- */

static const struct pell_scatter_radius_row radius_rows[PELL_SCATTER_RADII] = {
    [PELL_SCATTER_RADIUS_MEAN_FREE_PATH] = { "mean-free-path", "reduced mean free path 1/sigma_t'" },
    [PELL_SCATTER_RADIUS_DIFFUSE] = { "diffuse", "diffuse mean free path 1/sigma_tr" },
    [PELL_SCATTER_RADIUS_EXTINCTION] = { "extinction", "mean free path 1/sigma_t: subsurface radius of OpenPBR and Arnold" },
    [PELL_SCATTER_RADIUS_BURLEY] = { "burley", "shape d of normalized diffusion: Disney's scatter distance" },
    [PELL_SCATTER_RADIUS_CYCLES] = { "cycles", "subsurface radius of Cycles, Christensen-Burley and Random Walk" },
    [PELL_SCATTER_RADIUS_CYCLES_SKIN] = { "cycles-skin", "subsurface radius of Cycles, Random Walk (Skin)" },
    [PELL_SCATTER_RADIUS_MEAN] = { "mean", "mean distance between where light enters and where it leaves" },
};

size_t pell_radius_count(void)
{
    return PELL_SCATTER_RADII;
}

const struct pell_scatter_radius_row *pell_scatter_radius_at(size_t index)
{
    return index < PELL_SCATTER_RADII ? &radius_rows[index] : NULL;
}

bool pell_scatter_radius_find(const char *name, enum pell_scatter_radius *out)
{
    for (int i = 0; name && i < PELL_SCATTER_RADII; i++)
        if (strcmp(radius_rows[i].name, name) == 0) {
            *out = (enum pell_scatter_radius) i;
            return true;
        }
    return false;
}

static const char *const color_names[3] = { "color[0]", "color[1]", "color[2]" };
static const char *const radius_names[3] = { "radius[0]", "radius[1]", "radius[2]" };
static const char *const g_names[3] = { "g[0]", "g[1]", "g[2]" };

static bool input_valid(const struct pell_color_and_radius *in, struct pell_medium_fault *fault)
{
    if (!pell_in_range("kind", (double) (int) in->kind, 0.0, PELL_SCATTER_RADII - 1, fault) ||
        !pell_in_range("eta", in->eta, PELL_ETA_MIN, PELL_ETA_MAX, fault))
        return false;
    for (int c = 0; c < 3; c++)
        if (!pell_in_range(color_names[c], in->color[c], 0.0, 1.0, fault) ||
            !pell_in_range(g_names[c], in->g[c], -PELL_G_MAX, PELL_G_MAX, fault) ||
            !pell_in_range(radius_names[c], in->radius[c], 0.0, HUGE_VAL, fault))
            return false;
    return true;
}

/* The mean radius of a profile in reduced mean free paths; 1 for a profile without light. */
static double mean_radius_of(const struct query *q, double albedo_reduced)
{
    struct pell_profile profile;

    if (make_profile(q, 1.0 - albedo_reduced, albedo_reduced, &profile) != PELL_OK || !(pell_profile_total(&profile) > 0.0))
        return 1.0;
    return pell_profile_mean_radius(&profile);
}

/* sigma_t' times the radius: the radius parameter in reduced mean free paths. */
static double reduced_per_radius(const struct pell_color_and_radius *in, int c, const struct query *q, double albedo_reduced)
{
    const double A = in->color[c], g = in->g[c], rest = 1.0 - albedo_reduced;
    const double reduced_per_extinction = (1.0 - g) / (1.0 - g * rest); /* 1 - alpha g */

    switch (in->kind) {
    case PELL_SCATTER_RADIUS_DIFFUSE: return 1.0 / sqrt(3.0 * rest);
    case PELL_SCATTER_RADIUS_EXTINCTION: return reduced_per_extinction;
    case PELL_SCATTER_RADIUS_BURLEY: return reduced_per_extinction / (1.9 - A + 3.5 * (A - 0.8) * (A - 0.8));
    case PELL_SCATTER_RADIUS_CYCLES: return 4.0 * PELL_PI * reduced_per_extinction / (1.0 - g);
    case PELL_SCATTER_RADIUS_CYCLES_SKIN: {
        const double white = 0.995; /* where its inversion ends, at 1 - a = 1e-6 */
        const double a = A < white ? invert_dipole(A, clamped_fdr(in->eta, PELL_FRESNEL_POLY3)) : 1.0 - 1e-6;
        return reduced_per_extinction / ((1.0 - g) * sqrt(3.0 * (1.0 - a)));
    }
    case PELL_SCATTER_RADIUS_MEAN: return mean_radius_of(q, albedo_reduced);
    default: return 1.0;
    }
}

/* Sets one channel of the medium from its albedo. */
static bool set_channel(const struct pell_color_and_radius *in, int c, const struct query *q, double albedo_reduced,
                        struct pell_medium *out, struct pell_medium_fault *fault)
{
    const double scale = reduced_per_radius(in, c, q, albedo_reduced), sigma_t = scale / in->radius[c];

    if (!(sigma_t >= PELL_SIGMA_T_MIN && sigma_t <= PELL_SIGMA_MAX)) {
        if (fault)
            *fault = (struct pell_medium_fault) { radius_names[c], in->radius[c], scale / PELL_SIGMA_MAX, scale / PELL_SIGMA_T_MIN };
        return false;
    }
    out->sigma_s_reduced[c] = albedo_reduced * sigma_t;
    out->sigma_a[c] = (1.0 - albedo_reduced) * sigma_t;
    out->g[c] = in->g[c];
    if (out->sigma_a[c] + out->sigma_s_reduced[c] < PELL_SIGMA_T_MIN) /* by rounding */
        out->sigma_a[c] = PELL_SIGMA_T_MIN - out->sigma_s_reduced[c];
    return true;
}

enum pell_result pell_medium_from_color_and_radius(const struct pell_color_and_radius *in, enum pell_profile_model model,
                                                   const struct pell_profile_params *params, struct pell_medium *out,
                                                   struct pell_medium_fault *fault)
{
    if (!in || !out)
        return PELL_ERR_INVALID;

    struct pell_medium m = { .eta = in->eta };

    *out = (struct pell_medium) { 0 };
    if (fault)
        *fault = (struct pell_medium_fault) { 0 };
    if (!input_valid(in, fault))
        return PELL_ERR_INVALID;
    for (int c = 0; c < 3; c++) {
        const struct query q = { model, params, in->g[c], in->eta };
        double albedo_reduced = 0.0;
        const enum pell_result res = invert_model(&q, in->color[c], &albedo_reduced, color_names[c], fault);
        if (res != PELL_OK)
            return res;
        if (!set_channel(in, c, &q, albedo_reduced, &m, fault))
            return PELL_ERR_INVALID;
    }
    *out = m;
    return PELL_OK;
}

enum pell_result pell_medium_from_map(const struct pell_color_and_radius *in, enum pell_albedo_map map, struct pell_medium *out,
                                      struct pell_medium_fault *fault)
{
    if (!in || !out)
        return PELL_ERR_INVALID;

    struct pell_medium m = { .eta = in->eta };

    *out = (struct pell_medium) { 0 };
    if (fault)
        *fault = (struct pell_medium_fault) { 0 };
    if (!pell_in_range("map", (double) (int) map, 0.0, PELL_ALBEDO_MAPS - 1, fault) || !input_valid(in, fault))
        return PELL_ERR_INVALID;
    for (int c = 0; c < 3; c++) {
        const struct query q = { PELL_PROFILE_MONTE_CARLO, NULL, in->g[c], in->eta };
        if (!set_channel(in, c, &q, pell_albedo_map_invert(map, in->color[c], in->eta), &m, fault))
            return PELL_ERR_INVALID;
    }
    *out = m;
    return PELL_OK;
}
