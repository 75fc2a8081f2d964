/* SPDX-License-Identifier: MIT
 * renderer.c - the renderer, its scene and its method; what methods may ask of it. */
#include "render/renderer_state.h"

#include <string.h>

struct pell_context *pell_renderer_context(struct pell_renderer *r)
{
    return r->ctx;
}

struct pell_pool *pell_renderer_pool(struct pell_renderer *r)
{
    return r->pool;
}

const struct pell_scene *pell_renderer_scene(const struct pell_renderer *r)
{
    return r->scene;
}

bool pell_renderer_scatters(const struct pell_renderer *r)
{
    return r->method != NULL;
}

const struct pell_rays *pell_renderer_rays(const struct pell_renderer *r)
{
    return r->rays;
}

enum pell_result pell_renderer_bodies(const struct pell_renderer *r, struct pell_bodies **out)
{
    return pell_bodies_create(r->ctx, r->scene, r->frame_index, r->frame_materials, out);
}

const struct pell_pass *pell_renderer_pass(const struct pell_renderer *r)
{
    return r->pass;
}

int pell_renderer_samples(const struct pell_renderer *r)
{
    return r->settings.msaa;
}

int pell_renderer_sample(const struct pell_renderer *r)
{
    return r->sample;
}

bool pell_renderer_begins(const struct pell_renderer *r)
{
    return !r->scattered;
}

const struct pell_view *pell_renderer_eye(const struct pell_renderer *r)
{
    return &r->eye;
}

const struct pell_settings *pell_renderer_settings(const struct pell_renderer *r)
{
    return &r->settings;
}

const struct pell_checkpoint *pell_renderer_checkpoint(const struct pell_renderer *r)
{
    return r->checkpoint.path ? &r->checkpoint : NULL;
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
    pell_free(r->ctx, (char *) r->checkpoint.path);
    r->checkpoint = (struct pell_checkpoint) { path, checkpoint ? checkpoint->every : 0.0 };
    pell_pass_destroy(&r->pass); /* it has read the old one */
    return PELL_OK;
}

uint32_t pell_renderer_seed(const struct pell_renderer *r)
{
    const uint64_t seed = (uint64_t) r->settings.seed;
    return (uint32_t) (seed ^ seed >> 32);
}

struct pell_irradiance_params pell_renderer_light_params(const struct pell_renderer *r, float mix)
{
    return (struct pell_irradiance_params) {
        .rays = r->rays,
        .scene = r->scene,
        .surface = &r->surface,
        .tables = r->tables,
        .mix = mix,
        .smooth = r->settings.boundary == PELL_BOUNDARY_SMOOTH,
        .seed = pell_renderer_seed(r),
    };
}

uint64_t pell_renderer_lights(const struct pell_renderer *r)
{
    return r->lights_number;
}

const struct pell_fan *pell_renderer_fan(const struct pell_renderer *r, size_t light)
{
    return r->lights ? pell_lights_fan(r->lights, light) : NULL;
}

void pell_renderer_light(const struct pell_renderer *r, const struct pell_points *points, float mix, float spacing, uint32_t first,
                         int samples, struct pell_points_light *out)
{
    struct pell_irradiance_params p = pell_renderer_light_params(r, mix);

    p.sample = first;
    pell_irradiance_points(r->lights, &p, points, spacing, samples, out);
}

void pell_renderer_light_of(const struct pell_renderer *r, uint64_t lights, const float *ambient, const struct pell_points *points,
                            float mix, float spacing, uint32_t first, int samples, struct pell_points_light *out)
{
    struct pell_irradiance_params p = pell_renderer_light_params(r, mix);

    p.sample = first;
    p.lights = lights;
    p.ambient = ambient;
    pell_irradiance_points(r->lights, &p, points, spacing, samples, out);
}

bool pell_renderer_lends_scene(const struct pell_renderer *r, const struct pell_frame *shape)
{
    return r->scene && r->lights && r->sized && shape->materials == r->frame_materials;
}

enum pell_engine pell_renderer_engine(const struct pell_renderer *r)
{
    (void) r;
    return PELL_ENGINE_CPU;
}

int pell_renderer_threads(const struct pell_renderer *r)
{
    return pell_pool_threads(r->pool);
}

const char *pell_engine_name(enum pell_engine engine)
{
    static const char *const names[] = { "auto", "cpu", "vulkan" };
    return (unsigned) engine < PELL_COUNT(names) ? names[engine] : "unknown";
}

enum pell_result pell_renderer_create(struct pell_context *ctx, const struct pell_renderer_params *params, struct pell_renderer **out)
{
    static const struct pell_renderer_params none;
    struct pell_renderer *r = NULL;
    enum pell_result res;

    *out = NULL;
    if (!params)
        params = &none;
    if (params->engine == PELL_ENGINE_VULKAN)
        return pell_error(ctx, PELL_ERR_DEVICE, "engine vulkan", "use --engine cpu", "this build has the engine cpu only");
    r = pell_zalloc(ctx, sizeof(*r));
    if (!r)
        return PELL_ERR_NOMEM;
    r->ctx = ctx;
    r->copies.wanted = params->copies;
    PELL_TRY(pell_pool_create(ctx, params->threads, &r->pool));
    *out = r;
    return PELL_OK;

fail:
    pell_renderer_destroy(&r);
    return res;
}

/* --- What hangs on scene and method ------------------------------------------------------------------------------------------- */

static void drop_scene(struct pell_renderer *r)
{
    pell_pass_destroy(&r->pass);
    pell_lights_destroy(&r->lights);
    pell_compositor_destroy(&r->compositor);
    pell_specular_tables_destroy(&r->tables);
    pell_rays_destroy(&r->rays);
    pell_mips_destroy(&r->mips);
    pell_raster_destroy(&r->raster);
    r->rastered = false;
    for (size_t i = 0; r->profiles && i < r->num_frame_materials; i++)
        pell_free(r->ctx, r->profiles[i]);
    pell_free(r->ctx, r->profiles);
    pell_free(r->ctx, r->frame_index);
    pell_free(r->ctx, r->frame_materials);
    r->profiles = NULL;
    r->profiled = false;
    pell_free(r->ctx, r->total);
    pell_free(r->ctx, r->thickness);
    r->frame_index = NULL;
    r->frame_materials = NULL;
    r->num_frame_materials = 0;
    r->total = NULL;
    r->thickness = NULL;
    r->scene = NULL;
}

void pell_renderer_destroy(struct pell_renderer **renderer)
{
    struct pell_renderer *r = *renderer;
    if (!r)
        return;
    *renderer = NULL;
    drop_scene(r);
    pell_renderer_drop_size(r);
    pell_copies_finish(r->ctx, &r->copies);
    pell_free(r->ctx, r->knobs);
    pell_free(r->ctx, (char *) r->checkpoint.path);
    pell_pool_destroy(&r->pool);
    pell_free(r->ctx, r);
}

static enum pell_result make_materials(struct pell_renderer *r, const struct pell_scene *scene)
{
    const size_t n = scene->num_materials;

    if (n < 1 || n > 65534)
        return pell_error(r->ctx, PELL_ERR_INVALID, scene->path, NULL, "%zu materials, must be in [1, 65534]", n);
    r->frame_index = pell_calloc(r->ctx, n + 1, sizeof(*r->frame_index));
    r->frame_materials = pell_calloc(r->ctx, n, sizeof(*r->frame_materials));
    r->total = pell_calloc(r->ctx, n, sizeof(*r->total));
    r->thickness = pell_calloc(r->ctx, n, sizeof(*r->thickness));
    if (!r->frame_index || !r->frame_materials || !r->total || !r->thickness)
        return PELL_ERR_NOMEM;
    for (size_t i = 0; i < n; i++) {
        const struct pell_material *m = &scene->materials[i];
        struct pell_frame_material *f = &r->frame_materials[r->num_frame_materials];
        struct pell_medium_fault fault;

        if (m->opaque)
            continue;
        if (!m->profile && m->gaussians.count == 0 && !pell_medium_valid(&m->medium, &fault))
            return pell_error(r->ctx, PELL_ERR_INVALID, m->name, NULL, "%s = %g, must be in [%g, %g]", fault.field, fault.value, fault.min,
                              fault.max);
        if (r->num_frame_materials == PELL_FRAME_MATERIALS)
            return pell_error(r->ctx, PELL_ERR_UNSUPPORTED, scene->path, "mark some \"opaque\": true", "more than %d translucent materials",
                              PELL_FRAME_MATERIALS);
        f->medium = m->medium;
        f->gaussians = m->gaussians;
        if (m->profile)
            f->gaussians.count = 0; /* the profile, not its coefficients or a published set, is what scatters */
        f->white = m->color_from == PELL_COLOR_FROM_TEXTURE;
        f->name = m->preset && m->preset[0] ? m->preset : m->name;
        f->preset = !m->profile && m->gaussians.count == 0 ? m->preset : NULL;
        r->frame_index[i + 1] = (uint16_t) ++r->num_frame_materials;
    }
    return PELL_OK;
}

enum pell_result pell_renderer_set_scene(struct pell_renderer *r, const struct pell_scene *scene)
{
    enum pell_result res;

    drop_scene(r);
    if (!scene)
        return PELL_OK;
    if (scene->num_cameras < 1)
        return pell_error(r->ctx, PELL_ERR_INVALID, scene->path, NULL, "the scene has no camera");
    PELL_TRY(make_materials(r, scene));
    PELL_TRY(pell_specular_tables_create(r->ctx, scene, &r->tables));
    PELL_TRY(pell_compositor_create(r->ctx, scene->num_materials, &r->compositor));
    PELL_TRY(pell_rays_create(r->ctx, scene, r->pool, &r->rays));
    PELL_TRY(pell_mips_create(r->ctx, scene, r->pool, &r->mips));
    r->scene = scene;
    return PELL_OK;

fail:
    drop_scene(r);
    return res;
}

enum pell_result pell_renderer_set_method(struct pell_renderer *r, const struct pell_method *method, const void *knobs)
{
    void *copy = NULL;

    if (method) {
        if (!method->cpu)
            return pell_error(r->ctx, PELL_ERR_DEVICE, method->name, NULL, "has no engine cpu");
        copy = pell_zalloc(r->ctx, method->knobs_size);
        if (!copy)
            return PELL_ERR_NOMEM;
        if (knobs)
            memcpy(copy, knobs, method->knobs_size);
        else
            pell_knobs_default(method->knobs, copy);
        if (pell_knobs_check(r->ctx, method->knobs, method->name, copy) != PELL_OK) {
            pell_free(r->ctx, copy);
            return PELL_ERR_INVALID;
        }
    }
    pell_pass_destroy(&r->pass);
    pell_free(r->ctx, r->knobs);
    r->method = method;
    r->knobs = copy;
    return PELL_OK;
}

double pell_renderer_trace_bare(struct pell_renderer *r)
{
    struct pell_view view;

    if (!r->scene || !r->sized)
        return 0.0;
    view = pell_view_make(&r->scene->cameras[0], r->settings.width, r->settings.height, 0.0f, 0.0f);
    return pell_surface_trace_bare(r->pool, r->rays, r->scene, &view, &r->surface);
}

void pell_renderer_record_rays(struct pell_renderer *r, struct pell_ray_record *record)
{
    if (r->rays)
        pell_rays_record(r->rays, record);
}
