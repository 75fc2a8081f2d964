/* SPDX-License-Identifier: MIT
 * frame.c - one frame: the order in which its stages run. */
#include "render/renderer_state.h"

#include "render/intermediate.h"
#include "render/pass.h"
#include "render/post/dof.h"
#include "scene/scene.h"

#include <stdio.h>
#include <string.h>

#define DEFAULT_F_NUMBER 2.8 /* for a camera that does not specify it */

static bool finite3(const float v[3])
{
    return isfinite(v[0]) && isfinite(v[1]) && isfinite(v[2]);
}

/* The camera may have been moved since the scene was completed. */
static enum pell_result check_camera(struct pell_context *ctx, const struct pell_camera *c)
{
    const char *name = c->name && c->name[0] ? c->name : "camera";
    const struct pell_vec3 forward = vec3_normalize(vec3_load(c->forward));

    if (!finite3(c->position))
        return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "position = %g, %g, %g mm, must be finite", (double) c->position[0],
                          (double) c->position[1], (double) c->position[2]);
    if (!finite3(c->forward) || !finite3(c->up) || !(vec3_length(vec3_cross(forward, vec3_normalize(vec3_load(c->up)))) > 1e-6f))
        return pell_error(ctx, PELL_ERR_INVALID, name, NULL,
                          "forward = %g, %g, %g and up = %g, %g, %g, must have a length and not be parallel", (double) c->forward[0],
                          (double) c->forward[1], (double) c->forward[2], (double) c->up[0], (double) c->up[1], (double) c->up[2]);
    if (!(c->ortho_height >= 0.0f && c->ortho_height <= 1e12f))
        return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "ortho_height = %g mm, must be in [0, 1e12]", (double) c->ortho_height);
    if (c->ortho_height == 0.0f && !(c->fov >= 1e-4f && c->fov <= 3.14f))
        return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "fov = %g, must be in [0.0001, 3.14] radians", (double) c->fov);
    return PELL_OK;
}

/* See struct pell_camera. */
static enum pell_result make_lens(const struct pell_renderer *r, const struct pell_settings *s, struct pell_lens *lens)
{
    const struct pell_camera *c = &r->scene->cameras[0];
    const char *name = c->name && c->name[0] ? c->name : "camera";
    const struct pell_vec3 middle = vec3_mul(vec3_add(vec3_load(r->scene->bounds_min), vec3_load(r->scene->bounds_max)), 0.5f);

    *lens = (struct pell_lens) { 0 };
    if (!s->dof)
        return PELL_OK;
    if (c->ortho_height > 0.0f)
        return pell_error(r->ctx, PELL_ERR_INVALID, name, "leave dof off", "an orthographic camera has no lens, so no depth of field");
    if (c->f_number != 0.0f && !(c->f_number >= 0.1f && c->f_number <= 1e6f))
        return pell_error(r->ctx, PELL_ERR_INVALID, name, NULL, "f_number = %g, must be in [0.1, 1e6]", (double) c->f_number);
    lens->focus = c->focus;
    if (c->focus == 0.0f)
        lens->focus = vec3_dot(vec3_sub(middle, vec3_load(c->position)), vec3_normalize(vec3_load(c->forward)));
    if (!(lens->focus >= 1e-3f && lens->focus <= 1e12f))
        return pell_error(r->ctx, PELL_ERR_INVALID, name, "give the camera a focus",
                          c->focus == 0.0f ? "the centre of the bounds is %g mm in front of the camera, which can't focus on it"
                                           : "focus = %g mm, must be in [0.001, 1e12]",
                          (double) lens->focus);
    lens->radius = (float) (6.0 / tan(0.5 * (double) c->fov) / (c->f_number > 0.0f ? (double) c->f_number : DEFAULT_F_NUMBER));
    return PELL_OK;
}

static struct pell_view sample_view(const struct pell_renderer *r, const struct pell_settings *settings, int sample)
{
    struct pell_view view;
    float dx, dy;

    pell_golden_grid(sample, settings->msaa, &dx, &dy);
    view = pell_view_make(&r->scene->cameras[0], settings->width, settings->height, dx, dy);
    pell_view_through(&view, &r->lens, sample, settings->msaa);
    return view;
}

/* --- One frame ---------------------------------------------------------------------------------------------------------------- */

static void widen(struct pell_rect *rect, int by, int width, int height)
{
    if (rect->x0 >= rect->x1)
        return;
    rect->x0 = rect->x0 > by ? rect->x0 - by : 0;
    rect->y0 = rect->y0 > by ? rect->y0 - by : 0;
    rect->x1 = rect->x1 < width - by ? rect->x1 + by : width;
    rect->y1 = rect->y1 < height - by ? rect->y1 + by : height;
}

/* Shows the planes that a method reads, or those that it has written. */
static enum pell_result show_planes(struct pell_renderer *r, const struct pell_frame *in, const struct pell_frame_light *out, bool of_light)
{
    const enum pell_quantity quantity = pell_pass_plan(r->pass)->quantity;
    enum pell_result res = PELL_OK;

    for (int i = 0; i < PELL_PLANES && res == PELL_OK; i++) {
        const struct pell_plane_info *p = pell_plane_at(i);
        const void *planes[3];
        char name[64];
        struct pell_intermediate image = {
            .name = name, .unit = pell_plane_unit(p, quantity), .what = p->what, .components = p->components
        };
        if (p->of_light != of_light)
            continue;
        pell_plane_pointers(p, in, out, planes);
        snprintf(name, sizeof(name), "frame.%s", p->name);
        image.color = p->components == 3 && i != PELL_PLANE_NORMAL && i != PELL_PLANE_POSITION;
        if (planes[0])
            res = pell_show_pixels(&r->services, in, planes, p->format, &image);
    }
    return res;
}

/* The method's frame of a sample, without its planes. */
static struct pell_frame method_frame(const struct pell_renderer *r, const struct pell_engine_sample *sample)
{
    return (struct pell_frame) {
        .shape = pell_renderer_shape(r, &sample->view),
        .sample = sample->index,
        .num_samples = r->settings.msaa,
        .first = !r->scattered,
        .seed = pell_settings_seed(&r->settings),
        .lights_revision = r->lights_revision,
        .view = &sample->view,
    };
}

/* Runs the method over one sample's surface and lighting. */
static enum pell_result scatter(struct pell_renderer *r, const struct pell_engine_sample *sample, const struct pell_engine_seen *seen,
                                struct pell_engine_scattered *scattered)
{
    const struct pell_engine_interface *engine = r->device->engine;
    struct pell_frame in = *sample->in;
    struct pell_frame_light out = { .light = { NULL } };
    struct pell_pass_time times[PELL_STAGES_MOST];
    double start;
    size_t n;
    enum pell_result res;

    if (sample->frame->plan->needs & PELL_NEED_SHADED)
        PELL_TRY(engine->shade(r->engine, sample));
    engine->hand_over(r->engine, sample, &in, &out);
    if (pell_services_observed(&r->services, &in))
        PELL_TRY(show_planes(r, &in, &out, false));
    start = pell_seconds();
    PELL_TRY(pell_pass_render(r->pass, &in, &out));
    if (pell_services_observed(&r->services, &in))
        PELL_TRY(show_planes(r, &in, &out, true));
    r->scattered = scattered->present = true;
    n = pell_pass_times(r->pass, times, PELL_COUNT(times));
    for (size_t i = 0; i < n; i++)
        pell_stage_note(&r->notes, times[i].name, times[i].seconds, times[i].pixels, times[i].rays, times[i].bytes);
    if (n == 0)
        pell_stage_note(&r->notes, r->method->name, pell_seconds() - start, seen->translucent_pixels, 0, seen->translucent_pixels * 24);
    if (pell_pass_standard_error(r->pass, scattered->standard_error))
        r->noisy = true;
    return PELL_OK;

fail:
    return res;
}

static enum pell_result render_sample(struct pell_renderer *r, const struct pell_engine_frame *frame, int index)
{
    const struct pell_engine_interface *engine = r->device->engine;
    struct pell_engine_sample sample = { frame, sample_view(r, frame->settings, index), index, NULL };
    const struct pell_frame in = r->pass ? method_frame(r, &sample) : (struct pell_frame) { .sample = index };
    struct pell_engine_seen seen = { .translucent_pixels = 0 };
    struct pell_engine_scattered scattered = { .present = false };
    bool done = false;
    enum pell_result res;

    sample.in = r->pass ? &in : NULL;
    if (engine->sample)
        PELL_TRY(engine->sample(r->engine, &sample, r->pass, &seen, &done));
    if (done) {
        pell_rect_unite(&r->translucent, &seen.translucent);
        r->scattered |= r->pass && seen.translucent_pixels > 0;
        return PELL_OK;
    }
    PELL_TRY(engine->surface(r->engine, &sample, &seen));
    pell_rect_unite(&r->translucent, &seen.translucent);
    PELL_TRY(engine->irradiance(r->engine, &sample));
    if (r->pass && seen.translucent_pixels > 0)
        PELL_TRY(scatter(r, &sample, &seen, &scattered));
    PELL_TRY(engine->composite(r->engine, &sample, &scattered));
    return PELL_OK;

fail:
    return res;
}

/* Renders as many samples as the settings request, or those before an interruption. */
static enum pell_result render_samples(struct pell_renderer *r, const struct pell_engine_frame *frame, bool *partial)
{
    const bool may_end = r->pass && r->method->partial;
    const int msaa = frame->settings->msaa;
    enum pell_result res = PELL_OK;

    if (may_end)
        pell_interruptible(r->ctx, 1);
    for (int i = 0; res == PELL_OK && i < msaa; i++) {
        res = render_sample(r, frame, i);
        /* The method may reject a sample as too incomplete. */
        if (may_end && !pell_cancelled(r->ctx) &&
            (res == PELL_OK ? pell_context_interrupted(r->ctx) : res == PELL_ERR_CANCELLED && i > 0)) {
            *partial = pell_context_interrupted(r->ctx);
            r->device->engine->average(r->engine, res == PELL_OK ? i + 1 : i, msaa);
            res = PELL_OK;
            break;
        }
        if (res == PELL_OK && msaa > 1 && !may_end)
            pell_progress(r->ctx, "render", (double) (i + 1) / msaa);
    }
    if (may_end)
        pell_interruptible(r->ctx, -1);
    return res;
}

/* Bounds of the pixels that any sample of the frame may cover. */
static struct pell_rect find_covered(const struct pell_renderer *r, const struct pell_settings *s, const struct pell_view *view)
{
    const struct pell_scene *scene = r->scene;
    const struct pell_rect all = { 0, 0, s->width, s->height };
    /* Layers are cleared by the composite alone, so with layers it covers the whole image. */
    struct pell_rect covered = scene->ground_mesh >= 0 || s->layers ? all : pell_view_rect(view, scene->bounds_min, scene->bounds_max);

    for (int i = 0; r->lens.radius > 0.0f && i < s->msaa; i++) {
        const struct pell_view lens_view = sample_view(r, s, i);
        const struct pell_rect rect = pell_view_rect(&lens_view, scene->bounds_min, scene->bounds_max);
        pell_rect_unite(&covered, &rect);
    }
    if (r->lens.radius > 0.0f)
        widen(&covered, PELL_DOF_MOST + 1, s->width, s->height);
    return covered;
}

static void warn_of_nothing(const struct pell_renderer *r, const struct pell_engine_result *result)
{
    if (!result->covered)
        pell_warn(r->ctx, "render",
                  pell_scene_has_area(r->scene) ? "check the camera: `pellucid check` prints where the objects are"
                                                : "none of the scene's triangles has an area",
                  "nothing is in view");
    else if (!result->any_light)
        pell_warn(r->ctx, "render", "check the lights, and that neither they nor the camera are inside a closed object",
                  "no light reaches the visible surfaces: the image is black");
    else if (result->negligible)
        pell_warn(r->ctx, "render", "check the units of the lights; --environment-scale multiplies an environment's radiance",
                  "the light on the visible surfaces is negligible, with radiances below 1e-30 W/(m^2 sr): the image is black");
    if (result->invalid > 0)
        pell_warn(r->ctx, "render", "please report the scene", "%s set to 0",
                  pell_counted(result->invalid, "pixel was not finite and was", "pixels were not finite and were").str);
}

/* Parts of the lens whose discs are clipped do not overlap: each shows its own copy of out-of-focus content. From the edge of the lens,
 * nearer objects may be visible than from where most samples are; no more samples than this are added for that. */
static void warn_of_copies(const struct pell_renderer *r, const struct pell_settings *s, const struct pell_engine_result *result)
{
    const double n = (double) s->msaa, ratio = (double) result->widest_disc / PELL_DOF_MOST;
    const double needed = ceil(n * ratio * ratio * (1.0 + 1.0 / (n * n)));
    char hint[64];

    if (!(ratio > 1.0))
        return;
    snprintf(hint, sizeof(hint), "--msaa %.0f", needed);
    pell_warn(r->ctx, "depth of field", needed <= PELL_MSAA_MOST ? hint : "a larger f-number, or less out of focus",
              "the most out-of-focus surfaces show as separate copies: the lens needs %.0f samples, not %d", needed, s->msaa);
}

static bool can_denoise(const struct pell_renderer *r)
{
    if (!r->settings.denoise)
        return false;
    if (!r->noisy || !r->settings.layers || r->lens.radius > 0.0f)
        pell_warn(r->ctx, "denoise", r->noisy || !r->scattered ? NULL : "path-trace, dipole and single-scatter do",
                  "nothing is denoised: %s",
                  !r->scattered         ? "only scattered light is filtered, and there is none"
                  : !r->noisy           ? "the method does not estimate its noise"
                  : !r->settings.layers ? "the layers are not computed"
                                        : "its weights are not valid after the blur of depth of field");
    else
        pell_info(r->ctx, "denoise", "the image is denoised for display: do not use it as a reference");
    return r->noisy && r->settings.layers && r->lens.radius == 0.0f;
}

/* Adds a row for the part of `seconds` that no row has yet. */
static void note_preparation(struct pell_renderer *r, double seconds)
{
    for (size_t i = 0; i < r->notes.count; i++)
        seconds -= 1e-3 * (double) r->notes.rows[i].ms;
    if (seconds > 1e-4)
        pell_stage_note(&r->notes, "prepare", seconds, 0, 0, 0);
}

enum pell_result pell_renderer_render(struct pell_renderer *r, const struct pell_settings *settings, struct pell_render_result *image)
{
    if (!r || !settings || !image)
        return pell_null(r ? r->ctx : NULL, "pell_renderer_render");

    const double begin = pell_seconds();
    struct pell_engine_frame frame = { .settings = &r->settings, .materials = &r->materials, .lens = &r->lens, .notes = &r->notes };
    struct pell_engine_result result;
    struct pell_view view;
    bool partial = false;
    enum pell_result res;

    memset(image, 0, sizeof(*image));
    if (!r->scene)
        return pell_error(r->ctx, PELL_ERR_INVALID, "render", NULL, "the renderer has no scene");
    PELL_TRY(pell_knobs_check(r->ctx, pell_settings_knobs(), "settings", settings));
    if (r->bandwidth.wanted)
        PELL_TRY(pell_bandwidth_plan(r->ctx, &r->bandwidth, settings->width, settings->height));
    r->notes.count = 0;
    r->translucent = (struct pell_rect) { 0 };
    r->noisy = r->scattered = false;
    PELL_TRY(check_camera(r->ctx, &r->scene->cameras[0]));
    if (pell_scene_check_lights(r->scene) != PELL_OK)
        return PELL_ERR_INVALID; /* whatever made the scene, a program changed its lights since */
    if (r->has_checkpoint && !(r->method && r->method->partial))
        return pell_error(r->ctx, PELL_ERR_UNSUPPORTED, r->method ? r->method->name : "none", "path-trace does",
                          "keeps no state in a checkpoint file");
    view = pell_view_make(&r->scene->cameras[0], settings->width, settings->height, 0.0f, 0.0f);
    PELL_TRY(make_lens(r, settings, &r->lens));
    PELL_TRY(pell_renderer_prepare(r, settings, &view));
    note_preparation(r, pell_seconds() - begin);

    frame.scene = r->scene;
    frame.plan = r->pass ? pell_pass_plan(r->pass) : NULL;
    frame.covered = find_covered(r, settings, &view);
    frame.observed = r->observer.show != NULL;
    PELL_TRY(render_samples(r, &frame, &partial));
    frame.denoise = can_denoise(r);
    PELL_TRY(r->device->engine->post(r->engine, &frame, &view));
    r->device->engine->read_back(r->engine, &frame, r->noisy, r->channels, &result);
    *image = (struct pell_render_result) {
        .width = settings->width,
        .height = settings->height,
        .stride = result.stride,
        .channels = r->channels,
        .num_channels = result.num_channels,
        .display = { result.display[0], result.display[1], result.display[2] },
        .alpha = result.alpha,
        .stages = r->notes.rows,
        .num_stages = r->notes.count,
        .seconds = pell_seconds() - begin,
        .invalid = result.invalid,
        .exposure = result.exposure,
        .white = result.white,
        .rect = r->translucent,
        .partial = partial,
        .unfinished = r->pass && pell_pass_unfinished(r->pass),
        .unwritten = r->pass && pell_pass_unwritten(r->pass),
    };
    if (r->bandwidth.wanted)
        pell_bandwidth_measure(r->device->pool, &r->bandwidth, r->notes.rows, r->notes.count);
    warn_of_nothing(r, &result);
    warn_of_copies(r, settings, &result);
    return PELL_OK;

fail:
    return res;
}
