/* SPDX-License-Identifier: MIT
 *
 * read_gpu.c - pixels on a Vulkan device read the maps there, for frames whose planes stay on the device. Maps are uploaded when they are
 * made.
 */
#include "methods/texture_space/read_gpu.h"
#include "methods/gpu_planes.h"
#include "methods/texture_space/push.h"

#include <string.h>

enum { GROUP_X = 16, GROUP_Y = 8, TRIANGLE_WORDS = 7 };

/* Device copies of a solid's data. */
struct sent {
    struct pell_gpu_buffer *layout, *map;
    struct pell_gpu_pass *pass;
    uint64_t version; /* of its map */
};

struct ts_pixels {
    struct pell_context *ctx; /* borrowed */
    struct pell_gpu *gpu;     /* borrowed */
    struct pell_gpu_buffer *planes[PELL_GPU_PLANES];
    struct pell_gpu_commands *commands;
    int pitch, height; /* px */
    size_t num_solids;
    struct sent *sent;
};

extern const struct pell_shader pell_texture_space_read_shader;

static void close_sent(struct sent *s)
{
    pell_gpu_pass_destroy(&s->pass);
    pell_gpu_buffer_destroy(&s->layout);
    pell_gpu_buffer_destroy(&s->map);
    s->version = 0;
}

void ts_pixels_close(struct ts_state *st)
{
    struct ts_pixels *p = st->pixels;

    if (!p)
        return;
    st->pixels = NULL;
    for (size_t i = 0; p->sent && i < p->num_solids; i++)
        close_sent(&p->sent[i]);
    pell_gpu_commands_destroy(&p->commands);
    for (int i = 0; i < PELL_GPU_PLANES; i++)
        pell_gpu_buffer_destroy(&p->planes[i]);
    pell_free(p->ctx, p->sent);
    pell_free(p->ctx, p);
}

enum pell_result ts_pixels_open(struct ts_state *st, const struct pell_frame_shape *shape)
{
    static const struct {
        const char *name;
        int bytes; /* per pixel; 0: no plane of its own */
    } rows[PELL_GPU_PLANES] = {
        [PELL_GPU_PLANE_LIGHT] = { "texture-space pixels, light", 16 },
        [PELL_GPU_PLANE_SURFACE] = { "texture-space pixels, surface", 8 },
        [PELL_GPU_PLANE_RESULT] = { "texture-space pixels, result", 16 },
        [PELL_GPU_PLANE_HIT] = { "texture-space pixels, points", 16 },
    };
    const int pitch = pell_gpu_pitch(shape->width);
    enum pell_result res = PELL_ERR_NOMEM;
    struct ts_pixels *p;

    if (st->pixels)
        return PELL_OK;
    st->pixels = p = pell_zalloc(st->ctx, sizeof(*p));
    if (!p)
        return PELL_ERR_NOMEM;
    p->ctx = st->ctx;
    p->gpu = st->services->gpu;
    p->pitch = pitch;
    p->height = shape->height;
    p->num_solids = st->num_solids;
    p->sent = pell_calloc(p->ctx, p->num_solids + 1, sizeof(*p->sent));
    if (!p->sent)
        goto fail;
    for (int i = 0; i < PELL_GPU_PLANES; i++)
        if (rows[i].bytes)
            PELL_TRY(pell_gpu_buffer_create(p->gpu, PELL_GPU_ON_DEVICE,
                                            (uint64_t) pitch * (uint64_t) shape->height * (uint64_t) rows[i].bytes, rows[i].name,
                                            &p->planes[i]));
    PELL_TRY(pell_gpu_commands_create(p->gpu, "texture-space pixels", &p->commands));
    return PELL_OK;

fail:
    ts_pixels_close(st);
    return res;
}

bool ts_pixels_planes(const void *state, struct pell_gpu_buffer *planes[PELL_GPU_PLANES])
{
    const struct ts_state *st = state;

    memcpy(planes, st->pixels->planes, sizeof(st->pixels->planes));
    return st->num_solids > 0;
}

/* --- Maps ---------------------------------------------------------------------------------------------------------------------------- */

static size_t layout_words(const struct ts_state *st, const struct ts_atlas *a)
{
    return st->solids->num_meshes + TRIANGLE_WORDS * (size_t) (a ? a->num_triangles : 0) + 1;
}

static void fill_layout(const struct ts_state *st, const struct ts_solid *solid, size_t index, uint32_t *words)
{
    const struct ts_atlas *a = solid->atlas;

    for (size_t i = 0; i < st->solids->num_meshes; i++)
        words[i] = a && st->solids->of_mesh[i] == (int32_t) index ? a->first[i] : UINT32_MAX;
    words += st->solids->num_meshes;
    for (uint32_t t = 0; a && t < a->num_triangles; t++, words += TRIANGLE_WORDS) {
        memcpy(words, a->corners[t], 6 * sizeof(*words));
        words[6] = (uint32_t) a->chart[t];
    }
}

static enum pell_result send_solid(struct ts_state *st, size_t index)
{
    struct ts_pixels *p = st->pixels;
    const struct ts_solid *solid = &st->solid[index];
    const uint64_t layout_size = sizeof(uint32_t) * (uint64_t) layout_words(st, solid->atlas);
    const uint64_t map_size = 16 * (uint64_t) (solid->atlas ? solid->atlas->size : 1);
    struct pell_gpu_buffer *up[2] = { NULL, NULL };
    struct sent *s = &p->sent[index];
    enum pell_result res;

    close_sent(s);
    PELL_TRY(pell_gpu_buffer_create(p->gpu, PELL_GPU_TO_DEVICE, layout_size, "texture-space pixels, layout", &up[0]));
    PELL_TRY(pell_gpu_buffer_create(p->gpu, PELL_GPU_TO_DEVICE, map_size, "texture-space pixels, map", &up[1]));
    PELL_TRY(pell_gpu_buffer_create(p->gpu, PELL_GPU_ON_DEVICE, layout_size, "texture-space pixels, layout", &s->layout));
    PELL_TRY(pell_gpu_buffer_create(p->gpu, PELL_GPU_ON_DEVICE, map_size, "texture-space pixels, map", &s->map));
    fill_layout(st, solid, index, pell_gpu_buffer_host(up[0]));
    if (solid->atlas)
        memcpy(pell_gpu_buffer_host(up[1]), solid->map - 4 * TS_MARGIN, (size_t) map_size);
    PELL_TRY(pell_gpu_begin(p->commands));
    pell_gpu_copy(p->commands, up[0], s->layout, layout_size);
    pell_gpu_copy(p->commands, up[1], s->map, map_size);
    PELL_TRY(pell_gpu_finish(p->commands));
    PELL_TRY(pell_gpu_pass_create(p->gpu, &pell_texture_space_read_shader, NULL, 0,
                                  (struct pell_gpu_buffer *[]) { p->planes[PELL_GPU_PLANE_LIGHT], p->planes[PELL_GPU_PLANE_SURFACE],
                                                                 p->planes[PELL_GPU_PLANE_HIT], s->layout, s->map,
                                                                 p->planes[PELL_GPU_PLANE_RESULT] },
                                  &s->pass));
    s->version = solid->version;

fail:
    pell_gpu_buffer_destroy(&up[0]);
    pell_gpu_buffer_destroy(&up[1]);
    return res;
}

/* Uploads maps whose device copy is out of date. */
static enum pell_result send_maps(struct ts_state *st)
{
    struct ts_pixels *p = st->pixels;
    int64_t texels = 0;
    enum pell_result res = PELL_OK;

    for (size_t i = 0; i < st->num_solids && res == PELL_OK; i++) {
        if (p->sent[i].pass && p->sent[i].version == st->solid[i].version)
            continue;
        res = send_solid(st, i);
        texels += st->solid[i].atlas ? (int64_t) st->solid[i].atlas->size : 0;
    }
    if (texels > 0)
        ts_note_time(st, "map upload", texels, 32 * texels, 0);
    return res;
}

enum pell_result ts_pixels_prepare(void *state, const struct pell_frame *in)
{
    const struct ts_state *st = state;
    const enum pell_result res = ts_make(state, in);

    return res != PELL_OK ? res : pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : send_maps(state);
}

/* --- Pixels -------------------------------------------------------------------------------------------------------------------------- */

void ts_pixels_read(void *state, struct pell_gpu_commands *commands, float depth, float strength)
{
    const struct ts_state *st = state;
    const struct ts_pixels *p = st->pixels;

    (void) depth, (void) strength;
    pell_gpu_mark(commands, "gather");
    for (size_t i = 0; i < p->num_solids; i++) {
        const struct ts_solid *solid = &st->solid[i];
        const struct ts_atlas *a = solid->atlas;
        double weight[3] = { 0.0, 0.0, 0.0 };
        struct ts_read_push push = {
            .pitch = p->pitch, .rows = p->height, .meshes = (int32_t) st->solids->num_meshes, .origin = TS_MARGIN, .clear = i == 0
        };
        if (a) {
            ts_unblurred(st, solid, weight);
            push.width = a->width;
            push.height = a->height;
            push.stride = (int32_t) a->stride;
        }
        push.unblurred_r = (float) weight[0];
        push.unblurred_g = (float) weight[1];
        push.unblurred_b = (float) weight[2];
        pell_gpu_run(commands, p->sent[i].pass, &push, pell_gpu_groups(p->pitch, GROUP_X), pell_gpu_groups(p->height, GROUP_Y), 1);
    }
}
