/* SPDX-License-Identifier: MIT
 * buffers.c - buffers and passes of images. */
#include "render/curvature/stage.h"
#include "render/indirect/stage.h"
#include "render/pass.h"
#include "render/picture/device_state.h"

#include <string.h>

extern const struct pell_shader pell_picture_clear_shader, pell_picture_surface_shader, pell_picture_inside_shader,
    pell_picture_finish_shader, pell_picture_highlights_shader, pell_picture_rows_shader, pell_picture_spread_split_shader,
    pell_picture_spread_blur_shader, pell_picture_composite_shader;

static const struct {
    const struct pell_shader *shader;
    enum picture_buffer buffers[PELL_GPU_BINDINGS]; /* as its bindings */
} pass_rows[PASSES] = {
    [CLEAR] = { &pell_picture_clear_shader, { LIGHT, SURFACE } },
    [TRACE_CAMERA] = { &pell_picture_surface_shader,
                       { NODES, TRIANGLES, MESHES, CORNERS, LIT, MATERIALS, FRAME, KEYS, ATTRIBUTES, MAPS, POINTS, HITS, METHOD_HITS,
                         METHOD_BASES } },
    [ADD_INSIDE] = { &pell_picture_inside_shader, { HITS, LIT, FRAME, MESHES, CORNERS, SHAPES, SOLIDS, BETWEEN, POINTS, INSIDES } },
    [FINISH] = { &pell_picture_finish_shader,
                 { POINTS, RESULTS, HITS, INSIDES, LIT, MATERIALS, TABLES, FRAME, SKY, ARRIVED, SURFACE, SHOWN, AROUND, THROUGH, SINGLE } },
    [FILTER_HIGHLIGHTS] = { &pell_picture_highlights_shader, { SHOWN, AROUND, FRAME, ENTERED, HIGHLIGHTS, LIGHT } },
    [REDUCE_ROWS] = { &pell_picture_rows_shader, { SURFACE, SHOWN, AROUND, THROUGH, FRAME, LIT, THICKNESS, MATERIALS, ROWS } },
    [SPREAD_SPLIT] = { &pell_picture_spread_split_shader, { SURFACE, SHOWN, LIT, THICKNESS, FRAME, THROUGH, SPREAD_SUM } },
    [SPREAD_ACROSS] = { &pell_picture_spread_blur_shader, { SURFACE, AROUND, FRAME, SPREAD_SUM, SPREAD_HALF } },
    [SPREAD_DOWN] = { &pell_picture_spread_blur_shader, { SURFACE, AROUND, FRAME, SPREAD_HALF, SPREAD_SUM } },
    [COMPOSE] = { &pell_picture_composite_shader,
                  { LIGHT, RESULT, SHOWN, HIGHLIGHTS, THROUGH, SINGLE, MATERIALS, FRAME, AROUND, SUM, LENS } },
};

/* The unit of a buffer's size. */
enum counted { ONCE, MATERIAL, MESH, POINT, PIXEL, ROW, WORDS };

static const struct {
    const char *name;
    enum pell_gpu_memory memory;
    uint32_t bytes;
    enum counted of;
    uint32_t flag; /* of frames that need it; 0: all */
} buffer_rows[BUFFERS] = {
    [EMPTY] = { "picture, nothing", PELL_GPU_ON_DEVICE, 16, ONCE, 0 },
    [MATERIALS] = { "picture materials", PELL_GPU_ON_DEVICE, sizeof(struct pell_picture_material), MATERIAL, 0 },
    [MATERIALS_UP] = { "picture materials, upload", PELL_GPU_TO_DEVICE, sizeof(struct pell_picture_material), MATERIAL, 0 },
    [KEYS] = { "picture keys", PELL_GPU_ON_DEVICE, sizeof(uint32_t), MESH, 0 },
    [KEYS_UP] = { "picture keys, upload", PELL_GPU_TO_DEVICE, sizeof(uint32_t), MESH, 0 },
    [FRAME] = { "picture frame", PELL_GPU_ON_DEVICE, sizeof(struct pell_picture_frame), ONCE, 0 },
    [FRAME_UP] = { "picture frame, upload", PELL_GPU_TO_DEVICE, sizeof(struct pell_picture_frame), ONCE, 0 },
    [HITS] = { "picture hits", PELL_GPU_ON_DEVICE, sizeof(struct pell_picture_hit), POINT, 0 },
    [INSIDES] = { "picture insides", PELL_GPU_ON_DEVICE, sizeof(struct pell_picture_inside), POINT, PELL_PICTURE_INSIDES },
    [SHOWN] = { "picture shown", PELL_GPU_ON_DEVICE, sizeof(struct pell_picture_shown), PIXEL, 0 },
    [AROUND] = { "picture around", PELL_GPU_ON_DEVICE, sizeof(struct pell_picture_around), PIXEL, 0 },
    [THROUGH] = { "picture through", PELL_GPU_ON_DEVICE, 16, PIXEL, 0 },
    [SINGLE] = { "picture single", PELL_GPU_ON_DEVICE, 16, PIXEL, PELL_PICTURE_SINGLE },
    [HIGHLIGHTS] = { "picture highlights", PELL_GPU_ON_DEVICE, 16, PIXEL, PELL_PICTURE_SHARED },
    [ENTERED] = { "picture light before shadows are shared", PELL_GPU_ON_DEVICE, 16, PIXEL, PELL_PICTURE_SHARED },
    [SPREAD_SUM] = { "picture spread, sum", PELL_GPU_ON_DEVICE, 16, PIXEL, PELL_PICTURE_SPREADS },
    [SPREAD_HALF] = { "picture spread, half", PELL_GPU_ON_DEVICE, 16, PIXEL, PELL_PICTURE_SPREADS },
    [SUM] = { "picture sum", PELL_GPU_ON_DEVICE, 16, PIXEL, 0 },
    [SUM_DOWN] = { "picture sum, download", PELL_GPU_FROM_DEVICE, 16, PIXEL, 0 },
    [ROWS] = { "picture rows", PELL_GPU_ON_DEVICE, sizeof(struct pell_picture_row), ROW, 0 },
    [ROWS_DOWN] = { "picture rows, download", PELL_GPU_FROM_DEVICE, sizeof(struct pell_picture_row), ROW, 0 },
    [SHAPES] = { "picture shapes", PELL_GPU_ON_DEVICE, 4, WORDS, PELL_PICTURE_INSIDES },
    [SOLIDS] = { "picture solids", PELL_GPU_ON_DEVICE, 4, WORDS, PELL_PICTURE_INSIDES },
    [BETWEEN] = { "picture indirect light", PELL_GPU_ON_DEVICE, 4, WORDS, PELL_PICTURE_INSIDES },
    [ATTRIBUTES] = { "picture vertices", PELL_GPU_ON_DEVICE, 4, WORDS, PELL_PICTURE_MAPPED },
    [MAPS] = { "picture maps", PELL_GPU_ON_DEVICE, 4, WORDS, PELL_PICTURE_MAPPED },
    [NO_LIGHT] = { "picture light", PELL_GPU_ON_DEVICE, 16, PIXEL, 0 },
    [NO_SURFACE] = { "picture surface", PELL_GPU_ON_DEVICE, 8, PIXEL, 0 },
};

/* Per mesh of the scene: first words of four UV sets, tangents and colours, or PELL_MIPS_NONE; 2 words unused; then those data. */
static size_t attribute_words(const struct pell_scene *scene, uint32_t *out)
{
    size_t at = 8 * scene->num_meshes;

    if (!picture_is_mapped(scene))
        return 0;
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *m = &scene->meshes[i];
        const float *const data[6] = { m->uv[0], m->uv[1], m->uv[2], m->uv[3], m->tangent, m->color };
        for (int k = 0; k < 6; k++) {
            const size_t count = (k < 4 ? 2 : 4) * (size_t) m->num_vertices;
            if (out)
                out[8 * i + (size_t) k] = data[k] ? (uint32_t) at : PELL_MIPS_NONE;
            if (out && data[k])
                memcpy(out + at, data[k], count * sizeof(*out));
            at += data[k] ? count : 0;
        }
    }
    return at;
}

/* Words of the data of solids, of vertex attributes or of maps; `out` NULL: they are only counted. */
static size_t words_of(const struct pell_picture_sample *s, enum picture_buffer which, uint32_t *out)
{
    const struct pell_irradiance_params *p = s->irradiance;

    switch (which) {
    case SHAPES: return p->curvature ? pell_curvature_words(p->curvature, out) : 0;
    case ATTRIBUTES: return attribute_words(p->scene, out);
    case MAPS: return p->surface->mips ? pell_mips_words(p->surface->mips, p->scene, out) : 0;
    case SOLIDS: return p->solid_light ? pell_indirect_words(p->solid_light, out) : 0;
    default: return p->indirect ? pell_indirect_words(p->indirect, out) : 0;
    }
}

uint64_t picture_largest(const struct pell_picture_sample *s)
{
    const struct pell_view *v = &s->sample->view;
    uint64_t most = (uint64_t) pell_gpu_pitch(v->width) * (uint64_t) v->height * sizeof(struct pell_picture_around);

    for (int i = SHAPES; i <= MAPS; i++) {
        const uint64_t size = sizeof(uint32_t) * (uint64_t) words_of(s, i, NULL);
        most = size > most ? size : most;
    }
    return most;
}

static uint64_t size_of(const struct pell_picture_device *d, const struct pell_picture_sample *s, enum picture_buffer which)
{
    const struct pell_scene *scene = s->sample->frame->scene;
    const uint64_t counts[] = {
        [ONCE] = 1,
        [MATERIAL] = scene->num_materials + 1,
        [MESH] = scene->num_meshes + 1,
        [POINT] = d->room,
        [PIXEL] = (uint64_t) pell_gpu_pitch(d->width) * (uint64_t) d->height,
        [ROW] = (uint64_t) d->height,
        [WORDS] = buffer_rows[which].of == WORDS ? words_of(s, which, NULL) : 0,
    };
    const uint32_t flag = buffer_rows[which].flag;

    if ((flag && !(picture_flags(s) & flag)) || (s->pass && (which == NO_LIGHT || which == NO_SURFACE)))
        return 0;
    return counts[buffer_rows[which].of] * buffer_rows[which].bytes;
}

static enum pell_result make_buffers(struct pell_picture_device *d, const struct pell_picture_sample *s)
{
    enum pell_result res = PELL_OK;

    for (int i = 0; i < BUFFERS && res == PELL_OK; i++) {
        const uint64_t size = size_of(d, s, i);
        if (size <= d->sizes[i])
            continue;
        pell_gpu_buffer_destroy(&d->buffers[i]);
        d->sizes[i] = 0;
        d->sent = d->sent && (i < SHAPES || i > MAPS);
        res = pell_gpu_buffer_create(d->gpu, buffer_rows[i].memory, size, buffer_rows[i].name, &d->buffers[i]);
        d->sizes[i] = res == PELL_OK ? size : 0;
    }
    return res;
}

/* Uploads these words if they have changed. */
static enum pell_result send_words(struct pell_picture_device *d, const struct pell_picture_sample *s)
{
    struct pell_gpu_buffer *up[BUFFERS] = { NULL };
    enum pell_result res = PELL_OK;

    if (!(picture_flags(s) & (PELL_PICTURE_INSIDES | PELL_PICTURE_MAPPED)) || (d->sent && d->version == s->version))
        return PELL_OK;
    for (int i = SHAPES; i <= MAPS; i++) {
        const uint64_t size = size_of(d, s, i);
        if (size == 0)
            continue;
        PELL_TRY(pell_gpu_buffer_create(d->gpu, PELL_GPU_TO_DEVICE, size, buffer_rows[i].name, &up[i]));
        (void) words_of(s, i, pell_gpu_buffer_host(up[i]));
    }
    PELL_TRY(pell_gpu_begin(d->commands));
    for (int i = SHAPES; i <= MAPS; i++)
        if (up[i])
            pell_gpu_copy(d->commands, up[i], d->buffers[i], size_of(d, s, i));
    PELL_TRY(pell_gpu_finish(d->commands));
    d->version = s->version;
    d->sent = true;

fail:
    for (int i = SHAPES; i <= MAPS; i++)
        pell_gpu_buffer_destroy(&up[i]);
    return res;
}

static void borrow(struct pell_picture_device *d, const struct pell_picture_sample *s)
{
    const struct pell_light_lent lent = pell_light_device_lend(s->light);
    struct pell_gpu_buffer *planes[PELL_GPU_PLANES] = { d->buffers[NO_LIGHT], d->buffers[NO_SURFACE] };

    if (s->pass)
        pell_pass_planes(s->pass, planes);
    d->buffers[LIGHT] = planes[PELL_GPU_PLANE_LIGHT];
    d->buffers[ARRIVED] = picture_flags(s) & PELL_PICTURE_SHARED ? d->buffers[ENTERED] : d->buffers[LIGHT];
    d->buffers[SURFACE] = planes[PELL_GPU_PLANE_SURFACE];
    d->buffers[RESULT] = planes[PELL_GPU_PLANE_RESULT];
    d->buffers[METHOD_HITS] = planes[PELL_GPU_PLANE_HIT];
    d->buffers[METHOD_BASES] = planes[PELL_GPU_PLANE_BASE];
    d->buffers[LENS] = s->lens ? pell_post_device_lens_planes(s->lens, &s->composite->rect).buffer : NULL;
    d->buffers[NODES] = lent.nodes;
    d->buffers[TRIANGLES] = lent.triangles;
    d->buffers[MESHES] = lent.meshes;
    d->buffers[CORNERS] = lent.corners;
    d->buffers[LIT] = lent.materials;
    d->buffers[TABLES] = lent.tables;
    d->buffers[POINTS] = lent.points;
    d->buffers[RESULTS] = lent.results;
    d->buffers[THICKNESS] = lent.thickness;
    d->buffers[SKY] = lent.sky;
}

static bool is_used(const struct pell_picture_sample *s, enum picture_pass pass)
{
    const uint32_t flags = picture_flags(s);

    switch (pass) {
    case ADD_INSIDE: return flags & PELL_PICTURE_INSIDES;
    case FILTER_HIGHLIGHTS: return flags & PELL_PICTURE_SHARED;
    case SPREAD_SPLIT:
    case SPREAD_ACROSS:
    case SPREAD_DOWN: return flags & PELL_PICTURE_SPREADS;
    default: return true;
    }
}

/* Recreates a pass if one of its buffers was replaced. */
static enum pell_result make_pass(struct pell_picture_device *d, enum picture_pass pass)
{
    const struct pell_shader *shader = pass_rows[pass].shader;
    struct pell_gpu_buffer *buffers[PELL_GPU_BINDINGS];
    uint64_t numbers[PELL_GPU_BINDINGS] = { 0 };

    for (int k = 0; k < shader->num_bindings; k++) {
        struct pell_gpu_buffer *b = d->buffers[pass_rows[pass].buffers[k]];
        buffers[k] = b ? b : d->buffers[EMPTY];
        numbers[k] = pell_gpu_buffer_id(buffers[k]);
    }
    if (d->passes[pass] && memcmp(numbers, d->bound[pass], sizeof(numbers)) == 0)
        return PELL_OK;
    pell_gpu_pass_destroy(&d->passes[pass]);
    memcpy(d->bound[pass], numbers, sizeof(numbers));
    return pell_gpu_pass_create(d->gpu, shader, NULL, 0, buffers, &d->passes[pass]);
}

enum pell_result picture_prepare(struct pell_picture_device *d, const struct pell_picture_sample *s)
{
    const struct pell_view *view = &s->sample->view;
    enum pell_result res;

    if (view->width != d->width || view->height != d->height)
        pell_picture_device_drop(d);
    d->width = view->width;
    d->height = view->height;
    d->room = pell_light_device_lend(s->light).room / PELL_PICTURE_GROUP * PELL_PICTURE_GROUP;
    PELL_TRY(make_buffers(d, s));
    PELL_TRY(send_words(d, s));
    borrow(d, s);
    for (int i = 0; i < PASSES; i++)
        if (is_used(s, i))
            PELL_TRY(make_pass(d, i));
    return PELL_OK;

fail:
    return res;
}

void pell_picture_device_drop(struct pell_picture_device *d)
{
    for (int i = 0; i < PASSES; i++)
        pell_gpu_pass_destroy(&d->passes[i]);
    for (int i = 0; i < BUFFERS; i++)
        pell_gpu_buffer_destroy(&d->buffers[i]);
    memset(d->sizes, 0, sizeof(d->sizes));
    memset(d->bound, 0, sizeof(d->bound));
    d->width = d->height = 0;
    d->sent = false;
}
