/* SPDX-License-Identifier: MIT
 * dof.c - see dof.h. */
#include "render/post/dof.h"

#include "base/pool.h"

#define TILE PELL_LENS_MOST
#define SHARP PELL_LENS_SHARP
#define STEPS PELL_LENS_STEPS

enum {
    NEAR = 0,
    SAME = 5,
    FAR = 10,
    OWN = 15,
    SUMS = 16
}; /* a weight and four channels each; the last: coverage of the pixel's own disc, as far as others reach */

struct task {
    const struct pell_dof_params *p;
    float *const *in;
    float *const *out;
    float *disc;   /* radius, px; negative in front of the focus, increasing with depth */
    float *weight; /* of a fully covered pixel of the disc: discs sum to one */
    float *tiles;  /* radius of the widest disc of each tile, before clipping */
    int columns, rows;
    float table[PELL_LENS_TABLE]; /* weight by radius */
};

void pell_dof_table(float table[PELL_LENS_TABLE])
{
    const int last = PELL_DOF_MOST * STEPS;

    for (int k = 0; k <= last; k++) {
        const float r = (float) k / STEPS;
        double sum = 0.0;
        for (int y = -PELL_DOF_MOST; y <= PELL_DOF_MOST; y++)
            for (int x = -PELL_DOF_MOST; x <= PELL_DOF_MOST; x++)
                sum += (double) pell_disc_cover(r, sqrtf((float) (x * x + y * y)));
        table[k] = (float) (1.0 / sum);
    }
    table[last + 1] = table[last];
}

/* Weight of a fully covered pixel of a disc of radius r, in [0, PELL_DOF_MOST]. */
static float weight_of(const struct task *t, float r)
{
    const float at = r * STEPS, cell = floorf(at);
    return t->table[(int) cell] + (at - cell) * (t->table[(int) cell + 1] - t->table[(int) cell]);
}

/* Computes the discs and weights of a tile, and its widest disc. */
static void measure(void *arg, int index, int worker)
{
    struct task *t = arg;
    const struct pell_dof_params *p = t->p;
    const struct pell_surface *s = p->surface;
    const int x0 = index % t->columns * TILE, y0 = index / t->columns * TILE;
    const int x1 = x0 + TILE < s->width ? x0 + TILE : s->width, y1 = y0 + TILE < s->height ? y0 + TILE : s->height;
    float widest = 0.0f;
    (void) worker;

    for (int y = y0; y < y1; y++)
        for (int x = x0; x < x1; x++) {
            const ptrdiff_t i = y * s->stride + x;
            const bool seen = x >= s->covered.x0 && x < s->covered.x1 && y >= s->covered.y0 && y < s->covered.y1 && s->material[i];
            const float unclamped = pell_disc_radius(p->scale, 1.0f / p->focus, seen ? 1.0f / s->depth[i] : 0.0f);
            float d = unclamped, r;
            d = d > (float) -PELL_DOF_MOST ? d < (float) PELL_DOF_MOST ? d : (float) PELL_DOF_MOST : (float) -PELL_DOF_MOST;
            r = fabsf(d);
            t->disc[i] = d;
            t->weight[i] = weight_of(t, r);
            /* an empty pixel contributes nothing to others, however wide its disc is */
            widest = seen && fabsf(unclamped) > widest ? fabsf(unclamped) : widest;
        }
    t->tiles[index] = widest;
}

/* Adds the light of pixels (dx, dy) away to pixels x0 to x1 of row y. */
static void gather(const struct task *t, int y, int x0, int x1, int dx, int dy, float widest, float (*restrict sum)[TILE])
{
    const struct pell_dof_params *p = t->p;
    const ptrdiff_t here = y * p->surface->stride, there = (y + dy) * p->surface->stride + dx;
    const float d = sqrtf((float) (dx * dx + dy * dy));
    const int from = x0 > p->rect.x0 - dx ? x0 : p->rect.x0 - dx, to = x1 < p->rect.x1 - dx ? x1 : p->rect.x1 - dx;
    const float *restrict mine = t->disc + here, *restrict its = t->disc + there, *restrict weight = t->weight + there;
    const float *restrict r = t->in[0] + there, *restrict g = t->in[1] + there, *restrict b = t->in[2] + there,
                          *restrict a = t->in[3] + there;

    for (int x = from; x < to; x++) {
        const float radius = fabsf(mine[x]), band = pell_disc_band(radius), difference = its[x] - mine[x];
        const float w = pell_disc_cover(fabsf(its[x]), d) * weight[x];
        const float own = pell_disc_cover(radius < widest ? radius : widest, d);
        const float n = difference < -band ? w : 0.0f, f = difference > band ? own : 0.0f;
        const float s = difference < -band || difference > band ? 0.0f : w;
        const int i = x - x0;
        sum[NEAR][i] += n;
        sum[NEAR + 1][i] += n * r[x];
        sum[NEAR + 2][i] += n * g[x];
        sum[NEAR + 3][i] += n * b[x];
        sum[NEAR + 4][i] += n * a[x];
        sum[SAME][i] += s;
        sum[SAME + 1][i] += s * r[x];
        sum[SAME + 2][i] += s * g[x];
        sum[SAME + 3][i] += s * b[x];
        sum[SAME + 4][i] += s * a[x];
        sum[FAR][i] += f;
        sum[FAR + 1][i] += f * r[x];
        sum[FAR + 2][i] += f * g[x];
        sum[FAR + 3][i] += f * b[x];
        sum[FAR + 4][i] += f * a[x];
        sum[OWN][i] += own;
    }
}

static float composite(float (*sum)[TILE], int channel, int i, float inside)
{
    return pell_disc_composite(sum[NEAR][i], sum[NEAR + channel][i], sum[SAME][i], sum[SAME + channel][i], sum[FAR][i],
                               sum[FAR + channel][i], inside);
}

static void add(const struct task *t, ptrdiff_t i, int channel, float value)
{
    t->out[channel][i] = t->p->first ? value : t->out[channel][i] + value;
}

static void blur(void *arg, int index, int worker)
{
    const struct task *t = arg;
    const struct pell_dof_params *p = t->p;
    const int column = index % t->columns, row = index / t->columns;
    const int x0 = column * TILE > p->rect.x0 ? column * TILE : p->rect.x0, y0 = row * TILE > p->rect.y0 ? row * TILE : p->rect.y0;
    const int x1 = (column + 1) * TILE < p->rect.x1 ? (column + 1) * TILE : p->rect.x1;
    const int y1 = (row + 1) * TILE < p->rect.y1 ? (row + 1) * TILE : p->rect.y1;
    float widest = 0.0f;
    (void) worker;

    for (int y = row > 0 ? row - 1 : 0; y <= row + 1 && y < t->rows; y++)
        for (int x = column > 0 ? column - 1 : 0; x <= column + 1 && x < t->columns; x++)
            widest = t->tiles[y * t->columns + x] > widest ? t->tiles[y * t->columns + x] : widest;
    widest = widest < (float) PELL_DOF_MOST ? widest : (float) PELL_DOF_MOST;
    for (int y = y0; y < y1; y++) {
        const int reach = (int) ceilf(widest);
        float sum[SUMS][TILE] = { { 0 } };
        for (int dy = widest < SHARP ? 1 : -reach; dy <= (widest < SHARP ? 0 : reach); dy++) {
            if (y + dy < p->rect.y0 || y + dy >= p->rect.y1)
                continue;
            for (int dx = -reach; dx <= reach; dx++)
                if (sqrtf((float) (dx * dx + dy * dy)) < widest + 0.5f)
                    gather(t, y, x0, x1, dx, dy, widest, sum);
        }
        for (int x = x0; x < x1; x++) {
            const ptrdiff_t i = y * p->surface->stride + x;
            const float inside = fminf(sum[OWN][x - x0] * weight_of(t, fminf(fabsf(t->disc[i]), widest)), 1.0f);
            for (int c = 0; c < 4; c++)
                add(t, i, c, widest < SHARP ? t->in[c][i] : composite(sum, c + 1, x - x0, inside));
        }
    }
}

float pell_dof_render(struct pell_pool *pool, const struct pell_dof_params *params, float *const scratch[PELL_DOF_PLANES], float *tiles,
                      float *const out[4])
{
    float widest = 0.0f;
    struct task t = {
        .p = params,
        .in = scratch,
        .out = out,
        .disc = scratch[4],
        .weight = scratch[5],
        .tiles = tiles,
        .columns = (params->surface->width + TILE - 1) / TILE,
        .rows = (params->surface->height + TILE - 1) / TILE,
    };

    pell_dof_table(t.table);
    pell_pool_run(pool, t.columns * t.rows, measure, &t);
    pell_pool_run(pool, t.columns * t.rows, blur, &t);
    for (int i = 0; i < t.columns * t.rows; i++)
        widest = t.tiles[i] > widest ? t.tiles[i] : widest;
    return widest;
}
