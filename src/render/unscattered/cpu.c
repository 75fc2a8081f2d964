/* SPDX-License-Identifier: MIT
 * cpu.c - see stage.h: one way through each pixel, sixteen side by side. */
#include "render/unscattered/boundary.h"

#include "math/scalar.h"
#include "scene/material_maps.h"
#include "scene/triangle.h"
#include "transport/surface_color.h"

#include <stdatomic.h>
#include <string.h>

#define LANES 16
#define TILE 4
#define SURFACES 16            /* that a way meets, at most */
#define FAINT (1.0f / 2048.0f) /* share of what is behind below which a way ends */
#define PER_PIXEL 0.5f         /* radius of what a pixel sees over how far ways of pixels beside each other are apart; */
#define ELSEWHERE 0.7f         /* those come out elsewhere, at most; */
#define STRAY 0.03f            /* wider, they come out as by chance; */
#define SHARP 0.004f           /* narrower, they are one */
#define OFFSET 6e-6f           /* of the largest coordinate and the distance: how far from a surface rays start, as those of "irradiance" */

struct job {
    const struct pell_unscattered *u;
    const struct pell_unscattered_params *p;
    int columns; /* of tiles */
    _Atomic bool stray;
    _Atomic int64_t rays;
};

/* The ways of a tile. */
struct packet {
    struct unscattered_way way[LANES];
    _Alignas(64) int32_t open[LANES]; /* -1: it goes on */
    bool began[LANES];                /* a way goes on behind the pixel's surface; */
    bool stray[LANES];                /* it comes out far from those beside it, or not at all */
    uint32_t number[LANES];           /* of its pixel */
    float rgb[3][LANES];
    float spacing; /* mm between pixels */
    int64_t rays;
};

static float largest(struct pell_vec3 p)
{
    return fmaxf(fabsf(p.x), fmaxf(fabsf(p.y), fabsf(p.z)));
}

static bool is_faint(const struct unscattered_way *w)
{
    return !(fmaxf(w->weight[0], fmaxf(w->weight[1], w->weight[2])) > FAINT);
}

static const struct unscattered_medium *medium_in(const struct job *job, const struct unscattered_way *w)
{
    return &job->u->media[w->in[w->count - 1].material];
}

static float index_in(const struct job *job, const struct unscattered_way *w)
{
    return w->count > 0 ? medium_in(job, w)->eta : 1.0f;
}

/* A boundary's facets and highlight, as far as maps don't say another thing. */
static void set_finish(const struct pell_material *m, struct unscattered_face *f)
{
    const struct pell_surface_uniform e = pell_surface_uniform(m);

    f->roughness = e.roughness;
    f->rho_s = (e.specular[0] + e.specular[1] + e.specular[2]) * (1.0f / 3.0f);
}

/* The way goes into the solid of an object and material, if that has a medium. */
static bool enter(const struct job *job, struct unscattered_face *f, int object, struct unscattered_way *w)
{
    const float before = index_in(job, w);

    if (w->count == UNSCATTERED_NEST || !job->u->media[f->material].is)
        return false;
    f->n1 = before;
    f->n2 = job->u->media[f->material].eta;
    if (unscattered_pass(job->p, f, w))
        w->in[w->count++] = (struct unscattered_place) { object, f->material, 0 };
    return true;
}

/* --- Pixels ------------------------------------------------------------------------------------------------------------------------- */

/* The surface that a pixel sees. */
static void begin(const struct job *job, struct packet *k, int i, int x, int y)
{
    const struct pell_unscattered_params *p = job->p;
    const struct pell_surface *s = p->surface;
    const size_t at = (size_t) ((ptrdiff_t) y * s->stride + x);
    const int material = (int) s->material[at] - 1;
    const struct pell_material *m = &p->scene->materials[material];
    struct unscattered_way *w = &k->way[i];
    struct unscattered_face f = { .material = material };
    struct pell_vec3 start, toward;

    pell_view_ray(p->view, (float) x, (float) y, &start, &toward);
    f.at = vec3_mad(start, s->depth[at], toward);
    f.n = vec3(s->ns[0][at], s->ns[1][at], s->ns[2][at]);
    f.ng = vec3(s->ng[0][at], s->ng[1][at], s->ng[2][at]);
    f.unit = OFFSET * (largest(f.at) + s->depth[at]);
    set_finish(m, &f);
    if (!pell_surface_is_uniform(m)) {
        f.roughness = s->roughness[at];
        f.rho_s = (s->specular[0][at] + s->specular[1][at] + s->specular[2][at]) * (1.0f / 3.0f);
    }
    k->number[i] = pell_hash((uint32_t) x ^ pell_hash((uint32_t) y ^ pell_hash(p->sample)));
    *w = (struct unscattered_way) { .along = vec3_normalize(toward), .weight = { 1.0f, 1.0f, 1.0f }, .bounces = p->bounces };
    w->bundle = k->number[i] % UNSCATTERED_BUNDLES;
    w->draw = (struct unscattered_draw) { .x = (uint32_t) x, .y = (uint32_t) y, .seed = pell_hash(p->sample) };
    k->spacing = p->view->orthographic ? 1.0f / p->view->focal_px : s->depth[at] / p->view->focal_px;
    k->open[i] = enter(job, &f, p->scene->meshes[s->mesh[at]].object, w) && w->count > 0 ? -1 : 0;
}

/* --- Surfaces ------------------------------------------------------------------------------------------------------------------------- */

/* What was hit by lane i; *outer: from outside, by the order of its corners. */
static struct unscattered_face face_of(const struct job *job, const struct pell_ray_hit16 *r, int i, bool *outer)
{
    const struct pell_scene *scene = job->p->scene;
    const struct pell_mesh *mesh = &scene->meshes[r->hit.mesh[i]];
    const struct pell_vec3 d = vec3(r->ray.dx[i], r->ray.dy[i], r->ray.dz[i]);
    const struct pell_vec3 ng = vec3_normalize(vec3(r->hit.ngx[i], r->hit.ngy[i], r->hit.ngz[i]));
    const float w[3] = { 1.0f - r->hit.u[i] - r->hit.v[i], r->hit.u[i], r->hit.v[i] };
    const struct pell_material *m = &scene->materials[mesh->material];
    struct unscattered_face f = { .material = mesh->material };
    struct pell_vec3 n = { 0 };
    float side;

    *outer = vec3_dot(ng, d) < 0.0f;
    side = *outer ? 1.0f : -1.0f;
    for (int k = 0; mesh->normal && k < 3; k++)
        n = vec3_mad(n, w[k], vec3_load(mesh->normal + 3 * (size_t) mesh->index[3 * (size_t) r->hit.triangle[i] + (size_t) k]));
    f.at = vec3_mad(vec3(r->ray.ox[i], r->ray.oy[i], r->ray.oz[i]), r->ray.tfar[i], d);
    f.ng = vec3_mul(ng, side);
    f.n = vec3_dot(n, ng) > 0.0f ? vec3_mul(vec3_normalize(n), side) : f.ng;
    f.unit = OFFSET * (largest(f.at) + r->ray.tfar[i]);
    set_finish(m, &f);
    if (m->roughness_map.texture) {
        float texel[4];
        pell_texel_at(&m->roughness_map, mesh, r->hit.triangle[i], r->hit.u[i], r->hit.v[i], texel);
        f.roughness = fminf(fmaxf(m->roughness * texel[m->roughness_map.channel & 3], 0.0f), 1.0f);
    }
    return f;
}

/* A surface met inside a solid. False: the way ends there. */
static bool meet_inside(const struct job *job, const struct pell_ray_hit16 *r, int i, struct unscattered_way *w)
{
    const struct unscattered_medium *m = medium_in(job, w);
    struct unscattered_place *in = &w->in[w->count - 1];
    const int object = job->p->scene->meshes[r->hit.mesh[i]].object;
    struct unscattered_place left = *in;
    struct unscattered_face f;
    bool outer;

    w->thickness += m->clearest * r->ray.tfar[i];
    for (int c = 0; c < 3; c++)
        w->weight[c] *= expf(-m->sigma_t[c] * r->ray.tfar[i]);
    f = face_of(job, r, i, &outer);
    if (job->p->scene->materials[f.material].opaque || is_faint(w))
        return false;
    if (object != in->object)
        return outer && enter(job, &f, object, w);
    if (outer || in->shells > 0) { /* a part of the same object inside it is no boundary */
        in->shells += outer ? 1 : -1;
        w->at = vec3_mad(f.at, -f.unit, f.ng);
        return true;
    }
    f.n1 = m->eta;
    w->count--;
    f.n2 = index_in(job, w);
    if (!unscattered_pass(job->p, &f, w))
        w->in[w->count++] = left;
    return true;
}

/* --- The open ----------------------------------------------------------------------------------------------------------------------- */

/* What surfaces behind reflect: `hit` says of which lanes. */
static void add_surfaces(const struct job *job, struct packet *k, const struct pell_ray_hit16 *r, const bool hit[LANES])
{
    const struct pell_unscattered_params *p = job->p;
    const struct pell_points_params what = { .mix = -1.0f, .spacing = k->spacing, .first = p->sample, .samples = 1 };
    struct pell_surface_points in = { r->hit.mesh, r->hit.triangle, r->hit.u, r->hit.v, k->number, NULL, NULL };
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
                smaller(k->way[i].weight[c] * light[c][i] * (opaque ? 1.0f : p->total[material][c]) * (1.0f / PELL_PI_F), 1e25f);
    }
}

/* How far apart the ways of a pixel and of those beside it are, as what a pixel sees. Bumps send ways from place to place: one of each
 * pixel alone would show lights behind them as specks. 0 where nothing is beside it; where others have come out elsewhere, or not yet, as
 * far as such ways are apart. The median, so that one edge beside it does not count. */
static float width_of_pixel(const struct packet *k, int i, const bool was_open[LANES])
{
    const int x = i % TILE, y = i / TILE;
    float apart[4];
    int count = 0;

    for (int side = 0; side < 4; side++) {
        const int dx = side < 2 ? 2 * side - 1 : 0, dy = side < 2 ? 0 : 2 * side - 5, j = i + dx + TILE * dy;
        float far;
        int at = count;
        if (x + dx < 0 || x + dx >= TILE || y + dy < 0 || y + dy >= TILE || !k->began[j])
            continue;
        far = was_open[j] ? fminf(vec3_length(vec3_sub(k->way[i].along, k->way[j].along)), ELSEWHERE) : ELSEWHERE;
        for (; at > 0 && apart[at - 1] > far; at--)
            apart[at] = apart[at - 1];
        apart[at] = far;
        count++;
    }
    return count > 0 ? PER_PIXEL * apart[(count - 1) / 2] : 0.0f;
}

/* Ways in the open: lights, then the surface that each meets. */
static void see(const struct job *job, struct packet *k, const struct pell_ray_hit16 *r, const bool was_open[LANES])
{
    const struct pell_scene *scene = job->p->scene;
    bool hit[LANES] = { false };

    for (int i = 0; i < LANES; i++) {
        const bool met = r->hit.mesh[i] < scene->num_meshes;
        const float drawn = k->way[i].lobe.drawn, apart = was_open[i] ? width_of_pixel(k, i, was_open) : 0.0f;
        const float width = sqrtf(fmaxf(apart * apart - drawn * drawn, 0.0f));
        struct unscattered_way w = k->way[i];
        float rgb[3] = { 0 };
        if (!was_open[i])
            continue;
        k->stray[i] = width > STRAY || drawn > 0.0f;
        if (width > SHARP)
            w.lobe.pixel = width;
        k->rays += unscattered_see_lights(job->u, job->p, &w, met ? r->ray.tfar[i] : INFINITY, rgb);
        for (int c = 0; c < 3; c++)
            k->rgb[c][i] += rgb[c];
        hit[i] = met && k->way[i].bounces-- > 0;
    }
    add_surfaces(job, k, r, hit);
    for (int i = 0; i < LANES; i++) {
        struct unscattered_face f;
        bool outer;
        if (!was_open[i])
            continue;
        k->open[i] = 0;
        if (!hit[i] || scene->materials[scene->meshes[r->hit.mesh[i]].material].opaque)
            continue;
        f = face_of(job, r, i, &outer);
        if (outer && job->u->media[f.material].thin && enter(job, &f, scene->meshes[r->hit.mesh[i]].object, &k->way[i]))
            k->open[i] = -(int32_t) !is_faint(&k->way[i]);
    }
}

/* --- All of it ---------------------------------------------------------------------------------------------------------------------- */

static void follow(const struct job *job, struct packet *k)
{
    struct pell_ray_hit16 r;

    for (int step = 0; step < SURFACES; step++) {
        bool was_open[LANES], any = false;
        for (int i = 0; i < LANES; i++) {
            const struct unscattered_way *w = &k->way[i];
            float reach = 0.0f;
            was_open[i] = k->open[i] && w->count == 0;
            if (k->open[i])
                reach = was_open[i] ? INFINITY : (UNSCATTERED_THICKEST - w->thickness) / medium_in(job, w)->clearest;
            pell_ray16_set(&r.ray, i, w->at, w->along, reach);
            r.hit.mesh[i] = r.hit.instance[i] = PELL_NO_HIT;
            any |= k->open[i] != 0;
            k->rays += k->open[i] != 0;
        }
        if (!any)
            return;
        pell_rays_closest16(job->p->rays, k->open, true, &r);
        for (int i = 0; i < LANES; i++)
            if (k->open[i] && !was_open[i])
                k->open[i] = -(int32_t) (r.hit.mesh[i] < job->p->scene->num_meshes && meet_inside(job, &r, i, &k->way[i]));
        see(job, k, &r, was_open);
    }
}

/* Where most ways of a tile are stray, all are. Returns whether any is. */
static bool mark_stray(struct packet *k)
{
    int began = 0, stray = 0;

    for (int i = 0; i < LANES; i++) {
        began += k->began[i];
        stray += k->stray[i];
    }
    if (2 * stray > began)
        memcpy(k->stray, k->began, sizeof(k->stray));
    return stray > 0;
}

static void tile(struct job *job, struct packet *k, int x0, int y0)
{
    const struct pell_unscattered_params *p = job->p;
    const struct pell_surface *s = p->surface;
    const struct pell_rect r = s->translucent;
    bool any = false, stray = false;

    for (int i = 0; i < LANES; i++) {
        const int x = x0 + i % TILE, y = y0 + i / TILE;
        const bool in = x >= r.x0 && x < r.x1 && y >= r.y0 && y < r.y1;
        const uint16_t material = in ? s->material[(ptrdiff_t) y * s->stride + x] : 0;
        k->open[i] = 0;
        k->began[i] = k->stray[i] = false;
        k->rgb[0][i] = k->rgb[1][i] = k->rgb[2][i] = 0.0f;
        if (material && job->u->media[material - 1].thin) {
            begin(job, k, i, x, y);
            k->began[i] = k->stray[i] = k->open[i] != 0;
            any |= k->open[i] != 0;
        }
    }
    if (any) {
        follow(job, k);
        stray = mark_stray(k);
    }
    for (int i = 0; i < LANES; i++) {
        const int x = x0 + i % TILE, y = y0 + i / TILE;
        for (int c = 0; c < 3 && x >= r.x0 && x < r.x1 && y >= r.y0 && y < r.y1; c++)
            p->light[c][(ptrdiff_t) y * s->stride + x] = k->stray[i] ? -fmaxf(k->rgb[c][i], UNSCATTERED_STRAY) : k->rgb[c][i];
    }
    if (stray)
        job->stray = true;
}

static void tile_row(void *arg, int index, int worker)
{
    struct job *job = arg;
    const struct pell_rect r = job->p->surface->translucent;
    const int y0 = (r.y0 / TILE + index) * TILE;
    struct packet k;

    (void) worker;
    memset(&k, 0, sizeof(k));
    for (int column = 0; column < job->columns; column++)
        tile(job, &k, (r.x0 / TILE + column) * TILE, y0);
    atomic_fetch_add(&job->rays, k.rays);
}

int64_t pell_unscattered_render(struct pell_pool *pool, const struct pell_unscattered *unscattered,
                                const struct pell_unscattered_params *params)
{
    const struct pell_rect r = params->surface->translucent;
    struct job job = { .u = unscattered, .p = params, .columns = (r.x1 + TILE - 1) / TILE - r.x0 / TILE };

    if (r.x1 <= r.x0)
        return 0;
    pell_pool_run(pool, (r.y1 + TILE - 1) / TILE - r.y0 / TILE, tile_row, &job);
    if (job.stray)
        unscattered_share_stray(pool, params);
    return job.rays;
}
