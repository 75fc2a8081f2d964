/* SPDX-License-Identifier: MIT
 * plot.c - the plots of `pellucid profile`: R(r) over two logarithmic axes, or 2 pi r R(r) over linear ones, above a row that shows the
 * differences of the fits or the other models. One panel holds the three channels; with several fits or models each channel has its own. */
#include "cli/plot.h"
#include "cli/profile/profile.h"

#include "optics/photon/table.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SAMPLES = 241, MAX_CURVES = 24 };
#define RANGE 1e-7 /* fraction of the largest value down to which a logarithmic axis extends */

static const enum plot_color channel_colors[3] = { PLOT_RED, PLOT_GREEN, PLOT_BLUE };

/* The curves of a plot with their samples. */
struct sheet {
    const struct profile_job *job;
    bool weighted;
    double from, to;
    double least; /* least value on a logarithmic axis */
    double x[SAMPLES];
    struct plot_curve curves[6][MAX_CURVES]; /* curves of the panels, in row order */
    struct plot_panel panels[6];
    double *values[3 * 6 * MAX_CURVES]; /* owned */
    size_t num_values;
    char labels[PROFILE_FITS][64], difference_label[80];
};

/* What a curve shows: a profile, or a sum of Gaussians. */
struct subject {
    const struct pell_profile *profile;
    const struct pell_gaussians *gaussians;
};

static double value_of(const struct subject *s, double r)
{
    return s->profile ? pell_profile_eval(s->profile, r) : pell_gaussians_eval(s->gaussians, 0, r);
}

/* SAMPLES numbers that live as long as the sheet; NULL if out of memory. */
static double *new_values(struct sheet *sheet)
{
    double *v = calloc(SAMPLES, sizeof(*v));
    if (v)
        sheet->values[sheet->num_values++] = v;
    return v;
}

static struct plot_curve *add_curve(struct sheet *sheet, int panel, const char *label, enum plot_color color, enum plot_line line)
{
    struct plot_panel *p = &sheet->panels[panel];
    struct plot_curve *c = &sheet->curves[panel][p->num_curves];
    double *y = p->num_curves < MAX_CURVES ? new_values(sheet) : NULL;

    if (!y)
        return NULL;
    *c = (struct plot_curve) { .label = label, .x = sheet->x, .y = y, .count = SAMPLES, .color = color, .line = line };
    p->curves = sheet->curves[panel];
    p->num_curves++;
    return c;
}

/* Radius of a sample: its x, except at r = 0, where r R of models that rise as 1/r is 0 times infinity although its limit is not 0. */
static double radius_of(const struct sheet *sheet, int i)
{
    return sheet->weighted && i == 0 ? 1e-2 * sheet->x[1] : sheet->x[i];
}

/* R(r), or 2 pi r R(r). */
static bool add_value(struct sheet *sheet, int panel, const struct subject *s, const char *label, enum plot_color color,
                      enum plot_line line)
{
    struct plot_curve *c = add_curve(sheet, panel, label, color, line);

    for (int i = 0; c && i < SAMPLES; i++)
        ((double *) c->y)[i] = value_of(s, radius_of(sheet, i)) * (sheet->weighted ? 2.0 * acos(-1.0) * radius_of(sheet, i) : 1.0);
    return c != NULL;
}

/* Adds the difference of `s` from `base`: absolute where curves are weighted by 2 pi r, else in percent of the base, as far as the base is
 * drawn. */
static bool add_difference(struct sheet *sheet, int panel, const struct subject *s, const struct subject *base, const char *label,
                           enum plot_color color, enum plot_line line)
{
    struct plot_curve *c = add_curve(sheet, panel, label, color, line);

    for (int i = 0; c && i < SAMPLES; i++) {
        const double r = radius_of(sheet, i), a = value_of(s, r), b = value_of(base, r);
        ((double *) c->y)[i] = sheet->weighted ? 2.0 * acos(-1.0) * r * (a - b) : b > sheet->least ? 100.0 * (a / b - 1.0) : (double) NAN;
    }
    return c != NULL;
}

/* --- Axes --------------------------------------------------------------------------------------------------------------------- */

/* The lower end of the axis: RANGE of the largest value, or less, so that the fall-off of models that rise as 1/r is visible, too. */
static void choose_least(struct sheet *sheet)
{
    const struct pell_profile *R = sheet->job->profile->R;
    double high = 0.0;

    sheet->least = INFINITY;
    for (int c = 0; c < 3; c++)
        if (pell_profile_total(&R[c]) > 0.0) {
            high = fmax(high, pell_profile_eval(&R[c], sheet->x[0]));
            sheet->least = fmin(sheet->least, 0.1 * pell_profile_eval(&R[c], fmin(pell_profile_sample(&R[c], 0.998), sheet->to)));
        }
    sheet->least = fmax(fmin(sheet->least, RANGE * high), 1e-16 * high);
}

static void choose_x(struct sheet *sheet)
{
    const struct profile_job *job = sheet->job;

    sheet->from = sheet->weighted ? 0.0 : job->from;
    sheet->to = job->to;
    if (sheet->weighted && !job->to_given) {
        sheet->to = 0.0; /* the tail would leave no room for the rest */
        for (int c = 0; c < 3; c++)
            sheet->to = fmax(sheet->to, pell_profile_sample(&job->profile->R[c], 0.9));
        sheet->to = sheet->to > 0.0 ? sheet->to : job->to;
    }
    for (int i = 0; i < SAMPLES; i++) {
        const double f = (double) i / (SAMPLES - 1);
        sheet->x[i] = sheet->weighted ? f * sheet->to : job->from * pow(job->to / job->from, f);
    }
    choose_least(sheet);
}

/* The least and the largest value of a row's curves. */
static void extent_of(const struct sheet *sheet, int first, int count, double *low, double *high)
{
    *low = INFINITY;
    *high = -INFINITY;
    for (int k = first; k < first + count; k++)
        for (size_t j = 0; j < sheet->panels[k].num_curves; j++)
            for (size_t i = 0; i < sheet->curves[k][j].count; i++) {
                const double y = sheet->curves[k][j].y[i];
                if (isfinite(y)) {
                    *low = fmin(*low, y);
                    *high = fmax(*high, y);
                }
            }
}

static struct plot_axis value_axis(const struct sheet *sheet, int columns)
{
    const bool slab = sheet->job->slab && columns == 1;
    const char *weighted = slab ? "2\u03c0 r R(r), 2\u03c0 r T(r), 1/mm" : "2\u03c0 r R(r), 1/mm";
    const char *plain = slab ? "R(r), T(r), 1/mm\u00b2" : "R(r), 1/mm\u00b2";
    double low, high;

    extent_of(sheet, 0, columns, &low, &high);
    if (!(high > 0.0))
        return sheet->weighted ? (struct plot_axis) { weighted, false, 0.0, 1.0 } : (struct plot_axis) { plain, true, 1e-3, 1.0 };
    if (sheet->weighted)
        return (struct plot_axis) { weighted, false, 0.0, 1.06 * high };
    high = pow(10.0, ceil(2.0 * log10(1.1 * high)) / 2.0);
    low = pow(10.0, floor(log10(fmax(low, fmin(sheet->least, RANGE * high)))));
    return (struct plot_axis) { plain, true, low, high };
}

/* The difference axis covers the radii where most of the light is: the outermost hundredths must not compress the rest. */
static struct plot_axis difference_axis(const struct sheet *sheet, int columns, bool models)
{
    double high = 0.0, least = models ? 1e-3 : 0.1;
    const char *label = sheet->difference_label;

    for (int c = 0; c < 3; c++) {
        const struct pell_profile *base = &profile_reference(sheet->job)->R[c];
        const double first = pell_profile_sample(base, 0.01), last = pell_profile_sample(base, 0.99);
        const int panel = columns + (columns == 1 ? 0 : c);
        for (size_t j = 0; j < sheet->panels[panel].num_curves; j++)
            for (int i = 0; i < SAMPLES; i++)
                if (sheet->x[i] >= first && sheet->x[i] <= last && isfinite(sheet->curves[panel][j].y[i]))
                    high = fmax(high, fabs(sheet->curves[panel][j].y[i]));
    }
    if (sheet->weighted)
        return (struct plot_axis) { label, false, -1.15 * fmax(high, 1e-6), 1.15 * fmax(high, 1e-6) };
    high = fmin(fmax(1.15 * high, least), models ? 100.0 : 50.0);
    return (struct plot_axis) { label, false, -high, high };
}

/* --- Panels ------------------------------------------------------------------------------------------------------------------- */

static void name_fit(struct sheet *sheet, size_t i)
{
    if (i < sheet->job->num_fits)
        snprintf(sheet->labels[i], sizeof(sheet->labels[i]), "%.60s", pell_counted(sheet->job->fits[i].k, "Gaussian", "Gaussians").str);
}

/* Three channels in one panel, with the fit. */
static bool fill_one(struct sheet *sheet)
{
    const struct profile_job *job = sheet->job;
    const struct profile_fit *fit = job->num_fits ? &job->fits[0] : NULL;
    static const char *const transmitted[3] = { "T red", "T green", "T blue" };
    bool good = true;

    for (int c = 0; c < 3 && good; c++)
        good =
            add_value(sheet, 0, &(struct subject) { .profile = &job->profile->R[c] }, sheet->job->titles[c], channel_colors[c], PLOT_SOLID);
    for (int c = 0; c < 3 && job->slab && good; c++)
        good = add_value(sheet, 0, &(struct subject) { .profile = &job->profile->T[c] }, transmitted[c], channel_colors[c], PLOT_DASHED);
    name_fit(sheet, 0);
    for (int c = 0; c < 3 && fit && good; c++)
        good = add_value(sheet, 0, &(struct subject) { .gaussians = &fit->sum[c] }, c ? NULL : sheet->labels[0], PLOT_BLACK, PLOT_DOTTED);
    for (int c = 0; c < 3 && fit && good; c++)
        good = add_difference(sheet, 1, &(struct subject) { .gaussians = &fit->sum[c] },
                              &(struct subject) { .profile = &job->profile->R[c] }, sheet->job->titles[c], channel_colors[c], PLOT_SOLID);
    return good;
}

/* The index of the element of an array that is nearest to `value`. */
static int nearest(const double *list, int count, double value)
{
    int best = 0;
    for (int i = 1; i < count; i++)
        if (fabs(list[i] - value) < fabs(list[best] - value))
            best = i;
    return best;
}

/* Draws Monte Carlo results as points at the radii of their histogram, with one standard error of the nearest table entry as bars. Single
 * scattering has no bars: it is a closed form. */
static bool add_photons(struct sheet *sheet, int c, const struct candidate *one)
{
    const struct pell_photon_table *t = &pell_photon_table_data;
    const struct pell_medium *m = &sheet->job->medium;
    const double extinction = m->sigma_a[c] + m->sigma_s_reduced[c], v = sqrt(m->sigma_a[c] / extinction);
    const int g = nearest(t->g, PELL_TABLE_G, m->g[c]), eta = nearest(t->eta, PELL_TABLE_ETA, m->eta);
    const int alpha = nearest(t->v, PELL_TABLE_ALPHA, v);
    struct plot_curve *curve = add_curve(sheet, c, one->name, PLOT_BLACK, PLOT_POINTS);
    double *x = new_values(sheet), *error = new_values(sheet);
    struct pell_profile *multiple = malloc(sizeof(*multiple));

    if (!curve || !x || !error || !multiple ||
        pell_profile_make(PELL_PROFILE_MONTE_CARLO, m, c, &(struct pell_profile_params) { .without_single = true }, multiple) != PELL_OK) {
        free(multiple);
        return false;
    }
    for (int i = 0; i < PELL_TABLE_R; i++) {
        const double r = exp(pell_table_x(i)) / extinction, weight = sheet->weighted ? 2.0 * acos(-1.0) * r : 1.0;
        const uint8_t code = t->error[g][eta][alpha][i];
        x[i] = r >= sheet->from && r <= sheet->to ? r : (double) NAN;
        ((double *) curve->y)[i] = weight * pell_profile_eval(&one->R[c], r);
        error[i] = code == PELL_TABLE_NO_ERROR ? 0.0 : weight * pell_profile_eval(multiple, r) * 1e-4 * exp2(code / 8.0);
    }
    free(multiple);
    curve->x = x;
    curve->error = error;
    curve->count = PELL_TABLE_R;
    return true;
}

/* Each channel in its panel: the profile, other models and fits; below, their differences from the reference. */
static bool fill_column(struct sheet *sheet, int c)
{
    static const enum plot_color colors[] = { PLOT_RED, PLOT_BLUE, PLOT_GREEN, PLOT_PURPLE, PLOT_ORANGE, PLOT_SKY };
    static const enum plot_line lines[] = { PLOT_DASHED, PLOT_SOLID, PLOT_DASH_DOT, PLOT_DOTTED, PLOT_DASHED, PLOT_DASH_DOT };
    const struct profile_job *job = sheet->job;
    const struct candidate *reference = profile_reference(job);
    const struct subject base = { .profile = &reference->R[c] };
    const size_t fits = job->num_others ? 0 : job->num_fits;
    size_t k = 0;
    bool good = true;

    for (size_t i = 0; i <= job->num_others && good; i++) {
        const struct candidate *one = i ? &job->others[i - 1] : job->profile;
        const struct subject s = { .profile = &one->R[c] };
        const bool photons = strcmp(one->name, "monte-carlo") == 0;
        const enum plot_color color = one == job->profile ? PLOT_BLACK : colors[k % 6];
        const enum plot_line line = one == job->profile ? PLOT_SOLID : lines[k % 6];
        good = photons ? add_photons(sheet, c, one) : add_value(sheet, c, &s, one->name, color, line);
        if (good && one != reference)
            good = add_difference(sheet, 3 + c, &s, &base, NULL, color, line);
        k += one != job->profile && !photons;
    }
    for (size_t i = 0; i < fits && good; i++, k++) {
        const struct subject s = { .gaussians = &job->fits[i].sum[c] };
        name_fit(sheet, i);
        good = add_value(sheet, c, &s, sheet->labels[i], colors[k % 6], lines[k % 6]) &&
               add_difference(sheet, 3 + c, &s, &base, NULL, colors[k % 6], lines[k % 6]);
    }
    return good;
}

static void add_numbers(struct pell_text *text, const char *name, const double v[3], const char *unit)
{
    const char *between = text->length == 0 || text->str[text->length - 1] == '\n' ? ""
                          : text->str[text->length - 1] == 'y'                     ? " "
                                                                                   : " \u00b7 ";

    pell_text_add(text, "%s%s", between, name);
    for (int c = 0; c < 3; c++)
        pell_text_add(text, isfinite(v[c]) ? " %.3g" : " \u221e", v[c]);
    pell_text_add(text, "%s%s", unit[0] ? " " : "", unit);
}

static void write_caption(const struct profile_job *job, struct pell_text *text)
{
    double mfp[3], dmfp[3], total[3];

    for (int c = 0; c < 3; c++) {
        mfp[c] = job->has_medium ? pell_mean_free_path(&job->medium, c) : 0.0;
        dmfp[c] = job->has_medium ? pell_diffuse_mean_free_path(&job->medium, c) : 0.0;
        total[c] = pell_profile_total(&job->profile->R[c]);
    }
    if (job->has_medium) {
        pell_text_add(text, "\u03b7 %g", job->medium.eta);
        if (job->params.roughness > 0.0)
            pell_text_add(text, " \u00b7 roughness %g", job->params.roughness);
        add_numbers(text, "mean free path", mfp, "mm");
        add_numbers(text, "diffuse mean free path", dmfp, "mm");
    }
    if (job->num_others)
        pell_text_add(text, "%stotal reflectance by", job->has_medium ? "\n" : "");
    add_numbers(text, job->num_others ? job->model : "total reflectance", total, "");
    if (job->slab && !job->num_others) {
        for (int c = 0; c < 3; c++)
            total[c] = pell_profile_total(&job->profile->T[c]);
        add_numbers(text, "total transmittance", total, "");
    }
    if (job->num_fits && !job->num_others)
        pell_text_add(text, "\n");
    for (size_t i = 0; i < job->num_fits && !job->num_others; i++) {
        char head[128];
        double percent[3];
        for (int c = 0; c < 3; c++)
            percent[c] = 100.0 * job->fits[i].error[c];
        snprintf(head, sizeof(head), "error of %s", pell_counted(job->fits[i].k, "Gaussian", "Gaussians").str);
        add_numbers(text, head, percent, "%");
    }
    for (size_t i = 0; i < job->num_others; i++) {
        for (int c = 0; c < 3; c++)
            total[c] = pell_profile_total(&job->others[i].R[c]);
        add_numbers(text, job->others[i].name, total, "");
    }
}

enum exit_code profile_plot(struct cli *cli, const struct profile_job *job)
{
    const bool models = job->num_others > 0;
    const int columns = models || job->num_fits > 1 ? 3 : 1, rows = models || job->num_fits ? 2 : 1;
    struct sheet *sheet = calloc(1, sizeof(*sheet));
    struct pell_text caption = { .length = 0 }, title = { .length = 0 };
    enum exit_code code = EXIT_MEMORY;
    bool good = sheet != NULL;

    if (good) {
        struct plot_axis x = { "r, mm", false, 0.0, 1.0 }, value, difference;

        sheet->job = job;
        sheet->weighted = cli->profile.weighted;
        choose_x(sheet);
        x = (struct plot_axis) { "r, mm", !sheet->weighted, sheet->from, sheet->to };
        good = columns == 1 ? fill_one(sheet) : fill_column(sheet, 0) && fill_column(sheet, 1) && fill_column(sheet, 2);
        snprintf(sheet->difference_label, sizeof(sheet->difference_label), "%s%s, %s", models ? "from " : "error of the fit",
                 models ? profile_reference(job)->name : "", sheet->weighted ? "1/mm" : "%");
        value = value_axis(sheet, columns);
        difference = difference_axis(sheet, columns, models);
        for (int i = 0; i < columns * rows; i++) {
            struct plot_panel *p = &sheet->panels[i];
            p->x = x;
            p->y = i < columns ? value : difference;
            if (i % columns)
                p->y.label = "";
            p->title = columns > 1 && i < columns ? job->titles[i] : NULL;
            p->legend = i == 0;
        }
        pell_text_add(&title, "%s: %s", job->name, !models ? job->model : job->layers ? "three solvers" : "profile models");
        write_caption(job, &caption);
    }
    if (good)
        code = cli_failed(cli, plot_write(cli->ctx, cli->output,
                                          &(struct plot) { .title = title.str,
                                                           .caption = caption.str,
                                                           .width = columns > 1 ? 1180.0 : 760.0,
                                                           .height = rows > 1 ? 640.0 : 520.0,
                                                           .columns = columns,
                                                           .rows = rows,
                                                           .row_fraction = { rows > 1 ? 0.68 : 1.0, 0.32 },
                                                           .panels = sheet->panels }));
    for (size_t i = 0; sheet && i < sheet->num_values; i++)
        free(sheet->values[i]);
    free(sheet);
    return code;
}
