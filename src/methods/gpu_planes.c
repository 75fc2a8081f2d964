/* SPDX-License-Identifier: MIT
 * gpu_planes.c - transfer of a frame's planes to a Vulkan device and back. */
#include "methods/gpu_planes.h"

#include "render/material_id.h"

#include <string.h>

enum { ROUND = 16 /* px */, BANDS = 8 /* rows per task */ };

enum pell_result pell_gpu_planes_make(const struct pell_services *services, const struct pell_frame_shape *shape, struct pell_gpu_planes *p)
{
    const uint64_t pixels = (uint64_t) ((shape->width + ROUND - 1) / ROUND * ROUND) * (uint64_t) shape->height;
    struct pell_gpu *gpu = services->gpu;
    enum pell_result res;

    memset(p, 0, sizeof(*p));
    p->services = services;
    if (services->planes)
        return PELL_OK;
    p->pixels = pell_calloc(services->ctx, (size_t) shape->height, sizeof(*p->pixels));
    if (!p->pixels)
        return PELL_ERR_NOMEM;
    PELL_TRY(pell_gpu_buffer_create(gpu, PELL_GPU_TO_DEVICE, pixels * sizeof(struct pell_gpu_light), "light, upload", &p->light_up));
    PELL_TRY(pell_gpu_buffer_create(gpu, PELL_GPU_TO_DEVICE, pixels * sizeof(struct pell_gpu_surface), "surface, upload", &p->surface_up));
    PELL_TRY(pell_gpu_buffer_create(gpu, PELL_GPU_ON_DEVICE, pixels * sizeof(struct pell_gpu_light), "light", &p->light));
    PELL_TRY(pell_gpu_buffer_create(gpu, PELL_GPU_ON_DEVICE, pixels * sizeof(struct pell_gpu_surface), "surface", &p->surface));
    return pell_gpu_buffer_create(gpu, PELL_GPU_FROM_DEVICE, pixels * sizeof(struct pell_gpu_light), "result", &p->result);

fail:
    return res;
}

void pell_gpu_planes_finish(struct pell_gpu_planes *p)
{
    pell_gpu_buffer_destroy(&p->light_up);
    pell_gpu_buffer_destroy(&p->surface_up);
    pell_gpu_buffer_destroy(&p->light);
    pell_gpu_buffer_destroy(&p->surface);
    pell_gpu_buffer_destroy(&p->result);
    if (p->services)
        pell_free(p->services->ctx, p->pixels);
    p->pixels = NULL;
}

struct pell_gpu_buffer *pell_gpu_planes_buffer(const struct pell_gpu_planes *p, enum pell_gpu_plane plane)
{
    return p->services->planes               ? p->services->planes[plane]
           : plane == PELL_GPU_PLANE_LIGHT   ? p->light
           : plane == PELL_GPU_PLANE_SURFACE ? p->surface
                                             : p->result;
}

struct pell_gpu_light *pell_gpu_planes_light_row(const struct pell_gpu_planes *p, int row)
{
    return (struct pell_gpu_light *) pell_gpu_buffer_host(p->light_up) + (ptrdiff_t) row * p->width;
}

struct pell_gpu_surface *pell_gpu_planes_surface_row(const struct pell_gpu_planes *p, int row)
{
    return (struct pell_gpu_surface *) pell_gpu_buffer_host(p->surface_up) + (ptrdiff_t) row * p->width;
}

static void pack_row(struct pell_gpu_planes *p, int row)
{
    const struct pell_frame *in = p->in;
    struct pell_gpu_light *light = pell_gpu_planes_light_row(p, row);
    struct pell_gpu_surface *surface = pell_gpu_planes_surface_row(p, row);
    int32_t count = 0;

    for (int i = 0; i < p->width; i++) {
        const int x = p->x0 + i;
        const ptrdiff_t at = (p->y0 + row) * in->shape.stride + x;
        const uint16_t material = x >= in->rect.x0 && x < in->rect.x1 ? pell_material_id(in, at) : 0;

        surface[i] = (struct pell_gpu_surface) { material, material && p->strength ? p->strength[at] : 1.0f };
        light[i] = (struct pell_gpu_light) { { 0 }, 0 };
        if (material) {
            light[i] = (struct pell_gpu_light) { { p->from[0][at], p->from[1][at], p->from[2][at] }, in->depth[at] };
            count++;
        }
    }
    p->pixels[row] = count;
    if (p->row)
        p->row(p->state, row);
}

static void run_pack(void *arg, int index, int worker)
{
    struct pell_gpu_planes *p = arg;

    (void) worker;
    for (int row = index * BANDS; row < (index + 1) * BANDS && row < p->height; row++)
        pack_row(p, row);
}

int64_t pell_gpu_planes_pack(struct pell_gpu_planes *p, const struct pell_frame *in, const float *const light[3], const float *strength,
                             void (*row)(void *state, int row), void *state)
{
    const struct pell_rect *r = &in->rect;
    int64_t pixels = 0;

    p->started = pell_seconds();
    p->num_times = 0;
    p->in = in;
    p->from = light;
    p->strength = strength;
    p->row = row;
    p->state = state;
    p->x0 = r->x0 / ROUND * ROUND;
    p->y0 = r->y0;
    p->width = (r->x1 - p->x0 + ROUND - 1) / ROUND * ROUND;
    p->height = r->y1 - r->y0;
    pell_pool_run(p->services->pool, (p->height + BANDS - 1) / BANDS, run_pack, p);
    for (int y = 0; y < p->height; y++)
        pixels += p->pixels[y];
    p->packed = pell_seconds();
    return pixels;
}

void pell_gpu_planes_whole(struct pell_gpu_planes *p, int width, int height)
{
    p->x0 = p->y0 = 0;
    p->width = (width + ROUND - 1) / ROUND * ROUND;
    p->height = height;
}

void pell_gpu_planes_upload(const struct pell_gpu_planes *p, struct pell_gpu_commands *commands)
{
    const uint64_t pixels = (uint64_t) p->width * (uint64_t) p->height;

    pell_gpu_copy(commands, p->light_up, p->light, pixels * sizeof(struct pell_gpu_light));
    pell_gpu_copy(commands, p->surface_up, p->surface, pixels * sizeof(struct pell_gpu_surface));
}

void pell_gpu_planes_download(const struct pell_gpu_planes *p, struct pell_gpu_commands *commands, struct pell_gpu_buffer *from)
{
    const uint64_t pixels = (uint64_t) p->width * (uint64_t) p->height;

    pell_gpu_copy(commands, from, pell_gpu_planes_buffer(p, PELL_GPU_PLANE_RESULT), pixels * sizeof(struct pell_gpu_light));
}

static void run_unpack(void *arg, int index, int worker)
{
    const struct pell_gpu_planes *p = arg;
    const struct pell_frame *in = p->in;

    (void) worker;
    for (int row = index * BANDS; row < (index + 1) * BANDS && row < p->height; row++) {
        const struct pell_gpu_light *from = (const struct pell_gpu_light *) pell_gpu_buffer_host(p->result) + (ptrdiff_t) row * p->width;
        for (int x = in->rect.x0; x < in->rect.x1; x++) {
            const ptrdiff_t at = (p->y0 + row) * in->shape.stride + x;
            if (!pell_material_id(in, at))
                continue;
            for (int c = 0; c < 3; c++)
                p->to[c][at] = from[x - p->x0].light[c];
        }
    }
}

void pell_gpu_planes_unpack(struct pell_gpu_planes *p, float *const to[3])
{
    p->finished = pell_seconds();
    p->to = to;
    pell_pool_run(p->services->pool, (p->height + BANDS - 1) / BANDS, run_unpack, p);
    p->to = NULL;
}

void pell_gpu_planes_note(struct pell_gpu_planes *p, const struct pell_gpu_commands *commands, int64_t pixels,
                          int (*bytes)(const char *mark))
{
    const double now = pell_seconds();
    struct pell_gpu_time list[PELL_GPU_MARKS];
    const size_t count = pell_gpu_times(commands, list, PELL_GPU_MARKS - 2);
    const int64_t grid = (int64_t) p->width * p->height;

    p->times[p->num_times++] =
        (struct pell_pass_time) { .name = "pack", .seconds = p->packed - p->started, .pixels = pixels, .bytes = grid * 48 };
    for (size_t i = 0; i < count; i++)
        p->times[p->num_times++] = (struct pell_pass_time) {
            .name = list[i].name, .seconds = list[i].seconds, .pixels = pixels, .bytes = grid * bytes(list[i].name)
        };
    p->times[p->num_times++] =
        (struct pell_pass_time) { .name = "unpack", .seconds = now - p->finished, .pixels = pixels, .bytes = pixels * 28 };
}

size_t pell_gpu_planes_times(const struct pell_gpu_planes *p, struct pell_pass_time *list, size_t size)
{
    const size_t count = p->num_times < size ? p->num_times : size;

    memcpy(list, p->times, count * sizeof(*list));
    return count;
}
