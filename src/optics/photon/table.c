/* SPDX-License-Identifier: MIT
 *
 * table.c - interpolation of the table: cubics with the slopes of parabolas in sqrt(1 - alpha'), ln(1 - g) and ln(eta). */
#include "optics/photon/table.h"

/* The cubic on [x1, x2] with the slopes that parabolas through three neighbours have at its ends; it is linear in the values, so it is
 * given as weights w[0..3] of four neighbours from *first on. `x` has count >= 4 rising nodes; t within them. */
static void weights_at(const double *x, int count, double t, int *first, double w[4])
{
    int i = 0;
    while (i < count - 2 && t >= x[i + 1])
        i++;
    *first = i < 1 ? 0 : i > count - 3 ? count - 4 : i - 1;
    const double *p = x + *first;
    const int at = i - *first;                                   /* 0, 1 or 2: the interval within the four */
    const int low = at > 0 ? at - 1 : 0, high = at < 2 ? at : 1; /* where the three for the slope at either end begin */
    const double h = p[at + 1] - p[at], s = (t - p[at]) / h, s2 = s * s, s3 = s2 * s;
    const double slope[2] = { h * (s3 - 2.0 * s2 + s), h * (s3 - s2) };
    const int begin[2] = { low, high };

    for (int k = 0; k < 4; k++)
        w[k] = 0.0;
    w[at] = 2.0 * s3 - 3.0 * s2 + 1.0;
    w[at + 1] = 3.0 * s2 - 2.0 * s3;
    for (int end = 0; end < 2; end++) {
        const double *q = p + begin[end], node = p[at + end];
        for (int k = 0; k < 3; k++) { /* derivative of Lagrange's polynomial k of the three */
            const double a = q[(k + 1) % 3], b = q[(k + 2) % 3];
            w[begin[end] + k] += slope[end] * (2.0 * node - a - b) / ((q[k] - a) * (q[k] - b));
        }
    }
}

void pell_multiple(double albedo_reduced, double g, double eta, double y[PELL_TABLE_R], double *total)
{
    const struct pell_photon_table *t = &pell_photon_table_data;
    const double in_g = fmin(fmax(g, t->g[0]), t->g[PELL_TABLE_G - 1]), in_eta = fmin(fmax(eta, t->eta[0]), t->eta[PELL_TABLE_ETA - 1]);
    double xg[PELL_TABLE_G], xe[PELL_TABLE_ETA], wg[4], we[4], wv[4], sum = 0.0, white = 0.0;
    int ig, ie, iv;

    for (int i = 0; i < PELL_TABLE_G; i++)
        xg[i] = -log(1.0 - t->g[i]);
    for (int i = 0; i < PELL_TABLE_ETA; i++)
        xe[i] = log(t->eta[i]);
    weights_at(xg, PELL_TABLE_G, -log(1.0 - in_g), &ig, wg);
    weights_at(xe, PELL_TABLE_ETA, log(in_eta), &ie, we);
    weights_at(t->v, PELL_TABLE_ALPHA, sqrt(fmin(fmax(1.0 - albedo_reduced, 0.0), 1.0)), &iv, wv);

    for (int k = 0; k < PELL_TABLE_R; k++)
        y[k] = 0.0;
    for (int a = 0; a < 4; a++) {
        for (int b = 0; b < 4; b++) {
            white += wg[a] * we[b] * log((double) t->total[ig + a][ie + b][0]);
            for (int c = 0; c < 4; c++) {
                const double w = wg[a] * we[b] * wv[c];
                const int16_t *row = t->y[ig + a][ie + b][iv + c];
                if (w == 0.0)
                    continue;
                for (int k = 0; k < PELL_TABLE_R; k++)
                    y[k] += w / PELL_TABLE_Y_SCALE * row[k];
                sum += w * log((double) t->total[ig + a][ie + b][iv + c]);
            }
        }
    }
    /* At alpha' = 1 all light returns: the error of interpolation in g and eta is known there, and corrected in proportion elsewhere. */
    white -= log(1.0 - pell_single_total(in_g, in_eta));
    *total = exp(sum - white * (1.0 - sqrt(fmin(fmax(1.0 - albedo_reduced, 0.0), 1.0))));
}
