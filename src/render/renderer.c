/* SPDX-License-Identifier: MIT
 * renderer.c - the renderer and its inputs: scene, method, checkpoint. */
#include "render/renderer_state.h"

#include "render/engine_cpu.h"
#include "render/pass.h"

#include <string.h>

struct pell_device *pell_renderer_device(const struct pell_renderer *r)
{
    return r->device;
}

const struct pell_services *pell_renderer_services(const struct pell_renderer *r)
{
    return &r->services;
}

const struct pell_pass *pell_renderer_pass(const struct pell_renderer *r)
{
    return r->pass;
}

void pell_renderer_measure_copies(struct pell_renderer *r, bool wanted)
{
    r->bandwidth.wanted = wanted;
}

enum pell_result pell_renderer_create(struct pell_device *device, struct pell_renderer **out)
{
    struct pell_renderer *r = pell_zalloc(device->ctx, sizeof(*r));
    enum pell_result res;

    *out = NULL;
    if (!r)
        return PELL_ERR_NOMEM;
    r->ctx = device->ctx;
    r->device = device;
    PELL_TRY(device->engine->open(r->ctx, device->pool, &r->engine));
    *out = r;
    return PELL_OK;

fail:
    pell_renderer_destroy(&r);
    return res;
}

void pell_renderer_destroy(struct pell_renderer **renderer)
{
    struct pell_renderer *r = *renderer;
    if (!r)
        return;
    *renderer = NULL;
    pell_renderer_invalidate(r, ~0u);
    r->device->engine->close(r->engine);
    pell_bandwidth_finish(r->ctx, &r->bandwidth);
    pell_free(r->ctx, r->knobs);
    pell_free(r->ctx, (char *) r->checkpoint.path);
    pell_free(r->ctx, r);
}

enum pell_result pell_renderer_set_checkpoint(struct pell_renderer *r, const struct pell_checkpoint *checkpoint)
{
    char *path = NULL;

    if (checkpoint && !(checkpoint->path && checkpoint->path[0]))
        return pell_error(r->ctx, PELL_ERR_INVALID, "checkpoint", NULL, "has no path");
    if (checkpoint && !(checkpoint->every > 0.0 && checkpoint->every <= 1e9))
        return pell_error(r->ctx, PELL_ERR_INVALID, "checkpoint", NULL, "every %g s, must be in (0, 1e9]", checkpoint->every);
    if (checkpoint && !(path = pell_strdup(r->ctx, checkpoint->path)))
        return PELL_ERR_NOMEM;
    pell_renderer_invalidate(r, PELL_INPUT_CHECKPOINT); /* the method has read the old one */
    pell_free(r->ctx, (char *) r->checkpoint.path);
    r->checkpoint = (struct pell_checkpoint) { path, checkpoint ? checkpoint->every : 0.0 };
    return PELL_OK;
}

void pell_renderer_set_observer(struct pell_renderer *r, const struct pell_observer *observer)
{
    pell_renderer_invalidate(r, PELL_INPUT_METHOD); /* what it keeps from frame to frame is not made again otherwise */
    r->observer = observer ? *observer : (struct pell_observer) { NULL };
}

enum pell_result pell_renderer_set_scene(struct pell_renderer *r, const struct pell_scene *scene)
{
    enum pell_result res;

    pell_renderer_invalidate(r, PELL_INPUT_SCENE);
    r->scene = NULL;
    if (!scene)
        return PELL_OK;
    if (scene->num_cameras < 1)
        return pell_error(r->ctx, PELL_ERR_INVALID, scene->path, NULL, "the scene has no camera");
    r->scene = scene;
    res = pell_renderer_prepare_scene(r);
    if (res != PELL_OK)
        r->scene = NULL;
    return res;
}

void pell_renderer_lights_changed(struct pell_renderer *r)
{
    pell_renderer_invalidate(r, PELL_INPUT_LIGHTS);
}

enum pell_result pell_renderer_set_method(struct pell_renderer *r, const struct pell_method *method, const void *knobs)
{
    void *copy = NULL;
    enum pell_result res;

    if (method) {
        PELL_TRY(pell_engine_check(r->ctx, r->device->engine, method));
        res = PELL_ERR_NOMEM;
        copy = pell_zalloc(r->ctx, method->knobs_size);
        if (!copy)
            goto fail;
        if (knobs)
            memcpy(copy, knobs, method->knobs_size);
        else
            pell_knobs_default(method->knobs, copy);
        PELL_TRY(pell_knobs_check(r->ctx, method->knobs, method->name, copy));
    }
    pell_renderer_invalidate(r, PELL_INPUT_METHOD);
    pell_free(r->ctx, r->knobs);
    r->method = method;
    r->knobs = copy;
    return PELL_OK;

fail:
    pell_free(r->ctx, copy);
    return res;
}

double pell_renderer_trace_bare(struct pell_renderer *r)
{
    struct pell_view view;

    if (!r->scene || r->device->engine != &pell_engine_cpu)
        return 0.0;
    view = pell_view_make(&r->scene->cameras[0], r->settings.width, r->settings.height, 0.0f, 0.0f);
    return pell_engine_cpu_trace_bare(r->engine, &view);
}

void pell_renderer_record_rays(struct pell_renderer *r, struct pell_ray_record *record)
{
    if (r->device->engine == &pell_engine_cpu)
        pell_engine_cpu_record_rays(r->engine, record);
}
