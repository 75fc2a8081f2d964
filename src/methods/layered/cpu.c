/* SPDX-License-Identifier: MIT
 *
 * cpu.c - layered on the cpu engine: creation, destruction, and rendering in packets of pixels. The march is in march.c and march_fast.c.
 */
#include "methods/layered/state.h"

#include "base/simd.h"
#include "render/engine.h"
#include "scene/layers.h"

#include <math.h>
#include <string.h>

PELL_SIMD_TABLES(struct layered_kernels, layered_kernels);

enum { BAND = 4 }; /* rows of a task */
#define DENSE 0.5  /* albedo */

/* --- Create and destroy --------------------------------------------------------------------------------------------------------- */

static void layered_destroy(void *state)
{
    struct layered_state *st = state;

    if (!st)
        return;
    layered_cache_end(st);
    layered_diffuse_destroy(st);
    layered_refracted_destroy(st);
    for (int i = 0; st->workers && i < pell_pool_threads(st->pool); i++) {
        struct layered_worker *w = &st->workers[i];
        pell_free(st->ctx, w->packet.uv);
        pell_free(st->ctx, w->packet.lookup);
        for (int k = 0; k < LAYERED_GROUP; k++)
            pell_free(st->ctx, w->sources[k].depth);
    }
    pell_free(st->ctx, st->workers);
    pell_free(st->ctx, st->light_points);
    for (size_t i = 0; i < st->num_samplers; i++)
        pell_light_sampler_destroy(&st->samplers[i]);
    pell_free(st->ctx, st->samplers);
    for (size_t i = 0; st->planes && i < st->num_meshes; i++)
        pell_free(st->ctx, st->planes[i]);
    pell_free(st->ctx, st->planes);
    for (size_t i = 0; st->media && i < st->num_materials; i++)
        layered_medium_finish(st->ctx, &st->media[i]);
    for (size_t i = 0; st->medium_layers && i < st->num_materials; i++)
        pell_free(st->ctx, st->medium_layers[i]);
    pell_free(st->ctx, st->media);
    pell_free(st->ctx, st->medium_layers);
    pell_free(st->ctx, st);
}

/* march=sum evaluates each step at its middle only, so it misses layers thinner than a step. Warns where that happens. */
static void warn_about_steps(const struct layered_state *st, const struct pell_material *m)
{
    struct pell_layer_measure measure[PELL_LAYERS_MOST];
    double deepest = 0.0, thinnest = (double) INFINITY, above = 0.0;
    const char *name = "";
    char shown[96], layer[96];

    if (st->knobs.march != LAYERED_SUM || m->num_layers < 2)
        return;
    pell_scene_layers_measure(m, measure);
    for (int i = 0; i < m->num_layers && isfinite(measure[i].max); i++) {
        const double thick = measure[i].mean - above;
        if (thick > 0.0 && thick < thinnest) {
            thinnest = thick;
            name = m->layers[i].name;
        }
        above = measure[i].mean;
        deepest = fmax(deepest, measure[i].max);
    }
    if (deepest > thinnest * st->knobs.samples)
        pell_warn(st->ctx, "layered", "raise samples, or use march=exponential, which includes every layer",
                  "steps of %.3g mm skip layer \"%s\" of \"%s\", which is %.3g mm thick: march=sum needs more than %.0f samples",
                  deepest / st->knobs.samples, pell_printable(name, layer, sizeof(layer)),
                  pell_printable(pell_material_shown_name(m), shown, sizeof(shown)), thinnest, ceil(deepest / thinnest));
}

/* In a dense medium most of the scattered light has scattered more than once. Reports that this method leaves it out. */
static void report_dense(const struct layered_state *st, const struct pell_material *m)
{
    char shown[96];
    double albedo = 0.0;

    for (int c = 0; c < 3; c++) {
        const double scattered = m->medium.sigma_s_reduced[c], all = scattered + m->medium.sigma_a[c];
        albedo = fmax(albedo, all > 0.0 ? scattered / all : 0.0);
    }
    if (!st->knobs.multiple && st->knobs.as != LAYERED_PAPER && m->num_layers == 0 && albedo > DENSE)
        pell_info(st->ctx, "layered", "light that \"%s\" scatters more than once is left out: multiple=on adds it",
                  pell_printable(pell_material_shown_name(m), shown, sizeof(shown)));
}

static enum pell_result make_media(struct layered_state *st, const struct pell_scene *scene)
{
    enum pell_result res = PELL_ERR_NOMEM;

    st->medium_layers = pell_calloc(st->ctx, scene->num_materials + 1, sizeof(*st->medium_layers));
    st->media = pell_calloc(st->ctx, scene->num_materials + 1, sizeof(*st->media));
    if (!st->medium_layers || !st->media)
        goto fail;
    st->num_materials = scene->num_materials;
    for (size_t i = 0; i < scene->num_meshes; i++) {
        const struct pell_mesh *mesh = &scene->meshes[i];
        const struct pell_material *m;
        struct layered_medium *medium;
        if (!layered_scatters(scene, mesh) || st->medium_layers[mesh->material])
            continue;
        m = &scene->materials[mesh->material];
        warn_about_steps(st, m);
        report_dense(st, m);
        medium = &st->media[mesh->material];
        st->medium_layers[mesh->material] = pell_alloc(st->ctx, sizeof(**st->medium_layers));
        if (!st->medium_layers[mesh->material])
            goto fail;
        PELL_TRY(pell_medium_layers_make(st->ctx, "layered", m, st->medium_layers[mesh->material]));
        PELL_TRY(layered_medium_make(st->ctx, st->medium_layers[mesh->material], m->name, st->knobs.under, medium));
        PELL_TRY(layered_medium_color(st->ctx, m, medium));
        PELL_TRY(layered_medium_steps(st->ctx, st->knobs.samples, st->knobs.steps == LAYERED_EQUAL, medium));
        st->most_layers = medium->count > st->most_layers ? medium->count : st->most_layers;
        st->most_packs = medium->packs + medium->colors > st->most_packs ? medium->packs + medium->colors : st->most_packs;
        res = PELL_ERR_NOMEM;
    }
    return PELL_OK;

fail:
    return res;
}

static enum pell_result make_workers(struct layered_state *st)
{
    const int threads = pell_pool_threads(st->pool);

    st->workers = pell_calloc(st->ctx, (size_t) threads, sizeof(*st->workers));
    if (!st->workers)
        return PELL_ERR_NOMEM;
    for (int i = 0; i < threads; i++) {
        struct layered_worker *w = &st->workers[i];
        w->packet.uv = pell_calloc(st->ctx, (size_t) st->most_packs + 1, 6 * LAYERED_LANES * sizeof(float));
        w->packet.lookup = pell_calloc(st->ctx, (size_t) st->most_packs + 1, sizeof(*w->packet.lookup));
        if (!w->packet.uv || !w->packet.lookup)
            return PELL_ERR_NOMEM;
        for (int k = 0; k < LAYERED_GROUP; k++) {
            w->sources[k].depth = pell_calloc(st->ctx, (size_t) (LAYERED_MAX_NODES * st->most_layers + 1), LAYERED_LANES * sizeof(float));
            if (!w->sources[k].depth)
                return PELL_ERR_NOMEM;
        }
    }
    return PELL_OK;
}

static enum pell_result layered_create(const struct pell_services *services, const struct pell_frame_shape *shape, const void *knobs,
                                       void **state)
{
    struct pell_context *ctx = services->ctx;
    const struct pell_scene *scene = services->scene;
    struct layered_state *st = pell_zalloc(ctx, sizeof(*st));
    const struct layered_knobs *k = knobs;
    enum pell_result res;

    *state = st;
    if (!st)
        return PELL_ERR_NOMEM;
    st->services = services;
    st->ctx = ctx;
    st->pool = services->pool;
    st->kernels = layered_kernels_tables[pell_simd_best()];
    st->knobs = *k;
    if (k->refraction == LAYERED_EXACT)
        st->knobs.path = LAYERED_RAYS; /* the sampled points of the march are the nodes */
    st->work = (struct layered_work) {
        .samples = k->samples,
        .exponential = k->march == LAYERED_EXPONENTIAL,
        .refracts = k->refraction != LAYERED_NONE,
        .absolute = k->path == LAYERED_PLANES && k->refraction == LAYERED_NONE,
        .rest = k->as != LAYERED_PAPER,
        .max_tau2 = k->tolerance > 0.0f ? -log2f(k->tolerance) : INFINITY,
        .nodes = LAYERED_RAY_NODES,
        .node = { 0.004f, 0.04f, 0.16f, 0.45f, 0.99f },
    };
    st->size = vec3_length(vec3_sub(vec3_load(scene->bounds_max), vec3_load(scene->bounds_min)));
    st->size = st->size > 0.0f && st->size < 1e12f ? st->size : 1.0f;
    PELL_TRY(make_media(st, scene));
    PELL_TRY(layered_fit(st, scene));
    PELL_TRY(layered_make_lights(st, scene));
    if (k->refraction == LAYERED_EXACT) {
        PELL_TRY(layered_refracted_make(st, scene));
        st->work.nodes = LAYERED_MAX_NODES;
        for (int i = 0; i < LAYERED_MAX_NODES; i++) { /* denser near the surface */
            const float x = (float) i / (LAYERED_MAX_NODES - 1);
            st->work.node[i] = 0.004f + 0.986f * x * x;
        }
    }
    PELL_TRY(make_workers(st));
    if (k->multiple || k->diffuse > 0.0f)
        PELL_TRY(layered_diffuse_make(st, shape));
    return PELL_OK;

fail:
    return res;
}

/* --- A packet ------------------------------------------------------------------------------------------------------------------- */

/* Copies a triangle's vertices to the lanes where `of` is -1. */
static void read_triangle(const struct layered_state *st, const struct layered_medium *m, const struct pell_mesh *from,
                          const float (*plane)[4], uint32_t triangle, struct layered_packet *p, const int32_t *of)
{
    struct layered_triangle t;

    for (int c = 0; c < 3; c++) {
        const size_t v = from->index[3 * (size_t) triangle + (size_t) c];
        memcpy(t.corner[c], from->position + 3 * v, sizeof(t.corner[c]));
        memcpy(t.normal[c], from->normal + 3 * v, sizeof(t.normal[c]));
        memcpy(t.plane[c], plane[v], sizeof(t.plane[c]));
        for (int k = 0; k < m->packs + m->colors; k++)
            layered_map_uv(m->pack[k].map, from, (uint32_t) v, t.uv[k][c]);
    }
    st->kernels->fill(&t, m->packs + m->colors, of, p);
}

/* Reads up to 16 pixels; unused lanes repeat the first one. */
static void read_packet(const struct layered_state *st, const struct layered_medium *m, const int32_t *at, int count,
                        struct layered_packet *p, uint32_t mesh[16], uint32_t triangle[16])
{
    const struct pell_scene *scene = st->services->scene;
    const struct pell_frame *in = st->in;
    const struct pell_vec3 camera = st->view->origin, forward = st->view->forward;
    _Alignas(64) int32_t same[LAYERED_LANES];

    p->count = count;
    for (int i = 0; i < LAYERED_LANES; i++) {
        const int32_t pixel = at[i < count ? i : 0];
        mesh[i] = in->mesh[pixel];
        triangle[i] = in->triangle[pixel];
        p->at[i] = pixel;
        p->u[i] = in->barycentric[0][pixel];
        p->v[i] = in->barycentric[1][pixel];
    }
    for (unsigned left = 0xffff; left;) {
        const int first = __builtin_ctz(left);
        for (int i = 0; i < LAYERED_LANES; i++) {
            same[i] = mesh[i] == mesh[first] && triangle[i] == triangle[first] ? -1 : 0;
            left &= ~((unsigned) same[i] & 1u << i);
        }
        read_triangle(st, m, &scene->meshes[mesh[first]], (const float(*)[4]) st->planes[mesh[first]], triangle[first], p, same);
    }
    for (int i = 0; i < LAYERED_LANES; i++) {
        const float u = p->u[i], v = p->v[i], w = 1.0f - u - v;
        const float x = camera.x - (w * p->corner[0][0][i] + u * p->corner[1][0][i] + v * p->corner[2][0][i]);
        const float y = camera.y - (w * p->corner[0][1][i] + u * p->corner[1][1][i] + v * p->corner[2][1][i]);
        const float z = camera.z - (w * p->corner[0][2][i] + u * p->corner[1][2][i] + v * p->corner[2][2][i]);
        const float depth = -(x * forward.x + y * forward.y + z * forward.z),
                    inv_length = 1.0f / fmaxf(sqrtf(x * x + y * y + z * z), 1e-20f);
        p->spacing[i] = (in->shape.orthographic ? 1.0f : depth) / in->shape.focal_px;
        p->camera[0][i] = in->shape.orthographic ? -forward.x : inv_length * x;
        p->camera[1][i] = in->shape.orthographic ? -forward.y : inv_length * y;
        p->camera[2][i] = in->shape.orthographic ? -forward.z : inv_length * z;
    }
}

/* The base colour of the substrate below the deepest layer, where a march may end. */
static void set_colors(const struct pell_material *m, const struct pell_scene *scene, struct layered_packet *p, const uint32_t *mesh,
                       const uint32_t *triangle)
{
    p->shows_substrate = true;
    for (int i = 0; i < p->count; i++) {
        float color[3];
        pell_base_color_at(m, &scene->meshes[mesh[i]], triangle[i], p->u[i], p->v[i], color);
        for (int c = 0; c < 3; c++)
            p->color[c][i] = color[c] * (1.0f / PELL_PI_F);
    }
}

/* Boundary tints: of the light that leaves, and of the light that enters where no texture pack provides it. */
static void set_tints(const struct pell_scene *scene, const struct pell_material *material, const struct layered_medium *m,
                      struct layered_packet *p, const uint32_t *mesh, const uint32_t *triangle, float exit_tint[3][LAYERED_LANES])
{
    struct pell_material plain = *material;

    plain.base_color_map.texture = NULL;
    for (int i = 0; i < p->count; i++) {
        float color[3], plain_color[3], in[3] = { 1.0f, 1.0f, 1.0f }, out[3] = { 1.0f, 1.0f, 1.0f };
        pell_base_color_at(material, &scene->meshes[mesh[i]], triangle[i], p->u[i], p->v[i], color);
        pell_base_color_at(&plain, &scene->meshes[mesh[i]], triangle[i], p->u[i], p->v[i], plain_color);
        pell_tint_apply(&m->tint, m->colors ? plain_color : color, true, in);
        pell_tint_apply(&m->tint, color, false, out);
        for (int c = 0; c < 3; c++) {
            p->entry_tint[c][i] = in[c];
            exit_tint[c][i] = m->colors ? out[c] : in[c] * out[c];
        }
    }
    for (int c = 0; c < 3; c++)
        for (int i = p->count; i < LAYERED_LANES; i++)
            p->entry_tint[c][i] = 0.0f;
}

static void run_packet(const struct layered_state *st, int material, const int32_t *at, int count, struct layered_worker *w)
{
    const struct pell_scene *scene = st->services->scene;
    const struct layered_medium *m = &st->media[material];
    struct layered_packet *p = &w->packet;
    uint32_t mesh[16], triangle[16];
    float exit_tint[3][LAYERED_LANES];
    int pending = 0;

    read_packet(st, m, at, count, p, mesh, triangle);
    if (m->tint.enabled)
        set_tints(scene, &scene->materials[material], m, p, mesh, triangle, exit_tint);
    st->kernels->start(&st->work, m, p);
    layered_find_exits(st, m, mesh, w);
    if (m->substrate == PELL_SUBSTRATE_SURFACE_COLOR && !m->bottomless)
        set_colors(&scene->materials[material], scene, p, mesh, triangle);
    for (int i = 0; i < st->num_light_points; i++) {
        struct layered_light *source = &w->sources[pending];
        if (layered_set_power(st, &st->light_points[i], p, source)) {
            layered_set_planes(st, &st->light_points[i], p, w, source);
            for (int k = 0; k < st->work.nodes && source->any_nodes; k++)
                layered_set_node(st, m, p, source, mesh, triangle, k, w);
            pending++;
        }
        if (pending == LAYERED_GROUP || (pending > 0 && i + 1 == st->num_light_points)) {
            st->kernels->march(&st->work, m, p, w->sources, pending);
            pending = 0;
        }
    }
    w->pixels += count;
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < count; i++) {
            const bool separate = st->out->single[0] != NULL;
            const float light = (1.0f - st->knobs.diffuse) * p->light[c][i] * (m->tint.enabled ? exit_tint[c][i] : 1.0f);
            st->out->light[c][at[i]] = separate ? 0.0f : light;
            if (separate)
                st->out->single[c][at[i]] = light;
        }
}

/* Renders a band in tiles of 4 x 4 pixels; each packet holds pixels of one material. */
static void run_band(void *arg, int index, int worker)
{
    const struct layered_state *st = arg;
    const struct pell_scene *scene = st->services->scene;
    const struct pell_frame *in = st->in;
    const int y0 = in->rect.y0 + index * BAND, y1 = y0 + BAND < in->rect.y1 ? y0 + BAND : in->rect.y1;
    int32_t at[16];
    int count = 0, material = -1;

    for (int x0 = in->rect.x0; x0 < in->rect.x1; x0 += BAND) {
        if (pell_cancelled(st->ctx))
            return;
        for (int y = y0; y < y1; y++)
            for (int x = x0; x < x0 + BAND && x < in->rect.x1; x++) {
                const ptrdiff_t i = y * in->shape.stride + x;
                const struct pell_mesh *mesh;
                if (!in->material[i])
                    continue;
                if (!layered_shows(st, i)) {
                    for (int c = 0; c < 3; c++) {
                        st->out->light[c][i] = 0.0f;
                        if (st->out->single[0])
                            st->out->single[c][i] = 0.0f;
                    }
                    continue;
                }
                mesh = &scene->meshes[in->mesh[i]];
                if (count == 16 || (count > 0 && mesh->material != material)) {
                    run_packet(st, material, at, count, &st->workers[worker]);
                    count = 0;
                }
                material = mesh->material;
                at[count++] = (int32_t) i;
            }
    }
    if (count > 0)
        run_packet(st, material, at, count, &st->workers[worker]);
}

static void note(struct layered_state *st, const char *name, double seconds, int64_t pixels, int64_t bytes, int64_t rays)
{
    st->times[st->num_times++] =
        (struct pell_pass_time) { .name = name, .seconds = seconds, .pixels = pixels, .bytes = bytes, .rays = rays };
}

static enum pell_result layered_render(void *state, const struct pell_frame *in, const struct pell_frame_light *out)
{
    struct layered_state *st = state;
    const double start = pell_seconds();
    int64_t pixels = 0, rays = 0;
    enum pell_result res;

    st->in = in;
    st->out = out;
    st->view = in->view;
    if (pell_services_observed(st->services, in))
        PELL_TRY(layered_show(st));
    for (int i = 0; i < st->num_light_points; i++)
        st->light_points[i].grid = st->light_points[i].per_pixel ? NULL : pell_services_light_grid(st->services, st->light_points[i].light);
    for (int i = 0; i < pell_pool_threads(st->pool); i++)
        st->workers[i].pixels = st->workers[i].rays = 0;
    pell_pool_run(st->pool, (in->rect.y1 - in->rect.y0 + BAND - 1) / BAND, run_band, st);
    for (int i = 0; i < pell_pool_threads(st->pool); i++) {
        pixels += st->workers[i].pixels;
        rays += st->workers[i].rays;
    }
    st->num_times = 0;
    if (st->fit_seconds >= 0.0) {
        note(st, "planes", st->fit_seconds, 0, st->fitted * 44, 0);
        st->fit_seconds = -1.0;
    }
    note(st, "layered", pell_seconds() - start, pixels, pixels * 30, rays);
    if (st->diffuse) {
        const double then = pell_seconds();
        PELL_TRY(layered_diffuse_render(st));
        note(st, "diffuse", pell_seconds() - then, pixels, pixels * 60, 0);
    }
    res = pell_cancelled(st->ctx) ? PELL_ERR_CANCELLED : PELL_OK;

fail:
    st->in = NULL;
    st->out = NULL;
    return res;
}

static size_t layered_times(const void *state, struct pell_pass_time *times, size_t size)
{
    const struct layered_state *st = state;

    for (size_t i = 0; i < st->num_times && i < size; i++)
        times[i] = st->times[i];
    return st->num_times < size ? st->num_times : size;
}

const struct pell_method_engine layered_cpu = {
    .create = layered_create, .record = layered_render, .destroy = layered_destroy, .times = layered_times
};
