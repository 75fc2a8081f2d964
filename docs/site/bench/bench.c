/* SPDX-License-Identifier: MIT
 * bench.c - what the page of the profile bench calls: the library's optics, compiled to WebAssembly. Numbers go through one array. */
#include <pellucid/gaussians.h>
#include <pellucid/profile.h>

#include <math.h>

#include <emscripten.h>

#define RADII 97
#define CHANNELS 3

/* Room for what is asked and answered, on the page's side of the call. */
struct bench {
    double sigma_a[CHANNELS], sigma_s_reduced[CHANNELS], eta; /* asked */
    double r[RADII], R[CHANNELS][RADII], fit[CHANNELS][RADII];
    double total[CHANNELS], mean_free_path[CHANNELS], diffuse_mean_free_path[CHANNELS], error[CHANNELS];
    double variance[CHANNELS][PELL_GAUSSIANS_MAX], weight[CHANNELS][PELL_GAUSSIANS_MAX];
};

EMSCRIPTEN_KEEPALIVE int bench_bytes(void)
{
    return (int) sizeof(struct bench);
}

EMSCRIPTEN_KEEPALIVE int bench_radii(void)
{
    return RADII;
}

EMSCRIPTEN_KEEPALIVE int bench_gaussians(void)
{
    return PELL_GAUSSIANS_MAX;
}

EMSCRIPTEN_KEEPALIVE const char *bench_model_text(int model, int what)
{
    const struct pell_profile_model_row *row = pell_profile_model_at((size_t) model);
    return !row ? NULL : what == 0 ? row->name : what == 1 ? row->title : row->limits;
}

/* R(r) by a model, and the best sums of so many Gaussians (0: none). 0: done; otherwise the result's code. */
EMSCRIPTEN_KEEPALIVE int bench_run(struct bench *b, int model, int gaussians)
{
    struct pell_medium medium = { .eta = b->eta };
    struct pell_profile p[CHANNELS];
    double far = 1e-6;

    for (int c = 0; c < CHANNELS; c++) {
        medium.sigma_a[c] = b->sigma_a[c];
        medium.sigma_s_reduced[c] = b->sigma_s_reduced[c];
    }
    for (int c = 0; c < CHANNELS; c++) {
        const enum pell_result res = pell_profile_make((enum pell_profile_model) model, &medium, c, NULL, &p[c]);
        if (res != PELL_OK)
            return res;
        b->total[c] = pell_profile_total(&p[c]);
        b->mean_free_path[c] = pell_mean_free_path(&medium, c);
        b->diffuse_mean_free_path[c] = pell_diffuse_mean_free_path(&medium, c);
        if (b->total[c] > 0.0)
            far = fmax(far, pell_profile_sample(&p[c], 0.999));
    }
    for (int i = 0; i < RADII; i++)
        b->r[i] = far * pow(1e-3, 1.0 - (double) i / (RADII - 1));
    for (int c = 0; c < CHANNELS; c++) {
        const struct pell_fit_params params = { .count = gaussians };
        struct pell_gaussians g = { .count = 0 };
        struct pell_fit_report report = { .error = { NAN } };

        pell_profile_eval_many(&p[c], b->r, b->R[c], RADII);
        if (gaussians > 0 && pell_fit_profile(&p[c], &params, &g, &report) != PELL_OK)
            g.count = 0;
        b->error[c] = g.count > 0 ? report.error[0] : NAN;
        for (int i = 0; i < PELL_GAUSSIANS_MAX; i++) {
            b->variance[c][i] = i < g.count ? g.variance[i] : 0.0;
            b->weight[c][i] = i < g.count ? g.weight[i][0] : 0.0;
        }
        for (int i = 0; i < RADII; i++)
            b->fit[c][i] = g.count > 0 ? pell_gaussians_eval(&g, 0, b->r[i]) : NAN;
    }
    return 0;
}
