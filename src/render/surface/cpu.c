/* SPDX-License-Identifier: MIT
 * cpu.c - stage "surface": planes, and bands of packets for the pool. Packets are processed in kernel.c. */
#include "base/base.h"
#include "render/surface/kernel.h"

#include <limits.h>
#include <string.h>

PELL_SIMD_TABLES(struct pell_surface_kernels, pell_surface_kernels);

#define PLANES 24 /* planes of floats, without `reflection` */

struct scratch {
    void *planes;
    const struct pell_surface_kernels *kernels;
    struct surface_decode decode;
    struct surface_band bands[];
};

static int bands_of(int height)
{
    return (height + SURFACE_BAND_ROWS - 1) / SURFACE_BAND_ROWS;
}

static size_t tasks_of(int width, int height)
{
    const size_t columns = ((size_t) width + PELL_RASTER_TILE - 1) / PELL_RASTER_TILE;
    const size_t tiles = columns * (((size_t) height + PELL_RASTER_TILE - 1) / PELL_RASTER_TILE), bands = (size_t) bands_of(height);

    return tiles > bands ? tiles : bands;
}

enum pell_result pell_surface_allocate(struct pell_context *ctx, int width, int height, struct pell_surface *surface)
{
    /* clang-format off */
    float **const planes[PLANES] = {
        &surface->depth, &surface->ng[0], &surface->ng[1], &surface->ng[2], &surface->ns[0], &surface->ns[1], &surface->ns[2],
        &surface->base[0], &surface->base[1], &surface->base[2], &surface->roughness, &surface->metallic, &surface->specular[0],
        &surface->specular[1], &surface->specular[2], &surface->strength, &surface->terminator_offset,
        &surface->emissive[0], &surface->emissive[1], &surface->emissive[2], &surface->transmission[0], &surface->transmission[1],
        &surface->transmission[2], &surface->slope_variance,
    };
    /* clang-format on */
    struct scratch *scratch;
    size_t stride, pixels, bytes;
    float *next;

    memset(surface, 0, sizeof(*surface));
    if (width < 1 || height < 1 || (int64_t) width * height > pell_context_limits(ctx)->image_pixels || width > INT_MAX - 16)
        return pell_error(ctx, PELL_ERR_INVALID, NULL, PELL_RAISE_LIMIT("image-pixels"),
                          "an image of %d x %d pixels; at least 1 x 1 and at most %lld pixels are allowed", width, height,
                          (long long) pell_context_limits(ctx)->image_pixels);
    stride = ((size_t) width + 15) / 16 * 16;
    /* Planes of one size would start at the same offset in a page, and a pixel's 20 values would fall into the same few cache sets: each
     * plane starts three cache lines further on. */
    if (__builtin_mul_overflow(stride, (size_t) height, &pixels) || __builtin_add_overflow(pixels, 48, &pixels) ||
        __builtin_mul_overflow(pixels, (PLANES + 2) * sizeof(float), &bytes))
        return pell_error(ctx, PELL_ERR_NOMEM, NULL, NULL, "an image of %d x %d pixels can't be allocated", width, height);

    scratch = pell_zalloc(ctx, sizeof(*scratch) + tasks_of(width, height) * sizeof(scratch->bands[0]));
    surface->scratch = scratch;
    if (!scratch)
        goto fail;
    surface_decode_make(&scratch->decode);
    scratch->kernels = pell_surface_kernels_tables[pell_simd_best()];
    scratch->planes = pell_alloc(ctx, bytes);
    if (!scratch->planes)
        goto fail;

    surface->width = width;
    surface->height = height;
    surface->stride = (ptrdiff_t) stride;
    next = scratch->planes;
    for (size_t i = 0; i < PLANES; i++, next += pixels)
        *planes[i] = next;
    surface->reflection = next;
    surface->material = (uint16_t *) (next + pixels);
    return PELL_OK;

fail:
    pell_surface_finish(ctx, surface);
    return PELL_ERR_NOMEM;
}

void pell_surface_finish(struct pell_context *ctx, struct pell_surface *surface)
{
    struct scratch *scratch = surface->scratch;

    if (scratch)
        pell_free(ctx, scratch->planes);
    pell_free(ctx, scratch);
    memset(surface, 0, sizeof(*surface));
}

static void band_task(void *arg, int index, int worker)
{
    const struct surface_job *job = arg;
    const struct scratch *scratch = job->out->scratch;

    (void) worker;
    scratch->kernels->band(job, index);
}

static void tile_task(void *arg, int index, int worker)
{
    const struct surface_job *job = arg;
    const struct scratch *scratch = job->out->scratch;

    (void) worker;
    scratch->kernels->tile(job, index);
}

/* Draws the surface's raster, if it exists and can be used; false: rays are traced instead. */
static bool draw(struct pell_pool *pool, const struct surface_job *job)
{
    const struct pell_view *v = job->view;
    const struct pell_raster_view view = {
        v->origin,
        v->forward,
        v->right,
        v->up,
        v->orthographic,
        v->focal_px,
        0.5f + v->shift_x - 0.5f * (float) v->width,
        0.5f * (float) v->height - 0.5f - v->shift_y,
    };
    const int64_t pixels = (int64_t) (job->rect.x1 - job->rect.x0) * (job->rect.y1 - job->rect.y0);

    return job->out->raster && pell_raster_draw(job->out->raster, pool, &view, pixels);
}

static struct pell_rect empty_or(const struct pell_rect *r)
{
    return r->x0 < r->x1 ? *r : (struct pell_rect) { 0 };
}

static struct surface_job make_job(const struct pell_rays *rays, const struct pell_scene *scene, const struct pell_view *view,
                                   struct pell_surface *surface)
{
    struct scratch *scratch = surface->scratch;

    return (struct surface_job) {
        .rays = rays,
        .scene = scene,
        .view = view,
        .out = surface,
        /* the scene's bounds exclude the generated ground */
        .rect = scene->ground_mesh < 0 ? pell_view_rect(view, scene->bounds_min, scene->bounds_max)
                                       : (struct pell_rect) { 0, 0, view->width, view->height },
        .bands = scratch->bands,
        .decode = &scratch->decode,
    };
}

double pell_surface_trace_bare(struct pell_pool *pool, const struct pell_rays *rays, const struct pell_scene *scene,
                               const struct pell_view *view, struct pell_surface *surface)
{
    struct surface_job job = make_job(rays, scene, view, surface);
    const double start = pell_seconds();

    job.bare = true;
    pell_pool_run(pool, bands_of(view->height), band_task, &job);
    return pell_seconds() - start;
}

void pell_surface_look(const struct pell_surface *like, const struct pell_scene *scene, float spacing, const struct pell_ray_hit16 *packet,
                       uint32_t hits, struct pell_surface *out)
{
    const struct scratch *scratch = like->scratch;
    const struct pell_view view = {
        .width = SURFACE_PACKET_SIDE, .height = SURFACE_PACKET_SIDE, .orthographic = true, .focal_px = 1.0f / spacing
    };
    const struct surface_job job = { .scene = scene, .view = &view, .out = out, .decode = &scratch->decode };

    out->width = out->height = SURFACE_PACKET_SIDE;
    out->stride = SURFACE_PACKET_SIDE;
    out->mips = like->mips;
    out->omit_uniform = like->omit_uniform;
    out->any_emissive = false;
    out->spread = 0.0f;
    out->any_thin = like->mips && like->mips->any_thin;
    out->mesh = NULL;
    scratch->kernels->look(&job, packet, hits);
}

enum pell_result pell_surface_render(struct pell_pool *pool, const struct pell_rays *rays, const struct pell_scene *scene,
                                     const struct pell_view *view, struct pell_surface *surface)
{
    struct scratch *scratch = surface->scratch;
    struct surface_job job = make_job(rays, scene, view, surface);
    struct surface_band sum = { .covered = { INT_MAX, INT_MAX, 0, 0 }, .translucent = { INT_MAX, INT_MAX, 0, 0 } };
    int tasks = bands_of(view->height);

    if (scene->num_materials > 65534)
        return pell_error(scene->ctx, PELL_ERR_UNSUPPORTED, scene->path, NULL, "%zu materials; 65534 can be rendered",
                          scene->num_materials);
    if (view->width != surface->width || view->height != surface->height)
        return pell_error(scene->ctx, PELL_ERR_INVALID, scene->path, NULL, "the view has %d x %d pixels, the surface %d x %d", view->width,
                          view->height, surface->width, surface->height);
    surface->any_thin = pell_scene_has_sheets(scene);
    surface->any_emissive = false;
    for (size_t i = 0; i < scene->num_materials; i++)
        for (int c = 0; c < 3; c++)
            surface->any_emissive |= scene->materials[i].emissive[c] > 0.0f;

    if (draw(pool, &job)) {
        tasks = pell_raster_tiles(surface->raster);
        pell_pool_run(pool, tasks, tile_task, &job);
    } else {
        pell_pool_run(pool, tasks, band_task, &job);
    }
    if (pell_cancelled(scene->ctx))
        return PELL_ERR_CANCELLED;

    for (int i = 0; i < tasks; i++) {
        const struct surface_band *b = &scratch->bands[i];
        pell_rect_unite(&sum.covered, &b->covered);
        pell_rect_unite(&sum.translucent, &b->translucent);
        sum.covered_pixels += b->covered_pixels;
        sum.translucent_pixels += b->translucent_pixels;
        sum.rays += b->rays;
    }
    surface->covered = empty_or(&sum.covered);
    surface->translucent = empty_or(&sum.translucent);
    surface->covered_pixels = sum.covered_pixels;
    surface->translucent_pixels = sum.translucent_pixels;
    surface->rays = sum.rays;
    return PELL_OK;
}
