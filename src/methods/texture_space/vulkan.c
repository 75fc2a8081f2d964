/* SPDX-License-Identifier: MIT
 *
 * vulkan.c - a solid's map on a Vulkan device: uploads its layout, the irradiance and the list of texels that receive transmitted light,
 * runs all blurs there, and downloads the map. The shaders mirror the kernels of the cpu engine; README.md has the mathematics.
 */
#include "methods/gpu_planes.h"
#include "methods/texture_space/push.h"
#include "methods/texture_space/read_gpu.h"
#include "methods/texture_space/state.h"

#include "render/engine.h"

#include <string.h>

enum { LIST_GROUP = 64, LISTS_ACROSS = 32768, CHUNK = 16384, NOTES = PELL_GPU_MARKS - 1 };

/* --- Buffers and passes -------------------------------------------------------------------------------------------------------------- */

/* The first of each pair is written by the host and copied to the second. */
enum buffer {
    ALONG_X_UP,
    ALONG_X,
    ALONG_Y_UP,
    ALONG_Y,
    TILTS_UP,
    TILTS,
    CELLS_UP,
    CELLS,
    FILLS_UP,
    FILLS,
    SOURCES_UP,
    SOURCES,
    STRETCH_UP,
    STRETCH,
    TABLE_UP,
    TABLE,
    TEXELS_UP,
    TEXELS,
    LIGHT_UP,
    NOW,
    HALF,
    STRETCH_HALF, /* HALF for the stretch */
    SUM,
    TRANSMITTED,
    WEIGHTS,
    RESULT,
    BUFFERS
};

enum count { OF_TEXEL, OF_CELL, OF_FILL, OF_SOURCE, OF_TABLE, OF_LIST, COUNTS };

static const struct {
    const char *name;
    enum count of;
    int bytes; /* per element */
    enum pell_gpu_memory memory;
} buffer_rows[BUFFERS] = {
    [ALONG_X_UP] = { "texture-space lengths along x, upload", OF_TEXEL, 8, PELL_GPU_TO_DEVICE },
    [ALONG_X] = { "texture-space lengths along x", OF_TEXEL, 8, PELL_GPU_ON_DEVICE },
    [ALONG_Y_UP] = { "texture-space lengths along y, upload", OF_TEXEL, 8, PELL_GPU_TO_DEVICE },
    [ALONG_Y] = { "texture-space lengths along y", OF_TEXEL, 8, PELL_GPU_ON_DEVICE },
    [TILTS_UP] = { "texture-space tilts, upload", OF_TEXEL, 8, PELL_GPU_TO_DEVICE },
    [TILTS] = { "texture-space tilts", OF_TEXEL, 8, PELL_GPU_ON_DEVICE },
    [CELLS_UP] = { "texture-space blocks, upload", OF_CELL, 32, PELL_GPU_TO_DEVICE },
    [CELLS] = { "texture-space blocks", OF_CELL, 32, PELL_GPU_ON_DEVICE },
    [FILLS_UP] = { "texture-space borders, upload", OF_FILL, 16, PELL_GPU_TO_DEVICE },
    [FILLS] = { "texture-space borders", OF_FILL, 16, PELL_GPU_ON_DEVICE },
    [SOURCES_UP] = { "texture-space sources, upload", OF_SOURCE, 8, PELL_GPU_TO_DEVICE },
    [SOURCES] = { "texture-space sources", OF_SOURCE, 8, PELL_GPU_ON_DEVICE },
    [STRETCH_UP] = { "texture-space stretch, upload", OF_TEXEL, 8, PELL_GPU_TO_DEVICE },
    [STRETCH] = { "texture-space stretch", OF_TEXEL, 8, PELL_GPU_ON_DEVICE },
    [TABLE_UP] = { "texture-space slab, upload", OF_TABLE, 16, PELL_GPU_TO_DEVICE },
    [TABLE] = { "texture-space slab", OF_TABLE, 16, PELL_GPU_ON_DEVICE },
    [TEXELS_UP] = { "texture-space transmission, upload", OF_LIST, (int) sizeof(struct ts_entry), PELL_GPU_TO_DEVICE },
    [TEXELS] = { "texture-space transmission", OF_LIST, (int) sizeof(struct ts_entry), PELL_GPU_ON_DEVICE },
    [LIGHT_UP] = { "texture-space light, upload", OF_TEXEL, 16, PELL_GPU_TO_DEVICE },
    [NOW] = { "texture-space now", OF_TEXEL, 16, PELL_GPU_ON_DEVICE },
    [HALF] = { "texture-space half", OF_TEXEL, 16, PELL_GPU_ON_DEVICE },
    [STRETCH_HALF] = { "texture-space stretch, half", OF_TEXEL, 8, PELL_GPU_ON_DEVICE },
    [SUM] = { "texture-space sum", OF_TEXEL, 16, PELL_GPU_ON_DEVICE },
    [TRANSMITTED] = { "texture-space transmitted", OF_TEXEL, 16, PELL_GPU_ON_DEVICE },
    [WEIGHTS] = { "texture-space weights", OF_LIST, 16, PELL_GPU_ON_DEVICE },
    [RESULT] = { "texture-space map", OF_TEXEL, 16, PELL_GPU_FROM_DEVICE },
};

extern const struct pell_shader pell_texture_space_clear_shader, pell_texture_space_blur_shader, pell_texture_space_seven_taps_shader,
    pell_texture_space_fill_shader, pell_texture_space_add_shader, pell_texture_space_transmission_weights_shader,
    pell_texture_space_transmit_shader;

enum pass { CLEAR, ACROSS, DOWN, SEVEN_ACROSS, SEVEN_DOWN, FILL_NOW, FILL_SUM, ADD, WEIGH, TRANSMIT, TRANSMIT_SHARP, PASSES };

static const struct {
    const struct pell_shader *shader;
    enum buffer buffers[6]; /* in the order of its bindings */
    uint32_t axis;
} pass_rows[PASSES] = {
    [CLEAR] = { &pell_texture_space_clear_shader, { ALONG_X, SUM, TRANSMITTED }, 0 },
    [ACROSS] = { &pell_texture_space_blur_shader, { ALONG_X, TILTS, CELLS, NOW, HALF, SUM }, 0 },
    [DOWN] = { &pell_texture_space_blur_shader, { ALONG_Y, TILTS, CELLS, HALF, NOW, SUM }, 1 },
    [SEVEN_ACROSS] = { &pell_texture_space_seven_taps_shader, { ALONG_X, NOW, STRETCH, HALF, STRETCH_HALF, SUM }, 0 },
    [SEVEN_DOWN] = { &pell_texture_space_seven_taps_shader, { ALONG_X, HALF, STRETCH_HALF, NOW, STRETCH, SUM }, 1 },
    [FILL_NOW] = { &pell_texture_space_fill_shader, { FILLS, SOURCES, NOW }, 0 },
    [FILL_SUM] = { &pell_texture_space_fill_shader, { FILLS, SOURCES, SUM }, 0 },
    [ADD] = { &pell_texture_space_add_shader, { NOW, SUM }, 0 },
    [WEIGH] = { &pell_texture_space_transmission_weights_shader, { TEXELS, NOW, TABLE, WEIGHTS }, 0 },
    [TRANSMIT] = { &pell_texture_space_transmit_shader, { TEXELS, WEIGHTS, ALONG_X, NOW, TRANSMITTED }, 0 },
    [TRANSMIT_SHARP] = { &pell_texture_space_transmit_shader, { TEXELS, WEIGHTS, ALONG_X, NOW, SUM }, 0 },
};

struct ts_device {
    struct pell_gpu_buffer *buffers[BUFFERS];
    struct pell_gpu_pass *passes[PASSES];
    struct pell_gpu_commands *commands;
    bool open; /* a command list is being recorded */
    size_t counts[COUNTS];
    struct ts_push push;
    const struct ts_atlas *held; /* the atlas on the device, with the lengths of these positions */
    uint64_t positions;
    struct {
        const char *name;
        int64_t texels, bytes;
    } notes[NOTES]; /* of the command list's marks */
    size_t num_notes;
};

static void close_buffers(struct ts_device *d, enum count of, bool all)
{
    for (int i = 0; i < PASSES; i++)
        pell_gpu_pass_destroy(&d->passes[i]);
    for (int i = 0; i < BUFFERS; i++)
        if (all || buffer_rows[i].of == of)
            pell_gpu_buffer_destroy(&d->buffers[i]);
}

static void forget(struct ts_state *st)
{
    struct ts_device *d = st->device;

    if (!d)
        return;
    pell_gpu_commands_destroy(&d->commands);
    close_buffers(d, OF_TEXEL, true);
    pell_free(st->ctx, d);
    st->device = NULL;
}

static bool is_needed(const struct ts_state *st, enum buffer which)
{
    const bool seven = which == STRETCH || which == STRETCH_UP || which == STRETCH_HALF;

    return !seven || st->knobs.kernel == TS_KERNEL_SEVEN;
}

/* Creates the missing buffers. */
static enum pell_result make_buffers(struct ts_state *st, struct ts_device *d)
{
    enum pell_result res = PELL_OK;

    for (int i = 0; i < BUFFERS && res == PELL_OK; i++)
        if (!d->buffers[i] && is_needed(st, i))
            res = pell_gpu_buffer_create(st->services->gpu, buffer_rows[i].memory,
                                         (uint64_t) d->counts[buffer_rows[i].of] * (uint64_t) buffer_rows[i].bytes, buffer_rows[i].name,
                                         &d->buffers[i]);
    return res;
}

static enum pell_result make_passes(struct ts_state *st, struct ts_device *d)
{
    enum pell_result res = PELL_OK;

    for (int i = 0; i < PASSES && res == PELL_OK; i++) {
        const bool has_axis = i >= ACROSS && i <= SEVEN_DOWN, seven = i == SEVEN_ACROSS || i == SEVEN_DOWN;
        struct pell_gpu_buffer *buffers[PELL_COUNT(pass_rows[i].buffers)];
        if (has_axis && seven != (st->knobs.kernel == TS_KERNEL_SEVEN))
            continue;
        for (size_t k = 0; k < PELL_COUNT(buffers); k++)
            buffers[k] = d->buffers[pass_rows[i].buffers[k]];
        res = pell_gpu_pass_create(st->services->gpu, pass_rows[i].shader, &pass_rows[i].axis, has_axis, buffers, &d->passes[i]);
    }
    return res;
}

static size_t larger(size_t a, size_t b)
{
    return a > b ? a : b;
}

static size_t count_sources(const struct ts_atlas *a)
{
    size_t count = 0;

    for (size_t i = 0; i < a->num_borders; i++)
        if (a->fills[i].sources > 0)
            count = larger(count, (size_t) a->fills[i].from + a->fills[i].sources);
    return count;
}

/* Buffers fit the largest layout; the list of transmission grows. */
static enum pell_result open_device(struct ts_state *st)
{
    struct ts_device *d = pell_zalloc(st->ctx, sizeof(*d));
    enum pell_result res;

    if (!d)
        return PELL_ERR_NOMEM;
    st->device = d;
    for (int k = 0; k < COUNTS; k++)
        d->counts[k] = k == OF_TABLE ? TS_LEVELS * TS_THICK : 1;
    for (size_t i = 0; i < st->num_solids; i++) {
        const struct ts_atlas *a = st->solid[i].atlas;
        if (!a)
            continue;
        d->counts[OF_TEXEL] = larger(d->counts[OF_TEXEL], a->size);
        d->counts[OF_CELL] = larger(d->counts[OF_CELL], (size_t) a->blocks * (size_t) a->height);
        d->counts[OF_FILL] = larger(d->counts[OF_FILL], a->num_borders);
        d->counts[OF_SOURCE] = larger(d->counts[OF_SOURCE], count_sources(a));
    }
    PELL_TRY(make_buffers(st, d));
    PELL_TRY(make_passes(st, d));
    PELL_TRY(pell_gpu_commands_create(st->services->gpu, "texture-space", &d->commands));
    return PELL_OK;

fail:
    forget(st);
    return res;
}

static enum pell_result make_room(struct ts_state *st, size_t count)
{
    struct ts_device *d = st->device;
    enum pell_result res;

    if (count <= d->counts[OF_LIST])
        return PELL_OK;
    close_buffers(d, OF_LIST, false);
    d->counts[OF_LIST] = count + count / 4;
    PELL_TRY(make_buffers(st, d));
    PELL_TRY(make_passes(st, d));
    return PELL_OK;

fail:
    forget(st);
    return res;
}

/* --- Command lists ------------------------------------------------------------------------------------------------------------------- */

static enum pell_result open_list(struct ts_device *d)
{
    enum pell_result res;

    if (d->open)
        return PELL_OK;
    res = pell_gpu_begin(d->commands);
    if (res != PELL_OK)
        return res;
    d->open = true;
    d->num_notes = 0;
    pell_gpu_mark(d->commands, "texture-space");
    return PELL_OK;
}

static void take_note(struct ts_device *d, const char *name, int64_t texels, int64_t bytes)
{
    if (d->num_notes == NOTES)
        return;
    d->notes[d->num_notes].name = name;
    d->notes[d->num_notes].texels = texels;
    d->notes[d->num_notes++].bytes = bytes;
    pell_gpu_mark(d->commands, "texture-space");
}

/* Runs the list and adds its times. The work before it ran on the host. */
static enum pell_result close_list(struct ts_state *st)
{
    struct ts_device *d = st->device;
    struct pell_gpu_time times[PELL_GPU_MARKS];
    enum pell_result res;
    size_t count;

    if (!d->open)
        return PELL_OK;
    d->open = false;
    ts_note_time(st, "pack", 0, 0, 0);
    PELL_TRY(pell_gpu_finish(d->commands));
    count = pell_gpu_times(d->commands, times, PELL_COUNT(times));
    for (size_t i = 0; i < count && i < d->num_notes; i++)
        ts_add_time(st,
                    &(struct pell_pass_time) {
                        .name = d->notes[i].name, .seconds = times[i].seconds, .pixels = d->notes[i].texels, .bytes = d->notes[i].bytes });
    st->clock = pell_seconds();

fail:
    return res;
}

static void upload(struct ts_device *d, enum buffer from, size_t count)
{
    pell_gpu_copy(d->commands, d->buffers[from], d->buffers[from + 1], (uint64_t) count * (uint64_t) buffer_rows[from].bytes);
}

static void run_texels(struct ts_device *d, enum pass pass)
{
    const uint32_t *group = pass_rows[pass].shader->local;

    pell_gpu_run(d->commands, d->passes[pass], &d->push, pell_gpu_groups(d->push.stride, (int) group[0]),
                 pell_gpu_groups(d->push.height, (int) group[1]), 1);
}

static void run_entries(struct ts_device *d, enum pass pass, size_t count)
{
    const uint32_t groups = pell_gpu_groups((int64_t) count, LIST_GROUP), across = groups < LISTS_ACROSS ? groups : LISTS_ACROSS;

    d->push.count = (int32_t) count;
    if (count > 0)
        pell_gpu_run(d->commands, d->passes[pass], &d->push, across, pell_gpu_groups(groups, (int) across), 1);
}

/* --- Transfers ----------------------------------------------------------------------------------------------------------------------- */

struct packing {
    const struct ts_state *st;
    const struct ts_atlas *atlas;
    float *const *planes; /* of light */
    int count;
    bool scaled; /* by strength */
    float *map;  /* downloaded map */
};

static int chunks_of(size_t count)
{
    return (int) ((count + CHUNK - 1) / CHUNK);
}

static size_t chunk_end(size_t count, int chunk)
{
    const size_t end = (size_t) (chunk + 1) * CHUNK;

    return end < count ? end : count;
}

/* Interleaves two planes, which begin at texel (0, 0). */
static void pack_pairs(void *to, const float *first, const float *second, size_t from, size_t end)
{
    float *pair = (float *) to + 2 * from;

    for (size_t i = from; i < end; i++) {
        *pair++ = first[(ptrdiff_t) i - TS_MARGIN];
        *pair++ = second[(ptrdiff_t) i - TS_MARGIN];
    }
}

static void pack_stretch(const struct ts_state *st, const struct ts_atlas *a, float *to, size_t from, size_t end)
{
    for (size_t k = from; k < end; k++)
        ts_stretch(st, a, (ptrdiff_t) k - TS_MARGIN, to + 2 * k);
}

static void pack_layout(void *arg, int chunk, int worker)
{
    const struct packing *p = arg;
    const struct ts_state *st = p->st;
    const struct ts_device *d = st->device;
    const size_t from = (size_t) chunk * CHUNK, end = chunk_end(p->atlas->size, chunk);

    (void) worker;
    pack_pairs(pell_gpu_buffer_host(d->buffers[ALONG_X_UP]), p->atlas->key, st->work.length[0], from, end);
    pack_pairs(pell_gpu_buffer_host(d->buffers[ALONG_Y_UP]), p->atlas->key, st->work.length[1], from, end);
    pack_pairs(pell_gpu_buffer_host(d->buffers[TILTS_UP]), st->work.tilt[0], st->work.tilt[1], from, end);
}

static void pack_cells(const struct ts_state *st, const struct ts_atlas *a, float *to)
{
    for (size_t i = 0; i < (size_t) a->blocks * (size_t) a->height; i++) {
        const struct ts_cell *c = &st->work.cells[i];
        const float words[8] = { c->least[0], c->least[1], c->most[0], c->most[1], c->skew, (float) c->near, 0.0f, 0.0f };
        memcpy(to + 8 * i, words, sizeof(words));
    }
}

static void pack_table(const struct ts_profile *profile, float *to)
{
    for (int row = 0; row < TS_THICK; row++)
        for (int level = 0; level < TS_LEVELS; level++)
            for (int c = 0; c < 4; c++)
                *to++ = profile->slab && c < 3 && level < profile->count ? profile->fraction[row][level][c] : 0.0f;
}

/* Uploads the layout with its borders, and the profile. */
static void send_layout(struct ts_state *st, const struct ts_solid *solid)
{
    struct ts_device *d = st->device;
    const struct ts_atlas *a = solid->atlas;
    struct packing task = { .st = st, .atlas = a };
    const size_t sources = count_sources(a);

    pell_pool_run(st->pool, chunks_of(a->size), pack_layout, &task);
    pack_cells(st, a, pell_gpu_buffer_host(d->buffers[CELLS_UP]));
    memcpy(pell_gpu_buffer_host(d->buffers[FILLS_UP]), a->fills, a->num_borders * sizeof(*a->fills));
    if (sources > 0)
        memcpy(pell_gpu_buffer_host(d->buffers[SOURCES_UP]), a->sources, sources * sizeof(*a->sources));
    pack_table(solid->profile, pell_gpu_buffer_host(d->buffers[TABLE_UP]));
    upload(d, ALONG_X_UP, a->size);
    upload(d, ALONG_Y_UP, a->size);
    upload(d, TILTS_UP, a->size);
    upload(d, CELLS_UP, (size_t) a->blocks * (size_t) a->height);
    if (a->num_borders > 0)
        upload(d, FILLS_UP, a->num_borders);
    if (sources > 0)
        upload(d, SOURCES_UP, sources);
    upload(d, TABLE_UP, TS_LEVELS * TS_THICK);
    take_note(d, "upload", (int64_t) a->size, (int64_t) a->size * 48);
}

static enum pell_result begin(struct ts_state *st, const struct ts_solid *solid)
{
    const struct ts_atlas *a = solid->atlas;
    const bool scaled = st->work.length[0] != a->length[0];
    struct ts_device *d;
    enum pell_result res;

    if (!st->device)
        PELL_TRY(open_device(st));
    d = st->device;
    d->push = (struct ts_push) {
        .width = a->width,
        .height = a->height,
        .blocks = a->blocks,
        .stride = (int32_t) a->stride,
        .origin = TS_MARGIN,
        .tilts = st->work.tilts,
        .read_variance = st->work.read_variance,
        .linear = st->knobs.fade == TS_FADE_LINEAR,
        .slab = solid->profile->slab,
        .widest = (float) solid->profile->widest,
        .thickest = (float) solid->profile->thickest,
    };
    PELL_TRY(open_list(d));
    if (d->held != a || d->positions != a->positions || scaled)
        send_layout(st, solid);
    d->held = NULL; /* until the upload is complete */
    run_texels(d, CLEAR);
    take_note(d, "clear", a->inner, a->inner * 40);
    PELL_TRY(close_list(st));
    d->held = a;
    d->positions = a->positions;

fail:
    return res;
}

static void pack_light(void *arg, int chunk, int worker)
{
    const struct packing *p = arg;
    const struct ts_device *d = p->st->device;
    const size_t from = (size_t) chunk * CHUNK, end = chunk_end(p->atlas->size, chunk);
    float *to = (float *) pell_gpu_buffer_host(d->buffers[LIGHT_UP]) + 4 * from;

    (void) worker;
    for (size_t i = from; i < end; i++)
        for (int c = 0; c < 4; c++)
            *to++ = c < p->count ? p->planes[c][(ptrdiff_t) i - TS_MARGIN] : 0.0f;
}

static void pack_texels(void *arg, int chunk, int worker)
{
    const struct packing *p = arg;
    const struct ts_state *st = p->st;
    const struct ts_device *d = st->device;
    struct ts_entry *to = pell_gpu_buffer_host(d->buffers[TEXELS_UP]);
    const size_t end = chunk_end(st->tsm.count, chunk);

    (void) worker;
    for (size_t i = (size_t) chunk * CHUNK; i < end; i++) {
        const struct ts_transmitted_texel *t = &st->tsm.texels[i];
        const struct ts_bilinear second = t->second_weight > 0.0f ? t->second : t->from;
        to[i] = (struct ts_entry) {
            .at = t->at,
            .from = t->from.at,
            .second = second.at,
            .from_key = t->from.key,
            .from_x = t->from.fx,
            .from_y = t->from.fy,
            .second_key = second.key,
            .second_x = second.fx,
            .second_y = second.fy,
            .second_weight = t->second_weight,
            .surface_distance = t->surface_distance,
            .m = t->m,
            .opposed = t->opposed,
            .along_surface = t->along_surface,
            .remaining_r = t->remaining[0],
            .remaining_g = t->remaining[1],
            .remaining_b = t->remaining[2],
            .strength = p->scaled ? st->strength[t->at] : 1.0f,
        };
    }
}

static enum pell_result start(struct ts_blurring *p, bool transmitted, int planes)
{
    struct ts_state *st = p->st;
    const struct ts_atlas *a = p->solid->atlas;
    struct packing task = { .st = st, .atlas = a, .planes = st->light, .count = planes, .scaled = p->scaled };
    const size_t count = planes > 3 ? st->tsm.count : 0;
    struct ts_device *d;
    enum pell_result res;

    p->now = st->now; /* if it is inspected */
    PELL_TRY(make_room(st, count));
    d = st->device;
    if (!transmitted)
        pell_pool_run(st->pool, chunks_of(a->size), pack_light, &task);
    if (count > 0)
        pell_pool_run(st->pool, chunks_of(count), pack_texels, &task);
    if (st->work.seven)
        pack_stretch(st, a, pell_gpu_buffer_host(d->buffers[STRETCH_UP]), 0, a->size);
    PELL_TRY(open_list(d));
    if (transmitted)
        pell_gpu_copy(d->commands, d->buffers[TRANSMITTED], d->buffers[NOW], (uint64_t) a->size * 16);
    else
        upload(d, LIGHT_UP, a->size);
    if (count > 0)
        upload(d, TEXELS_UP, count);
    if (st->work.seven)
        upload(d, STRETCH_UP, a->size);
    take_note(d, "upload", (int64_t) a->size, (int64_t) a->size * 32 + (int64_t) count * 2 * (int64_t) sizeof(struct ts_entry));
    return PELL_OK;

fail:
    return res;
}

/* --- Passes -------------------------------------------------------------------------------------------------------------------------- */

static void fill(struct ts_blurring *p, int planes, int far)
{
    struct ts_device *d = p->st->device;

    (void) planes;
    d->push.far = far;
    d->push.keep = 0;
    run_entries(d, FILL_NOW, p->solid->atlas->num_borders);
}

static void set_weight(struct ts_push *push, const double weight[3])
{
    push->add = weight != NULL;
    push->weight_r = weight ? (float) weight[0] : 0.0f;
    push->weight_g = weight ? (float) weight[1] : 0.0f;
    push->weight_b = weight ? (float) weight[2] : 0.0f;
}

static void transmission_weights(struct ts_blurring *p)
{
    struct ts_device *d = p->st->device;
    const struct ts_profile *profile = p->solid->profile;

    d->push.level = p->level;
    d->push.variance = (float) profile->variance[p->level];
    d->push.reach = TS_FADE_REACH * (float) sqrt(profile->variance[p->level]);
    set_weight(&d->push, profile->weight[p->level]);
    run_entries(d, WEIGH, p->st->tsm.count);
}

static void transmit(struct ts_blurring *p)
{
    run_entries(p->st->device, p->st->knobs.soften ? TRANSMIT : TRANSMIT_SHARP, p->st->tsm.count);
}

static void blur(struct ts_blurring *p, const struct ts_blur *b, int blurred)
{
    struct ts_device *d = p->st->device;
    const bool seven = p->st->work.seven;

    d->push.before = (float) b->before;
    d->push.after = (float) b->after;
    set_weight(&d->push, b->weight);
    d->push.near = blurred;
    run_texels(d, seven ? SEVEN_ACROSS : ACROSS);
    d->push.near = 0;
    run_texels(d, seven ? SEVEN_DOWN : DOWN);
}

static void add(struct ts_blurring *p, const double weight[3])
{
    struct ts_device *d = p->st->device;

    set_weight(&d->push, weight);
    run_texels(d, ADD);
}

/* Buffers hold four components, and lengths are read together with them. */
static void note(struct ts_state *st, const char *name, int64_t texels, int planes)
{
    (void) planes;
    take_note(st->device, name, texels, texels * 64);
}

static enum pell_result inspect(struct ts_blurring *p, bool sum)
{
    struct ts_state *st = p->st;
    struct ts_device *d = st->device;
    const struct ts_atlas *a = p->solid->atlas;
    float *const *to = sum ? st->sum : st->now;
    const float *from;
    enum pell_result res;

    PELL_TRY(open_list(d));
    pell_gpu_copy(d->commands, d->buffers[sum ? SUM : NOW], d->buffers[RESULT], (uint64_t) a->size * 16);
    take_note(d, "look", (int64_t) a->size, (int64_t) a->size * 32);
    PELL_TRY(close_list(st));
    from = pell_gpu_buffer_host(d->buffers[RESULT]);
    for (size_t i = 0; i < a->size; i++)
        for (int c = 0; c < 3; c++)
            to[c][(ptrdiff_t) i - TS_MARGIN] = from[4 * i + (size_t) c];
    return open_list(d);

fail:
    return res;
}

static enum pell_result finish(struct ts_blurring *p)
{
    return close_list(p->st);
}

static void unpack_map(void *arg, int chunk, int worker)
{
    const struct packing *p = arg;
    const struct ts_device *d = p->st->device;
    const size_t from = (size_t) chunk * CHUNK, end = chunk_end(p->atlas->size, chunk);

    (void) worker;
    memcpy(p->map + 4 * from, (const float *) pell_gpu_buffer_host(d->buffers[RESULT]) + 4 * from, (end - from) * 16);
}

static enum pell_result store(struct ts_state *st, const struct ts_solid *solid)
{
    struct packing task = { .st = st, .atlas = solid->atlas, .map = solid->map - 4 * TS_MARGIN };
    struct ts_device *d = st->device;
    const struct ts_atlas *a = solid->atlas;
    enum pell_result res;

    PELL_TRY(open_list(d));
    d->push.far = TS_READ_FAR;
    d->push.keep = 1;
    run_entries(d, FILL_SUM, a->num_borders);
    pell_gpu_copy(d->commands, d->buffers[SUM], d->buffers[RESULT], (uint64_t) a->size * 16);
    take_note(d, "download", (int64_t) a->size, (int64_t) a->size * 32);
    PELL_TRY(close_list(st));
    pell_pool_run(st->pool, chunks_of(a->size), unpack_map, &task);
    ts_note_time(st, "unpack", a->inner, (int64_t) a->size * 32, 0);

fail:
    return res;
}

static const struct ts_runner vulkan_runner = {
    .begin = begin,
    .start = start,
    .fill = fill,
    .transmission_weights = transmission_weights,
    .blur = blur,
    .add = add,
    .transmit = transmit,
    .note = note,
    .inspect = inspect,
    .finish = finish,
    .store = store,
    .forget = forget,
    .close = ts_pixels_close,
};

static enum pell_result create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs, void **state)
{
    enum pell_result res;

    *state = NULL;
    if (((const struct ts_knobs *) knobs)->kernel == TS_KERNEL_JITTERED)
        return pell_error(services->ctx, PELL_ERR_UNSUPPORTED, "texture-space", "use --engine cpu, or leave the knob at its default",
                          "the engine vulkan has no kernel=jittered-13");
    res = ts_create(services, shape, knobs, &vulkan_runner, state);
    return res == PELL_OK ? ts_pixels_open(*state, shape) : res;
}

const struct pell_method_engine pell_ts_vulkan = {
    .create = create,
    .record = ts_render,
    .destroy = ts_destroy,
    .times = ts_times,
    .record_in = ts_pixels_read,
    .planes = ts_pixels_planes,
    .prepare = ts_pixels_prepare,
};
