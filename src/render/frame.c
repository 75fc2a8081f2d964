/* SPDX-License-Identifier: MIT
 * frame.c - one frame: the order in which its stages run. */
#include "render/renderer_state.h"

#include "scene/scene.h"

#include <string.h>

#define F_NUMBER 2.8 /* of a camera that does not say */

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
    if (!finite3(c->forward) || !finite3(c->up) ||
        !(vec3_length(vec3_cross(forward, vec3_normalize(vec3_load(c->up)))) > 1e-6f))
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
                          c->focus == 0.0f ? "the middle of the bounds is %g mm before the camera, which can't focus on it"
                                           : "focus = %g mm, must be in [0.001, 1e12]",
                          (double) lens->focus);
    lens->radius = (float) (6.0 / tan(0.5 * (double) c->fov) / (c->f_number > 0.0f ? (double) c->f_number : F_NUMBER));
    return PELL_OK;
}

/* Position of sample i of n in the pixel: one sample in each of n columns and n rows, the rows in the order of the golden section's
 * multiples (4 are the rotated grid). Their mean is the centre, so the picture stays where it is however many there are. */
static void sample_shift(int i, int n, float *x, float *y)
{
    const double golden = 0.6180339887498949, here = golden * (i + 1) - floor(golden * (i + 1));
    int rank = 0;

    for (int k = 1; k <= n; k++)
        rank += golden * k - floor(golden * k) < here;
    *x = ((float) i + 0.5f) / (float) n - 0.5f;
    *y = ((float) rank + 0.5f) / (float) n - 0.5f;
}

static struct pell_view sample_view(const struct pell_renderer *r, const struct pell_settings *settings, int sample)
{
    struct pell_view view;
    float dx, dy;

    sample_shift(sample, settings->msaa, &dx, &dy);
    view = pell_view_make(&r->scene->cameras[0], settings->width, settings->height, dx, dy);
    pell_view_through(&view, &r->lens, sample, settings->msaa);
    return view;
}

/* Adds a stage's time to its row, which the first sample makes. */
static void note(struct pell_renderer *r, const char *name, double seconds, int64_t pixels, int64_t rays, int64_t bytes)
{
    struct pell_stage_time *s = NULL;

    for (size_t i = 0; i < r->num_stages && !s; i++)
        if (strcmp(r->stages[i].name, name) == 0)
            s = &r->stages[i];
    if (!s) {
        if (r->num_stages == MAX_STAGES)
            return;
        s = &r->stages[r->num_stages++];
        *s = (struct pell_stage_time) { .name = name };
    }
    s->ms += 1e3 * seconds;
    s->pixels += pixels;
    s->rays += rays;
    s->bytes += bytes;
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

struct remap_task {
    const struct pell_renderer *r;
    const struct pell_view *view;
    uint16_t *out;
    float *const *position; /* NULL: not asked for */
};

static void remap_row(void *arg, int index, int worker)
{
    const struct remap_task *t = arg;
    const struct pell_surface *s = &t->r->surface;
    const int y = s->translucent.y0 + index;
    const ptrdiff_t row = y * s->stride;
    (void) worker;
    for (int x = s->translucent.x0; x < s->translucent.x1; x++)
        t->out[row + x] = t->r->frame_index[s->material[row + x]];
    for (int x = s->translucent.x0; t->position && x < s->translucent.x1; x++) {
        struct pell_vec3 start, direction, p;
        if (!t->out[row + x])
            continue;
        pell_view_ray(t->view, (float) x, (float) y, &start, &direction);
        p = vec3_mad(start, s->depth[row + x], direction);
        t->position[0][row + x] = p.x;
        t->position[1][row + x] = p.y;
        t->position[2][row + x] = p.z;
    }
}

/* Runs the method over one sample's surface and lighting; *exitance is NULL where nothing scatters. */
static enum pell_result scatter(struct pell_renderer *r, const struct pell_view *view, struct pell_composite_params *composite)
{
    const struct pell_surface *s = &r->surface;
    struct pell_frame frame = pell_renderer_frame(r, view);
    struct pell_frame_light out = { .light = { r->light[0], r->light[1], r->light[2] } };
    const struct pell_plan *plan;
    struct remap_task remap = { r, view, r->material, NULL };
    struct pell_pass_time times[MAX_STAGES];
    double start = pell_seconds();
    size_t n;
    enum pell_result res;

    if (!r->pass || s->translucent_pixels == 0)
        return PELL_OK;
    plan = pell_pass_plan(r->pass);
    if (plan->needs & PELL_NEED_POSITION)
        remap.position = r->position;
    for (int c = 0; c < 3; c++) {
        out.single[c] = (plan->gives & PELL_GIVES_SINGLE) ? r->single[c] : NULL;
        out.surface[c] = (plan->gives & PELL_GIVES_SURFACE) ? r->reflected[c] : NULL;
    }
    pell_pool_run(r->pool, s->translucent.y1 - s->translucent.y0, remap_row, &remap);
    if (pell_pass_plan(r->pass)->needs & PELL_NEED_LIT) {
        pell_composite_lit(r->pool, r->compositor, composite, r->lit);
        note(r, "lit", pell_seconds() - start, s->translucent_pixels, 0, s->translucent_pixels * 48);
    }
    frame.rect = s->translucent;
    frame.material = r->material;
    frame.depth = s->depth;
    frame.strength = s->strength;
    frame.mesh = s->mesh;
    frame.triangle = s->triangle;
    frame.barycentric[0] = s->barycentric[0];
    frame.barycentric[1] = s->barycentric[1];
    for (int c = 0; c < 3; c++) {
        frame.base[c] = s->base[c];
        frame.irradiance[c] = r->lighting.irradiance[c];
        frame.lit[c] = r->lit[c];
        frame.normal[c] = s->ns[c];
        frame.position[c] = remap.position ? r->position[c] : NULL;
    }
    start = pell_seconds();
    PELL_TRY(pell_pass_render(r->pass, &frame, &out));
    r->scattered = true;
    n = pell_pass_times(r->pass, times, PELL_COUNT(times));
    for (size_t i = 0; i < n; i++)
        note(r, times[i].name, times[i].seconds, times[i].pixels, times[i].rays, times[i].bytes);
    if (n == 0)
        note(r, r->method->name, pell_seconds() - start, s->translucent_pixels, 0, s->translucent_pixels * 24);
    composite->exitance = (const float *const *) r->light;
    composite->radiance = plan->quantity == PELL_QUANTITY_RADIANCE;
    composite->below = plan->below;
    composite->single = out.single[0] ? (const float *const *) r->single : NULL;
    composite->reflected = out.surface[0] ? (const float *const *) r->reflected : NULL;
    if (pell_pass_noise(r->pass, r->noise)) {
        composite->noise = r->noise;
        r->noisy = true;
    }
    return PELL_OK;

fail:
    return res;
}

/* The composite of one sample, blurred by its part of the lens. */
static void render_through_lens(struct pell_renderer *r, const struct pell_composite_params *composite)
{
    float *const out[] = { r->sum.color[0], r->sum.color[1], r->sum.color[2], r->sum.alpha };
    const struct pell_rect rect = composite->rect;
    struct pell_accumulator apart = r->sum;
    const struct pell_dof_params params = {
        .surface = &r->surface,
        .rect = rect,
        .scale = r->lens.radius / sqrtf((float) r->settings.msaa) * composite->view->focal_px,
        .focus = r->lens.focus,
        .first = composite->first,
    };
    double start = pell_seconds();

    for (int c = 0; c < 3; c++)
        apart.color[c] = r->open[c];
    apart.alpha = r->open[3];
    for (int c = 0; c < 4 && !composite->first; c++)
        for (int y = rect.y0; y < rect.y1 && rect.x0 < rect.x1; y++)
            memset(r->open[c] + y * r->surface.stride + rect.x0, 0, (size_t) (rect.x1 - rect.x0) * sizeof(float));
    pell_composite_render(r->pool, r->compositor, composite, &apart);
    note(r, "composite", pell_seconds() - start, r->surface.covered_pixels, 0, r->surface.covered_pixels * 64);
    start = pell_seconds();
    pell_dof_render(r->pool, &params, r->open, r->open_tiles, out);
    note(r, "depth of field", pell_seconds() - start, (int64_t) (rect.x1 - rect.x0) * (rect.y1 - rect.y0), 0,
         (int64_t) (rect.x1 - rect.x0) * (rect.y1 - rect.y0) * 40);
}

static enum pell_result render_sample(struct pell_renderer *r, const struct pell_settings *settings, int sample)
{
    const struct pell_surface *s = &r->surface;
    const struct pell_plan *plan = r->pass ? pell_pass_plan(r->pass) : NULL;
    struct pell_composite_params composite;
    struct pell_irradiance_params light;
    struct pell_view view = sample_view(r, settings, sample);
    double start = pell_seconds();
    enum pell_result res;

    r->eye = view;
    PELL_TRY(pell_surface_render(r->pool, r->rays, r->scene, &view, &r->surface));
    note(r, "surface", pell_seconds() - start, s->covered_pixels, s->rays, s->covered_pixels * 72);
    pell_rect_unite(&r->translucent, &s->translucent);

    start = pell_seconds();
    light = pell_renderer_light_params(r, plan ? plan->mix : -1.0f);
    light.view = &view;
    light.thickness = plan && (plan->needs & PELL_NEED_THROUGH) ? r->thickness : NULL;
    light.sample = (uint32_t) sample;
    PELL_TRY(pell_irradiance_render(r->pool, r->lights, &light, &r->lighting));
    note(r, "irradiance", pell_seconds() - start, s->covered_pixels, r->lighting.shadow_rays, s->covered_pixels * 108);

    composite = (struct pell_composite_params) {
        .scene = r->scene,
        .view = &view,
        .surface = s,
        .tables = r->tables,
        .lighting = &r->lighting,
        .total = (const float(*)[3]) r->total,
        .mix = plan ? plan->mix : -1.0f,
        .smooth = settings->boundary == PELL_BOUNDARY_SMOOTH,
        .published = settings->exit == PELL_EXIT_PUBLISHED,
        .rect = r->covered,
        .weight = 1.0f / (float) settings->msaa,
        .first = sample == 0,
    };
    PELL_TRY(scatter(r, &view, &composite));

    start = pell_seconds();
    if (r->lens.radius > 0.0f) {
        render_through_lens(r, &composite);
    } else {
        pell_composite_render(r->pool, r->compositor, &composite, &r->sum);
        note(r, "composite", pell_seconds() - start, s->covered_pixels, 0, s->covered_pixels * 64);
    }
    return pell_cancelled(r->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    return res;
}

static size_t add_rgb(struct pell_channel *out, const char *const names[3], float *const planes[3], ptrdiff_t stride)
{
    for (int c = 0; c < 3; c++)
        out[c] = (struct pell_channel) { names[c], planes[c], stride, false };
    return 3;
}

/* Names as spec/cli.md lists the layers. */
static size_t list_channels(struct pell_renderer *r, bool layers)
{
    static const char *const rgb[] = { "R", "G", "B" };
    static const char *const multiple[] = { "diffuse.multiple.R", "diffuse.multiple.G", "diffuse.multiple.B" };
    static const char *const single[] = { "diffuse.single.R", "diffuse.single.G", "diffuse.single.B" };
    static const char *const transmission[] = { "transmission.R", "transmission.G", "transmission.B" };
    static const char *const specular[] = { "specular.R", "specular.G", "specular.B" };
    static const char *const irradiance[] = { "irradiance.R", "irradiance.G", "irradiance.B" };
    static const char *const normal[] = { "normal.X", "normal.Y", "normal.Z" };
    static const char *const variance[] = { "variance.R", "variance.G", "variance.B" };
    const ptrdiff_t stride = r->surface.stride;
    struct pell_channel *c = r->channels;
    size_t n = add_rgb(c, rgb, r->sum.color, stride);

    c[n++] = (struct pell_channel) { "A", r->sum.alpha, stride, false };
    if (layers) {
        n += add_rgb(c + n, multiple, r->sum.multiple, stride);
        n += add_rgb(c + n, transmission, r->sum.transmission, stride);
        n += add_rgb(c + n, specular, r->sum.specular, stride);
        n += add_rgb(c + n, irradiance, r->sum.irradiance, stride);
        n += add_rgb(c + n, normal, r->sum.normal, stride);
        c[n++] = (struct pell_channel) { "depth.Z", r->sum.depth, stride, true };
        c[n++] = (struct pell_channel) { "translucent.Y", r->sum.translucent, stride, false };
        if (r->sum.single[0] && r->pass && (pell_pass_plan(r->pass)->gives & PELL_GIVES_SINGLE))
            n += add_rgb(c + n, single, r->sum.single, stride);
        if (r->noisy) {
            n += add_rgb(c + n, variance, r->sum.variance, stride);
            for (size_t i = n - 3; i < n; i++)
                c[i].full_float = true; /* squares of small numbers */
        }
    }
    return n;
}

/* A picture of fewer samples than planned: their mean. `done` is one of them at least. */
static void make_whole(struct pell_renderer *r, int done, int planned)
{
    const struct pell_accumulator *a = &r->sum;
    const float up = (float) planned / (float) done;
    float *const planes[] = { a->color[0],        a->color[1],        a->color[2],        a->alpha,         a->multiple[0],
                              a->multiple[1],     a->multiple[2],     a->single[0],       a->single[1],     a->single[2],
                              a->transmission[0], a->transmission[1], a->transmission[2], a->specular[0],   a->specular[1],
                              a->specular[2],     a->irradiance[0],   a->irradiance[1],   a->irradiance[2], a->normal[0],
                              a->normal[1],       a->normal[2],       a->translucent };
    const size_t size = (size_t) r->surface.stride * (size_t) r->surface.height;

    for (size_t k = 0; k < PELL_COUNT(planes); k++)
        for (size_t i = 0; planes[k] && i < size; i++)
            planes[k][i] *= up;
    for (int c = 0; c < 3; c++)
        for (size_t i = 0; a->variance[c] && i < size; i++)
            a->variance[c][i] *= up * up;
}

static enum pell_result render_samples(struct pell_renderer *r, const struct pell_settings *settings, struct pell_picture *picture)
{
    const bool may_end = r->pass && r->method->partial;
    enum pell_result res = PELL_OK;

    if (may_end)
        pell_partial(r->ctx, 1);
    for (int i = 0; res == PELL_OK && i < settings->msaa; i++) {
        r->sample = i;
        res = render_sample(r, settings, i);
        if (may_end && pell_context_interrupted(r->ctx) && !pell_cancelled(r->ctx) &&
            (res == PELL_OK || (res == PELL_ERR_CANCELLED && i > 0))) { /* a sample may be too incomplete to count */
            picture->partial = true;
            make_whole(r, res == PELL_OK ? i + 1 : i, settings->msaa);
            res = PELL_OK;
            break;
        }
        if (res == PELL_OK && settings->msaa > 1 && !may_end)
            pell_progress(r->ctx, "render", (double) (i + 1) / settings->msaa);
    }
    if (may_end)
        pell_partial(r->ctx, -1);
    return res;
}

enum pell_result pell_renderer_render(struct pell_renderer *r, const struct pell_settings *settings, struct pell_picture *picture)
{
    struct pell_post_result post;
    struct pell_view view;
    int64_t pixels;
    double start, begin;
    bool partial;
    enum pell_result res;

    memset(picture, 0, sizeof(*picture));
    if (!r->scene)
        return pell_error(r->ctx, PELL_ERR_INVALID, "render", NULL, "the renderer has no scene");
    PELL_TRY(pell_knobs_check(r->ctx, pell_settings_knobs, "settings", settings));
    if (r->copies.wanted)
        PELL_TRY(pell_copies_plan(r->ctx, &r->copies, settings->width, settings->height));
    begin = pell_seconds();
    r->num_stages = 0;
    r->translucent = (struct pell_rect) { 0 };
    r->noisy = r->scattered = false;
    PELL_TRY(check_camera(r->ctx, &r->scene->cameras[0]));
    if (r->checkpoint.path && !(r->method && r->method->partial))
        return pell_error(r->ctx, PELL_ERR_UNSUPPORTED, r->method ? r->method->name : "none", "path-trace does",
                          "keeps no state in a checkpoint file");
    view = pell_view_make(&r->scene->cameras[0], settings->width, settings->height, 0.0f, 0.0f);
    PELL_TRY(make_lens(r, settings, &r->lens));
    PELL_TRY(pell_renderer_prepare(r, settings, &view));
    if (pell_seconds() - begin > 1e-4)
        note(r, "prepare", pell_seconds() - begin, 0, 0, 0);

    /* Layers are cleared by the composite alone, so that it goes over all of the picture for them. */
    r->covered = r->scene->ground_mesh >= 0 || settings->layers
                     ? (struct pell_rect) { 0, 0, settings->width, settings->height }
                     : pell_view_rect(&view, r->scene->bounds_min, r->scene->bounds_max);
    for (int i = 0; r->lens.radius > 0.0f && i < settings->msaa; i++) {
        const struct pell_view through = sample_view(r, settings, i);
        const struct pell_rect rect = pell_view_rect(&through, r->scene->bounds_min, r->scene->bounds_max);
        pell_rect_unite(&r->covered, &rect);
    }
    if (r->lens.radius > 0.0f)
        widen(&r->covered, PELL_DOF_MOST + 1, settings->width, settings->height);
    PELL_TRY(render_samples(r, settings, picture));
    partial = picture->partial;

    start = pell_seconds();
    pell_post_render(r->pool,
                     &(struct pell_post_params) {
                         .scene = r->scene,
                         .view = &view,
                         .lens = &r->lens,
                         .lights = r->lights,
                         .settings = settings,
                         .width = settings->width,
                         .height = settings->height,
                         .rect = r->covered,
                         .stride = r->surface.stride,
                         .meter = r->sum.meter,
                         .rows = r->rows,
                         .glow = r->glow,
                     },
                     r->sum.color, r->sum.alpha, r->display, &post);
    if (pell_cancelled(r->ctx))
        return PELL_ERR_CANCELLED;
    pixels = (int64_t) settings->width * settings->height;
    note(r, "post", pell_seconds() - start - post.bloom, pixels, 0, pixels * 44);
    if (settings->bloom > 0.0f)
        note(r, "bloom", post.bloom, pixels, 0, pixels * 36);

    *picture = (struct pell_picture) {
        .width = settings->width,
        .height = settings->height,
        .stride = r->surface.stride,
        .channels = r->channels,
        .num_channels = list_channels(r, settings->layers),
        .display = { r->display[0], r->display[1], r->display[2] },
        .alpha = r->sum.alpha,
        .stages = r->stages,
        .num_stages = r->num_stages,
        .seconds = pell_seconds() - begin,
        .invalid = post.invalid,
        .exposure = post.exposure,
        .rect = r->translucent,
        .partial = partial,
    };
    if (r->copies.wanted)
        pell_copies_measure(r->pool, &r->copies, r->stages, r->num_stages);
    if (!post.covered)
        pell_warn(r->ctx, "render",
                  pell_scene_has_area(r->scene) ? "check the camera: `pellucid check` prints where the things are"
                                                : "none of the scene's triangles has an area",
                  "nothing is in view");
    else if (!post.lit)
        pell_warn(r->ctx, "render", "check the lights, and that neither they nor the camera are inside a closed thing",
                  "no light arrives at what is in view: the picture is black");
    if (post.invalid > 0)
        pell_warn(r->ctx, "render", "please report the scene", "%lld pixels came out as no number and were set to 0",
                  (long long) post.invalid);
    return PELL_OK;

fail:
    return res;
}
