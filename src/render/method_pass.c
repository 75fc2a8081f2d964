/* SPDX-License-Identifier: MIT
 * method_pass.c - a method on the caller's planes: checks in front, then the engine's functions, which may trust their input. */
#include "render/renderer.h"

#include <string.h>

struct pell_pass {
    struct pell_renderer *r; /* borrowed */
    const struct pell_method *method;
    const struct pell_method_engine *engine;
    struct pell_frame shape;
    struct pell_frame_material *materials; /* owned copy */
    struct pell_profile *profiles;         /* of materials that came without, three each */
    struct pell_plan plan;
    void *state;
};

static enum pell_result check_shape(struct pell_context *ctx, const struct pell_frame *s)
{
    if (s->width < 1 || s->height < 1 || s->width > 65536 || s->height > 65536)
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "size %d x %d, each must be in [1, 65536]", s->width, s->height);
    if (s->stride < s->width || s->stride > PTRDIFF_MAX / s->height)
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "stride = %td, must be at least the width %d", s->stride, s->width);
    if (!(s->focal_px > 0.0f && s->focal_px < 1e12f))
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "focal_px = %g, must be in (0, 1e12)", (double) s->focal_px);
    if (!(s->object_height >= 0.0f && s->object_height < 1e12f))
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "object_height = %g mm, must be in [0, 1e12)", (double) s->object_height);
    if (s->num_materials < 1 || s->num_materials > PELL_FRAME_MATERIALS || !s->materials)
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "num_materials = %zu, must be in [1, %d]", s->num_materials,
                          PELL_FRAME_MATERIALS);
    for (size_t i = 0; i < s->num_materials; i++) {
        const struct pell_frame_material *m = &s->materials[i];
        struct pell_medium_fault fault;
        const char *name = m->name ? m->name : "?";
        if (m->gaussians.count < 0 || m->gaussians.count > PELL_GAUSSIANS_MAX)
            return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "gaussians.count = %d, must be in [0, %d]", m->gaussians.count,
                              PELL_GAUSSIANS_MAX);
        for (int k = 0; k < m->gaussians.count; k++) {
            const double v = m->gaussians.variance[k], *w = m->gaussians.weight[k];
            if (!(v > 0.0 && v < 1e12) || (k > 0 && v <= m->gaussians.variance[k - 1]))
                return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "variance[%d] = %g mm^2, must be positive, under 1e12 and rising", k,
                                  v);
            for (int c = 0; c < 3; c++)
                if (!(w[c] >= 0.0 && w[c] <= 1.0))
                    return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "weight[%d][%d] = %g, must be in [0, 1]", k, c, w[c]);
        }
        if (!m->profile && m->gaussians.count == 0 && !pell_medium_valid(&m->medium, &fault))
            return pell_error(ctx, PELL_ERR_INVALID, name, NULL, "%s = %g, must be in [%g, %g]", fault.field, fault.value, fault.min,
                              fault.max);
    }
    return PELL_OK;
}

void pell_pass_destroy(struct pell_pass **pass)
{
    struct pell_pass *p = *pass;
    struct pell_context *ctx;

    if (!p)
        return;
    *pass = NULL;
    ctx = pell_renderer_context(p->r);
    p->engine->destroy(p->state);
    pell_free(ctx, p->materials);
    pell_free(ctx, p->profiles);
    pell_free(ctx, p);
}

/* Methods read profiles only: materials that came with coefficients or Gaussians alone get theirs here. */
static enum pell_result complete_profiles(struct pell_context *ctx, struct pell_pass *p)
{
    size_t missing = 0;

    for (size_t i = 0; i < p->shape.num_materials; i++)
        missing += !p->materials[i].profile;
    if (missing == 0)
        return PELL_OK;
    p->profiles = pell_calloc(ctx, 3 * missing, sizeof(*p->profiles));
    if (!p->profiles)
        return PELL_ERR_NOMEM;
    for (size_t i = 0, at = 0; i < p->shape.num_materials; i++) {
        struct pell_frame_material *m = &p->materials[i];
        if (m->profile)
            continue;
        for (int c = 0; c < 3; c++) {
            struct pell_profile *out = &p->profiles[at + (size_t) c];
            const enum pell_result res = m->gaussians.count > 0 ? pell_profile_from_gaussians(&m->gaussians, c, out)
                                                                : pell_profile_make(PELL_PROFILE_DIPOLE, &m->medium, c, NULL, out);
            if (res != PELL_OK)
                return pell_error(ctx, res, m->name, NULL, "has no profile");
        }
        m->profile = &p->profiles[at];
        at += 3;
    }
    return PELL_OK;
}

enum pell_result pell_pass_create(struct pell_renderer *r, const struct pell_method *method, const void *knobs,
                                  const struct pell_frame *shape, struct pell_pass **out)
{
    struct pell_context *ctx = pell_renderer_context(r);
    const enum pell_engine engine = pell_renderer_engine(r);
    void *defaults = NULL;
    struct pell_pass *p = NULL;
    enum pell_result res;

    *out = NULL;
    if (engine != PELL_ENGINE_CPU || !method->cpu)
        return pell_error(ctx, PELL_ERR_DEVICE, method->name, NULL, "has no engine %s", pell_engine_name(engine));
    PELL_TRY(check_shape(ctx, shape));

    res = PELL_ERR_NOMEM;
    p = pell_zalloc(ctx, sizeof(*p));
    if (!p)
        goto fail;
    p->r = r;
    p->method = method;
    p->engine = method->cpu;
    p->shape = *shape;
    p->materials = pell_alloc_array(ctx, shape->num_materials, sizeof(*p->materials));
    defaults = pell_zalloc(ctx, method->knobs_size);
    if (!p->materials || !defaults)
        goto fail;
    memcpy(p->materials, shape->materials, shape->num_materials * sizeof(*p->materials));
    for (size_t i = 0; i < shape->num_materials; i++)
        if (!p->materials[i].name)
            p->materials[i].name = "";
    p->shape.materials = p->materials;
    PELL_TRY(complete_profiles(ctx, p));
    if (!knobs) {
        pell_knobs_default(method->knobs, defaults);
        knobs = defaults;
    }
    PELL_TRY(pell_knobs_check(ctx, method->knobs, method->name, knobs));
    method->plan(knobs, &p->plan);
    if ((p->plan.needs & PELL_NEED_SCENE) && !pell_renderer_lends_scene(r, shape)) {
        res = pell_error(ctx, PELL_ERR_UNSUPPORTED, method->name, "set it as the renderer's method",
                         "needs the renderer's scene, it can't run on planes alone");
        goto fail;
    }
    PELL_TRY(p->engine->create(r, &p->shape, knobs, &p->state));
    pell_free(ctx, defaults);
    *out = p;
    return PELL_OK;

fail:
    pell_free(ctx, defaults);
    pell_pass_destroy(&p);
    return res;
}

static bool planes_there(const float *const planes[3])
{
    return planes[0] && planes[1] && planes[2];
}

enum pell_result pell_pass_render(struct pell_pass *pass, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct pell_context *ctx = pell_renderer_context(pass->r);
    const struct pell_frame *s = &pass->shape;
    const unsigned needs = pass->plan.needs;
    const char *missing = NULL;

    if (in->width != s->width || in->height != s->height || in->stride != s->stride || in->num_materials != s->num_materials ||
        in->orthographic != s->orthographic || in->focal_px != s->focal_px)
        return pell_error(ctx, PELL_ERR_INVALID, "frame", "make a new pass where the size, camera or materials change",
                          "the frame's shape is not the one that the pass was made for");
    if (in->rect.x0 < 0 || in->rect.y0 < 0 || in->rect.x1 > in->width || in->rect.y1 > in->height)
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "rect (%d, %d) to (%d, %d), must lie in the picture of %d x %d",
                          in->rect.x0, in->rect.y0, in->rect.x1, in->rect.y1, in->width, in->height);
    if (!in->material)
        missing = "material";
    else if (!in->depth)
        missing = "depth";
    else if ((needs & PELL_NEED_IRRADIANCE) && !planes_there(in->irradiance))
        missing = "irradiance";
    else if ((needs & PELL_NEED_LIT) && !planes_there(in->lit))
        missing = "lit";
    else if ((needs & PELL_NEED_NORMAL) && !planes_there(in->normal))
        missing = "normal";
    else if ((needs & PELL_NEED_POSITION) && !planes_there(in->position))
        missing = "position";
    else if ((needs & PELL_NEED_HIT) && !(in->mesh && in->triangle && in->barycentric[0] && in->barycentric[1]))
        missing = "mesh, triangle or barycentric";
    else if (!out->light[0] || !out->light[1] || !out->light[2])
        missing = "light";
    if (missing)
        return pell_error(ctx, PELL_ERR_INVALID, "frame", NULL, "plane %s is not there, method %s needs it", missing, pass->method->name);
    if (in->rect.x0 >= in->rect.x1 || in->rect.y0 >= in->rect.y1)
        return PELL_OK;
    return pass->engine->render(pass->state, in, out);
}

const struct pell_plan *pell_pass_plan(const struct pell_pass *pass)
{
    return &pass->plan;
}

const struct pell_thickness_table *pell_pass_thickness(const struct pell_pass *pass, size_t material)
{
    return pass->engine->thickness && material < pass->shape.num_materials ? pass->engine->thickness(pass->state, material) : NULL;
}

bool pell_pass_noise(const struct pell_pass *pass, const float *planes[3])
{
    return pass->engine->noise && pass->engine->noise(pass->state, planes);
}

size_t pell_pass_times(const struct pell_pass *pass, struct pell_pass_time *times, size_t size)
{
    return pass->engine->times ? pass->engine->times(pass->state, times, size) : 0;
}
