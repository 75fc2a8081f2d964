/* SPDX-License-Identifier: MIT
 * fit_starts.c - prints src/optics/fit/starts.h: the optimal variances of one dipole as Chebyshev series of its two parameters. They are
 * found at the Chebyshev nodes by the search that needs no table. Runs for seconds. */
#include "optics/fit/starts_domain.h"

#include "optics/fit/fit.h"

#include <math.h>
#include <stdio.h>

#define NODES_X 20
#define NODES_Q 6
#define PI 3.14159265358979323846

static double samples[PELL_GAUSSIANS_MAX][NODES_X][NODES_Q];

static bool find(int count, bool free_energy)
{
    for (int i = 0; i < NODES_X; i++)
        for (int j = 0; j < NODES_Q; j++) {
            const double x = start_x_of(cos(PI * (i + 0.5) / NODES_X)), q = start_q_of(cos(PI * (j + 0.5) / NODES_Q));
            const struct pell_dipole d = { .sigma_t_reduced = 1.0, .albedo_reduced = 1.0, .sigma_tr = x, .zr = 1.0, .zv = q };
            const struct pell_fit_params params = { .count = count, .free_energy = free_energy };
            struct pell_gaussians g;
            if (pell_fit_dipole_searched(&d, &params, &g, NULL) != PELL_OK)
                return false;
            for (int n = 0; n < count; n++)
                samples[n][i][j] = log(g.variance[n]);
        }
    return true;
}

static double term(int n, int a, int b)
{
    double sum = 0.0;
    for (int i = 0; i < NODES_X; i++)
        for (int j = 0; j < NODES_Q; j++)
            sum += samples[n][i][j] * cos(PI * a * (i + 0.5) / NODES_X) * cos(PI * b * (j + 0.5) / NODES_Q);
    return sum * (a ? 2.0 : 1.0) * (b ? 2.0 : 1.0) / (NODES_X * NODES_Q);
}

int main(void)
{
    double worst = 0.0;
    printf("/* SPDX-License-Identifier: MIT\n *\n * fit_starts.h - made by tests/optics/fit_starts; do not edit.\n *\n"
           " * Log variances of the best sums of Gaussians of a dipole in units of zr: for 1, 2, .. 10 Gaussians, each by rising\n"
           " * variance, the coefficients [%d][%d] of Chebyshev's series over the coordinates of starts_domain.h; energy kept,\n"
           " * then free. */\n#ifndef PELL_OPTICS_FIT_STARTS_H\n#define PELL_OPTICS_FIT_STARTS_H\n\n",
           START_X, START_Q);
    printf("static const float fit_starts[2][%d][%d][%d] = {\n", PELL_GAUSSIANS_MAX * (PELL_GAUSSIANS_MAX + 1) / 2, START_X, START_Q);
    for (int mode = 0; mode < 2; mode++) {
        printf("    {\n");
        for (int count = 1; count <= PELL_GAUSSIANS_MAX; count++) {
            if (!find(count, mode))
                return 1;
            for (int n = 0; n < count; n++) {
                double c[START_X][START_Q];
                printf("        {");
                for (int a = 0; a < START_X; a++) {
                    printf("%s{", a == 0 ? " " : a % 4 == 0 ? ",\n          " : ", ");
                    for (int b = 0; b < START_Q; b++)
                        printf("%s%.3ff", b ? ", " : " ", c[a][b] = term(n, a, b));
                    printf(" }");
                }
                printf(" },\n");
                for (int i = 0; i < NODES_X; i++)
                    for (int j = 0; j < NODES_Q; j++) {
                        double sum = 0.0;
                        for (int a = 0; a < START_X; a++)
                            for (int b = 0; b < START_Q; b++)
                                sum += c[a][b] * cos(PI * a * (i + 0.5) / NODES_X) * cos(PI * b * (j + 0.5) / NODES_Q);
                        worst = fmax(worst, fabs(sum - samples[n][i][j]));
                    }
            }
            fprintf(stderr, "%s, %d Gaussians: log variances within %.3g\n", mode ? "free" : "kept", count, worst);
        }
        printf("    },\n");
    }
    printf("};\n\n#endif\n");
    return 0;
}
