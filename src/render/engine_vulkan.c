/* SPDX-License-Identifier: MIT
 * engine_vulkan.c - the engine vulkan: methods run on a Vulkan device, and direct light is found there; all other stages of a frame are the
 * cpu engine's. */
#include "render/engine_cpu_state.h"

static const struct pell_method_engine *vulkan_method(const struct pell_method *method)
{
    return method->vulkan;
}

static enum pell_result vulkan_open(struct pell_context *ctx, struct pell_pool *pool, struct pell_gpu *gpu, void **engine)
{
    const enum pell_result res = pell_engine_cpu.open(ctx, pool, gpu, engine);
    struct pell_cpu *e = *engine;

    return res == PELL_OK ? pell_light_device_create(ctx, gpu, &e->device) : res;
}

static void vulkan_close(void *engine)
{
    struct pell_cpu *e = engine;

    if (e)
        pell_light_device_destroy(&e->device);
    pell_engine_cpu.close(engine);
}

static void vulkan_drop(void *engine, enum pell_engine_resource resource)
{
    struct pell_cpu *e = engine;

    if (resource == PELL_ENGINE_SCENE)
        pell_light_device_drop_scene(e->device);
    if (resource == PELL_ENGINE_LIGHTS)
        pell_light_device_drop_lights(e->device);
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
        res = pell_light_device_set_scene(e->device, frame->scene);
    if (resource == PELL_ENGINE_LIGHTS)
        res = pell_light_device_set_lights(e->device, e->lights, e->tables);
    if (resource == PELL_ENGINE_PLANES)
        res = pell_light_device_reserve(e->device, (size_t) e->surface.stride * (size_t) s->height);
    if (res != PELL_OK)
        vulkan_drop(engine, resource);
    return res;
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
}
