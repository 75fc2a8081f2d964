/* SPDX-License-Identifier: MIT
 *
 * quadrature.c - globally adaptive Gauss-Kronrod integration, after Piessens et al., QUADPACK (1983), algorithm QAG with the pair
 * G7, K15. */
#include "math/quadrature.h"

#include "math/vec.h"

#include <math.h>
#include <stddef.h>

#define INTERVALS 200

/* Positive nodes of K15; every second one (from index 1) is a node of G7. */
static const double nodes[8] = {
    0.991455371120812639206854697526329, 0.949107912342758524526189684047851,
    0.864864423359769072789712788640926, 0.741531185599394439863864773280788,
    0.586087235467691130294144691838259, 0.405845151377397166906606412076961,
    0.207784955007898467600689403773245, 0.0,
};
static const double weights_k[8] = {
    0.022935322010529224963732008058970, 0.063092092629978553290700663189204, 0.104790010322250183839876322541518,
    0.140653259715525918745189590510238, 0.169004726639267902826583426598550, 0.190350578064785409913256402421014,
    0.204432940075298892414161999234649, 0.209482141084727828012999174891714,
};
static const double weights_g[4] = {
    0.129484966168869693270611432679082,
    0.279705391489276667901467771423780,
    0.381830050505118944950369775488975,
    0.417959183673469387755102040816327,
};

struct interval {
    double a, b, value, error;
};

static struct interval rule(pell_integrand f, const void *arg, double a, double b)
{
    const double center = 0.5 * (a + b), half = 0.5 * (b - a), middle = f(center, arg);
    double k = weights_k[7] * middle, g = weights_g[3] * middle;

    for (int i = 0; i < 7; i++) {
        const double pair = f(center - half * nodes[i], arg) + f(center + half * nodes[i], arg);
        k += weights_k[i] * pair;
        if (i & 1)
            g += weights_g[i / 2] * pair;
    }
    return (struct interval) { a, b, half * k, fabs(half * (k - g)) };
}

double pell_integrate(pell_integrand f, const void *arg, double a, double b, double tol_abs, double tol_rel, double *error)
{
    struct interval list[INTERVALS];
    size_t count = 1;
    double sum, err;

    list[0] = rule(f, arg, a, b);
    for (;;) {
        size_t worst = 0;
        sum = err = 0.0;
        for (size_t i = 0; i < count; i++) {
            sum += list[i].value;
            err += list[i].error;
            if (list[i].error > list[worst].error)
                worst = i;
        }
        if (!(err > fmax(tol_abs, tol_rel * fabs(sum))) || count == INTERVALS)
            break;
        const struct interval w = list[worst];
        const double center = 0.5 * (w.a + w.b);
        list[worst] = rule(f, arg, w.a, center);
        list[count++] = rule(f, arg, center, w.b);
    }
    if (error)
        *error = err;
    return sum;
}

/* Newton's method on Legendre's polynomial from Tricomi's approximation of its roots (Abramowitz and Stegun 1964, 22.16.6). */
void pell_gauss_legendre(int count, double *x, double *w)
{
    for (int i = 0; i < count; i++) {
        double z = cos(PELL_PI * (i + 0.75) / (count + 0.5)), slope = 1.0;
        for (int round = 0; round < 8; round++) {
            double p = 1.0, before = 0.0;
            for (int k = 0; k < count; k++) {
                const double older = before;
                before = p;
                p = ((2 * k + 1) * z * before - k * older) / (k + 1);
            }
            slope = count * (z * p - before) / (z * z - 1.0);
            z -= p / slope;
        }
        x[i] = 0.5 * (1.0 - z);
        w[i] = 1.0 / ((1.0 - z * z) * slope * slope);
    }
}
