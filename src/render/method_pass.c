/* SPDX-License-Identifier: MIT
 * method_pass.c - runs a method on planes: validates the input, then calls the engine's functions, which may trust it. */
#include "render/pass.h"

#include "render/frame_material.h"

#include <string.h>

struct pell_pass {
    struct pell_services services;
    const struct pell_method *method;
    const struct pell_method_engine *engine;
    struct pell_frame_shape shape;
    struct pell_frame_material *materials; /* owned copy */
    struct pell_profile *profiles;         /* profiles of materials without their own, three per material */
    struct pell_plan plan;
    void *state;
};

enum pell_result pell_engine_check(struct pell_context *ctx, const struct pell_engine_interface *engine, const struct pell_method *method)
{
    return engine->method(method) ? PELL_OK : pell_engine_missing(ctx, engine->name, method);
}

enum pell_result pell_engine_missing(struct pell_context *ctx, const char *engine, const struct pell_method *method)
{
    return pell_error(ctx, PELL_ERR_DEVICE, method->name, method->cpu ? "take the engine cpu" : NULL, "has no engine %s, only %s", engine,
                      method->cpu && method->vulkan ? "cpu and vulkan"
                      : method->cpu                 ? "cpu"
                      : method->vulkan              ? "vulkan"
                                                    : "none");
}

static enum pell_result check_shape(struct pell_context *ctx, const struct pell_frame_shape *s)
{
    if (s->width < 1 || s->height < 1 || s->width > 65536 || s->height > 65536)
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "size %d x %d, each must be in [1, 65536]", s->width, s->height);
    if (s->stride < s->width || s->stride > PTRDIFF_MAX / s->height)
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "stride = %td, must be in [%d, %td]", s->stride, s->width,
                          PTRDIFF_MAX / s->height);
    if (!(s->focal_px > 0.0f && s->focal_px < 1e12f))
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "focal_px = %g, must be in (0, 1e12)", (double) s->focal_px);
    if (!(s->object_height >= 0.0f && s->object_height < 1e12f))
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "object_height = %g mm, must be in [0, 1e12)", (double) s->object_height);
    if (!s->materials)
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "materials is NULL");
    if (s->num_materials < 1 || s->num_materials > PELL_FRAME_MATERIALS)
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "num_materials = %zu, must be in [1, %d]", s->num_materials,
                          PELL_FRAME_MATERIALS);
    return PELL_OK;
}

void pell_pass_destroy(struct pell_pass **pass)
{
    struct pell_pass *p = *pass;
    struct pell_context *ctx;

    if (!p)
        return;
    *pass = NULL;
    ctx = p->services.ctx;
    p->engine->destroy(p->state);
    pell_free(ctx, p->materials);
    pell_free(ctx, p->profiles);
    pell_free(ctx, p);
}

/* Methods read profiles only: materials that came with coefficients or Gaussians alone get theirs here. */
static enum pell_result complete_profiles(struct pell_context *ctx, struct pell_pass *p)
{
    size_t missing = 0;
    enum pell_result res = PELL_ERR_NOMEM;

    for (size_t i = 0; i < p->shape.num_materials; i++)
        missing += !p->materials[i].profile;
    if (missing == 0)
        return PELL_OK;
    p->profiles = pell_calloc(ctx, 3 * missing, sizeof(*p->profiles));
    if (!p->profiles)
        goto fail;
    for (size_t i = 0, at = 0; i < p->shape.num_materials; i++) {
        struct pell_frame_material *m = &p->materials[i];
        if (m->profile)
            continue;
        PELL_TRY(pell_frame_material_profile(ctx, m->name, m, PELL_PROFILE_DIPOLE, &p->profiles[at]));
        m->profile = &p->profiles[at];
        at += 3;
    }
    return PELL_OK;

fail:
    return res;
}

enum pell_result pell_pass_make(const struct pell_engine_interface *engine, const struct pell_services *services,
                                const struct pell_method *method, const void *knobs, const struct pell_frame_shape *shape,
                                struct pell_pass **out)
{
    struct pell_context *ctx = services->ctx;
    struct pell_pass *p = NULL;
    enum pell_result res;

    *out = NULL;
    PELL_TRY(check_shape(ctx, shape));
    res = PELL_ERR_NOMEM;
    p = pell_zalloc(ctx, sizeof(*p));
    if (!p)
        goto fail;
    p->services = *services;
    p->method = method;
    p->engine = engine->method(method);
    p->shape = *shape;
    p->materials = pell_alloc_array(ctx, shape->num_materials, sizeof(*p->materials));
    if (!p->materials)
        goto fail;
    memcpy(p->materials, shape->materials, shape->num_materials * sizeof(*p->materials));
    for (size_t i = 0; i < shape->num_materials; i++)
        if (!p->materials[i].name)
            p->materials[i].name = "";
    p->shape.materials = p->materials;
    PELL_TRY(complete_profiles(ctx, p));
    method->plan(knobs, &p->plan);
    if ((p->plan.needs & PELL_NEED_SCENE) && !services->scene) {
        res = pell_error(ctx, PELL_ERR_UNSUPPORTED, method->name, "set it as a renderer's method",
                         "needs a renderer's scene, it can't run on planes alone");
        goto fail;
    }
    if (services->planes && !p->engine->record_in) {
        res = pell_error(ctx, PELL_ERR_UNSUPPORTED, method->name, NULL, "does not run on the buffers of a program's own device");
        goto fail;
    }
    PELL_TRY(p->engine->create(&p->services, &p->shape, knobs, &p->state));
    *out = p;
    return PELL_OK;

fail:
    pell_pass_destroy(&p);
    return res;
}

enum pell_result pell_pass_create(struct pell_device *device, const struct pell_method *method, const void *knobs,
                                  const struct pell_frame_shape *shape, struct pell_pass **out)
{
    if (out)
        *out = NULL;
    if (!device || !method || !shape || !out)
        return pell_null(device ? device->ctx : NULL, "pell_pass_create");

    const struct pell_services services = { .ctx = device->ctx, .pool = device->pool, .gpu = device->gpu, .planes = device->planes };
    void *defaults = NULL;
    enum pell_result res;

    *out = NULL;
    PELL_TRY(pell_engine_check(device->ctx, device->engine, method));
    PELL_TRY(check_shape(device->ctx, shape));
    for (size_t i = 0; i < shape->num_materials; i++)
        PELL_TRY(pell_frame_material_check(device->ctx, shape->materials[i].name ? shape->materials[i].name : "?", &shape->materials[i]));
    if (!knobs) {
        res = PELL_ERR_NOMEM;
        defaults = pell_zalloc(device->ctx, method->knobs_size);
        if (!defaults)
            goto fail;
        pell_knobs_default(method->knobs, defaults);
        knobs = defaults;
    }
    PELL_TRY(pell_knobs_check(device->ctx, method->knobs, method->name, knobs));
    res = pell_pass_make(device->engine, &services, method, knobs, shape, out);

fail:
    pell_free(device->ctx, defaults);
    return res;
}

/* The name of a plane that the method needs and the caller has not given; NULL: all are there. */
static const char *find_missing(unsigned needs, const struct pell_frame *in, const struct pell_frame_light *out)
{
    for (int i = 0; i < PELL_PLANES; i++) {
        const struct pell_plane_info *p = pell_plane_at(i);
        const void *planes[3];

        if (p->optional || (p->need && !(needs & p->need)))
            continue;
        pell_plane_pointers(p, in, out, planes);
        for (int c = 0; c < p->components; c++)
            if (!planes[c])
                return p->name;
    }
    return NULL;
}

/* Whether two planes of floats have a pixel's memory in common; their rows may alternate. */
static bool share_memory(const struct pell_frame_shape *s, const void *a, const void *b)
{
    const uintptr_t p = (uintptr_t) a, q = (uintptr_t) b, apart = p > q ? p - q : q - p;
    const uintptr_t width = (uintptr_t) s->width * sizeof(float), stride = (uintptr_t) s->stride * sizeof(float);
    const uintptr_t rows = apart / stride, rest = apart % stride, height = (uintptr_t) s->height;

    return (rows < height && rest < width) || (rows + 1 < height && stride - rest < width);
}

/* Whether a plane of `out`, all of which are of floats, has memory in common with another of `out` or one of `in`. */
static bool overlaps(const struct pell_frame *in, const struct pell_frame_light *out)
{
    const void *all[3 * PELL_PLANES], *written[3 * PELL_PLANES];
    bool floats[3 * PELL_PLANES];
    size_t count = 0, outputs = 0;

    for (int i = 0; i < PELL_PLANES; i++) {
        const struct pell_plane_info *p = pell_plane_at(i);
        const void *planes[3];

        pell_plane_pointers(p, in, out, planes);
        for (int c = 0; c < p->components; c++) {
            if (!planes[c])
                continue;
            floats[count] = p->format == PELL_PLANE_F32;
            all[count++] = planes[c];
            if (p->of_light)
                written[outputs++] = planes[c];
        }
    }
    for (size_t i = 0; i < outputs; i++) {
        int same = 0;
        for (size_t k = 0; k < count; k++)
            same += written[i] == all[k] || (floats[k] && share_memory(&in->shape, written[i], all[k]));
        if (same > 1)
            return true;
    }
    return false;
}

static bool same_shape(const struct pell_frame_shape *a, const struct pell_frame_shape *b)
{
    return a->width == b->width && a->height == b->height && a->stride == b->stride && a->num_materials == b->num_materials &&
           a->orthographic == b->orthographic && a->focal_px == b->focal_px;
}

enum pell_result pell_pass_render(struct pell_pass *pass, const struct pell_frame *in, const struct pell_frame_light *out)
{
    if (!pass || !in || !out)
        return pell_null(pass ? pass->services.ctx : NULL, "pell_pass_render");

    struct pell_context *ctx = pass->services.ctx;
    const struct pell_rect r = in->rect;
    const char *missing;

    if (!same_shape(&in->shape, &pass->shape))
        return pell_error(ctx, PELL_ERR_INVALID, "frame", "make a new pass where the size, camera or materials change",
                          "the frame's shape is not the one that the pass was made for");
    if (r.x0 < 0 || r.y0 < 0 || r.x1 > in->shape.width || r.y1 > in->shape.height)
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "rect (%d, %d) to (%d, %d), must lie in the image of %d x %d", r.x0, r.y0,
                          r.x1, r.y1, in->shape.width, in->shape.height);
    missing = find_missing(pass->plan.needs, in, out);
    if (missing)
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "plane %s is NULL, but method %s needs it", missing, pass->method->name);
    if (overlaps(in, out))
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL,
                          "a plane of the output has memory of another, or of one of the frame's own");
    if (r.x0 >= r.x1 || r.y0 >= r.y1)
        return PELL_OK;
    return pass->engine->record(pass->state, in, out);
}

void pell_pass_record_in(struct pell_pass *pass, struct pell_gpu_commands *commands, float depth, float strength)
{
    pass->engine->record_in(pass->state, commands, depth, strength);
}

bool pell_pass_planes(const struct pell_pass *pass, struct pell_gpu_buffer *planes[PELL_GPU_PLANES])
{
    return pass->engine->planes && pass->engine->planes(pass->state, planes);
}

enum pell_result pell_pass_prepare(struct pell_pass *pass, const struct pell_frame *in, struct pell_pass_time times[PELL_STAGES_MOST],
                                   size_t *count)
{
    enum pell_result res;

    *count = 0;
    if (!pass->engine->prepare)
        return PELL_OK;
    res = pass->engine->prepare(pass->state, in);
    if (res == PELL_OK)
        *count = pell_pass_times(pass, times, PELL_STAGES_MOST);
    return res;
}

const struct pell_plan *pell_pass_plan(const struct pell_pass *pass)
{
    return &pass->plan;
}

const struct pell_thickness_table *pell_pass_thickness(const struct pell_pass *pass, size_t material)
{
    return pass->engine->thickness && material < pass->shape.num_materials ? pass->engine->thickness(pass->state, material) : NULL;
}

bool pell_pass_standard_error(const struct pell_pass *pass, const float *planes[3])
{
    return pass->engine->standard_error && pass->engine->standard_error(pass->state, planes);
}

bool pell_pass_unfinished(const struct pell_pass *pass)
{
    return pass->engine->unfinished && pass->engine->unfinished(pass->state);
}

bool pell_pass_unwritten(const struct pell_pass *pass)
{
    return pass->engine->unwritten && pass->engine->unwritten(pass->state);
}

size_t pell_pass_times(const struct pell_pass *pass, struct pell_pass_time *times, size_t size)
{
    return pass->engine->times ? pass->engine->times(pass->state, times, size) : 0;
}
