/* SPDX-License-Identifier: MIT
 * engine_cpu_end.c - stages after the composite: depth of field per sample, then the end of a frame. */
#include "render/denoise/stage.h"
#include "render/engine_cpu_state.h"

/* Names of the rows for work on the device. */
struct device_rows {
    const char *pack, *upload, *run, *download, *unpack;
};

static void note_device(struct pell_stage_notes *notes, const struct device_rows *rows, const struct pell_post_device_times *t,
                        int64_t pixels)
{
    if (t->bytes_up > 0) {
        pell_stage_note(notes, rows->pack, t->pack, pixels, 0, 2 * t->bytes_up);
        pell_stage_note(notes, rows->upload, t->upload, pixels, 0, 2 * t->bytes_up);
        pell_stage_note(notes, rows->run, t->run, pixels, 0, t->bytes_run);
    }
    if (t->bytes_down > 0) {
        pell_stage_note(notes, rows->download, t->download, pixels, 0, 2 * t->bytes_down);
        pell_stage_note(notes, rows->unpack, t->unpack, pixels, 0, 2 * t->bytes_down);
    }
}

/* Whether the device does the work; `why`: the reason if it refuses, which becomes a row; else NULL. */
static bool on_device(const struct pell_cpu *e, const char *why, struct pell_stage_notes *notes)
{
    if (e->post_device && why)
        pell_stage_note(notes, why, 0.0, 0, 0, 0);
    return e->post_device && !why;
}

/* --- Depth of field ------------------------------------------------------------------------------------------------------------------ */

static const struct device_rows lens_rows = { "lens pack", "lens upload", "depth of field", "lens download", "lens unpack" };

enum pell_result pell_cpu_composite_through_lens(struct pell_cpu *e, const struct pell_engine_sample *sample)
{
    float *const out[] = { e->sum.color[0], e->sum.color[1], e->sum.color[2], e->sum.alpha };
    const struct pell_engine_frame *f = sample->frame;
    const struct pell_rect rect = f->covered;
    const int64_t pixels = (int64_t) (rect.x1 - rect.x0) * (rect.y1 - rect.y0);
    struct pell_accumulator pinhole = e->sum;
    const struct pell_dof_params params = { .surface = &e->surface,
                                            .rect = rect,
                                            .scale = f->lens->radius / sqrtf((float) f->settings->msaa) * sample->view.focal_px,
                                            .focus = f->lens->focus,
                                            .first = sample->index == 0 };
    struct pell_post_device_times times;
    double start = pell_seconds();
    enum pell_result res;

    for (int c = 0; c < 3; c++)
        pinhole.color[c] = e->pinhole[c];
    pinhole.alpha = e->pinhole[3];
    for (int c = 0; c < 4 && !params.first; c++)
        for (int y = rect.y0; y < rect.y1 && rect.x0 < rect.x1; y++)
            memset(e->pinhole[c] + y * e->surface.stride + rect.x0, 0, (size_t) (rect.x1 - rect.x0) * sizeof(float));
    pell_composite_render(e->pool, e->compositor, &e->composite, &pinhole);
    pell_stage_note(f->notes, "composite", pell_seconds() - start, e->surface.covered_pixels, 0, e->surface.covered_pixels * 64);
    if (on_device(e, e->post_device ? pell_post_device_refuses_lens(e->post_device) : NULL, f->notes)) {
        res = pell_post_device_lens(e->post_device, e->pool, &params, e->pinhole, &times);
        e->lens_pending = res == PELL_OK;
        e->lens_scale = 1.0f;
        if (res == PELL_OK)
            note_device(f->notes, &lens_rows, &times, pixels);
        return res;
    }
    start = pell_seconds();
    e->lens_pending = false;
    e->widest_disc = fmaxf(params.first ? 0.0f : e->widest_disc, pell_dof_render(e->pool, &params, e->pinhole, e->pinhole_tiles, out));
    pell_stage_note(f->notes, "depth of field", pell_seconds() - start, pixels, 0, pixels * 40);
    return PELL_OK;
}

/* Adds the device's sum to the frame's planes. */
static enum pell_result take_lens(struct pell_cpu *e, const struct pell_engine_frame *f)
{
    float *const out[] = { e->sum.color[0], e->sum.color[1], e->sum.color[2], e->sum.alpha };
    struct pell_post_device_times times;
    const enum pell_result res = pell_post_device_take_lens(e->post_device, e->pool, e->lens_scale, out, &e->widest_disc, &times);

    e->lens_pending = false;
    if (res == PELL_OK)
        note_device(f->notes, &lens_rows, &times, (int64_t) (f->covered.x1 - f->covered.x0) * (f->covered.y1 - f->covered.y0));
    return res;
}

/* --- The end of a frame ------------------------------------------------------------------------------------------------------------ */

void pell_cpu_average(void *engine, int done, int planned)
{
    struct pell_cpu *e = engine;

    pell_output_layers_scale(&e->sum, (size_t) e->surface.stride * (size_t) e->surface.height, (float) planned / (float) done);
    e->lens_scale = (float) planned / (float) done;
}

static void denoise(struct pell_cpu *e, const struct pell_engine_frame *f)
{
    const struct pell_denoise_params params = {
        .stride = e->surface.stride,
        .rect = f->covered,
        .sum = &e->sum, /* all samples have been added */
        .traced = f->plan && (f->plan->outputs & PELL_OUTPUT_SURFACE),
        .scratch = { e->lighting.transmitted[0], e->lighting.transmitted[1], e->lighting.transmitted[2], e->lighting.specular[0] },
    };
    const int64_t pixels = (int64_t) (f->covered.x1 - f->covered.x0) * (f->covered.y1 - f->covered.y0);
    const double start = pell_seconds();

    if (!pell_denoise_has_variance(&params))
        pell_warn(e->ctx, "denoise", "more samples, or a smaller --msaa",
                  "nothing is denoised: with one sample per multisample the noise is not known");
    pell_denoise_render(e->pool, &params);
    pell_stage_note(f->notes, "denoise", pell_seconds() - start, pixels, 0, pixels * 100);
}

enum pell_result pell_cpu_post(void *engine, const struct pell_engine_frame *f, const struct pell_view *view)
{
    static const struct device_rows rows = { "bloom pack", "bloom upload", "bloom", "bloom download", "bloom unpack" };
    struct pell_cpu *e = engine;
    const bool blooms = f->settings->bloom > 0.0f,
               device = blooms && on_device(e, e->post_device ? pell_post_device_refuses_bloom(e->post_device) : NULL, f->notes);
    const struct pell_post_params params = {
        .scene = e->scene,
        .view = view,
        .lens = f->lens,
        .lights = e->lights,
        .contact = e->contact,
        .settings = f->settings,
        .width = f->settings->width,
        .height = f->settings->height,
        .rect = f->covered,
        .stride = e->surface.stride,
        .meter = e->sum.meter,
        .rows = e->rows,
        .bloom_scratch = e->bloom_scratch,
        .unfiltered = e->lighting.transmitted, /* no sample needs it any more */
        .device = device ? e->post_device : NULL,
    };
    const int64_t pixels = (int64_t) params.width * params.height;
    double start;
    enum pell_result res;

    if (e->lens_pending)
        PELL_TRY(take_lens(e, f));
    if (f->denoise)
        denoise(e, f);
    start = pell_seconds();
    PELL_TRY(pell_post_render(e->pool, &params, e->sum.color, e->sum.alpha, e->display, &e->post));
    if (pell_cancelled(e->ctx))
        return PELL_ERR_CANCELLED;
    pell_stage_note(f->notes, "post", pell_seconds() - start - e->post.bloom, pixels, 0, pixels * 44);
    if (device)
        note_device(f->notes, &rows, &e->post.on_device, pixels);
    else if (blooms)
        pell_stage_note(f->notes, "bloom", e->post.bloom, pixels, 0, pixels * 36);
    return PELL_OK;

fail:
    return res;
}
