/* SPDX-License-Identifier: MIT
 * engine_cpu_around.c - the cpu engine's stages before and after the method: filters of its input, and unscattered light. */
#include "render/engine_cpu_state.h"
#include "render/highlights/stage.h"
#include "render/spread/stage.h"
#include "render/unscattered/stage.h"

void pell_cpu_share_highlights(struct pell_cpu *e, const struct pell_engine_sample *sample)
{
    const struct pell_view *view = &sample->view;
    struct pell_highlights_params params = {
        .rect = e->surface.covered,
        .stride = e->surface.stride,
        .material = e->surface.material,
        .depth = e->surface.depth,
        .depth_mm = view->orthographic ? 0.0f : 1.0f / view->focal_px,
        .fixed_mm = view->orthographic ? 1.0f / view->focal_px : 0.0f,
        .has_hidden = e->has_hidden,
        .rays = e->lights->light_samples,
    };
    const double start = pell_seconds();
    int64_t pixels;

    for (int c = 0; c < 3; c++) {
        params.normal[c] = e->surface.ns[c];
        params.hidden[c] = e->lighting.hidden[c];
        params.hidden[3 + c] = e->lighting.lost[c];
        params.light[c] = e->lighting.specular[c];
        params.light[3 + c] = e->lighting.irradiance[c];
        params.scratch[c] = e->display[c];
        params.scratch[3 + c] = e->plane[PELL_PLANE_LIGHT][c]; /* written by the method later */
    }
    pixels = pell_highlights_render(e->pool, &params);
    pell_stage_note(sample->frame->notes, "highlights", pell_seconds() - start, pixels, 0, pixels * 72);
}

void pell_cpu_spread(struct pell_cpu *e, const struct pell_engine_sample *sample, const uint16_t *key)
{
    const struct pell_view *view = &sample->view;
    struct pell_spread_params params = {
        .rect = e->surface.translucent,
        .stride = e->surface.stride,
        .key = key,
        .material = e->surface.material,
        .thickness = sample->frame->materials->thickness,
        .depth = e->surface.depth,
        .path = e->lighting.path,
        .depth_mm = view->orthographic ? 0.0f : 1.0f / view->focal_px,
        .fixed_mm = view->orthographic ? 1.0f / view->focal_px : 0.0f,
    };
    const double start = pell_seconds();
    int64_t pixels;

    for (int c = 0; c < 3; c++) {
        params.transmitted[c] = e->lighting.transmitted[c];
        params.sum[c] = e->display[c];
        params.half[c] = e->plane[PELL_PLANE_LIGHT][c];
    }
    params.lit[0] = e->spread_lit;
    params.lit[1] = e->spread_lit + pell_spread_blocks(params.stride) * (size_t) view->height;
    pixels = pell_spread_render(e->pool, &params);
    pell_stage_note(sample->frame->notes, "spread", pell_seconds() - start, pixels, 0, pixels * 32);
}

void pell_cpu_see_through(struct pell_cpu *e, const struct pell_engine_sample *sample)
{
    const struct pell_engine_frame *f = sample->frame;
    const struct pell_unscattered_params params = {
        .scene = e->scene,
        .rays = e->rays,
        .lights = e->lights,
        .tables = e->tables,
        .view = &sample->view,
        .surface = &e->surface,
        .behind = { pell_cpu_light_points, e },
        .total = (const float(*)[3]) f->materials->total,
        .smooth = f->settings->boundary == PELL_BOUNDARY_MODEL_SMOOTH,
        .bounces = f->settings->bounces,
        .sample = (uint32_t) sample->index,
        .light = { e->display[0], e->display[1], e->display[2] },
    };
    const double start = pell_seconds();
    const int64_t rays = pell_unscattered_render(e->pool, e->unscattered, &params);

    pell_stage_note(f->notes, "unscattered", pell_seconds() - start, e->surface.translucent_pixels, rays,
                    e->surface.translucent_pixels * 60);
}
