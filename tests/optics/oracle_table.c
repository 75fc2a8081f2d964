/* SPDX-License-Identifier: MIT
 *
 * oracle_table.c - the numbers of docs/guide/optics-proof.md, which scripts/gen_optics_proof.py inserts.
 *
 *     oracle_table compare             every file of tests/expect/oracle against ours; exit status 1 where a tolerance is exceeded or a key
 *                                      of a file is neither compared nor accounted for
 *     oracle_table tap                 the same as a test
 *     oracle_table fits                fits with 4 Gaussians and the best known optima, marble over the count
 *     oracle_table models PHOTONS CSV  the five profile models against photons, for the media of Jensen et al. 2001; the curves of the
 *                                      plots go to a file
 *
 * Files are found as by project_file: run it at the root of the repository, or set PELL_ROOT.
 *
 * Photons are traced once for all channels of one index: these media differ in albedo alone (g = 0). */
#include "photons.h"
#include "stacks.h"

#include "math/quadrature.h"
#include "math/vec.h"

/* --- Rows ------------------------------------------------------------------------------------------------------------------------- */

enum { ROWS_MAX = 96 };

static struct row {
    const char *file, *keys, *what, *kind;
    size_t numbers;
    double worst, tolerance;
} rows[ROWS_MAX];
static int row_count;

/* Keys of a file that are not compared, and why; "" where no reason is printed because the key describes the file's set-up. */
static const struct {
    const char *file, *key, *why;
} left_out[] = {
    { "dipole", "eta", "" },
    { "sampling", "eq9", "a demonstration of a misprint by its own Monte Carlo" },
    { "sampling", "jacobian", "image planes: no optics" },
    { "sampling", "lambertw_vs_brent_worst_rel", "the oracle's own check" },
    { "gaussians_fits", "eta", "" },
    { "gaussians_fits", "fdr", "" },
    { "gaussians_fits", "metric", "" },
    { "gaussians_claims", "marble_G_4_per_pole_LM", "four Gaussians for each pole: not a fit that is offered" },
    { "appendix_a", "literal_C2_at_x_0p01", "the misprint of C2 taken literally" },
    { "polynomial", "parseval", "the oracle's own check" },
    { "polynomial", "skin_layers_unit", "" },
    { "polynomial", "unconstrained_lsq_blows_up", "an approach that is not used here" },
    { "errata_demos", "seed001_ray_march", "single scattering along rays: no profile" },
    { "errata_demos", "seed001_eq12", "single scattering along rays: no profile" },
    { "errata_demos", "seed001_unnormalised_normal", "normal maps: no profile" },
    { "errata_demos", "seed001_algorithm2_weights", "single scattering along rays: no profile" },
    { "errata_demos", "seed002_eq6_pixel_area", "pixels: no profile" },
    { "errata_demos", "seed002_eq5_centre", "pixels: no profile" },
    { "errata_demos", "seed004_kernel", "a listing's taps: screen space" },
    { "errata_demos", "seed004_width_chain", "widths of passes: screen space" },
};

static void begin(const char *file, const char *keys, const char *what, const char *kind, double tolerance)
{
    if (row_count == ROWS_MAX)
        fail_msg("more than %d rows", ROWS_MAX);
    rows[row_count++] = (struct row) { file, keys, what, kind, 0, 0.0, tolerance };
}

/* One number, in units of `scale`. */
static void note(double ours, double theirs, double scale)
{
    struct row *r = &rows[row_count - 1];
    const double off = fabs(ours - theirs) / scale;
    r->numbers++;
    if (!(off <= r->worst) && !isnan(r->worst)) /* NaN is kept, and fails */
        r->worst = off;
}

static void relative(double ours, double theirs)
{
    note(ours, theirs, theirs != 0.0 ? fabs(theirs) : 1.0);
}

/* A quotient that must not exceed the tolerance. */
static void quotient(double ours, double theirs)
{
    note(ours / theirs, 0.0, 1.0);
}

static json_t *load(const char *name)
{
    char path[1024];
    json_error_t error;
    snprintf(path, sizeof(path), "%s/%s.json", project_file("tests/expect/oracle"), name);
    json_t *root = json_load_file(path, 0, &error);
    if (!root) {
        fprintf(stderr, "%s: %s\n", path, error.text);
        exit(2);
    }
    return root;
}

static const char *text_of(json_t *row, const char *key)
{
    return json_string_value(oracle_get(row, key));
}

static bool is(json_t *row, const char *key, const char *text)
{
    return strcmp(text_of(row, key), text) == 0;
}

static int channel_of(json_t *row)
{
    return (int) (strchr("RGB", text_of(row, "channel")[0]) - "RGB");
}

static struct pell_dipole dipole_of(json_t *row, double eta)
{
    return pell_dipole_make(oracle_number(row, "sigma_a"), oracle_number(row, "sigma_sp"), eta, PELL_FRESNEL_POLY3);
}

static struct pell_dipole dipole_named(const char *material, int c, double eta)
{
    const struct pell_medium *m = &pell_material_find(material)->medium;
    return pell_dipole_make(m->sigma_a[c], m->sigma_s_reduced[c], eta, PELL_FRESNEL_POLY3);
}

static double outside(const struct pell_dipole *d, double r)
{
    return pell_dipole_total(d) * (1.0 - pell_dipole_cdf(d, r));
}

/* Error (10) of a fit, in percent. */
static double fit_percent(const struct pell_dipole *d, int count, bool free, double r_max, struct pell_gaussians *g)
{
    const struct pell_fit_params params = { .count = count, .free_energy = free, .r_max_mm = r_max };
    struct pell_gaussians unused;
    struct pell_fit_report report;
    if (pell_fit_dipole(d, &params, g ? g : &unused, &report) != PELL_OK)
        return NAN;
    return 100.0 * report.error[0];
}

/* A dipole as a profile. */
static void profile_of(const struct pell_medium *m, int c, struct pell_profile *p)
{
    const struct pell_profile_params params = { .fresnel = PELL_FRESNEL_POLY3 };
    if (pell_profile_make(PELL_PROFILE_DIPOLE, m, c, &params, p) != PELL_OK)
        p->total = NAN;
}

static struct pell_medium grey(double sigma_a, double sigma_s, double eta)
{
    return (struct pell_medium) { { sigma_a, sigma_a, sigma_a }, { sigma_s, sigma_s, sigma_s }, { 0.0, 0.0, 0.0 }, eta };
}

/* --- Files ------------------------------------------------------------------------------------------------------------------------ */

static void compare_dipole(json_t *root)
{
    json_t *row;
    size_t i;
    begin("dipole", "table", "36 channels: coefficients, totals, R(r), cdf(r)", "relative", ROUNDED);
    json_array_foreach(oracle_get(root, "table"), i, row)
    {
        const double eta = oracle_number(row, "eta");
        const struct pell_dipole d = dipole_of(row, eta);
        const struct pell_dipole x =
            pell_dipole_make(oracle_number(row, "sigma_a"), oracle_number(row, "sigma_sp"), eta, PELL_FRESNEL_EXACT);
        const struct {
            const char *key;
            double value;
        } of[] = { { "sigma_tp", d.sigma_t_reduced },
                   { "alpha", d.albedo_reduced },
                   { "sigma_tr", d.sigma_tr },
                   { "A", d.A },
                   { "zr", d.zr },
                   { "zv", d.zv },
                   { "Fdr", pell_fresnel_diffuse(eta, PELL_FRESNEL_POLY3) },
                   { "zv_exact_fresnel", x.zv },
                   { "Rd_closed", pell_dipole_total(&d) },
                   { "Rd_closed_exact_fresnel", pell_dipole_total(&x) } };
        for (size_t k = 0; k < PELL_COUNT(of); k++)
            relative(of[k].value, oracle_number(row, of[k].key));
        for (size_t k = 0; k < json_array_size(oracle_get(row, "r_mm")); k++) {
            relative(pell_dipole_rd(&d, oracle_at(row, "r_mm", k)), oracle_at(row, "R", k));
            relative(pell_dipole_cdf(&d, oracle_at(row, "r_mm", k)), oracle_at(row, "cdf", k));
        }
    }
    begin("dipole", "fresnel", "Fdr exact and by both polynomials, 13 indices", "absolute", ROUNDED);
    json_array_foreach(oracle_get(root, "fresnel"), i, row)
    {
        double eta = oracle_number(row, "eta"); /* 0.7692307692 and 0.6666666667 are rounded 1/1.3 and 1/1.5 */
        eta = fabs(eta - 1.0 / 1.3) < 1e-9 ? 1.0 / 1.3 : fabs(eta - 1.0 / 1.5) < 1e-9 ? 1.0 / 1.5 : eta;
        note(pell_fresnel_diffuse(eta, PELL_FRESNEL_EXACT), oracle_number(row, "Fdr_exact"), 1.0);
        note(pell_fresnel_diffuse(eta, PELL_FRESNEL_POLY3), oracle_number(row, "Fdr_poly"), 1.0);
        note(pell_fresnel_diffuse(eta, PELL_FRESNEL_POLY4), oracle_number(row, "Fdr_poly_DJ4"), 1.0);
    }
}

static void compare_sampling(json_t *root)
{
    json_t *row;
    size_t i;
    begin("sampling", "sampling", "radii of both poles over xi, share of the real pole", "relative", ROUNDED);
    json_array_foreach(oracle_get(root, "sampling"), i, row)
    {
        const struct pell_dipole d = dipole_of(row, oracle_number(row, "eta"));
        relative(pell_dipole_real_share(&d), oracle_number(row, "threshold_real"));
        for (size_t k = 0; k < json_array_size(oracle_get(row, "xi")); k++) {
            relative(pell_pole_sample(d.zr, d.sigma_tr, oracle_at(row, "xi", k)), oracle_at(row, "r_real", k));
            relative(pell_pole_sample(d.zv, d.sigma_tr, oracle_at(row, "xi", k)), oracle_at(row, "r_virtual", k));
        }
    }
    begin("sampling", "sampling", "radii of the whole dipole over xi", "relative", 1e-8);
    json_array_foreach(oracle_get(root, "sampling"), i, row)
    {
        const struct pell_medium m = grey(oracle_number(row, "sigma_a"), oracle_number(row, "sigma_sp"), oracle_number(row, "eta"));
        struct pell_profile p;
        profile_of(&m, 0, &p);
        for (size_t k = 0; k < json_array_size(oracle_get(row, "xi")); k++)
            relative(pell_profile_sample(&p, oracle_at(row, "xi", k)), oracle_at(row, "r_of_full_cdf", k));
    }
}

struct finite {
    struct pell_stack stack;
    enum pell_stack_part part;
    int dipoles;
};

static double ring_of_poles(double log_r, const void *arg)
{
    const struct finite *f = arg;
    const double r = exp(log_r);
    double value;
    if (pell_slab_poles(&f->stack, 0, f->part, r, 1e-14, f->dipoles, &value, NULL) != PELL_OK)
        return NAN;
    return 2.0 * PELL_PI * r * r * value;
}

static struct pell_stack slab_in(json_t *row)
{
    const double eta = oracle_number(row, "eta_top");
    struct pell_stack s = slab_of(oracle_number(row, "sigma_a"), oracle_number(row, "sigma_sp"), eta, oracle_number(row, "d"));
    s.eta_below = eta / oracle_number(row, "eta_bot");
    return s;
}

static void totals_of(const struct pell_stack *s, int c, double total[PELL_STACK_PARTS])
{
    if (pell_stack_totals(s, c, total, NULL) != PELL_OK)
        total[0] = total[1] = total[2] = total[3] = NAN;
}

static size_t numbers_of(json_t *row, const char *key, double out[64])
{
    const size_t n = json_array_size(oracle_get(row, key));
    for (size_t k = 0; k < n && k < 64; k++)
        out[k] = oracle_at(row, key, k);
    return n;
}

static void compare_slabs(json_t *list)
{
    const char *const totals[PELL_STACK_PARTS] = { "total_R", "total_T", "total_R_minus", "total_T_minus" };
    const char *const poles[2] = { "R_poles", "T_poles" }, *const hankel[2] = { "R_inverse_hankel", "T_inverse_hankel" };
    json_t *row, *value;
    const char *count;
    size_t i;
    for (int lossless = 0; lossless < 2; lossless++) {
        begin("multipole", "single_slabs", lossless ? "totals without absorption (the oracle's R + T is 1 + 6e-8)" : "totals", "relative",
              lossless ? 1e-7 : ROUNDED);
        json_array_foreach(list, i, row)
        {
            const struct pell_stack s = slab_in(row);
            double total[PELL_STACK_PARTS];
            totals_of(&s, 0, total);
            for (int p = 0; p < PELL_STACK_PARTS && (s.layer[0].sigma_a[0] == 0.0) == lossless; p++)
                relative(total[p], oracle_number(row, totals[p]));
        }
    }
    for (int method = 0; method < 3; method++) {
        begin("multipole", "single_slabs",
              method == 0   ? "R(r), T(r) by poles; radii are rounded"
              : method == 1 ? "R(r), T(r) by poles without absorption (the oracle takes 801)"
                            : "R(r), T(r) by Hankel",
              method < 2 ? "relative" : "of f(0)",
              method == 0   ? 5.0 * ROUNDED
              : method == 1 ? 2e-6
                            : 2e-9);
        json_array_foreach(list, i, row)
        {
            const struct pell_stack s = slab_in(row);
            double r[64], f[2][64];
            double *const out[PELL_STACK_PARTS] = { f[0], f[1] };
            const size_t n = numbers_of(row, "r_mm", r);
            if (method < 2 && (s.layer[0].sigma_a[0] == 0.0) != (method == 1))
                continue;
            if (pell_stack_hankel(&s, 0, r, n, out, NULL) != PELL_OK)
                f[0][0] = NAN;
            for (int p = 0; p < 2; p++)
                for (size_t k = 0; k < n; k++) {
                    double sum;
                    if (method == 2)
                        note(f[p][k], oracle_at(row, hankel[p], k), oracle_at(row, hankel[p], 0));
                    else if (pell_slab_poles(&s, 0, p ? TP : RP, r[k], 1e-12, 100001, &sum, NULL) == PELL_OK)
                        relative(sum, oracle_at(row, poles[p], k));
                    else
                        relative(NAN, 1.0);
                }
        }
    }
    begin("multipole", "single_slabs", "totals of 2n + 1 dipoles, n <= 5, by quadrature", "relative", 1e-8);
    json_array_foreach(list, i, row)
        json_object_foreach(oracle_get(row, "total_by_number_of_dipoles_n"), count,
                            value) for (int p = 0; p < 2 && atoi(count) <= 5 && oracle_number(row, "sigma_a") > 0.0; p++)
    {
        const struct finite f = { slab_in(row), p ? TP : RP, 2 * atoi(count) + 1 };
        relative(pell_integrate(ring_of_poles, &f, log(1e-6), log(1e3), 0.0, 1e-10, NULL),
                 json_number_value(json_array_get(value, (size_t) p)));
    }
}

/* "[('slab', 2.62, 0.0041, 2.0, 1.3, 1.0), ('half', ...)]": kind, sigma_s', sigma_a, d, eta relative to the media above and below. */
static struct pell_stack stack_in(const char *text)
{
    struct pell_stack s = { .fresnel = PELL_FRESNEL_POLY4 };
    double eta = 1.0, sigma_s, sigma_a, d, up;
    for (const char *at = strstr(text, "[("); at; at = strchr(at + 1, '(')) {
        at += *at == '[';
        if (sscanf(at, "('slab', %lf, %lf, %lf, %lf,", &sigma_s, &sigma_a, &d, &up) == 4)
            put_below(&s, layer_of(sigma_a, sigma_s, eta *= up, d));
        else if (sscanf(at, "('half', %lf, %lf, None, %lf,", &sigma_s, &sigma_a, &up) == 3)
            put_below(&s, layer_of(sigma_a, sigma_s, eta *= up, INFINITY));
    }
    return s;
}

static void compare_stacks(json_t *list)
{
    const char *const keys[PELL_STACK_PARTS] = { "R_plus", "T_plus", "R_minus", "T_minus" };
    json_t *row;
    size_t i;
    begin("multipole", "generic_stacks", "totals and transforms of 2 and 3 layers", "relative", ROUNDED);
    json_array_foreach(list, i, row)
    {
        const struct pell_stack s = stack_in(text_of(row, "layers"));
        double total[PELL_STACK_PARTS], at[PELL_STACK_PARTS];
        totals_of(&s, 0, total);
        for (int p = 0; p < PELL_STACK_PARTS; p++)
            relative(total[p], oracle_number(row, keys[p]));
        for (size_t k = 0; k < json_array_size(oracle_get(row, "hankel_s")); k++) {
            if (pell_stack_transforms(&s, 0, oracle_at(row, "hankel_s", k), at) != PELL_OK)
                at[RP] = NAN;
            relative(at[RP], oracle_at(row, "hankel_R_plus", k));
            relative(at[TP], oracle_at(row, "hankel_T_plus", k));
        }
    }
    begin("multipole", "generic_stacks", "R(r), T(r)", "of f(0)", 1e-8);
    json_array_foreach(list, i, row)
    {
        const struct pell_stack s = stack_in(text_of(row, "layers"));
        double r[64], f[2][64];
        double *const out[PELL_STACK_PARTS] = { f[0], f[1] };
        const size_t n = numbers_of(row, "r_mm", r);
        if (pell_stack_hankel(&s, 0, r, n, out, NULL) != PELL_OK)
            f[0][0] = NAN;
        for (int p = 0; p < (isinf(s.layer[s.count - 1].thickness) ? 1 : 2); p++)
            for (size_t k = 0; k < n; k++)
                note(f[p][k], oracle_at(row, p ? "T" : "R", k), oracle_at(row, p ? "T" : "R", 0));
    }
}

static void compare_skin(json_t *root)
{
    static const double radii[4] = { 0.1, 0.3, 1.0, 3.0 };
    json_t *row;
    size_t i;
    begin("multipole", "skin", "totals of 2 and 3 layers, and of the first", "relative", ROUNDED);
    json_array_foreach(oracle_get(root, "skin"), i, row)
    {
        const struct pell_stack s = skin_of((int) oracle_number(row, "layers"));
        struct pell_stack top;
        double total[PELL_STACK_PARTS];
        totals_of(&s, channel_of(row), total);
        relative(total[RP], oracle_number(row, "total_R"));
        totals_of(pell_stack_layer(&s, 0, &top) == PELL_OK ? &top : &s, channel_of(row), total);
        relative(total[RP], oracle_number(row, "R1_total"));
        relative(total[TP], oracle_number(row, "T1_total"));
    }
    begin("multipole", "skin", "R(r); 7 digits at radii of 6", "of R(0)", 2e-6);
    json_array_foreach(oracle_get(root, "skin"), i, row)
    {
        const struct pell_stack s = skin_of((int) oracle_number(row, "layers"));
        double r[64], R[64];
        double *const out[PELL_STACK_PARTS] = { R };
        const size_t n = numbers_of(row, "r_mm", r);
        if (pell_stack_hankel(&s, channel_of(row), r, n, out, NULL) != PELL_OK)
            R[0] = NAN;
        for (size_t k = 0; k < n; k++)
            note(R[k], oracle_at(row, "R", k), oracle_at(row, "R", 0));
    }
    for (int cumulative = 0; cumulative < 2; cumulative++) {
        begin("multipole", "gpugems3_vs_hankel",
              cumulative ? "share of the light inside four radii (the oracle's sums exceed 1 by 2e-3)" : "totals in 1/mm and in 1/cm",
              cumulative ? "absolute" : "relative", cumulative ? 2.5e-3 : ROUNDED);
        json_array_foreach(oracle_get(root, "gpugems3_vs_hankel"), i, row)
        {
            struct pell_stack s = skin_of(3);
            static struct pell_profile p;
            const double unit = is(row, "table_unit", "1/mm") ? 10.0 : 1.0;
            for (int k = 0; k < 3; k++)
                for (int c = 0; c < 3; c++) {
                    s.layer[k].sigma_a[c] *= unit;
                    s.layer[k].sigma_s_reduced[c] *= unit;
                }
            if (pell_stack_profile(&s, channel_of(row), RP, &p, NULL) != PELL_OK)
                p.total = NAN;
            if (!cumulative)
                relative(p.total, oracle_number(row, "hankel_total"));
            for (size_t k = 0; k < 4 && cumulative; k++)
                note(pell_profile_cdf(&p, radii[k]), oracle_at(row, "cumulative_power_r_0p1_0p3_1_3_hankel", k), 1.0);
        }
    }
}

static void compare_multipole(json_t *root)
{
    static const double split_of[2][3] = { { 0.0041, 2.62, 10.0 }, { 0.032, 0.74, 8.0 } };
    double total[PELL_STACK_PARTS];
    json_t *row;
    size_t i;
    compare_slabs(oracle_get(root, "single_slabs"));
    compare_stacks(oracle_get(root, "generic_stacks"));
    compare_skin(root);
    begin("multipole", "splitting_test", "slabs whole and cut in two", "relative", ROUNDED);
    json_array_foreach(oracle_get(oracle_get(root, "splitting_test"), "rows"), i, row)
    {
        const struct pell_stack whole = slab_of(split_of[i % 2][0], split_of[i % 2][1], 1.3, split_of[i % 2][2]);
        struct pell_stack split = slab_of(split_of[i % 2][0], split_of[i % 2][1], 1.3, 0.5 * split_of[i % 2][2]);
        put_below(&split, split.layer[0]);
        totals_of(&whole, 0, total);
        relative(total[RP], oracle_number(row, "whole_R"));
        relative(total[TP], oracle_number(row, "whole_T"));
        totals_of(&split, 0, total);
        relative(total[RP], oracle_number(row, "split_R"));
        relative(total[TP], oracle_number(row, "split_T"));
    }
    begin("multipole", "rough_variant", "totals over A", "relative", ROUNDED);
    json_array_foreach(oracle_get(root, "rough_variant"), i, row)
    {
        struct pell_stack s = slab_of(0.0041, 2.62, 1.3, 5.0);
        s.A[0][0] = s.A[0][1] = oracle_number(row, "A");
        totals_of(&s, 0, total);
        relative(total[RP], oracle_number(row, "total_R"));
        relative(total[TP], oracle_number(row, "total_T"));
    }
    begin("multipole", "multipole_outside_validity_l_gt_d", "closed form where l > d", "relative", ROUNDED);
    row = oracle_get(root, "multipole_outside_validity_l_gt_d");
    struct pell_stack s = slab_of(oracle_number(row, "sigma_a"), oracle_number(row, "sigma_sp"), 1.4, oracle_number(row, "d"));
    s.eta_above = s.eta_below = 1.4;
    totals_of(&s, 0, total);
    relative(total[TP], oracle_number(row, "closed_form_T"));
    relative(total[RP], oracle_number(row, "R"));

    begin("multipole", "condition_R2R1_lt_1", "products of profiles and of transforms", "relative", 2.0 * ROUNDED);
    row = oracle_get(root, "condition_R2R1_lt_1");
    s = slab_of(0.0002, 7.38, 1.3, 1.0);
    struct pell_stack bottom = slab_of(0.0002, 7.38, 1.3, INFINITY), top; /* the oracle's lower side is in air, with three digits */
    double R1[1] = { NAN }, R2[1] = { NAN }, a[PELL_STACK_PARTS], b[PELL_STACK_PARTS], most = 0.0;
    double *const out1[PELL_STACK_PARTS] = { [RM] = R1 }, *const out2[PELL_STACK_PARTS] = { R2 };
    const double zero = 0.0;
    put_below(&s, bottom.layer[0]);
    bottom.fresnel = PELL_FRESNEL_POLY3;
    bool good = pell_stack_layer(&s, 0, &top) == PELL_OK && pell_stack_hankel(&top, 0, &zero, 1, out1, NULL) == PELL_OK &&
                pell_stack_hankel(&bottom, 0, &zero, 1, out2, NULL) == PELL_OK;
    for (int k = 0; k < 4000; k++) {
        const double at = k ? 1e-2 * exp(0.001 * k) : 0.0;
        good &= pell_stack_transforms(&top, 0, at, a) == PELL_OK && pell_stack_transforms(&bottom, 0, at, b) == PELL_OK;
        most = fmax(most, a[RM] * b[RP]);
    }
    relative(good ? most : NAN, oracle_number(row, "max_over_s_of_hankel_product"));
    relative(R1[0], oracle_number(row, "slab_R_minus_at_0_per_mm2"));
    relative(R2[0], oracle_number(row, "cream_R_at_0_per_mm2"));
}

static void compare_fits(json_t *root)
{
    json_t *row;
    size_t i;
    char key[8];
    begin("gaussians_fits", "rows", "error (10), 36 channels x 1 to 8 Gaussians x energy kept or free", "relative", 1e-4);
    json_array_foreach(oracle_get(root, "rows"), i, row) for (int k = 1; k <= 8; k++) for (int free = 0; free < 2; free++)
    {
        const struct pell_dipole d = dipole_of(row, oracle_number(row, "eta"));
        snprintf(key, sizeof(key), "%d", k);
        relative(fit_percent(&d, k, free, 0.0, NULL),
                 oracle_number(oracle_get(oracle_get(row, free ? "free" : "constrained"), key), "err_percent"));
    }
    begin("gaussians_fits", "rows", "variances and weights, 2, 4, 6 and 8 Gaussians", "relative", 1e-3);
    json_array_foreach(oracle_get(root, "rows"), i, row) for (int k = 2; k <= 8; k += 2) for (int free = 0; free < 2; free++)
    {
        const struct pell_dipole d = dipole_of(row, oracle_number(row, "eta"));
        struct pell_gaussians g = { 0 };
        snprintf(key, sizeof(key), "%d", k);
        json_t *known = oracle_get(oracle_get(row, free ? "free" : "constrained"), key);
        fit_percent(&d, k, free, 0.0, &g);
        for (size_t j = 0; j < (size_t) k; j++) {
            relative(g.variance[j], oracle_at(known, "v_mm2", j));
            relative(g.weight[j][0], oracle_at(known, "w", j));
        }
    }
}

static double peak_at(const struct pell_dipole *d, double *at)
{
    double a = 1e-3 * d->zr, b = 10.0 * d->zr;
    for (int i = 0; i < 200; i++) { /* golden section of r Rd(r) */
        const double x = b - 0.6180339887498949 * (b - a), y = a + 0.6180339887498949 * (b - a);
        if (x * pell_dipole_rd(d, x) > y * pell_dipole_rd(d, y))
            b = y;
        else
            a = x;
    }
    *at = 0.5 * (a + b);
    return 2.0 * PELL_PI * *at * pell_dipole_rd(d, *at);
}

/* The published marble, scaled to the dipole's total. */
static double published_marble_percent(int c, double eta)
{
    const struct pell_medium *m = &pell_material_find("marble")->medium;
    const struct pell_medium at = { { m->sigma_a[0], m->sigma_a[1], m->sigma_a[2] },
                                    { m->sigma_s_reduced[0], m->sigma_s_reduced[1], m->sigma_s_reduced[2] },
                                    { 0.0, 0.0, 0.0 },
                                    eta };
    struct pell_gaussians g = pell_material_find("marble-4gaussian")->gaussians;
    static struct pell_profile p;
    profile_of(&at, c, &p);
    const double scale = p.total / pell_gaussians_total(&g, c);
    for (int k = 0; k < g.count; k++)
        g.weight[k][c] *= scale;
    return 100.0 * pell_gaussians_error(&g, c, &p, 0.0);
}

static double set_error(const struct pell_gaussians *a, const struct pell_gaussians *b, int c)
{
    double wa[PELL_GAUSSIANS_MAX], wb[PELL_GAUSSIANS_MAX];
    for (int k = 0; k < PELL_GAUSSIANS_MAX; k++) {
        wa[k] = a->weight[k][c];
        wb[k] = b->weight[k][c];
    }
    return pell_gaussian_set_error(a->variance, wa, (size_t) a->count, b->variance, wb, (size_t) b->count);
}

static void compare_claims(json_t *root)
{
    const struct pell_gaussians *six = &pell_material_find("skin-6gaussian")->gaussians;
    const struct pell_gaussians *four = &pell_material_find("skin-4gaussian")->gaussians;
    json_t *row, *value;
    const char *key;
    size_t i;
    for (int free = 0; free < 2; free++) {
        begin("gaussians_claims", free ? "k4_free_sorted" : "k4_constrained_sorted", "4 Gaussians, 36 channels", "relative", 1e-4);
        json_array_foreach(oracle_get(root, free ? "k4_free_sorted" : "k4_constrained_sorted"), i, row)
        {
            const char *material = json_string_value(json_array_get(row, 1)), *c = json_string_value(json_array_get(row, 2));
            const struct pell_dipole d = dipole_named(material, (int) (strchr("RGB", c[0]) - "RGB"), 1.3);
            relative(fit_percent(&d, 4, free, 0.0, NULL), json_number_value(json_array_get(row, 0)));
        }
    }
    begin("gaussians_claims", "hypotheses", "4 and 8 Gaussians over indices, energy kept or free", "relative", 1e-3);
    json_array_foreach(oracle_get(root, "hypotheses"), i, row) json_object_foreach(row, key, value)
    {
        char material[16], c;
        int k;
        if (sscanf(key, "%15[a-z0-9]_%c_k%d", material, &c, &k) != 3)
            continue;
        const struct pell_dipole d = dipole_named(material, (int) (strchr("RGB", c) - "RGB"), oracle_number(row, "eta"));
        relative(fit_percent(&d, k, !json_is_true(oracle_get(row, "constraint")), 0.0, NULL), json_number_value(value));
    }
    begin("gaussians_claims", "marble_G_finite_range", "fits whose integrals end, errors from 0.0015 to 1.4 %", "points of %", 5e-5);
    json_array_foreach(oracle_get(root, "marble_G_finite_range"), i, row) for (int k = 4; k <= 8; k += 4) for (int free = 0; free < 2;
                                                                                                               free++)
    {
        const struct pell_dipole d = dipole_named("marble", 1, 1.3);
        char name[24];
        snprintf(name, sizeof(name), "%s_k%d", free ? "free" : "constrained", k);
        note(fit_percent(&d, k, free, oracle_number(row, "r_max_mm"), NULL), oracle_number(row, name), 1.0);
    }
    begin("gaussians_claims", "plain_LM_k8_marble_G_random_starts", "8 Gaussians, the best of its starts", "relative", 1e-4);
    json_array_foreach(oracle_get(root, "plain_LM_k8_marble_G_random_starts"), i, row)
    {
        const struct pell_dipole d = dipole_named("marble", 1, oracle_number(row, "eta"));
        double best = INFINITY;
        for (size_t k = 0; k < json_array_size(oracle_get(row, "errors_percent")); k++)
            best = fmin(best, oracle_at(row, "errors_percent", k));
        relative(fit_percent(&d, 8, !json_is_true(oracle_get(row, "constraint")), 0.0, NULL), best);
    }
    begin("gaussians_claims", "k2_grid_certification", "2 Gaussians: ours over the best of an exhaustive grid", "quotient", 1.0);
    json_array_foreach(oracle_get(root, "k2_grid_certification"), i, row)
    {
        const struct pell_dipole d = dipole_named(text_of(row, "material"), channel_of(row), 1.3);
        quotient(fit_percent(&d, 2, !json_is_true(oracle_get(row, "constraint")), 0.0, NULL), oracle_number(row, "grid"));
    }
    for (int where = 0; where < 2; where++) {
        begin("gaussians_claims", "marble_peak_of_2_pi_r_R",
              where ? "and where it is (the oracle looks at a grid)" : "the peak of figure 2", "relative", where ? 2e-4 : 2e-8);
        json_array_foreach(oracle_get(root, "marble_peak_of_2_pi_r_R"), i, row)
        {
            const struct pell_dipole d = dipole_named("marble", channel_of(row), oracle_number(row, "eta"));
            double at;
            const double peak = peak_at(&d, &at);
            relative(where ? at : peak, oracle_number(row, where ? "at_mm" : "peak"));
        }
    }
    begin("gaussians_claims", "error_versus_albedo_eta1.3", "19 albedos, 2 to 8 Gaussians", "relative", 1e-3);
    json_array_foreach(oracle_get(root, "error_versus_albedo_eta1.3"), i, row) for (int free = 0; free < 2; free++)
        json_object_foreach(oracle_get(row, free ? "free" : "constrained"), key, value)
    {
        const double alpha = oracle_number(row, "alpha");
        const struct pell_dipole d = pell_dipole_make(1.0 - alpha, alpha, 1.3, PELL_FRESNEL_POLY3);
        relative(fit_percent(&d, atoi(key), free, 0.0, NULL), json_number_value(value));
    }
    begin("gaussians_claims", "jimenez_marble_vs_dipole", "published marble against the dipole; ours is normalised to 1", "relative", 1e-3);
    json_array_foreach(oracle_get(root, "jimenez_marble_vs_dipole"), i, row) relative(
        published_marble_percent(channel_of(row), oracle_number(row, "eta")), oracle_number(row, "err_percent_table_scaled_to_Rd"));
    begin("gaussians_claims", "jimenez_skin4_vs_gpugems_six", "published skins against each other; ours are normalised to 1", "relative",
          0.02);
    json_array_foreach(oracle_get(root, "jimenez_skin4_vs_gpugems_six"), i, row)
    {
        const int c = channel_of(row);
        double of_six = 0.0, of_four = 0.0;
        for (int k = 0; k < 6; k++) {
            of_six += six->weight[k][c] * six->variance[k];
            of_four += k < 4 ? four->weight[k][c] * four->variance[k] : 0.0;
        }
        relative(100.0 * set_error(six, four, c), oracle_number(row, "eq10_percent"));
        relative(of_six, oracle_number(row, "mean_variance_six"));
        relative(of_four, oracle_number(row, "mean_variance_four"));
    }
}

static void compare_ranges(json_t *root)
{
    json_t *row;
    size_t i;
    for (int far = 0; far < 2; far++) {
        begin("gaussians_ranges", "rows", far ? "their error over all radii" : "fits whose integrals end, error inside", "relative", 1e-3);
        json_array_foreach(oracle_get(root, "rows"), i, row) for (int k = 4; k <= 8; k += 4)
        {
            const char *keys[2][2] = { { "k4_own", "k4_inf" }, { "k8_own", "k8_inf" } };
            const int c = channel_of(row);
            const struct pell_dipole d = dipole_named(text_of(row, "material"), c, oracle_number(row, "eta"));
            struct pell_gaussians g = { 0 };
            if (!json_object_get(row, keys[k == 8][far]))
                continue;
            const double inside = fit_percent(&d, k, is(row, "mode", "free"), oracle_number(row, "r_max_mm"), &g);
            static struct pell_profile p;
            const struct pell_medium m =
                grey(d.sigma_t_reduced * (1.0 - d.albedo_reduced), d.sigma_t_reduced * d.albedo_reduced, oracle_number(row, "eta"));
            profile_of(&m, 0, &p);
            relative(far ? 100.0 * pell_gaussians_error(&g, 0, &p, 0.0) : inside, oracle_number(row, keys[k == 8][far]));
        }
    }
}

enum { DENSE = 400 };
static double dense_v[DENSE], dense_w[DENSE];

static double appendix_percent(double x, enum pell_appendix_a constants, double weight[4])
{
    double v[4];
    if (pell_pole_gaussians(1.0, x, dense_v, dense_w, DENSE) != PELL_OK || pell_pole_appendix_a(1.0, x, constants, v, weight) != PELL_OK)
        return NAN;
    return 100.0 * pell_gaussian_set_error(dense_v, dense_w, DENSE, v, weight, 4);
}

static void compare_appendix_a(json_t *root)
{
    static const char *const weights[3] = { "C_printed", "C_best_free", "C_best_constrained" };
    static const char *const errors[3] = { "err_percent_printed", "err_percent_best_free", "err_percent_best_constrained" };
    static const char *const of_dipole[3] = { "err_percent_printed", "err_percent_best_C_free", "err_percent_best_C_constrained" };
    json_t *row;
    double w[4];
    size_t i;
    begin("appendix_a", "pole", "C1 to C4: printed, best, best with the energy", "absolute", 1e-6);
    json_array_foreach(oracle_get(root, "pole"), i, row) for (int kind = 0; kind < 3; kind++)
    {
        appendix_percent(oracle_number(row, "x"), (enum pell_appendix_a) kind, w);
        for (size_t k = 0; k < 4; k++)
            note(w[k] * 4.0 * PELL_PI * exp(oracle_number(row, "x")), oracle_at(row, weights[kind], k), 1.0);
    }
    begin("appendix_a", "pole", "their error (10)", "relative", 1e-4);
    json_array_foreach(oracle_get(root, "pole"), i, row) for (int kind = 0; kind < 3; kind++)
        relative(appendix_percent(oracle_number(row, "x"), (enum pell_appendix_a) kind, w), oracle_number(row, errors[kind]));
    begin("appendix_a", "table_best_C", "C1 to C4 at 62 x", "absolute", 1e-6);
    for (i = 0; i < json_array_size(oracle_get(oracle_get(root, "table_best_C"), "x")); i++) {
        json_t *table = oracle_get(root, "table_best_C");
        for (int kind = 1; kind < 3; kind++) {
            const double x = oracle_at(table, "x", i);
            appendix_percent(x, (enum pell_appendix_a) kind, w);
            for (size_t k = 0; k < 4; k++)
                note(w[k] * 4.0 * PELL_PI * exp(x),
                     json_number_value(json_array_get(json_array_get(oracle_get(table, kind == 1 ? "free" : "constrained"), i), k)), 1.0);
        }
    }
    for (int kind = 0; kind < 3; kind++) {
        begin("appendix_a", "dipole_eta1_3",
              kind == 0   ? "eight Gaussians, 36 dipoles, printed constants"
              : kind == 1 ? "best constants (the oracle interpolates its table)"
                          : "the same with the energy",
              "relative", kind == 0 ? 1e-4 : 2e-3);
        json_array_foreach(oracle_get(root, "dipole_eta1_3"), i, row)
        {
            const double alpha = oracle_number(row, "alpha");
            const struct pell_dipole d = pell_dipole_make(1.0 - alpha, alpha, 1.3, PELL_FRESNEL_POLY3);
            const struct pell_medium m = grey(1.0 - alpha, alpha, 1.3);
            static struct pell_profile p;
            struct pell_gaussians g;
            profile_of(&m, 0, &p);
            relative(pell_dipole_appendix_a(&d, (enum pell_appendix_a) kind, &g) == PELL_OK ? 100.0 * pell_gaussians_error(&g, 0, &p, 0.0)
                                                                                            : NAN,
                     oracle_number(row, of_dipole[kind]));
        }
    }
}

static struct pell_stack_sets sets;
static _Alignas(16) unsigned char memory[1 << 20];

/* Error (10) of R+ of the running sets from the Hankel solver, in percent. */
static double sets_percent(const struct pell_stack *s, int c)
{
    enum { N = 240 };
    double r[N], f[N], above = 0.0, below = 0.0;
    double *const out[PELL_STACK_PARTS] = { f };
    for (int k = 0; k < N; k++)
        r[k] = 2e-3 * exp(0.045 * k);
    if (pell_stack_hankel(s, c, r, N, out, NULL) != PELL_OK)
        return NAN;
    for (int k = 0; k < N; k++) {
        const double g = pell_gaussian_set_eval(sets.variance, sets.weight[RP], (size_t) sets.count, r[k]);
        above += r[k] * r[k] * (g - f[k]) * (g - f[k]);
        below += r[k] * r[k] * f[k] * f[k];
    }
    return 100.0 * sqrt(above / below);
}

static struct pell_stack case_of(const char *name, int *c)
{
    struct pell_stack s = skin_of(2);
    *c = 0;
    if (strncmp(name, "skin2_", 6) == 0) {
        *c = (int) (strchr("RGB", name[6]) - "RGB");
    } else if (strcmp(name, "two_slabs_thick") == 0) {
        s = slab_of(0.0041, 2.62, 1.3, 2.0);
        put_below(&s, layer_of(0.013, 1.09, 1.3, 4.0));
    } else { /* two_slabs_thin_top: the epidermis on 1 mm of the upper dermis */
        s.layer[1].thickness = 1.0;
    }
    return s;
}

static void compare_polynomial(json_t *root)
{
    json_t *row;
    size_t i;
    int c;
    for (int method = 0; method < 3; method++) {
        begin("polynomial", "runs",
              method == 0   ? "totals of R12, T12 by Hankel"
              : method == 1 ? "totals of R12 by our Gaussians"
                            : "error (10) of R12, ours over the oracle's by the same mixture, one by one and fast",
              method == 2 ? "quotient" : "relative",
              method == 0   ? ROUNDED
              : method == 1 ? 1e-6
                            : 1.0);
        json_array_foreach(oracle_get(root, "runs"), i, row)
        {
            const struct pell_stack s = case_of(text_of(row, "case"), &c);
            double total[PELL_STACK_PARTS];
            totals_of(&s, c, total);
            if (method == 0) {
                relative(total[RP], oracle_number(row, "R12_total_hankel"));
                if (json_object_get(row, "T12_total_hankel"))
                    relative(total[TP], oracle_number(row, "T12_total_hankel"));
                continue;
            }
            if (method == 2 && is(row, "method", "nnls")) /* least squares over up to 250 000 Gaussians: a different approach */
                continue;
            if (pell_stack_gaussians(&s, c, NULL, memory, sizeof(memory), &sets) != PELL_OK)
                sets.count = 0;
            if (method == 1)
                relative(pell_gaussian_set_total(sets.weight[RP], (size_t) sets.count), oracle_number(row, "R12_total_hankel"));
            else
                quotient(sets_percent(&s, c), oracle_number(row, "R12_err_percent"));
        }
    }
}

/* --- Photons ---------------------------------------------------------------------------------------------------------------------- */

enum { BATCHES = 16, CHANNELS = 36, RINGS = 22, PER_DECADE = 5 };
#define RING_FIRST 0.01 /* mean free paths */

/* Flux per photon of one channel: total, and through rings. Ring 0 is inside RING_FIRST; the last extends to infinity. */
struct tally {
    double alpha, eta;
    double total[2][BATCHES], ring[RINGS][BATCHES];
};

static struct tally tallies[CHANNELS];
static int tally_count, batch;
static double straight[2][BATCHES];
static bool rings;
static double walking_eta; /* with rings: tallies of other indices are skipped */

static void leave(void *user, const struct pell_photon_exit *e)
{
    const double at = ceil(PER_DECADE * log10(fmax(e->radius, 1e-12) / RING_FIRST));
    const int k = at <= 0.0 ? 0 : at >= RINGS - 1 ? RINGS - 1 : (int) at;
    (void) user;
    if (e->collisions == 0) {
        straight[e->face][batch] += e->weight;
        return;
    }
    for (int i = 0; i < tally_count; i++) {
        if (rings && tallies[i].eta != walking_eta)
            continue;
        const double w = e->weight * pow(tallies[i].alpha, e->collisions);
        tallies[i].total[e->face][batch] += w;
        if (rings)
            tallies[i].ring[k][batch] += w;
    }
}

static double ring_edge(int k)
{
    return k <= 0 ? 0.0 : k >= RINGS ? INFINITY : RING_FIRST * pow(10.0, (double) (k - 1) / PER_DECADE);
}

static double mean_of(const double x[BATCHES], double *error)
{
    double mean = 0.0, squares = 0.0;
    for (int i = 0; i < BATCHES; i++)
        mean += x[i] / BATCHES;
    for (int i = 0; i < BATCHES; i++)
        squares += (x[i] - mean) * (x[i] - mean);
    *error = sqrt(squares / (BATCHES * (BATCHES - 1)));
    return mean;
}

static void walk(const struct pell_photon_stack *s, uint64_t photons, uint64_t seed)
{
    const uint64_t each = photons / BATCHES;
    struct pell_photon_sums sums = { 0 };
    memset(straight, 0, sizeof(straight));
    for (batch = 0; batch < BATCHES; batch++)
        pell_photon_walk(s, seed, (uint64_t) batch * each, each, leave, NULL, NULL, &sums);
    for (int b = 0; b < BATCHES; b++)
        for (int i = 0; i < tally_count; i++) {
            if (rings && tallies[i].eta != walking_eta)
                continue;
            for (int face = 0; face < 2; face++)
                tallies[i].total[face][b] /= (double) each;
            for (int k = 0; k < RINGS; k++)
                tallies[i].ring[k][b] /= (double) each;
        }
    for (int face = 0; face < 2; face++)
        for (int b = 0; b < BATCHES; b++)
            straight[face][b] /= (double) each;
}

/* Our photons against a number with an error of its own, in combined standard errors. */
static void within(const double x[BATCHES], double theirs, double error)
{
    double ours_error;
    const double ours = mean_of(x, &ours_error);
    note(ours, theirs, hypot(ours_error, error));
}

static void compare_photon_slabs(json_t *root)
{
    json_t *row = oracle_get(root, "van_de_hulst");
    size_t i;
    double sum[BATCHES];
    begin("montecarlo", "van_de_hulst", "R and T of a slab by our photons", "standard errors", 3.0);
    const double mu_a = oracle_number(row, "mu_a_per_cm"), mu_s = oracle_number(row, "mu_s_per_cm");
    struct pell_photon_stack s = photons_in_layer(mu_a, mu_s, oracle_number(row, "g"), oracle_number(row, "n"), oracle_number(row, "d_cm"));
    s.roulette = 0;
    memset(tallies, 0, sizeof(tallies));
    tally_count = 1;
    tallies[0].alpha = 1.0; /* the layer absorbs */
    walk(&s, 400000, 1);
    within(tallies[0].total[0], oracle_number(row, "Rd"), oracle_number(row, "Rd_se"));
    for (int b = 0; b < BATCHES; b++)
        sum[b] = tallies[0].total[1][b] + straight[1][b];
    within(sum, oracle_number(row, "Tt"), oracle_number(row, "Tt_se"));
    within(straight[1], oracle_number(row, "T_unscattered_exact"), 0.0);

    row = oracle_get(root, "giovanelli");
    begin("montecarlo", "giovanelli", "the half-space by transport", "standard errors", 3.0);
    note(pell_half_space_albedo(0.9, oracle_number(row, "n")), oracle_number(row, "Rd_per_transmitted_photon"), oracle_number(row, "se"));
    begin("montecarlo", "giovanelli", "the half-space by our photons", "standard errors", 3.0);
    memset(tallies, 0, sizeof(tallies));
    tallies[0].alpha = 0.9;
    s = photons_in_layer(0.0, 1.0, 0.0, oracle_number(row, "n"), INFINITY);
    walk(&s, 200000, 2);
    within(tallies[0].total[0], oracle_number(row, "Rd_per_transmitted_photon"), oracle_number(row, "se"));

    begin("montecarlo", "chandrasekhar_matched", "half-spaces without a boundary by transport, against the exact", "relative", 1e-8);
    json_array_foreach(oracle_get(root, "chandrasekhar_matched"), i, row)
        relative(pell_half_space_albedo(oracle_number(row, "albedo"), 1.0), oracle_number(row, "exact"));

    begin("montecarlo", "slab_totals", "R and T of ten slabs by our photons", "standard errors", 3.0);
    json_array_foreach(oracle_get(root, "slab_totals"), i, row)
    {
        memset(tallies, 0, sizeof(tallies));
        tallies[0].alpha = oracle_number(row, "alpha");
        s = photons_in_layer(0.0, 1.0, 0.0, oracle_number(row, "n"), oracle_number(row, "optical_thickness"));
        walk(&s, 30000, 20 + i);
        within(tallies[0].total[0], oracle_number(row, "mc_R"), oracle_number(row, "mc_R_se"));
        for (int b = 0; b < BATCHES; b++)
            sum[b] = tallies[0].total[1][b] + straight[1][b];
        within(sum, oracle_number(row, "mc_T"), oracle_number(row, "mc_T_se"));
    }
    begin("montecarlo", "slab_totals", "these slabs by transport (adding-doubling)", "relative", 3e-3);
    json_array_foreach(oracle_get(root, "slab_totals"), i, row)
    {
        const double alpha = oracle_number(row, "alpha"), thickness = oracle_number(row, "optical_thickness");
        const struct pell_medium m = { .sigma_a = { 1.0 - alpha, 1.0 - alpha, 1.0 - alpha },
                                       .sigma_s_reduced = { alpha, alpha, alpha },
                                       .eta = oracle_number(row, "n") };
        struct pell_slab transport;
        struct pell_slab_light light;
        (void) pell_slab_make(&m, 0, &transport);
        light = pell_slab_at(&transport, thickness);
        relative(light.reflected + transport.boundary * exp(-thickness) * light.straight, oracle_number(row, "mc_R"));
        relative(light.transmitted + light.straight, oracle_number(row, "mc_T"));
    }
    begin("montecarlo", "slab_totals", "the multipole of these slabs (the oracle's R + T is 1 + 6e-8 without absorption)", "relative",
          2e-7);
    json_array_foreach(oracle_get(root, "slab_totals"), i, row)
    {
        const double alpha = oracle_number(row, "alpha");
        const struct pell_stack slab = slab_of(1.0 - alpha, alpha, oracle_number(row, "n"), oracle_number(row, "optical_thickness"));
        double total[PELL_STACK_PARTS];
        totals_of(&slab, 0, total);
        relative(total[RP], oracle_number(row, "multipole_R"));
        relative(total[TP], oracle_number(row, "multipole_T"));
    }
}

static void compare_albedos(json_t *root)
{
    json_t *row, *list = oracle_get(oracle_get(root, "semi_infinite_eta1.3_total_albedo"), "table");
    size_t i;

    begin("montecarlo", "semi_infinite_eta1.3_total_albedo", "33 totals by transport", "standard errors", 3.0);
    json_array_foreach(list, i, row)
        note(pell_half_space_albedo(oracle_number(row, "alpha"), 1.3), oracle_number(row, "mc_R"), oracle_number(row, "mc_se"));
    begin("montecarlo", "semi_infinite_eta1.3_total_albedo", "33 totals by the dipole; the albedo has 10 digits", "relative", 5e-8);
    json_array_foreach(list, i, row)
    {
        const double alpha = oracle_number(row, "alpha");
        const struct pell_dipole d = pell_dipole_make(1.0 - alpha, alpha, 1.3, PELL_FRESNEL_POLY3);
        relative(pell_dipole_total(&d), oracle_number(row, "dipole_R"));
    }
    for (int once = 0; once < 2; once++) {
        begin("montecarlo", "semi_infinite_eta1.3_total_albedo",
              once ? "light scattered once by the monte-carlo model" : "33 totals by the monte-carlo model", "absolute",
              once ? 3e-4 : 1e-3);
        json_array_foreach(list, i, row)
        {
            const double alpha = oracle_number(row, "alpha");
            const struct pell_medium m = grey(1.0 - alpha, alpha, 1.3);
            const struct pell_profile_params multiple = { .without_single = true };
            static struct pell_profile p, q;
            if (pell_profile_make(PELL_PROFILE_MONTE_CARLO, &m, 0, NULL, &p) != PELL_OK ||
                pell_profile_make(PELL_PROFILE_MONTE_CARLO, &m, 0, &multiple, &q) != PELL_OK)
                p.total = NAN;
            note(once ? p.total - q.total : p.total, oracle_number(row, once ? "mc_R_single" : "mc_R"), 1.0);
        }
    }
}

static void compare_radial_profiles(json_t *root)
{
    json_t *row;
    size_t i;

    for (int method = 0; method < 2; method++) {
        begin("montecarlo", "radial_profiles",
              method ? "rings of six media: light that the monte-carlo model misplaces"
                     : "rings of six media by the dipole, with over 1e-6 of the light; edges of 6 digits",
              method ? "of the total" : "relative", method ? 0.004 : 5e-5);
        json_array_foreach(oracle_get(root, "radial_profiles"), i, row)
        {
            const struct pell_medium m = grey(oracle_number(row, "sigma_a"), oracle_number(row, "sigma_sp"), oracle_number(row, "eta"));
            static struct pell_profile p;
            double off = 0.0, all = 0.0;
            if (method == 0)
                profile_of(&m, 0, &p);
            else if (pell_profile_make(PELL_PROFILE_MONTE_CARLO, &m, 0, NULL, &p) != PELL_OK)
                p.total = NAN;
            for (size_t k = 0; k + 1 < json_array_size(oracle_get(row, "bin_edges_mm")); k++) {
                const double a = oracle_at(row, "bin_edges_mm", k), b = oracle_at(row, "bin_edges_mm", k + 1);
                const double flux = p.total * (pell_profile_cdf(&p, b) - pell_profile_cdf(&p, a)), area = PELL_PI * (b * b - a * a);
                if (method == 0 && flux > 1e-6)
                    relative(flux / area, oracle_at(row, "dipole_bin_average", k));
                off += fabs(flux - area * oracle_at(row, "mc_R", k));
                all += area * oracle_at(row, "mc_R", k);
            }
            if (method == 1)
                note(off / all, 0.0, 1.0);
        }
    }
    begin("montecarlo", "single_scatter_matched_check", "light scattered once without a boundary, by the photon-beam model", "relative",
          1e-5);
    const struct pell_medium m = grey(0.1, 1.0, 1.0);
    const struct pell_profile_params multiple = { .without_single = true };
    static struct pell_profile p, q;
    if (pell_profile_make(PELL_PROFILE_PHOTON_BEAM, &m, 0, NULL, &p) != PELL_OK ||
        pell_profile_make(PELL_PROFILE_PHOTON_BEAM, &m, 0, &multiple, &q) != PELL_OK)
        p.total = NAN;
    relative((p.total - q.total) * 1.1, oracle_number(oracle_get(root, "single_scatter_matched_check"), "exact_R1_over_alpha"));
}

static void compare_photons(json_t *root)
{
    compare_photon_slabs(root);
    compare_albedos(root);
    compare_radial_profiles(root);
}

/* --- Errata ----------------------------------------------------------------------------------------------------------------------- */

static void compare_errata(json_t *root)
{
    json_t *row, *part = oracle_get(root, "seed003_eq16");
    const struct pell_gaussians *six = &pell_material_find("skin-6gaussian")->gaussians;
    size_t i;
    begin("errata_demos", "seed003_eq16", "a Gaussian at sqrt(r^2 + d^2)", "relative", ROUNDED);
    json_array_foreach(oracle_get(part, "pointwise"), i, row)
    {
        const double v = oracle_number(row, "v"), one = 1.0;
        relative(pell_gaussian_set_eval(&v, &one, 1, hypot(oracle_number(row, "r"), oracle_number(row, "d"))),
                 oracle_number(row, "G_at_sqrt_r2_plus_d2"));
    }
    begin("errata_demos", "seed003_eq16", "light of six-Gaussian skin outside d; ours is normalised to 1", "relative", 2e-3);
    json_array_foreach(oracle_get(part, "gems_skin_totals"), i, row) for (size_t c = 0; c < 3; c++)
    {
        double sum = 0.0;
        for (int k = 0; k < 6; k++)
            sum += six->weight[k][c] * exp(-0.5 * oracle_number(row, "d_mm") * oracle_number(row, "d_mm") / six->variance[k]);
        relative(sum, oracle_at(row, "total_corrected", c));
    }
    begin("errata_demos", "seed003_eq16", "four slabs of marble: T, and the dipole's light outside d", "relative", ROUNDED);
    json_array_foreach(oracle_get(part, "versus_multipole"), i, row)
    {
        const double d = oracle_number(row, "thickness_mm");
        const struct pell_stack s = slab_of(0.0041, 2.62, 1.3, d);
        const struct pell_dipole dipole = dipole_named("marble", 1, 1.3);
        double total[PELL_STACK_PARTS];
        totals_of(&s, 0, total);
        relative(total[TP], oracle_number(row, "multipole_T"));
        relative(outside(&dipole, d), oracle_number(row, "power_of_R_sqrt_r2_plus_d2"));
    }
    for (int two = 0; two < 2; two++) {
        begin("errata_demos", "seed003_multipole_4_gaussians", two ? "slabs by 2 Gaussians" : "slabs by 4 Gaussians, energy kept and free",
              "points of %", two ? 2e-2 : 2e-3);
        json_array_foreach(oracle_get(root, "seed003_multipole_4_gaussians"), i, row)
        {
            const bool marble = is(row, "material", "marble G");
            const struct pell_stack s = slab_of(marble ? 0.0041 : 0.032, marble ? 2.62 : 0.74, 1.3, oracle_number(row, "d"));
            static struct pell_profile p;
            for (int free = 0; free < (two ? 1 : 2); free++) {
                const struct pell_fit_params params = { .count = two ? 2 : 4, .free_energy = free };
                struct pell_gaussians g;
                struct pell_fit_report report;
                if (pell_stack_profile(&s, 0, is(row, "profile", "T") ? TP : RP, &p, NULL) != PELL_OK ||
                    pell_fit_profile(&p, &params, &g, &report) != PELL_OK)
                    report.error[0] = NAN;
                note(100.0 * report.error[0],
                     oracle_number(row, two    ? "k2_constrained_percent"
                                        : free ? "k4_free_percent"
                                               : "k4_constrained_percent"),
                     1.0);
            }
        }
    }
    begin("errata_demos", "seed003_spacing_rule", "quotients of variances: six-Gaussian skin, appendix A", "relative", ROUNDED);
    part = oracle_get(root, "seed003_spacing_rule");
    double v[4], w[4];
    for (size_t k = 0; k < 5; k++)
        relative(six->variance[k + 1] / six->variance[k], oracle_at(part, "gems_six", k));
    for (size_t k = 0; k < 3; k++)
        relative(pell_pole_appendix_a(1.0, 0.1, PELL_APPENDIX_A_PRINTED, v, w) == PELL_OK ? v[k + 1] / v[k] : NAN,
                 oracle_at(part, "appendix_a", k));
    begin("errata_demos", "seed001_schlick", "Schlick's phase function: mean cosine, values, k", "relative", ROUNDED);
    json_array_foreach(oracle_get(root, "seed001_schlick"), i, row)
    {
        const struct pell_phase p = { PELL_PHASE_SCHLICK, { oracle_number(row, "parameter") }, 0.0 };
        relative(pell_phase_mean_cosine(&p), oracle_number(row, "mean_cosine_closed"));
        relative(pell_phase_value(&p, -1.0), oracle_number(row, "forward_value"));
        relative(pell_phase_value(&p, 1.0), oracle_number(row, "backward_value"));
        relative(pell_phase_schlick_k(oracle_number(row, "parameter")), oracle_number(row, "k_giving_mean_cosine_equal_to_listed_g"));
    }
    begin("errata_demos", "seed002_eq8_threshold", "the dipole's light beyond a radius", "relative", 5.0 * ROUNDED);
    json_array_foreach(oracle_get(root, "seed002_eq8_threshold"), i, row)
    {
        const struct pell_dipole d = dipole_named(text_of(row, "material"), channel_of(row), 1.3);
        relative(1.0 - pell_dipole_cdf(&d, oracle_number(row, "d_t_mm")), oracle_number(row, "fraction_of_power_beyond_d_t"));
    }
    begin("errata_demos", "seed002_half_half_split", "dipole on two planes", "relative", ROUNDED);
    json_array_foreach(oracle_get(oracle_get(root, "seed002_half_half_split"), "rows"), i, row)
    {
        const struct pell_dipole d = dipole_named(text_of(row, "material"), channel_of(row), 1.3);
        relative(pell_dipole_total(&d), oracle_number(row, "exact"));
        relative(0.5 * (pell_dipole_total(&d) + outside(&d, oracle_number(row, "dz_mm"))), oracle_number(row, "half_half"));
    }
    begin("errata_demos", "seed004_table71", "quotients of variances: four-Gaussian skin and marble", "relative", ROUNDED);
    for (int k = 0; k < 2; k++) {
        const struct pell_gaussians *g = &pell_material_find(k ? "marble-4gaussian" : "skin-4gaussian")->gaussians;
        for (size_t j = 0; j < 3; j++)
            relative(g->variance[j + 1] / g->variance[j],
                     oracle_at(oracle_get(oracle_get(root, "seed004_table71"), k ? "marble" : "skin"), "variance_ratios", j));
    }
    begin("errata_demos", "seed004_marble_against_dipole", "published marble against the dipole", "relative", 1e-3);
    json_array_foreach(oracle_get(root, "seed004_marble_against_dipole"), i, row)
        relative(published_marble_percent(channel_of(row), oracle_number(row, "eta")), oracle_number(row, "err_percent_total_fixed_to_Rd"));
}

/* --- Commands --------------------------------------------------------------------------------------------------------------------- */

static const struct {
    const char *name;
    void (*compare)(json_t *root);
} files[] = {
    { "dipole", compare_dipole },         { "sampling", compare_sampling },       { "multipole", compare_multipole },
    { "gaussians_fits", compare_fits },   { "gaussians_claims", compare_claims }, { "gaussians_ranges", compare_ranges },
    { "appendix_a", compare_appendix_a }, { "polynomial", compare_polynomial },   { "montecarlo", compare_photons },
    { "errata_demos", compare_errata },
};

/* Every key of a file belongs to a row, or is left out for a reason. */
static bool accounted_for(const char *file, const char *key)
{
    for (int i = 0; i < row_count; i++)
        if (strcmp(rows[i].file, file) == 0 && strcmp(rows[i].keys, key) == 0)
            return true;
    for (size_t i = 0; i < PELL_COUNT(left_out); i++)
        if (strcmp(left_out[i].file, file) == 0 && strcmp(left_out[i].key, key) == 0)
            return true;
    fprintf(stderr, "%s: nothing compares \"%s\"\n", file, key);
    return false;
}

static int compare(bool tap)
{
    bool good = true;
    for (size_t i = 0; i < PELL_COUNT(files); i++) {
        json_t *root = load(files[i].name), *value;
        const char *key;
        files[i].compare(root);
        json_object_foreach(root, key, value) good &= accounted_for(files[i].name, key);
        json_decref(root);
    }
    if (tap) {
        printf("1..%d\n", row_count + 1);
        for (int i = 0; i < row_count; i++) {
            const struct row *r = &rows[i];
            printf("%s %d - %s %s: %s\n", r->numbers > 0 && r->worst <= r->tolerance ? "ok" : "not ok", i + 1, r->file, r->keys, r->what);
            if (!(r->numbers > 0 && r->worst <= r->tolerance))
                printf("# %zu numbers, %.3e is more than %.3e %s\n", r->numbers, r->worst, r->tolerance, r->kind);
        }
        printf("%s %d - every key is accounted for\n", good ? "ok" : "not ok", row_count + 1);
        return 0;
    }
    printf("| file, key | what | numbers | largest difference | tolerance | |\n|---|---|---|---|---|---|\n");
    for (int i = 0; i < row_count; i++) {
        const struct row *r = &rows[i];
        const bool holds = r->numbers > 0 && r->worst <= r->tolerance;
        printf("| %s `%s` | %s | %zu | %.1e | %.0e | %s |\n", r->file, r->keys, r->what, r->numbers, r->worst, r->tolerance, r->kind);
        if (!holds)
            fprintf(stderr, "%s %s (%s): %zu numbers, %.3e is more than %.3e\n", r->file, r->keys, r->what, r->numbers, r->worst,
                    r->tolerance);
        good &= holds;
    }
    printf("\n| not compared | why |\n|---|---|\n");
    for (size_t i = 0; i < PELL_COUNT(left_out); i++)
        if (left_out[i].why[0])
            printf("| %s `%s` | %s |\n", left_out[i].file, left_out[i].key, left_out[i].why);
    return good ? 0 : 1;
}

static int fits(void)
{
    json_t *root = load("gaussians_fits"), *row;
    size_t i;
    double least = INFINITY, most = 0.0;
    printf("| material | free, R | G | B | kept, R | G | B |\n|---|---|---|---|---|---|---|\n");
    for (i = 0; i < json_array_size(oracle_get(root, "rows")); i += 3) {
        printf("| %s", text_of(json_array_get(oracle_get(root, "rows"), i), "material"));
        for (int kept = 0; kept < 2; kept++)
            for (size_t c = 0; c < 3; c++) {
                row = json_array_get(oracle_get(root, "rows"), i + c);
                const struct pell_dipole d = dipole_of(row, oracle_number(row, "eta"));
                const double ours = fit_percent(&d, 4, !kept, 0.0, NULL);
                printf(" | %.4g / %.4g", ours,
                       oracle_number(oracle_get(oracle_get(row, kept ? "constrained" : "free"), "4"), "err_percent"));
                least = kept ? least : fmin(least, ours);
                most = kept ? most : fmax(most, ours);
            }
        printf(" |\n");
    }
    json_decref(root);
    printf("\nFree, they span %.4g to %.4g %%.\n\n", least, most);
    printf("| Gaussians | kept, R | G | B | free, R | G | B |\n|---|---|---|---|---|---|---|\n");
    for (int k = 1; k <= PELL_GAUSSIANS_MAX; k++) {
        printf("| %d", k);
        for (int free = 0; free < 2; free++)
            for (int c = 0; c < 3; c++) {
                const struct pell_medium *m = &pell_material_find("marble")->medium;
                const struct pell_dipole d = pell_dipole_make(m->sigma_a[c], m->sigma_s_reduced[c], m->eta, PELL_FRESNEL_EXACT);
                printf(" | %.3g", fit_percent(&d, k, free, 0.0, NULL));
            }
        printf(" |\n");
    }
    return 0;
}

static const struct pell_material_entry *media[CHANNELS / 3];

/* The media of Jensen et al. 2001, each at its own index, by photons. */
static void walk_media(uint64_t photons)
{
    int n = 0;
    memset(tallies, 0, sizeof(tallies));
    for (size_t i = 0; i < pell_material_count() && n < CHANNELS / 3; i++) {
        const struct pell_material_entry *e = pell_material_at(i);
        if (strcmp(e->family, "Jensen et al. 2001") != 0)
            continue;
        for (int c = 0; c < 3; c++) {
            tallies[3 * n + c].eta = e->medium.eta;
            tallies[3 * n + c].alpha = e->medium.sigma_s_reduced[c] / (e->medium.sigma_s_reduced[c] + e->medium.sigma_a[c]);
        }
        media[n++] = e;
    }
    if (n != CHANNELS / 3)
        fail_msg("%d media", n);
    tally_count = CHANNELS;
    rings = true;
    for (int i = 0; i < n; i++) { /* each index once */
        bool done = false;
        for (int k = 0; k < i; k++)
            done |= media[k]->medium.eta == media[i]->medium.eta;
        walking_eta = media[i]->medium.eta;
        const struct pell_photon_stack s = photons_in_layer(0.0, 1.0, 0.0, walking_eta, INFINITY);
        if (!done)
            walk(&s, photons, 2001);
    }
}

/* In mean free paths, as the photons are. */
static void model_of(enum pell_profile_model model, int channel, struct pell_profile *p)
{
    const double alpha = tallies[channel].alpha;
    const struct pell_medium m = grey(1.0 - alpha, alpha, tallies[channel].eta);
    if (pell_profile_make(model, &m, 0, NULL, p) != PELL_OK)
        p->total = NAN;
}

/* Flux of a profile through ring k. */
static double through(const struct pell_profile *p, int k)
{
    const double a = k > 0 ? pell_profile_cdf(p, ring_edge(k)) : 0.0, b = k < RINGS - 1 ? pell_profile_cdf(p, ring_edge(k + 1)) : 1.0;
    return p->total * (b - a);
}

static void models(uint64_t photons)
{
    static struct pell_profile p;
    static double off[PELL_PROFILE_MODELS][CHANNELS], total[PELL_PROFILE_MODELS][CHANNELS];
    double noise = 0.0;
    walk_media(photons);
    for (int i = 0; i < CHANNELS; i++) {
        double error, all = mean_of(tallies[i].total[0], &error), sum = 0.0;
        for (int k = 0; k < RINGS; k++) {
            mean_of(tallies[i].ring[k], &error);
            sum += 0.8 * error; /* mean of |x| */
        }
        noise = fmax(noise, sum / all);
        for (int model = 0; model < PELL_PROFILE_MODELS; model++) {
            double missed = 0.0;
            model_of((enum pell_profile_model) model, i, &p);
            for (int k = 0; k < RINGS; k++)
                missed += fabs(through(&p, k) - mean_of(tallies[i].ring[k], &error));
            off[model][i] = missed / all;
            total[model][i] = p.total / all - 1.0;
        }
    }
    for (int table = 0; table < 2; table++) {
        printf("%s| %s |", table ? "\n" : "", table ? "total, % off" : "light misplaced, %");
        for (int model = 0; model < PELL_PROFILE_MODELS; model++)
            printf(" %s |", pell_profile_model_at((size_t) model)->name);
        printf("\n|---|---|---|---|---|---|\n");
        for (int m = 0; m < CHANNELS / 3; m++) {
            printf("| %s |", media[m]->name);
            for (int model = 0; model < PELL_PROFILE_MODELS; model++) {
                for (int c = 0; c < 3; c++)
                    printf(table ? " %+.1f" : " %.1f", 100.0 * (table ? total : off)[model][3 * m + c]);
                printf(" |");
            }
            printf("\n");
        }
    }
    printf("\n%llu photons for each index; their own noise is up to %.1f %% of light misplaced.\n", (unsigned long long) photons,
           100.0 * noise);
}

/* The curves of the plots, after models(). */
static int write_curves(const char *path)
{
    FILE *file = fopen(path, "w");
    static struct pell_profile p;
    json_t *root = load("appendix_a"), *row;
    double w[4], error;
    size_t i;
    if (!file) {
        perror(path);
        return 1;
    }
    for (double x = 1e-3; x < 21.0; x *= 1.06) {
        fprintf(file, "appendix-a,%.6g", x);
        for (int kind = 0; kind < 3; kind++)
            fprintf(file, ",%.6g", appendix_percent(x, (enum pell_appendix_a) kind, w));
        fprintf(file, "\n");
    }
    json_array_foreach(oracle_get(root, "pole"), i, row)
        fprintf(file, "pole,%g,%g,%g,%g\n", oracle_number(row, "x"), oracle_number(row, "err_percent_printed"),
                oracle_number(row, "err_percent_best_free"), oracle_number(row, "err_percent_best_constrained"));
    json_decref(root);
    for (int m = 0; m < CHANNELS / 3; m++) { /* green */
        const int c = 3 * m + 1;
        fprintf(file, "medium,%s,%.6g\n", media[m]->name, tallies[c].alpha);
        for (int model = 0; model < PELL_PROFILE_MODELS; model++) { /* radiant exitance per unit of ln r */
            model_of((enum pell_profile_model) model, c, &p);
            for (double r = 0.01; r < 101.0; r *= 1.1)
                fprintf(file, "curve,%s,%.5g,%.5g\n", pell_profile_model_at((size_t) model)->name, r,
                        2.0 * PELL_PI * r * r * pell_profile_eval(&p, r));
        }
        for (int k = 1; k < RINGS - 1; k++) {
            const double flux = mean_of(tallies[c].ring[k], &error), width = log(ring_edge(k + 1) / ring_edge(k));
            fprintf(file, "ring,%.5g,%.5g,%.3g\n", sqrt(ring_edge(k) * ring_edge(k + 1)), flux / width, error / width);
        }
    }
    return fclose(file) == 0 ? 0 : 1;
}

static uint64_t photons_in(const char *text)
{
    const unsigned long long n = strtoull(text, NULL, 10);
    return n < 1600 ? 1600 : n;
}

int main(int argc, char **argv)
{
    if (argc == 2 && strcmp(argv[1], "compare") == 0)
        return compare(false);
    if (argc == 2 && strcmp(argv[1], "tap") == 0)
        return compare(true);
    if (argc == 2 && strcmp(argv[1], "fits") == 0)
        return fits();
    if (argc == 4 && strcmp(argv[1], "models") == 0) {
        models(photons_in(argv[2]));
        return write_curves(argv[3]);
    }
    fprintf(stderr, "usage: oracle_table compare|tap|fits, oracle_table models PHOTONS CSV\n");
    return 2;
}
