/* SPDX-License-Identifier: MIT
 * photon_table.c - makes the table of the monte-carlo model: data/profiles/monte-carlo.json.
 *
 * One run of photons for each g serves every index and every albedo: inside a half-space the index affects paths only through reflection
 * at the boundary. Photons are traced with the largest index; at each hit of the boundary the transmitted fraction for each smaller
 * index is tallied, and the ratio of reflectances multiplies the photon's weight for that index. Collisions do not absorb; a photon
 * counts alpha^n after n collisions.
 *
 * Results depend only on the seed and the number of photons: batches are summed in a fixed order, for any number of threads and however
 * often the program was interrupted. */
#include "base/base.h"
#include "base/file.h"
#include "base/pool.h"
#include "math/vec.h"
#include "optics/photon/photon.h"
#include "optics/photon/table.h"

#include <pellucid/inversion.h>

#include <popt.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    BATCHES = 200, /* per g: batches, from which standard errors follow */
    GROUP = 8,     /* batches that are in memory at a time */
    PER_DECADE = 20,
    DECADES_LOW = -3, /* radii of the bins, in mean free paths: 10^-3 .. 10^3.5 */
    BINS = 130,
    SLOTS = PELL_TABLE_ALPHA + 1, /* albedos, and single scattering */
    POWERS = 1024,
};

static const double axis_g[PELL_TABLE_G] = { -0.3, 0.0, 0.25, 0.5, 0.7, 0.83, 0.91 };
/* Photons relative to those of g = 0: with forward scattering a walk has 1/(1 - g) times the collisions. */
static const double relative_photons[PELL_TABLE_G] = { 0.4, 1.0, 0.4, 0.25, 0.18, 0.13, 0.1 };
static const double axis_eta[PELL_TABLE_ETA] = { 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.75, 2.1 };
static const double axis_v[PELL_TABLE_ALPHA] = {
    0.0, 0.01, 0.025, 0.05, 0.08, 0.12, 0.17, 0.23, 0.3, 0.38, 0.47, 0.57, 0.68, 0.79, 0.9, 1.0
};

/* --- Tallies ------------------------------------------------------------------------------------------------------------------ */

/* Cells are bin, index, slot. The first bin and the one after the last hold smaller and larger radii; then follows the total. */
enum { ALL = BINS + 2 };
struct cells {
    double c[BINS + 3][PELL_TABLE_ETA][SLOTS];
};

struct powers { /* alpha^m = low[m % POWERS] high[m / POWERS] */
    double low[POWERS][PELL_TABLE_ALPHA], high[POWERS + 1][PELL_TABLE_ALPHA];
};

struct tally {
    struct cells cells;
    const struct powers *powers;
    uint64_t photon;
    double weight[PELL_TABLE_ETA]; /* of this photon for each index, relative to its own */
    double cut, ratio;             /* of bins */
};

static void touch(void *user, const struct pell_photon_exit *e)
{
    struct tally *t = user;
    const double largest = pell_fresnel(1.0 / axis_eta[PELL_TABLE_ETA - 1], e->mu);
    const double x = (log10(fmax(e->radius, 1e-30)) - DECADES_LOW) * PER_DECADE;
    const int bin = x < 0.0 ? 0 : x >= BINS ? BINS + 1 : 1 + (int) x;

    if (e->index != t->photon) {
        t->photon = e->index;
        for (int i = 0; i < PELL_TABLE_ETA; i++)
            t->weight[i] = 1.0;
    }
    for (int i = 0; i < PELL_TABLE_ETA; i++) {
        const double f = i == PELL_TABLE_ETA - 1 ? largest : pell_fresnel(1.0 / axis_eta[i], e->mu);
        const double count = e->weight * t->weight[i] * (1.0 - f);
        t->weight[i] *= f / largest;
        if (count == 0.0)
            continue;
        double *c = t->cells.c[bin][i];
        if (e->collisions == 1) {
            c[PELL_TABLE_ALPHA] += count;
        } else {
            const double *low = t->powers->low[(e->collisions - 2) % POWERS], *high = t->powers->high[(e->collisions - 2) / POWERS];
            for (int j = 0; j < PELL_TABLE_ALPHA; j++)
                c[j] += count * low[j] * high[j];
        }
    }
}

static void powers_fill(struct powers *p, double g)
{
    for (int j = 0; j < PELL_TABLE_ALPHA; j++) {
        const double alpha = pell_albedo_of_reduced(1.0 - axis_v[j] * axis_v[j], g);
        for (int i = 0; i < POWERS; i++)
            p->low[i][j] = pow(alpha, i); /* 0^0 = 1: at alpha' = 0 light scattered twice remains */
        for (int i = 0; i <= POWERS; i++)
            p->high[i][j] = pow(alpha, (double) i * POWERS);
    }
}

/* --- State: sums over batches, and the file they are kept in ------------------------------------------------------------------ */

struct state {
    char magic[16];
    uint64_t seed, photons;     /* of g = 0 */
    int32_t done[PELL_TABLE_G]; /* batches */
    double collisions, seconds; /* work so far */
    struct cells sum[PELL_TABLE_G], squares[PELL_TABLE_G];
};

static const char magic[16] = "pell photons 2\n";

static uint64_t batch_photons(const struct state *s, int ig)
{
    const uint64_t n = (uint64_t) ((double) s->photons * relative_photons[ig] / BATCHES);
    return n > 0 ? n : 1;
}

static enum pell_result state_load(struct pell_context *ctx, const char *path, struct state *s)
{
    uint8_t *bytes;
    size_t size;
    enum pell_result res = pell_file_read(ctx, path, &bytes, &size);
    if (res != PELL_OK)
        return res;
    if (size != sizeof(*s) || memcmp(bytes, magic, sizeof(magic)) != 0)
        res = pell_error(ctx, PELL_ERR_FORMAT, path, NULL, "is no state of this program");
    else
        memcpy(s, bytes, sizeof(*s));
    pell_free(ctx, bytes);
    for (int i = 0; res == PELL_OK && i < PELL_TABLE_G; i++) {
        if (s->done[i] < 0 || s->done[i] > BATCHES)
            res = pell_error(ctx, PELL_ERR_FORMAT, path, NULL, "says that %d of %d batches are done", (int) s->done[i], (int) BATCHES);
    }
    return res;
}

/* --- Walking ------------------------------------------------------------------------------------------------------------------ */

struct work {
    const struct state *state;
    struct pell_photon_stack stack;
    const struct powers *powers;
    struct tally *tallies; /* GROUP of them */
    struct pell_photon_sums sums[GROUP];
    int ig, first; /* batch */
};

static void walk_batch(void *arg, int index, int worker)
{
    struct work *w = arg;
    struct tally *t = &w->tallies[index];
    const uint64_t photons = batch_photons(w->state, w->ig), batch = (uint64_t) (w->first + index);

    (void) worker;
    memset(t, 0, sizeof(*t));
    t->powers = w->powers;
    t->photon = UINT64_MAX;
    w->sums[index] = (struct pell_photon_sums) { 0 };
    pell_photon_walk(&w->stack, w->state->seed * PELL_TABLE_G + (uint64_t) w->ig, batch * photons, photons, NULL, touch, t,
                     &w->sums[index]);
    for (int b = 0; b < ALL; b++)
        for (int i = 0; i < PELL_TABLE_ETA; i++)
            for (int j = 0; j < SLOTS; j++)
                t->cells.c[ALL][i][j] += t->cells.c[b][i][j];
}

static double progress(const struct state *s)
{
    double done = 0.0;
    for (int i = 0; i < PELL_TABLE_G; i++)
        done += s->done[i];
    return done / (PELL_TABLE_G * (double) BATCHES);
}

/* All remaining batches, or `stop_after` groups of them (-1: no limit). The runs alternate: a table can be made at any time. */
static enum pell_result walk_all(struct pell_context *ctx, struct pell_pool *pool, struct state *s, const char *file, int stop_after)
{
    struct work w = { .state = s };
    struct powers *powers = pell_alloc_array(ctx, PELL_TABLE_G, sizeof(*powers));
    enum pell_result res = PELL_ERR_NOMEM;
    double saved = pell_seconds();
    int groups = 0;

    w.tallies = pell_alloc_array(ctx, GROUP, sizeof(*w.tallies));
    if (!powers || !w.tallies)
        goto fail;
    res = PELL_OK;
    for (int ig = 0; ig < PELL_TABLE_G; ig++)
        powers_fill(&powers[ig], axis_g[ig]);

    for (;;) {
        int ig = 0; /* the one with the fewest batches: the same order however often the program is interrupted */
        for (int i = 1; i < PELL_TABLE_G; i++)
            ig = s->done[i] < s->done[ig] ? i : ig;
        const double g = axis_g[ig], start = pell_seconds();
        const int count = BATCHES - s->done[ig] < GROUP ? BATCHES - s->done[ig] : GROUP;
        if (count <= 0)
            break;
        if (stop_after >= 0 && groups++ >= stop_after)
            goto save;
        w.ig = ig;
        w.first = s->done[ig];
        w.powers = &powers[ig];
        w.stack = (struct pell_photon_stack) { .count = 1,
                                               .layer = { { 0.0, 1.0, g, axis_eta[PELL_TABLE_ETA - 1], INFINITY } },
                                               .n_above = 1.0,
                                               .n_below = 1.0,
                                               .mu_min = 1.0,
                                               .mu_max = 1.0,
                                               .inside = true,
                                               .roulette = (int) (32.0 / (1.0 - g)),
                                               .collisions_max = (int) (65536.0 / (1.0 - g)) };
        pell_pool_run(pool, count, walk_batch, &w);
        if (pell_cancelled(ctx))
            goto save; /* the group is traced again */
        for (int b = 0; b < count; b++) {
            const double *from = &w.tallies[b].cells.c[0][0][0];
            double *sum = &s->sum[ig].c[0][0][0], *squares = &s->squares[ig].c[0][0][0];
            for (size_t i = 0; i < sizeof(struct cells) / sizeof(double); i++) {
                sum[i] += from[i];
                squares[i] += from[i] * from[i];
            }
            s->collisions += (double) w.sums[b].collisions;
        }
        s->done[ig] += count;
        s->seconds += pell_seconds() - start;
        pell_progress(ctx, "photons", progress(s));
        if (file && pell_seconds() - saved > 30.0) {
            PELL_TRY(pell_file_write(ctx, file, s, sizeof(*s)));
            saved = pell_seconds();
        }
    }
save:
    if (file && res == PELL_OK)
        res = pell_file_write(ctx, file, s, sizeof(*s));
    if (res == PELL_OK && pell_cancelled(ctx))
        res = PELL_ERR_CANCELLED;
fail:
    pell_free(ctx, powers);
    pell_free(ctx, w.tallies);
    return res;
}

/* --- From tallies to a table -------------------------------------------------------------------------------------------------- */

static double relative_error(double sum, double squares, int batches)
{
    const double mean = sum / batches, variance = (squares / batches - mean * mean) / (batches - 1);
    return mean > 0.0 ? sqrt(fmax(variance, 0.0)) / mean : HUGE_VAL;
}

/* Average over a bin in ln r of exp(-kappa r), five points of Gauss. */
static double decay(double kappa, double x, double width)
{
    static const double at[3] = { 0.0, 0.538469310105683, 0.906179845938664 },
                        w[3] = { 128.0 / 225.0, 0.478628670499366, 0.236926885056189 };
    double sum = w[0] * exp(-kappa * exp(x));
    for (int i = 1; i < 3; i++)
        sum += w[i] * (exp(-kappa * exp(x + 0.5 * width * at[i])) + exp(-kappa * exp(x - 0.5 * width * at[i])));
    return 0.5 * sum;
}

/* A parabola through ln(count) near x by weighted least squares; false where its error is not below `most`. */
static bool smooth(const double *bx, const double *by, const double *be, double x, double reach, double width, double most, double *y,
                   double *error)
{
    double m[3][3] = { { 0 } }, v[3] = { 0 }, q[3][3] = { { 0 } };
    int used = 0;
    for (int b = 0; b < BINS; b++) {
        const double d = bx[b] - x, u = fabs(d) / reach;
        if (u >= 1.0 || !(be[b] < 0.5))
            continue;
        const double cube = 1.0 - u * u * u, w = cube * cube * cube / (be[b] * be[b] + 1e-6), p[3] = { 1.0, d, d * d };
        for (int i = 0; i < 3; i++) {
            for (int j = 0; j < 3; j++) {
                m[i][j] += w * p[i] * p[j];
                q[i][j] += w * w * be[b] * be[b] * p[i] * p[j];
            }
            v[i] += w * p[i] * by[b];
        }
        used++;
    }
    if (used < 4)
        return false;
    /* The inverse's first row gives the value at x and its error; the others slope and curvature. */
    double inverse[3][3];
    const double det = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                       m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            const int a = (j + 1) % 3, b = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
            inverse[i][j] = (m[a][c] * m[b][d] - m[a][d] * m[b][c]) / det;
        }
    }
    double c[3] = { 0 }, variance = 0.0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            c[i] += inverse[i][j] * v[j];
            variance += inverse[0][i] * inverse[0][j] * q[i][j];
        }
    *y = c[0] - width * width / 24.0 * (c[1] * c[1] + 2.0 * c[2]); /* a bin's average exceeds the value at its middle by that */
    *error = sqrt(fmax(variance, 0.0));
    return isfinite(*y) && *error < most;
}

/* False where photons are too few to resolve a profile without absorption. */
static bool rows(const struct state *s, int ig, int ie, int ia, struct pell_photon_table *t)
{
    const double g = axis_g[ig], alpha = pell_albedo_of_reduced(1.0 - axis_v[ia] * axis_v[ia], g), per_reduced = 1.0 / (1.0 - alpha * g);
    const double kappa = pell_transport_kappa(alpha, g) * per_reduced, width = log(10.0) / PER_DECADE;
    const double photons = (double) batch_photons(s, ig) * s->done[ig];
    double bx[BINS], by[BINS], be[BINS], y[PELL_TABLE_R], error[PELL_TABLE_R];
    bool known[PELL_TABLE_R];
    int first = -1, last = -1;

    for (int b = 0; b < BINS; b++) {
        const double sum = s->sum[ig].c[b + 1][ie][ia];
        bx[b] = (DECADES_LOW * PER_DECADE + b + 0.5) * width - log(per_reduced); /* of a radius in reduced mean free paths */
        be[b] = relative_error(sum, s->squares[ig].c[b + 1][ie][ia], s->done[ig]);
        by[b] = sum > 0.0 ? log(sum / (photons * width * decay(kappa, bx[b], width))) : 0.0;
        if (!isfinite(by[b]))
            be[b] = HUGE_VAL;
    }
    for (double most = 0.05; first < 0 && most < 1.0; most *= 10.0) { /* few photons give a rough table rather than none */
        for (int k = 0; k < PELL_TABLE_R; k++) {
            const double x = pell_table_x(k), reach = x < log(0.1) || x > log(10.0) ? 0.85 : 0.6;
            known[k] = smooth(bx, by, be, x, reach, width, most, &y[k], &error[k]);
            if (known[k] && first < 0)
                first = k;
        }
    }
    for (int k = first; k >= 0 && k < PELL_TABLE_R && known[k]; k++)
        last = k; /* of a contiguous range */

    const double sum = s->sum[ig].c[ALL][ie][ia];
    const double most = 1.0 - pell_single_total(g, axis_eta[ie]); /* total reflectance without absorption */
    t->total[ig][ie][ia] = (float) (ia == 0 ? most : fmin(sum / photons, most));
    t->total_error[ig][ie][ia] =
        (float) (ia == 0 || !(sum > 0.0) ? 0.0 : sum / photons * relative_error(sum, s->squares[ig].c[ALL][ie][ia], s->done[ig]));
    if (!(sum > 0.0)) /* alpha' = 0 with forward scattering: photons that leave after two collisions are few */
        t->total[ig][ie][ia] = t->total[ig][ie][ia - 1];

    if (first < 0 && ia == 0)
        return false;

    /* Toward the axis R continues as a power of r, between 0 and -1. */
    const int from = first < 0 ? 0 : first, to = from + 4 < last ? from + 4 : last;
    const double step = pell_table_x(1) - pell_table_x(0);
    const double slope = to > from ? fmin(fmax((y[to] - y[from]) / (step * (to - from)), 1.0), 2.0) : 2.0;
    for (int k = 0; k < PELL_TABLE_R; k++) {
        double value, code = PELL_TABLE_NO_ERROR;
        if (first < 0) { /* the shape for a larger albedo */
            value = (double) t->y[ig][ie][ia - 1][k] / PELL_TABLE_Y_SCALE + log((double) t->total[ig][ie][ia] / t->total[ig][ie][ia - 1]);
        } else if (k < first) {
            value = y[first] + slope * (pell_table_x(k) - pell_table_x(first));
        } else if (k > last) { /* q exp(kappa r) of diffusion: (1 + kappa r)/r */
            const double r = exp(pell_table_x(k)), end = exp(pell_table_x(last));
            value = y[last] + log((1.0 + kappa * r) / (1.0 + kappa * end)) - log(r / end);
        } else {
            value = y[k];
            code = fmin(fmax(round(8.0 * log2(fmax(error[k], 1e-5) / 1e-4)), 0.0), PELL_TABLE_NO_ERROR - 1.0);
        }
        t->y[ig][ie][ia][k] = (int16_t) fmin(fmax(round(value * PELL_TABLE_Y_SCALE), -32767.0), 32767.0);
        t->error[ig][ie][ia][k] = (uint8_t) code;
    }
    return true;
}

static void print_numbers(FILE *f, const char *key, const double *v, int n, const char *end)
{
    fprintf(f, "  \"%s\": [", key);
    for (int i = 0; i < n; i++)
        fprintf(f, "%s%.10g", i ? ", " : "", v[i]);
    fprintf(f, "]%s\n", end);
}

static enum pell_result table_write(struct pell_context *ctx, const struct state *s, const char *path)
{
    struct pell_photon_table *t = pell_zalloc(ctx, sizeof(*t));
    char *text = NULL;
    size_t size = 0;
    enum pell_result res = PELL_ERR_NOMEM;
    FILE *f;

    if (!t)
        goto fail;
    for (int ig = 0; ig < PELL_TABLE_G; ig++) {
        t->photons[ig] = (double) batch_photons(s, ig) * s->done[ig];
        for (int ie = 0; ie < PELL_TABLE_ETA; ie++)
            for (int ia = 0; ia < PELL_TABLE_ALPHA; ia++)
                if (!rows(s, ig, ie, ia, t)) {
                    res = pell_error(ctx, PELL_ERR_INVALID, path, "let more walk", "%g photons of g = %g are too few for a table",
                                     t->photons[ig], axis_g[ig]);
                    goto fail;
                }
    }
    if (!(f = open_memstream(&text, &size)))
        goto fail;
    fprintf(f, "{\n  \"$comment\": \"Made by pell-photon-table; read src/optics/photon/table.h. Not to be edited.\",\n");
    fprintf(f, "  \"seed\": %llu,\n", (unsigned long long) s->seed);
    print_numbers(f, "photons", t->photons, PELL_TABLE_G, ",");
    print_numbers(f, "g", axis_g, PELL_TABLE_G, ",");
    print_numbers(f, "eta", axis_eta, PELL_TABLE_ETA, ",");
    print_numbers(f, "v", axis_v, PELL_TABLE_ALPHA, ",");
    fprintf(f, "  \"rows\": [\n");
    for (int i = 0; i < PELL_TABLE_G * PELL_TABLE_ETA * PELL_TABLE_ALPHA; i++) {
        const int ia = i % PELL_TABLE_ALPHA, ie = i / PELL_TABLE_ALPHA % PELL_TABLE_ETA, ig = i / PELL_TABLE_ALPHA / PELL_TABLE_ETA;
        fprintf(f, "%s[[%.6g,%.2g],[", i ? ",\n" : "", (double) t->total[ig][ie][ia], (double) t->total_error[ig][ie][ia]);
        for (int k = 0; k < PELL_TABLE_R; k++)
            fprintf(f, "%s%d", k ? "," : "", t->y[ig][ie][ia][k]);
        fprintf(f, "],[");
        for (int k = 0; k < PELL_TABLE_R; k++)
            fprintf(f, "%s%d", k ? "," : "", t->error[ig][ie][ia][k]);
        fprintf(f, "]]");
    }
    fprintf(f, "\n  ]\n}\n");
    res = fclose(f) == 0 ? pell_file_write(ctx, path, text, size) : PELL_ERR_NOMEM;
fail:
    free(text);
    pell_free(ctx, t);
    return res;
}

/* --- The program -------------------------------------------------------------------------------------------------------------- */

static struct pell_context *interrupted;

static void on_signal(int number)
{
    (void) number;
    pell_context_cancel(interrupted);
}

static void on_message(void *user, const struct pell_message *m)
{
    (void) user;
    fprintf(stderr, "pell-photon-table: %s%s%s%s%s\n", m->where, m->where[0] ? ": " : "", m->what, m->hint[0] ? "; " : "", m->hint);
}

static void on_progress(void *user, const char *task, double fraction)
{
    if (*(const int *) user == 0)
        fprintf(stderr, "\r%s %5.1f %%", task, 100.0 * fraction);
}

int main(int argc, const char **argv)
{
    char *output = NULL, *file = NULL;
    int threads = 0, stop_after = -1, quiet = 0, code = 1, fresh = 0;
    long long seed = 1, photons = 20000000;
    struct pell_context *ctx = NULL;
    struct pell_pool *pool = NULL;
    struct state *state = NULL;
    const struct poptOption options[] = {
        { "photons", 'n', POPT_ARG_LONGLONG, &photons, 0, "photons for g = 0; fewer where g is larger (20000000)", "N" },
        { "seed", 's', POPT_ARG_LONGLONG, &seed, 0, "of all random numbers (1)", "S" },
        { "threads", 't', POPT_ARG_INT, &threads, 0, "0: one per core (0)", "T" },
        { "resume", 'r', POPT_ARG_STRING, &file, 0, "keep the counts in FILE every 30 s and at the end, and go on from there if it exists",
          "FILE" },
        { "stop-after", 0, POPT_ARG_INT, &stop_after, 0, "walk so many groups of 8 batches only (-1: all)", "GROUPS" },
        { "quiet", 'q', POPT_ARG_NONE, &quiet, 0, "no progress", NULL },
        { "output", 'o', POPT_ARG_STRING, &output, 0, "the table (JSON), made of what has been counted", "FILE" },
        POPT_AUTOHELP POPT_TABLEEND
    };
    poptContext parser = poptGetContext("pell-photon-table", argc, argv, options, 0);
    const int bad = poptGetNextOpt(parser);

    if (bad < -1 || poptPeekArg(parser) || seed < 0 || photons < 1 || photons > 100000000000ll || stop_after < -1) {
        fprintf(stderr, "pell-photon-table: %s; see --help\n",
                bad < -1              ? poptStrerror(bad)
                : poptPeekArg(parser) ? "takes no arguments"
                                      : "a number is out of range");
        code = 2;
        goto done;
    }
    const struct pell_context_params params = { .log = on_message, .progress = on_progress, .progress_user = &quiet };
    if (pell_context_create(&params, &ctx) != PELL_OK || pell_pool_create(ctx, threads, &pool) != PELL_OK ||
        !(state = pell_zalloc(ctx, sizeof(*state))))
        goto done;
    interrupted = ctx;
    signal(SIGINT, on_signal);
    signal(SIGTERM, on_signal);

    FILE *exists = file ? fopen(file, "rb") : NULL;
    if (exists) {
        fclose(exists);
        if (state_load(ctx, file, state) != PELL_OK)
            goto done;
        if (state->seed != (uint64_t) seed || state->photons != (uint64_t) photons) {
            pell_error(ctx, PELL_ERR_INVALID, file, "give the same seed and photons, or another file", "holds seed %llu, photons %llu",
                       (unsigned long long) state->seed, (unsigned long long) state->photons);
            goto done;
        }
    } else {
        memcpy(state->magic, magic, sizeof(magic));
        state->seed = (uint64_t) seed;
        state->photons = (uint64_t) photons;
        fresh = 1;
    }
    enum pell_result res = walk_all(ctx, pool, state, file, stop_after);
    if (!quiet)
        fprintf(stderr, "\n%.0f million collisions in %.1f s, %.1f ns each\n", 1e-6 * state->collisions, state->seconds,
                1e9 * state->seconds / fmax(state->collisions, 1.0));
    if (res == PELL_OK && output) {
        for (int i = 0; i < PELL_TABLE_G && res == PELL_OK; i++) {
            if (state->done[i] < 2)
                res = pell_error(ctx, PELL_ERR_INVALID, output, fresh ? "walk on" : NULL, "g = %g has %d batches; 2 are needed", axis_g[i],
                                 (int) state->done[i]);
        }
        if (res == PELL_OK)
            res = table_write(ctx, state, output);
    }
    code = res == PELL_OK ? 0 : 1;
done:
    if (ctx)
        pell_free(ctx, state);
    pell_pool_destroy(&pool);
    pell_context_destroy(&ctx);
    poptFreeContext(parser);
    free(file);
    free(output);
    return code;
}
