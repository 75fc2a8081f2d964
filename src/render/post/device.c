/* SPDX-License-Identifier: MIT
 * device.c - see device.h. */
#include "render/post/device.h"

#include "render/plane_buffers.h"
#include "render/post/device_data.h"
#include "vulkan/gpu.h"

#include <string.h>

enum buffer {
    PLANES_UP, /* a sample, or the image */
    PLANES,
    PLANES_DOWN, /* the sum, or the image */
    TABLE_UP,
    TABLE,
    DISCS,
    TILES,
    TILES_DOWN,
    SUM,
    SCRATCH,
    SHOWN,
    SHOWN_DOWN,
    BUFFERS
};

enum pass { LENS_MEASURE, LENS_BLUR, SPREAD, MIX, SHOW, PASSES };

enum {
    PLANES_MOST = 7,  /* copied at once */
    COPIED_ROWS = 32, /* per task */
    LENS_PLANES = 5,  /* per sample */
    TAPS = 2 * PELL_BLUR_RADIUS + 1,
    WEIGHTS = 2 * PELL_BLUR_MOST + TAPS, /* of a Gaussian, in the table */
    BLOOM_TABLE = 2 * WEIGHTS,           /* larger than the table of depth of field */
    LOW0 = 0,                            /* planes of SCRATCH: both Gaussians, and one between their steps */
    LOW1 = 1,
    BETWEEN = 2
};

#define FLOAT sizeof(float)

struct pell_post_device {
    struct pell_context *ctx; /* borrowed */
    struct pell_gpu *gpu;     /* borrowed */
    struct pell_gpu_commands *commands;
    struct pell_gpu_buffer *buffers[BUFFERS];
    struct pell_gpu_pass *passes[PASSES];
    const char *lens_why, *bloom_why;
    int width, height;
    size_t plane;          /* floats, of an image */
    bool lens, bloom;      /* their buffers exist, or a reason why not is set */
    bool lens_table;       /* TABLE holds the weights of depth of field */
    struct pell_rect rect; /* of the last sample's composite */
};

extern const struct pell_shader pell_post_lens_measure_shader, pell_post_lens_blur_shader, pell_post_bloom_spread_shader,
    pell_post_bloom_mix_shader, pell_post_show_shader;

enum pell_result pell_post_device_create(struct pell_context *ctx, struct pell_gpu *gpu, struct pell_post_device **out)
{
    struct pell_post_device *d = pell_zalloc(ctx, sizeof(*d));
    enum pell_result res;

    *out = NULL;
    if (!d)
        return PELL_ERR_NOMEM;
    d->ctx = ctx;
    d->gpu = gpu;
    PELL_TRY(pell_gpu_commands_create(gpu, "post", &d->commands));
    *out = d;
    return PELL_OK;

fail:
    pell_post_device_destroy(&d);
    return res;
}

void pell_post_device_drop(struct pell_post_device *d)
{
    for (int i = 0; i < PASSES; i++)
        pell_gpu_pass_destroy(&d->passes[i]);
    for (int i = 0; i < BUFFERS; i++)
        pell_gpu_buffer_destroy(&d->buffers[i]);
    d->lens = d->bloom = d->lens_table = false;
    d->lens_why = d->bloom_why = NULL;
}

void pell_post_device_destroy(struct pell_post_device **device)
{
    struct pell_post_device *d = *device;

    if (!d)
        return;
    *device = NULL;
    pell_gpu_commands_destroy(&d->commands);
    pell_post_device_drop(d);
    pell_free(d->ctx, d);
}

const char *pell_post_device_refuses_lens(const struct pell_post_device *d)
{
    return d->lens_why;
}

const char *pell_post_device_refuses_bloom(const struct pell_post_device *d)
{
    return d->bloom_why;
}

/* --- Buffers and passes -------------------------------------------------------------------------------------------------------------- */

static enum pell_result make_buffer(struct pell_post_device *d, enum buffer which, enum pell_gpu_memory memory, size_t floats,
                                    const char *name)
{
    return d->buffers[which] ? PELL_OK : pell_gpu_buffer_create(d->gpu, memory, floats * FLOAT, name, &d->buffers[which]);
}

static enum pell_result make_pass(struct pell_post_device *d, enum pass which, const struct pell_shader *shader, const enum buffer *list)
{
    struct pell_gpu_buffer *buffers[PELL_GPU_BINDINGS];

    for (int i = 0; i < shader->num_bindings; i++)
        buffers[i] = d->buffers[list[i]];
    return pell_gpu_pass_create(d->gpu, shader, NULL, 0, buffers, &d->passes[which]);
}

static enum pell_result make_common(struct pell_post_device *d, size_t planes)
{
    enum pell_result res;

    PELL_TRY(make_buffer(d, PLANES_UP, PELL_GPU_TO_DEVICE, planes * d->plane, "post, planes, upload"));
    PELL_TRY(make_buffer(d, PLANES, PELL_GPU_ON_DEVICE, planes * d->plane, "post, planes"));
    PELL_TRY(make_buffer(d, PLANES_DOWN, PELL_GPU_FROM_DEVICE, 4 * d->plane, "post, planes, download"));
    PELL_TRY(make_buffer(d, TABLE_UP, PELL_GPU_TO_DEVICE, BLOOM_TABLE, "post, table, upload"));
    return make_buffer(d, TABLE, PELL_GPU_ON_DEVICE, BLOOM_TABLE, "post, table");

fail:
    return res;
}

static enum pell_result make_lens(struct pell_post_device *d)
{
    static const enum buffer of_measure[] = { PLANES, TABLE, DISCS, TILES }, of_blur[] = { PLANES, TABLE, DISCS, TILES, SUM };
    const size_t tiles = pell_dof_tiles(d->width, d->height);
    enum pell_result res;

    PELL_TRY(make_buffer(d, DISCS, PELL_GPU_ON_DEVICE, 2 * d->plane, "lens, discs"));
    PELL_TRY(make_buffer(d, TILES, PELL_GPU_ON_DEVICE, 2 * tiles, "lens, tiles"));
    PELL_TRY(make_buffer(d, TILES_DOWN, PELL_GPU_FROM_DEVICE, tiles, "lens, tiles, download"));
    PELL_TRY(make_buffer(d, SUM, PELL_GPU_ON_DEVICE, 4 * d->plane, "lens, sum"));
    PELL_TRY(make_pass(d, LENS_MEASURE, &pell_post_lens_measure_shader, of_measure));
    return make_pass(d, LENS_BLUR, &pell_post_lens_blur_shader, of_blur);

fail:
    return res;
}

static enum pell_result make_bloom(struct pell_post_device *d)
{
    static const enum buffer of_spread[] = { PLANES, SCRATCH, TABLE }, of_mix[] = { PLANES, SCRATCH }, of_show[] = { PLANES, SHOWN };
    enum pell_result res;

    PELL_TRY(make_buffer(d, SCRATCH, PELL_GPU_ON_DEVICE, 3 * d->plane, "bloom, room"));
    PELL_TRY(make_buffer(d, SHOWN, PELL_GPU_ON_DEVICE, 3 * d->plane, "shown"));
    PELL_TRY(make_buffer(d, SHOWN_DOWN, PELL_GPU_FROM_DEVICE, 3 * d->plane, "shown, download"));
    PELL_TRY(make_pass(d, SPREAD, &pell_post_bloom_spread_shader, of_spread));
    PELL_TRY(make_pass(d, MIX, &pell_post_bloom_mix_shader, of_mix));
    return make_pass(d, SHOW, &pell_post_show_shader, of_show);

fail:
    return res;
}

enum pell_result pell_post_device_reserve(struct pell_post_device *d, int width, int height, bool lens, bool bloom)
{
    const uint64_t most = pell_gpu_buffer_most(d->gpu) / FLOAT, plane = (uint64_t) pell_plane_stride(width) * (uint64_t) height;
    const bool same = d->width == width && d->height == height;
    enum pell_result res;

    if ((!lens || (same && d->lens)) && (!bloom || (same && d->bloom)))
        return PELL_OK;
    lens |= same && d->lens;
    bloom |= same && d->bloom;
    pell_post_device_drop(d);
    d->width = width;
    d->height = height;
    d->plane = plane;
    d->lens = lens;
    d->bloom = bloom;
    d->lens_why = lens && LENS_PLANES * plane > most ? "depth of field by the cpu: more pixels than a buffer holds" : NULL;
    d->bloom_why = bloom && 4 * plane > most ? "bloom by the cpu: more pixels than a buffer holds" : NULL;
    lens &= !d->lens_why;
    bloom &= !d->bloom_why;
    if (!lens && !bloom)
        return PELL_OK;
    PELL_TRY(make_common(d, lens ? LENS_PLANES : 4));
    if (lens)
        PELL_TRY(make_lens(d));
    if (bloom)
        PELL_TRY(make_bloom(d));
    return PELL_OK;

fail:
    pell_post_device_drop(d);
    return res;
}

/* --- Copies -------------------------------------------------------------------------------------------------------------------------- */

/* Copies rectangles of planes. */
struct copy {
    const float *from[PLANES_MOST];
    float *to[PLANES_MOST];
    int count, rows, width; /* floats of a row */
    ptrdiff_t from_stride, to_stride;
    float scale; /* factor of the values */
};

static void copy_band(void *arg, int band, int worker)
{
    const struct copy *c = arg;
    const int end = (band + 1) * COPIED_ROWS < c->rows ? (band + 1) * COPIED_ROWS : c->rows;
    (void) worker;

    for (int i = 0; i < c->count; i++)
        for (int y = band * COPIED_ROWS; y < end; y++) {
            float *restrict to = c->to[i] + y * c->to_stride;
            memcpy(to, c->from[i] + y * c->from_stride, (size_t) c->width * FLOAT);
            for (int x = 0; c->scale != 1.0f && x < c->width; x++)
                to[x] *= c->scale;
        }
}

/* Returns the time, in seconds. */
static double copy_planes(struct pell_pool *pool, struct copy *c)
{
    const double start = pell_seconds();

    if (c->rows > 0 && c->width > 0)
        pell_pool_run(pool, (c->rows + COPIED_ROWS - 1) / COPIED_ROWS, copy_band, c);
    return pell_seconds() - start;
}

static float *host(const struct pell_post_device *d, enum buffer which)
{
    return pell_gpu_buffer_host(d->buffers[which]);
}

/* Adds the times of the finished list's marks, which are some of "upload", "run" and "download". */
static void take_times(const struct pell_post_device *d, struct pell_post_device_times *times)
{
    struct pell_gpu_time list[4];
    const size_t count = pell_gpu_times(d->commands, list, PELL_COUNT(list));

    for (size_t i = 0; i < count; i++) {
        double *const to = strcmp(list[i].name, "upload") == 0 ? &times->upload
                           : strcmp(list[i].name, "run") == 0  ? &times->run
                                                               : &times->download;
        *to += list[i].seconds;
    }
}

static void run(struct pell_post_device *d, struct pell_gpu_commands *commands, enum pass which, const void *push, int width, int height)
{
    pell_gpu_run(commands, d->passes[which], push, (uint32_t) (width + PELL_POST_GROUP_X - 1) / PELL_POST_GROUP_X,
                 (uint32_t) (height + PELL_POST_GROUP_Y - 1) / PELL_POST_GROUP_Y, 1);
}

/* --- Depth of field ------------------------------------------------------------------------------------------------------------------ */

/* Rows of the image that hold the composite, from a row of tiles on. */
struct window {
    int y0, height, columns, rows;
    size_t plane; /* floats */
};

static struct window window_of(const struct pell_post_device *d, const struct pell_rect *r)
{
    struct window w = { .y0 = r->y0 / PELL_LENS_MOST * PELL_LENS_MOST, .columns = (d->width + PELL_LENS_MOST - 1) / PELL_LENS_MOST };

    w.height = r->y1 > w.y0 && r->x1 > r->x0 ? r->y1 - w.y0 : 0;
    w.rows = (w.height + PELL_LENS_MOST - 1) / PELL_LENS_MOST;
    w.plane = (size_t) pell_plane_stride(d->width) * (size_t) w.height;
    return w;
}

struct depths_task {
    const struct pell_surface *surface;
    const struct window *window;
    float *out;
};

/* Writes 1 / depth of a row, 0 where nothing is visible. */
static void invert_row(void *arg, int row, int worker)
{
    const struct depths_task *t = arg;
    const struct pell_surface *s = t->surface;
    const struct pell_rect c = s->covered;
    const int y = t->window->y0 + row;
    const ptrdiff_t at = y * s->stride;
    float *restrict out = t->out + row * s->stride;
    (void) worker;

    memset(out, 0, (size_t) s->stride * FLOAT);
    for (int x = c.x0; y >= c.y0 && y < c.y1 && x < c.x1; x++)
        out[x] = s->material[at + x] ? 1.0f / s->depth[at + x] : 0.0f;
}

static double pack_sample(struct pell_post_device *d, struct pell_pool *pool, const struct pell_surface *surface, const struct window *w,
                          float *const in[4])
{
    struct copy c = { .count = 4,
                      .rows = w->height,
                      .width = (int) surface->stride,
                      .from_stride = surface->stride,
                      .to_stride = surface->stride,
                      .scale = 1.0f };
    struct depths_task depths = { surface, w, host(d, PLANES_UP) + 4 * w->plane };
    const double start = pell_seconds();

    for (int i = 0; i < 4; i++) {
        c.from[i] = in[i] + w->y0 * surface->stride;
        c.to[i] = host(d, PLANES_UP) + (size_t) i * w->plane;
    }
    copy_planes(pool, &c);
    pell_pool_run(pool, w->height, invert_row, &depths);
    return pell_seconds() - start;
}

static void send_lens_table(struct pell_post_device *d, struct pell_gpu_commands *commands)
{
    pell_dof_table(host(d, TABLE_UP));
    pell_gpu_copy(commands, d->buffers[TABLE_UP], d->buffers[TABLE], PELL_LENS_TABLE * FLOAT);
}

static void run_lens(struct pell_post_device *d, const struct pell_dof_params *params, const struct window *w,
                     struct pell_gpu_commands *commands)
{
    const struct pell_lens_push push = {
        .scale = params->scale,
        .inverse_focus = 1.0f / params->focus,
        .stride = (uint32_t) pell_plane_stride(d->width),
        .plane = (uint32_t) w->plane,
        .width = (uint32_t) d->width,
        .height = (uint32_t) w->height,
        .columns = (uint32_t) w->columns,
        .rows = (uint32_t) w->rows,
        .x0 = params->rect.x0,
        .y0 = params->rect.y0 - w->y0,
        .x1 = params->rect.x1,
        .y1 = params->rect.y1 - w->y0,
        .first = params->first,
    };

    pell_gpu_run(commands, d->passes[LENS_MEASURE], &push, (uint32_t) w->columns, (uint32_t) w->rows, 1);
    run(d, commands, LENS_BLUR, &push, d->width, w->height);
}

struct pell_post_lens_planes pell_post_device_lens_planes(const struct pell_post_device *d, const struct pell_rect *rect)
{
    const struct window w = window_of(d, rect);

    return (struct pell_post_lens_planes) { d->buffers[PLANES], (uint32_t) w.plane, (uint32_t) pell_plane_stride(d->width), w.y0 };
}

void pell_post_device_record_lens(struct pell_post_device *d, const struct pell_dof_params *params, struct pell_gpu_commands *commands)
{
    const struct window w = window_of(d, &params->rect);

    d->rect = params->rect;
    if (w.height == 0)
        return;
    if (params->first)
        send_lens_table(d, commands);
    run_lens(d, params, &w, commands);
}

enum pell_result pell_post_device_lens(struct pell_post_device *d, struct pell_pool *pool, const struct pell_dof_params *params,
                                       float *const in[4], struct pell_post_device_times *times)
{
    const struct window w = window_of(d, &params->rect);
    enum pell_result res;

    *times = (struct pell_post_device_times) { 0 };
    d->rect = params->rect;
    if (w.height == 0)
        return PELL_OK;
    times->pack = pack_sample(d, pool, params->surface, &w, in);
    PELL_TRY(pell_gpu_begin(d->commands));
    pell_gpu_mark(d->commands, "upload");
    if (!d->lens_table)
        send_lens_table(d, d->commands);
    pell_gpu_copy(d->commands, d->buffers[PLANES_UP], d->buffers[PLANES], LENS_PLANES * w.plane * FLOAT);
    pell_gpu_mark(d->commands, "run");
    run_lens(d, params, &w, d->commands);
    PELL_TRY(pell_gpu_finish(d->commands));
    d->lens_table = true;
    take_times(d, times);
    times->bytes_up = (int64_t) (LENS_PLANES * w.plane * FLOAT);
    /* An inverse depth becomes a disc; disc and colour become a sum. Neighbours come from caches. */
    times->bytes_run = (int64_t) (w.plane * FLOAT) * (1 + 2 + 6 + (params->first ? 4 : 8));
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_post_device_take_lens(struct pell_post_device *d, struct pell_pool *pool, float scale, float *const out[4],
                                            float *widest, struct pell_post_device_times *times)
{
    const struct window w = window_of(d, &d->rect);
    const ptrdiff_t stride = pell_plane_stride(d->width);
    struct copy c = { .count = 4,
                      .rows = d->rect.y1 - d->rect.y0,
                      .width = d->rect.x1 - d->rect.x0,
                      .from_stride = stride,
                      .to_stride = stride,
                      .scale = scale };
    const size_t tiles = (size_t) w.columns * (size_t) w.rows;
    enum pell_result res;

    *times = (struct pell_post_device_times) { 0 };
    *widest = 0.0f;
    if (w.height == 0)
        return PELL_OK;
    PELL_TRY(pell_gpu_begin(d->commands));
    pell_gpu_mark(d->commands, "download");
    pell_gpu_copy(d->commands, d->buffers[SUM], d->buffers[PLANES_DOWN], 4 * w.plane * FLOAT);
    pell_gpu_copy(d->commands, d->buffers[TILES], d->buffers[TILES_DOWN], tiles * FLOAT);
    PELL_TRY(pell_gpu_finish(d->commands));
    take_times(d, times);
    times->bytes_down = (int64_t) ((4 * w.plane + tiles) * FLOAT);
    for (int i = 0; i < 4; i++) {
        c.from[i] = host(d, PLANES_DOWN) + (size_t) i * w.plane + (d->rect.y0 - w.y0) * stride + d->rect.x0;
        c.to[i] = out[i] + d->rect.y0 * stride + d->rect.x0;
    }
    times->unpack = copy_planes(pool, &c);
    for (size_t i = 0; i < tiles; i++)
        *widest = fmaxf(*widest, host(d, TILES_DOWN)[i]);
    return PELL_OK;

fail:
    return res;
}

/* --- Bloom and the tone curve -------------------------------------------------------------------------------------------------------- */

/* Writes a Gaussian's weights, in the order in which they are read. */
static void fill_table(const struct pell_blur *b, float *table)
{
    memcpy(table, b->grid_weight, (size_t) (b->last - b->first) * FLOAT);
    for (int i = -b->radius; i <= b->radius; i++)
        table[2 * PELL_BLUR_MOST + b->radius + i] = b->tap[i < 0 ? -i : i];
}

/* Records a step that writes width x height values. Returns its bytes: overlapping ranges are read twice, neighbours of a Gaussian from
 * caches. */
static int64_t bloom_step(struct pell_post_device *d, struct pell_bloom_push *p, int width, int height)
{
    p->width = (uint32_t) width;
    p->height = (uint32_t) height;
    run(d, d->commands, SPREAD, p, width, height);
    return (int64_t) width * height * (int64_t) FLOAT * (1 + (p->factor > 1 ? 2 * p->factor : 1));
}

/* Records one Gaussian of a channel, into plane `low` of SCRATCH. Returns its bytes. */
static int64_t blur_channel(struct pell_post_device *d, const struct pell_blur *b, size_t channel, int low, uint32_t weights)
{
    const uint32_t stride = (uint32_t) pell_plane_stride(d->width), plane = (uint32_t) d->plane, taps = weights + 2 * PELL_BLUR_MOST;
    const uint32_t from = (uint32_t) channel * plane, here = (uint32_t) low * plane, between = BETWEEN * plane;
    const bool smaller = b->factor > 1;
    struct pell_bloom_push down = { from,
                                    between,
                                    .of_color = 1,
                                    .stride = stride,
                                    .size = d->height,
                                    .down = 1,
                                    .factor = b->factor,
                                    .first = b->first,
                                    .last = b->last,
                                    .weights = weights };
    struct pell_bloom_push along = {
        between, here, .stride = stride, .size = d->width, .factor = b->factor, .first = b->first, .last = b->last, .weights = weights
    };
    struct pell_bloom_push rows = { smaller ? here : from, between,     .of_color = !smaller, .stride = stride,
                                    .size = b->width,      .factor = 1, .first = -b->radius,  .last = b->radius + 1,
                                    .weights = taps };
    struct pell_bloom_push columns = { between,        here,        .stride = stride,    .size = b->height,
                                       .down = 1,      .factor = 1, .first = -b->radius, .last = b->radius + 1,
                                       .weights = taps };
    int64_t bytes = 0;

    if (smaller)
        bytes = bloom_step(d, &down, d->width, b->height) + bloom_step(d, &along, b->width, b->height);
    bytes += bloom_step(d, &rows, b->width, b->height);
    return bytes + bloom_step(d, &columns, b->width, b->height);
}

static int64_t record_bloom(struct pell_post_device *d, const struct pell_blur blurs[2], const struct pell_bloom_params *params,
                            const struct pell_post_tone *tone, size_t count)
{
    const uint32_t stride = (uint32_t) params->stride, plane = (uint32_t) d->plane;
    const uint32_t width = (uint32_t) d->width, height = (uint32_t) d->height;
    const struct pell_show_push show = { stride,      width, height, plane, tone->exposure, tone->min_alpha, tone->curve, tone->white_scale,
                                         tone->filmic };
    const int64_t pixels = (int64_t) d->width * d->height;
    int64_t bytes = 0;

    for (size_t c = 0; c < count; c++) {
        const struct pell_mix_push mix = {
            .from = (uint32_t) c * plane,
            .stride = stride,
            .width = width,
            .height = height,
            .low0 = LOW0 * plane,
            .low1 = LOW1 * plane,
            .factor0 = blurs[0].factor,
            .width0 = blurs[0].width,
            .height0 = blurs[0].height,
            .factor1 = blurs[1].factor,
            .width1 = blurs[1].width,
            .height1 = blurs[1].height,
            .rest = 1.0f - params->fraction,
            .weight = 0.5f * params->fraction,
        };
        bytes += blur_channel(d, &blurs[0], c, LOW0, 0) + blur_channel(d, &blurs[1], c, LOW1, WEIGHTS);
        run(d, d->commands, MIX, &mix, d->width, d->height);
        bytes += (int64_t) FLOAT * (2 * pixels + (int64_t) blurs[0].width * blurs[0].height + (int64_t) blurs[1].width * blurs[1].height);
    }
    run(d, d->commands, SHOW, &show, d->width, d->height);
    return bytes + (int64_t) FLOAT * pixels * (int64_t) (3 + count);
}

enum pell_result pell_post_device_bloom(struct pell_post_device *d, struct pell_pool *pool, const struct pell_bloom_params *params,
                                        const struct pell_post_tone *tone, float *const *planes, size_t count, float *const display[3],
                                        struct pell_post_device_times *times)
{
    const ptrdiff_t stride = params->stride;
    const size_t size = count * d->plane * FLOAT;
    struct copy c = {
        .count = (int) count, .rows = d->height, .width = (int) stride, .from_stride = stride, .to_stride = stride, .scale = 1.0f
    };
    struct pell_blur blurs[2];
    enum pell_result res;

    *times = (struct pell_post_device_times) { 0 };
    pell_bloom_plan(params, blurs);
    fill_table(&blurs[0], host(d, TABLE_UP));
    fill_table(&blurs[1], host(d, TABLE_UP) + WEIGHTS);
    d->lens_table = false; /* overwritten */
    for (size_t i = 0; i < count; i++) {
        c.from[i] = planes[i];
        c.to[i] = host(d, PLANES_UP) + i * d->plane;
    }
    times->pack = copy_planes(pool, &c);
    PELL_TRY(pell_gpu_begin(d->commands));
    pell_gpu_mark(d->commands, "upload");
    pell_gpu_copy(d->commands, d->buffers[TABLE_UP], d->buffers[TABLE], BLOOM_TABLE * FLOAT);
    pell_gpu_copy(d->commands, d->buffers[PLANES_UP], d->buffers[PLANES], size);
    pell_gpu_mark(d->commands, "run");
    times->bytes_run = record_bloom(d, blurs, params, tone, count);
    pell_gpu_mark(d->commands, "download");
    pell_gpu_copy(d->commands, d->buffers[PLANES], d->buffers[PLANES_DOWN], size);
    pell_gpu_copy(d->commands, d->buffers[SHOWN], d->buffers[SHOWN_DOWN], 3 * d->plane * FLOAT);
    PELL_TRY(pell_gpu_finish(d->commands));
    take_times(d, times);
    times->bytes_up = (int64_t) (size + BLOOM_TABLE * FLOAT);
    times->bytes_down = (int64_t) (size + 3 * d->plane * FLOAT);
    for (size_t i = 0; i < count + 3; i++) {
        c.from[i] = i < count ? host(d, PLANES_DOWN) + i * d->plane : host(d, SHOWN_DOWN) + (i - count) * d->plane;
        c.to[i] = i < count ? planes[i] : display[i - count];
    }
    c.count = (int) count + 3;
    c.width = d->width;
    times->unpack = copy_planes(pool, &c);
    return PELL_OK;

fail:
    return res;
}
