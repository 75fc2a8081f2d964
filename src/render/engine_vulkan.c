/* SPDX-License-Identifier: MIT
 *
 * engine_vulkan.c - the engine vulkan: whole samples are rendered on a Vulkan device (picture/device.h) if it has all they need; otherwise
 * methods, direct light, transmission, depth of field and bloom run there, and all other stages on the CPU engine.
 */
#include "render/engine_cpu_state.h"

static const struct pell_method_engine *vulkan_method(const struct pell_method *method)
{
    return method->vulkan;
}

static enum pell_result vulkan_open(struct pell_context *ctx, struct pell_pool *pool, struct pell_gpu *gpu, void **engine)
{
    struct pell_cpu *e;
    enum pell_result res;

    PELL_TRY(pell_engine_cpu.open(ctx, pool, gpu, engine));
    e = *engine;
    PELL_TRY(pell_light_device_create(ctx, gpu, &e->light_device));
    PELL_TRY(pell_picture_device_create(ctx, gpu, &e->picture));
    return pell_post_device_create(ctx, gpu, &e->post_device);

fail:
    return res;
}

static void vulkan_close(void *engine)
{
    struct pell_cpu *e = engine;

    if (e) {
        pell_picture_device_destroy(&e->picture);
        pell_light_device_destroy(&e->light_device);
        pell_post_device_destroy(&e->post_device);
    }
    pell_engine_cpu.close(engine);
}

static void vulkan_drop(void *engine, enum pell_engine_resource resource)
{
    struct pell_cpu *e = engine;

    if (resource == PELL_ENGINE_SCENE)
        pell_light_device_drop_scene(e->light_device);
    if (resource == PELL_ENGINE_LIGHTS)
        pell_light_device_drop_lights(e->light_device);
    if (resource == PELL_ENGINE_PLANES)
        pell_post_device_drop(e->post_device);
    if (resource == PELL_ENGINE_SCENE || resource == PELL_ENGINE_PLANES)
        pell_picture_device_drop(e->picture);
    pell_engine_cpu.drop(engine, resource);
}

static enum pell_result vulkan_make(void *engine, enum pell_engine_resource resource, const struct pell_engine_frame *frame)
{
    const struct pell_settings *s = frame->settings;
    enum pell_result res = pell_engine_cpu.make(engine, resource, frame);
    struct pell_cpu *e = engine;

    if (res != PELL_OK)
        return res;
    if (resource == PELL_ENGINE_SCENE)
        res = pell_light_device_set_scene(e->light_device, frame->scene);
    if (resource == PELL_ENGINE_LIGHTS)
        res = pell_light_device_set_lights(e->light_device, e->lights, e->tables);
    if (resource == PELL_ENGINE_PLANES)
        res = pell_light_device_reserve(e->light_device, (size_t) e->surface.stride * (size_t) s->height);
    if (resource == PELL_ENGINE_PLANES && res == PELL_OK)
        res = pell_post_device_reserve(e->post_device, s->width, s->height, s->dof, s->bloom > 0.0f);
    if (res != PELL_OK)
        vulkan_drop(engine, resource);
    return res;
}

/* --- Whole samples ------------------------------------------------------------------------------------------------------------------- */

static enum pell_result vulkan_sample(void *engine, const struct pell_engine_sample *sample, struct pell_pass *pass,
                                      struct pell_engine_seen *seen, bool *done)
{
    struct pell_cpu *e = engine;
    struct pell_irradiance_params light = pell_cpu_sample_light(e, sample);
    const struct pell_composite_params composite = pell_cpu_sample_composite(e, sample, &light);
    const struct pell_picture_sample picture = {
        .sample = sample,
        .light = e->light_device,
        .irradiance = &light,
        .composite = &composite,
        .pass = pass,
        .unscattered = pass && pell_cpu_sees_through(e, sample->frame),
        .spreads = pass && pell_cpu_spreads(sample->frame),
        .lens = sample->frame->lens->radius > 0.0f ? e->post_device : NULL,
        .rays = e->lights ? e->lights->light_samples : 1,
        .version = e->solids_version,
    };
    const char *why = NULL;
    enum pell_result res;

    if (!pell_light_device_refuses(e->light_device)) {
        res = pell_light_device_set_thickness(e->light_device, &light);
        if (res != PELL_OK)
            return res;
    }
    if (sample->index == 0) {
        why = pell_picture_device_refuses(e->picture, &picture);
        e->pictured = !why;
        e->lens_pending = false;
    }
    if (why)
        pell_stage_note(sample->frame->notes, why, 0.0, 0, 0, 0);
    *done = e->pictured;
    if (!e->pictured)
        return PELL_OK;
    res = pell_picture_device_sample(e->picture, &picture, seen);
    e->lens_pending = res == PELL_OK && picture.lens && composite.rect.x0 < composite.rect.x1 && composite.rect.y0 < composite.rect.y1;
    e->lens_scale = 1.0f;
    return res;
}

static enum pell_result vulkan_post(void *engine, const struct pell_engine_frame *frame, const struct pell_view *view)
{
    struct pell_cpu *e = engine;
    enum pell_result res = PELL_OK;

    if (e->pictured)
        res = pell_picture_device_take(e->picture, e->pool, frame->notes, &e->sum, e->surface.stride, &frame->covered, e->lens_pending);
    return res == PELL_OK ? pell_cpu_post(engine, frame, view) : res;
}

/* --- Light at points, in batches ----------------------------------------------------------------------------------------------------- */

static struct pell_irradiance_params points_light(const struct pell_cpu *e, const struct pell_points_params *params)
{
    struct pell_irradiance_params p = pell_cpu_points_light(e, params);

    p.device = e->light_device;
    return p;
}

static size_t batch_room(void *engine)
{
    const struct pell_cpu *e = engine;

    return pell_light_device_refuses(e->light_device) ? 0 : pell_light_device_room(e->light_device);
}

static uint32_t *batch_begin(void *engine)
{
    const struct pell_cpu *e = engine;

    pell_light_device_begin(e->light_device);
    return pell_light_device_slots(e->light_device);
}

static uint32_t batch_send(void *engine, const struct pell_points_params *params, const struct pell_surface_points *in, size_t n)
{
    const struct pell_cpu *e = engine;
    const struct pell_irradiance_params p = points_light(e, params);

    return pell_irradiance_send_points(e->lights, &p, params, in, n);
}

static enum pell_result batch_run(void *engine, const struct pell_points_params *params, double *seconds, int64_t *bytes)
{
    const struct pell_cpu *e = engine;
    struct pell_irradiance_params p = points_light(e, params);
    const struct pell_light_run run = { .params = &p };
    struct pell_light_device_times t;
    enum pell_result res;

    p.lights = params->lights;
    res = pell_light_device_run(e->light_device, &run);
    t = pell_light_device_times(e->light_device); /* the method's own, not the stage's */
    *seconds = t.upload + t.light + t.transmission + t.download;
    *bytes = 3 * (t.bytes_up + t.bytes_down); /* read and written by copies, then by the pass */
    return res;
}

static int64_t batch_take(void *engine, const struct pell_points_params *params, const struct pell_surface_points *in, size_t n,
                          uint32_t slot, const struct pell_surface_light *out)
{
    const struct pell_cpu *e = engine;
    const struct pell_irradiance_params p = points_light(e, params);

    return pell_irradiance_take_points(e->lights, &p, params, in, n, slot, out);
}

static void vulkan_lend(void *engine, struct pell_services *services)
{
    static const struct pell_light_batches batches = { batch_room, batch_begin, batch_send, batch_run, batch_take };

    pell_engine_cpu.lend(engine, services);
    services->batches = &batches;
}

void pell_engine_vulkan_make(struct pell_engine_interface *engine)
{
    *engine = pell_engine_cpu;
    engine->name = "vulkan";
    engine->method = vulkan_method;
    engine->open = vulkan_open;
    engine->close = vulkan_close;
    engine->make = vulkan_make;
    engine->drop = vulkan_drop;
    engine->lend = vulkan_lend;
    engine->sample = vulkan_sample;
    engine->post = vulkan_post;
}
