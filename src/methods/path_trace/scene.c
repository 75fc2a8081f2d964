/* SPDX-License-Identifier: MIT
 * scene.c - scene data for path tracing, created once; ray intersection. */
#include "methods/path_trace/walk.h"

#include "image/color.h"
#include "methods/reference_frame.h"
#include "scene/material_maps.h"
#include "scene/mesh/topology.h"
#include "scene/triangle.h"

#include <stdio.h>
#include <string.h>

#define GRID_BYTES ((size_t) 64 << 20)
#define SMOOTH_ROUGHNESS 0.05f /* below: alpha under 0.0025, treated as a delta distribution */
#define MATCHED 1e-3f          /* indices that differ by less have no rough boundary between them */
#define SPLIT_RANGE 3.0f       /* in mean free paths: distance beyond the bound within which flights are split */
#define NEE_FRACTION 0.1f      /* for isotropic scattering; successive forward scattering events are correlated */
#define PROBES 256
#define FOLD_RAYS 1024        /* test rays that detect folds */
#define MAX_LIGHT_RAYS 6      /* light rays per sample */
#define ROUGHNESS_STEPS 48.0f /* quantisation steps of mapped roughness, from 0 to 1 */
#define MAX_TEXELS (1u << 20)

/* --- Solids ----------------------------------------------------------------------------------------------------------------------- */

static const struct pell_mesh *mesh_of(const struct pt_scene *s, size_t solid, size_t triangle)
{
    return &s->scene->meshes[s->solids->solids[solid].triangles[triangle].mesh];
}

static void bound(const struct pt_scene *s, size_t i)
{
    const struct pell_solid *b = &s->solids->solids[i];
    struct pt_solid *out = &s->solid[i];

    out->lo = vec3(INFINITY, INFINITY, INFINITY);
    out->hi = vec3(-INFINITY, -INFINITY, -INFINITY);
    for (size_t t = 0; t < b->num_triangles && !pell_cancelled_at(s->ctx, t); t++) {
        const struct pell_mesh *m = mesh_of(s, i, t);
        for (int k = 0; k < 3; k++) {
            const float *p = m->position + 3 * (size_t) m->index[3 * (size_t) b->triangles[t].triangle + (size_t) k];
            out->lo = vec3(fminf(out->lo.x, p[0]), fminf(out->lo.y, p[1]), fminf(out->lo.z, p[2]));
            out->hi = vec3(fmaxf(out->hi.x, p[0]), fmaxf(out->hi.y, p[1]), fmaxf(out->hi.z, p[2]));
        }
    }
}

/* The ground is a sheet that bounds everything below it: its medium ends at a distance of the sheet's size. */
static void deepen_ground(const struct pt_scene *s, size_t i)
{
    struct pt_solid *b = &s->solid[i];
    const struct pell_vec3 size = vec3_sub(b->hi, b->lo);
    const float depth = fmaxf(size.x, fmaxf(size.y, size.z));

    if (s->scene->ground_mesh < 0 || s->solids->of_mesh[s->scene->ground_mesh] != (int) i)
        return;
    b->lo = vec3_sub(b->lo, vec3(depth, depth, depth));
    b->hi = vec3_add(b->hi, vec3(depth, depth, depth));
}

/* Detects open surfaces; one warning per object. (Inverted normals of closed ones are fixed when a scene is completed.) */
static enum pell_result inspect(struct pt_scene *s)
{
    const struct pell_scene *scene = s->scene;
    struct pell_scene_report report = { 0 };
    uint32_t *order = pell_calloc(s->ctx, 2 * scene->num_meshes + 1, sizeof(*order));
    enum pell_result res = PELL_ERR_NOMEM;
    size_t rank = 0; /* reports are sorted by object index */

    if (!order)
        return PELL_ERR_NOMEM;
    PELL_TRY(pell_scene_check(scene, &report));
    pell_scene_objects(scene, order, order + scene->num_meshes);
    for (size_t i = 0, previous = SIZE_MAX; i < scene->num_meshes; i++) {
        const uint32_t m = order[i];
        const int solid = m < s->solids->num_meshes ? s->solids->of_mesh[m] : -1;
        rank += i > 0 && scene->meshes[m].object != scene->meshes[order[i - 1]].object;
        if (solid < 0 || rank >= report.num_objects)
            continue;
        const struct pell_object_report *o = &report.objects[rank];
        s->solid[solid].closed = o->closed || o->joined;
        if (previous != rank && !s->solid[solid].closed)
            pell_warn(
                s->ctx, o->name, "close it: a medium needs a closed surface",
                "the surface is open (%lld boundary edges): path-trace ends the medium where light finds no surface inside its bounds",
                (long long) o->boundary_edges);
        previous = rank;
    }
    res = PELL_OK;

fail:
    pell_scene_report_finish(s->ctx, &report);
    pell_free(s->ctx, order);
    return res;
}

/* Fraction of the scattering events with next-event estimation, tuned on the bunny in milk, skin and ketchup: smaller for long paths and
 * for forward scattering. */
static float nee_fraction(const struct pt_coefficients *m)
{
    float albedo = 0.0f;

    for (int c = 0; c < 3; c++)
        albedo = fmaxf(albedo, m->sigma_t[c] > 0.0f ? m->sigma_s[c] / m->sigma_t[c] : 0.0f);
    return fminf(NEE_FRACTION * (1.0f - 0.7f * fmaxf(m->g[1], 0.0f)) + 0.5f * sqrtf(fmaxf(1.0f - albedo, 0.0f)), 1.0f);
}

/* A solid's boundary is smooth everywhere, or rough everywhere: connections find light through either, but where a solid had both, only
 * walks that meet a light at random would. Its smooth parts are as rough as the least that counts as rough; a material may be in several
 * solids. */
static void make_boundaries_alike(struct pt_scene *s)
{
    bool changed = true;

    while (changed) {
        changed = false;
        for (size_t i = 0; i < s->solids->count; i++) {
            struct pt_solid *b = &s->solid[i];
            const size_t triangles = s->solids->solids[i].num_triangles;
            const bool matched = fabsf(b->medium.eta - 1.0f) < MATCHED;
            b->smooth = b->rough = triangles > 0;
            for (size_t t = 0; t < triangles && !pell_cancelled_at(s->ctx, t); t++) {
                const struct pt_roughness_range *f = &s->roughness_ranges[mesh_of(s, i, t)->material];
                b->smooth = b->smooth && (matched || f->high < SMOOTH_ROUGHNESS);
                b->rough = b->rough && !matched && f->low >= SMOOTH_ROUGHNESS;
            }
            for (size_t t = 0; t < triangles && !b->smooth && !b->rough && !pell_cancelled_at(s->ctx, t); t++) {
                struct pt_roughness_range *f = &s->roughness_ranges[mesh_of(s, i, t)->material];
                changed = changed || f->low < SMOOTH_ROUGHNESS;
                f->low = fmaxf(f->low, SMOOTH_ROUGHNESS);
                f->high = fmaxf(f->high, SMOOTH_ROUGHNESS);
            }
        }
        changed = changed && !pell_cancelled(s->ctx);
    }
}

static enum pell_result make_solids(struct pt_scene *s)
{
    struct pell_vec3 lo = vec3(INFINITY, INFINITY, INFINITY), hi = vec3(-INFINITY, -INFINITY, -INFINITY);

    for (size_t i = 0; i < s->solids->count; i++) {
        struct pt_solid *b = &s->solid[i];
        const struct pell_solid *from = &s->solids->solids[i];
        enum pell_result res;
        if (from->num_triangles == 0)
            continue;
        const struct pell_material *m = &s->scene->materials[mesh_of(s, i, 0)->material];
        if ((res = pt_medium_make(s->ctx, s->scene, m, &b->medium)) != PELL_OK)
            return res;
        b->fraction = nee_fraction(&b->medium.layer[b->medium.layers - 1]);
        bound(s, i);
        lo = vec3(fminf(lo.x, b->lo.x), fminf(lo.y, b->lo.y), fminf(lo.z, b->lo.z));
        hi = vec3(fmaxf(hi.x, b->hi.x), fmaxf(hi.y, b->hi.y), fmaxf(hi.z, b->hi.z));
        deepen_ground(s, i);
    }
    if (lo.x <= hi.x) {
        s->centre = vec3_mul(vec3_add(lo, hi), 0.5f);
        s->epsilon = 1e-6f * fmaxf(vec3_max_abs(lo), vec3_max_abs(hi)) + 1e-12f;
        s->radius = 0.5 * (double) vec3_length(vec3_sub(hi, lo)) * 1.0001 + 1e-6;
    }
    return pell_cancelled(s->ctx) ? PELL_ERR_CANCELLED : PELL_OK;
}

/* --- Boundaries --------------------------------------------------------------------------------------------------------------------- */

static enum pell_result add_rough(struct pt_scene *s, float alpha, float eta)
{
    struct pt_rough *grown;

    if (fabsf(eta - 1.0f) < MATCHED)
        return PELL_OK;
    for (size_t i = 0; i < s->num_rough; i++)
        if (s->rough[i].alpha == alpha && s->rough[i].eta == eta)
            return PELL_OK;
    grown = pell_realloc_array(s->ctx, s->rough, s->num_rough + 1, sizeof(*grown));
    if (!grown)
        return PELL_ERR_NOMEM;
    s->rough = grown;
    pt_rough_make(alpha, eta, &s->rough[s->num_rough++]);
    return PELL_OK;
}

/* GGX alpha of a step of the range; 0: smooth. */
static float step_alpha(const struct pt_roughness_range *f, int step)
{
    const float r = f->steps > 1 ? f->low + (f->high - f->low) * ((float) step / (float) (f->steps - 1)) : f->high;

    return r >= SMOOTH_ROUGHNESS ? r * r : 0.0f;
}

float pt_alpha(const struct pt_scene *s, const struct pt_hit *hit)
{
    const struct pt_roughness_range *f = &s->roughness_ranges[hit->material];
    const struct pell_material *m = &s->scene->materials[hit->material];
    float texel[4], step = 0.0f;

    if (f->steps > 1) {
        pt_texel_at(s, hit, &m->roughness_map, texel);
        step = (m->roughness * texel[m->roughness_map.channel & 3] - f->low) / (f->high - f->low) * (float) (f->steps - 1) + 0.5f;
        step = fminf(fmaxf(step, 0.0f), (float) (f->steps - 1));
    }
    return step_alpha(f, (int) step);
}

const struct pt_rough *pt_rough_find(const struct pt_scene *s, const struct pt_hit *hit, float eta)
{
    const float alpha = s->roughness_ranges[hit->material].high < SMOOTH_ROUGHNESS ? 0.0f : pt_alpha(s, hit);

    for (size_t i = 0; alpha > 0.0f && i < s->num_rough; i++)
        if (s->rough[i].alpha == alpha && fabsf(s->rough[i].eta - eta) < 1e-5f)
            return &s->rough[i];
    return NULL;
}

/* Adds the boundaries of all steps of a range. */
static enum pell_result add_roughness_range(struct pt_scene *s, const struct pt_roughness_range *f, float eta)
{
    enum pell_result res = PELL_OK;

    for (int step = 0; step < f->steps && res == PELL_OK; step++)
        if (step_alpha(f, step) > 0.0f)
            res = add_rough(s, step_alpha(f, step), eta);
    return res;
}

static enum pell_result make_boundaries(struct pt_scene *s)
{
    enum pell_result res = PELL_OK;

    for (size_t i = 0; i < s->solids->count; i++)
        for (size_t t = 0; t < s->solids->solids[i].num_triangles && !pell_cancelled_at(s->ctx, t); t++) {
            const int m = mesh_of(s, i, t)->material;
            if (s->roughness_ranges[m].high < SMOOTH_ROUGHNESS || (t > 0 && m == mesh_of(s, i, t - 1)->material))
                continue;
            PELL_TRY(add_roughness_range(s, &s->roughness_ranges[m], s->solid[i].medium.eta));
            for (size_t k = 0; k < s->solids->count; k++)
                if (k != i && s->solid[k].medium.eta > 0.0f)
                    PELL_TRY(add_roughness_range(s, &s->roughness_ranges[m], s->solid[i].medium.eta / s->solid[k].medium.eta));
        }
fail:
    return res;
}

/* Smallest and largest value of a map; of large maps conservative bounds. */
static void map_range(const struct pell_texture_map *map, float range[2])
{
    const struct pell_image *image = &map->texture->image;
    const size_t texels = (size_t) image->width * (size_t) image->height;

    range[0] = texels <= MAX_TEXELS ? 1.0f : 0.0f;
    range[1] = texels <= MAX_TEXELS && texels > 0 ? 0.0f : 1.0f;
    for (size_t i = 0; i < texels && texels <= MAX_TEXELS; i++) {
        float texel[4], x;
        pell_image_sample(image, PELL_WRAP_CLAMP, PELL_WRAP_CLAMP, true,
                          ((float) (i % (size_t) image->width) + 0.5f) / (float) image->width,
                          ((float) (i / (size_t) image->width) + 0.5f) / (float) image->height, texel);
        x = fminf(fmaxf(texel[map->channel & 3], 0.0f), 1.0f);
        range[0] = fminf(range[0], x);
        range[1] = fmaxf(range[1], x);
    }
}

static void set_roughness_ranges(struct pt_scene *s)
{
    const bool rough = s->knobs.boundary == PT_BOUNDARY_SETTINGS ? s->services->settings->boundary == PELL_BOUNDARY_MODEL_ROUGH
                                                                 : s->knobs.boundary == PT_BOUNDARY_ROUGH;

    for (size_t i = 0; i < s->scene->num_materials; i++) {
        const struct pell_material *m = &s->scene->materials[i];
        const float r = rough && !m->opaque ? fminf(m->roughness, 1.0f) : 0.0f;
        struct pt_roughness_range *f = &s->roughness_ranges[i];
        float range[2] = { 1.0f, 1.0f };
        if (r >= SMOOTH_ROUGHNESS && m->roughness_map.texture) {
            map_range(&m->roughness_map, range);
            for (size_t k = 0; k < s->scene->num_meshes; k++) /* without coordinates the map's value is 1 */
                if (s->scene->meshes[k].material == (int) i && !s->scene->meshes[k].uv[m->roughness_map.uv])
                    range[1] = 1.0f;
        }
        f->low = r * range[0];
        f->high = r * range[1];
        f->steps = 1 + (int) ceilf((f->high - f->low) * ROUGHNESS_STEPS);
    }
}

/* --- Lights -------------------------------------------------------------------------------------------------------------------------- */

/* Number of useful light rays per sample, from the fraction of mirrored rays that hit a surface: 32 in 100 on a seated figure, 8 on a
 * bunny, none on a ball. */
static int light_rays(const struct pt_scene *s)
{
    struct pt_sampler q = pt_sampler_start(s->seed, 0, 0, 98);
    struct pt_counts counts = { 0 };
    int mirrored = 0, hits = 0;
    double folded;

    for (int i = 0; i < FOLD_RAYS; i++) {
        struct pell_light_ray light;
        struct pt_hit hit, next;
        struct pell_vec3 w;
        double u[5];
        for (int k = 0; k < 5; k++)
            u[k] = pt_fine(&q);
        if (!pell_light_sampler_emit(s->light_sampler, s->centre, s->radius, u, &light) || !light.sample.delta ||
            !pt_intersect(s, &counts, light.origin, light.direction, INFINITY, PELL_RAY_ALL, &hit) || hit.solid < 0)
            continue;
        w = vec3_mad(light.direction, -2.0f * vec3_dot(light.direction, hit.ng), hit.ng);
        mirrored++;
        hits += pt_intersect(s, &counts, pt_offset_origin(&hit, w), w, INFINITY, PELL_RAY_ALL, &next);
    }
    folded = mirrored > 0 ? fmin(fmax((double) hits / mirrored - 0.1, 0.0) / 0.15, 1.0) : 0.0;
    return 1 + (int) ((MAX_LIGHT_RAYS - 1) * folded + 0.5);
}

static void probe_lights(struct pt_scene *s)
{
    struct pt_sampler q = pt_sampler_start(s->seed, 0, 0, 99);
    double flux = 0.0, uneven = 0.0, environments = 0.0;

    for (size_t i = 0; i < s->scene->num_lights; i++) {
        const struct pell_light *l = &s->scene->lights[i];
        const bool delta = l->type == PELL_LIGHT_POINT || l->type == PELL_LIGHT_SPOT || l->type == PELL_LIGHT_DIRECTIONAL;
        s->light_paths = s->light_paths || delta;
        for (int c = 0; !delta && l->type != PELL_LIGHT_ENVIRONMENT && c < 3; c++)
            s->brightest = fmax(s->brightest, (double) l->power[c]);
    }
    for (int i = 0; s->radius > 0.0 && i < PROBES; i++) {
        double u[5];
        struct pell_vec3 direction;
        struct pell_light_sample sample;
        struct pell_light_ray ray;
        struct pell_light_hit hit;
        for (int k = 0; k < 5; k++)
            u[k] = pt_fine(&q);
        if (pell_light_sampler_emit(s->light_sampler, s->centre, s->radius, u, &ray))
            flux += fmax(ray.weight[0], fmax(ray.weight[1], ray.weight[2])) / PROBES;
        if (pell_light_sampler_sample(s->light_sampler, s->centre, u, &sample) && sample.distant && !sample.delta) {
            uneven += sample.pdf * 4.0 * PELL_PI;
            environments += 1.0;
        }
        direction = vec3((float) (2.0 * u[0] - 1.0), (float) (2.0 * u[1] - 1.0), (float) (2.0 * u[2] - 1.0));
        direction = vec3_normalize(direction);
        for (int k = 0; pell_light_sampler_hit(s->light_sampler, s->centre, s->centre, direction, INFINITY, k, &hit); k++)
            for (int c = 0; c < 3; c++)
                s->brightest = fmax(s->brightest, (double) hit.radiance[c]);
    }
    /* Mean density over samples of the lights, relative to a uniform environment. It includes the probability of choosing the light, which
     * makes less important environments count as more uniform, as it should. */
    s->environment_fraction = environments > 0.0 ? fmin(fmax((uneven / environments - 1.5) / 10.0, 0.0), 1.0) : 1.0;
    for (size_t i = 0; s->light_paths && i < s->solids->count; i++)
        if (s->solids->solids[i].num_triangles > 0 && !s->solid[i].rough && !(s->knobs.techniques & (PT_CONNECT | PT_LIGHT_PATHS))) {
            pell_warn(s->ctx, "path-trace", "leave the knob connections on",
                      "point, spot and directional lights do not light media below smooth surfaces: random paths can't hit them");
            break;
        }
    for (size_t i = 0; i < s->solids->count; i++)
        s->chains = s->chains || (s->solids->solids[i].num_triangles > 0 && !s->solid[i].rough);
    s->chains = s->chains && s->light_paths && (s->knobs.techniques & PT_SPECULAR_MANIFOLD) && s->radius > 0.0;
    s->light_paths = s->light_paths && (s->knobs.techniques & PT_LIGHT_PATHS) && s->radius > 0.0;
    s->light_rays = s->light_paths ? light_rays(s) : 0;
    s->typical = s->radius > 0.0 ? flux / (4.0 * PELL_PI * PELL_PI * s->radius * s->radius) : 0.0;
}

double pt_scene_brightest(const struct pt_scene *scene)
{
    return scene->brightest;
}

int pt_scene_exponent(const struct pt_scene *scene)
{
    const double order = scene->typical > 0.0 ? scene->typical : scene->brightest;
    int exponent = 0;

    if (order > 0.0 && isfinite(order))
        frexp(order, &exponent);
    return exponent < -300 ? -300 : exponent > 300 ? 300 : exponent;
}

bool pt_stopped(const struct pt_scene *scene)
{
    return pell_cancelled(scene->ctx) || pell_context_interrupted(scene->ctx);
}

void pt_scene_set_deadline(struct pt_scene *scene, double seconds)
{
    scene->deadline = seconds;
}

/* --- Construction --------------------------------------------------------------------------------------------------------------------- */

void pt_scene_destroy(struct pt_scene **scene)
{
    struct pt_scene *s = *scene;

    if (!s)
        return;
    *scene = NULL;
    pell_distance_destroy(&s->distance);
    pell_connector_destroy(&s->connector);
    pell_light_sampler_destroy(&s->light_sampler);
    pell_free(s->ctx, s->rough);
    pell_free(s->ctx, s->tint);
    pell_free(s->ctx, s->roughness_ranges);
    for (size_t i = 0; s->solid && i < s->solids->count; i++)
        pt_medium_finish(s->ctx, &s->solid[i].medium);
    pell_free(s->ctx, s->solid);
    pell_solids_destroy(&s->solids);
    pell_free(s->ctx, s);
}

/* Homogeneous, with Henyey-Greenstein phase functions and a finite mean free path: what the kernel of wavefront_kernel.h supports. */
static bool has_simple_medium(const struct pt_medium *m)
{
    return m->homogeneous && m->layers == 1 && m->layer[0].hg && m->min_sigma_t > 1e-12f && m->min_sigma_t < INFINITY;
}

static enum pell_result make_helpers(struct pt_scene *s)
{
    bool connects = false, grid = false;
    enum pell_result res;

    PELL_TRY(pell_light_sampler_create(s->ctx, s->scene, &s->light_sampler));
    for (size_t i = 0; i < s->solids->count; i++) {
        struct pt_solid *b = &s->solid[i];
        const bool connected = (s->knobs.techniques & PT_CONNECT) && pell_light_sampler_count(s->light_sampler) > 0;
        b->connects = b->smooth && connected;
        b->connects_rough = b->rough && connected;
        b->lanes = s->knobs.acceleration != PT_ACCELERATION_NONE && has_simple_medium(&b->medium);
        b->split_mm =
            (s->knobs.techniques & PT_SPLIT) && b->smooth && has_simple_medium(&b->medium) ? SPLIT_RANGE / b->medium.min_sigma_t : 0.0f;
        b->connect_mm = b->medium.min_sigma_t > 0.0f ? 1.0f / ((float) PT_RANGE_RATE * b->medium.min_sigma_t) : INFINITY;
        b->grid = s->knobs.acceleration == PT_ACCELERATION_GRID;
        connects = connects || b->connects || b->connects_rough;
        grid = grid || b->grid;
    }
    if (connects)
        PELL_TRY(pell_connector_create(s->ctx, s->scene, s->rays, s->solids, s->knobs.normals == PT_NORMALS_FLAT, &s->connector));
    if (grid)
        PELL_TRY(pell_distance_create(s->ctx, s->services->pool, s->scene, s->solids, GRID_BYTES, &s->distance));
    probe_lights(s);
    return PELL_OK;

fail:
    return res;
}

enum pell_result pt_scene_create(const struct pell_services *services, const struct pt_knobs *knobs, struct pt_scene **out)
{
    struct pell_context *ctx = services->ctx;
    struct pt_scene *s = pell_zalloc(ctx, sizeof(*s));
    enum pell_result res = PELL_ERR_NOMEM;

    *out = NULL;
    if (!s)
        return PELL_ERR_NOMEM;
    s->ctx = ctx;
    s->services = services;
    s->scene = services->scene;
    s->rays = services->rays;
    s->knobs = *knobs;
    s->deadline = (double) INFINITY;
    s->seed = reference_half_seed(pell_settings_seed(services->settings), knobs->half);
    PELL_TRY(pell_services_solids(services, &s->solids));
    res = PELL_ERR_NOMEM;
    s->solid = pell_calloc(ctx, s->solids->count + 1, sizeof(*s->solid));
    s->roughness_ranges = pell_calloc(ctx, s->scene->num_materials + 1, sizeof(*s->roughness_ranges));
    s->tint = pell_calloc(ctx, s->scene->num_materials + 1, sizeof(*s->tint));
    if (!s->solid || !s->roughness_ranges || !s->tint)
        goto fail;
    set_roughness_ranges(s);
    PELL_TRY(make_solids(s));
    make_boundaries_alike(s);
    pt_set_tints(s);
    PELL_TRY(make_boundaries(s));
    PELL_TRY(inspect(s));
    PELL_TRY(make_helpers(s));
    *out = s;
    return PELL_OK;

fail:
    pt_scene_destroy(&s);
    return res;
}

/* --- Rays ------------------------------------------------------------------------------------------------------------------------- */

/* mm: several rounding errors of a point on a triangle along its normal. Errors in the plane may be far larger, but rays of a thin plate
 * must not start deep inside it. */
static float rounding_along(struct pell_vec3 n, struct pell_vec3 a, struct pell_vec3 b, struct pell_vec3 c)
{
    const struct pell_vec3 most = vec3(fmaxf(fabsf(a.x), fmaxf(fabsf(b.x), fabsf(c.x))), fmaxf(fabsf(a.y), fmaxf(fabsf(b.y), fabsf(c.y))),
                                       fmaxf(fabsf(a.z), fmaxf(fabsf(b.z), fabsf(c.z))));

    return 1e-6f * (fabsf(n.x) * most.x + fabsf(n.y) * most.y + fabsf(n.z) * most.z) + 1e-12f;
}

void pt_hit_at(const struct pt_scene *s, uint32_t mesh, uint32_t triangle, float u, float v, struct pell_vec3 w, struct pt_hit *out)
{
    const struct pell_mesh *m = &s->scene->meshes[mesh];
    const uint32_t *i = m->index + 3 * (size_t) triangle;
    const float k = 1.0f - u - v;
    struct pell_vec3 p[3];

    pell_triangle_corners(m, triangle, p);
    out->mesh = mesh;
    out->triangle = triangle;
    out->u = u;
    out->v = v;
    out->p = vec3_add(vec3_add(vec3_mul(p[0], k), vec3_mul(p[1], u)), vec3_mul(p[2], v));
    out->ng = vec3_normalize(pell_triangle_cross(p));
    if (vec3_dot(out->ng, out->ng) < 0.5f)
        out->ng = vec3_mul(w, -1.0f); /* degenerate */
    out->epsilon = rounding_along(out->ng, p[0], p[1], p[2]);
    out->ns = out->ng;
    out->interpolated = false;
    if (s->knobs.normals == PT_NORMALS_SMOOTH && m->normal) {
        const float *n = m->normal;
        const struct pell_vec3 sum =
            vec3_add(vec3_add(vec3_mul(vec3_load(n + 3 * (size_t) i[0]), k), vec3_mul(vec3_load(n + 3 * (size_t) i[1]), u)),
                     vec3_mul(vec3_load(n + 3 * (size_t) i[2]), v));
        const float length = vec3_length(sum);
        if (length > 1e-6f && vec3_dot(sum, out->ng) > 1e-3f * length) {
            out->ns = vec3_mul(sum, 1.0f / length);
            out->interpolated = true;
        }
    }
    out->solid = mesh < s->solids->num_meshes ? s->solids->of_mesh[mesh] : -1;
    out->material = m->material;
}

bool pt_intersect(const struct pt_scene *s, struct pt_counts *counts, struct pell_vec3 x, struct pell_vec3 w, float reach, uint32_t mask,
                  struct pt_hit *out)
{
    const struct pell_ray ray = { { x.x, x.y, x.z }, 0.0f, { w.x, w.y, w.z }, reach, mask };
    struct pell_hit hit;

    counts->rays++;
    if (!pell_rays_closest(s->rays, &ray, &hit))
        return false;
    pt_hit_at(s, hit.mesh, hit.triangle, hit.u, hit.v, w, out);
    out->t = hit.t;
    return true;
}

bool pt_unoccluded(const struct pt_scene *s, struct pt_counts *counts, struct pell_vec3 x, struct pell_vec3 w, float reach, uint32_t mask)
{
    const struct pell_ray ray = { { x.x, x.y, x.z }, 0.0f, { w.x, w.y, w.z }, reach, mask };

    counts->rays++;
    return !pell_rays_occluded(s->rays, &ray);
}

/* --- Medium stack ----------------------------------------------------------------------------------------------------------------- */

bool pt_cross(const struct pt_scene *s, const struct pt_medium_stack *stack, int solid, bool enter, struct pt_medium_stack *before,
              struct pt_medium_stack *after)
{
    struct pt_medium_stack without = { 0 }, with;
    bool inside = false;

    for (int i = 0; i < stack->count; i++)
        inside = inside || stack->solid[i] == solid;
    for (int i = 0; !inside && !enter && i < stack->count; i++) /* a closed surface shared by several media: the one that was entered */
        if (s->solids->solids[stack->solid[i]].object == s->solids->solids[solid].object)
            solid = stack->solid[i];
    inside = false;

    for (int i = 0; i < stack->count; i++) {
        inside = inside || stack->solid[i] == solid;
        if (stack->solid[i] != solid)
            without.solid[without.count++] = stack->solid[i];
    }
    with = inside ? *stack : without;
    if (!inside && with.count < PT_STACK_DEPTH)
        with.solid[with.count++] = (int16_t) solid;
    if (enter && inside)
        return false;
    *before = enter ? without : with;
    *after = enter ? with : without;
    return true;
}

struct pell_dvec3 pt_normal_at(const struct pt_scene *s, const struct pt_hit *hit, struct pell_dvec3 at, const struct pell_dvec3 dp[2],
                               struct pell_dvec3 dn[2])
{
    const struct pell_mesh *m = &s->scene->meshes[hit->mesh];
    const uint32_t *i = m->index + 3 * (size_t) hit->triangle;
    struct pell_dvec3 p[3], n[3], e1, e2, off, sum, normal;
    double a, b, c, det, u, v, length;

    dn[0] = dn[1] = (struct pell_dvec3) { 0.0, 0.0, 0.0 };
    if (!hit->interpolated)
        return dvec3_widen(hit->ng);
    for (int k = 0; k < 3; k++) {
        p[k] = dvec3_widen(vec3_load(m->position + 3 * (size_t) i[k]));
        n[k] = dvec3_widen(vec3_load(m->normal + 3 * (size_t) i[k]));
    }
    e1 = dvec3_mad(p[1], -1.0, p[0]);
    e2 = dvec3_mad(p[2], -1.0, p[0]);
    a = dvec3_dot(e1, e1);
    b = dvec3_dot(e1, e2);
    c = dvec3_dot(e2, e2);
    det = a * c - b * b;
    if (!(det > 0.0))
        return dvec3_widen(hit->ns);
    off = dvec3_mad(at, -1.0, p[0]);
    u = (dvec3_dot(off, e1) * c - dvec3_dot(off, e2) * b) / det;
    v = (dvec3_dot(off, e2) * a - dvec3_dot(off, e1) * b) / det;
    sum = dvec3_mad(dvec3_mad(dvec3_mul(n[0], 1.0 - u - v), u, n[1]), v, n[2]);
    length = sqrt(dvec3_dot(sum, sum));
    if (!(length > 1e-9))
        return dvec3_widen(hit->ns);
    normal = dvec3_mul(sum, 1.0 / length);
    for (int k = 0; k < 2; k++) {
        const double f = dvec3_dot(dp[k], e1), g = dvec3_dot(dp[k], e2), du = (f * c - g * b) / det, dv = (g * a - f * b) / det;
        const struct pell_dvec3 d = dvec3_mad(dvec3_mul(dvec3_mad(n[1], -1.0, n[0]), du), dv, dvec3_mad(n[2], -1.0, n[0]));
        dn[k] = dvec3_mul(dvec3_mad(d, -dvec3_dot(d, normal), normal), 1.0 / length);
    }
    return normal;
}
