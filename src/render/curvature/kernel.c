/* SPDX-License-Identifier: MIT
 * kernel.c - see kernel.h: table positions, table values and arithmetic, each over 16 lanes. */
#include "render/curvature/kernel.h"

#include "math/scalar.h"
#include "render/rows16.h"

#ifndef PELL_SIMD_NAME
#define PELL_SIMD_NAME base
#endif

#define N 16
enum { BENT = sizeof(struct curvature_bent) / sizeof(float), SLAB = 4 }; /* floats of an entry of the tables over curvature and thinness */

/* Table values of each lane's shape. Where nothing is thin, slab, sheet, ball and crossed are 1, through, forward and small 0. */
struct table_values {
    _Alignas(64) float bent[BENT][N]; /* struct curvature_bent */
    float slab[SLAB][N], through[SLAB][N], forward[SLAB][N], crossed[SLAB][N], sheet[SLAB][N], ball[SLAB][N], small[SLAB][N];
};

/* Splits positions in a table into cells and fractions. */
static void split(const float *at, int32_t *cell, float *fraction)
{
    for (int i = 0; i < N; i += WIDTH) {
        const vf coord = load(at + i);
        const vi whole = __builtin_convertvector(coord, vi);
        memcpy(cell + i, &whole, sizeof(whole));
        store(fraction + i, coord - __builtin_convertvector(whole, vf));
    }
}

static void look_up_bent(const struct curvature_shapes *restrict s, struct table_values *restrict l)
{
    static const float flat[2][BENT] = { { 1, 1, 1, 1, 1, 1, 0, 0, 0, 1, 1, 1 }, { 1, 1, 1, 1, 1, 1, 0, 0, 0, 1, 1, 1 } };
    _Alignas(64) float limit[N], at[N], fraction[N];
    _Alignas(64) int32_t cell[N];
    const float *row[N];

    for (int i = 0; i < N; i++)
        limit[i] = s->response[i]->limit;
    for (int i = 0; i < N; i++)
        at[i] = pell_curvature_mean_coord(s->mean[i], limit[i]);
    split(at, cell, fraction);
    for (int i = 0; i < N; i++)
        row[i] = s->mean[i] != 0.0f ? s->response[i]->bent[cell[i]].gain : flat[0];
    rows_between(row, fraction, BENT, l->bent);
}

/* Positions in the tables over thinness. */
struct table_cell {
    const float *thinness;
    _Alignas(64) int32_t cell[N];
    _Alignas(64) float fraction[N];
};

static void find_slab(const struct curvature_shapes *restrict s, const float *restrict thinness, struct table_cell *restrict p)
{
    _Alignas(64) float step[N], at[N];

    p->thinness = thinness;
    for (int i = 0; i < N; i++)
        step[i] = s->response[i]->step;
    for (int i = 0; i < N; i++)
        at[i] = pell_curvature_thinness_coord(thinness[i], step[i]);
    split(at, p->cell, p->fraction);
}

/* `none` where nothing is thin. */
static void look_up_slab(const struct curvature_shapes *restrict s, const struct table_cell *restrict p, size_t table,
                         const float none[2][SLAB], float (*restrict out)[N])
{
    const float *row[N];

    for (int i = 0; i < N; i++)
        row[i] = p->thinness[i] > 0.0f ? (const float *) ((const char *) s->response[i] + table) + SLAB * p->cell[i] : none[0];
    rows_between(row, p->fraction, SLAB, out);
}

static void effects(const struct curvature_shapes *restrict s, struct pell_curvature_effects *restrict out)
{
    static const float zero[2][SLAB] = { { 0 } }, one[2][SLAB] = { { 1, 1, 1, 0 }, { 1, 1, 1, 0 } };
    _Alignas(64) float thinness[N], excess[N], round[N];
    struct table_cell cell;
    struct table_values l;

    look_up_bent(s, &l);
    for (int i = 0; i < N; i++) {
        thinness[i] = larger(s->thinness[i], 0.0f);
        excess[i] = thinness[i] > 0.0f ? pell_curvature_excess(s->mean[i], thinness[i]) : 0.0f;
    }
    find_slab(s, thinness, &cell);
    look_up_slab(s, &cell, offsetof(struct curvature_response, through), zero, l.through);
    look_up_slab(s, &cell, offsetof(struct curvature_response, forward), zero, l.forward);
    look_up_slab(s, &cell, offsetof(struct curvature_response, slab), one, l.sheet);
    look_up_slab(s, &cell, offsetof(struct curvature_response, ball), one, l.ball);
    look_up_slab(s, &cell, offsetof(struct curvature_response, small), zero, l.small);
    find_slab(s, excess, &cell);
    look_up_slab(s, &cell, offsetof(struct curvature_response, slab), one, l.slab);
    look_up_slab(s, &cell, offsetof(struct curvature_response, crossed), one, l.crossed);
    for (int i = 0; i < N; i++) {
        round[i] = thinness[i] > 0.0f ? pell_curvature_round(s->mean[i], thinness[i]) : 0.0f;
        out->flat[i] = thinness[i] > 0.0f ? pell_curvature_sheet(excess[i], thinness[i]) : 0.0f;
    }
    for (int c = 0; c < 3; c++) {
        _Alignas(64) float path[N];
        for (int i = 0; i < N; i++)
            path[i] = s->response[i]->path[c];
        for (int i = 0; i < N; i++) {
            const float total = l.bent[9 + c][i] + out->flat[i] * (1.0f - l.bent[9 + c][i]), through = l.through[c][i];
            const float as_thick = l.sheet[c][i] + round[i] * (l.ball[c][i] - l.sheet[c][i]);
            const float all = total * l.slab[c][i] + l.small[c][i] * (as_thick - total * l.slab[c][i]);
            const float local = larger(all - through, 0.0f);
            out->gain[c][i] = l.bent[c][i];
            out->opposed[c][i] = l.bent[3 + c][i];
            out->local[c][i] = local;
            out->uniform[c][i] = all;
            out->small[c][i] = l.small[c][i];
            out->opposed_local[c][i] = larger(all - larger(through, l.bent[6 + c][i]), 0.0f);
            out->shift[c][i] = pell_curvature_shift(s->mean[i], path[i]);
            out->sheet[c][i] = out->flat[i] * (through + l.forward[c][i]);
            out->round[c][i] = through - out->flat[i] * through;
            out->returned[c][i] = smaller(1.0f + out->flat[i] * (local - 1.0f), 1.0f);
            out->crossed[c][i] = 1.0f + out->flat[i] * (l.crossed[c][i] - 1.0f);
        }
    }
}

extern const struct curvature_kernels PELL_SIMD(curvature_kernels);
const struct curvature_kernels PELL_SIMD(curvature_kernels) = { effects };
