/* SPDX-License-Identifier: MIT
 * renderer.c - the renderer and its inputs: scene, method, checkpoint. */
#include "render/renderer_state.h"

#include "render/communicator.h"
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

void pell_renderer_measure_bandwidth(struct pell_renderer *r, bool wanted)
{
    r->bandwidth.wanted = wanted;
}

enum pell_result pell_renderer_create(struct pell_device *device, struct pell_renderer **out)
{
    if (out)
        *out = NULL;
    if (!device || !out)
        return pell_null(device ? device->ctx : NULL, "pell_renderer_create");

    struct pell_renderer *r = pell_zalloc(device->ctx, sizeof(*r));
    enum pell_result res;

    *out = NULL;
    if (!r)
        return PELL_ERR_NOMEM;
    r->ctx = device->ctx;
    r->device = device;
    PELL_TRY(device->engine->open(r->ctx, device->pool, device->gpu, &r->engine));
    *out = r;
    return PELL_OK;

fail:
    pell_renderer_destroy(&r);
    return res;
}

static void drop_checkpoint(struct pell_renderer *r)
{
    for (int i = 0; i < r->checkpoint.num_parts; i++)
        pell_free(r->ctx, (char *) r->checkpoint.parts[i]);
    pell_free(r->ctx, (void *) r->checkpoint.parts);
    pell_free(r->ctx, (char *) r->checkpoint.path);
    pell_free(r->ctx, (char *) r->checkpoint.note);
    r->checkpoint = (struct pell_checkpoint) { .path = NULL };
    r->has_checkpoint = false;
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
    drop_checkpoint(r);
    pell_free(r->ctx, r);
}

static enum pell_result check_checkpoint(struct pell_context *ctx, const struct pell_checkpoint *c)
{
    const bool merge = c->mode != PELL_CHECKPOINT_RENDER;

    if (!merge && !(c->path && c->path[0]))
        return pell_error(ctx, PELL_ERR_INVALID, "checkpoint", NULL, "has no path");
    if (merge && c->num_parts < 1)
        return pell_error(ctx, PELL_ERR_INVALID, "checkpoint", NULL, "no files to merge");
    if (!(c->every > 0.0 && c->every <= 1e9))
        return pell_error(ctx, PELL_ERR_INVALID, "checkpoint", NULL, "every %g s, must be in (0, 1e9]", c->every);
    if (c->first_sample < 0 || c->end_sample < c->first_sample || (c->end_sample > 0 && c->end_sample == c->first_sample))
        return pell_error(ctx, PELL_ERR_INVALID, "checkpoint", NULL, "samples %d:%d, must be a range that is not empty", c->first_sample,
                          c->end_sample);
    if (c->first_tile < 0 || c->end_tile < c->first_tile || (c->end_tile > 0 && c->end_tile == c->first_tile))
        return pell_error(ctx, PELL_ERR_INVALID, "checkpoint", NULL, "tiles %d:%d, must be a range that is not empty", c->first_tile,
                          c->end_tile);
    return PELL_OK;
}

enum pell_result pell_renderer_set_checkpoint(struct pell_renderer *r, const struct pell_checkpoint *checkpoint)
{
    if (!r)
        return pell_null(NULL, "pell_renderer_set_checkpoint");

    struct pell_checkpoint copy = checkpoint ? *checkpoint : (struct pell_checkpoint) { .path = NULL };
    const char **parts;
    enum pell_result res;

    if (checkpoint && (res = check_checkpoint(r->ctx, checkpoint)) != PELL_OK)
        return res;
    pell_renderer_invalidate(r, PELL_INPUT_CHECKPOINT); /* the method has read the old one */
    drop_checkpoint(r);
    if (!checkpoint)
        return PELL_OK;
    copy.path = copy.note = NULL;
    copy.parts = NULL;
    copy.num_parts = 0;
    r->checkpoint = copy;
    if (checkpoint->path && !(r->checkpoint.path = pell_strdup(r->ctx, checkpoint->path)))
        goto fail;
    if (checkpoint->note && !(r->checkpoint.note = pell_strdup(r->ctx, checkpoint->note)))
        goto fail;
    if (checkpoint->num_parts > 0) {
        parts = pell_calloc(r->ctx, (size_t) checkpoint->num_parts, sizeof(*parts));
        if (!parts)
            goto fail;
        r->checkpoint.parts = parts;
        for (; r->checkpoint.num_parts < checkpoint->num_parts; r->checkpoint.num_parts++)
            if (!(parts[r->checkpoint.num_parts] = pell_strdup(r->ctx, checkpoint->parts[r->checkpoint.num_parts])))
                goto fail;
    }
    r->has_checkpoint = true;
    return PELL_OK;

fail:
    drop_checkpoint(r);
    return PELL_ERR_NOMEM;
}

void pell_renderer_set_communicator(struct pell_renderer *r, struct pell_communicator *communicator)
{
    pell_renderer_invalidate(r, PELL_INPUT_CHECKPOINT);
    r->communicator = communicator;
}

void pell_renderer_set_observer(struct pell_renderer *r, const struct pell_observer *observer)
{
    pell_renderer_invalidate(r, PELL_INPUT_METHOD); /* what it keeps from frame to frame is not made again otherwise */
    r->observer = observer ? *observer : (struct pell_observer) { NULL };
}

enum pell_result pell_renderer_set_scene(struct pell_renderer *r, const struct pell_scene *scene)
{
    if (!r)
        return pell_null(NULL, "pell_renderer_set_scene");

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
    if (!r)
        return pell_null(NULL, "pell_renderer_set_method");

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

/* Whether the stages are the cpu engine's, as those of the engine vulkan are. */
static bool has_cpu_stages(const struct pell_renderer *r)
{
    return r->device->engine->surface == pell_engine_cpu.surface;
}

double pell_renderer_trace_bare(struct pell_renderer *r)
{
    struct pell_view view;

    if (!r->scene || !has_cpu_stages(r))
        return 0.0;
    view = pell_view_make(&r->scene->cameras[0], r->settings.width, r->settings.height, 0.0f, 0.0f);
    return pell_engine_cpu_trace_bare(r->engine, &view);
}

void pell_renderer_record_rays(struct pell_renderer *r, struct pell_ray_record *record)
{
    if (has_cpu_stages(r))
        pell_engine_cpu_record_rays(r->engine, record);
}
