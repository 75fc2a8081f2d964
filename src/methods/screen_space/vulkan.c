/* SPDX-License-Identifier: MIT
 *
 * vulkan.c - screen-space diffusion on a Vulkan device: uploads the frame's planes, runs the blurs as compute passes, and downloads the
 * result. The shaders mirror the kernels of the cpu engine; README.md has the mathematics.
 */
#include "methods/gpu_planes.h"
#include "methods/screen_space/chain.h"
#include "methods/screen_space/factors.h"
#include "methods/screen_space/push.h"

#include <string.h>

enum { LINES_ACROSS = 4096 }; /* maximum number of workgroups of lines.comp in a row */

enum buffer {
    TABLE_UP,
    TABLE,
    FACTORS_UP,
    FACTORS,
    DEPTHS,
    SCALE,
    SLOPES,
    CELLS,
    LINES,
    PLANS,
    ALONG_X,
    ALONG_D,
    NOW,
    HALF,
    SUM,
    BUFFERS,
    LIGHT,
    SURFACE /* the frame's planes */
};

/* Sizes of the tables depend on chains and kernels and are set elsewhere. */
static const struct {
    const char *name;
    enum pell_gpu_memory memory;
    int of_pixel, of_block; /* bytes */
} buffer_rows[BUFFERS] = {
    [TABLE_UP] = { "screen-space steps, upload", PELL_GPU_TO_DEVICE, 0, 0 },
    [TABLE] = { "screen-space steps", PELL_GPU_ON_DEVICE, 0, 0 },
    [FACTORS_UP] = { "screen-space kernel, upload", PELL_GPU_TO_DEVICE, 0, 0 },
    [FACTORS] = { "screen-space kernel", PELL_GPU_ON_DEVICE, 0, 0 },
    [DEPTHS] = { "screen-space position", PELL_GPU_ON_DEVICE, 8, 0 },
    [SCALE] = { "screen-space scale", PELL_GPU_ON_DEVICE, 4, 0 },
    [SLOPES] = { "screen-space slopes", PELL_GPU_ON_DEVICE, 16, 0 },
    [CELLS] = { "screen-space blocks", PELL_GPU_ON_DEVICE, 0, 8 },
    [LINES] = { "screen-space lines", PELL_GPU_ON_DEVICE, 0, 16 },
    [PLANS] = { "screen-space plans", PELL_GPU_ON_DEVICE, 0, 2 * 16 * SCREEN_PLANNED },
    [ALONG_X] = { "screen-space lengths along x", PELL_GPU_ON_DEVICE, 8, 0 },
    [ALONG_D] = { "screen-space lengths down", PELL_GPU_ON_DEVICE, 8, 0 },
    [NOW] = { "screen-space now", PELL_GPU_ON_DEVICE, 16, 0 },
    [HALF] = { "screen-space half", PELL_GPU_ON_DEVICE, 16, 0 },
    [SUM] = { "screen-space sum", PELL_GPU_ON_DEVICE, 16, 0 },
};

extern const struct pell_shader pell_screen_space_load_shader, pell_screen_space_measure_shader, pell_screen_space_lines_shader,
    pell_screen_space_plan_shader, pell_screen_space_blur_shader, pell_screen_space_separable_shader;

enum pass { LOAD, MEASURE, LINE, PLAN, ACROSS, DOWN, TERM_ACROSS, TERM_DOWN, PASSES };
enum form { GAUSSIANS, LISTING, SEPARABLE }; /* constant FORM of plan.comp */

static const struct {
    const struct pell_shader *shader;
    enum buffer buffers[8]; /* in the order of its bindings */
} pass_rows[PASSES] = {
    [LOAD] = { &pell_screen_space_load_shader, { LIGHT, SURFACE, TABLE, DEPTHS, SCALE, NOW, SUM } },
    [MEASURE] = { &pell_screen_space_measure_shader, { DEPTHS, SCALE, SLOPES, CELLS } },
    [LINE] = { &pell_screen_space_lines_shader, { CELLS, LINES } },
    [PLAN] = { &pell_screen_space_plan_shader, { DEPTHS, SCALE, SLOPES, LINES, TABLE, ALONG_X, ALONG_D, PLANS } },
    [ACROSS] = { &pell_screen_space_blur_shader, { ALONG_X, ALONG_X, SCALE, TABLE, PLANS, NOW, HALF, SUM } },
    [DOWN] = { &pell_screen_space_blur_shader, { ALONG_D, ALONG_X, SCALE, TABLE, PLANS, HALF, NOW, SUM } },
    [TERM_ACROSS] = { &pell_screen_space_separable_shader, { ALONG_X, ALONG_D, SCALE, FACTORS, PLANS, NOW, HALF, SUM } },
    [TERM_DOWN] = { &pell_screen_space_separable_shader, { ALONG_D, ALONG_X, SCALE, FACTORS, PLANS, HALF, NOW, SUM } },
};

struct vec4 {
    float x, y, z, w;
};

struct screen_gpu {
    struct pell_context *ctx; /* borrowed, as are services and gpu */
    const struct pell_services *services;
    struct pell_gpu *gpu;
    struct screen_chain chain;
    struct screen_factors factors; /* with kernel=separable */
    enum form form;
    struct pell_gpu_planes planes;
    struct pell_gpu_buffer *buffers[BUFFERS];
    struct pell_gpu_pass *passes[PASSES];
    struct pell_gpu_commands *commands;
    struct screen_push push;
    float *scales; /* per row: maximum px^2 per mm^2 */
};

/* --- Create and destroy -------------------------------------------------------------------------------------------------------- */

static void gpu_destroy(void *state)
{
    struct screen_gpu *st = state;

    if (!st)
        return;
    pell_gpu_commands_destroy(&st->commands);
    for (int i = 0; i < PASSES; i++)
        pell_gpu_pass_destroy(&st->passes[i]);
    for (int i = 0; i < BUFFERS; i++)
        pell_gpu_buffer_destroy(&st->buffers[i]);
    pell_gpu_planes_finish(&st->planes);
    pell_free(st->ctx, st->scales);
    pell_ss_factors_finish(st->ctx, &st->factors);
    pell_ss_chain_finish(&st->chain);
    pell_free(st->ctx, st);
}

static uint64_t table_size(const struct screen_gpu *st)
{
    return (uint64_t) (SCREEN_PREBLUR + st->chain.steps + 1) * (st->chain.num_materials + 1) * sizeof(struct vec4);
}

static uint64_t factors_size(const struct screen_gpu *st)
{
    return (uint64_t) (st->chain.num_materials + 1) * (uint64_t) st->factors.rank * SCREEN_FACTOR_SIZE * sizeof(struct vec4);
}

static bool is_needed(const struct screen_gpu *st, enum buffer which)
{
    return st->form == SEPARABLE || (which != FACTORS && which != FACTORS_UP);
}

static enum pell_result make_buffers(struct screen_gpu *st, const struct pell_frame_shape *shape)
{
    const uint64_t blocks = ((uint64_t) shape->width + SCREEN_BLOCK - 1) / SCREEN_BLOCK * (uint64_t) shape->height;
    enum pell_result res = PELL_OK;

    for (int i = 0; res == PELL_OK && i < BUFFERS; i++) {
        const uint64_t size = i == TABLE || i == TABLE_UP ? table_size(st)
                              : i == FACTORS || i == FACTORS_UP
                                  ? factors_size(st)
                                  : blocks * (uint64_t) (buffer_rows[i].of_pixel * SCREEN_BLOCK + buffer_rows[i].of_block);
        if (is_needed(st, i))
            res = pell_gpu_buffer_create(st->gpu, buffer_rows[i].memory, size, buffer_rows[i].name, &st->buffers[i]);
    }
    return res;
}

static struct pell_gpu_buffer *buffer_of(const struct screen_gpu *st, enum buffer which)
{
    return which == LIGHT     ? pell_gpu_planes_buffer(&st->planes, PELL_GPU_PLANE_LIGHT)
           : which == SURFACE ? pell_gpu_planes_buffer(&st->planes, PELL_GPU_PLANE_SURFACE)
                              : st->buffers[which];
}

static bool is_used(const struct screen_gpu *st, enum pass pass)
{
    return st->form == SEPARABLE ? pass != ACROSS && pass != DOWN : pass != TERM_ACROSS && pass != TERM_DOWN;
}

static enum pell_result make_passes(struct screen_gpu *st)
{
    enum pell_result res = PELL_OK;

    for (int i = 0; res == PELL_OK && i < PASSES; i++) {
        const uint32_t first = i == PLAN ? st->form : i == DOWN || i == TERM_DOWN, constants[2] = { first, (uint32_t) st->chain.forms };
        const size_t count = i == ACROSS || i == DOWN ? 2 : i == PLAN || i == TERM_ACROSS || i == TERM_DOWN ? 1 : 0;
        struct pell_gpu_buffer *buffers[PELL_COUNT(pass_rows[i].buffers)];

        if (!is_used(st, i))
            continue;
        for (size_t k = 0; k < PELL_COUNT(buffers); k++)
            buffers[k] = buffer_of(st, pass_rows[i].buffers[k]);
        res = pell_gpu_pass_create(st->gpu, pass_rows[i].shader, constants, count, buffers, &st->passes[i]);
    }
    return res;
}

/* The table of steps, uploaded with each frame: a few hundred bytes per material. */
static void fill_table(const struct screen_gpu *st)
{
    const struct screen_chain *c = &st->chain;
    const size_t row = c->num_materials + 1, steps = (size_t) (SCREEN_PREBLUR + c->steps) * row;
    struct vec4 *table = pell_gpu_buffer_host(st->buffers[TABLE_UP]);

    for (size_t i = 0; i < steps; i++)
        table[i] = (struct vec4) { c->blend[i][0], c->blend[i][1], c->blend[i][2], c->variance[i] };
    for (size_t m = 0; m < row; m++)
        table[steps + m] =
            (struct vec4) { c->total[m][0], c->total[m][1], c->total[m][2], st->form == SEPARABLE ? st->factors.extent_mm[m] : 0.0f };
}

/* The kernel's factors, in the format of separable.comp. */
static void fill_factors(const struct screen_gpu *st)
{
    const size_t count = (st->chain.num_materials + 1) * (size_t) st->factors.rank;
    struct vec4 *to = pell_gpu_buffer_host(st->buffers[FACTORS_UP]);

    for (size_t i = 0; i < count; i++) {
        const struct screen_factor *f = &st->factors.factor[i];
        *to++ = (struct vec4) { f->integral[0], f->integral[1], f->integral[2], st->factors.extent_mm[i / (size_t) st->factors.rank] };
        *to++ = (struct vec4) { f->sign[0], f->sign[1], f->sign[2], 0.0f };
        for (int k = 0; k < SCREEN_FACTOR_PARTS; k++)
            for (int c = 0; c < 3; c++)
                *to++ = (struct vec4) { f->cubic[c][0][k], f->cubic[c][1][k], f->cubic[c][2][k], f->cubic[c][3][k] };
    }
}

static enum pell_result gpu_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                   void **state)
{
    struct pell_context *ctx = services->ctx;
    struct screen_gpu *st = pell_zalloc(ctx, sizeof(*st));
    const struct screen_knobs *chosen = knobs;
    const struct screen_chain *c;
    enum pell_result res;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->ctx = ctx;
    st->services = services;
    st->gpu = services->gpu;
    c = &st->chain;
    st->form = chosen->kernel == SCREEN_KERNEL_SEPARABLE ? SEPARABLE : chosen->edges == SCREEN_EDGES_PAPER ? LISTING : GAUSSIANS;
    if (chosen->rotate && st->form != GAUSSIANS)
        return pell_error(ctx, PELL_ERR_UNSUPPORTED, "screen-space", "use --engine cpu, or leave the knob at its default",
                          "the engine vulkan has no rotate=on");
    PELL_TRY(pell_ss_chain_make(ctx, shape, knobs, &st->chain));
    if (st->form == SEPARABLE)
        PELL_TRY(pell_ss_factors_make(c, shape, &st->factors));
    st->push = (struct screen_push) {
        .image_width = shape->width,
        .image_height = shape->height,
        .row = (int32_t) c->num_materials + 1,
        .total = SCREEN_PREBLUR + c->steps,
        .orthographic = shape->orthographic,
        .strength = c->knobs.strength,
        .rank = st->factors.rank,
        .taps = c->knobs.taps,
        .depth_mm = c->depth_mm,
        .fixed_mm = c->fixed_mm,
        .ratio2 = c->ratio2,
        .skip = c->skip,
        .correction = c->correction,
        .maxdd = c->maxdd,
        .unit = c->unit,
    };
    res = PELL_ERR_NOMEM;
    st->scales = pell_calloc(ctx, (size_t) shape->height, sizeof(*st->scales));
    if (!st->scales)
        goto fail;
    PELL_TRY(make_buffers(st, shape));
    PELL_TRY(pell_gpu_planes_make(services, shape, &st->planes));
    PELL_TRY(make_passes(st));
    fill_table(st);
    if (st->form == SEPARABLE)
        fill_factors(st);
    return services->planes ? PELL_OK : pell_gpu_commands_create(st->gpu, "screen-space", &st->commands);

fail:
    return res;
}

/* --- Transfers ------------------------------------------------------------------------------------------------------------------- */

/* px^2 per mm^2 of the variances, as in load.comp: the number of steps depends on the maximum. */
static float scale_of(const struct screen_push *p, float depth, float strength)
{
    const float mm = depth * p->depth_mm + p->fixed_mm, s = strength < 1.0f ? strength : 1.0f;
    const float scale = s * s * p->ratio2 / (mm * mm);

    return !(depth > 0.0f && depth < 1e12f && strength > 0.0f) ? 0.0f : scale < 1e30f ? scale : 1e30f;
}

/* Maximum over a row. */
static void find_scale(void *state, int row)
{
    struct screen_gpu *st = state;
    const struct pell_gpu_planes *p = &st->planes;
    const struct pell_gpu_light *light = pell_gpu_planes_light_row(p, row);
    const struct pell_gpu_surface *surface = pell_gpu_planes_surface_row(p, row);
    float most = 0.0f;

    for (int i = 0; i < p->width; i++) {
        const float scale = surface[i].material ? scale_of(&st->push, light[i].depth, surface[i].strength) : 0.0f;
        most = scale > most ? scale : most;
    }
    st->scales[row] = most;
}

/* --- A frame ------------------------------------------------------------------------------------------------------------------- */

struct steps {
    int first, end, preblur;
};

static void set_grid(struct screen_gpu *st)
{
    st->push.x0 = st->planes.x0;
    st->push.y0 = st->planes.y0;
    st->push.width = st->planes.width;
    st->push.height = st->planes.height;
}

static void run_pixels(struct screen_gpu *st, struct pell_gpu_commands *c, enum pass pass)
{
    const uint32_t *group = pass_rows[pass].shader->local;

    pell_gpu_run(c, st->passes[pass], &st->push, pell_gpu_groups(st->push.width, (int) group[0]),
                 pell_gpu_groups(st->push.height, (int) group[1]), 1);
}

static void run_lines(struct screen_gpu *st, struct pell_gpu_commands *c)
{
    const int64_t lines = (int64_t) st->push.height + st->push.width / SCREEN_BLOCK, across = lines < LINES_ACROSS ? lines : LINES_ACROSS;

    pell_gpu_run(c, st->passes[LINE], &st->push, (uint32_t) across, pell_gpu_groups(lines, (int) across), 1);
}

static const char *step_name(const struct screen_gpu *st, int step, int preblur)
{
    return st->form == SEPARABLE ? pell_ss_term_name(step) : pell_ss_step_name(step, preblur);
}

/* Records everything from the frame's planes to the step before `steps.end`. `whole`: see struct screen_push. */
static void record_steps(struct screen_gpu *st, struct pell_gpu_commands *c, struct steps steps, bool whole)
{
    const bool separable = st->form == SEPARABLE;

    st->push.base = SCREEN_PREBLUR - steps.preblur;
    st->push.whole = whole;
    st->push.planned = steps.first;
    st->push.end = steps.end;
    pell_gpu_copy(c, st->buffers[TABLE_UP], st->buffers[TABLE], table_size(st));
    if (separable)
        pell_gpu_copy(c, st->buffers[FACTORS_UP], st->buffers[FACTORS], factors_size(st));
    pell_gpu_mark(c, "load");
    run_pixels(st, c, LOAD);
    pell_gpu_mark(c, "measure");
    run_pixels(st, c, MEASURE);
    run_lines(st, c);
    run_pixels(st, c, PLAN);
    for (int step = steps.first; step < steps.end; step++) {
        pell_gpu_mark(c, step_name(st, step, steps.preblur));
        st->push.step = step;
        if (st->form == GAUSSIANS && step == st->push.planned + SCREEN_PLANNED) {
            st->push.planned = step;
            run_pixels(st, c, PLAN);
        }
        run_pixels(st, c, separable ? TERM_ACROSS : ACROSS);
        run_pixels(st, c, separable ? TERM_DOWN : DOWN);
    }
}

static void record_download(const struct screen_gpu *st, struct pell_gpu_commands *c)
{
    pell_gpu_mark(c, "download");
    pell_gpu_planes_download(&st->planes, c, st->buffers[SUM]);
}

/* Runs the command list and downloads the result to three planes. */
static enum pell_result run_list(struct screen_gpu *st, struct steps steps, bool whole, float *const to[3])
{
    struct pell_gpu_commands *c = st->commands;
    enum pell_result res;

    PELL_TRY(pell_gpu_begin(c));
    pell_gpu_mark(c, "upload");
    pell_gpu_planes_upload(&st->planes, c);
    record_steps(st, c, steps, whole);
    record_download(st, c);
    PELL_TRY(pell_gpu_finish(c));
    pell_gpu_planes_unpack(&st->planes, to);
    return PELL_OK;

fail:
    return res;
}

/* Steps of a frame whose largest pixel scale is `scale` px^2 per mm^2: blurs, or the kernel's terms. */
static struct steps choose_steps(const struct screen_gpu *st, float scale)
{
    struct steps steps = { .end = st->factors.rank };

    if (st->form == SEPARABLE)
        return steps;
    pell_ss_chain_choose(&st->chain, scale, &steps.preblur, &steps.first);
    steps.end = steps.preblur + st->chain.steps;
    return steps;
}

/* Device to device: the grid is the whole image. */
static void gpu_record_in(void *state, struct pell_gpu_commands *commands, float depth, float strength)
{
    struct screen_gpu *st = state;

    pell_gpu_planes_whole(&st->planes, st->push.image_width, st->push.image_height);
    set_grid(st);
    record_steps(st, commands, choose_steps(st, scale_of(&st->push, depth, strength)), false);
    if (st->services->planes)
        record_download(st, commands);
}

static bool gpu_planes(const void *state, struct pell_gpu_buffer *planes[PELL_GPU_PLANES])
{
    const struct screen_gpu *st = state;

    planes[PELL_GPU_PLANE_LIGHT] = buffer_of(st, LIGHT);
    planes[PELL_GPU_PLANE_SURFACE] = buffer_of(st, SURFACE);
    planes[PELL_GPU_PLANE_RESULT] = st->buffers[SUM];
    return st->chain.knobs.input != SCREEN_INPUT_SHADED;
}

/* The result of each step by itself. */
static enum pell_result show_blurs(struct screen_gpu *st, const struct pell_frame *in, struct steps steps)
{
    const size_t size = (size_t) in->shape.stride * (size_t) in->shape.height;
    float *planes = pell_calloc(st->ctx, 3 * size, sizeof(*planes));
    float *const to[3] = { planes, planes + size, planes + 2 * size };
    enum pell_result res = planes ? PELL_OK : PELL_ERR_NOMEM;

    for (int step = steps.first; step < steps.end && res == PELL_OK; step++) {
        res = run_list(st, (struct steps) { steps.first, step + 1, steps.preblur }, st->form != SEPARABLE, to);
        if (res == PELL_OK)
            res = pell_ss_show(&st->chain, st->services, in, (const float *const *) to, 0, step, steps.preblur);
    }
    pell_free(st->ctx, planes);
    return res;
}

static int bytes_of(const char *mark)
{
    return !strcmp(mark, "upload")       ? 48
           : !strcmp(mark, "load")       ? 68
           : !strcmp(mark, "measure")    ? 72
           : !strcmp(mark, "download")   ? 32
           : !strncmp(mark, "kernel", 6) ? 104
                                         : 128;
}

static enum pell_result gpu_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct screen_gpu *st = state;
    const struct screen_knobs *k = &st->chain.knobs;
    struct steps steps;
    int64_t pixels;
    float most = 0.0f;
    enum pell_result res;

    pixels = pell_gpu_planes_pack(&st->planes, in, k->input == SCREEN_INPUT_SHADED ? in->shaded : in->irradiance,
                                  k->strength ? in->strength : NULL, find_scale, st);
    set_grid(st);
    for (int row = 0; row < st->planes.height; row++)
        most = st->scales[row] > most ? st->scales[row] : most;
    steps = choose_steps(st, most);
    res = pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
    if (res == PELL_OK && pell_services_observed(st->services, in))
        res = show_blurs(st, in, steps);
    if (res == PELL_OK)
        res = run_list(st, steps, false, out->light);
    if (res == PELL_OK)
        pell_gpu_planes_note(&st->planes, st->commands, pixels, bytes_of);
    return res == PELL_OK && pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : res;
}

static const struct pell_thickness_table *thickness(const void *state, size_t material)
{
    const struct screen_gpu *st = state;

    return st->chain.thickness && material < st->chain.num_materials ? &st->chain.thickness[material] : NULL;
}

static size_t times(const void *state, struct pell_pass_time *list, size_t size)
{
    return pell_gpu_planes_times(&((const struct screen_gpu *) state)->planes, list, size);
}

const struct pell_method_engine pell_ss_vulkan = {
    .create = gpu_create,
    .record = gpu_render,
    .destroy = gpu_destroy,
    .record_in = gpu_record_in,
    .planes = gpu_planes,
    .thickness = thickness,
    .times = times,
};
