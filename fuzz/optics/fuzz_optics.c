/* SPDX-License-Identifier: MIT
 * fuzz_optics.c - the functions of the optics tier on arbitrary numbers: they return for any arguments, and accepted arguments give the
 * documented properties: finite, no negative reflectance, no more light than enters.
 *
 * The first byte selects the function, the rest are its arguments: a byte for the encoding of each, then the 8 bytes of a double, or 2
 * bytes for a fraction of its range. Missing bytes are 0. */
#include <pellucid/inversion.h>
#include <pellucid/kernel.h>
#include <pellucid/layers.h>
#include <pellucid/material.h>
#include <pellucid/phase.h>
#include <pellucid/sampling.h>
#include <pellucid/skin.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define SLACK 1e-6 /* tolerance by which a total may exceed 1 */

struct bytes {
    const uint8_t *at, *end;
};

#define require(holds) ((holds) ? (void) 0 : fail(#holds, __LINE__))

static void fail(const char *what, int line)
{
    fprintf(stderr, "fuzz_optics.c:%d: not so: %s\n", line, what);
    abort();
}

static unsigned next_byte(struct bytes *in)
{
    return in->at < in->end ? *in->at++ : 0;
}

/* An integer in [low, high]. */
static int whole(struct bytes *in, int low, int high)
{
    return low + (int) (next_byte(in) % (unsigned) (high - low + 1));
}

/* Any number, but most often one in [low, high], low >= 0: a bound, uniform, or uniform in the logarithm. */
static double number(struct bytes *in, double low, double high)
{
    const unsigned form = next_byte(in) % 8;
    double value, fraction;
    uint8_t raw[sizeof(value)];

    if (form == 0) {
        for (size_t i = 0; i < sizeof(raw); i++)
            raw[i] = (uint8_t) next_byte(in);
        memcpy(&value, raw, sizeof(value));
        return value;
    }
    if (form == 1 || form == 2)
        return form == 1 ? low : high;
    fraction = next_byte(in);
    fraction = (fraction + 256.0 * next_byte(in)) / 65535.0;
    if (form < 5)
        return low + fraction * (high - low);
    return high * pow(low > 0.0 ? low / high : 1e-12, fraction);
}

static double signed_number(struct bytes *in, double high)
{
    const bool minus = next_byte(in) & 1;
    const double value = number(in, 0.0, high);
    return minus ? -value : value;
}

static struct pell_medium some_medium(struct bytes *in)
{
    struct pell_medium m;

    for (int c = 0; c < 3; c++) {
        m.sigma_a[c] = number(in, 0.0, PELL_SIGMA_MAX);
        m.sigma_s_reduced[c] = number(in, 0.0, PELL_SIGMA_MAX);
        m.g[c] = signed_number(in, PELL_G_MAX);
    }
    m.eta = number(in, PELL_ETA_MIN, PELL_ETA_MAX);
    return m;
}

static struct pell_profile_params some_params(struct bytes *in)
{
    const unsigned flags = next_byte(in);
    struct pell_profile_params params = { .fresnel = (enum pell_fresnel_model)(flags & 3), .without_single = flags & 4 };

    if (flags & 8)
        params.roughness = number(in, 0.0, 1.0);
    if (flags & 16)
        params.A = number(in, 0.0, PELL_PROFILE_A_MAX);
    return params;
}

/* --- Profiles ----------------------------------------------------------------------------------------------------------------- */

static void check_total(double total)
{
    require(total >= 0.0 && total <= 1.0 + SLACK);
}

static void check_profile(struct bytes *in, const struct pell_profile *p)
{
    double r[16], R[16], middle;

    check_total(pell_profile_total(p));
    for (int i = 0; i < 8; i++) {
        const double xi = number(in, 0.0, 1.0), s = number(in, 0.0, 1e3);
        r[i] = pell_profile_sample(p, xi);
        require(r[i] >= 0.0 && isfinite(r[i]));
        r[i + 8] = number(in, 0.0, 1e6);
        require(fabs(pell_profile_transform(p, s)) <= pell_profile_total(p) * (1.0 + SLACK) + 1e-300);
    }
    pell_profile_eval_many(p, r, R, 16);
    for (int i = 0; i < 16; i++) {
        const double value = pell_profile_eval(p, r[i]), inside = pell_profile_cdf(p, r[i]);
        require(value >= 0.0 && memcmp(&value, &R[i], sizeof(value)) == 0);
        require(inside >= 0.0 && inside <= 1.0 && pell_profile_pdf(p, r[i]) >= 0.0);
    }
    middle = pell_profile_sample(p, 0.5);
    require(pell_profile_total(p) == 0.0 || fabs(pell_profile_cdf(p, middle) - 0.5) < 1e-6);
}

static bool some_profile(struct bytes *in, struct pell_profile *out)
{
    const enum pell_profile_model model = (enum pell_profile_model) whole(in, -1, PELL_PROFILE_MODELS);
    const struct pell_medium medium = some_medium(in);
    const struct pell_profile_params params = some_params(in);
    const int channel = whole(in, -1, 3);
    const enum pell_result res = pell_profile_make(model, &medium, channel, &params, out);

    require(res == PELL_OK || res == PELL_ERR_INVALID || res == PELL_ERR_UNSUPPORTED);
    require(res == PELL_OK || out->total == 0.0);
    return res == PELL_OK;
}

/* Rows sorted by radius or unsorted; arbitrary values, or values whose light is at most 1. */
static bool some_table(struct bytes *in, struct pell_profile *out)
{
    enum { ROWS = 1500 };
    static double r[ROWS], R[ROWS];
    const unsigned form = next_byte(in);
    const size_t repeat = form & 4 ? 20 : 1, given = (size_t) (in->end - in->at) / 6;
    struct pell_profile_fault fault;
    size_t count = 0;

    for (size_t i = 0; i < given * repeat && i < ROWS; i++, count++) {
        r[i] = i % repeat ? r[i - 1] * 1.01 + 1e-9 : number(in, form & 8 ? 1e-3 : 0.0, 1e3);
        if (form & 1 && i && i % repeat == 0)
            r[i] = r[i - 1] + fabs(r[i]);
        R[i] = i % repeat ? R[i - 1] : number(in, 0.0, form & 16 ? 1.0 : 1e9);
    }
    for (size_t i = 0; form & 2 && i < count; i++)
        R[i] /= 1e9 * 3.2 * fmax(1e-12, r[count - 1] * r[count - 1]);
    if (pell_profile_from_table(r, R, count, out, &fault) == PELL_OK)
        return true;
    require(fault.field && fault.row <= count && out->total == 0.0);
    return false;
}

static bool any_profile(struct bytes *in, struct pell_profile *out)
{
    return next_byte(in) & 1 ? some_table(in, out) : some_profile(in, out);
}

static void try_profile(struct bytes *in)
{
    struct pell_profile p;
    if (some_profile(in, &p))
        check_profile(in, &p);
}

static void try_table(struct bytes *in)
{
    struct bytes start = *in;
    struct pell_profile p;
    if (some_table(in, &p))
        check_profile(&start, &p);
}

static void try_dipole(struct bytes *in)
{
    const double sigma_a = number(in, 0.0, PELL_SIGMA_MAX), sigma_s = number(in, 0.0, PELL_SIGMA_MAX);
    const double eta = number(in, PELL_ETA_MIN, PELL_ETA_MAX), z = signed_number(in, 1e6), s = number(in, 0.0, 1e6);
    const struct pell_dipole d = pell_dipole_make(sigma_a, sigma_s, eta, (enum pell_fresnel_model) whole(in, 0, 2));
    const double r = number(in, 0.0, 1e6), albedo = number(in, 0.0, 1.0), exact = pell_half_space_albedo(albedo, eta);
    double variance[10], weight[10];

    require(isnan(exact) || (exact >= 0.0 && exact <= 1.0 + SLACK));
    if (sigma_a >= 0.0 && sigma_s >= 0.0 && sigma_a <= PELL_SIGMA_MAX && sigma_s <= PELL_SIGMA_MAX &&
        sigma_a + sigma_s >= PELL_SIGMA_T_MIN && eta >= PELL_ETA_MIN && eta <= PELL_ETA_MAX && r >= 0.0) {
        require(pell_dipole_rd(&d, r) >= 0.0 && pell_dipole_total(&d) >= 0.0 && pell_dipole_cdf(&d, r) >= 0.0);
        require(pell_dipole_cdf(&d, r) <= 1.0 && pell_dipole_sample_one(&d, albedo) >= 0.0 && pell_dipole_sample(&d, albedo, r) >= 0.0);
    }
    if (pell_pole_gaussians(z, s, variance, weight, 8) == PELL_OK)
        for (int i = 0; i < 8; i++)
            require(isfinite(weight[i]) && variance[i] >= 0.0 && isfinite(variance[i]));
    if (pell_pole_appendix_a(z, s, (enum pell_appendix_a) whole(in, -1, 3), variance, weight) == PELL_OK)
        for (int i = 0; i < 4; i++)
            require(isfinite(weight[i]) && variance[i] >= 0.0 && isfinite(variance[i]));
}

/* --- Fits --------------------------------------------------------------------------------------------------------------------- */

static void check_fit(const struct pell_gaussians *g, const struct pell_fit_params *params, const struct pell_fit_report *report, int c,
                      double total)
{
    double sum = 0.0;

    require(g->count >= 0 && g->count <= params->count);
    for (int i = 0; i < g->count; i++) {
        require(g->weight[i][c] >= 0.0 && isfinite(g->weight[i][c]) && g->variance[i] > 0.0 && isfinite(g->variance[i]));
        require(i == 0 || g->variance[i] >= g->variance[i - 1]);
        sum += g->weight[i][c];
    }
    require(isfinite(report->error[c]) && report->error[c] >= 0.0);
    require(params->free_energy || fabs(sum - total) <= SLACK);
}

static struct pell_fit_params some_fit(struct bytes *in)
{
    const struct pell_fit_params params = { .count = whole(in, 0, PELL_GAUSSIANS_MAX + 1), .free_energy = next_byte(in) & 1 };
    struct pell_fit_params with_end = params;
    if (next_byte(in) & 1)
        with_end.r_max_mm = number(in, 0.0, 1e6);
    return with_end;
}

static void try_fit(struct bytes *in)
{
    const struct pell_fit_params params = some_fit(in);
    struct pell_fit_report report;
    struct pell_gaussians g;
    struct pell_profile p;

    if (any_profile(in, &p) && pell_fit_profile(&p, &params, &g, &report) == PELL_OK) {
        check_fit(&g, &params, &report, 0, p.total);
        const bool error = !isnan(pell_gaussians_error(&g, 0, &p, params.r_max_mm));
        require(p.total > 0.0 && g.count ? error || p.total < 1e-290 : !error); /* denormal light has no meaningful error */
    }
}

static void try_shared_fit(struct bytes *in)
{
    const struct pell_fit_params params = some_fit(in);
    struct pell_profile *p = malloc(3 * sizeof(*p));
    struct pell_fit_report report;
    struct pell_gaussians g;

    require(p);
    if (some_profile(in, &p[0]) && some_profile(in, &p[1]) && any_profile(in, &p[2]) &&
        pell_fit_profiles(p, &params, &g, &report) == PELL_OK)
        for (int c = 0; c < 3; c++)
            check_fit(&g, &params, &report, c, p[c].total);
    free(p);
}

/* --- Layers ------------------------------------------------------------------------------------------------------------------- */

static void some_stack(struct bytes *in, struct pell_stack *s)
{
    const unsigned flags = next_byte(in);

    memset(s, 0, sizeof(*s));
    s->count = whole(in, 0, flags & 1 ? PELL_LAYERS_MAX + 1 : 4);
    s->fresnel = (enum pell_fresnel_model) whole(in, 0, 3);
    for (int i = 0; i < s->count && i < PELL_LAYERS_MAX; i++) {
        struct pell_medium_layer *y = &s->layer[i];
        /* only one channel is checked */
        y->sigma_a[0] = y->sigma_a[1] = y->sigma_a[2] = number(in, 0.0, PELL_SIGMA_MAX);
        y->sigma_s_reduced[0] = y->sigma_s_reduced[1] = y->sigma_s_reduced[2] = number(in, 0.0, PELL_SIGMA_MAX);
        y->eta = flags & 2 ? number(in, PELL_ETA_MIN, PELL_ETA_MAX) : 1.4;
        y->thickness = number(in, PELL_THICKNESS_MIN, PELL_THICKNESS_MAX);
        if (flags & 4)
            s->roughness[i] = number(in, 0.0, 1.0);
        if (flags & 8)
            for (int k = 0; k < 2; k++)
                s->A[i][k] = number(in, 1.0, 1e6);
    }
    if (flags & 16)
        s->eta_above = number(in, PELL_ETA_MIN, PELL_ETA_MAX);
    if (flags & 16)
        s->eta_below = number(in, PELL_ETA_MIN, PELL_ETA_MAX);
    if (flags & 32 && s->count >= 1 && s->count <= PELL_LAYERS_MAX)
        s->layer[s->count - 1].thickness = INFINITY;
}

static void check_parts(const double total[PELL_STACK_PARTS])
{
    for (int k = 0; k < PELL_STACK_PARTS; k++)
        require(total[k] >= -1e-12);
    require(total[PELL_STACK_R_PLUS] + total[PELL_STACK_T_PLUS] <= 1.0 + SLACK);
    require(total[PELL_STACK_R_MINUS] + total[PELL_STACK_T_MINUS] <= 1.0 + SLACK);
}

static void try_stack(struct bytes *in)
{
    struct pell_stack_fault fault;
    struct pell_stack s, alone;
    double total[PELL_STACK_PARTS], at[PELL_STACK_PARTS], frequency, r, value;
    bool valid;
    int dipoles;

    some_stack(in, &s);
    valid = pell_stack_valid(&s, &fault);
    require(valid || fault.field);
    require((pell_stack_totals(&s, 0, total, NULL) == PELL_OK) == valid);
    if (!valid)
        return;
    check_parts(total);
    frequency = number(in, 0.0, 1e6);
    if (pell_stack_transforms(&s, 0, frequency, at) == PELL_OK)
        for (int k = 0; k < PELL_STACK_PARTS; k++)
            require(fabs(at[k]) <= 1.0 + SLACK);
    require(pell_stack_layer(&s, whole(in, 0, s.count - 1), &alone) == PELL_OK && pell_stack_valid(&alone, &fault));
    r = number(in, 0.0, 1e6);
    if (pell_slab_poles(&alone, 0, (enum pell_stack_part) whole(in, 0, 3), r, 1e-9, 201, &value, &dipoles) == PELL_OK)
        require(isfinite(value) && dipoles >= 1 && dipoles <= 201);
}

static void try_hankel(struct bytes *in)
{
    enum { RADII = 6 };
    double r[RADII], value[PELL_STACK_PARTS][RADII], *const out[PELL_STACK_PARTS] = { value[0], value[1], value[2], value[3] };
    struct pell_profile p;
    struct pell_stack s;
    unsigned flags;

    some_stack(in, &s);
    for (int i = 0; i < RADII; i++)
        r[i] = number(in, 0.0, 1e6);
    if (pell_stack_hankel(&s, 0, r, RADII, out, &flags) == PELL_OK)
        for (int i = 0; i < RADII * PELL_STACK_PARTS; i++)
            require(isfinite(value[i / RADII][i % RADII]));
    if (pell_stack_profile(&s, 0, (enum pell_stack_part) whole(in, -1, 4), &p, &flags) == PELL_OK)
        check_profile(in, &p);
}

static void try_stack_gaussians(struct bytes *in)
{
    struct pell_stack_gaussians_params params = { .analytic = false };
    const unsigned form = next_byte(in);
    struct pell_stack_sets *sets = malloc(sizeof(*sets));
    const struct pell_stack_sets *channel[3] = { sets, sets, sets };
    double total[PELL_STACK_PARTS];
    struct pell_gaussians g;
    struct pell_stack s;
    void *workspace;
    size_t size;

    params.analytic = form & 1;
    params.reflectance_only = form & 2;
    if (form & 4)
        params.variance = number(in, 1e-12, 1e6);
    if (form & 8)
        params.block = whole(in, 0, PELL_STACK_BLOCK_MAX + 2);
    if (form & 16)
        params.energy_loss = number(in, 1e-15, 0.1);
    some_stack(in, &s);
    size = pell_stack_workspace_size(&params);
    require(size < 1 << 28);
    workspace = malloc(size);
    require(sets && workspace);
    if (pell_stack_gaussians(&s, 0, &params, workspace, size, sets) == PELL_OK) {
        const int parts = params.reflectance_only ? 1 : PELL_STACK_PARTS;
        require(sets->count >= 1 && sets->count <= PELL_STACK_SET_MAX && sets->narrow > 0.0);
        memset(total, 0, sizeof(total));
        for (int k = 0; k < parts; k++)
            for (int i = 0; i < sets->count; i++) {
                require(isfinite(sets->weight[k][i]) && (params.analytic || sets->weight[k][i] >= 0.0));
                require(sets->variance[i] > (i ? sets->variance[i - 1] : 0.0) && isfinite(sets->variance[i]));
                total[k] += sets->weight[k][i];
            }
        if (!params.analytic)
            check_parts(total);
        if (pell_stack_reduce(channel, PELL_STACK_R_PLUS, whole(in, 1, PELL_GAUSSIANS_MAX + 1), &g) == PELL_OK)
            for (int i = 0; i < g.count; i++)
                require(g.weight[i][0] >= 0.0 && isfinite(g.weight[i][0]));
    }
    free(workspace);
    free(sets);
}

/* --- Scattering events --------------------------------------------------------------------------------------------------------- */

static void try_phase(struct bytes *in)
{
    const struct pell_phase p = { .kind = (enum pell_phase_kind) whole(in, 0, PELL_PHASE_KINDS),
                                  .g = { signed_number(in, PELL_G_MAX), signed_number(in, PELL_G_MAX) },
                                  .weight = number(in, 0.0, 1.0) };
    const double cosine = signed_number(in, 1.0), xi = number(in, 0.0, 1.0), xi2 = number(in, 0.0, 1.0), w_i[3] = { 0.0, 0.6, -0.8 };
    const double k = pell_phase_schlick_k(cosine);
    struct pell_medium_fault fault;
    double w_o[3], drawn;

    require(!(fabs(k) > PELL_G_MAX));
    if (!pell_phase_valid(&p, &fault)) {
        require(fault.field);
        return;
    }
    require(fabs(pell_phase_mean_cosine(&p)) <= 1.0);
    if (!isnan(cosine)) {
        require(pell_phase_value(&p, cosine) >= 0.0 && isfinite(pell_phase_value(&p, cosine)));
        require(pell_phase_cdf(&p, cosine) >= 0.0 && pell_phase_cdf(&p, cosine) <= 1.0);
    }
    if (isnan(xi) || isnan(xi2))
        return;
    drawn = pell_phase_sample_cosine(&p, xi);
    require(fabs(drawn) <= 1.0);
    require(pell_phase_sample(&p, xi, xi2, w_i, w_o) > 0.0);
    require(fabs(w_o[0] * w_o[0] + w_o[1] * w_o[1] + w_o[2] * w_o[2] - 1.0) < 1e-9);
}

/* --- Inversion ------------------------------------------------------------------------------------------------------------------ */

static void try_inversion(struct bytes *in)
{
    const enum pell_albedo_map map = (enum pell_albedo_map) whole(in, 0, PELL_ALBEDO_MAPS - 1);
    const enum pell_profile_model model = (enum pell_profile_model) whole(in, -1, PELL_PROFILE_MODELS);
    const struct pell_profile_params params = some_params(in);
    struct pell_color_and_radius look = { .kind = (enum pell_scatter_radius) whole(in, 0, PELL_SCATTER_RADII) };
    struct pell_medium_fault fault = { .field = NULL };
    struct pell_medium medium;
    struct pell_profile p;
    double albedo, back;

    look.eta = number(in, PELL_ETA_MIN, PELL_ETA_MAX);
    for (int c = 0; c < 3; c++) {
        look.color[c] = number(in, 0.0, 1.0);
        look.radius[c] = number(in, 1e-6, 1e6);
        look.g[c] = signed_number(in, PELL_G_MAX);
    }
    albedo = pell_albedo_map_invert(map, look.color[0], look.eta);
    require(isnan(albedo) ? isnan(look.color[0]) || isnan(look.eta) : albedo >= 0.0 && albedo <= 1.0);
    back = pell_albedo_map_color(map, albedo, look.eta);
    require(isnan(back) || (back >= 0.0 && back <= 1.0));
    for (int i = 0; i < 2; i++) {
        back = i ? pell_color_under_boundary(look.color[0], look.eta) : pell_color_without_boundary(look.color[0], look.eta);
        require(isnan(back) ? isnan(look.color[0]) || isnan(look.eta) : back >= 0.0 && back <= 1.0);
    }
    if (pell_medium_from_map(&look, map, &medium, &fault) == PELL_OK)
        require(pell_medium_valid(&medium, NULL));
    else
        require(fault.field);
    if (pell_medium_from_color_and_radius(&look, model, &params, &medium, NULL) != PELL_OK)
        return;
    require(pell_medium_valid(&medium, NULL));
    for (int c = 0; c < 3; c++) {
        require(pell_profile_make(model, &medium, c, &params, &p) == PELL_OK);
        require(fabs(p.total - look.color[c]) < 1e-6);
    }
}

/* --- Materials ------------------------------------------------------------------------------------------------------------------ */

static void try_material(struct bytes *in)
{
    const struct pell_material_entry *entry = pell_material_at(next_byte(in) % pell_material_count());
    struct pell_material_entry e = *entry;

    for (int i = 0; i < 3; i++) {
        const double concentration = number(in, 1e-6, PELL_CONCENTRATION_MAX);
        if (pell_material_dilute(&e, concentration, &e) == PELL_OK)
            require(pell_medium_valid(&e.medium, NULL) && e.concentration > 0.0 && e.medium.eta == entry->medium.eta);
    }
}

static void try_skin(struct bytes *in)
{
    struct pell_skin skin;
    struct pell_skin_coefficients coefficients[2];
    struct pell_medium_fault fault;
    struct pell_material_layers layers;
    struct pell_stack stack;
    double reflectance[PELL_WAVELENGTHS], rgb[3], wavelength;
    bool valid;

    skin.melanin = number(in, 0.0, 1.0);
    skin.melanin_blend = number(in, 0.0, 1.0);
    skin.haemoglobin = number(in, 0.0, 1.0);
    skin.oxygenation = number(in, 0.0, 1.0);
    skin.epidermis_mm = number(in, 0.01, 1.0);
    skin.eta = number(in, 1.0, 2.0);
    wavelength = number(in, PELL_WAVELENGTH_MIN, PELL_WAVELENGTH_MAX);
    valid = pell_skin_valid(&skin, &fault);
    if (pell_skin_at(&skin, wavelength, &coefficients[0], &coefficients[1]) == PELL_OK)
        for (int i = 0; i < 2; i++)
            require(coefficients[i].sigma_a >= 0.0 && coefficients[i].sigma_s_reduced > 0.0 && isfinite(coefficients[i].sigma_a) &&
                    isfinite(coefficients[i].sigma_s_reduced));
    require((pell_skin_reflectance(&skin, reflectance) == PELL_OK) == valid);
    require((pell_skin_color(&skin, rgb) == PELL_OK) == valid);
    require((pell_skin_layers(&skin, &layers) == PELL_OK) == valid);
    if (!valid) {
        require(fault.field);
        return;
    }
    for (int i = 0; i < PELL_WAVELENGTHS; i++)
        check_total(reflectance[i]);
    for (int c = 0; c < 3; c++)
        check_total(rgb[c]);
    pell_material_stack(&layers, &stack);
    require(pell_stack_valid(&stack, NULL));
}

/* --- Kernels -------------------------------------------------------------------------------------------------------------------- */

static void try_kernel(struct bytes *in)
{
    enum { TEXELS = 32 };
    const double end = number(in, 0.0, 1e6);
    const struct pell_separable_params params = { .taps = whole(in, 0, PELL_KERNEL_TAPS_MAX + 2),
                                                  .rank = whole(in, 0, 4),
                                                  .extent_mm = number(in, 0.0, 1e6),
                                                  .spread = number(in, 1.0, 4.0) };
    struct pell_separable *kernel = malloc(sizeof(*kernel));
    struct pell_profile *p = malloc(3 * sizeof(*p));
    float texel[TEXELS];

    require(kernel && p);
    if (any_profile(in, &p[0])) {
        p[1] = p[2] = p[0];
        if (pell_kernel_table_value(&p[0], end, texel, TEXELS) == PELL_OK)
            for (int i = 0; i < TEXELS; i++)
                require(texel[i] >= 0.0f);
        if (pell_kernel_table_ring(&p[0], end, texel, TEXELS) == PELL_OK)
            for (int i = 0; i < TEXELS; i++)
                require(texel[i] >= 0.0f && texel[i] <= 1.0f + (float) SLACK);
        if (pell_kernel_table_radius(&p[0], texel, TEXELS) == PELL_OK)
            for (int i = 0; i < TEXELS; i++)
                require(texel[i] >= 0.0f);
        if (pell_kernel_table_sphere(&p[0], end, texel, TEXELS / 4, 4) == PELL_OK)
            for (int i = 0; i < TEXELS; i++)
                require(texel[i] >= 0.0f && texel[i] <= 1.0f + (float) SLACK);
        if (pell_separable_make(p, &params, kernel) == PELL_OK)
            for (int k = 0; k < kernel->rank; k++)
                for (int i = 0; i < kernel->taps; i++)
                    require(isfinite(kernel->weight[k][i][0]) && isfinite(kernel->offset_mm[i]));
    }
    free(p);
    free(kernel);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static void (*const tries[])(struct bytes *) = { try_profile,  try_table,  try_dipole,          try_fit,   try_shared_fit,
                                                     try_stack,    try_hankel, try_stack_gaussians, try_phase, try_inversion,
                                                     try_material, try_skin,   try_kernel };
    struct bytes in = { data, data + size };

    tries[next_byte(&in) % (sizeof(tries) / sizeof(tries[0]))](&in);
    return 0;
}
