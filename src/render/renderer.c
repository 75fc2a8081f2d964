/* SPDX-License-Identifier: MIT
 * renderer.c - the renderer: what it holds from frame to frame, and the one order in which the stages of a frame run. */
#include "render/renderer.h"

#include "render/composite/composite.h"
#include "render/planes.h"
#include "render/post/dof.h"
#include "render/post/post.h"

#include <string.h>

/* What a copy is measured with, bytes read: four planes of the picture, but not more, nor less, than this. */
#define COPY_MOST ((size_t) 32 << 20)
#define COPY_LEAST ((size_t) 1 << 20)
#define COPY_BANDS 64
#define COPY_ROUNDS 9
#define F_NUMBER 2.8 /* of a camera that does not say */
#define MAX_STAGES 48
#define MAX_CHANNELS 32

struct pell_renderer {
    struct pell_context *ctx; /* borrowed */
    struct pell_pool *pool;
    const struct pell_scene *scene; /* borrowed */
    const struct pell_method *method;
    void *knobs; /* owned copy */

    /* Of the scene. */
    struct pell_rays *rays;
    struct pell_mips *mips;
    struct pell_specular_tables *tables;
    struct pell_compositor *compositor;
    uint16_t *frame_index;                       /* per scene material + 1: the frame's material + 1, or 0 */
    struct pell_frame_material *frame_materials;
    size_t num_frame_materials;
    struct pell_profile **profiles;              /* per frame material: what was made for it, of three channels, or NULL */
    bool profiled;                               /* they are there, for settings.profile */
    float (*total)[3];                           /* per scene material: total reflectance of its profile */
    const struct pell_thickness_table **thickness; /* per scene material */

    /* Of scene and settings. */
    struct pell_settings settings; /* that the rest was made for */
    struct pell_lights *lights;
    uint64_t lights_number; /* see pell_renderer_lights */
    struct pell_pass *pass;
    float focal_px; /* that the pass was made for */
    bool orthographic;

    /* Of the size and the layers asked for. */
    bool sized;
    struct pell_surface surface;
    struct pell_rect covered; /* of the frame: what any of its samples may cover */
    struct pell_lighting lighting;
    struct pell_accumulator sum;
    struct pell_rect translucent; /* of all samples of the frame */
    bool noisy;                   /* the frame's method knows its standard error */
    float *lit[3], *light[3], *display[3];
    const float *noise[3]; /* the pass's own, of the last sample */
    float *single[3], *reflected[3]; /* there once a method gave them apart */
    int sample;                      /* of the frame, that is being made */
    bool scattered;                  /* the method gave light of a sample of the frame */
    struct pell_view eye;            /* of that sample */
    struct pell_lens lens;           /* of the frame */
    float *glow[PELL_BLOOM_PLANES];  /* there once bloom was asked for */
    float *open[PELL_DOF_PLANES], *open_tiles; /* there once depth of field was asked for */
    struct pell_checkpoint checkpoint; /* owned path; NULL: none */
    float *position[3], *hit[4]; /* there once a method asked for them; mesh, triangle and barycentric */
    uint16_t *material; /* the frame's plane */
    double *rows; /* 4 a row for post, then 2 a row for the meter */

    bool copies;      /* measure the following */
    double copy_rate; /* bytes a second that a copy reads and writes, 0: not measured yet */
    struct pell_stage_time stages[MAX_STAGES];
    size_t num_stages;
    struct pell_channel channels[MAX_CHANNELS];
};

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

/* Of a frame's light, all that does not hang on the sample. */
static struct pell_irradiance_params light_params(const struct pell_renderer *r, float mix)
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
    struct pell_irradiance_params p = light_params(r, mix);

    p.sample = first;
    pell_irradiance_points(r->lights, &p, points, spacing, samples, out);
}

void pell_renderer_light_of(const struct pell_renderer *r, uint64_t lights, const float *ambient, const struct pell_points *points,
                            float mix, float spacing, uint32_t first, int samples, struct pell_points_light *out)
{
    struct pell_irradiance_params p = light_params(r, mix);

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
    r->copies = params->copies;
    PELL_TRY(pell_pool_create(ctx, params->threads, &r->pool));
    *out = r;
    return PELL_OK;

fail:
    pell_renderer_destroy(&r);
    return res;
}

/* --- What hangs on the size --------------------------------------------------------------------------------------------------- */

static void drop_size(struct pell_renderer *r)
{
    pell_surface_finish(r->ctx, &r->surface);
    pell_free(r->ctx, r->lighting.irradiance[0]); /* owns all float planes, but for those made when asked for */
    pell_free(r->ctx, r->position[0]);
    pell_free(r->ctx, r->hit[0]);
    pell_free(r->ctx, r->single[0]);
    pell_free(r->ctx, r->glow[0]);
    pell_free(r->ctx, r->open[0]);
    pell_free(r->ctx, r->open_tiles);
    pell_free(r->ctx, r->material);
    pell_free(r->ctx, r->rows);
    memset(&r->lighting, 0, sizeof(r->lighting));
    memset(&r->sum, 0, sizeof(r->sum));
    memset(r->position, 0, sizeof(r->position));
    memset(r->hit, 0, sizeof(r->hit));
    memset(r->single, 0, sizeof(r->single));
    memset(r->glow, 0, sizeof(r->glow));
    memset(r->open, 0, sizeof(r->open));
    r->open_tiles = NULL;
    memset(r->reflected, 0, sizeof(r->reflected));
    r->material = NULL;
    r->rows = NULL;
    r->sized = false;
}

static enum pell_result make_size(struct pell_renderer *r, const struct pell_settings *s)
{
    const size_t pixels = (size_t) pell_plane_stride(s->width) * (size_t) s->height;
    struct pell_lighting *l = &r->lighting;
    struct pell_accumulator *a = &r->sum;
    float **planes[64];
    size_t n = 0;
    enum pell_result res;

    for (int c = 0; c < 3; c++) {
        planes[n++] = &l->irradiance[c];
        planes[n++] = &l->through[c];
        planes[n++] = &l->specular[c];
        planes[n++] = &a->color[c];
        planes[n++] = &r->light[c];
        planes[n++] = &r->lit[c];
        planes[n++] = &r->display[c];
        if (s->layers) {
            planes[n++] = &a->multiple[c];
            planes[n++] = &a->transmission[c];
            planes[n++] = &a->specular[c];
            planes[n++] = &a->irradiance[c];
            planes[n++] = &a->normal[c];
            planes[n++] = &a->variance[c];
        }
    }
    planes[n++] = &a->alpha;
    if (s->layers) {
        planes[n++] = &a->depth;
        planes[n++] = &a->translucent;
    }

    PELL_TRY(pell_surface_allocate(r->ctx, s->width, s->height, &r->surface));
    PELL_TRY(pell_planes_allocate(r->ctx, s->width, s->height, planes, n));
    res = PELL_ERR_NOMEM;
    r->material = pell_calloc(r->ctx, pixels, sizeof(*r->material));
    r->rows = pell_calloc(r->ctx, (size_t) s->height * 6, sizeof(*r->rows));
    if (!r->material || !r->rows)
        goto fail;
    r->sum.meter = r->rows + (size_t) s->height * 4;
    r->sized = true;
    return PELL_OK;

fail:
    drop_size(r);
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
    drop_size(r);
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

static enum pell_profile_model model_of(const struct pell_material *m, int setting)
{
    return setting > 0 ? (enum pell_profile_model) (setting - 1) : m->model;
}

/* Materials with one profile share it: the profile is large, and some models take their time. */
static bool same_profile(const struct pell_material *a, const struct pell_material *b, int setting)
{
    return !b->opaque && !a->profile && !b->profile && a->gaussians.count == 0 && b->gaussians.count == 0 &&
           model_of(a, setting) == model_of(b, setting) && memcmp(&a->medium, &b->medium, sizeof(a->medium)) == 0;
}

/* Makes the profile of a scene's material into *out, which is for three channels. */
static enum pell_result make_profile(struct pell_renderer *r, const struct pell_material *m, struct pell_profile *out)
{
    const enum pell_profile_model model = model_of(m, r->settings.profile);

    for (int c = 0; c < 3; c++) {
        const enum pell_result res = m->gaussians.count > 0 ? pell_profile_from_gaussians(&m->gaussians, c, &out[c])
                                                            : pell_profile_make(model, &m->medium, c, NULL, &out[c]);
        if (res != PELL_OK)
            return pell_error(r->ctx, res, m->name, "choose another profile", "has no profile %s",
                              pell_profile_model_at(model) ? pell_profile_model_at(model)->name : "of that model");
    }
    return PELL_OK;
}

/* Gives every translucent material its profile, and says how much light each reflects. */
static enum pell_result make_profiles(struct pell_renderer *r)
{
    const struct pell_scene *scene = r->scene;
    struct pell_frame_material *const frame = r->frame_materials;
    enum pell_result res = PELL_ERR_NOMEM;

    if (!r->profiles)
        r->profiles = pell_calloc(r->ctx, r->num_frame_materials + 1, sizeof(*r->profiles));
    if (!r->profiles)
        goto fail;
    for (size_t i = 0; i < scene->num_materials; i++) {
        const struct pell_material *m = &scene->materials[i];
        const size_t at = r->frame_index[i + 1];
        size_t k = 0;

        if (at == 0)
            continue;
        if (r->settings.profile > 0 && (m->profile || m->gaussians.count > 0))
            pell_warn(r->ctx, m->name, "a model makes profiles of coefficients", "has no coefficients: its own profile is used, not %s",
                      pell_profile_model_at(model_of(m, r->settings.profile))->name);
        while (k < i && !(r->frame_index[k + 1] && same_profile(m, &scene->materials[k], r->settings.profile)))
            k++;
        if (k < i) {
            frame[at - 1].profile = frame[r->frame_index[k + 1] - 1].profile;
        } else if (m->profile) {
            frame[at - 1].profile = m->profile;
        } else {
            if (!r->profiles[at - 1])
                r->profiles[at - 1] = pell_calloc(r->ctx, 3, sizeof(**r->profiles));
            res = PELL_ERR_NOMEM;
            if (!r->profiles[at - 1])
                goto fail;
            PELL_TRY(make_profile(r, m, r->profiles[at - 1]));
            frame[at - 1].profile = r->profiles[at - 1];
        }
        for (int c = 0; c < 3; c++)
            r->total[i][c] = frame[at - 1].white ? 1.0f : (float) pell_profile_total(&frame[at - 1].profile[c]);
    }
    r->profiled = true;
    return PELL_OK;

fail:
    return res;
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

/* The frame's shape for the method: what does not change from sample to sample. */
static struct pell_frame frame_shape(const struct pell_renderer *r, const struct pell_view *view)
{
    return (struct pell_frame) {
        .width = view->width,
        .height = view->height,
        .stride = r->surface.stride,
        .orthographic = view->orthographic,
        .focal_px = view->focal_px,
        .object_height = r->scene->bounds_max[1] - r->scene->bounds_min[1],
        .materials = r->frame_materials,
        .num_materials = r->num_frame_materials,
    };
}

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

/* The surface keeps what its rays hit for methods that ask. */
static void lend_hits(struct pell_renderer *r)
{
    const bool asked = r->pass && (pell_pass_plan(r->pass)->needs & PELL_NEED_HIT);

    r->surface.mesh = asked ? (uint32_t *) r->hit[0] : NULL;
    r->surface.triangle = asked ? (uint32_t *) r->hit[1] : NULL;
    r->surface.barycentric[0] = asked ? r->hit[2] : NULL;
    r->surface.barycentric[1] = asked ? r->hit[3] : NULL;
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

/* Everything that a frame of these settings needs and that is not there yet. */
static enum pell_result prepare(struct pell_renderer *r, const struct pell_settings *s, const struct pell_view *view)
{
    const struct pell_settings *old = &r->settings;
    const bool same_size = r->sized && old->width == s->width && old->height == s->height && old->layers == s->layers;
    const bool same_lights = r->lights && old->light_samples == s->light_samples && old->ambient_samples == s->ambient_samples &&
                             old->environment_lights == s->environment_lights && old->msaa == s->msaa && old->boundary == s->boundary &&
                             old->seed == s->seed;
    enum pell_result res;

    if (!same_size || r->focal_px != view->focal_px || r->orthographic != view->orthographic)
        pell_pass_destroy(&r->pass);
    if (!same_size)
        drop_size(r);
    if (!same_lights) {
        pell_lights_destroy(&r->lights);
        if (r->pass && (pell_pass_plan(r->pass)->needs & PELL_NEED_SCENE) && !pell_pass_plan(r->pass)->relights)
            pell_pass_destroy(&r->pass); /* it keeps what they lit */
    }
    if (old->profile != s->profile) {
        pell_pass_destroy(&r->pass);
        r->profiled = false;
    }
    r->settings = *s;
    if (!r->profiled)
        PELL_TRY(make_profiles(r));
    if (!r->sized)
        PELL_TRY(make_size(r, s));
    r->surface.mips = r->mips; /* before a pass is made: methods light points of this scene then */
    r->surface.lean = true;
    if (!r->lights) {
        PELL_TRY(pell_lights_create(r->ctx, r->scene, s, r->pool, &r->lights));
        r->lights_number++;
    }
    if (!r->pass) {
        memset(r->thickness, 0, r->scene->num_materials * sizeof(*r->thickness));
        if (r->method && r->num_frame_materials > 0) {
            const struct pell_frame shape = frame_shape(r, view);
            PELL_TRY(pell_pass_create(r, r->method, r->knobs, &shape, &r->pass));
            r->focal_px = view->focal_px;
            r->orthographic = view->orthographic;
            for (size_t i = 0; i < r->scene->num_materials; i++)
                if (r->frame_index[i + 1])
                    r->thickness[i] = pell_pass_thickness(r->pass, (size_t) r->frame_index[i + 1] - 1);
        }
    }
    if (r->pass && (pell_pass_plan(r->pass)->needs & PELL_NEED_POSITION) && !r->position[0]) {
        float **const planes[] = { &r->position[0], &r->position[1], &r->position[2] };
        PELL_TRY(pell_planes_allocate(r->ctx, s->width, s->height, planes, PELL_COUNT(planes)));
    }
    if (r->pass && (pell_pass_plan(r->pass)->needs & PELL_NEED_HIT) && !r->hit[0]) {
        float **const planes[] = { &r->hit[0], &r->hit[1], &r->hit[2], &r->hit[3] };
        PELL_TRY(pell_planes_allocate(r->ctx, s->width, s->height, planes, PELL_COUNT(planes)));
    }
    lend_hits(r);
    if (s->bloom > 0.0f && !r->glow[0]) {
        float **const planes[PELL_BLOOM_PLANES] = { &r->glow[0], &r->glow[1], &r->glow[2] };
        PELL_TRY(pell_planes_allocate(r->ctx, s->width, s->height, planes, PELL_COUNT(planes)));
    }
    if (s->dof && !r->open[0]) {
        float **const planes[PELL_DOF_PLANES] = { &r->open[0], &r->open[1], &r->open[2], &r->open[3], &r->open[4], &r->open[5] };
        PELL_TRY(pell_planes_allocate(r->ctx, s->width, s->height, planes, PELL_COUNT(planes)));
    }
    if (s->dof && !r->open_tiles && !(r->open_tiles = pell_calloc(r->ctx, pell_dof_tiles(s->width, s->height), sizeof(float))))
        return PELL_ERR_NOMEM;
    if (r->pass && pell_pass_plan(r->pass)->gives && s->layers && !r->single[0]) {
        float **planes[9];
        for (size_t c = 0; c < 3; c++) {
            planes[c] = &r->single[c];
            planes[3 + c] = &r->reflected[c];
            planes[6 + c] = &r->sum.single[c];
        }
        PELL_TRY(pell_planes_allocate(r->ctx, s->width, s->height, planes, PELL_COUNT(planes)));
    }
    return PELL_OK;

fail:
    return res;
}

/* --- Time --------------------------------------------------------------------------------------------------------------------- */

struct copy_task {
    const char *from;
    char *to;
    size_t band;
};

static void copy_band(void *arg, int index, int worker)
{
    const struct copy_task *t = arg;
    (void) worker;
    memcpy(t->to + (size_t) index * t->band, t->from + (size_t) index * t->band, t->band);
}

/* The rate at which this renderer's threads copy four planes of the picture's size (a blur's key and light) to four others, over and over:
 * what is read was last touched a pass ago, as it is between stages, so it is in the outer caches or in memory according to the size of
 * the picture. The median of some rounds, so that one that was lucky does not count, nor one that was disturbed. */
static enum pell_result measure_copy(struct pell_renderer *r, const struct pell_settings *s)
{
    size_t bytes = 4 * sizeof(float) * (size_t) pell_plane_stride(s->width) * (size_t) s->height;
    double rounds[COPY_ROUNDS];
    struct copy_task t;
    char *block;

    bytes = bytes < COPY_LEAST ? COPY_LEAST : bytes > COPY_MOST ? COPY_MOST : bytes;
    t.band = bytes / COPY_BANDS / 64 * 64;
    bytes = t.band * COPY_BANDS;
    block = pell_zalloc(r->ctx, 2 * bytes);
    if (!block)
        return PELL_ERR_NOMEM;
    t.from = block;
    t.to = block + bytes;
    for (int i = 0; i < COPY_ROUNDS; i++) {
        const double start = pell_seconds();
        double time;
        int at = i;
        pell_pool_run(r->pool, COPY_BANDS, copy_band, &t);
        time = pell_seconds() - start;
        for (; at > 0 && rounds[at - 1] > time; at--)
            rounds[at] = rounds[at - 1];
        rounds[at] = time;
    }
    pell_free(r->ctx, block);
    r->copy_rate = 2.0 * (double) bytes / fmax(rounds[COPY_ROUNDS / 2], 1e-9);
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
    s->copy_ms = r->copy_rate > 0.0 ? 1e3 * (double) s->bytes / r->copy_rate : 0.0;
}

/* --- One frame ---------------------------------------------------------------------------------------------------------------- */

static void unite(struct pell_rect *a, const struct pell_rect *b)
{
    if (b->x0 >= b->x1)
        return;
    if (a->x0 >= a->x1)
        *a = *b;
    a->x0 = b->x0 < a->x0 ? b->x0 : a->x0;
    a->y0 = b->y0 < a->y0 ? b->y0 : a->y0;
    a->x1 = b->x1 > a->x1 ? b->x1 : a->x1;
    a->y1 = b->y1 > a->y1 ? b->y1 : a->y1;
}

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
    struct pell_frame frame = frame_shape(r, view);
    struct pell_frame_light out = { .light = { r->light[0], r->light[1], r->light[2] } };
    const struct pell_plan *plan;
    struct remap_task remap = { r, view, r->material, NULL };
    struct pell_pass_time times[24];
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
    unite(&r->translucent, &s->translucent);

    start = pell_seconds();
    light = light_params(r, plan ? plan->mix : -1.0f);
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
    if (r->copies && (r->copy_rate == 0.0 || r->settings.width != settings->width || r->settings.height != settings->height))
        PELL_TRY(measure_copy(r, settings));
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
    PELL_TRY(prepare(r, settings, &view));
    if (pell_seconds() - begin > 1e-4)
        note(r, "prepare", pell_seconds() - begin, 0, 0, 0);

    /* Layers are cleared by the composite alone, so that it goes over all of the picture for them. */
    r->covered = r->scene->ground_mesh >= 0 || settings->layers
                     ? (struct pell_rect) { 0, 0, settings->width, settings->height }
                     : pell_view_rect(&view, r->scene->bounds_min, r->scene->bounds_max);
    for (int i = 0; r->lens.radius > 0.0f && i < settings->msaa; i++) {
        const struct pell_view through = sample_view(r, settings, i);
        const struct pell_rect rect = pell_view_rect(&through, r->scene->bounds_min, r->scene->bounds_max);
        unite(&r->covered, &rect);
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
    if (!post.covered)
        pell_warn(r->ctx, "render", "check the camera: `pellucid check` prints where the things are", "nothing is in view");
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
