/* SPDX-License-Identifier: MIT
 *
 * table.c - a user's own table of R(r) as a profile. */
#include "math/vec.h"
#include "optics/profile/nodes.h"
#include "optics/profile/shape.h"

#include <math.h>
#include <string.h>

static enum pell_result refuse(struct pell_profile_fault *fault, size_t row, const char *field, double value, double min, double max)
{
    if (fault)
        *fault = (struct pell_profile_fault) { row, field, value, min, max };
    return PELL_ERR_INVALID;
}

/* Integrates over a table's cubics, in increasing radius only. */
struct walk {
    const double *r, *R;
    size_t count, row; /* the current cubic begins at `row` */
    double slope[2];
};

static struct walk walk_begin(const double *r, const double *R, size_t count)
{
    return (struct walk) { r, R, count, 0, { pell_nodes_slope(r, R, count, 0), pell_nodes_slope(r, R, count, 1) } };
}

static void walk_next(struct walk *w)
{
    w->row++;
    w->slope[0] = w->slope[1];
    w->slope[1] = pell_nodes_slope(w->r, w->R, w->count, w->row + 1);
}

/* Flux from the current row up to x <= the next row's radius. */
static double walk_flux(const struct walk *w, double x)
{
    const double r0 = w->r[w->row], h = w->r[w->row + 1] - r0;
    return pell_nodes_cubic_flux(r0, h, w->R[w->row], w->R[w->row + 1], h * w->slope[0], h * w->slope[1], x - r0);
}

/* Flux of the table between two radii, the first no less than in earlier calls. */
static double walk_between(struct walk *w, double from, double to)
{
    double sum;
    while (w->row + 2 < w->count && w->r[w->row + 1] <= from)
        walk_next(w);
    sum = -walk_flux(w, from);
    while (w->row + 2 < w->count && w->r[w->row + 1] < to) {
        sum += walk_flux(w, w->r[w->row + 1]);
        walk_next(w);
    }
    return fmax(0.0, sum + walk_flux(w, to));
}

/* Chooses nodes for a table with more rows than nodes: at rows, by equal parts of the density of rows, of light and of log r. */
static int choose_nodes(const double *r, const double *R, size_t count, double total, double *node)
{
    const double first = r[0] > 0.0 ? r[0] : r[1], logs = log(r[count - 1] / first);
    struct walk w = walk_begin(r, R, count);
    double light = 0.0;
    int nodes = 1;

    node[0] = r[0];
    for (size_t i = 1; i < count; i++) {
        light += walk_between(&w, r[i - 1], r[i]);
        const double measure =
            ((double) i / (double) (count - 1) + (total > 0.0 ? light / total : 0.0) + (logs > 0.0 ? log(r[i] / first) / logs : 0.0)) / 3.0;
        if (i + 1 == count || (nodes < PELL_PROFILE_NODES - 1 && measure * (PELL_PROFILE_NODES - 1) >= nodes))
            node[nodes++] = r[i];
    }
    return nodes;
}

#define ROUNDS 12

/* Each node gets the mean of the table between the midpoints to its neighbours; then values are corrected until the cubics' flux over these
 * intervals equals the table's. */
static void merge(const double *r, const double *R, size_t count, double total, struct pell_profile *out)
{
    double wanted[PELL_PROFILE_NODES];
    struct walk w = walk_begin(r, R, count);
    const int n = choose_nodes(r, R, count, total, out->r);

    for (int k = 0; k < n; k++) {
        const double from = k > 0 ? 0.5 * (out->r[k - 1] + out->r[k]) : out->r[0];
        const double to = k + 1 < n ? 0.5 * (out->r[k] + out->r[k + 1]) : out->r[k];
        const double disc = k == 0 ? from * from * R[0] : 0.0, from2 = k == 0 ? 0.0 : from * from;
        wanted[k] = walk_between(&w, from, to) + PELL_PI * disc;
        out->value[k] = wanted[k] / (PELL_PI * (to * to - from2));
    }
    for (int round = 0; round < ROUNDS; round++) {
        double before = PELL_PI * out->r[0] * out->r[0] * out->value[0];
        pell_profile_nodes_make(out, n, PELL_NODES_LINEAR, -1.0);
        for (int k = 0; k < n; k++) {
            const double middle = k + 1 < n ? 0.5 * (out->r[k] + out->r[k + 1]) : 0.0;
            const double flux = before + (k + 1 < n ? pell_profile_nodes_flux(out, k, out->r[k], middle) : 0.0);
            if (flux > 0.0 && round + 1 < ROUNDS)
                out->value[k] *= fmin(2.0, fmax(0.5, wanted[k] / flux));
            before = k + 1 < n ? pell_profile_nodes_flux(out, k, middle, out->r[k + 1]) : 0.0;
        }
    }
    if (out->total > 0.0)
        pell_profile_nodes_scale(out, total / out->total);
}

enum pell_result pell_profile_from_table(const double *r_mm, const double *R, size_t count, struct pell_profile *out,
                                         struct pell_profile_fault *fault)
{
    if (!r_mm || !R || !out)
        return PELL_ERR_INVALID;

    double total, most = 1.0 + PELL_PROFILE_TOTAL_SLACK;

    memset(out, 0, sizeof(*out));
    if (fault)
        *fault = (struct pell_profile_fault) { 0 };
    if (count < 2)
        return refuse(fault, count, "rows", (double) count, 2.0, (double) (SIZE_MAX / 2));
    for (size_t i = 0; i < count; i++) {
        const double least = i > 0 ? fmax(r_mm[i - 1] + PELL_PROFILE_STEP_MIN, r_mm[i - 1] * (1.0 + 1e-12)) : 0.0;
        if (!(r_mm[i] >= least && r_mm[i] <= PELL_PROFILE_RADIUS_MAX))
            return refuse(fault, i, "r_mm", r_mm[i], least, PELL_PROFILE_RADIUS_MAX);
        if (!(R[i] >= 0.0 && R[i] <= PELL_PROFILE_R_MAX))
            return refuse(fault, i, "R", R[i], 0.0, PELL_PROFILE_R_MAX);
    }
    struct walk w = walk_begin(r_mm, R, count);
    total = PELL_PI * r_mm[0] * r_mm[0] * R[0];
    if (!(total <= most))
        return refuse(fault, 0, "total", total, 0.0, 1.0);
    for (size_t i = 1; i < count; i++) {
        total += walk_between(&w, r_mm[i - 1], r_mm[i]);
        if (!(total <= most))
            return refuse(fault, i, "total", total, 0.0, 1.0);
    }
    if (count > PELL_PROFILE_NODES) {
        merge(r_mm, R, count, total, out);
    } else {
        memcpy(out->r, r_mm, count * sizeof(*r_mm));
        memcpy(out->value, R, count * sizeof(*R));
        pell_profile_nodes_make(out, (int) count, PELL_NODES_LINEAR, -1.0);
    }
    out->total = fmin(1.0, out->total);
    pell_profile_drop_traces(out);
    return PELL_OK;
}
