/* SPDX-License-Identifier: MIT
 * device.c - see device.h: the order in which the passes of a sample run. */
#include "render/picture/device_state.h"

#include "render/indirect/stage.h"
#include "render/pass.h"
#include "scene/material_maps.h"

#include <math.h>
#include <string.h>

enum { CLEAR_ACROSS = 1024 }; /* workgroups of clear.comp in a row, at most */

enum pell_result pell_picture_device_create(struct pell_context *ctx, struct pell_gpu *gpu, struct pell_picture_device **out)
{
    struct pell_picture_device *d = pell_zalloc(ctx, sizeof(*d));
    enum pell_result res;

    *out = NULL;
    if (!d)
        return PELL_ERR_NOMEM;
    d->ctx = ctx;
    d->gpu = gpu;
    PELL_TRY(pell_gpu_commands_create(gpu, "picture", &d->commands));
    *out = d;
    return PELL_OK;

fail:
    pell_picture_device_destroy(&d);
    return res;
}

void pell_picture_device_destroy(struct pell_picture_device **device)
{
    struct pell_picture_device *d = *device;

    if (!d)
        return;
    *device = NULL;
    pell_gpu_commands_destroy(&d->commands);
    pell_picture_device_drop(d);
    pell_free(d->ctx, d);
}

/* --- What the device can't do --------------------------------------------------------------------------------------------------------- */

#define BY_CPU "surface to composite by the cpu: "

static const char *refuses_light(const struct pell_picture_sample *s)
{
    const struct pell_irradiance_params *light = s->irradiance;
    const struct pell_light_lent lent = pell_light_device_lend(s->light);

    if (pell_light_device_refuses(s->light))
        return BY_CPU "direct light is";
    if (pell_light_device_refuses_transmission(s->light))
        return BY_CPU "transmission is";
    if (!lent.corners)
        return BY_CPU "more corners than a buffer holds";
    if (lent.environments > 0 && !lent.sky)
        return BY_CPU "more of environments than a buffer holds";
    if (light->solid_light && pell_indirect_has_beams(light->solid_light))
        return BY_CPU "light is scattered forward through clear solids";
    if (s->unscattered)
        return BY_CPU "light passes thin parts without being scattered";
    return light->solid_light && light->whole_solid ? BY_CPU "the method asks whole solids" : NULL;
}

static const char *refuses_method(const struct pell_picture_sample *s)
{
    const unsigned known = PELL_NEED_IRRADIANCE | PELL_NEED_STRENGTH | PELL_NEED_TRANSMISSION | PELL_NEED_SCENE | PELL_NEED_HIT;
    const struct pell_plan *plan = s->sample->frame->plan;
    struct pell_gpu_buffer *planes[PELL_GPU_PLANES] = { NULL };

    if (!s->pass)
        return NULL;
    if (plan->needs & PELL_NEED_SHADED)
        return BY_CPU "the method blurs the lit image";
    if ((plan->needs & ~known) || plan->outputs || plan->quantity != PELL_QUANTITY_EXITANCE || !pell_pass_planes(s->pass, planes))
        return BY_CPU "the method reads other planes";
    return NULL;
}

const char *pell_picture_device_refuses(const struct pell_picture_device *d, const struct pell_picture_sample *s)
{
    const struct pell_engine_frame *f = s->sample->frame;
    const char *why = f->settings->layers                                 ? BY_CPU "layers are asked for"
                      : f->observed                                       ? BY_CPU "intermediate images are asked for"
                      : s->lens && pell_post_device_refuses_lens(s->lens) ? BY_CPU "depth of field is"
                                                                          : NULL;

    if (!why)
        why = refuses_method(s);
    if (!why)
        why = refuses_light(s);
    if (!why && picture_largest(s) > pell_gpu_buffer_most(d->gpu))
        why = BY_CPU "more pixels, or more known of solids, than a buffer holds";
    return why;
}

/* --- A sample ------------------------------------------------------------------------------------------------------------------------- */

static void clear_planes(struct pell_picture_device *d)
{
    const uint32_t count = (uint32_t) pell_gpu_pitch(d->width) * (uint32_t) d->height, groups = (count + 63) / 64;
    const uint32_t across = groups < CLEAR_ACROSS ? groups : CLEAR_ACROSS;
    const struct {
        uint32_t count, across;
    } push = { count, 64 * across };

    pell_gpu_mark(d->commands, "clear");
    pell_gpu_run(d->commands, d->passes[CLEAR], &push, across, (groups + across - 1) / across, 1);
}

/* Runs one invocation per pixel of the rectangle. */
static void run_pixels(struct pell_picture_device *d, const struct pell_picture_sample *s, enum picture_pass pass, const void *push)
{
    const struct pell_rect r = s->composite->rect;

    pell_gpu_run(d->commands, d->passes[pass], push, picture_tiles(r.x1 - r.x0), picture_tiles(r.y1 - r.y0), 1);
}

/* Records the passes from camera rays to the light at the surface. */
static void record_light(struct pell_picture_device *d, const struct pell_picture_sample *s)
{
    const struct pell_light_run run = { .params = s->irradiance, .highlights = true };
    const struct pell_rect r = s->composite->rect;
    const uint32_t tiles = picture_tiles(r.x1 - r.x0) * picture_tiles(r.y1 - r.y0), sides = picture_flags(s) & PELL_PICTURE_SHEETS ? 2 : 1;
    const uint32_t batch_tiles = (uint32_t) (d->room / (sides * PELL_PICTURE_GROUP));

    pell_gpu_mark(d->commands, "tables upload");
    pell_light_device_upload(s->light, &run, d->commands);
    pell_gpu_copy(d->commands, d->buffers[MATERIALS_UP], d->buffers[MATERIALS], d->sizes[MATERIALS]);
    pell_gpu_copy(d->commands, d->buffers[KEYS_UP], d->buffers[KEYS], d->sizes[KEYS]);
    pell_gpu_copy(d->commands, d->buffers[FRAME_UP], d->buffers[FRAME], d->sizes[FRAME]);
    if (s->composite->first)
        clear_planes(d);
    for (uint32_t first = 0; first < tiles; first += batch_tiles) {
        struct pell_picture_push push = { .first = first, .count = tiles - first < batch_tiles ? tiles - first : batch_tiles };
        struct pell_light_layout layout;
        push.far_sides = sides > 1 ? push.count * PELL_PICTURE_GROUP : 0;
        pell_gpu_mark(d->commands, "surface");
        pell_gpu_run(d->commands, d->passes[TRACE_CAMERA], &push, push.count, 1, 1);
        if (picture_flags(s) & PELL_PICTURE_INSIDES) {
            pell_gpu_mark(d->commands, "inside");
            pell_gpu_run(d->commands, d->passes[ADD_INSIDE], &push, sides * push.count, 1, 1);
        }
        layout = pell_light_device_record(s->light, &run, d->commands, (size_t) sides * push.count * PELL_PICTURE_GROUP);
        push.results = layout.words;
        push.through = layout.through_at;
        pell_gpu_mark(d->commands, "finish");
        pell_gpu_run(d->commands, d->passes[FINISH], &push, push.count, 1, 1);
    }
    if (s->irradiance->shared) {
        pell_gpu_mark(d->commands, "highlights");
        run_pixels(d, s, FILTER_HIGHLIGHTS, NULL);
    }
    pell_gpu_mark(d->commands, "rows");
    pell_gpu_run(d->commands, d->passes[REDUCE_ROWS], NULL, (uint32_t) (r.y1 - r.y0), 1, 1);
    pell_gpu_copy(d->commands, d->buffers[ROWS], d->buffers[ROWS_DOWN], d->sizes[ROWS_DOWN]);
}

/* Statistics of all rows of a sample. */
struct found {
    struct pell_engine_seen seen;
    int64_t pixels, rays, through;
    float depth, strength; /* of the pixel where a method's kernel is widest; depth 0: none */
};

static struct found read_rows(const struct pell_picture_device *d, const struct pell_picture_sample *s)
{
    const struct pell_picture_row *rows = pell_gpu_buffer_host(d->buffers[ROWS_DOWN]);
    const struct pell_view *v = &s->sample->view;
    const struct pell_rect r = s->composite->rect;
    struct found f = { .pixels = 0 };
    float widest = 0.0f;

    for (int y = r.y0; y < r.y1; y++) {
        const struct pell_picture_row *row = &rows[y];
        const struct pell_rect range = { (int) row->x0, y, (int) row->x1, y + 1 };
        const float width = row->depth > 0.0f ? row->strength / (v->orthographic ? 1.0f : row->depth) : 0.0f;
        f.pixels += row->pixels;
        f.rays += row->rays;
        f.through += row->through;
        f.seen.translucent_pixels += row->translucent;
        if (row->translucent > 0)
            pell_rect_unite(&f.seen.translucent, &range);
        if (width > widest || (row->depth > 0.0f && f.depth == 0.0f)) {
            widest = width;
            f.depth = row->depth;
            f.strength = row->strength;
        }
    }
    return f;
}

/* Bytes that a pass must read and write per pixel of the image. */
static int64_t bytes_of(const char *name)
{
    static const struct {
        const char *name;
        int bytes;
    } rows[] = {
        { "clear", 24 },
        { "surface", 128 + 80 },
        { "direct light", 128 + 48 },
        { "transmission", 128 + 48 },
        { "finish", 128 + 80 + 48 + 104 },
        { "highlights", 144 },
        { "rows", 56 },
        { "spread", 96 },
        { "composite", 112 },
        { "depth of field", 60 },
        { "load", 68 },
        { "measure", 72 },
    };

    for (size_t i = 0; i < PELL_COUNT(rows); i++)
        if (strcmp(rows[i].name, name) == 0)
            return rows[i].bytes;
    return 128;
}

/* Notes the times of the list that has run. */
static void note_times(const struct pell_picture_device *d, const struct pell_picture_sample *s, const struct found *f)
{
    struct pell_gpu_time list[PELL_GPU_MARKS];
    const size_t count = pell_gpu_times(d->commands, list, PELL_GPU_MARKS);
    int64_t direct = f->rays, transmission = f->through, camera = f->pixels;

    for (size_t i = 0; i < count; i++) {
        int64_t *rays = strcmp(list[i].name, "direct light") == 0   ? &direct
                        : strcmp(list[i].name, "transmission") == 0 ? &transmission
                        : strcmp(list[i].name, "surface") == 0      ? &camera
                                                                    : NULL;
        pell_stage_note(s->sample->frame->notes, list[i].name, list[i].seconds,
                        i == 0 || strcmp(list[i].name, list[i - 1].name) ? f->pixels : 0, rays ? *rays : 0,
                        f->pixels * bytes_of(list[i].name));
        if (rays)
            *rays = 0; /* the row of the first batch counts them all */
    }
}

/* Prepares the method's data on the host. */
static enum pell_result prepare_method(const struct pell_picture_sample *s, const struct found *f)
{
    struct pell_frame in = *s->sample->in;
    struct pell_pass_time times[PELL_STAGES_MOST];
    size_t count;
    enum pell_result res;

    in.rect = f->seen.translucent;
    res = pell_pass_prepare(s->pass, &in, times, &count);
    for (size_t i = 0; i < count; i++)
        pell_stage_note(s->sample->frame->notes, times[i].name, times[i].seconds, times[i].pixels, times[i].rays, times[i].bytes);
    return res;
}

static void record_composite(struct pell_picture_device *d, const struct pell_picture_sample *s)
{
    const struct pell_engine_frame *f = s->sample->frame;
    const struct pell_dof_params lens = { .rect = s->composite->rect,
                                          .scale = f->lens->radius / sqrtf((float) f->settings->msaa) * s->sample->view.focal_px,
                                          .focus = f->lens->focus,
                                          .first = s->composite->first };
    struct pell_composite_push push = { .plane = 0 };

    if (s->lens) {
        const struct pell_post_lens_planes planes = pell_post_device_lens_planes(s->lens, &lens.rect);
        push = (struct pell_composite_push) { planes.plane, planes.stride, planes.y0 };
    }
    pell_gpu_mark(d->commands, "composite");
    run_pixels(d, s, COMPOSE, &push);
    if (!s->lens)
        return;
    pell_gpu_mark(d->commands, "depth of field");
    pell_post_device_record_lens(s->lens, &lens, d->commands);
}

/* Records the spread of transmission, the method, and the composite. */
static void record_end(struct pell_picture_device *d, const struct pell_picture_sample *s, const struct found *f)
{
    if (s->spreads)
        picture_spread(d, s, f->seen.translucent);
    if (s->pass && f->depth > 0.0f)
        pell_pass_record_in(s->pass, d->commands, f->depth, f->strength);
    record_composite(d, s);
}

enum pell_result pell_picture_device_sample(struct pell_picture_device *d, const struct pell_picture_sample *s,
                                            struct pell_engine_seen *seen)
{
    const struct pell_rect r = s->composite->rect;
    struct found f;
    enum pell_result res;

    PELL_TRY(picture_prepare(d, s));
    if (r.x0 >= r.x1 || r.y0 >= r.y1)
        return PELL_OK;
    picture_fill(d, s);
    PELL_TRY(pell_gpu_begin(d->commands));
    record_light(d, s);
    PELL_TRY(pell_gpu_finish(d->commands));
    pell_light_device_recorded(s->light, &(struct pell_light_run) { .params = s->irradiance, .highlights = true });
    f = read_rows(d, s);
    note_times(d, s, &f);
    *seen = f.seen;
    if (pell_cancelled(d->ctx))
        return PELL_ERR_CANCELLED;
    if (s->pass && f.depth > 0.0f)
        PELL_TRY(prepare_method(s, &f));
    PELL_TRY(pell_gpu_begin(d->commands));
    record_end(d, s, &f);
    PELL_TRY(pell_gpu_finish(d->commands));
    f.rays = f.through = 0;
    note_times(d, s, &f);
    return pell_cancelled(d->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}

/* --- The image ------------------------------------------------------------------------------------------------------------------------ */

struct take_task {
    const struct pell_picture_device *d;
    const struct pell_accumulator *out;
    ptrdiff_t stride;
    struct pell_rect rect;
};

/* Copies what the row metered. */
static void meter_row(const struct take_task *t, int y)
{
    const struct pell_picture_row *row = (const struct pell_picture_row *) pell_gpu_buffer_host(t->d->buffers[ROWS_DOWN]) + y;

    t->out->meter[2 * y] = (double) row->arriving;
    t->out->meter[2 * y + 1] = (double) row->covered;
}

static void take_row(void *arg, int index, int worker)
{
    const struct take_task *t = arg;
    const int y = t->rect.y0 + index;
    const struct pell_vec4 *from =
        (const struct pell_vec4 *) pell_gpu_buffer_host(t->d->buffers[SUM_DOWN]) + (size_t) y * (size_t) pell_gpu_pitch(t->d->width);

    (void) worker;
    for (int x = t->rect.x0; x < t->rect.x1; x++) {
        t->out->color[0][y * t->stride + x] = from[x].x;
        t->out->color[1][y * t->stride + x] = from[x].y;
        t->out->color[2][y * t->stride + x] = from[x].z;
        t->out->alpha[y * t->stride + x] = from[x].w;
    }
    meter_row(t, y);
}

enum pell_result pell_picture_device_take(struct pell_picture_device *d, struct pell_pool *pool, struct pell_stage_notes *notes,
                                          const struct pell_accumulator *out, ptrdiff_t stride, const struct pell_rect *rect, bool lens)
{
    const struct take_task take = { d, out, stride, *rect };
    const int64_t pixels = (int64_t) (rect->x1 - rect->x0) * (rect->y1 - rect->y0);
    const uint64_t line = sizeof(struct pell_vec4) * (uint64_t) pell_gpu_pitch(d->width);
    struct pell_gpu_time time = { .seconds = 0.0 };
    double start;
    enum pell_result res;

    if (rect->x0 >= rect->x1 || rect->y0 >= rect->y1)
        return PELL_OK;
    if (lens) {
        for (int y = rect->y0; y < rect->y1; y++)
            meter_row(&take, y);
        return PELL_OK;
    }
    PELL_TRY(pell_gpu_begin(d->commands));
    pell_gpu_mark(d->commands, "download");
    pell_gpu_copy_part(d->commands, d->buffers[SUM], d->buffers[SUM_DOWN], line * (uint64_t) rect->y0,
                       line * (uint64_t) (rect->y1 - rect->y0));
    PELL_TRY(pell_gpu_finish(d->commands));
    start = pell_seconds();
    pell_pool_run(pool, rect->y1 - rect->y0, take_row, (void *) &take);
    (void) pell_gpu_times(d->commands, &time, 1);
    pell_stage_note(notes, "picture download", time.seconds, pixels, 0, 32 * pixels);
    pell_stage_note(notes, "picture unpack", pell_seconds() - start, pixels, 0, 32 * pixels);
    return PELL_OK;

fail:
    return res;
}
