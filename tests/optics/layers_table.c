/* SPDX-License-Identifier: MIT
 *
 * layers_table.c - prints the tables of "Slabs and layers" in src/optics/README.md: times of the solvers for the three channels of
 * three-layer skin with their errors, and errors over the narrow Gaussian's variance and count. */
#include "stacks.h"

#include "base/base.h"

enum { RADII = 240, REPEATS = 200 };

static struct pell_stack_sets sets;
static _Alignas(16) unsigned char memory[1 << 20];
static double r[RADII], reference[RADII];

/* Error (10) at the given radii. */
static double error_of(const double *f)
{
    double above = 0.0, below = 0.0;
    for (int k = 0; k < RADII; k++) {
        above += r[k] * r[k] * (f[k] - reference[k]) * (f[k] - reference[k]);
        below += r[k] * r[k] * reference[k] * reference[k];
    }
    return sqrt(above / below);
}

static bool refer(const struct pell_stack *s, int c, enum pell_stack_part part)
{
    double *out[PELL_STACK_PARTS] = { 0 };
    out[part] = reference;
    return pell_stack_hankel(s, c, r, RADII, out, NULL) == PELL_OK;
}

static double set_error(enum pell_stack_part part)
{
    double f[RADII];
    for (int k = 0; k < RADII; k++)
        f[k] = pell_gaussian_set_eval(sets.variance, sets.weight[part], (size_t) sets.count, r[k]);
    return error_of(f);
}

static bool solve(const struct pell_stack *s, int c, const struct pell_stack_gaussians_params *q)
{
    return pell_stack_gaussians(s, c, q, memory, sizeof(memory), &sets) == PELL_OK;
}

int main(void)
{
    const struct pell_stack skin = skin_of(3);
    struct pell_stack thin = skin_of(2);
    static struct pell_profile p;
    bool good = true;

    for (int k = 0; k < RADII; k++)
        r[k] = 2e-3 * exp(0.045 * k);
    printf("| solver | ms | error (10), worst of R G B |\n|---|---|---|\n");
    for (int row = 0; row < 6; row++) {
        const struct pell_stack_gaussians_params q = { .block = (const int[]) { 8, 16, 32, 64, 32, 0 }[row],
                                                       .analytic = row == 4,
                                                       .reflectance_only = true };
        double best = INFINITY, worst = 0.0, R[RADII];
        double *const out[PELL_STACK_PARTS] = { R };
        for (int n = 0; n < REPEATS; n++) {
            const double begin = pell_seconds();
            for (int c = 0; c < 3; c++)
                good &= row < 5 ? solve(&skin, c, &q) : pell_stack_hankel(&skin, c, r, RADII, out, NULL) == PELL_OK;
            best = fmin(best, 1e3 * (pell_seconds() - begin));
        }
        for (int c = 0; c < 3 && row < 5; c++) {
            good &= solve(&skin, c, &q) && refer(&skin, c, RP);
            worst = fmax(worst, set_error(RP));
        }
        if (row < 5)
            printf("| %s, block %d | %.2f | %.2g %% |\n", q.analytic ? "analytic" : "Gaussians", q.block, best, 100.0 * worst);
        else
            printf("| Hankel, %d radii | %.2f | reference |\n", RADII, best);
    }
    double best = INFINITY;
    for (int n = 0; n < REPEATS; n++) {
        const double begin = pell_seconds();
        for (int c = 0; c < 3; c++)
            good &= pell_stack_profile(&skin, c, RP, &p, NULL) == PELL_OK;
        best = fmin(best, 1e3 * (pell_seconds() - begin));
    }
    printf("| Hankel, as profiles | %.2f | |\n", best);

    thin.layer[1].thickness = 1.0;
    printf("\n| v / min(l, d - l)^2 | block 16: R, T (count) | block 32 | block 64 | block 128 |\n|---|---|---|---|---|\n");
    for (double ratio = 4.0; ratio > 1.0 / 300.0; ratio *= 0.25) {
        printf(ratio >= 1.0 ? "| %g |" : "| 1/%g |", ratio >= 1.0 ? ratio : 1.0 / ratio);
        for (int block = 16; block <= 128; block *= 2) {
            const double gap = thin.layer[0].thickness - 1.0 / (thin.layer[0].sigma_a[0] + thin.layer[0].sigma_s_reduced[0]);
            const struct pell_stack_gaussians_params q = { .block = block, .variance = ratio * gap * gap };
            good &= solve(&thin, 0, &q) && refer(&thin, 0, RP);
            const double of_R = set_error(RP);
            good &= refer(&thin, 0, TP);
            printf(" %.2g, %.2g %% (%d) |", 100.0 * of_R, 100.0 * set_error(TP), sets.count);
        }
        printf("\n");
    }
    return good ? 0 : 1;
}
