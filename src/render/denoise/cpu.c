/* SPDX-License-Identifier: MIT
 * cpu.c - see stage.h. */
#include "render/denoise/stage.h"

#include "render/denoise/kernel.h"

#include <math.h>
#include <string.h>

/* Feature differences that halve a weight, approximately. */
#define NORMAL_STEP 0.4f
#define ALBEDO_STEP 0.06f
#define DEPTH_STEP 0.004f /* of the depth itself */
#define OUTLIER 1.5f      /* factor over the second largest of the pixels around */
#define RESOLVED 2.0f     /* standard deviations */

struct task {
    const struct pell_denoise_params *p;
    const struct pell_denoise_kernels *kernels;
    int across; /* tiles of a row */
    bool second;
};

static bool inside(const struct pell_rect *r, int x, int y)
{
    return x >= r->x0 && x < r->x1 && y >= r->y0 && y < r->y1;
}

static float *pixel_at(const struct pell_denoise_params *p, float *plane, int x, int y)
{
    return plane + (ptrdiff_t) y * p->stride + x;
}

/* Variances are at least as noisy as the image, and a pixel without light so far reports none: uses the mean of the neighbourhood. */
static float mean_variance(const struct pell_denoise_params *p, int c, int x, int y)
{
    float sum = 0.0f, count = 0.0f;

    for (int v = y - 2; v <= y + 2; v++)
        for (int u = x - 2; u <= x + 2; u++) {
            const float translucent = inside(&p->rect, u, v) ? *pixel_at(p, p->sum->translucent, u, v) : 0.0f;
            if (translucent > 0.0f) {
                sum += *pixel_at(p, p->sum->variance[c], u, v) / (translucent * translucent);
                count += 1.0f;
            }
        }
    return count > 0.0f ? sum / count : 0.0f;
}

static void load_pixel(const struct task *k, struct pell_denoise_tile *t, int x, int y, int to_x, int to_y)
{
    const struct pell_denoise_params *p = k->p;
    const struct pell_accumulator *s = p->sum;
    const float depth = *pixel_at(p, s->depth, x, y), translucent = *pixel_at(p, s->translucent, x, y),
                alpha = *pixel_at(p, s->alpha, x, y);

    if (!(translucent > 0.0f) || !(alpha > 0.0f))
        return;
    for (int c = 0; c < 3; c++) {
        const float single = s->single[c] ? *pixel_at(p, s->single[c], x, y) : 0.0f;
        const float reflected = p->traced ? *pixel_at(p, s->specular[c], x, y) : 0.0f;
        t->light[c][to_y][to_x] = (*pixel_at(p, s->multiple[c], x, y) + single + reflected) / translucent;
        t->variance[c][to_y][to_x] = mean_variance(p, c, x, y);
        t->feature[NORMAL + c][to_y][to_x] = *pixel_at(p, s->normal[c], x, y) / alpha * (1.0f / NORMAL_STEP);
        t->feature[ALBEDO + c][to_y][to_x] = *pixel_at(p, s->albedo[c], x, y) / alpha * (1.0f / ALBEDO_STEP);
    }
    t->feature[DEPTH][to_y][to_x] = depth > 0.0f ? logf(depth) * (1.0f / DEPTH_STEP) : 0.0f;
    t->translucent[to_y][to_x] = translucent;
    t->valid[to_y][to_x] = 1.0f;
    if (k->second)
        t->total[to_y][to_x] = *pixel_at(p, p->scratch[3], x, y);
}

/* Excess of outliers: pixels that exceed all but one of the pixels around them by far, with an equally large uncertainty. Features are
 * ignored: where they differ from pixel to pixel, the filter would find no others to distribute the light to. */
static void find_outliers(const struct task *k, struct pell_denoise_tile *t, int left, int top)
{
    const struct pell_denoise_params *p = k->p;

    for (int c = 0; c < 3; c++)
        for (int y = 1; y < WIDE - 1; y++)
            for (int x = 1; x < WIDE - 1; x++) {
                const float light = t->light[c][y][x], translucent = t->translucent[y][x];
                float first = 0.0f, second = 0.0f, count = 0.0f, error;
                if (!(t->valid[y][x] > 0.0f))
                    continue;
                for (int i = 0; i < 9; i++) {
                    const int u = x + i % 3 - 1, v = y + i / 3 - 1;
                    const float other = i != 4 ? t->valid[v][u] * t->light[c][v][u] : 0.0f;
                    count += i != 4 ? t->valid[v][u] : 0.0f;
                    second = other > first ? first : other > second ? other : second;
                    first = other > first ? other : first;
                }
                error = RESOLVED * sqrtf(*pixel_at(p, p->sum->variance[c], left + x, top + y)) / translucent;
                if (count > 3.0f && light > OUTLIER * second && light - second < error)
                    t->excess[c][y][x] = light - second;
            }
}

/* Distributes the excess of outliers to the pixels around them, by their translucent fraction: no light is lost. */
static void redistribute_outliers(struct pell_denoise_tile *t)
{
    float around[WIDE][WIDE] = { { 0.0f } }; /* fractions of the pixels around */

    for (int y = 1; y < WIDE - 1; y++)
        for (int x = 1; x < WIDE - 1; x++)
            for (int i = 0; i < 9; i++)
                around[y][x] += i != 4 ? t->translucent[y + i / 3 - 1][x + i % 3 - 1] : 0.0f;
    for (int c = 0; c < 3; c++)
        for (int y = 1; y < WIDE - 1; y++)
            for (int x = 1; x < WIDE - 1; x++) {
                float gained = -t->excess[c][y][x];
                if (!(t->valid[y][x] > 0.0f))
                    continue;
                for (int i = 0; i < 9; i++) {
                    const int u = x + i % 3 - 1, v = y + i / 3 - 1;
                    if (i != 4 && t->excess[c][v][u] > 0.0f)
                        gained += t->excess[c][v][u] * t->translucent[v][u] / around[v][u];
                }
                t->light[c][y][x] += gained;
                if (x >= BORDER && x < BORDER + TILE && y >= BORDER && y < BORDER + TILE)
                    t->gained[c][y - BORDER][x - BORDER] = t->translucent[y][x] * gained;
            }
}

/* Depth gradient of a pixel to its neighbours, the flatter side of each axis: an edge is not a slope. */
static void find_slopes(struct pell_denoise_tile *t)
{
    for (int y = 1; y < WIDE - 1; y++)
        for (int x = 1; x < WIDE - 1; x++) {
            const float(*z)[WIDE] = t->feature[DEPTH], here = z[y][x];
            const float dx = fminf(fabsf(z[y][x + 1] - here), fabsf(z[y][x - 1] - here));
            const float dy = fminf(fabsf(z[y + 1][x] - here), fabsf(z[y - 1][x] - here));
            t->steep[y][x] = dx + dy;
        }
}

static void filter_tile(void *arg, int index, int worker)
{
    const struct task *k = arg;
    const struct pell_denoise_params *p = k->p;
    const struct pell_rect r = p->rect;
    const int x0 = r.x0 + index % k->across * TILE, y0 = r.y0 + index / k->across * TILE;
    struct pell_denoise_tile tile;
    float noisy = 0.0f;
    (void) worker;

    memset(&tile, 0, sizeof(tile));
    for (int y = 0; y < WIDE; y++)
        for (int x = 0; x < WIDE; x++)
            tile.total[y][x] = 1.0f;
    for (int y = 0; y < WIDE; y++)
        for (int x = 0; x < WIDE; x++)
            if (inside(&r, x0 + x - BORDER, y0 + y - BORDER))
                load_pixel(k, &tile, x0 + x - BORDER, y0 + y - BORDER, x, y);
    find_outliers(k, &tile, x0 - BORDER, y0 - BORDER);
    redistribute_outliers(&tile);
    for (int y = BORDER; y < BORDER + TILE; y++)
        for (int x = BORDER; x < BORDER + TILE; x++)
            noisy += tile.valid[y][x];
    find_slopes(&tile);
    if (noisy > 0.0f && k->second)
        k->kernels->move(&tile);
    else if (noisy > 0.0f)
        k->kernels->weigh(&tile);
    for (int y = 0; y < TILE && y0 + y < r.y1; y++)
        for (int x = 0; x < TILE && x0 + x < r.x1; x++) {
            if (!k->second)
                *pixel_at(p, p->scratch[3], x0 + x, y0 + y) = tile.sum[y][x];
            for (int c = 0; c < 3 && k->second; c++)
                *pixel_at(p, p->scratch[c], x0 + x, y0 + y) =
                    *pixel_at(p, p->sum->color[c], x0 + x, y0 + y) + tile.gained[c][y][x] + tile.moved[c][y][x];
        }
}

bool pell_denoise_has_variance(const struct pell_denoise_params *p)
{
    for (int c = 0; c < 3; c++)
        for (int y = p->rect.y0; y < p->rect.y1; y++)
            for (int x = p->rect.x0; x < p->rect.x1; x++)
                if (*pixel_at(p, p->sum->variance[c], x, y) > 0.0f)
                    return true;
    return false;
}

void pell_denoise_render(struct pell_pool *pool, const struct pell_denoise_params *p)
{
    const struct pell_rect r = p->rect;
    struct task k = { .p = p, .kernels = pell_denoise_kernels_tables[pell_simd_best()], .across = (r.x1 - r.x0 + TILE - 1) / TILE };
    const int down = (r.y1 - r.y0 + TILE - 1) / TILE;

    if (k.across <= 0 || down <= 0)
        return;
    pell_pool_run(pool, k.across * down, filter_tile, &k);
    k.second = true;
    pell_pool_run(pool, k.across * down, filter_tile, &k);
    for (int c = 0; c < 3; c++)
        for (int y = r.y0; y < r.y1; y++)
            memcpy(pixel_at(p, p->sum->color[c], r.x0, y), pixel_at(p, p->scratch[c], r.x0, y), (size_t) (r.x1 - r.x0) * sizeof(float));
}
