/* SPDX-License-Identifier: MIT
 *
 * environment.c - environment light: a latitude-longitude image or a constant, resolved into
 *
 *   lights      directional lights for the excess over a clamped luminance, by splitting the image where energy times angular variance is
 *               largest, at the median (after Debevec 2005, "A Median Cut Algorithm for Light Probe Sampling")
 *   table       irradiance over the normal, for the WHOLE image except compact lights (a sun). A pixel computes
 *
 *                   E(n) = V_amb (table(n) - Sum over broad lights of P c T) + Sum over all lights of V_k P c T,     c = max(n.l, 0)
 *
 *               so that without occluders the broad lights cancel and the sum is exactly the image's irradiance
 *   levels      the image prefiltered by lobes of increasing width, for reflection
 *
 * The table integrates over elements: blocks of the image, subdivided while they hold much energy, each with its flux and its mean
 * direction (flux-weighted, not normalised: a cosine is linear in it, so first moments are exact). For each node the elements are added to
 * a histogram over mu = n.l with linear weights, and every kernel (cosine, albedo of the lobes at several widths, Fresnel) is then a short
 * sum over bins.
 */
#include "lights/environment_kernel.h"
#include "lights/environment_map.h"

#include <string.h>

#define BLOCK 16             /* texels of the coarsest elements */
#define ELEMENT_DIVISOR 1024 /* a block is split while its energy x (side/BLOCK)^2 exceeds total / this */

/* --- Octahedral table over the normal ----------------------------------------------------------------------------------------- */

/* Poles at +-y; the lower half is folded over the diagonals, so that the border is continuous. */
static struct pell_vec3 node_normal(int i, int j)
{
    const float a = 2.0f * (float) i / (PELL_ENV_NODES - 1) - 1.0f, b = 2.0f * (float) j / (PELL_ENV_NODES - 1) - 1.0f;
    const float y = 1.0f - fabsf(a) - fabsf(b);
    const float x = y < 0.0f ? copysignf(1.0f - fabsf(b), a) : a, z = y < 0.0f ? copysignf(1.0f - fabsf(a), b) : b;
    return vec3_normalize(vec3(x, y, z));
}

struct node_task {
    struct pell_environment *env;
    const struct pell_env_element *elements;
    size_t count;
    const struct pell_light_source *sources;
    size_t num_sources;
    const float *kernels; /* of bin b, row r at [b * rows + r] */
    int rows;
    const struct pell_env_kernels *simd;
};

/* Constant environment: all nodes are equal. dw = 2 pi dmu */
static void make_constant_row(const struct node_task *t, float *row)
{
    const size_t size = (size_t) t->env->size;
    float bins[PELL_ENV_BINS][4] = { { 0.0f } };

    for (int c = 0; c < 3; c++)
        for (int b = 0; b < PELL_ENV_BINS; b++)
            bins[b][c] = t->env->power[c] * 2.0f * PELL_PI_F / (PELL_ENV_BINS - 1) * (b == 0 || b == PELL_ENV_BINS - 1 ? 0.5f : 1.0f);
    t->simd->add_bins(t->kernels, t->rows, (const float(*)[4]) bins, row);
    for (size_t i = 1; i < PELL_ENV_NODES; i++)
        memcpy(row + i * size, row, size * sizeof(*row));
}

static void make_node_row(void *arg, int j, int worker)
{
    const struct node_task *t = arg;
    _Alignas(64) float bins[PELL_ENV_TOGETHER][PELL_ENV_BINS][4];
    float *const row = t->env->nodes + (size_t) (j * PELL_ENV_NODES) * (size_t) t->env->size;
    struct pell_vec3 n[PELL_ENV_TOGETHER];

    (void) worker;
    if (t->count == 0) {
        make_constant_row(t, row);
        return;
    }
    for (int first = 0, count; first < PELL_ENV_NODES; first += count) {
        count = PELL_ENV_NODES - first < PELL_ENV_TOGETHER ? PELL_ENV_NODES - first : PELL_ENV_TOGETHER;
        memset(bins, 0, sizeof(bins));
        for (int i = 0; i < count; i++)
            n[i] = node_normal(first + i, j);
        t->simd->deposit(t->elements, t->count, n, count, bins);
        for (int i = 0; i < count; i++) {
            for (size_t k = 0; k < t->num_sources; k++) {
                const float *p = t->sources[k].power, rgb[4] = { p[0], p[1], p[2] }, mu = -vec3_dot(n[i], t->sources[k].direction);
                if (t->sources[k].compact && mu > 0.0f)
                    pell_env_deposit(bins[i], mu, rgb, -1.0f);
            }
            t->simd->add_bins(t->kernels, t->rows, (const float(*)[4]) bins[i], row + (size_t) (first + i) * (size_t) t->env->size);
        }
    }
}

/* Computes the layout of the table's rows and allocates it, with one row of `kernels` per row of a node. */
static enum pell_result allocate_table(struct pell_context *ctx, const struct pell_specular_tables *tables, struct pell_environment *env,
                                       float **kernels)
{
    bool used[PELL_SPECULAR_MODELS] = { false };
    int rows = 1;

    for (size_t i = 0; i < tables->num_materials; i++)
        used[tables->model[i]] = true;
    for (int m = 0; m < PELL_SPECULAR_MODELS; m++) {
        env->model_at[m] = used[m] ? 3 * rows : -1;
        rows += used[m] ? 2 * PELL_ENV_ROUGHNESS : 0;
    }
    env->boundary_at = 3 * rows;
    rows += tables->num_boundaries < PELL_ENV_ETAS ? (int) tables->num_boundaries : PELL_ENV_ETAS;
    env->size = 3 * rows;
    *kernels = pell_calloc(ctx, (size_t) rows * PELL_ENV_BINS + PELL_ENV_ROWS, sizeof(float));
    if (*kernels)
        env->nodes = pell_alloc_array(ctx, (size_t) PELL_ENV_NODES * PELL_ENV_NODES * (size_t) env->size, sizeof(float));
    return env->nodes ? PELL_OK : PELL_ERR_NOMEM;
}

static void make_kernels(const struct pell_specular_tables *tables, const struct pell_environment *env, float *at)
{
    const int etas = (env->size - env->boundary_at) / 3;

    for (int b = 0; b < PELL_ENV_BINS; b++) {
        const float mu = (float) b / (PELL_ENV_BINS - 1);
        *at++ = mu;
        for (int m = 0; m < PELL_SPECULAR_MODELS; m++)
            for (int k = 0; env->model_at[m] >= 0 && k < PELL_ENV_ROUGHNESS; k++) {
                float fraction, scale, bias;
                int index;
                pell_roughness_position(PELL_ROUGHNESS_MIN + (1.0f - PELL_ROUGHNESS_MIN) * (float) k / (PELL_ENV_ROUGHNESS - 1), &index,
                                        &fraction);
                pell_albedo_pair(tables->albedo[m][0][index], fraction, mu, &scale, &bias);
                *at++ = mu * scale;
                *at++ = mu * bias;
            }
        for (int k = 0; k < etas; k++)
            *at++ = mu * pell_boundary_lookup(tables->boundaries[k].transmittance, mu);
    }
}

/* --- Working-resolution image ------------------------------------------------------------------------------------------------- */

static void finish_map(struct pell_context *ctx, struct pell_env_map *m)
{
    pell_free(ctx, m->rgb);
    pell_free(ctx, m->sin_row);
    memset(m, 0, sizeof(*m));
}

static enum pell_result make_map(struct pell_context *ctx, const struct pell_environment *env, int width, int height,
                                 struct pell_env_map *m)
{
    const size_t rows = (size_t) height, columns = (size_t) width;

    *m = (struct pell_env_map) { .width = width, .height = height };
    m->rgb = pell_alloc_array(ctx, 3 * rows * columns, sizeof(float));
    m->sin_row = m->rgb ? pell_alloc_array(ctx, 3 * rows + 2 * columns, sizeof(float)) : NULL;
    if (!m->sin_row)
        return PELL_ERR_NOMEM;
    m->cos_row = m->sin_row + rows;
    m->solid_angle_row = m->cos_row + rows;
    m->sin_column = m->solid_angle_row + rows;
    m->cos_column = m->sin_column + columns;
    for (int y = 0; y < height; y++) {
        const double t = PELL_PI * (y + 0.5) / height, half = 0.5 * PELL_PI / height;
        m->sin_row[y] = (float) sin(t);
        m->cos_row[y] = (float) cos(t);
        m->solid_angle_row[y] = (float) (2.0 * PELL_PI / width * 2.0 * sin(t) * sin(half));
    }
    for (int x = 0; x < width; x++) {
        /* map azimuth a: x = sin a, z = -cos a; rotated by the light's rotation about y */
        const double a = 2.0 * PELL_PI * ((x + 0.5) / width - 0.5), sx = sin(a), cz = cos(a);
        m->sin_column[x] = (float) (sx * env->cos_rotate - cz * env->sin_rotate);
        m->cos_column[x] = (float) (sx * env->sin_rotate + cz * env->cos_rotate);
    }
    return PELL_OK;
}

struct resample_task {
    const struct pell_environment *env;
    struct pell_env_map *to;
};

/* Mean over the texel's area on the sphere; a smaller image is interpolated. */
static void resample_row(void *arg, int y, int worker)
{
    const struct resample_task *t = arg;
    const struct pell_image *image = &t->env->image->image;
    const double sx = (double) image->width / t->to->width, sy = (double) image->height / t->to->height;
    const double y0 = y * sy, y1 = y0 + sy;

    (void) worker;
    for (int x = 0; x < t->to->width; x++) {
        float *out = t->to->rgb + 3 * ((size_t) y * (size_t) t->to->width + (size_t) x), rgba[4];
        const double x0 = x * sx, x1 = x0 + sx;
        double sum[3] = { 0 }, weight = 0.0;
        if (sx < 1.0 || sy < 1.0) {
            pell_image_sample(image, PELL_WRAP_REPEAT, PELL_WRAP_CLAMP, false, (float) ((x + 0.5) / t->to->width),
                              (float) ((y + 0.5) / t->to->height), rgba);
            memcpy(out, rgba, 3 * sizeof(*out));
            pell_environment_clean(t->env, out);
            continue;
        }
        for (int j = (int) y0; j < image->height && (double) j < y1 - 1e-9; j++) {
            const double wy = (fmin(y1, j + 1.0) - fmax(y0, j)) * sin(PELL_PI * (j + 0.5) / image->height);
            for (int i = (int) x0; i < image->width && (double) i < x1 - 1e-9; i++) {
                const double w = wy * (fmin(x1, i + 1.0) - fmax(x0, i));
                pell_image_texel(image, i, j, rgba);
                pell_environment_clean(t->env, rgba);
                for (int c = 0; c < 3; c++)
                    sum[c] += w * rgba[c];
                weight += w;
            }
        }
        for (int c = 0; c < 3; c++)
            out[c] = weight > 0.0 ? (float) (sum[c] / weight) : 0.0f;
    }
}

/* Downsamples by two, weighted by solid angle. */
static void halve(const struct pell_env_map *from, struct pell_env_map *to)
{
    for (int y = 0; y < to->height; y++) {
        const float a = from->solid_angle_row[2 * y], b = from->solid_angle_row[2 * y + 1], inv = 0.5f / (a + b);
        const float *r0 = from->rgb + (size_t) (2 * y) * (size_t) from->width * 3, *r1 = r0 + (size_t) from->width * 3;
        float *out = to->rgb + (size_t) y * (size_t) to->width * 3;
        for (int x = 0; x < to->width; x++)
            for (int c = 0; c < 3; c++)
                out[3 * x + c] = inv * (a * (r0[6 * x + c] + r0[6 * x + 3 + c]) + b * (r1[6 * x + c] + r1[6 * x + 3 + c]));
    }
}

/* --- Elements ----------------------------------------------------------------------------------------------------------------- */

struct gather {
    const struct pell_env_map *map;
    double threshold;             /* energy x (side / BLOCK)^2 below which a block is one element */
    struct pell_env_element *out; /* NULL: count only */
    size_t count;
};

static double block_element(const struct pell_env_map *m, int x0, int y0, int side, struct pell_env_element *e)
{
    double rgb[3] = { 0 }, d[3] = { 0 }, total = 0.0;

    for (int y = y0; y < y0 + side; y++)
        for (int x = x0; x < x0 + side; x++) {
            const float *p = m->rgb + 3 * ((size_t) y * (size_t) m->width + (size_t) x), w = m->solid_angle_row[y];
            const struct pell_vec3 v = pell_env_map_direction(m, x, y);
            const double l = (double) w * ((double) p[0] + p[1] + p[2]);
            for (int c = 0; c < 3; c++)
                rgb[c] += (double) w * p[c];
            d[0] += l * v.x;
            d[1] += l * v.y;
            d[2] += l * v.z;
            total += l;
        }
    if (total > 0.0)
        *e = (struct pell_env_element) {
            (float) (d[0] / total), (float) (d[1] / total), (float) (d[2] / total), 0.0f, { (float) rgb[0], (float) rgb[1], (float) rgb[2] }
        };
    return total;
}

/* Recursion depth at most log2(BLOCK). */
static void gather_block(struct gather *g, int x, int y, int side)
{
    struct pell_env_element e = { 0 };
    const double total = block_element(g->map, x, y, side, &e);

    if (!(total > 0.0))
        return;
    if (side > 1 && total * side * side > g->threshold * (BLOCK * BLOCK)) {
        const int h = side / 2;
        gather_block(g, x, y, h);
        gather_block(g, x + h, y, h);
        gather_block(g, x, y + h, h);
        gather_block(g, x + h, y + h, h);
        return;
    }
    if (g->out)
        g->out[g->count] = e;
    g->count++;
}

static void gather_all(struct gather *g)
{
    g->count = 0;
    for (int y = 0; y < g->map->height; y += BLOCK)
        for (int x = 0; x < g->map->width; x += BLOCK)
            gather_block(g, x, y, BLOCK);
}

/* --- Reflection --------------------------------------------------------------------------------------------------------------- */

/* A map in planes whose rows are stored twice in succession, so that any wrapped interval of a row is contiguous. */
struct ring_map {
    int width, height;
    size_t stride;
    float *plane[3], *sin_column, *cos_column;
    const struct pell_env_map *map; /* source of the row data */
};

struct lobe_task {
    const struct pell_environment *env;
    const struct ring_map *from;
    struct pell_env_level *to;
    float alpha, reach; /* reach: cutoff of the lobe around the mirror direction, radians */
    const struct pell_env_kernels *simd;
};

static size_t ring_floats(int width)
{
    const size_t stride = 2 * (size_t) width + PELL_ENV_WIDE;
    return stride * (3 * (size_t) width / 2 + 2);
}

static void make_ring(const struct pell_env_map *m, float *block, struct ring_map *r)
{
    const size_t stride = 2 * (size_t) m->width + PELL_ENV_WIDE, size = stride * (size_t) m->height;

    *r = (struct ring_map) {
        .width = m->width, .height = m->height, .stride = stride, .map = m, .plane = { block, block + size, block + 2 * size }
    };
    r->sin_column = block + 3 * size;
    r->cos_column = r->sin_column + stride;
    for (size_t x = 0; x < stride; x++) {
        const size_t from = x % (size_t) m->width;
        r->sin_column[x] = m->sin_column[from];
        r->cos_column[x] = m->cos_column[from];
        for (size_t y = 0; y < (size_t) m->height; y++)
            for (size_t c = 0; c < 3; c++)
                r->plane[c][y * stride + x] = m->rgb[3 * (y * (size_t) m->width + from) + c];
    }
}

/* Mean radiance weighted by D(h) n.l for n = v = mirror direction (Karis 2013, "Real Shading in Unreal Engine 4"). */
static void filter_row(void *arg, int y, int worker)
{
    const struct lobe_task *t = arg;
    const struct ring_map *m = t->from;
    const double polar = PELL_PI * (y + 0.5) / t->to->height;
    const float st = (float) sin(polar), ct = (float) cos(polar), limit = cosf(t->reach);
    const int j0 = (int) floor((polar - t->reach) / PELL_PI * m->height), j1 = (int) ceil((polar + t->reach) / PELL_PI * m->height);

    (void) worker;
    for (int x = 0; x < t->to->width; x++) {
        const int middle = (int) ((x + 0.5) / t->to->width * m->width);
        float *out = t->to->rgb + 3 * ((size_t) y * (size_t) t->to->width + (size_t) x);
        const double azimuth = 2.0 * PELL_PI * ((x + 0.5) / t->to->width - 0.5);
        struct pell_env_lobe lobe = { { (float) (sin(azimuth) * t->env->cos_rotate - cos(azimuth) * t->env->sin_rotate),
                                        (float) (sin(azimuth) * t->env->sin_rotate + cos(azimuth) * t->env->cos_rotate) },
                                      .a2 = t->alpha * t->alpha };
        float sums[4][PELL_ENV_WIDE] = { { 0 } }, total[4] = { 0 };
        for (int j = j0 < 0 ? 0 : j0; j < j1 && j < m->height; j++) {
            /* extent of the lobe along the row */
            const float a = lobe.a = ct * m->map->cos_row[j], b = lobe.b = st * m->map->sin_row[j];
            const float c = b > 1e-9f ? (limit - a) / b : limit > a ? 2.0f : -2.0f;
            const int reach = c <= -1.0f ? m->width : c < 1.0f ? (int) (acosf(c) / (2.0f * PELL_PI_F) * (float) m->width) + 1 : 0;
            const bool full_circle = 2 * reach + 1 >= m->width;
            const int from = full_circle ? 0 : (middle - reach + m->width) % m->width;
            if (c < 1.0f)
                t->simd->add_row(&(struct pell_env_row) { { m->plane[0] + (size_t) j * m->stride, m->plane[1] + (size_t) j * m->stride,
                                                            m->plane[2] + (size_t) j * m->stride },
                                                          m->sin_column,
                                                          m->cos_column,
                                                          m->map->solid_angle_row[j] },
                                 from, from + (full_circle ? m->width : 2 * reach + 1), &lobe, sums);
        }
        for (int c = 0; c < 4; c++)
            for (int k = 0; k < PELL_ENV_WIDE; k++)
                total[c] += sums[c][k];
        for (int c = 0; c < 3; c++)
            out[c] = total[3] > 0.0f ? total[c] / total[3] : 0.0f;
    }
}

/* Widths of the source and the result of a level, and the cutoff of its lobe. */
static const struct {
    int from, to;
    float reach;
} level_sizes[PELL_ENV_LEVELS] = { { 0, 0, 0 },      { 256, 256, 0.25f }, { 128, 128, 0.9f }, { 64, 64, 1.6f },
                                   { 64, 64, 1.6f }, { 64, 64, 1.6f },    { 64, 64, 1.6f } };

/* --- Construction ------------------------------------------------------------------------------------------------------------- */

#define MIPS 5 /* 1024, 512, 256, 128, 64 */

/* Temporary data; everything except the elements is allocated before the work begins. */
struct scratch {
    struct pell_env_map mips[MIPS]; /* from the working size down to 64 */
    int num_mips;
    float *ring, *kernels;
    struct pell_env_element *elements;
};

static void free_scratch(struct pell_context *ctx, struct scratch *w)
{
    for (int i = 0; i < MIPS; i++)
        finish_map(ctx, &w->mips[i]);
    pell_free(ctx, w->ring);
    pell_free(ctx, w->kernels);
    pell_free(ctx, w->elements);
}

static enum pell_result allocate_scratch(struct pell_context *ctx, struct pell_environment *env, struct scratch *w)
{
    const int image_width = env->image->image.width, width = image_width >= 1024 ? 1024 : image_width >= 512 ? 512 : 256;
    enum pell_result res;

    for (int size = width; size >= 64; size /= 2) {
        PELL_TRY(make_map(ctx, env, size, size / 2, &w->mips[w->num_mips]));
        w->num_mips++;
    }
    res = PELL_ERR_NOMEM;
    w->ring = pell_alloc_array(ctx, ring_floats(level_sizes[1].from), sizeof(float));
    if (!w->ring)
        goto fail;
    for (int k = 0; k < PELL_ENV_LEVELS; k++) {
        struct pell_env_level *l = &env->levels[k];
        l->width = k == 0 ? width : level_sizes[k].to;
        l->height = l->width / 2;
        l->rgb = pell_alloc_array(ctx, (size_t) l->width * (size_t) l->height * 3, sizeof(float));
        if (!l->rgb)
            goto fail;
    }
    res = PELL_OK;

fail:
    return res;
}

static void make_levels(struct pell_pool *pool, struct scratch *w, struct pell_environment *env)
{
    const struct pell_env_kernels *simd = pell_env_kernels_tables[pell_simd_best()];
    const struct pell_env_map *full = &w->mips[0];

    memcpy(env->levels[0].rgb, full->rgb, (size_t) full->width * (size_t) full->height * 3 * sizeof(float));
    for (int i = 1; i < w->num_mips; i++)
        halve(&w->mips[i - 1], &w->mips[i]);
    for (int k = 1; k < PELL_ENV_LEVELS; k++) {
        struct ring_map ring;
        int i = 0;
        while (w->mips[i].width > level_sizes[k].from)
            i++;
        make_ring(&w->mips[i], w->ring, &ring);
        pell_pool_run(pool, env->levels[k].height, filter_row,
                      &(struct lobe_task) { env, &ring, &env->levels[k], pell_env_level_roughness[k] * pell_env_level_roughness[k],
                                            level_sizes[k].reach, simd });
    }
    env->num_levels = PELL_ENV_LEVELS;
}

/* The elements of an image. A black image gets one element without light, because no elements would mean a constant environment. */
static enum pell_result make_elements(struct pell_context *ctx, const struct pell_env_map *map, struct pell_env_element **elements,
                                      size_t *count)
{
    struct gather gather = { .map = map };
    struct pell_env_element unused;
    double total = 0.0;

    for (int y = 0; y < map->height; y += BLOCK)
        for (int x = 0; x < map->width; x += BLOCK)
            total += block_element(map, x, y, BLOCK, &unused);
    gather.threshold = total / ELEMENT_DIVISOR;
    gather_all(&gather);
    *elements = pell_calloc(ctx, gather.count + 1, sizeof(**elements));
    if (!*elements)
        return PELL_ERR_NOMEM;
    gather.out = *elements;
    gather_all(&gather);
    *count = gather.count ? gather.count : 1;
    return PELL_OK;
}

enum pell_result pell_environment_create(struct pell_context *ctx, const struct pell_light *light,
                                         const struct pell_environment_params *params, struct pell_environment *env,
                                         struct pell_environment_lights *out)
{
    const struct pell_specular_tables *tables = params->tables;
    struct pell_pool *pool = params->pool;
    struct scratch w = { 0 };
    struct node_task task = { .env = env, .simd = pell_env_kernels_tables[pell_simd_best()] };
    enum pell_result res;

    *out = (struct pell_environment_lights) { 0 };
    pell_environment_init(env, light);
    PELL_TRY(allocate_table(ctx, tables, env, &w.kernels));
    make_kernels(tables, env, w.kernels);
    if (env->image) {
        PELL_TRY(allocate_scratch(ctx, env, &w));
        pell_pool_run(pool, w.mips[0].height, resample_row, &(struct resample_task) { env, &w.mips[0] });
        PELL_TRY(pell_environment_light_sources(ctx, &w.mips[0], params->index, params->max_lights, out));
        PELL_TRY(make_elements(ctx, &w.mips[0], &w.elements, &task.count));
        make_levels(pool, &w, env);
    }
    task.elements = w.elements;
    task.num_sources = out->count;
    task.sources = out->sources;
    task.kernels = w.kernels;
    task.rows = env->size / 3;
    pell_pool_run(pool, PELL_ENV_NODES, make_node_row, &task);
    res = pell_cancelled(ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    free_scratch(ctx, &w);
    return res;
}

void pell_environment_finish(struct pell_context *ctx, struct pell_environment *env)
{
    pell_free(ctx, env->nodes);
    for (int k = 0; k < PELL_ENV_LEVELS; k++)
        pell_free(ctx, env->levels[k].rgb);
    memset(env, 0, sizeof(*env));
}
