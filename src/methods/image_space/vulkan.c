/* SPDX-License-Identifier: MIT
 *
 * vulkan.c - the image-space method on a Vulkan device: sample sets and views of lights are computed on the cpu and uploaded once; the
 * camera's irradiance image, sampling and reconstruction are compute passes. The shaders mirror the kernels of the cpu engine.
 */
#include "methods/gpu_planes.h"
#include "methods/image_space/image_space.h"
#include "methods/image_space/push.h"

#include "render/engine.h"

#include <string.h>

enum { GROUP_X = 16, GROUP_Y = 8, SET_WORDS = 16, LEVEL_WORDS = 8, VIEW_FLOATS = 16 };

/* The method's own buffers; each with the suffix _UP is the upload buffer of the next one. */
enum buffer {
    SETS_UP,
    SETS,
    OFFSETS_UP,
    OFFSETS,
    ROWS_UP,
    ROWS,
    LIGHTS_UP,
    LIGHTS,
    VIEWS_UP,
    VIEWS,
    BASE_UP,
    BASE,
    SOLIDS_UP,
    SOLIDS,
    TEXELS,
    REGIONS,
    M,
    ALPHA,
    RESULT,
    BUFFERS,
    LIGHT, /* of the frame */
    SURFACE
};

static const struct {
    const char *name;
    enum pell_gpu_memory memory;
    int pixel_bytes; /* 0: its size does not depend on the pixels */
} buffer_rows[BUFFERS] = {
    [SETS_UP] = { "image-space sets, upload", PELL_GPU_TO_DEVICE, 0 },
    [SETS] = { "image-space sets", PELL_GPU_ON_DEVICE, 0 },
    [OFFSETS_UP] = { "image-space samples, upload", PELL_GPU_TO_DEVICE, 0 },
    [OFFSETS] = { "image-space samples", PELL_GPU_ON_DEVICE, 0 },
    [ROWS_UP] = { "image-space profiles, upload", PELL_GPU_TO_DEVICE, 0 },
    [ROWS] = { "image-space profiles", PELL_GPU_ON_DEVICE, 0 },
    [LIGHTS_UP] = { "image-space views of lights, upload", PELL_GPU_TO_DEVICE, 0 },
    [LIGHTS] = { "image-space views of lights", PELL_GPU_ON_DEVICE, 0 },
    [VIEWS_UP] = { "image-space views, upload", PELL_GPU_TO_DEVICE, 0 },
    [VIEWS] = { "image-space views", PELL_GPU_ON_DEVICE, 0 },
    [BASE_UP] = { "image-space colours, upload", PELL_GPU_TO_DEVICE, 16 },
    [BASE] = { "image-space colours", PELL_GPU_ON_DEVICE, 16 },
    [SOLIDS_UP] = { "image-space solids, upload", PELL_GPU_TO_DEVICE, 4 },
    [SOLIDS] = { "image-space solids", PELL_GPU_ON_DEVICE, 4 },
    [TEXELS] = { "image-space texels", PELL_GPU_ON_DEVICE, 32 },
    [REGIONS] = { "image-space regions", PELL_GPU_ON_DEVICE, 0 },
    [M] = { "image-space M", PELL_GPU_ON_DEVICE, 16 },
    [ALPHA] = { "image-space alpha", PELL_GPU_ON_DEVICE, 16 },
    [RESULT] = { "image-space result", PELL_GPU_ON_DEVICE, 16 },
};

extern const struct pell_shader pell_image_space_load_shader, pell_image_space_adapt_shader, pell_image_space_choose_shader,
    pell_image_space_gather_shader, pell_image_space_rebuild_shader;

enum pass { LOAD, ADAPT, CHOOSE, GATHER, REBUILD, PASSES };

static const struct {
    const struct pell_shader *shader;
    enum buffer buffers[11]; /* in the order of its bindings */
} pass_rows[PASSES] = {
    [LOAD] = { &pell_image_space_load_shader, { LIGHT, SURFACE, SOLIDS, TEXELS } },
    [ADAPT] = { &pell_image_space_adapt_shader, { LIGHT, SURFACE, SETS, REGIONS } },
    [CHOOSE] = { &pell_image_space_choose_shader, { REGIONS } },
    [GATHER] = { &pell_image_space_gather_shader, { TEXELS, SURFACE, BASE, SETS, OFFSETS, ROWS, VIEWS, LIGHTS, M, ALPHA, REGIONS } },
    [REBUILD] = { &pell_image_space_rebuild_shader, { TEXELS, M, ALPHA, RESULT } },
};

struct is_gpu {
    struct is_setup setup;
    struct pell_context *ctx; /* borrowed */
    struct pell_gpu_planes planes;
    uint64_t sizes[BUFFERS]; /* bytes; 0: not needed */
    struct pell_gpu_buffer *buffers[BUFFERS];
    struct pell_gpu_pass *passes[PASSES];
    struct pell_gpu_commands *commands;
    struct is_push push;
    int image_height;      /* px */
    int32_t *row_solids;   /* solids + 1 of the image's pixels */
    bool sent;             /* frame-independent data is on the device */
    uint64_t sent_image;   /* index of the image whose patterns are on the device, */
    uint64_t packed_image; /* and of the image whose patterns are packed */
};

/* --- Create and destroy -------------------------------------------------------------------------------------------------------- */

static void gpu_destroy(void *state)
{
    struct is_gpu *st = state;

    if (!st)
        return;
    pell_gpu_commands_destroy(&st->commands);
    for (int i = 0; i < PASSES; i++)
        pell_gpu_pass_destroy(&st->passes[i]);
    for (int i = 0; i < BUFFERS; i++)
        pell_gpu_buffer_destroy(&st->buffers[i]);
    pell_gpu_planes_finish(&st->planes);
    is_setup_finish(&st->setup);
    pell_free(st->ctx, st->row_solids);
    pell_free(st->ctx, st);
}

/* Number of profiles of a set: the material's own and those of its levels. */
static size_t profiles_of(const struct is_set *set)
{
    return set->level ? 1 + IS_LEVELS : 1;
}

/* Number of samples of a profile, over the tile. */
static size_t samples_of(const struct is_gpu *st)
{
    const struct is_work *w = &st->setup.work;

    return (size_t) w->tile * (size_t) w->tile * (size_t) w->samples_row;
}

static bool has_levels(const struct is_gpu *st)
{
    bool some = false;

    for (size_t i = 0; i < st->setup.num_sets; i++)
        some |= st->setup.sets[i].level != NULL;
    return some;
}

static enum pell_result make_buffers(struct is_gpu *st, const struct pell_frame_shape *shape)
{
    const struct is_setup *setup = &st->setup;
    const uint64_t pixels = (uint64_t) ((shape->width + IS_BLOCK - 1) / IS_BLOCK * IS_BLOCK) * (uint64_t) shape->height;
    const uint64_t views = (uint64_t) setup->work.num_views, texels = (uint64_t) setup->knobs.view_size * (uint64_t) setup->knobs.view_size;
    uint64_t profiles = 0, levels = 0;
    enum pell_result res = PELL_OK;

    for (size_t i = 0; i < setup->num_sets; i++)
        if (setup->sets[i].owned) {
            profiles += profiles_of(&setup->sets[i]);
            levels += setup->sets[i].level != NULL;
        }
    st->sizes[SETS] = 4 * (SET_WORDS * (uint64_t) setup->num_sets + LEVEL_WORDS * IS_LEVELS * levels);
    st->sizes[OFFSETS] = 16 * profiles * samples_of(st);
    st->sizes[ROWS] = 32 * profiles * IS_ROWS;
    st->sizes[VIEWS] = 4 * VIEW_FLOATS * views;
    st->sizes[LIGHTS] = 4 * IS_TEXEL * texels * views;
    for (int i = BASE; i < BUFFERS; i++)
        st->sizes[i] = pixels * (uint64_t) buffer_rows[i].pixel_bytes;
    if (is_adapts(&setup->knobs)) /* two more rows: for a remainder, and because the grid's first row may be anywhere in a region */
        st->sizes[REGIONS] = 4 + 4 * (pixels / (uint64_t) shape->height / IS_REGION_X) * ((uint64_t) shape->height / IS_REGION_Y + 2);
    if (!has_levels(st))
        st->sizes[BASE] = 0;
    if (!setup->solids)
        st->sizes[SOLIDS] = 0;
    if (!setup->work.reconstruct)
        st->sizes[RESULT] = 0;
    for (int i = 0; i < TEXELS; i += 2)
        st->sizes[i] = st->sizes[i + 1];
    for (int i = 0; res == PELL_OK && i < BUFFERS; i++)
        if (st->sizes[i] > 0)
            res = pell_gpu_buffer_create(setup->services->gpu, buffer_rows[i].memory, st->sizes[i], buffer_rows[i].name, &st->buffers[i]);
    return res;
}

/* An unused binding of a pass gets another buffer. */
static struct pell_gpu_buffer *buffer_of(const struct is_gpu *st, enum buffer which)
{
    return which == LIGHT         ? pell_gpu_planes_buffer(&st->planes, PELL_GPU_PLANE_LIGHT)
           : which == SURFACE     ? pell_gpu_planes_buffer(&st->planes, PELL_GPU_PLANE_SURFACE)
           : st->sizes[which] > 0 ? st->buffers[which]
                                  : st->buffers[SETS];
}

static enum pell_result make_passes(struct is_gpu *st)
{
    const uint32_t views = st->setup.work.num_views > 0;
    enum pell_result res = PELL_OK;

    for (int i = 0; res == PELL_OK && i < PASSES; i++) {
        struct pell_gpu_buffer *buffers[PELL_COUNT(pass_rows[i].buffers)];

        if ((i == REBUILD && !st->setup.work.reconstruct) || ((i == ADAPT || i == CHOOSE) && !is_adapts(&st->setup.knobs)))
            continue;
        for (size_t k = 0; k < PELL_COUNT(buffers); k++)
            buffers[k] = buffer_of(st, pass_rows[i].buffers[k]);
        res = pell_gpu_pass_create(st->setup.services->gpu, pass_rows[i].shader, &views, i == GATHER ? 1 : 0, buffers, &st->passes[i]);
    }
    return res;
}

/* --- Frame-independent data ------------------------------------------------------------------------------------------------------ */

/* Offsets of a set's parts, in elements of the buffer that holds them. */
struct set_offsets {
    uint32_t offsets, rows, levels;
};

static void fill_offsets(const struct is_gpu *st, const struct is_set *set, uint32_t at)
{
    const size_t n = (size_t) st->setup.work.tile, samples = (size_t) st->setup.work.samples_row;
    float *offset = (float *) pell_gpu_buffer_host(st->buffers[OFFSETS_UP]) + 4 * (size_t) at;

    for (size_t row = 0; row < profiles_of(set) * n * samples; row++) /* of the tile, and one sample */
        for (size_t x = 0; x < n; x++) {
            for (size_t c = 0; c < 3; c++)
                offset[c] = set->offset[(row * 3 + c) * IS_BLOCK + x];
            offset[3] = 0.0f;
            offset += 4;
        }
}

/* Offsets of all sets, in the order of fill_tables. */
static void fill_all_offsets(const struct is_gpu *st)
{
    const struct is_setup *s = &st->setup;
    uint32_t at = 0;

    for (size_t i = 0; i < s->num_sets; i++)
        if (s->sets[i].owned) {
            fill_offsets(st, &s->sets[i], at);
            at += (uint32_t) (profiles_of(&s->sets[i]) * samples_of(st));
        }
}

static void fill_rows(const struct is_gpu *st, const struct is_set *set, uint32_t at)
{
    float *rows = (float *) pell_gpu_buffer_host(st->buffers[ROWS_UP]) + 4 * (size_t) at;

    memcpy(rows, set->rows, profiles_of(set) * IS_ROWS * sizeof(*set->rows));
}

static void fill_levels(const struct is_gpu *st, const struct is_set *set, const struct set_offsets *at)
{
    float *to = (float *) pell_gpu_buffer_host(st->buffers[SETS_UP]) + 4 * (size_t) at->levels;

    for (int i = 0; i < IS_LEVELS; i++, to += LEVEL_WORDS) {
        const float *from = set->level[i];
        const float row[LEVEL_WORDS] = { from[IS_UNIFORM_AT], from[IS_BROAD2_AT],      from[IS_REACH2_AT],
                                         from[IS_QUARTER_AT], from[IS_QUARTER_AT + 1], from[IS_QUARTER_AT + 2] };
        memcpy(to, row, sizeof(row));
    }
}

/* In the order of points.glsl. */
static void fill_set(const struct is_set *set, const struct set_offsets *at, uint32_t *to)
{
    const float first[4] = { set->per_length2, set->reach2, set->uniform, set->broad2 };

    memset(to, 0, SET_WORDS * sizeof(*to));
    memcpy(to, first, sizeof(first));
    memcpy(to + 4, set->scale, sizeof(set->scale));
    to[7] = at->offsets;
    memcpy(to + 8, set->quarter, sizeof(set->quarter));
    to[11] = at->rows;
    to[12] = set->level ? at->levels : UINT32_MAX;
    memcpy(to + 13, &set->median, sizeof(set->median));
}

static enum pell_result fill_tables(const struct is_gpu *st)
{
    const struct is_setup *s = &st->setup;
    uint32_t *sets = pell_gpu_buffer_host(st->buffers[SETS_UP]);
    struct set_offsets *at = pell_calloc(st->ctx, s->num_sets, sizeof(*at));
    struct set_offsets next = { .levels = (uint32_t) s->num_sets * (SET_WORDS / 4) };

    if (!at)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < s->num_sets; i++) {
        const struct is_set *set = &s->sets[i];
        if (set->owned) {
            at[i] = next;
            fill_rows(st, set, next.rows);
            if (set->level)
                fill_levels(st, set, &next);
            next.offsets += (uint32_t) (profiles_of(set) * samples_of(st));
            next.rows += (uint32_t) (profiles_of(set) * IS_ROWS * 2);
            next.levels += set->level ? IS_LEVELS * (LEVEL_WORDS / 4) : 0;
        } else {
            for (size_t k = 0; k < i; k++)
                if (s->sets[k].owned && s->sets[k].offset == set->offset)
                    at[i] = at[k];
        }
        fill_set(set, &at[i], sets + i * SET_WORDS);
    }
    fill_all_offsets(st);
    pell_free(st->ctx, at);
    return PELL_OK;
}

/* A texel in the shaders' format: the plane and the key, then the light and h. */
static void fill_lights(const struct is_gpu *st)
{
    const size_t texels = (size_t) st->setup.knobs.view_size * (size_t) st->setup.knobs.view_size;
    float *to = st->setup.work.num_views > 0 ? pell_gpu_buffer_host(st->buffers[LIGHTS_UP]) : NULL;

    for (int v = 0; v < st->setup.work.num_views; v++)
        for (size_t i = 0; i < texels; i++, to += IS_TEXEL) {
            const float *from = st->setup.light_views[v].texels + i * IS_TEXEL;
            const float texel[IS_TEXEL] = { from[IS_W],   from[IS_GU],    from[IS_GV],   from[IS_KEY],
                                            from[IS_RED], from[IS_GREEN], from[IS_BLUE], from[IS_H] };
            memcpy(to, texel, sizeof(texel));
        }
}

static void set_push(struct is_gpu *st, const struct pell_frame_shape *shape)
{
    const struct is_work *w = &st->setup.work;

    st->image_height = shape->height;
    st->push = (struct is_push) {
        .image_width = shape->width,
        .materials = (int32_t) shape->num_materials,
        .orthographic = shape->orthographic,
        .solids = st->setup.solids != NULL,
        .strength = st->setup.knobs.strength,
        .samples = w->counts[IS_CLASS_OF_ALL].samples,
        .row_samples = w->samples_row,
        .adaptive = is_adapts(&st->setup.knobs),
        .halves = st->setup.knobs.sampling == IS_COMBINED || st->setup.knobs.sampling == IS_SEPARATE,
        .importance = w->counts[IS_CLASS_OF_ALL].importance,
        .first_kind = w->first_kind,
        .tile = w->tile,
        .views = w->num_views,
        .view_size = st->setup.knobs.view_size,
        .jacobian = w->inverted ? -1 : w->jacobian,
        .by_weight = w->renormalise == IS_BY_WEIGHT,
        .by_count = w->renormalise == IS_BY_COUNT,
        .factor = w->factor,
        .focal_px = w->focal_px,
        .mid_x = 0.5f * (float) shape->width,
        .mid_y = 0.5f * (float) shape->height,
    };
}

static enum pell_result gpu_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                   void **state)
{
    struct is_gpu *st = pell_zalloc(services->ctx, sizeof(*st));
    enum pell_result res;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->ctx = services->ctx;
    PELL_TRY(is_setup_make(services, shape, knobs, &st->setup));
    PELL_TRY(make_buffers(st, shape));
    PELL_TRY(pell_gpu_planes_make(services, shape, &st->planes));
    PELL_TRY(make_passes(st));
    PELL_TRY(fill_tables(st));
    fill_lights(st);
    set_push(st, shape);
    if (st->setup.solids) {
        st->row_solids = pell_calloc(st->ctx, (size_t) shape->width * (size_t) shape->height, sizeof(*st->row_solids));
        if (!st->row_solids)
            return PELL_ERR_NOMEM;
    }
    return services->planes ? PELL_OK : pell_gpu_commands_create(services->gpu, "image-space", &st->commands);

fail:
    return res;
}

/* --- A frame ------------------------------------------------------------------------------------------------------------------- */

/* Row data that the frame's planes lack: colours, solids. */
static void pack_row(void *state, int row)
{
    struct is_gpu *st = state;
    const struct pell_gpu_planes *p = &st->planes;
    const struct pell_gpu_surface *surface = pell_gpu_planes_surface_row(p, row);
    const int y = p->y0 + row;

    if (st->push.colours) {
        float *to = (float *) pell_gpu_buffer_host(st->buffers[BASE_UP]) + 4 * (ptrdiff_t) row * p->width;
        for (int i = 0; i < p->width; i++)
            for (int c = 0; c < 4; c++)
                *to++ = surface[i].material && c < 3 ? p->in->base[c][y * p->in->shape.stride + p->x0 + i] : 0.0f;
    }
    if (st->setup.solids) {
        int32_t *to = (int32_t *) pell_gpu_buffer_host(st->buffers[SOLIDS_UP]) + (ptrdiff_t) row * p->width;
        int32_t *found = st->row_solids + (ptrdiff_t) y * p->in->shape.width;
        is_find_solids(&st->setup, p->in, y, found);
        for (int i = 0; i < p->width; i++)
            to[i] = surface[i].material ? found[p->x0 + i] : 0;
    }
}

static void pack_views(const struct is_gpu *st)
{
    float *to = st->setup.work.num_views > 0 ? pell_gpu_buffer_host(st->buffers[VIEWS_UP]) : NULL;

    for (int i = 0; i < st->setup.work.num_views; i++, to += VIEW_FLOATS) {
        const struct is_view *v = &st->setup.views[i];
        for (int k = 0; k < 3; k++) {
            memcpy(to + 4 * k, v->rotate[k], sizeof(v->rotate[k]));
            to[4 * k + 3] = v->shift[k];
        }
        to[12] = v->focal_px;
        to[13] = v->centre_px;
        to[14] = v->orthographic;
        to[15] = 0.0f;
    }
}

static void set_grid(struct is_gpu *st)
{
    st->push.x0 = st->planes.x0;
    st->push.y0 = st->planes.y0;
    st->push.width = st->planes.width;
    st->push.height = st->planes.height;
}

/* Uploads buffers from `first` to before `last`, which are pairs. `pixels`: of the grid. */
static void send(struct is_gpu *st, struct pell_gpu_commands *c, int first, int last, uint64_t pixels)
{
    for (int i = first; i < last; i += 2)
        if (st->sizes[i] > 0)
            pell_gpu_copy(c, st->buffers[i], st->buffers[i + 1],
                          buffer_rows[i].pixel_bytes > 0 ? pixels * (uint64_t) buffer_rows[i].pixel_bytes : st->sizes[i]);
}

static void run_pixels(struct is_gpu *st, struct pell_gpu_commands *c, const char *name, enum pass pass)
{
    pell_gpu_mark(c, name);
    pell_gpu_run(c, st->passes[pass], &st->push, pell_gpu_groups(st->push.width, GROUP_X), pell_gpu_groups(st->push.height, GROUP_Y), 1);
}

static void record_passes(struct is_gpu *st, struct pell_gpu_commands *c)
{
    const bool reconstruct = st->setup.work.reconstruct;

    run_pixels(st, c, "load", LOAD);
    if (is_adapts(&st->setup.knobs)) {
        pell_gpu_run(c, st->passes[ADAPT], &st->push, pell_gpu_groups(st->push.width, 8 * IS_REGION_X),
                     pell_gpu_groups(st->push.height + IS_REGION_Y, 8 * IS_REGION_Y), 1);
        pell_gpu_run(c, st->passes[CHOOSE], &st->push, 1, 1, 1);
    }
    run_pixels(st, c, "sample", GATHER);
    if (reconstruct)
        run_pixels(st, c, "reconstruct", REBUILD);
}

static enum buffer result_of(const struct is_gpu *st)
{
    return st->setup.work.reconstruct ? RESULT : M;
}

static void record_download(struct is_gpu *st, struct pell_gpu_commands *c)
{
    pell_gpu_mark(c, "download");
    pell_gpu_planes_download(&st->planes, c, st->buffers[result_of(st)]);
}

/* --- Device to device ---------------------------------------------------------------------------------------------------------------- */

/* The grid covers the whole image. Tables are uploaded every time, because earlier command lists may not have run. */
static void gpu_record_in(void *state, struct pell_gpu_commands *commands, float depth, float strength)
{
    struct is_gpu *st = state;

    (void) depth, (void) strength;
    pell_gpu_planes_whole(&st->planes, st->push.image_width, st->image_height);
    set_grid(st);
    st->sent = false;
    send(st, commands, SETS_UP, LIGHTS_UP, 0);
    record_passes(st, commands);
    if (st->setup.services->planes)
        record_download(st, commands);
}

static bool gpu_planes(const void *state, struct pell_gpu_buffer *planes[PELL_GPU_PLANES])
{
    const struct is_gpu *st = state;

    planes[PELL_GPU_PLANE_LIGHT] = buffer_of(st, LIGHT);
    planes[PELL_GPU_PLANE_SURFACE] = buffer_of(st, SURFACE);
    planes[PELL_GPU_PLANE_RESULT] = st->buffers[result_of(st)];
    planes[PELL_GPU_PLANE_BASE] = st->sizes[BASE] > 0 ? st->buffers[BASE] : NULL;
    return !st->setup.solids;
}

/* Selects the frame's patterns. */
static enum pell_result turn_to(struct is_gpu *st, const struct pell_frame *in)
{
    const enum pell_result res = is_setup_frame(&st->setup, in);

    if (res == PELL_OK && st->setup.image_index != st->packed_image)
        fill_all_offsets(st);
    st->packed_image = st->setup.image_index;
    st->push.mid_x = st->setup.work.mid_x;
    st->push.mid_y = st->setup.work.mid_y;
    return res;
}

static enum pell_result gpu_prepare(void *state, const struct pell_frame *in)
{
    struct is_gpu *st = state;

    st->push.colours = st->sizes[BASE] > 0;
    st->planes.num_times = 0;
    return turn_to(st, in);
}

/* --- Host planes --------------------------------------------------------------------------------------------------------------------- */

static int bytes_of(const char *mark)
{
    return !strcmp(mark, "upload")        ? 48
           : !strcmp(mark, "load")        ? 24 + 4 * IS_TEXEL
           : !strcmp(mark, "sample")      ? 4 * IS_TEXEL + 8 + 32
           : !strcmp(mark, "reconstruct") ? 4 * IS_TEXEL /* lines hold both halves */ + 32 + 16
                                          : 32;
}

static enum pell_result run_list(struct is_gpu *st)
{
    struct pell_gpu_commands *c = st->commands;
    const uint64_t pixels = (uint64_t) st->push.width * (uint64_t) st->push.height;
    enum pell_result res;

    PELL_TRY(pell_gpu_begin(c));
    pell_gpu_mark(c, "upload");
    if (!st->sent)
        send(st, c, SETS_UP, VIEWS_UP, 0);
    else if (st->sent_image != st->setup.image_index)
        send(st, c, OFFSETS_UP, ROWS_UP, 0);
    send(st, c, VIEWS_UP, st->push.colours ? SOLIDS_UP : BASE_UP, pixels);
    send(st, c, SOLIDS_UP, TEXELS, pixels);
    pell_gpu_planes_upload(&st->planes, c);
    record_passes(st, c);
    record_download(st, c);
    PELL_TRY(pell_gpu_finish(c));
    st->sent = true;
    st->sent_image = st->setup.image_index;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result gpu_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct is_gpu *st = state;
    int64_t pixels;
    enum pell_result res;

    PELL_TRY(turn_to(st, in));
    st->push.colours = st->sizes[BASE] > 0 && in->base[0] && in->base[1] && in->base[2];
    pixels = pell_gpu_planes_pack(&st->planes, in, in->irradiance, in->strength, pack_row, st);
    pack_views(st);
    set_grid(st);
    res = pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
    if (res != PELL_OK)
        return res;
    PELL_TRY(run_list(st));
    pell_gpu_planes_unpack(&st->planes, out->light);
    pell_gpu_planes_note(&st->planes, st->commands, pixels, bytes_of);
    return pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}

static const struct pell_thickness_table *thickness(const void *state, size_t material)
{
    return is_setup_thickness(&((const struct is_gpu *) state)->setup, material);
}

static size_t times(const void *state, struct pell_pass_time *list, size_t size)
{
    return pell_gpu_planes_times(&((const struct is_gpu *) state)->planes, list, size);
}

const struct pell_method_engine pell_is_vulkan = {
    .create = gpu_create,
    .record = gpu_render,
    .destroy = gpu_destroy,
    .record_in = gpu_record_in,
    .planes = gpu_planes,
    .prepare = gpu_prepare,
    .thickness = thickness,
    .times = times,
};
