/* SPDX-License-Identifier: MIT
 * cpu.c - see stage.h: one path through each pixel, in packets of sixteen. */
#include "render/unscattered/boundary.h"

#include "math/scalar.h"
#include "scene/material_maps.h"
#include "scene/triangle.h"
#include "transport/surface_color.h"

#include <stdatomic.h>
#include <string.h>

#define LANES 16
#define TILE 4
#define MAX_SURFACES 16             /* largest number of surfaces on a path */
#define MIN_WEIGHT (1.0f / 2048.0f) /* least weight of a path */
#define FOOTPRINT 0.5f              /* footprint of a pixel over the angle between the paths of adjacent pixels; */
#define MAX_ANGLE 0.7f              /* largest angle, assumed where an adjacent path exits elsewhere; */
#define INCOHERENT_WIDTH 0.03f      /* width above which a path counts as incoherent; */
#define MIN_FOOTPRINT 0.004f        /* width below which the footprint is ignored */
#define RAY_OFFSET 6e-6f            /* of the largest coordinate and the distance: offset of ray origins, as in stage "irradiance" */

struct job {
    const struct pell_unscattered *u;
    const struct pell_unscattered_params *p;
    int columns; /* in tiles */
    _Atomic bool incoherent;
    _Atomic int64_t rays;
};

/* The paths of a tile. */
struct packet {
    struct unscattered_path path[LANES];
    _Alignas(64) int32_t active[LANES]; /* -1: the path continues */
    bool entered[LANES];                /* the path entered the pixel's surface; */
    bool incoherent[LANES];             /* it exits far from adjacent paths, or not at all */
    uint32_t seed[LANES];               /* of the pixel */
    float rgb[3][LANES];
    float spacing; /* distance between pixels, mm */
    int64_t rays;
};

static bool is_faint(const struct unscattered_path *w)
{
    return !(fmaxf(w->weight[0], fmaxf(w->weight[1], w->weight[2])) > MIN_WEIGHT);
}

static const struct unscattered_medium *current_medium(const struct job *job, const struct unscattered_path *w)
{
    return &job->u->media[w->medium_stack[w->nesting - 1].material];
}

static float current_eta(const struct job *job, const struct unscattered_path *w)
{
    return w->nesting > 0 ? current_medium(job, w)->eta : 1.0f;
}

/* Refracts the path into the solid of an object and material. Returns false if that has no medium. */
static bool enter(const struct job *job, struct unscattered_hit *f, int object, struct unscattered_path *w)
{
    const float before = current_eta(job, w);

    if (w->nesting == UNSCATTERED_MAX_NESTING || !job->u->media[f->boundary.material].is_traced)
        return false;
    f->n1 = before;
    f->n2 = job->u->media[f->boundary.material].eta;
    if (unscattered_cross(job->p, f, w))
        w->medium_stack[w->nesting++] = (struct unscattered_solid) { object, f->boundary.material, 0 };
    return true;
}

/* --- Pixels ------------------------------------------------------------------------------------------------------------------------- */

/* Starts a path at the visible surface of a pixel. */
static void start_path(const struct job *job, struct packet *k, int i, int x, int y)
{
    const struct pell_unscattered_params *p = job->p;
    const struct pell_surface *s = p->surface;
    const size_t at = (size_t) ((ptrdiff_t) y * s->stride + x);
    const int material = (int) s->material[at] - 1;
    const struct pell_material *m = &p->scene->materials[material];
    struct unscattered_path *w = &k->path[i];
    struct unscattered_hit f = { .boundary = unscattered_boundary_of(p->scene, material) };
    struct pell_vec3 start, ray_direction;

    pell_view_ray(p->view, (float) x, (float) y, &start, &ray_direction);
    f.position = vec3_mad(start, s->depth[at], ray_direction);
    f.n = vec3(s->ns[0][at], s->ns[1][at], s->ns[2][at]);
    f.ng = vec3(s->ng[0][at], s->ng[1][at], s->ng[2][at]);
    f.offset = RAY_OFFSET * (vec3_max_abs(f.position) + s->depth[at]);
    if (!pell_surface_is_uniform(m)) {
        f.boundary.roughness = s->roughness[at];
        f.boundary.rho_s = (s->specular[0][at] + s->specular[1][at] + s->specular[2][at]) * (1.0f / 3.0f);
    }
    k->seed[i] = pell_hash((uint32_t) x ^ pell_hash((uint32_t) y ^ pell_hash(p->sample)));
    *w = (struct unscattered_path) { .direction = vec3_normalize(ray_direction), .weight = { 1.0f, 1.0f, 1.0f }, .bounces = p->bounces };
    w->bundle = k->seed[i] % UNSCATTERED_BUNDLES;
    w->random = (struct unscattered_random) { .x = (uint32_t) x, .y = (uint32_t) y, .seed = pell_hash(p->sample) };
    k->spacing = pell_view_pixel_mm(p->view, s->depth[at]);
    k->active[i] = enter(job, &f, pell_mesh_assembly(&p->scene->meshes[s->mesh[at]]), w) && w->nesting > 0 ? -1 : 0;
}

/* --- Surfaces ------------------------------------------------------------------------------------------------------------------------- */

/* Loads the hit of lane i. *outer: from outside, by the order of the triangle's corners. */
static struct unscattered_hit load_hit(const struct job *job, const struct pell_ray_hit16 *r, int i, bool *outer)
{
    const struct pell_scene *scene = job->p->scene;
    const struct pell_mesh *mesh = &scene->meshes[r->hit.mesh[i]];
    const struct pell_vec3 d = vec3(r->ray.dx[i], r->ray.dy[i], r->ray.dz[i]);
    const struct pell_vec3 ng = vec3_normalize(vec3(r->hit.ngx[i], r->hit.ngy[i], r->hit.ngz[i]));
    const float w[3] = { 1.0f - r->hit.u[i] - r->hit.v[i], r->hit.u[i], r->hit.v[i] };
    const struct pell_material *m = &scene->materials[mesh->material];
    struct unscattered_hit f = { .boundary = unscattered_boundary_of(scene, mesh->material) };
    struct pell_vec3 n = { 0 };
    float side;

    *outer = vec3_dot(ng, d) < 0.0f;
    side = *outer ? 1.0f : -1.0f;
    for (int k = 0; mesh->normal && k < 3; k++)
        n = vec3_mad(n, w[k], vec3_load(mesh->normal + 3 * (size_t) mesh->index[3 * (size_t) r->hit.triangle[i] + (size_t) k]));
    f.position = vec3_mad(vec3(r->ray.ox[i], r->ray.oy[i], r->ray.oz[i]), r->ray.tfar[i], d);
    f.ng = vec3_mul(ng, side);
    f.n = vec3_dot(n, ng) > 0.0f ? vec3_mul(vec3_normalize(n), side) : f.ng;
    f.offset = RAY_OFFSET * (vec3_max_abs(f.position) + r->ray.tfar[i]);
    if (m->roughness_map.texture) {
        float texel[4];
        pell_texel_at(&m->roughness_map, mesh, r->hit.triangle[i], r->hit.u[i], r->hit.v[i], texel);
        f.boundary.roughness = fminf(fmaxf(m->roughness * texel[m->roughness_map.channel & 3], 0.0f), 1.0f);
    }
    return f;
}

/* Index of the solid of an object that contains the path; -1: none. */
static int find_solid(const struct unscattered_path *w, int object)
{
    int at = w->nesting - 1;

    while (at >= 0 && w->medium_stack[at].object != object)
        at--;
    return at;
}

/* Passes a surface that does not bound the current medium: of a part of an object inside itself, or of a solid that overlaps the one that
 * was entered last. */
static void pass_inside(struct unscattered_path *w, int at, bool outer)
{
    struct unscattered_solid *solid = &w->medium_stack[at];

    if (outer || solid->inner_surfaces > 0) {
        solid->inner_surfaces += outer ? 1 : -1;
        return;
    }
    w->nesting--;
    for (; at < w->nesting; at++)
        w->medium_stack[at] = w->medium_stack[at + 1];
}

/* Handles a hit inside a solid. Returns false if the path ends there. */
static bool hit_inside(const struct job *job, const struct pell_ray_hit16 *r, int i, struct unscattered_path *w)
{
    const struct unscattered_medium *m = current_medium(job, w);
    const struct unscattered_solid last = w->medium_stack[w->nesting - 1];
    const int object = pell_mesh_assembly(&job->p->scene->meshes[r->hit.mesh[i]]), at = find_solid(w, object);
    struct unscattered_hit f;
    bool outer;

    w->optical_thickness += m->min_sigma_t * r->ray.tfar[i];
    for (int c = 0; c < 3; c++)
        w->weight[c] *= expf(-m->sigma_t[c] * r->ray.tfar[i]);
    f = load_hit(job, r, i, &outer);
    if (job->p->scene->materials[f.boundary.material].opaque || is_faint(w))
        return false;
    if (at < 0)
        return outer && enter(job, &f, object, w);
    if (outer || last.inner_surfaces > 0 || object != last.object) {
        pass_inside(w, at, outer);
        w->position = vec3_mad(f.position, -f.offset, f.ng);
        return true;
    }
    f.n1 = m->eta;
    w->nesting--;
    f.n2 = current_eta(job, w);
    if (!unscattered_cross(job->p, &f, w))
        w->medium_stack[w->nesting++] = last;
    return true;
}

/* --- Outside -------------------------------------------------------------------------------------------------------------------------- */

/* Adds the light that surfaces in the background reflect, for lanes with `hit`. */
static void add_surface_light(const struct job *job, struct packet *k, const struct pell_ray_hit16 *r, const bool hit[LANES])
{
    const struct pell_unscattered_params *p = job->p;
    const struct pell_points_params what = { .mix = -1.0f, .spacing = k->spacing, .first = p->sample, .samples = 1 };
    struct pell_surface_points in = { r->hit.mesh, r->hit.triangle, r->hit.u, r->hit.v, k->seed, NULL, NULL };
    float light[3][LANES];
    const struct pell_surface_light out = { .irradiance = { light[0], light[1], light[2] } };
    uint32_t mesh[LANES];
    bool back[LANES], any = false;

    for (int i = 0; i < LANES; i++) {
        mesh[i] = hit[i] ? r->hit.mesh[i] : PELL_NO_HIT;
        back[i] = r->hit.ngx[i] * r->ray.dx[i] + r->hit.ngy[i] * r->ray.dy[i] + r->hit.ngz[i] * r->ray.dz[i] > 0.0f;
        any |= hit[i];
    }
    if (!any)
        return;
    in.mesh = mesh;
    in.back = back;
    k->rays += p->behind.light_points(p->behind.engine, &what, &in, LANES, &out);
    for (int i = 0; i < LANES; i++) {
        const int material = hit[i] ? p->scene->meshes[mesh[i]].material : 0;
        const bool opaque = p->scene->materials[material].opaque;
        for (int c = 0; hit[i] && c < 3; c++)
            k->rgb[c][i] +=
                smaller(k->path[i].weight[c] * light[c][i] * (opaque ? 1.0f : p->total[material][c]) * (1.0f / PELL_PI_F), 1e25f);
    }
}

/* Returns the footprint of a pixel: the angle between its path and adjacent ones. Bumps send paths to unrelated directions: with one
 * path per pixel, lights behind them would show as specks. 0 where no path is adjacent; MAX_ANGLE for adjacent paths that exit elsewhere
 * or not yet. The median is used, so that a single edge does not count. */
static float footprint(const struct packet *k, int i, const bool outside[LANES])
{
    const int x = i % TILE, y = i / TILE;
    float angle[4];
    int count = 0;

    for (int side = 0; side < 4; side++) {
        const int dx = side < 2 ? 2 * side - 1 : 0, dy = side < 2 ? 0 : 2 * side - 5, j = i + dx + TILE * dy;
        float neighbour;
        int at = count;
        if (x + dx < 0 || x + dx >= TILE || y + dy < 0 || y + dy >= TILE || !k->entered[j])
            continue;
        neighbour = outside[j] ? fminf(vec3_length(vec3_sub(k->path[i].direction, k->path[j].direction)), MAX_ANGLE) : MAX_ANGLE;
        for (; at > 0 && angle[at - 1] > neighbour; at--)
            angle[at] = angle[at - 1];
        angle[at] = neighbour;
        count++;
    }
    return count > 0 ? FOOTPRINT * angle[(count - 1) / 2] : 0.0f;
}

/* Adds the lights seen along paths outside, then the surface that each path hits. */
static void shade_outside(const struct job *job, struct packet *k, const struct pell_ray_hit16 *r, const bool outside[LANES])
{
    const struct pell_scene *scene = job->p->scene;
    bool hit[LANES] = { false };

    for (int i = 0; i < LANES; i++) {
        const bool hit_any = r->hit.mesh[i] < scene->num_meshes;
        const float sampled = k->path[i].lobe.sampled, size = outside[i] ? footprint(k, i, outside) : 0.0f;
        const float width = sqrtf(fmaxf(size * size - sampled * sampled, 0.0f));
        struct unscattered_path w = k->path[i];
        float rgb[3] = { 0 };
        if (!outside[i])
            continue;
        k->incoherent[i] = width > INCOHERENT_WIDTH || sampled > 0.0f;
        if (width > MIN_FOOTPRINT)
            w.lobe.pixel = width;
        k->rays += unscattered_add_lights(job->u, job->p, &w, hit_any ? r->ray.tfar[i] : INFINITY, rgb);
        for (int c = 0; c < 3; c++)
            k->rgb[c][i] += rgb[c];
        hit[i] = hit_any && k->path[i].bounces-- > 0;
    }
    add_surface_light(job, k, r, hit);
    for (int i = 0; i < LANES; i++) {
        struct unscattered_hit f;
        bool outer;
        if (!outside[i])
            continue;
        k->active[i] = 0;
        if (!hit[i] || scene->materials[scene->meshes[r->hit.mesh[i]].material].opaque)
            continue;
        f = load_hit(job, r, i, &outer);
        if (outer && job->u->media[f.boundary.material].thin &&
            enter(job, &f, pell_mesh_assembly(&scene->meshes[r->hit.mesh[i]]), &k->path[i]))
            k->active[i] = -(int32_t) !is_faint(&k->path[i]);
    }
}

/* --- Tiles ---------------------------------------------------------------------------------------------------------------------------- */

static void trace_paths(const struct job *job, struct packet *k)
{
    struct pell_ray_hit16 r;

    for (int step = 0; step < MAX_SURFACES; step++) {
        bool outside[LANES], any = false;
        for (int i = 0; i < LANES; i++) {
            const struct unscattered_path *w = &k->path[i];
            float reach = 0.0f;
            outside[i] = k->active[i] && w->nesting == 0;
            if (k->active[i])
                reach = outside[i] ? INFINITY : (UNSCATTERED_MAX_THICKNESS - w->optical_thickness) / current_medium(job, w)->min_sigma_t;
            pell_ray16_set(&r.ray, i, w->position, w->direction, reach);
            r.hit.mesh[i] = r.hit.instance[i] = PELL_NO_HIT;
            any |= k->active[i] != 0;
            k->rays += k->active[i] != 0;
        }
        if (!any)
            return;
        pell_rays_closest16(job->p->rays, k->active, true, &r);
        for (int i = 0; i < LANES; i++)
            if (k->active[i] && !outside[i])
                k->active[i] = -(int32_t) (r.hit.mesh[i] < job->p->scene->num_meshes && hit_inside(job, &r, i, &k->path[i]));
        shade_outside(job, k, &r, outside);
    }
}

/* Marks all paths of a tile as incoherent if most are. Returns whether any is. */
static bool mark_incoherent(struct packet *k)
{
    int entered = 0, incoherent = 0;

    for (int i = 0; i < LANES; i++) {
        entered += k->entered[i];
        incoherent += k->incoherent[i];
    }
    if (2 * incoherent > entered)
        memcpy(k->incoherent, k->entered, sizeof(k->incoherent));
    return incoherent > 0;
}

static void render_tile(struct job *job, struct packet *k, int x0, int y0)
{
    const struct pell_unscattered_params *p = job->p;
    const struct pell_surface *s = p->surface;
    const struct pell_rect r = s->translucent;
    bool any = false, incoherent = false;

    for (int i = 0; i < LANES; i++) {
        const int x = x0 + i % TILE, y = y0 + i / TILE;
        const bool in = x >= r.x0 && x < r.x1 && y >= r.y0 && y < r.y1;
        const uint16_t material = in ? s->material[(ptrdiff_t) y * s->stride + x] : 0;
        k->active[i] = 0;
        k->entered[i] = k->incoherent[i] = false;
        k->rgb[0][i] = k->rgb[1][i] = k->rgb[2][i] = 0.0f;
        if (material && job->u->media[material - 1].thin) {
            start_path(job, k, i, x, y);
            k->entered[i] = k->incoherent[i] = k->active[i] != 0;
            any |= k->active[i] != 0;
        }
    }
    if (any) {
        trace_paths(job, k);
        incoherent = mark_incoherent(k);
    }
    for (int i = 0; i < LANES; i++) {
        const int x = x0 + i % TILE, y = y0 + i / TILE;
        for (int c = 0; c < 3 && x >= r.x0 && x < r.x1 && y >= r.y0 && y < r.y1; c++)
            p->light[c][(ptrdiff_t) y * s->stride + x] = k->incoherent[i] ? -fmaxf(k->rgb[c][i], UNSCATTERED_INCOHERENT) : k->rgb[c][i];
    }
    if (incoherent)
        job->incoherent = true;
}

static void render_row(void *arg, int index, int worker)
{
    struct job *job = arg;
    const struct pell_rect r = job->p->surface->translucent;
    const int y0 = (r.y0 / TILE + index) * TILE;
    struct packet k;

    (void) worker;
    memset(&k, 0, sizeof(k));
    for (int column = 0; column < job->columns; column++)
        render_tile(job, &k, (r.x0 / TILE + column) * TILE, y0);
    atomic_fetch_add(&job->rays, k.rays);
}

int64_t pell_unscattered_render(struct pell_pool *pool, const struct pell_unscattered *unscattered,
                                const struct pell_unscattered_params *params)
{
    const struct pell_rect r = params->surface->translucent;
    struct job job = { .u = unscattered, .p = params, .columns = (r.x1 + TILE - 1) / TILE - r.x0 / TILE };

    if (r.x1 <= r.x0)
        return 0;
    pell_pool_run(pool, (r.y1 + TILE - 1) / TILE - r.y0 / TILE, render_row, &job);
    if (job.incoherent)
        unscattered_blur_incoherent(pool, params);
    return job.rays;
}
